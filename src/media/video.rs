//! Clips of real cameras: H.264 in MP4 or MOV files, folders of numbered pictures; and an MP4
//! writer for what is drawn on them.
//!
//! Boxes and sample tables are those of ISO/IEC 14496-12 and -15. Colours are taken as BT.601,
//! limited range, whatever the file says.

use crate::eval::coco;
use rusty_h264_common::YuvFrame;
use rusty_h264_common::nal::split_annex_b;
use rusty_h264_decoder::Decoder;
use rusty_h264_encoder::{Encoder, EncoderConfig, Preset};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Why a clip cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// The file or folder cannot be read.
    #[error(
        "clip {path}: cannot be read ({why}); name an MP4 or MOV file with H.264, or a folder of \
         numbered pictures (PNG, JPEG)"
    )]
    Unreadable {
        /// The clip.
        path: PathBuf,
        /// What the system said.
        why: String,
    },
    /// The file is no video that is understood.
    #[error("clip {path}: {why}; convert it with `ffmpeg -i IN -pix_fmt yuv420p OUT.mp4`")]
    Format {
        /// The clip.
        path: PathBuf,
        /// What differs.
        why: String,
    },
    /// The file ends too early.
    #[error("clip {path}: {why}; the file is cut off: copy or record it again")]
    Truncated {
        /// The clip.
        path: PathBuf,
        /// What is missing.
        why: String,
    },
    /// A frame cannot be decoded.
    #[error(
        "clip {path}: frame {frame} cannot be decoded ({why}); copy the file again, or convert it \
         with `ffmpeg -i IN -pix_fmt yuv420p OUT.mp4`"
    )]
    Frame {
        /// The clip.
        path: PathBuf,
        /// Index of the frame, from 0.
        frame: usize,
        /// What the decoder said.
        why: String,
    },
    /// The folder holds no pictures, or pictures that do not belong together.
    #[error("clip {path}: {why}")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What is wrong, and what would be right.
        why: String,
    },
    /// A clip cannot be written.
    #[error("video {path}: {why}")]
    Write {
        /// The file.
        path: PathBuf,
        /// What went wrong.
        why: String,
    },
}

/// One picture of a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Rows of red, green, blue bytes.
    pub rgb8: Vec<u8>,
    /// Width and height [px].
    pub size_px: [u32; 2],
    /// Time from the first frame [s].
    pub t_s: f64,
    /// The picture's file, of a folder.
    pub file: Option<PathBuf>,
}

/// A clip that is being read, frame by frame in the order in which they are shown.
pub struct Clip {
    path: PathBuf,
    source: Source,
    times_s: Vec<f64>,
    next: usize,
    size_px: Option<[u32; 2]>,
}

enum Source {
    Mp4(Box<Mp4>),
    Folder(Vec<PathBuf>),
}

struct Mp4 {
    file: File,
    samples: Vec<Sample>,
    /// Bytes of the length before each unit of a sample.
    length_bytes: usize,
    decoder: Decoder,
    /// Samples that have gone into the decoder.
    decoded: usize,
    /// Pictures that are shown later, by their place.
    waiting: BTreeMap<usize, YuvFrame>,
}

/// A frame as it lies in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sample {
    offset: u64,
    size: u32,
    /// Time at which it is shown, in units of the track.
    shown: i64,
    /// Its place in the order of these times.
    place: usize,
}

impl Clip {
    /// Opens the clip at `path`; pictures of a folder follow each other at `rate_hz` [Hz].
    pub fn open(path: &Path, rate_hz: f64) -> Result<Self, VideoError> {
        let unreadable = |error: io::Error| VideoError::Unreadable {
            path: path.into(),
            why: error.to_string(),
        };
        let (source, times_s) = if std::fs::metadata(path).map_err(unreadable)?.is_dir() {
            let files = pictures(path)?;
            let times_s = (0..files.len()).map(|i| i as f64 / rate_hz).collect();
            (Source::Folder(files), times_s)
        } else {
            let file = File::open(path).map_err(unreadable)?;
            let (mp4, times_s) = Mp4::open(path, file)?;
            (Source::Mp4(Box::new(mp4)), times_s)
        };
        Ok(Self {
            path: path.into(),
            source,
            times_s,
            next: 0,
            size_px: None,
        })
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.times_s.len()
    }

