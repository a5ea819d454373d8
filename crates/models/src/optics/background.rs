//! The sky behind what was rendered: added on the CPU, from its exact model.
//!
//! A renderer pays for every sample of every pixel; the sky is smooth. So the renderer leaves it black and
//! tells how many samples of a pixel something solid covers, and the sky is worked out on a lattice and
//! joined linearly in between: every [`TILE_PX`] pixels, with clouds every [`CLOUD_PX`]. The lattice is the
//! sensor's, so that a window of a frame has the frame's pixels.

use crate::air::backdrop::Backdrop;
use crate::optics::camera::{Pinhole, PixelRect};
use glam::{DQuat, DVec2, DVec3};
use half::f16;
use half::slice::HalfFloatSliceExt;

/// Pixels from a node of the sky to the next.
pub const TILE_PX: usize = 16;
/// Pixels from a node of the clouds to the next.
const CLOUD_PX: usize = 4;
const NODES: usize = TILE_PX / CLOUD_PX;
/// Bytes of a half-float RGBA pixel.
const PIXEL_BYTES: usize = 8;

/// The alpha of a sample that a solid surface covers: 1, and a power of five for who it is, so that
/// the sum over a pixel's samples modulo five counts the covered ones.
const BASE: u32 = 5;

/// The share of a pixel's `samples` that nothing solid covers, from their mean alpha.
pub fn open_share(alpha: f32, samples: u32) -> f32 {
    let samples = samples as f32;
    let sum = (alpha * samples + 0.5) as u32;
    1.0 - (sum % BASE) as f32 / samples
}

/// How a frame looks at the sky.
#[derive(Clone, Copy, Debug)]
pub struct Background<'a> {
    /// What there is to see.
    pub backdrop: &'a Backdrop,
    /// The whole sensor.
    pub pinhole: Pinhole,
    /// Attitude of the camera.
    pub q_enu_cam: DQuat,
    /// The part of the sensor that was rendered.
    pub rect: PixelRect,
    /// Samples a pixel, 1 or 4.
    pub samples: u32,
}

