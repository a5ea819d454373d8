//! The laser beam: a focused Gaussian through turbulent, absorbing air on to a target.
//!
//! Radii are 1/e² radii of the irradiance (1/e of the field) throughout.

use std::f64::consts::{PI, SQRT_2};

use crate::models::turbulence::PathTurbulence;
use glam::DVec3;

/// A laser behind its beam director.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Laser {
    /// Power that leaves the aperture [W].
    pub power_w: f64,
    /// Wavelength [m].
    pub wavelength_m: f64,
    /// Radius W0 at the exit where the irradiance is 1/e² (the field 1/e) of its peak [m]; the
    /// clear aperture is taken wide enough not to clip.
    pub aperture_radius_m: f64,
    /// Beam propagation ratio M² [-] (ISO 11146-1), 1 for a perfect Gaussian.
    pub m2: f64,
}

impl Laser {
    /// Radius [m] at `range_m` [m] without turbulence, the beam focused at `focus_range_m` [m]
    /// (infinite: collimated): W² = W0² (1 - R/F)² + (M² λ R / (π W0))² (Siegman, Proc. SPIE 1224,
    /// 1990).
    pub fn spot_radius_m(&self, range_m: f64, focus_range_m: f64) -> f64 {
        let geometric = self.aperture_radius_m * (1.0 - range_m / focus_range_m);
        let diffraction = self.m2 * self.wavelength_m * range_m / (PI * self.aperture_radius_m);
        geometric.hypot(diffraction)
    }

    /// Long-term radius [m] at the end of the path of `turbulence`: diffraction, turbulent spread
    /// and wander together.
    pub fn long_term_radius_m(
        &self,
        range_m: f64,
        focus_range_m: f64,
        turbulence: &PathTurbulence,
    ) -> f64 {
        turbulence.long_term_radius_m(self.spot_radius_m(range_m, focus_range_m))
    }

    /// Short-term radius [m] at the end of the path of `turbulence`: the long-term one without the
    /// wander, which [`crate::models::turbulence::Wander`] moves explicitly.
    pub fn short_term_radius_m(
        &self,
        range_m: f64,
        focus_range_m: f64,
        turbulence: &PathTurbulence,
    ) -> f64 {
        let w_m = self.spot_radius_m(range_m, focus_range_m);
        turbulence.short_term_radius_m(w_m, self.aperture_radius_m)
    }

    /// Thermal distortion number N [-] of the beam on its way to `range_m` [m], focused at
    /// `focus_range_m` [m].
    ///
    /// Convention of Gebhardt, Appl. Opt. 15, 1479 (1976), and Proc. SPIE 1221 (1990), steady state
    /// in a crosswind, a = W0/√2 the 1/e radius at the exit:
    /// N = (-n_T) α P L² / (π n0 ρ c_p v0 a³) ·
    ///     (2/L²) ∫_0^L (a/a(z')) ∫_0^z' (a/a(z''))² (v0/v(z'')) e^(-β z'') dz'' dz'.
    /// The beam's radius is that without turbulence, so N is an upper bound in strong turbulence.
    pub fn distortion_number(&self, range_m: f64, focus_range_m: f64, air: &BloomingAir) -> f64 {
        // Midpoint rule, graded towards the focus where the beam is narrow; good to 0.2 %.
        const NODES: usize = 64;
        let w0 = self.aperture_radius_m;
        let (mut inner, mut outer) = (0.0, 0.0);
        for i in 0..NODES {
            let left = 1.0 - (i as f64 + 0.5) / NODES as f64;
            let z = range_m * (1.0 - left * left);
            let dz = range_m * 2.0 * left / NODES as f64;
            let narrowing = w0 / self.spot_radius_m(z, focus_range_m);
            let speed = air.crosswind_mps.abs() + air.slew_radps.abs() * z;
            let heat = narrowing * narrowing / speed * (-air.extinction_per_m * z).exp() * dz;
            outer += narrowing * (inner + 0.5 * heat) * dz;
            inner += heat;
        }
        let a = w0 / SQRT_2;
        // At constant pressure n_T = -(n - 1)/T and (n - 1)/ρ is fixed, so the density cancels:
        // -n_T/ρ = K/T with Gladstone and Dale's K.
        let strength = gladstone_dale_m3pkg(self.wavelength_m) / air.temperature_k
            * air.absorption_per_m
            * self.power_w
            / (PI * CP_AIR * a.powi(3));
        2.0 * strength * outer
    }
}

/// Specific heat of air at constant pressure [J/(kg K)] (Incropera et al., Fundamentals of Heat and
/// Mass Transfer, 7th ed., table A.4, 300 K).
const CP_AIR: f64 = 1007.0;

/// Gladstone–Dale constant (n - 1)/ρ of air [m³/kg]: Edlén's dispersion for standard air (Metrologia
/// 2, 71, 1966) over its density at 15 °C and 101 325 Pa, 1.2250 kg/m³.
fn gladstone_dale_m3pkg(wavelength_m: f64) -> f64 {
    let s2 = (1e-6 / wavelength_m).powi(2); // [1/um^2]
    (8342.13 + 2_406_030.0 / (130.0 - s2) + 15_997.0 / (38.9 - s2)) * 1e-8 / 1.2250
}

/// The air that a high-power beam heats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BloomingAir {
    /// Absorption coefficient [1/m] (the part of the extinction that heats the air).
    pub absorption_per_m: f64,
    /// Whole extinction coefficient [1/m].
    pub extinction_per_m: f64,
    /// Temperature [K].
    pub temperature_k: f64,
    /// Wind across the beam [m/s]. With no wind and no slew the steady state does not exist and the
    /// distortion number is infinite; natural convection then gives some 0.1 m/s.
    pub crosswind_mps: f64,
    /// Slew rate of the beam [rad/s], taken to add to the wind along the path.
    pub slew_radps: f64,
}

