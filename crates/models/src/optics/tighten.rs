//! Tight boxes of what flies, from loose ones drawn by people.
//!
//! Published boxes of video are interpolated between frames and two to five times as long as what they hold. What is
//! inside stands out against what surrounds it: a plane is fitted to the colours around the box, and what differs from it
//! is kept where it also holds its own beside the strongest contrast near it, so that the soft edge of a dark body ends
//! where the body does while a faint rotor further out stays. The box ends where the contrast has fallen to
//! [`TightenParams::level`] of that near the edge, between pixels.

use glam::DVec3;

/// How a loose box is tightened.
///
/// `level` and the two shares of contrast were chosen on 47 of 95 boxes drawn by hand on frames of the training clips of
/// the Halmstad set, and looked at on the other 48 (docs/dataset.md). The rest is judged, on other frames of these clips.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TightenParams {
    /// How far around the loose box the surroundings are looked at, over its longer side; 6 px at least.
    pub margin: f64,
    /// Least contrast over the noise of the surroundings.
    pub noise: f64,
    /// Least contrast [grey levels of 255].
    pub least: f64,
    /// Least contrast over the strongest inside the loose box.
    pub share: f64,
    /// Contrast at which the box ends, over the strongest within 2 px.
    pub level: f64,
    /// A piece apart from the main one counts from this share of its summed contrast on.
    pub piece: f64,
    /// And from this share of its strongest contrast on.
    pub piece_peak: f64,
    /// And within 2 px and this share of the box so far.
    pub gap: f64,
    /// Least strongest contrast over the noise.
    pub sure: f64,
    /// Shortest longer side of a tight box [px].
    pub least_px: f64,
    /// Longest side of a tight box over that of the loose one.
    pub longest: f64,
}

impl Default for TightenParams {
    fn default() -> Self {
        Self {
            margin: 0.3,
            noise: 5.0,
            least: 6.0, // [grey levels]
            share: 0.1,
            level: 0.25,
            piece: 0.05,
            piece_peak: 0.2,
            gap: 0.25,
            sure: 7.0,
            least_px: 1.8, // [px]
            longest: 1.15,
        }
    }
}

/// A tightened box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tight {
    /// x0, y0, x1, y1 [px].
    pub box_px: [f64; 4],
    /// Area of what stands out [px^2].
    pub area_px2: f64,
    /// Strongest contrast over the noise of the surroundings.
    pub contrast: f64,
}

/// Why a box cannot be tightened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotTight {
    /// There is too little around it to tell it from.
    NoSurroundings,
    /// Nothing in it stands out.
    Faint,
    /// What stands out goes on beyond what is looked at: a contrail, a mast, a tree.
    GoesOn,
    /// What stands out is smaller than `least_px` or larger than the loose box.
    Size,
}

/// Half the side of the square in which the strongest contrast is sought [px].
const NEAR_PX: usize = 2; // [px]
/// Least number of pixels around a box.
const LEAST_AROUND: usize = 30;
/// Turns of fitting the plane, each without what the last did not explain.
const FITS: usize = 4;
/// What differs by more than so many medians is left out of the fit.
const OUTLIER: f64 = 2.5;
/// Noise of a flawless picture [grey levels]: that of its rounding and compression.
const LEAST_NOISE: f64 = 0.6; // [grey levels]

/// The tight box of what a loose one, x0, y0, x1, y1 [px], holds in an 8-bit RGB picture of `size_px`; `others` are
/// loose boxes of other things, which are no surroundings.
pub fn tighten(
    rgb8: &[u8],
    size_px: [u32; 2],
    loose_px: [f64; 4],
    others: &[[f64; 4]],
    params: &TightenParams,
) -> Result<Tight, NotTight> {
    let view = View::around(rgb8, size_px, loose_px, others, params)?;
    let (contrast, noise) = view.contrast()?;
    view.outline(&contrast, noise, params)
}

/// The pixels in and around a loose box.
struct View {
    /// Upper left corner in the picture, and its size [px].
    corner: [usize; 2],
    size: [usize; 2],
    /// Whether it ends where the picture does: left, top, right, bottom.
    at_edge: [bool; 4],
    pixels: Vec<DVec3>,
    /// What is inside the loose box, and what is around it and nothing else's.
    inside: Vec<bool>,
    around: Vec<bool>,
    /// Longer side of the loose box, and both [px].
    sides_px: [f64; 2],
}

