//! What a simulation is opened from and with.

use super::error::SimulationError;
use super::run::Simulation;
use super::view::View;
use crate::app;
use crate::components::beam::Propagations;
use crate::components::control::PointingLaws;
use crate::components::detect::{Detector, DetectorContext, Detectors};
use crate::components::flight::Uav;
use crate::components::mount::Stations;
use crate::components::record::OwnTopics;
use crate::components::run::{Cast, Failure, Options, PartError, SimClock, Tick, TickSet};
use crate::components::track::{self, TrackStage};
use crate::models::control::pointing::PointingLaw;
use crate::models::control::tuning::MountPlant;
use crate::models::decision::tracker::Tracker;
use crate::models::laser::propagation::{Propagation, PropagationContext};
use crate::recording::read::Recorded;
use crate::scenario::{Loaded, PAPER, Scenario};
use bevy::app::App;
use bevy::ecs::schedule::ScheduleCleanupPolicy;
use bevy::prelude::{Entity, IntoScheduleConfigs, SystemSet, World};
use schemars::JsonSchema;
use serde::Serialize;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// A part of the caller's own, to be added to a run before its set-up.
type Part = Box<dyn FnOnce(&mut App) -> Result<(), String>>;

impl Simulation {
    /// Opens a scenario (`.toml`), or a recording (`.mcap`) whose run is made again.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, SimulationError> {
        Self::builder(path).open()
    }

    /// To open a scenario or a recording with changes, options, and parts of one's own.
    pub fn builder(path: impl AsRef<Path>) -> Builder {
        Builder::file(path)
    }
}

/// A simulation to be opened: its scenario, changes to that, how it is run, and parts of the caller's own.
pub struct Builder {
    source: Source,
    set: Vec<String>,
    pictures: Option<bool>,
    options: Options,
    parts: Vec<Part>,
    stages: Vec<TrackStage>,
    topics: usize,
}

/// Topics of a caller's own are asked in the order in which they were added.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct TopicInTurn(usize);

/// Where a scenario comes from.
enum Source {
    /// A scenario file, or a recording whose scenario and seed are run again.
    File(PathBuf),
    /// The text of a scenario, and the folder that its paths lead on from.
    Text(String, PathBuf),
    /// One that has been loaded.
    Loaded(Box<Loaded>),
}

impl Builder {
    fn new(source: Source) -> Self {
        Self {
            source,
            set: Vec::new(),
            pictures: None,
            options: Options::default(),
            parts: Vec::new(),
            stages: Vec::new(),
            topics: 0,
        }
    }

    /// From a scenario file, or from a recording (`.mcap`), whose scenario runs again with its seed.
    pub fn file(path: impl AsRef<Path>) -> Self {
        Self::new(Source::File(path.as_ref().to_owned()))
    }

