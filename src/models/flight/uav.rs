//! The UAV catalogue: one constant record per airframe.
//!
//! Sources of the values, by field (each record lists its own checked ones):
//! - checked: read in the maker's published data;
//! - recalled: believed to be the maker's figure, not checked against the source. All speeds but the
//!   Mavic 2's, all tilt limits and all angular rates are of this kind;
//! - derived: inertia, from mass and size (±35 %; makers publish none), and drag area, which closes
//!   `m g tan(tilt) = rho C_D A v^2 / 2` at the listed top speed and tilt in 1.225 kg/m^3 air;
//! - assumed, typical of the class: rotor lag, thrust-to-weight ratio and skin material.

use crate::models::flight::class::ObjectClass;
use crate::models::laser::thermal::{
    ABS_SHELL, CARBON_EPOXY, LIPO_POUCH, MOTOR_BELL, POLYCARBONATE_SHELL, SHELLED_POUCH,
    SkinMaterial,
};
use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A UAV of the catalogue.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum UavKind {
    /// DJI Phantom 4.
    Phantom4,
    /// DJI Mavic 2 Pro.
    Mavic2,
    /// DJI Mavic Air.
    MavicAir,
    /// DJI Matrice 200.
    Matrice200,
    /// DJI Matrice 600 Pro.
    Matrice600,
    /// A generic five-inch first-person-view racer.
    Fpv5,
}

impl UavKind {
    /// Every kind, in catalogue order.
    pub const ALL: [Self; 6] = [
        Self::Phantom4,
        Self::Mavic2,
        Self::MavicAir,
        Self::Matrice200,
        Self::Matrice600,
        Self::Fpv5,
    ];
}

/// The physical data of one UAV; body axes are forward, left, up.
#[derive(Clone, Debug, PartialEq)]
pub struct UavModel {
    /// Maker and model.
    pub name: &'static str,
    /// Class, by size and number of rotors.
    pub class: ObjectClass,
    /// Take-off mass [kg].
    pub mass_kg: f64,
    /// Motor-to-motor diagonal [m].
    pub diagonal_m: f64,
    /// Length, width, height [m].
    pub size_m: [f64; 3],
    /// Number of rotors (4 or 6).
    pub rotor_count: usize,
    /// Propeller diameter [m].
    pub propeller_diameter_m: f64,
    /// Greatest level speed in still air [m/s].
    pub v_max_mps: f64,
    /// Greatest tilt of the thrust axis from the vertical [rad].
    pub max_tilt_rad: f64,
    /// Greatest roll or pitch rate [rad/s]; the autopilot allows half of it in yaw.
    pub max_rate_radps: f64,
    /// Greatest total thrust over weight in 1.225 kg/m^3 air [-].
    pub thrust_to_weight: f64,
    /// Principal moments of inertia about body x, y, z [kg m^2].
    pub inertia_kgm2: [f64; 3],
    /// Frame drag area `C_D A` of eq. 6 [m^2].
    pub drag_area_m2: f64,
    /// Time constant of the rotors' first-order speed lag [s].
    pub rotor_lag_s: f64,
    /// Material of the vulnerable skin.
    pub skin: SkinMaterial,
    /// Middle of the battery, of one of them where there are more [m, body].
    pub battery_body_m: DVec3,
    /// Middle of the camera [m, body].
    pub camera_body_m: DVec3,
}

/// The part of a UAV that the laser is aimed at.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum AimPart {
    /// The middle of the body: the centroid of the airframe's surface.
    #[default]
    Body,
    /// The battery.
    Battery,
    /// The hub of the front left rotor.
    RotorHub,
    /// The camera on its gimbal.
    Camera,
}

impl UavModel {
    /// What the laser heats when it is aimed at `part`.
    pub fn part_skin(&self, part: AimPart) -> SkinMaterial {
        match part {
            AimPart::Body => self.skin,
            // A racer's battery is strapped on bare.
            AimPart::Battery if self.class == ObjectClass::Fpv => LIPO_POUCH,
            AimPart::Battery => SHELLED_POUCH,
            AimPart::RotorHub => MOTOR_BELL,
            // Its housing; lens and sensor may go earlier.
            AimPart::Camera => POLYCARBONATE_SHELL,
        }
    }
}

