//! Interlocks and the firing command.

use crate::components::beam::FireCommand;
use crate::components::capture::{SensorCamera, StationCameras, Tier};
use crate::components::engage::{Burst, Interlocks, Rules};
use crate::components::environment::Environment;
use crate::components::mount::Mount;
use crate::components::network::Tasking;
use crate::components::operator::{Command, Operator};
use crate::components::run::SimClock;
use crate::components::track::{BoresightError, Tracker, TrackingState};
use crate::models::decision::tracker;
use crate::models::engage::interlock::{FAR_M, beam_half_angle_rad, bundle, faces_sun, in_beam};
use crate::models::ground::dsm::HitKind;
use crate::models::maths::kinematics::{az_el_to_los, los_to_az_el};
use crate::models::tracking::estimation::LosFilter;
use crate::models::tracking::table::{Track, separation_rad};
use bevy::ecs::query::QueryData;
use bevy::prelude::*;
use glam::{DVec2, DVec3};

/// Why a beam may not go where it points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Obstruction {
    /// Something stands before the target.
    Blocked,
    /// Something solid behind it is none that may be there, or too near.
    Solid,
    /// Nothing is behind it, and that may not be.
    Sky,
}

impl Obstruction {
    /// The reason, where it is so now.
    fn now(self) -> &'static str {
        match self {
            Self::Blocked => "line of sight blocked",
            Self::Solid => "solid backstop",
            Self::Sky => "open sky behind",
        }
    }

    /// The reason, where it will be so within the look ahead.
    fn ahead(self) -> &'static str {
        match self {
            Self::Blocked => "line of sight will be blocked",
            Self::Solid => "solid backstop ahead",
            Self::Sky => "open sky ahead",
        }
    }
}

impl Rules {
    /// Whether the target, if there is one, is likely enough a UAV.
    fn takes_for_uav(&self, tracker: &tracker::Tracker) -> bool {
        (tracker.target_uav_probability()).is_none_or(|belief| belief >= self.min_uav_probability)
    }

    /// Whether the target is too large for a UAV, by the range finder: an aircraft with people in it is.
    fn is_outsize(&self, tracker: &tracker::Tracker, t_s: f64) -> bool {
        let span_m = (tracker.target_track()).and_then(|track| track.measured_span_m(t_s));
        span_m.is_some_and(|span_m| span_m > self.max_span_m)
    }

    /// Why a beam on a target at `range_m` [m] may not be fired, given what it would meet there or
    /// beyond: range [m] and kind, or `None` for sky.
    pub fn refusal(&self, range_m: f64, hit: Option<(f64, HitKind)>) -> Option<Obstruction> {
        let Some((hit_m, kind)) = hit else {
            return (!self.allow_sky).then_some(Obstruction::Sky);
        };
        let allowed = match kind {
            HitKind::Ground => self.allow_ground,
            HitKind::Building => self.allow_building,
        };
        if hit_m <= range_m {
            Some(Obstruction::Blocked)
        } else if !allowed || hit_m < range_m + self.min_clear_range_m {
            Some(Obstruction::Solid)
        } else {
            None
        }
    }
}

/// How often the way to the target, and behind it, is looked over [Hz]: far more often than
/// anything comes up within the look ahead.
const SURROUNDINGS_HZ: u32 = 120;
/// Instants at which the line of sight ahead is checked.
const LOOKS_AHEAD: u32 = 3;
/// Time without news of the target from the precise camera after which the laser is held [s], and least number of its frames.
const UNSEEN_S: f64 = 0.05;
const UNSEEN_FRAMES: f64 = 2.0;
/// Hits that make a track an object to be spared: a false alarm seldom comes back.
const OBJECT_HITS: u32 = 3;
/// Time since the last hit for which it does [s].
const OBJECT_S: f64 = 1.0;
/// Size from which on parts of a target are boxed for themselves [px]; how far from its middle they are, over its size; and by how
/// much their rates differ at most [rad/s], since the box jumps: a bird that crosses the picture is faster.
const PARTS_PX: f64 = 48.0;
const PART_SHARE: f64 = 0.6;
const PART_RADPS: f64 = 4e-3;