    /// The pictures of a folder, in order; none of a video.
    pub fn files(&self) -> &[PathBuf] {
        match &self.source {
            Source::Folder(files) => files,
            Source::Mp4(_) => &[],
        }
    }

    /// Mean rate [Hz]; that of a single frame is taken as 30.
    pub fn rate_hz(&self) -> f64 {
        let last_s = self.times_s.last().copied().unwrap_or(0.0);
        if last_s > 0.0 {
            (self.frames() - 1) as f64 / last_s
        } else {
            30.0
        }
    }

    /// The next frame; `None` after the last.
    pub fn next_frame(&mut self) -> Result<Option<Frame>, VideoError> {
        let index = self.next;
        let Some(&t_s) = self.times_s.get(index) else {
            return Ok(None);
        };
        self.next += 1;
        let (rgb8, size_px, file) = match &mut self.source {
            Source::Mp4(mp4) => {
                let frame = mp4.frame(&self.path, index)?;
                let size_px = [frame.width as u32, frame.height as u32];
                (rgb8_of(&frame), size_px, None)
            }
            Source::Folder(files) => {
                let path = &files[index];
                let wrong = |why: String| VideoError::Folder {
                    path: path.clone(),
                    why,
                };
                let bytes = std::fs::read(path).map_err(|error| wrong(error.to_string()))?;
                let (rgb8, size_px) = coco::decode(&bytes).map_err(|why| {
                    wrong(format!("no picture ({why}); PNG and JPEG files are read"))
                })?;
                (rgb8, size_px, Some(path.clone()))
            }
        };
        let first = *self.size_px.get_or_insert(size_px);
        if first != size_px {
            let why = format!(
                "frame {index} is {} × {} px, those before it {} × {}; all must have one size",
                size_px[0], size_px[1], first[0], first[1]
            );
            return Err(match file {
                Some(path) => VideoError::Folder { path, why },
                None => VideoError::Format {
                    path: self.path.clone(),
                    why,
                },
            });
        }
        Ok(Some(Frame {
            rgb8,
            size_px,
            t_s,
            file,
        }))
    }
}

/// The pictures in a folder, in the order of the last number in their names.
fn pictures(folder: &Path) -> Result<Vec<PathBuf>, VideoError> {
    let entries = std::fs::read_dir(folder).map_err(|error| VideoError::Unreadable {
        path: folder.into(),
        why: error.to_string(),
    })?;
    let mut files: Vec<PathBuf> = entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| {
            let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("");
            ["png", "jpg", "jpeg"].contains(&extension.to_ascii_lowercase().as_str())
        })
        .collect();
    if files.is_empty() {
        return Err(VideoError::Folder {
            path: folder.into(),
            why: "the folder holds no .png, .jpg or .jpeg files".into(),
        });
    }
    files.sort_by_cached_key(|path| numbered(path));
    Ok(files)
}

/// Name before its last number, that number, and the name.
fn numbered(path: &Path) -> (String, u64, PathBuf) {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let is_digit = |c: char| c.is_ascii_digit();
    let end = stem.rfind(is_digit).map_or(0, |at| at + 1);
    let start = stem[..end].rfind(|c| !is_digit(c)).map_or(0, |at| {
        at + stem[at..].chars().next().map_or(1, char::len_utf8)
    });
    let number = stem[start..end].parse().unwrap_or(u64::MAX);
    (stem[..start].to_string(), number, path.into())
}

/// Largest `moov` box: the tables of hours of video are some megabytes.
const MAX_MOOV_BYTES: u64 = 1 << 28; // [byte]

/// What is wrong with the boxes of a file.
enum Broken {
    Format(String),
    Truncated(String),
}

impl Broken {
    fn at(self, path: &Path) -> VideoError {
        let path = path.into();
        match self {
            Broken::Format(why) => VideoError::Format { path, why },
            Broken::Truncated(why) => VideoError::Truncated { path, why },
        }
    }
}

