//! `boresight eval clip`: a detector and the tracker on clips of real cameras.
//!
//! The tracker is that of a run, with its table, its filter and its states, fed with the clip as
//! the frames of a coarse camera that stands still under an open sky. A nominal pinhole turns
//! pixels into angles, for the filter's motion is one of angles. Latency is none.

use super::coco::{Coco, OTHERS, UAVS};
use super::detector::Miss;
use super::page::{note, number, table};
use super::{job, mot, progress, quoted, threads, within, within_share};
use crate::app::{self, RunError};
use crate::components::capture::{PixelRect, Tier};
use crate::components::clock::SimClock;
use crate::components::mount::{Alignment, Pointing};
use crate::components::track::{DetectionBatch, Tracker, TrackingState};
use crate::eval::detector::metrics::{ALL, Criterion, Image, Matching, Truth};
use crate::inference::OnnxDetector;
use crate::media::video::{Clip, Frame, Writer};
use crate::models::maths::kinematics::{Pose, az_el_to_los};
use crate::models::optics::camera::Pinhole;
use crate::models::optics::detection::Detection;
use crate::models::tracking::table::Track;
use crate::recording::encode_jpeg;
use crate::report::{Across, Chart, Escaped, STYLE, Scale, Series, StateSpan, states_html};
use crate::scenario;
use crate::systems::track::{Situation, TrackerParams, patience_s, step, take_in};
use base64::{Engine as _, prelude::BASE64_STANDARD};
use clap::Args;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, btree_map::Entry};
use std::fmt::{self, Write as _};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What `boresight eval clip` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// Clips: MP4 or MOV files with H.264, or folders of numbered pictures (PNG, JPEG).
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// ONNX model with the interface of training/README.md.
    #[arg(long)]
    pub model: PathBuf,
    /// Folder for clip.json, clip.html, overlay.mp4 and tracks.txt; of several clips, each has a
    /// folder in it.
    #[arg(long, default_value = "out/clip")]
    pub out: PathBuf,
    /// Detections with a lower score are dropped, 0 to 1; the model's own threshold by default.
    #[arg(long)]
    pub threshold: Option<f64>,
    /// Truth: a list of {file, frames, boxes_xywh}, boxes by label for every frame; for folders of
    /// pictures also COCO annotations.
    #[arg(long, value_name = "JSON")]
    pub boxes: Option<PathBuf>,
    /// Label of the boxes that are UAVs; may be repeated (default: uav, drone and kinds of them,
    /// but not bird, airplane, helicopter, balloon).
    #[arg(long, value_name = "NAME")]
    pub category: Vec<String>,
    /// Horizontal field of view that the tracker counts on [deg].
    #[arg(long, default_value_t = 1.0)]
    pub fov_deg: f64,
    /// Standard deviation of a detection's centre that the tracker counts on [px]; on real pixels
    /// it is larger than the 0.5 px of a run.
    #[arg(long, default_value_t = 2.0)]
    pub centre_sigma_px: f64,
    /// Pictures a second of a folder [Hz].
    #[arg(long, default_value_t = 30.0)]
    pub rate_hz: f64,
    /// Threads of the model (default: all cores).
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// Length of a held target's way that is drawn [s].
const TRAIL_S: f64 = 2.0;
/// Pictures of the contact sheet.
const SHEET: usize = 24;
/// Ticks of the tracker's clock a second: whole numbers of them for all usual rates.
const TICK_HZ: u32 = 90_000;

/// What was measured, as `clip.json` has it; its keys do not change. A figure without truth to
/// measure it by is null.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    /// Frames.
    pub frames: usize,
    /// Detections of at least the threshold.
    pub detections: usize,
    /// Boxes of UAVs.
    pub boxes: Option<usize>,
    /// Share of these boxes in which the centre of a detection lies.
    pub recall: Option<f64>,
    /// Share of these boxes that a detection meets with an IoU of 0.5; boxes may be loose.
    pub recall_iou_0_5: Option<f64>,
    /// Detections whose centre lies in no box of a UAV.
    pub false_alarms: Option<usize>,
    /// The same a frame.
    pub false_alarms_per_frame: Option<f64>,
    /// Further detections in a box that has one.
    pub duplicates: Option<usize>,
    /// Distance from the centres of the boxes [px].
    pub miss_distance_px: MissDistances,
    /// Share of the frames in which the tracker holds a target.
    pub locked_share: f64,
    /// Share of the frames with a UAV in which its box holds the target that the tracker holds.
    pub on_target_share: Option<f64>,
    /// Share of the frames in which the tracker holds a target that is in no box of a UAV.
    pub false_lock_share: Option<f64>,
    /// Frames over the time of decoding, detecting and tracking.
    pub frames_per_s: f64,
}

/// Miss distances of eq. 12 [px].
#[derive(Clone, Debug, Serialize)]
pub struct MissDistances {
    /// Centres of detections in a box.
    pub detector: Miss,
    /// Place of the held target in a box, as the filter has it with the frame's own detection.
    pub tracker: Miss,
}

/// One clip.
#[derive(Clone, Debug, Serialize)]
pub struct ClipFigures {
    /// The file or folder.
    pub file: PathBuf,
    /// Width and height [px].
    pub size_px: [u32; 2],
    /// Mean rate [Hz].
    pub rate_hz: f64,
    /// The figures.
    #[serde(flatten)]
    pub figures: Figures,
    /// Tracks that were confirmed, in the order of their identities.
    pub tracks: Vec<TrackFigures>,
    /// States of the tracker, in order.
    pub states: Vec<State>,
}

/// A track.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrackFigures {
    /// Identity.
    pub id: u32,
    /// Time of the first frame in which it was confirmed [s].
    pub start: f64,
    /// Time of the last [s].
    pub end: f64,
    /// Time between [s].
    pub length: f64,
    /// Frames in which it was confirmed.
    pub frames: usize,
    /// Mean score at its end.
    pub score: f64,
    /// Larger side of its box at its end [px].
    pub size_px: f64,
    /// Share of its frames in which it was in the box of a UAV.
    pub on_uav_share: Option<f64>,
}

/// A stay in a state of the tracker.
#[derive(Clone, Debug, Serialize)]
pub struct State {
    /// search, acquire, coarse (a target is held) or lost.
    pub name: &'static str,
    /// When it began [s].
    pub start: f64,
    /// Why.
    pub reason: String,
}

