//! The geometric truth with set errors as a detector; it needs no picture.

use crate::components::capture::{ExposedFrame, PixelRect};
use crate::components::detect::{Detector, DetectorContext, Question, Reading};
use crate::components::run::{PartError, Seed};
use crate::models::maths::rng::Stream;
use crate::models::optics::detection::{Candidate, Detection, TruthErrors, detect_truth};
use glam::DVec2;
use std::collections::VecDeque;

/// The truth with the errors of a scenario.
pub fn make(context: &DetectorContext) -> TruthDetector {
    let errors = &context.loaded.scenario.detector.truth;
    let errors = TruthErrors {
        noise_px: errors.noise_px,
        miss_rate: errors.miss_rate,
        distractor_rate: errors.distractor_rate,
        false_alarms_per_frame: errors.false_alarms_per_frame,
    };
    TruthDetector::new(errors, context.seed)
}

/// The truth of every frame, with errors.
pub struct TruthDetector {
    errors: TruthErrors,
    seed: Seed,
    answers: VecDeque<Vec<Detection>>,
}

impl TruthDetector {
    /// Noise, misses, false alarms and scores, drawn from the run's seed.
    pub fn new(errors: TruthErrors, seed: Seed) -> Self {
        Self {
            errors,
            seed,
            answers: VecDeque::new(),
        }
    }
}

impl Detector for TruthDetector {
    /// It names nothing.
    fn classes(&self) -> &[String] {
        &[]
    }

    fn reading(&self) -> Reading {
        Reading::of_truth(self.errors.noise_px)
    }

    fn wants_pictures(&self) -> bool {
        false
    }

    fn ask(&mut self, questions: Vec<Question>) {
        let answer = |question: Question| found(&self.errors, self.seed.0, &question.frame);
        self.answers.extend(questions.into_iter().map(answer));
    }

    fn answer(&mut self) -> Result<Vec<Detection>, PartError> {
        Ok(self.answers.pop_front().unwrap_or_default())
    }
}

