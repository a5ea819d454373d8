//! Frames become detections, which wait out readout and inference.

use crate::components::camera::{Frame, Frames, PixelRect, SensorCamera};
use crate::components::clock::SimClock;
use crate::components::track::{DetectionBatch, DetectionQueue};
use crate::inference::{DetectorError, OnnxDetector};
use crate::models::detection::{Candidate, Detection, TruthErrors, detect_truth};
use crate::models::rng::Stream;
use crate::run::{Failure, Stopwatch};
use bevy::prelude::*;
use std::time::Instant;

/// The detector of a run: an image goes in, boxes with scores come out.
#[derive(Resource)]
pub enum Detector {
    /// A network on the rendered image.
    Onnx {
        /// The loaded model.
        model: Box<OnnxDetector>,
        /// Scores below this are dropped.
        score_threshold: f64,
    },
    /// The geometric truth with set errors; needs no image.
    Truth {
        /// The errors.
        errors: TruthErrors,
        /// Seed of the run.
        seed: u64,
    },
}

impl Detector {
    /// Whether frames must be rendered for it.
    pub fn needs_images(&self) -> bool {
        matches!(self, Detector::Onnx { .. })
    }

    /// The detections in `frame`, in full-sensor pixels.
    pub fn detect(
        &mut self,
        frame: &Frame,
        sensor_px: [u32; 2],
    ) -> Result<Vec<Detection>, DetectorError> {
        let mut found = Vec::new();
        match self {
            Detector::Onnx {
                model,
                score_threshold,
            } => {
                if let Some(rgb8) = &frame.rgb8 {
                    model.detect(rgb8, frame.rect.size_px, &mut found)?;
                }
                found.retain(|detection| detection.score >= *score_threshold);
                for detection in &mut found {
                    *detection = detection.shifted(frame.rect.offset_px);
                }
            }
            Detector::Truth { errors, seed } => {
                // Control work wants a detector whose only errors are the set ones: the box is
                // centred on the aim point, whatever the gear below it or the rotors above.
                let candidates = frame.truth.iter().filter(|seen| seen.clear).map(|seen| {
                    let [x0, y0, x1, y1] = seen.box_px;
                    let (half_x, half_y) = (0.5 * (x1 - x0), 0.5 * (y1 - y0));
                    let [x, y] = seen.aim_px;
                    Candidate {
                        index: seen.uav,
                        box_px: [x - half_x, y - half_y, x + half_x, y + half_y],
                        distractor: seen.distractor,
                    }
                });
                // Sensor noise has a key of the same parts: another seed keeps the two apart.
                let key = Stream::new(!*seed, frame.tick, frame.tier.name()).bits();
                let PixelRect { offset_px, size_px } = frame.rect;
                detect_truth(
                    candidates, errors, offset_px, size_px, sensor_px, key, &mut found,
                );
            }
        }
        Ok(found)
    }
}

/// Runs the detector on every frame of this tick and releases what has become available.
pub fn detect(
    clock: Res<SimClock>,
    frames: Res<Frames>,
    cameras: Query<&SensorCamera>,
    mut detector: ResMut<Detector>,
    mut queue: ResMut<DetectionQueue>,
    mut stopwatch: ResMut<Stopwatch>,
    mut failure: ResMut<Failure>,
) {
    for frame in &frames.0 {
        let Some(camera) = cameras.iter().find(|camera| camera.tier == frame.tier) else {
            continue;
        };
        let sensor_px = [camera.pinhole.width_px, camera.pinhole.height_px];
        let started = Instant::now();
        let detections = match detector.detect(frame, sensor_px) {
            Ok(detections) => detections,
            Err(error) => {
                failure.set(error);
                continue;
            }
        };
        if detector.needs_images() {
            stopwatch.inference += started.elapsed();
        }
        queue.push(DetectionBatch {
            tier: frame.tier,
            exposure_tick: frame.tick,
            available_tick: frame.tick + camera.latency_ticks,
            pointing: frame.pointing,
            rect: frame.rect,
            detections,
        });
    }
    queue.release(clock.tick);
}