/// What decides where a station's beam may go.
pub(crate) struct Way<'a> {
    pub(crate) rules: &'a Rules,
    pub(crate) environment: &'a Environment,
    pub(crate) r_enu_m: DVec3,
    /// Where all stations are, this one among them [m].
    pub(crate) stations_enu_m: &'a [DVec3],
}

impl Way<'_> {
    /// Whether a direction passes another station too closely.
    fn at_station(&self, az_el_rad: DVec2) -> bool {
        let others = self.stations_enu_m.iter();
        others
            .filter(|other| **other != self.r_enu_m)
            .any(|other| passes(*other - self.r_enu_m, az_el_to_los(az_el_rad)))
    }

    /// Whether a direction meets what is protected.
    fn protected(&self, az_el_rad: DVec2) -> bool {
        let mut zones = self.rules.keep_out.iter();
        zones.any(|zone| zone.meets(self.r_enu_m, az_el_rad, FAR_M))
    }

    /// Whether a target at a place [m] could be fired at as far as the way there and what lies behind it goes.
    pub(crate) fn is_open(&self, r_target_enu_m: DVec3) -> bool {
        let to_m = r_target_enu_m - self.r_enu_m;
        let (ray_enu, az_el_rad) = (to_m.normalize(), los_to_az_el(to_m));
        let dsm = &self.environment.city.dsm;
        let hit = dsm.first_hit_kind(self.r_enu_m, ray_enu, FAR_M);
        self.rules.refusal(to_m.length(), hit).is_none()
            && !self.environment.in_cloud(r_target_enu_m)
            && !self.protected(az_el_rad)
            && !self.at_station(az_el_rad)
    }

    /// Adds the reasons not to fire along the line of sight of `filter` at a target at `range_m` [m], now and within
    /// the look ahead. A bundle of rays of half angle `spread_rad` [rad] stands for the beam.
    fn look(
        &self,
        filter: &LosFilter,
        range_m: f64,
        spread_rad: f64,
        t_s: f64,
        refused: &mut Vec<&'static str>,
    ) {
        let los = filter.predicted(t_s);
        let direction = az_el_to_los(los.az_el_rad());
        if self
            .environment
            .in_cloud(self.r_enu_m + range_m * direction)
        {
            refused.push(Obstruction::Blocked.now());
        }
        let dsm = &self.environment.city.dsm;
        let obstructed = |az_el_rad: DVec2| {
            let hits = bundle(az_el_rad, spread_rad)
                .map(|ray_enu| dsm.first_hit_kind(self.r_enu_m, ray_enu, FAR_M));
            hits.map(|hit| self.rules.refusal(range_m, hit))
        };
        let mut refuse = |reason: &'static str| {
            if !refused.contains(&reason) {
                refused.push(reason);
            }
        };
        for obstruction in obstructed(los.az_el_rad()).into_iter().flatten() {
            refuse(obstruction.now());
        }
        if self.protected(los.az_el_rad()) {
            refuse("keep-out zone");
        }
        if self.at_station(los.az_el_rad()) {
            refuse("another station in the line of fire");
        }
        // The laser must be off before the line of sight gets anywhere it must not fire.
        for i in 1..=LOOKS_AHEAD {
            let lead_s = self.rules.look_ahead_s * f64::from(i) / f64::from(LOOKS_AHEAD);
            let at = filter.predicted(t_s + lead_s).az_el_rad();
            for obstruction in obstructed(at).into_iter().flatten() {
                refuse(obstruction.ahead());
            }
            if self.protected(at) {
                refuse("keep-out zone ahead");
            }
            if self.at_station(at) {
                refuse("another station ahead in the line of fire");
            }
        }
    }
}

/// A station as its fire is decided.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct Firing {
    mount: &'static Mount,
    operator: &'static Operator,
    rules: &'static mut Rules,
    tracker: &'static Tracker,
    tasking: &'static Tasking,
    cameras: &'static StationCameras,
    interlocks: &'static mut Interlocks,
    burst: &'static mut Burst,
    command: &'static mut FireCommand,
}

