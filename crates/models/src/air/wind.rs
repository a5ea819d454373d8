//! Mean wind over flat rough ground, and gusts.
//!
//! The mean follows the neutral logarithmic law; the gusts are the Dryden model of MIL-F-8785C for
//! low altitude, discretised exactly, so that the statistics do not depend on the tick. A reported
//! gust speed scales them up where they fall short of it.

use crate::air::shared_gusts::{NUMBERS, SharedNoise};
use crate::maths::rng::Stream;
use glam::DVec3;
use std::f64::consts::TAU;
use thiserror::Error;

const FOOT_M: f64 = 0.3048; // [m]
/// Roughness length of open ground: terrain category II of EN 1991-1-4, over which anemometers are
/// taken to stand. Its turbulence there, `U10 / ln(10 m/z0)` = 0.189 U10, is near that of
/// MIL-F-8785C, 0.171 U10 at 10 m.
const OPEN_GROUND_M: f64 = 0.05; // [m]
/// Least wind that carries turbulence past the anemometer, so that gusts reported in a calm still
/// change.
const LEAST_PACE_MPS: f64 = 1.0; // [m/s]

/// Why a wind could not be set up.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum WindError {
    /// The reference speed is negative or not finite.
    #[error("wind speed {0} m/s; give a finite speed of at least 0")]
    Speed(f64),
    /// The direction is not finite.
    #[error("wind direction {0} deg; give a finite direction, clockwise from north")]
    Direction(f64),
    /// The roughness length lies outside the law's use.
    #[error("roughness length {0} m; give a length above 0 and up to 2 m (0.03 grass, 1 city)")]
    Roughness(f64),
    /// The displacement height is negative or not finite.
    #[error("displacement height {0} m; give a finite height of at least 0")]
    Displacement(f64),
}

/// The mean wind: `U(h) = U10 ln((h - d)/z0) / ln(10 m/z0)`, horizontal, one direction.
#[derive(Clone, Debug, PartialEq)]
pub struct MeanWind {
    /// Unit vector the air moves along.
    direction_enu: DVec3,
    /// `U10 / ln(10 m/z0)`, the friction velocity over von Kármán's constant [m/s].
    scale_mps: f64,
    roughness_m: f64,
    displacement_m: f64,
}

impl MeanWind {
    /// A wind of `speed_10m_mps` [m/s] 10 m above the displacement plane (above ground where
    /// `displacement_m` is 0), blowing from `from_deg` [deg, clockwise from north], over a surface
    /// of roughness length `roughness_m` [m] and displacement height `displacement_m` [m].
    pub fn new(
        speed_10m_mps: f64,
        from_deg: f64,
        roughness_m: f64,
        displacement_m: f64,
    ) -> Result<Self, WindError> {
        if !(speed_10m_mps.is_finite() && speed_10m_mps >= 0.0) {
            return Err(WindError::Speed(speed_10m_mps));
        }
        if !from_deg.is_finite() {
            return Err(WindError::Direction(from_deg));
        }
        if !(roughness_m > 0.0 && roughness_m <= 2.0) {
            return Err(WindError::Roughness(roughness_m));
        }
        if !(displacement_m.is_finite() && displacement_m >= 0.0) {
            return Err(WindError::Displacement(displacement_m));
        }
        let (sin, cos) = from_deg.to_radians().sin_cos();
        Ok(Self {
            direction_enu: DVec3::new(-sin, -cos, 0.0),
            scale_mps: speed_10m_mps / (10.0 / roughness_m).ln(), // 10 [m]
            roughness_m,
            displacement_m,
        })
    }

    /// Another wind over the same surface, as [`Self::new`] takes it.
    pub fn changed(&self, speed_10m_mps: f64, from_deg: f64) -> Result<Self, WindError> {
        Self::new(
            speed_10m_mps,
            from_deg,
            self.roughness_m,
            self.displacement_m,
        )
    }

    /// Mean wind velocity [m/s, enu] at `height_agl_m` [m] above ground; constant below 1 m (or two
    /// roughness lengths) above the displacement plane, where the law no longer holds.
    pub fn mean_wind_enu_mps(&self, height_agl_m: f64) -> DVec3 {
        self.direction_enu * self.speed_mps(height_agl_m)
    }

    /// Wind speed 20 ft above open ground of the same friction velocity.
    fn w20_mps(&self) -> f64 {
        self.scale_mps * (20.0 * FOOT_M / OPEN_GROUND_M).ln()
    }

