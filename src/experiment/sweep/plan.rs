//! The experiment file, and the runs that follow from it.

use crate::experiment::figures::{self, Kind};
use crate::models::flight::trajectory::Trajectory;
use crate::models::maths::rng::Stream;
use crate::scenario::check::Check;
use crate::scenario::load::{self, Checked, Parsed};
use crate::scenario::{InputError, Loaded, Places, Scenario, Seeds};
use schemars::JsonSchema;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// Most runs of an experiment.
const MOST_RUNS: u64 = 1_000_000;
/// Most points and factors of the Sobol sequence: beyond them it has no more.
const MOST_SOBOL: (u32, usize) = (1 << 16, sobol_burley::NUM_DIMENSIONS as usize);

/// A sweep over a scenario: `boresight sweep` reads it from TOML.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// Its name.
    pub name: String,
    /// What it finds out, for people.
    #[serde(default)]
    pub description: String,
    /// The scenario that is varied, from the folder of this file.
    pub scenario: PathBuf,
    /// Changes to it in every run, as `KEY=VALUE`.
    #[serde(default)]
    pub set: Vec<String>,
    /// Whether cameras render; without it the detector must be one that needs no pictures.
    #[serde(default)]
    pub pictures: bool,
    /// Seeds of every point, "from..=to" or a list; absent: the scenario's seed.
    pub seeds: Option<Seeds>,
    /// What is varied.
    pub factors: Vec<FactorConfig>,
    /// How points are chosen from the factors: "grid" takes every combination.
    #[serde(default)]
    pub sampling: Sampling,
    /// Number of points of a sampling other than the grid.
    pub samples: Option<u32>,
    /// Figures of `summary.json` that the table has, by their keys as in `[expect.values]`; none: the usual ones.
    #[serde(default)]
    pub keep: Vec<String>,
}

/// How points are chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Sampling {
    /// Every combination.
    #[default]
    Grid,
    /// As many strata of every factor as there are points, each used once, combined at random (McKay, Beckman and
    /// Conover 1979).
    LatinHypercube,
    /// Sobol's sequence with Owen's scrambling (Burley 2020).
    Sobol,
}

/// A factor: a key of the scenario with its values, or levels that each change several.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FactorConfig {
    /// Name of its column; absent: the key.
    pub name: Option<String>,
    /// The scenario's key, as for `--set`.
    pub key: Option<String>,
    /// A list of values.
    #[schemars(with = "Option<Vec<serde_json::Value>>")]
    pub values: Option<Vec<toml::Value>>,
    /// A range, with both ends.
    pub range: Option<[f64; 2]>,
    /// Values of the range in a grid.
    pub steps: Option<u32>,
    /// Whether the range is divided evenly in its logarithm.
    #[serde(default)]
    pub log: bool,
    /// Whether values of the range are rounded to whole numbers.
    #[serde(default)]
    pub whole: bool,
    /// Levels by name, in place of a key.
    pub levels: Option<Vec<Level>>,
}

/// A level of a factor.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Level {
    /// Its name in the table.
    pub name: String,
    /// What it changes, as `KEY=VALUE`.
    pub set: Vec<String>,
}

impl Checked for Experiment {
    fn check(&self, check: &mut Check) {
        check.that(!self.name.trim().is_empty(), "name", || {
            "must not be empty".into()
        });
        check.that(!self.factors.is_empty(), "factors", || {
            "varies nothing: give at least one [[factors]]".into()
        });
        let grid = self.sampling == Sampling::Grid;
        check.that(grid == self.samples.is_none(), "samples", || match grid {
            true => "a grid has as many points as combinations: leave it out".into(),
            false => "says how many points the sampling takes: give it".into(),
        });
        check.that(self.samples != Some(0), "samples", || {
            "must be at least 1".into()
        });
        if self.sampling == Sampling::Sobol {
            let (points, factors) = MOST_SOBOL;
            check.that(
                self.samples.is_none_or(|samples| samples <= points),
                "samples",
                || {
                    format!(
                        "the Sobol sequence has {points} points: take no more, or latin_hypercube"
                    )
                },
            );
            check.that(self.factors.len() <= factors, "factors", || {
                format!("the Sobol sequence has {factors} dimensions: take no more factors, or latin_hypercube")
            });
        }
        if let Some(seeds) = &self.seeds {
            seeds.check(check, MOST_RUNS);
        }
        let mut names: Vec<&str> = Vec::new();
        for (index, factor) in self.factors.iter().enumerate() {
            check.table(&format!("factors[{index}]"), |check| {
                factor.check(check, grid);
                let name = factor.name();
                check.that(!names.contains(&name), "name", || {
                    format!("the name '{name}' is taken by an earlier factor")
                });
            });
            names.push(factor.name());
        }
    }
}

