//! Flight dynamics of a multirotor under its autopilot.
//!
//! Rigid body with one first-order speed lag per rotor, thrust `k w^2`, reaction torque in
//! proportion, and the quadratic frame drag of eq. 6. The autopilot is the geometric tracking
//! controller on SE(3) of Lee, Leok and McClamroch (CDC 2010), with the attitude error of Lee (ACC
//! 2011), cascaded through a body-rate loop so that tilt, rate and speed can be limited.

use super::uav::UavModel;
use crate::maths::kinematics::GRAVITY_MPS2;
use glam::{DMat3, DQuat, DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// The most rotors an airframe may have.
pub const MAX_ROTORS: usize = 8;
const SEA_LEVEL_DENSITY_KGPM3: f64 = 1.225; // [kg/m^3], ISA
/// Static thrust and power coefficients of a small propeller (`T = C_T rho n^2 D^4`,
/// `P = C_P rho n^3 D^5`), typical of the UIUC propeller data.
const THRUST_COEFFICIENT: f64 = 0.10;
const POWER_COEFFICIENT: f64 = 0.045;
/// Lag of the autopilot's estimate of the drag it feels [s]; acts as the integral term of a usual
/// position loop does, and equally slowly.
const DRAG_ESTIMATE_LAG_S: f64 = 1.0; // [s]
/// The furthest the commanded heading leads the flown one [rad], so that a turn never takes the
/// attitude loop's authority from tilt.
const HEADING_LEAD_RAD: f64 = 0.5; // [rad]

/// State of a multirotor; rotors beyond the airframe's count stay zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MultirotorState {
    /// Position of the centre of mass [m, enu].
    pub r_enu_m: DVec3,
    /// Velocity over ground [m/s, enu].
    pub v_enu_mps: DVec3,
    /// Attitude: rotates a body (forward, left, up) vector into enu.
    pub q_enu_body: DQuat,
    /// Angular velocity [rad/s, body].
    pub omega_body_radps: DVec3,
    /// Rotor speeds, positive in each rotor's own sense [rad/s].
    pub rotor_speed_radps: [f64; MAX_ROTORS],
    /// Rotor angles about body up, in [0, 2 pi) [rad].
    pub rotor_phase_rad: [f64; MAX_ROTORS],
    /// The autopilot's estimate of drag over mass, from its accelerometer [m/s^2, enu].
    pub drag_estimate_enu_mps2: DVec3,
}

/// State that the autopilot follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setpoint {
    /// Position [m, enu].
    pub r_enu_m: DVec3,
    /// Velocity [m/s, enu].
    pub v_enu_mps: DVec3,
    /// Acceleration [m/s^2, enu].
    pub a_enu_mps2: DVec3,
    /// Compass heading of body forward, clockwise from north [rad].
    pub yaw_rad: f64,
}

/// Constants of flight derived once from a [`UavModel`].
#[derive(Clone, Debug)]
pub struct Airframe {
    /// Number of rotors.
    pub rotor_count: usize,
    /// Rotor hubs seen from the centre of mass: forward, left [m, body].
    pub rotor_arm_body_m: [DVec2; MAX_ROTORS],
    /// Sense of each rotor: +1 counter-clockwise seen from above, -1 clockwise.
    pub rotor_spin: [f64; MAX_ROTORS],
    /// Rotors that turn when driven; the autopilot does not know of one that no longer does.
    pub rotor_works: [bool; MAX_ROTORS],
    /// Rotor speed that hovers in sea-level air [rad/s].
    pub hover_rotor_speed_radps: f64,
    mass_kg: f64,
    inertia_kgm2: DVec3,
    /// Thrust over squared speed of one rotor in sea-level air [N s^2].
    thrust_k_ns2: f64,
    /// Reaction torque over thrust [m].
    torque_per_thrust_m: f64,
    rotor_speed_min_radps: f64,
    rotor_speed_max_radps: f64,
    rotor_lag_s: f64,
    drag_area_m2: f64,
    v_max_mps: f64,
    tan_max_tilt: f64,
    max_rate_radps: f64,
    /// Loop gains [1/s], inner to outer, spaced off the rotor lag.
    rate_gain_per_s: f64,
    attitude_gain_per_s: f64,
    velocity_gain_per_s: f64,
    position_gain_per_s: f64,
}

