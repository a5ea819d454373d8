//! Materials that the laser heats, by name.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use boresight_models::laser::thermal::{self, SkinMaterial};

/// Material of a part that the laser heats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Skin")]
pub enum SkinKind {
    /// Dark polycarbonate shell.
    PolycarbonateShell,
    /// ABS shell.
    AbsShell,
    /// Carbon-fibre epoxy.
    CarbonFibre,
    /// Pouch of a lithium-polymer battery.
    LipoPouch,
    /// Such a pouch behind the plastic shell of its pack.
    ShelledPouch,
    /// Bell of an outrunner motor.
    MotorBell,
    /// Aluminium.
    Aluminium,
}

impl SkinKind {
    /// Its thermal and optical constants.
    pub fn material(self) -> SkinMaterial {
        match self {
            Self::PolycarbonateShell => thermal::POLYCARBONATE_SHELL,
            Self::AbsShell => thermal::ABS_SHELL,
            Self::CarbonFibre => thermal::CARBON_EPOXY,
            Self::LipoPouch => thermal::LIPO_POUCH,
            Self::ShelledPouch => thermal::SHELLED_POUCH,
            Self::MotorBell => thermal::MOTOR_BELL,
            Self::Aluminium => thermal::ALUMINIUM,
        }
    }
}
