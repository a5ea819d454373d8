//! PID laws: a general one with anti-windup, and the paper's (eqs. 9 and 10).
//!
//! Signs: a tracking error is the target's angle from the boresight, x right and y down positive
//! (see [`crate::models::camera`]), so `u` has the sign of the turn that removes it. In the printed
//! quaternion updates the pure quaternion is [0, u_y, u_x]: a turn u_y about the camera's x axis and
//! u_x about its y axis, no roll. About `cam` (y down) a positive turn about x looks *up*, so the
//! rotation vector used here is (−u_y, u_x, 0).
//!
//! The paper sets the camera's attitude directly, without dynamics. Boresight hands the same
//! increment to a real servo: [`increment_to_axis_rates`] times the frame rate is the rate command
//! that makes the increment happen within one frame.
//!
//! The paper prints no unit for the error; eqs. 9 and 10 are used in radians. Note that eq. 10
//! multiplies by Δt in its attitude update while eq. 9 does not: with Δt in seconds the precise loop
//! has a bandwidth of 0.005 rad/s, a time constant of 200 s. With Δt = 1 (one frame) it is the
//! counterpart of eq. 9: 0.6 rad/s at 120 Hz, beside 0.9 rad/s of the coarse loop at 60 Hz.

use glam::{DQuat, DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::models::kinematics::exp_so3;

/// Gains and limits of a general PID controller.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct PidParams {
    /// Proportional gain [output/input].
    pub kp: f64,
    /// Integral gain [output/(input s)].
    pub ki_per_s: f64,
    /// Derivative gain, acting on the measurement [output s/input].
    pub kd_s: f64,
    /// Time constant of the derivative's first-order filter [s]; zero for the bare difference.
    pub derivative_tau_s: f64,
    /// Output limit to each side.
    pub output_limit: f64,
}

/// A general PID controller: derivative on the filtered measurement, conditional integration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pid {
    integral: f64,
    filtered: Option<f64>,
}

impl Pid {
    /// One step of `dt_s`; returns the limited output.
    pub fn step(&mut self, params: &PidParams, setpoint: f64, measurement: f64, dt_s: f64) -> f64 {
        let error = setpoint - measurement;
        let before = self.filtered.unwrap_or(measurement);
        // e^{−dt/τ} → 0 as τ → 0: the bare difference is the same formula.
        let blend = -(-dt_s / params.derivative_tau_s.max(f64::MIN_POSITIVE)).exp_m1();
        let filtered = before + blend * (measurement - before);
        self.filtered = Some(filtered);
        let grown = self.integral + params.ki_per_s * error * dt_s;
        let rest = params.kp * error - params.kd_s * (filtered - before) / dt_s;
        let wanted = rest + grown;
        let output = wanted.min(params.output_limit).max(-params.output_limit);
        // Integrate unless saturated in the direction the error pushes.
        if output == wanted || params.ki_per_s * error * (wanted - output) < 0.0 {
            self.integral = grown;
        }
        output
    }
}

/// The saturation function of eq. 10, per component.
pub fn sat(e: DVec2, limit: f64) -> DVec2 {
    e.min(DVec2::splat(limit)).max(DVec2::splat(-limit))
}

/// The paper's control law (eq. 9, and eq. 10 with a saturation).
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct PaperLaw {
    /// Kp.
    pub kp: f64,
    /// Ki [1/s].
    pub ki_per_s: f64,
    /// Kd [s].
    pub kd_s: f64,
    /// Limit of sat(e) in the proportional term [rad]; `None` is eq. 9. Not printed in the paper.
    pub sat_rad: Option<f64>,
}

impl PaperLaw {
    /// Eq. 9 with its printed gains (coarse camera).
    pub const COARSE: Self = Self {
        kp: 0.015,
        ki_per_s: 0.002,
        kd_s: 0.001,
        sat_rad: None,
    };
    /// Eq. 10 with its printed gains (precise camera). The limit is ours: a quarter of the printed
    /// 30° field.
    pub const PRECISE: Self = Self {
        kp: 0.005,
        ki_per_s: 0.0005,
        kd_s: 0.001,
        sat_rad: Some(std::f64::consts::PI / 24.0),
    };
}

