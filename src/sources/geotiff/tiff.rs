//! The first picture of a TIFF or BigTIFF file (TIFF 6.0; strips and tiles; none, LZW, Deflate, PackBits; predictors 1, 2, 3).
//!
//! `geotiff-reader` reads rasters with its feature `local` only, which this crate does not build; its georeferencing is used.

use crate::sources::error::Fault;
use flate2::bufread::ZlibDecoder;
use std::collections::BTreeMap;
use std::io::Read;

/// What is done about a file that is not read.
const MEND: &str = "convert it with gdal_translate -co COMPRESS=DEFLATE, or cut it to the city";
/// Most pixels of a picture.
const MOST_PIXELS: u64 = 400_000_000;
/// The most that a byte of any of the compressions expands to; a file that promises more is damaged.
const MOST_GAIN: u64 = 4096;

/// A picture in memory.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Samples of a pixel.
    pub bands: usize,
    /// Samples, pixel by pixel, row by row from the top, as they are stored but in little-endian order.
    raw: Vec<u8>,
    sample: Sample,
    /// All numeric tags.
    tags: BTreeMap<u16, Vec<f64>>,
    /// All texts.
    texts: BTreeMap<u16, String>,
}

/// How a sample is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sample {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

impl Sample {
    fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

fn fault(what: impl ToString) -> Fault {
    Fault::new("TIFF", what, MEND)
}

/// Bytes of a file with its byte order.
struct File<'a> {
    bytes: &'a [u8],
    big_endian: bool,
}

impl File<'_> {
    /// A whole number of `n` bytes.
    fn number(&self, at: u64, n: usize) -> Option<u64> {
        let at = usize::try_from(at).ok()?;
        let bytes = self.bytes.get(at..at.checked_add(n)?)?;
        let add = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        Some(if self.big_endian {
            bytes.iter().fold(0, add)
        } else {
            bytes.iter().rev().fold(0, add)
        })
    }

    /// A number of a TIFF type.
    fn value(&self, kind: u64, at: u64) -> Option<f64> {
        Some(match kind {
            1 | 2 | 7 => self.number(at, 1)? as f64,
            3 => self.number(at, 2)? as f64,
            4 | 13 => self.number(at, 4)? as f64,
            5 => self.number(at, 4)? as f64 / self.number(at + 4, 4)? as f64,
            6 => f64::from(self.number(at, 1)? as u8 as i8),
            8 => f64::from(self.number(at, 2)? as u16 as i16),
            9 => f64::from(self.number(at, 4)? as u32 as i32),
            11 => f64::from(f32::from_bits(self.number(at, 4)? as u32)),
            12 => f64::from_bits(self.number(at, 8)?),
            16 | 18 => self.number(at, 8)? as f64,
            _ => return None,
        })
    }
}

/// Bytes of a value of a TIFF type.
fn size(kind: u64) -> u64 {
    match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16 | 17 | 18 => 8,
        _ => 0,
    }
}

/// Numbers and texts of the first directory.
type Tags = (BTreeMap<u16, Vec<f64>>, BTreeMap<u16, String>);

fn tags(file: &File) -> Option<Tags> {
    let big = file.number(2, 2)? == 43;
    let (width, count_bytes, entry) = if big { (8, 8, 20) } else { (4, 2, 12) };
    let directory = file.number(if big { 8 } else { 4 }, width)?;
    let count = file.number(directory, count_bytes)?.min(4096);
    let (mut tags, mut texts) = (BTreeMap::new(), BTreeMap::new());
    for k in 0..count {
        let at = directory.checked_add(count_bytes as u64 + k * entry)?;
        let (tag, kind) = (file.number(at, 2)? as u16, file.number(at + 2, 2)?);
        let number = file.number(at + 4, width)?;
        let length = number.checked_mul(size(kind))?;
        let own = at + 4 + width as u64;
        let from = if length <= width as u64 {
            own
        } else {
            file.number(own, width)?
        };
        // Values outside the file are those of a damaged directory.
        if size(kind) == 0 || from.checked_add(length)? > file.bytes.len() as u64 {
            continue;
        }
        if kind == 2 {
            let bytes = &file.bytes[from as usize..(from + length) as usize];
            let text = String::from_utf8_lossy(bytes)
                .trim_end_matches('\0')
                .to_string();
            texts.insert(tag, text);
        } else {
            let all = (0..number).map(|k| file.value(kind, from + k * size(kind)));
            tags.insert(tag, all.collect::<Option<Vec<f64>>>()?);
        }
    }
    Some((tags, texts))
}