fn format(why: impl Into<String>) -> Broken {
    Broken::Format(why.into())
}

impl Mp4 {
    fn open(path: &Path, mut file: File) -> Result<(Self, Vec<f64>), VideoError> {
        let (moov, length) = moov(&mut file).map_err(|broken| broken.at(path))?;
        let movie = Movie::parse(&moov, length).map_err(|broken| broken.at(path))?;
        let first = movie.samples.iter().map(|sample| sample.shown).min();
        let mut times_s = vec![0.0; movie.samples.len()];
        for sample in &movie.samples {
            let since = sample.shown - first.unwrap_or(0);
            times_s[sample.place] = since as f64 / f64::from(movie.timescale);
        }
        let mut decoder = Decoder::new();
        decoder
            .decode(&movie.head)
            .map_err(|error| format(error.to_string()).at(path))?;
        let mp4 = Self {
            file,
            samples: movie.samples,
            length_bytes: movie.length_bytes,
            decoder,
            decoded: 0,
            waiting: BTreeMap::new(),
        };
        Ok((mp4, times_s))
    }

    /// The picture that is shown at place `place`; asked for in order.
    fn frame(&mut self, path: &Path, place: usize) -> Result<YuvFrame, VideoError> {
        loop {
            if let Some(frame) = self.waiting.remove(&place) {
                return Ok(frame);
            }
            let index = self.decoded;
            let wrong = |why: String| VideoError::Frame {
                path: path.into(),
                frame: index,
                why,
            };
            let Some(sample) = self.samples.get(index) else {
                return Err(wrong("it is missing".into()));
            };
            let mut data = vec![0; sample.size as usize];
            self.file
                .seek(SeekFrom::Start(sample.offset))
                .and_then(|_| self.file.read_exact(&mut data))
                .map_err(|error| wrong(error.to_string()))?;
            let units = annex_b(&data, self.length_bytes)
                .ok_or_else(|| wrong("its parts are longer than it is".into()))?;
            let frame = (self.decoder.decode(&units))
                .map_err(|error| wrong(error.to_string()))?
                .ok_or_else(|| wrong("it holds no picture".into()))?;
            if !frame.is_valid() {
                return Err(wrong("its planes do not fit its size".into()));
            }
            self.waiting.insert(sample.place, frame);
            self.decoded += 1;
        }
    }
}

/// The units of a sample, each after its length, as a byte stream with start codes.
fn annex_b(sample: &[u8], length_bytes: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(sample.len() + 16);
    let mut rest = sample;
    while !rest.is_empty() {
        let (length, after) = rest.split_at_checked(length_bytes)?;
        let length = length.iter().fold(0, |n, b| n << 8 | usize::from(*b));
        let (unit, after) = after.split_at_checked(length)?;
        out.extend([0, 0, 0, 1]);
        out.extend(unit);
        rest = after;
    }
    Some(out)
}

/// The `moov` box of a file, and the file's length.
fn moov(file: &mut File) -> Result<(Vec<u8>, u64), Broken> {
    let io = |error: io::Error| Broken::Truncated(error.to_string());
    let length = file.seek(SeekFrom::End(0)).map_err(io)?;
    let (mut at, mut known) = (0, false);
    while at < length {
        let mut head = [0; 16];
        let here = (length - at).min(16) as usize;
        file.seek(SeekFrom::Start(at)).map_err(io)?;
        file.read_exact(&mut head[..here]).map_err(io)?;
        let kind = [head[4], head[5], head[6], head[7]];
        // A file of another kind shows at its first box.
        known |= matches!(
            &kind,
            b"ftyp" | b"moov" | b"mdat" | b"free" | b"skip" | b"wide" | b"pnot"
        );
        if !known || here < 8 {
            break;
        }
        let (size, skip) = match u32_at(&head, 0).unwrap_or(0) {
            0 => (length - at, 8),
            1 => (
                u64_at(&head, 8).filter(|_| here == 16).unwrap_or(u64::MAX),
                16,
            ),
            size => (u64::from(size), 8),
        };
        let end = at.checked_add(size).filter(|_| size >= skip);
        let Some(end) = end.filter(|end| *end <= length) else {
            let name = String::from_utf8_lossy(&kind).into_owned();
            return Err(Broken::Truncated(format!(
                "its '{name}' box goes on after the end of the file"
            )));
        };
        if &kind == b"moov" {
            if size > MAX_MOOV_BYTES {
                return Err(format("its index is too long"));
            }
            let mut data = vec![0; (size - skip) as usize];
            file.seek(SeekFrom::Start(at + skip)).map_err(io)?;
            file.read_exact(&mut data).map_err(io)?;
            return Ok((data, length));
        }
        at = end;
    }
    if known {
        Err(Broken::Truncated("it has no 'moov' box (its index)".into()))
    } else {
        Err(format("it is no MP4 or MOV file"))
    }
}

