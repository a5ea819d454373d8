//! The laser and what its beam does.

use crate::components::run::Registry;
use crate::models::laser::beam::Laser;
use crate::models::laser::propagation::{BeamAir, Propagation, PropagationContext};
use crate::models::maths::rng::Stream;
use crate::models::optics::seeing::{FrozenAir, Look, Pupil, Ripples};
use bevy::prelude::*;
use glam::DVec2;
use std::sync::Arc;

/// The propagations that a scenario may name, each made for a station.
#[derive(Resource, Default, Deref, DerefMut)]
pub struct Propagations(pub Registry<PropagationContext, dyn Propagation>);

/// The laser: constants, and how its beam crosses the air.
#[derive(Component, Clone, Debug)]
pub struct LaserSource {
    /// Power, wavelength, aperture, beam quality.
    pub laser: Laser,
    /// Fixed focus [m]; `None` follows the target's range.
    pub focus_m: Option<f64>,
    /// Residual jitter of the beam director about each axis, white per tick [rad rms].
    pub jitter_rad: f64,
    /// How the beam crosses the air, with its memory.
    pub propagation: Box<dyn Propagation>,
    /// Outer scale of the turbulence [m].
    pub outer_m: f64,
    /// The air that the station's cameras look through, as the beam meets it; none where they look through none.
    pub seeing: Option<BeamSeeing>,
    /// Stream of the jitter.
    pub jitter_rng: Stream,
    /// The air on the way to the aimed UAV.
    pub path: Option<BeamPath>,
}

/// The pauses of a laser for the exposures of cameras that it would blind.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct LaserPauses {
    /// Power without pauses [W].
    pub full_w: f64,
    /// Share of the time that it pauses for, from the next tick on.
    pub share: f64,
}

/// The air on a beam's path, good for a fraction of a second.
#[derive(Clone, Debug)]
pub struct BeamPath {
    /// Index of the UAV at its end.
    pub index: usize,
    /// The air.
    pub air: BeamAir,
}

/// The turbulence that a station's cameras look through, as its beam meets it.
#[derive(Clone, Debug)]
pub struct BeamSeeing {
    /// The air.
    pub air: Arc<FrozenAir>,
    /// The beam at its aperture.
    pub pupil: Pupil,
    /// Its tilts about the axes that the optics had at a time [s], good as long as the path.
    pub ripples: Option<(Ripples, Look)>,
    /// Where the beam is turned, of unit variance about each axis, right and down.
    pub turned: DVec2,
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
    /// 1/e^2 radius at its range of the Gaussian that has the spot's power and peak [m].
    pub spot_radius_m: f64,
    /// Greatest irradiance at its range [W/m^2].
    pub peak_wpm2: f64,
    /// Distance of the beam's centre from its aim point [m].
    pub offset_m: f64,
    /// Whether the firing beam's centre lay on that aim point, with nothing in between.
    pub on_aim_point: bool,
    /// Atmospheric transmittance.
    pub transmittance: f64,
    /// Peak over that without fluctuation.
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
