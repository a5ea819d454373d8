//! The station: mount, optics, commands.

use crate::models::air::wind::DrydenGust;
use crate::models::control::tuning::MountPlant;
use crate::models::maths::kinematics::{Pose, boresight_chain, exp_so3};
use crate::models::maths::rng::Stream;
use crate::models::mount::base_motion::BaseMotion;
use crate::models::mount::gimbal::{GimbalCommand, GimbalParams, GimbalState, WindLoad};
use crate::models::mount::gyro::{Gyro, TiltGyro};
use crate::models::mount::mirror::{Mirror, MirrorParams};
use crate::models::optics::camera::Pinhole;
use bevy::prelude::*;
use glam::{DQuat, DVec2, DVec3};

/// A laser station. What it has once hangs on its entity; its cameras are entities of their own. Stations and
/// cameras are spawned in the order of the scenario and given the same components, so that every query meets
/// them in that order.
#[derive(Component, Clone, Debug, PartialEq, Eq)]
pub struct Station {
    /// Its number in the scenario.
    pub index: usize,
    /// Its name.
    pub name: String,
}

impl Station {
    /// What topics, frames and logs call a part of this station: the first one's go by their own names.
    pub fn named(&self, part: &str) -> String {
        match self.index {
            0 => part.to_owned(),
            _ => format!("{}/{part}", self.name),
        }
    }
}

/// The stations in the order of the scenario.
#[derive(Resource, Clone, Debug, Default)]
pub struct Stations(pub Vec<Entity>);

/// What the first station has: the one that a run of a single station is about.
pub fn first_station<C: Component>(world: &World) -> Option<&C> {
    world.get(*world.get_resource::<Stations>()?.0.first()?)
}

/// Two driven axes on a base, and what senses them.
#[derive(Clone, Debug)]
pub struct Gimbal {
    /// Constants.
    pub params: GimbalParams,
    /// Angles and rates; the true ones: what the station knows is measured.
    pub state: GimbalState,
    /// Gyros on its rotors.
    pub gyros: Gyro<2>,
    /// Base rate about the axes in the last tick [rad/s], for the reaction torque.
    pub base_rate_radps: [f64; 2],
}

impl Gimbal {
    /// A gimbal at rest, as near to an azimuth and elevation of 0 as its stops allow.
    pub fn new(params: GimbalParams, gyros: Gyro<2>) -> Self {
        Self {
            state: GimbalState::at_rest(params.within_stops(DVec2::ZERO)),
            params,
            gyros,
            base_rate_radps: [0.0; 2],
        }
    }
}

/// The two-axis mount on its moving base, and the fast steering mirror behind it.
#[derive(Component, Clone, Debug)]
pub struct Mount {
    /// Where the axes cross [m].
    pub r_enu_m: DVec3,
    /// The gimbal.
    pub gimbal: Gimbal,
    /// Constants of the mirror.
    pub mirror_params: MirrorParams,
    /// Deflection and rate of the mirror.
    pub mirror: Mirror,
    /// Stream of the noise of the mirror's sensor.
    pub mirror_rng: Stream,
    /// Tilt of the base.
    pub base: BaseMotion,
    /// Stream of the base motion.
    pub rng: Stream,
    /// Gyro on the base.
    pub gyro: TiltGyro,
    /// Wind on the gimbal, where it is modelled.
    pub wind: Option<StationWind>,
}

impl Mount {
    /// Azimuth and elevation from the encoders [rad].
    pub fn measured_az_el_rad(&self) -> DVec2 {
        self.gimbal.state.encoder_az_el_rad()
    }

    /// What a pointing law is made for: gimbal and mirror, commanded every `dt_s` [s].
    pub fn plant(&self, dt_s: f64) -> MountPlant {
        MountPlant {
            gimbal: self.gimbal.params,
            mirror: self.mirror_params,
            gyro: *self.gimbal.gyros.params(),
            dt_s,
        }
    }

    /// Where the laser really points, and what the station knows of it.
    pub fn optics(&self) -> Optics {
        let pointing = Pointing {
            az_el_rad: self.measured_az_el_rad(),
            mirror_rad: self.mirror.measured_rad(),
            base_tilt_rad: self.gyro.tilt_enu_rad,
        };
        Optics {
            laser: self.true_pose(OpticalPath::BehindMirror, DVec3::ZERO),
            pointing,
        }
    }

    /// Where a camera on this mount looks now, at rest so far.
    pub fn camera_view(
        &self,
        path: OpticalPath,
        boresight: &Boresight,
        optics: &Optics,
    ) -> CameraView {
        let pose = self.true_pose(path, boresight.true_rad);
        CameraView {
            pose,
            believed: (optics.pointing).pose(self.r_enu_m, path, boresight.known_rad),
            q_before_enu_cam: pose.q_enu_cam,
        }
    }

    /// The true pose of an optic on this mount, turned against the laser by a rotation vector [rad].
    fn true_pose(&self, path: OpticalPath, turned_rad: DVec3) -> Pose {
        let [az, el] = match path {
            OpticalPath::Apart { az_el_rad, .. } => az_el_rad,
            _ => self.gimbal.state.az_el_rad(),
        }
        .to_array();
        let mirror_rad = path.mirror_rad(self.mirror.deflection_rad());
        boresight_chain(
            self.r_enu_m,
            self.base.tilt_rad(),
            az,
            el,
            mirror_rad,
            turned_rad,
        )
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

/// What the mount was told; it obeys from the next tick on.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct MountCommand {
    /// Rates of the axes.
    pub gimbal: GimbalCommand,
    /// Line-of-sight deflection of the mirror, right and up [rad].
    pub mirror_rad: DVec2,
}

/// What the station knows of its own pointing: encoders, mirror sensor and gyro; not the gyro's drift.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pointing {
    /// Encoder azimuth and elevation [rad].
    pub az_el_rad: DVec2,
    /// Mirror deflection, right and up [rad].
    pub mirror_rad: DVec2,
    /// Tilt of the base by the gyro [rad].
    pub base_tilt_rad: DVec3,
}

