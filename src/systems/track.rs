//! Detections that have arrived become tracks, and tracks move the state machine.

use crate::components::camera::{PixelRect, SensorCamera, Tier};
use crate::components::clock::SimClock;
use crate::components::environment::Environment;
use crate::components::station::{Mount, Optics};
use crate::components::track::{
    BoresightError, DetectionBatch, DetectionQueue, Tracker, TrackingState,
};
use crate::components::uav::{Flight, UavStatus};
use crate::models::kinematics::{Pose, az_el_to_los, los_to_az_el};
use crate::models::rng::Stream;
use crate::models::tracking::{Look, Sighting, Track};
use bevy::prelude::*;
use glam::DVec2;

/// How detections are used.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct TrackerParams {
    /// The paper's rule: the detection nearest to the image centre is the target, and the linear
    /// map of eq. 8 its error. Otherwise identity comes from the track table.
    pub paper: bool,
    /// Precise errors up to this count as locked [px].
    pub lock_radius_px: f64,
    /// How long the lock must hold before the state is Engage [s].
    pub lock_dwell_s: f64,
    /// A precise error beyond this ends Engage [px].
    pub break_radius_px: f64,
}

/// Standard deviation of a detection's centre [px], of the pointing knowledge [rad].
const CENTRE_SIGMA_PX: f64 = 0.5;
const POINTING_SIGMA_RAD: f64 = 5e-6;
/// Hits that confirm a target to the next camera.
const CONFIRM_HITS: u32 = 4;
/// Hits after which a search track may become the target.
const CANDIDATE_HITS: u32 = 6;
/// Least rate on the sky that counts as flight [rad/s], and its least significance: scenery keeps
/// still, a flickering facade does not move far.
const MOVING_RADPS: f64 = 1.0e-3;
const MOVING_SIGMAS: f64 = 6.0;
/// Clear sky that must lie below a candidate that does not move [rad].
const SKY_MARGIN_RAD: f64 = 4e-3;
/// Time without a hit after which a camera has lost the target [s].
const LOSE_AFTER_S: f64 = 0.25;
/// Time the coarse camera has to confirm a candidate [s], and a lost target to come back.
const ACQUIRE_TIMEOUT_S: f64 = 3.0;
const LOST_TIMEOUT_S: f64 = 3.0;
/// Horizon of backstop checks [m].
const FAR_M: f64 = 20_000.0;

/// Updates the track table with the batches that arrived in this tick.
pub fn associate(
    clock: Res<SimClock>,
    params: Res<TrackerParams>,
    queue: Res<DetectionQueue>,
    mount: Single<&Mount>,
    cameras: Query<&SensorCamera>,
    mut tracker: ResMut<Tracker>,
) {
    for batch in &queue.arrived {
        let Some(camera) = cameras.iter().find(|camera| camera.tier == batch.tier) else {
            continue;
        };
        let pose = batch.pointing.believed_pose(mount.r_enu_m, batch.tier);
        let sightings = sightings(batch, camera, &pose);
        let tier = batch.tier as usize;
        let searching = match tracker.state {
            TrackingState::Search => batch.tier == Tier::Search,
            TrackingState::Lost => batch.tier == Tier::Coarse,
            _ => false,
        };
        let in_view = |az_el: DVec2| sees(camera, &pose, batch.rect, az_el);
        let look = Look {
            tier,
            t_s: clock.at_s(batch.exposure_tick),
            sightings: &sightings,
            in_view: &in_view,
            start_tracks: searching,
        };
        let assigned = tracker.table.update(&look);
        let held = matches!(
            tracker.state,
            TrackingState::Coarse | TrackingState::Precise | TrackingState::Engage
        );
        let chosen = if params.paper && held && batch.tier != Tier::Search {
            nearest_to_centre(batch, camera)
        } else {
            tracker
                .target
                .and_then(|target| assigned.iter().position(|id| *id == Some(target)))
        };
        if let Some(index) = chosen {
            tracker.hits_in_state[tier] += 1;
            tracker.error[tier] = Some(boresight_error(batch, index, camera, params.paper));
        }
    }
}

/// The directions of a batch's detections.
fn sightings(batch: &DetectionBatch, camera: &SensorCamera, pose: &Pose) -> Vec<Sighting> {
    let ifov_rad = camera.pinhole.ifov_rad();
    let boresight_rad = batch.pointing.alignment.sigma_rad[batch.tier as usize];
    let pointing_rad = POINTING_SIGMA_RAD.hypot(boresight_rad);
    batch
        .detections
        .iter()
        .map(|detection| {
            let ray_cam = camera.pinhole.ray(detection.centre_px().into());
            let [x0, y0, x1, y1] = detection.box_px;
            Sighting {
                az_el_rad: los_to_az_el(pose.q_enu_cam * ray_cam),
                sigma_rad: (CENTRE_SIGMA_PX * ifov_rad).hypot(pointing_rad),
                size_rad: (x1 - x0).max(y1 - y0) * ifov_rad,
                score: detection.score,
            }
        })
        .collect()
}

