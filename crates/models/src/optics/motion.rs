//! Motion blur and rolling shutter: where the image moves while its rows are exposed.
//!
//! A frame is rendered for one instant, the middle of the exposure of its middle row. A row exposed
//! `delay` later, for a time T, is that picture shifted by v (delay - T/2 .. delay + T/2), v being
//! the motion of the image. What stands still moves as the line of sight turns; a UAV's box moves
//! as the UAV does before the camera.
//!
//! Assumptions: the motion is uniform over the exposure and over the field (no roll about the line
//! of sight); in the box of a UAV, grown by the motion's reach, its surroundings move with it;
//! truth is that of the rendered instant. Shifts between pixels are Catmull-Rom interpolations,
//! which keep centroid and variance; a long smear is summed of whole pixels, and cut at 64 px from
//! its row.

use glam::DVec2;

/// Smears shorter than this are left out [px]: their variance is below 0.006 px^2.
const MIN_SMEAR_PX: f64 = 0.25;
/// Weights below this are left out.
const MIN_WEIGHT: f32 = 1e-4;
/// Farthest that a row's picture may come from [px]; faster motion is cut there.
const MAX_REACH_PX: f64 = 64.0;
/// From this length on a smear is summed of whole pixels [px]: 1/12 px^2 is nothing beside its variance.
const LONG_SMEAR_PX: f64 = 16.0;

/// Motion of the image.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageMotion {
    /// Motion of what stands still [px/s], right and down.
    pub still_pxps: DVec2,
    /// Boxes [px, whole sensor] that move in their own way, and that motion [px/s]; the first that
    /// holds a pixel counts.
    pub boxes: Vec<([f64; 4], DVec2)>,
}

/// When the rows of a frame are exposed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Shutter {
    /// All at once.
    #[default]
    Global,
    /// One after the other, so long apart [s].
    Rolling(f64),
}

/// One weight of a row's picture, of the pixel that lies (dx, dy) away.
type Tap = (isize, isize, f32);

/// The weights of an image that does not move.
const STILL: [Tap; 1] = [(0, 0, 1.0)];

/// How a row is put together that is exposed for some time, some time after the rendered instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Smear {
    /// The weights of what stands still.
    still: Vec<Tap>,
    /// Boxes [px, whole sensor], grown by their motion's reach, and their weights.
    boxes: Vec<([f64; 4], Vec<Tap>)>,
}

/// How one row is put together from the rendered one.
#[derive(Clone, Debug, PartialEq)]
pub struct RowMotion<'a> {
    /// Columns [px, of the frame] and their weights; later parts overwrite earlier ones.
    parts: Vec<(std::ops::Range<usize>, &'a [Tap])>,
}

/// Catmull-Rom weights of the pixels -1, 0, 1, 2 for a point `f` after pixel 0.
fn catmull_rom(f: f64) -> [f64; 4] {
    [
        ((2.0 - f) * f - 1.0) * f / 2.0,
        ((3.0 * f - 5.0) * f * f + 2.0) / 2.0,
        ((4.0 - 3.0 * f) * f + 1.0) * f / 2.0,
        (f - 1.0) * f * f / 2.0,
    ]
}

/// The weights of an image that moves by `shift_px` and is smeared along `smear_px`.
fn taps(shift_px: DVec2, smear_px: DVec2) -> Vec<Tap> {
    let shift_px = shift_px.clamp_length_max(MAX_REACH_PX);
    let smear_px = smear_px.clamp_length_max(2.0 * (MAX_REACH_PX - shift_px.length()));
    let steps = (2.0 * smear_px.length()).ceil().max(1.0);
    let between = smear_px.length() < LONG_SMEAR_PX;
    let mut found: Vec<(isize, isize, f64)> = Vec::new();
    let mut add = |dx: isize, dy: isize, weight: f64| {
        // The newest are the likeliest to come again.
        match found
            .iter_mut()
            .rev()
            .find(|tap| (tap.0, tap.1) == (dx, dy))
        {
            Some(tap) => tap.2 += weight / steps,
            None => found.push((dx, dy, weight / steps)),
        }
    };
    for step in 0..steps as u32 {
        // Where the light of the pixel came from: against the motion.
        let along = (f64::from(step) + 0.5) / steps - 0.5;
        let at = -shift_px - along * smear_px;
        if !between {
            add(at.x.round() as isize, at.y.round() as isize, 1.0);
            continue;
        }
        let (cell, rest) = (at.floor(), at - at.floor());
        let (wx, wy) = (catmull_rom(rest.x), catmull_rom(rest.y));
        for (j, wy) in (-1..).zip(wy) {
            for (i, wx) in (-1..).zip(wx) {
                add(cell.x as isize + i, cell.y as isize + j, wx * wy);
            }
        }
    }
    found.sort_by_key(|tap| (tap.1, tap.0));
    let found = found.into_iter().map(|(dx, dy, w)| (dx, dy, w as f32));
    found.filter(|tap| tap.2.abs() > MIN_WEIGHT).collect()
}

