use std::f64::consts::TAU;

use super::*;
use crate::maths::rng::Stream;

fn close(value: f64, expected: f64, relative: f64) {
    assert!(
        (value / expected - 1.0).abs() < relative,
        "{value} against {expected}"
    );
}

/// Radius [m] of the time-averaged spot of a beam of radius `w_m` [m] that jitters by
/// `axis_rms_rad` [rad, rms about each axis] at `range_m` [m]: w² + 4 σ² R².
///
/// A Gaussian spot has the variance w²/4 about each axis; an independent Gaussian jitter adds its
/// own, (σR)².
fn jitter_averaged_radius_m(w_m: f64, axis_rms_rad: f64, range_m: f64) -> f64 {
    w_m.hypot(2.0 * axis_rms_rad * range_m)
}

fn laser() -> Laser {
    Laser {
        power_w: 2000.0,
        wavelength_m: 1.064e-6,
        aperture_radius_m: 0.05,
        m2: 1.0,
    }
}

#[test]
fn spot_radii_have_the_published_values() {
    let laser = laser();
    close(laser.spot_radius_m(1000.0, 1000.0), 6.774e-3, 1e-4);
}

#[test]
fn collimated_beam_doubles_its_area_at_the_rayleigh_range() {
    let laser = Laser { m2: 1.7, ..laser() };
    let rayleigh = PI * 0.05 * 0.05 / (1.7 * 1.064e-6);
    close(
        laser.spot_radius_m(rayleigh, f64::INFINITY),
        0.05 * SQRT_2,
        1e-12,
    );
}

#[test]
fn irradiance_integrates_to_the_power() {
    let (power, w, n) = (3.0, 0.02, 2000);
    let dr = 0.1 / f64::from(n);
    let total: f64 = (0..n)
        .map(|i| (f64::from(i) + 0.5) * dr)
        .map(|r| irradiance_wpm2(power, w, r) * TAU * r * dr)
        .sum();
    close(total, power, 1e-5);
}

/// The bucket by brute force in polar coordinates about its centre.
fn bucket_by_quadrature(w: f64, d: f64, a: f64) -> f64 {
    let (nr, nt) = (4000, 512);
    let (dr, dt) = (a / nr as f64, TAU / nt as f64);
    let mut sum = 0.0;
    for i in 0..nr {
        let r = (i as f64 + 0.5) * dr;
        for j in 0..nt {
            let rho2 = r * r + d * d + 2.0 * r * d * (j as f64 * dt).cos();
            sum += irradiance_wpm2(1.0, w, rho2.sqrt()) * r * dr * dt;
        }
    }
    sum
}

#[test]
fn bucket_at_zero_offset_is_the_closed_form() {
    for ratio in [1e-4, 0.1, 1.0, 3.0, 40.0] {
        let expected = -f64::exp_m1(-2.0 * ratio * ratio);
        close(
            power_in_bucket_w(1.0, 0.01, 0.0, 0.01 * ratio),
            expected,
            1e-13,
        );
    }
    assert_eq!(power_in_bucket_w(5.0, 0.01, 0.3, 0.0), 0.0);
}

#[test]
fn bucket_with_offset_matches_quadrature() {
    // Axis inside, on the rim, outside; narrow and wide beams (in units of the bucket).
    for w in [0.15, 0.5, 1.0, 4.0] {
        for d in [0.3, 0.9, 1.0, 1.1, 2.0] {
            let error = power_in_bucket_w(1.0, w, d, 1.0) - bucket_by_quadrature(w, d, 1.0);
            assert!(error.abs() < 3e-6, "w {w}, d {d}: {error:e}");
        }
    }
}

#[test]
fn bucket_is_exact_for_a_marcum_identity() {
    // Q1(x, x) = (1 + e^(-x²) I0(x²))/2: the axis on the rim; x² = 4 a²/w². I0 from
    // Abramowitz & Stegun table 9.8.
    for (x2, i0) in [
        (1.0f64, 1.266_065_877_752_008_4),
        (4.0, 11.301_921_952_136_33),
        (10.0, 2_815.716_628_466_254),
    ] {
        let expected = 0.5 * (1.0 - (-x2).exp() * i0);
        let a = 0.5 * x2.sqrt();
        close(power_in_bucket_w(1.0, 1.0, a, a), expected, 1e-13);
    }
    // A needle on the rim of a bucket 50 times as wide: x² = 1e4, where I0(x) is its asymptotic
    // series (A&S 9.7.1).
    let x = 1e4f64;
    let series = 1.0 + 1.0 / (8.0 * x) + 9.0 / (128.0 * x * x);
    let expected = 0.5 * (1.0 - series / (TAU * x).sqrt());
    close(power_in_bucket_w(1.0, 1.0, 50.0, 50.0), expected, 1e-12);
}