impl View {
    fn around(
        rgb8: &[u8],
        [width, height]: [u32; 2],
        loose_px: [f64; 4],
        others: &[[f64; 4]],
        params: &TightenParams,
    ) -> Result<Self, NotTight> {
        let [x0, y0, x1, y1] = loose_px;
        let sides_px = [x1 - x0, y1 - y0];
        let margin_px = (params.margin * sides_px[0].max(sides_px[1])).max(6.0); // [px]
        let clamp = |x: f64, most: u32| x.clamp(0.0, f64::from(most)) as usize;
        let [left, top] = [
            clamp((x0 - margin_px).floor(), width),
            clamp((y0 - margin_px).floor(), height),
        ];
        let [right, bottom] = [
            clamp((x1 + margin_px).ceil(), width),
            clamp((y1 + margin_px).ceil(), height),
        ];
        let size = [right.saturating_sub(left), bottom.saturating_sub(top)];
        if size[0] < 8 || size[1] < 8 || rgb8.len() < 3 * (width * height) as usize {
            return Err(NotTight::NoSurroundings);
        }
        let within = |[x0, y0, x1, y1]: [f64; 4], x: f64, y: f64, more_px: f64| {
            x > x0 - more_px && x < x1 + more_px && y > y0 - more_px && y < y1 + more_px
        };
        let (mut pixels, mut inside, mut around) = (Vec::new(), Vec::new(), Vec::new());
        for row in top..bottom {
            for column in left..right {
                let at = 3 * (row * width as usize + column);
                let rgb = [rgb8[at], rgb8[at + 1], rgb8[at + 2]].map(f64::from);
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                let own = within(loose_px, x, y, 0.0);
                pixels.push(DVec3::from(rgb));
                inside.push(own);
                around.push(!own && !others.iter().any(|other| within(*other, x, y, 2.0)));
            }
        }
        Ok(Self {
            corner: [left, top],
            size,
            at_edge: [
                left == 0,
                top == 0,
                right == width as usize,
                bottom == height as usize,
            ],
            pixels,
            inside,
            around,
            sides_px,
        })
    }

    /// Difference of every pixel from the plane through the colours around the box [grey levels, rms of the three], and the
    /// noise of what the plane explains.
    fn contrast(&self) -> Result<(Vec<f64>, f64), NotTight> {
        let mut kept = self.around.clone();
        let mut contrast = Vec::new();
        for _ in 0..FITS {
            if kept.iter().filter(|kept| **kept).count() < LEAST_AROUND {
                return Err(NotTight::NoSurroundings);
            }
            let plane = self.plane(&kept).ok_or(NotTight::NoSurroundings)?;
            contrast = (0..self.pixels.len())
                .map(|i| {
                    let [u, v] = self.place(i);
                    let off = self.pixels[i] - (plane[0] + u * plane[1] + v * plane[2]);
                    (off.length_squared() / 3.0).sqrt()
                })
                .collect();
            let mut off: Vec<f64> = (contrast.iter().zip(&self.around))
                .filter_map(|(off, around)| around.then_some(*off))
                .collect();
            off.sort_by(f64::total_cmp);
            let median = 1.4826 * off[off.len() / 2]; // 1.4826: deviation over the median, of Gaussian noise
            for (kept, (off, around)) in kept.iter_mut().zip(contrast.iter().zip(&self.around)) {
                *kept = *around && *off < OUTLIER * median.max(LEAST_NOISE);
            }
        }
        let (mut sum, mut count) = (0.0, 0usize);
        for (off, _) in contrast.iter().zip(&kept).filter(|(_, kept)| **kept) {
            sum += off * off;
            count += 1;
        }
        if count < LEAST_AROUND {
            return Err(NotTight::NoSurroundings);
        }
        Ok((contrast, (sum / count as f64).sqrt().max(LEAST_NOISE)))
    }

    /// Place of a pixel in the view, -1 to 1 each way.
    fn place(&self, index: usize) -> [f64; 2] {
        let [width, height] = self.size;
        let over = |k: usize, count: usize| 2.0 * (k as f64 + 0.5) / count as f64 - 1.0;
        [over(index % width, width), over(index / width, height)]
    }

