//! All stray light of a frame, pixel by pixel, as luminance that makes as many electrons.

use super::beam::BeamLight;
use glam::DVec3;
use libm::erf;
use std::f64::consts::FRAC_1_SQRT_2;

/// Angle within which the lens's scattering around a point of light stops growing [deg]: some pixels of a narrow camera,
/// chosen; the sun's ends at its own disc.
const CORE_DEG: f64 = 0.02;
/// Angle from a point of light at which its veil ends [deg]: a hood shades the lens.
const HOOD_DEG: f64 = 90.0;

/// A point of light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointLight {
    /// Direction in the camera's axes, unit.
    pub dir_cam: DVec3,
    /// Illuminance on a surface that faces it [klx], of the channels, by the electrons that it makes.
    pub klx: [f64; 3],
    /// Standard deviation of its own extent [rad].
    pub radius_rad: f64,
}

/// A beam, and the luminance of the channels that its radiance is to the camera [kcd sr/W].
#[derive(Clone, Debug, PartialEq)]
pub struct SeenBeam {
    /// The beam.
    pub light: BeamLight,
    /// Luminance over radiance.
    pub kcd_per_w: [f64; 3],
    /// Whether the camera is beside the laser and looks along its beam: light is then smooth along rows.
    pub along: bool,
}

/// What a camera's frame is lit with beside its scene.
#[derive(Clone, Debug, PartialEq)]
pub struct StrayLight {
    /// Focal length of the camera [px].
    pub focal_px: f64,
    /// Centre of the whole sensor [px].
    pub centre_px: [f64; 2],
    /// Standard deviation of its blur [px].
    pub blur_px: f64,
    /// Strength of the veiling glare of its lens, as of the sun's.
    pub glare: f64,
    /// Light that no pixel shows [kcd/m²].
    pub least_kcd_m2: f64,
    /// Beams in the air.
    pub beams: Vec<SeenBeam>,
    /// Lit spots and lamps.
    pub points: Vec<PointLight>,
}

impl StrayLight {
    /// A pixel's direction in the camera's axes, unit.
    fn direction(&self, x_px: f64, y_px: f64) -> DVec3 {
        let [cx, cy] = self.centre_px;
        DVec3::new(
            (x_px - cx) / self.focal_px,
            (y_px - cy) / self.focal_px,
            1.0,
        )
        .normalize()
    }

    /// Light of a channel [kcd/m²] at every second pixel of the sensor's row `y` from `x` on, `out.len()` of them.
    pub fn half_row(&self, channel: usize, x: usize, y: usize, out: &mut [f32]) {
        out.fill(0.0);
        let place = |i: usize| [(x + 2 * i) as f64 + 0.5, y as f64 + 0.5];
        for beam in &self.beams {
            let kcd_m2 = |i: usize| {
                let [x_px, y_px] = place(i);
                beam.kcd_per_w[channel] * beam.light.radiance(self.direction(x_px, y_px))
            };
            if beam.along {
                add_smooth(kcd_m2, self.least_kcd_m2, out);
            } else {
                for (i, out) in out.iter_mut().enumerate() {
                    *out += kcd_m2(i) as f32;
                }
            }
        }
        for point in &self.points {
            for (i, out) in out.iter_mut().enumerate() {
                let [x_px, y_px] = place(i);
                let dir = self.direction(x_px, y_px);
                let kcd_per_klx = self.point_kcd_per_klx(point, dir, [x_px, y_px]);
                *out += (point.klx[channel] * kcd_per_klx) as f32;
            }
        }
    }

    /// Luminance of the channels in a direction of the field [kcd/m²], for a meter that sees no points but their veil.
    pub fn veil_kcd_m2(&self, dir_cam: DVec3) -> [f64; 3] {
        [0, 1, 2].map(|channel| {
            let beams = (self.beams.iter())
                .map(|beam| beam.kcd_per_w[channel] * beam.light.radiance(dir_cam));
            let points = (self.points.iter())
                .map(|point| point.klx[channel] * self.veil_per_sr(point, dir_cam));
            beams.chain(points).sum()
        })
    }

