//! Rasters with a place on the map: heights and pictures from above.

use super::grid;
use super::keys::{self, Keys, NAME, System};
use super::metadata::{Band, Beside};
use super::tiff::{Tiff, cover, transparent};
use crate::projection::{Crs, CrsError};
use crate::sources::error::{Fault, SourceError, read_bytes};
use crate::sources::options::Options;
use crate::sources::place;
use crate::sources::unit;
use boresight_common::jpeg::is_cut_off;
use boresight_common::warning::Notes;
use boresight_models::maths::geodesy::longitude_near_deg;
use geotiff_core::transform::GeoTransform;
use glam::DVec2;
use std::path::Path;

/// Heights [m] that points of the Earth may have; others stand for none.
const EARTHLY_M: std::ops::Range<f64> = -12_000.0..9_500.0; // [m]

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

/// A raster's place with its coordinates in the system's unit.
fn in_map_unit(t: GeoTransform, unit: f64) -> GeoTransform {
    GeoTransform {
        origin_x: t.origin_x * unit,
        pixel_width: t.pixel_width * unit,
        skew_x: t.skew_x * unit,
        origin_y: t.origin_y * unit,
        skew_y: t.skew_y * unit,
        pixel_height: t.pixel_height * unit,
    }
}

/// The value for none that the file states.
fn missing(tiff: &Tiff, notes: &mut Notes) -> Option<f64> {
    let text = tiff.text(42_113).trim();
    let value = text.replace(',', ".").parse().ok();
    if value.is_none() && !text.is_empty() {
        let what = format!("'{text}' is no number and marks no pixel as missing");
        notes.assume("GDAL_NODATA", what, "state it with gdal_edit -a_nodata");
    }
    value
}

/// Height of a step of the values, and of the value 0, as the third scale and coordinate of the georeferencing state them (GeoTIFF 1.1, 7.3).
fn upright(tiff: &Tiff, band: &mut Band, notes: &mut Notes) -> Result<(), Fault> {
    let (matrix, scale, tie) = (
        tiff.numbers(34_264),
        tiff.numbers(33_550),
        tiff.numbers(33_922),
    );
    let [step, zero] = match (<[f64; 16]>::try_from(matrix), scale.get(2), tie.get(..6)) {
        (Ok(m), ..) if [m[2], m[6], m[8], m[9]] != [0.0; 4] => {
            let mend = "bring it onto the map first (gdalwarp -t_srs)";
            return Err(Fault::new(
                "ModelTransformation",
                "a matrix that tilts the raster",
                mend,
            ));
        }
        (Ok(m), ..) => [m[10], m[11]],
        (_, Some(step), Some(tie)) => [*step, tie[5] - tie[2] * step],
        _ => return Ok(()),
    };
    let place = "third scale and tie point";
    let mend =
        "write the heights themselves, with 0 or 1 for the third scale (gdal_translate -unscale)";
    if !(step.is_finite() && zero.is_finite()) {
        notes.assume(place, "they are no numbers and are not applied", mend);
        return Ok(());
    }
    if zero == 0.0 && [0.0, 1.0].contains(&step) {
        return Ok(());
    }
    if step == 0.0 || band.scale.or(band.offset).is_some() {
        let what = format!("scale {step} and height {zero} are not applied to the heights");
        notes.assume(place, what, mend);
        return Ok(());
    }
    let what = format!(
        "heights are {zero} + {step} · value, as the specification has it, where GDAL takes the values alone"
    );
    notes.assume(place, what, mend);
    (band.scale, band.offset) = (Some(step), Some(zero));
    Ok(())
}