#[test]
fn bucket_resolves_needle_beams() {
    // Needle beams near the rim of a wide bucket.
    for (w, d, a) in [(0.01, 0.497, 0.5), (0.01, 0.503, 0.5), (0.02, 0.5, 0.5)] {
        let fraction = power_in_bucket_w(1.0, w, d, a);
        let n = 20_000;
        let (mut inside, mut all) = (0.0, 0.0);
        // Polar coordinates about the beam axis: the angle seen inside the bucket is exact.
        for i in 0..n {
            let rho = (f64::from(i) + 0.5) * 5.0 * w / f64::from(n);
            let cosine = ((rho * rho + d * d - a * a) / (2.0 * rho * d)).clamp(-1.0, 1.0);
            let flux = irradiance_wpm2(1.0, w, rho) * rho;
            inside += flux * cosine.acos() / PI;
            all += flux;
        }
        assert!((fraction - inside / all).abs() < 1e-6, "{fraction}");
    }
}

#[test]
fn jitter_widens_the_mean_spot() {
    // Monte Carlo: mean irradiance on the axis and mean power in a bucket.
    let (w, sigma, range, bucket) = (0.012, 9e-6, 800.0, 0.01);
    let mut rng = Stream::new(21, 0, "jitter");
    let n = 200_000;
    let (mut axis, mut axis2, mut power, mut power2) = (0.0, 0.0, 0.0, 0.0);
    for _ in 0..n {
        let offset = (sigma * range) * rng.normal().hypot(rng.normal());
        let i = irradiance_wpm2(1.0, w, offset);
        let p = power_in_bucket_w(1.0, w, offset, bucket);
        axis += i;
        axis2 += i * i;
        power += p;
        power2 += p * p;
    }
    let n = f64::from(n);
    let check = |sum: f64, square: f64, expected: f64| {
        let mean = sum / n;
        let error = ((square / n - mean * mean) / n).sqrt();
        assert!((mean - expected).abs() < 5.0 * error, "{mean} {expected}");
    };
    let wide = jitter_averaged_radius_m(w, sigma, range);
    check(axis, axis2, peak_irradiance_wpm2(1.0, wide));
    check(power, power2, power_in_bucket_w(1.0, wide, 0.0, bucket));
}

fn air() -> BloomingAir {
    BloomingAir {
        absorption_per_m: 1e-5,
        extinction_per_m: 0.0,
        temperature_k: 288.15,
        crosswind_mps: 4.0,
        slew_radps: 0.0,
    }
}

#[test]
fn distortion_number_has_gebhardts_closed_forms() {
    // No diffraction: a straight-sided beam.
    let ray = Laser { m2: 0.0, ..laser() };
    let (l, a, air) = (1500.0, 0.05 / SQRT_2, air());
    // Collimated: N_C with n_T = -(n - 1)/T, n - 1 = 2.7398e-4 and 1.2250 kg/m³ at 288.15 K.
    let collimated =
        2.7398e-4 / 288.15 * 1e-5 * 2000.0 * l * l / (PI * 1.2250 * 1007.0 * 4.0 * a * a * a);
    let base = ray.distortion_number(l, f64::INFINITY, &air);
    close(base, collimated, 2e-4);
    // Focusing by N_F: 2 N_F²/(N_F - 1) (1 - ln N_F/(N_F - 1)).
    let nf: f64 = 6.0;
    let focused = ray.distortion_number(l, l / (1.0 - 1.0 / nf), &air);
    let expected = 2.0 * nf * nf / (nf - 1.0) * (1.0 - nf.ln() / (nf - 1.0));
    close(focused / base, expected, 2e-3);
    // Extinction: (2/N_E²)(N_E - 1 + e^(-N_E)).
    let ne = 0.8;
    let dim = BloomingAir {
        extinction_per_m: ne / l,
        ..air
    };
    let expected = 2.0 / (ne * ne) * (ne - 1.0 + (-ne).exp());
    close(
        ray.distortion_number(l, f64::INFINITY, &dim) / base,
        expected,
        1e-3,
    );
    // Slewing: (2/N_w²)((N_w + 1) ln(N_w + 1) - N_w).
    let nw: f64 = 5.0;
    let slewed = BloomingAir {
        slew_radps: nw * 4.0 / l,
        ..air
    };
    let expected = 2.0 / (nw * nw) * ((nw + 1.0) * nw.ln_1p() - nw);
    close(
        ray.distortion_number(l, f64::INFINITY, &slewed) / base,
        expected,
        2e-3,
    );
}

#[test]
fn blooming_halves_the_peak_at_four() {
    assert_eq!(blooming_factor(0.0), 1.0);
    assert_eq!(blooming_factor(4.0), 0.5);
    assert_eq!(blooming_factor(f64::INFINITY), 0.0);
}
