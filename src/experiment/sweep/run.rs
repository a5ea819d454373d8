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
    /// What was kept of its summary; `Err`: why there is none.
    pub result: Result<BTreeMap<String, Value>, String>,
}
