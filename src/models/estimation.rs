//! Angle-only Kalman filter of a target's line of sight in inertial azimuth and elevation.
//!
//! Each axis carries angle, rate and acceleration under Singer's model (R. A. Singer, 1970): the
//! acceleration is a first-order Gauss–Markov process of rms σₐ and correlation time τ. Noise and
//! manoeuvres are stated on the sky; the azimuth axis sees both divided by cos(el). The axes are
//! otherwise independent, which leaves out the kinematic coupling (of order ȧ·ė·tan el); it grows
//! towards the zenith, where azimuth angles lose their meaning, and cos(el) is floored at 0.05.
//!
//! Latency: the filter stays at the exposure time of the newest measurement and is extrapolated on
//! reading ([`LosFilter::predicted`]). A measurement older than that (two cameras of different
//! latency) is put in its place and the later ones are replayed, so the result is the same as if
//! they had come in order, as far back as the last eight accepted measurements.

use glam::{DVec2, DVec3};
use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::models::gimbal::lag_integrals;
use crate::models::kinematics::{az_el_to_los, wrap_pi};

/// Accepted measurements kept for replay.
const HISTORY: usize = 8;

/// A filter parameter out of its range.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("line-of-sight filter parameter {name} = {value} is not positive")]
pub struct LosFilterError {
    /// Field name.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
}

/// Parameters of a line-of-sight filter.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct LosFilterParams {
    /// Rms angular acceleration of the target on the sky, σₐ [rad/s²].
    pub accel_sigma_radps2: f64,
    /// Correlation time of that acceleration, τ [s].
    pub accel_tau_s: f64,
    /// Standard deviation of the unknown initial rate on the sky [rad/s].
    pub initial_rate_sigma_radps: f64,
    /// Gate on the normalised innovation squared (χ² of two degrees of freedom).
    pub gate_nis: f64,
    /// Memory of the track quality [s].
    pub quality_tau_s: f64,
}

impl Default for LosFilterParams {
    /// For a small multirotor near 1 km: manoeuvres of some 2 m/s² held for two seconds, speeds up to
    /// 20 m/s. At a known range R prefer σₐ = a/R. Too small a σₐ is the dangerous side: the gate
    /// then throws away the manoeuvre (see the tuning study in `pointing.rs`). The gate passes
    /// 99.97 % of true measurements.
    fn default() -> Self {
        Self {
            accel_sigma_radps2: 2e-3,       // [rad/s²]
            accel_tau_s: 2.0,               // [s]
            initial_rate_sigma_radps: 0.02, // [rad/s]
            gate_nis: 16.0,
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

/// What became of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gating {
    /// Used; with its normalised innovation squared.
    Accepted { nis: f64 },
    /// Outside the gate, not used; with its normalised innovation squared.
    Rejected { nis: f64 },
    /// Older than the replay memory, not used.
    TooOld,
}

/// Estimate of one axis: (angle, rate, acceleration) and covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Axis {
    x: Vector3<f64>,
    p: Matrix3<f64>,
}

/// A measurement of the line of sight.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sight {
    az_el_rad: DVec2,
    sigma_rad: f64,
}

/// The filter after one accepted measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Entry {
    t_s: f64,
    axes: [Axis; 2],
    sight: Sight,
}

/// Angle-only Kalman filter of one target's line of sight.
#[derive(Clone, Debug, PartialEq)]
pub struct LosFilter {
    params: LosFilterParams,
    /// Accepted measurements, oldest first, in exposure order; `len` of them.
    history: [Entry; HISTORY],
    len: usize,
    quality: f64,
    scored_t_s: f64,
}

/// 1/cos(el) of the azimuth axis, then 1 of the elevation axis.
fn axis_scales(el_rad: f64) -> [f64; 2] {
    [1.0 / el_rad.cos().max(0.05), 1.0]
}

