//! LQG pointing law: one optimal regulator that moves gimbal and mirror together.
//!
//! By the separation principle the law is a linear-quadratic regulator on estimates. The target's part
//! of the state (line of sight, its rate and acceleration) is the Kalman estimate of
//! [`crate::tracking::estimation`]; the mount's own is measured, but for the torque that the rate servo's
//! integrator and all disturbances make together, which a Kalman observer finds from the encoder's rate.
//!
//! Each axis, in sky angles, has the state x = (e, r, ξ, m, ṁ, a): gimbal error, gimbal rate beyond the
//! line of sight's, servo integrator and disturbance [rad/s²], mirror deflection and rate, acceleration
//! of the line of sight (Singer). Inputs are the rate command beyond the line of sight's and the
//! mirror's. The model is the sampled one of [`crate::mount::gimbal`] and
//! [`crate::mount::mirror`]: torque and mirror command are held over the tick.
//!
//! The cost, by Bryson's rule one over the square of what is acceptable, is on the pointing error
//! e − m, on the deflection m and on both commands. So how gimbal and mirror share the work follows
//! from two numbers that mean something, error and deflection, instead of a separate gain: the
//! mirror takes the error within a tick, the gimbal unloads it as fast as its rate effort allows.
//! No integral of the error is needed: the rate servo integrates, so steady friction or
//! wind leaves no rate error, and the observer's ξ acts before an error arises.
//!
//! Against [`super::tuned::TunedPointing`] it buys foresight of the servo's and the
//! disturbance's next tick, a mirror of any speed without a special rule, and gains that follow the
//! mount's parameters. It buys nothing against pixel noise or gyro drift, which come through the shared
//! estimate and dominate; it needs a model of the servo; and an LQG loop has no guaranteed margins
//! (Doyle, 1978), so `boresight tune` measures them.

use glam::DVec2;
use nalgebra::{DMatrix, DVector};
use thiserror::Error;

use super::law::{Aim, HandOver, PointingInput, PointingOutput};
use super::pointing::PointingLaw;
use crate::maths::kinematics::base_rate_on_axes;
use crate::maths::second_order::{SecondOrderError, second_order_transition};
use crate::mount::gimbal::{AxisParams, GimbalCommand, GimbalParams};
use crate::mount::mirror::MirrorParams;

/// Why a regulator cannot be built.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum LqgError {
    /// The Riccati equation has no stabilising solution, or it was not found.
    #[error(
        "the Riccati equation was not solved: relative residual {residual:e}; choose less extreme weights"
    )]
    Riccati {
        /// Residual of the equation, relative to the solution.
        residual: f64,
    },
    /// The mirror's parameters are out of range.
    #[error(transparent)]
    Mirror(#[from] SecondOrderError),
}

/// Largest relative residual of a solved Riccati equation.
const RESIDUAL: f64 = 1e-9;

/// Stabilising solution P of the discrete algebraic Riccati equation
/// P = AᵀPA − AᵀPB(R + BᵀPB)⁻¹BᵀPA + Q, by structured doubling (Chu, Fan, Lin and Wang, 2004),
/// tested against the equation.
pub fn solve_dare(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
) -> Result<DMatrix<f64>, LqgError> {
    let unsolved = LqgError::Riccati { residual: f64::NAN };
    let identity = DMatrix::identity(a.nrows(), a.nrows());
    let inverse_r = r.clone().try_inverse().ok_or(unsolved)?;
    let (mut ak, mut g, mut h) = (a.clone(), b * inverse_r * b.transpose(), q.clone());
    for _ in 0..60 {
        let w = (&identity + &g * &h).try_inverse().ok_or(unsolved)?;
        let next_h = &h + ak.transpose() * &h * &w * &ak;
        g += &ak * &w * &g * ak.transpose();
        ak = &ak * &w * &ak;
        let change = (&next_h - &h).norm() / next_h.norm();
        // Rounding must not let it drift from symmetry.
        h = 0.5 * (&next_h + next_h.transpose());
        g = 0.5 * (&g + g.transpose());
        if change < 1e-15 {
            break;
        }
    }
    let residual = dare_residual(a, b, q, r, &h).ok_or(unsolved)?;
    if residual < RESIDUAL {
        Ok(h)
    } else {
        Err(LqgError::Riccati { residual })
    }
}