/// Memory of the paper's law: ∫e dτ and the last error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PaperPid {
    integral_rad_s: DVec2,
    previous_rad: Option<DVec2>,
}

impl PaperPid {
    /// u of eqs. 9 and 10 for the error angles (x right, y down) [rad] of one frame of `dt_s`.
    pub fn step(&mut self, law: &PaperLaw, error_rad: DVec2, dt_s: f64) -> DVec2 {
        self.integral_rad_s += error_rad * dt_s;
        let slope = (error_rad - self.previous_rad.unwrap_or(error_rad)) / dt_s;
        self.previous_rad = Some(error_rad);
        let proportional = law.sat_rad.map_or(error_rad, |limit| sat(error_rad, limit));
        law.kp * proportional + law.ki_per_s * self.integral_rad_s + law.kd_s * slope
    }
}

/// Rotation vector in `cam` of a control output (x right, y down), see the module's sign note.
fn turn_cam(u: DVec2) -> DVec3 {
    DVec3::new(-u.y, u.x, 0.0)
}

/// Eq. 9's attitude update q ← q·exp(½[0, u_y, u_x]) of a camera attitude, `u` in radians.
pub fn coarse_attitude_update(q_enu_cam: DQuat, u_rad: DVec2) -> DQuat {
    (q_enu_cam * exp_so3(turn_cam(u_rad))).normalize()
}

/// Eq. 10's attitude update q ← q·(I + Δt/2·Ω(u)), renormalised: first order in `u_radps · dt_s`.
///
/// Ω(u) is the 4 × 4 matrix of the quaternion product with [0, u]; the paper prints the 3 × 3
/// cross-product matrix, which cannot act on a quaternion.
pub fn precise_attitude_update(q_enu_cam: DQuat, u_radps: DVec2, dt_s: f64) -> DQuat {
    let half = 0.5 * dt_s * turn_cam(u_radps);
    (q_enu_cam + q_enu_cam * DQuat::from_xyzw(half.x, half.y, half.z, 0.0)).normalize()
}