/// How close to another station a beam must not pass [m]: mount, mast and crew, whatever stands behind or before.
const STATION_CLEARANCE_M: f64 = 10.0;

/// Whether a ray passes another station, which is at `to_enu_m` [m] from its origin, too closely.
fn passes(to_enu_m: DVec3, ray_enu: DVec3) -> bool {
    let along_m = to_enu_m.dot(ray_enu);
    let nearest_m = to_enu_m - along_m.max(0.0) * ray_enu;
    nearest_m.length() < STATION_CLEARANCE_M
}

/// Checks every interlock and sets the firing command for the next tick.
pub fn decide_fire(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    cameras: Query<&SensorCamera>,
    mut stations: Query<Firing>,
) {
    let stations_enu_m: Vec<DVec3> = (stations.iter())
        .map(|station| station.mount.r_enu_m)
        .collect();
    for station in &mut stations {
        decide_station(&clock, &environment, &cameras, &stations_enu_m, station);
    }
}

/// Checks the interlocks of one station and sets its firing command.
fn decide_station(
    clock: &SimClock,
    environment: &Environment,
    cameras: &Query<&SensorCamera>,
    stations_enu_m: &[DVec3],
    station: FiringItem,
) {
    let FiringItem {
        mount,
        operator,
        mut rules,
        tracker,
        tasking,
        cameras: own,
        mut interlocks,
        mut burst,
        mut command,
    } = station;
    for command in &operator.due {
        if let Command::Fire(may) = command {
            rules.authorised = *may;
        }
    }
    let rules = &*rules;
    let Interlocks {
        reasons,
        looked_over,
    } = &mut *interlocks;
    reasons.clear();
    if !rules.authorised {
        reasons.push("not authorised");
    }
    if tracker.state != TrackingState::Engage {
        reasons.push("track not stable");
        *looked_over = None;
    }
    let precise = cameras
        .iter_many(own.entities())
        .find(|camera| camera.tier == Tier::Precise);
    if let Some(error) = tracker.error[Tier::Precise] {
        if error.offset_px.length() > error.half_side_px {
            reasons.push("aim point outside the target");
        }
        if precise.is_some_and(|camera| is_unseen(clock, &error, camera.period_ticks)) {
            reasons.push("target not seen");
        }
    }
    if !rules.takes_for_uav(tracker) {
        reasons.push("not recognised as a UAV");
    }
    if rules.is_outsize(tracker, clock.t_s()) {
        reasons.push("too large for a UAV");
    }
    if !tracker.designated && tracker.target.is_some_and(|id| !tasking.permits(id)) {
        reasons.push("another station's target");
    }
    match (tracker.target_track(), tracker.range_m) {
        (Some(track), Some(range_m)) if tracker.state == TrackingState::Engage => {
            let known = looked_over.as_ref().map(|(id, _)| *id);
            if known != Some(track.id) || clock.due(SURROUNDINGS_HZ) {
                // The beam's whole width must be clear: look around the line by some pixels.
                let way = Way {
                    rules,
                    environment,
                    r_enu_m: mount.r_enu_m,
                    stations_enu_m,
                };
                let spread_rad = precise.map_or(1e-4, |camera| 4.0 * camera.pinhole.ifov_rad());
                let (_, refused) = looked_over.insert((track.id, Vec::new()));
                way.look(&track.filter, range_m, spread_rad, clock.t_s(), refused);
            }
            reasons.extend(looked_over.iter().flat_map(|(_, refused)| refused));
            look_along(
                clock,
                environment,
                rules,
                tracker,
                (track, range_m),
                reasons,
            );
            command.focus_range_m = range_m;
        }
        (Some(_), None) => reasons.push("no range"),
        // Without a track nothing of the above can be checked.
        (None, _) if tracker.state == TrackingState::Engage => reasons.push("no track"),
        _ => {}
    }
    if burst.pauses(rules, clock) {
        reasons.push("burst limit");
    }
    command.fire = reasons.is_empty();
    burst.began = match (command.fire, burst.began) {
        (true, None) => Some(clock.tick),
        (true, began) => began,
        (false, _) => None,
    };
}

