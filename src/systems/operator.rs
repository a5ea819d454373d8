//! The operator's orders.

use crate::components::flight::{Flight, Uav};
use crate::components::mount::Mount;
use crate::components::operator::{Answer, Command, Designation, Operator};
use crate::components::run::SimClock;
use crate::components::track::Tracker;
use crate::models::decision::situation::CONFIRM_HITS;
use crate::models::maths::kinematics::los_to_az_el;
use crate::models::tracking::table::{Track, TrackTable, separation_rad};
use bevy::prelude::*;
use glam::DVec2;

/// An operator points at a UAV's picture; the track must be this close to it [rad].
const DESIGNATION_RAD: f64 = 3e-3;

/// Takes the orders that are due: a track, or the one nearest to the UAV pointed at, becomes the target, or the
/// choice goes back to the tracker; a station slewed by hand gives its target up. What is no target goes to the
/// parts that it concerns at once, and leaves alone a designation that waits for its track.
pub fn obey(
    clock: Res<SimClock>,
    uavs: Query<(&Uav, &Flight)>,
    mut stations: Query<(&Mount, &mut Operator, &mut Tracker)>,
) {
    for (mount, mut operator, mut tracker) in &mut stations {
        if !operator.due.is_empty() {
            operator.due.clear();
        }
        if operator.waiting.is_none() && operator.next == operator.orders.len() {
            continue;
        }
        // One that takes the place of another is carried out in the next tick.
        if !take_due(&clock, &mut operator, &mut tracker) {
            designate(&clock, mount, &uavs, &mut operator, &mut tracker);
        }
    }
}

/// Why an order is not carried out that another one follows.
const TAKEN: &str = "another order took its place";

/// Takes the orders of a station's operator that are due; true if one took the place of one that waited.
fn take_due(clock: &SimClock, operator: &mut Operator, tracker: &mut Tracker) -> bool {
    let mut replaced = false;
    // A slew of the same tick, which a later order undoes before it was begun.
    let mut slew: Option<usize> = None;
    while let Some(order) = operator.orders.get(operator.next)
        && clock.tick >= order.tick
    {
        let command = order.command.clone();
        operator.next += 1;
        if matches!(command, Command::Target(_) | Command::Slew(_))
            && let Some(answer) = slew.take().and_then(|at| operator.answers.get_mut(at))
        {
            *answer = Answer::Refused(TAKEN.into());
        }
        if matches!(command, Command::Slew(_)) {
            slew = Some(operator.answers.len());
        }
        let answer = match command {
            Command::Target(_) => Answer::Waits,
            _ => Answer::Obeyed,
        };
        match command {
            Command::Target(target) => {
                if operator.waiting.replace(target).is_some() {
                    operator.answer_waiting(Answer::Refused(TAKEN.into()));
                    replaced = true;
                }
            }
            Command::Slew(az_el_deg) => {
                let [azimuth_deg, elevation_deg] = az_el_deg;
                operator.slew_rad = Some(DVec2::from(az_el_deg.map(f64::to_radians)));
                if tracker.target.is_some() {
                    let reason =
                        format!("operator slews to {azimuth_deg:.1}°, {elevation_deg:.1}°");
                    tracker.give_up(clock.tick, None, reason);
                }
            }
            Command::Drive(drive) => operator.drive = drive,
            other => operator.due.push(other),
        }
        operator.answers.push(answer);
    }
    replaced
}

/// Carries out what a station's operator wants for a target, if it can be.
fn designate(
    clock: &SimClock,
    mount: &Mount,
    uavs: &Query<(&Uav, &Flight)>,
    operator: &mut Operator,
    tracker: &mut Tracker,
) {
    let t_s = clock.t_s();
    let (track, reason) = match operator.waiting {
        None => return,
        Some(Designation::Release) => {
            tracker.designated = false;
            (operator.waiting, operator.slew_rad) = (None, None);
            operator.answer_waiting(Answer::Obeyed);
            return;
        }
        Some(Designation::Track(id)) => {
            let Some(track) = tracker.table.get(id) else {
                // A track that is gone does not come back under its old number.
                operator.waiting = None;
                operator.answer_waiting(Answer::Refused(format!("there is no track {id}")));
                return;
            };
            let held = (track.total_hits() >= CONFIRM_HITS).then_some(id);
            (held, format!("operator chooses track {id}"))
        }
        Some(Designation::Uav(index)) => {
            let Some((uav, flight)) = uavs.iter().find(|(uav, _)| uav.index == index) else {
                operator.waiting = None;
                operator.answer_waiting(Answer::Refused("there is no such UAV".into()));
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
        (operator.waiting, operator.slew_rad) = (None, None);
        operator.answer_waiting(Answer::Obeyed);
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
