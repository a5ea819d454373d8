use super::*;

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
    PathTurbulence::new(&Cn2Profile::Constant(1e-14), &path, LAMBDA)
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
    let t = PathTurbulence::new(&profile, &path, 500e-9);
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
        PathTurbulence::new(&profile, &path, LAMBDA)
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

#[test]
fn focused_beam_has_the_published_spread_and_wander() {
    let t = uniform();
    let w0 = 0.05;
    let w = LAMBDA * 1000.0 / (std::f64::consts::PI * w0);
    close(t.long_term_radius_m(w), 12.065e-3, 2e-3);
    close(t.wander_rms_m(w0), 8.6e-3, 2e-3);
    let short = t.short_term_radius_m(w, w0);
    let axis = 1000.0 * t.wander_axis_rms_rad(w0);
    close(
        (short * short + 4.0 * axis * axis).sqrt(),
        t.long_term_radius_m(w),
        1e-12,
    );
    assert!(short > w);
}

#[test]
fn simulated_wander_agrees_with_the_centroid_tilt() {
    // First principles, independent of A&P: the irradiance-weighted phase gradient of a
    // Gaussian beam over D = 6.88 (r/r0)^(5/3) has the two-axis variance
    // 6.88/2 · 25/9 · Γ(5/6) W0^(-1/3) r0^(-5/3) / k².
    let t = uniform();
    let w0: f64 = 0.05;
    let k = TAU / LAMBDA;
    let two_axes = 0.5 * 6.88 * 25.0 / 9.0 * 1.128_787 / w0.cbrt()
        * t.fried_spherical_m.powf(-5.0 / 3.0)
        / (k * k);
    close(t.wander_axis_rms_rad(w0), (0.5 * two_axes).sqrt(), 0.12);
}

#[test]
fn long_term_radius_against_huygens_fresnel() {
    // On-axis irradiance of a focused Gaussian through a 5/3 structure function: the ratio to
    // vacuum is ∫ exp(-q) exp(-(2 W0² q)^(5/6) / ρ0^(5/3)) dq.
    let w0 = 0.05;
    let w = LAMBDA * 1000.0 / (std::f64::consts::PI * w0);
    for (cn2, tolerance) in [(1e-16, 1e-3), (1e-15, 0.03), (1e-14, 0.08), (1e-13, 0.3)] {
        let path = AirPath {
            length_m: 1000.0,
            h0_m: 0.0,
            h1_m: 0.0,
        };
        let t = PathTurbulence::new(&Cn2Profile::Constant(cn2), &path, LAMBDA);
        let x = (2.0 * w0 * w0).powf(5.0 / 6.0) * (t.fried_spherical_m / 2.1).powf(-5.0 / 3.0);
        let n = 400_000;
        let dq = 40.0 / f64::from(n);
        let strehl: f64 = (0..n)
            .map(|i| (f64::from(i) + 0.5) * dq)
            .map(|q| (-q - x * q.powf(5.0 / 6.0)).exp() * dq)
            .sum();
        let exact = w / strehl.sqrt();
        close(t.long_term_radius_m(w), exact, tolerance);
    }
}

#[test]
fn gamma_gamma_has_its_limits() {
    // Weak: the scintillation index of a plane wave is the Rytov variance.
    close(GammaGamma::new(1e-4, 0.0).scintillation_index(), 1e-4, 2e-3);
    // Saturation: 1 + 0.86 σ_R^(-4/5) (A&P ch. 9, zero inner scale).
    let rytov = 1e4f64;
    close(
        GammaGamma::new(rytov, 0.0).scintillation_index(),
        1.0 + 0.86 * rytov.powf(-0.4),
        0.01,
    );
    // A wide aperture averages.
    assert!(
        GammaGamma::new(0.3, 25.0).scintillation_index()
            < 0.1 * GammaGamma::new(0.3, 0.0).scintillation_index()
    );
    // No turbulence: no scintillation.
    let mut rng = Stream::new(1, 0, "still");
    let mut still = Scintillation::new(GammaGamma::new(0.0, 0.0), 0.01, &mut rng);
    assert_eq!(still.step(0.001, &mut rng), 1.0);
}

#[test]
fn gamma_map_is_the_exponential_law_for_shape_one() {
    // P(g < y) = 1 - e^-y, so g = -ln(1 - Φ(x)).
    let map = GammaMap::new(1.0);
    for (x, phi_below) in [
        (-3.0, 1.349_898_031_63e-3),
        (-1.0, 0.158_655_253_931),
        (0.0, 0.5),
        (1.0, 0.841_344_746_069),
        (3.0, 0.998_650_101_968),
    ] {
        let expected = (-f64::ln_1p(-phi_below)).ln();
        let error = map.ln_gamma_variate(x) - expected;
        // Linear interpolation: h²/8 of the curvature, about 0.5.
        assert!(error.abs() < 2e-4, "{x}: {error}");
    }
}

#[test]
fn gamma_map_has_the_quantiles_of_chi_square() {
    // Ten degrees of freedom are shape 5; published percentage points of χ² at 0.1, 2.5, 50,
    // 97.5 and 99.9 %, printed to five digits.
    let map = GammaMap::new(5.0);
    for (x, chi2) in [
        (-3.090_232, 1.4787),
        (-1.959_964, 3.2470),
        (0.0, 9.3418),
        (1.959_964, 20.4832),
        (3.090_232, 29.5883),
    ] {
        close(10.0 * map.ln_gamma_variate(x).exp(), chi2, 1e-4);
    }
}

