//! Optical turbulence along a slant path, and the random channels it drives: scintillation and beam
//! wander.
//!
//! "A&P" is Andrews & Phillips, Laser Beam Propagation through Random Media, 2nd ed., SPIE 2005.
//! Kolmogorov spectrum: infinite outer and zero inner scale.

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use glam::DVec2;

use crate::air::atmosphere::Cn2Profile;
use crate::maths::rng::Stream;

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
    /// ∫ Cn² (1 - z/L)^(5/3) dz [m^(1/3)].
    transmitter_weighted_cn2: f64,
}

impl PathTurbulence {
    /// Integrates `profile` along `path` at `wavelength_m` [m].
    pub fn new(profile: &Cn2Profile, path: &AirPath, wavelength_m: f64) -> Self {
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
            transmitter_weighted_cn2: weighted,
        }
    }

    /// Long-term 1/e² intensity radius [m] at the target of a beam whose radius without turbulence
    /// is `w_m` [m]: W sqrt(1 + T), T = 4.35 k^(7/6) L^(5/6) Λ^(5/6) ∫ Cn² (1 - z/L)^(5/3) dz,
    /// Λ = 2L/(k W²) (A&P ch. 12; 1.33 σ_R² Λ^(5/6) if uniform).
    ///
    /// First order in Cn²: against the exact on-axis irradiance it is 0.3 % low at T = 0.2, 7 % at
    /// T = 2 and 25 % at T = 20.
    pub fn long_term_radius_m(&self, w_m: f64) -> f64 {
        let lambda_l = 2.0 * self.length_m * self.length_m / (self.wavenumber_radpm * w_m * w_m);
        let t = 4.35
            * self.wavenumber_radpm.powf(7.0 / 6.0)
            * lambda_l.powf(5.0 / 6.0)
            * self.transmitter_weighted_cn2;
        w_m * (1.0 + t).sqrt()
    }

    /// Root of A&P's beam wander variance <r_c²> [m] at the target for a beam of 1/e² intensity
    /// radius `w0_m` [m] at the transmitter, focused on the target:
    /// (7.25 L² W0^(-1/3) ∫ Cn² (1 - z/L)^(5/3) dz)^(1/2) (A&P ch. 12; 2.72 Cn² L³ W0^(-1/3) if
    /// uniform). A collimated beam has 11 % less variance.
    pub fn wander_rms_m(&self, w0_m: f64) -> f64 {
        2.0 * self.length_m * self.wander_axis_rms_rad(w0_m)
    }

    /// Wander to simulate about each axis [rad, rms].
    ///
    /// Half of [`Self::wander_rms_m`] over the length: A&P split W_LT² = W_ST² + <r_c²> in squared
    /// 1/e² radii, and a Gaussian spot of radius W has the variance W²/4 about each axis. A spot of
    /// the short-term radius that wanders so averages to the long-term radius exactly.
    pub fn wander_axis_rms_rad(&self, w0_m: f64) -> f64 {
        0.5 * (7.25 / w0_m.cbrt() * self.transmitter_weighted_cn2).sqrt()
    }

    /// Short-term 1/e² intensity radius [m]: the long-term one without the wander, for use with an
    /// explicitly simulated wander.
    pub fn short_term_radius_m(&self, w_m: f64, w0_m: f64) -> f64 {
        let long = self.long_term_radius_m(w_m);
        let wander = self.wander_rms_m(w0_m);
        // For M² >= 1 the wander is at most 0.742 of the turbulent spread; the floor only guards a
        // radius below the diffraction limit.
        (long * long - wander * wander).sqrt().max(w_m)
    }

    /// Gamma–gamma parameters of the irradiance averaged over an aperture or spot of diameter
    /// `diameter_m` [m] (0 for a point). The plane-wave value, taken for the focused beam too,
    /// whose wander is simulated apart.
    pub fn gamma_gamma(&self, diameter_m: f64) -> GammaGamma {
        let d2 = self.wavenumber_radpm * diameter_m * diameter_m / (4.0 * self.length_m);
        GammaGamma::new(self.rytov_plane, d2)
    }

    /// Correlation time of scintillation [s], sqrt(λ L) / v⊥ (frozen flow past the Fresnel zone) for
    /// the transverse wind `v_perp_mps` [m/s]; infinite in still air.
    pub fn correlation_time_s(&self, v_perp_mps: f64) -> f64 {
        (TAU / self.wavenumber_radpm * self.length_m).sqrt() / v_perp_mps.abs()
    }
}

