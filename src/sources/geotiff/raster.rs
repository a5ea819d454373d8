//! Rasters with a place on the map: heights and pictures from above.

use super::tiff::Tiff;
use crate::projection::Crs;
use crate::sources::error::{Fault, SourceError, read_bytes};
use crate::sources::options::Options;
use crate::sources::place;
use geotiff_core::crs::CrsInfo;
use geotiff_core::geokeys::GeoKeyDirectory;
use geotiff_core::transform::GeoTransform;
use glam::DVec2;
use std::path::Path;

/// What a raster without a place on the map needs.
const WORLD: &str =
    "name one with georeferencing, or put a world file beside it (.tfw, .jgw, .pgw)";

/// From pixels (corner of the top left one: 0, 0) to the map and back.
fn transform(tiff: &Tiff, keys: &CrsInfo) -> Option<GeoTransform> {
    let kind = keys.raster_type_enum();
    if let Ok(matrix) = <[f64; 16]>::try_from(tiff.numbers(34_264)) {
        return Some(GeoTransform::from_transformation_matrix_with_raster_type(
            &matrix, kind,
        ));
    }
    let tie = tiff.numbers(33_922).get(..6)?.try_into().ok()?;
    let scale = tiff.numbers(33_550).try_into().ok()?;
    Some(GeoTransform::from_tiepoint_and_scale_with_raster_type(
        &tie, &scale, kind,
    ))
}

/// The place that a world file gives: six numbers, of the centre of the top left pixel.
fn world(path: &Path) -> Option<GeoTransform> {
    let extension = path.extension()?.to_str()?.to_lowercase();
    let short: String = [extension.chars().next()?, extension.chars().last()?, 'w']
        .iter()
        .collect();
    let names = [
        short.clone(),
        format!("{extension}w"),
        "wld".into(),
        short.to_uppercase(),
    ];
    let text = names
        .iter()
        .find_map(|name| std::fs::read_to_string(path.with_extension(name)).ok())?;
    let numbers: Vec<f64> = text
        .split_whitespace()
        .map_while(|word| word.parse().ok())
        .collect();
    let &[a, d, b, e, c, f] = numbers.get(..6)? else {
        return None;
    };
    Some(GeoTransform {
        origin_x: c - (a + b) / 2.0,
        pixel_width: a,
        skew_x: b,
        origin_y: f - (d + e) / 2.0,
        skew_y: d,
        pixel_height: e,
    })
}

/// Checks that a transform has an inverse.
fn checked(found: Option<GeoTransform>, path: &Path) -> Result<GeoTransform, SourceError> {
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
    let none = || Fault::new("georeferencing", "it has no place on the map", WORLD).of(path);
    found.filter(sound).ok_or_else(none)
}

/// The keys of a GeoTIFF.
fn keys(tiff: &Tiff) -> CrsInfo {
    let directory: Vec<u16> = tiff.numbers(34_735).iter().map(|v| *v as u16).collect();
    let parsed = GeoKeyDirectory::parse(&directory, &tiff.numbers(34_736), tiff.text(34_737));
    CrsInfo::from_geokeys(&parsed.unwrap_or_default())
}

/// The system that keys name.
fn named(keys: &CrsInfo) -> Option<String> {
    let horizontal = keys.projected_epsg().or(keys.geodetic_epsg());
    let known = |code: &u16| ![0, 32_767].contains(code);
    let horizontal = horizontal.filter(known)?;
    Some(match keys.vertical_epsg().filter(known) {
        Some(vertical) => format!("EPSG:{horizontal}+{vertical}"),
        None => format!("EPSG:{horizontal}"),
    })
}

/// Heights on a map.
pub struct Heights {
    /// Columns and rows.
    pub size: [usize; 2],
    /// The map's system.
    pub crs: Crs,
    transform: GeoTransform,
    /// Row by row from the top; not a number where there is none.
    heights: Vec<f32>,
}

impl Heights {
    /// Reads a GeoTIFF's first band.
    pub fn read(path: &Path, options: &Options) -> Result<Self, SourceError> {
        let tiff = Tiff::open(read_bytes(path)?).map_err(|fault| fault.of(path))?;
        let keys = keys(&tiff);
        let transform = checked(transform(&tiff, &keys).or_else(|| world(path)), path)?;
        let none = || {
            Fault::new(
                "coordinates",
                "its keys name no coordinate reference system",
                "name it with --crs",
            )
        };
        let name = options
            .crs
            .clone()
            .or_else(|| named(&keys))
            .ok_or_else(none);
        let crs = name
            .and_then(|name| place::crs(&name, options))
            .map_err(|fault| fault.of(path))?;
        let nodata: Option<f64> = tiff.text(42_113).trim().parse().ok();
        let mut heights = tiff.band().map_err(|fault| fault.of(path))?;
        for height_m in &mut heights {
            let h = f64::from(*height_m);
            // No point of the Earth lies so far from its surface: values for no data that no tag names.
            if nodata.is_some_and(|n| (h - n).abs() <= 1e-6 * n.abs())
                || !(-12_000.0..9_500.0).contains(&h)
            {
                *height_m = f32::NAN;
            }
        }
        if heights.iter().all(|h| h.is_nan()) {
            return Err(Fault::new(
                "heights",
                "no pixel holds a height",
                "name a raster of heights in metres",
            )
            .of(path));
        }
        Ok(Self {
            size: tiff.size(),
            crs,
            transform,
            heights,
        })
    }

