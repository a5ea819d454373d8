//! Coverage of pixels by a silhouette, sampled where the GPU samples.

use crate::bodies::{Rotors, UavMesh};
use crate::maths::kinematics::Pose;
use crate::optics::camera::{Pinhole, PixelRect};
use glam::{DMat3, DQuat, DVec2, DVec3};

/// Vulkan's standard sample positions for four samples a pixel (specification, "Rasterization").
const SAMPLES_4: [[f64; 2]; 4] = [
    [0.375, 0.125],
    [0.875, 0.375],
    [0.125, 0.625],
    [0.625, 0.875],
];
const SAMPLES_1: [[f64; 2]; 1] = [[0.5, 0.5]];
/// An 8 x 8 grid, row by row.
const FINE: [[f64; 2]; 64] = {
    let mut grid = [[0.0; 2]; 64];
    let mut i = 0;
    while i < 64 {
        grid[i] = [((i % 8) as f64 + 0.5) / 8.0, ((i / 8) as f64 + 0.5) / 8.0];
        i += 1;
    }
    grid
};

/// Samples counted over pixels: how many, where, and their bounding box.
#[derive(Clone, Copy, Debug)]
pub struct Coverage {
    /// Number of samples.
    pub samples: f64,
    sum_px: DVec2,
    low_px: DVec2,
    high_px: DVec2,
}

impl Default for Coverage {
    fn default() -> Self {
        Self {
            samples: 0.0,
            sum_px: DVec2::ZERO,
            low_px: DVec2::MAX,
            high_px: DVec2::MIN,
        }
    }
}

impl Coverage {
    /// Adds `samples` samples of pixel `x`, `y`.
    pub fn add(&mut self, x: u32, y: u32, samples: f64) {
        if samples > 0.0 {
            let corner = DVec2::new(f64::from(x), f64::from(y));
            self.samples += samples;
            self.sum_px += samples * (corner + 0.5);
            self.low_px = self.low_px.min(corner);
            self.high_px = self.high_px.max(corner + 1.0);
        }
    }

    /// The smallest box of whole pixels around the samples: x0, y0, x1, y1.
    pub fn box_px(&self) -> Option<[f64; 4]> {
        let (low, high) = (self.low_px, self.high_px);
        (self.samples > 0.0).then_some([low.x, low.y, high.x, high.y])
    }

    /// The mean position of the samples.
    pub fn centroid_px(&self) -> Option<[f64; 2]> {
        (self.samples > 0.0).then(|| (self.sum_px / self.samples).to_array())
    }
}

/// What a UAV at position and attitude `body` would cover of `rect` if nothing stood before it, pixel by pixel,
/// its rotors smeared by the exposure: the union of its triangles, with `antialias` (1 or 4) samples a pixel.
pub fn sampled_silhouette(
    pinhole: &Pinhole,
    pose: &Pose,
    body: (DVec3, DQuat),
    rotors: Rotors<'_>,
    shape: &UavMesh,
    rect: PixelRect,
    antialias: u32,
) -> Masks {
    let positions: &[[f64; 2]] = if antialias > 1 {
        &SAMPLES_4
    } else {
        &SAMPLES_1
    };
    let triangles = triangles(pinhole, pose, body, rotors, shape);
    cover(&triangles, rect, positions)
}

/// What [`sampled_silhouette`] gives with 8 x 8 samples a pixel.
pub fn fine_silhouette(
    pinhole: &Pinhole,
    pose: &Pose,
    body: (DVec3, DQuat),
    rotors: Rotors<'_>,
    shape: &UavMesh,
    rect: PixelRect,
) -> Masks {
    let triangles = triangles(pinhole, pose, body, rotors, shape);
    cover(&triangles, rect, &FINE)
}

/// The triangles of a UAV on the sensor [px]; a part that is not wholly in front is left out.
fn triangles(
    pinhole: &Pinhole,
    pose: &Pose,
    body: (DVec3, DQuat),
    rotors: Rotors<'_>,
    shape: &UavMesh,
) -> Vec<[DVec2; 3]> {
    let q_cam_enu = pose.q_enu_cam.inverse();
    let r_cam_m = q_cam_enu * (body.0 - pose.r_enu_m);
    let q_cam_body = q_cam_enu * body.1;
    let body_axes = DMat3::from_quat(q_cam_body);
    let body = shape.body.positions.iter();
    let body =
        body.map(|p| pinhole.project(r_cam_m + body_axes * DVec3::from_array(p.map(f64::from))));
    let mut parts = vec![(&shape.body.indices, body.collect::<Option<Vec<DVec2>>>())];
    for (number, (blade, at_body)) in (shape.blades_at(rotors.phase_rad).into_iter()).enumerate() {
        let axes = body_axes * at_body.matrix3;
        let hub_cam_m = r_cam_m + body_axes * at_body.translation;
        let points = (0..blade.positions.len())
            .map(|i| pinhole.project(hub_cam_m + axes * rotors.vertex_m(number, blade, i)));
        parts.push((&blade.indices, points.collect()));
    }
    parts
        .iter()
        .filter_map(|(indices, points)| points.as_ref().map(|points| (indices, points)))
        .flat_map(|(indices, points)| {
            indices
                .chunks_exact(3)
                .map(|t| [0, 1, 2].map(|i| points[t[i] as usize]))
        })
        // What faces away is not drawn: corners run counter-clockwise from outside, clockwise where rows count downward.
        .filter(|[a, b, c]| (*b - *a).perp_dot(*c - *a) < 0.0)
        .collect()
}

