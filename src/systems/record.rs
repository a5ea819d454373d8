//! State hash, statistics, recording: what a tick leaves behind.

pub mod mcap;
pub mod sights;

use crate::components::beam::{BeamState, FireCommand};
use crate::components::capture::{ExposedFrame, Frames, Tier};
use crate::components::detect::DetectionQueue;
use crate::components::engage::{Interlocks, Rules};
use crate::components::flight::{Distractor, Flight, HeatedSkin, Uav, UavStatus};
use crate::components::mount::{Mount, MountCommand, Optics, PanTilt};
use crate::components::network::{SharedPicture, Tasking};
use crate::components::record::{CameraHistory, Fates, History, KeptFrame, Recording, StateHash};
use crate::components::run::SimClock;
use crate::components::track::Tracker;
use crate::models::decision::belief::Belief;
use crate::models::engage::interlock::FAR_M;
use crate::models::maths::kinematics::{error_angles, los_to_az_el};
use crate::models::tracking::held::reach_rad;
use crate::systems::track::followed;
use bevy::ecs::query::QueryData;
use bevy::prelude::*;
use glam::DVec3;
use std::sync::Arc;
use xxhash_rust::xxh3::Xxh3;

/// A station as its state is hashed.
#[derive(QueryData)]
pub struct Hashed {
    mount: &'static Mount,
    command: &'static MountCommand,
    beam: &'static BeamState,
    fire: &'static FireCommand,
    tracker: &'static Tracker,
    queue: &'static DetectionQueue,
    picture: &'static SharedPicture,
    tasking: &'static Tasking,
}

/// Hashes the state after this tick.
pub fn hash_state(
    clock: Res<SimClock>,
    mut hash: ResMut<StateHash>,
    stations: Query<Hashed>,
    pan_tilts: Query<&PanTilt>,
    uavs: Query<(&Flight, &HeatedSkin, &UavStatus)>,
    distractors: Query<&Flight, With<Distractor>>,
    mut bytes: Local<Vec<u8>>,
) {
    bytes.clear();
    for station in &stations {
        let HashedItem {
            mount,
            command,
            beam,
            fire,
            tracker,
            ..
        } = station;
        put_mount(&mut bytes, mount);
        let mut put = |values: &[f64]| put_all(&mut bytes, values);
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
    }
    let mut put = |values: &[f64]| put_all(&mut bytes, values);
    for (flight, skin, status) in &uavs {
        let state = &flight.state;
        put(&state.r_enu_m.to_array());
        put(&state.v_enu_mps.to_array());
        put(&state.q_enu_body.to_array());
        put(&state.omega_body_radps.to_array());
        put(&state.rotor_speed_radps);
        put(&[skin.temperature_k, skin.face_k, skin.hole_m2]);
        put(&[*status as u8 as f64]);
    }
    for pan_tilt in &pan_tilts {
        put(&pan_tilt.gimbal.state.az_el_rad().to_array());
        put(&pan_tilt.gimbal.state.rates_radps().to_array());
    }
    // One archetype for good: always in the scenario's order.
    for flight in &distractors {
        put(&flight.state.r_enu_m.to_array());
        put(&flight.state.v_enu_mps.to_array());
        put(&flight.state.q_enu_body.to_array());
        put(&flight.state.rotor_phase_rad[..1]);
    }
    for station in &stations {
        let HashedItem {
            tracker,
            queue,
            picture,
            tasking,
            ..
        } = station;
        put(&[
            tracker.state as u8 as f64,
            tracker.target.map_or(-1.0, f64::from),
        ]);
        put(&[tracker.table.tracks.len() as f64]);
        let recognised = tracker
            .table
            .tracks
            .iter()
            .filter_map(|track| track.recognition);
        for found in recognised {
            put(&found.probabilities);
        }
        for batch in &queue.arrived {
            put(&[batch.frame.tick as f64, batch.frame.tier as u8 as f64]);
            for detection in &batch.detections {
                put(&detection.box_px);
                put(&[detection.score, f64::from(detection.label)]);
            }
        }
        for object in &picture.objects {
            let (r_enu_m, v_enu_mps) = object.track.motion_enu();
            put(&r_enu_m.to_array());
            put(&v_enu_mps.to_array());
        }
        if let Some(task) = tasking.task {
            let number = task.track.map_or(-1.0, f64::from);
            put(&[f64::from(u8::from(task.engages)), number]);
        }
    }
    let mut hasher = Xxh3::new();
    hasher.update(&hash.0.to_le_bytes());
    hasher.update(&clock.tick.to_le_bytes());
    hasher.update(&bytes);
    hash.0 = hasher.digest();
}

