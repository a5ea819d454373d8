//! Flight dynamics of a multirotor under its autopilot.
//!
//! Rigid body with one first-order speed lag per rotor, thrust `k w^2`, reaction torque in
//! proportion, and the quadratic frame drag of eq. 6. The autopilot is the geometric tracking
//! controller on SE(3) of Lee, Leok and McClamroch (CDC 2010), with the attitude error of Lee (ACC
//! 2011), cascaded through a body-rate loop so that tilt, rate and speed limits have a place.

use super::kinematics::GRAVITY_MPS2;
use super::uav::UavModel;
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
/// position loop does, and as slowly.
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

/// What the autopilot is asked to follow.
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
        *speed_radps += approach * (wanted_radps - *speed_radps);
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
mod tests {
    use super::*;
    use crate::models::uav::{self, UavKind};

    const DT_S: f64 = 1.0 / 960.0; // [s]
    const RHO: f64 = SEA_LEVEL_DENSITY_KGPM3;

    fn hover_at(r_enu_m: DVec3, yaw_rad: f64) -> Setpoint {
        Setpoint {
            r_enu_m,
            v_enu_mps: DVec3::ZERO,
            a_enu_mps2: DVec3::ZERO,
            yaw_rad,
        }
    }

    fn airframe(kind: UavKind) -> Airframe {
        Airframe::new(uav::model(kind))
    }

    #[test]
    fn hover_rotor_speed_is_the_real_one() {
        // A Phantom 4 hovers near 5500 rpm.
        let rpm = airframe(UavKind::Phantom4).hover_rotor_speed_radps * 60.0 / TAU;
        assert!((4800.0..6200.0).contains(&rpm), "{rpm}");
    }

    #[test]
    fn trim_faces_its_heading_and_stays() {
        for kind in UavKind::ALL {
            let airframe = airframe(kind);
            let setpoint = hover_at(DVec3::new(3.0, -4.0, 50.0), 0.6);
            let mut state = MultirotorState::trimmed(&airframe, &setpoint, DVec3::ZERO, RHO);
            let nose = state.q_enu_body * DVec3::X;
            assert!((nose - DVec3::new(0.6_f64.sin(), 0.6_f64.cos(), 0.0)).length() < 1e-12);
            for _ in 0..20 * 960 {
                step(&airframe, &mut state, &setpoint, DVec3::ZERO, RHO, DT_S);
                assert!((state.r_enu_m - setpoint.r_enu_m).length() < 1e-6);
            }
            assert!(
                (state.rotor_speed_radps[0] / airframe.hover_rotor_speed_radps - 1.0).abs() < 1e-9
            );
        }
    }

    #[test]
    fn hover_settles_within_a_centimetre() {
        for kind in UavKind::ALL {
            let airframe = airframe(kind);
            let mut state = MultirotorState::trimmed(
                &airframe,
                &hover_at(DVec3::new(0.0, 0.0, 50.0), 0.0),
                DVec3::ZERO,
                RHO,
            );
            let setpoint = hover_at(DVec3::new(5.0, -3.0, 52.0), 2.5);
            for k in 0..30 * 960 {
                step(&airframe, &mut state, &setpoint, DVec3::ZERO, RHO, DT_S);
                if k >= 15 * 960 {
                    assert!((state.r_enu_m - setpoint.r_enu_m).length() < 0.01);
                }
            }
            let nose = state.q_enu_body * DVec3::X;
            assert!((nose - heading(2.5).extend(0.0)).length() < 1e-3);
        }
    }