impl Airframe {
    /// The airframe of `model`: rotors evenly spaced on the motor circle, the front pair astride
    /// the nose, neighbours turning in opposite senses.
    pub fn new(model: &UavModel) -> Self {
        let n = model.rotor_count.min(MAX_ROTORS);
        let mut rotor_arm_body_m = [DVec2::ZERO; MAX_ROTORS];
        let mut rotor_spin = [0.0; MAX_ROTORS];
        for i in 0..n {
            let angle_rad = PI * (2 * i + 1) as f64 / n as f64;
            rotor_arm_body_m[i] = model.diagonal_m / 2.0 * DVec2::from_angle(angle_rad);
            rotor_spin[i] = if i % 2 == 0 { -1.0 } else { 1.0 };
        }
        let d_m = model.propeller_diameter_m;
        let thrust_k_ns2 = THRUST_COEFFICIENT * SEA_LEVEL_DENSITY_KGPM3 * d_m.powi(4) / (TAU * TAU);
        let hover_rotor_speed_radps =
            (model.mass_kg * GRAVITY_MPS2 / (n as f64 * thrust_k_ns2)).sqrt();
        // Loops on a lag T: the rate loop at gain 0.5/T is damped at 0.7; each loop further out is
        // about three times slower.
        let rate_gain_per_s = 0.5 / model.rotor_lag_s;
        let attitude_gain_per_s = 0.4 * rate_gain_per_s;
        let velocity_gain_per_s = (0.35 * attitude_gain_per_s).min(3.0); // [1/s]
        Self {
            rotor_count: n,
            rotor_arm_body_m,
            rotor_spin,
            rotor_works: [true; MAX_ROTORS],
            hover_rotor_speed_radps,
            mass_kg: model.mass_kg,
            inertia_kgm2: DVec3::from_array(model.inertia_kgm2),
            thrust_k_ns2,
            torque_per_thrust_m: POWER_COEFFICIENT * d_m / (TAU * THRUST_COEFFICIENT),
            rotor_speed_min_radps: 0.2 * hover_rotor_speed_radps, // idle, assumed
            rotor_speed_max_radps: hover_rotor_speed_radps * model.thrust_to_weight.sqrt(),
            rotor_lag_s: model.rotor_lag_s,
            drag_area_m2: model.drag_area_m2,
            v_max_mps: model.v_max_mps,
            tan_max_tilt: model.max_tilt_rad.tan(),
            max_rate_radps: model.max_rate_radps,
            rate_gain_per_s,
            attitude_gain_per_s,
            velocity_gain_per_s,
            position_gain_per_s: 0.4 * velocity_gain_per_s,
        }
    }

    /// Frame drag [N, enu] by eq. 6: `rho C_D A |u|^2 / 2` along the relative wind `u`.
    pub fn drag_enu_n(
        &self,
        v_enu_mps: DVec3,
        wind_enu_mps: DVec3,
        air_density_kgpm3: f64,
    ) -> DVec3 {
        let flow_enu_mps = wind_enu_mps - v_enu_mps;
        0.5 * air_density_kgpm3 * self.drag_area_m2 * flow_enu_mps.length() * flow_enu_mps
    }

    /// Thrust over squared speed of one rotor [N s^2] in air of the given density.
    fn thrust_k_ns2(&self, air_density_kgpm3: f64) -> f64 {
        self.thrust_k_ns2 * (air_density_kgpm3 / SEA_LEVEL_DENSITY_KGPM3)
    }

    /// The specific thrust [m/s^2, enu] nearest the one asked for that height, tilt and total
    /// thrust allow, in this order.
    fn allowed_thrust_enu_mps2(&self, wanted_enu_mps2: DVec3, thrust_k_ns2: f64) -> DVec3 {
        // A tenth of the thrust is kept back for the attitude loop.
        let most_mps2 =
            0.9 * self.rotor_count as f64 * thrust_k_ns2 * self.rotor_speed_max_radps.powi(2)
                / self.mass_kg;
        let up_mps2 = wanted_enu_mps2.z.clamp(
            0.3 * GRAVITY_MPS2,
            (0.9 * most_mps2).max(0.3 * GRAVITY_MPS2),
        );
        let side_mps2 = (most_mps2 * most_mps2 - up_mps2 * up_mps2).max(0.0).sqrt();
        wanted_enu_mps2
            .truncate()
            .clamp_length_max(side_mps2.min(self.tan_max_tilt * up_mps2))
            .extend(up_mps2)
    }

