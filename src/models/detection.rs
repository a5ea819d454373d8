//! What a detector is given and what it says, and the detector that is made of truth and set errors.

use crate::models::camera::PixelRect;
use crate::models::rng::Stream;

/// One detection in full-sensor pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// x0, y0, x1, y1 [px].
    pub box_px: [f64; 4],
    /// Middle of the body [px]: the box's, unless the detector says better.
    pub aim_px: [f64; 2],
    /// Confidence, 0 to 1.
    pub score: f64,
    /// Index of its most likely class among those of the detector.
    pub label: u32,
}

impl Detection {
    /// A detection whose body has its middle in the box's.
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

    /// Centre of the box [px].
    pub fn centre_px(&self) -> [f64; 2] {
        let [x0, y0, x1, y1] = self.box_px;
        [0.5 * (x0 + x1), 0.5 * (y0 + y1)]
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
    /// Whether it is no UAV.
    pub distractor: bool,
}

/// Smallest side a UAV's box may have to be detected at all [px]: below a pixel there is no
/// image to find it in.
const MIN_SIDE_PX: f64 = 1.0;
/// Mean and standard deviation of the score of a UAV, and of a distractor taken for one; both are
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
mod tests {
    use super::*;

    const SENSOR: [u32; 2] = [640, 480];

    fn run(errors: &TruthErrors, frames: usize, size_px: [u32; 2]) -> Vec<Detection> {
        (0..frames as u64)
            .flat_map(|key| frame(&[UAV], errors, size_px, key))
            .collect()
    }

    fn frame(
        seen: &[Candidate],
        errors: &TruthErrors,
        size_px: [u32; 2],
        key: u64,
    ) -> Vec<Detection> {
        let mut out = Vec::new();
        let seen = seen.iter().copied();
        detect_truth(seen, errors, [0, 0], size_px, SENSOR, key, &mut out);
        out
    }

    const UAV: Candidate = Candidate {
        index: 0,
        box_px: [100.0, 100.0, 110.0, 108.0],
        distractor: false,
    };
    const BIRD: Candidate = Candidate {
        index: 1,
        box_px: [300.0, 100.0, 310.0, 108.0],
        distractor: true,
    };

    #[derive(serde::Deserialize)]
    struct Golden {
        stride: u32,
        min_side_px: u32,
        width: u32,
        height: u32,
        rgb: Vec<u8>,
        padded_width: u32,
        padded_height: u32,
        planes: Vec<f32>,
    }

    /// The file that the Python side of the rule is held to as well.
    #[test]
    fn the_golden_picture_is_padded_as_in_training() {
        let text = include_str!("../../tests/data/preprocess.json");
        let golden: Golden = serde_json::from_str(text).unwrap();
        let padding = Padding {
            stride_px: golden.stride,
            min_side_px: golden.min_side_px,
            fixed_px: [None; 2],
        };
        let size_px = [golden.width, golden.height];
        let input_px = padding.input_px(size_px).unwrap();
        assert_eq!(input_px, [golden.padded_width, golden.padded_height]);
        let whole = PixelRect {
            offset_px: [0, 0],
            size_px,
        };
        // What the buffer held before, the batch's earlier pictures, stays.
        let mut out = vec![7.0; 5];
        planes(&golden.rgb, golden.width, whole, input_px, &mut out);
        assert_eq!(out[..5], [7.0; 5]);
        let out = out.split_off(5);
        assert_eq!(out.len(), golden.planes.len());
        for (i, (found, wanted)) in out.iter().zip(&golden.planes).enumerate() {
            assert!((found - wanted).abs() <= 1e-6, "{i}: {found}, not {wanted}");
        }
        // A part of the picture is what the picture holds there.
        let look = PixelRect {
            offset_px: [3, 2],
            size_px: [golden.width - 4, golden.height - 2],
        };
        let mut part = Vec::new();
        planes(&golden.rgb, golden.width, look, input_px, &mut part);
        let [across, down] = input_px.map(|x| x as usize);
        for (i, found) in part.iter().enumerate() {
            let (plane, y, x) = (i / (across * down), i / across % down, i % across);
            let inside = x < look.size_px[0] as usize && y < look.size_px[1] as usize;
            let wanted = if inside {
                out[(plane * down + y + 2) * across + x + 3]
            } else {
                0.0
            };
            assert_eq!(*found, wanted, "{plane} {y} {x}");
        }
    }