/// What `clip.json` holds.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// Version of the program.
    pub version: &'static str,
    /// The command that repeats it.
    pub command: String,
    /// The model.
    pub model: PathBuf,
    /// The truth.
    pub boxes_file: Option<PathBuf>,
    /// Detections with a lower score are dropped.
    pub threshold: f64,
    /// Field of view that the tracker counts on [deg].
    pub fov_deg: f64,
    /// Standard deviation of a detection's centre that it counts on [px].
    pub centre_sigma_px: f64,
    /// Threads of the model, on the CPU.
    pub threads: usize,
    /// All clips together.
    #[serde(flatten)]
    pub figures: Figures,
    /// Each clip.
    pub clips: Vec<ClipFigures>,
}

/// What figures are made of.
#[derive(Default)]
struct Tally {
    /// Whether there is truth.
    known: bool,
    frames: usize,
    detections: usize,
    boxes: usize,
    hits: usize,
    hits_iou: usize,
    false_alarms: usize,
    duplicates: usize,
    locked: usize,
    with_uav: usize,
    on_target: usize,
    false_lock: usize,
    detector_px: Vec<f64>,
    tracker_px: Vec<f64>,
    busy: Duration,
}

impl Tally {
    fn add(&mut self, other: &Self) {
        self.known |= other.known;
        self.frames += other.frames;
        self.detections += other.detections;
        self.boxes += other.boxes;
        self.hits += other.hits;
        self.hits_iou += other.hits_iou;
        self.false_alarms += other.false_alarms;
        self.duplicates += other.duplicates;
        self.locked += other.locked;
        self.with_uav += other.with_uav;
        self.on_target += other.on_target;
        self.false_lock += other.false_lock;
        self.detector_px.extend(&other.detector_px);
        self.tracker_px.extend(&other.tracker_px);
        self.busy += other.busy;
    }

    fn figures(&self) -> Figures {
        let share =
            |part: usize, of: usize| (self.known && of > 0).then(|| part as f64 / of as f64);
        let count = |n: usize| self.known.then_some(n);
        Figures {
            frames: self.frames,
            detections: self.detections,
            boxes: count(self.boxes),
            recall: share(self.hits, self.boxes),
            recall_iou_0_5: share(self.hits_iou, self.boxes),
            false_alarms: count(self.false_alarms),
            false_alarms_per_frame: share(self.false_alarms, self.frames),
            duplicates: count(self.duplicates),
            miss_distance_px: MissDistances {
                detector: Miss::of(self.detector_px.iter().copied()),
                tracker: Miss::of(self.tracker_px.iter().copied()),
            },
            locked_share: self.locked as f64 / self.frames.max(1) as f64,
            on_target_share: share(self.on_target, self.with_uav),
            false_lock_share: share(self.false_lock, self.frames),
            frames_per_s: self.frames as f64 / self.busy.as_secs_f64().max(f64::MIN_POSITIVE),
        }
    }
}

/// Carries out the evaluation and writes what it leaves.
pub fn clip(arguments: &Arguments) -> Result<Evaluation, RunError> {
    let fov_deg = arguments.fov_deg;
    within_share("--threshold", arguments.threshold)?;
    within("--fov-deg", fov_deg, 0.01, 170.0)?;
    within("--centre-sigma-px", arguments.centre_sigma_px, 0.01, 20.0)?;
    within("--rate-hz", arguments.rate_hz, 0.1, 10_000.0)?;
    let boxes = arguments.boxes.as_deref();
    let truth = boxes
        .map(|path| BoxFile::load(path, &arguments.category))
        .transpose()?;
    let threads = threads(arguments.threads);
    let mut model = OnnxDetector::load(&arguments.model, threads)?;
    let threshold = arguments.threshold.unwrap_or(model.score_threshold());
    let arguments = &Arguments {
        threshold: Some(threshold),
        ..arguments.clone()
    };
    // What cannot be read or written is told before the work.
    for file in &arguments.files {
        let clip = Clip::open(file, arguments.rate_hz)?;
        if let Some(truth) = &truth {
            truth.check(file, &clip)?;
        }
    }
    mot::writable(&arguments.out.join("clip.json"))?;
    let head = |files: &[PathBuf]| Evaluation {
        version: app::VERSION,
        command: command(arguments, files, threads, threshold),
        model: arguments.model.clone(),
        boxes_file: arguments.boxes.clone(),
        threshold,
        fov_deg,
        centre_sigma_px: arguments.centre_sigma_px,
        threads,
        figures: Tally::default().figures(),
        clips: Vec::new(),
    };
    let several = arguments.files.len() > 1;
    let names = folder_names(&arguments.files);
    let mut all = Tally::default();
    let mut clips = Vec::new();
    for (file, name) in arguments.files.iter().zip(&names) {
        let folder = if several {
            arguments.out.join(name)
        } else {
            arguments.out.clone()
        };
        let played = play(&mut model, file, name, truth.as_ref(), arguments, &folder)?;
        all.add(&played.tally);
        clips.push(played.clip.clone());
        let evaluation = Evaluation {
            figures: played.clip.figures.clone(),
            clips: vec![played.clip.clone()],
            ..head(std::slice::from_ref(file))
        };
        let page = |page: &mut String| one_page(page, &evaluation, name, &played);
        write(&folder, &evaluation, page)?;
    }
    let evaluation = Evaluation {
        figures: all.figures(),
        clips,
        ..head(&arguments.files)
    };
    if several {
        let page = |page: &mut String| all_page(page, &evaluation, &names);
        write(&arguments.out, &evaluation, page)?;
    }
    Ok(evaluation)
}

fn command(arguments: &Arguments, files: &[PathBuf], threads: usize, threshold: f64) -> String {
    let files: String = (files.iter())
        .map(|file| format!(" {}", quoted(file.display())))
        .collect();
    let boxes = arguments.boxes.as_ref();
    let boxes = boxes.map_or(String::new(), |b| {
        format!(" --boxes {}", quoted(b.display()))
    });
    let categories: String = (arguments.category.iter())
        .map(|name| format!(" --category {}", quoted(name)))
        .collect();
    format!(
        "boresight eval clip{files} --model {} --threshold {}{boxes}{categories} --fov-deg {} \
         --centre-sigma-px {} --rate-hz {} --threads {threads}",
        quoted(arguments.model.display()),
        threshold,
        arguments.fov_deg,
        arguments.centre_sigma_px,
        arguments.rate_hz
    )
}

