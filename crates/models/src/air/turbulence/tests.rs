use super::*;
use std::f64::consts::PI;

const LAMBDA: f64 = 1.064e-6;

fn close(value: f64, expected: f64, relative: f64) {
    assert!(
        (value / expected - 1.0).abs() < relative,
        "{value} against {expected}"
    );
}

fn uniform() -> PathTurbulence {
    let path = AirPath {
        length_m: 1000.0,
        h0_m: 10.0,
        h1_m: 10.0,
    };
    PathTurbulence::new(&Cn2Profile::Constant(1e-14), &path, LAMBDA, f64::INFINITY)
}

#[test]
fn uniform_path_has_the_closed_forms() {
    let t = uniform();
    let k = TAU / LAMBDA;
    let scale = 1e-14 * k.powf(7.0 / 6.0) * 1000f64.powf(11.0 / 6.0);
    // The moments of the weights: 6/11 and the beta function B(11/6, 11/6) = 0.2206.
    close(t.rytov_plane, 2.25 * 6.0 / 11.0 * scale, 1e-4);
    close(t.rytov_plane, 0.3088, 3e-3);
    close(t.rytov_spherical / t.rytov_plane, 0.4043, 1e-3);
    close(t.fried_plane_m, 0.0500, 2e-3);
    close(t.fried_spherical_m, 0.0900, 2e-3);
    close(
        t.fried_spherical_m / t.fried_plane_m,
        (3.0 / 8.0f64).powf(-0.6),
        1e-6,
    );
}

#[test]
fn hufnagel_valley_zenith_fried_parameter() {
    let profile = Cn2Profile::HufnagelValley {
        wind_mps: 21.0,
        ground: 1.7e-14,
    };
    let path = AirPath {
        length_m: 30e3,
        h0_m: 0.0,
        h1_m: 30e3,
    };
    let t = PathTurbulence::new(&profile, &path, 500e-9, f64::INFINITY);
    close(t.fried_plane_m, 0.04961, 2e-4);
    let mut integral = 0.0;
    path.for_each_node(|dz, _, h| integral += profile.cn2(h) * dz);
    close(integral, 2.2354e-12, 2e-4);
    // Isoplanatic angle 6.894 urad from the 5/3 moment of height (0.5 % of it is above 25 km).
    let mut moment = 0.0;
    path.for_each_node(|dz, _, h| moment += profile.cn2(h) * h.powf(5.0 / 3.0) * dz);
    let k = TAU / 500e-9;
    close((2.914 * k * k * moment).powf(-0.6), 6.894e-6, 2e-3);
}

#[test]
fn reversed_path_swaps_the_ends() {
    let profile = Cn2Profile::Urban {
        cn2_ref: 1e-14,
        height_ref_m: 10.0,
        displacement_m: 0.0,
        day: true,
    };
    let make = |h0_m, h1_m| {
        let path = AirPath {
            length_m: 1500.0,
            h0_m,
            h1_m,
        };
        PathTurbulence::new(&profile, &path, LAMBDA, f64::INFINITY)
    };
    let (up, down) = (make(5.0, 200.0), make(200.0, 5.0));
    close(up.rytov_spherical, down.rytov_spherical, 1e-12);
    close(up.fried_plane_m, down.fried_plane_m, 1e-12);
    // Turbulence at the transmitter harms the beam most.
    assert!(up.fried_spherical_m < 0.5 * down.fried_spherical_m);
    // Closed form of ∫ h^(-4/3) along the slant: 3 (h0^(-1/3) - h1^(-1/3)) L/(h1 - h0).
    let integral = 1e-14
        * 10f64.powf(4.0 / 3.0)
        * 3.0
        * (5f64.powf(-1.0 / 3.0) - 200f64.powf(-1.0 / 3.0))
        * 1500.0
        / 195.0;
    let k = TAU / LAMBDA;
    close(
        up.fried_plane_m,
        (0.423 * k * k * integral).powf(-0.6),
        1e-6,
    );
}

