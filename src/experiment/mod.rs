//! Experiments on scenarios: what a run must show, and how it is found out.

pub mod diff;
pub mod figures;
pub mod sweep;
pub mod test;

use crate::models::ground::city::{City, CityParams};
use crate::output::OutputError;
use crate::parameters::environment::city_of;
use crate::place::made_from;
use crate::recording::read::ReadError;
use crate::scenario::{InputError, Loaded, Site};
use crate::simulation::{Builder, Options, SimulationError};
use crate::stop;
use serde_json::Value;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Why an experiment cannot be carried out.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A scenario.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A file that it leaves.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A path without scenarios.
    #[error("{}: {what}", path.display())]
    Path {
        /// The path.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A tolerance of `diff`.
    #[error("--tolerance {0}: is no tolerance; write FIELD=MOST such as azimuth_rad=1e-9")]
    Tolerance(String),
    /// No folder for what is thrown away afterwards.
    #[error("no temporary folder: {0}; set TMPDIR to one with room")]
    Folder(std::io::Error),
    /// The program cannot be read to tell its build from others.
    #[error("this program cannot be read: {0}; start it by its path")]
    Program(std::io::Error),
    /// A recording.
    #[error(transparent)]
    Recording(#[from] ReadError),
    /// What was found cannot be written as JSON or XML.
    #[error("{}: cannot be written: {message}; name another file or folder", path.display())]
    Text {
        /// The file.
        path: PathBuf,
        /// What the writer says.
        message: String,
    },
}

/// Cities that are kept for further runs.
const MOST_CITIES: usize = 8;

/// What tells cities apart: their parameters, and for a real one its site.
type CityKey = (CityParams, Option<Site>);

/// Why a run has no summary.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum NoSummary {
    /// It was stopped from outside before its end, or not begun.
    Stopped,
    /// It failed; why.
    Failed(String),
}

/// Makes runs for several threads.
#[derive(Default)]
pub(crate) struct Runner {
    /// Held while something renders: the software rasteriser takes all cores for itself.
    rendering: Mutex<()>,
    cities: Mutex<Vec<(CityKey, Arc<City>)>>,
}

impl Runner {
    /// Makes a run to its end and gives its summary, and the time it took; without pictures the detector must need
    /// none. A fault of the program in one run does not take the others with it.
    pub(crate) fn run(
        &self,
        loaded: &Loaded,
        seed: u64,
        pictures: bool,
    ) -> Result<(Value, Duration), NoSummary> {
        let _one = pictures.then(|| {
            self.rendering
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
        });
        if stop::asked().is_some() {
            return Err(NoSummary::Stopped);
        }
        let run = || -> Result<(Value, Duration), SimulationError> {
            let options = Options {
                seed: Some(seed),
                one_thread: !pictures,
                capture: pictures,
                city: (!pictures).then(|| self.city(loaded)).flatten(),
                ..Options::default()
            };
            let started = Instant::now();
            let mut run = Builder::loaded(loaded.clone()).options(options).open()?;
            while !run.step(u64::MAX)? {}
            let summary = serde_json::to_value(run.summary().summary).unwrap_or_default();
            Ok((summary, started.elapsed()))
        };
        match catch_unwind(AssertUnwindSafe(run)) {
            // A summary of half a run is none.
            Ok(Ok((summary, _))) if !summary["stopped_s"].is_null() => Err(NoSummary::Stopped),
            Ok(result) => result.map_err(|error| NoSummary::Failed(error.to_string())),
            Err(panic) => {
                let said = (panic.downcast_ref::<String>().map(String::as_str))
                    .or_else(|| panic.downcast_ref::<&str>().copied());
                let said = said.unwrap_or("no message");
                Err(NoSummary::Failed(format!("a fault of the program: {said}")))
            }
        }
    }

    /// The city of a scenario; `None` where the run itself will say what is wrong with it.
    fn city(&self, loaded: &Loaded) -> Option<Arc<City>> {
        let scenario = &loaded.scenario;
        let folder = loaded.path.parent().unwrap_or(Path::new(""));
        let site = scenario.city.is_real().then(|| scenario.site.clone());
        let key = (made_from(&scenario.city, folder), site);
        let mut known = self.cities.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, city)) = known.iter().find(|(of, _)| *of == key) {
            return Some(city.clone());
        }
        let city = city_of(loaded).ok()?;
        // A sweep over cities needs each one for a while only.
        if known.len() >= MOST_CITIES {
            known.remove(0);
        }
        known.push((key, city.clone()));
        Some(city)
    }
}
