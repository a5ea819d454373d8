//! What lies ahead of a track: the part aimed at, and buildings that will hide it.

use crate::components::environment::Environment;
use crate::components::mount::Mount;
use crate::components::run::SimClock;
use crate::components::track::{Tracker, TrackerParams};
use crate::models::flight::uav::{AimPart, aim_offset_enu_m};
use crate::models::maths::kinematics::{los_to_az_el, wrap_pi};
use crate::models::tracking::table::Occlusion;
use crate::systems::track::situation::WEIGHING_HZ;
use bevy::prelude::*;
use glam::{DVec2, DVec3};

/// Foresight of occlusions [s].
const FORESIGHT_S: f64 = 4.0;
/// What was seen so lately is not hidden [s].
const SEEN_S: f64 = 0.15;

/// Finds where on the target's picture the part aimed at is expected.
pub fn aim(clock: Res<SimClock>, mut stations: Query<(&TrackerParams, &Mount, &mut Tracker)>) {
    for (params, mount, mut tracker) in &mut stations {
        let aim_rad = part_rad(params, mount.r_enu_m, &tracker, clock.t_s());
        tracker.aim_rad = aim_rad.unwrap_or(DVec2::ZERO);
    }
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
