//! Angle-only interacting-multiple-model filter of a target's line of sight in inertial azimuth and
//! elevation.
//!
//! Each axis carries angle, rate and acceleration under Singer's model (R. A. Singer, 1970): the
//! acceleration is a first-order Gauss–Markov process of rms a and correlation time τ. Three such
//! models, for straight flight, manoeuvre and hard manoeuvre, differ in a; they run side by side on each
//! axis and are weighted by how well they predict the measurements (H. A. P. Blom, Y. Bar-Shalom,
//! "The interacting multiple model algorithm for systems with Markovian switching coefficients",
//! 1988; Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and
//! Navigation*, 2001, §11.6). Each axis has its own mode: a target that weaves sideways stays smooth
//! in elevation.
//!
//! Modes switch as a continuous-time Markov chain: at the rate λ a new mode is drawn from the
//! shares π. Then exp(Q Δt) = κI + (1 − κ)1πᵀ with κ = e^(−λΔt), for any number of modes and any frame
//! rate, and each mode starts a step from a mixture of its own estimate and the combined one.
//! The mean time in mode j is 1/(λ(1 − π_j)). All modes share τ and so the transition matrix, which
//! makes the extrapolated mean and covariance of the mixture exact.
//!
//! Accelerations are stated in m/s² and seen at a range R ([`LosFilter::set_range_m`]); the azimuth
//! axis sees angles divided by cos(el). The axes are otherwise independent, which leaves out the
//! kinematic coupling (of order ȧ·ė·tan el); it grows towards the zenith, where azimuth angles lose
//! their meaning, and cos(el) is floored at 0.05.
//!
//! Latency: the filter stays at the exposure time of the newest measurement and is extrapolated on
//! reading ([`LosFilter::predicted`]). A measurement older than that (two cameras of different
//! latency) is put in its place and the later ones are replayed, so the result is the same as if
//! they had come in order, as far back as the last eight accepted measurements.

use glam::{DVec2, DVec3};
use nalgebra::Matrix3;
use thiserror::Error;

use crate::maths::first_order::lag_integrals;
use crate::maths::kinematics::{az_el_to_los, wrap_pi};

/// Accepted measurements kept for replay.
const HISTORY: usize = 8;
/// Modes of motion: straight flight, manoeuvre, hard manoeuvre.
pub const MODES: usize = 3;
/// Longest step of extrapolation within which the mode does not switch [s].
const STEP_S: f64 = 0.1;
/// Most steps of an extrapolation; beyond that the steps become longer.
const MAX_STEPS: f64 = 100.0;
/// Normalised innovation squared up to which a measurement counts as it is stated: 98.9 % of two Gaussian
/// degrees of freedom. Beyond, its deviation is taken to be larger in proportion, so that its pull grows
/// no further (P. J. Huber, "Robust estimation of a location parameter", 1964).
const HUBER_NIS: f64 = 9.0;
/// Number of measurements in a row outside the gate, but near each other, from which on they are
/// accepted.
const REACQUIRE_AFTER: u32 = 3;

/// A filter parameter out of its range.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("line-of-sight filter parameter {name} = {value} is not positive; give a value above 0")]
pub struct LosFilterError {
    /// Field name.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
}

/// One mode of a target's motion on one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionMode {
    /// Rms acceleration across the line of sight [m/s²].
    pub accel_mps2: f64,
    /// Share of the time that targets spend in this mode, π (relative to the other modes').
    pub share: f64,
}

/// Parameters of a line-of-sight filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LosFilterParams {
    /// Straight flight, manoeuvre, hard manoeuvre.
    pub modes: [MotionMode; MODES],
    /// Correlation time of the acceleration, τ [s].
    pub accel_tau_s: f64,
    /// Mean time between draws of a new mode, 1/λ [s].
    pub switch_s: f64,
    /// Range that is assumed until one is known [m].
    pub range_m: f64,
    /// Standard deviation of the unknown initial rate on the sky [rad/s].
    pub initial_rate_sigma_radps: f64,
    /// Gate on the normalised innovation squared (χ² of two degrees of freedom).
    pub gate_nis: f64,
    /// Memory of the track quality [s].
    pub quality_tau_s: f64,
}

