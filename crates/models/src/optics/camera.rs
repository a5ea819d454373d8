//! Pinhole camera geometry (paper eq. 8, exact and as printed).
//!
//! Sign convention, used by every tracker error in Boresight: in the `cam` frame x points right, y
//! down and z forward, so an error angle is **positive to the right of and below** the boresight. A
//! target with x > 0 needs the mount to turn right (azimuth grows); one with y > 0 needs it to
//! look lower (elevation shrinks). Pixel (i, j) covers [i, i+1) × [j, j+1), so the principal point
//! of a w × h image is (w/2, h/2), a corner of four pixels when both are even.

use glam::{DVec2, DVec3};
use thiserror::Error;

/// Why a camera cannot be built.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum CameraError {
    /// An image without pixels.
    #[error("image of {width_px} x {height_px} px has no pixels")]
    Empty { width_px: u32, height_px: u32 },
    /// A horizontal field of view outside (0, pi).
    #[error("horizontal field of view {0} rad is not in (0, pi)")]
    FieldOfView(f64),
}

/// An ideal pinhole camera: square pixels, principal point at the image centre, no distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Image width [px].
    pub width_px: u32,
    /// Image height [px].
    pub height_px: u32,
    /// Focal length over pixel pitch [px].
    pub focal_px: f64,
}

impl Pinhole {
    /// The camera whose image is `width_px` wide over the full horizontal field of view `hfov_rad`.
    pub fn from_hfov(width_px: u32, height_px: u32, hfov_rad: f64) -> Result<Self, CameraError> {
        if width_px == 0 || height_px == 0 {
            return Err(CameraError::Empty {
                width_px,
                height_px,
            });
        }
        if !(hfov_rad > 0.0 && hfov_rad < std::f64::consts::PI) {
            return Err(CameraError::FieldOfView(hfov_rad));
        }
        Ok(Self {
            width_px,
            height_px,
            focal_px: 0.5 * f64::from(width_px) / (0.5 * hfov_rad).tan(),
        })
    }

    /// The principal point [px].
    pub fn centre_px(&self) -> DVec2 {
        0.5 * DVec2::new(f64::from(self.width_px), f64::from(self.height_px))
    }

    /// The image point [px] of a point in the `cam` frame [m]; `None` where it is not in front of
    /// the camera. The point may lie outside the image: see [`Self::contains`].
    pub fn project(&self, r_cam_m: DVec3) -> Option<DVec2> {
        (r_cam_m.z > 0.0).then(|| self.centre_px() + self.focal_px * r_cam_m.truncate() / r_cam_m.z)
    }

    /// Whether an image point [px] falls on the detector.
    pub fn contains(&self, px: DVec2) -> bool {
        (0.0..f64::from(self.width_px)).contains(&px.x)
            && (0.0..f64::from(self.height_px)).contains(&px.y)
    }

    /// The unit vector in the `cam` frame of the ray through an image point [px].
    pub fn ray(&self, px: DVec2) -> DVec3 {
        (px - self.centre_px()).extend(self.focal_px).normalize()
    }

    /// Error angles [rad] of an image point [px] from the boresight, x right and y down positive:
    /// atan(Δ/f) per axis, eq. 8 in its exact form.
    pub fn angles(&self, px: DVec2) -> DVec2 {
        let tangent = (px - self.centre_px()) / self.focal_px;
        DVec2::new(tangent.x.atan(), tangent.y.atan())
    }

    /// Error angles [rad] by the linear map printed as eq. 8, 2Δ/W · FOV/2 per axis, with the sign
    /// of [`Self::angles`]. It is right at the centre and at the edges only: in a 120° field it reads
    /// 40 % low next to the centre and 10.9° low half way out.
    pub fn angles_linear(&self, px: DVec2) -> DVec2 {
        let half = self.centre_px();
        (px - half) / half * DVec2::new(0.5 * self.hfov_rad(), 0.5 * self.vfov_rad())
    }

    /// Full horizontal field of view [rad].
    pub fn hfov_rad(&self) -> f64 {
        2.0 * (0.5 * f64::from(self.width_px) / self.focal_px).atan()
    }

    /// Full vertical field of view [rad].
    pub fn vfov_rad(&self) -> f64 {
        2.0 * (0.5 * f64::from(self.height_px) / self.focal_px).atan()
    }

    /// Instantaneous field of view of one pixel on the boresight [rad].
    pub fn ifov_rad(&self) -> f64 {
        2.0 * (0.5 / self.focal_px).atan()
    }
}

/// A rectangle of sensor pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PixelRect {
    /// Upper left corner [px].
    pub offset_px: [u32; 2],
    /// Width and height [px].
    pub size_px: [u32; 2],
}

impl PixelRect {
    /// Whether a place on the sensor [px] lies in it.
    pub fn holds(&self, at_px: [f64; 2]) -> bool {
        (0..2).all(|axis| {
            let low = f64::from(self.offset_px[axis]);
            (low..low + f64::from(self.size_px[axis])).contains(&at_px[axis])
        })
    }

    /// The largest part of `self`'s sensor around `centre_px` that a window of `size_px` shows.
    pub fn window(sensor_px: [u32; 2], centre_px: [f64; 2], size_px: u32) -> Self {
        let axis = |i: usize| {
            let size = size_px.min(sensor_px[i]);
            let most = f64::from(sensor_px[i] - size);
            (
                (centre_px[i] - f64::from(size) / 2.0)
                    .round()
                    .clamp(0.0, most) as u32,
                size,
            )
        };
        let ((x, width), (y, height)) = (axis(0), axis(1));
        Self {
            offset_px: [x, y],
            size_px: [width, height],
        }
    }

