//! What a detector says, and the detector that is made of truth and set errors.

use crate::models::rng::Stream;

/// One detection in full-sensor pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// x0, y0, x1, y1 [px].
    pub box_px: [f64; 4],
    /// Confidence, 0 to 1.
    pub score: f64,
}

impl Detection {
    /// Centre of the box [px].
    pub fn centre_px(&self) -> [f64; 2] {
        let [x0, y0, x1, y1] = self.box_px;
        [0.5 * (x0 + x1), 0.5 * (y0 + y1)]
    }

    /// The detection shifted by the upper left corner of the window it was found in.
    pub fn shifted(&self, offset_px: [u32; 2]) -> Self {
        let [dx, dy] = offset_px.map(f64::from);
        let [x0, y0, x1, y1] = self.box_px;
        Self {
            box_px: [x0 + dx, y0 + dy, x1 + dx, y1 + dy],
            ..*self
        }
    }
}

/// Errors of the truth detector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthErrors {
    /// Standard deviation of the centre per axis [px].
    pub noise_px: f64,
    /// Probability that a visible UAV is missed in a frame.
    pub miss_rate: f64,
    /// Mean number of false alarms in a full frame; a window has its share by area.
    pub false_alarms_per_frame: f64,
}

/// Smallest side a UAV's box may have to be detected at all [px]: below a pixel there is no
/// image to find it in.
const MIN_SIDE_PX: f64 = 1.0;

/// Detections of the truth detector in the rectangle `offset_px`, `size_px` of a sensor of
/// `sensor_px`, given the boxes of all UAVs whose line of sight is clear.
pub fn detect_truth(
    boxes_px: impl Iterator<Item = [f64; 4]>,
    errors: &TruthErrors,
    offset_px: [u32; 2],
    size_px: [u32; 2],
    sensor_px: [u32; 2],
    rng: &mut Stream,
    out: &mut Vec<Detection>,
) {
    let low = offset_px.map(f64::from);
    let high = [0, 1].map(|i| low[i] + f64::from(size_px[i]));
    for [x0, y0, x1, y1] in boxes_px {
        // Every UAV draws the same numbers whether it is seen or not, so that one UAV's
        // visibility does not change another's errors.
        let missed = rng.uniform() < errors.miss_rate;
        let (dx, dy) = (
            errors.noise_px * rng.normal(),
            errors.noise_px * rng.normal(),
        );
        let (cx, cy) = (0.5 * (x0 + x1), 0.5 * (y0 + y1));
        let inside = cx >= low[0] && cx < high[0] && cy >= low[1] && cy < high[1];
        if missed || !inside || (x1 - x0).max(y1 - y0) < MIN_SIDE_PX {
            continue;
        }
        out.push(Detection {
            box_px: [x0 + dx, y0 + dy, x1 + dx, y1 + dy],
            score: 0.9,
        });
    }
    let share = f64::from(size_px[0] * size_px[1]) / f64::from(sensor_px[0] * sensor_px[1]);
    for _ in 0..rng.poisson(errors.false_alarms_per_frame * share) {
        let (x, y) = (rng.range(low[0], high[0]), rng.range(low[1], high[1]));
        let half = rng.range(1.5, 8.0);
        out.push(Detection {
            box_px: [x - half, y - half, x + half, y + half],
            score: rng.range(0.5, 0.9),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SENSOR: [u32; 2] = [640, 480];

    fn run(errors: &TruthErrors, frames: usize, size_px: [u32; 2]) -> Vec<Detection> {
        let mut rng = Stream::new(3, 0, "detector");
        let mut out = Vec::new();
        for _ in 0..frames {
            let boxes = [[100.0, 100.0, 110.0, 108.0]];
            detect_truth(
                boxes.into_iter(),
                errors,
                [0, 0],
                size_px,
                SENSOR,
                &mut rng,
                &mut out,
            );
        }
        out
    }

    #[test]
    fn misses_and_noise_have_the_set_rates() {
        let n = 20_000;
        let errors = TruthErrors {
            noise_px: 1.5,
            miss_rate: 0.1,
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
            false_alarms_per_frame: 0.0,
        };
        assert!(run(&errors, 10, [50, 50]).is_empty());
    }
}
