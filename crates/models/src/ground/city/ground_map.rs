//! The picture of the ground that the terrain mesh carries.

use glam::DVec2;

use crate::ground::dsm::HeightGrid;
use crate::maths::noise::ValueNoise;
use crate::maths::polygon::{rectangle, span};
use crate::maths::rng::Stream;

/// Resolution [px].
pub(super) const MAP_PX: usize = 2048;

/// The ground seen from above, 8-bit sRGB; row 0 is the north edge, column 0 the west edge.
#[derive(Clone, Debug, PartialEq)]
pub struct GroundMap {
    /// Pixels per side.
    pub size_px: usize,
    /// Side of the square it shows, which is centred on the site point [m].
    pub extent_m: f64,
    /// RGB, row by row.
    pub rgb: Vec<[u8; 3]>,
}

impl GroundMap {
    /// A map of one colour.
    pub(super) fn new(extent_m: f64, rgb: [u8; 3]) -> Self {
        Self {
            size_px: MAP_PX,
            extent_m,
            rgb: vec![rgb; MAP_PX * MAP_PX],
        }
    }

    /// Side of a pixel [m].
    pub(super) fn pixel_m(&self) -> f64 {
        self.extent_m / self.size_px as f64
    }

    /// Blends a convex polygon in, anti-aliased by the distance to its edges.
    pub(super) fn paint(&mut self, outline: &[DVec2], rgb: [u8; 3], alpha: f64) {
        let px = self.pixel_m();
        let half = self.extent_m / 2.0;
        let n = outline.len();
        if n < 3 {
            return;
        }
        // Clipping may leave edges without length, which have no inside.
        let edges: Vec<(DVec2, DVec2)> = (0..n)
            .filter_map(|k| {
                let (a, b) = (outline[k], outline[(k + 1) % n]);
                Some((a, (b - a).perp().try_normalize()?))
            })
            .collect();
        let clamp = |x: f64| x.clamp(0.0, self.size_px as f64) as usize;
        let [e0, e1] = span(outline, DVec2::X);
        let [n0, n1] = span(outline, DVec2::Y);
        let columns = clamp((e0 + half) / px - 1.0)..clamp((e1 + half) / px + 2.0);
        let east_m = |column: usize| (column as f64 + 0.5) * px - half;
        for row in clamp((half - n1) / px - 1.0)..clamp((half - n0) / px + 2.0) {
            let y = half - (row as f64 + 0.5) * px;
            // A street across the map would have a box of most of it: only where the row is within half a pixel
            // of every edge's inside, and a column more.
            let [mut from_m, mut to_m] = [east_m(columns.start), east_m(columns.end)];
            for &(a, inward) in &edges {
                let at_zero = (y - a.y) * inward.y - a.x * inward.x + 0.5 * px;
                let bound_m = -at_zero / inward.x;
                if inward.x > 0.0 {
                    from_m = from_m.max(bound_m - px);
                } else if inward.x < 0.0 {
                    to_m = to_m.min(bound_m + px);
                } else if at_zero < 0.0 {
                    to_m = f64::NEG_INFINITY;
                }
            }
            let column = |e_m: f64| clamp((e_m + half) / px);
            for column in column(from_m).max(columns.start)..(column(to_m) + 1).min(columns.end) {
                let p = DVec2::new(east_m(column), y);
                let inside = edges
                    .iter()
                    .map(|&(a, inward)| (p - a).dot(inward))
                    .fold(f64::INFINITY, f64::min);
                let cover = (inside / px + 0.5).clamp(0.0, 1.0) * alpha;
                if cover > 0.0 {
                    let pixel = &mut self.rgb[row * self.size_px + column];
                    for (old, new) in pixel.iter_mut().zip(rgb) {
                        *old = (f64::from(*old) + (f64::from(new) - f64::from(*old)) * cover)
                            .round() as u8;
                    }
                }
            }
        }
    }

    /// Paints a line of some width; what is thinner than a pixel blends by its share of it.
    pub(super) fn stroke(&mut self, [a, b]: [DVec2; 2], width_m: f64, rgb: [u8; 3], alpha: f64) {
        let px = self.pixel_m();
        let axis = (b - a).normalize_or(DVec2::X);
        let half = DVec2::new(a.distance(b) / 2.0, width_m.max(px) / 2.0);
        self.paint(
            &rectangle((a + b) / 2.0, axis, half),
            rgb,
            alpha * (width_m / px).min(1.0),
        );
    }

    /// Blends a colour in everywhere, with the weight that `alpha` gives a point [m].
    pub(super) fn blend(&mut self, rgb: [u8; 3], alpha: impl Fn(DVec2) -> f64) {
        let (px, half) = (self.pixel_m(), self.extent_m / 2.0);
        for row in 0..self.size_px {
            let y = half - (row as f64 + 0.5) * px;
            for column in 0..self.size_px {
                let e = (column as f64 + 0.5) * px - half;
                let alpha = alpha(DVec2::new(e, y));
                if alpha > 0.0 {
                    let pixel = &mut self.rgb[row * self.size_px + column];
                    for (old, new) in pixel.iter_mut().zip(rgb) {
                        *old = (f64::from(*old) * (1.0 - alpha) + f64::from(new) * alpha) as u8;
                    }
                }
            }
        }
    }

