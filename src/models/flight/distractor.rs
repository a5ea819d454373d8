//! Flying objects that are no UAVs: birds, balloons, aeroplanes, leaves.

use crate::models::flight::multirotor::Setpoint;
use crate::models::maths::kinematics::GRAVITY_MPS2;
use glam::{DMat3, DQuat, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Kind of distractor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DistractorKind {
    /// A herring gull in flapping flight along its trajectory.
    Bird,
    /// A drifting party balloon: its trajectory is flown through the air, not over the ground, so
    /// that one that hovers drifts with the wind.
    Balloon,
    /// A twin-jet airliner along its trajectory.
    Aeroplane,
    /// A leaf or scrap of paper that tumbles; its trajectory is flown through the air like a
    /// balloon's.
    Leaf,
}

impl DistractorKind {
    /// The kind as recordings and the window name it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bird => "bird",
            Self::Balloon => "balloon",
            Self::Aeroplane => "aeroplane",
            Self::Leaf => "leaf",
        }
    }

    /// Length, width and height, wings stretched [m].
    pub fn size_m(self) -> [f64; 3] {
        match self {
            Self::Bird => [BIRD_LENGTH_M, BIRD_SPAN_M, 0.15], // [m]
            Self::Balloon => [2.0 * BALLOON_RADIUS_M; 3],
            Self::Aeroplane => AIRLINER_SIZE_M,
            Self::Leaf => LEAF_SIZE_M,
        }
    }
}

/// Bill to tail of a herring gull [m]; length and span from the species' handbook ranges of 0.55 to
/// 0.67 m and 1.25 to 1.55 m (Cramp & Simmons, Birds of the Western Palearctic vol. 3; recalled).
pub const BIRD_LENGTH_M: f64 = 0.60; // [m]
/// Wing span of a herring gull [m].
pub const BIRD_SPAN_M: f64 = 1.35; // [m]
/// Wingbeats a second. The formula of Pennycuick, J. Exp. Biol. 199, 1613 (1996) gives 3.7 Hz for
/// this gull; birds in passage beat 0.81 to 1.05 times as often (Pennycuick, J. Exp. Biol. 204, 3283,
/// 2001), gulls at the slow end.
pub const WINGBEAT_HZ: f64 = 3.1; // [Hz]
/// Mean angle of the wings above the level [rad] (assumption).
pub const WING_MEAN_RAD: f64 = 0.14; // [rad]
/// How far the wings beat to both sides of their mean angle [rad] (assumption: cruising flight, 35
/// degrees).
pub const WING_BEAT_RAD: f64 = 0.61; // [rad]
/// Length, span and height of a twin-jet airliner of the Airbus A320's size [m] (recalled from the
/// maker's airport planning manual).
pub const AIRLINER_SIZE_M: [f64; 3] = [37.6, 35.8, 11.8]; // [m]
/// Length, span and height of a four-seat high-wing aeroplane of the Cessna 172's size [m] (recalled).
pub const LIGHT_AIRCRAFT_SIZE_M: [f64; 3] = [8.3, 11.0, 2.7]; // [m]
/// Length, width and bend of a large leaf [m] (assumption).
pub const LEAF_SIZE_M: [f64; 3] = [0.16, 0.11, 0.03]; // [m]
/// Turns a second of a tumbling leaf about its length (assumption).
pub const TUMBLE_ROLL_HZ: f64 = 1.7; // [Hz]
/// Turns a second of a tumbling leaf about the vertical (assumption).
pub const TUMBLE_YAW_HZ: f64 = 0.4; // [Hz]
/// Angle of both wings above the level in a glide [rad] (assumption).
pub const GLIDE_RAD: f64 = 0.10; // [rad]
/// A latex balloon of three feet [m].
pub const BALLOON_RADIUS_M: f64 = 0.457; // [m]

/// A bird at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BirdPose {
    /// Position of the body [m, enu].
    pub r_enu_m: DVec3,
    /// Velocity of the body [m/s, enu].
    pub v_enu_mps: DVec3,
    /// Attitude: forward along the path, banked so that lift carries weight and turn.
    pub q_enu_body: DQuat,
    /// Angle of both wings above the level [rad].
    pub wing_rad: f64,
}

/// The bird that follows `setpoint`, `phase_rad` [rad] into its wingbeat (0: wings up).
///
/// The downstroke carries everything: lift is `m g (1 + sin(phase))`, so the body heaves by
/// `-g/omega^2 sin(phase)`, 2.6 cm at 3.1 Hz (the lift's first harmonic; assumption).
pub fn bird_pose(setpoint: &Setpoint, phase_rad: f64) -> BirdPose {
    let omega_radps = TAU * WINGBEAT_HZ;
    let (sin, cos) = phase_rad.sin_cos();
    let heave = GRAVITY_MPS2 / (omega_radps * omega_radps) * DVec3::Z;
    BirdPose {
        r_enu_m: setpoint.r_enu_m - sin * heave,
        v_enu_mps: setpoint.v_enu_mps - omega_radps * cos * heave,
        q_enu_body: winged_attitude(setpoint),
        wing_rad: wing_rad(phase_rad),
    }
}

