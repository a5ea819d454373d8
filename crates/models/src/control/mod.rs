//! Control laws of mount and mirror, and how their gains are derived. `law` is what they share, `tuned`,
//! `lqg` and `paper` are the laws, `pointing` is what the first two have in common, `tuning` measures loops.

pub mod law;
pub mod lqg;
pub mod paper;
pub mod pointing;
pub mod tuned;
pub mod tuning;

use crate::tracking::estimation::LosFilterParams;
use lqg::{LqgPointing, LqgWeights};
use pointing::PointingLaw;
use std::error::Error;
use tuning::MountPlant;

/// What makes a law for a mount.
pub type MakeLaw = fn(&MountPlant) -> Result<Box<dyn PointingLaw>, Box<dyn Error + Send + Sync>>;

/// The pointing laws that every run knows, by the names that scenarios give them.
pub const POINTING_LAWS: [(&str, MakeLaw); 2] = [
    ("tuned", |plant| Ok(Box::new(tuning::derive(plant)?.law))),
    ("lqg", |plant| {
        let tau_s = LosFilterParams::default().accel_tau_s;
        let (gimbal, mirror) = (&plant.gimbal, &plant.mirror);
        let law = LqgPointing::new(gimbal, mirror, tau_s, &LqgWeights::default(), plant.dt_s)?;
        Ok(Box::new(law))
    }),
];

#[cfg(test)]
mod tests;