impl Background<'_> {
    /// Adds the sky to the `rows` of the frame, the first of which is row `first` of the rectangle: half-float
    /// RGBA, little-endian, the luminance [kcd/m^2] of the covered samples over all samples, and the
    /// mean alpha of the samples.
    pub fn fill(&self, first: usize, rows: &mut [u8]) {
        let width = self.rect.size_px[0] as usize;
        let [left, top] = self.rect.offset_px.map(|x| x as usize);
        let count = rows.len() / (PIXEL_BYTES * width).max(1);
        let mut lattice = Lattice::default();
        let mut row = 0;
        while row < count {
            // Up to the next row of the sensor's lattice.
            let y = top + first + row;
            let end = count.min(row + TILE_PX - y % TILE_PX);
            let mut x = left;
            while x < left + width {
                let next = (left + width).min(x - x % TILE_PX + TILE_PX);
                let columns = [x, next].map(|x| PIXEL_BYTES * (x - left));
                let lines = rows[PIXEL_BYTES * width * row..PIXEL_BYTES * width * end]
                    .chunks_exact_mut(PIXEL_BYTES * width)
                    .map(|line| &mut line[columns[0]..columns[1]]);
                self.fill_tile([x, y], &mut lattice, lines);
                x = next;
            }
            lattice.go_down();
            row = end;
        }
    }

    /// Adds the sky to the part of a tile whose first pixel is `at` of the sensor.
    fn fill_tile<'b>(
        &self,
        at: [usize; 2],
        lattice: &mut Lattice,
        lines: impl Iterator<Item = &'b mut [u8]>,
    ) {
        let corner = at.map(|x| x - x % TILE_PX);
        let mut tile: Option<Tile> = None;
        for (y, line) in (at[1]..).zip(lines) {
            let mut rgba = [0.0; 4 * TILE_PX];
            let mut halves = [f16::ZERO; 4 * TILE_PX];
            let length = line.len() / 2;
            // Most of a sky is bare: it is written without being read.
            let (words, _) = line.as_chunks::<PIXEL_BYTES>();
            let drawn = words
                .iter()
                .fold(0, |all, pixel| all | u64::from_ne_bytes(*pixel))
                != 0;
            let (bytes, _) = line.as_chunks_mut::<2>();
            let open = |alpha: f32| open_share(alpha, self.samples);
            let (pixels, _) = rgba[..length].as_chunks_mut::<4>();
            if drawn {
                for (half, bytes) in halves.iter_mut().zip(&*bytes) {
                    *half = f16::from_le_bytes(*bytes);
                }
                halves[..length].convert_to_f32_slice(pixels.as_flattened_mut());
                if pixels.iter().all(|pixel| open(pixel[3]) <= 0.0) {
                    continue;
                }
            }
            let tile = tile.get_or_insert_with(|| self.tile(corner, lattice));
            let sky = tile.line(y - corner[1]);
            let sky = &sky[at[0] - corner[0]..];
            if drawn {
                for (pixel, sky) in pixels.iter_mut().zip(sky) {
                    let open = open(pixel[3]);
                    for (pixel, sky) in pixel.iter_mut().zip(sky) {
                        *pixel += open * sky;
                    }
                }
            } else {
                pixels.copy_from_slice(&sky[..pixels.len()]);
            }
            if tile.sunny {
                for (x, pixel) in (at[0]..).zip(rgba[..length].as_chunks_mut::<4>().0) {
                    let px = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                    let disc = self.backdrop.disc(self.direction(px));
                    let left = tile.sun_left(x - corner[0], y - corner[1]) * open(pixel[3]);
                    for (pixel, disc) in pixel.iter_mut().zip(disc) {
                        *pixel += left * disc as f32;
                    }
                }
            }
            halves[..length].convert_from_f32_slice(&rgba[..length]);
            for (half, bytes) in halves.iter().zip(bytes) {
                *bytes = half.to_le_bytes();
            }
        }
    }

    /// The direction of an image point.
    fn direction(&self, px: DVec2) -> DVec3 {
        self.q_enu_cam * self.pinhole.ray(px)
    }

    /// The sky of the tile whose corner is pixel `corner` of the sensor.
    fn tile(&self, corner: [usize; 2], lattice: &mut Lattice) -> Tile {
        let corner_px = DVec2::new(corner[0] as f64, corner[1] as f64);
        let at = |i: usize, j: usize| corner_px + DVec2::new(i as f64, j as f64);
        let last = TILE_PX;
        let first = self.rect.offset_px[0] as usize / TILE_PX;
        let corners = [0, 1].map(|j| {
            [0, 1].map(|i| {
                let column = corner[0] / TILE_PX - first + i;
                lattice.at(column, j, || {
                    self.backdrop
                        .sky
                        .radiance(self.direction(at(i * last, j * last)))
                })
            })
        });
        let detail_rad = CLOUD_PX as f64 / self.pinhole.focal_px;
        let middle = self.direction(at(last / 2, last / 2));
        let radius_rad = TILE_PX as f64 / self.pinhole.focal_px;
        let node = |i: usize, j: usize| {
            let [u, v] = [i, j].map(|n| n as f64 / NODES as f64);
            let clear = std::array::from_fn(|c| {
                let along = |row: &[[f64; 3]; 2]| row[0][c] + (row[1][c] - row[0][c]) * u;
                along(&corners[0]) + (along(&corners[1]) - along(&corners[0])) * v
            });
            if !self.backdrop.is_clouded() {
                return (clear, 1.0);
            }
            let dir = self.direction(at(i * CLOUD_PX, j * CLOUD_PX));
            self.backdrop.clouded(dir, clear, detail_rad)
        };
        Tile {
            nodes: std::array::from_fn(|j| {
                std::array::from_fn(|i| {
                    let (rgb, left) = node(i, j);
                    let [r, g, b] = rgb.map(|x| x as f32);
                    [r, g, b, left as f32]
                })
            }),
            sunny: self.backdrop.disc_near(middle, radius_rad),
        }
    }
}

/// The clear sky at the corners of a row of tiles, the upper ones and the lower ones, where a tile has asked for it.
#[derive(Default)]
struct Lattice([Vec<Option<[f64; 3]>>; 2]);

impl Lattice {
    /// The sky at column `column` of the upper (0) or lower (1) corners.
    fn at(&mut self, column: usize, row: usize, sky: impl FnOnce() -> [f64; 3]) -> [f64; 3] {
        let row = &mut self.0[row];
        if row.len() <= column {
            row.resize(column + 1, None);
        }
        *row[column].get_or_insert_with(sky)
    }

    /// Goes on to the next row of tiles, whose upper corners are this one's lower.
    fn go_down(&mut self) {
        self.0.swap(0, 1);
        self.0[1].clear();
    }
}

/// The sky of a square of pixels.
struct Tile {
    /// Rows of nodes: linear sRGB [kcd/m^2], and what clouds leave of the sun's disc.
    nodes: [[[f32; 4]; NODES + 1]; NODES + 1],
    /// Whether the sun's disc may show in it.
    sunny: bool,
}

impl Tile {
    /// The radiance at the pixels of row `y` of the tile; the fourth number is 0.
    fn line(&self, y: usize) -> [[f32; 4]; TILE_PX] {
        let v = (y % CLOUD_PX) as f32 / CLOUD_PX as f32 + 0.5 / CLOUD_PX as f32;
        let rows = [y / CLOUD_PX, y / CLOUD_PX + 1].map(|j| &self.nodes[j]);
        // All four numbers at once, so that a pixel is one vector.
        let join = |a: &[f32; 4], b: &[f32; 4], share: f32| -> [f32; 4] {
            std::array::from_fn(|c| a[c] + (b[c] - a[c]) * share)
        };
        let across: [[f32; 4]; NODES + 1] =
            std::array::from_fn(|i| join(&rows[0][i], &rows[1][i], v));
        std::array::from_fn(|x| {
            let (i, u) = (
                x / CLOUD_PX,
                (x % CLOUD_PX) as f32 / CLOUD_PX as f32 + 0.5 / CLOUD_PX as f32,
            );
            let [r, g, b, _] = join(&across[i], &across[i + 1], u);
            [r, g, b, 0.0]
        })
    }

