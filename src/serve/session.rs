//! The run that is served, and what its clients want of it.

use super::convert;
use super::error::ServeError;
use super::inbox::Client;
use super::marks::{Mark, Marks};
use super::mavlink::{self, Doors};
use super::order;
use super::outside::{self, Link, OUTSIDE};
use super::pace::Pace;
use crate::output;
use crate::report::summary::Finished;
use crate::scenario::{Loaded, OrderConfig, RECORDED};
use crate::simulation::{Builder, Frame, Options, Simulation, SimulationError};
use crate::stop;
use crate::systems::detect::recorded;
use boresight_lockstep::MAX_REPLY_BYTES;
use boresight_lockstep::proto::{self, reply::What as Says, request::What as Wants};
use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use toml_edit::DocumentMut;

/// The file of what a detector outside has found, beside the recording.
const ANSWERS_FILE: &str = "answers.csv";
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
    /// With whom MAVLink is spoken.
    pub mavlink: mavlink::Arguments,
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

    /// Writes what the client found beside the recording, and returns the scenario that takes its answers from there.
    fn keep_answers(&self, folder: &Path, scenario: &str) -> Result<String, ServeError> {
        let table = recorded::table(&self.link.answers())
            .map_err(|error| ServeError::Answers(error.to_string()))?;
        output::put(&folder.join(ANSWERS_FILE), table)?;
        let mut document: DocumentMut = scenario
            .parse()
            .map_err(|error: toml_edit::TomlError| ServeError::Answers(error.to_string()))?;
        let detector = document["detector"].or_insert(toml_edit::table());
        detector["kind"] = toml_edit::value(RECORDED);
        detector["answers"] = toml_edit::value(ANSWERS_FILE);
        if !self.options.capture {
            // Without pictures nothing was seen to move.
            detector["moving"] = toml_edit::value(false);
        }
        Ok(document.to_string())
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
    marks: Marks,
    paused: bool,
    pace: Option<Pace>,
    doors: Doors,
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

impl From<ServeError> for Fault {
    fn from(error: ServeError) -> Self {
        Self::Fatal(error)
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

/// What those need who serve the run in another language.
impl Session {
    /// The run.
    pub(super) fn run(&self) -> &Simulation {
        &self.run
    }

    /// The same, to be looked at in ways that take its renderer.
    pub(super) fn run_mut(&mut self) -> &mut Simulation {
        &mut self.run
    }

    /// The newest frame of a camera, by its number.
    pub(super) fn newest(&self, camera: usize) -> Option<&Frame> {
        self.frames.get(&camera)
    }

    /// Whether the run leaves a recording.
    pub(super) fn records(&self) -> bool {
        self.opening.options.out.is_some()
    }

    /// Whether it is held.
    pub(super) fn paused(&self) -> bool {
        self.paused
    }

    /// Holds it, or lets it go on.
    pub(super) fn set_paused(&mut self, paused: bool) {
        self.paused = paused;
    }

    /// Lets one tick pass, whatever the clock says.
    pub(super) fn pass(&mut self) -> Result<(), ServeError> {
        self.step(1)
    }

    /// Gives an order, and keeps it; what is inside says why it is not taken.
    pub(super) fn obey(&mut self, order: OrderConfig) -> Result<Result<(), String>, ServeError> {
        match self.give(order) {
            Ok(()) => Ok(Ok(())),
            Err(Fault::Refused(why)) => Ok(Err(why)),
            Err(Fault::Fatal(error)) => Err(error),
        }
    }

    /// The run from its beginning, without the orders that were given.
    pub(super) fn begin_anew(self) -> Result<Self, ServeError> {
        let (again, _) = self.seek(proto::Seek {
            tick: 0,
            with_state: false,
        })?;
        Ok(again)
    }
}

impl Session {
    /// Opens the run, which goes by the clock if it has a pace.
    pub(super) fn open(mut opening: Opening) -> Result<Self, ServeError> {
        let run = opening.open()?;
        // A process starts its log once.
        opening.options.log = false;
        let doors = opening.mavlink.open(run.view(), &opening.loaded.scenario)?;
        let pace = (opening.options.pace).map(|factor| Pace::new(factor, run.view().tick_hz()));
        // Where an autopilot answers each tick, none waits for clients.
        let pace = pace.or_else(|| doors.flown().map(|_| Pace::free()));
        Ok(Self {
            opening,
            run,
            given: Vec::new(),
            frames: BTreeMap::new(),
            events: VecDeque::new(),
            first_event: 0,
            marks: Marks::default(),
            paused: false,
            pace,
            doors,
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
        let stands = !self.doors.ready() || self.paused || self.run.over() || self.lacks_detector();
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

    fn step(&mut self, ticks: u64) -> Result<(), ServeError> {
        for _ in 0..ticks {
            if self.run.over() {
                break;
            }
            let stopped = || stop::asked().is_some();
            for order in self.doors.before(self.run.view(), stopped)? {
                self.run.give(&order)?;
            }
            let over = self.run.step(1)?;
            self.keep();
            self.doors.after(self.run.view());
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

    /// Where MAVLink is spoken, a line each.
    pub(super) fn said(&self) -> Vec<String> {
        self.doors.said()
    }

    /// What went wrong on the way to ground stations, in words.
    pub(super) fn told(&mut self) -> Option<String> {
        let told = self.doors.ground()?.told()?;
        Some(format!("mavlink: messages {told}"))
    }

    /// Whether the run ends by itself when it is over.
    pub(super) fn goes_alone(&self) -> bool {
        self.doors.any()
    }

    /// Whether ground station or autopilot have been there.
    pub(super) fn had_any(&self) -> bool {
        self.doors.had_any()
    }

    /// Does what ground stations want; lines that tell of what is not offered.
    pub(super) fn hear(&mut self) -> Result<Vec<String>, ServeError> {
        let mut said = Vec::new();
        let view = self.run.view();
        let Some(ground) = self.doors.ground() else {
            return Ok(said);
        };
        for mut asked in ground.hear(view, &mut said) {
            let orders = std::mem::replace(&mut asked.orders, Ok(Vec::new()));
            let given = orders
                .map_err(Fault::Refused)
                .and_then(|orders| (orders.into_iter()).try_for_each(|order| self.give(order)));
            if let Err(Fault::Refused(why)) = &given {
                said.push(format!("mavlink: {why}"));
            }
            let given = match given {
                Ok(()) => Ok(()),
                Err(Fault::Refused(why)) => Err(why),
                Err(Fault::Fatal(error)) => return Err(error),
            };
            let view = self.run.view();
            if let Some(ground) = self.doors.ground() {
                ground.answer(view, &asked, given);
            }
        }
        Ok(said)
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
            Wants::TakeSnapshot(_) => self.take_snapshot(),
            Wants::Restore(restore) => self.restore(restore),
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
            return Err(
                "the run goes by the clock (--pace), or by its autopilot (--hil): pause it to step it".into(),
            );
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
        self.give(order::config(order)?)?;
        Ok(self.done())
    }

    /// Gives an order, and keeps it.
    fn give(&mut self, order: OrderConfig) -> Result<(), Fault> {
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
        Ok(())
    }

    /// Says why the run cannot go to a tick.
    fn may_seek(&self, tick: u64) -> Result<(), Fault> {
        let last = self.run.view().last_tick();
        if tick > last {
            return Err(
                format!("seek: tick {tick}: the run ends with tick {last} at the latest").into(),
            );
        }
        self.may_go_back("seek")?;
        self.may_tick()
    }

    /// Says why time cannot go back.
    fn may_go_back(&self, what: &str) -> Result<(), Fault> {
        match self.doors.flown() {
            Some(uav) => Err(format!(
                "{what}: an autopilot flies '{uav}' (--hil), and its time does not go back"
            )
            .into()),
            None => Ok(()),
        }
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
            marks,
            doors,
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
            marks: marks.forget(),
            paused,
            pace,
            // What is repeated is not told again.
            doors: Doors::default(),
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
        again.doors = doors;
        let said = again.stepped(seek.with_state);
        Ok((again, said))
    }

    fn take_snapshot(&mut self) -> Result<Says, Fault> {
        let run = self.run.snapshot()?;
        let tick = run.tick();
        let number = self.marks.keep(Mark {
            run,
            frames: self.frames.clone(),
            orders: self.given.len(),
            event: self.first_event + self.events.len() as u64,
        });
        Ok(Says::Snapshot(proto::Snapshot { number, tick }))
    }

    fn restore(&mut self, wanted: proto::Restore) -> Result<Says, Fault> {
        self.may_step()?;
        self.may_go_back("restore")?;
        let mark = self.marks.get(wanted.number)?;
        match self.run.restore(&mark.run) {
            Ok(()) => {}
            Err(error @ SimulationError::Recorded) => {
                return Err(format!("restore: {error}; seek begins it anew").into());
            }
            Err(error) => return Err(error.into()),
        }
        self.given.truncate(mark.orders);
        self.frames = mark.frames;
        let kept = mark.event.saturating_sub(self.first_event);
        self.events
            .truncate(usize::try_from(kept).unwrap_or(usize::MAX));
        if let Some(pace) = &mut self.pace {
            pace.stand();
        }
        Ok(self.stepped(wanted.with_state))
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
            let scenario = match self.opening.outside() {
                true => self.opening.keep_answers(folder, &scenario)?,
                false => scenario,
            };
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
