//! The operator's orders.

use crate::components::flight::{Flight, Uav};
use crate::components::mount::Mount;
use crate::components::run::SimClock;
use crate::components::track::{Designation, Operator, Order, Tracker};
use crate::models::maths::kinematics::los_to_az_el;
use crate::models::tracking::table::{Track, TrackTable, separation_rad};
use crate::systems::track::situation::CONFIRM_HITS;
use bevy::prelude::*;
use glam::DVec2;

/// An operator points at a UAV's picture; the track must be this close to it [rad].
const DESIGNATION_RAD: f64 = 3e-3;

/// Carries out the operators' orders: a track, or the one nearest to the UAV pointed at, becomes the
/// target, or the choice goes back to the tracker.
pub fn obey(
    clock: Res<SimClock>,
    uavs: Query<(&Uav, &Flight)>,
    mut stations: Query<(&Mount, &mut Operator, &mut Tracker)>,
) {
    for (mount, mut operator, mut tracker) in &mut stations {
        obey_next(&clock, mount, &uavs, &mut operator, &mut tracker);
    }
}

/// Carries out the next order of a station's operator, if it is due.
fn obey_next(
    clock: &SimClock,
    mount: &Mount,
    uavs: &Query<(&Uav, &Flight)>,
    operator: &mut Operator,
    tracker: &mut Tracker,
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
