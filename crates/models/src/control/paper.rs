//! The paper's PID laws (eqs. 9 and 10).
//!
//! Signs: a tracking error is the target's angle from the boresight, x right and y down positive
//! (see [`crate::optics::camera`]), so `u` has the sign of the turn that removes it. In the printed
//! quaternion updates the pure quaternion is [0, u_y, u_x]: a turn u_y about the camera's x axis and
//! u_x about its y axis, no roll. About `cam` (y down) a positive turn about x looks *up*, so the
//! rotation vector used here is (−u_y, u_x, 0).
//!
//! The paper sets the camera's attitude directly, without dynamics. Boresight computes that very
//! attitude, by the printed quaternion update, and gives it to real servos: of eq. 9 the gimbal gets
//! the rates that reach it within one frame ([`coarse_axis_rates`]), of eq. 10 the mirror the
//! deflection that looks there ([`precise_mirror`]). An update may also roll the camera a little about
//! its axis; a two-axis mount cannot follow that, and the boresight does not need it.
//!
//! The paper prints no unit for the error; eqs. 9 and 10 are used in radians. Note that eq. 10
//! multiplies by Δt in its attitude update while eq. 9 does not: with Δt in seconds the precise loop
//! has a bandwidth of 0.005 rad/s, a time constant of 200 s. With Δt = 1 (one frame) it is the
//! counterpart of eq. 9: 0.6 rad/s at 120 Hz, beside 0.9 rad/s of the coarse loop at 60 Hz.

use glam::{DQuat, DVec2, DVec3};

use super::law::deflection_to;
use crate::maths::kinematics::{boresight_chain, exp_so3, los_to_az_el, wrap_pi};

/// The saturation function of eq. 10, per component.
pub fn sat(e: DVec2, limit: f64) -> DVec2 {
    e.min(DVec2::splat(limit)).max(DVec2::splat(-limit))
}

/// The paper's control law (eq. 9, and eq. 10 with a saturation).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperLaw {
    /// Proportional gain Kp.
    pub kp: f64,
    /// Integral gain Ki [1/s].
    pub ki_per_s: f64,
    /// Derivative gain Kd [s].
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

/// Gimbal rates, azimuth (x) and elevation (y) [rad/s], that turn the coarse camera from where it is
/// to eq. 9's new attitude within one frame; `u_rad` is x right, y down.
pub fn coarse_axis_rates(az_el_rad: DVec2, u_rad: DVec2, frame_rate_hz: f64) -> DVec2 {
    let updated = coarse_attitude_update(look(az_el_rad, DVec2::ZERO), u_rad);
    let turn = los_to_az_el(updated * DVec3::Z) - az_el_rad;
    DVec2::new(wrap_pi(turn.x), turn.y) * frame_rate_hz
}

/// Mirror deflection, right (x) and up (y) [rad], with which the precise camera looks along eq. 10's
/// new attitude; `u_radps` is x right, y down.
pub fn precise_mirror(az_el_rad: DVec2, mirror_rad: DVec2, u_radps: DVec2, dt_s: f64) -> DVec2 {
    let updated = precise_attitude_update(look(az_el_rad, mirror_rad), u_radps, dt_s);
    deflection_to(updated * DVec3::Z, az_el_rad)
}

/// Attitude of a camera on a level base.
fn look(az_el_rad: DVec2, mirror_rad: DVec2) -> DQuat {
    let [az, el] = az_el_rad.to_array();
    boresight_chain(DVec3::ZERO, DVec3::ZERO, az, el, mirror_rad, DVec3::ZERO).q_enu_cam
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::kinematics::error_angles;

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
        let q = look(DVec2::new(0.4, 0.3), DVec2::ZERO);
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
    fn servos_are_sent_to_the_printed_attitudes() {
        let (at, hz) = (DVec2::new(0.2, 0.5), 60.0);
        // Large enough that a linear split over the axes would miss by 4 mrad.
        let u = DVec2::new(0.1, -0.05);
        let rates = coarse_axis_rates(at, u, hz);
        let wanted = coarse_attitude_update(look(at, DVec2::ZERO), u);
        let reached = look(at + rates / hz, DVec2::ZERO);
        assert!((reached * DVec3::Z - wanted * DVec3::Z).length() < 1e-14);
        let linear = DVec2::new(u.x / at.y.cos(), -u.y) * hz;
        assert!((rates - linear).length() / hz > 4e-3);
        // To first order it is that split.
        let small = coarse_axis_rates(at, 1e-4 * u, hz) - 1e-4 * linear;
        assert!(small.length() / hz < 1e-9);

        let (mirror, dt) = (DVec2::new(1e-3, -2e-3), 1.0 / 120.0);
        let u = DVec2::new(0.03, -0.06);
        let set = precise_mirror(at, mirror, u, dt);
        let wanted = precise_attitude_update(look(at, mirror), u, dt);
        assert!((look(at, set) * DVec3::Z - wanted * DVec3::Z).length() < 1e-14);
        // The image's down is the mirror's −y.
        assert!((set - mirror - DVec2::new(u.x, -u.y) * dt).length() < 1e-8);
    }
}
