//! Optical turbulence along a slant path, and what it makes of a beam on the average.
//!
//! "A&P" is Andrews & Phillips, Laser Beam Propagation through Random Media, 2nd ed., SPIE 2005. The spectrum is Kolmogorov's
//! but for the outer scale, which takes from spread and wander; the inner scale is zero.

use std::f64::consts::TAU;

use crate::air::atmosphere::Cn2Profile;

/// A straight path over flat ground from the transmitter to the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AirPath {
    /// Length [m].
    pub length_m: f64,
    /// Height of the transmitter above the ground [m].
    pub h0_m: f64,
    /// Height of the target above the ground [m].
    pub h1_m: f64,
}

/// Positive nodes and weights of the 8-point Gauss–Legendre rule on [-1, 1] (Abramowitz & Stegun
/// table 25.4).
const GAUSS_8: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];
const PANELS: usize = 4;

impl AirPath {
    /// Adds `weight * f(z / length, height)` over quadrature nodes whose weights sum to the length:
    /// eight-point Gauss in four panels of u, z graded as u^3 from the lower end, where Cn² varies
    /// most.
    fn for_each_node(&self, mut f: impl FnMut(f64, f64, f64)) {
        let up = self.h1_m >= self.h0_m;
        let half = 0.5 / PANELS as f64;
        for panel in 0..PANELS {
            let middle = (2 * panel + 1) as f64 * half;
            for (node, weight) in GAUSS_8 {
                for u in [middle - half * node, middle + half * node] {
                    let s = u * u * u;
                    let t = if up { s } else { 1.0 - s };
                    let dz = self.length_m * half * weight * 3.0 * u * u;
                    f(dz, t, self.h0_m + (self.h1_m - self.h0_m) * t);
                }
            }
        }
    }
}

/// The turbulence integrals of one path at one wavelength (about 2 us to make: renew it when the
/// path has changed by some metres rather than every tick).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathTurbulence {
    /// Rytov variance of a plane wave that starts at the transmitter [-]:
    /// 2.25 k^(7/6) ∫ Cn² (L - z)^(5/6) dz (A&P ch. 12; 1.23 Cn² k^(7/6) L^(11/6) if uniform).
    pub rytov_plane: f64,
    /// Rytov variance of a spherical wave [-]: 2.25 k^(7/6) ∫ Cn² (z (1 - z/L))^(5/6) dz (0.497 Cn²
    /// k^(7/6) L^(11/6) if uniform); the same from either end.
    pub rytov_spherical: f64,
    /// Fried parameter of a plane wave [m]: (0.423 k² ∫ Cn² dz)^(-3/5).
    pub fried_plane_m: f64,
    /// Fried parameter at the transmitter of a point source at the target [m]:
    /// (0.423 k² ∫ Cn² (1 - z/L)^(5/3) dz)^(-3/5). By reciprocity it governs both the sensor's
    /// image and the spread of a beam focused on the target.
    pub fried_spherical_m: f64,
    wavenumber_radpm: f64,
    length_m: f64,
    outer_m: f64,
}

impl PathTurbulence {
    /// Integrates `profile` along `path` at `wavelength_m` [m], of the outer scale `outer_m` [m] (infinite for none).
    pub fn new(profile: &Cn2Profile, path: &AirPath, wavelength_m: f64, outer_m: f64) -> Self {
        let (mut plane, mut spherical, mut total, mut weighted) = (0.0, 0.0, 0.0, 0.0);
        path.for_each_node(|dz, t, height_m| {
            let cn2_dz = profile.cn2(height_m) * dz;
            let left = 1.0 - t;
            let left_56 = left.powf(5.0 / 6.0);
            total += cn2_dz;
            plane += cn2_dz * left_56;
            spherical += cn2_dz * left_56 * t.powf(5.0 / 6.0);
            weighted += cn2_dz * left_56 * left_56;
        });
        let k = TAU / wavelength_m;
        let rytov = 2.25 * k.powf(7.0 / 6.0) * path.length_m.powf(5.0 / 6.0);
        let fried = |integral: f64| (0.423 * k * k * integral).powf(-0.6);
        Self {
            rytov_plane: rytov * plane,
            rytov_spherical: rytov * spherical,
            fried_plane_m: fried(total),
            fried_spherical_m: fried(weighted),
            wavenumber_radpm: k,
            length_m: path.length_m,
            outer_m,
        }
    }

    /// Long-term 1/e² intensity radius [m] at the target of a beam whose radius without turbulence is `w_m` [m]: that of the
    /// Gaussian which has the mean irradiance on the axis, by the extended Huygens–Fresnel integral
    /// ⟨I⟩/I0 = ∫ exp(-q - D(ρ)/2) dq, ρ² = 8 L² q / (k W)², D = 6.88 (ρ/r0)^(5/3) (1 - 0.715 (κ0 ρ)^(1/3)), κ0 = 2π/L0
    /// (A&P ch. 6 and 7).
    pub fn long_term_radius_m(&self, w_m: f64) -> f64 {
        let scale_m = 8f64.sqrt() * self.length_m / (self.wavenumber_radpm * w_m);
        let spread = 3.44 * (scale_m / self.fried_spherical_m).powf(5.0 / 3.0);
        let held = 0.715 * (TAU / self.outer_m * scale_m).cbrt();
        // The integrand falls within some units of the smaller of 1 and spread^(-6/5); in q = (unit) v³ it is smooth.
        let unit = 1.0 / (1.0 + spread.powf(1.2));
        let mut left = 0.0;
        const REACH: f64 = 4.0;
        for panel in 0..2 * PANELS {
            let half = 0.5 * REACH / (2 * PANELS) as f64;
            let middle = (2 * panel + 1) as f64 * half;
            for (node, weight) in GAUSS_8 {
                for v in [middle - half * node, middle + half * node] {
                    let root = (unit * v * v * v).sqrt();
                    let structure =
                        spread * root.powf(5.0 / 3.0) * (1.0 - held * root.cbrt()).max(0.0);
                    left += half * weight * 3.0 * unit * v * v * (-root * root - structure).exp();
                }
            }
        }
        w_m / left.sqrt()
    }

    /// Short-term 1/e² intensity radius [m] about the centroid, where the spot's peak is concerned:
    /// W² + (0.366 λ L / r0)².
    ///
    /// The form is Breaux's for tilt-corrected apertures (1978; recalled), with the factor that split steps give for D/r0 up
    /// to 3 (example `spots` of `boresight-wave`); never more than the long-term radius.
    pub fn short_term_radius_m(&self, w_m: f64) -> f64 {
        let lambda_m = TAU / self.wavenumber_radpm;
        let spread_m = 0.366 * lambda_m * self.length_m / self.fried_spherical_m;
        w_m.hypot(spread_m).min(self.long_term_radius_m(w_m))
    }

    /// Variance of the logarithm of the short-term spot's peak [-] of a beam of 1/e² radius `w0_m` [m] at the transmitter:
    /// 0.0175 (2 W0/r0)², by the same example for D/r0 from 0.3 to 3, and at most one.
    pub fn peak_log_variance(&self, w0_m: f64) -> f64 {
        (0.0175 * (2.0 * w0_m / self.fried_spherical_m).powi(2)).min(1.0)
    }
}

#[cfg(test)]
mod tests;
