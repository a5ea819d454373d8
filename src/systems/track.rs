//! Detections that have arrived become tracks, and tracks move the state machine.

pub mod recognise;

use crate::components::beam::BeamState;
use crate::components::capture::{PixelRect, SensorCamera, Tier};
use crate::components::control::Radar;
use crate::components::detect::{DetectionBatch, DetectionQueue, Detector};
use crate::components::environment::Environment;
use crate::components::flight::{Flight, Uav};
use crate::components::mount::{Mount, Optics};
use crate::components::run::SimClock;
use crate::components::track::{
    BoresightError, Designation, Gallery, Operator, Order, RangeFinder, Tracker, TrackerParams,
    TrackingState,
};
use crate::models::engage::interlock::FAR_M;
use crate::models::engage::threat::time_to_asset_s;
use crate::models::flight::uav::{AimPart, aim_offset_enu_m};
use crate::models::ground::dsm::{Dsm, LineOfSight};
use crate::models::laser::range_finder::{LitSurface, RangeFinderParams};
use crate::models::maths::kinematics::{Pose, az_el_to_los, los_to_az_el, wrap_pi};
use crate::models::optics::camera::Pinhole;
use crate::models::tracking::radar::RadarCue;
use crate::models::tracking::table::{
    CameraLook, Occlusion, Sighting, Track, TrackTable, separation_rad,
};
use bevy::prelude::*;
use glam::{DVec2, DVec3};
use recognise::Hung;

/// Time without a hit after which a camera of `rate_hz` [Hz] has lost the target [s]: a slow one may
/// miss a frame, as the faster ones may miss several.
pub fn patience_s(rate_hz: f64) -> f64 {
    const LEAST_S: f64 = 0.25; // [s]
    const FRAMES: f64 = 2.5;
    LEAST_S.max(FRAMES / rate_hz)
}

impl TrackerParams {
    /// Whether the detector is sure enough that a track is a UAV.
    pub fn convinced(&self, track: &Track) -> bool {
        track.filter.quality() >= self.min_quality && track.score >= self.min_score
    }
}

/// Standard deviation of the pointing knowledge [rad]: the drift of the base gyro within the
/// memory of the filter.
const POINTING_SIGMA_RAD: f64 = 5e-6;
/// Hits that confirm a target to the next camera.
const CONFIRM_HITS: u32 = 4;
/// Hits after which a search track may become the target.
const CANDIDATE_HITS: u32 = 6;
/// Hits that bring a lost target back: of the coarse camera, and of the search camera.
const AGAIN_HITS: u32 = 2;
const REFIND_HITS: u32 = 3;
/// Least rate on the sky that counts as flight [rad/s], and its least significance: scenery keeps
/// still, a flickering facade does not move far.
const MOVING_RADPS: f64 = 1.0e-3;
const MOVING_SIGMAS: f64 = 6.0;
/// Clear sky that must lie below a candidate that does not move [rad].
const SKY_MARGIN_RAD: f64 = 4e-3;
/// Time for which a track that was given up as no target is left alone [s].
const REJECTED_S: f64 = 10.0;
/// Time the coarse camera has to confirm a candidate [s], and a lost target to come back.
const ACQUIRE_TIMEOUT_S: f64 = 3.0;
const LOST_TIMEOUT_S: f64 = 3.0;
/// How long another track must have been the greater threat before it becomes the target [s].
const RIVAL_S: f64 = 1.0;
/// A held target that falls short of `min_quality` by this factor, or of `min_score` by this much,
/// is none.
const DOUBT_QUALITY: f64 = 0.6;
const DOUBT_SCORE: f64 = 0.05;
/// Time for which it must have been held before it is doubted [s].
const DOUBT_AFTER_S: f64 = 1.0;
/// A target that sinks faster by this [m/s] than when it was fired at, for this long [s], has been dealt
/// with.
const FALLING_MPS: f64 = 6.0;
const FALLING_S: f64 = 0.3;
/// Foresight of occlusions [s]; how often it is renewed, and threats are compared [Hz].
const FORESIGHT_S: f64 = 4.0;
const FORESIGHT_HZ: u32 = 10;
/// An operator points at a UAV's picture; the track must be this close to it [rad].
const DESIGNATION_RAD: f64 = 3e-3;

/// Updates the track table with the batches that arrived in this tick.
pub fn associate(
    clock: Res<SimClock>,
    params: Res<TrackerParams>,
    queue: Res<DetectionQueue>,
    mount: Single<&Mount>,
    cameras: Query<&SensorCamera>,
    detector: Res<Detector>,
    mut gallery: ResMut<Gallery>,
    mut tracker: ResMut<Tracker>,
) {
    for batch in &queue.arrived {
        let tier = batch.frame.tier;
        let Some(camera) = cameras.iter().find(|camera| camera.tier == tier) else {
            continue;
        };
        let t_s = clock.at_s(batch.frame.tick);
        let assigned = take_in(
            &mut tracker,
            &params,
            batch,
            &camera.pinhole,
            mount.r_enu_m,
            t_s,
        );
        let hung = Hung {
            batch,
            pinhole: &camera.pinhole,
            r_enu_m: mount.r_enu_m,
            t_s,
            assigned: &assigned,
        };
        gallery.hang(&hung, &tracker.table, |label| detector.class(label));
    }
}

