//! How a run ends, in one word.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How a run ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// No station's coarse or precise camera held a target.
    #[default]
    NotAcquired,
    /// A target was tracked, and outlasted the run.
    Tracked,
    /// A UAV flew into the city or another UAV, and none was brought down by the laser.
    Crashed,
    /// Some of the UAVs were brought down by the laser.
    PartlyNeutralised,
    /// All were.
    Neutralised,
}

impl Outcome {
    /// The word, as files and reports have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::NotAcquired => "not_acquired",
            Self::Tracked => "tracked",
            Self::Crashed => "crashed",
            Self::PartlyNeutralised => "partly_neutralised",
            Self::Neutralised => "neutralised",
        }
    }
}
