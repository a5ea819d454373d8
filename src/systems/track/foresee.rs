//! What lies ahead of a track: the part aimed at, and buildings that will hide it.

use crate::components::environment::Environment;
use crate::components::mount::Mount;
use crate::components::run::SimClock;
use crate::components::track::{Tracker, TrackerParams};
use crate::models::decision::situation::WEIGHING_HZ;
use crate::models::flight::uav::{AimPart, aim_offset_enu_m};
use crate::models::maths::kinematics::{los_to_az_el, wrap_pi};
use crate::models::tracking::table::Occlusion;
use bevy::prelude::*;
use glam::{DVec2, DVec3};

/// Foresight of occlusions [s].
const FORESIGHT_S: f64 = 4.0;
/// What was seen so lately is not hidden [s].
const SEEN_S: f64 = 0.15;

/// Fire without effect for so long [s] makes the aim walk over a large body, beside whose middle that of its picture may
/// lie: round it in steps of this [m], where discs of the 5 cm that the laser heats leave no gap, for this
/// long [s] at each place and in the middle.
const WALK_AFTER_S: f64 = 4.0; // [s]
const WALK_M: f64 = 0.087; // [m]
const WALK_DWELL_S: f64 = 2.0; // [s]
/// Places of the walk, from the first on [deg, from right to up] and [steps]: mostly the middle lies below the body, for legs and
/// load hang from it.
const WALK: [(f64, f64); 8] = [
    (90.0, 1.0),
    (90.0, 2.0),
    (270.0, 1.0),
    (90.0, 3.0),
    (30.0, 1.0),
    (210.0, 1.0),
    (150.0, 1.0),
    (330.0, 1.0),
];
/// Least span of what is walked over [m]: on a smaller one the beam would go past it.
const WALK_SPAN_M: f64 = 0.8; // [m]
/// Share of the span that a second step and a third end in at most: a large body with legs is about half as high as wide.
const WALK_SHARE: f64 = 0.16;

/// Finds where on the target's picture the part aimed at is expected.
pub fn aim(clock: Res<SimClock>, mut stations: Query<(&TrackerParams, &Mount, &mut Tracker)>) {
    for (params, mount, mut tracker) in &mut stations {
        let part_rad = part_rad(params, mount.r_enu_m, &tracker, clock.t_s());
        let walk_rad = match params.aim {
            Some(AimPart::Body) => walk_rad(&tracker, clock.at_s(tracker.fired_ticks)),
            _ => DVec2::ZERO,
        };
        tracker.aim_rad = part_rad.unwrap_or(DVec2::ZERO) + walk_rad;
    }
}

/// How far the aim has walked from where the part is expected, right and up on the sky [rad], after `fired_s` of fire [s].
fn walk_rad(tracker: &Tracker, fired_s: f64) -> DVec2 {
    let (Some(range_m), Some(track)) = (tracker.range_m, tracker.target_track()) else {
        return DVec2::ZERO;
    };
    let span_m = track.size_rad * range_m;
    if fired_s < WALK_AFTER_S || span_m < WALK_SPAN_M {
        return DVec2::ZERO;
    }
    let on_it = |(_, steps): &&(f64, f64)| *steps <= 1.0 || steps * WALK_M <= WALK_SHARE * span_m;
    let places: Vec<&(f64, f64)> = WALK.iter().filter(on_it).collect();
    let place = ((fired_s - WALK_AFTER_S) / WALK_DWELL_S) as usize % (places.len() + 1);
    places.get(place).map_or(DVec2::ZERO, |(deg, steps)| {
        steps * WALK_M / range_m * DVec2::from_angle(deg.to_radians())
    })
}

/// Where the part aimed at is from the middle of the target's picture, right and up on the sky [rad], if the
/// target's range is known.
fn part_rad(
    params: &TrackerParams,
    r_station_enu_m: DVec3,
    tracker: &Tracker,
    t_s: f64,
) -> Option<DVec2> {
    let (part, range_m) = (params.aim?, tracker.range_m?);
    let track = tracker.target_track()?;
    let (r_enu_m, v_enu_mps) = track.position_enu(r_station_enu_m, t_s)?;
    // A detection's centre follows the mass of the picture, as the body's centroid does, more
    // than its outline: the parts are counted from the body.
    let span_m = track.size_rad * range_m;
    let offset_enu_m = aim_offset_enu_m(part, span_m, v_enu_mps)
        - aim_offset_enu_m(AimPart::Body, span_m, v_enu_mps);
    let los = los_to_az_el(r_enu_m - r_station_enu_m);
    let shifted = los_to_az_el(r_enu_m + offset_enu_m - r_station_enu_m);
    Some(DVec2::new(
        wrap_pi(shifted.x - los.x) * los.y.cos(),
        shifted.y - los.y,
    ))
}