impl Default for LosFilterParams {
    /// For a small multirotor near 1 km at up to 20 m/s: straight flight in gusts, manoeuvres of some
    /// 2 m/s² held for some seconds, now and then a hard one. The gate is at 5σ.
    fn default() -> Self {
        Self {
            modes: [(0.07, 0.6), (2.0, 0.37), (20.0, 0.03)] // [m/s²], share
                .map(|(accel_mps2, share)| MotionMode { accel_mps2, share }),
            accel_tau_s: 3.0,               // [s]
            switch_s: 4.0,                  // [s]
            range_m: 1_000.0,               // [m]
            initial_rate_sigma_radps: 0.02, // [rad/s]
            gate_nis: 25.0,
            quality_tau_s: 0.5, // [s]
        }
    }
}

/// A line of sight at one time, with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LosState {
    /// Time [s].
    pub t_s: f64,
    /// Azimuth [rad], in (−π, π], clockwise from north.
    pub az_rad: f64,
    /// Elevation [rad].
    pub el_rad: f64,
    /// Azimuth rate [rad/s].
    pub az_rate_radps: f64,
    /// Elevation rate [rad/s].
    pub el_rate_radps: f64,
    /// Azimuth acceleration [rad/s²].
    pub az_accel_radps2: f64,
    /// Elevation acceleration [rad/s²].
    pub el_accel_radps2: f64,
    /// Covariances of (angle, rate, acceleration) of azimuth and of elevation.
    pub covariance: [Matrix3<f64>; 2],
}

impl LosState {
    /// A line of sight that stands still, known exactly.
    #[cfg(test)]
    pub fn still(az_el_rad: DVec2) -> Self {
        Self {
            t_s: 0.0,
            az_rad: az_el_rad.x,
            el_rad: az_el_rad.y,
            az_rate_radps: 0.0,
            el_rate_radps: 0.0,
            az_accel_radps2: 0.0,
            el_accel_radps2: 0.0,
            covariance: [Matrix3::zeros(); 2],
        }
    }

    /// Azimuth (x) and elevation (y) [rad].
    pub fn az_el_rad(&self) -> DVec2 {
        DVec2::new(self.az_rad, self.el_rad)
    }

    /// Unit direction in `enu` and its time derivative [1/s].
    pub fn direction_enu(&self) -> (DVec3, DVec3) {
        let (sin_az, cos_az) = self.az_rad.sin_cos();
        let (sin_el, cos_el) = self.el_rad.sin_cos();
        let right = DVec3::new(cos_az, -sin_az, 0.0);
        let up = DVec3::new(-sin_az * sin_el, -cos_az * sin_el, cos_el);
        (
            az_el_to_los(self.az_el_rad()),
            self.az_rate_radps * cos_el * right + self.el_rate_radps * up,
        )
    }

    /// Standard deviations on the sky [rad]: cross-elevation (x) and elevation (y).
    pub fn sigma_rad(&self) -> DVec2 {
        DVec2::new(
            self.covariance[0][(0, 0)].sqrt() * self.el_rad.cos(),
            self.covariance[1][(0, 0)].sqrt(),
        )
    }
}

/// How the filter treated a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gating {
    /// Used; with its normalised innovation squared.
    Accepted { nis: f64 },
    /// Outside the gate, not used; with its normalised innovation squared.
    Rejected { nis: f64 },
    /// Older than the replay memory, not used.
    TooOld,
}

/// Estimate of one axis: (angle, rate, acceleration) and the upper triangle of its covariance, row
/// by row. The angle is not wrapped.
#[derive(Clone, Copy, Debug, PartialEq)]
struct AxisFilter {
    x: [f64; 3],
    p: [f64; 6],
}

/// Row and column of the entries of an upper triangle.
const UPPER: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

impl AxisFilter {
    const ZERO: Self = Self {
        x: [0.0; 3],
        p: [0.0; 6],
    };

    /// Mean and covariance of a mixture of estimates.
    fn mixture<const N: usize>(weights: [f64; N], parts: [&Self; N]) -> Self {
        let mut sum = Self::ZERO;
        for (weight, part) in weights.iter().zip(parts) {
            for (mean, x) in sum.x.iter_mut().zip(part.x) {
                *mean += weight * x;
            }
        }
        for (weight, part) in weights.iter().zip(parts) {
            let d: [f64; 3] = std::array::from_fn(|i| part.x[i] - sum.x[i]);
            for ((total, p), (i, j)) in sum.p.iter_mut().zip(part.p).zip(UPPER) {
                *total += weight * (p + d[i] * d[j]);
            }
        }
        sum
    }

