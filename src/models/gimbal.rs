//! Two-axis direct-drive gimbal: rigid axes with limited torque, viscous friction, a speed limit
//! and travel stops, each under an inner PI rate loop.
//!
//! Angles are relative to the base (what the encoders read): azimuth clockwise from the base's
//! north, elevation up. The two axes are dynamically independent (balanced load, no gyroscopic
//! coupling); friction is viscous only. The mechanics are stepped exactly for a torque held over
//! the tick. The rate loop is of type 2, so a steady acceleration leaves no rate error and needs no
//! feed-forward (measured: none helps). The sampled loop is stable while bandwidth · 2π · dt stays well below 1 (15 Hz at
//! 960 Hz gives 0.1).

use std::f64::consts::{PI, TAU};

use glam::DVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::models::kinematics::wrap_pi;

/// A gimbal parameter out of its range.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("gimbal parameter {name} = {value} is out of range")]
pub struct GimbalError {
    /// Field name.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
}

/// (e⁻ˣ, (1 − e⁻ˣ)/x, (x − 1 + e⁻ˣ)/x²) for x ≥ 0: a first-order lag and its first two integrals,
/// accurate down to x = 0.
pub(crate) fn lag_integrals(x: f64) -> [f64; 3] {
    if x < 0.05 {
        // ψ = Σ (−x)ᵏ/(k+2)!, exact to rounding after eight terms here; then back up.
        let mut term = 0.5;
        let mut psi = 0.0;
        for k in 3..11 {
            psi += term;
            term *= -x / f64::from(k);
        }
        let phi = 1.0 - x * psi;
        [1.0 - x * phi, phi, psi]
    } else {
        let phi = -(-x).exp_m1() / x;
        [(-x).exp(), phi, (1.0 - phi) / x]
    }
}

/// One gimbal axis and its rate servo.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct AxisParams {
    /// Moment of inertia about the axis [kg m²].
    pub inertia_kg_m2: f64,
    /// Largest motor torque [N m].
    pub torque_limit_nm: f64,
    /// Viscous friction [N m s/rad].
    pub viscous_nms: f64,
    /// Largest rate [rad/s]: the command is limited to it and the motor gives no torque beyond it.
    pub rate_limit_radps: f64,
    /// Natural frequency of the closed rate loop [Hz].
    pub bandwidth_hz: f64,
    /// Damping ratio of the closed rate loop.
    pub damping: f64,
    /// Travel stops [rad], lower then upper; `None` turns without end (slip ring).
    pub travel_rad: Option<[f64; 2]>,
}

/// A two-axis gimbal.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct GimbalParams {
    /// Outer axis.
    pub azimuth: AxisParams,
    /// Inner axis.
    pub elevation: AxisParams,
}

impl Default for GimbalParams {
    /// A small beam director (assumed, no particular product): some 40 kg of optics and yoke within
    /// 0.4 m, so 8 and 5 kg m²; direct-drive torque motors of 60 and 40 N m give 7.5 and
    /// 8 rad/s², three times what a 20 m/s target passing at 50 m asks in rate change; 60°/s covers
    /// that target (0.4 rad/s) and slews across the sector in 3 s. A 15 Hz rate loop stays a factor
    /// of two below the first structural mode (30–40 Hz) of a mount of this size.
    fn default() -> Self {
        let degree = PI / 180.0;
        let azimuth = AxisParams {
            inertia_kg_m2: 8.0,    // [kg m²]
            torque_limit_nm: 60.0, // [N m]
            viscous_nms: 2.0,      // [N m s/rad]
            rate_limit_radps: 60.0 * degree,
            bandwidth_hz: 15.0, // [Hz]
            damping: 0.9,
            travel_rad: None,
        };
        Self {
            azimuth,
            elevation: AxisParams {
                inertia_kg_m2: 5.0,    // [kg m²]
                torque_limit_nm: 40.0, // [N m]
                viscous_nms: 1.5,      // [N m s/rad]
                travel_rad: Some([-20.0 * degree, 85.0 * degree]),
                ..azimuth
            },
        }
    }
}

