//! What a law offers that points by a predicted line of sight, and the laws by their names.

use super::law::{HandOver, PointingInput, PointingOutput};
use super::lqg::{LqgPointing, LqgWeights};
use super::tuning::{self, MountPlant};
use crate::models::mount::gimbal::GimbalParams;
use crate::models::tracking::estimation::LosFilterParams;
use std::collections::BTreeMap;
use std::fmt::Debug;

/// A law that points gimbal and mirror by a predicted line of sight.
pub trait PointingLaw: CloneLaw + Debug + Send + Sync {
    /// How far ahead of a tick's start the line of sight is to be predicted [s].
    fn lead_s(&self) -> f64 {
        0.0
    }

    /// The commands of one tick.
    fn command(
        &mut self,
        hand_over: &mut HandOver,
        gimbal: &GimbalParams,
        input: &PointingInput,
    ) -> PointingOutput;

    /// Forgets what a pause in the tracking has made stale.
    fn rest(&mut self) {}

    /// Its gains, with names and units.
    fn gains(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }
}

/// A law that can be copied with its memory: whatever is [`Clone`].
pub trait CloneLaw {
    /// The copy.
    fn boxed(&self) -> Box<dyn PointingLaw>;
}

impl<L: PointingLaw + Clone + 'static> CloneLaw for L {
    fn boxed(&self) -> Box<dyn PointingLaw> {
        Box::new(self.clone())
    }
}

impl Clone for Box<dyn PointingLaw> {
    fn clone(&self) -> Self {
        (**self).boxed()
    }
}

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
