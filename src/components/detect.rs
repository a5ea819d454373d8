//! The detector, and detections on their way to the tracker.

use crate::components::capture::{ExposedFrame, PixelRect, Readout, UavInFrame};
use crate::components::environment::Environment;
use crate::components::run::{Options, PartError, Registry, Seed};
use crate::models::decision::look::Shown;
use crate::models::engage::interlock::FAR_M;
use crate::models::flight::class::is_uav;
use crate::models::ground::city::City;
use crate::models::optics::detection::Detection;
use crate::models::sensing::moving::{Dot, MovingAs, MovingDots};
use crate::models::tracking::evidence::ScoreModel;
use crate::models::tracking::recognition::TrackClass;
use crate::scenario::Loaded;
use bevy::prelude::*;
use glam::DVec3;
use std::collections::VecDeque;
use std::sync::Arc;

/// A frame, and how a detector is to look at it.
#[derive(Clone, Debug)]
pub struct Question {
    /// What was exposed.
    pub frame: Arc<ExposedFrame>,
    /// The pixels in which to look.
    pub look: PixelRect,
    /// By how much, a whole number, the picture is to be shrunk.
    pub shrunk: u32,
}

/// What finds UAVs in frames: questions go in, answers come out in their order.
pub trait Detector: Send + Sync {
    /// Names of its classes, by the labels of its detections.
    fn classes(&self) -> &[String];

    /// How its answers are read.
    fn reading(&self) -> Reading;

    /// Whether it looks at pictures: a run that renders nothing refuses it then.
    fn wants_pictures(&self) -> bool {
        true
    }

    /// Takes the questions of a tick; it may work on them meanwhile.
    fn ask(&mut self, questions: Vec<Question>);

    /// The detections, in full-sensor pixels, of the oldest question without an answer; waits for them.
    fn answer(&mut self) -> Result<Vec<Detection>, PartError>;
}

/// How a detector's answers are read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// A detection of this score counts by itself.
    pub start_score: f64,
    /// One of a lower score goes on with a track; below this one it is dropped.
    pub weak_score: f64,
    /// What its scores mean.
    pub score: ScoreModel,
    /// Side of the square around the predicted target in which it looks for that [px]; `None`: in all that is read.
    pub roi_px: Option<u32>,
    /// What is larger than this is shown to it shrunk, so that it is no larger [px].
    pub largest_shown_px: f64,
    /// Standard deviation of a detection's centre [px], and what a larger box adds to it, as a share of its side.
    pub centre_sigma_px: f64,
    pub centre_sigma_rel: f64,
    /// Whether it boxes the part aimed at rather than the whole UAV.
    pub boxes_part: bool,
}

impl Reading {
    /// That of a network for small UAVs, whose score of `neutral` says nothing, as the shipped one errs on boxes of 3 to 80 px
    /// (docs/validation/threat-and-target-choice.md).
    pub fn of_network(
        start_score: f64,
        weak_score: f64,
        neutral: f64,
        roi_px: Option<u32>,
    ) -> Self {
        Self {
            start_score,
            weak_score,
            score: ScoreModel::Network(neutral),
            roi_px,
            largest_shown_px: LARGEST_SHOWN_PX,
            centre_sigma_px: 0.5,
            centre_sigma_rel: 0.015,
            boxes_part: false,
        }
    }

    /// That of the geometric truth with noise of this standard deviation [px].
    pub fn of_truth(noise_px: f64) -> Self {
        Self {
            start_score: 0.0,
            weak_score: 0.0,
            score: ScoreModel::Fixed(0.72),
            roi_px: None,
            largest_shown_px: f64::INFINITY,
            // With no noise at all the filter would ignore its own prediction.
            centre_sigma_px: noise_px.max(0.02),
            centre_sigma_rel: 0.0,
            boxes_part: true,
        }
    }
}

/// A target must not be larger than this share of the region in which the network looks for it, or the
/// region grows: the network wants surroundings, and the prediction errs.
const LARGEST_SHARE: f64 = 0.5;
/// A region grows in steps of this many pixels, a common stride of networks.
const REGION_STEP_PX: u32 = 64;
/// What is larger than this is shown to a network shrunk: networks for small UAVs are the less sure, the larger a UAV is
/// beyond some 40 px.
const LARGEST_SHOWN_PX: f64 = 64.0;