/// 1/e² radius of the mean irradiance on the axis by the extended Huygens–Fresnel integral, of a beam focused at 1 km.
fn by_quadrature(w0_m: f64, fried_m: f64) -> f64 {
    let x = (2.0 * w0_m * w0_m).powf(5.0 / 6.0) * (fried_m / 2.1).powf(-5.0 / 3.0);
    let n = 400_000;
    let dq = 40.0 / f64::from(n);
    let left: f64 = (0..n)
        .map(|i| (f64::from(i) + 0.5) * dq)
        .map(|q| (-q - x * q.powf(5.0 / 6.0)).exp() * dq)
        .sum();
    LAMBDA * 1000.0 / (PI * w0_m) / left.sqrt()
}

fn of(cn2: f64, outer_m: f64) -> PathTurbulence {
    let path = AirPath {
        length_m: 1000.0,
        h0_m: 0.0,
        h1_m: 0.0,
    };
    PathTurbulence::new(&Cn2Profile::Constant(cn2), &path, LAMBDA, outer_m)
}

#[test]
fn the_long_term_radius_is_the_extended_huygens_fresnel_integrals() {
    let w = LAMBDA * 1000.0 / (PI * 0.05);
    for cn2 in [1e-16, 1e-15, 1e-14, 1e-13, 1e-12] {
        let t = of(cn2, f64::INFINITY);
        let exact = by_quadrature(0.05, t.fried_spherical_m);
        close(t.long_term_radius_m(w), exact, 2e-3);
    }
    // Weak turbulence: Andrews & Phillips' W sqrt(1 + 1.33 σ_R² Λ^(5/6)), Λ = 2 L/(k W²).
    let t = of(1e-16, f64::INFINITY);
    let lambda = 2.0 * 1000.0 * LAMBDA / (TAU * w * w);
    let weak = w * (1.0 + 1.33 * t.rytov_plane * lambda.powf(5.0 / 6.0)).sqrt();
    close(t.long_term_radius_m(w), weak, 1e-3);
}

#[test]
fn an_outer_scale_holds_spread_and_wander_back() {
    let w = LAMBDA * 1000.0 / (PI * 0.05);
    let radii =
        [f64::INFINITY, 100.0, 10.0, 1.0].map(|outer_m| of(1e-14, outer_m).long_term_radius_m(w));
    assert!(radii.is_sorted_by(|a, b| a > b), "{radii:?}");
    assert!(radii[3] > w);
}

#[test]
fn the_spot_of_a_moment_lies_between_the_lens_and_the_long_term() {
    let w = LAMBDA * 1000.0 / (PI * 0.05);
    for cn2 in [1e-16, 1e-14, 1e-13, 1e-12] {
        let t = of(cn2, 20.0);
        let short = t.short_term_radius_m(w);
        assert!(
            w < short && short < t.long_term_radius_m(w),
            "{cn2}: {short}"
        );
    }
}

/// Root of the mean square of the centroid's distance from the axis [rad], of a beam focused on the target: the phase's slope,
/// weighted by the irradiance, over Kolmogorov's structure function, 6.88/2 · 25/9 · Γ(5/6) W0^(-1/3) r0^(-5/3) / k².
fn centroid_rms_rad(turbulence: &PathTurbulence, w0_m: f64) -> f64 {
    const GAMMA_5_6: f64 = 1.128_787_029_9;
    let square =
        3.44 * 25.0 / 9.0 * GAMMA_5_6 / w0_m.cbrt() * turbulence.fried_spherical_m.powf(-5.0 / 3.0);
    square.sqrt() / turbulence.wavenumber_radpm
}

#[test]
fn the_wander_is_the_centroids() {
    // Up to D/r0 of one the spot is one piece: what the radii leave for the wander is the centroid's, within a tenth.
    let w = LAMBDA * 1000.0 / (PI * 0.05);
    let t = of(1e-14, f64::INFINITY);
    let left = (t.long_term_radius_m(w).powi(2) - t.short_term_radius_m(w).powi(2)).sqrt();
    close(2f64.sqrt() * 0.5e-3 * left, centroid_rms_rad(&t, 0.05), 0.1);
    close(1000.0 * centroid_rms_rad(&t, 0.05), 6.81e-3, 5e-3);
}
