//! The spectrum of turbulence.

use std::f64::consts::{PI, TAU};

/// Turbulence with outer and inner scale: 0.033 Cn² (κ² + κ0²)^(-11/6) exp(-κ²/κm²), κ0 = 2π/L0, κm = 5.92/l0 (von Kármán,
/// modified; Andrews & Phillips, Laser Beam Propagation through Random Media, 2nd ed., SPIE 2005, ch. 3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VonKarman {
    /// Outer scale L0 \[m\]; infinite for Kolmogorov's.
    pub outer_m: f64,
    /// Inner scale l0 \[m\]; 0 for none.
    pub inner_m: f64,
}

impl VonKarman {
    /// Density over frequency (cycles/m) of the optical path through a layer of a strength, the integral of Cn² over it
    /// \[m^(1/3)\]: \[m² m²\].
    pub fn density(&self, strength: f64, frequency_pm: f64) -> f64 {
        let kappa2 = (TAU * frequency_pm).powi(2);
        let outer2 = (TAU / self.outer_m).powi(2);
        let inner = self.inner_m / 5.92;
        // The path's spectrum is 2π times the index's over the layer; (2π)² of it go to cycles.
        TAU.powi(3)
            * 0.033
            * strength
            * (kappa2 + outer2).powf(-11.0 / 6.0)
            * (-kappa2 * inner * inner).exp()
    }

    /// Mean square of the wave in the middle (x, y) \[cycles/m\] of a square cell of a side, so that it makes the difference at
    /// two places about so far apart that all of the cell makes \[m²\]: where waves are longer, as their slopes, where they are
    /// shorter, as their mean squares.
    pub(crate) fn of_cell(&self, strength: f64, [x, y]: [f64; 2], side: f64, apart_m: f64) -> f64 {
        const PARTS: usize = 12;
        let difference = |f: f64| -(-(PI * f * apart_m).powi(2)).exp_m1();
        let mut sum = 0.0;
        let at = |middle: f64, i: usize| middle + ((i as f64 + 0.5) / PARTS as f64 - 0.5) * side;
        for i in 0..PARTS {
            for j in 0..PARTS {
                let f = at(x, i).hypot(at(y, j));
                sum += difference(f) * self.density(strength, f);
            }
        }
        sum * (side / PARTS as f64).powi(2) / difference(x.hypot(y))
    }

    /// Mean square of the difference of the optical path at two places so far apart, through a layer of a strength \[m²\]:
    /// 4π ∫ (1 - J0(2π f r)) density f df.
    pub fn structure_m2(&self, strength: f64, apart_m: f64) -> f64 {
        // In the logarithm of f, from far above the outer scale to far below the distance.
        let low = (1e-4 / apart_m).min(1e-3 / self.outer_m.min(1e9));
        let high = 300.0 / apart_m;
        let n = 6000;
        let step = (high / low).ln() / f64::from(n);
        let sum: f64 = (0..n)
            .map(|i| {
                let f = low * ((f64::from(i) + 0.5) * step).exp();
                f * f * (1.0 - j0(TAU * f * apart_m)) * self.density(strength, f)
            })
            .sum();
        // Beyond, J0 is nothing on the average; the density falls as f^(-11/3).
        let tail = if self.inner_m > 0.0 {
            0.0
        } else {
            high * high * self.density(strength, high) * 0.6
        };
        2.0 * TAU * (sum * step + tail)
    }
}

/// Bessel's function of order 0: its integral by the trapezium rule, exact for a periodic integrand.
pub(crate) fn j0(x: f64) -> f64 {
    let n = 24 + (1.2 * x.abs()) as usize;
    let sum: f64 = (0..n)
        .map(|i| (x * (PI * (i as f64 + 0.5) / n as f64).sin()).cos())
        .sum();
    sum / n as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kolmogorovs_structure_function_is_the_five_thirds_law() {
        // D = 2.914 k² Cn² L r^(5/3) for a plane wave (Andrews & Phillips, ch. 6), here of the path: without k².
        let spectrum = VonKarman {
            outer_m: f64::INFINITY,
            inner_m: 0.0,
        };
        for r in [0.01, 0.1, 1.0f64] {
            let ratio = spectrum.structure_m2(1e-11, r) / (2.914e-11 * r.powf(5.0 / 3.0));
            assert!((ratio - 1.0).abs() < 0.005, "{r}: {ratio}");
        }
    }

    #[test]
    fn von_karmans_structure_function_has_published_values() {
        // r0 = 0.1 m, L0 = 100 m: 8.394 rad² at 0.125 m, 75.15 rad² at 0.5 m.
        let spectrum = VonKarman {
            outer_m: 100.0,
            inner_m: 0.0,
        };
        // 0.423 k² ∫Cn² = r0^(-5/3); with k = 1 the path is the phase.
        let strength = 0.1f64.powf(-5.0 / 3.0) / 0.423;
        for (r, expected) in [(0.125, 8.394), (0.5, 75.15)] {
            let ratio = spectrum.structure_m2(strength, r) / expected;
            assert!((ratio - 1.0).abs() < 0.005, "{r}: {ratio}");
        }
    }
}
