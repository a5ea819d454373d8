//! Pointing kinematics: the chain base → azimuth → elevation → fast steering mirror → camera
//! (paper eq. 11) as a product of exponentials, and the angles between frames.
//!
//! The chain's axes meet in one point, the station, so each link is a pure rotation; a lever arm
//! would enter as the `v` of that link's twist. The mirror is described by the deflection of the
//! line of sight (twice the optical-bench rotation of the mirror itself); the second-order image
//! roll of a real tilted mirror is left out (below 1e-5 rad at 5 mrad).

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DQuat, DVec2, DVec3};

/// Position of the station and attitude of a camera in the site frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position in `enu` [m].
    pub r_enu_m: DVec3,
    /// Rotates `cam` (x right, y down, z forward) into `enu`.
    pub q_enu_cam: DQuat,
}

/// `angle` [rad] wrapped into (−π, π].
pub fn wrap_pi(angle: f64) -> f64 {
    let wrapped = angle.rem_euclid(TAU);
    if wrapped > PI { wrapped - TAU } else { wrapped }
}

/// The rotation of a rotation vector [rad]: exp([ω]×) as a unit quaternion.
pub fn exp_so3(rotation_rad: DVec3) -> DQuat {
    let half = 0.5 * rotation_rad.length();
    // sin(h)/h loses nothing above 1e-4; below, two terms are exact to 1e-17.
    let scale = 0.5
        * if half > 1e-4 {
            half.sin() / half
        } else {
            1.0 - half * half / 6.0
        };
    let v = rotation_rad * scale;
    DQuat::from_xyzw(v.x, v.y, v.z, half.cos())
}

/// The rigid motion of a twist (ω [rad], v [m]): exp of [[ω]×, v; 0, 0], as (translation [m],
/// rotation); the factor of eq. 11.
pub fn exp_se3(rotation_rad: DVec3, v_m: DVec3) -> (DVec3, DQuat) {
    let square = rotation_rad.length_squared();
    // V = 1 + a[ω]× + b[ω]×², a = (1 − cos θ)/θ², b = (θ − sin θ)/θ³; the series avoid the
    // cancellation at small θ and are exact to 1e-15 below the switch.
    let (a, b) = if square < 0.04 {
        let s = square;
        (
            0.5 - s / 24.0 * (1.0 - s / 30.0 * (1.0 - s / 56.0 * (1.0 - s / 90.0))),
            1.0 / 6.0 - s / 120.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0 * (1.0 - s / 110.0))),
        )
    } else {
        let angle = square.sqrt();
        (
            (1.0 - angle.cos()) / square,
            (angle - angle.sin()) / (square * angle),
        )
    };
    let turned = rotation_rad.cross(v_m);
    (
        v_m + a * turned + b * rotation_rad.cross(turned),
        exp_so3(rotation_rad),
    )
}

/// Attitude of a camera that looks level to the north: right is east, down is −up.
fn q_enu_cam_home() -> DQuat {
    DQuat::from_mat3(&DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y))
}

/// Pose of a camera at the end of the chain of eq. 11.
///
/// `base_tilt_rad` is a rotation vector about the `enu` axes; `az_rad` is clockwise from the base's
/// north and `el_rad` up from its horizon; `mirror_rad` deflects the line of sight right (x,
/// cross-elevation) and **up** (y, elevation) along a great circle; `camera_misalignment_rad` is a
/// rotation vector in `cam`. Only the precise camera and the laser look through the mirror: pass
/// zero for the search and the coarse camera, which ride on the gimbal.
pub fn boresight_chain(
    r_station_enu_m: DVec3,
    base_tilt_rad: DVec3,
    az_rad: f64,
    el_rad: f64,
    mirror_rad: DVec2,
    camera_misalignment_rad: DVec3,
) -> Pose {
    let zero = DVec3::ZERO;
    let links = [
        (zero, r_station_enu_m),
        (base_tilt_rad, zero),
        (DVec3::new(0.0, 0.0, -az_rad), zero),
        (DVec3::new(el_rad, 0.0, 0.0), zero),
        (DVec3::new(mirror_rad.y, 0.0, -mirror_rad.x), zero),
    ];
    let (r_enu_m, q) = links
        .iter()
        .fold((zero, DQuat::IDENTITY), |(r, q), &(omega, v)| {
            let (step_m, turn) = exp_se3(omega, v);
            (r + q * step_m, q * turn)
        });
    Pose {
        r_enu_m,
        q_enu_cam: (q * q_enu_cam_home() * exp_so3(camera_misalignment_rad)).normalize(),
    }
}