/// Residual of the Riccati equation for P, relative to P; `None` where R + BᵀPB cannot be inverted.
pub fn dare_residual(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    q: &DMatrix<f64>,
    r: &DMatrix<f64>,
    p: &DMatrix<f64>,
) -> Option<f64> {
    let k = lqr_gain(a, b, r, p)?;
    let rest = a.transpose() * p * (a - b * k) + q - p;
    Some(rest.norm() / p.norm())
}

/// Gain K = (R + BᵀPB)⁻¹BᵀPA of the optimal input u = −Kx.
pub fn lqr_gain(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    r: &DMatrix<f64>,
    p: &DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let inverse = (r + b.transpose() * p * b).try_inverse()?;
    Some(inverse * b.transpose() * p * a)
}

/// Acceptable sizes of errors and commands, from which the weights of the cost follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LqgWeights {
    /// Pointing error [rad].
    pub error_rad: f64,
    /// Mirror deflection, and command [rad].
    pub deflection_rad: f64,
    /// Rate command beyond the line of sight's [rad/s].
    pub rate_radps: f64,
    /// Rms of the noise of an encoder's rate [rad/s].
    pub rate_noise_radps: f64,
    /// Rms change of the disturbance in a tick [rad/s²].
    pub disturbance_step_radps2: f64,
}

impl Default for LqgWeights {
    /// A microradian of error weighs as 200 µrad of deflection or 4 mrad/s of rate: the regulator
    /// then leaves 25 ppm of a deflection as error. Noise of the rate: what
    /// the base's unseen motion within a tick makes.
    fn default() -> Self {
        Self {
            error_rad: 1e-6,               // [rad]
            deflection_rad: 200e-6,        // [rad]
            rate_radps: 4e-3,              // [rad/s]
            rate_noise_radps: 1e-4,        // [rad/s]
            disturbance_step_radps2: 1e-2, // [rad/s²]
        }
    }
}

/// States and inputs of one axis.
const STATES: usize = 6;
const INPUTS: usize = 2;

/// Sampled model of one axis: x⁺ = Ax + Bu, see the module.
fn axis_model(
    axis: &AxisParams,
    mirror: &MirrorParams,
    accel_tau_s: f64,
    dt_s: f64,
) -> Result<(DMatrix<f64>, DMatrix<f64>), LqgError> {
    let omega = std::f64::consts::TAU * axis.bandwidth_hz;
    let (g, w2, t) = (2.0 * axis.damping * omega, omega * omega, dt_s);
    let [[c, s], [c_dot, s_dot]] =
        second_order_transition(mirror.natural_frequency_hz, mirror.damping, dt_s)?;
    let forget = (-dt_s / accel_tau_s).exp();
    let h = 0.5 * t * t;
    #[rustfmt::skip]
    let a = DMatrix::from_row_slice(STATES, STATES, &[
        1.0, -t + h * g, -h, 0.0, 0.0, h,
        0.0, 1.0 - t * g, t, 0.0, 0.0, -t,
        0.0, -t * w2, 1.0, 0.0, 0.0, 0.0,
        0.0, 0.0, 0.0, c, s, 0.0,
        0.0, 0.0, 0.0, c_dot, s_dot, 0.0,
        0.0, 0.0, 0.0, 0.0, 0.0, forget,
    ]);
    #[rustfmt::skip]
    let b = DMatrix::from_row_slice(STATES, INPUTS, &[
        -h * g, 0.0,
        t * g, 0.0,
        t * w2, 0.0,
        0.0, 1.0 - c,
        0.0, -c_dot,
        0.0, 0.0,
    ]);
    Ok((a, b))
}

/// Weights Q and R of one axis.
fn axis_cost(weights: &LqgWeights) -> (DMatrix<f64>, DMatrix<f64>) {
    let per_square = |x: f64| 1.0 / (x * x);
    let mut q = DMatrix::zeros(STATES, STATES);
    // (e − m)² and m².
    let error = per_square(weights.error_rad);
    for (i, j, sign) in [(0, 0, 1.0), (0, 3, -1.0), (3, 0, -1.0), (3, 3, 1.0)] {
        q[(i, j)] = sign * error;
    }
    q[(3, 3)] += per_square(weights.deflection_rad);
    let r = DMatrix::from_diagonal(&DVector::from_vec(vec![
        per_square(weights.rate_radps),
        per_square(weights.deflection_rad),
    ]));
    (q, r)
}