fn u32_at(data: &[u8], at: usize) -> Option<u32> {
    let bytes = data.get(at..)?.first_chunk::<4>()?;
    Some(u32::from_be_bytes(*bytes))
}

fn u64_at(data: &[u8], at: usize) -> Option<u64> {
    let bytes = data.get(at..)?.first_chunk::<8>()?;
    Some(u64::from_be_bytes(*bytes))
}

/// The content of the first box of a kind among boxes that follow each other.
fn child<'a>(data: &'a [u8], kind: &[u8; 4]) -> Option<&'a [u8]> {
    children(data).find(|(k, _)| k == kind).map(|(_, d)| d)
}

/// Kind and content of boxes that follow each other, up to the first that does not fit.
fn children(mut data: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    std::iter::from_fn(move || {
        let kind = *data.get(4..)?.first_chunk::<4>()?;
        let (size, skip) = match u32_at(data, 0)? {
            0 => (data.len(), 8),
            1 => (usize::try_from(u64_at(data, 8)?).ok()?, 16),
            size => (size as usize, 8),
        };
        let content = data.get(skip..size)?;
        data = &data[size..];
        Some((kind, content))
    })
}

/// Rows of `N` numbers of a table: version and flags, `extra` bytes, count, rows. `None` if it ends
/// too early.
fn rows<const N: usize>(table: &[u8], extra: usize) -> Option<impl Iterator<Item = [u32; N]>> {
    let count = u32_at(table, 4 + extra)? as usize;
    let data = table.get(8 + extra..)?;
    let data = data.get(..count.checked_mul(4 * N)?)?;
    Some(
        data.chunks_exact(4 * N)
            .map(|row| std::array::from_fn(|i| u32_at(row, 4 * i).unwrap_or(0))),
    )
}

/// The video track of a file.
#[derive(Debug, PartialEq)]
struct Movie {
    timescale: u32,
    samples: Vec<Sample>,
    length_bytes: usize,
    /// Parameter sets, with start codes.
    head: Vec<u8>,
}

impl Movie {
    /// Reads the content of a `moov` box of a file of `length` bytes.
    fn parse(moov: &[u8], length: u64) -> Result<Self, Broken> {
        let is_video = |mdia: &&[u8]| {
            child(mdia, b"hdlr").is_some_and(|hdlr| hdlr.get(8..12) == Some(b"vide"))
        };
        let mdia = children(moov)
            .filter(|(kind, _)| kind == b"trak")
            .filter_map(|(_, trak)| child(trak, b"mdia"))
            .find(is_video)
            .ok_or_else(|| format("it holds no video track"))?;
        let mdhd = child(mdia, b"mdhd").ok_or_else(|| format("it has no time scale"))?;
        let long = mdhd.first() == Some(&1);
        let timescale = u32_at(mdhd, if long { 20 } else { 12 })
            .filter(|scale| *scale > 0)
            .ok_or_else(|| format("it has no time scale"))?;
        let stbl = child(mdia, b"minf")
            .and_then(|minf| child(minf, b"stbl"))
            .ok_or_else(|| format("it has no table of frames"))?;
        let (length_bytes, head) = description(stbl)?;
        let mut movie = Self {
            timescale,
            samples: samples(stbl, length)?,
            length_bytes,
            head,
        };
        if movie.samples.is_empty() {
            return Err(match child(moov, b"mvex") {
                Some(_) => format("it is a fragmented MP4, whose frames have no common table"),
                None => format("it holds no frames"),
            });
        }
        let mut order: Vec<usize> = (0..movie.samples.len()).collect();
        order.sort_by_key(|i| movie.samples[*i].shown);
        for (place, i) in order.into_iter().enumerate() {
            movie.samples[i].place = place;
        }
        Ok(movie)
    }
}