/// Whether the precise camera, with so many ticks from frame to frame, has had no news of the target for so long that the
/// mount may follow something it is not.
fn is_unseen(clock: &SimClock, error: &BoresightError, period_ticks: u64) -> bool {
    let silent_s = clock.at_s(clock.tick.saturating_sub(error.available_tick));
    silent_s > UNSEEN_S.max(UNSEEN_FRAMES * clock.at_s(period_ticks))
}

/// Whether a track is something to be spared: seen often enough and lately, and no part of what stands
/// solid behind it. What stands in clear sky, a balloon or a kestrel, is spared whatever it is taken for.
fn is_object(track: &Track, t_s: f64) -> bool {
    track.total_hits() >= OBJECT_HITS
        && t_s - track.seen_s() < OBJECT_S
        && (track.conduct.in_sky || !track.conduct.is_scenery())
}

/// Whether a track is a part of a large target: smaller, on its picture, and it moves along.
fn is_part(track: &Track, target: &Track, t_s: f64) -> bool {
    let [of_target, own] = [target, track].map(|track| track.filter.predicted(t_s).az_el_rad());
    target.evidence.best_px() > PARTS_PX
        && track.size_rad < target.size_rad
        && separation_rad(of_target, own) < PART_SHARE * target.size_rad
        && (track.rates(t_s).0 - target.rates(t_s).0).length() < PART_RADPS
}

/// Adds the reasons not to fire at a track that hold in this tick: the sun, others in the beam, its fall.
fn look_along(
    clock: &SimClock,
    environment: &Environment,
    rules: &Rules,
    tracker: &Tracker,
    (track, range_m): (&Track, f64),
    refused: &mut Vec<&'static str>,
) {
    let t_s = clock.t_s();
    let los = track.filter.predicted(t_s);
    let direction = az_el_to_los(los.az_el_rad());
    if faces_sun(
        direction,
        environment.backdrop.sun_dir_enu,
        rules.sun_exclusion_rad,
    ) {
        refused.push("sun behind the target");
    }
    let mut others = (tracker.table.tracks.iter()).filter(|other| {
        other.id != track.id && is_object(other, t_s) && !is_part(other, track, t_s)
    });
    if others.any(|other| {
        let nearest_m = other.range.nearest_m(t_s).unwrap_or(range_m);
        let beam_rad = beam_half_angle_rad(rules.beam_radius_m, range_m, nearest_m);
        in_beam(&los, &other.filter.predicted(t_s), other.size_rad, beam_rad)
    }) {
        refused.push("another object in the beam");
    }
    if tracker.falling_since.is_some() {
        refused.push("target falls");
    }
}