/// Updates the track table with one batch, exposed at `t_s` by a camera at `r_enu_m`; returns for
/// each detection the track it went to (of the paper's rule, which knows no others, nothing).
pub(crate) fn take_in(
    tracker: &mut Tracker,
    params: &TrackerParams,
    batch: &DetectionBatch,
    pinhole: &Pinhole,
    r_enu_m: DVec3,
    t_s: f64,
) -> Vec<Option<u32>> {
    let frame = &batch.frame;
    let pose = frame.pointing.believed_pose(r_enu_m, frame.tier);
    let sightings = sightings(batch, pinhole, &pose, params.centre_sigma_px);
    let tier = frame.tier as usize;
    let in_view = |az_el: DVec2| sees(pinhole, &pose, batch.look, az_el);
    let look = CameraLook {
        tier,
        t_s,
        sightings: &sightings,
        in_view: &in_view,
        // The precise camera sees what it was turned to: a track already.
        start_tracks: frame.tier != Tier::Precise,
    };
    let blind = params.nearest_to_centre
        && frame.tier != Tier::Search
        && !matches!(
            tracker.state,
            TrackingState::Search | TrackingState::Acquire
        );
    let mut assigned = Vec::new();
    let chosen = if blind {
        let nearest = nearest_to_centre(batch, pinhole);
        if let Some(target) = tracker.target {
            let sighting = nearest.map(|index| &sightings[index]);
            tracker.table.force(target, &look, sighting);
        }
        nearest
    } else {
        assigned = tracker.table.update(&look);
        tracker.follow_joined();
        tracker
            .target
            .and_then(|target| assigned.iter().position(|id| *id == Some(target)))
    };
    if let Some(index) = chosen {
        tracker.hits_in_state[tier] += 1;
        let linear = params.linear_angles;
        let aim_rad = tracker.aim_rad;
        tracker.error[tier] = Some(boresight_error(batch, index, pinhole, linear, aim_rad));
    }
    assigned
}

/// The directions of a batch's detections.
fn sightings(
    batch: &DetectionBatch,
    pinhole: &Pinhole,
    pose: &Pose,
    centre_sigma_px: f64,
) -> Vec<Sighting> {
    let ifov_rad = pinhole.ifov_rad();
    let frame = &batch.frame;
    let boresight_rad = frame.pointing.alignment.sigma_rad[frame.tier as usize];
    let pointing_rad = POINTING_SIGMA_RAD.hypot(boresight_rad);
    batch
        .detections
        .iter()
        .map(|detection| {
            let ray_cam = pinhole.ray(detection.aim_px.into());
            let [x0, y0, x1, y1] = detection.box_px;
            Sighting {
                az_el_rad: los_to_az_el(pose.q_enu_cam * ray_cam),
                sigma_rad: (centre_sigma_px * ifov_rad).hypot(pointing_rad),
                size_rad: (x1 - x0).max(y1 - y0) * ifov_rad,
                score: detection.score,
                label: detection.label,
            }
        })
        .collect()
}

/// Whether a camera at `pose` sees a direction in the pixels it read out.
fn sees(pinhole: &Pinhole, pose: &Pose, rect: PixelRect, az_el_rad: DVec2) -> bool {
    let ray_cam = pose.q_enu_cam.inverse() * az_el_to_los(az_el_rad);
    // A target whose centre is at the very edge is cut and may fairly be missed.
    const EDGE_PX: f64 = 4.0;
    pinhole.project(ray_cam).is_some_and(|px| {
        [px.x, px.y]
            .iter()
            .zip(rect.offset_px)
            .zip(rect.size_px)
            .all(|((x, low), size)| {
                *x >= f64::from(low) + EDGE_PX && *x < f64::from(low + size) - EDGE_PX
            })
    })
}