/// Bytes of a unit's length, and the parameter sets.
fn description(stbl: &[u8]) -> Result<(usize, Vec<u8>), Broken> {
    let entry = child(stbl, b"stsd")
        .and_then(|stsd| children(stsd.get(8..)?).next())
        .ok_or_else(|| format("it does not say how its video is coded"))?;
    let (kind, entry) = entry;
    if !matches!(&kind, b"avc1" | b"avc3") {
        let name = String::from_utf8_lossy(&kind).into_owned();
        return Err(format(format!("its video is '{name}', not H.264")));
    }
    // 78 bytes of a visual sample entry come before its boxes.
    let avcc = entry
        .get(78..)
        .and_then(|boxes| child(boxes, b"avcC"))
        .ok_or_else(|| format("it lacks the parameters of its H.264 video"))?;
    let read = || {
        let length_bytes = usize::from(avcc.get(4)? & 3) + 1;
        let mut head = Vec::new();
        let mut rest = avcc.get(5..)?;
        for mask in [0x1f, 0xff] {
            let (count, after) = rest.split_first()?;
            rest = after;
            for _ in 0..count & mask {
                let (size, after) = rest.split_at_checked(2)?;
                let size = usize::from(size[0]) << 8 | usize::from(size[1]);
                let (unit, after) = after.split_at_checked(size)?;
                head.extend([0, 0, 0, 1]);
                head.extend(unit);
                rest = after;
            }
        }
        Some((length_bytes, head))
    };
    read().ok_or_else(|| format("the parameters of its H.264 video are damaged"))
}

/// Where the frames lie and when they are shown.
fn samples(stbl: &[u8], length: u64) -> Result<Vec<Sample>, Broken> {
    let damaged = |name: &str| format(format!("its table '{name}' is damaged"));
    let table = |name: &'static [u8; 4]| {
        child(stbl, name).ok_or_else(|| damaged(&String::from_utf8_lossy(name)))
    };
    let stsz = table(b"stsz")?;
    let sizes: Vec<u32> = match (u32_at(stsz, 4), u32_at(stsz, 8)) {
        (Some(0), Some(_)) => rows(stsz, 4)
            .ok_or_else(|| damaged("stsz"))?
            .map(|[size]| size)
            .collect(),
        // No file holds more frames than bytes.
        (Some(size), Some(count)) if u64::from(count) <= length => vec![size; count as usize],
        _ => return Err(damaged("stsz")),
    };
    let chunks: Vec<u64> = match (child(stbl, b"stco"), child(stbl, b"co64")) {
        (Some(stco), _) => rows(stco, 0)
            .ok_or_else(|| damaged("stco"))?
            .map(|[offset]| u64::from(offset))
            .collect(),
        (None, Some(co64)) => rows(co64, 0)
            .ok_or_else(|| damaged("co64"))?
            .map(|[high, low]| u64::from(high) << 32 | u64::from(low))
            .collect(),
        (None, None) => return Err(damaged("stco")),
    };
    let runs: Vec<[u32; 3]> = rows(table(b"stsc")?, 0)
        .ok_or_else(|| damaged("stsc"))?
        .collect();
    let mut offsets = Vec::with_capacity(sizes.len());
    let mut run = 0;
    for (i, chunk) in chunks.iter().enumerate() {
        while runs
            .get(run + 1)
            .is_some_and(|next| next[0] as usize <= i + 1)
        {
            run += 1;
        }
        let per_chunk = runs.get(run).ok_or_else(|| damaged("stsc"))?[1];
        let mut offset = *chunk;
        for _ in 0..per_chunk {
            let Some(size) = sizes.get(offsets.len()) else {
                break;
            };
            offsets.push(offset);
            offset = offset.saturating_add(u64::from(*size));
        }
    }
    if offsets.len() != sizes.len() {
        return Err(damaged("stsc"));
    }
    // Durations, then shifts of what is shown in another order than it is stored.
    let runs_of = |name, table: &[u8]| -> Result<Vec<i64>, Broken> {
        let mut values = Vec::with_capacity(sizes.len());
        for [count, value] in rows(table, 0).ok_or_else(|| damaged(name))? {
            let left = sizes.len() - values.len();
            // Shifts may be negative, and are so in files of either version.
            let value = i64::from(value.cast_signed());
            values.extend(std::iter::repeat_n(value, left.min(count as usize)));
        }
        if values.len() != sizes.len() {
            return Err(damaged(name));
        }
        Ok(values)
    };
    let durations = runs_of("stts", table(b"stts")?)?;
    let shifts = child(stbl, b"ctts")
        .map(|ctts| runs_of("ctts", ctts))
        .transpose()?;
    let (count, mut stored) = (sizes.len(), 0_i64);
    let mut samples = Vec::with_capacity(count);
    for (i, (size, offset)) in sizes.into_iter().zip(offsets).enumerate() {
        if offset.saturating_add(u64::from(size)) > length {
            return Err(Broken::Truncated(format!(
                "frame {i} of {count} lies behind the end of the file"
            )));
        }
        samples.push(Sample {
            offset,
            size,
            shown: stored + shifts.as_ref().map_or(0, |shifts| shifts[i]),
            place: i,
        });
        stored += durations[i].max(0);
    }
    Ok(samples)
}