/// Shape parameters of the gamma–gamma irradiance distribution of mean one (Al-Habash, Andrews &
/// Phillips, Opt. Eng. 40, 1554, 2001).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GammaGamma {
    /// Large-scale (refractive) shape α [-].
    pub alpha: f64,
    /// Small-scale (diffractive) shape β [-].
    pub beta: f64,
}

impl GammaGamma {
    /// Parameters of a plane wave of Rytov variance `rytov` [-] averaged over an aperture with
    /// `d2` = k D²/(4 L) [-] (A&P ch. 10, zero inner scale; `d2` = 0 is a point).
    pub fn new(rytov: f64, d2: f64) -> Self {
        let s125 = rytov.powf(1.2); // sigma_R^(12/5)
        let large = 0.49 * rytov / (1.0 + 0.65 * d2 + 1.11 * s125).powf(7.0 / 6.0);
        let small = 0.51 * rytov * (1.0 + 0.69 * s125).powf(-5.0 / 6.0)
            / (1.0 + 0.90 * d2 + 0.62 * d2 * s125);
        Self {
            alpha: 1.0 / large.exp_m1(),
            beta: 1.0 / small.exp_m1(),
        }
    }

    /// Scintillation index, the variance of the mean-one irradiance [-].
    #[cfg(test)]
    fn scintillation_index(&self) -> f64 {
        1.0 / self.alpha + 1.0 / self.beta + 1.0 / (self.alpha * self.beta)
    }
}

/// A channel that multiplies the mean irradiance on the target.
pub trait IntensityChannel {
    /// Advances by `dt_s` [s] and returns the relative intensity [-].
    fn step(&mut self, dt_s: f64, rng: &mut Stream) -> f64;
}

/// The paper's eq. 7, dI = -γ I dt + σ I dW: geometric Brownian motion, updated exactly.
///
/// It is **not** of mean one, nor stationary: E[I] = I0 e^(-γ t) and var[ln I] = σ² t grow and decay
/// without bound. Kept to reproduce the paper; [`Scintillation`] is the physical channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperIntensity {
    /// Drift γ [1/s].
    pub gamma_per_s: f64,
    /// Volatility σ [1/sqrt(s)].
    pub sigma_per_sqrt_s: f64,
    /// Present relative intensity I/I0 [-]; starts at 1.
    pub intensity: f64,
}

impl PaperIntensity {
    /// Accepted drift [1/s]. At the upper end the intensity falls by e in a tenth of a second.
    pub const DRIFT_RANGE_PER_S: RangeInclusive<f64> = 0.0..=10.0;
    /// Accepted volatility [1/sqrt(s)]. At the upper end the logarithm's deviation after a minute
    /// is 77, beyond any physical channel and still a finite number.
    pub const VOLATILITY_RANGE_PER_SQRT_S: RangeInclusive<f64> = 0.0..=10.0;

    /// A channel at I = I0 with drift `gamma_per_s` [1/s] and volatility `sigma_per_sqrt_s`
    /// [1/sqrt(s)]; the paper prints neither.
    pub fn new(gamma_per_s: f64, sigma_per_sqrt_s: f64) -> Self {
        Self {
            gamma_per_s,
            sigma_per_sqrt_s,
            intensity: 1.0,
        }
    }
}

impl IntensityChannel for PaperIntensity {
    fn step(&mut self, dt_s: f64, rng: &mut Stream) -> f64 {
        let sigma = self.sigma_per_sqrt_s;
        let drift = (-self.gamma_per_s - 0.5 * sigma * sigma) * dt_s;
        self.intensity *= (drift + sigma * dt_s.sqrt() * rng.normal()).exp();
        self.intensity
    }
}