/// Foresees when buildings will hide the tracks whose range is known.
pub fn foresee(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut stations: Query<(&Mount, &mut Tracker)>,
) {
    if !clock.due(WEIGHING_HZ) {
        return;
    }
    let t_s = clock.t_s();
    let dsm = &environment.city.dsm;
    for (mount, mut tracker) in &mut stations {
        for track in &mut tracker.table.tracks {
            let was = track.occlusion;
            // What is being seen is not hidden: its range is taken for too long.
            let seen = t_s - track.seen_s() < SEEN_S;
            let next = track
                .foresee_occlusion(dsm, mount.r_enu_m, t_s, FORESIGHT_S)
                .filter(|next| !(seen && next.hides(t_s)));
            track.occlusion = match (was, next) {
                // It is behind the building since it went there, not since the last look ahead.
                (Some(was), Some(next)) if was.hides(t_s) && next.hides(t_s) => Some(Occlusion {
                    enter_s: was.enter_s,
                    ..next
                }),
                // What is over is kept until the track is seen again: the way out is looked up there.
                (Some(was), None) if was.enter_s <= t_s && track.seen_s() < was.enter_s => {
                    Some(was)
                }
                (_, next) => next,
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::capture::Tier;
    use crate::models::tracking::evidence::EvidenceParams;
    use crate::models::tracking::table::{CameraLook, Sighting};

    #[test]
    fn fire_without_effect_walks_over_a_large_target_only() {
        // The distance [m] and direction [deg] of the aim's walk on a target of this span [m] at 500 m.
        let walked = |span_m: f64, fired_s: f64| {
            let mut tracker = Tracker::default();
            let sighting = Sighting {
                az_el_rad: DVec2::new(0.2, 0.1),
                sigma_rad: 1e-5,
                size_rad: span_m / 500.0,
                score: 0.9,
                label: 0,
                weak: false,
            };
            tracker.table.update(&CameraLook {
                tier: Tier::Coarse,
                t_s: 0.0,
                ifov_rad: 1e-4,
                reads: &EvidenceParams::default(),
                sightings: &[sighting],
                in_view: &|_| true,
                start_tracks: true,
            });
            let id = tracker.table.tracks[0].id;
            tracker.acquire(0, id, "test");
            tracker.range_m = Some(500.0);
            let at_m = 500.0 * walk_rad(&tracker, fired_s);
            (
                at_m.length(),
                at_m.to_angle().to_degrees().rem_euclid(360.0),
            )
        };
        assert_eq!(walked(1.6, WALK_AFTER_S - 0.1).0, 0.0);
        assert_eq!(walked(0.5, 60.0).0, 0.0);
        // On a smaller one the further places are left out.
        for (span_m, most) in [(1.0, 1.0), (1.2, 2.0), (1.7, 3.0)] {
            let mut places: Vec<(f64, f64)> = WALK.to_vec();
            places.retain(|(_, steps)| *steps <= most);
            for (place, (deg, steps)) in places.iter().enumerate() {
                let at_s = WALK_AFTER_S + (place as f64 + 0.5) * WALK_DWELL_S;
                let (far_m, to_deg) = walked(span_m, at_s);
                assert!((far_m - steps * WALK_M).abs() < 1e-12 && (to_deg - deg).abs() < 1e-9);
            }
            // Back in the middle, and round again.
            let round_s = WALK_AFTER_S + places.len() as f64 * WALK_DWELL_S;
            assert_eq!(walked(span_m, round_s + 0.5 * WALK_DWELL_S).0, 0.0);
            assert!(walked(span_m, round_s + 1.5 * WALK_DWELL_S).0 > 0.0);
        }
    }
}
