//! Flying objects that are no UAVs: birds, balloons, aeroplanes, helicopters, leaves.

use crate::flight::bird::{self, Species};
use crate::flight::class::ObjectClass;
use crate::flight::multirotor::{MAX_ROTORS, Setpoint};
use crate::maths::kinematics::GRAVITY_MPS2;
use glam::{DMat3, DQuat, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Kind of distractor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DistractorKind {
    /// A herring gull along its trajectory, beating its wings with short glides.
    Bird,
    /// A carrion crow.
    Crow,
    /// A feral pigeon.
    Pigeon,
    /// A common swift, which glides half of the time.
    Swift,
    /// A greylag goose, which never glides.
    Goose,
    /// A common buzzard that soars with spread wings; `orbit` is its trajectory.
    Raptor,
    /// A drifting party balloon: its trajectory is flown through the air, not over the ground, so
    /// that one that hovers drifts with the wind.
    Balloon,
    /// A twin-jet airliner along its trajectory.
    Aeroplane,
    /// A twin-jet airliner at cruising height, with its contrail of some hundred metres.
    Contrail,
    /// A regional airliner with two turboprops, a high wing and a T-tail.
    Turboprop,
    /// A four-seat aeroplane with one propeller.
    LightAircraft,
    /// A light twin-engined helicopter.
    Helicopter,
    /// A leaf or scrap of paper that tumbles; its trajectory is flown through the air like a
    /// balloon's.
    Leaf,
}

impl DistractorKind {
    /// Every kind.
    pub const ALL: [Self; 13] = [
        Self::Bird,
        Self::Crow,
        Self::Pigeon,
        Self::Swift,
        Self::Goose,
        Self::Raptor,
        Self::Balloon,
        Self::Aeroplane,
        Self::Contrail,
        Self::Turboprop,
        Self::LightAircraft,
        Self::Helicopter,
        Self::Leaf,
    ];

    /// The kind as recordings and the window name it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bird => "bird",
            Self::Crow => "crow",
            Self::Pigeon => "pigeon",
            Self::Swift => "swift",
            Self::Goose => "goose",
            Self::Raptor => "raptor",
            Self::Balloon => "balloon",
            Self::Aeroplane => "aeroplane",
            Self::Contrail => "contrail",
            Self::Turboprop => "turboprop",
            Self::LightAircraft => "light_aircraft",
            Self::Helicopter => "helicopter",
            Self::Leaf => "leaf",
        }
    }

    /// What a detector should call it.
    pub fn class(self) -> ObjectClass {
        match self {
            Self::Balloon => ObjectClass::Balloon,
            Self::Aeroplane | Self::Contrail | Self::Turboprop | Self::LightAircraft => {
                ObjectClass::Aeroplane
            }
            Self::Helicopter => ObjectClass::Helicopter,
            Self::Leaf => ObjectClass::Other,
            _ => ObjectClass::Bird,
        }
    }

    /// The species of a bird; `None` for all else.
    pub fn species(self) -> Option<&'static Species> {
        match self {
            Self::Bird => Some(&bird::GULL),
            Self::Crow => Some(&bird::CROW),
            Self::Pigeon => Some(&bird::PIGEON),
            Self::Swift => Some(&bird::SWIFT),
            Self::Goose => Some(&bird::GOOSE),
            Self::Raptor => Some(&bird::BUZZARD),
            _ => None,
        }
    }

    /// Length, width and height, wings stretched [m].
    pub fn size_m(self) -> [f64; 3] {
        match self {
            Self::Balloon => [2.0 * BALLOON_RADIUS_M; 3],
            Self::Aeroplane => AIRLINER_SIZE_M,
            Self::Contrail => {
                let [length_m, span_m, height_m] = AIRLINER_SIZE_M;
                [0.5 * length_m + CONTRAIL_M, span_m, height_m]
            }
            Self::Turboprop => TURBOPROP_SIZE_M,
            Self::LightAircraft => LIGHT_AIRCRAFT_SIZE_M,
            Self::Helicopter => HELICOPTER_SIZE_M,
            Self::Leaf => LEAF_SIZE_M,
            _ => (self.species()).map_or([0.0; 3], |s| [s.length_m, s.span_m, 0.25 * s.length_m]),
        }
    }

    /// Greatest speed through the air at which it is ever met [m/s]: birds in a dive with the wind behind them, aircraft at
    /// their limits. Recalled, rounded up: it tells a slip of the pen from a flight.
    pub fn v_max_mps(self) -> f64 {
        match self {
            Self::Bird | Self::Crow | Self::Goose => 35.0,
            Self::Pigeon | Self::Raptor => 45.0,
            Self::Swift => 60.0,
            Self::Balloon | Self::Leaf => 10.0,
            Self::Aeroplane | Self::Contrail => 320.0,
            Self::Turboprop => 200.0,
            Self::LightAircraft | Self::Helicopter => 110.0,
        }
    }

    /// Whether it drifts with the air.
    pub fn drifts(self) -> bool {
        matches!(self, Self::Balloon | Self::Leaf)
    }

    /// Phases of its wings' joints or of its rotors [rad], `t_s` after it had `phase_rad`.
    pub fn phases_rad(self, t_s: f64, phase_rad: f64) -> [f64; MAX_ROTORS] {
        if let Some(species) = self.species() {
            return species.wings_rad(t_s, phase_rad);
        }
        self.rotor_speeds_radps()
            .map(|speed_radps| match speed_radps {
                0.0 => 0.0,
                _ => (phase_rad + speed_radps * t_s).rem_euclid(TAU),
            })
    }

    /// Speeds of its rotors [rad/s]; wings have none.
    pub fn rotor_speeds_radps(self) -> [f64; MAX_ROTORS] {
        let turns_hz: &[f64] = match self {
            Self::LightAircraft => &[PROPELLER_HZ],
            Self::Turboprop => &[TURBOPROP_HZ; 2],
            Self::Helicopter => &ROTORS_HZ,
            _ => &[],
        };
        std::array::from_fn(|i| turns_hz.get(i).map_or(0.0, |hz| TAU * hz))
    }

    /// Position, velocity and attitude of one that follows `setpoint`, `t_s` after it had
    /// `phase_rad`. What drifts takes its position from the air instead.
    pub fn pose(self, setpoint: &Setpoint, t_s: f64, phase_rad: f64) -> DistractorPose {
        let [heave_m, heave_mps] =
            (self.species()).map_or([0.0; 2], |species| species.heave(t_s, phase_rad));
        DistractorPose {
            r_enu_m: setpoint.r_enu_m + heave_m * DVec3::Z,
            v_enu_mps: setpoint.v_enu_mps + heave_mps * DVec3::Z,
            q_enu_body: match self {
                Self::Balloon => DQuat::IDENTITY,
                Self::Leaf => tumbling_attitude(t_s, phase_rad),
                Self::Helicopter => rotorcraft_attitude(setpoint),
                _ => winged_attitude(setpoint),
            },
        }
    }
}