    /// The autopilot: rotor thrusts [N] that follow `setpoint`.
    fn control(
        &self,
        state: &MultirotorState,
        rotation: &DMat3,
        setpoint: &Setpoint,
        thrust_k_ns2: f64,
    ) -> [f64; MAX_ROTORS] {
        let v_wanted_enu_mps = (setpoint.v_enu_mps
            + self.position_gain_per_s * (setpoint.r_enu_m - state.r_enu_m))
            .clamp_length_max(self.v_max_mps);
        let thrust_enu_mps2 = self.allowed_thrust_enu_mps2(
            setpoint.a_enu_mps2 + self.velocity_gain_per_s * (v_wanted_enu_mps - state.v_enu_mps)
                - state.drag_estimate_enu_mps2
                + GRAVITY_MPS2 * DVec3::Z,
            thrust_k_ns2,
        );
        let heading = led_heading(rotation.x_axis.truncate(), heading(setpoint.yaw_rad));
        let wanted = attitude(thrust_enu_mps2, heading);

        // Attitude error 2 sin(angle/2) about the axis that turns the flown attitude into the
        // wanted one; it keeps growing up to a half turn.
        let twice_sine = rotation.x_axis.cross(wanted.x_axis)
            + rotation.y_axis.cross(wanted.y_axis)
            + rotation.z_axis.cross(wanted.z_axis);
        let trace = rotation.x_axis.dot(wanted.x_axis)
            + rotation.y_axis.dot(wanted.y_axis)
            + rotation.z_axis.dot(wanted.z_axis);
        let error_body = rotation.transpose() * twice_sine / (1.0 + trace).max(1e-3).sqrt();

        let rate_wanted = self.attitude_gain_per_s * error_body;
        let yaw_max_radps = 0.5 * self.max_rate_radps;
        let rate_wanted_radps = rate_wanted
            .truncate()
            .clamp_length_max(self.max_rate_radps)
            .extend((0.5 * rate_wanted.z).clamp(-yaw_max_radps, yaw_max_radps));
        let omega = state.omega_body_radps;
        let moment_body_nm = self.inertia_kgm2
            * (self.rate_gain_per_s * (rate_wanted_radps - omega))
            + omega.cross(self.inertia_kgm2 * omega);
        let force_n = self.mass_kg * thrust_enu_mps2.dot(rotation.z_axis);
        self.mix(force_n, moment_body_nm, thrust_k_ns2)
    }

    /// Rotor thrusts [N] for a total force and a moment. Where the rotors cannot give both, roll
    /// and pitch come first, then the force, then yaw.
    fn mix(&self, force_n: f64, moment_body_nm: DVec3, thrust_k_ns2: f64) -> [f64; MAX_ROTORS] {
        let n = self.rotor_count;
        let least_n = thrust_k_ns2 * self.rotor_speed_min_radps.powi(2);
        let most_n = thrust_k_ns2 * self.rotor_speed_max_radps.powi(2);
        // Evenly spaced rotors make the allocation's rows orthogonal, so its pseudo-inverse is its
        // transpose, scaled.
        let tilt_gain = 2.0 / (n as f64 * self.rotor_arm_body_m[0].length_squared());
        let mut tilt_n = [0.0; MAX_ROTORS];
        let (mut low_n, mut high_n) = (0.0_f64, 0.0_f64);
        for (tilt_n, arm) in tilt_n.iter_mut().zip(&self.rotor_arm_body_m).take(n) {
            *tilt_n = tilt_gain * (arm.y * moment_body_nm.x - arm.x * moment_body_nm.y);
            low_n = low_n.min(*tilt_n);
            high_n = high_n.max(*tilt_n);
        }
        let span_n = high_n - low_n;
        let scale = if span_n > most_n - least_n {
            (most_n - least_n) / span_n
        } else {
            1.0
        };
        let (low_n, high_n) = (low_n * scale, high_n * scale);
        let share_n = (force_n / n as f64)
            .max(least_n - low_n)
            .min(most_n - high_n);

        let yaw_n = (moment_body_nm.z / (n as f64 * self.torque_per_thrust_m)).abs();
        let yaw_sign = moment_body_nm.z.signum();
        let mut room_n = yaw_n;
        let mut thrust_n = [0.0; MAX_ROTORS];
        for i in 0..n {
            thrust_n[i] = share_n + scale * tilt_n[i];
            // The reaction on the body opposes the rotor's sense.
            let room = if -self.rotor_spin[i] * yaw_sign > 0.0 {
                most_n - thrust_n[i]
            } else {
                thrust_n[i] - least_n
            };
            room_n = room_n.min(room);
        }
        let yaw_n = yaw_sign * room_n.max(0.0);
        for (thrust_n, spin) in thrust_n.iter_mut().zip(&self.rotor_spin).take(n) {
            *thrust_n -= spin * yaw_n;
        }
        thrust_n
    }

