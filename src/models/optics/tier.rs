//! The three tiers of the acquisition chain.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which tier of the acquisition chain a camera is.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Tier {
    /// Search camera (STV): wide, finds candidates.
    Search,
    /// Coarse camera (CTV): on the gimbal, steers it.
    Coarse,
    /// Precise camera (PTV): behind the fast steering mirror, steers it.
    Precise,
}

impl Tier {
    /// All tiers, wide to narrow; also the order of every per-camera array.
    pub const ALL: [Tier; 3] = [Tier::Search, Tier::Coarse, Tier::Precise];

    /// The tier's short name, as topics and reports use it.
    pub fn name(self) -> &'static str {
        match self {
            Tier::Search => "stv",
            Tier::Coarse => "ctv",
            Tier::Precise => "ptv",
        }
    }

    /// The tier's plain name, as logs and scenarios use it.
    pub fn word(self) -> &'static str {
        match self {
            Tier::Search => "search",
            Tier::Coarse => "coarse",
            Tier::Precise => "precise",
        }
    }
}