    fn speed_mps(&self, height_agl_m: f64) -> f64 {
        let floor_m = (2.0 * self.roughness_m).max(1.0); // 1 [m]
        let z_m = (height_agl_m - self.displacement_m).max(floor_m);
        self.scale_mps * (z_m / self.roughness_m).ln()
    }
}

/// Mean wind speed and gust speed [m/s] 10 m above the displacement plane of ground of roughness
/// length `roughness_m` [m], of which a report has `speed_mps` and `gust_mps` 10 m above open ground.
///
/// By EN 1991-1-4 (eq. 4.3 to 4.5) friction velocity and turbulence grow with `(z0 / 0.05 m)^0.07`
/// and the mean with `ln(10 m / z0)` times that; what a gust has beyond the mean is turbulence.
pub fn over_rough_ground(
    speed_mps: f64,
    gust_mps: Option<f64>,
    roughness_m: f64,
) -> (f64, Option<f64>) {
    let friction = (roughness_m / OPEN_GROUND_M).powf(0.07);
    let mean_mps = speed_mps * friction * (10.0 / roughness_m).ln() / (10.0 / OPEN_GROUND_M).ln(); // 10 [m]
    let gust_mps = gust_mps.map(|gust_mps| mean_mps + friction * (gust_mps - speed_mps).max(0.0));
    (mean_mps, gust_mps)
}

/// Length scales [m] and standard deviations [m/s] of the low-altitude Dryden model; the lateral
/// component shares the longitudinal ones.
#[derive(Clone, Copy, Debug)]
pub struct DrydenScales {
    /// Length scale along and across the mean wind [m].
    pub l_u_m: f64,
    /// Length scale upright [m].
    pub l_w_m: f64,
    /// Standard deviation along and across the mean wind [m/s].
    pub sigma_u_mps: f64,
    /// Standard deviation upright [m/s].
    pub sigma_w_mps: f64,
}

/// Those of a height above ground [m] and the wind speed 20 ft above open ground [m/s]: MIL-F-8785C, 3.7.3.4; the height
/// is held within the 10 to 1000 ft the formulas cover.
pub fn dryden_scales(height_agl_m: f64, w20_mps: f64) -> DrydenScales {
    let h_ft = (height_agl_m / FOOT_M).clamp(10.0, 1000.0);
    let base = 0.177 + 0.000823 * h_ft;
    let sigma_w_mps = 0.1 * w20_mps;
    DrydenScales {
        l_u_m: h_ft / base.powf(1.2) * FOOT_M,
        l_w_m: h_ft * FOOT_M,
        sigma_u_mps: sigma_w_mps / base.powf(0.4),
        sigma_w_mps,
    }
}

/// Excess of a reported gust speed over the mean, in standard deviations of Dryden turbulence
/// of length scale `l_u_m` [m] that the mean wind `mean_mps` [m/s] carries past the anemometer.
///
/// A gust is the highest mean over 3 s in ten minutes (WMO-No. 8): the expected maximum of the
/// smoothed process by Davenport's peak factor (Proc. Inst. Civ. Eng. 28, 187, 1964), its variance
/// and rate of upcrossings taken from the autocorrelation `exp(-U t / L)`.
fn gust_factor(mean_mps: f64, l_u_m: f64) -> f64 {
    const SMOOTHED_S: f64 = 3.0; // [s]
    const WATCHED_S: f64 = 600.0; // [s]
    const EULER_GAMMA: f64 = 0.577_215_664_901_532_9;
    let x = SMOOTHED_S * mean_mps / l_u_m;
    // 2 (x - 1 + e^-x) / x^2 and 2 (1 - e^-x) / 3 s^2: the variances of the mean and its slope.
    let variance = 2.0 * (x + (-x).exp_m1()) / (x * x);
    let slope_variance = -2.0 * (-x).exp_m1() / (SMOOTHED_S * SMOOTHED_S);
    let upcrossings = WATCHED_S / TAU * (slope_variance / variance).sqrt();
    let peak = (2.0 * upcrossings.ln()).sqrt();
    (peak + EULER_GAMMA / peak) * variance.sqrt()
}

/// Exact one-tick update of the unit-variance transverse filter
/// `(1 + sqrt(3) T s) / (1 + T s)^2`, as two first-order lags in series.
#[derive(Clone, Copy, Debug)]
struct TransverseStep {
    decay: f64,
    /// The tick over the filter's time constant.
    tau: f64,
    l11: f64,
    l21: f64,
    l22: f64,
}

