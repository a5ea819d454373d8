//! The runs of an experiment: each one's values, key, scenario and command.

use super::factor::{Factor, Setting};
use super::file::Experiment;
use super::hash::hash_of;
use super::sampling::settings;
use crate::experiment::figures::Kind;
use crate::scenario::{InputError, Loaded};
use std::collections::BTreeMap;
use std::path::PathBuf;
use xxhash_rust::xxh3::xxh3_64;

/// A run of an experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedRun {
    /// Its number, from 0.
    pub index: u64,
    /// The factors' values, in their order.
    pub settings: Vec<Setting>,
    /// Its seed.
    pub seed: u64,
}

/// An experiment with its runs.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The file.
    pub experiment: Experiment,
    /// The factors.
    pub factors: Vec<Factor>,
    /// Figures that are kept, with what they are.
    pub figures: Vec<(String, Kind)>,
    /// Hash of what all runs share, but for the program: the scenario with what every run changes, the models, UAVs and
    /// flights that it names, and the figures that are kept. What such a file names itself is not in it.
    pub hash: String,
    /// For a factor and a value's label a digest of the files that only this value names.
    pub(super) files: BTreeMap<(usize, String), u64>,
    /// The scenario's path, and its text.
    pub(super) scenario: PathBuf,
    pub(super) source: String,
    pub(super) seeds: Vec<u64>,
    pub(super) points: u64,
    /// For each factor of a Latin hypercube the place of each point.
    pub(super) strata: Vec<Vec<f64>>,
}

impl Plan {
    /// What a run follows from beside what all share, as a hash: changes, files that these name, seed. The number of a run
    /// is not in it, so that an experiment with more seeds or values has the runs of the one with fewer.
    pub fn key(&self, run: &PlannedRun) -> String {
        let changes = run.settings.iter().flat_map(|setting| &setting.set);
        let files = run.settings.iter().enumerate().map(|(index, setting)| {
            // A value of a range names no file; its ends do.
            let own = self.files.get(&(index, setting.label.clone()));
            own.copied().unwrap_or_default()
        });
        let files = files.filter(|digest| *digest != 0);
        let rest: Vec<u8> = (files.chain([run.seed]))
            .flat_map(u64::to_le_bytes)
            .collect();
        hash_of(changes.map(String::as_str), xxh3_64(&rest))
    }

    /// How many runs there are.
    pub fn runs(&self) -> u64 {
        self.points * self.seeds.len() as u64
    }

    /// How many seeds every point has.
    pub fn seeds(&self) -> usize {
        self.seeds.len()
    }

    /// A run by its number; the seeds of a point stand together.
    pub fn run(&self, index: u64) -> PlannedRun {
        let seeds = self.seeds.len() as u64;
        let (point, seed) = (index / seeds, index % seeds);
        let sampling = self.experiment.sampling;
        let settings = settings(&self.factors, sampling, &self.strata, point);
        PlannedRun {
            index,
            settings,
            seed: self.seeds[seed as usize],
        }
    }

    /// The scenario of a run.
    pub fn scenario(&self, run: &PlannedRun) -> Result<Loaded, InputError> {
        let changes = run.settings.iter().flat_map(|setting| &setting.set);
        self.load(&changes.cloned().collect::<Vec<_>>())
    }

    /// The command that makes a run again.
    pub fn command(&self, run: &PlannedRun) -> String {
        let changes = run.settings.iter().flat_map(|setting| &setting.set);
        let mut command = format!(
            "boresight run {} --seed {}",
            crate::output::quoted(self.scenario.display()),
            run.seed
        );
        for change in self.experiment.set.iter().chain(changes) {
            command += &format!(" --set {}", crate::output::quoted(change));
        }
        if !self.experiment.pictures {
            command += " --no-capture";
        }
        command
    }

    pub(super) fn load(&self, changes: &[String]) -> Result<Loaded, InputError> {
        let set = self.experiment.set.iter().chain(changes).cloned().collect();
        Loaded::parse(self.source.clone(), self.scenario.clone(), set)
    }
}
