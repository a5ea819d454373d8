//! State hash, recording, statistics: what a tick leaves behind.

use crate::app::{Failure, RunError};
use crate::components::beam::{BeamState, FireCommand, LaserSource};
use crate::components::capture::{Frame, Frames, SensorCamera, Tier};
use crate::components::clock::SimClock;
use crate::components::flight::{Distractor, Flight, HeatedSkin, Uav, UavStatus};
use crate::components::mount::{Mount, MountCommand, Optics};
use crate::components::record::{History, KeptFrame, Recording, StateHash, Unmarked};
use crate::components::track::{DetectionBatch, DetectionQueue, Tracker, TrackingState};
use crate::media::image::encode_jpeg;
use crate::models::maths::kinematics::{error_angles, los_to_az_el};
use crate::models::tracking::table::separation_rad;
use crate::recording::{
    BoxAnnotation, CameraTopic, FrameTransform, LogLevel, Recorder, RecordingError, SceneEntity,
    SceneShape, proto,
};
use crate::systems::detect::Detector;
use crate::systems::engage::Interlocks;
use bevy::prelude::*;
use glam::{DQuat, DVec3};
use xxhash_rust::xxh3::Xxh3;

/// Hashes the state after this tick.
pub fn hash_state(
    clock: Res<SimClock>,
    mut hash: ResMut<StateHash>,
    station: Single<(&Mount, &MountCommand, &BeamState, &FireCommand)>,
    uavs: Query<(&Flight, &HeatedSkin, &UavStatus)>,
    distractors: Query<&Flight, With<Distractor>>,
    tracker: Res<Tracker>,
    queue: Res<DetectionQueue>,
    mut bytes: Local<Vec<u8>>,
) {
    bytes.clear();
    let mut put = |values: &[f64]| {
        for value in values {
            bytes.extend_from_slice(&value.to_bits().to_le_bytes());
        }
    };
    let (mount, command, beam, fire) = *station;
    put(&mount.gimbal.az_el_rad().to_array());
    put(&mount.gimbal.rates_radps().to_array());
    put(&mount.mirror.deflection_rad().to_array());
    put(&mount.mirror.rate_radps().to_array());
    put(&mount.base.tilt_rad().to_array());
    put(&mount.gyro.tilt_enu_rad.to_array());
    for axis in [&mount.gimbal.azimuth, &mount.gimbal.elevation] {
        put(&[
            axis.twist_rad,
            axis.twist_rate_radps,
            axis.integral_nm,
            axis.encoder_rad,
            axis.gyro_radps,
        ]);
    }
    put(&mount.wind.as_ref().map_or([0.0; 2], |wind| wind.torque_nm));
    put(&command.gimbal.rate_radps);
    put(&command.mirror_rad.to_array());
    put(&[
        beam.irradiance_wpm2,
        beam.offset_m,
        beam.scintillation,
        beam.energy_j,
        beam.dwell_s,
    ]);
    put(&[
        f64::from(u8::from(fire.fire)),
        fire.focus_range_m,
        tracker.range_m.unwrap_or(-1.0),
    ]);
    for (flight, skin, status) in &uavs {
        let state = &flight.state;
        put(&state.r_enu_m.to_array());
        put(&state.v_enu_mps.to_array());
        put(&state.q_enu_body.to_array());
        put(&state.omega_body_radps.to_array());
        put(&state.rotor_speed_radps);
        put(&[skin.skin.temperature_k, *status as u8 as f64]);
    }
    // One archetype for good: always in the scenario's order.
    for flight in &distractors {
        put(&flight.state.r_enu_m.to_array());
        put(&flight.state.v_enu_mps.to_array());
        put(&flight.state.q_enu_body.to_array());
        put(&flight.state.rotor_phase_rad[..1]);
    }
    put(&[
        tracker.state as u8 as f64,
        tracker.target.map_or(-1.0, f64::from),
    ]);
    put(&[tracker.table.tracks.len() as f64]);
    for batch in &queue.arrived {
        put(&[batch.exposure_tick as f64, batch.tier as u8 as f64]);
        for detection in &batch.detections {
            put(&detection.box_px);
            put(&[detection.score, f64::from(detection.label)]);
        }
    }
    let mut hasher = Xxh3::new();
    hasher.update(&hash.0.to_le_bytes());
    hasher.update(&clock.tick.to_le_bytes());
    hasher.update(&bytes);
    hash.0 = hasher.digest();
}

