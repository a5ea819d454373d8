//! The first picture of a TIFF or BigTIFF file, decoded by `tiff-reader`.

use crate::sources::error::Fault;
use boresight_common::warning::Notes;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use tiff_reader::ifd::{ColorModel, ExtraSample, Ifd, RasterLayout};
use tiff_reader::{OpenOptions, Tag, TiffError, TiffFile};

/// What is done about a file whose coding is not read.
const MEND: &str =
    "convert it with gdal_translate -co COMPRESS=DEFLATE, or fetch it again if it is damaged";
/// What is done about samples that are not read.
const FLOAT: &str = "convert them with gdal_translate -ot Float32";
/// What is done about a file that is damaged.
const AGAIN: &str = "fetch it again, or write it again from its source";
/// Most pixels of a picture.
const MOST_PIXELS: u64 = 400_000_000;
/// The most that a byte of a file is taken to expand to; a file that promises more is damaged.
const MOST_GAIN: u64 = 4096;
/// Rows that are decoded at a time, so that a large picture is in memory once: a multiple of the usual tiles.
const ROWS: usize = 1024;
/// Its tag `NewSubfileType`, with the bit of a transparency mask.
const SUBFILE: u16 = 254;
const MASK: u32 = 4;
/// And with that of an overview.
const REDUCED: u32 = 1;

/// A file whose directories have been read.
pub struct Tiff {
    file: TiffFile,
    /// The directory of the full picture.
    page: usize,
    layout: RasterLayout,
}

fn fault(what: impl ToString, mend: &str) -> Fault {
    Fault::new("TIFF", what, mend)
}

fn none() -> Fault {
    fault(
        "this is no TIFF file",
        "name a GeoTIFF (gdal_translate writes one from most rasters)",
    )
}

fn refused(error: TiffError) -> Fault {
    match error {
        TiffError::InvalidMagic | TiffError::UnsupportedVersion(_) => none(),
        TiffError::UnsupportedBitsPerSample(_) | TiffError::UnsupportedSampleFormat(_) => {
            fault(error, FLOAT)
        }
        other => fault(other, MEND),
    }
}

/// A sample as a number: unsigned (1), signed (2) or floating (3), in the machine's byte order.
fn number(bytes: &[u8], format: u16) -> Option<f64> {
    Some(match (format, bytes.len()) {
        (1, 1) => f64::from(bytes[0]),
        (1, 2) => f64::from(u16::from_ne_bytes(bytes.try_into().ok()?)),
        (1, 4) => f64::from(u32::from_ne_bytes(bytes.try_into().ok()?)),
        (2, 1) => f64::from(bytes[0].cast_signed()),
        (2, 2) => f64::from(i16::from_ne_bytes(bytes.try_into().ok()?)),
        (2, 4) => f64::from(i32::from_ne_bytes(bytes.try_into().ok()?)),
        (1, 8) => u64::from_ne_bytes(bytes.try_into().ok()?) as f64,
        (2, 8) => i64::from_ne_bytes(bytes.try_into().ok()?) as f64,
        (3, 4) => f64::from(f32::from_ne_bytes(bytes.try_into().ok()?)),
        (3, 8) => f64::from_ne_bytes(bytes.try_into().ok()?),
        _ => return None,
    })
}

/// What kind of picture a directory says it is.
fn subfile(ifd: &Ifd) -> u32 {
    let kind = ifd.tag(SUBFILE).and_then(|tag| tag.value.as_u32());
    kind.unwrap_or(0)
}