impl AxisParams {
    fn validate(&self) -> Result<(), GimbalError> {
        for (name, value) in [
            ("inertia_kg_m2", self.inertia_kg_m2),
            ("torque_limit_nm", self.torque_limit_nm),
            ("rate_limit_radps", self.rate_limit_radps),
            ("bandwidth_hz", self.bandwidth_hz),
            ("damping", self.damping),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(GimbalError { name, value });
            }
        }
        if !(self.viscous_nms >= 0.0 && self.viscous_nms.is_finite()) {
            return Err(GimbalError {
                name: "viscous_nms",
                value: self.viscous_nms,
            });
        }
        match self.travel_rad {
            Some([low, high]) if !(high - low > 0.0 && (high - low).is_finite()) => {
                Err(GimbalError {
                    name: "travel_rad",
                    value: high - low,
                })
            }
            _ => Ok(()),
        }
    }

    /// Angle [rad] to turn from `angle_rad` to reach `target_rad` (any multiple of a turn): the
    /// shortest way the stops allow; to the nearer stop when the target lies beyond them.
    pub fn error_rad(&self, target_rad: f64, angle_rad: f64) -> f64 {
        let shortest = wrap_pi(target_rad - angle_rad);
        let Some([low, high]) = self.travel_rad else {
            return shortest;
        };
        [shortest, shortest - TAU * shortest.signum()]
            .into_iter()
            .find(|e| (low..=high).contains(&(angle_rad + e)))
            .unwrap_or((angle_rad + shortest).min(high).max(low) - angle_rad)
    }
}

impl GimbalParams {
    /// Checks every field.
    pub fn validate(&self) -> Result<(), GimbalError> {
        self.azimuth.validate()?;
        self.elevation.validate()
    }

    /// Angles [rad] to turn in azimuth (x) and elevation (y) from `az_el_rad` to `target_rad`.
    pub fn error_rad(&self, target_rad: DVec2, az_el_rad: DVec2) -> DVec2 {
        DVec2::new(
            self.azimuth.error_rad(target_rad.x, az_el_rad.x),
            self.elevation.error_rad(target_rad.y, az_el_rad.y),
        )
    }

    /// The command that slews to a position [rad] and stops there: proportional near the target,
    /// on the braking parabola at 70 % of the torque far from it.
    pub fn position_command(&self, state: &GimbalState, target_rad: DVec2) -> GimbalCommand {
        let error = self.error_rad(target_rad, state.az_el_rad());
        let rate = |axis: &AxisParams, error: f64| {
            // A quarter of the rate loop's bandwidth keeps the cascade well damped.
            let linear = 0.25 * TAU * axis.bandwidth_hz * error.abs();
            let braking = (1.4 * axis.torque_limit_nm / axis.inertia_kg_m2 * error.abs()).sqrt();
            linear.min(braking).copysign(error)
        };
        GimbalCommand {
            rate_radps: [rate(&self.azimuth, error.x), rate(&self.elevation, error.y)],
        }
    }
}

/// State of one axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AxisState {
    /// Angle relative to the base [rad]; wrapped to (−π, π] on an axis without stops.
    pub angle_rad: f64,
    /// Rate relative to the base [rad/s].
    pub rate_radps: f64,
    /// Integrator of the rate loop [N m].
    pub integral_nm: f64,
    /// Motor torque of the last step [N m].
    pub torque_nm: f64,
}

/// State of a two-axis gimbal.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GimbalState {
    /// Outer axis.
    pub azimuth: AxisState,
    /// Inner axis.
    pub elevation: AxisState,
}