/// Red, green, blue of a 4:2:0 picture by BT.601 in limited range, in 16-bit fixed point.
fn rgb8_of(frame: &YuvFrame) -> Vec<u8> {
    let mut out = Vec::with_capacity(3 * frame.width * frame.height);
    let chroma = frame.chroma_width();
    for (j, row) in frame.y.chunks_exact(frame.width.max(1)).enumerate() {
        for (i, y) in row.iter().enumerate() {
            let at = j / 2 * chroma + i / 2;
            let y = 76_309 * (i32::from(*y) - 16); // 255/219
            let u = i32::from(frame.u[at]) - 128;
            let v = i32::from(frame.v[at]) - 128;
            let byte = |x: i32| ((x + (1 << 15)) >> 16).clamp(0, 255) as u8;
            out.extend([
                byte(y + 104_597 * v), // 1.402 · 255/224
                byte(y - 25_675 * u - 53_279 * v),
                byte(y + 132_201 * u), // 1.772 · 255/224
            ]);
        }
    }
    out
}

/// The 4:2:0 picture of red, green, blue bytes; the inverse of [`rgb8_of`] but for the mean of the
/// colours of four pixels. An odd last row or column is left out.
fn yuv_of(rgb8: &[u8], [width, height]: [u32; 2]) -> YuvFrame {
    let stride = 3 * width as usize;
    let (width, height) = (width as usize & !1, height as usize & !1);
    let mut frame = YuvFrame::black(width, height);
    let pixel = |i: usize, j: usize| {
        let at = j * stride + 3 * i;
        [0, 1, 2].map(|c| i32::from(rgb8.get(at + c).copied().unwrap_or(0)))
    };
    let dot = |[r, g, b]: [i32; 3], [kr, kg, kb]: [i32; 3]| kr * r + kg * g + kb * b;
    for j in 0..height {
        for i in 0..width {
            let y = dot(pixel(i, j), [16_829, 33_039, 6_416]);
            frame.y[j * width + i] = (16 + ((y + (1 << 15)) >> 16)) as u8;
        }
    }
    for j in 0..height / 2 {
        for i in 0..width / 2 {
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(a, b)| pixel(2 * i + a, 2 * j + b));
            let sum = [0, 1, 2].map(|c| four.iter().map(|p| p[c]).sum::<i32>());
            let byte = |x: i32| (128 + ((x + (1 << 17)) >> 18)).clamp(0, 255) as u8;
            let at = j * (width / 2) + i;
            frame.u[at] = byte(dot(sum, [-9_714, -19_070, 28_784]));
            frame.v[at] = byte(dot(sum, [28_784, -24_103, -4_681]));
        }
    }
    frame
}