fn nearest_to_centre(batch: &DetectionBatch, pinhole: &Pinhole) -> Option<usize> {
    let centre = pinhole.centre_px();
    let distance = |i: &usize| centre.distance(batch.detections[*i].aim_px.into());
    (0..batch.detections.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
}

fn boresight_error(
    batch: &DetectionBatch,
    index: usize,
    pinhole: &Pinhole,
    linear: bool,
    aim_rad: DVec2,
) -> BoresightError {
    let detection = &batch.detections[index];
    // Right and up on the sky is right and, in an image whose rows run down, up against them.
    let aim_px = DVec2::new(aim_rad.x, -aim_rad.y) / pinhole.ifov_rad();
    let px = DVec2::from(detection.aim_px) + aim_px;
    let [x0, y0, x1, y1] = detection.box_px;
    // What is to be brought to the target is the laser's axis, not the image's centre.
    let reticle_px = batch.frame.reticle_px(pinhole);
    let angles = |px| {
        if linear {
            pinhole.angles_linear(px)
        } else {
            pinhole.angles(px)
        }
    };
    BoresightError {
        exposure_tick: batch.frame.tick,
        available_tick: batch.available_tick,
        angle_rad: angles(px) - angles(reticle_px),
        distance_px: px.distance(reticle_px),
        half_side_px: 0.5 * (x1 - x0).min(y1 - y0),
    }
}

/// Finds where on the target's picture the part aimed at is expected.
pub fn aim(
    clock: Res<SimClock>,
    params: Res<TrackerParams>,
    mount: Single<&Mount>,
    mut tracker: ResMut<Tracker>,
) {
    let (Some(part), Some(range_m)) = (params.aim, tracker.range_m) else {
        tracker.aim_rad = DVec2::ZERO;
        return;
    };
    let t_s = clock.t_s();
    let placed = tracker.target_track().and_then(|track| {
        let (r_enu_m, v_enu_mps) = track.position_enu(mount.r_enu_m, t_s)?;
        // A detection's centre follows the mass of the picture, as the body's centroid does, more
        // than its outline: the parts are counted from the body.
        let span_m = track.size_rad * range_m;
        let offset_enu_m = aim_offset_enu_m(part, span_m, v_enu_mps)
            - aim_offset_enu_m(AimPart::Body, span_m, v_enu_mps);
        let los = los_to_az_el(r_enu_m - mount.r_enu_m);
        let shifted = los_to_az_el(r_enu_m + offset_enu_m - mount.r_enu_m);
        Some(DVec2::new(
            wrap_pi(shifted.x - los.x) * los.y.cos(),
            shifted.y - los.y,
        ))
    });
    tracker.aim_rad = placed.unwrap_or(DVec2::ZERO);
}

/// Foresees when buildings will hide the tracks whose range is known.
pub fn foresee(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mount: Single<&Mount>,
    mut tracker: ResMut<Tracker>,
) {
    if !clock.due(FORESIGHT_HZ) {
        return;
    }
    let t_s = clock.t_s();
    let dsm = &environment.city.dsm;
    for track in &mut tracker.table.tracks {
        let was = track.occlusion;
        let next = track.foresee_occlusion(dsm, mount.r_enu_m, t_s, FORESIGHT_S);
        track.occlusion = match (was, next) {
            // It is behind the building since it went there, not since the last look ahead.
            (Some(was), Some(next)) if was.hides(t_s) && next.hides(t_s) => Some(Occlusion {
                enter_s: was.enter_s,
                ..next
            }),
            // What is over is kept until the track is seen again: the way out is looked up there.
            (Some(was), None) if was.enter_s <= t_s && track.seen_s() < was.enter_s => Some(was),
            (_, next) => next,
        };
    }
}

/// Carries out the operator's orders: a track, or the one nearest to the UAV pointed at, becomes the
/// target, or the choice goes back to the tracker.
pub fn obey(
    clock: Res<SimClock>,
    mount: Single<&Mount>,
    uavs: Query<(&Uav, &Flight)>,
    mut operator: ResMut<Operator>,
    mut tracker: ResMut<Tracker>,
) {
    let due = |order: &&Order| clock.tick >= order.tick;
    let Some(order) = operator.orders.get(operator.next).filter(due) else {
        return;
    };
    // A later order that has come due replaces one that still waits for a track.
    if operator
        .orders
        .get(operator.next + 1)
        .is_some_and(|newer| due(&newer))
    {
        operator.next += 1;
        return;
    }
    let t_s = clock.t_s();
    let (track, reason) = match order.target {
        Designation::Release => {
            tracker.designated = false;
            operator.next += 1;
            return;
        }
        Designation::Track(id) => {
            let Some(track) = tracker.table.get(id) else {
                // A track that is gone does not come back under its old number.
                operator.next += 1;
                return;
            };
            let held = (track.total_hits() >= CONFIRM_HITS).then_some(id);
            (held, format!("operator chooses track {id}"))
        }
        Designation::Uav(index) => {
            let Some((uav, flight)) = uavs.iter().find(|(uav, _)| uav.index == index) else {
                operator.next += 1;
                return;
            };
            let at = los_to_az_el(flight.aim_enu_m() - mount.r_enu_m);
            let nearest = nearest_track(&tracker.table, at, t_s);
            let id = nearest.map_or(String::new(), |id| format!(" (track {id})"));
            (nearest, format!("operator designates {}{id}", uav.name))
        }
    };
    if let Some(id) = track {
        if tracker.target != Some(id) {
            tracker.acquire(clock.tick, id, reason);
        }
        tracker.designated = true;
        operator.next += 1;
    }
}

/// The confirmed track nearest to a direction that an operator points at.
fn nearest_track(table: &TrackTable, at_az_el_rad: DVec2, t_s: f64) -> Option<u32> {
    let distance =
        |track: &Track| separation_rad(track.filter.predicted(t_s).az_el_rad(), at_az_el_rad);
    table
        .tracks
        .iter()
        .filter(|track| track.total_hits() >= CONFIRM_HITS && distance(track) < DESIGNATION_RAD)
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .map(|track| track.id)
}

/// What the state machine looks at.
pub(crate) struct Situation<'a> {
    pub(crate) tick: u64,
    pub(crate) clock: &'a SimClock,
    pub(crate) params: &'a TrackerParams,
    /// The city's heights; `None` under an open sky.
    pub(crate) dsm: Option<&'a Dsm>,
    pub(crate) r_station_enu_m: DVec3,
}