/// Azimuth (x) in (−π, π], clockwise from north, and elevation (y) [rad] of a direction in `enu`.
pub fn los_to_az_el(dir_enu: DVec3) -> DVec2 {
    DVec2::new(
        dir_enu.x.atan2(dir_enu.y),
        dir_enu.z.atan2(dir_enu.x.hypot(dir_enu.y)),
    )
}

/// Unit direction in `enu` of an azimuth (x) and an elevation (y) [rad].
pub fn az_el_to_los(az_el_rad: DVec2) -> DVec3 {
    let (sin_az, cos_az) = az_el_rad.x.sin_cos();
    let (sin_el, cos_el) = az_el_rad.y.sin_cos();
    DVec3::new(sin_az * cos_el, cos_az * cos_el, sin_el)
}

/// Error angles [rad] of a direction in `enu` from a camera's boresight: x right, y down, the same
/// angles as [`crate::optics::camera::Pinhole::angles`] for a direction in front of the camera.
pub fn error_angles(q_enu_cam: DQuat, dir_enu: DVec3) -> DVec2 {
    let d = q_enu_cam.inverse() * dir_enu;
    DVec2::new(d.x.atan2(d.z), d.y.atan2(d.z))
}

/// Standard gravity [m/s²] (3rd CGPM, 1901).
pub const GRAVITY_MPS2: f64 = 9.80665;