    fn covariance(&self) -> Matrix3<f64> {
        let [xx, xv, xa, vv, va, aa] = self.p;
        Matrix3::new(xx, xv, xa, xv, vv, va, xa, va, aa)
    }
}

/// The estimates of one axis in all modes, and the modes' probabilities.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Belief {
    probability: [f64; MODES],
    modes: [AxisFilter; MODES],
}

/// A measurement of the line of sight.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sight {
    t_s: f64,
    az_el_rad: DVec2,
    sigma_rad: f64,
}

/// The filter after one accepted measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Entry {
    axes: [Belief; 2],
    sight: Sight,
}

/// Angle-only interacting-multiple-model filter of one target's line of sight.
#[derive(Clone, Debug, PartialEq)]
pub struct LosFilter {
    params: LosFilterParams,
    /// Accepted measurements, oldest first, in exposure order; `len` of them.
    history: [Entry; HISTORY],
    len: usize,
    /// Time of the newest measurement that passed the gate [s], the newest one that did not since
    /// then, and how many in a row did not and fit each other.
    gated_t_s: f64,
    refused: Option<Sight>,
    refusals: u32,
    quality: f64,
    scored_t_s: f64,
}

/// 1/cos(el) of the azimuth axis, then 1 of the elevation axis.
fn axis_scales(el_rad: f64) -> [f64; 2] {
    [1.0 / el_rad.cos().max(0.05), 1.0]
}

/// Singer's model over a step: the last two columns of the transition matrix that are not 0 or 1,
/// and the upper triangle of the process noise for unit rms acceleration.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Singer {
    dt_s: f64,
    angle_per_accel: f64,
    rate_per_accel: f64,
    decay: f64,
    noise: [f64; 6],
}

/// Powers of x = Δt/τ that the six noise terms begin with, and terms of their series.
const NOISE_ORDER: [u32; 6] = [5, 4, 3, 3, 2, 1];
const NOISE_TERMS: usize = 9;

/// Coefficients of the noise's power series: entry k of row i multiplies x^(order_i + k).
const NOISE_SERIES: [[f64; NOISE_TERMS]; 6] = {
    let mut series = [[0.0; NOISE_TERMS]; 6];
    let mut i = 0;
    while i < 6 {
        let mut term = 0;
        while term < NOISE_TERMS {
            let k = NOISE_ORDER[i] + term as u32;
            let (mut factorial, mut n) = (1.0, 2);
            while n <= k {
                factorial *= n as f64;
                n += 1;
            }
            let (k_, two) = (k as f64, (1u64 << k) as f64);
            // The k-th derivatives at zero of the closed forms in `singer`, but for (−1)^k.
            let derivative = [
                4.0 * k_ - two,
                two - 2.0 - 2.0 * k_,
                2.0 * k_ - two,
                4.0 - two,
                two - 2.0,
                -two,
            ][i];
            let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            series[i][term] = sign * derivative / factorial;
            term += 1;
        }
        i += 1;
    }
    series
};

/// Singer's model over `dt_s` for a correlation time of `tau_s`.
fn singer(tau_s: f64, dt_s: f64) -> Singer {
    let x = dt_s / tau_s;
    let [e, phi, psi] = lag_integrals(x);
    // Q = (2/τ) ∫₀^dt g gᵀ du, with g(u) the last column of the transition over u.
    let x2 = x * x;
    let noise = if x < 0.15 {
        // The closed forms cancel to nothing here; the series is exact to 1e-12.
        let leading = [x2 * x2 * x, x2 * x2, x2 * x, x2 * x, x2, x];
        std::array::from_fn(|i| {
            leading[i] * NOISE_SERIES[i].iter().rev().fold(0.0, |sum, c| sum * x + c)
        })
    } else {
        let e2 = e * e;
        [
            1.0 - e2 + 2.0 * x + 2.0 / 3.0 * x2 * x - 2.0 * x2 - 4.0 * x * e,
            e2 + 1.0 - 2.0 * e + 2.0 * x * e - 2.0 * x + x2,
            1.0 - e2 - 2.0 * x * e,
            4.0 * e - 3.0 - e2 + 2.0 * x,
            e2 + 1.0 - 2.0 * e,
            1.0 - e2,
        ]
    };
    let t2 = tau_s * tau_s;
    let units = [t2 * t2, t2 * tau_s, t2, t2, tau_s, 1.0];
    Singer {
        dt_s,
        angle_per_accel: dt_s * dt_s * psi,
        rate_per_accel: dt_s * phi,
        decay: e,
        noise: std::array::from_fn(|i| noise[i] * units[i]),
    }
}