impl Picture {
    /// Reads a file's first picture.
    pub fn read(bytes: &[u8]) -> Result<Self, Fault> {
        let big_endian = match bytes.get(..4) {
            Some([b'I', b'I', 42 | 43, 0]) => false,
            Some([b'M', b'M', 0, 42 | 43]) => true,
            _ => return Err(fault("this is no TIFF file")),
        };
        let file = File { bytes, big_endian };
        let (tags, texts) = tags(&file).ok_or_else(|| fault("its directory is damaged"))?;
        let list = |tag: u16| tags.get(&tag).map_or(&[][..], Vec::as_slice);
        let one = |tag: u16, default: f64| list(tag).first().copied().unwrap_or(default) as u64;
        let (width, height) = (one(256, 0.0), one(257, 0.0));
        let bands = one(277, 1.0);
        if width == 0
            || height == 0
            || width.saturating_mul(height) > MOST_PIXELS
            || !(1..=16).contains(&bands)
        {
            return Err(fault(format!(
                "{width} × {height} pixels of {bands} bands are none, or too many"
            )));
        }
        let bits = one(258, 1.0);
        let same = list(258).iter().all(|b| *b as u64 == bits)
            && list(339).iter().all(|f| *f as u64 == one(339, 1.0));
        let sample = match (bits, one(339, 1.0)) {
            _ if !same => None,
            (8, 1) => Some(Sample::U8),
            (8, 2) => Some(Sample::I8),
            (16, 1) => Some(Sample::U16),
            (16, 2) => Some(Sample::I16),
            (32, 1) => Some(Sample::U32),
            (32, 2) => Some(Sample::I32),
            (32, 3) => Some(Sample::F32),
            (64, 3) => Some(Sample::F64),
            _ => None,
        };
        let sample = sample.ok_or_else(|| fault(format!("samples of {bits} bits are not read")))?;
        let total = width * height * bands * sample.bytes() as u64;
        if total > MOST_GAIN * bytes.len() as u64 {
            return Err(fault("it is far too short for its pixels"));
        }
        let mut picture = Self {
            width: width as usize,
            height: height as usize,
            bands: bands as usize,
            raw: vec![0; total as usize],
            sample,
            tags: BTreeMap::new(),
            texts: BTreeMap::new(),
        };
        picture.fill(&file, &tags)?;
        (picture.tags, picture.texts) = (tags, texts);
        Ok(picture)
    }

    /// Decodes all strips or tiles into place.
    fn fill(&mut self, file: &File, tags: &BTreeMap<u16, Vec<f64>>) -> Result<(), Fault> {
        let list = |tag: u16| tags.get(&tag).map_or(&[][..], Vec::as_slice);
        let one = |tag: u16, default: usize| list(tag).first().map_or(default, |v| *v as usize);
        let tiled = tags.contains_key(&324);
        let (columns, rows, offsets, counts) = if tiled {
            (one(322, 0), one(323, 0), list(324), list(325))
        } else {
            (
                self.width,
                one(278, self.height).min(self.height),
                list(273),
                list(279),
            )
        };
        // Tiles may reach beyond the picture, but not without end.
        let most = [self.width, self.height].map(|n| n.div_ceil(16) * 16 + 4096);
        if columns == 0 || rows == 0 || columns > most[0] || rows > most[1] {
            return Err(fault(format!(
                "blocks of {columns} × {rows} pixels are none"
            )));
        }
        let planar = one(284, 1) == 2;
        let (planes, samples) = if planar {
            (self.bands, 1)
        } else {
            (1, self.bands)
        };
        let [across, down] = [self.width.div_ceil(columns), self.height.div_ceil(rows)];
        let blocks = across * down * planes;
        let counts_given = counts.len() == blocks;
        if offsets.len() != blocks || !(counts_given || (blocks == 1 && counts.is_empty())) {
            return Err(fault(format!(
                "{} blocks where {blocks} belong",
                offsets.len()
            )));
        }
        let (compression, predictor) = (one(259, 1), one(317, 1));
        let wide = self.sample.bytes();
        let mut block = Vec::new();
        for (k, offset) in offsets.iter().enumerate() {
            let (plane, index) = (k / (across * down), k % (across * down));
            let (x0, y0) = (index % across * columns, index / across * rows);
            // The last strip holds only the rows that are left.
            let rows_here = if tiled {
                rows
            } else {
                rows.min(self.height - y0)
            };
            let line = columns * samples * wide;
            let from = *offset as usize;
            let stored = if counts_given {
                counts[k] as usize
            } else {
                line * rows_here
            };
            if stored == 0 && from == 0 {
                self.hole([x0, y0], [columns, rows_here]);
                continue;
            }
            let bytes = from
                .checked_add(stored)
                .and_then(|to| file.bytes.get(from..to));
            let bytes = bytes.ok_or_else(|| fault("a block lies outside the file"))?;
            unpack(compression, bytes, line * rows_here, &mut block)?;
            for row in block.chunks_exact_mut(line) {
                undo(predictor, row, samples, wide, file.big_endian)?;
            }
            for y in 0..rows_here.min(self.height - y0) {
                for x in 0..columns.min(self.width - x0) {
                    let from = y * line + x * samples * wide;
                    let to = (((y0 + y) * self.width + x0 + x) * self.bands + plane) * wide;
                    self.raw[to..to + samples * wide]
                        .copy_from_slice(&block[from..from + samples * wide]);
                }
            }
        }
        Ok(())
    }