    /// The plane a + u b + v c of least squares through what is kept; `None` where it has no single answer.
    fn plane(&self, kept: &[bool]) -> Option<[DVec3; 3]> {
        let mut normal = glam::DMat3::ZERO;
        let mut right = [DVec3::ZERO; 3];
        for (i, pixel) in self.pixels.iter().enumerate().filter(|(i, _)| kept[*i]) {
            let [u, v] = self.place(i);
            let row = DVec3::new(1.0, u, v);
            normal += glam::DMat3::from_cols(row, row * u, row * v);
            for (sum, weight) in right.iter_mut().zip(row.to_array()) {
                *sum += weight * *pixel;
            }
        }
        if normal.determinant().abs() < 1e-6 {
            return None;
        }
        let inverse = normal.inverse();
        let answer = |k: usize| (0..3).map(|i| inverse.col(i)[k] * right[i]).sum();
        Some([answer(0), answer(1), answer(2)])
    }

    fn outline(
        &self,
        contrast: &[f64],
        noise: f64,
        params: &TightenParams,
    ) -> Result<Tight, NotTight> {
        let inner = (contrast.iter().zip(&self.inside)).filter(|(_, inside)| **inside);
        let strongest = inner.map(|(off, _)| *off).fold(0.0, f64::max);
        let floor = (params.noise * noise)
            .max(params.least)
            .max(params.share * strongest);
        let near = self.strongest_near(contrast);
        let stands_out: Vec<bool> = (contrast.iter().zip(&near))
            .map(|(off, near)| *off > floor && *off >= params.level * near)
            .collect();
        let mut pieces = self.pieces(&stands_out, contrast);
        if pieces.is_empty() {
            return Err(NotTight::Faint);
        }
        pieces.retain(|piece| 2 * piece.inside > piece.pixels);
        let main = (pieces.iter().enumerate()).max_by(|a, b| a.1.sum.total_cmp(&b.1.sum));
        let Some((main, _)) = main else {
            return Err(NotTight::Faint);
        };
        let mut whole = pieces.swap_remove(main);
        let (least_sum, least_peak) = (params.piece * whole.sum, params.piece_peak * whole.peak);
        pieces.retain(|piece| piece.sum > least_sum && piece.peak > least_peak);
        while let Some(next) = pieces.iter().position(|piece| {
            let longer = whole.side(0).max(whole.side(1));
            piece.gap(&whole) as f64 <= 2.0 + params.gap * longer as f64
        }) {
            whole.join(&pieces.swap_remove(next));
        }
        let [left, top, right, bottom] = whole.ends;
        let touches = [
            left == 0,
            top == 0,
            right == self.size[0],
            bottom == self.size[1],
        ];
        if (touches.iter().zip(self.at_edge)).any(|(touches, at_edge)| *touches && !at_edge) {
            return Err(NotTight::GoesOn);
        }
        if whole.peak < params.sure * noise {
            return Err(NotTight::Faint);
        }
        let box_px = self.ends_between_pixels(contrast, &whole, floor, params.level);
        let sides_px = [box_px[2] - box_px[0], box_px[3] - box_px[1]];
        let too_long = (sides_px.iter().zip(self.sides_px))
            .any(|(side, loose)| *side > params.longest * loose);
        if too_long || sides_px[0].max(sides_px[1]) < params.least_px {
            return Err(NotTight::Size);
        }
        Ok(Tight {
            box_px,
            area_px2: whole.pixels as f64,
            contrast: whole.peak / noise,
        })
    }

    /// The strongest contrast within [`NEAR_PX`] of every pixel.
    fn strongest_near(&self, contrast: &[f64]) -> Vec<f64> {
        let [width, height] = self.size;
        let reach =
            |k: usize, count: usize| k.saturating_sub(NEAR_PX)..(k + NEAR_PX + 1).min(count);
        (0..contrast.len())
            .map(|i| {
                let rows = reach(i / width, height);
                rows.flat_map(|y| reach(i % width, width).map(move |x| (x, y)))
                    .map(|(x, y)| contrast[y * width + x])
                    .fold(0.0, f64::max)
            })
            .collect()
    }

