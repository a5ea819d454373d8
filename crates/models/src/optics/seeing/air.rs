//! The air about a station: layers of waves that the wind carries.

use crate::maths::rng::Stream;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Purpose of the stream that a station's air is drawn from.
pub const SEEING_STREAM: &str = "seeing";

/// Layers of the air.
pub const LAYERS: usize = 12;

/// Distances from the station between which the layers lie [m]. They grow with the distance, as what an eddy does to an
/// angle falls with it; beyond the last there is no turbulence.
pub(super) const EDGES_M: [f64; LAYERS + 1] = [
    0.0, 30.0, 80.0, 150.0, 250.0, 400.0, 600.0, 900.0, 1350.0, 2000.0, 3000.0, 4800.0, 8000.0,
];

/// Waves of a layer: some five to a factor of e in wavelength.
const WAVES: usize = 40;
/// Largest wavenumber [rad/m]: that of an inner scale of 5 mm, 5.92/l0.
const MAX_RADPM: f64 = 1_184.0;
/// Smallest wavenumber over that of the outer scale: below, the spectrum's tilts are below 1e-4 of all.
const MIN_RATIO: f64 = 0.25;
/// Smallest wavenumber without an outer scale [rad/m].
const MIN_RADPM: f64 = 1e-4;
/// Speed of the air's own stirring in each layer [m/s], as in the beam's path: natural convection.
const STIR_MPS: f64 = 0.3;

/// The winds of the layers [m/s], east, north, up.
pub type LayerWinds = [DVec3; LAYERS];

/// A plane wave of optical path in a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Wave {
    /// Wave vector [rad/m], east, north, up.
    pub k_enu_radpm: DVec3,
    /// Amplitude of the optical path for a layer of ∫Cn² dz = 1 m^(1/3) [m].
    pub amplitude_m: f64,
    /// Phase at the station at the start [rad].
    pub phase_rad: f64,
}

/// Frozen turbulence about a station: fixed waves for each layer.
///
/// A thin layer of ∫Cn² dz has the optical path's spectrum 2π 0.033 ∫Cn² dz (κ² + κ0²)^(-11/6) across the sight (von Kármán;
/// Andrews & Phillips, 2nd ed., ch. 3 and 6). The waves have directions in space, so that this holds for every sight: a plane
/// through an isotropic field of spectrum c (K² + κ0²)^(-7/3) has it, with c = 2π 0.033 Γ(7/3)/(√π Γ(11/6)).
#[derive(Clone, Debug, PartialEq)]
pub struct FrozenAir {
    /// The waves, layer by layer.
    pub(super) layers: Vec<Vec<Wave>>,
    /// How each layer moves beside the mean wind [m/s].
    stir_enu_mps: LayerWinds,
}

impl FrozenAir {
    /// Draws the air; `outer_m`: the outer scale [m], infinite for none.
    pub fn new(rng: &mut Stream, outer_m: f64) -> Self {
        let kappa0 = TAU / outer_m;
        let least = (MIN_RATIO * kappa0).max(MIN_RADPM);
        let shell = (MAX_RADPM / least).ln() / WAVES as f64;
        // Γ(7/3) and Γ(11/6).
        let c = TAU * 0.033 * 1.190_639_348_76 / (PI.sqrt() * 0.940_655_857_9);
        let wave = |i: usize, rng: &mut Stream| {
            let k = least * (shell * (i as f64 + rng.uniform())).exp();
            // Half the square of the amplitude is the energy of the shell, by the value where the wave lies: without bias.
            let energy =
                c * (k * k + kappa0 * kappa0).powf(-7.0 / 3.0) * 2.0 * TAU * k.powi(3) * shell;
            Wave {
                k_enu_radpm: k * direction(rng),
                amplitude_m: (2.0 * energy).sqrt(),
                phase_rad: TAU * rng.uniform(),
            }
        };
        let layers = (0..LAYERS).map(|_| (0..WAVES).map(|i| wave(i, rng)).collect());
        let layers = layers.collect();
        Self {
            layers,
            stir_enu_mps: std::array::from_fn(|_| STIR_MPS * direction(rng)),
        }
    }

    /// The winds that carry the layers, by the mean wind [m/s] at a distance from the station [m].
    pub fn winds(&self, mean_enu_mps: impl Fn(f64) -> DVec3) -> LayerWinds {
        std::array::from_fn(|i| {
            let middle_m = 0.5 * (EDGES_M[i] + EDGES_M[i + 1]);
            mean_enu_mps(middle_m) + self.stir_enu_mps[i]
        })
    }
}

/// A direction, each as likely.
fn direction(rng: &mut Stream) -> DVec3 {
    let up = rng.range(-1.0, 1.0);
    let (sin, cos) = rng.range(0.0, TAU).sin_cos();
    let level = (1.0 - up * up).max(0.0).sqrt();
    DVec3::new(level * sin, level * cos, up)
}
