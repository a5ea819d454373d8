//! Where the pixels of a raster lie on the map: pixel scale and tie point, matrix, control points, or a world file.

use super::keys::Keys;
use super::metadata::Beside;
use super::tiff::Tiff;
use crate::sources::error::Fault;
use boresight_common::warning::Notes;
use geotiff_core::transform::GeoTransform;
use glam::{DMat3, DVec2, DVec3};
use std::path::Path;

/// What a raster without a place on the map needs.
const WORLD: &str =
    "name one with georeferencing, or put a world file beside it (.tfw, .jgw, .pgw)";
/// How far a control point may lie from where the fit of all puts it [px]: a raster that is not straight on the map lies farther.
const STRAIGHT_PX: f64 = 0.5; // [px]
/// What is done about a raster that is not straight.
const WARP: &str = "bring it onto the map first (gdalwarp -t_srs)";

fn fault(what: impl ToString, mend: &str) -> Fault {
    Fault::new("georeferencing", what, mend)
}

/// From pixels (corner of the top left one: 0, 0) to the map and back.
pub fn placed(
    tiff: &Tiff,
    keys: &Keys,
    path: &Path,
    beside: &Beside,
    notes: &mut Notes,
) -> Result<GeoTransform, Fault> {
    let own = inside(tiff, keys, notes)?;
    let others = [
        (".aux.xml", beside.transform.map(ordered)),
        ("world file", world(path)?),
    ];
    let size = tiff.size().map(|n| n as f64);
    let mut found = own;
    for (name, other) in others {
        let (Some(first), Some(second)) = (found, other) else {
            found = found.or(other);
            continue;
        };
        if apart_px(&first, &second, size) > STRAIGHT_PX {
            let what = "it puts the raster elsewhere than the raster's own tags and is not applied";
            notes.assume(name, what, "remove the one that is wrong");
        }
    }
    if tiff.has(50_844) && found.is_none() {
        return Err(fault(
            "it is placed by RPCs, as pictures from space are before they lie flat",
            WARP,
        ));
    }
    let ties = tiff.numbers(33_922).len() / 6;
    if found.is_none() && ties > 0 {
        let what = format!("{ties} tie points without a pixel scale give no place");
        return Err(fault(what, WORLD));
    }
    checked(found)
}

/// The place that a world file, or the file of metadata beside it, gives a picture.
pub fn by_world_file(path: &Path, beside: &Beside) -> Result<GeoTransform, Fault> {
    checked(world(path)?.or(beside.transform.map(ordered)))
}

/// Farthest that two places of a raster lie apart, in pixels of the first.
fn apart_px(a: &GeoTransform, b: &GeoTransform, [width, height]: [f64; 2]) -> f64 {
    let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
    let apart = corners.map(|[x, y]| {
        let (east, north) = b.pixel_to_geo(x, y);
        let there = a.geo_to_pixel(east, north);
        there.map_or(f64::INFINITY, |(i, j)| (i - x).abs().max((j - y).abs()))
    });
    apart.into_iter().fold(0.0, f64::max)
}

/// Six numbers as GDAL orders them.
fn ordered(
    [
        origin_x,
        pixel_width,
        skew_x,
        origin_y,
        skew_y,
        pixel_height,
    ]: [f64; 6],
) -> GeoTransform {
    GeoTransform {
        origin_x,
        pixel_width,
        skew_x,
        origin_y,
        skew_y,
        pixel_height,
    }
}

/// The place that the file's own tags give; `None` where they give none.
fn inside(tiff: &Tiff, keys: &Keys, notes: &mut Notes) -> Result<Option<GeoTransform>, Fault> {
    let kind = keys.raster_type();
    let (matrix, scale, ties) = (
        tiff.numbers(34_264),
        tiff.numbers(33_550),
        tiff.numbers(33_922),
    );
    if let Ok(matrix) = <[f64; 16]>::try_from(matrix) {
        return Ok(Some(
            GeoTransform::from_transformation_matrix_with_raster_type(&matrix, kind),
        ));
    }
    let ties: Vec<[f64; 6]> = (ties.chunks_exact(6))
        .filter_map(|tie| tie.try_into().ok())
        .collect();
    let [width, height] = match scale.as_slice() {
        [x, y, ..] if *x != 0.0 && *y != 0.0 => [*x, *y],
        _ if ties.len() > 2 => return control_points(&ties, keys).map(Some),
        _ => return Ok(None),
    };
    let Some(&[i, j, _, x, y, _]) = ties.first() else {
        return Ok(None);
    };
    if height < 0.0 {
        let what = "the second pixel scale is negative: rows run from south to north, as the specification has it, where GDAL turns it round";
        notes.assume(
            "pixel scale",
            what,
            "write a matrix (ModelTransformation) or rows from the north (gdalwarp)",
        );
    }
    // A pixel that is a point lies where its tie point says with its centre.
    let half = match kind {
        geotiff_core::crs::RasterType::PixelIsPoint => 0.5,
        _ => 0.0,
    };
    let found = GeoTransform {
        origin_x: x - (i + half) * width,
        pixel_width: width,
        skew_x: 0.0,
        origin_y: y + (j + half) * height,
        skew_y: 0.0,
        pixel_height: -height,
    };
    let off = |[i, j, _, x, y, _]: &[f64; 6]| {
        let (east, north) = found.pixel_to_geo(i + half, j + half);
        ((east - x) / width).abs().max(((north - y) / height).abs())
    };
    let farthest_px = ties.iter().map(off).fold(0.0, f64::max);
    if farthest_px > STRAIGHT_PX {
        let what = format!(
            "{} tie points do not agree with the pixel scale, by {farthest_px:.1} px",
            ties.len()
        );
        return Err(fault(what, WARP));
    }
    Ok(Some(found))
}