impl TransverseStep {
    fn new(tau: f64) -> Self {
        // In stationary state the covariance of (x1, x2) is [1, 1/2; 1/2, 1/2]; what one tick
        // forgets of it must come back as noise. The entries are incomplete gamma functions, whose
        // series keeps the digits the plain difference loses at a short tick.
        let x = 2.0 * tau;
        let q11 = -(-x).exp_m1();
        let q12 = 0.5 * erlang_cdf(2, x);
        let q22 = 0.5 * erlang_cdf(3, x);
        let l11 = q11.sqrt();
        let l21 = if l11 > 0.0 { q12 / l11 } else { 0.0 };
        Self {
            decay: (-tau).exp(),
            tau,
            l11,
            l21,
            l22: (q22 - l21 * l21).max(0.0).sqrt(),
        }
    }

    /// `n1` and `n2` are standard normal.
    fn advance(&self, x: &mut [f64; 2], n1: f64, n2: f64) {
        let second = self.decay * (x[1] + self.tau * x[0]) + self.l21 * n1 + self.l22 * n2;
        *x = [self.decay * x[0] + self.l11 * n1, second];
    }
}

/// Regularised lower incomplete gamma function P(n, x) of a whole n.
fn erlang_cdf(n: u32, x: f64) -> f64 {
    let mut term = 1.0;
    let mut head = 0.0;
    for k in 0..n {
        head += term;
        term *= x / f64::from(k + 1);
    }
    if x > 1.0 {
        return 1.0 - (-x).exp() * head;
    }
    let mut tail = 0.0;
    for k in n..n + 16 {
        tail += term;
        term *= x / f64::from(k + 1);
    }
    (-x).exp() * tail
}

/// Output of the transverse filter, of unit variance.
fn transverse(x: &[f64; 2]) -> f64 {
    (3.0_f64.sqrt() * x[0] + (1.0 - 3.0_f64.sqrt()) * x[1]) * std::f64::consts::FRAC_1_SQRT_2
}

/// Filter coefficients and what they were computed for.
#[derive(Clone, Copy, Debug)]
struct Coefficients {
    dt_s: f64,
    height_agl_m: f64,
    speed_mps: f64,
    scales: DrydenScales,
    decay_u: f64,
    noise_u: f64,
    v: TransverseStep,
    w: TransverseStep,
}

/// Gusts met by one UAV: the Dryden model of MIL-F-8785C for low altitude, its longitudinal axis
/// along the mean wind.
#[derive(Clone, Debug)]
pub struct DrydenGust {
    mean: MeanWind,
    /// Wind speed 20 ft above open ground of the same friction velocity.
    w20_mps: f64,
    /// Filter states of unit stationary variance: a change of height only rescales them.
    u: f64,
    v: [f64; 2],
    w: [f64; 2],
    coefficients: Option<Coefficients>,
}

impl DrydenGust {
    /// Gusts in the wind `mean`, started in their stationary state. Their strength follows its friction
    /// velocity, as turbulence over any roughness does: over a city a given mean wind brings some
    /// three times the gusts that it brings over grass.
    pub fn new(mean: &MeanWind, rng: &mut Stream) -> Self {
        let mut start = || {
            let x1 = rng.normal();
            [x1, 0.5 * (x1 + rng.normal())]
        };
        Self {
            w20_mps: mean.w20_mps(),
            mean: mean.clone(),
            u: start()[0],
            v: start(),
            w: start(),
            coefficients: None,
        }
    }

    /// The same gusts in another mean wind: what they are in standard deviations goes on, in its strength, along
    /// and across its direction.
    pub fn carried_by(self, mean: &MeanWind) -> Self {
        Self {
            w20_mps: mean.w20_mps(),
            mean: mean.clone(),
            coefficients: None,
            ..self
        }
    }

    /// The same gusts made strong enough for a reported gust speed of `gust_mps` [m/s, 10 m up as
    /// the mean wind's]: its scale W20 grows until the gust is what ten minutes bring on average.
    /// A gust speed that the mean wind's own turbulence reaches changes nothing.
    pub fn reaching(mut self, gust_mps: Option<f64>) -> Self {
        let mean_mps = self.mean.speed_mps(10.0 + self.mean.displacement_m); // 10 [m]
        let unit = dryden_scales(10.0, 1.0); // 10 [m], 1 [m/s]
        if let Some(gust_mps) = gust_mps {
            let factor = gust_factor(mean_mps.max(LEAST_PACE_MPS), unit.l_u_m);
            let sigma_u_mps = (gust_mps - mean_mps) / factor;
            self.w20_mps = self.w20_mps.max(sigma_u_mps / unit.sigma_u_mps);
            self.coefficients = None;
        }
        self
    }

