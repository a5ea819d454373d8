//! The first picture of a TIFF or BigTIFF file, decoded by `tiff-reader`.

use crate::sources::error::Fault;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use tiff_reader::ifd::{ColorModel, ExtraSample, Ifd, RasterLayout};
use tiff_reader::{OpenOptions, Tag, TiffError, TiffFile};

/// What is done about a file that is not read.
const MEND: &str = "convert it with gdal_translate -co COMPRESS=DEFLATE, or cut it to the city";
/// Most pixels of a picture.
const MOST_PIXELS: u64 = 400_000_000;
/// The most that a byte of a file is taken to expand to; a file that promises more is damaged.
const MOST_GAIN: u64 = 4096;
/// Rows that are decoded at a time, so that a large picture is in memory once: a multiple of the usual tiles.
const ROWS: usize = 1024;
/// Its tag `NewSubfileType`, with the bit of a transparency mask.
const SUBFILE: u16 = 254;
const MASK: u32 = 4;

/// A file whose directories have been read.
pub struct Tiff {
    file: TiffFile,
    layout: RasterLayout,
}

fn fault(what: impl ToString) -> Fault {
    Fault::new("TIFF", what, MEND)
}

fn refused(error: TiffError) -> Fault {
    match error {
        TiffError::InvalidMagic | TiffError::UnsupportedVersion(_) => fault("this is no TIFF file"),
        other => fault(other),
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
        (3, 4) => f64::from(f32::from_ne_bytes(bytes.try_into().ok()?)),
        (3, 8) => f64::from_ne_bytes(bytes.try_into().ok()?),
        _ => return None,
    })
}

impl Tiff {
    /// Opens a file of these bytes.
    pub fn open(bytes: Vec<u8>) -> Result<Self, Fault> {
        if bytes.len() < 8 {
            return Err(fault("this is no TIFF file"));
        }
        let length = bytes.len() as u64;
        let options = OpenOptions {
            decode_output_bytes: 4 << 30, // [B]
            ..OpenOptions::default()
        };
        let file = TiffFile::from_bytes_with_options(bytes, options).map_err(refused)?;
        let layout = (file.ifd(0).and_then(Ifd::raster_layout)).map_err(refused)?;
        let pixels = layout.width as u64 * layout.height as u64;
        let bands = layout.samples_per_pixel as u64;
        if pixels == 0 || pixels > MOST_PIXELS || !(1..=16).contains(&bands) {
            return Err(fault(format!(
                "{} × {} pixels of {bands} bands are none, or too many",
                layout.width, layout.height
            )));
        }
        if pixels * bands * layout.bytes_per_sample as u64 > MOST_GAIN * length {
            return Err(fault("it is far too short for its pixels"));
        }
        Ok(Self { file, layout })
    }

    /// Columns and rows.
    pub fn size(&self) -> [usize; 2] {
        [self.layout.width, self.layout.height]
    }

    fn ifd(&self) -> Result<&Ifd, Fault> {
        self.file.ifd(0).map_err(refused)
    }

    fn tag(&self, code: u16) -> Option<&Tag> {
        self.file.ifd(0).ok()?.tag(code)
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
            let bytes = decoded.map_err(|_| fault("its pixels are damaged"))?;
            take(rows, bytes.map_err(refused)?);
        }
        Ok(())
    }

    /// The numbers of the first band, row by row from the top; not a number where a sparse file has no block.
    pub fn band(&self) -> Result<Vec<f32>, Fault> {
        let RasterLayout {
            width,
            height,
            bytes_per_sample: wide,
            sample_format: format,
            ..
        } = self.layout;
        let unread = || {
            let bits = self.layout.bits_per_sample;
            fault(format!("samples of {bits} bits are not read"))
        };
        number(&vec![0; wide], format).ok_or_else(unread)?;
        let mut band = Vec::with_capacity(width * height);
        let read = |rows: &Range<usize>| {
            (self.file).read_band_window_bytes(0, 0, rows.start, 0, rows.len(), width)
        };
        self.rows(read, |_, bytes| {
            let samples = bytes.chunks_exact(wide);
            band.extend(samples.map(|bytes| number(bytes, format).unwrap_or(f64::NAN) as f32));
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
    /// file's tags name, its own alpha, and its transparency mask.
    pub fn rgba(&self) -> Result<Vec<u8>, Fault> {
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
            (_, bits) => return Err(fault(format!("pictures of {bits} bits are not shown"))),
        };
        let alpha = ifd.extra_samples().ok().and_then(|extra| {
            let is_alpha = |e: &ExtraSample| {
                matches!(
                    e,
                    ExtraSample::AssociatedAlpha | ExtraSample::UnassociatedAlpha
                )
            };
            Some(bands.checked_sub(extra.len())? + extra.iter().position(is_alpha)?)
        });
        let colours = alpha.unwrap_or(bands);
        let [green, blue] = if colours < 3 { [0, 0] } else { [1, 2] };
        let width = layout.width;
        let mut rgba = Vec::with_capacity(4 * width * layout.height);
        let read = |rows: &Range<usize>| {
            if stored {
                (self.file).read_window_bytes(0, rows.start, 0, rows.len(), width)
            } else {
                (self.file).read_decoded_window_bytes(0, rows.start, 0, rows.len(), width)
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
                [at(0), at(green), at(blue), alpha.map_or(255, at)]
            }));
        })?;
        self.mask(&mut rgba)?;
        Ok(rgba)
    }

    /// Makes transparent what the file's transparency mask covers.
    fn mask(&self, rgba: &mut [u8]) -> Result<(), Fault> {
        let kind = |ifd: &Ifd| ifd.tag(SUBFILE).and_then(|tag| tag.value.as_u32());
        let masks = |ifd: &Ifd| {
            kind(ifd) == Some(MASK)
                && [ifd.width() as usize, ifd.height() as usize] == self.size()
                && ifd.samples_per_pixel() == 1
        };
        let Some(index) = self.file.ifds().iter().position(masks) else {
            return Ok(());
        };
        let width = self.layout.width;
        let read = |rows: &Range<usize>| {
            (self.file).read_decoded_window_bytes(index, rows.start, 0, rows.len(), width)
        };
        self.rows(read, |rows, shown| {
            let pixels = rgba[4 * width * rows.start..].chunks_exact_mut(4);
            for (pixel, shown) in pixels.zip(shown) {
                if shown == 0 {
                    pixel[3] = 0;
                }
            }
        })
    }
}