/// A folder for every clip: its name without ending, numbered where that is not unique.
fn folder_names(files: &[PathBuf]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for file in files {
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        let mut name = stem.to_string();
        let mut number = 2;
        while name.is_empty() || names.contains(&name) {
            name = format!("{stem}-{number}");
            number += 1;
        }
        names.push(name);
    }
    names
}

/// Boxes of a frame [px].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameTruth {
    /// UAVs.
    pub uavs: Vec<Truth>,
    /// What is none: x0, y0, x1, y1.
    pub others: Vec<[f64; 4]>,
}

/// Boxes of a clip.
#[derive(Clone, Debug, PartialEq)]
pub struct ClipTruth {
    /// Name of the clip's file, without folders.
    pub file: String,
    /// Boxes of each of its frames.
    pub frames: Vec<FrameTruth>,
}

/// Why a list of boxes is none.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BoxesError {
    /// No JSON, a key missing or of another type.
    #[error("{0}; expected a list of {{file, frames, boxes_xywh}}")]
    Json(String),
    /// A value that cannot be.
    #[error("[{index}] ({file}): {why}")]
    Value {
        /// Index in the list.
        index: usize,
        /// The clip's file.
        file: String,
        /// What is wrong, and what would be right.
        why: String,
    },
}

/// A clip as the file has it.
#[derive(Debug, Deserialize)]
struct Listed {
    file: String,
    frames: usize,
    boxes_xywh: Vec<BTreeMap<String, Vec<[f64; 4]>>>,
}

/// Reads a list of clips with their boxes; those labelled with one of `categories` are UAVs, or
/// without categories those whose label says so.
pub fn parse_boxes(text: &str, categories: &[String]) -> Result<Vec<ClipTruth>, BoxesError> {
    let listed: Vec<Listed> =
        serde_json::from_str(text).map_err(|error| BoxesError::Json(error.to_string()))?;
    let is = |names: &[&str], label: &str| names.iter().any(|n| n.eq_ignore_ascii_case(label));
    let mut clips: Vec<ClipTruth> = Vec::with_capacity(listed.len());
    for (index, clip) in listed.into_iter().enumerate() {
        let wrong = |why: String| BoxesError::Value {
            index,
            file: clip.file.clone(),
            why,
        };
        if clip.boxes_xywh.len() != clip.frames {
            let (found, frames) = (clip.boxes_xywh.len(), clip.frames);
            return Err(wrong(format!(
                "boxes_xywh has {found} entries, frames says {frames}"
            )));
        }
        if clips.iter().any(|other| other.file == clip.file) {
            return Err(wrong("the file is listed twice".into()));
        }
        let mut frames = vec![FrameTruth::default(); clip.frames];
        for (i, (labels, frame)) in clip.boxes_xywh.iter().zip(&mut frames).enumerate() {
            for (label, boxes) in labels {
                let uav = if categories.is_empty() {
                    is(&UAVS, label)
                } else {
                    categories.iter().any(|c| c.eq_ignore_ascii_case(label))
                };
                if !uav && categories.is_empty() && !is(&OTHERS, label) {
                    return Err(wrong(format!(
                        "frame {i}: whether '{label}' is a UAV is not clear; name the labels that \
                         are with --category"
                    )));
                }
                for [x, y, width, height] in boxes {
                    let box_px = [*x, *y, x + width, y + height];
                    if !(*width > 0.0 && *height > 0.0 && box_px.iter().all(|c| c.is_finite())) {
                        return Err(wrong(format!(
                            "frame {i}: the box [{x}, {y}, {width}, {height}] must be x, y, width \
                             and height with sides above 0 px"
                        )));
                    }
                    if uav {
                        frame.uavs.push(Truth {
                            box_px,
                            area_px2: width * height,
                            ignored: false,
                        });
                    } else {
                        frame.others.push(box_px);
                    }
                }
            }
        }
        clips.push(ClipTruth {
            file: clip.file,
            frames,
        });
    }
    Ok(clips)
}

/// The truth of `--boxes`.
enum BoxFile {
    Clips(PathBuf, Vec<ClipTruth>),
    /// A set, and the index of each picture by its file.
    Pictures(Coco, BTreeMap<PathBuf, usize>),
}

impl BoxFile {
    fn load(path: &Path, categories: &[String]) -> Result<Self, RunError> {
        let wrong = |why: String| RunError::Argument {
            argument: "--boxes",
            why: format!("{}: {why}", path.display()),
        };
        let pictures = || -> Result<Self, RunError> {
            let coco = Coco::load(path, categories)?;
            // Pictures that are not there are of other clips.
            let places = (coco.pictures.iter().enumerate())
                .filter_map(|(i, picture)| {
                    Some((std::fs::canonicalize(coco.path(picture).ok()?).ok()?, i))
                })
                .collect();
            Ok(Self::Pictures(coco, places))
        };
        if path.is_dir() {
            return pictures();
        }
        let text = std::fs::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
        if text.trim_start().starts_with('{') {
            return pictures();
        }
        let clips = parse_boxes(&text, categories).map_err(|error| wrong(error.to_string()))?;
        Ok(Self::Clips(path.into(), clips))
    }

    fn wrong(&self, why: String) -> RunError {
        let path = match self {
            Self::Clips(path, _) => path,
            Self::Pictures(coco, _) => &coco.file,
        };
        RunError::Argument {
            argument: "--boxes",
            why: format!("{}: {why}", path.display()),
        }
    }

    fn listed(&self, file: &Path) -> Result<&ClipTruth, RunError> {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let found = match self {
            Self::Clips(_, clips) => clips.iter().find(|clip| clip.file == name),
            Self::Pictures(..) => None,
        };
        found.ok_or_else(|| self.wrong(format!("it lists no boxes of '{name}'")))
    }

