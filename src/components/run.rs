//! The run itself: what it runs, its clock and seed, the schedules, how it ends or fails.

use crate::models::ground::city::City;
use crate::models::maths::rng::Stream;
use crate::scenario::Loaded;
use bevy::ecs::schedule::ScheduleLabel;
use bevy::platform::cell::SyncCell;
use bevy::prelude::*;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// The schedule that builds a run from its scenario, once, before the first tick.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
pub struct SetUp;

/// The schedule of one fixed step.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
pub struct Tick;

/// The domains in the order in which [`SetUp`] and every [`Tick`] walk them. Data flows down;
/// nothing reaches back up but the next tick's commands.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TickSet {
    /// Wind and gusts at every UAV.
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

/// How a scenario is run.
#[derive(Resource, Clone, Debug, Default)]
pub struct Options {
    /// Seed instead of the scenario's.
    pub seed: Option<u64>,
    /// Worker threads; the machine's cores by default. It changes no result.
    pub threads: Option<usize>,
    /// Whether the detector works within the tick rather than on a thread of its own; it changes no
    /// result.
    pub one_thread: bool,
    /// Whether cameras render.
    pub capture: bool,
    /// Whether they do so only for pictures that are asked for between two ticks: exposures are without. It changes no
    /// result where the detector looks at no picture.
    pub on_demand: bool,
    /// Folder for recording, summary and report; none writes nothing.
    pub out: Option<PathBuf>,
    /// Address on which the recording's topics are served to Foxglove while the run goes on; it changes no result.
    pub live: Option<SocketAddr>,
    /// Simulated seconds per wall-clock second at most, of a run without a window; none is as fast as it goes.
    pub pace: Option<f64>,
    /// Whether the app gets a window.
    pub window: bool,
    /// Whether Bevy's warnings go to standard error; a process can start its log once only.
    pub log: bool,
    /// A city generated before, for runs without pictures; one with other parameters than the
    /// scenario's is not used.
    pub city: Option<Arc<City>>,
}

/// The scenario of this run, with the places of its values.
#[derive(Resource, Deref, Clone, Debug)]
pub struct RunScenario(pub Arc<Loaded>);

/// The one seed of a run.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Eq)]
pub struct Seed(pub u64);

impl Seed {
    /// The random stream of an entity for a purpose; no other stream depends on its draws.
    pub fn stream(self, entity: u64, purpose: &str) -> Stream {
        Stream::new(self.0, entity, purpose)
    }
}

/// The simulation's own clock: fixed ticks, never the wall clock.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Eq)]
pub struct SimClock {
    /// Ticks since the start; the state after the systems of tick `n` is the state at `n / tick_hz`.
    pub tick: u64,
    /// Ticks per second.
    pub tick_hz: u32,
}

impl SimClock {
    /// Simulated time [s].
    pub fn t_s(&self) -> f64 {
        self.tick as f64 / f64::from(self.tick_hz)
    }

    /// Length of a tick [s].
    pub fn dt_s(&self) -> f64 {
        1.0 / f64::from(self.tick_hz)
    }

    /// Simulated time of `tick` [s].
    pub fn at_s(&self, tick: u64) -> f64 {
        tick as f64 / f64::from(self.tick_hz)
    }

    /// Whole ticks that cover a duration; a latency never ends early.
    pub fn ticks_of(&self, duration_s: f64) -> u64 {
        // The small slack keeps a duration that is a whole number of ticks from rounding up.
        (duration_s * f64::from(self.tick_hz) - 1e-9)
            .ceil()
            .max(0.0) as u64
    }

    /// Whether something that happens `rate_hz` times a second is due in this tick; a rate above the
    /// tick's is due in every one.
    pub fn due(&self, rate_hz: u32) -> bool {
        self.tick
            .is_multiple_of(u64::from((self.tick_hz / rate_hz).max(1)))
    }
}

/// Where and when a run ends.
#[derive(Resource, Clone, Copy, Debug)]
pub struct RunEnd {
    /// Last tick.
    pub last_tick: u64,
    /// Tick at which every UAV had come to its end, if that has happened.
    pub settled: Option<u64>,
    /// Tick after which the run was stopped from outside, if it was.
    pub stopped: Option<u64>,
}

/// Who takes part in a run, looked up once after the set-up: nobody joins or leaves later.
#[derive(Resource, Clone, Debug, Default)]
pub struct Cast {
    /// The stations, in the order of the scenario.
    pub stations: Vec<Entity>,
    /// UAVs and distractors, by their index.
    pub flying: Vec<Entity>,
}

/// What a domain, or a user's own plugin, reports when it cannot go on: any typed error.
pub type PartError = Box<dyn std::error::Error + Send + Sync>;

/// Makes a part in the light of a context.
type Make<C, T> = Box<dyn Fn(&C) -> Result<Box<T>, PartError> + Send + Sync>;

/// The parts of one kind that a scenario may name.
pub struct Registry<C, T: ?Sized>(BTreeMap<String, Make<C, T>>);

impl<C, T: ?Sized> Default for Registry<C, T> {
    fn default() -> Self {
        Self(BTreeMap::new())
    }
}

impl<C, T: ?Sized> Registry<C, T> {
    /// Adds a part under a name, in place of one that had it.
    pub fn add(
        &mut self,
        name: &str,
        make: impl Fn(&C) -> Result<Box<T>, PartError> + Send + Sync + 'static,
    ) {
        self.0.insert(name.to_owned(), Box::new(make));
    }

    /// Names of the parts, in their alphabet's order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }

    /// Makes the part of a name; `None` where there is none of that name.
    pub fn make(&self, name: &str, context: &C) -> Option<Result<Box<T>, PartError>> {
        Some(self.0.get(name)?(context))
    }
}

/// The first error of a set-up or a run; a tick in which one appears is the last.
#[derive(Resource, Default)]
pub struct Failure(Option<PartError>);

impl Failure {
    /// Keeps `error` unless one came before it.
    pub fn set(&mut self, error: impl Into<PartError>) {
        self.0.get_or_insert_with(|| error.into());
    }

    /// Takes the error, if there is one.
    pub fn take(&mut self) -> Option<PartError> {
        self.0.take()
    }

    /// Whether there is an error.
    pub fn is_set(&self) -> bool {
        self.0.is_some()
    }
}

/// What a run keeps that one at a time works with, and that cannot be read by two: taken out for the work, and put back.
///
/// As a resource it lets a run move to another thread, which what the engine calls "non-send" would not.
#[derive(Resource)]
pub struct Kept<T: Send + 'static>(SyncCell<T>);

impl<T: Send + 'static> Kept<T> {
    /// Puts it into the world, in place of one that is there.
    pub fn put(world: &mut World, kept: T) {
        world.insert_resource(Self(SyncCell::new(kept)));
    }

    /// Takes it out of the world.
    pub fn take(world: &mut World) -> Option<T> {
        let Self(cell) = world.remove_resource()?;
        Some(SyncCell::to_inner(cell))
    }
}

/// Wall-clock time by part. It is reported, and enters no state.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct Stopwatch {
    /// Rendering, readback and image formation.
    pub render: Duration,
    /// Waiting for the detector, which works while the next frames are rendered.
    pub inference: Duration,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_error_is_kept() {
        let mut failure = Failure::default();
        failure.set("first");
        failure.set("second");
        assert!(failure.is_set());
        assert_eq!(
            failure.take().map(|e| e.to_string()).as_deref(),
            Some("first")
        );
        assert!(!failure.is_set());
    }
}
