//! The three tiers of the acquisition chain.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::{Index, IndexMut};

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
    /// All tiers, wide to narrow.
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

/// One of something for the cameras of each tier.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PerTier<T> {
    /// Of the search cameras.
    pub search: T,
    /// Of the coarse ones.
    pub coarse: T,
    /// Of the precise ones.
    pub precise: T,
}

impl<T> PerTier<T> {
    /// What `of` gives for each tier.
    pub fn of(mut of: impl FnMut(Tier) -> T) -> Self {
        Self {
            search: of(Tier::Search),
            coarse: of(Tier::Coarse),
            precise: of(Tier::Precise),
        }
    }

    /// All of them, wide to narrow.
    pub fn each(self) -> [T; 3] {
        [self.search, self.coarse, self.precise]
    }
}

impl<T> Index<Tier> for PerTier<T> {
    type Output = T;

    fn index(&self, tier: Tier) -> &T {
        match tier {
            Tier::Search => &self.search,
            Tier::Coarse => &self.coarse,
            Tier::Precise => &self.precise,
        }
    }
}

impl<T> IndexMut<Tier> for PerTier<T> {
    fn index_mut(&mut self, tier: Tier) -> &mut T {
        match tier {
            Tier::Search => &mut self.search,
            Tier::Coarse => &mut self.coarse,
            Tier::Precise => &mut self.precise,
        }
    }
}