impl Situation<'_> {
    fn t_s(&self) -> f64 {
        self.clock.at_s(self.tick)
    }

    /// Time without news of a hit of the target by a camera [s].
    fn silent_s(&self, tracker: &Tracker, tier: Tier) -> f64 {
        tracker.error[tier as usize].map_or(f64::INFINITY, |error| {
            self.clock.at_s(self.tick - error.available_tick)
        })
    }

    /// Whether a camera has had no news of the target for so long that it has lost it.
    fn lost_by(&self, tracker: &Tracker, tier: Tier) -> bool {
        self.silent_s(tracker, tier) > self.params.patience_s[tier as usize]
    }

    /// Whether a track was seen so lately by any camera that it may still be there.
    fn fresh(&self, track: &Track) -> bool {
        let longest_s = self.params.patience_s.into_iter().fold(0.0, f64::max);
        self.t_s() - track.seen_s() <= longest_s
    }

    /// Speed with which a track loses height [m/s].
    fn sink_mps(&self, track: &Track) -> f64 {
        track
            .position_enu(self.r_station_enu_m, self.t_s())
            .map_or(0.0, |(_, v_enu_mps)| -v_enu_mps.z)
    }

    /// Time that a track needs to reach the asset [s].
    fn threat_s(&self, track: &Track) -> f64 {
        track
            .position_enu(self.r_station_enu_m, self.t_s())
            .map_or(f64::INFINITY, |(r_enu_m, v_enu_mps)| {
                time_to_asset_s(r_enu_m, v_enu_mps, self.params.r_asset_enu_m)
            })
    }

    /// The most threatening track that looks like a UAV, and why it does.
    fn candidate(&self, tracker: &Tracker) -> Option<(u32, f64, String)> {
        tracker
            .table
            .tracks
            .iter()
            .filter(|track| tracker.rejected.iter().all(|(id, _)| *id != track.id))
            .filter_map(|track| {
                let reason = self.candidate_reason(track)?;
                Some((track.id, self.threat_s(track), reason))
            })
            .min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)))
    }

    /// Why a track may be a UAV: the detector sees it in most frames, and it moves or stands in
    /// clear sky.
    fn candidate_reason(&self, track: &Track) -> Option<String> {
        let quality = track.filter.quality();
        if track.total_hits() < CANDIDATE_HITS || !self.params.convinced(track) {
            return None;
        }
        if track.misses > 0 && !self.fresh(track) {
            return None;
        }
        let (rate_radps, sigmas) = track.motion(self.t_s());
        let seen = format!("seen in {:.0} % of its frames", 100.0 * quality);
        if rate_radps > MOVING_RADPS && sigmas > MOVING_SIGMAS {
            return Some(format!("moves at {:.1} mrad/s, {seen}", 1e3 * rate_radps));
        }
        let below =
            track.filter.predicted(self.t_s()).az_el_rad() - DVec2::new(0.0, SKY_MARGIN_RAD);
        let sky = self.dsm.is_none_or(|dsm| {
            dsm.first_hit(self.r_station_enu_m, az_el_to_los(below), FAR_M)
                .is_none()
        });
        sky.then(|| format!("stands in clear sky, {seen}"))
    }
}

/// Moves the state machine.
pub fn decide(
    clock: Res<SimClock>,
    params: Res<TrackerParams>,
    environment: Res<Environment>,
    radar: Res<Radar>,
    station: Single<(&Mount, &BeamState)>,
    mut tracker: ResMut<Tracker>,
) {
    let (mount, beam) = *station;
    let tracker = &mut *tracker;
    let now = Situation {
        tick: clock.tick,
        clock: &clock,
        params: &params,
        dsm: Some(&environment.city.dsm),
        r_station_enu_m: mount.r_enu_m,
    };
    let searched = tracker.state == TrackingState::Search;
    step(&now, tracker, beam.firing, clock.due(FORESIGHT_HZ));
    if searched
        && let Some(id) = tracker.target
        && let Some(cue) = radar.cue(now.t_s())
    {
        take_radar_range(&cue, &mut tracker.table, id, now.t_s());
    }
}

