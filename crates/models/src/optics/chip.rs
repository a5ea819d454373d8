//! Chips: small square pictures of what a detection shows, all of one size.

use crate::optics::camera::PixelRect;
use std::sync::Arc;

/// Width and height of a chip [px].
pub const CHIP_PX: usize = 24;
/// A chip's 8-bit RGB pixels, row by row.
pub type Chip = Arc<[u8]>;

/// The square of `side_px` around `centre_px`, both in pixels of the sensor, of a picture that holds
/// the sensor's pixels `rect` as 8-bit RGB rows; beyond them the nearest pixel goes on.
///
/// Each pixel is the mean of the picture under a triangle as wide as two pixels of the chip, or of
/// the picture where those are wider: linear interpolation where it enlarges, and no aliases where it
/// shrinks.
pub fn chip(rgb8: &[u8], rect: PixelRect, centre_px: [f64; 2], side_px: f64) -> Chip {
    let [width, height] = rect.size_px.map(|side| side as usize);
    if rgb8.len() < 3 * width * height || width * height == 0 {
        return vec![0; 3 * CHIP_PX * CHIP_PX].into();
    }
    let corner_px = |axis: usize| centre_px[axis] - f64::from(rect.offset_px[axis]) - 0.5 * side_px;
    let columns = taps(corner_px(0), side_px, width);
    let rows = taps(corner_px(1), side_px, height);
    let first = rows.first().map_or(0, |taps| taps.first);
    let last = rows
        .last()
        .map_or(0, |taps| taps.first + taps.weights.len());
    // Rows are shrunk first, each once.
    let shrunk: Vec<[f64; 3 * CHIP_PX]> = (first..last)
        .map(|y| {
            let row = &rgb8[3 * width * y..3 * width * (y + 1)];
            let mut out = [0.0; 3 * CHIP_PX];
            for (taps, pixel) in columns.iter().zip(out.chunks_exact_mut(3)) {
                let from = row[3 * taps.first..].chunks_exact(3);
                for (weight, rgb) in taps.weights.iter().zip(from) {
                    for (sum, value) in pixel.iter_mut().zip(rgb) {
                        *sum += weight * f64::from(*value);
                    }
                }
            }
            out
        })
        .collect();
    rows.iter()
        .flat_map(|taps| {
            let mut out = [0.0; 3 * CHIP_PX];
            for (weight, row) in taps.weights.iter().zip(&shrunk[taps.first - first..]) {
                for (sum, value) in out.iter_mut().zip(row) {
                    *sum += weight * value;
                }
            }
            out.map(|value| value.round().clamp(0.0, 255.0) as u8)
        })
        .collect()
}

/// Neighbouring pixels of the picture that make a row or column of the chip.
struct Taps {
    first: usize,
    /// Their weights, which sum to 1.
    weights: Vec<f64>,
}

/// The taps of each row or column of a chip that begins at `from_px` and is `side_px` wide, in a
/// picture of `count` pixels. Later ones begin and end no earlier than those before.
fn taps(from_px: f64, side_px: f64, count: usize) -> Vec<Taps> {
    let step_px = side_px / CHIP_PX as f64;
    let reach_px = step_px.max(1.0);
    let inside = |x: f64| x.clamp(0.0, (count - 1) as f64) as usize;
    (0..CHIP_PX)
        .map(|i| {
            let middle_px = from_px + (i as f64 + 0.5) * step_px;
            // Pixel x has its middle at x + 0.5.
            let low = (middle_px - reach_px - 0.5).floor();
            let high = (middle_px + reach_px - 0.5).ceil();
            let (first, last) = (inside(low), inside(high));
            let mut weights = vec![0.0; last - first + 1];
            let mut total = 0.0;
            let mut x = low;
            while x <= high {
                let weight = (1.0 - (x + 0.5 - middle_px).abs() / reach_px).max(0.0);
                weights[inside(x) - first] += weight;
                total += weight;
                x += 1.0;
            }
            for weight in &mut weights {
                *weight /= total;
            }
            Taps { first, weights }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A picture of `rect` whose value is linear over the sensor.
    fn slope(rect: PixelRect) -> Vec<u8> {
        let [width, height] = rect.size_px;
        let [left, top] = rect.offset_px;
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| [left + x, top + y, 7]));
        pixels.flatten().map(|value| value as u8).collect()
    }

    fn at(chip: &Chip, x: usize, y: usize) -> [u8; 3] {
        let i = 3 * (y * CHIP_PX + x);
        [chip[i], chip[i + 1], chip[i + 2]]
    }

    #[test]
    fn a_slope_stays_a_slope_at_any_size() {
        let rect = PixelRect {
            offset_px: [20, 10],
            size_px: [200, 180],
        };
        let picture = slope(rect);
        for side_px in [6.0, 24.0, 31.0, 96.0] {
            let found = chip(&picture, rect, [120.0, 100.0], side_px);
            for (x, y) in [(2, 3), (12, 12), (21, 20)] {
                let place = |i: usize, middle: f64| {
                    middle + ((i as f64 + 0.5) / CHIP_PX as f64 - 0.5) * side_px - 0.5
                };
                let [red, green, blue] = at(&found, x, y).map(f64::from);
                assert!(
                    (red - place(x, 120.0)).abs() <= 1.0,
                    "{side_px} {x} {y}: {red}"
                );
                assert!((green - place(y, 100.0)).abs() <= 1.0, "{side_px}: {green}");
                assert_eq!(blue, 7.0);
            }
        }
    }

    #[test]
    fn its_mean_is_that_of_the_pixels_under_it() {
        let rect = PixelRect {
            offset_px: [0, 0],
            size_px: [96, 96],
        };
        // Stripes of one pixel alias where pixels are left out.
        let picture: Vec<u8> = (0..96 * 96)
            .flat_map(|i| [if i % 2 == 0 { 200 } else { 0 }; 3])
            .collect();
        let found = chip(&picture, rect, [48.0, 48.0], 72.0);
        // Three pixels a step: weights of 1, 2, 3, 2, 1 ninths leave 1/9 of the stripes.
        let apart = found.iter().map(|value| value.abs_diff(100)).max();
        assert!(apart <= Some(12), "{apart:?}");
    }

    #[test]
    fn beyond_the_edge_the_last_pixel_goes_on() {
        let rect = PixelRect {
            offset_px: [100, 100],
            size_px: [40, 30],
        };
        let picture = slope(rect);
        let found = chip(&picture, rect, [100.0, 115.0], 48.0);
        assert_eq!(at(&found, 0, 12)[0], 100);
        assert_eq!(at(&found, 0, 23)[1], 129);
        // Wholly outside, or without pixels: still a chip.
        assert_eq!(
            at(&chip(&picture, rect, [9e3, 9e3], 10.0), 5, 5),
            [139, 129, 7]
        );
        let none = PixelRect {
            size_px: [0, 0],
            ..rect
        };
        assert_eq!(chip(&[], none, [0.0; 2], 10.0).len(), 3 * CHIP_PX * CHIP_PX);
    }
}