/// The UAV or distractor that the tracker's target really is: the one nearest to its line of sight.
pub fn followed<'a>(
    tracker: &Tracker,
    t_s: f64,
    r_station_enu_m: DVec3,
    uavs: impl Iterator<Item = (&'a Uav, &'a Flight)>,
) -> Option<usize> {
    let los = tracker.target_track()?.filter.predicted(t_s).az_el_rad();
    uavs.map(|(uav, flight)| {
        let at = los_to_az_el(flight.aim_enu_m() - r_station_enu_m);
        (separation_rad(los, at), uav.index)
    })
    .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
    .map(|(_, index)| index)
}

/// Pictures on the contact sheet: one a camera and state, then one in two seconds.
const KEEP_EVERY_S: f64 = 2.0;
const KEEP_MOST: usize = 48;

/// Collects series and pictures.
pub fn keep_history(
    clock: Res<SimClock>,
    recording: Res<Recording>,
    frames: Res<Frames>,
    tracker: Res<Tracker>,
    queue: Res<DetectionQueue>,
    cameras: Query<&SensorCamera>,
    station: Single<(&Mount, &Optics, &BeamState)>,
    uavs: Query<(&Uav, &Flight, &HeatedSkin, &UavStatus)>,
    distractors: Query<(&Uav, &Flight), With<Distractor>>,
    mut history: ResMut<History>,
) {
    let (mount, optics, beam) = *station;
    let t_s = clock.t_s();
    for (uav, _, _, status) in &uavs {
        if history.neutralised_s.len() <= uav.index {
            history.neutralised_s.resize(uav.index + 1, None);
        }
        if status.neutralised() && history.neutralised_s[uav.index].is_none() {
            history.neutralised_s[uav.index] = Some(t_s);
        }
    }
    if tracker.state == TrackingState::Coarse && history.acquired_s.is_none() {
        history.acquired_s = Some(t_s);
    }
    let sampled = clock.tick.is_multiple_of(recording.state_period_ticks);
    // A distractor that is followed is no UAV: no series takes it for one.
    let target = if sampled || !frames.0.is_empty() {
        let flying = uavs.iter().map(|(uav, flight, ..)| (uav, flight));
        let all = flying.chain(&distractors);
        followed(&tracker, t_s, mount.r_enu_m, all)
    } else {
        None
    };
    if sampled {
        history.irradiance_wpm2.push((t_s, beam.irradiance_wpm2));
        history
            .power_in_bucket_w
            .push((t_s, beam.power_in_bucket_w));
        if let Some((_, flight, skin, _)) = uavs.iter().find(|(uav, ..)| Some(uav.index) == target)
        {
            history.skin_k.push((t_s, skin.skin.temperature_k));
            if holds(&tracker, Tier::Precise) {
                let los_enu = flight.aim_enu_m() - optics.laser.r_enu_m;
                let error_rad = error_angles(optics.laser.q_enu_cam, los_enu).length();
                history.los_error_urad.push((t_s, 1e6 * error_rad));
            }
        }
    }
    for frame in &frames.0 {
        let Some(camera) = cameras.iter().find(|camera| camera.tier == frame.tier) else {
            continue;
        };
        let reticle = frame
            .pointing
            .alignment
            .reticle_px(&camera.pinhole, frame.tier);
        // What falls has been dealt with: its miss distance is no measure of the tracking.
        let flies = uavs
            .iter()
            .any(|(uav, _, _, status)| Some(uav.index) == target && *status == UavStatus::Flying);
        if flies
            && holds(&tracker, frame.tier)
            && let Some(seen) = frame.truth.iter().find(|seen| Some(seen.uav) == target)
        {
            history.miss_px[frame.tier as usize].push((t_s, reticle.distance(seen.aim_px.into())));
        }
        if let Some(rgb8) = &frame.rgb8 {
            history.coming.push(KeptFrame {
                tier: frame.tier,
                tick: frame.tick,
                t_s,
                size_px: frame.rect.size_px,
                rgb8: rgb8.clone(),
                offset_px: frame.rect.offset_px,
                detections: Vec::new(),
                centre_px: reticle.to_array(),
                state: tracker.state.name(),
            });
        }
    }
    for batch in &queue.arrived {
        let of_batch = |kept: &KeptFrame| (kept.tick, kept.tier) == batch.key();
        let Some(at) = history.coming.iter().position(of_batch) else {
            continue;
        };
        let mut kept = history.coming.remove(at);
        kept.detections.clone_from(&batch.detections);
        let last = (history.frames.iter().rev()).find(|last| last.tier == kept.tier);
        let wanted =
            last.is_none_or(|last| last.state != kept.state || kept.t_s - last.t_s >= KEEP_EVERY_S);
        if wanted && history.frames.len() < KEEP_MOST {
            let at = history.frames.partition_point(|f| f.tick <= kept.tick);
            history.frames.insert(at, kept.clone());
        }
        let tier = kept.tier as usize;
        history.latest[tier] = Some(kept);
    }
}

