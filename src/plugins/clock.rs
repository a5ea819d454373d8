//! The tick: one walk down a chain of system sets.

use bevy::ecs::schedule::{LogLevel, ScheduleBuildSettings, ScheduleLabel, SingleThreadedExecutor};
use bevy::prelude::*;

/// The schedule of one fixed step.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
pub struct Tick;

/// The domains in the order a tick walks them. Data flows down; nothing reaches back up but
/// the next tick's commands.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TickSet {
    /// Clock, wind and gusts, turbulence of the beam path.
    Environment,
    /// UAVs fly, fall and crash.
    Flight,
    /// Base motion, gimbal and mirror follow last tick's commands.
    Mount,
    /// The laser beam crosses the air and heats what it meets.
    Beam,
    /// Cameras that are due expose.
    Capture,
    /// Frames become detections, held back by their latency.
    Detect,
    /// Detections that have arrived become tracks and a tracking state.
    Track,
    /// Tracks become commands for gimbal, mirror and readout windows.
    Control,
    /// Interlocks, firing command, outcome.
    Engage,
    /// State hash, recording, statistics.
    Record,
}

/// Adds [`Tick`] with its sets; every other plugin hangs its systems into them.
pub struct ClockPlugin;

impl Plugin for ClockPlugin {
    fn build(&self, app: &mut App) {
        use TickSet::*;
        let mut schedule = Schedule::new(Tick);
        // A step of one engagement takes microseconds: handing its systems to other threads
        // would cost more than running them.
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
        app.add_schedule(schedule);
    }
}
