//! The run: schedules, clock, seed, end.

use crate::components::run::{
    Failure, Options, PartError, RunEnd, RunScenario, Seed, SetUp, SimClock, Stopwatch, Tick,
    TickSet,
};
use crate::systems::run as systems;
use bevy::ecs::schedule::{
    LogLevel, ScheduleBuildSettings, ScheduleConfigs, ScheduleLabel, SingleThreadedExecutor,
};
use bevy::ecs::system::ScheduleSystem;
use bevy::prelude::*;

/// Adds [`SetUp`] and [`Tick`] with their sets; every other plugin adds its systems to them.
/// [`Options`] and [`RunScenario`] must be there before [`SetUp`] runs.
pub struct RunPlugin;

impl Plugin for RunPlugin {
    fn build(&self, app: &mut App) {
        app.add_schedule(walk(SetUp))
            .add_schedule(walk(Tick))
            .init_resource::<Failure>()
            .init_resource::<Stopwatch>()
            .add_systems(
                SetUp,
                set_up
                    .before(TickSet::Environment)
                    .run_if(systems::nothing_failed),
            )
            .add_systems(Tick, systems::advance_clock.before(TickSet::Environment))
            .add_systems(Tick, systems::note_end.after(TickSet::Record));
    }
}

/// A system of [`SetUp`] that may fail. The first error ends the set-up: what comes after it may
/// want what the failed part was to bring.
pub fn fallible<M>(
    system: impl IntoSystem<(), Result<(), PartError>, M> + 'static,
) -> ScheduleConfigs<ScheduleSystem> {
    system
        .pipe(systems::note_failure)
        .run_if(systems::nothing_failed)
}

/// A schedule that walks the sets of [`TickSet`] one after the other.
fn walk(label: impl ScheduleLabel) -> Schedule {
    use TickSet::*;
    let mut schedule = Schedule::new(label);
    // A step of one engagement takes microseconds: handing its systems to other threads would cost
    // more than running them.
    schedule.set_executor(SingleThreadedExecutor::new());
    schedule.set_build_settings(ScheduleBuildSettings {
        ambiguity_detection: LogLevel::Error,
        ..default()
    });
    schedule.configure_sets(
        (
            Environment,
            Flight,
            Mount,
            Beam,
            Capture,
            Detect,
            Track,
            Control,
            Engage,
            Record,
        )
            .chain(),
    );
    schedule
}

/// Clock, seed and end of the run.
fn set_up(mut commands: Commands, loaded: Res<RunScenario>, options: Res<Options>) {
    let scenario = &loaded.scenario;
    let clock = SimClock {
        tick: 0,
        tick_hz: scenario.tick_hz,
    };
    commands.insert_resource(clock);
    commands.insert_resource(Seed(options.seed.unwrap_or(scenario.seed)));
    commands.insert_resource(RunEnd {
        last_tick: clock.ticks_of(scenario.duration_s),
        settled: None,
        stopped: None,
    });
}