/// Singer's transition matrix over `dt_s` and process noise for unit σₐ.
fn singer(tau_s: f64, dt_s: f64) -> (Matrix3<f64>, Matrix3<f64>) {
    let x = dt_s / tau_s;
    let [e, phi, psi] = lag_integrals(x);
    let transition = Matrix3::new(
        1.0,
        dt_s,
        dt_s * dt_s * psi,
        0.0,
        1.0,
        dt_s * phi,
        0.0,
        0.0,
        e,
    );
    // Q = (2/τ) ∫₀^dt g gᵀ du, with g(u) the last column of the transition over u.
    let noise = if x < 0.1 {
        // Five-point Gauss–Legendre: the closed form below cancels to nothing here, while this is
        // exact to 1e-15.
        const NODES: [(f64, f64); 5] = [
            (0.046_910_077_030_668, 0.118_463_442_528_094_5),
            (0.230_765_344_947_158_5, 0.239_314_335_249_683_2),
            (0.5, 0.284_444_444_444_444_4),
            (0.769_234_655_052_841_5, 0.239_314_335_249_683_2),
            (0.953_089_922_969_332, 0.118_463_442_528_094_5),
        ];
        NODES.iter().fold(Matrix3::zeros(), |sum, &(s, weight)| {
            let u = s * dt_s;
            let [e, phi, psi] = lag_integrals(s * x);
            let g = Vector3::new(u * u * psi, u * phi, e);
            sum + g * g.transpose() * (weight * 2.0 * x)
        })
    } else {
        let e2 = e * e;
        let q11 = tau_s.powi(4)
            * (1.0 - e2 + 2.0 * x + 2.0 / 3.0 * x.powi(3) - 2.0 * x * x - 4.0 * x * e);
        let q12 = tau_s.powi(3) * (e2 + 1.0 - 2.0 * e + 2.0 * x * e - 2.0 * x + x * x);
        let q13 = tau_s.powi(2) * (1.0 - e2 - 2.0 * x * e);
        let q22 = tau_s.powi(2) * (4.0 * e - 3.0 - e2 + 2.0 * x);
        let q23 = tau_s * (e2 + 1.0 - 2.0 * e);
        let q33 = 1.0 - e2;
        Matrix3::new(q11, q12, q13, q12, q22, q23, q13, q23, q33)
    };
    (transition, noise)
}

impl LosFilterParams {
    /// Checks every field.
    pub fn validate(&self) -> Result<(), LosFilterError> {
        for (name, value) in [
            ("accel_sigma_radps2", self.accel_sigma_radps2),
            ("accel_tau_s", self.accel_tau_s),
            ("initial_rate_sigma_radps", self.initial_rate_sigma_radps),
            ("gate_nis", self.gate_nis),
            ("quality_tau_s", self.quality_tau_s),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(LosFilterError { name, value });
            }
        }
        Ok(())
    }

    /// The estimate at `t_s`, not before the entry's time.
    fn advance(&self, entry: &Entry, t_s: f64) -> [Axis; 2] {
        let (transition, noise) = singer(self.accel_tau_s, t_s - entry.t_s);
        let scales = axis_scales(entry.axes[1].x[0]);
        std::array::from_fn(|i| {
            let Axis { x, p } = entry.axes[i];
            let sigma = self.accel_sigma_radps2 * scales[i];
            let p = transition * p * transition.transpose() + noise * (sigma * sigma);
            Axis {
                x: transition * x,
                p,
            }
        })
    }
}