/// Length, span and height of a twin-jet airliner of the Airbus A320's size [m] (recalled from the
/// maker's airport planning manual).
pub const AIRLINER_SIZE_M: [f64; 3] = [37.6, 35.8, 11.8]; // [m]
/// How far behind the middle of an airliner its contrail ends [m] (assumption: one that fades soon).
pub const CONTRAIL_M: f64 = 350.0; // [m]
/// Length, span and height of a regional airliner of the ATR 72's size [m] (recalled).
pub const TURBOPROP_SIZE_M: [f64; 3] = [27.2, 27.1, 7.7]; // [m]
/// Turns a second of a turboprop's propellers (1,200 a minute; recalled).
pub const TURBOPROP_HZ: f64 = 20.0; // [Hz]
/// Length, span and height of a four-seat high-wing aeroplane of the Cessna 172's size [m] (recalled).
pub const LIGHT_AIRCRAFT_SIZE_M: [f64; 3] = [8.3, 11.0, 2.7]; // [m]
/// Length with turning rotors, diameter of the main rotor and height of a helicopter of the Airbus
/// H135's size [m] (recalled).
pub const HELICOPTER_SIZE_M: [f64; 3] = [12.2, 10.4, 3.6]; // [m]
/// Turns a second of a helicopter's main and tail rotors (395 and 3,000 a minute; assumption, of that
/// size).
pub const ROTORS_HZ: [f64; 2] = [6.6, 50.0]; // [Hz]
/// Turns a second of a light aircraft's propeller (2,400 a minute; assumption).
pub const PROPELLER_HZ: f64 = 40.0; // [Hz]
/// Drag of a helicopter over its mass and speed, by which it pitches forward [1/s]: 6 degrees at
/// 60 m/s (assumption).
const HELICOPTER_DRAG_PER_S: f64 = 0.017; // [1/s]
/// Length, width and bend of a large leaf [m] (assumption).
pub const LEAF_SIZE_M: [f64; 3] = [0.16, 0.11, 0.03]; // [m]
/// Turns a second of a tumbling leaf about its length (assumption).
pub const TUMBLE_ROLL_HZ: f64 = 1.7; // [Hz]
/// Turns a second of a tumbling leaf about the vertical (assumption).
pub const TUMBLE_YAW_HZ: f64 = 0.4; // [Hz]
/// A latex balloon of three feet [m].
pub const BALLOON_RADIUS_M: f64 = 0.457; // [m]

/// A distractor at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DistractorPose {
    /// Position of the body [m, enu].
    pub r_enu_m: DVec3,
    /// Velocity of the body [m/s, enu].
    pub v_enu_mps: DVec3,
    /// Attitude of the body.
    pub q_enu_body: DQuat,
}

/// The heading of a setpoint as a level unit vector.
fn heading(setpoint: &Setpoint) -> DVec3 {
    DVec3::new(setpoint.yaw_rad.sin(), setpoint.yaw_rad.cos(), 0.0)
}