    /// From the text of a scenario that is no file. Paths in it lead on from `folder`; an error names the line of the text.
    ///
    /// ```
    /// use boresight::simulation::Builder;
    ///
    /// let text = std::fs::read_to_string("scenarios/urban_intercept.toml")?;
    /// let open = |text: String| Builder::from_text(text, "scenarios").set("detector.kind=truth").open();
    /// let mut run = open(text.clone())?;
    /// run.run_until(0.1)?;
    /// assert!(run.view().tick() > 0);
    ///
    /// let wrong = open(text.replace("power_w = 800.0", "power_w = -1")).err();
    /// assert!(wrong.is_some_and(|why| why.to_string().starts_with("scenario text, line ")));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn from_text(text: impl Into<String>, folder: impl AsRef<Path>) -> Self {
        Self::new(Source::Text(text.into(), folder.as_ref().to_owned()))
    }

    /// From a scenario that is there.
    pub fn loaded(loaded: Loaded) -> Self {
        Self::new(Source::Loaded(Box::new(loaded)))
    }

    /// Changes a value of the scenario, as `--set` does: `weather.visibility_m=5000`. A scenario that is there
    /// already takes no changes: opening it is an error then.
    pub fn set(mut self, change: impl Into<String>) -> Self {
        self.set.push(change.into());
        self
    }

    /// Another seed than the scenario's.
    pub fn seed(mut self, seed: u64) -> Self {
        self.options.seed = Some(seed);
        self
    }

    /// Whether cameras render. By default they do unless the scenario's detector is the truth, which looks at no
    /// picture.
    pub fn pictures(mut self, rendered: bool) -> Self {
        self.pictures = Some(rendered);
        self
    }

    /// Folder for recording, summary and report; without one nothing is written.
    pub fn record(mut self, out: impl AsRef<Path>) -> Self {
        self.options.out = Some(out.as_ref().to_owned());
        self
    }

    /// Address on which the topics are served to Foxglove while the run goes on.
    pub fn live(mut self, address: SocketAddr) -> Self {
        self.options.live = Some(address);
        self
    }

    /// Worker threads; they change no result.
    pub fn threads(mut self, threads: usize) -> Self {
        self.options.threads = Some(threads);
        self
    }

    /// All else that [`Options`] hold; what was said here before is lost.
    pub fn options(mut self, options: Options) -> Self {
        self.pictures = Some(options.capture);
        self.options = options;
        self
    }

    /// A detector that the scenario names as `detector.kind`. A faulty one ends the run with its error.
    pub fn detector(
        self,
        name: &str,
        make: impl Fn(&DetectorContext) -> Result<Box<dyn Detector>, PartError> + Send + Sync + 'static,
    ) -> Self {
        let name = name.to_owned();
        self.part(move |app| {
            let mut detectors = app.world_mut().resource_mut::<Detectors>();
            detectors.add(&name, make);
            Ok(())
        })
    }

    /// A pointing law that the scenario names as `controller.preset`, or an order as its law.
    pub fn law(
        self,
        name: &str,
        make: impl Fn(&MountPlant) -> Result<Box<dyn PointingLaw>, PartError> + Send + Sync + 'static,
    ) -> Self {
        let name = name.to_owned();
        self.part(move |app| {
            if name == PAPER {
                return Err(format!(
                    "law '{PAPER}': is the name of the paper's two loops; give it another"
                ));
            }
            app.world_mut()
                .resource_mut::<PointingLaws>()
                .add(&name, make);
            Ok(())
        })
    }

    /// A way for the laser's beam to cross the air, that the scenario names as `turbulence.propagation`.
    pub fn propagation(
        self,
        name: &str,
        make: impl Fn(&PropagationContext) -> Result<Box<dyn Propagation>, PartError>
        + Send
        + Sync
        + 'static,
    ) -> Self {
        let name = name.to_owned();
        self.part(move |app| {
            let mut propagations = app.world_mut().resource_mut::<Propagations>();
            propagations.add(&name, make);
            Ok(())
        })
    }

    /// What the tracker does in a stage, in place of what it does there by itself; once a stage.
    pub fn stage(
        mut self,
        stage: TrackStage,
        mut work: impl FnMut(&mut Stage) + Send + Sync + 'static,
    ) -> Self {
        let before = self.stages.contains(&stage);
        self.stages.push(stage);
        self.part(move |app| {
            if before {
                return Err(format!("{stage:?}: is replaced twice; do both in one"));
            }
            let all = ScheduleCleanupPolicy::RemoveSystemsOnly;
            app.remove_systems_in_set(Tick, stage, all)
                .map_err(|error| format!("{stage:?}: cannot be replaced: {error}"))?;
            let work = move |world: &mut World| work(&mut Stage { world });
            app.add_systems(Tick, work.in_set(stage));
            Ok(())
        })
    }

    /// A topic of JSON messages in the recording, such as `/mine/tracks`: so many times a second `say` looks at the
    /// run and may have something to say. A rate above the tick's is every tick. Names that begin with `/boresight/` are
    /// the program's own.
    pub fn topic<M: Serialize + JsonSchema + 'static>(
        mut self,
        topic: &str,
        rate_hz: u32,
        mut say: impl FnMut(View) -> Option<M> + Send + Sync + 'static,
    ) -> Self {
        let topic = topic.to_owned();
        let turn = self.topics;
        self.topics += 1;
        self.part(move |app| {
            let own = topic.starts_with('/') && !topic.starts_with("/boresight/");
            if !own || topic.contains(char::is_whitespace) {
                return Err(format!(
                    "topic '{topic}': is no name for a topic of one's own; give one such as /mine/tracks"
                ));
            }
            let topic = app.world_mut().resource_mut::<OwnTopics>().add::<M>(&topic);
            let publish = move |world: &mut World| {
                if !world.resource::<SimClock>().due(rate_hz.max(1)) {
                    return;
                }
                let Some(message) = say(View { world }) else {
                    return;
                };
                let published = world.resource_mut::<OwnTopics>().publish(topic, &message);
                if let Err(error) = published {
                    world.resource_mut::<Failure>().set(error);
                }
            };
            let place = publish.after(TickSet::Engage).before(TickSet::Record);
            let place = place.in_set(TopicInTurn(turn));
            match turn.checked_sub(1) {
                Some(before) => app.add_systems(Tick, place.after(TopicInTurn(before))),
                None => app.add_systems(Tick, place),
            };
            Ok(())
        })
    }

    fn part(mut self, part: impl FnOnce(&mut App) -> Result<(), String> + 'static) -> Self {
        self.parts.push(Box::new(part));
        self
    }

    /// Sets the run up, ready for its first tick.
    pub fn open(self) -> Result<Simulation, SimulationError> {
        let Self {
            source,
            set,
            pictures,
            mut options,
            parts,
            ..
        } = self;
        let loaded = match source {
            Source::Loaded(loaded) if set.is_empty() => *loaded,
            Source::Loaded(loaded) => {
                return Err(SimulationError::Changed(loaded.path));
            }
            Source::File(path) if path.extension().is_some_and(|end| end == "mcap") => {
                let recorded = Recorded::open(&path)?;
                options.seed = options.seed.or(Some(recorded.seed));
                recorded.scenario(&set)?
            }
            Source::File(path) => Scenario::load(&path, &set)?,
            Source::Text(text, folder) => Loaded::text(text, &folder, set)?,
        };
        options.capture = pictures.unwrap_or(!loaded.scenario.detector.is_blind());
        let mut refused = Ok(());
        let built = app::build_with(&loaded, &options, |app| {
            refused = parts.into_iter().try_for_each(|part| part(app));
        });
        refused.map_err(SimulationError::Part)?;
        let mut app = built?;
        let cast = cast(app.world_mut());
        app.insert_resource(cast);
        Ok(Simulation::of(app, loaded, options))
    }
}

/// The run in the middle of a tick, as a stage of the tracker finds it.
pub struct Stage<'a> {
    world: &'a mut World,
}

impl Stage<'_> {
    /// The run as it stands.
    pub fn view(&self) -> View<'_> {
        View { world: self.world }
    }

    /// Goes through the trackers of the stations, in the order of the scenario.
    pub fn each_tracker(&mut self, mut work: impl FnMut(&mut Tracker)) {
        let mut trackers = self.world.query::<&mut track::Tracker>();
        for mut tracker in trackers.iter_mut(self.world) {
            work(&mut tracker);
        }
    }
}

/// Who takes part in a run that is set up.
fn cast(world: &mut World) -> Cast {
    let mut flying: Vec<_> = (world.query::<(Entity, &Uav)>().iter(world))
        .map(|(entity, uav)| (uav.index, entity))
        .collect();
    flying.sort_unstable_by_key(|(index, _)| *index);
    Cast {
        stations: world.resource::<Stations>().0.clone(),
        flying: flying.into_iter().map(|(_, entity)| entity).collect(),
    }
}
