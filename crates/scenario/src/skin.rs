//! Walls that the laser heats, by name.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use boresight_models::laser::target::{self, Skin};

/// What a part that the laser heats is made of. A shell has a circuit board behind it; on an arm it is hollow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Skin")]
pub enum SkinKind {
    /// Polycarbonate shell of 1.5 mm.
    PolycarbonateShell,
    /// ABS shell of 2 mm.
    AbsShell,
    /// Carbon-fibre epoxy of 1.5 mm.
    CarbonFibre,
    /// Pouch of a lithium-polymer battery.
    LipoPouch,
    /// Such a pouch behind the plastic shell of its pack.
    ShelledPouch,
    /// Bell of an outrunner motor: steel over magnets.
    MotorBell,
    /// Aluminium sheet of 1 mm.
    Aluminium,
}

impl SkinKind {
    /// Its layers.
    pub fn skin(self) -> Skin {
        match self {
            Self::PolycarbonateShell => target::POLYCARBONATE_SHELL,
            Self::AbsShell => target::ABS_SHELL,
            Self::CarbonFibre => target::CARBON_EPOXY,
            Self::LipoPouch => target::LIPO_POUCH,
            Self::ShelledPouch => target::SHELLED_POUCH,
            Self::MotorBell => target::MOTOR_BELL,
            Self::Aluminium => target::ALUMINIUM,
        }
    }
}
