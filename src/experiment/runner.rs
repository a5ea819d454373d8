//! Runs for several threads, each to be looked at as its caller likes.

use crate::models::ground::city::{City, CityParams};
use crate::parameters::environment::city_of;
use crate::place::made_from;
use crate::scenario::{Loaded, Site};
use crate::simulation::{Builder, Options, Simulation, SimulationError};
use crate::stop;
use serde_json::Value;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Cities that are kept for further runs.
const MOST_CITIES: usize = 8;

/// What tells cities apart: their parameters, and for a real one its site.
type CityKey = (CityParams, Option<Site>);

/// Why nothing is known of a run.
#[derive(Debug, thiserror::Error)]
pub enum Unmade {
    /// It was stopped from outside before its end, or not begun.
    #[error("stopped")]
    Stopped,
    /// It failed.
    #[error(transparent)]
    Failed(#[from] SimulationError),
    /// The program did.
    #[error("a fault of the program: {0}")]
    Fault(String),
}

/// Makes runs for several threads: what is made of many runs, sweeps, tests and evaluations, goes through it.
#[derive(Default)]
pub struct Runner {
    /// Held while something renders: the software rasteriser takes all cores for itself.
    rendering: Mutex<()>,
    cities: Mutex<Vec<(CityKey, Arc<City>)>>,
}

impl Runner {
    /// Opens a run with a seed, and gives what `work` makes of it. Without pictures the detector must need none. A fault
    /// of the program in one run does not take the others with it.
    /// One that was stopped midway is over, too: its caller asks.
    pub fn make<T>(
        &self,
        loaded: &Loaded,
        seed: u64,
        pictures: bool,
        work: impl FnOnce(Simulation) -> Result<T, SimulationError>,
    ) -> Result<T, Unmade> {
        let _one = pictures.then(|| {
            self.rendering
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
        });
        if stop::asked().is_some() {
            return Err(Unmade::Stopped);
        }
        let run = || {
            let options = Options {
                seed: Some(seed),
                one_thread: !pictures,
                capture: pictures,
                city: (!pictures).then(|| self.city(loaded)).flatten(),
                ..Options::default()
            };
            work(Builder::loaded(loaded.clone()).options(options).open()?)
        };
        match catch_unwind(AssertUnwindSafe(run)) {
            Ok(result) => Ok(result?),
            Err(panic) => {
                let said = (panic.downcast_ref::<String>().map(String::as_str))
                    .or_else(|| panic.downcast_ref::<&str>().copied());
                Err(Unmade::Fault(said.unwrap_or("no message").to_owned()))
            }
        }
    }

    /// Makes a run to its end and gives its summary, and the time it took.
    pub fn summary(
        &self,
        loaded: &Loaded,
        seed: u64,
        pictures: bool,
    ) -> Result<(Value, Duration), Unmade> {
        let started = Instant::now();
        let summary = self.make(loaded, seed, pictures, |mut run| {
            run.step(u64::MAX)?;
            Ok(serde_json::to_value(run.summary().summary).unwrap_or_default())
        })?;
        // A summary of half a run is none.
        match summary["stopped_s"].is_null() {
            true => Ok((summary, started.elapsed())),
            false => Err(Unmade::Stopped),
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