    /// Marks a sparse file's block that is not stored as no number; of whole numbers it stays 0.
    fn hole(&mut self, [x0, y0]: [usize; 2], [columns, rows]: [usize; 2]) {
        if self.sample != Sample::F32 {
            return;
        }
        for y in y0..(y0 + rows).min(self.height) {
            for x in x0..(x0 + columns).min(self.width) {
                let to = (y * self.width + x) * self.bands * 4;
                self.raw[to..to + 4].copy_from_slice(&f32::NAN.to_le_bytes());
            }
        }
    }

    /// A sample.
    pub fn sample(&self, x: usize, y: usize, band: usize) -> f64 {
        let n = self.sample.bytes();
        let at = ((y * self.width + x) * self.bands + band.min(self.bands - 1)) * n;
        let bytes = &self.raw[at..at + n];
        let number = bytes
            .iter()
            .rev()
            .fold(0_u64, |sum, byte| sum << 8 | u64::from(*byte));
        match self.sample {
            Sample::U8 | Sample::U16 | Sample::U32 => number as f64,
            Sample::I8 => f64::from(number as u8 as i8),
            Sample::I16 => f64::from(number as u16 as i16),
            Sample::I32 => f64::from(number as u32 as i32),
            Sample::F32 => f64::from(f32::from_bits(number as u32)),
            Sample::F64 => f64::from_bits(number),
        }
    }

    /// The numbers of a tag.
    pub fn numbers(&self, tag: u16) -> &[f64] {
        self.tags.get(&tag).map_or(&[], Vec::as_slice)
    }

    /// The text of a tag.
    pub fn text(&self, tag: u16) -> &str {
        self.texts.get(&tag).map_or("", String::as_str)
    }

    /// Red, green, blue and alpha of a pixel on the screen.
    pub fn rgba(&self, x: usize, y: usize) -> [u8; 4] {
        let top = if self.sample == Sample::U16 {
            257.0
        } else {
            1.0
        };
        let at = |band: usize| (self.sample(x, y, band) / top) as u8;
        match self.bands {
            1 => [at(0), at(0), at(0), 255],
            2 => [at(0), at(0), at(0), at(1)],
            3 => [at(0), at(1), at(2), 255],
            _ => [at(0), at(1), at(2), at(3)],
        }
    }
}

/// Unpacks a block to `length` bytes.
fn unpack(
    compression: usize,
    bytes: &[u8],
    length: usize,
    into: &mut Vec<u8>,
) -> Result<(), Fault> {
    into.clear();
    match compression {
        1 => into.extend_from_slice(&bytes[..length.min(bytes.len())]),
        5 => lzw(bytes, length, into),
        8 | 32_946 => {
            let read = ZlibDecoder::new(bytes)
                .take(length as u64)
                .read_to_end(into);
            read.map_err(|error| fault(format!("a block is damaged ({error})")))?;
        }
        32_773 => pack_bits(bytes, length, into),
        7 => return Err(fault("JPEG inside of TIFF is not read")),
        other => return Err(fault(format!("compression {other} is not read"))),
    }
    if into.len() < length {
        return Err(fault(format!(
            "a block has {} bytes where {length} belong",
            into.len()
        )));
    }
    into.truncate(length);
    Ok(())
}