    /// Mottles the map, and darkens it where buildings close off the sky.
    pub(super) fn finish(
        &mut self,
        terrain: &HeightGrid,
        surface: &HeightGrid,
        noise: &ValueNoise,
        rng: &mut Stream,
    ) {
        let openness = openness(self.extent_m, terrain, surface);
        let (px, half) = (self.pixel_m(), self.extent_m / 2.0);
        for row in 0..self.size_px {
            let y = half - (row as f64 + 0.5) * px;
            for column in 0..self.size_px {
                let p = DVec2::new((column as f64 + 0.5) * px - half, y);
                let grain = 1.0
                    + 0.05 * noise.at(p / 19.0)
                    + 0.05 * noise.at(p / 4.3)
                    + rng.range(-0.04, 0.04);
                let factor = openness.bilinear_m(p.x, p.y).powf(0.7) * grain;
                for c in &mut self.rgb[row * self.size_px + column] {
                    *c = (f64::from(*c) * factor).clamp(0.0, 255.0) as u8;
                }
            }
        }
    }

    /// The map with the sun's shadows: where `lit` says that a point is in the sun, it keeps its
    /// colour; elsewhere it has the skylight's share. The mean of 2 x 2 samples a pixel.
    pub(super) fn with_shadows(&self, lit: impl Fn(DVec2) -> bool) -> Self {
        let (px, half) = (self.pixel_m(), self.extent_m / 2.0);
        let gains = [0, 1, 2, 3, 4].map(|q| shadow_gain(f64::from(q) / 4.0));
        let mut map = self.clone();
        for row in 0..self.size_px {
            for column in 0..self.size_px {
                let mut sum = 0;
                for (dx, dy) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
                    let p = DVec2::new(
                        (column as f64 + dx) * px - half,
                        half - (row as f64 + dy) * px,
                    );
                    sum += usize::from(lit(p));
                }
                let pixel = &mut map.rgb[row * self.size_px + column];
                *pixel = std::array::from_fn(|c| (f64::from(pixel[c]) * gains[sum][c]) as u8);
            }
        }
        map
    }

    /// The map with all of it in shadow.
    pub(super) fn all_shaded(&self) -> Self {
        let dark = shadow_gain(0.0);
        let mut map = self.clone();
        for pixel in &mut map.rgb {
            *pixel = std::array::from_fn(|c| (f64::from(pixel[c]) * dark[c]) as u8);
        }
        map
    }
}

/// What 8-bit sRGB values are multiplied by where the share `lit` of a pixel is in the sun.
fn shadow_gain(lit: f64) -> [f64; 3] {
    // Skylight's share (assumed) of the global irradiance on open ground under a clear sky, bluish.
    const SKY: [f64; 3] = [0.27, 0.30, 0.35];
    SKY.map(|s| (s + (1.0 - s) * lit).powf(1.0 / 2.2))
}

/// 8-bit sRGB of a linear albedo.
pub(super) fn srgb8(albedo: [f32; 3]) -> [u8; 3] {
    albedo.map(|c| (255.0 * c.clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8)
}

/// How open the sky is over the built square of side `extent_m` [m], 0..1: less where the mean
/// height of what stands around is great.
fn openness(extent_m: f64, terrain: &HeightGrid, surface: &HeightGrid) -> HeightGrid {
    const CELL_M: f64 = 6.0;
    let n = (extent_m / CELL_M).ceil() as usize;
    let mut mean = vec![0.0f32; n * n];
    let mut count = vec![0.0f32; n * n];
    for (k, &h) in surface.heights_m.iter().enumerate() {
        let e = (k % surface.nx) as f64 * surface.cell_m;
        let y = (k / surface.nx) as f64 * surface.cell_m;
        let cell = ((y / CELL_M) as usize).min(n - 1) * n + ((e / CELL_M) as usize).min(n - 1);
        mean[cell] += h;
        count[cell] += 1.0;
    }
    for (k, m) in mean.iter_mut().enumerate() {
        let at = |i: usize| (i as f64 + 0.5) * CELL_M - extent_m / 2.0;
        *m = *m / count[k].max(1.0) - terrain.bilinear_m(at(k % n), at(k / n)) as f32;
    }
    // Two box blurs along each axis.
    for stride in [1, n] {
        for _ in 0..2 {
            blur(&mut mean, n, stride);
        }
    }
    HeightGrid {
        origin_e_m: -extent_m / 2.0,
        origin_n_m: -extent_m / 2.0,
        cell_m: CELL_M,
        nx: n,
        ny: n,
        heights_m: mean
            .iter()
            .map(|m| 1.0 / (1.0 + m.max(0.0) / 26.0))
            .collect(),
    }
}

/// Replaces each cell of an n x n grid by the mean of up to five neighbours along the axis whose
/// cells are `stride` apart.
fn blur(grid: &mut [f32], n: usize, stride: usize) {
    let old = grid.to_vec();
    for (k, m) in grid.iter_mut().enumerate() {
        let along = k / stride % n;
        let (low, high) = (along.saturating_sub(2), (along + 2).min(n - 1));
        let sum: f32 = (low..=high)
            .map(|i| old[k - along * stride + i * stride])
            .sum();
        *m = sum / (high - low + 1) as f32;
    }
}
