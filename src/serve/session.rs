//! The run that is served, and what its clients want of it.

use super::convert;
use super::error::ServeError;
use super::inbox::Client;
use super::order;
use super::outside::{self, Link, OUTSIDE};
use super::pace::Pace;
use crate::output;
use crate::report::summary::Finished;
use crate::scenario::{Loaded, OrderConfig};
use crate::simulation::{Builder, Frame, Options, Simulation, SimulationError};
use boresight_lockstep::MAX_REPLY_BYTES;
use boresight_lockstep::proto::{self, reply::What as Says, request::What as Wants};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Events that are kept, and those that are told at once.
const MOST_EVENTS: usize = 10_000;
const MOST_TOLD: usize = 1_000;
/// Orders of a run: more would be a fault of a client.
const MOST_ORDERS: usize = 1_000_000;

/// How a run is opened, and opened again.
pub(super) struct Opening {
    pub loaded: Loaded,
    pub options: Options,
    pub link: Arc<Link>,
    /// How long a detector outside may take for a frame.
    pub detector_timeout: Duration,
}

impl Opening {
    fn open(&self) -> Result<Simulation, SimulationError> {
        let (link, longest) = (self.link.clone(), self.detector_timeout);
        Builder::loaded(self.loaded.clone())
            .options(self.options.clone())
            .detector(OUTSIDE, move |context| {
                Ok(outside::make(link.clone(), longest, context))
            })
            .open()
    }

    /// Whether the run's detector is a client.
    pub(super) fn outside(&self) -> bool {
        self.loaded.scenario.detector.kind == OUTSIDE
    }
}

/// A run between two requests.
pub(super) struct Session {
    opening: Opening,
    run: Simulation,
    /// Orders that were taken, with the tick after which they came.
    given: Vec<(u64, OrderConfig)>,
    /// The newest frame of each camera, by its number.
    frames: BTreeMap<usize, Frame>,
    /// The last events, and the number of the first of them.
    events: VecDeque<proto::Event>,
    first_event: u64,
    paused: bool,
    pace: Option<Pace>,
}

/// What comes of a request.
#[allow(clippy::large_enum_variant)] // There is one at a time, and it is moved at once.
pub(super) enum Handled {
    /// This is said to the client.
    Say(Box<Says>),
    /// It is refused, in one line.
    Refuse(String),
    /// The run is to go to a tick.
    Seek(proto::Seek),
    /// The run is to be finished.
    Finish,
}

/// Why a request is not carried out: the client is told, or the run is at its end.
enum Fault {
    Refused(String),
    Fatal(ServeError),
}

impl From<String> for Fault {
    fn from(why: String) -> Self {
        Self::Refused(why)
    }
}

impl From<&str> for Fault {
    fn from(why: &str) -> Self {
        Self::Refused(why.to_owned())
    }
}

impl From<SimulationError> for Fault {
    fn from(error: SimulationError) -> Self {
        Self::Fatal(error.into())
    }
}

impl From<toml::ser::Error> for Fault {
    fn from(error: toml::ser::Error) -> Self {
        Self::Fatal(error.into())
    }
}

impl Session {
    /// Opens the run, which goes by the clock if it has a pace.
    pub(super) fn open(mut opening: Opening) -> Result<Self, ServeError> {
        let run = opening.open()?;
        // A process starts its log once.
        opening.options.log = false;
        let pace = opening
            .options
            .pace
            .map(|factor| Pace::new(factor, run.view().tick_hz()));
        Ok(Self {
            opening,
            run,
            given: Vec::new(),
            frames: BTreeMap::new(),
            events: VecDeque::new(),
            first_event: 0,
            paused: false,
            pace,
        })
    }

    /// What a client is told that is let in.
    pub(super) fn welcome(&self) -> proto::Welcome {
        let Options { pace, capture, .. } = self.opening.options;
        convert::welcome(&self.run, pace, capture, self.opening.outside())
    }

    /// Whether the run is over.
    pub(super) fn over(&self) -> bool {
        self.run.over()
    }

    /// How the run kept to the clock, if it went by it.
    pub(super) fn pace(&self) -> Option<&Pace> {
        self.pace.as_ref()
    }

    /// When the next tick begins of a run that goes by the clock; none while it stands still.
    pub(super) fn due(&mut self) -> Option<Instant> {
        let stands = self.paused || self.run.over() || self.lacks_detector();
        let tick = self.run.view().tick();
        let pace = self.pace.as_mut()?;
        if stands {
            pace.stand();
            return None;
        }
        Some(pace.due(tick))
    }

    fn lacks_detector(&self) -> bool {
        self.opening.outside() && !self.opening.link.is_there()
    }

    /// Lets one tick pass by the clock.
    pub(super) fn tick(&mut self) -> Result<(), ServeError> {
        self.step(1)?;
        let tick = self.run.view().tick();
        if let Some(pace) = &mut self.pace {
            pace.note(tick);
        }
        Ok(())
    }