    /// Force along body up [N] and moment [N m, body] of the rotors at their present speeds.
    fn rotor_wrench(&self, state: &MultirotorState, thrust_k_ns2: f64) -> (f64, DVec3) {
        let mut force_n = 0.0;
        let mut moment_body_nm = DVec3::ZERO;
        for i in 0..self.rotor_count {
            let thrust_n = thrust_k_ns2 * state.rotor_speed_radps[i].powi(2);
            force_n += thrust_n;
            moment_body_nm += thrust_n
                * DVec3::new(
                    self.rotor_arm_body_m[i].y,
                    -self.rotor_arm_body_m[i].x,
                    -self.rotor_spin[i] * self.torque_per_thrust_m,
                );
        }
        (force_n, moment_body_nm)
    }
}

impl MultirotorState {
    /// Compass heading of body forward, clockwise from north [rad].
    pub fn yaw_rad(&self) -> f64 {
        let forward_enu = self.q_enu_body * DVec3::X;
        forward_enu.x.atan2(forward_enu.y)
    }

    /// The state that flies `setpoint` in a steady wind [m/s, enu] without transient: attitude and
    /// rotors hold its acceleration against weight and drag, within the airframe's limits.
    pub fn trimmed(
        airframe: &Airframe,
        setpoint: &Setpoint,
        wind_enu_mps: DVec3,
        air_density_kgpm3: f64,
    ) -> Self {
        let thrust_k_ns2 = airframe.thrust_k_ns2(air_density_kgpm3);
        let drag_estimate_enu_mps2 =
            airframe.drag_enu_n(setpoint.v_enu_mps, wind_enu_mps, air_density_kgpm3)
                / airframe.mass_kg;
        let thrust_enu_mps2 = airframe.allowed_thrust_enu_mps2(
            setpoint.a_enu_mps2 - drag_estimate_enu_mps2 + GRAVITY_MPS2 * DVec3::Z,
            thrust_k_ns2,
        );
        let n = airframe.rotor_count;
        let share_n = airframe.mass_kg * thrust_enu_mps2.length() / n as f64;
        let mut rotor_speed_radps = [0.0; MAX_ROTORS];
        rotor_speed_radps[..n].fill((share_n / thrust_k_ns2).sqrt());
        Self {
            r_enu_m: setpoint.r_enu_m,
            v_enu_mps: setpoint.v_enu_mps,
            q_enu_body: DQuat::from_mat3(&attitude(thrust_enu_mps2, heading(setpoint.yaw_rad))),
            omega_body_radps: DVec3::ZERO,
            rotor_speed_radps,
            rotor_phase_rad: [0.0; MAX_ROTORS],
            drag_estimate_enu_mps2,
        }
    }
}

/// Horizontal unit vector (east, north) of a compass heading [rad].
fn heading(yaw_rad: f64) -> DVec2 {
    let (sin, cos) = yaw_rad.sin_cos();
    DVec2::new(sin, cos)
}

/// `wanted` heading, brought within the lead of the flown one (any length, east and north).
fn led_heading(flown: DVec2, wanted: DVec2) -> DVec2 {
    let length = flown.length();
    // Near the vertical the nose has no heading to lead.
    if length < 0.1 || flown.dot(wanted) >= HEADING_LEAD_RAD.cos() * length {
        return wanted;
    }
    let sense = if flown.perp_dot(wanted) < 0.0 {
        -1.0
    } else {
        1.0
    };
    DVec2::from_angle(sense * HEADING_LEAD_RAD).rotate(flown / length)
}

/// Body axes [enu columns] whose up axis lies along `thrust_enu` and whose nose points to
/// `heading`, as Lee, Leok and McClamroch construct them.
fn attitude(thrust_enu: DVec3, heading: DVec2) -> DMat3 {
    let up = thrust_enu.normalize_or(DVec3::Z);
    let left = up.cross(heading.extend(0.0)).normalize_or(DVec3::Y);
    DMat3::from_cols(left.cross(up), left, up)
}

/// Advances a multirotor whose rotors an autopilot outside drives by `dt_s` [s]; `throttle` is the share of its fastest
/// speed that each rotor is to turn at, 0 to 1, in the order of [`Airframe::rotor_arm_body_m`].
pub fn step_rotors(
    airframe: &Airframe,
    state: &mut MultirotorState,
    throttle: &[f64; MAX_ROTORS],
    wind_enu_mps: DVec3,
    air_density_kgpm3: f64,
    dt_s: f64,
) {
    let wanted_radps = throttle.map(|share| share.clamp(0.0, 1.0) * airframe.rotor_speed_max_radps);
    advance(
        airframe,
        state,
        &wanted_radps,
        wind_enu_mps,
        air_density_kgpm3,
        dt_s,
    );
}

