//! The experiment file, and the runs that follow from it.

mod columns;
mod factor;
mod file;
mod hash;
mod runs;
mod sampling;

pub use factor::{Factor, Setting};
pub use file::{Experiment, FactorConfig, Level, Sampling};
pub use runs::{Plan, PlannedRun};

use crate::scenario::load::{self, Parsed};
use crate::scenario::{InputError, Loaded, Seeds};
use columns::{columns_apart, kept};
use factor::Values;
use file::MOST_RUNS;
use hash::{digest, hash_of, named_files};
use sampling::strata;
use std::collections::BTreeMap;
use std::path::Path;

/// Why a detector is refused.
const NEEDS_PICTURES: &str = "detector.kind = \"onnx\" needs pictures: add pictures = true, or \"detector.kind=truth\" to set";

impl Plan {
    /// Reads an experiment, and tries every value of every factor on the scenario.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let path = &crate::data::found(path);
        let text = load::read(path)?;
        let file = path.display().to_string();
        let Parsed {
            value: experiment,
            places,
        } = load::parse::<Experiment>(&text, &file, &[])?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let scenario = folder.join(&experiment.scenario);
        let source = load::read(&scenario)?;
        let factors: Vec<Factor> = experiment.factors.iter().map(Factor::of).collect();
        let base = Loaded::parse(source.clone(), scenario.clone(), experiment.set.clone())?;
        let seeds = (experiment.seeds.as_ref()).map(Seeds::count).unwrap_or(1);
        let points = match experiment.samples {
            Some(samples) => u64::from(samples),
            None => factors
                .iter()
                .fold(1, |all: u64, factor| all.saturating_mul(factor.count())),
        };
        let runs = points.saturating_mul(seeds);
        if !(1..=MOST_RUNS).contains(&runs) {
            let what = format!(
                "{points} points with {seeds} seeds each are {runs} runs, must be from 1 to {MOST_RUNS}: take fewer \
                 values, or sampling = \"sobol\" with samples"
            );
            return Err(places.refuse("factors", what));
        }
        let strata = match experiment.sampling {
            Sampling::LatinHypercube => (0..factors.len())
                .map(|factor| strata(points, factor as u64))
                .collect(),
            _ => Vec::new(),
        };
        let figures = kept(&experiment, &base.scenario, &places)?;
        columns_apart(&factors, &figures, &places)?;
        for (index, factor) in factors.iter().enumerate() {
            if let Some(label) = factor.repeated(experiment.sampling == Sampling::Grid) {
                let what = format!("takes '{label}' twice: leave one out, or take fewer steps");
                return Err(places.refuse(&format!("factors[{index}]"), what));
            }
        }
        let plan = Self {
            figures,
            hash: String::new(),
            files: BTreeMap::new(),
            seeds: match &experiment.seeds {
                Some(seeds) => seeds.all(),
                None => vec![base.scenario.seed],
            },
            experiment,
            factors,
            scenario,
            source,
            points,
            strata,
        };
        let blind = !plan.experiment.pictures;
        let shared = named_files(&base.scenario);
        let mut files = BTreeMap::new();
        // A factor may choose the detector; one that does not is held to the scenario's.
        let chooses = |set: &String| {
            let key = set.split_once('=').map_or("", |(key, _)| key.trim());
            ["detector", "detector.kind"].contains(&key)
        };
        let mut chosen = false;
        for (index, factor) in plan.factors.iter().enumerate() {
            let trials = match &factor.values {
                Values::List(list) => list.clone(),
                Values::Range { .. } => [0.0, 1.0].map(|u| factor.between(u)).into(),
            };
            chosen |= trials.iter().all(|setting| setting.set.iter().any(chooses));
            for setting in trials {
                let at = |what: String| {
                    let what = format!("{} = {}: {what}", factor.name, setting.label);
                    places.refuse(&format!("factors[{index}]"), what)
                };
                let loaded = plan
                    .load(&setting.set)
                    .map_err(|error| at(error.to_string()))?;
                if blind && setting.set.iter().any(chooses) && loaded.scenario.detector.is_onnx() {
                    return Err(at(NEEDS_PICTURES.into()));
                }
                let own = &named_files(&loaded.scenario) - &shared;
                files.insert((index, setting.label), digest(&own));
            }
        }
        if blind && !chosen && base.scenario.detector.is_onnx() {
            return Err(places.refuse("pictures", NEEDS_PICTURES));
        }
        let Experiment {
            name,
            set,
            pictures,
            ..
        } = &plan.experiment;
        let keys = plan.figures.iter().map(|(key, _)| key.as_str());
        let words = [name.as_str(), if *pictures { "pictures" } else { "blind" }];
        let words = words
            .into_iter()
            .chain(set.iter().map(String::as_str))
            .chain(keys);
        let hash = hash_of(words.chain([plan.source.as_str()]), digest(&shared));
        Ok(Self {
            hash,
            files,
            ..plan
        })
    }
}

#[cfg(test)]
mod tests;
