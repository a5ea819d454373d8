//! The laser beam: a focused Gaussian through turbulent, absorbing air on to a target.
//!
//! Radii are 1/e² radii of the irradiance (1/e of the field) throughout.

use std::f64::consts::{PI, SQRT_2};

use crate::air::turbulence::PathTurbulence;

/// A laser behind its beam director.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Laser {
    /// Power that leaves the aperture [W].
    pub power_w: f64,
    /// Wavelength [m].
    pub wavelength_m: f64,
    /// Radius W0 at the exit where the irradiance is 1/e² (the field 1/e) of its peak [m]; the
    /// clear aperture is assumed wide enough not to clip.
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

/// Pressure of the air [Pa]: sea level, within 5 % in the lowest 400 m.
pub const PRESSURE_PA: f64 = 101_325.0;

/// Refractivity n - 1 of air of a temperature [1] at sea level.
pub fn refractivity(wavelength_m: f64, temperature_k: f64) -> f64 {
    const R_DRY: f64 = 287.053; // [J/(kg K)], ICAO standard atmosphere
    gladstone_dale_m3pkg(wavelength_m) * PRESSURE_PA / (R_DRY * temperature_k)
}

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

/// Radius of the bucket around the aim point [m]: a fist-sized component.
pub const BUCKET_RADIUS_M: f64 = 0.05; // [m]

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

#[cfg(test)]
mod tests;