/// Whether a camera at `pose` sees a direction in the pixels it read out.
fn sees(camera: &SensorCamera, pose: &Pose, rect: PixelRect, az_el_rad: DVec2) -> bool {
    let ray_cam = pose.q_enu_cam.inverse() * az_el_to_los(az_el_rad);
    // A target whose centre is at the very edge is cut and may fairly be missed.
    const EDGE_PX: f64 = 4.0;
    camera.pinhole.project(ray_cam).is_some_and(|px| {
        [px.x, px.y]
            .iter()
            .zip(rect.offset_px)
            .zip(rect.size_px)
            .all(|((x, low), size)| {
                *x >= f64::from(low) + EDGE_PX && *x < f64::from(low + size) - EDGE_PX
            })
    })
}

fn nearest_to_centre(batch: &DetectionBatch, camera: &SensorCamera) -> Option<usize> {
    let centre = camera.pinhole.centre_px();
    let distance = |i: &usize| centre.distance(batch.detections[*i].centre_px().into());
    (0..batch.detections.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

fn boresight_error(
    batch: &DetectionBatch,
    index: usize,
    camera: &SensorCamera,
    linear: bool,
) -> BoresightError {
    let detection = &batch.detections[index];
    let px: DVec2 = detection.centre_px().into();
    let [x0, y0, x1, y1] = detection.box_px;
    // What is to be brought to the target is the laser's axis, not the image's centre.
    let reticle_px = batch
        .pointing
        .alignment
        .reticle_px(&camera.pinhole, batch.tier);
    let angles = |px| {
        if linear {
            camera.pinhole.angles_linear(px)
        } else {
            camera.pinhole.angles(px)
        }
    };
    BoresightError {
        exposure_tick: batch.exposure_tick,
        angle_rad: angles(px) - angles(reticle_px),
        distance_px: px.distance(reticle_px),
        half_side_px: 0.5 * (x1 - x0).min(y1 - y0),
    }
}

/// Moves the state machine.
pub fn decide(
    clock: Res<SimClock>,
    params: Res<TrackerParams>,
    environment: Res<Environment>,
    mount: Single<&Mount>,
    mut tracker: ResMut<Tracker>,
) {
    let tracker = &mut *tracker;
    let tick = clock.tick;
    let in_state_s = clock.at_s(tick - tracker.since_tick);
    let silent_s = |tracker: &Tracker, tier: Tier| {
        tracker.error[tier as usize].map_or(f64::INFINITY, |error| {
            clock.at_s(tick - error.exposure_tick)
        })
    };
    // The paper has no track to extrapolate: it knows its target only by what it sees.
    let gone = !params.paper && tracker.target_track().is_none();
    match tracker.state {
        TrackingState::Search => {
            let candidate = tracker
                .table
                .tracks
                .iter()
                .filter(|track| !tracker.rejected.contains(&track.id))
                .filter_map(|track| {
                    Some((
                        track,
                        candidate_reason(track, clock.t_s(), &environment, &mount)?,
                    ))
                })
                .max_by_key(|(track, _)| (track.total_hits(), std::cmp::Reverse(track.id)))
                .map(|(track, reason)| (track.id, reason));
            if let Some((id, reason)) = candidate {
                tracker.target = Some(id);
                tracker.error = [None; 3];
                tracker.range_m = None;
                tracker.change(tick, TrackingState::Acquire, reason);
            }
        }
        TrackingState::Acquire => {
            if tracker.hits_in_state[Tier::Coarse as usize] >= CONFIRM_HITS {
                let reason = format!("coarse camera confirms with {CONFIRM_HITS} hits");
                tracker.change(tick, TrackingState::Coarse, reason);
            } else if gone || in_state_s > ACQUIRE_TIMEOUT_S {
                tracker.rejected.extend(tracker.target.take());
                let reason = format!(
                    "coarse camera saw the candidate {} times in {in_state_s:.1} s",
                    tracker.hits_in_state[Tier::Coarse as usize]
                );
                tracker.change(tick, TrackingState::Search, reason);
            }
        }
        TrackingState::Coarse => {
            if tracker.hits_in_state[Tier::Precise as usize] >= CONFIRM_HITS {
                let reason = format!("precise camera confirms with {CONFIRM_HITS} hits");
                tracker.change(tick, TrackingState::Precise, reason);
            } else if gone {
                drop_target(tracker, tick);
            } else if silent_s(tracker, Tier::Coarse) > LOSE_AFTER_S {
                tracker.change(tick, TrackingState::Lost, lost_reason("coarse"));
            }
        }
        TrackingState::Precise | TrackingState::Engage => {
            let error = tracker.error[Tier::Precise as usize];
            if gone {
                drop_target(tracker, tick);
            } else if silent_s(tracker, Tier::Precise) > LOSE_AFTER_S {
                let coarse_holds = silent_s(tracker, Tier::Coarse) <= LOSE_AFTER_S;
                let to = if coarse_holds {
                    TrackingState::Coarse
                } else {
                    TrackingState::Lost
                };
                tracker.change(tick, to, lost_reason("precise"));
            } else if let Some(error) = error {
                let radius_px = if tracker.state == TrackingState::Engage {
                    params.break_radius_px
                } else {
                    params.lock_radius_px
                };
                if error.distance_px > radius_px {
                    tracker.locked_since = None;
                } else if tracker.locked_since.is_none() {
                    tracker.locked_since = Some(tick);
                }
                let locked_s = tracker
                    .locked_since
                    .map_or(0.0, |since| clock.at_s(tick - since));
                if tracker.state == TrackingState::Precise && locked_s >= params.lock_dwell_s {
                    let reason = format!(
                        "precise error below {} px for {} s",
                        params.lock_radius_px, params.lock_dwell_s
                    );
                    tracker.change(tick, TrackingState::Engage, reason);
                } else if tracker.state == TrackingState::Engage && tracker.locked_since.is_none() {
                    let reason = format!("precise error is {:.1} px", error.distance_px);
                    tracker.change(tick, TrackingState::Precise, reason);
                }
            }
        }
        TrackingState::Lost => {
            let seen = tracker.hits_in_state[Tier::Coarse as usize]
                + tracker.hits_in_state[Tier::Precise as usize];
            if seen >= 2 {
                tracker.change(tick, TrackingState::Coarse, "seen again");
            } else if gone {
                drop_target(tracker, tick);
            } else if in_state_s > LOST_TIMEOUT_S {
                tracker.target = None;
                let reason = format!("not seen again within {in_state_s:.1} s");
                tracker.change(tick, TrackingState::Search, reason);
            }
        }
    }
}

/// Goes back to the search when the target's track has run out of hits.
fn drop_target(tracker: &mut Tracker, tick: u64) {
    tracker.target = None;
    tracker.change(
        tick,
        TrackingState::Search,
        "no camera saw the target any more",
    );
}

fn lost_reason(camera: &str) -> String {
    format!("{camera} camera had no hit for {LOSE_AFTER_S} s")
}

/// Why a track may be a UAV: it moves, or it stands in clear sky.
fn candidate_reason(
    track: &Track,
    t_s: f64,
    environment: &Environment,
    mount: &Mount,
) -> Option<String> {
    if track.total_hits() < CANDIDATE_HITS || track.misses > 0 {
        return None;
    }
    let (rate_radps, sigmas) = track.motion(t_s);
    if rate_radps > MOVING_RADPS && sigmas > MOVING_SIGMAS {
        return Some(format!(
            "a candidate moves at {:.1} mrad/s",
            1e3 * rate_radps
        ));
    }
    let below = track.filter.predicted(t_s).az_el_rad() - DVec2::new(0.0, SKY_MARGIN_RAD);
    let sky = environment
        .city
        .dsm
        .first_hit(mount.r_enu_m, az_el_to_los(below), FAR_M)
        .is_none();
    // What does not move must be looked at longer.
    (sky && track.total_hits() >= 2 * CANDIDATE_HITS)
        .then(|| "a candidate stands in clear sky".into())
}

/// Pulses of the range finder a second, and the deviation of a range [m].
const RANGE_HZ: u32 = 10;
const RANGE_SIGMA_M: f64 = 0.5;
/// Half of the range finder's field [rad].
const RANGE_FIELD_RAD: f64 = 5e-4;

/// The laser range finder's stream.
#[derive(Resource)]
pub struct RangeFinder(pub Stream);

/// Ranges the UAV on the laser's axis, while the precise camera holds a target.
pub fn find_range(
    clock: Res<SimClock>,
    optics: Single<&Optics>,
    uavs: Query<(&Flight, &UavStatus)>,
    mut finder: ResMut<RangeFinder>,
    mut tracker: ResMut<Tracker>,
) {
    let every = u64::from((clock.tick_hz / RANGE_HZ).max(1));
    let held = matches!(
        tracker.state,
        TrackingState::Precise | TrackingState::Engage
    );
    if !held || !clock.tick.is_multiple_of(every) {
        return;
    }
    let pose = optics.laser;
    let echo = uavs
        .iter()
        .filter(|(_, status)| **status == UavStatus::Flying)
        .map(|(flight, _)| pose.q_enu_cam.inverse() * (flight.aim_enu_m() - pose.r_enu_m))
        .filter(|r_cam_m| r_cam_m.truncate().length() < RANGE_FIELD_RAD * r_cam_m.z)
        .map(|r_cam_m| r_cam_m.length())
        .min_by(f64::total_cmp);
    if let Some(range_m) = echo {
        tracker.range_m = Some(range_m + RANGE_SIGMA_M * finder.0.normal());
    }
}