/// Updates both axes with a sight; returns them with the normalised innovation squared.
fn correct(axes: &[Axis; 2], sight: &Sight) -> ([Axis; 2], f64) {
    let scales = axis_scales(axes[1].x[0]);
    let innovation = [
        wrap_pi(sight.az_el_rad.x - axes[0].x[0]),
        sight.az_el_rad.y - axes[1].x[0],
    ];
    let mut nis = 0.0;
    let axes = std::array::from_fn(|i| {
        let Axis { mut x, p } = axes[i];
        let noise = sight.sigma_rad * scales[i];
        let s = p[(0, 0)] + noise * noise;
        let column: Vector3<f64> = p.column(0).into();
        nis += innovation[i] * innovation[i] / s;
        x += column * (innovation[i] / s);
        // H picks the angle, so (I − KH)P is this rank-one step, symmetric by construction.
        let p = p - column * column.transpose() / s;
        if i == 0 {
            x[0] = wrap_pi(x[0]);
        }
        Axis { x, p }
    });
    (axes, nis)
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
        let scales = axis_scales(az_el_rad.y);
        let deviations = Vector3::new(
            sigma_rad,
            params.initial_rate_sigma_radps,
            params.accel_sigma_radps2,
        );
        let entry = Entry {
            t_s,
            axes: std::array::from_fn(|i| Axis {
                x: Vector3::new(az_el_rad[i], 0.0, 0.0),
                p: Matrix3::from_diagonal(&(deviations * scales[i]).map(|d| d * d)),
            }),
            sight: Sight {
                az_el_rad,
                sigma_rad,
            },
        };
        Ok(Self {
            params,
            history: [entry; HISTORY],
            len: 1,
            quality: 1.0,
            scored_t_s: t_s,
        })
    }

    /// Time of the newest accepted exposure [s].
    pub fn t_s(&self) -> f64 {
        self.history[self.len - 1].t_s
    }

    /// Time since the newest accepted exposure [s].
    pub fn coast_s(&self, t_s: f64) -> f64 {
        t_s - self.t_s()
    }

    /// Share of recent frames whose measurement was accepted, with exponential memory, in [0, 1].
    pub fn quality(&self) -> f64 {
        self.quality
    }

    /// The line of sight extrapolated to `t_s` (not before the newest exposure; an earlier time
    /// gives the newest estimate).
    pub fn predicted(&self, t_s: f64) -> LosState {
        let newest = &self.history[self.len - 1];
        let t_s = t_s.max(newest.t_s);
        let [az, el] = self.params.advance(newest, t_s);
        LosState {
            t_s,
            az_rad: wrap_pi(az.x[0]),
            el_rad: el.x[0],
            az_rate_radps: az.x[1],
            el_rate_radps: el.x[1],
            az_accel_radps2: az.x[2],
            el_accel_radps2: el.x[2],
            covariance: [az.p, el.p],
        }
    }

    /// Offers the measurement of the exposure at `t_exposure_s` (azimuth x, elevation y [rad], of
    /// standard deviation `sigma_rad` on the sky), and scores the frame.
    pub fn update(&mut self, az_el_rad: DVec2, sigma_rad: f64, t_exposure_s: f64) -> Gating {
        let sight = Sight {
            az_el_rad,
            sigma_rad,
        };
        let at = self.history[..self.len].partition_point(|e| e.t_s <= t_exposure_s);
        if at == 0 {
            return Gating::TooOld;
        }
        let prior = self.params.advance(&self.history[at - 1], t_exposure_s);
        let (axes, nis) = correct(&prior, &sight);
        if nis.is_nan() || nis > self.params.gate_nis {
            self.score(0.0, t_exposure_s);
            return Gating::Rejected { nis };
        }
        self.insert(
            at,
            Entry {
                t_s: t_exposure_s,
                axes,
                sight,
            },
        );
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

    /// Puts an entry at index `at` (≥ 1) and replays the later ones.
    fn insert(&mut self, mut at: usize, entry: Entry) {
        if self.len == HISTORY {
            self.history.rotate_left(1);
            self.len -= 1;
            at -= 1;
        }
        self.history.copy_within(at..self.len, at + 1);
        self.history[at] = entry;
        self.len += 1;
        for k in at + 1..self.len {
            let later = self.history[k];
            let prior = self.params.advance(&self.history[k - 1], later.t_s);
            self.history[k].axes = correct(&prior, &later.sight).0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::rng::Stream;

    const DT: f64 = 1.0 / 120.0;

    #[test]
    fn singer_matrices_compose_and_have_their_limits() {
        let tau = 1.3;
        // Across both branches: Q(a + b) = Φ(b) Q(a) Φ(b)ᵀ + Q(b).
        for (a, b) in [
            (0.001, 0.002),
            (0.12, 0.02),
            (0.05, 0.1),
            (0.5, 2.0),
            (6.0, 9.0),
        ] {
            let ((fa, qa), (fb, qb)) = (singer(tau, a), singer(tau, b));
            let (f, q) = singer(tau, a + b);
            assert!((f - fb * fa).norm() < 1e-13 * f.norm());
            let sum = fb * qa * fb.transpose() + qb;
            for i in 0..3 {
                for j in 0..3 {
                    assert!(
                        (sum[(i, j)] / q[(i, j)] - 1.0).abs() < 1e-8,
                        "{a} {b} {i}{j}"
                    );
                }
            }
        }
        // White jerk of density 2/τ at short times: q11 = dt⁵/(10 τ).
        let (_, q) = singer(tau, 1e-4);
        assert!((q[(0, 0)] / (1e-20 / (10.0 * tau)) - 1.0).abs() < 1e-3);
        assert_eq!(singer(tau, 0.0).0, Matrix3::identity());
    }

    /// Truth drawn from the filter's own model, on the sky at elevation `el`.
    struct Truth {
        axes: [Vector3<f64>; 2],
    }

    impl Truth {
        fn new(params: &LosFilterParams, az_el: DVec2, rng: &mut Stream) -> Self {
            let scales = axis_scales(az_el.y);
            Self {
                axes: std::array::from_fn(|i| {
                    Vector3::new(
                        az_el[i],
                        params.initial_rate_sigma_radps * scales[i] * rng.normal(),
                        params.accel_sigma_radps2 * scales[i] * rng.normal(),
                    )
                }),
            }
        }

        fn step(&mut self, params: &LosFilterParams, dt: f64, rng: &mut Stream) {
            let (f, q) = singer(params.accel_tau_s, dt);
            let root = q.cholesky().unwrap().l();
            let scales = axis_scales(self.axes[1][0]);
            for (axis, scale) in self.axes.iter_mut().zip(scales) {
                let n = Vector3::new(rng.normal(), rng.normal(), rng.normal());
                *axis = f * *axis + root * n * (params.accel_sigma_radps2 * scale);
            }
        }

        fn sight(&self, sigma: f64, rng: &mut Stream) -> DVec2 {
            let scales = axis_scales(self.axes[1][0]);
            DVec2::new(
                wrap_pi(self.axes[0][0] + sigma * scales[0] * rng.normal()),
                self.axes[1][0] + sigma * rng.normal(),
            )
        }
    }

    #[test]
    fn nees_and_nis_are_consistent_over_200_runs() {
        let params = LosFilterParams {
            gate_nis: 1e9,
            ..Default::default()
        };
        let (runs, sigma) = (200, 27e-6);
        let (mut nees, mut nis_sum, mut frames) = ([0.0; 3], 0.0, 0.0);
        for run in 0..runs {
            let mut rng = Stream::new(11, run, "nees");
            // Straddles the wrap at south, at 34° elevation.
            let mut truth = Truth::new(
                &params,
                DVec2::new(std::f64::consts::PI - 1e-4, 0.6),
                &mut rng,
            );
            let first = truth.sight(sigma, &mut rng);
            let mut filter = LosFilter::start(params, first, sigma, 0.0).unwrap();
            for k in 1..=240 {
                truth.step(&params, DT, &mut rng);
                let t = f64::from(k) * DT;
                match filter.update(truth.sight(sigma, &mut rng), sigma, t) {
                    Gating::Accepted { nis } => nis_sum += nis,
                    other => panic!("{other:?}"),
                }
                frames += 1.0;
                if k % 80 == 0 {
                    let axes = filter.history[filter.len - 1].axes;
                    for (i, axis) in axes.iter().enumerate() {
                        let mut e = truth.axes[i] - axis.x;
                        e[0] = wrap_pi(e[0]);
                        nees[(k / 80 - 1) as usize] += e.dot(&(axis.p.try_inverse().unwrap() * e));
                    }
                }
            }
        }
        // χ² of 1200 degrees of freedom over 200: 95 % within [5.53, 6.49].
        for total in nees {
            let mean = total / runs as f64;
            assert!((5.53..6.49).contains(&mean), "NEES {mean}");
        }
        // χ² of 96 000 degrees of freedom: 2 ± 1.96·2/√48 000.
        let mean = nis_sum / frames;
        assert!((mean - 2.0).abs() < 0.018, "NIS {mean}");
    }

    #[test]
    fn constant_acceleration_is_followed_with_the_theoretical_lag() {
        // Singer's mean acceleration decays, so a sustained acceleration leaves a small bias;
        // with a long τ the filter is a third-order tracker and the bias vanishes.
        let bias = |tau: f64| {
            let params = LosFilterParams {
                accel_tau_s: tau,
                ..Default::default()
            };
            let accel = 2e-3; // [rad/s²]
            let truth = |t: f64| 0.1 + 8e-3 * t + 0.5 * accel * t * t;
            let mut filter =
                LosFilter::start(params, DVec2::new(0.2, truth(0.0)), 27e-6, 0.0).unwrap();
            let mut t = 0.0;
            for k in 1..=600 {
                t = f64::from(k) * DT;
                filter.update(DVec2::new(0.2, truth(t)), 27e-6, t);
            }
            let ahead = filter.predicted(t + 0.03);
            (
                truth(t + 0.03) - ahead.el_rad,
                ahead.el_rate_radps / (8e-3 + accel * (t + 0.03)) - 1.0,
            )
        };
        let (angle, rate) = bias(1e4);
        assert!(angle.abs() < 1e-7 && rate.abs() < 1e-5, "{angle} {rate}");

        // Default: the fixed point of e ← (I − KH)(Φe + w), w = what Singer's model forgets of the
        // acceleration in one frame, with K of the converged Riccati recursion.
        let params = LosFilterParams::default();
        let (f, q) = singer(params.accel_tau_s, DT);
        let q = q * params.accel_sigma_radps2.powi(2);
        let mut p = Matrix3::identity() * 1e-4;
        let mut keep = Matrix3::<f64>::identity();
        for _ in 0..5000 {
            let prior = f * p * f.transpose() + q;
            let k = prior.column(0) / (prior[(0, 0)] + 27e-6f64.powi(2));
            keep = Matrix3::identity();
            for i in 0..3 {
                keep[(i, 0)] -= k[i];
            }
            p = keep * prior;
        }
        let accel = Vector3::new(0.0, 0.0, 2e-3);
        let steady = |dt: f64| Matrix3::new(1.0, dt, 0.5 * dt * dt, 0.0, 1.0, dt, 0.0, 0.0, 1.0);
        let forgot = (steady(DT) - f) * accel;
        let e = (Matrix3::<f64>::identity() - keep * f)
            .try_inverse()
            .unwrap()
            * (keep * forgot);
        let (ahead, _) = singer(params.accel_tau_s, 0.03);
        let expected = (ahead * e + (steady(0.03) - ahead) * accel)[0];
        let (angle, _) = bias(params.accel_tau_s);
        assert!((angle / expected - 1.0).abs() < 1e-3, "{angle} {expected}");
        // Lagging, by less than a third of a pixel.
        assert!(angle > 0.0 && angle < 9e-6, "{angle}");
    }

    #[test]
    fn late_measurements_are_put_in_their_place() {
        let params = LosFilterParams::default();
        let mut rng = Stream::new(5, 0, "late");
        let mut truth = Truth::new(&params, DVec2::new(-1.0, 0.3), &mut rng);
        let sights: Vec<(f64, DVec2)> = (1..=20)
            .map(|k| {
                truth.step(&params, DT, &mut rng);
                (f64::from(k) * DT, truth.sight(27e-6, &mut rng))
            })
            .collect();
        let start = LosFilter::start(params, DVec2::new(-1.0, 0.3), 1e-3, 0.0).unwrap();
        let mut ordered = start.clone();
        let mut shuffled = start;
        for (t, z) in &sights {
            assert!(matches!(
                ordered.update(*z, 27e-6, *t),
                Gating::Accepted { .. }
            ));
        }
        for k in 0..20 {
            // Swap every fourth with the one three later.
            let k = match k % 4 {
                0 => k + 3,
                3 => k - 3,
                _ => k,
            };
            shuffled.update(sights[k].1, 27e-6, sights[k].0);
        }
        let (a, b) = (ordered.predicted(0.2), shuffled.predicted(0.2));
        assert!((a.az_rad - b.az_rad).abs() < 1e-12 && (a.el_rad - b.el_rad).abs() < 1e-12);
        assert!((a.covariance[0] - b.covariance[0]).norm() < 1e-12 * a.covariance[0].norm());
        assert_eq!(
            ordered.update(sights[1].1, 27e-6, sights[1].0),
            Gating::TooOld
        );
    }

    #[test]
    fn gate_quality_and_coasting() {
        let params = LosFilterParams::default();
        let z = DVec2::new(0.5, 0.2);
        let mut filter = LosFilter::start(params, z, 27e-6, 0.0).unwrap();
        for k in 1..=240 {
            filter.update(z, 27e-6, f64::from(k) * DT);
        }
        let before = filter.predicted(2.5);
        let far = z + DVec2::new(0.0, 1e-3);
        let rejected = filter.update(far, 27e-6, 2.0 + DT);
        assert!(matches!(rejected, Gating::Rejected { nis } if nis > 16.0));
        assert_eq!(filter.predicted(2.5), before);
        assert!(matches!(
            filter.update(DVec2::new(f64::NAN, 0.0), 27e-6, 2.0 + 2.0 * DT),
            Gating::Rejected { .. }
        ));
        for k in 3..=60 {
            filter.miss(2.0 + f64::from(k) * DT);
        }
        // Half a second of misses with a memory of half a second: e⁻¹.
        assert!((filter.quality() - (-1.0f64).exp()).abs() < 1e-9);
        assert!((filter.coast_s(2.5) - 0.5).abs() < 1e-12);
        // Coasting, the uncertainty grows until the far measurement would pass.
        assert!(filter.predicted(3.0).sigma_rad().y > 10.0 * filter.predicted(2.0).sigma_rad().y);
        assert!(matches!(
            filter.update(far, 27e-6, 4.0),
            Gating::Accepted { .. }
        ));
    }

    #[test]
    fn cos_el_scales_the_azimuth_axis() {
        let params = LosFilterParams::default();
        let z = DVec2::new(0.0, 1.2);
        let mut filter = LosFilter::start(params, z, 27e-6, 0.0).unwrap();
        for k in 1..=100 {
            filter.update(z, 27e-6, f64::from(k) * DT);
        }
        let state = filter.predicted(1.0);
        assert!((state.sigma_rad().x / state.sigma_rad().y - 1.0).abs() < 1e-9);
        assert!(state.covariance[0][(0, 0)] > 7.0 * state.covariance[1][(0, 0)]);
        // The derivative of the direction is that of its angles.
        let mut moving = state;
        (moving.az_rate_radps, moving.el_rate_radps) = (0.3, -0.2);
        let (d, d_dot) = moving.direction_enu();
        let h = 1e-6;
        moving.az_rad += 0.3 * h;
        moving.el_rad -= 0.2 * h;
        assert!(((moving.direction_enu().0 - d) / h - d_dot).length() < 1e-6);
    }

    #[test]
    fn bad_parameters_are_refused() {
        let z = DVec2::ZERO;
        let mut params = LosFilterParams::default();
        assert!(LosFilter::start(params, z, 0.0, 0.0).is_err());
        params.accel_tau_s = f64::NAN;
        assert!(LosFilter::start(params, z, 1e-5, 0.0).is_err());
    }
}
