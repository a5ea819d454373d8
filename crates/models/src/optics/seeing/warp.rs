//! A picture seen through moving air: its parts shifted by a map each, and blurred.

use super::ripples::Ripples;
use crate::optics::camera::PixelRect;
use crate::optics::sensor::half_kernel;
use glam::{DVec2, Vec4};
use half::f16;
use half::slice::HalfFloatSliceExt;
use std::ops::Range;

/// Blur below this is left out [px], as the sensor's is.
const MIN_BLUR_PX: f64 = 0.15;
/// Blur above this is cut off [px]: nothing is to be seen any more.
const MAX_BLUR_PX: f64 = 16.0;
/// Farthest that a pixel's light may come from [px].
const MAX_SHIFT_PX: f32 = 64.0;
/// Largest finite half float, to which brighter input is limited.
const MAX_VALUE: f32 = 65504.0;

/// Shifts at the nodes of a grid over a part of a sensor; linear between them.
#[derive(Clone, Debug, PartialEq)]
pub struct ShiftMap {
    /// Place of the first node [px].
    from_px: [f64; 2],
    pitch_px: f64,
    columns: usize,
    rows: usize,
    /// Right and down [px], row by row.
    shifts_px: [Vec<f32>; 2],
}

impl ShiftMap {
    /// The map over a rectangle of the sensor. A node has the same shift whatever rectangle it is wanted for.
    pub fn new(ripples: &Ripples, rect: PixelRect) -> Self {
        let lens = ripples.lens();
        let pitch_px = lens.pitch_px;
        let first = rect.offset_px.map(|x| (f64::from(x) / pitch_px).floor());
        let count = |i: usize| {
            let end = f64::from(rect.offset_px[i] + rect.size_px[i]) / pitch_px;
            (end.ceil() - first[i]) as usize + 1
        };
        let (columns, rows) = (count(0), count(1));
        let from_px = first.map(|node| node * pitch_px);
        let from = DVec2::from(from_px) - lens.centre_px;
        let mut shifts_px = [(); 2].map(|()| vec![0.0f32; columns * rows]);
        let (mut sines, mut cosines) = (vec![0.0f32; columns], vec![0.0f32; columns]);
        for wave in &ripples.waves {
            // sin(a + b) = sin a cos b + cos a sin b: a by columns, b by rows.
            let step = wave.per_px * pitch_px;
            for (i, (sine, cosine)) in sines.iter_mut().zip(&mut cosines).enumerate() {
                let (s, c) = (wave.per_px.x * from.x + step.x * i as f64).sin_cos();
                (*sine, *cosine) = (s as f32, c as f32);
            }
            let [right, down] = wave.shift_px.to_array().map(|px| px as f32);
            for row in 0..rows {
                let b = wave.phase_rad + wave.per_px.y * from.y + step.y * row as f64;
                let (s, c) = b.sin_cos();
                let (s, c) = (s as f32, c as f32);
                let nodes = row * columns..(row + 1) * columns;
                let [rights, downs] = &mut shifts_px;
                let to = rights[nodes.clone()].iter_mut().zip(&mut downs[nodes]);
                for ((to_right, to_down), (sine, cosine)) in to.zip(sines.iter().zip(&cosines)) {
                    let wave = sine * c + cosine * s;
                    *to_right += right * wave;
                    *to_down += down * wave;
                }
            }
        }
        for shift in shifts_px.iter_mut().flatten() {
            *shift = shift.clamp(-MAX_SHIFT_PX, MAX_SHIFT_PX);
        }
        Self {
            from_px,
            pitch_px,
            columns,
            rows,
            shifts_px,
        }
    }

    /// Largest shift along either axis [px].
    pub fn reach_px(&self) -> f64 {
        let all = self.shifts_px.iter().flatten();
        f64::from(all.fold(0.0f32, |most, shift| most.max(shift.abs())))
    }

    /// The shifts of a row of pixels [px, whole sensor], `columns` from `x0` on.
    pub(super) fn row(&self, x0: u32, y: u32, columns: usize, out: &mut Vec<[f32; 2]>) {
        let at = |px: f64, i: usize, count: usize| {
            let at = ((px - self.from_px[i]) / self.pitch_px).clamp(0.0, (count - 1) as f64);
            let cell = (at as usize).min(count.saturating_sub(2));
            (cell, (at - cell as f64) as f32)
        };
        let (row, down) = at(f64::from(y) + 0.5, 1, self.rows);
        let below = (row + 1).min(self.rows - 1);
        out.clear();
        out.extend((0..columns).map(|i| {
            let (column, along) = at(f64::from(x0) + i as f64 + 0.5, 0, self.columns);
            let beside = (column + 1).min(self.columns - 1);
            [0, 1].map(|axis| {
                let shift =
                    |row: usize, column: usize| self.shifts_px[axis][row * self.columns + column];
                let above = shift(row, column) + along * (shift(row, beside) - shift(row, column));
                let under =
                    shift(below, column) + along * (shift(below, beside) - shift(below, column));
                above + down * (under - above)
            })
        }));
    }
}