impl Singer {
    /// Φx and ΦPΦᵀ + σ²Q of an axis, for an acceleration of variance σ² [rad²/s⁴].
    fn advance(&self, axis: &AxisFilter, variance_rad2ps4: f64) -> AxisFilter {
        let Self {
            dt_s: a,
            angle_per_accel: b,
            rate_per_accel: c,
            decay: e,
            noise,
        } = *self;
        let [angle, rate, accel] = axis.x;
        let [p00, p01, p02, p11, p12, p22] = axis.p;
        // ΦP, upper triangle.
        let g00 = p00 + a * p01 + b * p02;
        let g01 = p01 + a * p11 + b * p12;
        let g02 = p02 + a * p12 + b * p22;
        let g11 = p11 + c * p12;
        let g12 = p12 + c * p22;
        let moved = [
            g00 + a * g01 + b * g02,
            g01 + c * g02,
            e * g02,
            g11 + c * g12,
            e * g12,
            e * e * p22,
        ];
        AxisFilter {
            x: [angle + a * rate + b * accel, rate + c * accel, e * accel],
            p: std::array::from_fn(|i| moved[i] + variance_rad2ps4 * noise[i]),
        }
    }
}

impl LosFilterParams {
    /// Checks every field.
    pub fn validate(&self) -> Result<(), LosFilterError> {
        let modes = self
            .modes
            .iter()
            .flat_map(|mode| [("accel_mps2", mode.accel_mps2), ("share", mode.share)]);
        let others = [
            ("accel_tau_s", self.accel_tau_s),
            ("switch_s", self.switch_s),
            ("range_m", self.range_m),
            ("initial_rate_sigma_radps", self.initial_rate_sigma_radps),
            ("gate_nis", self.gate_nis),
            ("quality_tau_s", self.quality_tau_s),
        ];
        for (name, value) in modes.chain(others) {
            if !(value > 0.0 && value.is_finite()) {
                return Err(LosFilterError { name, value });
            }
        }
        Ok(())
    }

    /// The modes' shares π, which sum to 1.
    fn shares(&self) -> [f64; MODES] {
        let total: f64 = self.modes.iter().map(|mode| mode.share).sum();
        self.modes.map(|mode| mode.share / total)
    }

    /// Acceleration variances of the modes on the sky [rad²/s⁴].
    fn accel_variances(&self) -> [f64; MODES] {
        self.modes
            .map(|mode| (mode.accel_mps2 / self.range_m).powi(2))
    }

    /// Steps of equal length that extrapolate over `dt_s` ≥ 0: their number, the probability κ to
    /// stay in a mode, Singer's model.
    fn steps(&self, dt_s: f64) -> (usize, f64, Singer) {
        let steps = (dt_s / STEP_S).ceil().clamp(1.0, MAX_STEPS);
        let step_s = dt_s / steps;
        (
            steps as usize,
            (-step_s / self.switch_s).exp(),
            singer(self.accel_tau_s, step_s),
        )
    }

    /// The estimates of both axes in all modes `dt_s` ≥ 0 later.
    fn advance(&self, axes: &[Belief; 2], dt_s: f64) -> [Belief; 2] {
        let (steps, kept, model) = self.steps(dt_s);
        let (shares, variances) = (self.shares(), self.accel_variances());
        let mut axes = *axes;
        for _ in 0..steps {
            let combined = axes.each_ref().map(Belief::combined);
            let scales = axis_scales(combined[1].x[0]);
            for ((axis, combined), scale) in axes.iter_mut().zip(&combined).zip(scales) {
                for j in 0..MODES {
                    let stays = kept * axis.probability[j];
                    let probability = stays + (1.0 - kept) * shares[j];
                    // Interaction: a target in mode j either stayed in it or has just drawn it.
                    let own = stays / probability.max(f64::MIN_POSITIVE);
                    let mixed = AxisFilter::mixture([own, 1.0 - own], [&axis.modes[j], combined]);
                    axis.probability[j] = probability;
                    axis.modes[j] = model.advance(&mixed, variances[j] * scale * scale);
                }
            }
        }
        axes
    }