/// Angle of both wings above the level [rad], `phase_rad` [rad] into the wingbeat (0: wings up).
pub fn wing_rad(phase_rad: f64) -> f64 {
    WING_MEAN_RAD + WING_BEAT_RAD * phase_rad.cos()
}

/// Attitude (body to enu) of what flies on wings along `setpoint`: forward along the path, banked so
/// that lift carries weight and turn; at rest it faces its heading.
pub fn winged_attitude(setpoint: &Setpoint) -> DQuat {
    let heading = DVec3::new(setpoint.yaw_rad.sin(), setpoint.yaw_rad.cos(), 0.0);
    let forward = setpoint.v_enu_mps.try_normalize().unwrap_or(heading);
    let left = (setpoint.a_enu_mps2 + GRAVITY_MPS2 * DVec3::Z)
        .cross(forward)
        .try_normalize()
        .unwrap_or(DVec3::Z.cross(heading));
    DQuat::from_mat3(&DMat3::from_cols(forward, left, forward.cross(left)))
}

/// Attitude (body to enu) of a tumbling leaf after `t_s` [s], from `phase_rad` [rad] on: it turns
/// about its length, which turns about the vertical.
pub fn tumbling_attitude(t_s: f64, phase_rad: f64) -> DQuat {
    let angle = |hz: f64| TAU * hz * t_s + phase_rad;
    let (roll, yaw) = (angle(TUMBLE_ROLL_HZ), angle(TUMBLE_YAW_HZ));
    DQuat::from_rotation_z(yaw) * DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(roll)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level() -> Setpoint {
        Setpoint {
            r_enu_m: DVec3::new(10.0, 20.0, 90.0),
            v_enu_mps: DVec3::new(11.0, 0.0, 0.0),
            a_enu_mps2: DVec3::ZERO,
            yaw_rad: 0.0,
        }
    }

    #[test]
    fn the_wingbeat_is_the_published_one() {
        // Pennycuick 1996: f = m^3/8 g^1/2 b^-23/24 S^-1/3 rho^-3/8 with the gull's 1.0 kg, 0.20 m^2.
        let predicted_hz = GRAVITY_MPS2.sqrt()
            * BIRD_SPAN_M.powf(-23.0 / 24.0)
            * 0.20_f64.powf(-1.0 / 3.0)
            * 1.225_f64.powf(-3.0 / 8.0);
        let share = WINGBEAT_HZ / predicted_hz;
        assert!((0.81..1.05).contains(&share), "{share}");
    }

    #[test]
    fn the_body_heaves_by_centimetres_and_its_velocity_is_the_derivative() {
        let step_s = 1e-6;
        let at = |t_s: f64| bird_pose(&level(), TAU * WINGBEAT_HZ * t_s);
        let mut highest_m = 0.0_f64;
        for i in 0..100 {
            let t_s = f64::from(i) * 5e-3;
            let rate = (at(t_s + step_s).r_enu_m.z - at(t_s - step_s).r_enu_m.z) / (2.0 * step_s);
            assert!((rate - at(t_s).v_enu_mps.z).abs() < 1e-6);
            highest_m = highest_m.max(at(t_s).r_enu_m.z - 90.0);
        }
        assert!((highest_m - 0.0258).abs() < 3e-4, "{highest_m}");
    }

    #[test]
    fn lift_carries_weight_and_turn() {
        let pose = bird_pose(&level(), 0.3);
        assert!((pose.q_enu_body * DVec3::Z - DVec3::Z).length() < 1e-12);
        // A left turn of 5 m/s^2: the left wing hangs by atan(5/g).
        let turn = Setpoint {
            a_enu_mps2: DVec3::new(0.0, 5.0, 0.0),
            ..level()
        };
        let left = bird_pose(&turn, 0.0).q_enu_body * DVec3::Y;
        let bank_rad = -left.z.asin();
        assert!((bank_rad - (5.0 / GRAVITY_MPS2).atan()).abs() < 1e-12);
        // At rest it faces its heading.
        let still = Setpoint {
            v_enu_mps: DVec3::ZERO,
            yaw_rad: std::f64::consts::FRAC_PI_2,
            ..level()
        };
        let forward = bird_pose(&still, 0.0).q_enu_body * DVec3::X;
        assert!((forward - DVec3::X).length() < 1e-12);
    }

    #[test]
    fn a_leaf_turns_at_its_rates() {
        let rate = |at: f64| {
            let step_s = 1e-5;
            let turn = tumbling_attitude(at, 0.7).inverse() * tumbling_attitude(at + step_s, 0.7);
            turn.to_scaled_axis() / step_s
        };
        for t_s in [0.0, 0.3, 1.1] {
            // The spin about its length and the part of the other turn along it.
            let along = TAU * (TUMBLE_ROLL_HZ - TUMBLE_YAW_HZ * 0.4_f64.sin());
            assert!((rate(t_s).x - along).abs() < 1e-3, "{}", rate(t_s));
            assert!(rate(t_s).length() < TAU * (TUMBLE_ROLL_HZ + TUMBLE_YAW_HZ));
        }
        let turned = tumbling_attitude(0.2, 0.0) * DVec3::Z;
        assert!(turned.dot(DVec3::Z) < 0.0, "{turned}");
    }
}