/// The detector of a run, which serves all stations.
#[derive(Resource)]
pub struct DetectorInUse {
    /// The detector at work.
    pub detector: Box<dyn Detector>,
    /// How its answers are read.
    pub reading: Reading,
    /// The stations that wait for an answer, one for each question, in the order in which they asked.
    pub asked: VecDeque<Entity>,
}

impl DetectorInUse {
    /// Puts a detector to work.
    pub fn new(detector: Box<dyn Detector>) -> Self {
        Self {
            reading: detector.reading(),
            detector,
            asked: VecDeque::new(),
        }
    }

    /// The part of the pixels `rect` in which it looks.
    pub fn look(&self, readout: &Readout, rect: PixelRect) -> PixelRect {
        match (readout, self.reading.roi_px) {
            (
                Readout::Around {
                    centre_px,
                    target_px,
                },
                Some(side),
            ) => rect.around(*centre_px, region_px(*target_px, side)),
            _ => rect,
        }
    }

    /// By how much, a whole number, its picture of a readout is shrunk.
    pub fn shrinks(&self, readout: &Readout) -> u32 {
        match readout {
            Readout::Around { target_px, .. } => {
                (target_px / self.reading.largest_shown_px).ceil().max(1.0) as u32
            }
            _ => 1,
        }
    }

    /// Bit by bit, which of its classes are no UAVs.
    pub fn other_classes(&self) -> u64 {
        other_classes(self.detector.classes())
    }

    /// Name of the class with the index that detections and tracks carry.
    pub fn class(&self, label: u32) -> &str {
        self.named(label).unwrap_or(MOVING)
    }

    /// The same, `None` for what moves and was not named.
    pub fn named(&self, label: u32) -> Option<&str> {
        let classes = self.detector.classes();
        let known = classes.get(label as usize).map(String::as_str);
        known.or(classes.is_empty().then_some("uav"))
    }

    /// How what moves counts among its detections: with the label behind those of its classes, and a score that starts a
    /// track and is about as likely of a UAV as of anything else that flies.
    pub fn moving(&self) -> MovingAs {
        MovingAs {
            label: self.detector.classes().len() as u32,
            score: self.reading.start_score.max(MovingAs::NEUTRAL),
        }
    }

    /// The detections that a picture is marked with, the weakest first, so that none covers a stronger one: those that
    /// count by themselves.
    pub fn drawn<'a>(&self, detections: &'a [Detection]) -> Vec<&'a Detection> {
        let counts = |found: &&Detection| !self.is_weak(found);
        let mut drawn: Vec<_> = detections.iter().filter(counts).collect();
        drawn.sort_by(|a, b| a.score.total_cmp(&b.score));
        drawn
    }

    /// Whether a detection counts only where a track awaits it.
    pub fn is_weak(&self, detection: &Detection) -> bool {
        detection.score < self.reading.start_score
    }

    /// What a picture's box is labelled with: the score, and the class where there are several.
    pub fn caption(&self, detection: &Detection) -> String {
        if self.detector.classes().len() > 1 {
            format!("{} {:.2}", self.class(detection.label), detection.score)
        } else {
            format!("{:.2}", detection.score)
        }
    }
}

/// Name of the class of what moves and was not named.
const MOVING: &str = "moving";

/// What a detector is made for.
pub struct DetectorContext {
    /// The scenario, and how it is run.
    pub loaded: Arc<Loaded>,
    pub options: Options,
    /// The seed of the run.
    pub seed: Seed,
    /// Sizes of the cameras' sensors [px].
    pub sensors_px: Vec<[u32; 2]>,
    /// What surrounds the things of the run, and what they are.
    pub surroundings: Arc<Surroundings>,
}

/// Wavelength at which what the air takes of the contrast is taken [m].
const SEEN_AT_M: f64 = 550e-9; // [m]

/// What surrounds the things of a run, and what they are: what a detector without pictures goes by.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// What stands behind them.
    pub city: Arc<City>,
    /// What the air takes of their contrast [1/m].
    pub extinction_per_m: f64,
    /// What they are, in the order of the scenario.
    pub kinds: Vec<TrackClass>,
    /// Ticks of a second.
    pub tick_hz: f64,
}

impl Surroundings {
    /// Those of a run whose things of such indices are of such kinds.
    pub fn new(
        environment: &Environment,
        things: impl IntoIterator<Item = (usize, TrackClass)>,
        tick_hz: f64,
    ) -> Self {
        let mut things: Vec<(usize, TrackClass)> = things.into_iter().collect();
        things.sort_unstable_by_key(|(index, _)| *index);
        Self {
            city: environment.city.clone(),
            extinction_per_m: environment.weather.extinction_per_m(SEEN_AT_M),
            kinds: things.into_iter().map(|(_, kind)| kind).collect(),
            tick_hz,
        }
    }