    #[test]
    fn inputs_are_multiples_of_the_stride_and_large_enough() {
        let padding = Padding {
            stride_px: 32,
            min_side_px: 100,
            fixed_px: [None, Some(512)],
        };
        assert_eq!(padding.input_px([640, 480]), Some([640, 512]));
        assert_eq!(padding.input_px([641, 512]), Some([672, 512]));
        assert_eq!(padding.input_px([1, 1]), Some([128, 512]));
        assert_eq!(padding.input_px([640, 513]), None);
        assert_eq!(padding.input_px([u32::MAX, 1]), None);
    }

    #[test]
    fn distractors_are_reported_at_their_rate_with_lower_scores() {
        let errors = TruthErrors {
            noise_px: 0.5,
            miss_rate: 0.0,
            distractor_rate: 0.3,
            false_alarms_per_frame: 0.0,
        };
        let n = 20_000;
        let (mut uavs, mut birds) = (Vec::new(), Vec::new());
        for key in 0..n {
            for found in frame(&[UAV, BIRD], &errors, SENSOR, key) {
                if found.centre_px()[0] < 200.0 {
                    uavs.push(found.score);
                } else {
                    birds.push(found.score);
                }
            }
        }
        let rate = birds.len() as f64 / n as f64;
        assert!(
            (rate - 0.3).abs() < 5.0 * (0.21 / n as f64).sqrt(),
            "{rate}"
        );
        assert_eq!(uavs.len() as u64, n);
        let mean = |scores: &[f64]| scores.iter().sum::<f64>() / scores.len() as f64;
        // The cut at 1 takes 0.003 off the UAVs' mean: sigma phi(1.5) - 1.5 sigma Q(1.5).
        assert!((mean(&uavs) - 0.847).abs() < 0.003, "{}", mean(&uavs));
        assert!((mean(&birds) - 0.600).abs() < 0.008, "{}", mean(&birds));
        assert!(uavs.iter().all(|score| (0.0..=1.0).contains(score)));
    }

    #[test]
    fn what_else_is_visible_changes_no_draw() {
        let errors = TruthErrors {
            noise_px: 1.0,
            miss_rate: 0.3,
            distractor_rate: 0.5,
            false_alarms_per_frame: 0.2,
        };
        let hidden = Candidate {
            box_px: [900.0, 100.0, 910.0, 108.0],
            ..BIRD
        };
        for key in 0..500 {
            let alone = frame(&[UAV], &errors, SENSOR, key);
            assert_eq!(frame(&[UAV, hidden], &errors, SENSOR, key), alone);
            let both = frame(&[BIRD, UAV], &errors, SENSOR, key);
            assert!(alone.iter().all(|found| both.contains(found)));
        }
    }

    #[test]
    fn misses_and_noise_have_the_set_rates() {
        let n = 20_000;
        let errors = TruthErrors {
            noise_px: 1.5,
            miss_rate: 0.1,
            distractor_rate: 0.0,
            false_alarms_per_frame: 0.0,
        };
        let seen = run(&errors, n, SENSOR);
        let rate = 1.0 - seen.len() as f64 / n as f64;
        assert!(
            (rate - 0.1).abs() < 5.0 * (0.09 / n as f64).sqrt(),
            "{rate}"
        );
        let variance = seen
            .iter()
            .map(|d| (d.centre_px()[0] - 105.0).powi(2))
            .sum::<f64>()
            / seen.len() as f64;
        assert!((variance.sqrt() - 1.5).abs() < 0.05, "{}", variance.sqrt());
    }

    #[test]
    fn false_alarms_scale_with_the_window() {
        let errors = TruthErrors {
            noise_px: 0.0,
            miss_rate: 1.0,
            distractor_rate: 0.0,
            false_alarms_per_frame: 2.0,
        };
        let n = 4_000;
        let window = run(&errors, n, [320, 240]).len() as f64 / n as f64;
        assert!(
            (window - 0.5).abs() < 5.0 * (0.5 / n as f64).sqrt(),
            "{window}"
        );
    }

    #[test]
    fn what_lies_outside_the_window_is_not_seen() {
        let errors = TruthErrors {
            noise_px: 0.0,
            miss_rate: 0.0,
            distractor_rate: 0.0,
            false_alarms_per_frame: 0.0,
        };
        assert!(run(&errors, 10, [50, 50]).is_empty());
    }
}