impl Pointing {
    /// The pose that the station at `r_station_enu_m` [m] believes an optic to have, turned against the laser by
    /// a rotation vector [rad].
    pub fn pose(&self, r_station_enu_m: DVec3, path: OpticalPath, turned_rad: DVec3) -> Pose {
        let [az, el] = match path {
            OpticalPath::Apart {
                measured_az_el_rad, ..
            } => measured_az_el_rad,
            _ => self.az_el_rad,
        }
        .to_array();
        let mirror_rad = path.mirror_rad(self.mirror_rad);
        boresight_chain(
            r_station_enu_m,
            self.base_tilt_rad,
            az,
            el,
            mirror_rad,
            turned_rad,
        )
    }

    /// Where the station believes its laser to point.
    pub fn laser_axis_enu(&self) -> DVec3 {
        let pose = self.pose(DVec3::ZERO, OpticalPath::BehindMirror, DVec3::ZERO);
        pose.q_enu_cam * DVec3::Z
    }
}

/// Where the laser really points in this tick.
#[derive(Component, Clone, Copy, Debug)]
pub struct Optics {
    /// Pose of the laser, whose path is that of what stands behind the mirror.
    pub laser: Pose,
    /// What the station knows of it.
    pub pointing: Pointing,
}

/// What turns an optic.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub enum OpticalPath {
    /// The gimbal.
    OnGimbal,
    /// The gimbal, and behind it the mirror, as the laser.
    BehindMirror,
    /// Neither: it stands on the base, fixed or on a [`PanTilt`] of its own.
    Apart {
        /// Azimuth (x) and elevation (y) that it looks at [rad].
        az_el_rad: DVec2,
        /// The same as measured [rad].
        measured_az_el_rad: DVec2,
    },
}

impl OpticalPath {
    /// What a mirror's deflection [rad] turns of it.
    fn mirror_rad(self, deflection_rad: DVec2) -> DVec2 {
        match self {
            OpticalPath::BehindMirror => deflection_rad,
            OpticalPath::OnGimbal | OpticalPath::Apart { .. } => DVec2::ZERO,
        }
    }

    /// Whether the station's gimbal turns it.
    pub fn is_on_gimbal(self) -> bool {
        !matches!(self, OpticalPath::Apart { .. })
    }
}

/// A gimbal that turns one camera alone and searches with it, whatever the station does. It hangs on an entity
/// of its own, so that all cameras have the same components. The wind does not reach it.
#[derive(Component, Clone, Debug)]
pub struct PanTilt {
    /// The station on whose base it stands.
    pub station: Entity,
    /// What it turns.
    pub camera: Entity,
    /// Its axes.
    pub gimbal: Gimbal,
    /// What it was told; it obeys from the next tick on.
    pub command: GimbalCommand,
}

impl PanTilt {
    /// The path of its camera.
    pub fn path(&self) -> OpticalPath {
        OpticalPath::Apart {
            az_el_rad: self.gimbal.state.az_el_rad(),
            measured_az_el_rad: self.gimbal.state.encoder_az_el_rad(),
        }
    }
}

/// How a camera is turned against its station's laser, which defines the axis: rotation vectors in camera axes.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq)]
pub struct Boresight {
    /// The true turn [rad].
    pub true_rad: DVec3,
    /// The turn as calibrated [rad].
    pub known_rad: DVec3,
    /// Standard error of that across the line of sight, per axis [rad].
    pub sigma_rad: f64,
}

impl Boresight {
    /// Where the camera would show the laser's axis [px], by what the station knows; for a camera on the gimbal
    /// with the mirror at its centre.
    pub fn reticle_px(&self, pinhole: &Pinhole) -> DVec2 {
        pinhole
            .project(exp_so3(-self.known_rad) * DVec3::Z)
            .unwrap_or(pinhole.centre_px())
    }
}

/// Where a camera looks in this tick.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct CameraView {
    /// Its true pose.
    pub pose: Pose,
    /// The pose that the station believes it to have.
    pub believed: Pose,
    /// Its true attitude one tick ago.
    pub q_before_enu_cam: DQuat,
}

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
            let boresight = Boresight {
                known_rad: known,
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
            let ray_cam = pinhole.ray(boresight.reticle_px(&pinhole));
            let target_enu = pose(truth).q_enu_cam * ray_cam;
            // ... is on the station's axis, and off the laser's by what is not known.
            let pointing = Pointing {
                az_el_rad: at,
                mirror_rad: DVec2::ZERO,
                base_tilt_rad: DVec3::ZERO,
            };
            let believed = pointing.pose(DVec3::ZERO, OpticalPath::BehindMirror, known);
            let believed = believed.q_enu_cam * ray_cam;
            assert!(error_angles(pose(DVec3::ZERO).q_enu_cam, believed).length() < 1e-12);
            let miss = error_angles(pose(DVec3::ZERO).q_enu_cam, target_enu);
            assert!((miss.abs() - expected_rad).length() < 1e-8, "{miss}");
        }
    }
}