    /// Refuses a clip of which this file does not tell the truth.
    fn check(&self, file: &Path, clip: &Clip) -> Result<(), RunError> {
        let frames = clip.frames();
        if let Self::Pictures(..) = self {
            if clip.files().is_empty() {
                return Err(self.wrong(format!(
                    "COCO annotations are of pictures, but {} is a video",
                    file.display()
                )));
            }
            return (clip.files().iter()).try_for_each(|file| self.place(file).map(|_| ()));
        }
        let listed = self.listed(file)?.frames.len();
        if listed == frames {
            return Ok(());
        }
        Err(self.wrong(format!(
            "it lists {listed} frames of {}, which has {frames}",
            file.display()
        )))
    }

    /// The index of a picture in the set, by its file.
    fn place(&self, file: &Path) -> Result<usize, RunError> {
        let found = match self {
            Self::Pictures(_, places) => {
                (std::fs::canonicalize(file).ok()).and_then(|file| places.get(&file))
            }
            Self::Clips(..) => None,
        };
        found
            .copied()
            .ok_or_else(|| self.wrong(format!("it does not list {}", file.display())))
    }

    /// The boxes of frame `index` of a clip.
    fn of(&self, file: &Path, index: usize, frame: &Frame) -> Result<FrameTruth, RunError> {
        let Self::Pictures(coco, _) = self else {
            let frames = &self.listed(file)?.frames;
            return Ok(frames.get(index).cloned().unwrap_or_default());
        };
        let at = self.place(frame.file.as_deref().unwrap_or(file))?;
        let (picture, [width, height]) = (&coco.pictures[at], frame.size_px);
        if [picture.width, picture.height] != frame.size_px {
            return Err(self.wrong(format!(
                "{} is {width} × {height} px, but images[].width and height say {} × {}",
                picture.file_name, picture.width, picture.height
            )));
        }
        Ok(FrameTruth {
            uavs: coco.truth[at].clone(),
            others: Vec::new(),
        })
    }
}

/// The run's tracker at work on a clip.
struct Follower {
    clock: SimClock,
    params: TrackerParams,
    tracker: Tracker,
    pinhole: Pinhole,
    pointing: Pointing,
    pose: Pose,
}

/// A track in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Followed {
    id: u32,
    /// Where the filter has it [px].
    px: DVec2,
    /// Larger side of its box [px].
    side_px: f64,
    /// Its detection's box in this frame [px].
    seen_px: Option<[f64; 4]>,
    score: f64,
}

impl Follower {
    fn new(
        [width, height]: [u32; 2],
        rate_hz: f64,
        arguments: &Arguments,
    ) -> Result<Self, RunError> {
        let pinhole = Pinhole::from_hfov(width, height, arguments.fov_deg.to_radians());
        let pinhole = pinhole.map_err(|error| RunError::Argument {
            argument: "--fov-deg",
            why: error.to_string(),
        })?;
        let defaults = scenario::Tracker::default();
        let pointing = Pointing {
            az_el_rad: DVec2::ZERO,
            mirror_rad: DVec2::ZERO,
            base_tilt_rad: DVec3::ZERO,
            alignment: Alignment::default(),
        };
        Ok(Self {
            clock: SimClock {
                tick: 0,
                tick_hz: TICK_HZ,
            },
            params: TrackerParams {
                nearest_to_centre: false,
                linear_angles: false,
                centre_sigma_px: arguments.centre_sigma_px,
                min_quality: defaults.min_quality,
                min_score: 0.0,
                switch_ratio: defaults.switch_ratio,
                r_asset_enu_m: DVec3::ZERO,
                aim: None,
                // There is no precise camera to lock.
                lock_radius_px: 0.0,
                lock_dwell_s: f64::INFINITY,
                break_radius_px: 0.0,
                patience_s: [patience_s(rate_hz); 3],
            },
            tracker: Tracker::default(),
            pinhole,
            pointing,
            pose: pointing.believed_pose(DVec3::ZERO, Tier::Coarse),
        })
    }

    /// Takes a frame's detections in; returns the confirmed tracks in view.
    fn look(&mut self, t_s: f64, detections: &[Detection]) -> Vec<Followed> {
        let tick = (t_s * f64::from(TICK_HZ)).round() as u64;
        self.clock.tick = tick;
        let t_s = self.clock.t_s();
        let (width, height) = (self.pinhole.width_px, self.pinhole.height_px);
        let batch = DetectionBatch {
            tier: Tier::Coarse,
            exposure_tick: tick,
            available_tick: tick,
            pointing: self.pointing,
            rect: PixelRect {
                offset_px: [0, 0],
                size_px: [width, height],
            },
            detections: detections.to_vec(),
        };
        let (tracker, params, pinhole) = (&mut self.tracker, &self.params, &self.pinhole);
        let assigned = take_in(tracker, params, &batch, pinhole, DVec3::ZERO, t_s);
        let now = Situation {
            tick,
            clock: &self.clock,
            params,
            dsm: None,
            r_station_enu_m: DVec3::ZERO,
        };
        step(&now, tracker, false, true);
        let found = |track: &Track| {
            let index = assigned.iter().position(|id| *id == Some(track.id))?;
            detections.get(index).map(|detection| detection.box_px)
        };
        (self.tracker.table.tracks.iter())
            .filter(|track| job::confirmed(track, &self.params, t_s))
            .filter_map(|track| {
                let los_enu = az_el_to_los(track.filter.predicted(t_s).az_el_rad());
                let px = (self.pinhole).project(self.pose.q_enu_cam.inverse() * los_enu)?;
                Some(Followed {
                    id: track.id,
                    px,
                    side_px: track.size_rad / self.pinhole.ifov_rad(),
                    seen_px: found(track),
                    score: track.score,
                })
            })
            .filter(|followed| self.pinhole.contains(followed.px))
            .collect()
    }

    /// The target that is held.
    fn held(&self) -> Option<u32> {
        let held = matches!(
            self.tracker.state,
            TrackingState::Coarse | TrackingState::Precise | TrackingState::Engage
        );
        self.tracker.target.filter(|_| held)
    }
}

fn inside([x0, y0, x1, y1]: [f64; 4], px: DVec2) -> bool {
    (x0..=x1).contains(&px.x) && (y0..=y1).contains(&px.y)
}

/// A clip that has been played.
struct Played {
    clip: ClipFigures,
    tally: Tally,
    curves: Curves,
    end_s: f64,
    sheet: Vec<Sheet>,
}

