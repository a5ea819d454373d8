//! Low flight: the course around what is high, and the floor that clears the rest.

use super::behaviour::{Behaviour, MOST_MPS2, TURN_S};
use super::member::Mate;
use glam::DVec2;

/// On a low approach: how far ahead [s], in steps of at most [s] and [m], and how far to each side [m].
const LOW_AHEAD_S: f64 = 10.0;
const LOW_STEP_S: f64 = 0.4;
const LOW_STEP_M: f64 = 5.0;
const LOW_ASIDE_M: f64 = 3.0;
/// The climb that it counts on [m/s], the time until it has begun [s], and that in which it makes up for an error of height [s].
const LOW_CLIMB_MPS: f64 = 4.0;
const LOW_LEAD_S: f64 = 1.5;
pub(super) const LOW_PLACE_S: f64 = 0.8;
/// How far below the floor it stops [m].
const LOW_STOP_M: f64 = 8.0;
/// Courses that it compares, off its way [deg], and how much lower the ground must be for each degree [m].
const LOW_COURSES_DEG: [f64; 7] = [0.0, -15.0, 15.0, -30.0, 30.0, -45.0, 45.0];
const LOW_COURSE_MPDEG: f64 = 0.2;

/// Velocity [m/s] and floor [m] of a low approach that would fly at `wanted_mps` [m/s]: the floor is what the ground asks for
/// now, so that a climb clears all of it on the way there. Of some courses beside the wanted one, each with the turn to it,
/// a flock takes that of the least floor (Fox, Burgard and Thrun, *The dynamic window approach to collision avoidance*,
/// 1997); a formation keeps its own.
pub fn low_course(
    own: &Mate,
    wanted_mps: DVec2,
    behaviour: &Behaviour,
    surface_m: impl Fn(DVec2) -> f64,
) -> (DVec2, f64) {
    let fastest_mps = wanted_mps.length().max(own.v_enu_mps.truncate().length());
    let step_s = LOW_STEP_M / fastest_mps.max(LOW_STEP_M / LOW_STEP_S);
    let floor_m = |course_mps: DVec2| {
        let (mut r_m, mut v_mps) = (own.r_enu_m.truncate(), own.v_enu_mps.truncate());
        let mut floor_m = f64::NEG_INFINITY;
        for step in 0..=(LOW_AHEAD_S / step_s) as usize {
            let aside_m = LOW_ASIDE_M * v_mps.perp().normalize_or_zero();
            let highest_m = [r_m, r_m - aside_m, r_m + aside_m].map(&surface_m);
            let highest_m = highest_m.into_iter().fold(f64::NEG_INFINITY, f64::max);
            let climb_m = LOW_CLIMB_MPS * (step_s * step as f64 - LOW_LEAD_S).max(0.0);
            floor_m = floor_m.max(highest_m - climb_m);
            let a_mps2 = ((course_mps - v_mps) / TURN_S).clamp_length_max(MOST_MPS2);
            v_mps += (a_mps2 * step_s).clamp_length_max((course_mps - v_mps).length());
            r_m += v_mps * step_s;
        }
        floor_m
    };
    let courses = match behaviour.keeps_formation {
        true => &LOW_COURSES_DEG[..1],
        false => &LOW_COURSES_DEG,
    };
    let (mut least_m, mut best) = (f64::INFINITY, (wanted_mps, f64::NEG_INFINITY));
    for bearing_deg in courses {
        let course_mps = DVec2::from_angle(-bearing_deg.to_radians()).rotate(wanted_mps);
        let floor_m = floor_m(course_mps);
        let cost_m = floor_m + LOW_COURSE_MPDEG * bearing_deg.abs();
        if cost_m < least_m {
            (least_m, best) = (cost_m, (course_mps, floor_m));
        }
    }
    // What is too low for what comes slows down.
    let (course_mps, floor_m) = best;
    let slow = (1.0 - (floor_m - own.r_enu_m.z) / LOW_STOP_M).clamp(0.05, 1.0);
    (slow * course_mps, floor_m)
}
