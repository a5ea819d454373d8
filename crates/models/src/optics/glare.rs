//! Veiling glare: the sun's light that lens and dust scatter over the field.
//!
//! L = g E / theta^2, in kcd/m^2, klx and degrees, the shape of the disability glare of the eye
//! (CIE 146:2002, where g is 10 and L is in cd/m^2 for lux) with the much smaller g of a lens. The light scattered
//! between 0.27 deg and 30 deg is then 0.9 % of the sun's for g = 1, of the order of the veiling
//! glare index of good lenses (ISO 9358; recalled). Close to the sun it stops growing at the edge
//! of the disc. It ends 90 deg from the sun, where a hood shades the lens.

use glam::DVec3;

/// Angular radius of the sun's disc [deg].
const SUN_RADIUS_DEG: f32 = 0.267;

/// The sun's glare in a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunGlare {
    /// Direction to the sun in the camera's frame, unit.
    pub sun_cam: DVec3,
    /// Its illuminance on a surface that faces it, linear sRGB [klx].
    pub sun_klx: [f64; 3],
    /// Focal length of the camera [px].
    pub focal_px: f64,
    /// Centre of the whole sensor [px].
    pub centre_px: [f64; 2],
}

impl SunGlare {
    /// The most that the glare of a lens of the strength `g` brings into a field whose corner lies
    /// `half_field_rad` from its axis [kcd/m^2].
    pub fn most_kcd_m2(&self, g: f64, half_field_rad: f64) -> f64 {
        if self.sun_cam.z <= 0.0 {
            return 0.0;
        }
        let apart_rad = (self.sun_cam.z.min(1.0).acos() - half_field_rad).max(0.0);
        let apart_deg = apart_rad.to_degrees().max(f64::from(SUN_RADIUS_DEG));
        g * self.sun_klx.into_iter().fold(0.0, f64::max) / (apart_deg * apart_deg)
    }

    /// Glare over the sun's illuminance, in kcd/m^2 a klx, at every second pixel from (`x`, `y`) on,
    /// `out.len()` of them.
    pub fn half_row(&self, g: f64, x: usize, y: usize, out: &mut [f32]) {
        let inverse = 1.0 / self.focal_px;
        let right = ((x as f64 + 0.5 - self.centre_px[0]) * inverse) as f32;
        let down = ((y as f64 + 0.5 - self.centre_px[1]) * inverse) as f32;
        let step = (2.0 * inverse) as f32;
        let [sx, sy, sz] = self.sun_cam.as_vec3().to_array();
        // |ray x sun|^2 over |ray|^2 is sin^2 theta, exact for small angles, where 1 - cos is not.
        let degrees = 1f32.to_radians().recip();
        let (scale, least) = ((g as f32), SUN_RADIUS_DEG * SUN_RADIUS_DEG);
        for (i, out) in out.iter_mut().enumerate() {
            let (u, v) = (right + i as f32 * step, down);
            let cross = [v * sz - sy, sx - u * sz, u * sy - v * sx];
            let square = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2];
            let sine = square / (1.0 + u * u + v * v);
            let square_deg = degrees * degrees * sine;
            *out = scale
                / if square_deg > least {
                    square_deg
                } else {
                    least
                };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn glare_falls_with_the_square_of_the_angle() {
        let glare = |apart_deg: f64| {
            let (sin, cos) = apart_deg.to_radians().sin_cos();
            let sun = SunGlare {
                sun_cam: DVec3::new(sin, 0.0, cos),
                sun_klx: [80.0, 75.0, 70.0],
                focal_px: 6000.0,
                centre_px: [320.5, 240.5],
            };
            let mut out = [0.0; 1];
            sun.half_row(1.0, 320, 240, &mut out);
            (f64::from(out[0]), sun.most_kcd_m2(1.0, 0.0))
        };
        for apart_deg in [0.5, 2.0, 10.0] {
            let (found, most) = glare(apart_deg);
            let exact = 1.0 / (apart_deg * apart_deg);
            assert!((found / exact - 1.0).abs() < 0.02, "{found} {exact}");
            assert!((most / (80.0 * exact) - 1.0).abs() < 1e-6, "{most}");
        }
        // Inside the disc it stops; behind the camera there is none.
        assert!((glare(0.0).0 - glare(0.2).0).abs() < 1e-3);
        assert_eq!(glare(100.0).1, 0.0);
        // What is scattered in all: the sum of L over E in rings around the sun.
        let rings = 3000;
        let total: f64 = (0..rings)
            .map(|i| {
                let theta_deg = 0.27 + (30.0 - 0.27) * (f64::from(i) + 0.5) / f64::from(rings);
                let width_rad = (30.0f64 - 0.27).to_radians() / f64::from(rings);
                let ring_sr = std::f64::consts::TAU * theta_deg.to_radians().sin() * width_rad;
                ring_sr / (theta_deg * theta_deg)
            })
            .sum();
        assert!((total - 0.009).abs() < 5e-4, "{total}");
    }
}