    /// What of `stands_out` hangs together, diagonally too.
    fn pieces(&self, stands_out: &[bool], contrast: &[f64]) -> Vec<Piece> {
        let [width, height] = self.size;
        let mut left = stands_out.to_vec();
        let mut pieces = Vec::new();
        for start in 0..left.len() {
            if !left[start] {
                continue;
            }
            left[start] = false;
            let mut piece = Piece::default();
            let mut waiting = vec![start];
            while let Some(i) = waiting.pop() {
                let (x, y) = (i % width, i / width);
                piece.add(x, y, contrast[i], self.inside[i]);
                for y in y.saturating_sub(1)..(y + 2).min(height) {
                    for x in x.saturating_sub(1)..(x + 2).min(width) {
                        if std::mem::take(&mut left[y * width + x]) {
                            waiting.push(y * width + x);
                        }
                    }
                }
            }
            pieces.push(piece);
        }
        pieces
    }

    /// The box of a piece, each side moved out by at most half a pixel to where the contrast falls to its level.
    fn ends_between_pixels(
        &self,
        contrast: &[f64],
        piece: &Piece,
        floor: f64,
        level: f64,
    ) -> [f64; 4] {
        let [width, height] = self.size;
        let [left, top, right, bottom] = piece.ends;
        let column = |x: usize| {
            (top..bottom)
                .map(|y| contrast[y * width + x])
                .fold(0.0, f64::max)
        };
        let row = |y: usize| {
            (left..right)
                .map(|x| contrast[y * width + x])
                .fold(0.0, f64::max)
        };
        let columns: Vec<f64> = (0..width).map(column).collect();
        let rows: Vec<f64> = (0..height).map(row).collect();
        let back = |lines: &[f64]| lines.iter().rev().copied().collect::<Vec<_>>();
        let out = |lines: &[f64], first: usize| out_px(lines, first, floor, level);
        let [x, y] = self.corner.map(|corner| corner as f64);
        [
            x + left as f64 - out(&columns, left),
            y + top as f64 - out(&rows, top),
            x + right as f64 + out(&back(&columns), width - right),
            y + bottom as f64 + out(&back(&rows), height - bottom),
        ]
    }
}

/// How far before line `first` a profile falls to `level` of what is strongest in its first three lines, 0 to 0.5 px.
fn out_px(lines: &[f64], first: usize, floor: f64, level: f64) -> f64 {
    let Some(before) = first.checked_sub(1).map(|k| lines[k]) else {
        return 0.0; // the picture's edge
    };
    let own = lines[first];
    let strongest = lines[first..].iter().take(3).copied().fold(0.0, f64::max);
    let end = (level * strongest).max(floor);
    if own <= end || before >= own {
        0.0
    } else if before >= end {
        0.5 // [px]
    } else {
        ((own - end) / (own - before) - 0.5).min(0.5)
    }
}

/// Pixels that hang together.
#[derive(Clone, Debug)]
struct Piece {
    /// First column and row, and those after the last.
    ends: [usize; 4],
    pixels: usize,
    inside: usize,
    /// Sum and maximum of its contrast [grey levels].
    sum: f64,
    peak: f64,
}

impl Default for Piece {
    fn default() -> Self {
        Self {
            ends: [usize::MAX, usize::MAX, 0, 0],
            pixels: 0,
            inside: 0,
            sum: 0.0,
            peak: 0.0,
        }
    }
}

impl Piece {
    fn add(&mut self, x: usize, y: usize, contrast: f64, inside: bool) {
        self.join(&Self {
            ends: [x, y, x + 1, y + 1],
            pixels: 1,
            inside: usize::from(inside),
            sum: contrast,
            peak: contrast,
        });
    }

    fn join(&mut self, other: &Self) {
        for k in 0..2 {
            self.ends[k] = self.ends[k].min(other.ends[k]);
            self.ends[k + 2] = self.ends[k + 2].max(other.ends[k + 2]);
        }
        self.pixels += other.pixels;
        self.inside += other.inside;
        self.sum += other.sum;
        self.peak = self.peak.max(other.peak);
    }

    fn side(&self, axis: usize) -> usize {
        self.ends[axis + 2] - self.ends[axis]
    }