    /// Luminance of a point of light over its illuminance [1/sr]: its image, spread over pixels by blur and extent, and
    /// what the lens scatters around it.
    fn point_kcd_per_klx(&self, point: &PointLight, dir: DVec3, [x_px, y_px]: [f64; 2]) -> f64 {
        let veil = self.veil_per_sr(point, dir);
        if point.dir_cam.z <= 0.0 {
            return veil;
        }
        /// Blur below this hardly leaves a pixel [px].
        const LEAST_PX: f64 = 0.15;
        let [cx, cy] = self.centre_px;
        let scale = self.focal_px / point.dir_cam.z;
        let at = [cx + scale * point.dir_cam.x, cy + scale * point.dir_cam.y];
        let sigma = (self.blur_px.hypot(point.radius_rad * self.focal_px)).max(LEAST_PX);
        let off = [x_px - at[0], y_px - at[1]];
        if off.iter().any(|off| off.abs() > 7.0 * sigma + 1.0) {
            return veil;
        }
        let share: f64 = off
            .map(|off| {
                let edge = |side: f64| erf((off + side) / sigma * FRAC_1_SQRT_2);
                0.5 * (edge(0.5) - edge(-0.5))
            })
            .into_iter()
            .product();
        // A pixel is 1/f² sr wide near the axis.
        share * self.focal_px * self.focal_px + veil
    }

    /// What the lens scatters around a point of light: g/(theta² + core²), by the law of the sun's glare.
    fn veil_per_sr(&self, point: &PointLight, dir: DVec3) -> f64 {
        let sine_2 = point.dir_cam.cross(dir).length_squared();
        let theta_deg = sine_2.sqrt().atan2(point.dir_cam.dot(dir)).to_degrees();
        if theta_deg > HOOD_DEG {
            return 0.0;
        }
        self.glare / (theta_deg * theta_deg + CORE_DEG * CORE_DEG)
    }

    /// Whether a pixel may show any of it.
    pub fn shows(&self) -> bool {
        let greatest = |values: [f64; 3]| values.into_iter().fold(0.0, f64::max);
        let beams: f64 = (self.beams.iter())
            .map(|beam| greatest(beam.kcd_per_w) * beam.light.most_radiance())
            .sum();
        let points: f64 = (self.points.iter())
            .map(|point| {
                // The middle pixel of a Gaussian has at most 1/(2π σ²) of it.
                let spread_px2 = std::f64::consts::TAU * self.blur_px * self.blur_px;
                let core = self.focal_px * self.focal_px / spread_px2.max(1.0);
                let peak = core + self.glare / (CORE_DEG * CORE_DEG);
                greatest(point.klx) * peak
            })
            .sum();
        beams + points > self.least_kcd_m2
    }
}

/// Adds a smooth function of the index to `out`: worked out every [`STRIDE`] places, and in between where a straight line
/// is off by more than a five-hundredth and `least`.
fn add_smooth(value: impl Fn(usize) -> f64, least: f64, out: &mut [f32]) {
    /// Places from one that is worked out to the next.
    const STRIDE: usize = 8;
    let Some(last) = out.len().checked_sub(1) else {
        return;
    };
    let mut from = (0, value(0));
    out[0] += from.1 as f32;
    while from.0 < last {
        let at = (from.0 + STRIDE).min(last);
        let to = (at, value(at));
        out[at] += to.1 as f32;
        add_between(&value, least, [from, to], out);
        from = to;
    }
}