/// Coefficients (ρ, sqrt(1 - ρ²)) of the exact update of a unit Ornstein–Uhlenbeck process over
/// `dt_s`; a correlation time of zero gives white noise.
fn ou_coefficients(dt_s: f64, correlation_time_s: f64) -> (f64, f64) {
    if dt_s <= 0.0 {
        return (1.0, 0.0);
    }
    let x = dt_s / correlation_time_s;
    ((-x).exp(), (-(-2.0 * x).exp_m1()).sqrt())
}

/// Stationary gamma–gamma scintillation of mean one.
///
/// The product of two gamma variates, each a monotone map of a unit Ornstein–Uhlenbeck Gaussian, so
/// that the marginal distribution is gamma–gamma at any step and the Gaussians have the
/// autocorrelation exp(-|t|/τ). Both scales share one correlation time: right for weak turbulence,
/// where the Fresnel zone rules; in strong turbulence the large scales are slower in truth.
#[derive(Clone, Debug)]
pub struct Scintillation {
    correlation_time_s: f64,
    large: GammaMap,
    small: GammaMap,
    x_large: f64,
    x_small: f64,
}

impl Scintillation {
    /// A channel in its stationary state with `parameters` and `correlation_time_s` [s].
    pub fn new(parameters: GammaGamma, correlation_time_s: f64, rng: &mut Stream) -> Self {
        Self {
            correlation_time_s,
            large: GammaMap::new(parameters.alpha),
            small: GammaMap::new(parameters.beta),
            x_large: rng.normal(),
            x_small: rng.normal(),
        }
    }

    /// Changes the strength and the correlation time [s] without a jump of the underlying
    /// Gaussians (under 0.1 ms, no allocation: at a frame's rate rather than every tick).
    pub fn retune(&mut self, parameters: GammaGamma, correlation_time_s: f64) {
        self.correlation_time_s = correlation_time_s;
        self.large.fill(parameters.alpha);
        self.small.fill(parameters.beta);
    }
}

impl IntensityChannel for Scintillation {
    fn step(&mut self, dt_s: f64, rng: &mut Stream) -> f64 {
        let (keep, kick) = ou_coefficients(dt_s, self.correlation_time_s);
        self.x_large = keep * self.x_large + kick * rng.normal();
        self.x_small = keep * self.x_small + kick * rng.normal();
        (self.large.ln_gamma_variate(self.x_large) + self.small.ln_gamma_variate(self.x_small))
            .exp()
    }
}

/// Half-width of the table in standard deviations; one draw in 5e8 lies beyond and is clamped.
const MAP_SIGMAS: f64 = 6.0;
/// Intervals of the table on each side of the median.
const MAP_SIDE: usize = 128;
const MAP_STEP: f64 = MAP_SIGMAS / MAP_SIDE as f64;
/// Intervals of the quadrature of the gamma density.
const MAP_CELLS: usize = 1024;
/// Standard normal probability below -6 (Abramowitz & Stegun table 26.2).
const MAP_TAIL: f64 = 9.865_876_450e-10;

/// Table of ln of the gamma quantile, of mean one, against a standard normal.
#[derive(Clone, Debug)]
struct GammaMap(Box<[f64; 2 * MAP_SIDE + 1]>);

impl GammaMap {
    fn new(shape: f64) -> Self {
        let mut map = Self(Box::new([0.0; 2 * MAP_SIDE + 1]));
        map.fill(shape);
        map
    }

    /// Matches the tail probabilities of the gamma and the normal law from both ends, so that
    /// neither tail suffers from cancellation.
    fn fill(&mut self, shape: f64) {
        // Without turbulence the shape is infinite and the variate is one.
        if !(shape > 0.0 && shape < 1e12) {
            self.0.fill(0.0);
            return;
        }
        // ln g has the density exp(a (y - e^y + 1)), up to a constant; these limits hold more than
        // six standard deviations for any shape.
        let low = -(21.0 / shape + 7.0 / shape.sqrt());
        let high = (7.0 / shape.sqrt() + 25.0 / shape).ln_1p();
        let dy = (high - low) / MAP_CELLS as f64;
        let mut density = [DensityNode::default(); MAP_CELLS + 1];
        for (i, node) in density.iter_mut().enumerate() {
            let y = low + dy * i as f64;
            // e^y - 1 keeps the difference y - e^y + 1 exact near zero.
            let excess = y.exp_m1();
            let value = (shape * (y - excess)).exp();
            *node = DensityNode {
                y,
                value,
                slope: -shape * excess * value,
            };
        }
        let total = density.iter().map(|node| node.value).sum::<f64>() * dy;
        let (low_half, high_half) = self.0.split_at_mut(MAP_SIDE);
        match_tail(density.iter(), low_half.iter_mut(), dy, total);
        match_tail(density.iter().rev(), high_half.iter_mut().rev(), dy, total);
    }