impl FactorConfig {
    fn name(&self) -> &str {
        (self.name.as_deref().or(self.key.as_deref())).unwrap_or("")
    }

    fn check(&self, check: &mut Check, grid: bool) {
        let kinds = [
            self.values.is_some(),
            self.range.is_some(),
            self.levels.is_some(),
        ];
        let given = kinds.iter().filter(|given| **given).count();
        check.that(given == 1, "values", || {
            format!("a factor has one of values, range and levels, found {given}")
        });
        check.that(self.key.is_some() != self.levels.is_some(), "key", || {
            "a factor has a key with values or a range, or else levels".into()
        });
        check.that(!self.name().is_empty(), "name", || {
            "a factor of levels needs a name".into()
        });
        let mut keys = self.key.iter().map(String::as_str).chain(
            (self.levels.iter().flatten().flat_map(|level| &level.set))
                .filter_map(|set| Some(set.split_once('=')?.0)),
        );
        check.that(!keys.any(|key| key.trim() == "seed"), "key", || {
            "a factor does not change the seed: say which the runs have with seeds".into()
        });
        let empty = self.values.as_ref().is_some_and(Vec::is_empty)
            || self.levels.as_ref().is_some_and(Vec::is_empty);
        check.that(!empty, "values", || "must not be empty".into());
        if let Some([from, to]) = self.range {
            check.that(
                from.is_finite() && to.is_finite() && from < to,
                "range",
                || format!("found [{from}, {to}], the first must be below the second"),
            );
            check.that(!self.log || from > 0.0, "range", || {
                format!("found [{from}, {to}], a logarithmic range begins above 0")
            });
            check.that(
                !grid || self.steps.is_some_and(|steps| steps >= 2),
                "steps",
                || "a range in a grid needs at least 2 steps".into(),
            );
            let whole = !self.whole || (from.fract() == 0.0 && to.fract() == 0.0);
            check.that(whole, "range", || {
                format!("found [{from}, {to}], a range of whole numbers has whole ends")
            });
        }
    }
}

/// A factor's value in a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// As the table has it.
    pub label: String,
    /// The number that it is, if it is one.
    pub number: Option<f64>,
    /// The changes to the scenario.
    pub set: Vec<String>,
}

/// A factor, ready to use.
#[derive(Clone, Debug, PartialEq)]
pub struct Factor {
    /// Name of its column.
    pub name: String,
    values: Values,
}

#[derive(Clone, Debug, PartialEq)]
enum Values {
    List(Vec<Setting>),
    Range {
        key: String,
        ends: [f64; 2],
        steps: u32,
        log: bool,
        whole: bool,
    },
}

impl Factor {
    fn of(config: &FactorConfig) -> Self {
        let key = config.key.clone().unwrap_or_default();
        let listed = |value: &toml::Value| {
            let label = match value {
                toml::Value::String(text) => text.clone(),
                // The shortest text that is this number, with an exponent where it is long.
                toml::Value::Float(number) => format!("{number:?}"),
                other => other.to_string(),
            };
            let whole = value.as_integer().map(|whole| whole as f64);
            Setting {
                label,
                number: value.as_float().or(whole),
                set: vec![format!("{key}={value}")],
            }
        };
        let level = |level: &Level| Setting {
            label: level.name.clone(),
            number: level.name.parse().ok(),
            set: level.set.clone(),
        };
        let values = match (&config.values, &config.levels, config.range) {
            (Some(values), ..) => Values::List(values.iter().map(listed).collect()),
            (_, Some(levels), _) => Values::List(levels.iter().map(level).collect()),
            (.., range) => Values::Range {
                key,
                ends: range.unwrap_or_default(),
                steps: config.steps.unwrap_or(2),
                log: config.log,
                whole: config.whole,
            },
        };
        Self {
            name: config.name().to_owned(),
            values,
        }
    }

