//! The mount obeys last tick's commands on a base that moves.

use crate::components::capture::CameraOf;
use crate::components::mount::{
    Boresight, CameraView, Gimbal, Mount, MountCommand, OpticalPath, Optics, PanTilt,
};
use crate::components::run::SimClock;
use crate::models::mount::base_motion::BaseMotion;
use crate::models::mount::gimbal::{self, GimbalCommand};
use bevy::prelude::*;
use glam::{DVec2, DVec3};

/// Steps base, gimbal and mirror of every station, and the gimbals of single cameras on its base.
pub fn turn(
    clock: Res<SimClock>,
    mut stations: Query<(Entity, &mut Mount, &MountCommand, &mut Optics)>,
    mut pan_tilts: Query<&mut PanTilt>,
    mut paths: Query<&mut OpticalPath>,
) {
    let dt_s = clock.dt_s();
    for (station, mut mount, command, mut optics) in &mut stations {
        let turned_rad = turn_mount(&mut mount, command, dt_s);
        *optics = mount.optics();
        for mut pan_tilt in &mut pan_tilts {
            if pan_tilt.station != station {
                continue;
            }
            let PanTilt {
                gimbal, command, ..
            } = &mut *pan_tilt;
            let torque_nm = gimbal.follow(&mount.base, turned_rad, dt_s);
            gimbal.step(command, torque_nm, dt_s);
            if let Ok(mut path) = paths.get_mut(pan_tilt.camera) {
                *path = pan_tilt.path();
            }
        }
    }
}

impl Gimbal {
    /// Torque on the axes [N m] by which the load drags behind its base, which turned by this [rad] in the
    /// last `dt_s` [s].
    fn follow(&mut self, base: &BaseMotion, turned_rad: DVec3, dt_s: f64) -> [f64; 2] {
        let Self {
            params,
            state,
            base_rate_radps,
            ..
        } = self;
        state.follow_base(params, base_rate_radps, base.rate_radps(), turned_rad, dt_s)
    }

    /// Obeys a command for a tick, under torques [N m] on its axes.
    fn step(&mut self, command: &GimbalCommand, torque_nm: [f64; 2], dt_s: f64) {
        gimbal::step(&mut self.state, &self.params, command, torque_nm, dt_s);
        (self.state).read_gyros(&mut self.gyros, dt_s);
    }
}

/// Where every camera looks after its mount has turned.
pub fn look(
    stations: Query<(&Mount, &Optics)>,
    mut cameras: Query<(&CameraOf, &OpticalPath, &Boresight, &mut CameraView)>,
) {
    for (of, path, boresight, mut view) in &mut cameras {
        if let Ok((mount, optics)) = stations.get(of.0) {
            *view = CameraView {
                q_before_enu_cam: view.pose.q_enu_cam,
                ..mount.camera_view(*path, boresight, optics)
            };
        }
    }
}

/// Steps base, gimbal and mirror of one station; the turn of the base [rad].
fn turn_mount(mount: &mut Mount, command: &MountCommand, dt_s: f64) -> DVec3 {
    let Mount {
        base,
        rng,
        gimbal,
        gyro,
        wind,
        ..
    } = mount;
    let before_rad = base.tilt_rad();
    base.step(rng);
    let turned_rad = base.tilt_rad() - before_rad;
    gyro.read(turned_rad, base.rate_radps(), dt_s);
    let mut torque_nm = gimbal.follow(base, turned_rad, dt_s);
    if let Some(wind) = wind {
        // The air passes a station that stands still.
        let gust = wind.gusts.step(dt_s, wind.height_agl_m, 0.0, &mut wind.rng);
        wind.torque_nm = wind.load.torque_nm(
            wind.air_density_kgpm3,
            wind.mean_enu_mps + gust,
            gimbal.state.az_el_rad(),
        );
        torque_nm = [0, 1].map(|i| torque_nm[i] + wind.torque_nm[i]);
    }
    gimbal.step(&command.gimbal, torque_nm, dt_s);
    mount.mirror.step(command.mirror_rad);
    let [right, up] = [0, 1].map(|_| mount.mirror_rng.normal());
    (mount.mirror).read(mount.mirror_params.noise_rad * DVec2::new(right, up));
    turned_rad
}
