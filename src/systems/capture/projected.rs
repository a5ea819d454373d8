//! What a camera would see of a UAV if nothing stood before it.

use crate::components::capture::UavInFrame;
use crate::components::flight::{Flight, UavShape};
use crate::models::maths::kinematics::Pose;
use crate::models::optics::camera::Pinhole;
use glam::{DMat3, DQuat, DVec2, DVec3};

/// What a camera would see of a UAV if nothing stood before it; without its identity.
pub fn projected(
    pinhole: &Pinhole,
    pose: &Pose,
    flight: &Flight,
    shape: &UavShape,
) -> Option<UavInFrame> {
    let body = (flight.state.r_enu_m, flight.state.q_enu_body);
    let box_px = projected_box(pinhole, pose, body, shape)?;
    let to_target_m = flight.aim_enu_m() - pose.r_enu_m;
    let aim_px = pinhole.project(pose.q_enu_cam.inverse() * to_target_m)?;
    Some(UavInFrame {
        uav: 0,
        distractor: false,
        box_px,
        aim_px: aim_px.to_array(),
        range_m: to_target_m.length(),
        clear: true,
        rendered: None,
    })
}

/// The box around the projection of a UAV's airframe and rotor discs [px]; `None` if it is not
/// wholly in front of the camera or misses the sensor.
fn projected_box(
    pinhole: &Pinhole,
    pose: &Pose,
    (r_enu_m, q_enu_body): (DVec3, DQuat),
    shape: &UavShape,
) -> Option<[f64; 4]> {
    let q_cam_enu = pose.q_enu_cam.inverse();
    let r_cam_m = q_cam_enu * (r_enu_m - pose.r_enu_m);
    let radius_m = shape.radius_m;
    if r_cam_m.z <= radius_m {
        return None;
    }
    // Off the sensor by more than its own size: no vertex needs projecting.
    let centre = pinhole.project(r_cam_m)?;
    let reach_px = 2.0 * pinhole.focal_px * radius_m / (r_cam_m.z - radius_m);
    let (width, height) = (f64::from(pinhole.width_px), f64::from(pinhole.height_px));
    let outside = |x: f64, side: f64| x < -reach_px || x > side + reach_px;
    if outside(centre.x, width) || outside(centre.y, height) {
        return None;
    }
    let to_cam = DMat3::from_quat(q_cam_enu * q_enu_body);
    let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
    for corner_body_m in &shape.outline_body_m {
        let px = pinhole.project(r_cam_m + to_cam * *corner_body_m)?;
        low = low.min(px);
        high = high.max(px);
    }
    (high.x > 0.0 && high.y > 0.0 && low.x < width && low.y < height)
        .then_some([low.x, low.y, high.x, high.y])
}
