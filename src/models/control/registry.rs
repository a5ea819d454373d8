//! The pointing laws by their names.

use super::lqg::{LqgPointing, LqgWeights};
use super::pointing::PointingLaw;
use super::tuning::{self, MountPlant};
use crate::models::tracking::estimation::LosFilterParams;
use std::collections::BTreeMap;

/// Why a law cannot be made for a mount.
pub type LawError = Box<dyn std::error::Error + Send + Sync>;

/// Makes a law for a mount.
type Make = Box<dyn Fn(&MountPlant) -> Result<Box<dyn PointingLaw>, LawError> + Send + Sync>;

/// The laws that a scenario may name.
pub struct LawRegistry(BTreeMap<String, Make>);

impl Default for LawRegistry {
    /// `tuned` and `lqg`.
    fn default() -> Self {
        let mut laws = Self(BTreeMap::new());
        laws.add("tuned", |plant| Ok(tuning::derive(plant)?.law));
        laws.add("lqg", |plant| {
            let tau_s = LosFilterParams::default().accel_tau_s;
            let MountPlant {
                gimbal,
                mirror,
                dt_s,
            } = plant;
            Ok(LqgPointing::new(
                gimbal,
                mirror,
                tau_s,
                &LqgWeights::default(),
                *dt_s,
            )?)
        });
        laws
    }
}

impl LawRegistry {
    /// Adds a law under a name, in place of one that had it.
    pub fn add<L: PointingLaw + 'static>(
        &mut self,
        name: &str,
        make: impl Fn(&MountPlant) -> Result<L, LawError> + Send + Sync + 'static,
    ) {
        let make: Make = Box::new(move |plant| Ok(Box::new(make(plant)?)));
        self.0.insert(name.to_owned(), make);
    }

    /// Names of the laws, in their alphabet's order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }

    /// The law of a name for a mount; `None` where there is none of that name.
    pub fn make(
        &self,
        name: &str,
        plant: &MountPlant,
    ) -> Option<Result<Box<dyn PointingLaw>, LawError>> {
        Some(self.0.get(name)?(plant))
    }
}
