//! Input and output of a detector, and the truth detector: the truth with set errors.

use crate::maths::rng::Stream;
use crate::optics::camera::PixelRect;

/// A detection this far outside the box of the truth is still on it [px], or this share of the box's longer side.
const BESIDE_PX: f64 = 2.0;
const BESIDE_SHARE: f64 = 0.25;

/// One detection in full-sensor pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// x0, y0, x1, y1 [px].
    pub box_px: [f64; 4],
    /// Middle of the body [px]: the box's, unless the detector gives a better one.
    pub aim_px: [f64; 2],
    /// Confidence, 0 to 1.
    pub score: f64,
    /// Index of its most likely class among those of the detector.
    pub label: u32,
}

impl Detection {
    /// A detection whose body is centred on its box.
    pub fn new(box_px: [f64; 4], score: f64, label: u32) -> Self {
        let mut detection = Self {
            box_px,
            aim_px: [0.0; 2],
            score,
            label,
        };
        detection.aim_px = detection.centre_px();
        detection
    }

    /// Whether its centre lies in a box of the truth or close beside it.
    pub fn lies_on(&self, [x0, y0, x1, y1]: [f64; 4]) -> bool {
        let [x, y] = self.centre_px();
        let beside_px = BESIDE_PX.max(BESIDE_SHARE * (x1 - x0).max(y1 - y0));
        (x0 - beside_px..=x1 + beside_px).contains(&x)
            && (y0 - beside_px..=y1 + beside_px).contains(&y)
    }

    /// Centre of the box [px].
    pub fn centre_px(&self) -> [f64; 2] {
        let [x0, y0, x1, y1] = self.box_px;
        [0.5 * (x0 + x1), 0.5 * (y0 + y1)]
    }

    /// The detection in a picture with this many times as many pixels to a side.
    pub fn enlarged(&self, times: f64) -> Self {
        Self {
            box_px: self.box_px.map(|x| times * x),
            aim_px: self.aim_px.map(|x| times * x),
            ..*self
        }
    }

    /// The detection shifted by the upper left corner of the window it was found in.
    pub fn shifted(&self, offset_px: [u32; 2]) -> Self {
        let [dx, dy] = offset_px.map(f64::from);
        let [x0, y0, x1, y1] = self.box_px;
        let [x, y] = self.aim_px;
        Self {
            box_px: [x0 + dx, y0 + dy, x1 + dx, y1 + dy],
            aim_px: [x + dx, y + dy],
            ..*self
        }
    }
}

/// How a picture becomes a network's input: at native resolution, padded with zeros at the right
/// and at the bottom (`preprocess = native` in training/README.md). Boxes keep their pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Padding {
    /// Width and height of the input are multiples of this [px].
    pub stride_px: u32,
    /// Least width and height of the input [px].
    pub min_side_px: u32,
    /// Width and height, each where the network takes no other [px].
    pub fixed_px: [Option<u32>; 2],
}

impl Padding {
    /// Width and height of the input for a picture of `size_px`; `None` for a picture larger than
    /// the network takes.
    pub fn input_px(&self, size_px: [u32; 2]) -> Option<[u32; 2]> {
        let side = |axis: usize| match self.fixed_px[axis] {
            Some(fixed) => (size_px[axis] <= fixed).then_some(fixed),
            None => size_px[axis]
                .max(self.min_side_px)
                .checked_next_multiple_of(self.stride_px.max(1)),
        };
        Some([side(0)?, side(1)?])
    }
}

/// Appends the red, green and blue plane, 0 to 1, of the part `look` of a picture with rows of
/// `width_px` RGB pixels, padded with zeros to `input_px`. What of `look` the picture does not hold
/// is zero.
pub fn planes(rgb8: &[u8], width_px: u32, look: PixelRect, input_px: [u32; 2], out: &mut Vec<f32>) {
    let [left, top] = look.offset_px.map(|x| x as usize);
    let [width, height] = look.size_px.map(|x| x as usize);
    let [across, down] = input_px.map(|x| x as usize);
    let area = across * down;
    let first = out.len();
    out.resize(first + 3 * area, 0.0);
    let (red, rest) = out[first..].split_at_mut(area);
    let (green, blue) = rest.split_at_mut(area);
    let rows = rgb8.chunks_exact(3 * width_px.max(1) as usize).skip(top);
    for (y, row) in rows.take(height.min(down)).enumerate() {
        let pixels = row.chunks_exact(3).skip(left).take(width.min(across));
        for (x, pixel) in pixels.enumerate() {
            let at = y * across + x;
            red[at] = f32::from(pixel[0]) / 255.0;
            green[at] = f32::from(pixel[1]) / 255.0;
            blue[at] = f32::from(pixel[2]) / 255.0;
        }
    }
}

