//! The station: mount, optics, commands.

use crate::components::camera::Tier;
use crate::models::base_motion::BaseMotion;
use crate::models::gimbal::{GimbalCommand, GimbalParams, GimbalState};
use crate::models::kinematics::{Pose, boresight_chain};
use crate::models::mirror::{Mirror, MirrorParams};
use crate::models::rng::Stream;
use bevy::prelude::*;
use glam::{DVec2, DVec3};

/// The two-axis mount on its moving base, and the fast steering mirror behind it.
#[derive(Component, Clone, Debug)]
pub struct Mount {
    /// Where the axes cross [m].
    pub r_enu_m: DVec3,
    /// Constants of the gimbal.
    pub params: GimbalParams,
    /// Angles and rates of the gimbal.
    pub gimbal: GimbalState,
    /// Constants of the mirror.
    pub mirror_params: MirrorParams,
    /// The mirror.
    pub mirror: Mirror,
    /// Tilt of the base.
    pub base: BaseMotion,
    /// Stream of the base motion.
    pub rng: Stream,
    /// Base rate about the axes in the last tick [rad/s], for the reaction torque.
    pub base_rate_radps: [f64; 2],
    /// Fibre-optic gyro on the base.
    pub gyro: Gyro,
}

/// A gyro that integrates the base's tilt from a levelled start.
#[derive(Clone, Debug)]
pub struct Gyro {
    /// Angle random walk [rad/sqrt(s)].
    pub angle_random_walk: f64,
    /// Stream of its noise.
    pub rng: Stream,
    /// Measured rate [rad/s].
    pub rate_enu_radps: DVec3,
    /// Integrated tilt [rad].
    pub tilt_enu_rad: DVec3,
}

/// What the mount was told; it obeys from the next tick on.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct MountCommand {
    /// Rates of the axes.
    pub gimbal: GimbalCommand,
    /// Line-of-sight deflection of the mirror, right and up [rad].
    pub mirror_rad: DVec2,
}

/// What the station knows of its own pointing: encoders, mirror sensor and gyro; not the gyro's
/// drift nor boresight errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pointing {
    /// Encoder azimuth and elevation [rad].
    pub az_el_rad: DVec2,
    /// Mirror deflection, right and up [rad].
    pub mirror_rad: DVec2,
    /// Tilt of the base by the gyro [rad].
    pub base_tilt_rad: DVec3,
}

impl Pointing {
    /// The pose the station believes a camera of `tier` to have.
    pub fn believed_pose(&self, r_station_enu_m: DVec3, tier: Tier) -> Pose {
        let [az, el] = self.az_el_rad.to_array();
        let mirror_rad = if tier == Tier::Precise {
            self.mirror_rad
        } else {
            DVec2::ZERO
        };
        boresight_chain(
            r_station_enu_m,
            self.base_tilt_rad,
            az,
            el,
            mirror_rad,
            DVec3::ZERO,
        )
    }
}

/// Where the optics really point in this tick.
#[derive(Component, Clone, Copy, Debug)]
pub struct Optics {
    /// Poses of the cameras, in the order of [`Tier::ALL`].
    pub cameras: [Pose; 3],
    /// Pose of the laser, which shares the precise camera's path.
    pub laser: Pose,
    /// What the station knows of it.
    pub pointing: Pointing,
}

impl Optics {
    /// Pose of the camera of `tier`.
    pub fn camera(&self, tier: Tier) -> Pose {
        self.cameras[tier as usize]
    }
}

/// Boresight errors [rad], rotation vectors in camera axes, in the order of [`Tier::ALL`]; the
/// laser defines the axis.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Misalignment(pub [DVec3; 3]);