/// The place that control points give, all of which lie straight on the map: a least-squares fit of an affine map.
fn control_points(ties: &[[f64; 6]], keys: &Keys) -> Result<GeoTransform, Fault> {
    let half = match keys.raster_type() {
        geotiff_core::crs::RasterType::PixelIsPoint => 0.5,
        _ => 0.0,
    };
    let points = || {
        ties.iter()
            .map(|[i, j, _, x, y, _]| (DVec2::new(i + half, j + half), DVec2::new(*x, *y)))
    };
    let count = ties.len() as f64;
    let mean = points().fold([DVec2::ZERO; 2], |[p, r], point| {
        [p + point.0 / count, r + point.1 / count]
    });
    let [mut normal, mut east, mut north] = [DMat3::ZERO, DMat3::ZERO, DMat3::ZERO];
    for (p, r) in points() {
        let (p, r) = ((p - mean[0]).extend(1.0), r - mean[1]);
        normal += DMat3::from_cols(p * p.x, p * p.y, p * p.z);
        east.x_axis += p * r.x;
        north.x_axis += p * r.y;
    }
    let size = points().fold(0.0, |far: f64, (p, _)| far.max((p - mean[0]).length()));
    if normal.determinant().abs() < 1e-9 * count * (count * size * size).powi(2) {
        let what = format!("its {} tie points lie on one line", ties.len());
        return Err(fault(
            what,
            "write the pixel scale, or place it with four corners (gdal_edit -a_ullr)",
        ));
    }
    let inverse = normal.inverse();
    let [e, n]: [DVec3; 2] = [inverse * east.x_axis, inverse * north.x_axis];
    let found = GeoTransform {
        origin_x: mean[1].x + e.z - e.x * mean[0].x - e.y * mean[0].y,
        pixel_width: e.x,
        skew_x: e.y,
        origin_y: mean[1].y + n.z - n.x * mean[0].x - n.y * mean[0].y,
        skew_y: n.x,
        pixel_height: n.y,
    };
    let off = |(p, r): (DVec2, DVec2)| {
        let there = found.geo_to_pixel(r.x, r.y);
        there.map_or(f64::INFINITY, |(i, j)| p.distance(DVec2::new(i, j)))
    };
    let farthest_px = points().map(off).fold(0.0, f64::max);
    if farthest_px > STRAIGHT_PX {
        let what = format!(
            "its {} tie points lie on no straight map, by {farthest_px:.1} px",
            ties.len()
        );
        return Err(fault(what, WARP));
    }
    Ok(found)
}

/// The place that a world file gives: six numbers, of the centre of the top left pixel. `None` where there is none.
fn world(path: &Path) -> Result<Option<GeoTransform>, Fault> {
    let extension = path.extension().and_then(|end| end.to_str()).unwrap_or("");
    let extension = extension.to_lowercase();
    let ends = extension.chars().next().zip(extension.chars().last());
    let short = ends.map_or(String::new(), |(first, last)| format!("{first}{last}w"));
    let names = [
        short.clone(),
        format!("{extension}w"),
        "wld".into(),
        short.to_uppercase(),
    ];
    let mut found = names.iter().filter_map(|name| {
        let path = path.with_extension(name);
        let bytes = std::fs::read(&path).ok()?;
        Some((path, bytes))
    });
    let Some((path, bytes)) = found.next() else {
        return Ok(None);
    };
    let text = String::from_utf8_lossy(&bytes);
    let text = text.trim_start_matches('\u{feff}');
    let numbers: Vec<f64> = text
        .split_whitespace()
        // Decimal commas and Fortran's exponents, as some programs write them.
        .map_while(|word| word.replace(',', ".").replace(['D', 'd'], "e").parse().ok())
        .collect();
    let Some(&[a, d, b, e, c, f]) = numbers.get(..6) else {
        let what = format!("{} does not begin with six numbers", path.display());
        return Err(fault(what, "write it again, or remove it"));
    };
    Ok(Some(ordered([
        c - (a + b) / 2.0,
        a,
        b,
        f - (d + e) / 2.0,
        d,
        e,
    ])))
}

/// Checks that a transform has an inverse.
fn checked(found: Option<GeoTransform>) -> Result<GeoTransform, Fault> {
    let sound = |t: &GeoTransform| {
        let numbers = [
            t.origin_x,
            t.origin_y,
            t.pixel_width,
            t.pixel_height,
            t.skew_x,
            t.skew_y,
        ];
        numbers.iter().all(|v| v.is_finite()) && t.geo_to_pixel(t.origin_x, t.origin_y).is_some()
    };
    found
        .filter(sound)
        .ok_or_else(|| fault("it has no place on the map", WORLD))
}