    fn step(&mut self, ticks: u64) -> Result<(), SimulationError> {
        for _ in 0..ticks {
            let over = self.run.step(1)?;
            self.keep();
            if over {
                break;
            }
        }
        Ok(())
    }

    /// Keeps what the last tick has brought.
    fn keep(&mut self) {
        for frame in self.run.frames() {
            self.frames.insert(frame.camera_index(), frame.keep());
        }
        self.events
            .extend(self.run.events().iter().map(convert::event));
        while self.events.len() > MOST_EVENTS {
            self.events.pop_front();
            self.first_event += 1;
        }
    }

    /// Carries out a request. An error ends the run.
    pub(super) fn handle(&mut self, client: &Client, wants: Wants) -> Result<Handled, ServeError> {
        let said = match wants {
            Wants::Finish(_) => return Ok(Handled::Finish),
            Wants::Ping(_) => Ok(Says::Pong(proto::Pong {})),
            Wants::State(wanted) => Ok(Says::State(self.state(wanted))),
            Wants::Frames(wanted) => self.frames(&wanted).map(Says::Frames),
            Wants::Step(step) => self.step_for(step.ticks, step.with_state),
            Wants::RunUntil(until) => self.run_until(until),
            Wants::Pause(_) => Ok(self.hold(true)),
            Wants::Resume(_) => Ok(self.hold(false)),
            Wants::Order(order) => self.order(order),
            Wants::Seek(seek) => match self.may_seek(seek.tick) {
                Ok(()) => return Ok(Handled::Seek(seek)),
                Err(fault) => Err(fault),
            },
            Wants::Scenario(_) => (self.run.scenario_with_orders())
                .map(|toml| Says::Scenario(proto::Scenario { toml }))
                .map_err(Fault::from),
            Wants::Events(wanted) => Ok(Says::Events(self.events_from(wanted.from))),
            Wants::BeDetector(wanted) => self.be_detector(client, wanted),
            Wants::Hello(_) => Err("hello: has been said before".into()),
            Wants::Detected(_) => Err("detected: answers a question alone".into()),
        };
        match said {
            Ok(said) => Ok(Handled::Say(Box::new(said))),
            Err(Fault::Refused(why)) => Ok(Handled::Refuse(why)),
            Err(Fault::Fatal(error)) => Err(error),
        }
    }

    fn state(&self, wanted: proto::GetState) -> proto::State {
        let (late_ticks, most_late_s) = self.pace.as_ref().map_or((0, 0.0), Pace::late);
        proto::State {
            over: self.run.over(),
            paused: self.paused,
            late_ticks,
            most_late_s,
            ..convert::state(self.run.view(), wanted)
        }
    }

    fn frames(&self, wanted: &proto::GetFrames) -> Result<proto::Frames, Fault> {
        let known: Vec<String> = (self.run.view().stations())
            .flat_map(|station| station.cameras().map(|camera| camera.name().to_owned()))
            .collect();
        if let Some(name) = wanted.cameras.iter().find(|name| !known.contains(name)) {
            return Err(
                format!("frames: no camera '{name}': there are {}", known.join(", ")).into(),
            );
        }
        let of =
            |name: &str| wanted.cameras.is_empty() || wanted.cameras.iter().any(|of| of == name);
        let frames: Vec<_> = (self.frames.values().map(Frame::view))
            .filter(|frame| {
                of(frame.camera()) && (frame.tick() > wanted.after_tick || wanted.after_tick == 0)
            })
            .collect();
        let bytes = frames
            .iter()
            .filter_map(|frame| frame.rgb8())
            .map(<[u8]>::len)
            .sum::<usize>();
        if wanted.pixels && bytes > MAX_REPLY_BYTES / 2 {
            return Err(format!(
                "frames: {bytes} bytes of pixels are too many at once; ask camera by camera"
            )
            .into());
        }
        let frames = frames
            .into_iter()
            .map(|frame| convert::frame(frame, wanted.pixels, true));
        Ok(proto::Frames {
            frames: frames.collect(),
        })
    }

    /// Says why nobody may step now.
    fn may_step(&self) -> Result<(), Fault> {
        if self.pace.is_some() && !self.paused {
            return Err("the run goes by the clock (--pace): pause it to step it".into());
        }
        if self.pace.is_none() && self.paused {
            return Err("the run is paused: resume it first".into());
        }
        self.may_tick()
    }

    /// Says why no tick can pass now.
    fn may_tick(&self) -> Result<(), Fault> {
        if self.lacks_detector() {
            return Err(format!(
                "the scenario's detector is a client (detector.kind = \"{OUTSIDE}\"), and none is it: send be_detector first"
            )
            .into());
        }
        Ok(())
    }

    fn step_for(&mut self, ticks: u64, with_state: bool) -> Result<Says, Fault> {
        self.may_step()?;
        self.step(ticks)?;
        Ok(self.stepped(with_state))
    }