    /// Values in a grid.
    fn count(&self) -> u64 {
        match &self.values {
            Values::List(list) => list.len() as u64,
            Values::Range { steps, .. } => u64::from(*steps),
        }
    }

    /// The value of this number in a grid.
    fn at(&self, index: u64) -> Setting {
        match &self.values {
            Values::List(list) => list[index as usize % list.len()].clone(),
            Values::Range { steps, .. } => {
                self.in_range(index as f64 / f64::from((*steps).max(2) - 1), false)
            }
        }
    }

    /// The value at a place from 0 to 1 of the factor's values, each of them as likely.
    fn between(&self, u: f64) -> Setting {
        match &self.values {
            Values::List(list) => {
                let index = (u * list.len() as f64) as usize;
                list[index.min(list.len() - 1)].clone()
            }
            Values::Range { .. } => self.in_range(u, true),
        }
    }

    /// The value at a place from 0 to 1 of a range. Of whole numbers each is as likely, or the nearest is taken.
    fn in_range(&self, u: f64, likely: bool) -> Setting {
        let Values::Range {
            key,
            ends: [from, to],
            log,
            whole,
            ..
        } = &self.values
        else {
            return self.at(0);
        };
        // The last number has as much of the range as each other one.
        let beyond = if *whole && likely { to + 1.0 } else { *to };
        let value = match log {
            // Not by powers of the ratio: the ends are to be what the file says.
            true if u > 0.0 && u < 1.0 => (from.ln() + u * (beyond.ln() - from.ln())).exp(),
            _ if u >= 1.0 => *to,
            _ => from + u * (beyond - from),
        };
        let (value, label) = match whole {
            true => {
                let near = if likely { value.floor() } else { value.round() };
                let value = near.clamp(*from, *to);
                (value, format!("{}", value as i64))
            }
            false => (value, format!("{value:?}")),
        };
        Setting {
            set: vec![format!("{key}={label}")],
            label,
            number: Some(value),
        }
    }

    /// A value that a grid would take twice, or a list holds twice.
    fn repeated(&self, grid: bool) -> Option<String> {
        let labels: Vec<String> = match &self.values {
            Values::List(list) => list.iter().map(|setting| setting.label.clone()).collect(),
            Values::Range { whole: true, .. } if grid => (0..self.count())
                .map(|index| self.at(index).label)
                .collect(),
            Values::Range { .. } => Vec::new(),
        };
        let mut seen = BTreeSet::new();
        labels.into_iter().find(|label| !seen.insert(label.clone()))
    }
}

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
    files: BTreeMap<(usize, String), u64>,
    /// The scenario's path, and its text.
    scenario: PathBuf,
    source: String,
    seeds: Vec<u64>,
    points: u64,
    /// For each factor of a Latin hypercube the place of each point.
    strata: Vec<Vec<f64>>,
}

/// What is kept where the file does not say it.
const USUAL: [&str; 9] = [
    "outcome",
    "time_to_acquire_s",
    "time_to_neutralise_s",
    "miss_distance_px.precise.mean",
    "dwell_s",
    "energy_j",
    "distractor_s",
    "wrong_object_s",
    "simulated_s",
];

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
        let mut rest = point;
        // The last factor changes fastest.
        let mut settings: Vec<Setting> = (self.factors.iter().enumerate().rev())
            .map(|(dimension, factor)| match self.experiment.sampling {
                Sampling::Grid => {
                    let at = rest % factor.count();
                    rest /= factor.count();
                    factor.at(at)
                }
                Sampling::LatinHypercube => factor.between(self.strata[dimension][point as usize]),
                Sampling::Sobol => {
                    let u = sobol_burley::sample(point as u32, dimension as u32, 0);
                    factor.between(f64::from(u))
                }
            })
            .collect();
        settings.reverse();
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

    fn load(&self, changes: &[String]) -> Result<Loaded, InputError> {
        let set = self.experiment.set.iter().chain(changes).cloned().collect();
        Loaded::parse(self.source.clone(), self.scenario.clone(), set)
    }
}

/// Why a detector is refused.
const NEEDS_PICTURES: &str = "detector.kind = \"onnx\" needs pictures: add pictures = true, or \"detector.kind=truth\" to set";

