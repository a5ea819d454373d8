//! Range of a target from its apparent size and from a laser range finder.
//!
//! An extended Kalman filter of three states: logarithm of the range, its rate, and logarithm of the
//! target's span. A size θ says ln θ = ln s − ln R, a laser sample says ln R. The span is assumed
//! with a spread, and what a size then says is wrong by the same factor in every frame: with the span
//! as a state, sizes do not average that away, laser samples teach it, and the sizes hold the
//! range after the laser is lost. (Range from angles and size: V. J. Aidala, S. E. Hammel,
//! "Utilization of modified polar coordinates for bearings-only tracking", 1983, whose 1/R states
//! these are the logarithms of.)
//!
//! Between samples the closing speed is constant but for white acceleration; the span that shows
//! wanders with the target's aspect, as a first-order Gauss–Markov process about the assumed one.

use nalgebra::{Matrix3, RowVector3, Vector3};
use std::ops::Range;
use thiserror::Error;

/// Standard deviation of the unknown closing speed at the start [m/s].
const SPEED_SIGMA_MPS: f64 = 15.0;
/// Density of the acceleration along the line of sight [m²/s³]: 2 m/s² held for 2 s.
const ACCEL_DENSITY: f64 = 2.0 * 2.0 * 2.0 * 2.0;
/// Correlation time of the apparent span [s].
const SPAN_TAU_S: f64 = 60.0;

/// A size that no target has.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("assumed {name} = {value} is not positive; give a value above 0")]
pub struct RangingError {
    /// Parameter.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
}

/// Estimate at one time: ln(R/m), its rate [1/s], ln(span/m).
#[derive(Clone, Copy, Debug, PartialEq)]
struct Estimate {
    t_s: f64,
    x: Vector3<f64>,
    p: Matrix3<f64>,
}

/// Range of one target.
#[derive(Clone, Debug, PartialEq)]
pub struct Ranging {
    /// Logarithm of the assumed span in metres, and its standard deviation.
    ln_span: f64,
    sigma_ln_span: f64,
    estimate: Option<Estimate>,
}