    /// East or longitude and north or latitude of a pixel's centre.
    pub fn center(&self, column: usize, row: usize) -> DVec2 {
        self.transform
            .pixel_to_geo(column as f64 + 0.5, row as f64 + 0.5)
            .into()
    }

    /// Height of a pixel, in the map's vertical system.
    pub fn at(&self, column: usize, row: usize) -> Option<f64> {
        let h = *self.heights.get(row * self.size[0] + column)?;
        (column < self.size[0] && !h.is_nan()).then(|| f64::from(h))
    }

    /// Height at a place on the map, between pixels' centres bilinear, at the edge the nearest one's; `None` outside and where a
    /// pixel is missing.
    pub fn sample(&self, r: DVec2) -> Option<f64> {
        let (x, y) = self.transform.geo_to_pixel(r.x, r.y)?;
        let [width, height] = self.size.map(|n| n as f64);
        if !((0.0..=width).contains(&x) && (0.0..=height).contains(&y)) {
            return None;
        }
        let x = (x - 0.5).clamp(0.0, width - 1.0);
        let y = (y - 0.5).clamp(0.0, height - 1.0);
        let (i, j) = (x as usize, y as usize);
        let (i1, j1) = ((i + 1).min(self.size[0] - 1), (j + 1).min(self.size[1] - 1));
        let (fx, fy) = (x - i as f64, y - j as f64);
        let top = self.at(i, j)? * (1.0 - fx) + self.at(i1, j)? * fx;
        let bottom = self.at(i, j1)? * (1.0 - fx) + self.at(i1, j1)? * fx;
        Some(top * (1.0 - fy) + bottom * fy)
    }
}

/// A picture from above on a map.
pub struct Orthophoto {
    /// Columns and rows.
    pub size: [usize; 2],
    /// The map's system; `None`: that of what it is laid over.
    pub crs: Option<Crs>,
    transform: GeoTransform,
    rgba: Vec<u8>,
}

impl Orthophoto {
    /// Reads a GeoTIFF, or a JPEG or PNG with a world file.
    pub fn read(path: &Path, options: &Options) -> Result<Self, SourceError> {
        let bytes = read_bytes(path)?;
        let fault = |what: String| {
            Fault::new(
                "picture",
                what,
                "name a GeoTIFF, or a JPEG or PNG with a world file",
            )
            .of(path)
        };
        if [&b"II"[..], b"MM"]
            .iter()
            .any(|head| bytes.starts_with(head))
        {
            let tiff = Tiff::open(bytes).map_err(|fault| fault.of(path))?;
            let keys = keys(&tiff);
            let transform = checked(transform(&tiff, &keys).or_else(|| world(path)), path)?;
            let crs = named(&keys)
                .map(|name| place::crs(&name, options))
                .transpose();
            return Ok(Self {
                size: tiff.size(),
                crs: crs.map_err(|fault| fault.of(path))?,
                transform,
                rgba: tiff.rgba().map_err(|fault| fault.of(path))?,
            });
        }
        let transform = checked(world(path), path)?;
        let reader = image::ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format();
        let mut reader = reader.map_err(|error| fault(error.to_string()))?;
        let mut limits = image::Limits::default();
        limits.max_alloc = Some(2 << 30);
        reader.limits(limits);
        let picture = reader
            .decode()
            .map_err(|error| fault(error.to_string()))?
            .to_rgba8();
        let size = [picture.width() as usize, picture.height() as usize];
        Ok(Self {
            size,
            crs: None,
            transform,
            rgba: picture.into_raw(),
        })
    }

    /// Place in the picture [px] of a place on the map.
    pub fn pixel(&self, r: DVec2) -> Option<DVec2> {
        self.transform.geo_to_pixel(r.x, r.y).map(DVec2::from)
    }

    /// A pixel; `None` outside.
    pub fn at(&self, column: i64, row: i64) -> Option<[u8; 4]> {
        let [width, height] = self.size.map(|n| n as i64);
        let inside = (0..width).contains(&column) && (0..height).contains(&row);
        let at = 4 * (row * width + column).max(0) as usize;
        self.rgba
            .get(at..at + 4)
            .filter(|_| inside)?
            .try_into()
            .ok()
    }
}
