//! A cell of a film: its size, its letters, and where they go.

use super::canvas::Canvas;
use crate::media::labels;

/// Width and height of a cell [px].
pub const CELL_PX: [u32; 2] = [480, 360];
/// Letters of what stands at boxes and dots [px].
pub const SMALL_PX: f32 = 12.0;

/// Where small texts go at boxes of a cell, the most important first.
pub fn labels_of<'a>(
    cell: &Canvas,
    texts: impl Iterator<Item = &'a str>,
    boxes: &[[f64; 4]],
    gap_px: f64,
) -> Vec<Option<[f64; 2]>> {
    let labels_px: Vec<[f64; 2]> = texts.map(|text| cell.words_px(SMALL_PX, text)).collect();
    labels::place(boxes, &labels_px, CELL_PX.map(f64::from), gap_px)
}
