//! What the feature tables of instances and points have in common: positions and directions.

use crate::tiles::content::bytes::Kind;
use crate::tiles::content::error::ContentError;
use crate::tiles::content::table::Table;
use glam::{DVec2, DVec3};

/// Vectors of triples.
pub(crate) fn vectors(numbers: Option<Vec<f64>>) -> Option<Vec<DVec3>> {
    let (triples, _) = numbers.as_deref()?.as_chunks::<3>();
    Some(triples.iter().map(|v| DVec3::from(*v)).collect())
}

/// Positions of things, plain or quantized [m].
pub(crate) fn positions(table: &Table, count: usize) -> Result<Option<Vec<DVec3>>, ContentError> {
    const STEPS: f64 = 65_535.0;
    if let Some(plain) = vectors(table.numbers("POSITION", 3, Kind::F32, count)?) {
        return Ok(Some(plain));
    }
    let name = "POSITION_QUANTIZED";
    let Some(steps) = vectors(table.numbers(name, 3, Kind::U16, count)?) else {
        return Ok(None);
    };
    let offset = table.vector("QUANTIZED_VOLUME_OFFSET", Kind::F32)?;
    let scale = table.vector("QUANTIZED_VOLUME_SCALE", Kind::F32)?;
    let Some((offset, scale)) = offset.zip(scale) else {
        let why = format!("{name} without QUANTIZED_VOLUME_OFFSET and QUANTIZED_VOLUME_SCALE");
        return Err(ContentError::damaged("feature table", why));
    };
    let place = |step: DVec3| step / STEPS * DVec3::from(scale) + DVec3::from(offset);
    Ok(Some(steps.into_iter().map(place).collect()))
}

/// Directions of things, plain or as two steps of an octahedron unfolded (`OCT32P`).
pub(crate) fn directions(
    table: &Table,
    name: &str,
    count: usize,
) -> Result<Option<Vec<DVec3>>, ContentError> {
    if let Some(plain) = vectors(table.numbers(name, 3, Kind::F32, count)?) {
        return Ok(Some(plain));
    }
    let steps = table.numbers(&format!("{name}_OCT32P"), 2, Kind::U16, count)?;
    Ok(steps.map(|steps| octahedral(&steps, 65_535.0)))
}

/// Unit vectors of pairs of steps on an unfolded octahedron (Meyer et al. 2010; Cigolle et al. 2014).
pub(crate) fn octahedral(steps: &[f64], largest: f64) -> Vec<DVec3> {
    let (pairs, _) = steps.as_chunks::<2>();
    let vector = |pair: &[f64; 2]| {
        let mut p = DVec2::from(*pair) / largest * 2.0 - 1.0;
        let z = 1.0 - p.x.abs() - p.y.abs();
        if z < 0.0 {
            let sign = |x: f64| if x < 0.0 { -1.0 } else { 1.0 };
            p = DVec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y));
        }
        p.extend(z).normalize_or(DVec3::Z)
    };
    pairs.iter().map(vector).collect()
}
