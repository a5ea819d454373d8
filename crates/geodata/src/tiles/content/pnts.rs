//! Point clouds (pnts).

use crate::tiles::content::bytes::{Kind, u32_at};
use crate::tiles::content::error::ContentError;
use crate::tiles::content::model::{Content, Context, linear};
use crate::tiles::content::semantic::{octahedral, positions};
use crate::tiles::content::table::{Parts, Table};
use boresight_models::shape::textured::{NO_FEATURE, PointCloud};
use glam::DVec3;

/// Length of the header [byte].
const HEADER: usize = 28;

/// Decodes a pnts, whose bytes end where it does.
pub(crate) fn decode(bytes: &[u8], context: &Context) -> Result<Content, ContentError> {
    let mut lengths = [0; 4];
    for (i, length) in lengths.iter_mut().enumerate() {
        *length = u32_at(bytes, 12 + 4 * i, "header")?;
    }
    let Parts {
        features: mut table,
        batch,
        ..
    } = Parts::new(bytes, HEADER, lengths, "header")?;
    let damaged = |why: &str| ContentError::damaged("feature table", why);
    let count = table.count("POINTS_LENGTH")?;
    let count = count.ok_or_else(|| damaged("it has no POINTS_LENGTH"))?;
    const POINT: usize = 64; // [byte] in memory, at most
    context.spend(count.saturating_mul(POINT), "feature table, POINTS_LENGTH")?;
    table.unpack(count, context)?;
    let found = positions(&table, count)?;
    let found = found.ok_or_else(|| damaged("it has neither POSITION nor POSITION_QUANTIZED"))?;
    let (low, high) = bounds(&found);
    let middle = 0.5 * (low + high);
    if !middle.is_finite() {
        return Err(damaged("a position is not finite"));
    }
    let center = table.vector("RTC_CENTER", Kind::F32)?.unwrap_or_default();
    let mut content = Content::default();
    let ids = table.numbers("BATCH_ID", 1, Kind::U16, count)?;
    let mut features = Vec::new();
    match ids {
        Some(ids) => {
            let rows = table.count("BATCH_LENGTH")?;
            let rows = rows.ok_or_else(|| damaged("BATCH_ID without BATCH_LENGTH"))?;
            let (all, notes) = batch.rows(rows, bytes.len(), context)?;
            let row = |id: &f64| {
                if (*id as usize) < rows {
                    *id as u32
                } else {
                    NO_FEATURE
                }
            };
            features = ids.iter().map(row).collect();
            content.features = all;
            notes.into_iter().for_each(|note| content.note(note));
        }
        None if !batch.is_empty() => content.note("properties of single points are left out"),
        None => {}
    }
    let to_f32 = |v: DVec3| v.as_vec3().to_array();
    let cloud = PointCloud {
        origin_m: DVec3::from(center) + middle,
        positions: found.iter().map(|p| to_f32(*p - middle)).collect(),
        colors: colors(&table, count)?,
        normals: normals(&table, count)?.into_iter().map(to_f32).collect(),
        features,
    };
    if count > 0 {
        content.points.push(cloud);
    }
    Ok(content)
}

/// Lowest and highest coordinates.
fn bounds(points: &[DVec3]) -> (DVec3, DVec3) {
    let first = points.first().copied().unwrap_or_default();
    let widen = |(low, high): (DVec3, DVec3), p: &DVec3| {
        // A coordinate that is no number shall not hide behind the others.
        if p.is_finite() {
            (low.min(*p), high.max(*p))
        } else {
            (DVec3::NAN, DVec3::NAN)
        }
    };
    let mut bounds = (first, first);
    for p in points {
        bounds = widen(bounds, p);
        if !bounds.0.is_finite() {
            break;
        }
    }
    bounds
}

/// Colours of points, which a file has in sRGB; alpha is linear.
fn colors(table: &Table, count: usize) -> Result<Vec<[f32; 4]>, ContentError> {
    const BYTE: f64 = 255.0;
    let rgba = |c: &[f64]| {
        let alpha = c.get(3).map_or(1.0, |a| *a / BYTE);
        [
            linear(c[0] / BYTE),
            linear(c[1] / BYTE),
            linear(c[2] / BYTE),
            alpha as f32,
        ]
    };
    for (name, components) in [("RGBA", 4), ("RGB", 3)] {
        if let Some(found) = table.numbers(name, components, Kind::U8, count)? {
            return Ok(found.chunks(components).map(rgba).collect());
        }
    }
    if let Some(found) = table.numbers("RGB565", 1, Kind::U16, count)? {
        let rgb = |c: &f64| {
            let c = *c as u32;
            let level = |shift: u32, bits: u32| {
                let largest = (1 << bits) - 1;
                linear(f64::from(c >> shift & largest) / f64::from(largest))
            };
            [level(11, 5), level(5, 6), level(0, 5), 1.0]
        };
        return Ok(found.iter().map(rgb).collect());
    }
    let one = table.numbers("CONSTANT_RGBA", 4, Kind::U8, 1)?;
    Ok(one.map_or_else(Vec::new, |one| vec![rgba(&one); count]))
}

/// Unit normals of points; none where the file has none.
fn normals(table: &Table, count: usize) -> Result<Vec<DVec3>, ContentError> {
    if let Some(plain) = table.numbers("NORMAL", 3, Kind::F32, count)? {
        let (triples, _) = plain.as_chunks::<3>();
        let unit = |v: &[f64; 3]| DVec3::from(*v).normalize_or(DVec3::Z);
        return Ok(triples.iter().map(unit).collect());
    }
    let steps = table.numbers("NORMAL_OCT16P", 2, Kind::U8, count)?;
    Ok(steps.map_or_else(Vec::new, |steps| octahedral(&steps, 255.0)))
}