/// Moves the state machine by one look at the situation; `compares`: threats are weighed now.
pub(crate) fn step(now: &Situation, tracker: &mut Tracker, firing: bool, compares: bool) {
    let tick = now.tick;
    let kept_ticks = now.clock.ticks_of(REJECTED_S);
    tracker
        .rejected
        .retain(|(_, since)| tick < since + kept_ticks);
    if tracker.state == TrackingState::Search {
        if let Some((id, threat_s, reason)) = now.candidate(tracker) {
            let reason = format!("track {id} {reason}, could arrive in {threat_s:.0} s");
            tracker.acquire(tick, id, reason);
        }
        return;
    }
    let Some(track) = tracker.target_track() else {
        tracker.give_up(tick, false, "no camera saw the target any more");
        return;
    };
    let sink_mps = now.sink_mps(track);
    if firing {
        tracker.sink_at_fire_mps.get_or_insert(sink_mps);
    }
    // One that dived at the station before it was hit still attacks.
    let sinks = (tracker.sink_at_fire_mps).is_some_and(|before| sink_mps - before > FALLING_MPS);
    if sinks && tracker.lased {
        let since = *tracker.falling_since.get_or_insert(tick);
        if now.clock.at_s(tick - since) > FALLING_S {
            tracker.give_up(tick, true, "the target falls");
            return;
        }
    } else {
        tracker.falling_since = None;
    }
    hold(now, tracker);
    // What is being fired at is not left for another.
    if !now.params.nearest_to_centre
        && !tracker.designated
        && !firing
        && matches!(
            tracker.state,
            TrackingState::Coarse
                | TrackingState::Precise
                | TrackingState::Engage
                | TrackingState::Lost
        )
    {
        if compares {
            compare(now, tracker);
        }
    } else {
        tracker.rival = None;
    }
}

/// The range of a cue goes to the track that it points at, if there is only one.
fn take_radar_range(cue: &RadarCue, table: &mut TrackTable, id: u32, t_s: f64) {
    const GATE_SIGMAS: f64 = 3.0;
    let gate_rad = GATE_SIGMAS * cue.sigma_rad.max_element();
    let mut near = table.tracks.iter_mut().filter(|track| {
        let at = track.filter.predicted(t_s).az_el_rad();
        track.total_hits() >= CONFIRM_HITS && separation_rad(at, cue.az_el_rad) < gate_rad
    });
    if let (Some(track), None) = (near.next(), near.next())
        && track.id == id
    {
        track.ranged(cue.range_m, cue.range_sigma_m, t_s);
    }
}

/// Steps the states that have a target.
fn hold(now: &Situation, tracker: &mut Tracker) {
    let (tick, params) = (now.tick, now.params);
    let in_state_s = now.clock.at_s(tick - tracker.since_tick);
    let Some(track) = tracker.target_track() else {
        return;
    };
    let (id, quality, score) = (track.id, track.filter.quality(), track.score);
    let hidden = track.hidden(now.t_s());
    // The paper's rule has no track to judge by.
    let judged = !params.nearest_to_centre;
    let convincing = !judged || params.convinced(track);
    let hits = tracker.hits_in_state;
    match tracker.state {
        TrackingState::Search => {}
        TrackingState::Acquire => {
            if hits[Tier::Coarse as usize] >= CONFIRM_HITS && convincing {
                let reason = format!(
                    "coarse camera confirms with {CONFIRM_HITS} hits, seen in {:.0} % of the frames",
                    100.0 * quality
                );
                tracker.change(tick, TrackingState::Coarse, reason);
            } else if !hidden && in_state_s > ACQUIRE_TIMEOUT_S + hidden_s(track) {
                // What the precise camera has seen is a UAV, wherever it is now.
                let reject = track.hits[Tier::Precise as usize] < CONFIRM_HITS;
                let reason = format!(
                    "coarse camera saw the candidate {} times in {in_state_s:.1} s",
                    hits[Tier::Coarse as usize]
                );
                tracker.give_up(tick, reject, reason);
            }
        }
        TrackingState::Coarse | TrackingState::Precise | TrackingState::Engage
            if judged
                && !hidden
                && in_state_s > DOUBT_AFTER_S
                && now.fresh(track)
                && (quality < DOUBT_QUALITY * params.min_quality
                    || score < params.min_score - DOUBT_SCORE) =>
        {
            let reason = format!(
                "track {id} is no UAV: the detector sees it in {:.0} % of the frames, with a mean \
                 score of {score:.2}",
                100.0 * quality
            );
            tracker.give_up(tick, true, reason);
        }
        TrackingState::Coarse => {
            if hits[Tier::Precise as usize] >= CONFIRM_HITS {
                let reason = format!("precise camera confirms with {CONFIRM_HITS} hits");
                tracker.change(tick, TrackingState::Precise, reason);
            } else if now.lost_by(tracker, Tier::Coarse) {
                lose(now, tracker, Tier::Coarse);
            }
        }
        TrackingState::Precise | TrackingState::Engage => {
            if now.lost_by(tracker, Tier::Precise) {
                if now.lost_by(tracker, Tier::Coarse) {
                    lose(now, tracker, Tier::Precise);
                } else {
                    tracker.change(tick, TrackingState::Coarse, silence(now, Tier::Precise));
                }
            } else if let Some(error) = tracker.error[Tier::Precise as usize] {
                lock(now, tracker, error.distance_px);
            }
        }
        TrackingState::Lost => find_again(now, tracker, in_state_s),
    }
}