impl ImageMotion {
    /// How the rows are put together that are exposed for `exposure_s`, `delay_s` after the
    /// rendered instant; none where nothing moves by enough.
    pub fn smear(&self, exposure_s: f64, delay_s: f64) -> Option<Smear> {
        let of = |pxps: DVec2| {
            let (smear_px, shift_px) = (pxps * exposure_s, pxps * delay_s);
            if smear_px.length() >= MIN_SMEAR_PX || shift_px.length() >= 0.5 * MIN_SMEAR_PX {
                taps(shift_px, smear_px)
            } else {
                STILL.to_vec()
            }
        };
        let boxes = self.boxes.iter().map(|([x0, y0, x1, y1], pxps)| {
            let reach = pxps.abs() * (delay_s.abs() + 0.5 * exposure_s);
            let reach = reach.min(DVec2::splat(MAX_REACH_PX)) + 2.0;
            let grown = [x0 - reach.x, y0 - reach.y, x1 + reach.x, y1 + reach.y];
            (grown, of(*pxps))
        });
        let smear = Smear {
            still: of(self.still_pxps),
            boxes: boxes.collect(),
        };
        let moves = smear.still != STILL || smear.boxes.iter().any(|(_, taps)| *taps != STILL);
        moves.then_some(smear)
    }
}

impl Smear {
    /// How row `row` of a frame, `width` pixels of the whole sensor from `origin_px` on, is put
    /// together; none where nothing in it moves by enough.
    pub fn row(&self, row: usize, width: usize, origin_px: [u32; 2]) -> Option<RowMotion<'_>> {
        let y = f64::from(origin_px[1]) + row as f64 + 0.5;
        let left = f64::from(origin_px[0]);
        let here = |(box_px, _): &&([f64; 4], Vec<Tap>)| box_px[1] < y && y < box_px[3];
        let boxes = self.boxes.iter().filter(here);
        if self.still == STILL && boxes.clone().all(|(_, taps)| *taps == STILL) {
            return None;
        }
        let mut parts = vec![(0..width, &self.still[..])];
        for (box_px, taps) in boxes.rev() {
            let column = |x: f64| (x - left).clamp(0.0, width as f64) as usize;
            parts.push((column(box_px[0].floor())..column(box_px[2].ceil()), taps));
        }
        Some(RowMotion { parts })
    }
}