/// Whether the mask beside a raster (`dem.tif.msk`) shows each pixel; `None` where there is none.
fn mask_beside(path: &Path, size: [usize; 2]) -> Result<Option<Vec<bool>>, Fault> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".msk");
    let Ok(bytes) = std::fs::read(Path::new(&beside)) else {
        return Ok(None);
    };
    let mend = "write it again (gdal_translate -mask), or remove it";
    let wrong = |what: String| Fault::new("mask beside it (.msk)", what, mend);
    let mask = Tiff::open(bytes).map_err(|fault| wrong(fault.what))?;
    if mask.size() != size {
        return Err(wrong(format!(
            "{:?} pixels do not cover {size:?}",
            mask.size()
        )));
    }
    mask.as_mask().map(Some)
}

impl Heights {
    /// Reads a GeoTIFF's first band: its values by the scale, offset and unit that it states, without what it says is missing.
    pub fn read(path: &Path, options: &Options, notes: &mut Notes) -> Result<Self, SourceError> {
        let tiff = Tiff::open(read_bytes(path)?).map_err(|fault| fault.of(path))?;
        Self::decode(&tiff, path, options, notes).map_err(|fault| fault.of(path))
    }

    fn decode(
        tiff: &Tiff,
        path: &Path,
        options: &Options,
        notes: &mut Notes,
    ) -> Result<Self, Fault> {
        let [width, height] = tiff.size();
        if width * height > MOST_HEIGHTS {
            let what = format!("{width} × {height} heights are more than {MOST_HEIGHTS}");
            let mend = "cut it to the city, or thin it out (gdalwarp -tr)";
            return Err(Fault::new("heights", what, mend));
        }
        let beside = Beside::read(path, notes)?;
        let mut band = Band::parse(tiff.text(42_112), notes)?;
        band.missing = missing(tiff, notes).or(band.missing);
        let mut band = band.or(beside.band.clone(), notes);
        tiff.note(notes);
        tiff.heights_only(band.description.as_deref(), notes)?;
        let keys = Keys::of(tiff);
        let transform = grid::placed(tiff, &keys, path, &beside, notes)?;
        let none = || {
            Fault::new(
                "coordinates",
                "its keys name no coordinate reference system",
                NAME,
            )
        };
        let System { mut crs, to_map } = keys.system(options, &beside, notes)?.ok_or_else(none)?;
        if let Some(word) = band.unit.as_deref().filter(|word| !word.is_empty()) {
            let mend = "give the heights in metres, and say so (gdal_edit -units m)";
            let unknown = || {
                Fault::new(
                    "unit type",
                    format!("values in '{word}' are no heights in a unit known here"),
                    mend,
                )
            };
            let unit_m = unit::by_word(word).ok_or_else(unknown)?;
            crs = keys::stated(crs, unit_m, "unit type", options, notes);
        }
        place::note_heights(&crs, notes);
        let map_m = crs.map_unit_m();
        let unsaid =
            band.unit.is_none() && !keys.state_height_unit() && !crs.height_unit_is_stated();
        if map_m != 1.0 && unsaid {
            let what = format!(
                "in metres, as nothing else is said, though the map counts units of {map_m} m"
            );
            notes.assume("heights", what, "state their unit (gdal_edit -units ft)");
        }
        upright(tiff, &mut band, notes)?;
        let heights = values(tiff, &band, crs.height_unit_m(), notes)?;
        let mut found = Self {
            size: tiff.size(),
            crs,
            transform: in_map_unit(transform, to_map),
            heights,
        };
        if let Some(shown) = mask_beside(path, found.size)? {
            cover(&mut found.heights, shown.into_iter());
        }
        if found.heights.iter().all(|h| h.is_nan()) {
            let mend = "name a raster of heights, with their unit and scale";
            return Err(Fault::new("heights", "no pixel holds a height", mend));
        }
        Ok(found)
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
    /// pixel is missing. Longitudes may be written either side of 0 or ±180°.
    pub fn sample(&self, r: DVec2) -> Option<f64> {
        let r = if self.crs.is_geographic() {
            near(&self.transform, self.size, r)
        } else {
            r
        };
        let (x, y) = self.transform.geo_to_pixel(r.x, r.y)?;
        let [width, height] = self.size.map(|n| n as f64);
        if !((0.0..=width).contains(&x) && (0.0..=height).contains(&y)) {
            return None;
        }
        let around = self.is_around();
        let (x, y) = (x - 0.5, (y - 0.5).clamp(0.0, height - 1.0));
        let x = if around { x } else { x.clamp(0.0, width - 1.0) };
        let [columns, rows] = self.size;
        // The last column's neighbour is the first where the raster goes round the Earth.
        let column = |i: f64| match around {
            true => i.rem_euclid(width) as usize,
            false => (i as usize).min(columns - 1),
        };
        let (i, i1) = (column(x.floor()), column(x.floor() + 1.0));
        let (j, j1) = (y as usize, (y as usize + 1).min(rows - 1));
        let (fx, fy) = (x - x.floor(), y - j as f64);
        let top = self.at(i, j)? * (1.0 - fx) + self.at(i1, j)? * fx;
        let bottom = self.at(i, j1)? * (1.0 - fx) + self.at(i1, j1)? * fx;
        Some(top * (1.0 - fy) + bottom * fy)
    }

    /// Whether its columns go once round the Earth.
    fn is_around(&self) -> bool {
        let t = &self.transform;
        let all_deg = t.pixel_width.abs() * self.size[0] as f64;
        self.crs.is_geographic()
            && t.skew_x == 0.0
            && (all_deg - 360.0).abs() < t.pixel_width.abs() / 2.0
    }
}

/// A place in degrees with its longitude written as the raster's are.
fn near(transform: &GeoTransform, size: [usize; 2], r: DVec2) -> DVec2 {
    let (middle_deg, _) = transform.pixel_to_geo(size[0] as f64 / 2.0, size[1] as f64 / 2.0);
    DVec2::new(longitude_near_deg(r.x, middle_deg), r.y)
}

/// The most heights of a raster.
const MOST_HEIGHTS: usize = 64_000_000;
/// What most surveys write for no height, where they do not say so.
const USUAL_NONE: f64 = -9999.0;

/// The heights in a band's values, in a unit of so many metres. What lies on no place on Earth counts as missing.
fn values(tiff: &Tiff, band: &Band, unit_m: f64, notes: &mut Notes) -> Result<Vec<f32>, Fault> {
    let (scale, offset) = (band.scale.unwrap_or(1.0), band.offset.unwrap_or(0.0));
    if scale == 0.0 {
        let mend = "state it with gdal_edit -scale";
        return Err(Fault::new(
            "GDAL metadata: scale",
            "0 makes all heights the same",
            mend,
        ));
    }
    let mut off: Option<(u64, f64)> = None;
    let mut unstated = 0_u64;
    let heights = tiff.heights(|value| {
        // The text may have fewer digits than the value; of what no height comes near, far fewer.
        let near = |n: f64| n.abs() > 1e30 && (value / n - 1.0).abs() <= 1e-5;
        let is_none = |n: f64| value == n || value as f32 == n as f32 || near(n);
        if value.is_nan() || band.missing.is_some_and(is_none) {
            return f32::NAN;
        }
        if value == USUAL_NONE && band.missing.is_none() {
            unstated += 1;
            return f32::NAN;
        }
        let height = offset + scale * value;
        if EARTHLY_M.contains(&(height * unit_m)) {
            return height as f32;
        }
        off.get_or_insert((0, value)).0 += 1;
        f32::NAN
    })?;
    if unstated > 0 {
        let what = format!(
            "{unstated} pixels hold {USUAL_NONE}, which no value for none states, and count as missing"
        );
        let mend = "state it (gdal_edit -a_nodata -9999), or another value where they are heights";
        notes.assume("heights", what, mend);
    }
    if let Some((count, first)) = off {
        let what = format!(
            "{count} pixels hold what no place on Earth has (the first: {first}) and count as missing"
        );
        notes.assume(
            "heights",
            what,
            "state the value for none (gdal_edit -a_nodata), or the unit and scale",
        );
    }
    Ok(heights)
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
    pub fn read(path: &Path, notes: &mut Notes) -> Result<Self, SourceError> {
        let bytes = read_bytes(path)?;
        let found = match [&b"II"[..], b"MM"]
            .iter()
            .any(|head| bytes.starts_with(head))
        {
            true => Self::tiff(bytes, path, notes),
            false => Self::picture(bytes, path, notes),
        };
        found.map_err(|fault| fault.of(path))
    }

    /// A GeoTIFF.
    fn tiff(bytes: Vec<u8>, path: &Path, notes: &mut Notes) -> Result<Self, Fault> {
        let tiff = Tiff::open(bytes)?;
        let beside = Beside::read(path, notes)?;
        let keys = Keys::of(&tiff);
        tiff.note(notes);
        let band = Band::parse(tiff.text(42_112), &mut Notes::default())?;
        if band.scale.or(band.offset).is_some() {
            let what = "its scale and offset are not applied to the colours";
            notes.assume(
                "GDAL metadata",
                what,
                "write the colours themselves (gdal_translate -unscale)",
            );
        }
        let transform = grid::placed(&tiff, &keys, path, &beside, notes)?;
        let system = keys.map(&beside, notes).unwrap_or_else(|fault| {
            let what = format!("{}: taken as that of the heights", fault.what);
            let mend = "bring the picture to the heights' system (gdalwarp -t_srs)";
            notes.assume("the picture's system", what, mend);
            None
        });
        let to_map = system.as_ref().map_or(1.0, |system| system.to_map);
        let missing = missing(&tiff, notes).or(beside.band.missing);
        let mut found = Self {
            size: tiff.size(),
            crs: system.map(|system| system.crs),
            transform: in_map_unit(transform, to_map),
            rgba: tiff.rgba(missing)?,
        };
        if let Some(shown) = mask_beside(path, found.size)? {
            transparent(&mut found.rgba, &shown);
        }
        Ok(found)
    }

    /// A JPEG or PNG.
    fn picture(bytes: Vec<u8>, path: &Path, notes: &mut Notes) -> Result<Self, Fault> {
        let mend = "name a GeoTIFF, or a JPEG or PNG with a world file";
        let fault = |error: &dyn std::fmt::Display| Fault::new("picture", error, mend);
        if is_cut_off(&bytes) {
            return Err(fault(&"the JPEG is cut off"));
        }
        let reader = image::ImageReader::new(std::io::Cursor::new(bytes)).with_guessed_format();
        let mut reader = reader.map_err(|error| fault(&error))?;
        let mut limits = image::Limits::default();
        limits.max_alloc = Some(2 << 30);
        reader.limits(limits);
        let picture = reader.decode().map_err(|error| fault(&error))?.to_rgba8();
        let beside = Beside::read(path, notes)?;
        let crs = match beside.system.as_deref().and_then(keys::of_wkt) {
            Some(name) => Some(Crs::parse(&name)?),
            None => None,
        };
        let found = Self {
            size: [picture.width() as usize, picture.height() as usize],
            crs,
            transform: grid::by_world_file(path, &beside)?,
            rgba: picture.into_raw(),
        };
        match mask_beside(path, found.size)? {
            Some(shown) => {
                let mut found = found;
                transparent(&mut found.rgba, &shown);
                Ok(found)
            }
            None => Ok(found),
        }
    }

    /// Place in the picture [px] of a place on the map of some heights.
    pub fn pixel(&self, r: DVec2, heights: &Crs) -> Result<Option<DVec2>, CrsError> {
        let there = match &self.crs {
            Some(crs) => crs.horizontal(heights.to_geodetic(r.extend(0.0))?)?,
            None => r,
        };
        let there = match self.crs.as_ref().unwrap_or(heights).is_geographic() {
            true => near(&self.transform, self.size, there),
            false => there,
        };
        Ok(self
            .transform
            .geo_to_pixel(there.x, there.y)
            .map(DVec2::from))
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