    #[test]
    fn tops_out_at_the_published_speed_and_tilt() {
        for kind in UavKind::ALL {
            let model = uav::model(kind);
            let airframe = Airframe::new(model);
            let v_asked_enu_mps = DVec3::new(0.0, 2.0 * model.v_max_mps, 0.0);
            let mut setpoint = hover_at(DVec3::new(0.0, 0.0, 50.0), 0.0);
            let mut state = MultirotorState::trimmed(&airframe, &setpoint, DVec3::ZERO, RHO);
            setpoint.v_enu_mps = v_asked_enu_mps;
            for _ in 0..60 * 960 {
                setpoint.r_enu_m += DT_S * v_asked_enu_mps;
                step(&airframe, &mut state, &setpoint, DVec3::ZERO, RHO, DT_S);
                assert!(state.v_enu_mps.length() < 1.05 * model.v_max_mps);
            }
            let tilt_rad = (state.q_enu_body * DVec3::Z).angle_between(DVec3::Z);
            assert!(
                (state.v_enu_mps.y / model.v_max_mps - 1.0).abs() < 0.05,
                "{} {}",
                model.name,
                state.v_enu_mps
            );
            assert!(
                (tilt_rad / model.max_tilt_rad - 1.0).abs() < 0.05,
                "{}",
                model.name
            );
            assert!(
                (state.r_enu_m.z - 50.0).abs() < 0.5,
                "{} {}",
                model.name,
                state.r_enu_m
            );
        }
    }

    #[test]
    fn recovers_from_upsets() {
        for kind in UavKind::ALL {
            for (angle_deg, axis) in [
                (30.0_f64, DVec3::X),
                (30.0, DVec3::Y),
                (120.0, DVec3::new(0.6, 0.8, 0.0)),
            ] {
                let airframe = airframe(kind);
                let setpoint = hover_at(DVec3::new(0.0, 0.0, 50.0), 0.0);
                let mut state = MultirotorState::trimmed(&airframe, &setpoint, DVec3::ZERO, RHO);
                state.q_enu_body *= DQuat::from_axis_angle(axis, angle_deg.to_radians());
                for k in 0..12 * 960 {
                    step(&airframe, &mut state, &setpoint, DVec3::ZERO, RHO, DT_S);
                    if k == 960 {
                        let up = state.q_enu_body * DVec3::Z;
                        let limit_rad = uav::model(kind).max_tilt_rad;
                        assert!(
                            up.angle_between(DVec3::Z) < limit_rad,
                            "{kind:?} {angle_deg}"
                        );
                    }
                }
                let error_m = (state.r_enu_m - setpoint.r_enu_m).length();
                assert!(error_m < 0.01, "{kind:?} {angle_deg} {error_m}");
            }
        }
    }

    #[test]
    fn holds_against_a_steady_wind() {
        let airframe = airframe(UavKind::Phantom4);
        let setpoint = hover_at(DVec3::new(0.0, 0.0, 50.0), 0.0);
        let mut state = MultirotorState::trimmed(&airframe, &setpoint, DVec3::ZERO, RHO);
        let wind_enu_mps = DVec3::new(10.0, 0.0, 0.0);
        for _ in 0..20 * 960 {
            step(&airframe, &mut state, &setpoint, wind_enu_mps, RHO, DT_S);
        }
        assert!((state.r_enu_m - setpoint.r_enu_m).length() < 0.01);
        // Drag 0.5 * 1.225 * 0.0498 * 100 = 3.050 N against a weight of 13.533 N.
        let tilt_rad = (state.q_enu_body * DVec3::Z).angle_between(DVec3::Z);
        assert!((tilt_rad.tan() - 3.050_25 / 13.533_18).abs() < 1e-4);
        let trimmed = MultirotorState::trimmed(&airframe, &setpoint, wind_enu_mps, RHO);
        assert!(trimmed.q_enu_body.angle_between(state.q_enu_body) < 1e-4);
    }

