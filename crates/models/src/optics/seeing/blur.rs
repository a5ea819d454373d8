//! Blur by turbulence, of short and of long exposures (Fried, JOSA 56, 1372, 1966).

use std::f64::consts::{PI, SQRT_2};

/// Nodes of the integrals over the spatial frequencies.
const NODES: usize = 48;

/// Share of the tilt in what an exposure does to the sharpness: Fried's factor is 1 where D² is far above λL (near field)
/// and 1/2 far below; between them this goes smoothly.
pub fn near_field(diameter_m: f64, wavelength_m: f64, range_m: f64) -> f64 {
    1.0 - 0.5 / (1.0 + diameter_m * diameter_m / (wavelength_m * range_m))
}

/// Standard deviation [rad] of the Gaussian that, on the diffraction of a disc, has the resolution (the integral of the
/// transfer function) of Fried's short exposure: exp(-3.44 (D u/r0)^(5/3) (1 - μ u^(1/3))), u = λ f/D. μ by [`near_field`].
pub fn short_exposure_sigma_rad(
    diameter_m: f64,
    wavelength_m: f64,
    fried_m: f64,
    near_field: f64,
) -> f64 {
    let strength = 3.44 * (diameter_m / fried_m).powf(5.0 / 3.0);
    if strength < 1e-6 {
        return 0.0;
    }
    let wanted = resolution(|u| fried(strength, near_field, u));
    // exp(-s u²): s by bisection of its logarithm.
    let (mut low, mut high) = (1e-9f64.ln(), 1e6f64.ln());
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let s = middle.exp();
        if resolution(|u| (-s * u * u).exp()) > wanted {
            low = middle;
        } else {
            high = middle;
        }
    }
    let s = (0.5 * (low + high)).exp();
    // A Gaussian of σ has exp(-2 π² σ² f²).
    s.sqrt() * wavelength_m / (SQRT_2 * PI * diameter_m)
}

/// Fried's factor of the transfer function at u, for 3.44 (D/r0)^(5/3).
pub(super) fn fried(strength: f64, near_field: f64, u: f64) -> f64 {
    let left = (1.0 - near_field * u.cbrt()).max(0.0);
    (-strength * u.powf(5.0 / 3.0) * left).exp()
}

/// Integral of a disc's transfer function times another, times u du from 0 to 1: diffraction alone leaves 1/8.
pub(super) fn resolution(of: impl Fn(f64) -> f64) -> f64 {
    let at = |i: usize| {
        // Denser near 0, where strong turbulence leaves all.
        let v = (i as f64 + 0.5) / NODES as f64;
        let u = v * v;
        let diffraction = 2.0 / PI * (u.acos() - u * (1.0 - u * u).sqrt());
        diffraction * of(u) * u * 2.0 * v / NODES as f64
    };
    (0..NODES).map(at).sum()
}

/// The same of a long exposure: exp(-3.44 (D u/r0)^(5/3)).
pub fn long_exposure_sigma_rad(diameter_m: f64, wavelength_m: f64, fried_m: f64) -> f64 {
    short_exposure_sigma_rad(diameter_m, wavelength_m, fried_m, 0.0)
}