    /// The part of `self` around `centre_px` that a square of `side_px` shows.
    pub fn around(self, centre_px: [f64; 2], side_px: u32) -> Self {
        let [dx, dy] = self.offset_px;
        let centre_px = [centre_px[0] - f64::from(dx), centre_px[1] - f64::from(dy)];
        let part = Self::window(self.size_px, centre_px, side_px);
        let [x, y] = part.offset_px;
        Self {
            offset_px: [dx + x, dy + y],
            ..part
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEGREE: f64 = std::f64::consts::PI / 180.0;

    #[test]
    fn a_part_of_a_window_stays_in_it() {
        let window = PixelRect::window([640, 480], [600.0, 100.0], 256);
        assert_eq!(window.offset_px, [384, 0]);
        let part = window.around([600.0, 100.0], 64);
        assert_eq!((part.offset_px, part.size_px), ([568, 68], [64, 64]));
        let part = window.around([1e9, -1e9], 64);
        assert_eq!(part.offset_px, [576, 0]);
        assert_eq!(window.around([600.0, 100.0], 300), window);
    }

    #[test]
    fn field_of_view_round_trips() {
        let wide = Pinhole::from_hfov(640, 480, 120.0 * DEGREE).unwrap();
        // tan 60° = √3.
        assert!((wide.focal_px - 320.0 / 3f64.sqrt()).abs() < 1e-10);
        assert!((wide.hfov_rad() - 120.0 * DEGREE).abs() < 1e-14);
        assert!((wide.vfov_rad() - 2.0 * (0.75 * 3f64.sqrt()).atan()).abs() < 1e-14);
    }

    #[test]
    fn projection_inverts_the_ray() {
        let camera = Pinhole::from_hfov(640, 480, 30.0 * DEGREE).unwrap();
        for px in [
            DVec2::new(0.0, 0.0),
            DVec2::new(320.0, 240.0),
            DVec2::new(601.5, 33.25),
        ] {
            let ray = camera.ray(px);
            assert!((ray.length() - 1.0).abs() < 1e-15);
            assert!((camera.project(ray * 977.0).unwrap() - px).length() < 1e-10);
        }
        assert_eq!(camera.project(DVec3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(camera.project(DVec3::X), None);
        assert!(camera.contains(DVec2::new(0.0, 479.9)));
        assert!(!camera.contains(DVec2::new(640.0, 10.0)));
    }

    #[test]
    fn signs_are_right_and_down() {
        let camera = Pinhole::from_hfov(640, 480, 30.0 * DEGREE).unwrap();
        let px = camera.project(DVec3::new(1.0, 2.0, 100.0)).unwrap();
        let angles = camera.angles(px);
        assert!((angles - DVec2::new(0.01f64.atan(), 0.02f64.atan())).length() < 1e-15);
        assert!(camera.angles_linear(px).x > 0.0 && camera.angles_linear(px).y > 0.0);
    }

    #[test]
    fn eq_8_exact_versus_linear_is_the_closed_form() {
        // At the share s of the half width: exact atan(s tan(h/2)), linear s h/2.
        for (hfov_deg, half_way_error_deg) in [(30.0, 0.1307), (120.0, 10.8934)] {
            let camera = Pinhole::from_hfov(640, 480, hfov_deg * DEGREE).unwrap();
            let half = 0.5 * hfov_deg * DEGREE;
            for share in [-0.9, -0.3, 0.1, 0.5, 0.8] {
                let px = camera.centre_px() + DVec2::new(320.0 * share, 0.0);
                let error = camera.angles(px).x - camera.angles_linear(px).x;
                let expected = (share * half.tan()).atan() - share * half;
                assert!((error - expected).abs() < 1e-14, "{hfov_deg} {share}");
                if share == 0.5 {
                    assert!(
                        (error / DEGREE - half_way_error_deg).abs() < 1e-4,
                        "{error}"
                    );
                }
            }
        }
    }

    #[test]
    fn linear_eq_8_holds_in_a_narrow_field_and_fails_in_a_wide_one() {
        // Half way to the edge: exact atan(½ tan(h/2)), linear h/4.
        let half_way = |camera: &Pinhole| {
            let px = DVec2::new(0.75 * f64::from(camera.width_px), camera.centre_px().y);
            (camera.angles(px).x, camera.angles_linear(px).x)
        };
        let narrow = Pinhole::from_hfov(640, 480, 1.0 * DEGREE).unwrap();
        let (exact, linear) = half_way(&narrow);
        // With T = tan(h/2): atan(T/2) − ½ atan T = T³/8 + O(T⁵), so T²/4 of the angle.
        let t = (0.5 * DEGREE).tan();
        assert!(((exact - linear) / exact - t * t / 4.0).abs() < 1e-8);
        let wide = Pinhole::from_hfov(640, 480, 120.0 * DEGREE).unwrap();
        let (exact, linear) = half_way(&wide);
        assert!((linear - 30.0 * DEGREE).abs() < 1e-14);
        assert!((exact - (0.5 * 3f64.sqrt()).atan()).abs() < 1e-14);
        assert!((exact - linear) / DEGREE > 10.8 && (exact - linear) / DEGREE < 10.9);
        // Both meet at the edge.
        let edge = DVec2::new(640.0, 240.0);
        assert!((wide.angles(edge).x - wide.angles_linear(edge).x).abs() < 1e-14);
    }

    #[test]
    fn bad_cameras_are_refused() {
        assert!(Pinhole::from_hfov(0, 480, 1.0).is_err());
        assert!(Pinhole::from_hfov(640, 0, 1.0).is_err());
        assert!(Pinhole::from_hfov(640, 480, std::f64::consts::PI).is_err());
        assert!(Pinhole::from_hfov(640, 480, f64::NAN).is_err());
    }
}