    /// What the thing of an index is.
    pub fn kind(&self, index: usize) -> TrackClass {
        self.kinds.get(index).copied().unwrap_or(TrackClass::Other)
    }

    /// Whether the sky is what a ray from a place [m, enu] meets.
    pub fn is_sky(&self, from_enu_m: DVec3, ray_enu: DVec3) -> bool {
        let hit = self.city.dsm.first_hit_kind(from_enu_m, ray_enu, FAR_M);
        hit.is_none()
    }
}

/// The detectors that a scenario may name.
#[derive(Resource, Default, Deref, DerefMut)]
pub struct Detectors(pub Registry<DetectorContext, dyn Detector>);

/// Bit by bit, which of these classes are no UAVs.
pub fn other_classes(classes: &[String]) -> u64 {
    let other = |(_, class): &(usize, &String)| !is_uav(class);
    let bits = classes.iter().take(64).enumerate().filter(other);
    bits.fold(0, |bits, (index, _)| bits | 1 << index)
}

/// Side of the square that holds a target of `target_px` as it should, and is not below `least_px`.
pub fn region_px(target_px: f64, least_px: u32) -> u32 {
    let wanted = (target_px / LARGEST_SHARE).min(f64::from(u16::MAX)) as u32;
    if wanted <= least_px {
        least_px
    } else {
        wanted.next_multiple_of(REGION_STEP_PX)
    }
}

/// The detections of one frame, and the frame itself.
#[derive(Clone, Debug)]
pub struct DetectionBatch {
    /// What was exposed.
    pub frame: Arc<ExposedFrame>,
    /// First tick in which the tracker may see the detections.
    pub available_tick: u64,
    /// The pixels in which the detector looked.
    pub look: PixelRect,
    /// By how much its picture was shrunk.
    pub shrunk: u32,
    /// Detections above the threshold, in full-sensor pixels; empty until `answered`.
    pub detections: Vec<Detection>,
    /// The best score that the detector gave to anything near each UAV in front of the camera, in the order of the
    /// frame's truth, below the threshold too; for the record alone.
    pub best_scores: Vec<Option<f64>>,
    /// What moves in it against the scenery.
    pub moving: Vec<Dot>,
    /// Whether the detector has answered.
    pub answered: bool,
}

impl DetectionBatch {
    /// What the tracker sees of it; it was exposed at `t_s` [s].
    pub fn shown(&self, t_s: f64) -> Shown<'_> {
        let frame = &*self.frame;
        Shown {
            camera: frame.index,
            tier: frame.tier,
            tick: frame.tick,
            t_s,
            available_tick: self.available_tick,
            exposure_s: frame.conditions.exposure.time_s,
            pinhole: frame.pinhole,
            believed: frame.believed,
            reticle_px: frame.reticle_px(),
            boresight_sigma_rad: frame.boresight.sigma_rad,
            look: self.look,
            shrunk: self.shrunk,
            detections: &self.detections,
            picture: frame
                .rgb8
                .as_ref()
                .map(|rgb8| (rgb8.as_slice(), frame.rect)),
        }
    }

    /// Frames go to the detector, and are answered, in this order.
    fn asked(&self) -> (u64, usize) {
        (self.frame.tick, self.frame.index)
    }
}

/// What moves in the frames of a camera; none where nobody looks for that.
#[derive(Component, Clone, Debug, Default)]
pub struct Moving(pub Option<MovingDots>);

/// Batches of a station that wait out their latency.
#[derive(Component, Clone, Default, Debug)]
pub struct DetectionQueue {
    /// Ordered by (available tick, exposure tick, camera).
    pub waiting: VecDeque<DetectionBatch>,
    /// The batches that arrived in this tick.
    pub arrived: Vec<DetectionBatch>,
}

impl DetectionQueue {
    /// Queues a batch at its place.
    pub fn push(&mut self, batch: DetectionBatch) {
        let key = |b: &DetectionBatch| (b.available_tick, b.asked());
        let at = self.waiting.partition_point(|b| key(b) <= key(&batch));
        self.waiting.insert(at, batch);
    }