/// Whether a camera holds the target in the present state.
fn holds(tracker: &Tracker, tier: Tier) -> bool {
    match tier {
        Tier::Search => false,
        Tier::Coarse => matches!(
            tracker.state,
            TrackingState::Coarse | TrackingState::Precise | TrackingState::Engage
        ),
        Tier::Precise => {
            matches!(
                tracker.state,
                TrackingState::Precise | TrackingState::Engage
            )
        }
    }
}

/// The recording's camera of a tier.
fn camera_of(tier: Tier) -> CameraTopic {
    CameraTopic::ALL[tier as usize]
}

fn xyz(v: DVec3) -> proto::Vec3 {
    proto::Vec3 {
        x: v.x,
        y: v.y,
        z: v.z,
    }
}

fn box_of([x0_px, y0_px, x1_px, y1_px]: [f64; 4]) -> proto::BoxPx {
    proto::BoxPx {
        x0_px,
        y0_px,
        x1_px,
        y1_px,
    }
}

fn transform<'a>(child: &'a str, r_enu_m: DVec3, q: DQuat) -> FrameTransform<'a> {
    FrameTransform {
        parent: "enu",
        child,
        translation_m: r_enu_m.to_array(),
        rotation: q.to_array(),
    }
}

/// A UAV or distractor as it is recorded.
type Flying = (
    &'static Uav,
    &'static Flight,
    Option<&'static HeatedSkin>,
    &'static UavStatus,
    Option<&'static Distractor>,
);

/// Everything that a tick may record.
#[derive(bevy::ecs::system::SystemParam)]
pub struct Recorded<'w, 's> {
    clock: Res<'w, SimClock>,
    hash: Res<'w, StateHash>,
    frames: Res<'w, Frames>,
    queue: Res<'w, DetectionQueue>,
    detector: Res<'w, Detector>,
    tracker: Res<'w, Tracker>,
    interlocks: Res<'w, Interlocks>,
    station: Single<
        'w,
        's,
        (
            &'static Mount,
            &'static MountCommand,
            &'static Optics,
            &'static LaserSource,
            &'static BeamState,
        ),
    >,
    uavs: Query<'w, 's, Flying>,
    cameras: Query<'w, 's, &'static SensorCamera>,
}

/// Writes this tick into the recording.
pub fn write_recording(
    now: Recorded,
    mut recording: ResMut<Recording>,
    mut failure: ResMut<Failure>,
) {
    let recording = &mut *recording;
    let Some(mut recorder) = recording.recorder.take() else {
        return;
    };
    match now.write(recorder.get(), recording) {
        Ok(()) => recording.recorder = Some(recorder),
        // The file is given up, not the error.
        Err(error) => failure.set(error),
    }
}

