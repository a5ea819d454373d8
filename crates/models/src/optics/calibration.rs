//! Boresight calibration: how a camera is turned against the laser, from centroids of a beacon.
//!
//! The mount puts a beacon at known directions from the laser's axis and the camera measures its
//! centroid; the rotation between the two follows by least squares. The beacon stands far enough for
//! parallax not to matter, and the mount's own error over a camera's field is left out.

use glam::{DVec2, DVec3};
use nalgebra::{Matrix3, Vector3};
use thiserror::Error;

use crate::maths::kinematics::exp_so3;
use crate::maths::rng::Stream;
use crate::optics::camera::Pinhole;

/// Too few or too poor measurements.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("{count} centroids do not determine a boresight; take more")]
pub struct CalibrationError {
    /// Number of measurements.
    pub count: usize,
}

/// A measured boresight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Rotation vector of the camera against the laser, in `cam` axes [rad].
    pub rotation_rad: DVec3,
    /// Standard error of each component [rad].
    pub standard_error_rad: DVec3,
}

/// One measurement of the beacon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Centroid {
    /// Unit direction in which the mount put the beacon, in the laser's axes (as `cam`).
    pub direction: DVec3,
    /// Where the camera saw its centroid [px].
    pub px: DVec2,
}

/// Centroids of the beacon in a camera turned by `rotation_rad`, at `count` places spread over the
/// middle 60 % of the image, with a noise of `sigma_px` per axis.
pub fn measure(
    pinhole: &Pinhole,
    rotation_rad: DVec3,
    count: usize,
    sigma_px: f64,
    rng: &mut Stream,
) -> Vec<Centroid> {
    let size_px = 2.0 * pinhole.centre_px();
    (0..count)
        .filter_map(|_| {
            let place = DVec2::new(rng.range(0.2, 0.8), rng.range(0.2, 0.8));
            let direction = pinhole.ray(place * size_px).normalize();
            let px = pinhole.project(exp_so3(-rotation_rad) * direction)?;
            let noise = sigma_px * DVec2::new(rng.normal(), rng.normal());
            Some(Centroid {
                direction,
                px: px + noise,
            })
        })
        .collect()
}

/// The rotation that fits `centroids` best in the least-squares sense (Gauss-Newton), with its
/// standard error for a noise of `sigma_px` per axis.
pub fn estimate(
    pinhole: &Pinhole,
    centroids: &[Centroid],
    sigma_px: f64,
) -> Result<Calibration, CalibrationError> {
    let fail = CalibrationError {
        count: centroids.len(),
    };
    let mut rotation = DVec3::ZERO;
    let mut covariance = Matrix3::zeros();
    // Quadratic convergence: from 10 mrad to rounding in three steps.
    for _ in 0..4 {
        let mut normal = Matrix3::<f64>::zeros();
        let mut right = Vector3::<f64>::zeros();
        let turn = exp_so3(-rotation);
        for &Centroid { direction, px } in centroids {
            let d = turn * direction;
            let Some(expected) = pinhole.project(d) else {
                continue;
            };
            // A small turn ω of the camera moves what it sees by d × ω.
            let (x, y, f) = (d.x / d.z, d.y / d.z, pinhole.focal_px);
            let rows = [
                Vector3::new(f * x * y, -f * (1.0 + x * x), f * y),
                Vector3::new(f * (1.0 + y * y), -f * x * y, -f * x),
            ];
            let residual = px - expected;
            for (row, miss) in rows.iter().zip(residual.to_array()) {
                normal += row * row.transpose();
                right += row * miss;
            }
        }
        let inverse = normal.try_inverse().ok_or(fail)?;
        let step = inverse * right;
        rotation += DVec3::new(step.x, step.y, step.z);
        covariance = inverse;
    }
    let error = |i: usize| sigma_px * f64::sqrt(covariance[(i, i)]);
    let standard_error_rad = DVec3::new(error(0), error(1), error(2));
    if !(rotation.is_finite() && standard_error_rad.is_finite()) {
        return Err(fail);
    }
    Ok(Calibration {
        rotation_rad: rotation,
        standard_error_rad,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> Pinhole {
        Pinhole::from_hfov(640, 480, 1.0f64.to_radians()).unwrap()
    }

    #[test]
    fn without_noise_the_rotation_comes_back() {
        let mut rng = Stream::new(1, 0, "calibration");
        for rotation in [
            DVec3::ZERO,
            DVec3::new(150e-6, -80e-6, 200e-6),
            DVec3::new(3e-3, 2e-3, -10e-3),
        ] {
            let centroids = measure(&camera(), rotation, 20, 0.0, &mut rng);
            let found = estimate(&camera(), &centroids, 0.1).unwrap();
            assert!(
                (found.rotation_rad - rotation).length() < 1e-11,
                "{rotation}"
            );
        }
    }

    #[test]
    fn residuals_follow_the_stated_error_and_the_root_of_n() {
        let (pinhole, sigma_px) = (camera(), 0.2);
        let rotation = DVec3::new(50e-6, -120e-6, 90e-6);
        let mut spread = Vec::new();
        for count in [50, 200, 800] {
            let runs = 400;
            let (mut squares, mut stated) = (DVec3::ZERO, DVec3::ZERO);
            for run in 0..runs {
                let mut rng = Stream::new(run, 0, "calibration");
                let centroids = measure(&pinhole, rotation, count, sigma_px, &mut rng);
                let found = estimate(&pinhole, &centroids, sigma_px).unwrap();
                let z = (found.rotation_rad - rotation) / found.standard_error_rad;
                // 3,600 draws in all: five deviations are never seen, four hardly.
                assert!(z.abs().max_element() < 5.0, "{z}");
                squares += z * z;
                stated += found.standard_error_rad / runs as f64;
            }
            // The reduced chi square of each component; five standard errors.
            let bound = 5.0 * (2.0 / runs as f64).sqrt();
            let chi = squares / runs as f64;
            assert!((chi - 1.0).abs().max_element() < bound, "{count} {chi}");
            // Across the line of sight a single camera's σ/(f √N) is all there is.
            let ideal = sigma_px / pinhole.focal_px / (count as f64).sqrt();
            assert!((stated.x / ideal - 1.0).abs() < 0.1 && (stated.y / ideal - 1.0).abs() < 0.1);
            spread.push(stated);
        }
        for pair in spread.windows(2) {
            assert!((pair[0] / pair[1] - 2.0).abs().max_element() < 0.05);
        }
    }

    #[test]
    fn nothing_measured_is_an_error() {
        assert!(estimate(&camera(), &[], 0.1).is_err());
        let one = [Centroid {
            direction: DVec3::Z,
            px: camera().centre_px(),
        }];
        assert!(estimate(&camera(), &one, 0.1).is_err());
    }
}