impl GimbalState {
    /// At rest at an azimuth (x) and an elevation (y) [rad].
    pub fn at_rest(az_el_rad: DVec2) -> Self {
        let mut state = Self::default();
        state.azimuth.angle_rad = az_el_rad.x;
        state.elevation.angle_rad = az_el_rad.y;
        state
    }

    /// Azimuth (x) and elevation (y) [rad].
    pub fn az_el_rad(&self) -> DVec2 {
        DVec2::new(self.azimuth.angle_rad, self.elevation.angle_rad)
    }

    /// Azimuth (x) and elevation (y) rates [rad/s].
    pub fn rates_radps(&self) -> DVec2 {
        DVec2::new(self.azimuth.rate_radps, self.elevation.rate_radps)
    }
}

/// What the gimbal is asked to do, azimuth then elevation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GimbalCommand {
    /// Rate [rad/s].
    pub rate_radps: [f64; 2],
}

/// Advances the gimbal by `dt_s` under a command and disturbance torques [N m] (azimuth,
/// elevation). A moving base enters as the torque −J·α about each axis, with α from the change of
/// [`crate::models::kinematics::base_rate_on_axes`].
pub fn step(
    state: &mut GimbalState,
    params: &GimbalParams,
    command: &GimbalCommand,
    disturbance_torque_nm: [f64; 2],
    dt_s: f64,
) {
    for (i, (axis, p)) in [
        (&mut state.azimuth, &params.azimuth),
        (&mut state.elevation, &params.elevation),
    ]
    .into_iter()
    .enumerate()
    {
        step_axis(
            axis,
            p,
            command.rate_radps[i],
            disturbance_torque_nm[i],
            dt_s,
        );
    }
}

