//! The run: its clock starts a tick, its first error or its end stops it.

use crate::components::flight::{Distractor, UavStatus};
use crate::components::run::{Failure, PartError, RunEnd, SetUp, SimClock, Tick};
use crate::stop;
use bevy::prelude::*;

/// Simulated time that a run goes on after its last UAV has come down [s].
const AFTERMATH_S: f64 = 1.0;

/// Starts the tick.
pub fn advance_clock(mut clock: ResMut<SimClock>) {
    clock.tick += 1;
}

/// Notes the tick in which the last UAV came to its end.
pub fn note_end(
    clock: Res<SimClock>,
    uavs: Query<&UavStatus, Without<Distractor>>,
    mut end: ResMut<RunEnd>,
) {
    let down = |status: &UavStatus| matches!(status, UavStatus::Down | UavStatus::Crashed);
    if end.settled.is_none() && !uavs.is_empty() && uavs.iter().all(down) {
        end.settled = Some(clock.tick);
    }
}

/// Reports the error of a set-up system.
pub fn note_failure(In(result): In<Result<(), PartError>>, mut failure: ResMut<Failure>) {
    if let Err(error) = result {
        failure.set(error);
    }
}

/// Whether nothing has failed so far: what failed leaves out what later parts build on.
pub fn nothing_failed(failure: Res<Failure>) -> bool {
    !failure.is_set()
}

/// Builds the run.
pub fn set_up(world: &mut World) -> Result<(), PartError> {
    world.run_schedule(SetUp);
    world.resource_mut::<Failure>().take().map_or(Ok(()), Err)
}

/// Runs one tick; true when the run is over, or stopped from outside.
pub fn step(world: &mut World) -> Result<bool, PartError> {
    world.run_schedule(Tick);
    if let Some(error) = world.resource_mut::<Failure>().take() {
        return Err(error);
    }
    let clock = world.resource::<SimClock>();
    let end = world.resource::<RunEnd>();
    let aftermath = clock.ticks_of(AFTERMATH_S);
    let tick = clock.tick;
    let over =
        tick >= end.last_tick || (end.settled).is_some_and(|since| tick >= since + aftermath);
    let stopped = !over && stop::asked().is_some();
    if stopped {
        world.resource_mut::<RunEnd>().stopped = Some(tick);
    }
    Ok(over || stopped)
}
