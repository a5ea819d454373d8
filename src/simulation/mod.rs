//! The front door: a run that is opened, stepped, looked at and given orders, without a word of Bevy.
//!
//! [`Simulation::open`] takes a scenario, or a recording whose run is to be made again. [`Simulation::step`] lets
//! time pass. [`Simulation::view`] shows everything between two ticks: stations with their mounts, beams, tracks and
//! beliefs, cameras, UAVs, the air. [`Simulation::frames`] and [`Simulation::events`] are what came since the step
//! before. [`Simulation::give`] takes the orders that a scenario may hold, too, and [`Builder`] takes detectors, pointing
//! laws, stages of the tracker and topics of one's own.
//!
//! ```
//! use boresight::scenario::OrderConfig;
//! use boresight::simulation::{Simulation, SimulationError};
//!
//! let mut run = Simulation::builder("scenarios/urban_intercept.toml")
//!     .set("detector.kind=truth")
//!     .seed(7)
//!     .open()?;
//! // Nobody fires in the first second.
//! run.give(&OrderConfig { fire: Some(false), ..OrderConfig::default() })?;
//! run.run_until(1.0)?;
//! for station in run.view().stations() {
//!     let pointing = station.mount().az_el_rad;
//!     println!("{} {} looks to {pointing} rad", station.name(), station.state().name());
//!     assert_eq!(station.beam().energy_j, 0.0);
//! }
//! # Ok::<(), SimulationError>(())
//! ```
//!
//! A run has one seed and no other source of chance: the same scenario, seed, parts and orders give the same
//! [`View::state_hash`] after every tick, however the ticks are stepped.
//!
//! Those who want the engine itself find it below, in [`crate::app`].

mod builder;
mod cast;
mod events;
mod view;

pub use crate::components::run::Options;
pub use builder::{Builder, Stage};
pub use events::{Event, What};
pub use view::{
    AirView, Arrived, CameraView, FrameView, MountView, StationView, TrackView, UavView, View,
};

use crate::app::{self, RunError};
use crate::components::capture::{ExposedFrame, Frames};
use crate::components::mount::Station;
use crate::components::operator::{Command, Operator, Order};
use crate::components::run::SimClock;
use crate::plugins::operator::command;
use crate::recording::read::ReadError;
use crate::report::ReportError;
use crate::report::summary::{Finished, conclude, finish};
use crate::scenario::{InputError, Loaded, OrderConfig, OrderError};
use bevy::app::App;
use bevy::prelude::World;
use events::Watch;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Why a simulation cannot be opened, go on or be finished. Each prints as one line that names the mend.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    /// The scenario cannot be read or is not valid.
    #[error(transparent)]
    Scenario(#[from] InputError),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] ReadError),
    /// The run cannot be built, or failed.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Summary or report cannot be written.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// An order that nobody can obey.
    #[error(transparent)]
    Order(#[from] OrderError),
    /// Changes to a scenario that has been loaded.
    #[error("{}: is loaded already: give the changes to the one who loads it", .0.display())]
    Changed(PathBuf),
    /// A part of the caller's own cannot be added.
    #[error("{0}")]
    Part(String),
    /// A step after the run had failed.
    #[error("the run has failed before and cannot go on; open it anew")]
    Failed,
}

/// A run between two ticks.
pub struct Simulation {
    app: App,
    loaded: Loaded,
    options: Options,
    started: Instant,
    state: State,
    /// The newest frame of each camera that exposed in the last step, by its number.
    frames: BTreeMap<usize, Arc<ExposedFrame>>,
    watch: Watch,
}

/// How far a run is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Goes,
    Over,
    Failed,
}