impl Recorded<'_, '_> {
    fn write(&self, recorder: &mut Recorder, recording: &mut Recording) -> Result<(), RunError> {
        let tick = self.clock.tick;
        let t_s = self.clock.t_s();
        let own = proto::Tick {
            tick,
            simulated_s: t_s,
            state_hash: self.hash.0,
        };
        recorder.own(tick, &own)?;
        for change in &self.tracker.changes[recording.changes_logged..] {
            let text = format!("{}: {}", change.to.name(), change.reason);
            recorder.log(tick, LogLevel::Info, "tracker", &text)?;
        }
        recording.changes_logged = self.tracker.changes.len();
        if tick.is_multiple_of(recording.state_period_ticks) {
            self.write_states(recorder, tick)?;
        }
        for frame in &self.frames.0 {
            self.write_frame(recorder, recording, frame)?;
        }
        for batch in &self.queue.arrived {
            self.write_detections(recorder, tick, batch)?;
            self.mark(recorder, recording, batch)?;
        }
        Ok(())
    }

    fn write_states(&self, recorder: &mut Recorder, tick: u64) -> Result<(), RecordingError> {
        let (mount, command, optics, source, beam) = *self.station;
        let t_s = self.clock.t_s();
        let mut transforms: Vec<_> = Tier::ALL
            .iter()
            .map(|tier| {
                let pose = optics.camera(*tier);
                transform(tier.name(), pose.r_enu_m, pose.q_enu_cam)
            })
            .collect();
        transforms.extend(self.uavs.iter().map(|(uav, flight, ..)| {
            transform(&uav.name, flight.state.r_enu_m, flight.state.q_enu_body)
        }));
        recorder.frame_transforms(tick, &transforms)?;

        let end = |range_m: f64| {
            optics.laser.r_enu_m + optics.laser.q_enu_cam * DVec3::new(0.0, 0.0, range_m)
        };
        let range_m = self.tracker.range_m.unwrap_or(1_500.0);
        let line = [optics.laser.r_enu_m.to_array(), end(range_m).to_array()];
        let shapes: Vec<_> = self
            .uavs
            .iter()
            .map(|(uav, _, _, status, distractor)| {
                [SceneShape::Cube {
                    centre_m: [0.0; 3],
                    rotation: [0.0, 0.0, 0.0, 1.0],
                    size_m: uav.size_m,
                    colour: match status {
                        _ if distractor.is_some() => [0.4, 0.45, 0.5, 1.0],
                        UavStatus::Flying => [0.9, 0.6, 0.0, 1.0],
                        _ => [0.5, 0.1, 0.1, 1.0],
                    },
                }]
            })
            .collect();
        let beam_line = [SceneShape::Line {
            points_m: &line,
            width_m: 0.1,
            colour: [0.84, 0.37, 0.0, 0.8],
        }];
        let lifetime_ticks = u32::try_from(
            self.clock.ticks_of(1.0 / 60.0), // [s]
        )
        .unwrap_or(1);
        let mut entities: Vec<_> = self
            .uavs
            .iter()
            .zip(&shapes)
            .map(|((uav, ..), shapes)| SceneEntity {
                id: &uav.name,
                frame: &uav.name,
                lifetime_ticks: 0,
                shapes,
            })
            .collect();
        if beam.firing {
            entities.push(SceneEntity {
                id: "beam",
                frame: "enu",
                lifetime_ticks,
                shapes: &beam_line,
            });
        }
        recorder.scene_update(tick, &entities)?;

        for (uav, flight, skin, status, distractor) in &self.uavs {
            let state = &flight.state;
            let [x, y, z, w] = state.q_enu_body.to_array();
            recorder.own(
                tick,
                &proto::UavState {
                    name: uav.name.clone(),
                    r_enu_m: Some(xyz(state.r_enu_m)),
                    v_enu_mps: Some(xyz(state.v_enu_mps)),
                    q_enu_body: Some(proto::Quat { x, y, z, w }),
                    skin_temperature_k: skin.map_or(f64::NAN, |skin| skin.skin.temperature_k),
                    status: distractor
                        .map_or(status.name(), |distractor| distractor.kind.name())
                        .into(),
                },
            )?;
        }
        let (angle, rate) = (mount.gimbal.az_el_rad(), mount.gimbal.rates_radps());
        let tilt = mount.base.tilt_rad();
        recorder.own(
            tick,
            &proto::MountState {
                azimuth_rad: angle.x,
                elevation_rad: angle.y,
                azimuth_rate_radps: rate.x,
                elevation_rate_radps: rate.y,
                azimuth_rate_command_radps: command.gimbal.rate_radps[0],
                elevation_rate_command_radps: command.gimbal.rate_radps[1],
                mirror_x_rad: mount.mirror.deflection_rad().x,
                mirror_y_rad: mount.mirror.deflection_rad().y,
                mirror_x_command_rad: command.mirror_rad.x,
                mirror_y_command_rad: command.mirror_rad.y,
                base_tilt_east_rad: tilt.x,
                base_tilt_north_rad: tilt.y,
            },
        )?;
        let mut track = proto::TrackState {
            state: self.tracker.state.name().into(),
            range_m: self.tracker.range_m.unwrap_or(f64::NAN),
            ..Default::default()
        };
        if let Some(target) = self.tracker.target_track() {
            let los = target.filter.predicted(t_s);
            let uavs = self.uavs.iter().map(|(uav, flight, ..)| (uav, flight));
            let index = followed(&self.tracker, t_s, mount.r_enu_m, uavs);
            let name = self.uavs.iter().find(|(uav, ..)| Some(uav.index) == index);
            track.target = name.map(|(uav, ..)| uav.name.clone()).unwrap_or_default();
            track.los_azimuth_rad = los.az_rad;
            track.los_elevation_rad = los.el_rad;
            track.los_azimuth_rate_radps = los.az_rate_radps;
            track.los_elevation_rate_radps = los.el_rate_radps;
            let [az, el] = los.covariance;
            track.los_covariance = vec![0.0; 16];
            for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                track.los_covariance[4 * (2 * i) + 2 * j] = az[(i, j)];
                track.los_covariance[4 * (2 * i + 1) + 2 * j + 1] = el[(i, j)];
            }
            track.quality = target.filter.quality();
            track.class = self.detector.class(target.label()).into();
        }
        recorder.own(tick, &track)?;
        recorder.own(
            tick,
            &proto::BeamState {
                firing: beam.firing,
                power_at_exit_w: if beam.firing {
                    source.laser.power_w
                } else {
                    0.0
                },
                power_at_target_w: beam.power_at_target_w,
                power_in_bucket_w: beam.power_in_bucket_w,
                irradiance_wpm2: beam.irradiance_wpm2,
                spot_radius_m: beam.spot_radius_m,
                offset_m: beam.offset_m,
                transmittance: beam.transmittance,
                scintillation: beam.scintillation,
                interlocks: self.interlocks.0.iter().map(ToString::to_string).collect(),
            },
        )
    }

    fn write_frame(
        &self,
        recorder: &mut Recorder,
        recording: &mut Recording,
        frame: &Frame,
    ) -> Result<(), RunError> {
        let tick = frame.tick;
        let camera = camera_of(frame.tier);
        let name = |index: usize| {
            self.uavs
                .iter()
                .find(|(uav, ..)| uav.index == index)
                .map(|(uav, ..)| uav.name.clone())
                .unwrap_or_default()
        };
        let uavs = frame
            .truth
            .iter()
            .map(|seen| {
                let rendered = seen.rendered;
                let visible =
                    rendered.map_or(f64::from(u8::from(seen.clear)), |r| r.visible_fraction);
                let shown = rendered.and_then(|r| r.box_px);
                proto::UavTruth {
                    name: name(seen.uav),
                    r#box: Some(box_of(shown.unwrap_or(seen.box_px))),
                    visible_fraction: visible,
                    range_m: seen.range_m,
                }
            })
            .collect();
        let truth = proto::FrameTruth {
            camera: frame.tier.name().into(),
            exposure_tick: tick,
            uavs,
        };
        recorder.own(tick, &truth)?;
        let Some(pinhole) = self
            .cameras
            .iter()
            .find(|c| c.tier == frame.tier)
            .map(|camera| camera.pinhole)
        else {
            return Ok(());
        };
        let reticle = frame.pointing.alignment.reticle_px(&pinhole, frame.tier);
        if holds(&self.tracker, frame.tier) {
            let uavs = self
                .uavs
                .iter()
                .filter(|(_, _, _, status, _)| **status == UavStatus::Flying)
                .map(|(uav, flight, ..)| (uav, flight));
            let target = followed(&self.tracker, self.clock.t_s(), frame.pose.r_enu_m, uavs);
            let seen = frame.truth.iter().find(|seen| Some(seen.uav) == target);
            if let Some(seen) = seen.filter(|seen| !seen.distractor) {
                let miss = proto::MissDistance {
                    camera: frame.tier.name().into(),
                    exposure_tick: tick,
                    miss_px: reticle.distance(seen.aim_px.into()),
                };
                recorder.own(tick, &miss)?;
            }
        }
        let Some(rgb8) = &frame.rgb8 else {
            return Ok(());
        };
        let seen = &mut recording.images_seen[frame.tier as usize];
        let keep = recording.image_every > 0 && seen.is_multiple_of(recording.image_every);
        *seen += 1;
        if keep {
            let [width, height] = frame.rect.size_px.map(|n| n as u16);
            let jpeg = encode_jpeg(rgb8, width, height, recording.jpeg_quality)
                .map_err(|error| RunError::Image(error.to_string()))?;
            // A window is a picture of its own: its calibration has the shifted principal point.
            let [dx, dy] = frame.rect.offset_px.map(f64::from);
            let centre = pinhole.centre_px();
            let (f, cx, cy) = (pinhole.focal_px, centre.x - dx, centre.y - dy);
            let [w, h] = frame.rect.size_px;
            let k_px = [f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0];
            recorder.camera_calibration(tick, camera, w, h, k_px)?;
            recorder.compressed_image(tick, camera, jpeg)?;
            recording.unmarked.push(Unmarked {
                tier: frame.tier,
                tick,
                offset_px: frame.rect.offset_px,
                reticle_px: [reticle.x - dx, reticle.y - dy],
            });
        }
        Ok(())
    }

    /// Marks the recorded image of a batch that has arrived, if there is one.
    fn mark(
        &self,
        recorder: &mut Recorder,
        recording: &mut Recording,
        batch: &DetectionBatch,
    ) -> Result<(), RecordingError> {
        let of_batch = |image: &Unmarked| (image.tick, image.tier) == batch.key();
        let Some(at) = recording.unmarked.iter().position(of_batch) else {
            return Ok(());
        };
        let image = recording.unmarked.remove(at);
        let [dx, dy] = image.offset_px.map(f64::from);
        let boxes: Vec<_> = batch
            .detections
            .iter()
            .map(|detection| BoxAnnotation {
                label: self.detector.class(detection.label),
                rect_px: {
                    let [x0, y0, x1, y1] = detection.box_px;
                    [x0 - dx, y0 - dy, x1 - dx, y1 - dy]
                },
                colour: [0.0, 0.62, 0.45, 1.0],
            })
            .collect();
        let (now, camera) = (self.clock.tick, camera_of(batch.tier));
        recorder.image_annotations(now, image.tick, camera, &boxes, image.reticle_px)
    }

    fn write_detections(
        &self,
        recorder: &mut Recorder,
        tick: u64,
        batch: &DetectionBatch,
    ) -> Result<(), RecordingError> {
        let detections = batch
            .detections
            .iter()
            .map(|detection| proto::Detection {
                r#box: Some(box_of(detection.box_px)),
                score: detection.score,
                label: self.detector.class(detection.label).into(),
            })
            .collect();
        recorder.own(
            tick,
            &proto::Detections {
                camera: batch.tier.name().into(),
                exposure_tick: batch.exposure_tick,
                available_tick: batch.available_tick,
                detections,
            },
        )
    }
}
