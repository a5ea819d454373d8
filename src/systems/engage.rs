//! Interlocks and the firing command.

use crate::components::beam::FireCommand;
use crate::components::camera::{SensorCamera, Tier};
use crate::components::clock::SimClock;
use crate::components::environment::Environment;
use crate::components::station::Mount;
use crate::components::track::{Tracker, TrackingState};
use crate::models::dsm::HitKind;
use crate::models::kinematics::az_el_to_los;
use bevy::prelude::*;
use glam::DVec2;

/// A sector the beam never enters.
#[derive(Clone, Debug, PartialEq)]
pub struct KeepOut {
    /// What is protected.
    pub name: String,
    /// Azimuths from, to, clockwise [rad]; from > to passes through north.
    pub azimuth_rad: [f64; 2],
    /// Elevations from, to [rad].
    pub elevation_rad: [f64; 2],
}

impl KeepOut {
    /// Whether a direction (azimuth, elevation) lies in the zone.
    pub fn contains(&self, az_el_rad: DVec2) -> bool {
        use std::f64::consts::TAU;
        let [from, to] = self.azimuth_rad;
        let span = (to - from).rem_euclid(TAU);
        // A zone from 0 to 360 degrees is the whole circle.
        let whole = span == 0.0 && from != to;
        let inside = whole || (az_el_rad.x - from).rem_euclid(TAU) <= span;
        inside && (self.elevation_rad[0]..=self.elevation_rad[1]).contains(&az_el_rad.y)
    }
}

/// The rules of engagement of a run.
#[derive(Resource, Clone, Debug)]
pub struct Rules {
    /// Whether the laser may fire at all.
    pub authorised: bool,
    /// Protected sectors.
    pub keep_out: Vec<KeepOut>,
    /// Whether open sky may lie behind the target.
    pub allow_sky: bool,
    /// Whether the ground may.
    pub allow_ground: bool,
    /// Whether a building or a tree may.
    pub allow_building: bool,
    /// How far behind the target what is solid must be [m].
    pub min_clear_range_m: f64,
    /// Longest burst [s].
    pub max_burst_s: f64,
    /// Least pause after a burst of that length [s].
    pub pause_s: f64,
}

impl Rules {
    /// Why a beam on a target at `range_m` [m] may not be fired, given what it would meet there or
    /// beyond: range [m] and kind, or `None` for sky.
    fn refusal(&self, range_m: f64, hit: Option<(f64, HitKind)>) -> Option<&'static str> {
        let (hit_m, kind) = match hit {
            Some(hit) => hit,
            None => return (!self.allow_sky).then_some("open sky behind"),
        };
        let allowed = match kind {
            HitKind::Ground => self.allow_ground,
            HitKind::Building => self.allow_building,
        };
        if hit_m <= range_m {
            Some("line of sight blocked")
        } else if !allowed || hit_m < range_m + self.min_clear_range_m {
            Some("solid backstop")
        } else {
            None
        }
    }
}

/// Why the laser does not fire; empty while it may.
#[derive(Resource, Clone, Debug, Default)]
pub struct Interlocks(pub Vec<&'static str>);

/// Burst bookkeeping.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct Burst {
    /// First tick of the present burst.
    pub began: Option<u64>,
    /// Last tick of a burst that ran into its limit.
    pub exhausted: Option<u64>,
}

/// How far a beam that misses is followed [m].
const FAR_M: f64 = 20_000.0;
/// A target that sinks faster than this has been neutralised as far as the station can tell
/// [m/s]: no trajectory in the catalogue dives so with its rotors running.
const FALLING_MPS: f64 = 6.0;

/// Checks every interlock and sets the firing command for the next tick.
pub fn decide_fire(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    rules: Res<Rules>,
    tracker: Res<Tracker>,
    cameras: Query<&SensorCamera>,
    mut interlocks: ResMut<Interlocks>,
    mut burst: ResMut<Burst>,
    station: Single<(&Mount, &mut FireCommand)>,
) {
    let (mount, mut command) = station.into_inner();
    let reasons = &mut interlocks.0;
    reasons.clear();
    if !rules.authorised {
        reasons.push("not authorised");
    }
    if tracker.state != TrackingState::Engage {
        reasons.push("track not stable");
    }
    if let Some(error) = tracker.error[Tier::Precise as usize]
        && error.distance_px > error.half_side_px
    {
        reasons.push("aim point outside the target");
    }
    match (tracker.target_track(), tracker.range_m) {
        (Some(track), Some(range_m)) if tracker.state == TrackingState::Engage => {
            let los = track.filter.predicted(clock.t_s());
            let direction = az_el_to_los(los.az_el_rad());
            // The beam's whole width must be clear: look around the line by half a pixel field.
            let spread = cameras
                .iter()
                .find(|camera| camera.tier == Tier::Precise)
                .map_or(1e-4, |camera| 4.0 * camera.pinhole.ifov_rad());
            if environment.in_cloud(mount.r_enu_m + range_m * direction) {
                reasons.push("line of sight blocked");
            }
            for (x, y) in [(0.0, 0.0), (spread, 0.0), (-spread, 0.0), (0.0, -spread)] {
                let around = az_el_to_los(los.az_el_rad() + DVec2::new(x, y));
                let dsm = &environment.city.dsm;
                let hit = dsm.first_hit_kind(mount.r_enu_m, around, FAR_M);
                if let Some(reason) = rules.refusal(range_m, hit)
                    && !reasons.contains(&reason)
                {
                    reasons.push(reason);
                }
            }
            if rules
                .keep_out
                .iter()
                .any(|zone| zone.contains(los.az_el_rad()))
            {
                reasons.push("keep-out zone");
            }
            if -los.el_rate_radps * range_m * direction.truncate().length() > FALLING_MPS {
                reasons.push("target falls");
            }
            command.focus_range_m = range_m;
        }
        (Some(_), None) => reasons.push("no range"),
        _ => {}
    }
    let elapsed_s = |since: u64| clock.at_s(clock.tick - since);
    if burst
        .began
        .is_some_and(|began| elapsed_s(began) >= rules.max_burst_s)
    {
        burst.exhausted = Some(clock.tick);
    }
    if burst
        .exhausted
        .is_some_and(|end| elapsed_s(end) < rules.pause_s)
    {
        reasons.push("burst limit");
    }
    command.fire = reasons.is_empty();
    burst.began = match (command.fire, burst.began) {
        (true, None) => Some(clock.tick),
        (true, began) => began,
        (false, _) => None,
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_listed_may_lie_behind() {
        let rules = |allow: [bool; 3]| Rules {
            authorised: true,
            keep_out: Vec::new(),
            allow_sky: allow[0],
            allow_ground: allow[1],
            allow_building: allow[2],
            min_clear_range_m: 500.0,
            max_burst_s: 15.0,
            pause_s: 1.0,
        };
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
        assert_eq!(near(1000.0), Some("line of sight blocked"));
        assert_eq!(near(1499.0), Some("solid backstop"));
        assert_eq!(near(1500.0), None);
    }

    #[test]
    fn a_zone_may_pass_through_north() {
        let zone = KeepOut {
            name: "corridor".into(),
            azimuth_rad: [6.0, 0.5],
            elevation_rad: [0.0, 1.0],
        };
        assert!(zone.contains(DVec2::new(-0.1, 0.5)));
        assert!(zone.contains(DVec2::new(0.3, 0.5)));
        assert!(!zone.contains(DVec2::new(1.0, 0.5)));
        assert!(!zone.contains(DVec2::new(0.3, -0.1)));
    }
}