/// Gain of one axis, rows (rate, mirror).
fn axis_gain(
    axis: &AxisParams,
    mirror: &MirrorParams,
    accel_tau_s: f64,
    weights: &LqgWeights,
    dt_s: f64,
) -> Result<[[f64; STATES]; INPUTS], LqgError> {
    let (a, b) = axis_model(axis, mirror, accel_tau_s, dt_s)?;
    let (q, r) = axis_cost(weights);
    // Solved in units of like size: angles by the acceptable error, times by the tick.
    let scale = DVector::from_vec(vec![1.0, 1e2, 1e4, 1.0, 1e3, 1e4]) * weights.error_rad;
    let s = DMatrix::from_diagonal(&scale);
    let s_inverse = DMatrix::from_diagonal(&scale.map(f64::recip));
    let input = DMatrix::from_diagonal(&DVector::from_vec(vec![
        weights.rate_radps,
        weights.deflection_rad,
    ]));
    let (a, b) = (&s_inverse * a * &s, &s_inverse * b * &input);
    let (q, r) = (&s * q * &s, &input * r * &input);
    let p = solve_dare(&a, &b, &q, &r)?;
    let k = lqr_gain(&a, &b, &r, &p).ok_or(LqgError::Riccati { residual: f64::NAN })?;
    let k = input * k * s_inverse;
    Ok([0, 1].map(|i| std::array::from_fn(|j| k[(i, j)])))
}

/// LQG pointing law; what it reads is predicted to the tick's start, without a lead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LqgPointing {
    /// Gains of azimuth and elevation, rows (rate, mirror).
    gains: [[[f64; STATES]; INPUTS]; 2],
    /// Share of the innovation that corrects the disturbance.
    observer: f64,
    dt_s: f64,
    /// What it remembers of each axis.
    axes: [Observer; 2],
}

/// Observer of one axis: servo integrator plus disturbance, and the last command.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Observer {
    /// ξ [rad/s²].
    drive_radps2: f64,
    /// The axis at the last command.
    last: Option<LastCommand>,
}

/// An axis when it was last commanded.
#[derive(Clone, Copy, Debug, PartialEq)]
struct LastCommand {
    /// Rate of the axis in space [rad/s].
    rate_radps: f64,
    /// Commanded minus measured rate [rad/s].
    error_radps: f64,
}

impl Observer {
    /// Corrects ξ by the axis rate in space now, after the last command.
    fn correct(&mut self, axis: &AxisParams, gain: f64, rate_radps: f64, dt_s: f64) {
        let Some(LastCommand {
            rate_radps: before,
            error_radps: error,
        }) = self.last
        else {
            return;
        };
        let omega = std::f64::consts::TAU * axis.bandwidth_hz;
        let demand = 2.0 * axis.damping * omega * error + self.drive_radps2;
        let limit = axis.torque_limit_nm / axis.inertia_kg_m2;
        let push = demand.min(limit).max(-limit);
        // The servo holds its integrator while it saturates.
        if push == demand || error * (demand - push) < 0.0 {
            self.drive_radps2 += omega * omega * error * dt_s;
        }
        let innovation = rate_radps - (before + dt_s * push);
        self.drive_radps2 += gain * innovation / dt_s;
    }
}

impl LqgPointing {
    /// The law for a mount commanded every `dt_s`, and a target whose acceleration has the
    /// correlation time `accel_tau_s`.
    pub fn new(
        gimbal: &GimbalParams,
        mirror: &MirrorParams,
        accel_tau_s: f64,
        weights: &LqgWeights,
        dt_s: f64,
    ) -> Result<Self, LqgError> {
        let gain = |axis| axis_gain(axis, mirror, accel_tau_s, weights, dt_s);
        // Kalman gain of a random walk seen through the change of rate in a tick: the dual equation.
        let one = |x: f64| DMatrix::from_element(1, 1, x);
        let noise = (weights.rate_noise_radps / dt_s).powi(2);
        let p = solve_dare(
            &one(1.0),
            &one(1.0),
            &one(weights.disturbance_step_radps2.powi(2)),
            &one(noise),
        )?[(0, 0)];
        Ok(Self {
            gains: [gain(&gimbal.azimuth)?, gain(&gimbal.elevation)?],
            observer: p / (p + noise),
            dt_s,
            axes: [Observer::default(); 2],
        })
    }

    /// Gimbal rate per angle still to turn of azimuth and elevation [1/s], once the servo follows: then
    /// u = −K_e e − K_r r is a proportional law of gain −K_e/(1 + K_r).
    pub fn gimbal_gains_per_s(&self) -> [f64; 2] {
        self.gains.map(|[rate, _]| -rate[0] / (1.0 + rate[1]))
    }
}