#[test]
fn scintillation_has_the_moments_of_gamma_gamma() {
    for (i, rytov) in [0.1, 1.0, 25.0].into_iter().enumerate() {
        let mut rng = Stream::new(11, i as u64, "moments");
        let parameters = GammaGamma::new(rytov, 0.0);
        let mut channel = Scintillation::new(parameters, 1e-3, &mut rng);
        let n = 1_000_000;
        let (mut s1, mut s2, mut s4) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            // 30 correlation times: independent draws.
            let d = channel.step(0.03, &mut rng) - 1.0;
            s1 += d;
            s2 += d * d;
            s4 += d * d * d * d;
        }
        let n = f64::from(n);
        let (mean, variance) = (s1 / n, s2 / n);
        let index = parameters.scintillation_index();
        // Five standard errors.
        assert!(mean.abs() < 5.0 * (index / n).sqrt(), "{mean}");
        let error = ((s4 / n - variance * variance) / n).sqrt();
        assert!((variance - index).abs() < 5.0 * error, "{variance} {index}");
    }
}

#[test]
fn scintillation_correlates_over_its_time() {
    // Weak turbulence makes the map linear: the Gaussian's own exp(-1) at one time constant,
    // whatever the step.
    for steps in [1, 8] {
        let mut rng = Stream::new(3, steps, "correlation");
        let tau = 5e-3;
        let mut channel = Scintillation::new(GammaGamma::new(1e-3, 0.0), tau, &mut rng);
        let n = 200_000;
        let (mut same, mut lagged) = (0.0, 0.0);
        let mut last = channel.step(0.0, &mut rng) - 1.0;
        for _ in 0..n {
            let mut now = last;
            for _ in 0..steps {
                now = channel.step(tau / steps as f64, &mut rng) - 1.0;
            }
            same += now * now;
            lagged += now * last;
            last = now;
        }
        let correlation = lagged / same;
        // Five standard errors are 5 sqrt((1 - ρ²)/n) = 0.0104.
        assert!(
            (correlation - (-1f64).exp()).abs() < 0.0105,
            "{correlation}"
        );
    }
}

#[test]
fn retuning_keeps_the_state() {
    let mut rng = Stream::new(5, 0, "retune");
    let weak = GammaGamma::new(0.2, 0.0);
    let mut channel = Scintillation::new(weak, 1e-2, &mut rng);
    let before = channel.step(0.0, &mut rng);
    channel.retune(GammaGamma::new(2.0, 0.0), 1e-2);
    assert_ne!(channel.step(0.0, &mut rng), before);
    channel.retune(weak, 1e-2);
    assert_eq!(channel.step(0.0, &mut rng), before);
}

#[test]
fn paper_intensity_is_geometric_brownian_motion() {
    let (gamma, sigma, t) = (0.7, 0.5, 0.8);
    let mut rng = Stream::new(9, 0, "paper");
    let n = 200_000;
    let (mut mean, mut log_mean, mut log_square) = (0.0, 0.0, 0.0);
    for _ in 0..n {
        let mut channel = PaperIntensity::new(gamma, sigma);
        // Unequal steps: the update is exact for any.
        channel.step(0.3 * t, &mut rng);
        let i = channel.step(0.7 * t, &mut rng);
        mean += i;
        log_mean += i.ln();
        log_square += i.ln() * i.ln();
    }
    let n = f64::from(n);
    let (mean, log_mean) = (mean / n, log_mean / n);
    let log_variance = log_square / n - log_mean * log_mean;
    let variance = sigma * sigma * t;
    let expected = (-gamma * t).exp();
    // Five standard errors each.
    let error = expected * (variance.exp_m1() / n).sqrt();
    assert!((mean - expected).abs() < 5.0 * error);
    assert!((log_mean + (gamma + 0.5 * sigma * sigma) * t).abs() < 5.0 * (variance / n).sqrt());
    assert!((log_variance - variance).abs() < 5.0 * variance * (2.0 / n).sqrt());
}

#[test]
fn wander_has_its_rms_and_correlation() {
    let mut rng = Stream::new(4, 0, "wander");
    let (rms, tau) = (4.3e-6, 0.02);
    let mut wander = Wander::new(rms, tau, &mut rng);
    let n = 200_000;
    let (mut same, mut cross, mut lagged) = (DVec2::ZERO, 0.0, DVec2::ZERO);
    let mut last = wander.step(0.0, &mut rng);
    for _ in 0..n {
        wander.step(0.25 * tau, &mut rng);
        let now = wander.step(0.75 * tau, &mut rng);
        same += now * now;
        cross += now.x * now.y;
        lagged += now * last;
        last = now;
    }
    let n = f64::from(n);
    let variance = same / n;
    // Correlated samples: five standard errors with (1 + ρ²)/(1 - ρ²) = 1.313 as many.
    let tolerance = 5.0 * (2.0 * 1.313 / n).sqrt();
    close(variance.x, rms * rms, tolerance);
    close(variance.y, rms * rms, tolerance);
    assert!((cross / n).abs() < tolerance * rms * rms);
    let correlation = lagged / same;
    assert!((correlation - (-1f64).exp()).abs().max_element() < 0.0105);
}