/// Angular velocity of the base (`enu` [rad/s]) about the gimbal's azimuth axis (clockwise) and
/// elevation axis (up) at azimuth `az_rad`: what a gyro on each axis reads.
pub fn base_rate_on_axes(az_rad: f64, omega_enu_radps: DVec3) -> [f64; 2] {
    let (sin_az, cos_az) = az_rad.sin_cos();
    [
        -omega_enu_radps.z,
        cos_az * omega_enu_radps.x - sin_az * omega_enu_radps.y,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix4, Rotation3, Vector3};

    fn matrix_of(rotation: DVec3, v: DVec3) -> Matrix4<f64> {
        let (t, q) = exp_se3(rotation, v);
        let r = DMat3::from_quat(q);
        Matrix4::from_fn(|i, j| match (i, j) {
            (3, 3) => 1.0,
            (3, _) => 0.0,
            (_, 3) => t[i],
            _ => r.col(j)[i],
        })
    }

    #[test]
    fn exponentials_match_nalgebra_and_the_power_series() {
        for rotation in [
            DVec3::ZERO,
            DVec3::new(3e-9, -1e-9, 2e-9),
            DVec3::new(1e-4, 2e-4, -1e-4),
            DVec3::new(0.1, -0.1, 0.14),
            DVec3::new(0.12, -0.1, 0.14),
            DVec3::new(-0.8, 1.9, 0.4),
            DVec3::new(0.0, 0.0, 3.1),
        ] {
            let v = DVec3::new(2.0, -1.0, 0.5);
            let ours = matrix_of(rotation, v);
            let theirs = Rotation3::new(Vector3::new(rotation.x, rotation.y, rotation.z));
            let diff = ours.fixed_view::<3, 3>(0, 0) - theirs.matrix();
            assert!(diff.norm() < 1e-14, "{rotation} {}", diff.norm());
            let w = rotation;
            let twist = Matrix4::new(
                0.0, -w.z, w.y, v.x, w.z, 0.0, -w.x, v.y, -w.y, w.x, 0.0, v.z, 0.0, 0.0, 0.0, 0.0,
            );
            // Sum of twist^k/k!, k < 40: exact to rounding for |ω| < π.
            let mut term = Matrix4::identity();
            let mut sum = term;
            for k in 1..40 {
                term = term * twist / f64::from(k);
                sum += term;
            }
            assert!((ours - sum).norm() < 1e-12, "{rotation}");
        }
    }

    #[test]
    fn a_long_chain_of_quaternion_increments_is_the_product_of_matrix_exponentials() {
        let mut rng = crate::maths::rng::Stream::new(17, 0, "increments");
        let mut vector = |scale: f64| scale * rng.normal3();
        let (mut r, mut q) = (DVec3::ZERO, DQuat::IDENTITY);
        let mut product = Matrix4::<f64>::identity();
        for k in 1..=2000 {
            // Increments of a tick's size, and now and then of half a turn.
            let (omega, v) = (vector(if k % 10 == 0 { 1.0 } else { 1e-3 }), vector(1e-2));
            let (step_m, turn) = exp_se3(omega, v);
            (r, q) = (r + q * step_m, (q * turn).normalize());
            let (w, u) = (omega, v);
            let twist = Matrix4::new(
                0.0, -w.z, w.y, u.x, w.z, 0.0, -w.x, u.y, -w.y, w.x, 0.0, u.z, 0.0, 0.0, 0.0, 0.0,
            );
            // Padé approximants: no formula is shared with the quaternions.
            product *= twist.exp();
            let attitude = DMat3::from_quat(q);
            for i in 0..3 {
                assert!((product[(i, 3)] - r[i]).abs() < 1e-12, "{k}");
                for j in 0..3 {
                    let error = product[(i, j)] - attitude.col(j)[i];
                    assert!(error.abs() < 1e-12, "{k} {error:e}");
                }
            }
        }
    }

    #[test]
    fn chain_is_the_closed_form_without_tilt_and_mirror() {
        let station = DVec3::new(10.0, -20.0, 30.0);
        for (az, el) in [(0.0, 0.0), (0.7, 0.3), (-2.9, 1.2), (1.6, -0.2)] {
            let pose = boresight_chain(station, DVec3::ZERO, az, el, DVec2::ZERO, DVec3::ZERO);
            assert!((pose.r_enu_m - station).length() < 1e-13);
            let los = az_el_to_los(DVec2::new(az, el));
            assert!((pose.q_enu_cam * DVec3::Z - los).length() < 1e-12);
            let right = DVec3::new(az.cos(), -az.sin(), 0.0);
            assert!((pose.q_enu_cam * DVec3::X - right).length() < 1e-12);
            assert!((pose.q_enu_cam * DVec3::Y - los.cross(right)).length() < 1e-12);
            let back = los_to_az_el(los);
            assert!((wrap_pi(back.x - az)).abs() < 1e-14 && (back.y - el).abs() < 1e-14);
        }
    }

    #[test]
    fn mirror_tilt_and_misalignment_act_where_they_should() {
        let (az, el) = (0.9, 0.4);
        let look = |tilt, mirror, mis| {
            boresight_chain(DVec3::ZERO, tilt, az, el, mirror, mis).q_enu_cam * DVec3::Z
        };
        let gimbal = boresight_chain(DVec3::ZERO, DVec3::ZERO, az, el, DVec2::ZERO, DVec3::ZERO);
        // A mirror deflection moves the line of sight right and up by exactly that great circle.
        let mirror = DVec2::new(3e-3, 2e-3);
        let seen = error_angles(gimbal.q_enu_cam, look(DVec3::ZERO, mirror, DVec3::ZERO));
        assert!((seen - DVec2::new(3e-3, -2e-3)).length() < 2e-8);
        let angle =
            look(DVec3::ZERO, mirror, DVec3::ZERO).angle_between(gimbal.q_enu_cam * DVec3::Z);
        assert!((angle - mirror.length()).abs() < 1e-12);
        // Base tilt rotates everything rigidly in enu.
        let tilt = DVec3::new(1e-3, -2e-3, 5e-4);
        let moved = exp_so3(tilt) * look(DVec3::ZERO, mirror, DVec3::ZERO);
        assert!((look(tilt, mirror, DVec3::ZERO) - moved).length() < 1e-15);
        // Misalignment about the camera's y (down) turns the view to the right.
        let seen = error_angles(
            gimbal.q_enu_cam,
            look(DVec3::ZERO, DVec2::ZERO, DVec3::new(0.0, 1e-3, 0.0)),
        );
        assert!((seen - DVec2::new(1e-3, 0.0)).length() < 1e-12);
    }

    #[test]
    fn base_rates_are_the_motion_of_the_line_of_sight() {
        // Without relative motion a base rate ω moves the boresight by ω × los; seen from inside
        // the gimbal that is ω on the elevation axis up.
        let (az, omega) = (0.8, DVec3::new(0.3, -0.5, 0.7));
        let los = az_el_to_los(DVec2::new(az, 0.0));
        let moved = omega.cross(los);
        let [az_rate, el_rate] = base_rate_on_axes(az, omega);
        assert!((moved.z - el_rate).abs() < 1e-15);
        let right = DVec3::new(az.cos(), -az.sin(), 0.0);
        assert!((moved.dot(right) - az_rate).abs() < 1e-15);
    }

    #[test]
    fn wrapping() {
        for turns in -3..=3 {
            assert!((wrap_pi(0.3 + f64::from(turns) * TAU) - 0.3).abs() < 1e-14);
        }
        assert_eq!(wrap_pi(PI), PI);
        assert_eq!(wrap_pi(-PI), PI);
    }
}