/// The files that the runs of a scenario read.
fn named_files(scenario: &Scenario) -> BTreeSet<PathBuf> {
    let detector = &scenario.detector;
    let mut files: BTreeSet<PathBuf> = (scenario.recogniser.model(detector).map(Path::to_path_buf))
        .into_iter()
        .chain(detector.is_onnx().then(|| detector.onnx_model.clone()))
        .collect();
    let flights = (scenario.uavs.iter().map(|uav| &uav.trajectory))
        .chain(scenario.distractors.iter().map(|other| &other.trajectory));
    for flight in flights {
        if let Trajectory::Recorded { file } = flight {
            files.insert(file.into());
        }
    }
    // What is no path is a name of the catalogue, which the program holds.
    let models = scenario.uavs.iter().map(|uav| &uav.model);
    files.extend(
        models
            .filter(|model| model.ends_with(".toml"))
            .map(PathBuf::from),
    );
    files
}

/// A digest of the contents of files; 0 of none.
fn digest(files: &BTreeSet<PathBuf>) -> u64 {
    if files.is_empty() {
        return 0;
    }
    let mut hasher = Xxh3::new();
    for file in files {
        // One that is not there is told by the runs.
        let bytes = std::fs::read(crate::data::found(file)).unwrap_or_default();
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(&bytes);
    }
    hasher.digest()
}

/// A hash of words and a number, in hexadecimal digits.
fn hash_of<'a>(words: impl Iterator<Item = &'a str>, number: u64) -> String {
    let mut hasher = Xxh3::new();
    for word in words {
        hasher.update(&(word.len() as u64).to_le_bytes());
        hasher.update(word.as_bytes());
    }
    hasher.update(&number.to_le_bytes());
    format!("{:016x}", hasher.digest())
}

/// Refuses two columns of one name.
fn columns_apart(
    factors: &[Factor],
    figures: &[(String, Kind)],
    places: &Places,
) -> Result<(), InputError> {
    let mut taken: BTreeSet<&str> = super::run::OWN_COLUMNS.into_iter().collect();
    let kept = (figures.iter().enumerate())
        .map(|(index, (key, _))| (format!("keep[{index}]"), key.as_str(), "leave it out"));
    let factors = (factors.iter().enumerate()).map(|(index, factor)| {
        let place = format!("factors[{index}].name");
        (place, factor.name.as_str(), "give the factor another name")
    });
    for (place, name, mend) in kept.chain(factors) {
        if !taken.insert(name) {
            let what = format!("the table has a column '{name}' already: {mend}");
            return Err(places.refuse(&place, what));
        }
    }
    Ok(())
}

/// The figures that an experiment keeps, with their kinds.
fn kept(
    experiment: &Experiment,
    scenario: &Scenario,
    places: &Places,
) -> Result<Vec<(String, Kind)>, InputError> {
    let usual = || USUAL.iter().map(|key| (*key).to_owned()).collect();
    let keys: Vec<String> = match experiment.keep.is_empty() {
        true => usual(),
        false => experiment.keep.clone(),
    };
    let kind = |(index, key): (usize, String)| {
        let kind = figures::kind(&key, scenario)
            .map_err(|wrong| places.refuse(&format!("keep[{index}]"), wrong))?;
        Ok((key, kind))
    };
    keys.into_iter().enumerate().map(kind).collect()
}