/// Advances a multirotor under its autopilot by `dt_s` [s] in wind `wind_enu_mps` [m/s, enu] and
/// air of density `air_density_kgpm3` [kg/m^3].
pub fn step(
    airframe: &Airframe,
    state: &mut MultirotorState,
    setpoint: &Setpoint,
    wind_enu_mps: DVec3,
    air_density_kgpm3: f64,
    dt_s: f64,
) {
    let thrust_k_ns2 = airframe.thrust_k_ns2(air_density_kgpm3);
    let rotation = DMat3::from_quat(state.q_enu_body);
    let thrust_n = airframe.control(state, &rotation, setpoint, thrust_k_ns2);

    let mut wanted_radps = [0.0; MAX_ROTORS];
    for (wanted_radps, thrust_n) in wanted_radps.iter_mut().zip(thrust_n) {
        *wanted_radps = (thrust_n / thrust_k_ns2).max(0.0).sqrt();
    }
    advance(
        airframe,
        state,
        &wanted_radps,
        wind_enu_mps,
        air_density_kgpm3,
        dt_s,
    );
}

/// The airframe's own motion over one tick, its rotors driven towards `wanted_radps` [rad/s].
fn advance(
    airframe: &Airframe,
    state: &mut MultirotorState,
    wanted_radps: &[f64; MAX_ROTORS],
    wind_enu_mps: DVec3,
    air_density_kgpm3: f64,
    dt_s: f64,
) {
    let thrust_k_ns2 = airframe.thrust_k_ns2(air_density_kgpm3);
    let up_enu = state.q_enu_body * DVec3::Z;
    let approach = -(-dt_s / airframe.rotor_lag_s).exp_m1();
    for (i, wanted_radps) in wanted_radps.iter().enumerate().take(airframe.rotor_count) {
        let speed_radps = &mut state.rotor_speed_radps[i];
        let driven_radps = if airframe.rotor_works[i] {
            *wanted_radps
        } else {
            0.0
        };
        *speed_radps += approach * (driven_radps - *speed_radps);
        let phase_rad = state.rotor_phase_rad[i] + airframe.rotor_spin[i] * *speed_radps * dt_s;
        state.rotor_phase_rad[i] = phase_rad - TAU * (phase_rad / TAU).floor();
    }

    let (force_n, moment_body_nm) = airframe.rotor_wrench(state, thrust_k_ns2);
    let drag_enu_n = airframe.drag_enu_n(state.v_enu_mps, wind_enu_mps, air_density_kgpm3);
    state.drag_estimate_enu_mps2 += dt_s / (DRAG_ESTIMATE_LAG_S + dt_s)
        * (drag_enu_n / airframe.mass_kg - state.drag_estimate_enu_mps2);
    let a_enu_mps2 = (force_n * up_enu + drag_enu_n) / airframe.mass_kg - GRAVITY_MPS2 * DVec3::Z;
    state.r_enu_m += dt_s * (state.v_enu_mps + 0.5 * dt_s * a_enu_mps2);
    state.v_enu_mps += dt_s * a_enu_mps2;
    rotate(state, airframe.inertia_kgm2, moment_body_nm, dt_s);
}

/// Euler's equations over one tick by the midpoint rule, and the attitude by the exponential map.
fn rotate(state: &mut MultirotorState, inertia_kgm2: DVec3, moment_body_nm: DVec3, dt_s: f64) {
    let alpha = |omega: DVec3| {
        (moment_body_nm - omega.cross(inertia_kgm2 * omega)) / inertia_kgm2 // [rad/s^2]
    };
    let middle = state.omega_body_radps + 0.5 * dt_s * alpha(state.omega_body_radps);
    state.omega_body_radps += dt_s * alpha(middle);
    // Half-angle sine and cosine by series: the angle of a tick is a few hundredths of a radian.
    let half = 0.5 * dt_s * middle;
    let square = half.length_squared();
    let vector = half * (1.0 - square / 6.0 * (1.0 - square / 20.0));
    let scalar = 1.0 - square / 2.0 * (1.0 - square / 12.0);
    let turn = DQuat::from_xyzw(vector.x, vector.y, vector.z, scalar);
    state.q_enu_body = (state.q_enu_body * turn).normalize();
}

#[cfg(test)]
mod tests;