impl Simulation {
    /// Opens a scenario (`.toml`), or a recording (`.mcap`) whose run is made again.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, SimulationError> {
        Self::builder(path).open()
    }

    /// To open a scenario or a recording with changes, options, and parts of one's own.
    pub fn builder(path: impl AsRef<Path>) -> Builder {
        Builder::file(path)
    }

    fn of(app: App, loaded: Loaded, options: Options) -> Self {
        let watch = Watch::of(View { world: app.world() });
        Self {
            app,
            loaded,
            options,
            started: Instant::now(),
            state: State::Goes,
            frames: BTreeMap::new(),
            watch,
        }
    }

    /// Lets so many ticks pass, fewer if the run ends before; true once it is over.
    pub fn step(&mut self, ticks: u64) -> Result<bool, SimulationError> {
        if self.state == State::Failed {
            return Err(SimulationError::Failed);
        }
        self.frames.clear();
        self.watch.clear();
        for _ in 0..ticks {
            if self.state != State::Goes {
                break;
            }
            match app::step(self.app.world_mut()) {
                Ok(false) => {}
                Ok(true) => self.state = State::Over,
                Err(error) => {
                    self.state = State::Failed;
                    return Err(error.into());
                }
            }
            let world = self.app.world();
            for frame in &world.resource::<Frames>().0 {
                self.frames.insert(frame.index, frame.clone());
            }
            self.watch.look(View { world });
        }
        Ok(self.over())
    }

    /// Lets time pass until `t_s` [s], or the run's end; true once it is over.
    pub fn run_until(&mut self, t_s: f64) -> Result<bool, SimulationError> {
        let clock = self.app.world().resource::<SimClock>();
        let ticks = clock.ticks_of(t_s).saturating_sub(clock.tick);
        self.step(ticks)
    }

    /// Lets time pass tick by tick until the run's end, or until `look`, which sees the run after each, says that it
    /// has seen enough.
    pub fn watch(&mut self, mut look: impl FnMut(&Self) -> bool) -> Result<(), SimulationError> {
        loop {
            let over = self.step(1)?;
            if look(self) || over {
                return Ok(());
            }
        }
    }

    /// Whether the run has come to its end.
    pub fn over(&self) -> bool {
        self.state == State::Over
    }

    /// Everything as the last tick left it.
    pub fn view(&self) -> View<'_> {
        View {
            world: self.app.world(),
        }
    }

    /// Simulated time [s].
    pub fn t_s(&self) -> f64 {
        self.view().t_s()
    }

    /// The scenario.
    pub fn scenario(&self) -> &Loaded {
        &self.loaded
    }

    /// Seed of every random stream.
    pub fn seed(&self) -> u64 {
        self.options.seed.unwrap_or(self.loaded.scenario.seed)
    }

    /// The newest frame of each camera that exposed in the last step, in the order of the cameras. A step no longer
    /// than a camera's period misses none.
    pub fn frames(&self) -> impl Iterator<Item = FrameView<'_>> {
        self.frames.values().map(|frame| FrameView { frame })
    }

    /// What happened in the last step, in order of time.
    pub fn events(&self) -> &[Event] {
        self.watch.events()
    }

    /// Gives an order to the station that it names, or to every one. It counts from its `t_s` on, or from the next
    /// tick if that is past. What cannot be obeyed whatever comes is refused here; what becomes of others is an
    /// [`Event`] once they are due.
    pub fn give(&mut self, order: &OrderConfig) -> Result<(), SimulationError> {
        self.loaded.scenario.check_order(order)?;
        let command = command(order, &self.loaded.scenario);
        let world = self.app.world_mut();
        let clock = *world.resource::<SimClock>();
        let tick = clock.ticks_of(order.t_s).max(clock.tick + 1);
        // There is one air for all: its orders are the first station's.
        let one_air = matches!(command, Command::Weather(_));
        for (station, mut operator) in world.query::<(&Station, &mut Operator)>().iter_mut(world) {
            let meant = match one_air {
                true => station.index == 0,
                false => order.is_for(&station.name),
            };
            if meant {
                operator.give(Order {
                    tick,
                    command: command.clone(),
                });
            }
        }
        Ok(())
    }

    /// Sums the run up as far as it went, and writes nothing.
    pub fn summary(&mut self) -> Finished {
        let elapsed = self.started.elapsed();
        finish(self.app.world_mut(), &self.loaded, &self.options, elapsed)
    }

    /// Ends the run where it is: closes the recording, and writes summary and report beside it if it has a folder.
    pub fn finish(mut self) -> Result<Finished, SimulationError> {
        let elapsed = self.started.elapsed();
        let world = self.app.world_mut();
        Ok(conclude(world, &self.loaded, &self.options, elapsed)?)
    }

    /// The engine's world, for the parts of this program that look deeper than a view.
    pub(crate) fn world(&self) -> &World {
        self.app.world()
    }

    /// The same, to be prepared before the first tick.
    pub(crate) fn world_mut(&mut self) -> &mut World {
        self.app.world_mut()
    }
}
