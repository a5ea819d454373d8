//! What a run of the scenario must show: `boresight test` holds it to that.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

use super::check::{Check, FRACTION};
use boresight_models::engage::outcome::Outcome;

/// What runs of the scenario must show.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Expect {
    /// Whether the runs are made without pictures, with the truth detector: they prove nothing about finding or
    /// choosing targets, and take a fraction of the time.
    pub blind: bool,
    /// Seeds of the runs, "from..=to" or a list; absent: the scenario's seed alone.
    pub seeds: Option<Seeds>,
    /// How every run ends.
    pub outcome: Option<Outcome>,
    /// What never happens in any run.
    pub never: Vec<Never>,
    /// Bounds on figures of `summary.json`, in every run, by their keys, dots between them: `dwell_s`,
    /// `miss_distance_px.precise.p95`, `uavs.intruder.neutralised_s`. Of a list's elements one is named by its name,
    /// or by its place from 0; a list of numbers has `count`, `least`, `most` and `mean`, every list `count`.
    pub values: BTreeMap<String, Bound>,
    /// Claims about shares of the runs.
    pub shares: Vec<ShareConfig>,
    /// Hash of the final state of the run with the scenario's seed, by platform, such as "x86_64-linux";
    /// `boresight test --bless` writes it.
    pub state_hash: BTreeMap<String, String>,
}

/// A claim about a share of the runs: that of those that meet all that it names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Share")]
pub struct ShareConfig {
    /// Least share. A quantile is such a claim: "90 % of the runs acquire within 2 s".
    pub at_least: f64,
    /// With this confidence: the one-sided lower limit of Clopper and Pearson is not below it. Absent: the share of
    /// the runs made.
    pub confidence: Option<f64>,
    /// How such a run ends.
    pub outcome: Option<Outcome>,
    /// What does not happen in such a run.
    #[serde(default)]
    pub never: Vec<Never>,
    /// Bounds on its figures.
    #[serde(default)]
    pub values: BTreeMap<String, Bound>,
}

/// Seeds of runs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected seeds such as \"1..=20\" or [1, 5, 7]")]
pub enum Seeds {
    /// From one to another, both among them.
    Range(SeedRange),
    /// These.
    List(Vec<u64>),
}

impl Seeds {
    /// How many.
    pub fn count(&self) -> u64 {
        match self {
            Self::Range(range) => range.last.saturating_sub(range.first).saturating_add(1),
            Self::List(list) => list.len() as u64,
        }
    }

    /// There must be some, not too many, and each once.
    pub fn check(&self, check: &mut Check, most: u64) {
        let count = self.count();
        check.that((1..=most).contains(&count), "seeds", || {
            format!("found {count} seeds, must be from 1 to {most}")
        });
        if let Self::List(list) = self {
            let mut seen = BTreeSet::new();
            let repeated = list.iter().find(|seed| !seen.insert(**seed));
            check.that(repeated.is_none(), "seeds", || {
                format!("holds {} twice", repeated.copied().unwrap_or_default())
            });
        }
    }

    /// The seeds in their order.
    pub fn all(&self) -> Vec<u64> {
        match self {
            Self::Range(range) => (range.first..=range.last).collect(),
            Self::List(list) => list.clone(),
        }
    }
}

/// Seeds from one to another, as text `1..=20`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct SeedRange {
    first: u64,
    last: u64,
}

impl TryFrom<String> for SeedRange {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let numbers = text.split_once("..=").and_then(|(first, last)| {
            Some((first.trim().parse().ok()?, last.trim().parse().ok()?))
        });
        match numbers {
            Some((first, last)) if first <= last => Ok(Self { first, last }),
            _ => Err(format!(
                "expected seeds such as \"1..=20\", found \"{text}\""
            )),
        }
    }
}

impl From<SeedRange> for String {
    fn from(range: SeedRange) -> Self {
        format!("{}..={}", range.first, range.last)
    }
}

impl JsonSchema for SeedRange {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "SeedRange".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "type": "string", "description": "From one seed to another, both among them.", "pattern": r"^\s*\d+\s*\.\.=\s*\d+\s*$" })
    }
}

/// What must not happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Never {
    /// A beam in a keep-out zone.
    FireInKeepOut,
    /// A beam on a distractor.
    FireAtDistractor,
    /// A station that tracks what is no UAV.
    WrongObject,
}

impl Never {
    /// The figure of `summary.json` that it keeps at 0.
    pub fn figure(self) -> &'static str {
        match self {
            Self::FireInKeepOut => "keep_out_s",
            Self::FireAtDistractor => "distractor_s",
            Self::WrongObject => "wrong_object_s",
        }
    }
}

/// Bounds on a figure. One that a run does not have meets none of them, but for `present = false`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Bound {
    /// Not below this.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_least: Option<f64>,
    /// Not above this.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at_most: Option<f64>,
    /// This text.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub is: Option<String>,
    /// Whether the run has it at all: the time of what never happened is absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub present: Option<bool>,
}

/// Most runs that a scenario's test may ask for.
const MOST_SEEDS: u64 = 100_000;

impl Expect {
    pub(super) fn check(&self, check: &mut Check) {
        if let Some(seeds) = &self.seeds {
            seeds.check(check, MOST_SEEDS);
        }
        let asks = self.outcome.is_some()
            || !(self.never.is_empty()
                && self.values.is_empty()
                && self.shares.is_empty()
                && self.state_hash.is_empty());
        check.that(asks, "", || {
            "expects nothing: give outcome, never, values, shares or state_hash".to_owned()
        });
        check_bounds(&self.values, check);
        for (index, share) in self.shares.iter().enumerate() {
            check.table(&format!("shares[{index}]"), |check| {
                check.within("at_least", share.at_least, FRACTION);
                check.maybe_within("confidence", share.confidence, 0.5..=0.999_999);
                check_bounds(&share.values, check);
                let asks =
                    share.outcome.is_some() || !(share.never.is_empty() && share.values.is_empty());
                check.that(asks, "", || {
                    "asks nothing of its runs: give outcome, never or values".to_owned()
                });
            });
        }
        for (platform, hash) in &self.state_hash {
            let is_hash = hash.len() == 16 && hash.bytes().all(|byte| byte.is_ascii_hexdigit());
            check.that(is_hash, &format!("state_hash.{platform}"), || {
                format!("found '{hash}', must be 16 hexadecimal digits; --bless writes them")
            });
        }
    }
}

/// Bounds that can be met.
fn check_bounds(values: &BTreeMap<String, Bound>, check: &mut Check) {
    for (path, bound) in values {
        let key = format!("values.{path}");
        let asks = *bound != Bound::default();
        check.that(asks, &key, || {
            "bounds nothing: give at_least, at_most, is or present".to_owned()
        });
        if let (Some(least), Some(most)) = (bound.at_least, bound.at_most) {
            check.that(least <= most, &key, || {
                format!("at_least = {least} is above at_most = {most}")
            });
        }
    }
}