/// Counts the time for which the beam rests on the aim point of what the tracker, after the last tick, has for its
/// target: one that rests on a UAV by mistake does not dwell on it.
pub fn count_dwell(
    clock: Res<SimClock>,
    uavs: Query<(&Uav, &Flight, &UavStatus)>,
    mut stations: Query<(&Tracker, &Optics, &mut BeamState)>,
) {
    for (tracker, optics, mut beam) in &mut stations {
        if !beam.on_aim_point {
            continue;
        }
        let flying = uavs
            .iter()
            .filter(|(.., status)| **status == UavStatus::Flying)
            .map(|(uav, flight, _)| (uav, flight));
        let target = followed(tracker, clock.t_s(), optics.laser.r_enu_m, flying);
        if target.map(|(index, _)| index) == beam.aimed {
            beam.dwell_s += clock.dt_s();
        }
    }
}

/// Appends the bits of numbers.
fn put_all(bytes: &mut Vec<u8>, values: &[f64]) {
    for value in values {
        bytes.extend_from_slice(&value.to_bits().to_le_bytes());
    }
}

/// Appends the state of gimbal, mirror, base and gyro.
fn put_mount(bytes: &mut Vec<u8>, mount: &Mount) {
    let mut put = |values: &[f64]| put_all(bytes, values);
    put(&mount.gimbal.state.az_el_rad().to_array());
    put(&mount.gimbal.state.rates_radps().to_array());
    put(&mount.mirror.deflection_rad().to_array());
    put(&mount.mirror.rate_radps().to_array());
    put(&mount.mirror.measured_rad().to_array());
    put(&mount.base.tilt_rad().to_array());
    put(&mount.gyro.tilt_enu_rad.to_array());
    for axis in [&mount.gimbal.state.azimuth, &mount.gimbal.state.elevation] {
        put(&[
            axis.twist_rad,
            axis.twist_rate_radps,
            axis.integral_nm,
            axis.bristle_rad,
            axis.encoder_rad,
            axis.gyro_radps,
        ]);
    }
    put(&mount.wind.as_ref().map_or([0.0; 2], |wind| wind.torque_nm));
}

/// Pictures on the contact sheet: one a camera and state, then one in two seconds.
const KEEP_EVERY_S: f64 = 2.0;
const KEEP_MOST: usize = 48;

/// A station as its series are kept.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct Kept {
    station: Entity,
    mount: &'static Mount,
    optics: &'static Optics,
    beam: &'static BeamState,
    tracker: &'static Tracker,
    rules: &'static Rules,
    interlocks: &'static Interlocks,
    history: &'static mut History,
}

