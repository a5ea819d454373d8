//! The experiment file as it is written, and what is checked of it.

use crate::scenario::Seeds;
use crate::scenario::check::Check;
use crate::scenario::load::Checked;
use crate::scenario::mistaken::Mistaken;
use schemars::JsonSchema;
use serde::Deserialize;
use std::path::PathBuf;
use toml::de::DeTable;

/// Most runs of an experiment.
pub(super) const MOST_RUNS: u64 = 1_000_000;
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
    fn mistaken(document: &DeTable) -> Option<Mistaken> {
        Mistaken::scenario(document)
    }

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
    pub(super) fn name(&self) -> &str {
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
