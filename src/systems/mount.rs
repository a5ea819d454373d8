//! The mount obeys last tick's commands on a base that moves.

use crate::components::capture::CameraOf;
use crate::components::mount::{Boresight, CameraView, Mount, MountCommand, OpticalPath, Optics};
use crate::components::run::SimClock;
use crate::models::mount::gimbal;
use bevy::prelude::*;

/// Steps base, gimbal and mirror of every station.
pub fn turn(clock: Res<SimClock>, mut stations: Query<(&mut Mount, &MountCommand, &mut Optics)>) {
    for (mut mount, command, mut optics) in &mut stations {
        turn_mount(&mut mount, command, clock.dt_s());
        *optics = mount.optics();
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

/// Steps base, gimbal and mirror of one station.
fn turn_mount(mount: &mut Mount, command: &MountCommand, dt_s: f64) {
    let Mount {
        base,
        rng,
        gimbal,
        params,
        axis_gyro_rng,
        base_rate_radps,
        gyro,
        wind,
        ..
    } = mount;
    let before_rad = base.tilt_rad();
    base.step(rng);
    let noise = gyro.rng.normal3() * (gyro.angle_random_walk / dt_s.sqrt());
    gyro.rate_enu_radps = base.rate_radps() + noise;
    // A gyro integrates inside: what it gives is the turn itself, not a sample of the rate.
    gyro.tilt_enu_rad += base.tilt_rad() - before_rad + noise * dt_s;
    let turned_rad = base.tilt_rad() - before_rad;
    let mut torque_nm =
        gimbal.follow_base(params, base_rate_radps, base.rate_radps(), turned_rad, dt_s);
    if let Some(wind) = wind {
        // The air passes a station that stands still.
        let gust = wind.gusts.step(dt_s, wind.height_agl_m, 0.0, &mut wind.rng);
        wind.torque_nm = wind.load.torque_nm(
            wind.air_density_kgpm3,
            wind.mean_enu_mps + gust,
            gimbal.az_el_rad(),
        );
        torque_nm = [0, 1].map(|i| torque_nm[i] + wind.torque_nm[i]);
    }
    gimbal::step(gimbal, params, &command.gimbal, torque_nm, dt_s);
    gimbal.add_gyro_noise(params, axis_gyro_rng, dt_s);
    mount.mirror.step(command.mirror_rad);
}