/// Which samples of each pixel a silhouette covers.
#[derive(Clone, Debug)]
pub struct Masks {
    /// The pixels that hold it.
    pub rect: PixelRect,
    /// A bit a sample, pixels row by row.
    pub masks: Vec<u64>,
}

impl Masks {
    /// The covered samples of pixel `x`, `y` of the sensor.
    pub fn at(&self, x: u32, y: u32) -> u64 {
        let [left, top] = self.rect.offset_px;
        let [width, height] = self.rect.size_px;
        let inside = x >= left && y >= top && x - left < width && y - top < height;
        if inside {
            self.masks[((y - top) * width + (x - left)) as usize]
        } else {
            0
        }
    }

    /// Box, centroid and number of the samples.
    pub fn coverage(&self) -> Coverage {
        let mut coverage = Coverage::default();
        let ([left, top], width) = (self.rect.offset_px, self.rect.size_px[0]);
        for (i, mask) in self.masks.iter().enumerate() {
            let (x, y) = (i as u32 % width, i as u32 / width);
            coverage.add(left + x, top + y, f64::from(mask.count_ones()));
        }
        coverage
    }
}

/// Pixels' sample masks of a union of triangles, with up to 64 samples a pixel.
fn cover(triangles: &[[DVec2; 3]], rect: PixelRect, positions: &[[f64; 2]]) -> Masks {
    let low = rect.offset_px.map(f64::from);
    let high = [0, 1].map(|i| low[i] + f64::from(rect.size_px[i]));
    let extent = triangles
        .iter()
        .flatten()
        .fold((DVec2::MAX, DVec2::MIN), |(a, b), p| (a.min(*p), b.max(*p)));
    let x0 = extent.0.x.floor().clamp(low[0], high[0]) as u32;
    let x1 = extent.1.x.ceil().clamp(low[0], high[0]) as u32;
    let y0 = extent.0.y.floor().clamp(low[1], high[1]) as u32;
    let y1 = extent.1.y.ceil().clamp(low[1], high[1]) as u32;
    let width = (x1 - x0) as usize;
    let mut masks = vec![0u64; width * (y1 - y0) as usize];
    for [a, b, c] in triangles {
        let area = (*b - *a).perp_dot(*c - *a);
        if area == 0.0 {
            continue;
        }
        let (near, far) = (a.min(*b).min(*c), a.max(*b).max(*c));
        let span = |low: f64, high: f64, from: u32, to: u32| {
            let clip = |x: f64| x.clamp(f64::from(from), f64::from(to)) as u32;
            clip(low.floor())..clip(high.ceil())
        };
        for y in span(near.y, far.y, y0, y1) {
            for x in span(near.x, far.x, x0, x1) {
                for (bit, position) in positions.iter().enumerate() {
                    let p = DVec2::new(f64::from(x) + position[0], f64::from(y) + position[1]);
                    let inside = [(a, b), (b, c), (c, a)]
                        .iter()
                        .all(|(from, to)| (**to - **from).perp_dot(p - **from) * area >= 0.0);
                    if inside {
                        masks[(y - y0) as usize * width + (x - x0) as usize] |= 1 << bit;
                    }
                }
            }
        }
    }
    Masks {
        rect: PixelRect {
            offset_px: [x0, y0],
            size_px: [x1 - x0, y1 - y0],
        },
        masks,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::uav_mesh;
    use crate::flight::uav::UavModel;
    use crate::shape::mesh::MeshData;

    const RECT: PixelRect = PixelRect {
        offset_px: [0, 0],
        size_px: [64, 48],
    };

    fn quad(low: DVec2, high: DVec2) -> [[DVec2; 3]; 2] {
        let (a, c) = (low, high);
        let (b, d) = (DVec2::new(high.x, low.y), DVec2::new(low.x, high.y));
        [[a, b, c], [a, c, d]]
    }

    #[test]
    fn whole_pixels_are_exact() {
        let triangles = quad(DVec2::new(10.0, 20.0), DVec2::new(14.0, 23.0));
        let coverage = cover(&triangles, RECT, &SAMPLES_4).coverage();
        assert_eq!(coverage.samples, 4.0 * 12.0);
        assert_eq!(coverage.box_px(), Some([10.0, 20.0, 14.0, 23.0]));
        assert_eq!(coverage.centroid_px(), Some([12.0, 21.5]));
    }

    /// Area [px^2] that a rotor seen from above covers of each square of 4 px.
    fn rotor_squares(speed_radps: f64, phase_rad: f64, exposure_s: f64) -> Vec<f64> {
        const SQUARE_PX: u32 = 4;
        const SIDE_PX: u32 = 64;
        let uav = UavModel::sample();
        let mut shape = uav_mesh(&uav);
        shape.body = MeshData::new(DVec3::ZERO);
        shape.rotors.truncate(1);
        let hub_m = std::mem::take(&mut shape.rotors[0].hub_body_m);
        assert!(hub_m.length() > 0.0);
        let radius_m = 0.5 * uav.propeller_diameter_m;
        let pinhole = Pinhole {
            width_px: SIDE_PX,
            height_px: SIDE_PX,
            focal_px: 28.0 * 100.0, // [px]: the blades reach 28 px from 100 radii away
        };
        let pose = Pose {
            r_enu_m: 100.0 * radius_m * DVec3::Z,
            q_enu_cam: DQuat::from_rotation_x(std::f64::consts::PI),
        };
        let rotors = Rotors {
            phase_rad: &[phase_rad],
            speed_radps: &[speed_radps],
            exposure_s,
        };
        let rect = PixelRect {
            offset_px: [0; 2],
            size_px: [SIDE_PX; 2],
        };
        let body = (DVec3::ZERO, DQuat::IDENTITY);
        let masks = fine_silhouette(&pinhole, &pose, body, rotors, &shape, rect);
        let squares = SIDE_PX / SQUARE_PX;
        let mut area_px2 = vec![0.0; (squares * squares) as usize];
        for (x, y) in (0..SIDE_PX).flat_map(|y| (0..SIDE_PX).map(move |x| (x, y))) {
            let square = y / SQUARE_PX * squares + x / SQUARE_PX;
            area_px2[square as usize] += f64::from(masks.at(x, y).count_ones()) / 64.0;
        }
        area_px2
    }

    #[test]
    fn a_smeared_rotor_covers_each_place_for_as_long_as_a_blade_is_there() {
        const PHASES: u32 = 64;
        let (speed_radps, phase_rad) = (600.0, 0.4);
        for exposure_s in [0.2e-3, 1e-3, 3e-3] {
            let smeared = rotor_squares(speed_radps, phase_rad, exposure_s);
            let mut mean = vec![0.0; smeared.len()];
            for k in 0..PHASES {
                let share = (f64::from(k) + 0.5) / f64::from(PHASES) - 0.5;
                let at_rad = phase_rad + share * speed_radps * exposure_s;
                let sharp = rotor_squares(speed_radps, at_rad, 0.0);
                for (sum, area_px2) in mean.iter_mut().zip(sharp) {
                    *sum += area_px2 / f64::from(PHASES);
                }
            }
            let total = |squares: &[f64]| squares.iter().sum::<f64>();
            let ratio = total(&smeared) / total(&mean);
            let worst_px2 = (smeared.iter().zip(&mean))
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            println!("{exposure_s} s: area {ratio:.3}, worst square {worst_px2:.2} px2 of 16");
            assert!((ratio - 1.0).abs() < 0.02, "{exposure_s} s: {ratio}");
            assert!(worst_px2 < 2.0, "{exposure_s} s: {worst_px2}");
            // It is smeared: what stands sharp differs by more.
            let sharp = rotor_squares(speed_radps, phase_rad, 0.0);
            let apart = (sharp.iter().zip(&mean)).map(|(a, b)| (a - b).abs());
            assert!(apart.fold(0.0, f64::max) > 2.0 * worst_px2);
        }
    }

    #[test]
    fn overlap_counts_once() {
        let mut triangles = quad(DVec2::new(5.0, 5.0), DVec2::new(9.0, 9.0)).to_vec();
        triangles.extend(quad(DVec2::new(7.0, 5.0), DVec2::new(11.0, 9.0)));
        assert_eq!(
            cover(&triangles, RECT, &SAMPLES_4).coverage().samples,
            4.0 * 24.0
        );
    }

    #[test]
    fn a_square_of_three_pixels_is_centred_within_a_fifth_at_worst() {
        // The mean over sub-pixel shifts and the worst case of four samples a pixel.
        let mut worst: f64 = 0.0;
        for i in 0..20 {
            for j in 0..20 {
                let low = DVec2::new(20.0 + 0.05 * f64::from(i), 20.0 + 0.05 * f64::from(j));
                let shape = quad(low, low + 3.0);
                let centroid = cover(&shape, RECT, &SAMPLES_4)
                    .coverage()
                    .centroid_px()
                    .unwrap();
                worst = worst.max((DVec2::from_array(centroid) - low - 1.5).length());
            }
        }
        // Axis-parallel edges are the worst case for a fixed sample pattern.
        assert!(worst < 0.2, "{worst}");
    }
}
