//! Tight boxes of what a UAV shows of itself.

use super::stage::{ANTIALIAS, Rendered};
use crate::models::bodies::raster::Masks;
use crate::systems::capture::{self, ImageScratch, MAGNIFIED_SAMPLES, MAGNIFY, PATCH_PX};

/// A column or row counts if it shows at least this much of the UAV [px]: the tip of a blade does not.
const MIN_COVERAGE_PX: f64 = 0.1;
/// Samples a side of a pixel.
const SIDE: u32 = 8;

/// What is seen of one UAV.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Label {
    /// x0, y0, x1, y1 [px].
    pub box_px: [f64; 4],
    /// Visible area [px^2].
    pub area_px: f64,
    /// Visible area over that of the unoccluded silhouette inside the frame.
    pub visible_fraction: f64,
}

/// The box of a silhouette of which every pixel shows the share `visible(x, y)`; `None` if no
/// column or no row shows enough.
pub fn label(masks: &Masks, visible: impl Fn(u32, u32) -> f64) -> Option<Label> {
    let [left, top] = masks.rect.offset_px;
    let [width, height] = masks.rect.size_px.map(|n| n as usize);
    // Area [px^2] in every column and row, and which of its finer ones hold a sample.
    let mut columns = vec![(0.0, 0u8); width];
    let mut rows = vec![(0.0, 0u8); height];
    let (mut whole, mut seen) = (0.0, 0.0);
    for (i, &mask) in masks.masks.iter().enumerate() {
        if mask == 0 {
            continue;
        }
        let (x, y) = (i % width, i / width);
        let area = f64::from(mask.count_ones()) / f64::from(SIDE * SIDE);
        whole += area;
        let share = visible(left + x as u32, top + y as u32);
        if share <= 0.0 {
            continue;
        }
        seen += area * share;
        let bytes = mask.to_le_bytes();
        columns[x].0 += area * share;
        columns[x].1 |= bytes.iter().fold(0, |all, byte| all | byte);
        rows[y].0 += area * share;
        let used = (0..8).filter(|k| bytes[*k] != 0);
        rows[y].1 |= used.fold(0, |all, k| all | 1 << k);
    }
    let span = |lines: &[(f64, u8)], from: u32| {
        let counts = |line: &&(f64, u8)| line.0 >= MIN_COVERAGE_PX;
        let first = lines.iter().position(|line| counts(&line))?;
        let last = lines.iter().rposition(|line| counts(&line))?;
        let sample = 1.0 / f64::from(SIDE);
        let low = first as f64 + sample * f64::from(lines[first].1.trailing_zeros());
        let high = last as f64 + 1.0 - sample * f64::from(lines[last].1.leading_zeros());
        Some([f64::from(from) + low, f64::from(from) + high])
    };
    let ([x0, x1], [y0, y1]) = (span(&columns, left)?, span(&rows, top)?);
    Some(Label {
        box_px: [x0, y0, x1, y1],
        area_px: seen,
        visible_fraction: (seen / whole).min(1.0),
    })
}

