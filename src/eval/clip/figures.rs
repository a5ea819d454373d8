//! What the evaluation measured, as `clip.json` has it, and how it is counted.

use crate::eval::detector::figures::Miss;
use crate::eval::detector::metrics::{ALL, AnnotatedImage, Criterion, Matching};
use crate::report::chart::Series;
use glam::DVec2;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::time::Duration;

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
    /// Share of the frames in which a track is held as a UAV: the recogniser took it for one, and nothing has changed that since.
    pub held_as_uav_share: Option<f64>,
    /// Share of the frames with a UAV in which such a track is in its box.
    pub uav_held_as_uav_share: Option<f64>,
    /// Share of the frames in which such a track is in no box of a UAV.
    pub other_held_as_uav_share: Option<f64>,
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
    /// What its boxes are called.
    pub labels: BTreeSet<String>,
    /// What was measured in it.
    #[serde(flatten)]
    pub figures: Figures,
    /// Tracks that were confirmed, in the order of their identities.
    pub tracks: Vec<TrackFigures>,
    /// States of the tracker, in order.
    pub states: Vec<State>,
}

/// A track that was confirmed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrackFigures {
    /// Identity of the track.
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
    /// Why it was entered.
    pub reason: String,
}

/// What `clip.json` holds.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// Version of the program.
    pub version: &'static str,
    /// The command that repeats it.
    pub command: String,
    /// What was left out, where it was stopped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
    /// The detector's model file.
    pub model: PathBuf,
    /// The file of `--boxes`.
    pub boxes_file: Option<PathBuf>,
    /// The recogniser's model file, and the probability from which on its word counts.
    pub recogniser: Option<PathBuf>,
    pub uav_probability: f64,
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
    /// The clips of each label together: those that have a box called so.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub by_label: BTreeMap<String, Figures>,
    /// Figures of each clip, in the order of the command line.
    pub clips: Vec<ClipFigures>,
}

/// What figures are made of.
#[derive(Default)]
pub(super) struct Tally {
    /// Whether there is truth.
    pub(super) known: bool,
    pub(super) frames: usize,
    pub(super) detections: usize,
    pub(super) boxes: usize,
    pub(super) hits: usize,
    pub(super) hits_iou: usize,
    pub(super) false_alarms: usize,
    pub(super) duplicates: usize,
    pub(super) locked: usize,
    pub(super) with_uav: usize,
    pub(super) on_target: usize,
    pub(super) false_lock: usize,
    /// Whether there is a recogniser; frames with a track that it takes for a UAV: any, one on a UAV,
    /// one on none.
    pub(super) recognised: bool,
    pub(super) as_uav: [usize; 3],
    pub(super) detector_px: Vec<f64>,
    pub(super) tracker_px: Vec<f64>,
    pub(super) busy: Duration,
}

impl Tally {
    pub(super) fn add(&mut self, other: &Self) {
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
        self.recognised |= other.recognised;
        for (own, more) in self.as_uav.iter_mut().zip(other.as_uav) {
            *own += more;
        }
        self.detector_px.extend(&other.detector_px);
        self.tracker_px.extend(&other.tracker_px);
        self.busy += other.busy;
    }

    pub(super) fn figures(&self) -> Figures {
        let share =
            |part: usize, of: usize| (self.known && of > 0).then(|| part as f64 / of as f64);
        let count = |n: usize| self.known.then_some(n);
        let of_recognised = |share: Option<f64>| share.filter(|_| self.recognised);
        let [any, on_uav, elsewhere] = self.as_uav;
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
            held_as_uav_share: of_recognised(Some(any as f64 / self.frames.max(1) as f64)),
            uav_held_as_uav_share: of_recognised(share(on_uav, self.with_uav)),
            other_held_as_uav_share: of_recognised(share(elsewhere, self.frames)),
            frames_per_s: self.frames as f64 / self.busy.as_secs_f64().max(f64::MIN_POSITIVE),
        }
    }

    /// Counts hits and false alarms of the detector; returns its miss distance in each frame, of which
    /// `times` has the times.
    pub(super) fn judge(&mut self, images: &[AnnotatedImage], times: &Series) -> Series {
        let mut series: Series = times.iter().map(|(t_s, _)| (*t_s, f64::NAN)).collect();
        if !self.known {
            return series;
        }
        let centre = Matching::of(images, Criterion::Centre, ALL);
        self.boxes = centre.boxes;
        for mark in &centre.marks {
            let image = &images[mark.image];
            let px = DVec2::from(image.found[mark.found].centre_px());
            match mark.hit.map(|k| &image.truth[k]) {
                Some(truth) if mark.is_hit() => {
                    let miss_px = px.distance(truth.centre_px().into());
                    self.hits += 1;
                    self.detector_px.push(miss_px);
                    series[mark.image].1 = series[mark.image].1.min(miss_px);
                }
                _ if !mark.is_false_alarm() => {}
                _ if image.truth.iter().any(|truth| inside(truth.box_px, px)) => {
                    self.duplicates += 1
                }
                _ => self.false_alarms += 1,
            }
        }
        let half = Matching::of(images, Criterion::Iou(0.5), ALL);
        self.hits_iou = half.marks.iter().filter(|mark| mark.is_hit()).count();
        series
    }
}

/// Whether a place lies in a box [px].
pub(super) fn inside([x0, y0, x1, y1]: [f64; 4], px: DVec2) -> bool {
    (x0..=x1).contains(&px.x) && (y0..=y1).contains(&px.y)
}
