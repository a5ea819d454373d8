//! Detections that have arrived become tracks, and tracks move the state machine.

mod associate;
mod decide;
mod foresee;
mod range;
pub mod recognise;

pub use associate::associate;
pub use decide::decide;
pub use foresee::{aim, foresee};
pub use range::find_range;

use crate::components::flight::{Flight, Uav};
use crate::components::track::Tracker;
use crate::models::maths::kinematics::los_to_az_el;
use crate::models::tracking::table::separation_rad;
use glam::DVec3;

/// The UAV or distractor that the tracker's target really is: the one nearest to its line of sight, and how far
/// that is from it [rad].
pub fn followed<'a>(
    tracker: &Tracker,
    t_s: f64,
    r_station_enu_m: DVec3,
    uavs: impl Iterator<Item = (&'a Uav, &'a Flight)>,
) -> Option<(usize, f64)> {
    let los = tracker.target_track()?.filter.predicted(t_s).az_el_rad();
    uavs.map(|(uav, flight)| {
        let at = los_to_az_el(flight.aim_enu_m() - r_station_enu_m);
        (uav.index, separation_rad(los, at))
    })
    .min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)))
}