/// A rectangle of a frame, and what the air makes of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// The rectangle [px, whole sensor], within the frame.
    pub rect: PixelRect,
    /// Its shifts.
    pub map: ShiftMap,
    /// Standard deviation of its blur [px].
    pub blur_px: f64,
}

impl Part {
    /// Whether it changes the picture by anything that shows.
    pub fn shows(&self) -> bool {
        self.blur_px >= MIN_BLUR_PX || self.map.reach_px() > 1e-3
    }
}

/// A rendered frame of single floats.
#[derive(Clone, Debug, Default)]
pub struct Picture {
    width: usize,
    height: usize,
    origin_px: [u32; 2],
    pixels: Vec<Vec4>,
}

/// What a strip of rows is worked out in.
#[derive(Clone, Debug, Default)]
pub struct WarpScratch {
    /// Rows blurred along themselves, then across.
    along: Vec<Vec4>,
    blurred: Vec<Vec4>,
    shifts_px: Vec<[f32; 2]>,
    warped: Vec<f32>,
    half: Vec<f16>,
}

impl Picture {
    /// Reads rows of RGBA half floats, little-endian, of a rectangle of a sensor; what is no light becomes 0.
    pub fn read(&mut self, rgba16f: &[u8], rect: PixelRect) {
        [self.width, self.height] = rect.size_px.map(|n| n as usize);
        self.origin_px = rect.offset_px;
        self.pixels.clear();
        let mut half = [f16::ZERO; 1024];
        let mut single = [0.0f32; 1024];
        for bytes in rgba16f.as_chunks::<2>().0.chunks(half.len()) {
            let (half, single) = (&mut half[..bytes.len()], &mut single[..bytes.len()]);
            for (half, bytes) in half.iter_mut().zip(bytes) {
                *half = f16::from_le_bytes(*bytes);
            }
            half.convert_to_f32_slice(single);
            let pixels = single.as_chunks::<4>().0.iter();
            self.pixels.extend(pixels.map(|rgba| {
                let limited = |value: f32| {
                    // A comparison with a NaN is false.
                    let value = if value > 0.0 { value } else { 0.0 };
                    if value < MAX_VALUE { value } else { MAX_VALUE }
                };
                Vec4::from(rgba.map(limited))
            }));
        }
    }

    /// Writes what the parts make of `rows` of the picture to those rows of the frame it was read from; later parts lie over
    /// earlier ones. Outside the frame the picture goes on as it ends.
    pub fn write(
        &self,
        parts: &[Part],
        rows: Range<usize>,
        scratch: &mut WarpScratch,
        rgba16f: &mut [u8],
    ) {
        for part in parts.iter().filter(|part| part.shows()) {
            let local = |i: usize, limit: usize| {
                let from = part.rect.offset_px[i].saturating_sub(self.origin_px[i]) as usize;
                from.min(limit)..(from + part.rect.size_px[i] as usize).min(limit)
            };
            let (columns, own) = (local(0, self.width), local(1, self.height));
            let wanted = own.start.max(rows.start)..own.end.min(rows.end);
            if wanted.is_empty() || columns.is_empty() {
                continue;
            }
            let reach = part.map.reach_px().ceil() as usize + 2;
            let grown = |range: &Range<usize>, limit: usize| {
                range.start.saturating_sub(reach)..(range.end + reach).min(limit)
            };
            let (source_x, source_y) = (grown(&columns, self.width), grown(&wanted, self.height));
            self.blur(part.blur_px, &source_x, &source_y, scratch);
            for y in wanted {
                let line = 8 * self.width * (y - rows.start);
                let out = &mut rgba16f[line + 8 * columns.start..line + 8 * columns.end];
                let (x0, y0) = (
                    self.origin_px[0] + columns.start as u32,
                    self.origin_px[1] + y as u32,
                );
                let WarpScratch {
                    blurred,
                    shifts_px,
                    warped,
                    half,
                    ..
                } = &mut *scratch;
                part.map.row(x0, y0, columns.len(), shifts_px);
                warped.clear();
                for (i, [right, down]) in shifts_px.iter().enumerate() {
                    let from_x = (columns.start - source_x.start + i) as f32 - right;
                    let from_y = (y - source_y.start) as f32 - down;
                    let size = [source_x.len(), source_y.len()];
                    let value = interpolated(blurred, size, from_x, from_y).max(Vec4::ZERO);
                    warped.extend(value.to_array());
                }
                half.resize(warped.len(), f16::ZERO);
                half.convert_from_f32_slice(warped);
                for (bytes, half) in out.as_chunks_mut::<2>().0.iter_mut().zip(half.iter()) {
                    *bytes = half.to_le_bytes();
                }
            }
        }
    }

