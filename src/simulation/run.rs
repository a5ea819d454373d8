//! A run between two ticks: stepped, looked at, given orders, finished.

use super::error::SimulationError;
use super::events::{Event, Watch};
use super::orders::with_orders;
use super::snapshot::{self, RunId, Snapshot, State};
use super::view::{Frame, FrameView, View};
use crate::app::{self, RunError};
use crate::components::capture::{Depth, ExposedFrame, Frames, SensorCamera};
use crate::components::mount::Station;
use crate::components::operator::{Operator, Order};
use crate::components::record::Recording;
use crate::components::run::{Options, SimClock};
use crate::parameters::operator::command;
use crate::report::summary::{Finished, conclude, finish};
use crate::scenario::{Loaded, OrderConfig};
use crate::systems::capture::{self as systems, CaptureError};
use crate::systems::detect::answer_all;
use bevy::app::{App, SubApp};
use bevy::prelude::{Entity, World};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// A run between two ticks. It may move from thread to thread.
pub struct Simulation {
    id: RunId,
    main: SubApp,
    loaded: Loaded,
    options: Options,
    started: Instant,
    state: State,
    /// The newest frame of each camera that exposed in the last step, by its number.
    frames: BTreeMap<usize, Arc<ExposedFrame>>,
    watch: Watch,
}

impl Simulation {
    pub(super) fn of(mut app: App, loaded: Loaded, options: Options) -> Self {
        // What else an app holds, sub-apps and a runner, has no part in a run.
        let main = std::mem::take(app.main_mut());
        let watch = Watch::of(View {
            world: main.world(),
        });
        Self {
            id: RunId::new(),
            main,
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
        self.step_while(ticks, || true)
    }

    /// As [`Self::step`], as long as `go_on` says so before each tick.
    pub fn step_while(
        &mut self,
        ticks: u64,
        mut go_on: impl FnMut() -> bool,
    ) -> Result<bool, SimulationError> {
        if self.state == State::Failed {
            return Err(SimulationError::Failed);
        }
        self.frames.clear();
        self.watch.clear();
        for _ in 0..ticks {
            if self.state != State::Goes || !go_on() {
                break;
            }
            match app::step(self.main.world_mut()) {
                Ok(false) => {}
                Ok(true) => self.state = State::Over,
                Err(error) => {
                    self.state = State::Failed;
                    return Err(error.into());
                }
            }
            let world = self.main.world();
            for frame in &world.resource::<Frames>().0 {
                self.frames.insert(frame.index, frame.clone());
            }
            self.watch.look(View { world });
        }
        Ok(self.over())
    }

    /// Lets time pass until `t_s` [s], or the run's end; true once it is over.
    pub fn run_until(&mut self, t_s: f64) -> Result<bool, SimulationError> {
        self.step(self.ticks_until(t_s))
    }

    /// Ticks from now to `t_s` [s]; none if that is past.
    pub fn ticks_until(&self, t_s: f64) -> u64 {
        let clock = self.main.world().resource::<SimClock>();
        clock.ticks_of(t_s).saturating_sub(clock.tick)
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
            world: self.main.world(),
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
        self.frames.values().map(FrameView::of)
    }

    /// What a camera, by its number, would expose now if it were due: a picture of its whole sensor between two ticks. It
    /// changes nothing of the run, and counts for no exposure. None without pictures, and where there is no such camera.
    pub fn picture(&mut self, camera: usize) -> Result<Option<Frame>, SimulationError> {
        self.of_camera(camera, systems::photograph)
            .map(|frame| frame.map(Frame::of))
    }

    /// How far a camera, by its number, sees in each pixel now, what it sees there, and how that is turned; see [`Depth`].
    /// It changes nothing of the run. None without pictures, and where there is no such camera.
    pub fn depth(&mut self, camera: usize) -> Result<Option<Depth>, SimulationError> {
        self.of_camera(camera, systems::measure_depth)
    }

    fn of_camera<T>(
        &mut self,
        camera: usize,
        take: impl FnOnce(&mut World, Entity) -> Result<Option<T>, CaptureError>,
    ) -> Result<Option<T>, SimulationError> {
        let world = self.main.world_mut();
        let mut cameras = world.query::<(Entity, &SensorCamera)>();
        let found = cameras.iter(world).find(|(_, of)| of.index == camera);
        match found.map(|(entity, _)| entity) {
            Some(entity) => Ok(take(world, entity)?),
            None => Ok(None),
        }
    }

    /// What happened in the last step, in order of time.
    pub fn events(&self) -> &[Event] {
        self.watch.events()
    }

    /// Gives an order to the station that it names, or to every one. It counts from its `t_s` on, or from the next
    /// tick if that is past. An order that could not stand in a scenario is refused here. What becomes of others is an
    /// [`Event`] once they are due: so a law that nobody knows. A recording holds the scenario, and not these orders:
    /// [`Self::scenario_with_orders`] does.
    pub fn give(&mut self, order: &OrderConfig) -> Result<(), SimulationError> {
        match self.state {
            State::Goes => {}
            State::Over => return Err(SimulationError::Over),
            State::Failed => return Err(SimulationError::Failed),
        }
        self.loaded.scenario.check_order(order)?;
        let command = command(order, &self.loaded.scenario);
        let world = self.main.world_mut();
        let clock = *world.resource::<SimClock>();
        let tick = clock.ticks_of(order.t_s).max(clock.tick + 1);
        for (station, mut operator) in world.query::<(&Station, &mut Operator)>().iter_mut(world) {
            if station.obeys(order, &command) {
                operator.give(Order {
                    tick,
                    command: command.clone(),
                });
            }
        }
        Ok(())
    }

    /// The run's state, to go back to. It costs a copy of what changes in a run, some 0.1 ms for one station and one
    /// UAV; what a rendered frame in flight is still looked at for is waited for.
    ///
    /// It holds all that this program keeps: clocks, random streams, UAVs, wrecks, mount, tracks, laws, orders, history.
    /// A law of one's own is copied with its memory. The memory of a detector, a tracker's stage or an observer of one's
    /// own is not: such a run goes on bit for bit only if these have none.
    pub fn snapshot(&mut self) -> Result<Snapshot, SimulationError> {
        if self.state == State::Failed {
            return Err(SimulationError::Failed);
        }
        self.settle()?;
        let world = self.main.world_mut();
        Ok(Snapshot::of(
            self.id,
            world,
            self.state,
            &self.frames,
            &self.watch,
        ))
    }

    /// Goes back to a snapshot of this run, or on to one; from there it goes on bit for bit as it did before. Orders that
    /// were given after it are forgotten. A run that is recorded refuses: open it without a recording.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), SimulationError> {
        let recording = self.main.world().get_resource::<Recording>();
        let recorded = recording.is_some_and(|recording| recording.recorder.is_some());
        snapshot::refused(snapshot, self.id, self.state, recorded)?;
        // Answers on their way are of frames that have not been exposed now.
        self.settle()?;
        snapshot.put_back(self.main.world_mut());
        self.state = snapshot.state;
        self.frames = snapshot.frames.clone();
        self.watch = snapshot.watch.clone();
        Ok(())
    }