/// Steps a lost target: a camera sees it again, or it is given up.
fn find_again(now: &Situation, tracker: &mut Tracker, in_state_s: f64) {
    let Some(track) = tracker.target_track() else {
        return;
    };
    let (id, hits) = (track.id, tracker.hits_in_state);
    let waits = track.hidden(now.t_s()) || in_state_s <= LOST_TIMEOUT_S + hidden_s(track);
    let reason = format!("track {id} seen again after {in_state_s:.2} s");
    if hits[Tier::Coarse as usize] >= AGAIN_HITS {
        tracker.change(now.tick, TrackingState::Coarse, reason);
    } else if hits[Tier::Precise as usize] >= CONFIRM_HITS {
        tracker.change(now.tick, TrackingState::Precise, reason);
    } else if hits[Tier::Search as usize] >= REFIND_HITS {
        let reason = format!("search camera sees track {id} again after {in_state_s:.2} s");
        tracker.change(now.tick, TrackingState::Acquire, reason);
    } else if !waits {
        let reason = format!("not seen again within {in_state_s:.1} s");
        tracker.give_up(now.tick, false, reason);
    }
}

/// How long the city hid a track that has come out again, or should have [s].
fn hidden_s(track: &Track) -> f64 {
    track
        .occlusion
        .and_then(|occlusion| Some(occlusion.exit_s? - occlusion.enter_s))
        .map_or(0.0, |hidden_s| hidden_s.max(0.0))
}

/// Goes to Lost and says why, if the city explains it.
fn lose(now: &Situation, tracker: &mut Tracker, tier: Tier) {
    let foreseen = tracker.target_track().and_then(|track| track.occlusion);
    let reason = match foreseen.filter(|occlusion| occlusion.hides(now.t_s())) {
        Some(occlusion) => match occlusion.exit_s {
            Some(exit_s) => format!("behind a building, expected out at {exit_s:.2} s"),
            None => "behind a building".into(),
        },
        None => silence(now, tier),
    };
    tracker.change(now.tick, TrackingState::Lost, reason);
}

/// Why a camera has lost the target.
fn silence(now: &Situation, tier: Tier) -> String {
    let patience_s = now.params.patience_s[tier as usize];
    format!("{} camera had no hit for {patience_s} s", tier.word())
}

/// Follows the lock of the precise camera between Precise and Engage.
fn lock(now: &Situation, tracker: &mut Tracker, distance_px: f64) {
    let (tick, params) = (now.tick, now.params);
    let engaged = tracker.state == TrackingState::Engage;
    let radius_px = if engaged {
        params.break_radius_px
    } else {
        params.lock_radius_px
    };
    if distance_px > radius_px {
        tracker.locked_since = None;
    } else if tracker.locked_since.is_none() {
        tracker.locked_since = Some(tick);
    }
    match (engaged, tracker.locked_since) {
        (false, Some(since)) if now.clock.at_s(tick - since) >= params.lock_dwell_s => {
            let reason = format!(
                "precise error below {} px for {} s",
                params.lock_radius_px, params.lock_dwell_s
            );
            tracker.change(tick, TrackingState::Engage, reason);
        }
        (true, None) => {
            let reason = format!("precise error is {distance_px:.1} px");
            tracker.change(tick, TrackingState::Precise, reason);
        }
        _ => {}
    }
}

/// Turns to another track that has been the greater threat for long enough.
fn compare(now: &Situation, tracker: &mut Tracker) {
    let Some(target) = tracker.target_track() else {
        return;
    };
    let held_s = now.threat_s(target);
    let greater = now.candidate(tracker).filter(|(id, threat_s, _)| {
        *id != target.id && threat_s * now.params.switch_ratio < held_s
    });
    let Some((id, threat_s, _)) = greater else {
        tracker.rival = None;
        return;
    };
    match tracker.rival {
        Some((rival, since)) if rival == id => {
            if now.clock.at_s(now.tick - since) > RIVAL_S {
                let reason = format!(
                    "track {id} is the greater threat: it could arrive in {threat_s:.0} s, \
                     the target in {held_s:.0} s"
                );
                tracker.acquire(now.tick, id, reason);
            }
        }
        _ => tracker.rival = Some((id, now.tick)),
    }
}