    /// The combined estimates of both axes `dt_s` ≥ 0 later. The same as combining the advanced
    /// modes: as they share Φ, mixing them leaves the mixture's mean and covariance as they are.
    fn extrapolate(&self, axes: &[Belief; 2], dt_s: f64) -> [AxisFilter; 2] {
        let (steps, kept, model) = self.steps(dt_s);
        let (shares, variances) = (self.shares(), self.accel_variances());
        let mean = |weights: &[f64; MODES]| -> f64 {
            weights.iter().zip(variances).map(|(w, v)| w * v).sum()
        };
        let drawn = mean(&shares);
        let mut variance = axes.each_ref().map(|axis| mean(&axis.probability));
        let mut combined = axes.each_ref().map(Belief::combined);
        for _ in 0..steps {
            let scales = axis_scales(combined[1].x[0]);
            for ((axis, variance), scale) in combined.iter_mut().zip(&mut variance).zip(scales) {
                *variance = kept * *variance + (1.0 - kept) * drawn;
                *axis = model.advance(axis, *variance * scale * scale);
            }
        }
        combined
    }

    /// Updates both axes with a sight; `combined` is their combined estimate before it. One within the gate
    /// but beyond [`HUBER_NIS`] pulls no more than one at that distance; one beyond the gate that is
    /// accepted all the same shows that the estimate is wrong, and counts in full.
    fn correct(&self, axes: &mut [Belief; 2], combined: &[AxisFilter; 2], sight: &Sight) {
        let scales = axis_scales(combined[1].x[0]);
        let nis = normalised_innovation(combined, sight, 0.0);
        let doubt = if nis <= self.gate_nis {
            (nis / HUBER_NIS).sqrt().max(1.0)
        } else {
            1.0
        };
        for (i, axis) in axes.iter_mut().enumerate() {
            let noise_rad = doubt * sight.sigma_rad * scales[i];
            axis.correct(|x| innovation(i, sight, x), noise_rad);
        }
    }

    /// An estimate from one measurement alone.
    fn begin(&self, sight: &Sight) -> [Belief; 2] {
        let scales = axis_scales(sight.az_el_rad.y);
        let rate = self.initial_rate_sigma_radps.powi(2);
        std::array::from_fn(|i| Belief {
            probability: self.shares(),
            modes: self.accel_variances().map(|accel| {
                let [angle, rate, accel] =
                    [sight.sigma_rad.powi(2), rate, accel].map(|v| v * scales[i] * scales[i]);
                AxisFilter {
                    x: [sight.az_el_rad[i], 0.0, 0.0],
                    p: [angle, 0.0, 0.0, rate, 0.0, accel],
                }
            }),
        })
    }
}

/// Difference of a measured angle from an estimated one [rad].
fn innovation(axis: usize, sight: &Sight, angle_rad: f64) -> f64 {
    if axis == 0 {
        wrap_pi(sight.az_el_rad.x - angle_rad)
    } else {
        sight.az_el_rad.y - angle_rad
    }
}

/// Normalised innovation squared of a sight against combined estimates that may have strayed by
/// another `reach_rad` on the sky.
fn normalised_innovation(axes: &[AxisFilter; 2], sight: &Sight, reach_rad: f64) -> f64 {
    let scales = axis_scales(axes[1].x[0]);
    (0..2)
        .map(|i| {
            let nu = innovation(i, sight, axes[i].x[0]);
            let noise = sight.sigma_rad.hypot(reach_rad) * scales[i];
            nu * nu / (axes[i].p[0] + noise * noise)
        })
        .sum()
}

impl Belief {
    /// Mean and covariance over the modes.
    fn combined(&self) -> AxisFilter {
        AxisFilter::mixture(self.probability, self.modes.each_ref())
    }