/// The detections of the truth detector in `frame`, in full-sensor pixels.
fn found(errors: &TruthErrors, seed: u64, frame: &ExposedFrame) -> Vec<Detection> {
    // Control work wants a detector whose only errors are the set ones: the box is
    // centred on the aim point, whatever the gear below it or the rotors above.
    let candidates = frame.truth.iter().filter(|seen| seen.clear).map(|seen| {
        let [x0, y0, x1, y1] = seen.box_px;
        let (half_x, half_y) = (0.5 * (x1 - x0), 0.5 * (y1 - y0));
        // Where the air before the lens shows it.
        let shift_px = (frame.seeing.as_ref()).map_or(DVec2::ZERO, |air| air.shift_px(seen.uav));
        let [x, y] = (DVec2::from(seen.aim_px) + shift_px).to_array();
        Candidate {
            index: seen.uav,
            box_px: [x - half_x, y - half_y, x + half_x, y + half_y],
            distractor: seen.distractor,
        }
    });
    // Sensor noise has a key of the same parts: another seed keeps the two apart.
    let key = Stream::new(!seed, frame.tick, &frame.name).bits();
    let PixelRect { offset_px, size_px } = frame.rect;
    let sensor_px = [frame.pinhole.width_px, frame.pinhole.height_px];
    let mut detections = Vec::new();
    detect_truth(
        candidates,
        errors,
        offset_px,
        size_px,
        sensor_px,
        key,
        &mut detections,
    );
    detections
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::capture::Tier;
    use crate::components::flight::{Flight, UavShape};
    use crate::models::bodies::uav_mesh;
    use crate::models::flight::multirotor::{self, Airframe};
    use crate::models::flight::trajectory::Trajectory;
    use crate::models::flight::uav::AimPart;
    use crate::models::maths::kinematics::Pose;
    use crate::models::optics::camera::Pinhole;
    use crate::scenario::catalogue;
    use crate::systems::capture::projected;
    use glam::{DMat3, DQuat, DVec3};
    use std::sync::Arc;

    /// Without errors the box of the truth detector is centred on the part, however the UAV tilts.
    #[test]
    fn the_aim_stays_on_the_part_through_an_evasive_weave() {
        let (dt_s, density) = (1.0 / 960.0, 1.2);
        let weave = Trajectory::Weave {
            start_enu_m: [-60.0, 400.0, 80.0],
            velocity_enu_mps: [12.0, 0.0, 0.0],
            lateral_acceleration_mps2: 6.0,
            period_s: 3.0,
        };
        let plan = weave.compile(|_| Ok(String::new())).unwrap();
        let uav = catalogue::load("phantom4").unwrap();
        let airframe = Airframe::new(&uav);
        let mesh = Arc::new(uav_mesh(&uav));
        let shape = UavShape::new(mesh.clone());
        // North, z forward and y down: the UAV passes through the field.
        let axes = DMat3::from_cols(DVec3::X, -DVec3::Z, DVec3::Y);
        let pose = Pose {
            r_enu_m: DVec3::new(0.0, 0.0, 75.0),
            q_enu_cam: DQuat::from_mat3(&axes),
        };
        let pinhole = Pinhole::from_hfov(1280, 960, 0.35).unwrap();
        let errors = TruthErrors {
            noise_px: 0.0,
            miss_rate: 0.0,
            distractor_rate: 0.0,
            false_alarms_per_frame: 0.0,
        };
        for part in [AimPart::Battery, AimPart::RotorHub, AimPart::Camera] {
            let mut flight = Flight {
                state: plan.initial_state(&airframe, DVec3::ZERO, density),
                aim_body_m: mesh.part_body_m(&uav, part),
            };
            let (mut worst_px, mut tilt_rad, mut frozen_px) = (0.0_f64, 0.0_f64, 0.0_f64);
            let offset_m = flight.state.q_enu_body * flight.aim_body_m;
            for tick in 0..9600_u64 {
                let state = &mut flight.state;
                let setpoint = plan.sample(tick as f64 * dt_s);
                multirotor::step(&airframe, state, &setpoint, DVec3::ZERO, density, dt_s);
                if tick % 8 != 0 {
                    continue;
                }
                let seen = projected(&pinhole, &pose, &flight, &shape).unwrap();
                let frame = ExposedFrame {
                    tick,
                    pose,
                    truth: vec![seen],
                    ..ExposedFrame::bare(Tier::Precise, pinhole)
                };
                let found = super::found(&errors, 1, &frame);
                assert_eq!(found.len(), 1, "{part:?} tick {tick}");
                // The part's projection, worked out by hand.
                let at_px = |r_enu_m: DVec3| {
                    let r = axes.transpose() * (r_enu_m - pose.r_enu_m);
                    pinhole.centre_px() + pinhole.focal_px * r.truncate() / r.z
                };
                let state = &flight.state;
                let rotation = DMat3::from_quat(state.q_enu_body);
                let part_px = at_px(state.r_enu_m + rotation * flight.aim_body_m);
                let box_px = DVec2::from(found[0].centre_px());
                worst_px = worst_px.max(box_px.distance(part_px));
                // A point that kept its first offset, as if the UAV never turned.
                frozen_px = frozen_px.max(at_px(state.r_enu_m + offset_m).distance(part_px));
                tilt_rad = tilt_rad.max(rotation.z_axis.z.acos());
            }
            println!("{part:?}: {worst_px:.1e} px, frozen {frozen_px:.2} px, tilt {tilt_rad:.2}");
            assert!(worst_px < 0.01, "{part:?}: {worst_px}");
            assert!(tilt_rad > 0.4, "{tilt_rad}");
            assert!(frozen_px > 0.1, "{part:?}: {frozen_px}");
        }
    }
}
