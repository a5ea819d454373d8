//! The detector, and detections on their way to the tracker.

use crate::components::capture::{ExposedFrame, PixelRect, Readout};
use crate::inference::Inference;
use crate::models::flight::class::is_uav;
use crate::models::optics::detection::{Detection, TruthErrors};
use bevy::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;

/// The detector of a run: an image goes in, boxes with scores come out.
#[derive(Resource)]
pub enum Detector {
    /// A network on the rendered image.
    Onnx {
        /// The model at work.
        inference: Box<Inference>,
        /// A detection of this score counts by itself.
        score_threshold: f64,
        /// One of a lower score goes on with a track; below this one it is dropped.
        weak_threshold: f64,
        /// Side of the square around the predicted target in which it looks for that [px].
        roi_px: Option<u32>,
        /// The stations that wait for an answer, one for each picture, in the order in which they asked.
        asked: VecDeque<Entity>,
    },
    /// The geometric truth with set errors; needs no image.
    Truth {
        /// Noise, misses, false alarms and scores.
        errors: TruthErrors,
        /// Seed of the run.
        seed: u64,
    },
}

/// A target must not be larger than this share of the region in which the network looks for it, or the
/// region grows: the network wants surroundings, and the prediction errs.
const LARGEST_SHARE: f64 = 0.5;
/// A region grows in steps of this many pixels, a common stride of networks.
const REGION_STEP_PX: u32 = 64;
/// What is larger than this is shown to the network shrunk, so that it is no larger: networks for small UAVs
/// do not know larger ones (the shipped one scores 0.8 at 40 px, 0.3 at 125 px; docs/validation.md).
const LARGEST_SHOWN_PX: f64 = 64.0;

impl Detector {
    /// Side of the square in which it looks for a predicted target [px], if it does so at all.
    pub fn roi_px(&self) -> Option<u32> {
        match self {
            Detector::Onnx { roi_px, .. } => *roi_px,
            Detector::Truth { .. } => None,
        }
    }

    /// The part of the pixels `rect` in which it looks.
    pub fn look(&self, readout: &Readout, rect: PixelRect) -> PixelRect {
        match (readout, self.roi_px()) {
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

    /// By how much, a whole number, the network's picture of a readout is shrunk.
    pub fn shrinks(&self, readout: &Readout) -> u32 {
        match (self, readout) {
            (Detector::Onnx { .. }, Readout::Around { target_px, .. }) => {
                (target_px / LARGEST_SHOWN_PX).ceil().max(1.0) as u32
            }
            _ => 1,
        }
    }

    /// The score from which on a detection counts by itself.
    pub fn start_score(&self) -> f64 {
        match self {
            Detector::Onnx {
                score_threshold, ..
            } => *score_threshold,
            Detector::Truth { .. } => 0.0,
        }
    }

    /// Bit by bit, which of its classes are no UAVs.
    pub fn other_classes(&self) -> u64 {
        match self {
            Detector::Onnx { inference, .. } => other_classes(inference.classes()),
            Detector::Truth { .. } => 0,
        }
    }

    /// Name of the class with the index that detections and tracks carry.
    pub fn class(&self, label: u32) -> &str {
        match self {
            Detector::Onnx { inference, .. } => inference
                .classes()
                .get(label as usize)
                .map_or("uav", String::as_str),
            Detector::Truth { .. } => "uav",
        }
    }

    /// What a picture's box is labelled with: the score, and the class where there are several.
    pub fn caption(&self, detection: &Detection) -> String {
        match self {
            Detector::Onnx { inference, .. } if inference.classes().len() > 1 => {
                format!("{} {:.2}", self.class(detection.label), detection.score)
            }
            _ => format!("{:.2}", detection.score),
        }
    }
}

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
    /// Whether the detector has answered.
    pub answered: bool,
}

impl DetectionBatch {
    /// Frames go to the detector, and are answered, in this order.
    fn asked(&self) -> (u64, usize) {
        (self.frame.tick, self.frame.index)
    }
}

/// Batches of a station that wait out their latency.
#[derive(Component, Default, Debug)]
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

    /// Whether a batch that is available at `tick` still lacks its detections.
    pub fn wants_answer(&self, tick: u64) -> bool {
        (self.waiting.iter())
            .take_while(|batch| batch.available_tick <= tick)
            .any(|batch| !batch.answered)
    }

    /// Puts the detector's next answer, in pixels of the part that it looked at, into its batch.
    pub fn answer(&mut self, found: &[Detection]) {
        let open = self.waiting.iter_mut().filter(|batch| !batch.answered);
        if let Some(batch) = open.min_by_key(|batch| batch.asked()) {
            let offset_px = batch.look.offset_px;
            let shrunk = f64::from(batch.shrunk);
            let placed = |found: &Detection| found.enlarged(shrunk).shifted(offset_px);
            batch.detections = found.iter().map(placed).collect();
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
        assert!(!queue.wants_answer(23) && queue.wants_answer(24));
        queue.answer(&[seen(1.0)]);
        assert!(
            queue.wants_answer(24),
            "the first answer was the search camera's"
        );
        queue.answer(&[seen(2.0)]);
        assert!(!queue.wants_answer(40));
        queue.release(24);
        let [precise] = &queue.arrived[..] else {
            panic!("{:?}", queue.arrived)
        };
        assert_eq!(precise.frame.tier, Tier::Precise);
        // In pixels of the sensor, not of the part looked at.
        assert_eq!(precise.detections[0].box_px, [102.0, 50.0, 106.0, 54.0]);
        queue.release(40);
        assert_eq!(queue.arrived[0].detections[0].box_px[0], 101.0);
        assert!(queue.waiting.is_empty());
    }
}