/// Units of time a second in files that are written [Hz].
const TIMESCALE: u32 = 90_000;

/// Writes H.264 into an MP4 file that browsers play.
pub struct Writer {
    path: PathBuf,
    file: BufWriter<File>,
    encoder: Encoder,
    size_px: [u32; 2],
    /// Parameter sets: those of the sequence, those of the picture.
    sets: [Vec<u8>; 2],
    /// Size of every frame [byte], and whether it needs no other.
    samples: Vec<(u32, bool)>,
}

/// Bytes before the first frame: `ftyp` and the long head of `mdat`.
const HEAD: [u8; 40] = *b"\0\0\0\x18ftypisom\0\0\x02\0isomavc1\0\0\0\x01mdat\0\0\0\0\0\0\0\0";

impl Writer {
    /// Begins a file for pictures of `size_px` at `rate_hz`; an odd last row or column is left out.
    pub fn create(path: &Path, size_px: [u32; 2], rate_hz: f64) -> Result<Self, VideoError> {
        let wrong = |why: String| VideoError::Write {
            path: path.into(),
            why,
        };
        let even = size_px.map(|side| side & !1);
        let [width, height] = even.map(|side| side as usize);
        let blocks = width.div_ceil(16) * height.div_ceil(16);
        // Baseline, one reference, no reordering: every player takes it.
        let mut config = EncoderConfig::baseline(width, height);
        config.preset = Preset::Balanced;
        config.qp = 22;
        config.gop_size = 60;
        config.framerate = rate_hz as f32;
        // Table A-1: levels 3.1, 4.0, 5.1 by macroblocks a frame.
        config.level_idc = match blocks {
            0..=3_600 => 31,
            3_601..=8_192 => 40,
            _ => 51,
        };
        let encoder = Encoder::new(config).map_err(|error| wrong(error.to_string()))?;
        let file = File::create(path).map_err(|error| wrong(error.to_string()))?;
        let mut file = BufWriter::new(file);
        (file.write_all(&HEAD)).map_err(|error| wrong(error.to_string()))?;
        Ok(Self {
            path: path.into(),
            file,
            encoder,
            size_px: even,
            sets: [Vec::new(), Vec::new()],
            samples: Vec::new(),
        })
    }

    /// Appends a picture: rows of red, green, blue bytes of the size given first.
    pub fn push(&mut self, rgb8: &[u8], size_px: [u32; 2]) -> Result<(), VideoError> {
        let coded = (self.encoder)
            .try_encode(&yuv_of(rgb8, size_px))
            .map_err(|error| self.wrong(error.to_string()))?;
        let mut sample = Vec::with_capacity(coded.len());
        let mut whole = false;
        for unit in split_annex_b(&coded) {
            match unit.first().map_or(0, |head| head & 0x1f) {
                7 => self.sets[0] = unit.to_vec(),
                8 => self.sets[1] = unit.to_vec(),
                kind => {
                    whole |= kind == 5;
                    sample.extend((unit.len() as u32).to_be_bytes());
                    sample.extend(unit);
                }
            }
        }
        (self.file.write_all(&sample)).map_err(|error| self.wrong(error.to_string()))?;
        self.samples.push((sample.len() as u32, whole));
        Ok(())
    }

    /// Writes the tables, for frames that follow each other at `rate_hz` [Hz], and closes the file.
    pub fn finish(mut self, rate_hz: f64) -> Result<(), VideoError> {
        let tables = self.tables(rate_hz);
        let data: u64 = self.samples.iter().map(|(size, _)| u64::from(*size)).sum();
        let mut write = || {
            self.file.write_all(&tables)?;
            self.file.seek(SeekFrom::Start(32))?;
            self.file.write_all(&(16 + data).to_be_bytes())?;
            self.file.flush()
        };
        write().map_err(|error: io::Error| self.wrong(error.to_string()))
    }

    fn wrong(&self, why: String) -> VideoError {
        VideoError::Write {
            path: self.path.clone(),
            why,
        }
    }

