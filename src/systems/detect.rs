//! Frames become detections, which wait out readout and inference.

use crate::components::capture::{ExposedFrame, Frames, PixelRect, Readout, SensorCamera};
use crate::components::detect::{DetectionBatch, DetectionQueue, Detector};
use crate::components::run::{Failure, SimClock, Stopwatch};
use crate::inference::DetectorInput;
use crate::models::maths::rng::Stream;
use crate::models::optics::detection::{Candidate, Detection, TruthErrors, detect_truth};
use bevy::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// The detections of the truth detector in `frame`, in full-sensor pixels.
fn truth(errors: &TruthErrors, seed: u64, frame: &ExposedFrame) -> Vec<Detection> {
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
    let key = Stream::new(!seed, frame.tick, &frame.name).bits();
    let PixelRect { offset_px, size_px } = frame.rect;
    let sensor_px = [frame.pinhole.width_px, frame.pinhole.height_px];
    let mut found = Vec::new();
    detect_truth(
        candidates, errors, offset_px, size_px, sensor_px, key, &mut found,
    );
    found
}

/// Hands every frame of this tick to the detector and releases what has become available. A network
/// has until then to answer; only what is still missing at that tick is waited for.
pub fn detect(
    clock: Res<SimClock>,
    frames: Res<Frames>,
    cameras: Query<(&SensorCamera, &Readout)>,
    mut detector: ResMut<Detector>,
    mut queues: Query<&mut DetectionQueue>,
    mut stopwatch: ResMut<Stopwatch>,
    mut failure: ResMut<Failure>,
) {
    let started = Instant::now();
    let (mut pictures, mut stations) = (Vec::new(), Vec::new());
    for frame in &frames.0 {
        let (Ok((camera, readout)), Ok(mut queue)) =
            (cameras.get(frame.camera), queues.get_mut(frame.station))
        else {
            continue;
        };
        let mut batch = DetectionBatch {
            frame: frame.clone(),
            available_tick: frame.tick + camera.latency_ticks,
            look: detector.look(readout, frame.rect),
            shrunk: detector.shrinks(readout),
            detections: Vec::new(),
            answered: true,
        };
        match &*detector {
            Detector::Onnx { .. } => {
                if let Some(picture) = picture(frame, batch.look, batch.shrunk) {
                    batch.answered = false;
                    pictures.push(picture);
                    stations.push(frame.station);
                }
            }
            Detector::Truth { errors, seed } => batch.detections = truth(errors, *seed, frame),
        }
        queue.push(batch);
    }
    if let Detector::Onnx {
        inference,
        weak_threshold,
        asked,
        ..
    } = &mut *detector
    {
        if !pictures.is_empty() {
            inference.submit(pictures);
        }
        asked.extend(stations);
        // Answers come in the order of the questions, whose ever they are.
        while queues.iter().any(|queue| queue.wants_answer(clock.tick))
            && let Some(station) = asked.pop_front()
        {
            let mut found = inference.fetch().unwrap_or_else(|error| {
                failure.set(error);
                Vec::new()
            });
            found.retain(|detection| detection.score >= *weak_threshold);
            if let Ok(mut queue) = queues.get_mut(station) {
                queue.answer(&found);
            }
        }
        stopwatch.inference += started.elapsed();
    }
    for mut queue in &mut queues {
        queue.release(clock.tick);
    }
}

/// The part `look` of a frame as the network takes it, `shrunk` by a whole number; none in a run that
/// renders nothing.
fn picture(frame: &ExposedFrame, look: PixelRect, shrunk: u32) -> Option<DetectorInput> {
    let [left, top] = frame.rect.offset_px;
    let [x, y] = look.offset_px;
    let look = PixelRect {
        offset_px: [x - left, y - top],
        ..look
    };
    let (rgb8, width_px) = (frame.rgb8.clone()?, frame.rect.size_px[0]);
    if shrunk <= 1 {
        return Some(DetectorInput {
            rgb8,
            width_px,
            look,
        });
    }
    let size_px = look.size_px.map(|side| side / shrunk);
    Some(DetectorInput {
        rgb8: Arc::new(shrink(&rgb8, width_px, look.offset_px, size_px, shrunk)),
        width_px: size_px[0],
        look: PixelRect {
            offset_px: [0, 0],
            size_px,
        },
    })
}

/// `size_px` pixels, each the mean of `times` by `times` of a picture with rows of `width_px` RGB pixels.
fn shrink(
    rgb8: &[u8],
    width_px: u32,
    offset_px: [u32; 2],
    size_px: [u32; 2],
    times: u32,
) -> Vec<u8> {
    let mean = |x: u32, y: u32, channel: usize| {
        let (left, top) = (offset_px[0] + times * x, offset_px[1] + times * y);
        let rows = (top..top + times).flat_map(|y| (left..left + times).map(move |x| (x, y)));
        let value = |(x, y)| rgb8.get(3 * (y * width_px + x) as usize + channel).copied();
        let sum: u32 = rows.map(|at| u32::from(value(at).unwrap_or(0))).sum();
        ((sum + times * times / 2) / (times * times)) as u8
    };
    let places = (0..size_px[1]).flat_map(|y| (0..size_px[0]).map(move |x| (x, y)));
    places
        .flat_map(|(x, y)| [0, 1, 2].map(|channel| mean(x, y, channel)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::capture::{ExposedFrame, Tier};
    use crate::components::flight::{Flight, UavShape};
    use crate::models::flight::multirotor::{self, Airframe};
    use crate::models::flight::trajectory::Trajectory;
    use crate::models::flight::uav::{AimPart, UavKind, model};
    use crate::models::maths::kinematics::Pose;
    use crate::models::optics::camera::Pinhole;
    use crate::models::shape::uav_mesh::uav_mesh;
    use crate::systems::capture::projected;
    use glam::{DMat3, DQuat, DVec2, DVec3};

    #[test]
    fn a_shrunk_pixel_is_the_mean_of_its_own() {
        // Columns 0, 10, 20, ... in every row; the red plane of a part that begins at (2, 1).
        let rgb8: Vec<u8> = (0..6 * 8).flat_map(|i| [10 * (i % 8), 0, 255]).collect();
        let small = shrink(&rgb8, 8, [2, 1], [3, 2], 2);
        assert_eq!(small.len(), 3 * 3 * 2);
        assert_eq!([small[0], small[3], small[6], small[9]], [25, 45, 65, 25]);
        assert_eq!(small[2], 255);
    }

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
        let uav = model(UavKind::Phantom4);
        let airframe = Airframe::new(uav);
        let mesh = Arc::new(uav_mesh(UavKind::Phantom4));
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
                aim_body_m: mesh.part_body_m(uav, part),
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
                let found = super::truth(&errors, 1, &frame);
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