/// Adds what lies between two places that are worked out.
fn add_between(
    value: &impl Fn(usize) -> f64,
    least: f64,
    [from, to]: [(usize, f64); 2],
    out: &mut [f32],
) {
    /// Greatest error of a straight line in the middle.
    const TOLERANCE: f64 = 2e-3;
    if to.0 - from.0 < 2 {
        return;
    }
    let middle = (from.0 + to.0) / 2;
    let line = |[from, to]: [(usize, f64); 2], at: usize| {
        let share = (at - from.0) as f64 / (to.0 - from.0) as f64;
        from.1 + (to.1 - from.1) * share
    };
    let at = (middle, value(middle));
    out[middle] += at.1 as f32;
    let off = (at.1 - line([from, to], middle)).abs();
    for ends in [[from, at], [at, to]] {
        if off > TOLERANCE * at.1 + least {
            add_between(value, least, ends, out);
        } else {
            let first = ends[0].0 + 1;
            for (i, out) in out[first..ends[1].0].iter_mut().enumerate() {
                *out += line(ends, first + i) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(glare: f64, points: Vec<PointLight>) -> StrayLight {
        StrayLight {
            focal_px: 36_000.0,
            centre_px: [320.0, 240.0],
            blur_px: 0.8,
            glare,
            least_kcd_m2: 0.0,
            beams: Vec::new(),
            points,
        }
    }

    /// Light of a channel over the whole sensor.
    fn picture(light: &StrayLight) -> Vec<f32> {
        let mut all = vec![0.0; 640 * 480];
        for y in 0..480 {
            for parity in 0..2 {
                let mut half = vec![0.0; 320];
                light.half_row(1, parity, y, &mut half);
                for (i, value) in half.into_iter().enumerate() {
                    all[640 * y + 2 * i + parity] = value;
                }
            }
        }
        all
    }

    #[test]
    fn the_image_of_a_point_holds_all_of_its_light() {
        let point = PointLight {
            dir_cam: DVec3::new(30.3 / 36_000.0, -12.8 / 36_000.0, 1.0).normalize(),
            klx: [0.0, 2.0, 0.0],
            radius_rad: 2e-5,
        };
        let all = picture(&camera(0.0, vec![point]));
        let pixel_sr = 36_000f64.powi(-2);
        let sum: f64 = all.iter().map(|value| f64::from(*value) * pixel_sr).sum();
        assert!((sum / 2.0 - 1.0).abs() < 1e-4, "{sum}");
        let middle = all.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
        assert_eq!(middle.unwrap().0, 640 * 227 + 350);
        // The red channel has nothing of it.
        let mut red = [1.0; 8];
        camera(0.0, vec![point]).half_row(0, 346, 227, &mut red);
        assert_eq!(red, [0.0; 8]);
    }

    #[test]
    fn the_veil_around_a_point_is_the_suns() {
        use crate::optics::glare::SunGlare;
        let dir_cam = DVec3::new(0.03, 0.0, 1.0).normalize();
        let point = PointLight {
            dir_cam,
            klx: [1.0; 3],
            radius_rad: 0.0,
        };
        let sun = SunGlare {
            sun_cam: dir_cam,
            sun_klx: [1.0; 3],
            focal_px: 36_000.0,
            centre_px: [320.0, 240.0],
        };
        let (mut found, mut expected) = ([0.0; 200], [0.0; 200]);
        camera(1.0, vec![point]).half_row(1, 40, 200, &mut found);
        sun.half_row(1.0, 40, 200, &mut expected);
        for (found, expected) in found.iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 3e-3, "{found} {expected}");
        }
    }

    #[test]
    fn a_row_along_a_beam_is_that_of_its_pixels() {
        use crate::laser::beam::Laser;
        use crate::optics::stray::beam::BeamSight;
        use crate::optics::stray::scatter::ScatteringAir;
        let sight = BeamSight {
            laser: Laser {
                power_w: 800.0,
                wavelength_m: 1064e-9,
                aperture_radius_m: 0.05,
                m2: 1.3,
            },
            focus_m: 800.0,
            end_m: 800.0,
            air: ScatteringAir::new(5e3, 1064e-9, [3.7e-4; 2]),
            exit_cam_m: DVec3::ZERO,
            axis_cam: DVec3::new(4e-4, 1e-4, 1.0).normalize(),
            lens_m: 0.045,
            blur_rad: 2e-5,
        };
        for offset_m in [0.0, 0.3] {
            let sight = BeamSight {
                exit_cam_m: DVec3::new(-offset_m, 0.0, 0.0),
                ..sight
            };
            let seen = |along| StrayLight {
                beams: vec![SeenBeam {
                    light: BeamLight::new(&sight.converged(800.0), |_| true),
                    kcd_per_w: [0.01; 3],
                    along,
                }],
                least_kcd_m2: 1e-4,
                ..camera(0.0, Vec::new())
            };
            let (smooth, exact) = (picture(&seen(true)), picture(&seen(false)));
            assert!(exact.iter().any(|value| *value > 1.0));
            for (index, (smooth, exact)) in smooth.iter().zip(exact).enumerate() {
                let off = (smooth - exact).abs();
                assert!(
                    off < 0.02 * exact + 2e-4,
                    "{offset_m} m, {index}: {smooth} {exact}"
                );
            }
        }
    }
}