    /// What clouds leave of the sun's disc about a pixel.
    fn sun_left(&self, x: usize, y: usize) -> f32 {
        self.nodes[(y + CLOUD_PX / 2) / CLOUD_PX][(x + CLOUD_PX / 2) / CLOUD_PX][3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::air::sky::Sky;

    fn backdrop(cover: f64) -> Backdrop {
        let sun_dir_enu = DVec3::new(0.1, 0.95, 0.3).normalize();
        let sky = Sky::new(sun_dir_enu, 20_000.0, cover, 0.18);
        Backdrop::new(sky, sun_dir_enu).with_clouds(cover, Some(7))
    }

    fn background(backdrop: &Backdrop, rect: PixelRect) -> Background<'_> {
        Background {
            backdrop,
            pinhole: Pinhole::from_hfov(640, 480, 0.1).unwrap(),
            // North, 17 degrees up: the sun's disc is in the field.
            q_enu_cam: DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2 + 0.3),
            rect,
            samples: 4,
        }
    }

    fn rect(offset_px: [u32; 2], size_px: [u32; 2]) -> PixelRect {
        PixelRect { offset_px, size_px }
    }

    fn pixel(bytes: &[u8], index: usize) -> [f64; 4] {
        [0, 2, 4, 6].map(|k| {
            let at = PIXEL_BYTES * index + k;
            f16::from_le_bytes([bytes[at], bytes[at + 1]]).to_f64()
        })
    }

    #[test]
    fn an_empty_frame_becomes_the_sky() {
        let backdrop = backdrop(0.0);
        let frame = background(&backdrop, rect([0, 0], [640, 480]));
        let mut bytes = vec![0; PIXEL_BYTES * 640 * 480];
        frame.fill(0, &mut bytes);
        for (x, y) in [(0, 0), (639, 479), (100, 333), (17, 401), (320, 240)] {
            let dir = frame.direction(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
            let (sky, disc) = (backdrop.sky.radiance(dir), backdrop.disc(dir));
            let found = pixel(&bytes, y * 640 + x);
            for c in 0..3 {
                let expected = sky[c] + disc[c];
                assert!(
                    (found[c] / expected - 1.0).abs() < 2e-3,
                    "{x} {y} {found:?}"
                );
            }
            assert_eq!(found[3], 0.0);
        }
    }

    #[test]
    fn what_is_covered_stays_and_edges_are_mixed() {
        let backdrop = backdrop(0.0);
        let frame = background(&backdrop, rect([64, 96], [32, 2]));
        let mut bytes = vec![0; PIXEL_BYTES * 64];
        // Covered by 4, 2 and 1 samples, the last of them with the fourth identity.
        for (index, alpha) in [(5, 1.0), (6, 0.5), (7, 0.25 * 626.0)] {
            for (k, value) in [0.25, 0.25, 0.25, alpha].into_iter().enumerate() {
                let at = PIXEL_BYTES * index + 2 * k;
                bytes[at..at + 2].copy_from_slice(&f16::from_f64(value).to_le_bytes());
            }
        }
        frame.fill(0, &mut bytes);
        let sky = pixel(&bytes, 8)[0];
        let shares = [5, 6, 7].map(|index| (pixel(&bytes, index)[0] - 0.25) / sky);
        for (share, expected) in shares.into_iter().zip([0.0, 0.5, 0.75]) {
            assert!((share - expected).abs() < 5e-3, "{shares:?}");
        }
        assert_eq!([5, 6, 7].map(|i| pixel(&bytes, i)[3]), [1.0, 0.5, 156.5]);
    }

    #[test]
    fn a_window_and_any_split_of_rows_have_the_frames_pixels() {
        let backdrop = backdrop(0.5);
        let frame = background(&backdrop, rect([0, 0], [640, 480]));
        let mut whole = vec![0; PIXEL_BYTES * 640 * 480];
        frame.fill(0, &mut whole);
        let window = background(&backdrop, rect([203, 117], [100, 70]));
        let mut part = vec![0; PIXEL_BYTES * 100 * 70];
        let (upper, lower) = part.split_at_mut(PIXEL_BYTES * 100 * 31);
        window.fill(0, upper);
        window.fill(31, lower);
        for y in 0..70 {
            let from = PIXEL_BYTES * (640 * (117 + y) + 203);
            let line = &whole[from..from + PIXEL_BYTES * 100];
            assert_eq!(
                line,
                &part[PIXEL_BYTES * 100 * y..PIXEL_BYTES * 100 * (y + 1)]
            );
        }
    }
}
