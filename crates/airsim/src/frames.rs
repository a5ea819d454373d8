//! AirSim's frames: the world north, east, down; bodies and cameras forward, right, down. Boresight's world is east,
//! north, up, its bodies are forward, left, up, its cameras right, down, forward.

use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::FRAC_1_SQRT_2;

/// A vector north, east, down, of one east, north, up; and the other way round.
pub fn swapped(v: DVec3) -> DVec3 {
    DVec3::new(v.y, v.x, -v.z)
}

/// A vector forward, right, down, of one forward, left, up; and the other way round.
pub fn flipped(v: DVec3) -> DVec3 {
    DVec3::new(v.x, -v.y, -v.z)
}

/// A vector forward, right, down, of one right, down, forward.
pub fn ahead(v_cam: DVec3) -> DVec3 {
    DVec3::new(v_cam.z, v_cam.x, v_cam.y)
}

/// From east, north, up to north, east, down: half a turn about their bisector.
fn q_ned_enu() -> DQuat {
    DQuat::from_xyzw(FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0, 0.0)
}

/// With the sign that makes its real part positive.
fn positive(q: DQuat) -> DQuat {
    match q.w < 0.0 {
        true => -q,
        false => q,
    }
}

/// How a body is turned: from forward, right, down to north, east, down.
pub fn attitude(q_enu_body: DQuat) -> DQuat {
    let q_body_frd = DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0);
    positive(q_ned_enu() * q_enu_body * q_body_frd)
}

/// How a camera is turned: from forward, right, down to north, east, down.
pub fn camera_attitude(q_enu_cam: DQuat) -> DQuat {
    let q_cam_frd = DQuat::from_mat3(&DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y));
    positive(q_ned_enu() * q_enu_cam * q_cam_frd)
}

/// Compass heading \[deg\], 0 to 360, of a yaw about down \[rad\].
pub fn heading_deg(yaw_rad: f64) -> f64 {
    yaw_rad.to_degrees().rem_euclid(360.0)
}

/// Yaw about down \[rad\] of an attitude of AirSim's.
pub fn yaw_rad(q_ned: DQuat) -> f64 {
    let nose = q_ned * DVec3::X;
    nose.y.atan2(nose.x)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: DVec3, b: DVec3) {
        assert!((a - b).length() < 1e-12, "{a} {b}");
    }

    #[test]
    fn directions_keep_their_meaning() {
        // A body whose nose looks to the east, banked to the right by 0.3 rad.
        let q_enu_body = DQuat::from_rotation_x(0.3);
        let q = attitude(q_enu_body);
        close(q * DVec3::X, DVec3::Y);
        // Its right wing points south and down.
        let right_enu = q_enu_body * -DVec3::Y;
        close(q * DVec3::Y, swapped(right_enu));
        assert!((q * DVec3::Y).x < -0.9 && (q * DVec3::Y).z > 0.2);
        assert!((yaw_rad(q).to_degrees() - 90.0).abs() < 1e-9 && q.w >= 0.0);
        // Any vector of the body is the same in both worlds.
        for v_flu in [DVec3::X, DVec3::Y, DVec3::new(0.3, -2.0, 5.0)] {
            close(q * flipped(v_flu), swapped(q_enu_body * v_flu));
        }
    }

    #[test]
    fn a_camera_looks_along_its_own_x() {
        // A camera that looks to the north: right is east, down is down.
        let q_enu_cam = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
        close(q_enu_cam * DVec3::Z, DVec3::Y);
        let q = camera_attitude(q_enu_cam);
        close(q * DVec3::X, DVec3::X);
        close(q * DVec3::Y, DVec3::Y);
        for v_cam in [DVec3::X, DVec3::Z, DVec3::new(-3.0, 0.5, 20.0)] {
            close(q * ahead(v_cam), swapped(q_enu_cam * v_cam));
        }
        let turned = DQuat::from_rotation_z(1.1) * q_enu_cam;
        for v_cam in [DVec3::X, DVec3::new(-3.0, 0.5, 20.0)] {
            close(
                camera_attitude(turned) * ahead(v_cam),
                swapped(turned * v_cam),
            );
        }
    }

    #[test]
    fn headings_go_round_the_compass() {
        assert_eq!(heading_deg(0.0), 0.0);
        assert!((heading_deg(-std::f64::consts::FRAC_PI_2) - 270.0).abs() < 1e-12);
    }
}