/// Collects the series of summary and report.
pub fn keep_series(
    clock: Res<SimClock>,
    recording: Res<Recording>,
    frames: Res<Frames>,
    mut stations: Query<Kept>,
    mut cameras: Query<&mut CameraHistory>,
    uavs: Query<(&Uav, &Flight, &HeatedSkin, &UavStatus)>,
    distractors: Query<(&Uav, &Flight), With<Distractor>>,
    mut fates: ResMut<Fates>,
) {
    let t_s = clock.t_s();
    let (r_asset_enu_m, asset_radius_m) = (fates.r_asset_enu_m, fates.asset_radius_m);
    for (uav, flight, skin, status) in &uavs {
        if fates.uavs.len() <= uav.index {
            fates.uavs.resize(uav.index + 1, default());
        }
        let fate = &mut fates.uavs[uav.index];
        fate.hottest_k = fate.hottest_k.max(skin.temperature_k);
        let near = flight.state.r_enu_m.distance(r_asset_enu_m) < asset_radius_m;
        if status.neutralised() {
            fate.neutralised_s.get_or_insert(t_s);
        } else if *status == UavStatus::Flying && near {
            fate.at_asset_s.get_or_insert(t_s);
        }
    }
    let sampled = clock.tick.is_multiple_of(recording.state_period_ticks);
    for kept in &mut stations {
        let KeptItem {
            station,
            mount,
            optics,
            beam,
            tracker,
            rules,
            interlocks,
            mut history,
        } = kept;
        if tracker.state.acquired() {
            history.acquired_s.get_or_insert(t_s);
        }
        if let Some(aimed) = beam.aimed.filter(|_| beam.firing)
            && history.shots.last().is_none_or(|(_, last)| *last != aimed)
        {
            history.shots.push((t_s, aimed));
        }
        if beam.firing {
            let at_rad = los_to_az_el(optics.laser.q_enu_cam * DVec3::Z);
            let mut zones = rules.keep_out.iter();
            if zones.any(|zone| zone.meets(optics.laser.r_enu_m, at_rad, FAR_M)) {
                history.keep_out_s += clock.dt_s();
            }
        }
        if !sampled && frames.0.is_empty() {
            continue;
        }
        // A distractor that is followed is no UAV: no series takes it for one.
        let flying = uavs.iter().map(|(uav, flight, ..)| (uav, flight));
        let all = flying.chain(&distractors);
        let nearest = followed(tracker, t_s, mount.r_enu_m, all);
        let target =
            nearest.and_then(|(index, _)| uavs.iter().find(|(uav, ..)| uav.index == index));
        if sampled {
            let held_s = clock.at_s(recording.state_period_ticks);
            let on = target
                .zip(nearest)
                .filter(|((uav, flight, ..), (_, off_rad))| {
                    let [length_m, width_m, _] = uav.size_m;
                    let range_m = flight.state.r_enu_m.distance(mount.r_enu_m);
                    *off_rad <= reach_rad(0.5 * length_m.max(width_m), range_m)
                });
            match on {
                _ if !tracker.state.acquired() => {}
                None => history.wrong_object_s += held_s,
                Some(((uav, ..), _)) => {
                    let dealing = history.dealings.entry(uav.index).or_default();
                    dealing.held_s += held_s;
                    for reason in &interlocks.reasons {
                        *dealing.refused_s.entry(reason).or_default() += held_s;
                    }
                    fates.uavs[uav.index].acquired_s.get_or_insert(t_s);
                }
            }
            let belief = tracker.target_belief().unwrap_or(Belief::UNKNOWN);
            history.belief.push((t_s, belief));
            history.irradiance_wpm2.push((t_s, beam.irradiance_wpm2));
            history
                .power_in_bucket_w
                .push((t_s, beam.power_in_bucket_w));
            if let Some((_, flight, skin, _)) = target {
                history.skin_k.push((t_s, skin.temperature_k));
                if tracker.state.holds(Tier::Precise) {
                    let los_enu = flight.aim_enu_m() - optics.laser.r_enu_m;
                    let error_rad = error_angles(optics.laser.q_enu_cam, los_enu).length();
                    history.los_error_urad.push((t_s, 1e6 * error_rad));
                }
            }
        }
        // What falls has been dealt with: its miss distance is no measure of the tracking.
        let Some((uav, ..)) = target.filter(|(.., status)| **status == UavStatus::Flying) else {
            continue;
        };
        let held = |frame: &&Arc<ExposedFrame>| {
            frame.station == station && tracker.state.holds(frame.tier)
        };
        for frame in frames.0.iter().filter(held) {
            if let Some(seen) = frame.truth.iter().find(|seen| seen.uav == uav.index)
                && let Ok(mut camera) = cameras.get_mut(frame.camera)
            {
                let miss_px = frame.reticle_px().distance(seen.aim_px.into());
                camera.miss_px.push((t_s, miss_px));
            }
        }
    }
}

/// Keeps pictures whose detections have arrived: some for the contact sheet, the last of each camera
/// for a window.
pub fn keep_pictures(
    clock: Res<SimClock>,
    mut stations: Query<(&Tracker, &DetectionQueue, &mut History)>,
    mut cameras: Query<&mut CameraHistory>,
) {
    for (tracker, queue, mut history) in &mut stations {
        for batch in &queue.arrived {
            let frame = &batch.frame;
            let Some(rgb8) = &frame.rgb8 else {
                continue;
            };
            let kept = KeptFrame {
                camera: frame.name.clone(),
                tick: frame.tick,
                t_s: clock.at_s(frame.tick),
                size_px: frame.rect.size_px,
                rgb8: rgb8.clone(),
                offset_px: frame.rect.offset_px,
                detections: batch.detections.clone(),
                centre_px: frame.reticle_px().to_array(),
                state: tracker.state_at(frame.tick).name(),
            };
            let last = (history.frames.iter().rev()).find(|last| last.camera == kept.camera);
            let wanted = last
                .is_none_or(|last| last.state != kept.state || kept.t_s - last.t_s >= KEEP_EVERY_S);
            if wanted && history.frames.len() < KEEP_MOST {
                let at = history.frames.partition_point(|f| f.tick <= kept.tick);
                history.frames.insert(at, kept.clone());
            }
            if let Ok(mut camera) = cameras.get_mut(frame.camera) {
                camera.latest = Some(kept);
            }
        }
    }
}
