//! The closed forms and sums that references come from: nothing here is the models' own.

use boresight_wave::VonKarman;
use std::f64::consts::{PI, TAU};

/// 1/e² radius \[m\] from the mean irradiance on the axis of a beam focused at the end of a uniform path, of the radius `w_m`
/// \[m\] in still air and `w0_m` \[m\] at the aperture, by the extended Huygens–Fresnel integral, summed finely:
/// D = 6.88 (ρ/r0)^(5/3) (1 - 0.715 (κ0 ρ)^(1/3)) of the outer scale \[m\], infinite for Kolmogorov's (Andrews & Phillips, 2nd
/// ed., ch. 6 and 7).
pub fn long_term_m(w_m: f64, w0_m: f64, fried_m: f64, outer_m: f64) -> f64 {
    let n = 200_000;
    let dq = 40.0 / f64::from(n);
    let left: f64 = (0..n)
        .map(|i| (f64::from(i) + 0.5) * dq)
        .map(|q| {
            let apart_m = w0_m * (2.0 * q).sqrt();
            let held = 0.715 * (TAU / outer_m * apart_m).cbrt();
            let half = 3.44 * (apart_m / fried_m).powf(5.0 / 3.0) * (1.0 - held);
            (-q - half).exp() * dq
        })
        .sum();
    w_m / left.sqrt()
}

/// The same in weak turbulence: W sqrt(1 + 1.33 σ_R² Λ^(5/6)), Λ = 2 L/(k W²) (Andrews & Phillips, ch. 6).
pub fn weak_long_term_m(w_m: f64, rytov: f64, length_m: f64, wavelength_m: f64) -> f64 {
    let lambda = 2.0 * length_m * wavelength_m / (TAU * w_m * w_m);
    w_m * (1.0 + 1.33 * rytov * lambda.powf(5.0 / 6.0)).sqrt()
}

/// Fried's parameter \[m\] of a point at the end of a uniform path: (3/8 · 0.423 k² Cn² L)^(-3/5).
pub fn fried_spherical_m(wavelength_m: f64, cn2: f64, length_m: f64) -> f64 {
    let k = TAU / wavelength_m;
    (0.423 * k * k * cn2 * length_m * 3.0 / 8.0).powf(-0.6)
}

/// Root of the mean square of the centroid's distance from the axis \[rad\] of a beam focused on its target: the phase's slope,
/// weighted by the irradiance, over Kolmogorov's structure function.
pub fn wander_rad(wavelength_m: f64, w0_m: f64, fried_m: f64) -> f64 {
    const GAMMA_5_6: f64 = 1.128_787_029_9;
    let square = 3.44 * 25.0 / 9.0 * GAMMA_5_6 / w0_m.cbrt() * fried_m.powf(-5.0 / 3.0);
    square.sqrt() * wavelength_m / TAU
}

/// Scintillation index of a plane wave of any strength (Andrews & Phillips, 2nd ed., ch. 9, without inner scale).
pub fn plane_scintillation(rytov: f64) -> f64 {
    let power = rytov.powf(1.2);
    let large = 0.49 * rytov / (1.0 + 1.11 * power).powf(7.0 / 6.0);
    let small = 0.51 * rytov / (1.0 + 0.69 * power).powf(5.0 / 6.0);
    (large + small).exp_m1()
}

/// Bessel's function of a whole order, by its integral.
fn bessel(order: i32, x: f64) -> f64 {
    let n = 40 + (1.5 * x.abs()) as usize;
    let at = |i: usize| PI * (i as f64 + 0.5) / n as f64;
    let sum: f64 = (0..n)
        .map(|i| (f64::from(order) * at(i) - x * at(i).sin()).cos())
        .sum();
    sum / n as f64
}

/// Radial and azimuthal order of Zernike's polynomials 2 to 15 in Noll's order, and whether it goes with the sine (J. Opt.
/// Soc. Am. 66, 207, 1976).
pub const NOLL: [(i32, i32, bool); 14] = [
    (1, 1, false),
    (1, 1, true),
    (2, 0, false),
    (2, 2, true),
    (2, 2, false),
    (3, 1, true),
    (3, 1, false),
    (3, 3, true),
    (3, 3, false),
    (4, 0, false),
    (4, 2, false),
    (4, 2, true),
    (4, 4, false),
    (4, 4, true),
];