    fn run_until(&mut self, until: proto::RunUntil) -> Result<Says, Fault> {
        self.may_step()?;
        if !until.t_s.is_finite() {
            return Err("run_until: t_s: must be a number of seconds".into());
        }
        self.step(self.run.ticks_until(until.t_s))?;
        Ok(self.stepped(until.with_state))
    }

    fn stepped(&self, with_state: bool) -> Says {
        let view = self.run.view();
        Says::Stepped(proto::Stepped {
            tick: view.tick(),
            state_hash: view.state_hash(),
            over: self.run.over(),
            state: with_state.then(|| self.state(proto::GetState::default())),
        })
    }

    fn done(&self) -> Says {
        Says::Done(proto::Done {
            tick: self.run.view().tick(),
        })
    }

    fn hold(&mut self, paused: bool) -> Says {
        self.paused = paused;
        self.done()
    }

    fn order(&mut self, order: proto::Order) -> Result<Says, Fault> {
        let order = order::config(order)?;
        if self.given.len() >= MOST_ORDERS {
            return Err(format!(
                "order: {MOST_ORDERS} were given in this run, and more are not taken"
            )
            .into());
        }
        match self.run.give(&order) {
            Ok(()) => {}
            Err(error @ (SimulationError::Order(_) | SimulationError::Over)) => {
                return Err(error.to_string().into());
            }
            Err(error) => return Err(error.into()),
        }
        self.given.push((self.run.view().tick(), order));
        Ok(self.done())
    }

    /// Says why the run cannot go to a tick.
    fn may_seek(&self, tick: u64) -> Result<(), Fault> {
        let last = self.run.view().last_tick();
        if tick > last {
            return Err(
                format!("seek: tick {tick}: the run ends with tick {last} at the latest").into(),
            );
        }
        self.may_tick()
    }

    /// Opens the run anew and repeats it with its orders, but those given at or after a tick, up to that tick; and what
    /// is said of that to a client.
    pub(super) fn seek(self, seek: proto::Seek) -> Result<(Self, Says), ServeError> {
        let Self {
            opening,
            run,
            given,
            paused,
            pace,
            ..
        } = self;
        // It closes its recording before another takes that one's place.
        drop(run);
        let mut again = Self {
            run: opening.open()?,
            opening,
            given: Vec::new(),
            frames: BTreeMap::new(),
            events: VecDeque::new(),
            first_event: 0,
            paused,
            pace,
        };
        for (tick, order) in given.into_iter().filter(|(tick, _)| *tick < seek.tick) {
            again.step(tick.saturating_sub(again.run.view().tick()))?;
            again.run.give(&order)?;
            again.given.push((tick, order));
        }
        again.step(seek.tick.saturating_sub(again.run.view().tick()))?;
        if let Some(pace) = &mut again.pace {
            pace.stand();
        }
        let said = again.stepped(seek.with_state);
        Ok((again, said))
    }

    fn events_from(&self, from: u64) -> proto::Events {
        let first = from.max(self.first_event);
        let skipped = usize::try_from(first - self.first_event).unwrap_or(usize::MAX);
        let told: Vec<_> = self
            .events
            .iter()
            .skip(skipped)
            .take(MOST_TOLD)
            .cloned()
            .collect();
        let end = self.first_event + self.events.len() as u64;
        proto::Events {
            next: first.min(end) + told.len() as u64,
            events: told,
            end,
            lost: self.first_event.saturating_sub(from),
        }
    }

    fn be_detector(&mut self, client: &Client, wanted: proto::BeDetector) -> Result<Says, Fault> {
        if !self.opening.outside() {
            let kind = &self.opening.loaded.scenario.detector.kind;
            return Err(format!(
                "be_detector: the scenario's detector is \"{kind}\": set detector.kind=\"{OUTSIDE}\""
            )
            .into());
        }
        self.opening.link.join(client, wanted)?;
        Ok(self.done())
    }

    /// Ends the run where it is, and writes what it leaves; what is said of that to a client, and the results.
    pub(super) fn finish(self) -> Result<(Says, Finished), ServeError> {
        let folder = self.opening.options.out.as_ref();
        let view = self.run.view();
        let (tick, state_hash) = (view.tick(), view.state_hash());
        let scenario = folder
            .map(|_| self.run.scenario_with_orders())
            .transpose()?;
        let finished = self.run.finish()?;
        if let (Some(folder), Some(scenario)) = (folder, scenario) {
            output::put(&folder.join("scenario.toml"), scenario)?;
        }
        let said = Says::Finished(proto::Finished {
            tick,
            state_hash,
            outcome: finished.summary.outcome.name().to_owned(),
            reason: finished.summary.reason.clone(),
            folder: folder
                .map(|folder| folder.display().to_string())
                .unwrap_or_default(),
        });
        Ok((said, finished))
    }
}