/// What is drawn over time.
#[derive(Default)]
struct Curves {
    /// Miss distance of detector and tracker [px].
    miss_px: [Series; 2],
    /// Best score on a UAV (without truth: anywhere), and elsewhere.
    score: [Series; 2],
}

/// A picture of the contact sheet.
struct Sheet {
    t_s: f64,
    frame: usize,
    caption: String,
    jpeg: Vec<u8>,
}

/// What is gathered of a track while it lasts.
#[derive(Clone, Copy)]
struct Life {
    start_s: f64,
    end_s: f64,
    frames: usize,
    on_uav: usize,
    /// Frames in a region to ignore, which speak neither for it nor against it.
    ignored: usize,
    last: Followed,
}

/// Plays a clip; writes its overlay and its tracks into `folder`.
fn play(
    model: &mut OnnxDetector,
    file: &Path,
    name: &str,
    truth: Option<&BoxFile>,
    arguments: &Arguments,
    folder: &Path,
) -> Result<Played, RunError> {
    let mut clip = Clip::open(file, arguments.rate_hz)?;
    let (count, rate_hz) = (clip.frames(), clip.rate_hz());
    std::fs::create_dir_all(folder).map_err(|source| RunError::Output {
        path: folder.into(),
        source,
    })?;
    let mut tally = Tally {
        known: truth.is_some(),
        ..Tally::default()
    };
    let mut curves = Curves::default();
    let mut images = Vec::with_capacity(count);
    let mut lives: BTreeMap<u32, Life> = BTreeMap::new();
    let mut trail: Vec<DVec2> = Vec::new();
    let mut lines = String::new();
    let mut sheet = Vec::new();
    let mut at_work: Option<(Follower, Writer)> = None;
    let (mut size_px, mut end_s) = ([0, 0], 0.0);
    let mut shown = Instant::now();
    for index in 0..count {
        let started = Instant::now();
        let Some(mut frame) = clip.next_frame()? else {
            break;
        };
        let mut spent = started.elapsed();
        (size_px, end_s) = (frame.size_px, frame.t_s);
        let (follower, writer) = match &mut at_work {
            Some(at_work) => at_work,
            None => {
                // Memory is set up at the first picture of a size.
                model.detect(&frame.rgb8, frame.size_px, &mut Vec::new())?;
                let overlay = folder.join("overlay.mp4");
                at_work.insert((
                    Follower::new(size_px, rate_hz, arguments)?,
                    Writer::create(&overlay, size_px, rate_hz)?,
                ))
            }
        };
        let started = Instant::now();
        let mut found = Vec::new();
        model.detect(&frame.rgb8, frame.size_px, &mut found)?;
        let sure = found.partition_point(|d| Some(d.score) >= arguments.threshold);
        let followed = follower.look(frame.t_s, &found[..sure]);
        spent += started.elapsed();
        tally.busy += spent;

        let boxes = match truth {
            Some(truth) => truth.of(file, index, &frame)?,
            None => FrameTruth::default(),
        };
        let on = |px: DVec2, ignored: bool| {
            (boxes.uavs.iter()).find(|t| t.ignored == ignored && inside(t.box_px, px))
        };
        let on_uav = |px: DVec2| on(px, false);
        let elsewhere = |px: DVec2| on_uav(px).is_none() && on(px, true).is_none();
        let best = |wanted: bool| {
            let fits = |d: &&Detection| {
                let px = d.centre_px().into();
                !tally.known
                    || if wanted {
                        on_uav(px).is_some()
                    } else {
                        elsewhere(px)
                    }
            };
            (found.iter().find(fits)).map_or(f64::NAN, |d| d.score)
        };
        curves.score[0].push((frame.t_s, best(true)));
        if tally.known {
            curves.score[1].push((frame.t_s, best(false)));
        }

        for (young, old) in &follower.tracker.table.joined {
            let Some(young) = lives.remove(young) else {
                continue;
            };
            match lives.entry(*old) {
                Entry::Vacant(entry) => {
                    entry.insert(young);
                }
                Entry::Occupied(entry) => {
                    let life = entry.into_mut();
                    life.start_s = life.start_s.min(young.start_s);
                    life.frames += young.frames;
                    life.on_uav += young.on_uav;
                    life.ignored += young.ignored;
                }
            }
        }
        for track in &followed {
            let life = lives.entry(track.id).or_insert(Life {
                start_s: frame.t_s,
                end_s: frame.t_s,
                frames: 0,
                on_uav: 0,
                ignored: 0,
                last: *track,
            });
            life.end_s = frame.t_s;
            life.frames += 1;
            life.on_uav += usize::from(on_uav(track.px).is_some());
            life.ignored += usize::from(on_uav(track.px).is_none() && !elsewhere(track.px));
            life.last = *track;
            mot_line(&mut lines, index, track);
        }
        let held = follower.held();
        let target = followed.iter().find(|track| Some(track.id) == held);
        let hit = target.and_then(|target| on_uav(target.px).map(|truth| (target, truth)));
        let has_uav = boxes.uavs.iter().any(|t| !t.ignored);
        tally.locked += usize::from(target.is_some());
        tally.with_uav += usize::from(has_uav);
        tally.on_target += usize::from(hit.is_some());
        tally.false_lock += usize::from(target.is_some_and(|target| elsewhere(target.px)));
        let miss = hit.map(|(target, truth)| target.px.distance(truth.centre_px().into()));
        tally.tracker_px.extend(miss);
        curves.miss_px[1].push((frame.t_s, miss.unwrap_or(f64::NAN)));
        match target {
            Some(target) => trail.push(target.px),
            None => trail.clear(),
        }

        found.truncate(sure);
        let recent = trail.len().saturating_sub((TRAIL_S * rate_hz) as usize);
        draw(
            &mut frame,
            &boxes,
            &found,
            &followed,
            held,
            &trail[recent..],
        );
        writer.push(&frame.rgb8, frame.size_px)?;
        // Evenly spread over the clip: the frame in the middle of each share.
        let shares = SHEET.min(count);
        if (0..shares).any(|k| (2 * k + 1) * count / (2 * shares) == index) {
            let of_interest = (target.map(|target| target.px))
                .or(boxes.uavs.first().map(|truth| truth.centre_px().into()))
                .or(found.first().map(|best| best.centre_px().into()));
            if let Some(px) = of_interest {
                inset(&mut frame, px);
            }
            sheet.push(Sheet::of(&frame, index, &found, target)?);
        }
        images.push(Image {
            truth: boxes.uavs,
            found,
        });
        if shown.elapsed() > Duration::from_secs(2) || index + 1 == count {
            shown = Instant::now();
            progress(&format!("{name}: {} of {count} frames", index + 1));
        }
    }
    let mut changes = Vec::new();
    if let Some((follower, writer)) = at_work {
        writer.finish(rate_hz)?;
        changes = follower.tracker.changes;
    }
    mot::put(&folder.join("tracks.txt"), &lines)?;
    tally.frames = images.len();
    tally.detections = images.iter().map(|image| image.found.len()).sum();
    curves.miss_px[0] = judge(&mut tally, &images, &curves.miss_px[1]);
    let known = tally.known;
    let tracks = lives.into_iter().map(|(id, life)| TrackFigures {
        id,
        start: life.start_s,
        end: life.end_s,
        length: life.end_s - life.start_s,
        frames: life.frames,
        score: life.last.score,
        size_px: life.last.side_px,
        on_uav_share: (known && life.frames > life.ignored)
            .then(|| life.on_uav as f64 / (life.frames - life.ignored) as f64),
    });
    let states = changes.into_iter().map(|change| State {
        name: change.to.name(),
        start: change.tick as f64 / f64::from(TICK_HZ),
        reason: change.reason,
    });
    Ok(Played {
        clip: ClipFigures {
            file: file.into(),
            size_px,
            rate_hz,
            figures: tally.figures(),
            tracks: tracks.collect(),
            states: states.collect(),
        },
        tally,
        curves,
        end_s,
        sheet,
    })
}

