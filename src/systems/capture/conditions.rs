//! How a frame is exposed: its setting, the motion of its image, the sun on its lens.

use super::metering;
use crate::components::capture::{AutoExposure, Conditions, SensorCamera, UavInFrame};
use crate::components::environment::Environment;
use crate::models::maths::kinematics::Pose;
use crate::models::optics::camera::Pinhole;
use crate::models::optics::glare::SunGlare;
use crate::models::optics::motion::ImageMotion;
use crate::models::optics::stray::light::StrayLight;
use glam::{DQuat, DVec2, DVec3};
use std::sync::Arc;

/// Motion on the image [px/s] of a point [m, in the camera's frame] with a velocity against it.
fn image_velocity_pxps(pinhole: &Pinhole, r_cam_m: DVec3, v_cam_mps: DVec3) -> DVec2 {
    let z_m = r_cam_m.z;
    pinhole.focal_px * (v_cam_mps.truncate() - r_cam_m.truncate() * (v_cam_mps.z / z_m)) / z_m
}

/// The motion of the image of a camera that came from the attitude `q_before` in `dt_s`, with what
/// flies in it: places and velocities [m, m/s, enu] by the index in the truth.
pub(super) fn image_motion(
    pinhole: &Pinhole,
    pose: &Pose,
    q_before: DQuat,
    dt_s: f64,
    truth: &[UavInFrame],
    flying: impl Fn(usize) -> Option<(DVec3, DVec3)>,
) -> ImageMotion {
    // Turn of the camera in its own axes.
    let omega_cam_radps = (q_before.inverse() * pose.q_enu_cam).to_scaled_axis() / dt_s;
    let to_cam = pose.q_enu_cam.inverse();
    let velocity_pxps = |r_cam_m: DVec3, v_cam_mps: DVec3| {
        let turning = v_cam_mps - omega_cam_radps.cross(r_cam_m);
        image_velocity_pxps(pinhole, r_cam_m, turning)
    };
    let mut near_first: Vec<_> = truth.iter().collect();
    near_first.sort_by(|a, b| a.range_m.total_cmp(&b.range_m).then(a.uav.cmp(&b.uav)));
    ImageMotion {
        still_pxps: velocity_pxps(DVec3::Z, DVec3::ZERO),
        boxes: (near_first.into_iter())
            .filter_map(|seen| {
                let (r_enu_m, v_enu_mps) = flying(seen.uav)?;
                let r_cam_m = to_cam * (r_enu_m - pose.r_enu_m);
                Some((seen.box_px, velocity_pxps(r_cam_m, to_cam * v_enu_mps)))
            })
            .collect(),
    }
}

/// The sun's glare in a camera; none where the sun is behind it, behind something or down.
pub fn sun_glare(environment: &Environment, pinhole: &Pinhole, pose: &Pose) -> Option<SunGlare> {
    /// Farthest that something is looked for before the sun [m].
    const FAR_M: f64 = 10_000.0;
    let sun_cam = pose.q_enu_cam.inverse() * environment.backdrop.sun_dir_enu;
    let sun_klx = environment.backdrop.sky.sun_illuminance();
    let dsm = &environment.city.dsm;
    let shines = sun_cam.z > 0.0
        && sun_klx.into_iter().sum::<f64>() > 0.0
        && dsm
            .first_hit(pose.r_enu_m, environment.backdrop.sun_dir_enu, FAR_M)
            .is_none();
    shines.then(|| SunGlare {
        sun_cam,
        sun_klx,
        focal_px: pinhole.focal_px,
        centre_px: pinhole.centre_px().to_array(),
    })
}

/// The conditions of a camera's next exposure.
pub(super) fn conditions(
    auto: &mut AutoExposure,
    camera: &SensorCamera,
    environment: &Environment,
    pose: &Pose,
    now: (u64, f64),
    (motion, stray): (ImageMotion, Option<Arc<StrayLight>>),
) -> Conditions {
    Conditions {
        exposure: metering::control(auto, camera, environment, pose, now, stray.as_deref()),
        motion,
        sun: sun_glare(environment, &camera.pinhole, pose),
        stray,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::maths::kinematics::exp_so3;

    #[test]
    fn the_image_moves_as_projections_do() {
        let pinhole = Pinhole::from_hfov(640, 480, 0.1).unwrap();
        let dt_s = 1e-3;
        let omega_cam_radps = DVec3::new(0.02, -0.05, 0.0);
        let before = Pose {
            r_enu_m: DVec3::new(1.0, 2.0, 3.0),
            q_enu_cam: exp_so3(DVec3::new(0.3, -1.2, 0.4)),
        };
        let pose = Pose {
            q_enu_cam: before.q_enu_cam * exp_so3(omega_cam_radps * dt_s),
            ..before
        };
        // A still point on the axis, and one that flies.
        let place = |pose: &Pose, r_enu_m: DVec3| {
            pinhole
                .project(pose.q_enu_cam.inverse() * (r_enu_m - pose.r_enu_m))
                .unwrap()
        };
        let still_enu_m = pose.r_enu_m + 500.0 * (pose.q_enu_cam * DVec3::Z);
        let (r_enu_m, v_enu_mps) = (still_enu_m + 4.0 * DVec3::X, DVec3::new(3.0, -8.0, 2.0));
        let seen = UavInFrame {
            uav: 0,
            distractor: false,
            box_px: [0.0; 4],
            aim_px: [0.0; 2],
            range_m: 500.0,
            clear: true,
            rendered: None,
        };
        let flying = |_| Some((r_enu_m, v_enu_mps));
        let motion = image_motion(&pinhole, &pose, before.q_enu_cam, dt_s, &[seen], flying);
        let still = (place(&pose, still_enu_m) - place(&before, still_enu_m)) / dt_s;
        assert!((motion.still_pxps - still).length() < 1e-3 * still.length());
        let flown = place(&before, r_enu_m - v_enu_mps * dt_s);
        let moving = (place(&pose, r_enu_m) - flown) / dt_s;
        let found = motion.boxes[0].1;
        assert!(
            (found - moving).length() < 1e-3 * moving.length(),
            "{found} {moving}"
        );
    }
}
