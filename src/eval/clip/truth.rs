//! The boxes of clips: a list of clips with boxes by label, or COCO annotations of their pictures.

use crate::eval::EvalError;
use crate::eval::detector::coco::{Coco, CocoError, UAVS, is_other};
use crate::eval::detector::metrics::Truth;
use crate::media::clip_boxes::{self, LabelledFrame, ListFault};
use crate::media::video::{Clip, ClipFrame};
use crate::warning::{self, StrictError};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Boxes of a frame [px].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameTruth {
    /// Boxes of UAVs.
    pub uavs: Vec<Truth>,
    /// Other things: x0, y0, x1, y1.
    pub others: Vec<[f64; 4]>,
    /// What all these boxes are called.
    pub labels: BTreeSet<String>,
}

/// Boxes of a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct ClipTruth {
    /// Name of the clip's file, without folders.
    pub file: String,
    /// Boxes of each of its frames.
    pub frames: Vec<FrameTruth>,
}

/// Why the truth of `--boxes` cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum BoxesError {
    /// The annotations of pictures.
    #[error(transparent)]
    Coco(#[from] CocoError),
    /// Warnings where they are errors.
    #[error(transparent)]
    Strict(#[from] StrictError),
    /// The file, or what it says of a clip.
    #[error("--boxes: {path}: {fault}")]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        fault: BoxesFault,
    },
}

impl From<BoxesError> for EvalError {
    fn from(error: BoxesError) -> Self {
        Self::own(error)
    }
}

/// What is wrong with a file of boxes.
#[derive(Debug, thiserror::Error)]
pub enum BoxesFault {
    /// The list itself.
    #[error(transparent)]
    List(#[from] ListFault),
    /// The list has no entry of a clip.
    #[error("it lists no boxes of '{clip}'; add them, or name another file")]
    NoClip {
        /// The clip's file.
        clip: String,
    },
    /// The entry of a clip is of another length.
    #[error("it lists {listed} frames of {clip}, which has {frames}; list the boxes of every frame", clip = clip.display())]
    Length {
        /// The clip.
        clip: PathBuf,
        /// Frames of the entry.
        listed: usize,
        /// Frames of the clip.
        frames: usize,
    },
    /// Annotations of pictures with a video.
    #[error("COCO annotations are of pictures, but {} is a video; give a folder of its pictures", .0.display())]
    Video(PathBuf),
    /// The annotations have no such picture.
    #[error("it does not list {}; add the picture, or leave it out of the folder", .0.display())]
    NoPicture(PathBuf),
    /// A picture is of another size than the annotations say.
    #[error(
        "{file} is {} × {} px, but images[].width and height say {} × {}; correct them",
        found_px[0], found_px[1], listed_px[0], listed_px[1]
    )]
    Size {
        /// The picture's file.
        file: String,
        /// Its width and height [px].
        found_px: [u32; 2],
        /// Those of the annotations [px].
        listed_px: [u32; 2],
    },
}

/// Which labels are of UAVs.
struct Labels<'a>(&'a [String]);

impl Labels<'_> {
    /// Whether a label is of UAVs: one of those named, or without names one that says so; `None` if that
    /// is not clear.
    fn is_uav(&self, label: &str) -> Option<bool> {
        let is = |names: &[&str]| names.iter().any(|n| n.eq_ignore_ascii_case(label));
        match self.0 {
            [] if is(&UAVS) => Some(true),
            [] => is_other(label).then_some(false),
            names => Some(names.iter().any(|c| c.eq_ignore_ascii_case(label))),
        }
    }

    /// The truth of a frame, or what is wrong with its labels.
    fn frame(&self, labels: &LabelledFrame) -> Result<FrameTruth, String> {
        let mut frame = FrameTruth::default();
        for (label, boxes) in labels {
            let uav = self.is_uav(label).ok_or_else(|| {
                format!(
                    "whether '{label}' is a UAV is not clear; name the labels that are with --category"
                )
            })?;
            if !boxes.is_empty() {
                frame.labels.insert(label.to_lowercase());
            }
            for box_px in boxes {
                let [x0, y0, x1, y1] = *box_px;
                if uav {
                    frame.uavs.push(Truth {
                        box_px: *box_px,
                        area_px2: (x1 - x0) * (y1 - y0),
                        ignored: false,
                    });
                } else {
                    frame.others.push(*box_px);
                }
            }
        }
        Ok(frame)
    }
}

/// Reads a list of clips with their boxes; those labelled with one of `categories` are UAVs, or
/// without categories those whose label says so.
pub fn parse_boxes(text: &str, categories: &[String]) -> Result<Vec<ClipTruth>, ListFault> {
    let labels = Labels(categories);
    (clip_boxes::parse(text)?.into_iter().enumerate())
        .map(|(index, clip)| {
            let frames = (clip.frames.iter().enumerate())
                .map(|(i, boxes)| {
                    labels
                        .frame(boxes)
                        .map_err(|why| format!("frame {i}: {why}"))
                })
                .collect::<Result<_, _>>();
            let file = clip.file;
            match frames {
                Ok(frames) => Ok(ClipTruth { file, frames }),
                Err(why) => Err(ListFault::Value { index, file, why }),
            }
        })
        .collect()
}

