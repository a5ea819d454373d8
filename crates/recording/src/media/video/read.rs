//! Clips in: H.264 in MP4 and MOV files, and folders of numbered pictures.

use super::boxes::{format, index};
use super::colour::{Colours, rgb_of};
use super::description::Description;
use super::error::VideoError;
use super::movie::Movie;
use super::sps::{Stated, stated};
use super::tables::Sample;
use super::turn::Turn;
use crate::media::image::decode;
use boresight_common::warning::{Notes, Warning};
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
    warnings: Vec<Warning>,
}

enum Source {
    Mp4(Box<Mp4>),
    Folder(Vec<PathBuf>),
}

struct Mp4 {
    file: File,
    samples: Vec<Sample>,
    descriptions: Vec<Description>,
    /// The description whose parameter sets the decoder has.
    description: Option<usize>,
    /// What the last sequence parameter set says.
    stated: Option<Stated>,
    turn: Turn,
    decoder: Decoder,
    /// Samples that have gone into the decoder.
    decoded: usize,
    /// Pictures that are shown later, by their place.
    waiting: BTreeMap<usize, RgbImage>,
}

impl Clip {
    /// Opens the clip at `path`; pictures of a folder follow each other at `rate_hz` [Hz].
    pub fn open(path: &Path, rate_hz: f64) -> Result<Self, VideoError> {
        let unreadable = |error: io::Error| VideoError::Unreadable {
            path: path.into(),
            why: error.to_string(),
        };
        let mut warnings = Vec::new();
        let (source, times_s) = if std::fs::metadata(path).map_err(unreadable)?.is_dir() {
            let files = pictures(path)?;
            let times_s = (0..files.len()).map(|i| i as f64 / rate_hz).collect();
            (Source::Folder(files), times_s)
        } else {
            let file = File::open(path).map_err(unreadable)?;
            let (mp4, times_s, notes) = Mp4::open(path, file)?;
            warnings = notes.warnings(path);
            (Source::Mp4(Box::new(mp4)), times_s)
        };
        Ok(Self {
            path: path.into(),
            source,
            times_s,
            next: 0,
            size_px: None,
            warnings,
        })
    }

    /// What is taken for granted or left out of the file.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
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
            Source::Mp4(mp4) => (mp4.frame(&self.path, index)?, None),
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
    fn open(path: &Path, mut file: File) -> Result<(Self, Vec<f64>, Notes), VideoError> {
        let index = index(&mut file).map_err(|broken| broken.at(path))?;
        let movie = Movie::parse(&index).map_err(|broken| broken.at(path))?;
        let mut notes = movie.notes;
        let mut mp4 = Self {
            file,
            samples: movie.samples,
            descriptions: movie.descriptions,
            description: None,
            stated: None,
            turn: movie.turn,
            decoder: Decoder::new(),
            decoded: 0,
            waiting: BTreeMap::new(),
        };
        mp4.begin(0).map_err(|why| format(why).at(path))?;
        let first = &mp4.descriptions[0];
        colours(first, mp4.stated).map_err(|why| format(why).at(path))?;
        note_pictures(first, mp4.stated, &mut notes);
        Ok((mp4, movie.times_s, notes))
    }

    /// Gives the decoder the parameter sets of a description.
    fn begin(&mut self, description: usize) -> Result<(), String> {
        if self.description != Some(description) {
            let next = &self.descriptions[description];
            decoded(&mut self.decoder, &next.head)?;
            self.stated = next.stated;
            self.description = Some(description);
        }
        Ok(())
    }