    /// ln of the gamma variate that belongs to the standard normal `x`.
    fn ln_gamma_variate(&self, x: f64) -> f64 {
        let position = ((x + MAP_SIGMAS) / MAP_STEP).clamp(0.0, 2.0 * MAP_SIDE as f64);
        let i = (position as usize).min(2 * MAP_SIDE - 1);
        let fraction = position - i as f64;
        self.0[i] + fraction * (self.0[i + 1] - self.0[i])
    }
}

/// The density of the logarithm of a gamma variate at `y`, not normalised, with its derivative.
#[derive(Clone, Copy, Default)]
struct DensityNode {
    y: f64,
    value: f64,
    slope: f64,
}

/// Fills `table`, which starts six standard deviations out, with the points where the tail of the
/// density of integral `total`, walked inwards on nodes `dy` apart, equals the normal tail.
fn match_tail<'a>(
    density: impl Iterator<Item = &'a DensityNode>,
    table: impl Iterator<Item = &'a mut f64>,
    dy: f64,
    total: f64,
) {
    // Trapezium with the end correction of Euler and Maclaurin; slopes are taken inwards.
    let strip = |h: f64, f0: f64, f1: f64, slope0: f64, slope1: f64| {
        0.5 * h * (f0 + f1) + h * h / 12.0 * (slope0 - slope1)
    };
    let phi = |x: f64| (-0.5 * x * x).exp() / TAU.sqrt();
    let mut nodes = density.peekable();
    let Some(mut node) = nodes.next() else {
        return;
    };
    // What lies beyond the end, from the density's exponential decay there.
    let mut tail = node.value * node.value / node.slope.abs() / total;
    let mut normal_tail = MAP_TAIL;
    for (j, entry) in table.enumerate() {
        let x = MAP_SIGMAS - MAP_STEP * j as f64; // distance from the median
        if j > 0 {
            let outer = x + MAP_STEP;
            let (f0, f1) = (phi(outer), phi(x));
            normal_tail += strip(MAP_STEP, f0, f1, outer * f0, x * f1);
        }
        *entry = node.y;
        while let Some(&inner) = nodes.peek() {
            let sign = (inner.y - node.y).signum();
            let area = strip(
                dy,
                node.value,
                inner.value,
                sign * node.slope,
                sign * inner.slope,
            );
            let next = tail + area / total;
            if next >= normal_tail {
                let fraction = (normal_tail / tail).ln() / (next / tail).ln();
                *entry = node.y + fraction * (inner.y - node.y);
                break;
            }
            tail = next;
            node = inner;
            nodes.next();
        }
    }
}

/// Two-axis Gaussian beam wander with exponential autocorrelation, updated exactly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wander {
    /// Deviation about each axis [rad, rms].
    pub axis_rms_rad: f64,
    /// Correlation time [s]; of the order of the beam diameter over the transverse wind.
    pub correlation_time_s: f64,
    unit: DVec2,
}

impl Wander {
    /// A wander in its stationary state.
    pub fn new(axis_rms_rad: f64, correlation_time_s: f64, rng: &mut Stream) -> Self {
        Self {
            axis_rms_rad,
            correlation_time_s,
            unit: DVec2::new(rng.normal(), rng.normal()),
        }
    }

    /// Advances by `dt_s` [s] and returns the angular offset of the beam about its two transverse
    /// axes [rad].
    pub fn step(&mut self, dt_s: f64, rng: &mut Stream) -> DVec2 {
        let (keep, kick) = ou_coefficients(dt_s, self.correlation_time_s);
        self.unit = keep * self.unit + kick * DVec2::new(rng.normal(), rng.normal());
        self.axis_rms_rad * self.unit
    }
}

#[cfg(test)]
mod tests;