impl RowMotion<'_> {
    /// Puts row `y` of `height` together, RGBA into `out`; `source` gives the rendered rows. Beyond
    /// its border the frame goes on as it ends.
    pub fn gather(
        &self,
        y: usize,
        height: usize,
        mut source: impl FnMut(usize, &mut Vec<f32>),
        out: &mut [f32],
    ) {
        let width = out.len() / 4;
        let mut row = Vec::new();
        for (columns, taps) in &self.parts {
            let part = &mut out[4 * columns.start..4 * columns.end.max(columns.start)];
            part.fill(0.0);
            let mut last = None;
            for (dx, dy, weight) in *taps {
                if last != Some(*dy) {
                    source(y.saturating_add_signed(*dy).min(height - 1), &mut row);
                    last = Some(*dy);
                }
                // Columns whose source lies inside; the others take the border's pixel.
                let first = columns.start.max((-dx).max(0) as usize).min(columns.end);
                let end = columns.end.min(width.saturating_add_signed(-dx)).max(first);
                let inside = &mut part[4 * (first - columns.start)..4 * (end - columns.start)];
                let from = 4 * first.saturating_add_signed(*dx);
                let from = &row[from.min(row.len())..];
                for (sum, value) in inside.iter_mut().zip(from) {
                    *sum += weight * value;
                }
                let mut border = |x: usize, from: usize| {
                    let sums = &mut part[4 * (x - columns.start)..];
                    for (sum, value) in sums.iter_mut().zip(&row[4 * from..4 * from + 4]) {
                        *sum += weight * value;
                    }
                };
                (columns.start..first).for_each(|x| border(x, 0));
                (end..columns.end).for_each(|x| border(x, width - 1));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 40;
    const HEIGHT: usize = 30;

    /// The picture of a point of light at (20, 15) after a motion: the sum, and its first and
    /// central second moments over x, y and xy.
    fn moments(motion: &ImageMotion, exposure_s: f64, delay_s: f64) -> (f64, DVec2, [f64; 3]) {
        let source = |y: usize, row: &mut Vec<f32>| {
            row.clear();
            row.extend((0..4 * WIDTH).map(|i| f32::from(u8::from(y == 15 && i / 4 == 20))));
        };
        let (mut sum, mut first, mut second) = (0.0, DVec2::ZERO, [0.0; 3]);
        for y in 0..HEIGHT {
            let mut row = vec![0.0f32; 4 * WIDTH];
            let smear = motion.smear(exposure_s, delay_s);
            match smear.as_ref().and_then(|smear| smear.row(y, WIDTH, [0, 0])) {
                Some(moved) => moved.gather(y, HEIGHT, source, &mut row),
                None => source(y, &mut row),
            }
            for (x, light) in row.iter().step_by(4).enumerate() {
                let (light, at) = (f64::from(*light), DVec2::new(x as f64, y as f64));
                let at = at - DVec2::new(20.0, 15.0);
                sum += light;
                first += light * at;
                let products = [at.x * at.x, at.y * at.y, at.x * at.y];
                (0..3).for_each(|k| second[k] += light * products[k]);
            }
        }
        let first = first / sum;
        let means = [first.x * first.x, first.y * first.y, first.x * first.y];
        (sum, first, [0, 1, 2].map(|k| second[k] / sum - means[k]))
    }

    #[test]
    fn a_smear_keeps_light_and_centroid_and_has_the_variance_of_its_length() {
        for smear_px in [
            DVec2::new(0.5, 0.0),
            DVec2::new(0.9, 0.7),
            DVec2::new(0.0, 3.0),
            DVec2::new(-6.0, 3.5),
            DVec2::new(17.5, -9.3),
        ] {
            let motion = ImageMotion {
                still_pxps: smear_px / 2e-3,
                boxes: Vec::new(),
            };
            let (sum, centroid, second) = moments(&motion, 2e-3, 0.0);
            assert!((sum - 1.0).abs() < 1e-3, "{sum}");
            assert!(centroid.length() < 2e-3, "{centroid}");
            // A uniform motion along L: L L^T / 12, less what the steps leave out, and what whole
            // pixels add to a long one.
            let most = if smear_px.length() < LONG_SMEAR_PX {
                [0.022, 0.01]
            } else {
                [0.1, 0.02]
            };
            let exact = [
                smear_px.x * smear_px.x,
                smear_px.y * smear_px.y,
                smear_px.x * smear_px.y,
            ];
            for (found, exact) in second.iter().zip(exact.map(|l| l / 12.0)) {
                assert!(
                    (found - exact).abs() < most[0] + most[1] * exact.abs(),
                    "{second:?} {exact}"
                );
            }
        }
    }

    #[test]
    fn a_late_row_shows_what_has_moved_on() {
        let motion = ImageMotion {
            still_pxps: DVec2::new(700.0, -300.0),
            boxes: Vec::new(),
        };
        let (_, centroid, _) = moments(&motion, 1e-6, 4e-3);
        assert!(
            (centroid - DVec2::new(2.8, -1.2)).length() < 1e-3,
            "{centroid}"
        );
    }

    #[test]
    fn a_box_moves_in_its_own_way() {
        // The line of sight turns, the target in its box stands still before the camera.
        let motion = ImageMotion {
            still_pxps: DVec2::new(2000.0, 0.0),
            boxes: vec![([16.0, 11.0, 25.0, 20.0], DVec2::ZERO)],
        };
        let (sum, centroid, second) = moments(&motion, 2e-3, 0.0);
        assert!(
            (sum - 1.0).abs() < 1e-6 && centroid.length() < 1e-6,
            "{centroid}"
        );
        assert!(second.iter().all(|s| s.abs() < 1e-6), "{second:?}");
        // Nothing that moves by too little is worth a thought.
        let slow = ImageMotion {
            still_pxps: DVec2::new(100.0, 0.0),
            boxes: Vec::new(),
        };
        assert_eq!(slow.smear(2e-3, 0.0), None);
    }

    #[test]
    fn however_fast_it_moves_a_row_is_the_sum_of_few() {
        // A bird that passes a metre before the lens, in a camera that slews: thousands of pixels.
        for pxps in [
            DVec2::new(4e6, -1e6),
            DVec2::new(-3e3, 9e5),
            DVec2::splat(1e9),
        ] {
            let motion = ImageMotion {
                still_pxps: pxps,
                boxes: vec![([10.0, 10.0, 12.0, 12.0], -pxps)],
            };
            for delay_s in [0.0, 4e-3, -4e-3] {
                let smear = motion.smear(2e-3, delay_s).unwrap();
                for taps in [&smear.still, &smear.boxes[0].1] {
                    assert!(taps.len() <= 3 * MAX_REACH_PX as usize, "{}", taps.len());
                    let sum: f32 = taps.iter().map(|tap| tap.2).sum();
                    assert!((sum - 1.0).abs() < 1e-3, "{sum}");
                    let far = |tap: &Tap| tap.0.abs().max(tap.1.abs()) as f64;
                    assert!(taps.iter().all(|tap| far(tap) <= MAX_REACH_PX + 2.0));
                }
            }
        }
    }
}