/// Errors of the truth detector.
///
/// It stands for a network trained with hard negatives: birds and balloons were in its training set,
/// so that it reports few of them, and those with less confidence than a UAV. Frames err
/// independently of each other; the rates are those after the network's own threshold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthErrors {
    /// Standard deviation of the centre per axis [px].
    pub noise_px: f64,
    /// Probability that a visible UAV is missed in a frame.
    pub miss_rate: f64,
    /// Probability that a visible distractor is reported as a UAV in a frame.
    pub distractor_rate: f64,
    /// Mean number of false alarms in a full frame; a window has its share by area.
    pub false_alarms_per_frame: f64,
}

/// What stands in the view of the truth detector with a clear line of sight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Its index in the scenario; the key of its random stream.
    pub index: usize,
    /// Its box [px].
    pub box_px: [f64; 4],
    /// Whether it is a distractor.
    pub distractor: bool,
}

/// Smallest side a UAV's box may have to be detected at all [px]: below a pixel there is no
/// image to find it in.
const MIN_SIDE_PX: f64 = 1.0;
/// Mean and standard deviation of the score of a UAV, and of a distractor mistaken for one; both are
/// cut off at 0 and 1 (assumption: two classes that overlap, as trained detectors show them).
const UAV_SCORE: [f64; 2] = [0.85, 0.10];
const DISTRACTOR_SCORE: [f64; 2] = [0.60, 0.12];

/// Detections of the truth detector in the rectangle `offset_px`, `size_px` of a sensor of
/// `sensor_px`, given all candidates; `key` is the frame's own random number.
pub fn detect_truth(
    candidates: impl Iterator<Item = Candidate>,
    errors: &TruthErrors,
    offset_px: [u32; 2],
    size_px: [u32; 2],
    sensor_px: [u32; 2],
    key: u64,
    out: &mut Vec<Detection>,
) {
    let low = offset_px.map(f64::from);
    let high = [0, 1].map(|i| low[i] + f64::from(size_px[i]));
    for candidate in candidates {
        // A stream for each frame and candidate: whether one is seen, in this frame or an earlier
        // one, does not change another's errors, nor its own later ones.
        let mut rng = Stream::new(key, candidate.index as u64, "truth detector");
        let [x0, y0, x1, y1] = candidate.box_px;
        let (missed, [mean, sigma]) = if candidate.distractor {
            (rng.uniform() >= errors.distractor_rate, DISTRACTOR_SCORE)
        } else {
            (rng.uniform() < errors.miss_rate, UAV_SCORE)
        };
        let (dx, dy) = (
            errors.noise_px * rng.normal(),
            errors.noise_px * rng.normal(),
        );
        let (cx, cy) = (0.5 * (x0 + x1), 0.5 * (y0 + y1));
        let inside = cx >= low[0] && cx < high[0] && cy >= low[1] && cy < high[1];
        if missed || !inside || (x1 - x0).max(y1 - y0) < MIN_SIDE_PX {
            continue;
        }
        out.push(Detection::new(
            [x0 + dx, y0 + dy, x1 + dx, y1 + dy],
            (mean + sigma * rng.normal()).clamp(0.0, 1.0),
            0,
        ));
    }
    let mut rng = Stream::new(key, 0, "false alarms");
    let share = f64::from(size_px[0] * size_px[1]) / f64::from(sensor_px[0] * sensor_px[1]);
    for _ in 0..rng.poisson(errors.false_alarms_per_frame * share) {
        let (x, y) = (rng.range(low[0], high[0]), rng.range(low[1], high[1]));
        let half = rng.range(1.5, 8.0);
        out.push(Detection::new(
            [x - half, y - half, x + half, y + half],
            rng.range(0.5, 0.9),
            0,
        ));
    }
}

#[cfg(test)]
mod tests;