/// Counts hits and false alarms of the detector; returns its miss distance in each frame.
fn judge(tally: &mut Tally, images: &[Image], times: &Series) -> Series {
    let mut series: Series = times.iter().map(|(t_s, _)| (*t_s, f64::NAN)).collect();
    if !tally.known {
        return series;
    }
    let centre = Matching::of(images, Criterion::Centre, ALL);
    tally.boxes = centre.boxes;
    for mark in &centre.marks {
        let image = &images[mark.image];
        let px = DVec2::from(image.found[mark.found].centre_px());
        match mark.hit.map(|k| &image.truth[k]) {
            Some(truth) if mark.is_hit() => {
                let miss_px = px.distance(truth.centre_px().into());
                tally.hits += 1;
                tally.detector_px.push(miss_px);
                series[mark.image].1 = series[mark.image].1.min(miss_px);
            }
            _ if !mark.is_false_alarm() => {}
            _ if image.truth.iter().any(|truth| inside(truth.box_px, px)) => tally.duplicates += 1,
            _ => tally.false_alarms += 1,
        }
    }
    let half = Matching::of(images, Criterion::Iou(0.5), ALL);
    tally.hits_iou = half.marks.iter().filter(|mark| mark.is_hit()).count();
    series
}

/// A line in MOTChallenge's form: frame and identity from 1, left, top, width, height, score.
fn mot_line(out: &mut String, index: usize, track: &Followed) {
    let half = 0.5 * track.side_px;
    let DVec2 { x, y } = track.px;
    let [x0, y0, x1, y1] = (track.seen_px).unwrap_or([x - half, y - half, x + half, y + half]);
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "{},{},{x0:.3},{y0:.3},{:.3},{:.3},{:.4},-1,-1,-1",
        index + 1,
        track.id + 1,
        x1 - x0,
        y1 - y0,
        track.score
    );
}

const GREEN: [u8; 3] = [47, 230, 160];
const WHITE: [u8; 3] = [255, 255, 255];
const ORANGE: [u8; 3] = [255, 140, 30];
const BLUE: [u8; 3] = [60, 160, 255];
const PINK: [u8; 3] = [255, 70, 200];
const COLOURS: &str = "Green: boxes of UAVs; white: boxes of what is none; orange: detections; blue: confirmed \
     tracks; pink: the target that is held, with its way of the last two seconds and a cross where the \
     filter has it. Pictures here show its surroundings enlarged in a corner.";

/// Lines on a picture.
struct Pen<'a> {
    frame: &'a mut Frame,
    /// Width of a line [px].
    width: i64,
}

impl Pen<'_> {
    /// Fills a rectangle, both corners included [px].
    fn fill(&mut self, [x0, y0, x1, y1]: [i64; 4], colour: [u8; 3]) {
        let [width, height] = self.frame.size_px.map(i64::from);
        for y in y0.max(0)..=y1.min(height - 1) {
            for x in x0.max(0)..=x1.min(width - 1) {
                let at = 3 * (y * width + x) as usize;
                self.frame.rgb8[at..at + 3].copy_from_slice(&colour);
            }
        }
    }

    /// The outline of a box, kept off it by `pad` pixels.
    fn outline(&mut self, box_px: [f64; 4], pad: i64, colour: [u8; 3]) {
        // A box far outside is drawn at the border.
        let limit = |x: f64| x.clamp(-1e6, 1e6);
        let [x0, y0] = [box_px[0], box_px[1]].map(|x| limit(x).floor() as i64 - pad);
        let [x1, y1] = [box_px[2], box_px[3]].map(|x| limit(x).ceil() as i64 - 1 + pad);
        let w = self.width - 1;
        self.fill([x0 - w, y0 - w, x1 + w, y0], colour);
        self.fill([x0 - w, y1, x1 + w, y1 + w], colour);
        self.fill([x0 - w, y0 - w, x0, y1 + w], colour);
        self.fill([x1, y0 - w, x1 + w, y1 + w], colour);
    }

    /// A straight line.
    fn line(&mut self, from: DVec2, to: DVec2, colour: [u8; 3]) {
        let steps = from.distance(to).ceil().clamp(1.0, 1e4) as usize;
        for i in 0..=steps {
            let at = from.lerp(to, i as f64 / steps as f64);
            let (x, y) = (at.x as i64, at.y as i64);
            let w = self.width - 1;
            self.fill([x, y, x + w, y + w], colour);
        }
    }
}

