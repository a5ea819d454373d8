//! The range finder: what its pulse meets, and which echo is the target's.

use crate::components::capture::Tier;
use crate::components::environment::Environment;
use crate::components::flight::{Flight, Uav};
use crate::components::mount::Optics;
use crate::components::run::SimClock;
use crate::components::track::{RangeFinder, Tracker};
use crate::models::engage::interlock::FAR_M;
use crate::models::ground::dsm::LineOfSight;
use crate::models::laser::range_finder::{LitSurface, REFLECTANCE, RangeFinderParams};
use crate::models::maths::kinematics::az_el_to_los;
use crate::models::tracking::table::Lased;
use bevy::prelude::*;
use glam::DVec2;
use std::f64::consts::LN_2;

/// Pulses of the range finder a second.
const RANGE_HZ: u32 = 10;
/// A range with a smaller deviation than this is good enough to focus and to judge by [m].
const RANGE_KNOWN_M: f64 = 10.0;

/// Ranges what the pulse meets first within the gate about the target's range, while the precise camera holds a target and the station
/// believes it in the range finder's field.
pub fn find_range(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    uavs: Query<(&Uav, &Flight)>,
    mut stations: Query<(&Optics, &mut RangeFinder, &mut Tracker)>,
) {
    if !clock.due(RANGE_HZ) {
        return;
    }
    for (optics, mut finder, mut tracker) in &mut stations {
        pulse(
            clock.t_s(),
            &environment,
            optics,
            &uavs,
            &mut finder,
            &mut tracker,
        );
    }
}

/// Sends a station's pulse, if it has what to send it at.
fn pulse(
    t_s: f64,
    environment: &Environment,
    optics: &Optics,
    uavs: &Query<(&Uav, &Flight)>,
    finder: &mut RangeFinder,
    tracker: &mut Tracker,
) {
    let held = tracker.state.holds(Tier::Precise);
    let RangeFinder { params, rng } = finder;
    let believed_rad = tracker.aim_los(t_s).map(|los| {
        let axis_enu = optics.pointing.laser_axis_enu();
        az_el_to_los(los.az_el_rad()).angle_between(axis_enu)
    });
    let Some(track) = tracker.target.and_then(|id| tracker.table.get_mut(id)) else {
        return;
    };
    let pulses = held && believed_rad.is_some_and(|off_rad| off_rad < params.half_field_rad);
    let echo_m = if pulses {
        let surfaces = lit_surfaces(params, environment, optics, uavs);
        let extinction_per_m = environment.weather.extinction_per_m(params.wavelength_m);
        let echoes_m = params.echoes_m(&surfaces, extinction_per_m, rng);
        track.met_first(echoes_m.first().copied(), t_s);
        let gate = track.range_gate(t_s);
        echoes_m.into_iter().find(|echo_m| gate.contains(echo_m))
    } else {
        None
    };
    if let Some(range_m) = echo_m {
        let measured_m = range_m + params.sigma_m * rng.normal();
        track.ranged(measured_m, params.sigma_m, t_s);
        track.lased = Some(Lased {
            t_s,
            range_m: measured_m,
            sigma_m: params.sigma_m,
        });
    } else if pulses {
        track.unanswered();
    }
    let known = track.range.range_m(t_s);
    tracker.lased |= echo_m.is_some();
    // A radar's range alone, which may be another's, is not good enough to fire by.
    tracker.range_m = known
        .filter(|(_, sigma_m)| tracker.lased && *sigma_m < RANGE_KNOWN_M)
        .map(|(range_m, _)| range_m);
}

/// What a pulse along the laser's axis may meet: anything that flies or falls in its field, and behind it the city, by one ray
/// for each quarter of the pulse's power.
fn lit_surfaces(
    params: &RangeFinderParams,
    environment: &Environment,
    optics: &Optics,
    uavs: &Query<(&Uav, &Flight)>,
) -> Vec<LitSurface> {
    let pose = optics.laser;
    let flying = uavs.iter().filter_map(|(uav, flight)| {
        let r_enu_m = flight.aim_enu_m();
        let r_cam_m = pose.q_enu_cam.inverse() * (r_enu_m - pose.r_enu_m);
        let off_rad = r_cam_m.truncate().length() / r_cam_m.z;
        let lit = r_cam_m.z > 0.0
            && off_rad < params.half_field_rad
            && environment.line_of_sight(pose.r_enu_m, r_enu_m) == LineOfSight::Clear;
        let [_, width_m, height_m] = uav.size_m;
        let range_m = r_enu_m.distance(pose.r_enu_m);
        lit.then(|| LitSurface {
            range_m,
            share: params.share(width_m * height_m, range_m, off_rad),
            reflectance: REFLECTANCE,
        })
    });
    let mut surfaces: Vec<LitSurface> = flying.collect();
    let passes = 1.0 - surfaces.iter().map(|lit| lit.share).sum::<f64>().min(1.0);
    // Half of a Gaussian beam's power falls within this radius: there the ray of a quarter stands.
    let off_rad = (0.5 * LN_2).sqrt() * params.half_field_rad;
    let quarters = [DVec2::X, DVec2::Y, DVec2::NEG_X, DVec2::NEG_Y];
    surfaces.extend(quarters.into_iter().filter_map(|towards| {
        let ray_enu = pose.q_enu_cam * (off_rad * towards).extend(1.0).normalize();
        let range_m = (environment.city.dsm).first_hit(pose.r_enu_m, ray_enu, FAR_M)?;
        Some(LitSurface {
            range_m,
            share: passes / 4.0,
            reflectance: REFLECTANCE,
        })
    }));
    surfaces
}