    /// The `moov` box.
    fn tables(&self, rate_hz: f64) -> Vec<u8> {
        let count = self.samples.len() as u32;
        let step = (f64::from(TIMESCALE) / rate_hz).round().max(1.0) as u32;
        let duration = count.saturating_mul(step);
        let [width, height] = self.size_px;
        let [sps, pps] = &self.sets;
        let mut avcc = vec![1];
        avcc.extend(sps.get(1..4).unwrap_or(&[66, 0, 31]));
        avcc.push(0xff);
        for (count, set) in [(0xe1, sps), (1, pps)] {
            avcc.push(count);
            avcc.extend((set.len() as u16).to_be_bytes());
            avcc.extend(set);
        }
        let mut entry = vec![0; 78];
        entry[7] = 1;
        entry[24..26].copy_from_slice(&(width as u16).to_be_bytes());
        entry[26..28].copy_from_slice(&(height as u16).to_be_bytes());
        entry[28..36].copy_from_slice(&[0, 72, 0, 0, 0, 72, 0, 0]);
        entry[41] = 1;
        entry[75] = 24;
        entry[76..78].copy_from_slice(&[0xff, 0xff]);
        entry.extend(boxed(b"avcC", &avcc));
        let table = |numbers: &[u32]| -> Vec<u8> {
            (numbers.iter())
                .flat_map(|number| number.to_be_bytes())
                .collect()
        };
        let matrix = [1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30];
        let whole: Vec<u32> = (1..=count)
            .zip(&self.samples)
            .filter(|(_, (_, whole))| *whole)
            .map(|(number, _)| number)
            .collect();
        let sizes: Vec<u32> = self.samples.iter().map(|(size, _)| *size).collect();
        let stbl = [
            boxed(b"stsd", &[table(&[0, 1]), boxed(b"avc1", &entry)].concat()),
            boxed(b"stts", &table(&[0, 1, count, step])),
            boxed(
                b"stss",
                &table(&[&[0, whole.len() as u32][..], &whole].concat()),
            ),
            boxed(b"stsc", &table(&[0, 1, 1, count, 1])),
            boxed(b"stsz", &table(&[&[0, 0, count][..], &sizes].concat())),
            boxed(b"stco", &table(&[0, 1, HEAD.len() as u32])),
        ];
        let dref = boxed(
            b"dref",
            &[table(&[0, 1]), boxed(b"url ", &table(&[1]))].concat(),
        );
        let minf = [
            boxed(b"vmhd", &table(&[1, 0, 0])),
            boxed(b"dinf", &dref),
            boxed(b"stbl", &stbl.concat()),
        ];
        let mut hdlr = table(&[0, 0]);
        hdlr.extend(b"vide\0\0\0\0\0\0\0\0\0\0\0\0\0");
        let mdia = [
            // 0x55c4: the language is undetermined.
            boxed(
                b"mdhd",
                &table(&[0, 0, 0, TIMESCALE, duration, 0x55c4_0000]),
            ),
            boxed(b"hdlr", &hdlr),
            boxed(b"minf", &minf.concat()),
        ];
        let mut tkhd = table(&[3, 0, 0, 1, 0, duration, 0, 0, 0, 0]);
        tkhd.extend(table(&matrix));
        tkhd.extend(table(&[width << 16, height << 16]));
        let trak = [boxed(b"tkhd", &tkhd), boxed(b"mdia", &mdia.concat())];
        let mut mvhd = table(&[0, 0, 0, TIMESCALE, duration, 1 << 16, 1 << 24, 0, 0]);
        mvhd.extend(table(&matrix));
        mvhd.extend(table(&[0, 0, 0, 0, 0, 0, 2]));
        boxed(
            b"moov",
            &[boxed(b"mvhd", &mvhd), boxed(b"trak", &trak.concat())].concat(),
        )
    }
}

/// A box of a kind around its content.
fn boxed(kind: &[u8; 4], content: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(8 + content.len());
    out.extend((8 + content.len() as u32).to_be_bytes());
    out.extend(kind);
    out.extend(content);
    out
}

#[cfg(test)]
mod tests;