fn step_axis(
    state: &mut AxisState,
    params: &AxisParams,
    rate_command_radps: f64,
    disturbance_nm: f64,
    dt_s: f64,
) {
    let inertia = params.inertia_kg_m2;
    let limit = params.rate_limit_radps;
    let mut wanted = rate_command_radps.min(limit).max(-limit);
    if let Some([low, high]) = params.travel_rad {
        // Brake ahead of a stop at half the torque, which leaves the rest for disturbances.
        let slowest = |room: f64| (params.torque_limit_nm / inertia * room.max(0.0)).sqrt();
        wanted = wanted
            .min(slowest(high - state.angle_rad))
            .max(-slowest(state.angle_rad - low));
    }
    let omega = TAU * params.bandwidth_hz;
    let error = wanted - state.rate_radps;
    let demand = 2.0 * params.damping * omega * inertia * error + state.integral_nm;
    let mut torque = demand
        .min(params.torque_limit_nm)
        .max(-params.torque_limit_nm);
    if state.rate_radps.abs() >= limit && torque * state.rate_radps > 0.0 {
        torque = 0.0;
    }
    // Conditional integration: hold while saturated unless the error leads back out.
    if torque == demand || error * (demand - torque) < 0.0 {
        state.integral_nm += omega * omega * inertia * error * dt_s;
    }
    state.torque_nm = torque;

    // J ω̇ = τ − b ω with the torque held: exact.
    let [decay, phi, psi] = lag_integrals(params.viscous_nms / inertia * dt_s);
    let push = (torque + disturbance_nm) / inertia;
    let angle = state.angle_rad + dt_s * (phi * state.rate_radps + dt_s * psi * push);
    state.rate_radps = decay * state.rate_radps + dt_s * phi * push;
    match params.travel_rad {
        None => state.angle_rad = wrap_pi(angle),
        Some([low, high]) => {
            state.angle_rad = angle.min(high).max(low);
            // The stop is a hard, inelastic one.
            if (angle > high && state.rate_radps > 0.0) || (angle < low && state.rate_radps < 0.0) {
                state.rate_radps = 0.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1.0 / 960.0;

    fn rate(az: f64, el: f64) -> GimbalCommand {
        GimbalCommand {
            rate_radps: [az, el],
        }
    }

    #[test]
    fn lag_integrals_match_their_definitions() {
        for x in [0.0f64, 1e-9, 1e-3, 0.0499, 0.0501, 1.0, 20.0] {
            let [e, phi, psi] = lag_integrals(x);
            assert!((e - (-x).exp()).abs() < 1e-15);
            // phi = ∫₀¹ e^{−xs} ds and psi = ∫₀¹ (1 − s) e^{−xs} ds, by Simpson.
            let n = 2000;
            let (mut a, mut b) = (0.0, 0.0);
            for k in 0..=n {
                let s = f64::from(k) / f64::from(n);
                let w = if k == 0 || k == n {
                    1.0
                } else {
                    f64::from(2 + 2 * (k % 2))
                };
                a += w * (-x * s).exp();
                b += w * (1.0 - s) * (-x * s).exp();
            }
            let h = 1.0 / (3.0 * f64::from(n));
            assert!(
                (phi - a * h).abs() < 1e-11 && (psi - b * h).abs() < 1e-11,
                "{x}"
            );
        }
    }

    #[test]
    fn small_rate_step_follows_the_linear_loop() {
        // Without friction the loop is (2ζω s + ω²)/(s² + 2ζω s + ω²).
        let mut params = GimbalParams::default();
        params.azimuth.viscous_nms = 0.0;
        let (z, w) = (params.azimuth.damping, TAU * params.azimuth.bandwidth_hz);
        // Fine steps: what remains is the first-order error of the sampled integrator.
        let dt = DT / 64.0;
        let mut state = GimbalState::default();
        for k in 1..=64 * 200 {
            step(&mut state, &params, &rate(1e-3, 0.0), [0.0; 2], dt);
            let t = f64::from(k) * dt;
            let wd = w * (1.0 - z * z).sqrt();
            let s = z * w;
            // 1 − e^{−st}(cos − (s/wd) sin): step of the loop with its zero.
            let y = 1.0 - (-s * t).exp() * ((wd * t).cos() - s / wd * (wd * t).sin());
            assert!(
                (state.azimuth.rate_radps - 1e-3 * y).abs() < 3e-3 * 1e-3,
                "{t}"
            );
        }
    }

    #[test]
    fn servo_is_stable_at_the_tick_and_rejects_a_constant_torque() {
        let params = GimbalParams::default();
        let mut state = GimbalState::default();
        for _ in 0..1920 {
            step(&mut state, &params, &rate(0.1, -0.05), [5.0, -3.0], DT);
        }
        assert!((state.azimuth.rate_radps - 0.1).abs() < 1e-9);
        assert!((state.elevation.rate_radps + 0.05).abs() < 1e-9);
        // Steady motor torque = viscous friction − disturbance.
        assert!((state.azimuth.torque_nm - (2.0 * 0.1 - 5.0)).abs() < 1e-6);
    }

    #[test]
    fn free_spin_down_is_exponential() {
        // With the motor starved, J ω̇ = −b ω: angle runs to ω0 J/b (1 − e^{−bt/J}).
        let axis = AxisParams {
            torque_limit_nm: 1e-12,
            travel_rad: Some([-10.0, 10.0]),
            ..GimbalParams::default().azimuth
        };
        let params = GimbalParams {
            azimuth: axis,
            elevation: axis,
        };
        let mut state = GimbalState::default();
        state.azimuth.rate_radps = 0.5;
        for _ in 0..960 {
            step(&mut state, &params, &rate(0.5, 0.0), [0.0; 2], DT);
        }
        let x = 2.0 / 8.0_f64;
        assert!((state.azimuth.rate_radps - 0.5 * (-x).exp()).abs() < 1e-10);
        assert!((state.azimuth.angle_rad - 0.5 * (1.0 - (-x).exp()) / x).abs() < 1e-10);
    }

    #[test]
    fn torque_and_rate_limits_hold() {
        let params = GimbalParams::default();
        let mut state = GimbalState::default();
        for _ in 0..96 {
            step(&mut state, &params, &rate(9.0, 9.0), [0.0; 2], DT);
            assert!(state.azimuth.torque_nm.abs() <= params.azimuth.torque_limit_nm);
        }
        // Full torque: no faster than T/J · t, and nearly that with little friction.
        let fastest = 60.0 / 8.0 * 0.1;
        assert!(state.azimuth.rate_radps < fastest && state.azimuth.rate_radps > 0.97 * fastest);
        for _ in 0..2000 {
            step(&mut state, &params, &rate(9.0, 0.0), [0.0; 2], DT);
            // One tick at full torque beyond the limit at most.
            assert!(state.azimuth.rate_radps <= params.azimuth.rate_limit_radps + 7.5 * DT);
        }
        assert!((state.azimuth.rate_radps / params.azimuth.rate_limit_radps - 1.0).abs() < 0.01);
    }

    #[test]
    fn stops_hold_and_are_met_gently() {
        let params = GimbalParams::default();
        let high = params.elevation.travel_rad.unwrap()[1];
        let mut state = GimbalState::default();
        let mut last = 0.0;
        for _ in 0..960 * 5 {
            last = state.elevation.rate_radps;
            step(&mut state, &params, &rate(0.0, 1.0), [0.0; 2], DT);
            assert!(state.elevation.angle_rad <= high);
        }
        assert!(high - state.elevation.angle_rad < 1e-3);
        assert!(last.abs() < 0.05);
        // A hard push does not pass either.
        for _ in 0..960 {
            step(&mut state, &params, &rate(0.0, 1.0), [0.0, 500.0], DT);
        }
        assert_eq!(state.elevation.angle_rad, high);
    }

    #[test]
    fn azimuth_takes_the_short_way_unless_a_cable_forbids_it() {
        let mut axis = GimbalParams::default().azimuth;
        assert!((axis.error_rad(-3.0, 3.0) - (TAU - 6.0)).abs() < 1e-14);
        axis.travel_rad = Some([-1.5 * PI, 1.5 * PI]);
        assert!((axis.error_rad(-3.0, 3.0) - (TAU - 6.0)).abs() < 1e-14);
        // At +260° the way up to 280° is blocked at 270°: go back to −80°.
        let degree = PI / 180.0;
        let error = axis.error_rad(280.0 * degree, 260.0 * degree);
        assert!((error + 340.0 * degree).abs() < 1e-12);
        // An unreachable elevation stops at the stop.
        let elevation = GimbalParams::default().elevation;
        assert!((elevation.error_rad(1.55, 0.0) - 85.0 * degree).abs() < 1e-12);
    }

    #[test]
    fn position_command_slews_and_settles_across_north_and_south() {
        let params = GimbalParams::default();
        let mut state = GimbalState::at_rest(DVec2::new(2.9, 0.1));
        let target = DVec2::new(-2.0, 0.9);
        let mut overshoot = 0.0_f64;
        for _ in 0..960 * 4 {
            let command = params.position_command(&state, target);
            step(&mut state, &params, &command, [0.0; 2], DT);
            overshoot = overshoot.max(-params.error_rad(target, state.az_el_rad()).x);
        }
        assert!(params.error_rad(target, state.az_el_rad()).length() < 1e-6);
        assert!(overshoot < 0.02, "{overshoot}");
    }

    #[test]
    fn bad_parameters_are_refused() {
        assert!(GimbalParams::default().validate().is_ok());
        let bad = |f: fn(&mut AxisParams)| {
            let mut p = GimbalParams::default();
            f(&mut p.elevation);
            p.validate().is_err()
        };
        assert!(bad(|p| p.inertia_kg_m2 = 0.0));
        assert!(bad(|p| p.viscous_nms = -1.0));
        assert!(bad(|p| p.bandwidth_hz = f64::INFINITY));
        assert!(bad(|p| p.travel_rad = Some([1.0, 1.0])));
    }
}