/// The truth of `--boxes`.
pub(super) enum BoxFile {
    /// Clips by their files' names.
    Clips(PathBuf, Vec<ClipTruth>),
    /// A set, and the index of each picture by its file.
    Pictures(Box<Coco>, BTreeMap<PathBuf, usize>),
}

impl BoxFile {
    pub(super) fn load(path: &Path, categories: &[String]) -> Result<Self, BoxesError> {
        if path.is_dir() {
            return Self::pictures(path, categories);
        }
        let wrong = |fault: BoxesFault| BoxesError::File {
            path: path.into(),
            fault,
        };
        let text =
            std::fs::read_to_string(path).map_err(|error| wrong(ListFault::from(error).into()))?;
        if text.trim_start().starts_with('{') {
            return Self::pictures(path, categories);
        }
        let clips = parse_boxes(&text, categories).map_err(|fault| wrong(fault.into()))?;
        Ok(Self::Clips(path.into(), clips))
    }

    fn pictures(path: &Path, categories: &[String]) -> Result<Self, BoxesError> {
        let coco = Coco::load(path, categories)?;
        warning::tell(&coco.warnings())?;
        // Pictures that are not there are of other clips.
        let places = (coco.pictures.iter().enumerate())
            .filter_map(|(i, picture)| {
                Some((std::fs::canonicalize(coco.path(picture).ok()?).ok()?, i))
            })
            .collect();
        Ok(Self::Pictures(Box::new(coco), places))
    }

    /// Refuses a clip of which this file does not tell the truth.
    pub(super) fn check(&self, file: &Path, clip: &Clip) -> Result<(), BoxesError> {
        self.checked(file, clip).map_err(|fault| self.wrong(fault))
    }

    /// The boxes of frame `index` of a clip.
    pub(super) fn of(
        &self,
        file: &Path,
        index: usize,
        frame: &ClipFrame,
    ) -> Result<FrameTruth, BoxesError> {
        self.frame(file, index, frame)
            .map_err(|fault| self.wrong(fault))
    }

    fn wrong(&self, fault: BoxesFault) -> BoxesError {
        let path = match self {
            Self::Clips(path, _) => path,
            Self::Pictures(coco, _) => &coco.file,
        };
        BoxesError::File {
            path: path.clone(),
            fault,
        }
    }

    fn checked(&self, file: &Path, clip: &Clip) -> Result<(), BoxesFault> {
        match self {
            Self::Pictures(_, places) => {
                if clip.files().is_empty() {
                    return Err(BoxesFault::Video(file.into()));
                }
                (clip.files().iter()).try_for_each(|file| place(places, file).map(|_| ()))
            }
            Self::Clips(_, clips) => {
                let listed = listed(clips, file)?.frames.len();
                if listed == clip.frames() {
                    return Ok(());
                }
                Err(BoxesFault::Length {
                    clip: file.into(),
                    listed,
                    frames: clip.frames(),
                })
            }
        }
    }

    fn frame(
        &self,
        file: &Path,
        index: usize,
        frame: &ClipFrame,
    ) -> Result<FrameTruth, BoxesFault> {
        match self {
            Self::Clips(_, clips) => {
                let frames = &listed(clips, file)?.frames;
                Ok(frames.get(index).cloned().unwrap_or_default())
            }
            Self::Pictures(coco, places) => {
                let at = place(places, frame.file.as_deref().unwrap_or(file))?;
                let picture = &coco.pictures[at];
                if picture.size_px() != frame.size_px() {
                    return Err(BoxesFault::Size {
                        file: picture.file_name.clone(),
                        found_px: frame.size_px(),
                        listed_px: picture.size_px(),
                    });
                }
                Ok(FrameTruth {
                    uavs: coco.truth[at].clone(),
                    others: coco.others[at].iter().map(|other| other.box_px).collect(),
                    labels: (coco.category[at].iter())
                        .filter_map(|id| coco.categories.get(id))
                        .chain(coco.others[at].iter().map(|other| &other.name))
                        .map(|name| name.to_lowercase())
                        .collect(),
                })
            }
        }
    }
}

/// The entry of a clip.
fn listed<'a>(clips: &'a [ClipTruth], file: &Path) -> Result<&'a ClipTruth, BoxesFault> {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let found = clips.iter().find(|clip| clip.file == name);
    found.ok_or_else(|| BoxesFault::NoClip { clip: name.into() })
}

/// The index of a picture in the set, by its file.
fn place(places: &BTreeMap<PathBuf, usize>, file: &Path) -> Result<usize, BoxesFault> {
    let found = std::fs::canonicalize(file).ok();
    let found = found.and_then(|file| places.get(&file).copied());
    found.ok_or_else(|| BoxesFault::NoPicture(file.into()))
}