    /// Notes what moves in a frame that waits for its answer.
    pub fn note_moving(&mut self, frame: &Arc<ExposedFrame>, dots: Vec<Dot>) {
        let of_frame = |batch: &&mut DetectionBatch| Arc::ptr_eq(&batch.frame, frame);
        if let Some(batch) = self.waiting.iter_mut().find(of_frame) {
            batch.moving = dots;
        }
    }

    /// Whether a batch that is available at `tick` still lacks its detections.
    pub fn wants_answer(&self, tick: u64) -> bool {
        (self.waiting.iter())
            .take_while(|batch| batch.available_tick <= tick)
            .any(|batch| !batch.answered)
    }

    /// Puts the detector's next answer, from `weak_score` on, into its batch, and counts what moves there among it.
    pub fn answer(&mut self, mut found: Vec<Detection>, weak_score: f64, moving: &MovingAs) {
        let open = self.waiting.iter_mut().filter(|batch| !batch.answered);
        if let Some(batch) = open.min_by_key(|batch| batch.asked()) {
            batch.best_scores = best_scores(&batch.frame.truth, &found);
            found.retain(|detection| detection.score >= weak_score);
            batch.detections = found;
            for dot in std::mem::take(&mut batch.moving) {
                dot.count_in(&mut batch.detections, moving);
            }
            batch.answered = true;
        }
    }

    /// Moves what is available at `tick` to `arrived`.
    pub fn release(&mut self, tick: u64) {
        self.arrived.clear();
        while self
            .waiting
            .front()
            .is_some_and(|batch| batch.available_tick <= tick)
        {
            self.arrived.extend(self.waiting.pop_front());
        }
    }
}

/// The best score of what lies on each of `truth`.
fn best_scores(truth: &[UavInFrame], found: &[Detection]) -> Vec<Option<f64>> {
    let best = |seen: &UavInFrame| {
        let on = found.iter().filter(|found| found.lies_on(seen.box_px));
        on.map(|found| found.score).reduce(f64::max)
    };
    truth.iter().map(best).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::capture::Tier;
    use crate::models::optics::camera::Pinhole;

    #[test]
    fn a_region_grows_with_the_target() {
        assert_eq!(
            [3.0, 128.0, 140.0, 400.0].map(|px| region_px(px, 256)),
            [256, 256, 320, 832]
        );
        assert_eq!(region_px(3.0, 48), 48);
    }

    fn batch(tier: Tier, tick: u64, available_tick: u64) -> DetectionBatch {
        let look = PixelRect {
            offset_px: [100, 50],
            size_px: [160; 2],
        };
        let pinhole = Pinhole::from_hfov(640, 480, 0.1).unwrap();
        let frame = ExposedFrame {
            tick,
            rect: look,
            ..ExposedFrame::bare(tier, pinhole)
        };
        DetectionBatch {
            frame: Arc::new(frame),
            available_tick,
            look,
            shrunk: 1,
            detections: Vec::new(),
            best_scores: Vec::new(),
            moving: Vec::new(),
            answered: false,
        }
    }

    #[test]
    fn answers_find_their_frames_though_a_later_one_is_due_first() {
        let mut queue = DetectionQueue::default();
        // The search camera is slow: what the precise one exposes later is due earlier.
        queue.push(batch(Tier::Search, 8, 40));
        queue.push(batch(Tier::Precise, 16, 24));
        let seen = |x0: f64| Detection {
            box_px: [x0, 0.0, x0 + 4.0, 4.0],
            aim_px: [x0 + 2.0, 2.0],
            score: 0.9,
            label: 0,
        };
        let moving = MovingAs {
            label: 8,
            score: 0.3,
        };
        assert!(!queue.wants_answer(23) && queue.wants_answer(24));
        queue.answer(vec![seen(1.0)], 0.0, &moving);
        assert!(
            queue.wants_answer(24),
            "the first answer was the search camera's"
        );
        queue.answer(vec![seen(2.0)], 0.0, &moving);
        assert!(!queue.wants_answer(40));
        queue.release(24);
        let [precise] = &queue.arrived[..] else {
            panic!("{:?}", queue.arrived)
        };
        assert_eq!(precise.frame.tier, Tier::Precise);
        assert_eq!(precise.detections[0].box_px[0], 2.0);
        queue.release(40);
        assert_eq!(queue.arrived[0].detections[0].box_px[0], 1.0);
        assert!(queue.waiting.is_empty());
    }
}