/// Peak irradiance left by steady blooming [-], 1/(1 + 0.0625 N²), for the distortion number of
/// [`Laser::distortion_number`] (Gebhardt, Appl. Opt. 15, 1479, 1976; an empirical fit).
pub fn blooming_factor(distortion_number: f64) -> f64 {
    1.0 / (1.0 + 0.0625 * distortion_number * distortion_number)
}

/// Irradiance [W/m²] on the axis of a Gaussian beam of `power_w` [W] and radius `w_m` [m].
pub fn peak_irradiance_wpm2(power_w: f64, w_m: f64) -> f64 {
    2.0 * power_w / (PI * w_m * w_m)
}

/// Irradiance [W/m²] at `offset_m` [m] from the axis of a Gaussian beam.
pub fn irradiance_wpm2(power_w: f64, w_m: f64, offset_m: f64) -> f64 {
    peak_irradiance_wpm2(power_w, w_m) * (-2.0 * (offset_m / w_m).powi(2)).exp()
}

/// Power [W] of a Gaussian beam of radius `w_m` [m] that falls into a circular bucket of
/// `bucket_radius_m` [m] whose centre is `offset_m` [m] from the axis; `power_w` (1 - Q1(2d/w,
/// 2a/w)) with Marcum's Q.
///
/// Seen from the beam axis, the disc is a contour integral of (1 - exp(-2ρ²/w²))/2π over the polar
/// angle: a smooth periodic integrand for which the trapezium rule converges exponentially, with no
/// Bessel function. Absolute error below 1e-13 of the power up to buckets 400 times as wide as the
/// beam.
pub fn power_in_bucket_w(power_w: f64, w_m: f64, offset_m: f64, bucket_radius_m: f64) -> f64 {
    let (a, d) = (bucket_radius_m.max(0.0), offset_m.abs());
    let sigma = 0.5 * w_m;
    // Ten standard deviations outside or inside the rim: 1e-22.
    if d - a >= 10.0 * sigma {
        return 0.0;
    }
    if a - d >= 10.0 * sigma {
        return power_w;
    }
    // The integrand's harmonics die as exp(-n²σ²/2ad); the cap is for a needle at the rim of a
    // bucket 400 times as wide.
    let half_nodes = 16 + ((5.0 * (a * d).sqrt() / sigma) as usize).min(4000);
    let mut sum = 0.0;
    for i in 0..=half_nodes {
        let cosine = (PI * i as f64 / half_nodes as f64).cos();
        let rho2 = (d * d + a * a + 2.0 * a * d * cosine).max(0.0);
        let x = rho2 / (2.0 * sigma * sigma);
        // (1 - e^-x)/rho², finite where the rim passes through the axis.
        let kernel = if x > 0.0 { -(-x).exp_m1() / x } else { 1.0 };
        let weight = if i == 0 || i == half_nodes { 0.5 } else { 1.0 };
        sum += weight * kernel * (a * a + a * d * cosine);
    }
    // Symmetric halves: (1/2π) · 2 · (π/n) · sum.
    power_w * sum / (half_nodes as f64 * 2.0 * sigma * sigma)
}

/// Correlation time of beam wander [s]: the transit of the beam's diameter at the exit by the
/// transverse wind `v_perp_mps` [m/s] (frozen flow); infinite in still air.
pub fn wander_correlation_time_s(aperture_radius_m: f64, v_perp_mps: f64) -> f64 {
    2.0 * aperture_radius_m / v_perp_mps.abs()
}

/// Velocity of the air relative to the beam [m/s], mean over the path: at a share t of the way the
/// beam moves sideways with t times its target's velocity.
pub fn mean_air_over_beam_mps(wind_enu_mps: DVec3, v_target_enu_mps: DVec3) -> DVec3 {
    wind_enu_mps - 0.5 * v_target_enu_mps
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::models::atmosphere::Cn2Profile;
    use crate::models::rng::Stream;
    use crate::models::turbulence::Path;

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
        let path = Path {
            length_m: 1000.0,
            h0_m: 10.0,
            h1_m: 10.0,
        };
        let air = PathTurbulence::new(&Cn2Profile::Constant(1e-14), &path, laser.wavelength_m);
        let long = laser.long_term_radius_m(1000.0, 1000.0, &air);
        close(long, 12.065e-3, 2e-3);
        let short = laser.short_term_radius_m(1000.0, 1000.0, &air);
        let wander = air.wander_axis_rms_rad(laser.aperture_radius_m);
        close(jitter_averaged_radius_m(short, wander, 1000.0), long, 1e-12);
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

    #[test]
    fn air_slides_over_the_whole_of_a_still_beam_and_half_of_a_moving_one() {
        let wind = DVec3::new(4.0, 0.0, 0.0);
        assert_eq!(mean_air_over_beam_mps(wind, DVec3::ZERO), wind);
        // Still air, a crossing target; and a target that drifts with the wind.
        assert_eq!(mean_air_over_beam_mps(DVec3::ZERO, wind), -0.5 * wind);
        assert_eq!(mean_air_over_beam_mps(wind, wind), 0.5 * wind);
        // The mean of what each point of the path meets.
        let v = DVec3::new(1.0, -6.0, 2.0);
        let points = 1_000;
        let mean = (0..points)
            .map(|i| wind - (f64::from(i) + 0.5) / f64::from(points) * v)
            .sum::<DVec3>()
            / f64::from(points);
        assert!((mean - mean_air_over_beam_mps(wind, v)).length() < 1e-12);
    }
}
