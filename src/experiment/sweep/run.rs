//! A run of an experiment that is over.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;

/// Every row has it.
pub const STATE_HASH: &str = "state_hash";
/// Columns that every table has beside factors and figures.
pub const OWN_COLUMNS: [&str; 5] = ["run", "seed", "scenario_hash", "version", STATE_HASH];

/// A run that is over.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Done {
    /// Its number in the experiment that it was made for.
    pub run: u64,
    /// What tells it from others, whatever experiment asks for it ([`super::plan::Plan::key`]).
    pub key: String,
    /// Hash of its scenario, all changes made.
    pub scenario_hash: String,
    /// How many UAVs flew, and when those of them that were brought down were \[s\].
    #[serde(default)]
    pub down: Down,
    /// What was kept of its summary; `Err`: why there is none.
    pub result: Result<BTreeMap<String, Value>, String>,
}

/// UAVs brought down in a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Down {
    /// UAVs that flew.
    pub uavs: usize,
    /// Times at which some of them were brought down \[s\].
    pub at_s: Vec<f64>,
}

impl Down {
    /// Those of a summary.
    pub fn of(summary: &Value) -> Self {
        let uavs = summary["uavs"].as_array().map_or(&[][..], Vec::as_slice);
        Self {
            uavs: uavs.len(),
            at_s: (uavs.iter())
                .filter_map(|uav| uav["neutralised_s"].as_f64())
                .collect(),
        }
    }

    /// UAVs that are not brought down by `t_s` \[s\].
    pub fn left(&self, t_s: f64) -> usize {
        self.uavs - self.at_s.iter().filter(|at_s| **at_s <= t_s).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn uavs_are_left_until_they_are_brought_down() {
        let summary = json!({ "uavs": [
            { "name": "a", "neutralised_s": 3.0 },
            { "name": "b", "neutralised_s": null },
            { "name": "c", "neutralised_s": 7.5 },
        ]});
        let down = Down::of(&summary);
        assert_eq!(
            [0.0, 2.9, 3.0, 7.5, 99.0].map(|t_s| down.left(t_s)),
            [3, 3, 2, 1, 1]
        );
        // A run that failed has none.
        assert_eq!(Down::of(&json!(null)), Down::default());
    }
}