/// Gimbal rates [azimuth, elevation] [rad/s] that perform the attitude increment `u_rad` (x right,
/// y down) once per frame: azimuth turns by u_x/cos el and elevation by −u_y.
pub fn increment_to_axis_rates(u_rad: DVec2, frame_rate_hz: f64, el_rad: f64) -> [f64; 2] {
    // Near the zenith azimuth loses its grip; 85° is the mount's upper stop.
    let cos_el = el_rad.cos().max(0.05);
    [u_rad.x * frame_rate_hz / cos_el, -u_rad.y * frame_rate_hz]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::kinematics::{boresight_chain, error_angles};

    #[test]
    fn paper_law_is_eqs_9_and_10() {
        let dt = 1.0 / 60.0;
        let mut pid = PaperPid::default();
        let errors = [
            DVec2::new(0.02, -0.01),
            DVec2::new(0.03, -0.02),
            DVec2::new(0.01, 0.05),
        ];
        let mut sum = DVec2::ZERO;
        for (k, e) in errors.into_iter().enumerate() {
            sum += e * dt;
            let slope = if k == 0 {
                DVec2::ZERO
            } else {
                (e - errors[k - 1]) / dt
            };
            let u = pid.step(&PaperLaw::COARSE, e, dt);
            let expected = 0.015 * e + 0.002 * sum + 0.001 * slope;
            assert!((u - expected).length() < 1e-17);
        }
        // Eq. 10 saturates the proportional term only.
        let limit = PaperLaw::PRECISE.sat_rad.unwrap();
        let u = PaperPid::default().step(&PaperLaw::PRECISE, DVec2::new(1.0, -0.01), dt);
        assert!((u.x - (0.005 * limit + 0.0005 * dt)).abs() < 1e-17);
        assert!((u.y + 0.005 * 0.01 + 0.0005 * 0.01 * dt).abs() < 1e-17);
        assert_eq!(sat(DVec2::new(2.0, -3.0), 1.0), DVec2::new(1.0, -1.0));
    }

    #[test]
    fn attitude_updates_turn_towards_the_target_and_agree_to_third_order() {
        let q =
            boresight_chain(DVec3::ZERO, DVec3::ZERO, 0.4, 0.3, DVec2::ZERO, DVec3::ZERO).q_enu_cam;
        // A target 2 mrad right and 1 mrad down leaves no error after its own increment.
        let u = DVec2::new(2e-3, 1e-3);
        let target = q * DVec3::new(u.x.tan(), u.y.tan(), 1.0).normalize();
        assert!((error_angles(q, target) - u).length() < 1e-15);
        let turned = coarse_attitude_update(q, u);
        assert!(error_angles(turned, target).length() < 3e-9);
        assert!(turned.angle_between(q * exp_so3(DVec3::new(-u.y, u.x, 0.0))) < 1e-15);
        // q(1 + x) normalised turns by 2 atan(θ/2): short of θ by θ³/12.
        let dt = 0.01;
        let first_order = precise_attitude_update(q, u / dt, dt);
        assert!(first_order.angle_between(turned) < 1.1 * u.length().powi(3) / 12.0);
        let big = DVec2::new(0.3, 0.0);
        let gap =
            precise_attitude_update(q, big / dt, dt).angle_between(coarse_attitude_update(q, big));
        assert!((gap - (0.3 - 2.0 * 0.15f64.atan())).abs() < 1e-8);
    }

    #[test]
    fn increments_become_rates_that_perform_them() {
        let (az, el, hz) = (0.2, 0.5, 60.0);
        let u = DVec2::new(1e-3, -2e-3);
        let [az_rate, el_rate] = increment_to_axis_rates(u, hz, el);
        let look = |az, el| {
            boresight_chain(DVec3::ZERO, DVec3::ZERO, az, el, DVec2::ZERO, DVec3::ZERO).q_enu_cam
        };
        let after = look(az + az_rate / hz, el + el_rate / hz) * DVec3::Z;
        assert!((error_angles(look(az, el), after) - u).length() < 3e-6);
    }

    #[test]
    fn pid_unwinds_at_once_and_filters_the_measurement() {
        let params = PidParams {
            kp: 2.0,
            ki_per_s: 5.0,
            kd_s: 0.0,
            derivative_tau_s: 0.0,
            output_limit: 1.0,
        };
        let mut pid = Pid::default();
        for _ in 0..1000 {
            assert_eq!(pid.step(&params, 10.0, 0.0, 0.01), 1.0);
        }
        // No windup: the first small negative error takes the output off the limit.
        assert!(pid.step(&params, -0.1, 0.0, 0.01) < 0.0);

        // A ramp of slope 3 through the derivative filter: −kd·3·(1 − e^{−t/τ}).
        let params = PidParams {
            kp: 0.0,
            ki_per_s: 0.0,
            kd_s: 0.5,
            derivative_tau_s: 0.1,
            output_limit: 100.0,
        };
        let (mut pid, dt) = (Pid::default(), 1e-4);
        let mut output = 0.0;
        for k in 0..=1000 {
            output = pid.step(&params, 0.0, 3.0 * f64::from(k) * dt, dt);
        }
        let expected = -1.5 * (1.0 - (-1.0f64).exp());
        assert!((output - expected).abs() < 1e-3, "{output}");
    }

    #[test]
    fn pid_on_a_first_order_plant_reaches_the_setpoint() {
        // x' = u − x with Kp = 2, Ki = 4: poles of s² + 3s + 4, no steady error.
        let params = PidParams {
            kp: 2.0,
            ki_per_s: 4.0,
            kd_s: 0.0,
            derivative_tau_s: 0.0,
            output_limit: 10.0,
        };
        let (mut pid, mut x, dt) = (Pid::default(), 0.0, 1e-4);
        for k in 1..=100_000 {
            let u = pid.step(&params, 1.0, x, dt);
            x += dt * (u - x);
            if k == 5000 {
                // Closed form at t = 0.5: y = 1 − e^{−1.5t}(cos wt − (0.5/w) sin wt), w = √7/2.
                let w = 7f64.sqrt() / 2.0;
                let y = 1.0 - (-0.75f64).exp() * ((0.5 * w).cos() - 0.5 / w * (0.5 * w).sin());
                assert!((x - y).abs() < 1e-3, "{x} {y}");
            }
        }
        assert!((x - 1.0).abs() < 1e-6);
    }
}