/// Pulses of the range finder a second.
const RANGE_HZ: u32 = 10;
/// A range with a smaller deviation than this is good enough to focus and to judge by [m].
const RANGE_KNOWN_M: f64 = 10.0;
/// Diffuse reflectance of airframes, birds, walls and ground at the range finder's wavelength
/// (assumption).
const REFLECTANCE: f64 = 0.3;

/// Ranges what the pulse meets first, while the precise camera holds a target and the station
/// believes it in the range finder's field.
pub fn find_range(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    optics: Single<&Optics>,
    uavs: Query<(&Uav, &Flight)>,
    mut finder: ResMut<RangeFinder>,
    mut tracker: ResMut<Tracker>,
) {
    if !clock.due(RANGE_HZ) {
        return;
    }
    let held = tracker.state.holds(Tier::Precise);
    let t_s = clock.t_s();
    let RangeFinder { params, rng } = &mut *finder;
    let believed_rad = tracker.aim_los(t_s).map(|los| {
        let axis_enu = optics.pointing.laser_axis_enu();
        az_el_to_los(los.az_el_rad()).angle_between(axis_enu)
    });
    let Some(track) = tracker.target.and_then(|id| tracker.table.get_mut(id)) else {
        return;
    };
    let pulses = held && believed_rad.is_some_and(|off_rad| off_rad < params.half_field_rad);
    let echo_m = if pulses {
        let surfaces = lit_surfaces(params, &environment, &optics, &uavs);
        let extinction_per_m = environment.weather.extinction_per_m(params.wavelength_m);
        params.first_echo_m(surfaces, extinction_per_m)
    } else {
        None
    };
    if let Some(range_m) = echo_m {
        let measured_m = range_m + params.sigma_m * rng.normal();
        track.ranged(measured_m, params.sigma_m, t_s);
    }
    let known = track.range.range_m(t_s);
    tracker.lased |= echo_m.is_some();
    // A radar's range alone, which may be another's, is not good enough to fire by.
    tracker.range_m = known
        .filter(|(_, sigma_m)| tracker.lased && *sigma_m < RANGE_KNOWN_M)
        .map(|(range_m, _)| range_m);
}