    /// The same gusts, started in the state that `noise` makes neighbours share at `r_enu_m` [m], `height_agl_m` [m] above
    /// ground.
    pub fn started_together(
        mut self,
        r_enu_m: DVec3,
        height_agl_m: f64,
        noise: &SharedNoise,
    ) -> Self {
        let scales = dryden_scales(height_agl_m, self.w20_mps);
        let [u, v1, v2, w1, w2] = noise.normals(r_enu_m, scales.l_u_m, scales.l_w_m);
        self.u = u;
        self.v = [v1, 0.5 * (v1 + v2)];
        self.w = [w1, 0.5 * (w1 + w2)];
        self
    }

    /// Gust velocity [m/s, enu] a tick of `dt_s` [s] later at `height_agl_m` [m] above ground, for a
    /// UAV of airspeed `airspeed_mps` [m/s]. The turbulence is carried past a hovering UAV by the
    /// mean wind, so the faster of the two sets the pace, at least 1 m/s.
    pub fn step(
        &mut self,
        dt_s: f64,
        height_agl_m: f64,
        airspeed_mps: f64,
        rng: &mut Stream,
    ) -> DVec3 {
        self.driven(dt_s, height_agl_m, airspeed_mps, |_| {
            [(); NUMBERS].map(|()| rng.normal())
        })
    }

    /// [`Self::step`] at `r_enu_m` [m], by noise that neighbours share.
    pub fn step_together(
        &mut self,
        dt_s: f64,
        r_enu_m: DVec3,
        height_agl_m: f64,
        airspeed_mps: f64,
        noise: &SharedNoise,
    ) -> DVec3 {
        self.driven(dt_s, height_agl_m, airspeed_mps, |scales| {
            noise.normals(r_enu_m, scales.l_u_m, scales.l_w_m)
        })
    }

    fn driven(
        &mut self,
        dt_s: f64,
        height_agl_m: f64,
        airspeed_mps: f64,
        normals: impl FnOnce(&DrydenScales) -> [f64; NUMBERS],
    ) -> DVec3 {
        if self.w20_mps <= 0.0 {
            return DVec3::ZERO;
        }
        let airspeed_mps = airspeed_mps.max(LEAST_PACE_MPS);
        // The logarithm of the mean profile is only taken where it can matter.
        let near = |a: f64, b: f64| (a - b).abs() <= 0.01 * b.abs();
        let kept = self.coefficients.filter(|c| {
            c.dt_s == dt_s
                && near(height_agl_m, c.height_agl_m)
                && (near(airspeed_mps, c.speed_mps)
                    || airspeed_mps < c.speed_mps
                        && near(self.mean.speed_mps(height_agl_m), c.speed_mps))
        });
        let c = kept.unwrap_or_else(|| self.coefficients_at(dt_s, height_agl_m, airspeed_mps));
        self.coefficients = Some(c);

        let [u, v1, v2, w1, w2] = normals(&c.scales);
        self.u = c.decay_u * self.u + c.noise_u * u;
        c.v.advance(&mut self.v, v1, v2);
        c.w.advance(&mut self.w, w1, w2);
        let along = self.mean.direction_enu;
        let left = DVec3::Z.cross(along);
        c.scales.sigma_u_mps * (self.u * along + transverse(&self.v) * left)
            + c.scales.sigma_w_mps * transverse(&self.w) * DVec3::Z
    }

    fn coefficients_at(&self, dt_s: f64, height_agl_m: f64, airspeed_mps: f64) -> Coefficients {
        let scales = dryden_scales(height_agl_m, self.w20_mps);
        let speed_mps = airspeed_mps.max(self.mean.speed_mps(height_agl_m));
        let tau_u = speed_mps * dt_s / scales.l_u_m;
        Coefficients {
            dt_s,
            height_agl_m,
            speed_mps,
            scales,
            decay_u: (-tau_u).exp(),
            noise_u: (-(-2.0 * tau_u).exp_m1()).sqrt(),
            v: TransverseStep::new(tau_u),
            w: TransverseStep::new(speed_mps * dt_s / scales.l_w_m),
        }
    }
}

#[cfg(test)]
mod tests;