    /// Pixels between the boxes of two pieces, along the axis on which they are further apart.
    fn gap(&self, other: &Self) -> usize {
        (0..2)
            .map(|axis| {
                let after = self.ends[axis].saturating_sub(other.ends[axis + 2]);
                let before = other.ends[axis].saturating_sub(self.ends[axis + 2]);
                after.max(before)
            })
            .fold(0, usize::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE_PX: [u32; 2] = [96, 80];

    /// A sloping sky with grain, and rectangles of a grey level, their edges shared out among the pixels.
    fn picture(things: &[([f64; 4], f64)]) -> Vec<u8> {
        let [width, height] = SIZE_PX;
        let mut grain = 1u32;
        let mut out = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let (x, y) = (f64::from(x), f64::from(y));
                let mut grey = 120.0 + 0.3 * x + 0.5 * y;
                for ([x0, y0, x1, y1], level) in things {
                    let covered = |low: f64, high: f64, at: f64| {
                        (high.min(at + 1.0) - low.max(at)).clamp(0.0, 1.0)
                    };
                    let share = covered(*x0, *x1, x) * covered(*y0, *y1, y);
                    grey += share * (level - grey);
                }
                for tint in [0.9, 1.0, 1.1] {
                    grain = grain.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let noise = f64::from(grain >> 24) / 64.0 - 2.0; // -2 to 2 grey levels
                    out.push((grey * tint + noise).clamp(0.0, 255.0) as u8);
                }
            }
        }
        out
    }

    fn tight(things: &[([f64; 4], f64)], loose_px: [f64; 4]) -> Result<Tight, NotTight> {
        let params = TightenParams::default();
        tighten(&picture(things), SIZE_PX, loose_px, &[], &params)
    }

    #[test]
    fn a_faint_arm_belongs_to_the_body_and_a_speck_far_off_does_not() {
        let body = ([40.0, 36.0, 50.0, 42.0], 20.0);
        let arm = ([50.0, 37.0, 58.0, 39.0], 80.0);
        let speck = ([40.0, 60.0, 41.0, 61.0], 100.0);
        let found = tight(&[body, arm, speck], [30.0, 28.0, 66.0, 66.0]).unwrap();
        for (found, wanted) in found.box_px.iter().zip([40.0, 36.0, 58.0, 42.0]) {
            assert!((found - wanted).abs() <= 0.5, "{found} {wanted}");
        }
        assert!(found.contrast > 20.0);
    }

    #[test]
    fn what_goes_on_or_does_not_stand_out_is_refused() {
        let trail = ([10.0, 38.0, 90.0, 41.0], 250.0);
        let loose_px = [30.0, 25.0, 60.0, 55.0];
        assert_eq!(tight(&[trail], loose_px), Err(NotTight::GoesOn));
        assert_eq!(tight(&[], loose_px), Err(NotTight::Faint));
        assert_eq!(
            tight(&[], [200.0, 25.0, 230.0, 55.0]),
            Err(NotTight::NoSurroundings)
        );
        let speck = ([44.0, 40.0, 45.0, 41.0], 60.0);
        assert_eq!(tight(&[speck], loose_px), Err(NotTight::Size));
    }

    #[test]
    fn a_thing_at_the_pictures_edge_ends_there() {
        let found = tight(&[([0.0, 30.0, 9.0, 36.0], 30.0)], [-4.0, 24.0, 20.0, 44.0]).unwrap();
        assert!(found.box_px[0].abs() < 1e-9 && (found.box_px[2] - 9.0).abs() <= 0.5);
    }

    proptest! {
        #[test]
        fn a_rectangle_is_found_within_a_pixel(
            x in 24.0..40.0f64, y in 24.0..36.0f64, w in 3.0..24.0f64, h in 3.0..18.0f64, dark: bool,
        ) {
            let level = if dark { 20.0 } else { 250.0 };
            let whole = [x, y, x + w, y + h];
            let loose_px = [x - 6.0, y - 5.0, x + w + 7.0, y + h + 6.0];
            let found = tight(&[(whole, level)], loose_px).unwrap();
            for (found, wanted) in found.box_px.iter().zip(whole) {
                // A pixel of which a quarter is covered counts whole.
                prop_assert!((found - wanted).abs() <= 0.85, "{:?} {:?}", found, wanted);
            }
        }
    }
}
