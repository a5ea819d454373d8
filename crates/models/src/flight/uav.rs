//! One UAV: the numbers by which it flies, heats up and is drawn. The catalogue's files (`assets/uavs`)
//! give them.

use crate::flight::class::ObjectClass;
use crate::flight::shape::{Coat, Shape};
use crate::laser::target::Skin;
use glam::{DVec2, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The physical data of one UAV; body axes are forward, left, up.
#[derive(Clone, Debug)]
pub struct UavModel {
    /// Its name in the catalogue, or the path of its file.
    pub id: String,
    /// Maker and model.
    pub name: String,
    /// Whether it is kept for judging: nothing that learns is shown it.
    pub held_out: bool,
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
    /// The hull; its middle, where none is given, is the centroid of the airframe's surface.
    pub body: Part<Option<DVec3>>,
    /// The battery, one of them where there are more.
    pub battery: Part,
    /// The front left motor; its middle, where none is given, is the hub of its rotor.
    pub rotor_hub: Part<Option<DVec3>>,
    /// The camera.
    pub camera: Part,
    /// What its arms are made of.
    pub arms: Skin,
    /// What it looks like.
    pub shape: Shape,
    /// The maker's paint.
    pub coat: Coat,
}

/// A part that the laser may be aimed at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part<P = DVec3> {
    /// Its middle [m, body].
    pub at_body_m: P,
    /// What the laser heats there.
    pub skin: Skin,
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
    pub fn part_skin(&self, part: AimPart) -> Skin {
        match part {
            AimPart::Body => self.body.skin,
            AimPart::Battery => self.battery.skin,
            AimPart::RotorHub => self.rotor_hub.skin,
            AimPart::Camera => self.camera.skin,
        }
    }
}

/// Expected offset of a part from the middle of the silhouette, rotor discs included [m, enu], for a
/// UAV of span `span_m` [m], the silhouette's width, that flies level along `v_enu_mps` [m/s, enu].
///
/// The station does not know the model: the fractions are means over the shipped catalogue, whose
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

#[cfg(test)]
impl UavModel {
    /// A UAV for tests, with the Phantom 4's numbers.
    pub(crate) fn sample() -> Self {
        use crate::flight::shape::Frame;
        use crate::laser::target::{ABS_SHELL, MOTOR_BELL, POLYCARBONATE_SHELL, SHELLED_POUCH};
        let grey = [0.5; 3];
        Self {
            id: "sample".into(),
            name: "sample".into(),
            held_out: false,
            class: ObjectClass::Quadcopter,
            mass_kg: 1.380,
            diagonal_m: 0.350,
            size_m: [0.289, 0.289, 0.196],
            rotor_count: 4,
            propeller_diameter_m: 9.4 * 0.0254,
            v_max_mps: 20.0,
            max_tilt_rad: 42.0_f64.to_radians(),
            max_rate_radps: 250.0_f64.to_radians(),
            thrust_to_weight: 2.2,
            inertia_kgm2: [7.4e-3, 9.0e-3, 14.9e-3],
            drag_area_m2: 0.0498,
            rotor_lag_s: 0.035,
            body: Part {
                at_body_m: None,
                skin: ABS_SHELL,
            },
            battery: Part {
                at_body_m: DVec3::new(-0.07, 0.0, 0.004),
                skin: SHELLED_POUCH,
            },
            rotor_hub: Part {
                at_body_m: None,
                skin: MOTOR_BELL,
            },
            camera: Part {
                at_body_m: DVec3::new(0.055, 0.0, -0.078),
                skin: POLYCARBONATE_SHELL,
            },
            arms: ABS_SHELL,
            shape: Shape::Frame(Frame::Phantom),
            coat: Coat {
                shell: grey,
                arms: [grey; 2],
                gear: grey,
                motor: grey,
                blades: grey,
            },
        }
    }
}