    /// Updates every mode with a measured angle, given what it differs from an estimated one by and
    /// its deviation [rad], and the modes' probabilities with its likelihood in each.
    fn correct(&mut self, innovation: impl Fn(f64) -> f64, noise_rad: f64) {
        let (mut nis, mut weight) = ([0.0; MODES], self.probability);
        for (j, AxisFilter { x, p }) in self.modes.iter_mut().enumerate() {
            let nu = innovation(x[0]);
            let s = p[0] + noise_rad * noise_rad;
            nis[j] = nu * nu / s;
            // The floor keeps a mode alive through sights of one time, between which none is drawn.
            weight[j] = weight[j].max(1e-9) / s.sqrt();
            let column = [p[0], p[1], p[2]];
            let gain = column.map(|c| c / s);
            for (x, k) in x.iter_mut().zip(gain) {
                *x += k * nu;
            }
            // H picks the angle, so (I − KH)P is this rank-one step, symmetric by construction.
            for (p, (i, j)) in p.iter_mut().zip(UPPER) {
                *p -= gain[i] * column[j];
            }
        }
        let least = nis.iter().copied().fold(f64::INFINITY, f64::min);
        for (weight, nis) in weight.iter_mut().zip(nis) {
            *weight *= (0.5 * (least - nis)).exp();
        }
        let total: f64 = weight.iter().sum();
        self.probability = weight.map(|w| w / total);
    }
}

impl LosFilter {
    /// Starts a track on one measurement (azimuth x, elevation y [rad], of standard deviation
    /// `sigma_rad` on the sky) exposed at `t_s`.
    pub fn start(
        params: LosFilterParams,
        az_el_rad: DVec2,
        sigma_rad: f64,
        t_s: f64,
    ) -> Result<Self, LosFilterError> {
        params.validate()?;
        if !(sigma_rad > 0.0 && sigma_rad.is_finite()) {
            return Err(LosFilterError {
                name: "sigma_rad",
                value: sigma_rad,
            });
        }
        let sight = Sight {
            t_s,
            az_el_rad,
            sigma_rad,
        };
        let entry = Entry {
            axes: params.begin(&sight),
            sight,
        };
        Ok(Self {
            params,
            history: [entry; HISTORY],
            len: 1,
            gated_t_s: t_s,
            refused: None,
            refusals: 0,
            quality: 1.0,
            scored_t_s: t_s,
        })
    }

    /// Sees the modes' accelerations at this range [m] from now on; a range that is not positive
    /// and finite is ignored.
    pub fn set_range_m(&mut self, range_m: f64) {
        if range_m > 0.0 && range_m.is_finite() {
            self.params.range_m = range_m;
        }
    }

    /// Probabilities of straight flight, manoeuvre and hard manoeuvre at the newest exposure, of azimuth
    /// and of elevation.
    #[cfg(test)]
    pub(crate) fn mode_probabilities(&self) -> [[f64; MODES]; 2] {
        self.newest().axes.map(|axis| axis.probability)
    }

    fn newest(&self) -> &Entry {
        &self.history[self.len - 1]
    }

    /// Time of the newest accepted exposure [s].
    pub fn t_s(&self) -> f64 {
        self.newest().sight.t_s
    }

    /// Time since the newest accepted exposure [s].
    pub fn coast_s(&self, t_s: f64) -> f64 {
        t_s - self.t_s()
    }

    /// Share of recent frames whose measurement was accepted, with exponential memory, in [0, 1].
    pub fn quality(&self) -> f64 {
        self.quality
    }

    /// The line of sight extrapolated to `t_s` from the newest exposure before it (a time before
    /// the oldest one kept gives that one's estimate): mean of the modes, and covariance with their
    /// spread.
    pub fn predicted(&self, t_s: f64) -> LosState {
        let known = &self.history[..self.len];
        let later = known.partition_point(|entry| entry.sight.t_s <= t_s);
        let from = &known[later.saturating_sub(1)];
        let dt_s = (t_s - from.sight.t_s).max(0.0);
        let [az, el] = self.params.extrapolate(&from.axes, dt_s);
        LosState {
            t_s: from.sight.t_s + dt_s,
            az_rad: wrap_pi(az.x[0]),
            el_rad: el.x[0],
            az_rate_radps: az.x[1],
            el_rate_radps: el.x[1],
            az_accel_radps2: az.x[2],
            el_accel_radps2: el.x[2],
            covariance: [az.covariance(), el.covariance()],
        }
    }