/// Draws boxes, detections and tracks into a frame.
fn draw(
    frame: &mut Frame,
    boxes: &FrameTruth,
    found: &[Detection],
    followed: &[Followed],
    held: Option<u32>,
    trail: &[DVec2],
) {
    let width = i64::from(frame.size_px[0].div_ceil(960));
    let mut pen = Pen { frame, width };
    for box_px in &boxes.others {
        pen.outline(*box_px, 0, WHITE);
    }
    for truth in &boxes.uavs {
        pen.outline(truth.box_px, 0, GREEN);
    }
    for detection in found {
        pen.outline(detection.box_px, width, ORANGE);
    }
    for track in followed {
        let half = 0.5 * track.side_px;
        let DVec2 { x, y } = track.px;
        let square = [x - half, y - half, x + half, y + half];
        if Some(track.id) != held {
            pen.outline(track.seen_px.unwrap_or(square), 3 * width, BLUE);
            continue;
        }
        pen.outline(track.seen_px.unwrap_or(square), 4 * width, PINK);
        for d in [DVec2::X, DVec2::Y] {
            let (near, far) = (half + 6.0, half + 16.0);
            for side in [-1.0, 1.0] {
                let arm = side * width as f64 * d;
                pen.line(track.px + near * arm, track.px + far * arm, PINK);
            }
        }
    }
    for pair in trail.windows(2) {
        pen.line(pair[0], pair[1], PINK);
    }
}

/// Shows the surroundings of `px` enlarged in the corner that is furthest from it.
fn inset(frame: &mut Frame, px: DVec2) {
    const ZOOM: i64 = 3;
    let [width, height] = frame.size_px.map(i64::from);
    let side = (width / 10).min(height / ZOOM);
    let from = |x: f64, size: i64| (x as i64 - side / 2).clamp(0, size - side);
    let (left, top) = (from(px.x, width), from(px.y, height));
    let corner = |x: f64, size: i64| {
        if x < 0.5 * size as f64 {
            size - ZOOM * side
        } else {
            0
        }
    };
    let (x0, y0) = (corner(px.x, width), corner(px.y, height));
    let source = frame.rgb8.clone();
    let mut pen = Pen { frame, width: 1 };
    for j in 0..side {
        for i in 0..side {
            let at = 3 * ((top + j) * width + left + i) as usize;
            let (x, y) = (x0 + ZOOM * i, y0 + ZOOM * j);
            let colour = [source[at], source[at + 1], source[at + 2]];
            pen.fill([x, y, x + ZOOM - 1, y + ZOOM - 1], colour);
        }
    }
    let size = (ZOOM * side) as f64;
    let (x0, y0) = (x0 as f64, y0 as f64);
    pen.outline([x0, y0, x0 + size, y0 + size], 0, WHITE);
}

impl Sheet {
    fn of(
        frame: &Frame,
        index: usize,
        found: &[Detection],
        target: Option<&Followed>,
    ) -> Result<Self, RunError> {
        let [width, height] = frame.size_px;
        let jpeg = encode_jpeg(&frame.rgb8, width as u16, height as u16, 80)
            .map_err(|error| RunError::Image(error.to_string()))?;
        let best = found.first().map_or("no detection".into(), |best| {
            format!("{} detections, best {:.2}", found.len(), best.score)
        });
        let target = target.map_or("no target".into(), |t| format!("track {}", t.id));
        Ok(Self {
            t_s: frame.t_s,
            frame: index,
            caption: format!("{best}, {target}"),
            jpeg,
        })
    }
}

fn percent(share: Option<f64>) -> String {
    share.map_or("–".into(), |share| format!("{:.1} %", 100.0 * share))
}

impl Figures {
    /// The figures with their names.
    fn rows(&self) -> Vec<(&'static str, String)> {
        let count = |n: Option<usize>| n.map_or("–".into(), |n| n.to_string());
        vec![
            ("frames", self.frames.to_string()),
            ("detections", self.detections.to_string()),
            ("boxes of UAVs", count(self.boxes)),
            ("recall", number(self.recall, 4)),
            ("recall at an IoU of 0.5", number(self.recall_iou_0_5, 4)),
            (
                "false alarms a frame",
                number(self.false_alarms_per_frame, 4),
            ),
            ("false alarms", count(self.false_alarms)),
            ("further detections in a box", count(self.duplicates)),
            (
                "detector's miss distance: mean / rms / median",
                self.miss_distance_px.detector.to_string(),
            ),
            (
                "tracker's miss distance: mean / rms / median",
                self.miss_distance_px.tracker.to_string(),
            ),
            ("target held", percent(Some(self.locked_share))),
            (
                "a UAV held, of frames with one",
                percent(self.on_target_share),
            ),
            ("something else held", percent(self.false_lock_share)),
            ("frames a second, CPU", format!("{:.1}", self.frames_per_s)),
        ]
    }
}

/// Head of the table of clips.
const COLUMNS: [&str; 8] = [
    "clip",
    "frames",
    "recall",
    "false alarms a frame",
    "UAV held",
    "else held",
    "detector mean [px]",
    "tracker mean [px]",
];

impl Evaluation {
    /// A row for each clip, and one for all.
    fn summary(&self) -> Vec<Vec<String>> {
        let row = |name: String, figures: &Figures| {
            vec![
                name,
                figures.frames.to_string(),
                number(figures.recall, 4),
                number(figures.false_alarms_per_frame, 4),
                percent(figures.on_target_share),
                percent(figures.false_lock_share),
                number(figures.miss_distance_px.detector.mean, 2),
                number(figures.miss_distance_px.tracker.mean, 2),
            ]
        };
        let names = folder_names(
            &self
                .clips
                .iter()
                .map(|c| c.file.clone())
                .collect::<Vec<_>>(),
        );
        let clips = self.clips.iter().zip(names);
        let mut rows: Vec<_> = clips.map(|(clip, name)| row(name, &clip.figures)).collect();
        if rows.len() > 1 {
            rows.push(row("all".into(), &self.figures));
        }
        rows
    }

    /// The figures as lines of text.
    pub fn text(&self) -> String {
        let mut text = String::new();
        if self.clips.len() > 1 {
            let rows = self.summary();
            let longest = rows.iter().map(|row| row[0].chars().count()).max();
            let first = longest.unwrap_or(0).max(4);
            let head = COLUMNS.map(String::from).to_vec();
            for row in std::iter::once(&head).chain(&rows) {
                let _ = write!(text, "{:<first$}", row[0]);
                for (cell, name) in row.iter().zip(COLUMNS).skip(1) {
                    let width = name.chars().count().max(8) + 2;
                    let _ = write!(text, "{cell:>width$}");
                }
                text.push('\n');
            }
            text.push('\n');
        }
        for (name, value) in self.figures.rows() {
            let _ = writeln!(text, "{name:<48} {value}");
        }
        text
    }
}