/// What a pulse along the laser's axis may meet: anything that flies or falls in its field, and the
/// city on its axis.
fn lit_surfaces(
    params: &RangeFinderParams,
    environment: &Environment,
    optics: &Optics,
    uavs: &Query<(&Uav, &Flight)>,
) -> Vec<LitSurface> {
    let pose = optics.laser;
    let axis_enu = pose.q_enu_cam * DVec3::Z;
    let flying = uavs.iter().filter_map(|(uav, flight)| {
        let r_enu_m = flight.aim_enu_m();
        let r_cam_m = pose.q_enu_cam.inverse() * (r_enu_m - pose.r_enu_m);
        let lit = r_cam_m.z > 0.0
            && r_cam_m.truncate().length() < params.half_field_rad * r_cam_m.z
            && environment.line_of_sight(pose.r_enu_m, r_enu_m) == LineOfSight::Clear;
        let [_, width_m, height_m] = uav.size_m;
        lit.then(|| LitSurface {
            range_m: r_enu_m.distance(pose.r_enu_m),
            area_m2: width_m * height_m,
            reflectance: REFLECTANCE,
        })
    });
    let city = environment
        .city
        .dsm
        .first_hit(pose.r_enu_m, axis_enu, FAR_M)
        .map(|range_m| LitSurface {
            range_m,
            area_m2: f64::INFINITY,
            reflectance: REFLECTANCE,
        });
    flying.chain(city).collect()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::tracking::table::Sighting;

    const CLOCK: SimClock = SimClock {
        tick: 0,
        tick_hz: 960,
    };
    /// Ticks from one frame of the cameras to the next.
    const FRAME: u32 = 16;

    fn params() -> TrackerParams {
        TrackerParams {
            nearest_to_centre: false,
            linear_angles: false,
            centre_sigma_px: 0.5,
            min_quality: 0.5,
            min_score: 0.0,
            switch_ratio: 2.0,
            r_asset_enu_m: DVec3::ZERO,
            aim: None,
            lock_radius_px: 5.0,
            lock_dwell_s: 0.1,
            break_radius_px: 20.0,
            patience_s: [patience_s(60.0); 3],
        }
    }

    fn situation(params: &TrackerParams, tick: u32) -> Situation<'_> {
        Situation {
            tick: u64::from(tick),
            clock: &CLOCK,
            params,
            dsm: None,
            r_station_enu_m: DVec3::ZERO,
        }
    }

    /// A frame of the precise camera that shows UAVs where they are, their ranges known.
    fn see(tracker: &mut Tracker, t_s: f64, uavs_enu_m: &[DVec3]) {
        let sighting = |r_enu_m: &DVec3| Sighting {
            az_el_rad: los_to_az_el(*r_enu_m),
            sigma_rad: 1e-5,
            size_rad: 6e-4,
            score: 0.9,
            label: 0,
        };
        tracker.table.update(&CameraLook {
            tier: Tier::Precise as usize,
            t_s,
            sightings: &uavs_enu_m.iter().map(sighting).collect::<Vec<_>>(),
            in_view: &|_| true,
            start_tracks: true,
        });
        for track in &mut tracker.table.tracks {
            let los = az_el_to_los(track.filter.predicted(t_s).az_el_rad());
            if let Some(r_enu_m) = uavs_enu_m.iter().find(|r| r.angle_between(los) < 1e-3) {
                track.ranged(r_enu_m.length(), 0.5, t_s);
            }
        }
    }

    /// A UAV 600 m away that sinks at `sink_mps`, after a second is fired at, and from then on falls with
    /// `fall_mps2` for two: why it is no target any more.
    fn given_up(sink_mps: f64, fall_mps2: f64) -> Option<String> {
        let params = params();
        let mut tracker = Tracker::default();
        for frame in 0..180_u32 {
            let t_s = f64::from(frame) / 60.0;
            let sunk_m = sink_mps * t_s + 0.5 * fall_mps2 * (t_s - 1.0).max(0.0).powi(2);
            see(&mut tracker, t_s, &[DVec3::new(0.0, 600.0, 80.0 - sunk_m)]);
            if frame == 30 {
                let id = tracker.table.tracks[0].id;
                tracker.acquire(u64::from(frame * FRAME), id, "test");
                tracker.lased = true;
            }
            if frame > 30 {
                let now = situation(&params, frame * FRAME);
                step(&now, &mut tracker, frame == 58, false);
                if tracker.target.is_none() {
                    return tracker.changes.last().map(|change| change.reason.clone());
                }
            }
        }
        None
    }

    #[test]
    fn a_lost_target_gives_way_to_a_greater_threat() {
        let params = params();
        let mut tracker = Tracker::default();
        let (mut first, mut changed_s) = (0, None);
        for frame in 0..240_u32 {
            let t_s = f64::from(frame) / 60.0;
            // One flies away and is hidden from 1 s on, the other comes straight at the asset.
            let leaves = DVec3::new(60.0, 700.0 + 5.0 * t_s, 80.0);
            let comes = DVec3::new(-60.0, 500.0 - 20.0 * t_s, 80.0);
            let both = [comes, leaves];
            see(&mut tracker, t_s, &both[..if frame < 60 { 2 } else { 1 }]);
            if frame == 59 {
                let right = |track: &&Track| track.filter.predicted(t_s).az_el_rad().x > 0.0;
                first = tracker.table.tracks.iter().find(right).unwrap().id;
                tracker.acquire(u64::from(frame * FRAME), first, "test");
                tracker.change(u64::from(frame * FRAME), TrackingState::Lost, "test");
            }
            if frame > 59 && changed_s.is_none() {
                step(
                    &situation(&params, frame * FRAME),
                    &mut tracker,
                    false,
                    true,
                );
                if tracker.target != Some(first) {
                    changed_s = Some(t_s);
                }
            }
        }
        assert_eq!(
            tracker.state,
            TrackingState::Acquire,
            "{:?}",
            tracker.changes
        );
        let waited_s = changed_s.unwrap() - 1.0;
        assert!((RIVAL_S..RIVAL_S + 0.1).contains(&waited_s), "{waited_s}");
    }

    #[test]
    fn silence_begins_when_the_news_arrives() {
        let params = params();
        let mut tracker = Tracker::default();
        // Exposed at the start, known 0.4 s later: a slow detector is no lost target.
        tracker.error[Tier::Coarse as usize] = Some(BoresightError {
            exposure_tick: 0,
            available_tick: 384,
            angle_rad: DVec2::ZERO,
            distance_px: 0.0,
            half_side_px: 4.0,
        });
        let lost = |tick| situation(&params, tick).lost_by(&tracker, Tier::Coarse);
        assert_eq!([390, 624, 625].map(lost), [false, false, true]);
    }

    #[test]
    fn a_slow_camera_may_miss_a_frame() {
        assert_eq!([960.0, 60.0, 10.0].map(patience_s), [0.25; 3]);
        // At 4 Hz and below a quarter of a second holds no frame but the last.
        assert!(patience_s(4.0) > 2.0 / 4.0 && patience_s(1.0) > 2.0);
    }

    #[test]
    fn a_diving_target_is_not_taken_for_one_that_falls() {
        assert_eq!(given_up(8.0, 0.0), None);
        assert_eq!(given_up(0.0, 0.0), None);
        assert_eq!(given_up(0.0, 9.8).as_deref(), Some("the target falls"));
        assert_eq!(given_up(8.0, 9.8).as_deref(), Some("the target falls"));
    }
}