impl Burst {
    /// Whether the laser must pause after a burst that ran into its limit, maybe in this tick.
    fn pauses(&mut self, rules: &Rules, clock: &SimClock) -> bool {
        let elapsed_s = |since: u64| clock.at_s(clock.tick - since);
        if self
            .began
            .is_some_and(|began| elapsed_s(began) >= rules.max_burst_s)
        {
            self.exhausted = Some(clock.tick);
        }
        self.exhausted
            .is_some_and(|end| elapsed_s(end) < rules.pause_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::tracking::evidence::EvidenceParams;
    use crate::models::tracking::recognition::Recognition;
    use crate::models::tracking::table::{CameraLook, Lased, Sighting, TrackTable};

    fn rules(allow: [bool; 3]) -> Rules {
        Rules {
            authorised: true,
            keep_out: Vec::new(),
            sun_exclusion_rad: 0.1,
            min_uav_probability: 0.7,
            max_span_m: 4.0,
            look_ahead_s: 0.3,
            beam_radius_m: 0.05,
            allow_sky: allow[0],
            allow_ground: allow[1],
            allow_building: allow[2],
            min_clear_range_m: 500.0,
            max_burst_s: 15.0,
            pause_s: 1.0,
        }
    }

    /// A table with one track, seen so many times with a score until 0 s.
    fn seen(times: u32, score: f64) -> TrackTable {
        seen_by(5e-5, times, score)
    }

    /// As `seen`, by a camera of this angle a pixel [rad].
    fn seen_by(ifov_rad: f64, times: u32, score: f64) -> TrackTable {
        flown([0.1, 0.0], 1e-3, ifov_rad, times, score)
    }

    /// As `seen_by`, of what is at an azimuth [rad] at 0 s, turns at a rate [rad/s] and is so large [rad].
    fn flown(
        [az_rad, rate_radps]: [f64; 2],
        size_rad: f64,
        ifov_rad: f64,
        times: u32,
        score: f64,
    ) -> TrackTable {
        let mut table = TrackTable::default();
        for i in 1..=times {
            let t_s = (f64::from(i) - f64::from(times)) / 60.0;
            let sighting = Sighting {
                az_el_rad: DVec2::new(az_rad + rate_radps * t_s, 0.1),
                sigma_rad: 1e-5,
                size_rad,
                score,
                label: 0,
                weak: false,
            };
            table.update(&CameraLook {
                tier: Tier::Search,
                t_s,
                ifov_rad,
                reads: &EvidenceParams::default(),
                sightings: &[sighting],
                in_view: &|_| true,
                start_tracks: true,
            });
        }
        table
    }

    #[test]
    fn the_laser_is_held_while_the_target_is_not_seen() {
        let unseen = |since_ticks: u64, period_ticks: u64| {
            let clock = SimClock {
                tick: 1000 + since_ticks,
                tick_hz: 960,
            };
            let error = BoresightError {
                exposure_tick: 900,
                available_tick: 1000,
                angle_rad: DVec2::ZERO,
                offset_px: DVec2::ZERO,
                half_side_px: 4.0,
            };
            is_unseen(&clock, &error, period_ticks)
        };
        assert_eq!([48, 49].map(|since| unseen(since, 8)), [false, true]);
        // A camera of 10 Hz may miss a frame.
        assert_eq!([192, 193].map(|since| unseen(since, 96)), [false, true]);
    }

    #[test]
    fn scenery_is_not_spared_but_what_stands_in_the_sky_is() {
        let mut table = seen(OBJECT_HITS, 0.5);
        let track = &mut table.tracks[0];
        assert!(is_object(track, 0.5) && !is_object(track, 1.5));
        track.conduct.in_scenery = true;
        assert!(!is_object(track, 0.5));
        track.conduct.in_sky = true;
        assert!(is_object(track, 0.5));
        assert!(!is_object(&seen(OBJECT_HITS - 1, 0.5).tracks[0], 0.5));
    }

    #[test]
    fn a_part_of_a_large_target_is_no_other_object() {
        const RATE_RADPS: f64 = 0.02;
        let track = |az_rad: f64, rate_radps: f64, size_rad: f64, ifov_rad: f64| {
            let mut table = flown([az_rad, rate_radps], size_rad, ifov_rad, 60, 0.9);
            table.tracks.remove(0)
        };
        let target = track(0.1, RATE_RADPS, 4e-3, 3e-5);
        let part = |az_rad, rate_radps, size_rad| {
            is_part(&track(az_rad, rate_radps, size_rad, 3e-5), &target, 0.0)
        };
        assert!(part(0.1015, RATE_RADPS, 1e-3));
        // Beside it, as large, or on another course it is something else.
        assert!(!part(0.103, RATE_RADPS, 1e-3));
        assert!(!part(0.1015, RATE_RADPS, 5e-3));
        assert!(!part(0.1015, RATE_RADPS + 8e-3, 1e-3));
        // A target of 20 px has no parts.
        let small = track(0.1, RATE_RADPS, 6e-4, 3e-5);
        let close = track(0.1001, RATE_RADPS, 3e-4, 3e-5);
        assert!(!is_part(&close, &small, 0.0));
    }

    #[test]
    fn what_is_larger_than_a_uav_is_not_fired_at() {
        // A box of 1 mrad at the range of an echo [m], so long after it [s].
        let outsize = |range_m: f64, since_s: f64| {
            let mut table = seen(6, 0.9);
            let t_s = 0.0;
            table.tracks[0].lased = Some(Lased {
                t_s,
                range_m,
                sigma_m: 0.5,
            });
            let tracker = tracker::Tracker {
                target: Some(table.tracks[0].id),
                table,
                ..tracker::Tracker::default()
            };
            rules([true; 3]).is_outsize(&tracker, since_s)
        };
        assert!(!outsize(3900.0, 0.1) && outsize(4100.0, 0.1));
        // What is no longer known counts no more.
        assert!(!outsize(4100.0, 1.5));
    }

    #[test]
    fn what_is_recognised_as_no_uav_is_not_fired_at() {
        // Nobody has looked at its last second yet: the tracker's own evidence counts.
        let takes = |table: TrackTable, radar_log_odds: f64| {
            let tracker = tracker::Tracker {
                target: Some(table.tracks[0].id),
                // As it was all along.
                mean_log_odds: table.tracks[0].log_odds(),
                table,
                radar_log_odds,
                ..tracker::Tracker::default()
            };
            rules([true; 3]).takes_for_uav(&tracker)
        };
        assert!(takes(seen(1, 0.9), 0.0) && !takes(seen(1, 0.15), 0.0));
        // But what something has passed waits for the recogniser's word.
        let mut passed = seen(1, 0.9);
        passed.tracks[0].passed_s = Some(0.9);
        assert!(!takes(passed, 0.0));
        // Nor is what its detections name a bird, however sure the recogniser and the radar.
        let params = EvidenceParams {
            other_classes: 0b10,
            ..EvidenceParams::default()
        };
        for (names_none, fires) in [(false, true), (true, false)] {
            let mut named = seen(1, 0.9);
            let track = &mut named.tracks[0];
            for t_s in [0.5, 1.0] {
                (track.evidence).on_look(&params, (1.0, Some(names_none)), 30.0, t_s);
            }
            track.recognition = Some(Recognition {
                probabilities: [0.99, 0.01, 0.0, 0.0, 0.0, 0.0],
                t_s: 1.0,
            });
            assert_eq!(takes(named, 0.5), fires);
        }
        // 20 px long, and a dot of 5 px, of which nobody can be so sure.
        for (ifov_rad, p_uav, fires) in [
            (5e-5, 0.69, false),
            (5e-5, 0.71, true),
            (2e-4, 0.91, false),
            (2e-4, 0.95, true),
        ] {
            let judged = || {
                let mut table = seen_by(ifov_rad, 1, 0.9);
                table.tracks[0].recognition = Some(Recognition {
                    probabilities: [p_uav, 1.0 - p_uav, 0.0, 0.0, 0.0, 0.0],
                    t_s: 1.0,
                });
                table
            };
            assert_eq!(takes(judged(), 0.0), fires, "{p_uav}");
            // What the radar says for it counts as well.
            assert!(takes(judged(), 1.0), "{p_uav}");
        }
    }

    #[test]
    fn a_beam_keeps_clear_of_another_station() {
        let ray_enu = DVec3::new(0.6, 0.8, 0.0);
        let aside = DVec3::new(0.8, -0.6, 0.0);
        for (along_m, aside_m, close) in [
            (300.0, 9.0, true),
            (300.0, 11.0, false),
            (4000.0, 9.0, true),
            // Behind the mount.
            (-300.0, 0.0, false),
        ] {
            let to_m = along_m * ray_enu + aside_m * aside;
            assert_eq!(passes(to_m, ray_enu), close, "{along_m} {aside_m}");
        }
    }

    #[test]
    fn only_what_is_listed_may_lie_behind() {
        let far = |kind| Some((1600.0, kind));
        let behind = [None, far(HitKind::Ground), far(HitKind::Building)];
        for allow in [
            [true, false, false],
            [false, true, false],
            [false, false, true],
        ] {
            for (allowed, hit) in allow.into_iter().zip(behind) {
                let refused = rules(allow).refusal(1000.0, hit);
                assert_eq!(refused.is_none(), allowed, "{allow:?} {hit:?}");
            }
        }
        let near = |range_m| rules([true; 3]).refusal(1000.0, Some((range_m, HitKind::Ground)));
        assert_eq!(near(1000.0), Some(Obstruction::Blocked));
        assert_eq!(near(1499.0), Some(Obstruction::Solid));
        assert_eq!(near(1500.0), None);
    }
}