fn write(
    folder: &Path,
    evaluation: &Evaluation,
    html: impl Fn(&mut String) -> fmt::Result,
) -> Result<(), RunError> {
    let text = serde_json::to_string_pretty(evaluation)? + "\n";
    mot::put(&folder.join("clip.json"), &text)?;
    let mut page = String::new();
    html(&mut page)
        .map_err(std::io::Error::other)
        .map_err(|source| RunError::Output {
            path: folder.into(),
            source,
        })?;
    mot::put(&folder.join("clip.html"), &page)
}

fn head(out: &mut String, evaluation: &Evaluation, title: &str) -> fmt::Result {
    writeln!(
        out,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
         <title>Boresight: {title}</title>\n<style>{STYLE}\
         .sheet img,video{{width:100%;display:block;border-radius:6px}}</style>\n</head>\n<body>\n\
         <header>\n<h1>{title}</h1>\n<p class=\"meta\"><span>Model <code>{}</code></span>\
         <span>Threshold <code>{}</code></span><span>Truth <code>{}</code></span>\
         <span>Version <code>{}</code></span><span><code>{}</code></span></p>\n</header>",
        Escaped(&evaluation.model.display().to_string()),
        evaluation.threshold,
        Escaped(
            &evaluation
                .boxes_file
                .as_ref()
                .map_or("none".into(), |b| b.display().to_string())
        ),
        evaluation.version,
        Escaped(&evaluation.command),
        title = Escaped(title),
    )
}

const MEANING: &str = "A detection hits when its centre lies in the box of a UAV; one in no such box is a false alarm. \
     Boxes may be loose: the IoU then says little. The target that is held counts as a UAV when the place that \
     the filter gives it lies in the box of one. Miss distances are those of hits, to the centre of the box.";

fn figures_html(out: &mut String, figures: &Figures) -> fmt::Result {
    out.push_str("<h2>Figures</h2>\n");
    let rows: Vec<Vec<String>> = (figures.rows().into_iter())
        .map(|(name, value)| vec![name.into(), value])
        .collect();
    table(out, &["figure", "value"], &rows)?;
    note(out, MEANING)
}

/// The page of several clips.
fn all_page(out: &mut String, evaluation: &Evaluation, names: &[String]) -> fmt::Result {
    head(out, evaluation, "Clips")?;
    out.push_str("<h2>Clips</h2>\n");
    table(out, &COLUMNS, &evaluation.summary())?;
    out.push_str("<p>Pages: ");
    for name in names {
        let name = Escaped(name);
        write!(out, "<a href=\"{name}/clip.html\">{name}</a> ")?;
    }
    out.push_str("</p>\n");
    figures_html(out, &evaluation.figures)?;
    out.push_str("</body>\n</html>\n");
    Ok(())
}

/// The page of one clip.
fn one_page(out: &mut String, evaluation: &Evaluation, name: &str, played: &Played) -> fmt::Result {
    head(out, evaluation, name)?;
    let clip = &played.clip;
    figures_html(out, &clip.figures)?;
    out.push_str("<h2>Over time</h2>\n<div class=\"charts\">\n");
    let across = Across::time("time [s]", played.end_s);
    let [detector, tracker] = &played.curves.miss_px;
    let miss = [("detector", detector), ("tracker", tracker)];
    let [on, elsewhere] = &played.curves.score;
    let both = [("on a UAV", on), ("elsewhere", elsewhere)];
    let score: &[(&str, &Series)] = match evaluation.boxes_file {
        Some(_) => &both,
        None => &[("", on)],
    };
    for (title, unit, series) in [
        ("Miss distance", "px", &miss[..]),
        ("Best score", "1", score),
    ] {
        let chart = Chart {
            title,
            unit,
            scale: Scale::Linear,
            series,
            limit: None,
        };
        chart.html(out, &across)?;
    }
    out.push_str("</div>\n<h2>States of the tracker</h2>\n");
    let ends = (clip.states.iter().skip(1).map(|state| state.start)).chain([played.end_s]);
    let spans: Vec<StateSpan> = (clip.states.iter().zip(ends))
        .map(|(state, t1_s)| StateSpan {
            t0_s: state.start,
            t1_s,
            name: state.name.into(),
            reason: state.reason.clone(),
        })
        .collect();
    states_html(out, &spans, played.end_s)?;
    out.push_str("<h2>Confirmed tracks</h2>\n");
    let rows: Vec<Vec<String>> = (clip.tracks.iter())
        .map(|track| {
            vec![
                track.id.to_string(),
                number(Some(track.start), 2),
                number(Some(track.end), 2),
                number(Some(track.length), 2),
                track.frames.to_string(),
                number(Some(track.score), 2),
                number(Some(track.size_px), 1),
                percent(track.on_uav_share),
            ]
        })
        .collect();
    let columns = [
        "track",
        "from [s]",
        "to [s]",
        "for [s]",
        "frames",
        "score",
        "size [px]",
        "on a UAV",
    ];
    table(out, &columns, &rows)?;
    writeln!(
        out,
        "<h2>Pictures</h2>\n<p><a href=\"overlay.mp4\">overlay.mp4</a>, tracks in MOTChallenge's form: \
         <a href=\"tracks.txt\">tracks.txt</a></p>"
    )?;
    note(out, COLOURS)?;
    out.push_str("<div class=\"sheet\">\n");
    for sheet in &played.sheet {
        writeln!(
            out,
            "<figure><img alt=\"frame {0}\" src=\"data:image/jpeg;base64,{1}\"><figcaption><b>frame {0}</b>\
             <span>{2:.2} s</span><span class=\"note\">{3}</span></figcaption></figure>",
            sheet.frame,
            BASE64_STANDARD.encode(&sheet.jpeg),
            sheet.t_s,
            Escaped(&sheet.caption)
        )?;
    }
    out.push_str("</div>\n</body>\n</html>\n");
    Ok(())
}

#[cfg(test)]
mod tests;
