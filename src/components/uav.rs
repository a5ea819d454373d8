//! What a UAV entity carries.

use crate::models::multirotor::{Airframe, MultirotorState};
use crate::models::rng::Stream;
use crate::models::thermal::{Skin, SkinMaterial};
use crate::models::trajectory::CompiledTrajectory;
use crate::models::uav::UavKind;
use crate::models::wind::DrydenGust;
use bevy::prelude::*;
use glam::DVec3;

/// Identity of a UAV.
#[derive(Component, Clone, Debug)]
pub struct Uav {
    /// Index in the scenario; the key of its random streams.
    pub index: usize,
    /// Name from the scenario.
    pub name: String,
    /// Catalogue entry.
    pub kind: UavKind,
}

/// Airframe and motion, the truth in f64.
#[derive(Component, Clone, Debug)]
pub struct Flight {
    /// Constants of the airframe.
    pub airframe: Airframe,
    /// Position, attitude, rates and rotors.
    pub state: MultirotorState,
    /// The point to aim at [m, body]: the centroid of the airframe's surface.
    pub aim_body_m: DVec3,
}

impl Flight {
    /// Where the aim point is [m].
    pub fn aim_enu_m(&self) -> DVec3 {
        self.state.r_enu_m + self.state.q_enu_body * self.aim_body_m
    }
}

/// The flight plan.
#[derive(Component, Clone, Debug)]
pub struct Guidance(pub CompiledTrajectory);

/// The air the UAV meets.
#[derive(Component, Clone, Debug)]
pub struct Air {
    /// Gust generator.
    pub gusts: DrydenGust,
    /// Its stream.
    pub rng: Stream,
    /// Mean wind plus gust at the UAV [m/s].
    pub wind_enu_mps: DVec3,
}

/// The component under the aim point, as a lumped skin.
#[derive(Component, Clone, Debug)]
pub struct HeatedSkin {
    /// Thermal state.
    pub skin: Skin,
    /// What it is made of.
    pub material: SkinMaterial,
    /// Mean irradiance on it in this tick [W/m^2].
    pub irradiance_wpm2: f64,
}

/// What has become of a UAV.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub enum UavStatus {
    /// Flies its plan.
    Flying,
    /// The laser has burnt it through; it falls.
    Falling,
    /// It lies on the city.
    Down,
    /// It flew into the city without help.
    Crashed,
}

impl UavStatus {
    /// The status as recordings and reports name it.
    pub fn name(self) -> &'static str {
        match self {
            UavStatus::Flying => "flying",
            UavStatus::Falling => "falling",
            UavStatus::Down => "down",
            UavStatus::Crashed => "crashed",
        }
    }

    /// Whether the laser has done its work.
    pub fn neutralised(self) -> bool {
        matches!(self, UavStatus::Falling | UavStatus::Down)
    }
}