impl PointingLaw for LqgPointing {
    fn command(
        &mut self,
        hand_over: &mut HandOver,
        gimbal: &GimbalParams,
        input: &PointingInput,
    ) -> PointingOutput {
        let aim = Aim::new(gimbal, input, 0.0);
        let sky = DVec2::new(aim.cos_el, 1.0);
        let base_radps = DVec2::from_array(base_rate_on_axes(
            input.gimbal_az_el_rad.x,
            input.base_rate_radps,
        ));
        let in_space = input.gimbal_rates_radps + base_radps;
        let accel = DVec2::new(input.los.az_accel_radps2, input.los.el_accel_radps2);

        // Far off, the gain on the error gives way to the braking parabola.
        let slope = |i: usize| 1.0 + self.gains[i][0][1];
        let gains_per_s = self.gimbal_gains_per_s();
        let turned = hand_over.gimbal_rates(gimbal, gains_per_s, &aim, input.gimbal_rates_radps);
        let set = hand_over.mirror(aim.deflection_rad);

        let mut output = PointingOutput {
            gimbal: GimbalCommand::default(),
            mirror_rad: DVec2::ZERO,
        };
        for (i, axis) in [&gimbal.azimuth, &gimbal.elevation].into_iter().enumerate() {
            let observer = &mut self.axes[i];
            observer.correct(axis, self.observer, in_space[i], self.dt_s);
            let excess = input.gimbal_rates_radps[i] - aim.rates_radps[i];
            let mut x = [
                0.0,
                excess * sky[i],
                observer.drive_radps2 * sky[i],
                input.mirror_rad[i],
                input.mirror_rates_radps[i],
                accel[i] * sky[i],
            ];
            let apply = |row: &[f64; STATES], x: &[f64; STATES]| -> f64 {
                -row.iter().zip(x).map(|(k, x)| k * x).sum::<f64>()
            };
            let turn = slope(i) * (turned[i] - aim.rates_radps[i]);
            let rate = aim.rates_radps[i] + turn + apply(&self.gains[i][0], &x) / sky[i];
            let limit = axis.rate_limit_radps;
            let rate = rate.min(limit).max(-limit);
            output.gimbal.rate_radps[i] = rate;
            observer.last = Some(LastCommand {
                rate_radps: in_space[i],
                error_radps: rate - input.gimbal_rates_radps[i],
            });
            x[0] = set[i];
            output.mirror_rad[i] = apply(&self.gains[i][1], &x);
        }
        output
    }

    /// Keeps the disturbance, but not a last command that is no longer the last.
    fn rest(&mut self) {
        for axis in &mut self.axes {
            axis.last = None;
        }
    }