    /// The picture that is shown at place `place`; asked for in order.
    fn frame(&mut self, path: &Path, place: usize) -> Result<RgbImage, VideoError> {
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
            let Some(sample) = self.samples.get(index).copied() else {
                return Err(wrong("it is missing".into()));
            };
            let picture = self.picture(sample).map_err(wrong)?;
            if let (Some(place), Some(picture)) = (sample.place, picture) {
                self.waiting.insert(place, picture);
            }
            self.decoded += 1;
        }
    }

    /// The picture of a sample as it is shown; none of one that is not.
    fn picture(&mut self, sample: Sample) -> Result<Option<RgbImage>, String> {
        let mut data = vec![0; sample.size as usize];
        self.file
            .seek(SeekFrom::Start(sample.offset))
            .and_then(|_| self.file.read_exact(&mut data))
            .map_err(|error| error.to_string())?;
        self.begin(sample.description)?;
        let description = &self.descriptions[sample.description];
        let units =
            units(&data, description.length_bytes).ok_or("its parts are longer than it is")?;
        self.stated = units.iter().find_map(|unit| stated(unit)).or(self.stated);
        let frame = decoded(&mut self.decoder, &annex_b(&units))?;
        if sample.place.is_none() {
            return Ok(None);
        }
        let frame = frame.ok_or("it holds no picture")?;
        if !frame.is_valid() {
            return Err("its planes do not fit its size".into());
        }
        let colours = colours(description, self.stated)?;
        let whole = rgb_of(&frame, colours);
        let [left, top] = self.stated.unwrap_or_default().corner_px;
        let (width, height) = whole.dimensions();
        if left >= width || top >= height {
            return Err("nothing of it is shown".into());
        }
        let mut picture = cut(whole, [left, top, width - left, height - top]);
        let size_px = picture.dimensions().into();
        if let Some(aperture) = description.aperture {
            let rectangle = aperture.rectangle(size_px);
            picture = cut(
                picture,
                rectangle.ok_or("its clean aperture does not lie in it")?,
            );
        }
        Ok(Some(self.turn.apply(picture)))
    }
}

/// A rectangle (left, top, width, height) [px] of a picture.
fn cut(picture: RgbImage, [left, top, width, height]: [u32; 4]) -> RgbImage {
    if (width, height) == picture.dimensions() {
        return picture;
    }
    image::imageops::crop_imm(&picture, left, top, width, height).to_image()
}

/// The colours of pictures: those that the container says, then those that the stream does.
fn colours(description: &Description, stated: Option<Stated>) -> Result<Colours, String> {
    let stated = stated.unwrap_or_default();
    let said = description
        .colours
        .map(|([matrix, _], _)| matrix)
        .filter(|matrix| *matrix != 2);
    let matrix = said.or(stated.matrix);
    let full = description
        .colours
        .and_then(|(_, full)| full)
        .or(stated.full_range);
    Colours::of(matrix, full.unwrap_or(false)).ok_or_else(|| {
        let code = matrix.unwrap_or_default();
        format!("its colours are of matrix {code} of ITU-T H.273, which is none of brightness and colour differences")
    })
}

/// Notes what the pictures are said to be that they are not taken as.
fn note_pictures(description: &Description, stated: Option<Stated>, notes: &mut Notes) {
    let stated = stated.unwrap_or_default();
    let aspect = description.aspect.or(stated.aspect);
    if let Some([width, height]) = aspect.filter(|[width, height]| width != height) {
        let what = format!("a pixel is {width} wide and {height} high: it is taken as square");
        let mend = "make them square with `ffmpeg -i IN -vf scale=iw*sar:ih,setsar=1 OUT.mp4`";
        notes.assume("pixels", what, mend);
    }
    if description.fields {
        let mend = "part them with `ffmpeg -i IN -vf bwdif OUT.mp4`";
        notes.assume(
            "frames",
            "each is of two fields (interlaced): they are taken as they are",
            mend,
        );
    }
    let transfer = description
        .colours
        .map(|([_, transfer], _)| transfer)
        .or(stated.transfer);
    if let Some(code @ (16 | 18)) = transfer {
        let name = if code == 16 { "PQ" } else { "HLG" };
        let what = format!(
            "their brightness is that of high dynamic range ({name}): it is taken as it is"
        );
        notes.assume(
            "colours",
            what,
            "convert it to BT.709 with ffmpeg's filter zscale",
        );
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

/// The units of a sample, each after its length.
fn units(sample: &[u8], length_bytes: usize) -> Option<Vec<&[u8]>> {
    let mut units = Vec::new();
    let mut rest = sample;
    while !rest.is_empty() {
        let (length, after) = rest.split_at_checked(length_bytes)?;
        let length = length.iter().fold(0, |n, b| n << 8 | usize::from(*b));
        let (unit, after) = after.split_at_checked(length)?;
        units.push(unit);
        rest = after;
    }
    Some(units)
}

/// Units as a byte stream with start codes.
fn annex_b(units: &[&[u8]]) -> Vec<u8> {
    let mut out = Vec::new();
    for unit in units {
        out.extend([0, 0, 0, 1]);
        out.extend(*unit);
    }
    out
}