    #[test]
    fn mixer_inverts_the_wrench_and_gives_up_yaw_first() {
        for kind in [UavKind::Phantom4, UavKind::Matrice600] {
            let airframe = airframe(kind);
            let k = airframe.thrust_k_ns2(RHO);
            let wrench = |thrust_n: [f64; MAX_ROTORS]| {
                let mut state = MultirotorState::trimmed(
                    &airframe,
                    &hover_at(DVec3::ZERO, 0.0),
                    DVec3::ZERO,
                    RHO,
                );
                state.rotor_speed_radps = thrust_n.map(|t| (t / k).sqrt());
                airframe.rotor_wrench(&state, k)
            };
            let weight_n = airframe.mass_kg * GRAVITY_MPS2;
            let arm_m = airframe.rotor_arm_body_m[0].length();
            let wanted = DVec3::new(0.1, -0.05, 0.01) * weight_n * arm_m;
            let (force_n, moment) = wrench(airframe.mix(weight_n, wanted, k));
            assert!((force_n / weight_n - 1.0).abs() < 1e-12);
            assert!((moment - wanted).length() < 1e-12 * weight_n);
            // An impossible yaw moment leaves force, roll and pitch alone.
            let greedy = DVec3::new(wanted.x, wanted.y, 10.0 * weight_n);
            let (force_n, moment) = wrench(airframe.mix(weight_n, greedy, k));
            assert!((force_n / weight_n - 1.0).abs() < 1e-12);
            assert!((moment - greedy).truncate().length() < 1e-12 * weight_n);
            assert!(moment.z > 0.0 && moment.z < greedy.z);
            // An impossible roll moment keeps its direction and every rotor its limits.
            let thrust_n = airframe.mix(weight_n, DVec3::new(10.0, 5.0, 1.0) * weight_n, k);
            let most_n = k * airframe.rotor_speed_max_radps.powi(2);
            assert!(thrust_n.iter().all(|t| (-1e-9..=most_n + 1e-9).contains(t)));
            let (_, moment) = wrench(thrust_n);
            assert!((moment.x / moment.y - 2.0).abs() < 1e-9);
        }
    }

    #[test]
    fn drag_follows_equation_6() {
        let airframe = airframe(UavKind::Phantom4);
        let drag = airframe.drag_enu_n(DVec3::new(0.0, 10.0, 0.0), DVec3::new(5.0, 10.0, 0.0), RHO);
        // Only the 5 m/s of relative wind count: 0.5 * 1.225 * 0.0498 * 25 = 0.7626 N.
        assert!((drag - DVec3::new(0.762_562_5, 0.0, 0.0)).length() < 1e-9);
    }

