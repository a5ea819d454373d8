//! The station: mount, optics, commands.

use crate::models::air::wind::DrydenGust;
use crate::models::maths::kinematics::{Pose, boresight_chain, exp_so3};
use crate::models::maths::rng::Stream;
use crate::models::mount::base_motion::BaseMotion;
use crate::models::mount::gimbal::{GimbalCommand, GimbalParams, GimbalState, WindLoad};
use crate::models::mount::mirror::{Mirror, MirrorParams};
use crate::models::optics::camera::Pinhole;
use crate::models::optics::tier::Tier;
use bevy::prelude::*;
use glam::{DVec2, DVec3};

/// The two-axis mount on its moving base, and the fast steering mirror behind it.
#[derive(Component, Clone, Debug)]
pub struct Mount {
    /// Where the axes cross [m].
    pub r_enu_m: DVec3,
    /// Constants of the gimbal.
    pub params: GimbalParams,
    /// Angles and rates of the gimbal; the true ones: what the station knows is measured.
    pub gimbal: GimbalState,
    /// Stream of the noise of the axes' gyros.
    pub axis_gyro_rng: Stream,
    /// Constants of the mirror.
    pub mirror_params: MirrorParams,
    /// Deflection and rate of the mirror.
    pub mirror: Mirror,
    /// Tilt of the base.
    pub base: BaseMotion,
    /// Stream of the base motion.
    pub rng: Stream,
    /// Base rate about the axes in the last tick [rad/s], for the reaction torque.
    pub base_rate_radps: [f64; 2],
    /// Fibre-optic gyro on the base.
    pub gyro: Gyro,
    /// Wind on the gimbal, where it is modelled.
    pub wind: Option<StationWind>,
    /// The cameras' boresights as calibrated.
    pub alignment: Alignment,
}

impl Mount {
    /// Azimuth and elevation from the encoders [rad].
    pub fn measured_az_el_rad(&self) -> DVec2 {
        self.gimbal.encoder_az_el_rad()
    }

    /// Azimuth and elevation rates from the axes' gyros [rad/s].
    pub fn measured_rates_radps(&self) -> DVec2 {
        self.gimbal.gyro_rates_radps()
    }

    /// The true poses and the known pointing.
    pub fn optics(&self, misalignment: &Misalignment) -> Optics {
        let pointing = Pointing {
            az_el_rad: self.measured_az_el_rad(),
            mirror_rad: self.mirror.deflection_rad(),
            base_tilt_rad: self.gyro.tilt_enu_rad,
            alignment: self.alignment,
        };
        let [az, el] = self.gimbal.az_el_rad().to_array();
        let tilt = self.base.tilt_rad();
        let pose = |mirror_rad: DVec2, misalignment_rad: DVec3| {
            boresight_chain(self.r_enu_m, tilt, az, el, mirror_rad, misalignment_rad)
        };
        Optics {
            cameras: Tier::ALL.map(|tier| {
                let mirror_rad = if tier == Tier::Precise {
                    pointing.mirror_rad
                } else {
                    DVec2::ZERO
                };
                pose(mirror_rad, misalignment.0[tier as usize])
            }),
            laser: pose(pointing.mirror_rad, DVec3::ZERO),
            pointing,
        }
    }
}

/// The wind at the station and what it gets hold of.
#[derive(Clone, Debug)]
pub struct StationWind {
    /// Drag area and arm.
    pub load: WindLoad,
    /// Mean wind [m/s].
    pub mean_enu_mps: DVec3,
    /// Height above the ground [m].
    pub height_agl_m: f64,
    /// Air density [kg/m³].
    pub air_density_kgpm3: f64,
    /// Gusts upon the mean.
    pub gusts: DrydenGust,
    /// Stream of the gusts.
    pub rng: Stream,
    /// Torque on azimuth and elevation in the last tick [N m].
    pub torque_nm: [f64; 2],
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

/// What the station knows of its own pointing: encoders, mirror sensor, gyro and calibrated
/// boresights; not the gyro's drift nor what calibration left.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pointing {
    /// Encoder azimuth and elevation [rad].
    pub az_el_rad: DVec2,
    /// Mirror deflection, right and up [rad].
    pub mirror_rad: DVec2,
    /// Tilt of the base by the gyro [rad].
    pub base_tilt_rad: DVec3,
    /// The cameras' boresights as calibrated.
    pub alignment: Alignment,
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
            self.alignment.rotation_rad[tier as usize],
        )
    }

    /// Where the station believes its laser to point.
    pub fn laser_axis_enu(&self) -> DVec3 {
        let [az, el] = self.az_el_rad.to_array();
        let pose = boresight_chain(
            DVec3::ZERO,
            self.base_tilt_rad,
            az,
            el,
            self.mirror_rad,
            DVec3::ZERO,
        );
        pose.q_enu_cam * DVec3::Z
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

/// What the station holds for the boresights of its cameras, in the order of [`Tier::ALL`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Alignment {
    /// Rotation vectors against the laser in camera axes [rad].
    pub rotation_rad: [DVec3; 3],
    /// Their standard errors across the line of sight, per axis [rad].
    pub sigma_rad: [f64; 3],
}

impl Alignment {
    /// Where a camera of `tier` would show the laser's axis [px], by what the station knows; for
    /// the cameras on the gimbal with the mirror at its centre.
    pub fn reticle_px(&self, pinhole: &Pinhole, tier: Tier) -> DVec2 {
        pinhole
            .project(exp_so3(-self.rotation_rad[tier as usize]) * DVec3::Z)
            .unwrap_or(pinhole.centre_px())
    }
}

/// True boresight errors [rad], rotation vectors in camera axes, in the order of [`Tier::ALL`]; the
/// laser defines the axis.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct Misalignment(pub [DVec3; 3]);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::maths::kinematics::error_angles;

    #[test]
    fn without_calibration_the_laser_misses_by_the_misalignment() {
        // The mount closes on the target as the precise camera shows it and the station reads it.
        let pinhole = Pinhole::from_hfov(640, 480, 1.0f64.to_radians()).unwrap();
        let truth = DVec3::new(40e-6, -30e-6, 20e-6);
        for (known, expected_rad) in [
            (DVec3::ZERO, DVec2::new(30e-6, 40e-6)),
            (truth, DVec2::ZERO),
        ] {
            let alignment = Alignment {
                rotation_rad: [DVec3::ZERO, DVec3::ZERO, known],
                ..default()
            };
            let at = DVec2::new(0.4, 0.2);
            let pose = |misalignment| {
                boresight_chain(
                    DVec3::ZERO,
                    DVec3::ZERO,
                    at.x,
                    at.y,
                    DVec2::ZERO,
                    misalignment,
                )
            };
            // A target on the reticle ...
            let ray_cam = pinhole.ray(alignment.reticle_px(&pinhole, Tier::Precise));
            let target_enu = pose(truth).q_enu_cam * ray_cam;
            // ... is on the station's axis, and off the laser's by what is not known.
            let pointing = Pointing {
                az_el_rad: at,
                mirror_rad: DVec2::ZERO,
                base_tilt_rad: DVec3::ZERO,
                alignment,
            };
            let believed = pointing.believed_pose(DVec3::ZERO, Tier::Precise).q_enu_cam * ray_cam;
            assert!(error_angles(pose(DVec3::ZERO).q_enu_cam, believed).length() < 1e-12);
            let miss = error_angles(pose(DVec3::ZERO).q_enu_cam, target_enu);
            assert!((miss.abs() - expected_rad).length() < 1e-8, "{miss}");
        }
    }
}