/// Attitude (body to enu) of what flies on wings along `setpoint`: forward along the path, banked so
/// that lift carries weight and turn; at rest it faces its heading.
pub fn winged_attitude(setpoint: &Setpoint) -> DQuat {
    let heading = heading(setpoint);
    let forward = setpoint.v_enu_mps.try_normalize().unwrap_or(heading);
    let left = (setpoint.a_enu_mps2 + GRAVITY_MPS2 * DVec3::Z)
        .cross(forward)
        .try_normalize()
        .unwrap_or(DVec3::Z.cross(heading));
    DQuat::from_mat3(&DMat3::from_cols(forward, left, forward.cross(left)))
}

/// Attitude (body to enu) of a helicopter along `setpoint`: its rotor's axis carries weight,
/// acceleration and drag, its nose points along the way, or its heading at rest.
pub fn rotorcraft_attitude(setpoint: &Setpoint) -> DQuat {
    let v_enu_mps = setpoint.v_enu_mps;
    let thrust = setpoint.a_enu_mps2 + GRAVITY_MPS2 * DVec3::Z + HELICOPTER_DRAG_PER_S * v_enu_mps;
    let up = thrust.try_normalize().unwrap_or(DVec3::Z);
    let level = DVec3::new(v_enu_mps.x, v_enu_mps.y, 0.0);
    let nose = if level.length() > 1.0 {
        level
    } else {
        heading(setpoint)
    };
    let left = up.cross(nose).try_normalize().unwrap_or(DVec3::Y);
    DQuat::from_mat3(&DMat3::from_cols(left.cross(up), left, up))
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
    fn the_body_heaves_by_centimetres_and_its_velocity_is_the_derivative() {
        let step_s = 1e-6;
        for kind in [
            DistractorKind::Goose,
            DistractorKind::Bird,
            DistractorKind::Swift,
        ] {
            let at = |t_s: f64| kind.pose(&level(), t_s, 0.4);
            let mut highest_m = 0.0_f64;
            for i in 0..2_000 {
                let t_s = f64::from(i) * 3.1e-3;
                let rise_m = at(t_s + step_s).r_enu_m.z - at(t_s - step_s).r_enu_m.z;
                let rate = rise_m / (2.0 * step_s);
                assert!((rate - at(t_s).v_enu_mps.z).abs() < 1e-5, "{kind:?}");
                highest_m = highest_m.max(at(t_s).r_enu_m.z - 90.0);
            }
            if kind == DistractorKind::Bird {
                assert!((highest_m - 0.0258).abs() < 3e-4, "{highest_m}");
            }
        }
    }

    #[test]
    fn lift_carries_weight_and_turn() {
        let level_q = winged_attitude(&level());
        assert!((level_q * DVec3::Z - DVec3::Z).length() < 1e-12);
        // A left turn of 5 m/s^2: the left wing hangs by atan(5/g).
        let turn = Setpoint {
            a_enu_mps2: DVec3::new(0.0, 5.0, 0.0),
            ..level()
        };
        let left = winged_attitude(&turn) * DVec3::Y;
        let bank_rad = -left.z.asin();
        assert!((bank_rad - (5.0 / GRAVITY_MPS2).atan()).abs() < 1e-12);
        // At rest it faces its heading.
        let still = Setpoint {
            v_enu_mps: DVec3::ZERO,
            yaw_rad: std::f64::consts::FRAC_PI_2,
            ..level()
        };
        let forward = winged_attitude(&still) * DVec3::X;
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

    #[test]
    fn a_helicopter_leans_into_its_flight_and_its_rotors_turn() {
        let fast = Setpoint {
            v_enu_mps: DVec3::new(60.0, 0.0, 0.0),
            ..level()
        };
        let q = rotorcraft_attitude(&fast);
        let pitch_deg = -(q * DVec3::X).z.asin().to_degrees();
        assert!((pitch_deg - 5.9).abs() < 0.2, "{pitch_deg}");
        assert!((q * DVec3::Y - DVec3::Y).length() < 1e-12);
        let kind = DistractorKind::Helicopter;
        let [main, tail, rest, ..] = kind.phases_rad(0.01, 0.0);
        assert!((main - TAU * 0.066).abs() < 1e-9 && (tail - TAU * 0.5).abs() < 1e-9);
        assert_eq!(rest, 0.0);
    }

    #[test]
    fn kinds_have_names_classes_and_sizes_of_their_own() {
        for (i, kind) in DistractorKind::ALL.into_iter().enumerate() {
            assert!(!kind.class().is_uav());
            assert!(kind.size_m().iter().all(|side| *side > 0.0));
            assert!(
                DistractorKind::ALL[..i]
                    .iter()
                    .all(|k| k.name() != kind.name())
            );
            let written = serde_json::to_value(kind).unwrap();
            assert_eq!(written, kind.name());
        }
    }
}