/// The share of every pixel of a UAV's silhouette that is seen in a rendered frame: samples of its
/// identity over those that it would have unoccluded.
///
/// `own` is the silhouette at the renderer's own four samples a pixel.
pub fn visible_share<'a>(
    rendered: &'a Rendered,
    scratch: &'a ImageScratch,
    prop: usize,
    masks: &'a Masks,
    own: &'a Masks,
) -> impl Fn(u32, u32) -> f64 + 'a {
    let digit = rendered.digits[prop];
    let width = rendered.frame.rect.size_px[0];
    let height = rendered.frame.rect.size_px[1];
    let count = move |pixels: &[u8], index: usize, samples: u32| {
        let sum = f64::from(samples) * capture::alpha_at(pixels, index);
        f64::from(capture::digit_of(sum.round() as u32, digit))
    };
    let mut patches = rendered.shot.patches.iter().zip(&scratch.enlarged);
    let patch = patches.find(|((patch, _), _)| patch.uav == prop);
    move |x, y| {
        if let Some(((patch, _), enlarged)) = patch {
            let [left, top] = patch.rect.offset_px;
            if x >= left && y >= top && x < left + PATCH_PX && y < top + PATCH_PX {
                let (x0, y0) = (MAGNIFY * (x - left), MAGNIFY * (y - top));
                let row = |y: u32| (x0..x0 + MAGNIFY).map(move |x| y * MAGNIFY * PATCH_PX + x);
                let samples: f64 = (y0..y0 + MAGNIFY)
                    .flat_map(row)
                    .map(|index| count(enlarged, index as usize, MAGNIFIED_SAMPLES))
                    .sum();
                let area = samples / f64::from(MAGNIFIED_SAMPLES * MAGNIFY * MAGNIFY);
                let whole = f64::from(masks.at(x, y).count_ones()) / f64::from(SIDE * SIDE);
                return (area / whole).min(1.0);
            }
        }
        // Four samples miss thin parts: their neighbours say whether something stands before them.
        let (mut seen, mut whole) = (0.0, 0.0);
        for reach in 0..3 {
            (seen, whole) = (0.0, 0.0);
            for y in y.saturating_sub(reach)..(y + reach + 1).min(height) {
                for x in x.saturating_sub(reach)..(x + reach + 1).min(width) {
                    seen += count(&scratch.pixels, (y * width + x) as usize, ANTIALIAS);
                    whole += f64::from(own.at(x, y).count_ones());
                }
            }
            if whole > 0.0 {
                break;
            }
        }
        if whole > 0.0 {
            (seen / whole).min(1.0)
        } else {
            1.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::optics::camera::PixelRect;

    /// Masks of `size_px` pixels from (10, 20) on, from a test of sub-samples (eighths of a pixel).
    fn masks(size_px: [u32; 2], covered: impl Fn(u32, u32) -> bool) -> Masks {
        let [width, height] = size_px;
        let pixel = |x: u32, y: u32| {
            (0..64)
                .filter(|bit| covered(8 * x + bit % 8, 8 * y + bit / 8))
                .fold(0u64, |mask, bit| mask | 1 << bit)
        };
        Masks {
            rect: PixelRect {
                offset_px: [10, 20],
                size_px,
            },
            masks: (0..width * height)
                .map(|i| pixel(i % width, i / width))
                .collect(),
        }
    }

    #[test]
    fn edges_are_those_of_the_samples() {
        // From 1.25 to 3.5 px across, from 0.5 to 2 px down.
        let body = masks([5, 3], |x, y| (10..28).contains(&x) && (4..16).contains(&y));
        let seen = label(&body, |_, _| 1.0).unwrap();
        assert_eq!(seen.box_px, [11.25, 20.5, 13.5, 22.0]);
        assert!((seen.area_px - 2.25 * 1.5).abs() < 1e-12);
        assert_eq!(seen.visible_fraction, 1.0);
    }

    #[test]
    fn a_blade_a_hair_wide_does_not_stretch_the_box() {
        // A body of 2 px, and to its right a line of an eighth of a pixel with every second sample.
        let thin = |x: u32, y: u32| y == 8 && x.is_multiple_of(2) && (16..40).contains(&x);
        let body = masks([5, 3], |x, y| (x < 16 && y < 16) || thin(x, y));
        let seen = label(&body, |_, _| 1.0).unwrap();
        assert_eq!(seen.box_px, [10.0, 20.0, 12.0, 22.0]);
        // Nothing but the line is nothing.
        assert_eq!(
            label(&masks([5, 3], thin), |_, _| 1.0).map(|s| s.box_px),
            None
        );
    }

    #[test]
    fn what_is_hidden_is_left_out() {
        let body = masks([4, 2], |_, _| true);
        let seen = label(&body, |x, _| if x < 13 { 1.0 } else { 0.02 }).unwrap();
        assert_eq!(seen.box_px, [10.0, 20.0, 13.0, 22.0]);
        assert!((seen.visible_fraction - (6.0 + 2.0 * 0.02) / 8.0).abs() < 1e-12);
        assert_eq!(label(&body, |_, _| 0.0), None);
    }
}
