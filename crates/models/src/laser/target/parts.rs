//! What of a UAV the beam falls on, and what its loss means.

use super::hull::Meets;
use super::skin::{Room, Skin};
use glam::DVec3;

/// What the loss of a part does to a UAV.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Effect {
    /// Battery or board are gone: it falls.
    PowerLost,
    /// A rotor has stopped: its motor has, or its arm hangs.
    RotorOut(usize),
    /// Its camera sees nothing more; it flies on.
    CameraBlind,
}

/// What a beam has struck.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Struck {
    /// The wall.
    pub skin: Skin,
    /// What its failing does.
    pub effect: Effect,
    /// Name of the part, for reports.
    pub part: &'static str,
    /// Whether it turns with its rotor, so that light goes round it.
    pub turns: bool,
}

/// Where a UAV has what [m, body], and of what it is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Parts {
    /// Middle of the battery, and its skin.
    pub battery: (DVec3, Skin),
    /// Middle of the camera, and its skin.
    pub camera: (DVec3, Skin),
    /// Hubs of the rotors, in the flight model's order, and the motors' skin.
    pub hubs: (Vec<DVec3>, Skin),
    /// The hull's skin.
    pub body: Skin,
    /// The arms' skin.
    pub arms: Skin,
    /// Motor-to-motor diagonal [m].
    pub diagonal_m: f64,
}

/// Sizes of parts in shares of the diagonal, over the catalogue's shapes: a motor's and a battery's radius, a camera's with
/// its gimbal, half the width of an arm, and how far out of the way to its hub an arm begins.
const MOTOR: f64 = 0.05;
const BATTERY: f64 = 0.11;
const CAMERA: f64 = 0.10;
const ARM: f64 = 0.06;
const ARM_BEGINS: f64 = 0.45;
/// How deep behind the face a battery lies [m].
const INSIDE_M: f64 = 0.12;
/// What of a part stands before its middle, in its radii.
const BEFORE: f64 = 1.5;

impl Parts {
    /// The same with every wall of one skin.
    pub fn all_of(self, skin: Skin) -> Self {
        Self {
            battery: (self.battery.0, skin),
            camera: (self.camera.0, skin),
            hubs: (self.hubs.0, skin),
            body: skin,
            arms: skin,
            ..self
        }
    }

    /// How deep a camera or a motor is that stands before the rest [m].
    pub fn depth_m(&self, effect: Effect) -> f64 {
        let radius = match effect {
            Effect::CameraBlind => CAMERA,
            Effect::RotorOut(_) | Effect::PowerLost => MOTOR,
        };
        2.0 * radius * self.diagonal_m
    }

    /// What a ray along a unit vector [body] strikes where it meets the hull: a motor, the camera, the battery behind the
    /// hull, an arm, else the hull before the board. What `is_lost` stands no longer before the rest.
    pub fn struck(
        &self,
        meets: &Meets,
        along_body: DVec3,
        is_lost: impl Fn(Effect) -> bool,
    ) -> Struck {
        let at_m = meets.r_body_m;
        // Distance of a place from the ray, and how far behind the face it lies [m].
        let passes = |place_m: DVec3| {
            let from_m = place_m - at_m;
            let behind_m = from_m.dot(along_body);
            ((from_m - behind_m * along_body).length(), behind_m)
        };
        let stands_at = |place_m: DVec3, radius_m: f64| {
            let (aside_m, behind_m) = passes(place_m);
            aside_m < radius_m && behind_m.abs() < BEFORE * radius_m
        };
        let (hubs, motor) = &self.hubs;
        let motor_m = MOTOR * self.diagonal_m;
        let turning = |rotor: &usize| !is_lost(Effect::RotorOut(*rotor));
        let motor_at = hubs.iter().position(|hub| stands_at(*hub, motor_m));
        if let Some(rotor) = motor_at.filter(turning) {
            return Struck {
                skin: *motor,
                effect: Effect::RotorOut(rotor),
                part: "motor",
                turns: true,
            };
        }
        let sees = !is_lost(Effect::CameraBlind);
        if sees && stands_at(self.camera.0, CAMERA * self.diagonal_m) {
            return Struck {
                skin: self.camera.1,
                effect: Effect::CameraBlind,
                part: "camera",
                turns: false,
            };
        }
        let (aside_m, behind_m) = passes(self.battery.0);
        if aside_m < BATTERY * self.diagonal_m && (-0.01..INSIDE_M).contains(&behind_m) {
            return Struck {
                skin: self.battery.1,
                effect: Effect::PowerLost,
                part: "battery",
                turns: false,
            };
        }
        let on_arm = |hub: &DVec3| {
            let out_m = hub.truncate().length();
            let way = hub.truncate() / out_m.max(1e-6);
            let along_m = at_m.truncate().dot(way);
            (ARM_BEGINS * out_m..=out_m).contains(&along_m)
                && at_m.truncate().perp_dot(way).abs() < ARM * self.diagonal_m
        };
        if let Some(rotor) = hubs.iter().position(on_arm).filter(turning) {
            return Struck {
                skin: self.arms.before(Room::Hollow),
                effect: Effect::RotorOut(rotor),
                part: "arm",
                turns: false,
            };
        }
        Struck {
            skin: self.body,
            effect: Effect::PowerLost,
            part: "body",
            turns: false,
        }
    }
}