/// Expected offset of a part from the middle of the silhouette, rotor discs included [m, enu], for a
/// UAV of span `span_m` [m], the silhouette's width, that flies level along `v_enu_mps` [m/s, enu].
///
/// The station does not know the model: the fractions are means over the catalogue, whose
/// models lie up to 0.18 of the span off them (see the tests of the meshes). For a UAV too slow
/// to have a course only the height is known.
pub fn aim_offset_enu_m(part: AimPart, span_m: f64, v_enu_mps: DVec3) -> DVec3 {
    // Forward, left, up over the span.
    let fraction = match part {
        AimPart::Body => DVec3::new(0.0, 0.0, 0.04),
        AimPart::Battery => DVec3::new(-0.07, 0.0, 0.10),
        AimPart::RotorHub => DVec3::new(0.29, 0.24, 0.12),
        AimPart::Camera => DVec3::new(0.17, 0.0, -0.04),
    };
    const COURSE_MPS: f64 = 0.5; // [m/s], below which the nose need not follow the velocity
    let course = v_enu_mps.truncate();
    let ahead = if course.length() < COURSE_MPS {
        DVec2::ZERO
    } else {
        course.normalize()
    };
    let level = fraction.x * ahead + fraction.y * ahead.perp();
    span_m * level.extend(fraction.z)
}

const INCH_M: f64 = 0.0254; // [m]

// Checked: mass, diagonal. Recalled: size, propeller, speed, tilt, rate.
const PHANTOM4: UavModel = UavModel {
    name: "DJI Phantom 4",
    class: ObjectClass::Quadcopter,
    mass_kg: 1.380,
    diagonal_m: 0.350,
    size_m: [0.289, 0.289, 0.196],
    rotor_count: 4,
    propeller_diameter_m: 9.4 * INCH_M,
    v_max_mps: 20.0,
    max_tilt_rad: 42.0_f64.to_radians(),
    max_rate_radps: 250.0_f64.to_radians(),
    thrust_to_weight: 2.2,
    inertia_kgm2: [7.4e-3, 9.0e-3, 14.9e-3],
    drag_area_m2: 0.0498,
    rotor_lag_s: 0.035,
    skin: ABS_SHELL,
    battery_body_m: DVec3::new(-0.07, 0.0, 0.004),
    camera_body_m: DVec3::new(0.055, 0.0, -0.078),
};

// Checked: mass, diagonal, size, speed. Recalled: propeller, tilt, rate.
const MAVIC2: UavModel = UavModel {
    name: "DJI Mavic 2 Pro",
    class: ObjectClass::Quadcopter,
    mass_kg: 0.907,
    diagonal_m: 0.354,
    size_m: [0.322, 0.242, 0.084],
    rotor_count: 4,
    propeller_diameter_m: 8.7 * INCH_M,
    v_max_mps: 20.0,
    max_tilt_rad: 35.0_f64.to_radians(),
    max_rate_radps: 200.0_f64.to_radians(),
    thrust_to_weight: 2.2,
    inertia_kgm2: [4.1e-3, 6.1e-3, 9.6e-3],
    drag_area_m2: 0.0254,
    rotor_lag_s: 0.035,
    skin: ABS_SHELL,
    battery_body_m: DVec3::new(-0.13 * 0.322, 0.0, 0.34 * 0.084),
    camera_body_m: DVec3::new(0.37 * 0.322, 0.0, -0.16 * 0.084),
};

// Checked: mass, diagonal, size. Recalled: propeller, speed, tilt, rate.
const MAVIC_AIR: UavModel = UavModel {
    name: "DJI Mavic Air",
    class: ObjectClass::Quadcopter,
    mass_kg: 0.430,
    diagonal_m: 0.213,
    size_m: [0.168, 0.184, 0.064],
    rotor_count: 4,
    propeller_diameter_m: 5.3 * INCH_M,
    v_max_mps: 19.0,
    max_tilt_rad: 35.0_f64.to_radians(),
    max_rate_radps: 250.0_f64.to_radians(),
    thrust_to_weight: 2.2,
    inertia_kgm2: [0.86e-3, 1.37e-3, 2.04e-3],
    drag_area_m2: 0.0134,
    rotor_lag_s: 0.025,
    skin: ABS_SHELL,
    battery_body_m: DVec3::new(-0.13 * 0.168, 0.0, 0.34 * 0.064),
    camera_body_m: DVec3::new(0.37 * 0.168, 0.0, -0.16 * 0.064),
};

// Recalled: mass, diagonal, size, propeller, speed, tilt, rate.
const MATRICE200: UavModel = UavModel {
    name: "DJI Matrice 200",
    class: ObjectClass::Quadcopter,
    mass_kg: 4.69,
    diagonal_m: 0.643,
    size_m: [0.887, 0.880, 0.378],
    rotor_count: 4,
    propeller_diameter_m: 17.0 * INCH_M,
    v_max_mps: 23.0,
    max_tilt_rad: 35.0_f64.to_radians(),
    max_rate_radps: 300.0_f64.to_radians(),
    thrust_to_weight: 2.0,
    inertia_kgm2: [0.071, 0.092, 0.140],
    drag_area_m2: 0.0994,
    rotor_lag_s: 0.045,
    // The moulded body around the batteries; its arms are carbon fibre.
    skin: ABS_SHELL,
    battery_body_m: DVec3::new(-0.165, 0.036, 0.03),
    camera_body_m: DVec3::new(0.15, 0.0, -0.115),
};