/// Zernike's polynomial at a place of the unit disc, of mean square one.
pub fn zernike((n, m, sine): (i32, i32, bool), x: f64, y: f64) -> f64 {
    let factorial = |k: i32| (1..=k).map(f64::from).product::<f64>();
    let (r, angle) = (x.hypot(y), y.atan2(x) * f64::from(m));
    let radial: f64 = (0..=(n - m) / 2)
        .map(|k| {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            let below = factorial(k) * factorial((n + m) / 2 - k) * factorial((n - m) / 2 - k);
            sign * factorial(n - k) / below * r.powi(n - 2 * k)
        })
        .sum();
    let turn = match (m, sine) {
        (0, _) => 1.0,
        (_, true) => 2f64.sqrt() * angle.sin(),
        (_, false) => 2f64.sqrt() * angle.cos(),
    };
    f64::from(n + 1).sqrt() * radial * turn
}

/// Mean square of a polynomial of radial order n over an aperture (Noll's equation 24, with an outer scale) \[m²\].
pub fn zernike_variance_m2(spectrum: &VonKarman, strength: f64, n: i32, diameter_m: f64) -> f64 {
    let (low, high, parts) = (1e-6f64, 60.0 / diameter_m, 3000);
    let step = (high / low).ln() / f64::from(parts);
    let sum: f64 = (0..parts)
        .map(|i| {
            let f = low * ((f64::from(i) + 0.5) * step).exp();
            let x = PI * f * diameter_m;
            let shape = (2.0 * bessel(n + 1, x) / x).powi(2);
            f * f * spectrum.density(strength, f) * f64::from(n + 1) * shape
        })
        .sum();
    TAU * sum * step
}

/// Response to a unit step of ω²/(s² + 2ζωs + ω²), ζ below 1, after a time \[s\].
pub fn second_order_step(omega_radps: f64, damping: f64, t_s: f64) -> f64 {
    let s = damping * omega_radps;
    let damped = omega_radps * (1.0 - damping * damping).sqrt();
    1.0 - (-s * t_s).exp() * ((damped * t_s).cos() + s / damped * (damped * t_s).sin())
}

/// Its overshoot, e^(-πζ/√(1 - ζ²)).
pub fn overshoot(damping: f64) -> f64 {
    (-PI * damping / (1.0 - damping * damping).sqrt()).exp()
}

/// Whether these forms have the values that their sources print.
#[cfg(test)]
mod tests {
    use super::*;

    fn close(is: f64, wanted: f64, relative: f64) {
        assert!(
            (is / wanted - 1.0).abs() < relative,
            "{is} against {wanted}"
        );
    }

    #[test]
    fn nolls_table_comes_out() {
        // Differences of Noll's residuals over (D/r0)^(5/3), for r0 = 1 m at k = 1.
        let kolmogorov = VonKarman {
            outer_m: f64::INFINITY,
            inner_m: 0.0,
        };
        for (n, wanted) in [(1, 0.448), (2, 0.0232), (3, 0.00619), (4, 0.00245)] {
            let found = zernike_variance_m2(&kolmogorov, 1.0 / 0.423, n, 1.0);
            close(found, wanted, 0.015);
        }
    }

    #[test]
    fn weak_and_exact_radius_agree_where_turbulence_is_weak() {
        let (wavelength_m, length_m, w0_m) = (1.064e-6, 1000.0, 0.05);
        let w_m = wavelength_m * length_m / (PI * w0_m);
        let rytov = 1.23 * 1e-17 * (TAU / wavelength_m).powf(7.0 / 6.0) * length_m.powf(11.0 / 6.0);
        let weak = weak_long_term_m(w_m, rytov, length_m, wavelength_m);
        let fried_m = fried_spherical_m(wavelength_m, 1e-17, length_m);
        let exact = long_term_m(w_m, w0_m, fried_m, f64::INFINITY);
        close(exact, weak, 2e-4);
    }

    #[test]
    fn scintillation_has_its_limits() {
        close(plane_scintillation(1e-3), 1e-3, 0.01);
        // 1 + 0.86 σ_R^(-4/5) where it is saturated.
        close(
            plane_scintillation(1e5),
            1.0 + 0.86 * 1e5f64.powf(-0.4),
            0.01,
        );
    }

    #[test]
    fn a_step_overshoots_by_its_closed_form() {
        let most = (0..4000)
            .map(|k| second_order_step(10.0, 0.5, 1e-3 * f64::from(k)))
            .fold(0.0, f64::max);
        close(most - 1.0, overshoot(0.5), 1e-4);
    }
}