    /// Waits for all answers of the detector.
    fn settle(&mut self) -> Result<(), SimulationError> {
        answer_all(self.main.world_mut()).map_err(|error| {
            self.state = State::Failed;
            SimulationError::Run(RunError::Part(error))
        })
    }

    /// The scenario as TOML, with seed and orders of this run: run again, with the same parts, it is the same run.
    pub fn scenario_with_orders(&self) -> Result<String, toml::ser::Error> {
        with_orders(self.main.world(), &self.loaded, &self.options)
    }

    /// Sums the run up as far as it went, and writes nothing.
    pub fn summary(&mut self) -> Finished {
        let elapsed = self.started.elapsed();
        finish(self.main.world_mut(), &self.loaded, &self.options, elapsed)
    }

    /// Ends the run where it is: closes the recording, and writes summary and report beside it if it has a folder.
    pub fn finish(mut self) -> Result<Finished, SimulationError> {
        let elapsed = self.started.elapsed();
        let world = self.main.world_mut();
        Ok(conclude(world, &self.loaded, &self.options, elapsed)?)
    }

    /// The engine's world, for the parts of this program that look deeper than a view.
    pub(crate) fn world(&self) -> &World {
        self.main.world()
    }

    /// The same, to be prepared before the first tick.
    pub(crate) fn world_mut(&mut self) -> &mut World {
        self.main.world_mut()
    }
}