// Checked: mass, diagonal, propeller. Recalled: size, speed, tilt, rate. The drag area is 1.1 % above
// what its balance asks for.
const MATRICE600: UavModel = UavModel {
    name: "DJI Matrice 600 Pro",
    class: ObjectClass::Hexacopter,
    mass_kg: 9.5,
    diagonal_m: 1.133,
    size_m: [1.668, 1.518, 0.759],
    rotor_count: 6,
    propeller_diameter_m: 21.0 * INCH_M,
    v_max_mps: 18.0,
    max_tilt_rad: 25.0_f64.to_radians(),
    max_rate_radps: 300.0_f64.to_radians(),
    thrust_to_weight: 2.2,
    inertia_kgm2: [0.45, 0.45, 0.83],
    drag_area_m2: 0.2213,
    rotor_lag_s: 0.050,
    skin: CARBON_EPOXY,
    battery_body_m: DVec3::new(0.155, 0.0, 0.012),
    camera_body_m: DVec3::new(0.0, 0.0, -0.25),
};

// No single maker: every value is assumed, typical of the class. Such a
// racer reaches 40 to 55 m/s and may tilt through 90 degrees; 45 m/s at a steady level-flight tilt
// of 65 degrees is assumed, which closes at C_D A = 0.0119 m^2, a plausible bluff plate of the
// frame's area. The tilt limit is that steady tilt, so that the airframe tops out there.
const FPV5: UavModel = UavModel {
    name: "5-inch FPV racer",
    class: ObjectClass::Fpv,
    mass_kg: 0.70,
    diagonal_m: 0.22,
    size_m: [0.20, 0.16, 0.06],
    rotor_count: 4,
    propeller_diameter_m: 5.0 * INCH_M,
    v_max_mps: 45.0,
    max_tilt_rad: 65.0_f64.to_radians(),
    max_rate_radps: 800.0_f64.to_radians(),
    thrust_to_weight: 6.0,
    inertia_kgm2: [1.3e-3, 1.9e-3, 2.8e-3],
    drag_area_m2: 0.01187,
    rotor_lag_s: 0.015,
    skin: CARBON_EPOXY,
    battery_body_m: DVec3::new(-0.005, 0.0, 0.02575),
    camera_body_m: DVec3::new(0.062, 0.0, -0.001),
};

/// The catalogue record of `kind`.
pub fn model(kind: UavKind) -> &'static UavModel {
    match kind {
        UavKind::Phantom4 => &PHANTOM4,
        UavKind::Mavic2 => &MAVIC2,
        UavKind::MavicAir => &MAVIC_AIR,
        UavKind::Matrice200 => &MATRICE200,
        UavKind::Matrice600 => &MATRICE600,
        UavKind::Fpv5 => &FPV5,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::maths::kinematics::GRAVITY_MPS2;

    #[test]
    fn drag_area_closes_the_balance_at_top_speed() {
        for kind in UavKind::ALL {
            let uav = model(kind);
            let drag_n = 0.5 * 1.225 * uav.drag_area_m2 * uav.v_max_mps.powi(2);
            let lift_n = uav.mass_kg * GRAVITY_MPS2 * uav.max_tilt_rad.tan();
            // The Matrice 600's tabulated area is 1.1 % above its balance.
            assert!((drag_n / lift_n - 1.0).abs() < 0.015, "{}", uav.name);
        }
    }

    #[test]
    fn bodies_are_possible() {
        for kind in UavKind::ALL {
            let uav = model(kind);
            let [x, y, z] = uav.inertia_kgm2;
            // The triangle inequality of a rigid body's moments of inertia.
            assert!(x + y > z && y + z > x && z + x > y, "{}", uav.name);
            // All the mass lies within half the largest size.
            let reach_m = uav.size_m.iter().copied().fold(uav.diagonal_m, f64::max) / 2.0;
            assert!(z < uav.mass_kg * reach_m * reach_m, "{}", uav.name);
            // Enough thrust to hold height at the tilt limit.
            assert!(
                uav.thrust_to_weight > 1.2 / uav.max_tilt_rad.cos(),
                "{}",
                uav.name
            );
        }
    }
}