impl Ranging {
    /// For a target of about `span_m` [m] with a relative standard deviation `sigma_rel` (0.4: ± 40 %).
    pub fn new(span_m: f64, sigma_rel: f64) -> Result<Self, RangingError> {
        for (name, value) in [("span_m", span_m), ("sigma_rel", sigma_rel)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(RangingError { name, value });
            }
        }
        Ok(Self {
            ln_span: span_m.ln(),
            sigma_ln_span: sigma_rel,
            estimate: None,
        })
    }

    /// Takes in an apparent size [rad] with its relative standard deviation, exposed at `t_s`; what
    /// is not positive and finite is ignored.
    pub fn on_size(&mut self, size_rad: f64, sigma_rel: f64, t_s: f64) {
        self.take(RowVector3::new(-1.0, 0.0, 1.0), size_rad, sigma_rel, t_s);
    }

    /// Takes in a range [m] of a laser range finder with its standard deviation [m], sent at `t_s`;
    /// what is not positive and finite is ignored.
    pub fn on_laser(&mut self, range_m: f64, sigma_m: f64, t_s: f64) {
        self.take(
            RowVector3::new(1.0, 0.0, 0.0),
            range_m,
            sigma_m / range_m,
            t_s,
        );
    }

    /// Range and its standard deviation [m] at `t_s`, once there was a sample.
    pub fn range_m(&self, t_s: f64) -> Option<(f64, f64)> {
        let Estimate { x, p, .. } = self.at(t_s)?;
        let range_m = x[0].exp();
        Some((range_m, range_m * p[(0, 0)].sqrt()))
    }

    /// The range two standard deviations (of its logarithm) nearer than the estimate [m] at `t_s`.
    pub fn nearest_m(&self, t_s: f64) -> Option<f64> {
        let Estimate { x, p, .. } = self.at(t_s)?;
        Some((x[0] - 2.0 * p[(0, 0)].sqrt()).exp())
    }

    /// The ranges [m] within four standard deviations (of the logarithm) of the estimate at `t_s` and some
    /// metres: those of an echo that may be the target's.
    pub fn gate_m(&self, t_s: f64) -> Option<Range<f64>> {
        const SIGMAS: f64 = 4.0;
        // An airframe is so deep, and its parts answer in turn.
        const DEEP_M: f64 = 5.0; // [m]
        let Estimate { x, p, .. } = self.at(t_s)?;
        let reach = SIGMAS * p[(0, 0)].sqrt();
        Some((x[0] - reach).exp() - DEEP_M..(x[0] + reach).exp() + DEEP_M)
    }

    /// Forgets what was known: it was another's.
    pub fn restart(&mut self) {
        self.estimate = None;
    }

    /// Closing speed [m/s] at `t_s`, positive for a target that comes nearer, once there was a sample.
    pub fn closing_mps(&self, t_s: f64) -> Option<f64> {
        let Estimate { x, .. } = self.at(t_s)?;
        Some(-x[1] * x[0].exp())
    }

    /// Extrapolates to `t_s`; a time before the newest sample gives the newest estimate.
    fn at(&self, t_s: f64) -> Option<Estimate> {
        let Estimate { t_s: before, x, p } = self.estimate?;
        let dt_s = (t_s - before).max(0.0);
        // R grows to R·grown at constant speed; the floor keeps it from passing through the station.
        let grown = (1.0 + x[1] * dt_s).max(0.1);
        let kept = (-dt_s / SPAN_TAU_S).exp();
        let jacobian = Matrix3::new(
            1.0,
            dt_s / grown,
            0.0,
            0.0,
            1.0 / (grown * grown),
            0.0,
            0.0,
            0.0,
            kept,
        );
        let density = ACCEL_DENSITY * (-2.0 * x[0]).exp(); // of the log-range's acceleration [1/s³]
        let (q11, q12) = (density * dt_s.powi(3) / 3.0, density * dt_s.powi(2) / 2.0);
        let wander = self.sigma_ln_span.powi(2) * (1.0 - kept * kept);
        let noise = Matrix3::new(q11, q12, 0.0, q12, density * dt_s, 0.0, 0.0, 0.0, wander);
        Some(Estimate {
            t_s: before + dt_s,
            x: Vector3::new(
                x[0] + grown.ln(),
                x[1] / grown,
                self.ln_span + kept * (x[2] - self.ln_span),
            ),
            p: jacobian * p * jacobian.transpose() + noise,
        })
    }

    fn take(&mut self, seen: RowVector3<f64>, value: f64, sigma_rel: f64, t_s: f64) {
        if !(value > 0.0 && value.is_finite() && sigma_rel > 0.0 && sigma_rel.is_finite()) {
            return;
        }
        let (z, r) = (value.ln(), sigma_rel * sigma_rel);
        let estimate = self.at(t_s).map_or_else(
            || self.first(&seen, z, r, t_s),
            |mut estimate| {
                let p = estimate.p;
                let column = p * seen.transpose();
                let s = (seen * column)[0] + r;
                estimate.x += column * ((z - (seen * estimate.x)[0]) / s);
                estimate.p = p - column * column.transpose() / s;
                estimate
            },
        );
        self.estimate = Some(estimate);
    }

    /// The estimate from one sample alone: a range that was unknown before it.
    fn first(&self, seen: &RowVector3<f64>, z: f64, r: f64, t_s: f64) -> Estimate {
        let span = self.sigma_ln_span.powi(2);
        // ±(z − seen span): the sample solved for ln R.
        let (sign, shared) = (seen[0], seen[2] * span);
        let ln_range = sign * (z - seen[2] * self.ln_span);
        let rate = (SPEED_SIGMA_MPS * (-ln_range).exp()).powi(2);
        Estimate {
            t_s,
            x: Vector3::new(ln_range, 0.0, self.ln_span),
            p: Matrix3::new(
                r + seen[2] * shared,
                0.0,
                shared,
                0.0,
                rate,
                0.0,
                shared,
                0.0,
                span,
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::rng::Stream;

    const SPAN_M: f64 = 0.35;

    #[test]
    fn sizes_do_not_average_the_unknown_span_away() {
        // A target of 0.5 m taken for one of 0.35 m.
        let mut ranging = Ranging::new(SPAN_M, 0.4).unwrap();
        for k in 0..600 {
            ranging.on_size(0.5 / 800.0, 0.05, f64::from(k) / 60.0);
        }
        let (range_m, sigma_m) = ranging.range_m(10.0).unwrap();
        // Nothing tells the span, so the range is wrong by the span's factor, and known to be.
        assert!(
            (range_m / (800.0 * SPAN_M / 0.5) - 1.0).abs() < 0.01,
            "{range_m}"
        );
        assert!((sigma_m / range_m - 0.4).abs() < 0.02, "{sigma_m}");
        let nearest_m = ranging.nearest_m(10.0).unwrap();
        assert!((nearest_m / range_m - (-0.8f64).exp()).abs() < 0.02);
    }

    #[test]
    fn the_first_sample_is_solved_for_the_range() {
        let mut ranging = Ranging::new(SPAN_M, 0.4).unwrap();
        assert_eq!(ranging.range_m(0.0), None);
        ranging.on_size(f64::NAN, 0.1, 0.0);
        ranging.on_laser(0.0, 1.0, 0.0);
        assert_eq!(ranging.closing_mps(0.0), None);
        ranging.on_size(SPAN_M / 700.0, 0.3, 0.0);
        let (range_m, sigma_m) = ranging.range_m(0.0).unwrap();
        assert!((range_m - 700.0).abs() < 1e-9 && (sigma_m - 0.5 * 700.0).abs() < 1e-9);
        let mut ranging = Ranging::new(SPAN_M, 0.4).unwrap();
        ranging.on_laser(700.0, 0.5, 0.0);
        let (range_m, sigma_m) = ranging.range_m(0.0).unwrap();
        assert!((range_m - 700.0).abs() < 1e-9 && (sigma_m - 0.5).abs() < 1e-9);
    }

    #[test]
    fn the_laser_gives_range_and_closing_speed_and_teaches_the_span() {
        let mut rng = Stream::new(1, 0, "ranging");
        let mut ranging = Ranging::new(SPAN_M, 0.4).unwrap();
        let truth = |t: f64| 900.0 - 20.0 * t;
        for k in 0..300 {
            let t = f64::from(k) / 60.0;
            ranging.on_size(0.5 / truth(t) * (1.0 + 0.05 * rng.normal()), 0.05, t);
            if k % 6 == 0 {
                ranging.on_laser(truth(t) + 0.5 * rng.normal(), 0.5, t);
            }
        }
        let (range_m, sigma_m) = ranging.range_m(5.0).unwrap();
        assert!(
            (range_m - truth(5.0)).abs() < 3.0 * sigma_m && sigma_m < 2.0,
            "{range_m} {sigma_m}"
        );
        let closing = ranging.closing_mps(5.0).unwrap();
        assert!((closing - 20.0).abs() < 3.0, "{closing}");
        // Without the laser, sizes hold the range for another 10 s, though the span was assumed 30 %
        // too small.
        for k in 300..900 {
            let t = f64::from(k) / 60.0;
            ranging.on_size(0.5 / truth(t) * (1.0 + 0.05 * rng.normal()), 0.05, t);
        }
        let (range_m, sigma_m) = ranging.range_m(15.0).unwrap();
        let error = range_m - truth(15.0);
        assert!(error.abs() < 3.0 * sigma_m, "{error} {sigma_m}");
        assert!(error.abs() < 0.15 * truth(15.0), "{error}");
        // With nothing at all the uncertainty grows.
        assert!(ranging.range_m(20.0).unwrap().1 > 1.2 * sigma_m);
    }

    #[test]
    fn errors_match_their_deviations_over_200_runs() {
        // χ² of one degree of freedom: the mean of 200 has 95 % in 1 ± 1.96·√(2/200).
        let (mut nees, mut speed) = (0.0, 0.0);
        for run in 0..200 {
            let mut rng = Stream::new(2, run, "ranging");
            let mut ranging = Ranging::new(SPAN_M, 0.3).unwrap();
            let first_m = 600.0;
            let (mut range_m, mut rate) = (first_m, SPEED_SIGMA_MPS * rng.normal());
            let mut span = (0.3 * rng.normal()).exp() * SPAN_M;
            let dt = 1.0 / 60.0;
            for k in 0..180 {
                let t = f64::from(k) * dt;
                ranging.on_size(span / range_m * (0.05 * rng.normal()).exp(), 0.05, t);
                if k % 6 == 0 {
                    ranging.on_laser(range_m + 2.0 * rng.normal(), 2.0, t);
                }
                range_m += rate * dt;
                rate += (ACCEL_DENSITY * dt).sqrt() * rng.normal();
                let kept = (-dt / SPAN_TAU_S).exp();
                let wander = 0.3 * (1.0 - kept * kept).sqrt() * rng.normal();
                span = SPAN_M * (kept * (span / SPAN_M).ln() + wander).exp();
            }
            let (estimate, sigma) = ranging.range_m(3.0).unwrap();
            nees += ((estimate - range_m) / sigma).powi(2) / 200.0;
            speed += (ranging.closing_mps(3.0).unwrap() + rate).powi(2) / 200.0;
        }
        assert!((nees - 1.0).abs() < 0.196, "{nees}");
        // 3.1 m/s with a sample every 0.1 s of 2 m.
        assert!(speed.sqrt() < 5.0, "{speed}");
    }

    #[test]
    fn a_closing_target_does_not_pass_through_the_station() {
        let mut ranging = Ranging::new(SPAN_M, 0.4).unwrap();
        for k in 0..20 {
            let t = f64::from(k) * 0.1;
            ranging.on_laser(100.0 - 30.0 * t, 0.5, t);
        }
        let (range_m, sigma_m) = ranging.range_m(60.0).unwrap();
        assert!(range_m > 0.0 && sigma_m.is_finite());
        assert!(Ranging::new(0.0, 0.4).is_err() && Ranging::new(0.3, f64::NAN).is_err());
    }
}