/// For each point a place from 0 to 1 in a stratum of its own, in random order.
fn strata(points: u64, factor: u64) -> Vec<f64> {
    let mut rng = Stream::new(0, factor, "latin hypercube");
    let mut order: Vec<u64> = (0..points).collect();
    for last in (1..order.len()).rev() {
        let other = (rng.uniform() * (last + 1) as f64) as usize;
        order.swap(last, other.min(last));
    }
    order
        .into_iter()
        .map(|stratum| (stratum as f64 + rng.uniform()) / points as f64)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(text: &str) -> Result<Plan, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("experiment.toml");
        let scenario = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/scenarios/urban_intercept.toml"
        );
        let head = format!("name = 'x'\nscenario = '{scenario}'\nset = ['detector.kind=truth']\n");
        std::fs::write(&path, head + text).unwrap();
        Plan::read(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn the_shipped_experiments_can_be_read() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("experiments");
        let mut read = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let plan = Plan::read(&path);
            assert!(plan.is_ok(), "{}: {:?}", path.display(), plan.err());
            read += 1;
        }
        assert!(read >= 5);
    }

    #[test]
    fn whole_numbers_are_as_likely_as_each_other() {
        let text = "sampling = 'latin_hypercube'\nsamples = 300\n[[factors]]\nkey = 'detector.roi_px'\n\
                    range = [16, 18]\nwhole = true\n";
        let plan = plan(text).unwrap();
        let mut counts = [0; 3];
        for index in 0..plan.runs() {
            let number = plan.run(index).settings[0].number.unwrap();
            counts[number as usize - 16] += 1;
        }
        assert_eq!(counts, [100; 3]);
    }

    #[test]
    fn runs_of_a_changed_model_are_others() {
        let folder = tempfile::tempdir().unwrap();
        let uav = folder.path().join("own.toml");
        let text = format!(
            "[[factors]]\nkey = 'uavs.0.model'\nvalues = ['fpv5', '{}']\n",
            uav.display()
        );
        let keys = |content: &str| {
            std::fs::write(&uav, content).unwrap();
            let plan = plan(&text).unwrap();
            (plan.key(&plan.run(0)), plan.key(&plan.run(1)))
        };
        let [one, same, other] = ["a", "a", "b"].map(keys);
        assert!(one == same && one.0 == other.0 && one.1 != other.1);
    }

    #[test]
    fn more_seeds_and_values_keep_the_runs_that_there_are() {
        let keys = |text: &str| {
            let plan = plan(text).unwrap();
            let keys: Vec<String> = (0..plan.runs())
                .map(|index| plan.key(&plan.run(index)))
                .collect();
            (plan.hash, keys)
        };
        let text = |seeds: &str, values: &str| {
            format!(
                "seeds = {seeds}\n[[factors]]\nkey = 'station.laser.power_w'\nvalues = {values}\n"
            )
        };
        let (hash, few) = keys(&text("'1..=2'", "[100.0, 400.0]"));
        let (same, many) = keys(&text("'0..=2'", "[200.0, 100.0, 400.0]"));
        assert_eq!(hash, same);
        assert!(few.iter().all(|key| many.contains(key)));
        assert_eq!(BTreeSet::from_iter(&many).len(), 9);
        // Other figures are kept: no run has them yet.
        let (other, _) = keys(&format!(
            "keep = ['dwell_s']\n{}",
            text("'1..=2'", "[100.0]")
        ));
        assert_ne!(hash, other);
    }

    const POWER: &str = "[[factors]]\nkey = 'station.laser.power_w'\nrange = [100.0, 1600.0]\n";

    #[test]
    fn a_grid_takes_every_combination() {
        let text = format!(
            "seeds = '1..=2'\n{POWER}steps = 3\nlog = true\n\
             [[factors]]\nname = 'light'\nlevels = [{{ name = 'day', set = [] }}, \
             {{ name = 'dusk', set = ['time_utc=2025-09-20T18:00:00Z'] }}]\n"
        );
        let plan = plan(&text).unwrap();
        assert_eq!(plan.runs(), 12);
        let labels: Vec<String> = (0..12)
            .map(|index| {
                let run = plan.run(index);
                let labels: Vec<_> = run.settings.iter().map(|s| s.label.clone()).collect();
                format!("{} {}", labels.join(" "), run.seed)
            })
            .collect();
        assert_eq!(labels[0], "100.0 day 1");
        assert_eq!(labels[1], "100.0 day 2");
        assert_eq!(labels[2], "100.0 dusk 1");
        assert!(labels[4].starts_with("400"), "{}", labels[4]);
        assert_eq!(labels[11], "1600.0 dusk 2");
        let loaded = plan.scenario(&plan.run(11)).unwrap();
        assert_eq!(loaded.scenario.station.laser.power_w, 1600.0);
        assert!(
            plan.command(&plan.run(11))
                .contains("--set station.laser.power_w=1600.0")
        );
    }

    #[test]
    fn samples_fill_the_range() {
        for sampling in ["latin_hypercube", "sobol"] {
            let text = format!("sampling = '{sampling}'\nsamples = 64\n{POWER}");
            let plan = plan(&text).unwrap();
            let mut values: Vec<f64> = (0..plan.runs())
                .map(|index| plan.run(index).settings[0].number.unwrap())
                .collect();
            values.sort_by(f64::total_cmp);
            // One in each of 64 strata; 64 points of a scrambled Sobol sequence have that too.
            for (stratum, value) in values.iter().enumerate() {
                let u = (value - 100.0) / 1500.0 * 64.0;
                let within = (stratum as f64..=stratum as f64 + 1.0).contains(&u);
                assert!(within, "{sampling}: {u} in {stratum}");
            }
        }
    }

    #[test]
    fn what_cannot_be_run_is_refused() {
        for (text, wanted) in [
            ("", "missing"),
            (
                "[[factors]]\nkey = 'station.laser.powr_w'\nvalues = [1]\n",
                "power_w",
            ),
            (
                "[[factors]]\nkey = 'station.laser.power_w'\nvalues = ['much']\n",
                "factors[0]",
            ),
            (
                "[[factors]]\nkey = 'seed'\n",
                "one of values, range and levels",
            ),
            (
                "[[factors]]\nkey = 'detector.roi_px'\nvalues = [16]\nrange = [16, 18]\nsteps = 2\n",
                "found 2",
            ),
            (&format!("{POWER}steps = 1\n"), "at least 2 steps"),
            (
                &format!(
                    "{POWER}steps = 1000000\n[[factors]]\nkey = 'duration_s'\nrange = [1, 2]\nsteps = 1000\n"
                ),
                "1000000000 runs",
            ),
            (&format!("samples = 3\n{POWER}steps = 2\n"), "leave it out"),
            (&format!("sampling = 'sobol'\n{POWER}"), "samples"),
            (
                &format!("keep = ['dwel_s']\n{POWER}steps = 2\n"),
                "did you mean 'dwell_s'",
            ),
            (
                &format!("{POWER}steps = 2\n{POWER}steps = 2\n"),
                "taken by an earlier factor",
            ),
            (
                "[[factors]]\nkey = 'station.laser.power_w'\nrange = [2, 1]\nsteps = 2\n",
                "below the second",
            ),
            (
                &format!("sampling = 'sobol'\nsamples = 65537\n{POWER}"),
                "65536 points",
            ),
            (
                &format!(
                    "sampling = 'sobol'\nsamples = 2\n{}",
                    (0..257)
                        .map(|n| POWER.replace("key", &format!("name = 'f{n}'\nkey")))
                        .collect::<String>()
                ),
                "256 dimensions",
            ),
            ("[[factors]]\nkey = 'seed'\nvalues = [1, 2]\n", "with seeds"),
            (
                "[[factors]]\nname = 'x'\nlevels = [{ name = 'a', set = ['seed=3'] }]\n",
                "with seeds",
            ),
            (&format!("seeds = []\n{POWER}steps = 2\n"), "found 0 seeds"),
            (
                &format!("seeds = [4, 4]\n{POWER}steps = 2\n"),
                "holds 4 twice",
            ),
            (
                "[[factors]]\nkey = 'station.laser.power_w'\nvalues = [1, 2, 1]\n",
                "'1' twice",
            ),
            (
                "[[factors]]\nkey = 'detector.roi_px'\nrange = [16, 18]\nsteps = 5\nwhole = true\n",
                "'17' twice",
            ),
            (
                "[[factors]]\nkey = 'detector.roi_px'\nrange = [16.5, 18]\nsteps = 2\nwhole = true\n",
                "whole ends",
            ),
            (
                &format!("keep = ['dwell_s', 'dwell_s']\n{POWER}steps = 2\n"),
                "column 'dwell_s' already",
            ),
            (
                &format!("keep = ['seed']\n{POWER}steps = 2\n"),
                "column 'seed' already",
            ),
            (
                &format!("keep = ['real_time_factor']\n{POWER}steps = 2\n"),
                "wall-clock",
            ),
            (
                "[[factors]]\nkey = 'detector.kind'\nvalues = ['truth', 'onnx']\n",
                "kind = onnx: detector.kind = \"onnx\" needs pictures",
            ),
        ] {
            let message = plan(text).unwrap_err();
            assert!(message.contains(wanted), "{text}: {message}");
            assert!(!message.contains('\n'), "{message}");
        }
    }
}
