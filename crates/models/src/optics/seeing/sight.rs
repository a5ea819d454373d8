//! The turbulence between a station and a place that it sees.

use super::air::{EDGES_M, LAYERS};
use std::f64::consts::TAU;

/// Nodes and weights of Gauss's three-point rule on [0, 1].
const GAUSS_3: [(f64, f64); 3] = [
    (0.112_701_665_379_258_3, 5.0 / 18.0),
    (0.5, 8.0 / 18.0),
    (0.887_298_334_620_741_7, 5.0 / 18.0),
];

/// What of a layer lies before what is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Slab {
    /// Its distance [m].
    pub z_m: f64,
    /// Share of the aperture through which the rays of a point at the range cross it, 1 - z/L.
    pub gamma: f64,
    /// ∫Cn² dz that a thin layer there needs for the same part of r0 [m^(1/3)]; 0: nothing of it.
    pub strength: f64,
}

/// The turbulence on the way from a station to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// The point's distance [m]; infinite: a star.
    pub range_m: f64,
    pub(super) slabs: [Slab; LAYERS],
}

impl Sight {
    /// Layers up to a range [m], of Cn² [m^(-2/3)] at a distance along the way [m].
    ///
    /// Each lies where the mean of Cn² γ^(5/3) does, and keeps its integral: Fried's parameter of a point source stays exact.
    pub fn new(range_m: f64, cn2: impl Fn(f64) -> f64) -> Self {
        let slabs = std::array::from_fn(|i| {
            let (from_m, to_m) = (EDGES_M[i], EDGES_M[i + 1].min(range_m));
            let depth_m = to_m - from_m;
            let (mut part, mut first) = (0.0, 0.0);
            if depth_m > 0.0 {
                for (node, weight) in GAUSS_3 {
                    let z_m = from_m + node * depth_m;
                    let share = weight * depth_m * cn2(z_m) * (1.0 - z_m / range_m).powf(5.0 / 3.0);
                    part += share;
                    first += share * z_m;
                }
            }
            if part <= 0.0 {
                return Slab::default();
            }
            let z_m = first / part;
            let gamma = 1.0 - z_m / range_m;
            Slab {
                z_m,
                gamma,
                strength: part / gamma.powf(5.0 / 3.0),
            }
        });
        Self { range_m, slabs }
    }

    /// ∫Cn² (1 - z/L)^(5/3) dz [m^(1/3)].
    pub fn moment(&self) -> f64 {
        let parts = self.slabs.iter();
        parts
            .map(|slab| slab.strength * slab.gamma.powf(5.0 / 3.0))
            .sum()
    }

    /// Fried's parameter [m] at the aperture of a point source at the range, at a wavelength [m]: (0.423 k² ∫Cn² γ^(5/3) dz)^(-3/5);
    /// infinite where nothing disturbs.
    pub fn fried_m(&self, wavelength_m: f64) -> f64 {
        (0.423 * (TAU / wavelength_m).powi(2) * self.moment()).powf(-0.6)
    }

    /// Variance of the tilt about each axis [rad²] that a disc of a diameter [m] sees, without an outer scale: 0.170
    /// (λ/D)² (D/r0)^(5/3), which has no wavelength (G-tilt; Sarazin & Roddier, A&A 227, 294, 1990, and Tyler, JOSA A 11, 358,
    /// 1994).
    pub fn tilt_variance_rad2(&self, diameter_m: f64) -> f64 {
        0.170 * 0.423 * TAU * TAU * self.moment() * diameter_m.powf(-1.0 / 3.0)
    }
}