    #[test]
    fn free_spin_conserves_energy_and_momentum() {
        let airframe = airframe(UavKind::Mavic2);
        let mut state =
            MultirotorState::trimmed(&airframe, &hover_at(DVec3::ZERO, 0.0), DVec3::ZERO, RHO);
        state.omega_body_radps = DVec3::new(3.0, 5.0, 4.0);
        let inertia = airframe.inertia_kgm2;
        let momentum = |s: &MultirotorState| s.q_enu_body * (inertia * s.omega_body_radps);
        let energy = |s: &MultirotorState| s.omega_body_radps.dot(inertia * s.omega_body_radps);
        let before = state;
        for _ in 0..9600 {
            rotate(&mut state, inertia, DVec3::ZERO, DT_S);
        }
        let drift = (momentum(&state) - momentum(&before)).length() / momentum(&before).length();
        assert!(drift < 1e-3, "{drift}");
        assert!((energy(&state) / energy(&before) - 1.0).abs() < 1e-4);
        assert!((state.q_enu_body.length() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn symmetric_top_precesses_at_the_analytic_rate() {
        let inertia = DVec3::new(2e-3, 2e-3, 3e-3);
        let airframe = airframe(UavKind::MavicAir);
        let mut state =
            MultirotorState::trimmed(&airframe, &hover_at(DVec3::ZERO, 0.0), DVec3::ZERO, RHO);
        state.omega_body_radps = DVec3::new(1.0, 0.0, 8.0);
        for _ in 0..960 {
            rotate(&mut state, inertia, DVec3::ZERO, DT_S);
        }
        // The transverse rate turns in the body at w_z (Iz - Ix)/Ix = 4 rad/s, for 1 s.
        let omega = state.omega_body_radps;
        assert!(
            (omega - DVec3::new(4.0_f64.cos(), 4.0_f64.sin(), 8.0)).length() < 1e-4,
            "{omega}"
        );
    }

    #[test]
    fn rotor_phase_turns_with_the_rotor() {
        let airframe = airframe(UavKind::Phantom4);
        let setpoint = hover_at(DVec3::ZERO, 0.0);
        let mut state = MultirotorState::trimmed(&airframe, &setpoint, DVec3::ZERO, RHO);
        for _ in 0..100 {
            step(&airframe, &mut state, &setpoint, DVec3::ZERO, RHO, DT_S);
        }
        for i in 0..4 {
            let turned_rad =
                airframe.rotor_spin[i] * airframe.hover_rotor_speed_radps * 100.0 * DT_S;
            assert!((state.rotor_phase_rad[i] - turned_rad.rem_euclid(TAU)).abs() < 1e-6);
        }
    }

    /// One second of open-loop flight against `rotorpy` 3.0.0: its Hummingbird with isotropic
    /// parasitic drag 0.005 N s^2/m^2, rotor drag, inflow and translational lift off, gravity
    /// 9.80665 m/s^2, integrated by DOP853 to 1e-11.
    #[test]
    fn open_loop_flight_matches_rotorpy() {
        let arm_m = 0.17; // [m]
        let airframe = Airframe {
            rotor_arm_body_m: std::array::from_fn(|i| {
                arm_m * DVec2::from_angle(PI * (0.25 + 0.5 * i as f64))
            }),
            mass_kg: 0.5,
            inertia_kgm2: DVec3::new(3.65e-3, 3.68e-3, 7.03e-3),
            thrust_k_ns2: 5.57e-6,
            torque_per_thrust_m: 1.36e-7 / 5.57e-6,
            rotor_lag_s: 0.005,
            drag_area_m2: 2.0 * 0.005 / RHO,
            ..airframe(UavKind::MavicAir)
        };
        let mut state = MultirotorState::trimmed(
            &airframe,
            &hover_at(DVec3::new(0.0, 0.0, 50.0), PI / 2.0),
            DVec3::ZERO,
            RHO,
        );
        assert!(state.q_enu_body.angle_between(DQuat::IDENTITY) < 1e-7);
        state.v_enu_mps = DVec3::new(4.0, 1.0, -1.0);
        state.omega_body_radps = DVec3::new(0.8, -0.5, 1.2);
        state.rotor_speed_radps[..4].fill(450.0);
        let mut wanted_radps = [0.0; MAX_ROTORS];
        wanted_radps[..4].copy_from_slice(&[480.5, 480.0, 479.6, 480.2]);
        let wind_enu_mps = DVec3::new(3.0, -2.0, 0.5);
        for _ in 0..960 {
            advance(
                &airframe,
                &mut state,
                &wanted_radps,
                wind_enu_mps,
                RHO,
                DT_S,
            );
        }
        let r_enu_m = DVec3::new(3.978_028_46, -0.511_068_266, 48.895_172_7);
        let v_enu_mps = DVec3::new(4.757_215_52, -3.145_043_65, -1.806_643_59);
        let q_enu_body =
            DQuat::from_xyzw(0.400_612_22, -0.022_591_487, 0.574_686_518, 0.713_256_532);
        let omega_body_radps = DVec3::new(1.001_827_57, 0.393_073_893, 1.198_395_59);
        let apart = |a: DVec3, b: DVec3| (a - b).length() / b.length();
        let moved_m = r_enu_m - DVec3::new(0.0, 0.0, 50.0);
        assert!(apart(state.r_enu_m - DVec3::new(0.0, 0.0, 50.0), moved_m) < 1e-3);
        assert!(apart(state.v_enu_mps, v_enu_mps) < 1e-3);
        assert!(state.q_enu_body.angle_between(q_enu_body) < 1e-3);
        assert!(apart(state.omega_body_radps, omega_body_radps) < 1e-3);
    }
}