/// TIFF's LZW: codes of 9 to 12 bits, most significant bit first; 256 clears, 257 ends. Stops at damage.
fn lzw(bytes: &[u8], length: usize, into: &mut Vec<u8>) {
    // Each entry is the one before it and a byte more, or stands in the output already.
    let mut entries: Vec<(usize, usize)> = Vec::with_capacity(4096);
    let (mut bits, mut have) = (0_u32, 0_u32);
    let mut wide = 9;
    let mut last: Option<(usize, usize)> = None;
    let mut input = bytes.iter();
    while into.len() < length {
        while have < wide {
            let Some(byte) = input.next() else { return };
            bits = bits << 8 | u32::from(*byte);
            have += 8;
        }
        have -= wide;
        let code = (bits >> have) as usize & ((1 << wide) - 1);
        match code {
            256 => {
                entries.clear();
                (wide, last) = (9, None);
                continue;
            }
            257 => return,
            _ => {}
        }
        let start = into.len();
        if code < 256 {
            into.push(code as u8);
        } else if let Some(&(from, to)) = entries.get(code - 258) {
            into.extend_from_within(from..to);
        } else if let Some((from, to)) = last.filter(|_| code - 258 == entries.len()) {
            into.extend_from_within(from..to);
            into.push(into[from]);
        } else {
            return;
        }
        if let Some((from, to)) = last.filter(|_| entries.len() < 4096 - 258) {
            // What came before and the first byte of this: they stand one behind the other in the output.
            debug_assert_eq!(to, start);
            entries.push((from, to + 1));
        }
        last = Some((start, into.len()));
        wide = match entries.len() + 258 + 1 {
            0..=511 => 9,
            512..=1023 => 10,
            1024..=2047 => 11,
            _ => 12,
        };
    }
}

/// PackBits. Stops at damage.
fn pack_bits(mut bytes: &[u8], length: usize, into: &mut Vec<u8>) {
    while let Some((head, rest)) = bytes.split_first().filter(|_| into.len() < length) {
        bytes = rest;
        match *head as i8 {
            -128 => {}
            n @ ..0 => {
                let Some((byte, rest)) = bytes.split_first() else {
                    return;
                };
                into.extend(std::iter::repeat_n(
                    *byte,
                    1 + usize::from(n.unsigned_abs()),
                ));
                bytes = rest;
            }
            n => {
                let n = (n as usize + 1).min(bytes.len());
                into.extend_from_slice(&bytes[..n]);
                bytes = &bytes[n..];
            }
        }
    }
}

/// Undoes a row's prediction, and brings its samples into little-endian order.
fn undo(
    predictor: usize,
    row: &mut [u8],
    samples: usize,
    wide: usize,
    big_endian: bool,
) -> Result<(), Fault> {
    if predictor == 3 {
        // Bytes of one significance lie together, most significant first, and each is the difference to the one before.
        for k in samples..row.len() {
            row[k] = row[k].wrapping_add(row[k - samples]);
        }
        let (planes, n) = (row.to_vec(), row.len() / wide);
        for k in 0..n {
            for byte in 0..wide {
                row[k * wide + byte] = planes[(wide - 1 - byte) * n + k];
            }
        }
        return Ok(());
    }
    if big_endian {
        row.chunks_exact_mut(wide).for_each(<[u8]>::reverse);
    }
    match predictor {
        1 => {}
        2 => {
            let step = samples * wide;
            for at in (step..row.len()).step_by(wide) {
                // The sum of two numbers of `wide` bytes, carried from byte to byte.
                let mut carry = 0;
                for byte in at..(at + wide).min(row.len()) {
                    let sum = u16::from(row[byte]) + u16::from(row[byte - step]) + carry;
                    row[byte] = sum as u8;
                    carry = sum >> 8;
                }
            }
        }
        other => return Err(fault(format!("predictor {other} is not read"))),
    }
    Ok(())
}