    /// Its mirror rows are gains of another kind.
    fn gains(&self) -> Vec<(&'static str, f64)> {
        let [az, el] = self.gimbal_gains_per_s();
        vec![("gimbal gain [1/s]", az.min(el))]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1.0 / 960.0;

    #[test]
    fn dare_of_a_scalar_and_of_a_double_integrator_are_the_closed_forms() {
        // p = a²p − a²b²p²/(r + b²p) + q: b²p² + (r − a²r − b²q)p − qr = 0.
        for (a, b, q, r) in [
            (1.2, 0.5, 2.0, 3.0),
            (0.9, 1.0, 1e-3, 10.0),
            (1.0, 1.0, 1.0, 1.0),
        ] {
            let one = |x: f64| DMatrix::from_element(1, 1, x);
            let p = solve_dare(&one(a), &one(b), &one(q), &one(r)).unwrap()[(0, 0)];
            let (b2, half): (f64, f64) = (b * b, 0.5 * (r - a * a * r - b * b * q));
            let expected = (-half + (half * half + b2 * q * r).sqrt()) / b2;
            assert!((p / expected - 1.0).abs() < 1e-12, "{p} {expected}");
        }
        // With all ones it is p² = p + 1: the golden ratio.
        let one = DMatrix::from_element(1, 1, 1.0);
        let golden = solve_dare(&one, &one, &one, &one).unwrap()[(0, 0)];
        assert!(
            (golden - 0.5 * (1.0 + 5f64.sqrt())).abs() < 1e-12,
            "{golden}"
        );

        // Double integrator x⁺ = x + v, v⁺ = v + u with Q = diag(1, 0): spectral factorisation of
        // r + 1/|(z − 1)²|² puts the poles at the roots inside the circle of
        // r (z − 1)²(z⁻¹ − 1)² + 1 = 0, so with s = z + 1/z − 2: r s² = −1.
        let (a, b) = (
            DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 0.0, 1.0]),
            DMatrix::from_row_slice(2, 1, &[0.0, 1.0]),
        );
        let q = DMatrix::from_row_slice(2, 2, &[1.0, 0.0, 0.0, 0.0]);
        for r in [0.1, 1.0, 50.0] {
            let rm = DMatrix::from_element(1, 1, r);
            let p = solve_dare(&a, &b, &q, &rm).unwrap();
            let k = lqr_gain(&a, &b, &rm, &p).unwrap();
            let poles = (&a - &b * k).complex_eigenvalues();
            for z in poles.iter() {
                let s = z + z.inv() - 2.0;
                assert!((s * s * r + 1.0).norm() < 1e-9, "{z}");
                assert!(z.norm() < 1.0);
            }
        }
    }

    #[test]
    fn an_unstabilisable_plant_is_refused() {
        let one = |x: f64| DMatrix::from_element(1, 1, x);
        assert!(solve_dare(&one(1.1), &one(0.0), &one(1.0), &one(1.0)).is_err());
    }

    fn closed(k: &[[f64; STATES]; INPUTS]) -> DMatrix<f64> {
        let (a, b) = axis_model(
            &GimbalParams::default().azimuth,
            &MirrorParams::default(),
            2.0,
            DT,
        )
        .unwrap();
        let k = DMatrix::from_fn(INPUTS, STATES, |i, j| k[i][j]);
        a - b * k
    }

    /// Σ xᵀ(Q + KᵀRK)x from an error of 1 mrad, the target accelerating.
    fn cost_of(k: &[[f64; STATES]; INPUTS]) -> f64 {
        let (q, r) = axis_cost(&LqgWeights::default());
        let gain = DMatrix::from_fn(INPUTS, STATES, |i, j| k[i][j]);
        let weight = q + gain.transpose() * r * &gain;
        let step = closed(k);
        let mut x = DVector::from_vec(vec![1e-3, 5e-3, 0.0, 0.0, 0.0, 1e-2]);
        let mut cost = 0.0;
        for _ in 0..20_000 {
            cost += (x.transpose() * &weight * &x)[(0, 0)];
            x = &step * x;
        }
        cost
    }

    #[test]
    fn regulator_is_stable_and_no_other_gain_is_cheaper() {
        let (gimbal, mirror) = (GimbalParams::default(), MirrorParams::default());
        let weights = LqgWeights::default();
        let k = axis_gain(&gimbal.azimuth, &mirror, 2.0, &weights, DT).unwrap();
        for pole in closed(&k).complex_eigenvalues().iter() {
            assert!(pole.norm() < 1.0, "{pole}");
        }
        let best = cost_of(&k);
        assert!(best.is_finite());
        // What a tenth more or less of each gain adds to the cost at least, about half of what it
        // does: nothing beyond rounding only for the gimbal's gains on the mirror.
        #[rustfmt::skip]
        let least = [
            [5e-6, 1e-8, 1.5e-8, -1e-12, -1e-12, 1.5e-10],
            [0.1, 6e-5, 5e-9, 1.5e-7, 5e-7, 6e-11],
        ];
        for i in 0..INPUTS {
            for j in 0..STATES {
                for factor in [0.9, 1.1] {
                    let mut other = k;
                    other[i][j] *= factor;
                    let rise = cost_of(&other) / best - 1.0;
                    assert!(rise > least[i][j], "{i} {j} {factor}: {rise:e}");
                }
            }
        }
        // The mirror takes up a standing error but for the weights' ratio; the gimbal turns to it.
        assert!(k[0][0] < 0.0 && k[1][0] < -0.9, "{k:?}");
    }

    #[test]
    fn observer_finds_a_constant_torque() {
        let mut gimbal = GimbalParams::default();
        gimbal.azimuth.cogging = None;
        let mut state = crate::mount::gimbal::GimbalState::default();
        let mut observer = Observer::default();
        for _ in 0..960 {
            let rate = state.azimuth.rate_radps;
            observer.correct(&gimbal.azimuth, 0.05, rate, DT);
            observer.last = Some(LastCommand {
                rate_radps: rate,
                error_radps: 0.1 - rate,
            });
            let command = GimbalCommand {
                rate_radps: [0.1, 0.0],
            };
            crate::mount::gimbal::step(&mut state, &gimbal, &command, [4.0, 0.0], DT);
        }
        // The rate is held, so servo and disturbance, friction included, cancel.
        assert!((state.azimuth.rate_radps - 0.1).abs() < 1e-6);
        assert!(observer.drive_radps2.abs() < 1e-4, "{observer:?}");
    }
}
