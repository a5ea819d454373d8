//! Clips in: H.264 in MP4 and MOV files, and folders of numbered pictures.

use super::boxes::{Movie, Sample, format, moov};
use super::colour::rgb_of;
use super::error::VideoError;
use crate::media::image::decode;
use image::RgbImage;
use rusty_h264_common::YuvFrame;
use rusty_h264_decoder::Decoder;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// One picture of a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct ClipFrame {
    /// The picture.
    pub picture: RgbImage,
    /// Time from the first frame [s].
    pub t_s: f64,
    /// The picture's file, of a folder.
    pub file: Option<PathBuf>,
}

impl ClipFrame {
    /// Width and height [px].
    pub fn size_px(&self) -> [u32; 2] {
        self.picture.dimensions().into()
    }
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
    pub fn next_frame(&mut self) -> Result<Option<ClipFrame>, VideoError> {
        let index = self.next;
        let Some(&t_s) = self.times_s.get(index) else {
            return Ok(None);
        };
        self.next += 1;
        let (picture, file) = match &mut self.source {
            Source::Mp4(mp4) => (rgb_of(&mp4.frame(&self.path, index)?), None),
            Source::Folder(files) => {
                let path = files[index].clone();
                (picture(&path)?, Some(path))
            }
        };
        let size_px = <[u32; 2]>::from(picture.dimensions());
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
        Ok(Some(ClipFrame { picture, t_s, file }))
    }
}

/// The picture in a file of a folder.
fn picture(path: &Path) -> Result<RgbImage, VideoError> {
    let bytes = std::fs::read(path).map_err(|error| VideoError::Folder {
        path: path.into(),
        why: error.to_string(),
    })?;
    decode(&bytes).map_err(|source| VideoError::Picture {
        path: path.into(),
        source,
    })
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
pub(super) fn numbered(path: &Path) -> (String, u64, PathBuf) {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let is_digit = |c: char| c.is_ascii_digit();
    let end = stem.rfind(is_digit).map_or(0, |at| at + 1);
    let start = stem[..end].rfind(|c| !is_digit(c)).map_or(0, |at| {
        at + stem[at..].chars().next().map_or(1, char::len_utf8)
    });
    let number = stem[start..end].parse().unwrap_or(u64::MAX);
    (stem[..start].to_string(), number, path.into())
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
        decoded(&mut decoder, &movie.head).map_err(|why| format(why).at(path))?;
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
            let frame = decoded(&mut self.decoder, &units)
                .map_err(wrong)?
                .ok_or_else(|| wrong("it holds no picture".into()))?;
            if !frame.is_valid() {
                return Err(wrong("its planes do not fit its size".into()));
            }
            self.waiting.insert(sample.place, frame);
            self.decoded += 1;
        }
    }
}

/// What the decoder makes of some units; why it makes nothing. Damaged ones may make it panic, and it is of no
/// use afterwards.
fn decoded(decoder: &mut Decoder, units: &[u8]) -> Result<Option<YuvFrame>, String> {
    match catch_unwind(AssertUnwindSafe(|| decoder.decode(units))) {
        Ok(made) => made.map_err(|error| error.to_string()),
        Err(_) => Err("it is damaged".into()),
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