    /// Blurs a rectangle of the picture into `scratch.blurred`.
    fn blur(&self, sigma_px: f64, x: &Range<usize>, y: &Range<usize>, scratch: &mut WarpScratch) {
        let WarpScratch { along, blurred, .. } = scratch;
        let line = |row: usize| &self.pixels[row * self.width..(row + 1) * self.width];
        blurred.clear();
        if sigma_px < MIN_BLUR_PX {
            for row in y.clone() {
                blurred.extend_from_slice(&line(row)[x.clone()]);
            }
            return;
        }
        let taps: Vec<f32> = half_kernel(sigma_px.min(MAX_BLUR_PX))
            .iter()
            .map(|tap| *tap as f32)
            .collect();
        let radius = taps.len() - 1;
        let columns = x.len();
        let rows = y.start.saturating_sub(radius)..(y.end + radius).min(self.height);
        along.clear();
        for row in rows.clone() {
            let line = line(row);
            let clamped = |x: usize, k: usize| {
                let (left, right) = (x.saturating_sub(k), (x + k).min(self.width - 1));
                line[left] + line[right]
            };
            along.extend(x.clone().map(|x| {
                let mut sum = taps[0] * line[x];
                if x >= radius && x + radius < self.width {
                    let near = &line[x - radius..=x + radius];
                    for (k, tap) in taps.iter().enumerate().skip(1) {
                        sum += *tap * (near[radius - k] + near[radius + k]);
                    }
                } else {
                    for (k, tap) in taps.iter().enumerate().skip(1) {
                        sum += *tap * clamped(x, k);
                    }
                }
                sum
            }));
        }
        let at = |row: usize| {
            let start = (row - rows.start) * columns;
            &along[start..start + columns]
        };
        for row in y.clone() {
            let first = blurred.len();
            blurred.extend(at(row).iter().map(|pixel| taps[0] * *pixel));
            for (k, tap) in taps.iter().enumerate().skip(1) {
                let above = at(row.saturating_sub(k));
                let below = at((row + k).min(self.height - 1));
                for (sum, (above, below)) in
                    blurred[first..].iter_mut().zip(above.iter().zip(below))
                {
                    *sum += *tap * (*above + *below);
                }
            }
        }
    }
}

/// Catmull-Rom weights of the pixels -1, 0, 1, 2 for a point `f` after pixel 0, which keep centroid and variance.
fn catmull_rom(f: f32) -> [f32; 4] {
    [
        ((2.0 - f) * f - 1.0) * f / 2.0,
        ((3.0 * f - 5.0) * f * f + 2.0) / 2.0,
        ((4.0 - 3.0 * f) * f + 1.0) * f / 2.0,
        (f - 1.0) * f * f / 2.0,
    ]
}

/// A picture's value at a place between its pixels, counted from the middle of the first.
fn interpolated(pixels: &[Vec4], [width, height]: [usize; 2], x: f32, y: f32) -> Vec4 {
    let (cell_x, cell_y) = (x.floor(), y.floor());
    let (weights_x, weights_y) = (catmull_rom(x - cell_x), catmull_rom(y - cell_y));
    let (cell_x, cell_y) = (cell_x as isize, cell_y as isize);
    let mut sum = Vec4::ZERO;
    let inside =
        cell_x >= 1 && cell_y >= 1 && cell_x + 2 < width as isize && cell_y + 2 < height as isize;
    for (j, weight_y) in (-1..).zip(weights_y) {
        let row = (cell_y + j).clamp(0, height as isize - 1) as usize * width;
        let mut along = Vec4::ZERO;
        if inside {
            let first = row + cell_x as usize - 1;
            for (pixel, weight) in pixels[first..first + 4].iter().zip(weights_x) {
                along += weight * *pixel;
            }
        } else {
            for (i, weight) in (-1..).zip(weights_x) {
                let column = (cell_x + i).clamp(0, width as isize - 1) as usize;
                along += weight * pixels[row + column];
            }
        }
        sum += weight_y * along;
    }
    sum
}