    /// Offers the measurement of the exposure at `t_exposure_s` (azimuth x, elevation y [rad], of
    /// standard deviation `sigma_rad` on the sky), and scores the frame.
    ///
    /// A measurement passes the gate on its normalised innovation against the modes' mixture. When
    /// three in a row do not, but follow each other and the last one that did at a rate that a target
    /// may have (`initial_rate_sigma_radps`), the model is taken to be wrong: from the third on they are
    /// accepted, until one passes the gate again.
    pub fn update(&mut self, az_el_rad: DVec2, sigma_rad: f64, t_exposure_s: f64) -> Gating {
        let sight = Sight {
            t_s: t_exposure_s,
            az_el_rad,
            sigma_rad,
        };
        let at = self.history[..self.len].partition_point(|e| e.sight.t_s <= t_exposure_s);
        if at == 0 {
            return Gating::TooOld;
        }
        let before = &self.history[at - 1];
        let dt_s = t_exposure_s - before.sight.t_s;
        let mut axes = self.params.advance(&before.axes, dt_s);
        let combined = axes.each_ref().map(Belief::combined);
        let nis = normalised_innovation(&combined, &sight, 0.0);
        if nis <= self.params.gate_nis {
            self.gated_t_s = self.gated_t_s.max(t_exposure_s);
            (self.refused, self.refusals) = (None, 0);
        } else if nis.is_nan() || at < self.len || !self.reacquires(&sight, &combined) {
            self.score(0.0, t_exposure_s);
            return Gating::Rejected { nis };
        }
        self.params.correct(&mut axes, &combined, &sight);
        self.insert(at, Entry { axes, sight });
        self.score(1.0, t_exposure_s);
        Gating::Accepted { nis }
    }

    /// Scores a frame, exposed at `t_exposure_s`, that held no measurement of this target.
    pub fn miss(&mut self, t_exposure_s: f64) {
        self.score(0.0, t_exposure_s);
    }

    fn score(&mut self, hit: f64, t_s: f64) {
        let step_s = (t_s - self.scored_t_s).max(0.0);
        self.scored_t_s += step_s;
        self.quality = hit + (self.quality - hit) * (-step_s / self.params.quality_tau_s).exp();
    }

    /// Whether to accept a measurement that the gate refused: see [`LosFilter::update`].
    fn reacquires(&mut self, sight: &Sight, combined: &[AxisFilter; 2]) -> bool {
        let reach = |from_s: f64| self.params.initial_rate_sigma_radps * (sight.t_s - from_s);
        let gate = self.params.gate_nis;
        let before = self.refused.replace(*sight);
        let fits = before.is_some_and(|before| {
            let noise = before.sigma_rad.hypot(reach(before.t_s));
            let axes = [before.az_el_rad.x, before.az_el_rad.y].map(|angle| AxisFilter {
                x: [angle, 0.0, 0.0],
                ..AxisFilter::ZERO
            });
            sight.t_s >= before.t_s && normalised_innovation(&axes, sight, noise) <= gate
        });
        self.refusals = if fits { self.refusals + 1 } else { 1 };
        self.refusals >= REACQUIRE_AFTER
            && normalised_innovation(combined, sight, reach(self.gated_t_s)) <= gate
    }

    /// Puts an entry at index `at` (≥ 1) and replays the later ones.
    fn insert(&mut self, mut at: usize, entry: Entry) {
        if self.len == HISTORY {
            self.history.copy_within(1.., 0);
            self.len -= 1;
            at -= 1;
        }
        self.history.copy_within(at..self.len, at + 1);
        self.history[at] = entry;
        self.len += 1;
        for k in at + 1..self.len {
            let before = self.history[k - 1];
            let later = &mut self.history[k];
            later.axes = self
                .params
                .advance(&before.axes, later.sight.t_s - before.sight.t_s);
            let combined = later.axes.each_ref().map(Belief::combined);
            self.params
                .correct(&mut later.axes, &combined, &later.sight);
        }
    }
}

#[cfg(test)]
mod tests;