impl Tiff {
    /// Opens a file of these bytes.
    pub fn open(bytes: Vec<u8>) -> Result<Self, Fault> {
        if bytes.len() < 8 {
            return Err(none());
        }
        let length = bytes.len() as u64;
        let options = OpenOptions {
            decode_output_bytes: 4 << 30, // [B]
            ..OpenOptions::default()
        };
        let file = TiffFile::from_bytes_with_options(bytes, options).map_err(refused)?;
        // Some put a small picture before the full one.
        let whole = |ifd: &Ifd| subfile(ifd) & (REDUCED | MASK) == 0;
        let page = file.ifds().iter().position(whole).unwrap_or(0);
        let layout = (file.ifd(page).and_then(Ifd::raster_layout)).map_err(refused)?;
        let pixels = layout.width as u64 * layout.height as u64;
        let bands = layout.samples_per_pixel as u64;
        if pixels == 0 || pixels > MOST_PIXELS || !(1..=16).contains(&bands) {
            let what = format!(
                "{} × {} pixels of {bands} bands are none, or too many",
                layout.width, layout.height
            );
            return Err(fault(
                what,
                "cut it to the city (gdalwarp -te), with the bands that are needed (-b)",
            ));
        }
        if pixels * bands * layout.bytes_per_sample as u64 > MOST_GAIN * length {
            return Err(fault("it is far too short for its pixels", AGAIN));
        }
        Ok(Self { file, page, layout })
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.layout.width, self.layout.height]
    }

    fn ifd(&self) -> Result<&Ifd, Fault> {
        self.file.ifd(self.page).map_err(refused)
    }

    fn tag(&self, code: u16) -> Option<&Tag> {
        self.file.ifd(self.page).ok()?.tag(code)
    }

    /// Whether a tag is there.
    pub fn has(&self, code: u16) -> bool {
        self.tag(code).is_some()
    }

    /// The numbers of a tag; none where it is absent.
    pub fn numbers(&self, code: u16) -> Vec<f64> {
        let value = |tag: &Tag| {
            let whole = || tag.value.as_u64_vec();
            let whole = || whole().map(|all| all.into_iter().map(|v| v as f64).collect());
            tag.value.as_f64_vec().or_else(whole)
        };
        self.tag(code).and_then(value).unwrap_or_default()
    }

    /// The text of a tag; empty where it is absent.
    pub fn text(&self, code: u16) -> &str {
        let text = self.tag(code).and_then(|tag| tag.value.as_str());
        text.unwrap_or("").trim_end_matches('\0')
    }

    /// All rows, some at a time: `read` decodes a range of them, `take` is given what it decoded. Damaged
    /// contents may make a decoder panic.
    fn rows(
        &self,
        read: impl Fn(&Range<usize>) -> Result<Vec<u8>, TiffError>,
        mut take: impl FnMut(Range<usize>, Vec<u8>),
    ) -> Result<(), Fault> {
        for from in (0..self.layout.height).step_by(ROWS) {
            let rows = from..(from + ROWS).min(self.layout.height);
            let decoded = catch_unwind(AssertUnwindSafe(|| read(&rows)));
            let bytes = decoded.map_err(|_| fault("its pixels are damaged", AGAIN))?;
            take(rows, bytes.map_err(refused)?);
        }
        Ok(())
    }

    /// What the tags state that changes what pixels are, and is not applied: pictures behind the first, turned rows.
    pub fn note(&self, notes: &mut Notes) {
        if self
            .ifd()
            .is_ok_and(|own| subfile(own) & (REDUCED | MASK) != 0)
        {
            let what =
                "the first is said to be a reduced picture or a mask, and is read all the same";
            notes.assume(
                "NewSubfileType",
                what,
                "put the full picture first (gdal_translate)",
            );
        }
        for (page, ifd) in self.file.ifds().iter().enumerate() {
            if page != self.page && subfile(ifd) & (REDUCED | MASK) == 0 {
                notes.leave_out("pictures behind the first", format!("picture {}", page + 1));
            }
        }
        let turned = self.numbers(274).first().copied().unwrap_or(1.0);
        if turned != 1.0 {
            let what = format!(
                "{turned} is not applied: the georeferencing says where rows and columns lie"
            );
            notes.assume(
                "Orientation",
                what,
                "write it row by row from the top left (gdal_translate)",
            );
        }
    }

    /// Refuses a picture in colours, and notes of several bands which one counts.
    pub fn heights_only(&self, description: Option<&str>, notes: &mut Notes) -> Result<(), Fault> {
        let photometric = self.numbers(262).first().copied().unwrap_or(1.0);
        let model = match photometric as u16 {
            0 | 1 => None,
            2 => Some("red, green and blue"),
            3 => Some("a palette"),
            4 => Some("a mask"),
            5 => Some("CMYK"),
            6 => Some("YCbCr"),
            _ => Some("colours of another model"),
        };
        if let Some(model) = model {
            let what = format!("a picture in {model}, no heights");
            let mend = "name it with --orthophoto, and a raster of heights as the source";
            return Err(Fault::new("PhotometricInterpretation", what, mend));
        }
        let all = self.layout.samples_per_pixel;
        let bands = all - usize::from(self.alpha(all).is_some());
        if bands > 1 {
            let named = description.map_or(String::new(), |name| format!(" ('{name}')"));
            let what = format!("{bands}: the first{named} is taken as heights");
            notes.assume("bands", what, "pick another with gdal_translate -b");
        }
        Ok(())
    }

    /// The band of so many that the tags call alpha.
    fn alpha(&self, bands: usize) -> Option<usize> {
        let extra = self.ifd().ok()?.extra_samples().ok()?;
        let is_alpha = |e: &ExtraSample| {
            matches!(
                e,
                ExtraSample::AssociatedAlpha | ExtraSample::UnassociatedAlpha
            )
        };
        let at = extra.iter().position(is_alpha)?;
        Some(bands.checked_sub(extra.len())? + at)
    }

    /// The first band, row by row from the top, each number made into a height; not a number where a sparse file has no block, where alpha
    /// is 0, and where the file's mask covers it.
    pub fn heights(&self, height: impl FnMut(f64) -> f32) -> Result<Vec<f32>, Fault> {
        let mut band = self.band(0, height)?;
        let alpha = self.alpha(self.layout.samples_per_pixel);
        if let Some(alpha) = alpha.filter(|alpha| *alpha > 0) {
            let shown = self.band(alpha, |value| value as f32)?;
            cover(&mut band, shown.iter().map(|alpha| *alpha != 0.0));
        }
        if let Some(shown) = self.shown()? {
            cover(&mut band, shown.into_iter());
        }
        Ok(band)
    }

    /// Whether the pixels of a mask's file are shown.
    pub fn as_mask(&self) -> Result<Vec<bool>, Fault> {
        let band = self.band(0, |value| value as f32)?;
        Ok(band.into_iter().map(|value| value != 0.0).collect())
    }

    /// The numbers of a band, row by row from the top; not a number where a sparse file has no block.
    pub fn band(&self, index: usize, mut made: impl FnMut(f64) -> f32) -> Result<Vec<f32>, Fault> {
        let RasterLayout {
            width,
            height,
            bytes_per_sample: wide,
            sample_format: format,
            ..
        } = self.layout;
        let unread = || {
            let bits = self.layout.bits_per_sample;
            fault(
                format!("samples of {bits} bits and format {format} are not read"),
                FLOAT,
            )
        };
        number(&vec![0; wide], format).ok_or_else(unread)?;
        let mut band = Vec::with_capacity(width * height);
        let read = |rows: &Range<usize>| {
            (self.file).read_band_window_bytes(self.page, index, rows.start, 0, rows.len(), width)
        };
        self.rows(read, |_, bytes| {
            let samples = bytes.chunks_exact(wide);
            band.extend(samples.map(|bytes| made(number(bytes, format).unwrap_or(f64::NAN))));
        })?;
        for [columns, rows] in self.holes()? {
            for row in rows {
                band[row * width + columns.start..row * width + columns.end].fill(f32::NAN);
            }
        }
        Ok(band)
    }

    /// Columns and rows of the first band's blocks that a sparse file leaves out.
    fn holes(&self) -> Result<Vec<[Range<usize>; 2]>, Fault> {
        let ifd = self.ifd()?;
        let [width, height] = self.size();
        let block = match (ifd.tile_width(), ifd.tile_height()) {
            (Some(wide), Some(high)) => [wide as usize, high as usize],
            _ => [width, ifd.rows_per_strip() as usize],
        };
        let (offsets, counts) = if ifd.is_tiled() {
            (ifd.tile_offsets(), ifd.tile_byte_counts())
        } else {
            (ifd.strip_offsets(), ifd.strip_byte_counts())
        };
        let (Some(offsets), Some(counts)) = (offsets, counts) else {
            return Ok(Vec::new());
        };
        let [wide, high] = block.map(|n| n.max(1));
        let across = width.div_ceil(wide);
        let blocks = offsets.iter().zip(&counts).enumerate();
        let empty = blocks.filter(|(_, (offset, count))| **offset == 0 || **count == 0);
        let place = |k: usize| {
            let [x, y] = [k % across * wide, k / across * high];
            [
                x..(x + wide).min(width),
                y.min(height)..(y + high).min(height),
            ]
        };
        Ok(empty.map(|(k, _)| place(k)).collect())
    }

    /// Red, green, blue and alpha of each pixel on a screen, row by row from the top: colours of any model that the
    /// file's tags name, its own alpha, its transparency mask, and its colour for no picture (`missing` in all bands).
    pub fn rgba(&self, missing: Option<f64>) -> Result<Vec<u8>, Fault> {
        let ifd = self.ifd()?;
        let model = ifd.color_model();
        // What are bands rather than colours is shown as it is stored.
        let stored = match &model {
            Ok(ColorModel::Rgb { .. }) | Err(_) => true,
            Ok(ColorModel::Grayscale { white_is_zero, .. }) => !white_is_zero,
            Ok(_) => false,
        };
        let layout = if stored {
            self.layout
        } else {
            ifd.decoded_raster_layout().map_err(refused)?
        };
        let (bands, wide) = (layout.samples_per_pixel, layout.bytes_per_sample);
        let shift = match (layout.sample_format, layout.bits_per_sample) {
            (1, 8) => 0,
            (1, 16) => 8,
            (_, bits) => {
                let what = format!("pictures of {bits} bits are not shown");
                return Err(fault(
                    what,
                    "convert it with gdal_translate -ot Byte -scale",
                ));
            }
        };
        let alpha = self.alpha(bands);
        let colours = alpha.unwrap_or(bands);
        let [green, blue] = if colours < 3 { [0, 0] } else { [1, 2] };
        let width = layout.width;
        let mut rgba = Vec::with_capacity(4 * width * layout.height);
        let read = |rows: &Range<usize>| {
            if stored {
                (self.file).read_window_bytes(self.page, rows.start, 0, rows.len(), width)
            } else {
                (self.file).read_decoded_window_bytes(self.page, rows.start, 0, rows.len(), width)
            }
        };
        self.rows(read, |_, bytes| {
            rgba.extend(bytes.chunks_exact(bands * wide).flat_map(|pixel| {
                let at = |band: usize| match shift {
                    0 => pixel[band],
                    _ => {
                        let sample = u16::from_ne_bytes([pixel[2 * band], pixel[2 * band + 1]]);
                        (sample >> shift) as u8
                    }
                };
                let none = missing.is_some_and(|missing| {
                    let mut samples = pixel.chunks_exact(wide).take(colours.max(1));
                    samples.all(|sample| number(sample, 1) == Some(missing))
                });
                let alpha = if none { 0 } else { alpha.map_or(255, at) };
                [at(0), at(green), at(blue), alpha]
            }));
        })?;
        if let Some(shown) = self.shown()? {
            transparent(&mut rgba, &shown);
        }
        Ok(rgba)
    }

    /// Whether the file's transparency mask shows each pixel; `None` without a mask.
    fn shown(&self) -> Result<Option<Vec<bool>>, Fault> {
        let kind = |ifd: &Ifd| ifd.tag(SUBFILE).and_then(|tag| tag.value.as_u32());
        let masks = |ifd: &Ifd| kind(ifd) == Some(MASK);
        let Some((index, ifd)) = (self.file.ifds().iter().enumerate()).find(|(_, ifd)| masks(ifd))
        else {
            return Ok(None);
        };
        let size = [ifd.width() as usize, ifd.height() as usize];
        if size != self.size() || ifd.samples_per_pixel() != 1 {
            let what = format!(
                "{} × {} pixels of {} bands do not cover the raster",
                size[0],
                size[1],
                ifd.samples_per_pixel()
            );
            let mend = "write the mask anew (gdal_translate -mask 1), or as the value for no data";
            return Err(Fault::new("transparency mask", what, mend));
        }
        let width = self.layout.width;
        let mut shown = Vec::with_capacity(width * self.layout.height);
        let read = |rows: &Range<usize>| {
            (self.file).read_decoded_window_bytes(index, rows.start, 0, rows.len(), width)
        };
        self.rows(read, |_, bytes| {
            shown.extend(bytes.iter().map(|byte| *byte != 0));
        })?;
        Ok(Some(shown))
    }
}

/// Makes heights not a number that a mask does not show.
pub fn cover(heights: &mut [f32], shown: impl Iterator<Item = bool>) {
    for (height, shown) in heights.iter_mut().zip(shown) {
        if !shown {
            *height = f32::NAN;
        }
    }
}

/// Makes pixels transparent that a mask does not show.
pub fn transparent(rgba: &mut [u8], shown: &[bool]) {
    for (pixel, shown) in rgba.chunks_exact_mut(4).zip(shown) {
        if !shown {
            pixel[3] = 0;
        }
    }
}
