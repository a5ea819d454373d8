//! The laser and what its beam does.

use crate::models::air::turbulence::{PaperIntensity, PathTurbulence, Scintillation, Wander};
use crate::models::laser::beam::Laser;
use crate::models::maths::rng::Stream;
use bevy::prelude::*;

/// How the intensity on the target fluctuates.
#[derive(Clone, Debug)]
pub enum Channel {
    /// Stationary gamma-gamma scintillation.
    Physical(Box<Scintillation>),
    /// Eq. 7 as printed.
    Paper(PaperIntensity),
}

/// The laser: constants and the state of the air on its path.
#[derive(Component, Clone, Debug)]
pub struct LaserSource {
    /// Power, wavelength, aperture, beam quality.
    pub laser: Laser,
    /// Fixed focus [m]; `None` follows the target's range.
    pub focus_m: Option<f64>,
    /// Residual jitter of the beam director about each axis, white per tick [rad rms].
    pub jitter_rad: f64,
    /// How the intensity fluctuates, with its state.
    pub channel: Channel,
    /// Wander of the beam's centre, with its state.
    pub wander: Wander,
    /// Stream of the channel.
    pub scintillation_rng: Stream,
    /// Stream of the wander.
    pub wander_rng: Stream,
    /// Stream of the jitter.
    pub jitter_rng: Stream,
    /// The air on the way to the aimed UAV.
    pub path: Option<BeamPath>,
}

/// The air on a beam's path, good for a fraction of a second.
#[derive(Clone, Copy, Debug)]
pub struct BeamPath {
    /// Index of the UAV at its end.
    pub index: usize,
    /// Turbulence integrals.
    pub turbulence: PathTurbulence,
    /// Peak irradiance that steady thermal blooming leaves, 0 to 1.
    pub blooming: f64,
}

/// What the engagement asks of the laser; obeyed from the next tick on.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct FireCommand {
    /// Whether the laser emits.
    pub fire: bool,
    /// Range to focus at [m].
    pub focus_range_m: f64,
}

/// What the beam did in this tick.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct BeamState {
    /// Whether the laser emitted.
    pub firing: bool,
    /// The UAV nearest to the beam's axis: its scenario index.
    pub aimed: Option<usize>,
    /// Power that arrives at the aimed UAV's range [W].
    pub power_at_target_w: f64,
    /// Power inside the aim-point bucket of that UAV [W].
    pub power_in_bucket_w: f64,
    /// Mean irradiance over that bucket [W/m^2].
    pub irradiance_wpm2: f64,
    /// Short-term 1/e^2 radius at its range [m].
    pub spot_radius_m: f64,
    /// Distance of the beam's centre from its aim point [m].
    pub offset_m: f64,
    /// Whether the firing beam's centre lay on that aim point, with nothing in between.
    pub on_aim_point: bool,
    /// Atmospheric transmittance.
    pub transmittance: f64,
    /// Relative intensity of the channel.
    pub scintillation: f64,
    /// Energy emitted since the start [J].
    pub energy_j: f64,
    /// Time for which the firing beam's centre lay on the aim point of the tracker's target [s].
    pub dwell_s: f64,
    /// Time for which the firing beam's axis lay on a distractor [s].
    pub distractor_s: f64,
}

/// What the laser has spent on a UAV.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
pub struct Dose {
    /// Energy emitted while this UAV was the aimed one [J].
    pub energy_j: f64,
    /// Time for which the firing beam's centre lay on its aim point [s].
    pub dwell_s: f64,
}
