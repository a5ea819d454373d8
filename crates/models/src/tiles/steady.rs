//! Views that stay while a camera turns a little: what was loaded for one serves all that lie inside it.
//!
//! Directions and places are rounded to a lattice, and the field is widened by more than the rounding. So the tiles
//! that a picture is drawn from are a function of the camera's pose alone, not of the poses before, and yet
//! change only when the camera has turned by some quarter of its half diagonal field.

use crate::maths::kinematics::{az_el_to_los, los_to_az_el};
use crate::optics::camera::Pinhole;
use crate::tiles::selection::View;
use glam::{DQuat, DVec2, DVec3};
use std::f64::consts::TAU;

/// Step of the lattice of directions, as a share of the half diagonal field.
const STEP: f64 = 0.25;
/// Widest half field that is asked for [rad]: a picture has an edge.
const WIDEST_RAD: f64 = 1.4;
/// Step of the lattice of places over that of directions [m/rad], and its largest [m].
const PLACE_PER_RAD_M: f64 = 1.5;
const LARGEST_STEP_M: f64 = 0.25;

/// A square view, upright, with the scale of a camera's pixels (its focal length), that holds all of what the camera sees from 15 m
/// on; in the frame of the camera's place and attitude (optical: x right, y down, z forward), whose z is up.
pub fn steady_view(pinhole: &Pinhole, r_m: DVec3, q_cam: DQuat) -> View {
    let half_px = 0.5 * f64::from(pinhole.width_px).hypot(f64::from(pinhole.height_px));
    let half_rad = (half_px / pinhole.focal_px).atan();
    let step_rad = STEP * half_rad;
    let az_el_rad = los_to_az_el(q_cam * DVec3::Z);
    let el_rad = (az_el_rad.y / step_rad).round() * step_rad;
    // As many azimuths as keep the step along a circle of this elevation.
    let around = (TAU * el_rad.cos().max(0.0) / step_rad).ceil().max(1.0);
    let az_rad = (az_el_rad.x / TAU * around).round() / around * TAU;
    let step_m = (PLACE_PER_RAD_M * step_rad).min(LARGEST_STEP_M);
    // Rounding turns by at most 0.88 steps.
    let wide_rad = (half_rad + step_rad).min(WIDEST_RAD);
    let side_px = (2.0 * pinhole.focal_px * wide_rad.tan()).ceil();
    let forward = az_el_to_los(DVec2::new(az_rad, el_rad));
    let up = az_el_to_los(DVec2::new(az_rad, el_rad + 0.5 * std::f64::consts::PI));
    View {
        r_root_m: (r_m / step_m).round() * step_m,
        forward,
        up,
        fovy_rad: 2.0 * (0.5 * side_px / pinhole.focal_px).atan(),
        size_px: [side_px as u32; 2],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn inside(view: &View, r_m: DVec3) -> bool {
        let to = r_m - view.r_root_m;
        let right = view.forward.cross(view.up);
        let edge = (0.5 * view.fovy_rad).tan();
        let depth = to.dot(view.forward);
        depth > 0.0 && to.dot(right).abs() <= edge * depth && to.dot(view.up).abs() <= edge * depth
    }

    proptest! {
        #[test]
        fn all_that_a_camera_sees_lies_in_its_steady_view(
            (az, el, roll) in (0.0..TAU, -1.5..1.5_f64, -3.0..3.0_f64),
            hfov_deg in 0.5..70.0_f64,
            (u, v, depth_m) in (0.0..640.0_f64, 0.0..480.0_f64, 15.0..3e4_f64),
            r in prop::array::uniform3(-100.0..100.0_f64),
        ) {
            let pinhole = Pinhole::from_hfov(640, 480, hfov_deg.to_radians()).unwrap();
            let look = az_el_to_los(DVec2::new(az, el));
            let right = look.cross(DVec3::Z).normalize();
            let q = DQuat::from_mat3(&glam::DMat3::from_cols(right, look.cross(right), look))
                * DQuat::from_rotation_z(roll);
            let r_m = DVec3::from(r);
            let view = steady_view(&pinhole, r_m, q);
            let seen_m = r_m + depth_m * (q * pinhole.ray(DVec2::new(u, v)));
            prop_assert!(inside(&view, seen_m));
            // A pixel is as large as the camera's.
            let focal_px = 0.5 * f64::from(view.size_px[1]) / (0.5 * view.fovy_rad).tan();
            prop_assert!((focal_px / pinhole.focal_px - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn a_camera_that_hardly_turns_keeps_its_view() {
        let pinhole = Pinhole::from_hfov(640, 480, 1_f64.to_radians()).unwrap();
        let at = |urad: f64| {
            let q = DQuat::from_rotation_z(1e-6 * urad + 1e-4) * DQuat::from_rotation_x(-1.6);
            steady_view(&pinhole, DVec3::new(1.0, 2.0, 3.0), q)
        };
        assert_eq!(at(0.0), at(100.0));
        assert_ne!(at(0.0), at(5_000.0));
    }
}
