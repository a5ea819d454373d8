//! How far something stands out from its surroundings in a picture.

/// What lies so far beyond a box counts as its surroundings [px], as in the source of [`signal_to_clutter`].
const AROUND_PX: f64 = 20.0;
/// What lies nearer than this is neither: the box's light is blurred into it [px].
const BLURRED_PX: f64 = 1.0;
/// Deviation that rounding to whole grey levels leaves.
const ROUNDING: f64 = 0.288_675; // 1/sqrt(12) [grey levels]

/// How a box in a picture differs from what is around it, in 8-bit grey levels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contrast {
    /// Mean of the box.
    pub target: f64,
    /// Mean of its surroundings.
    pub around: f64,
    /// Standard deviation of its surroundings, at least what rounding to whole levels leaves.
    pub deviation: f64,
}

impl Contrast {
    /// The signal-to-clutter ratio.
    pub fn ratio(&self) -> f64 {
        (self.target - self.around).abs() / self.deviation
    }
}

/// The signal-to-clutter ratio |m_t - m_b| / s_b of a box in a picture of 8-bit RGB pixels: the mean grey level of the pixels
/// that the box `[x0, y0, x1, y1]` [px] touches against mean and standard deviation of those around it. Noise alone gives a box
/// of n pixels some 1/sqrt(n). `None` where the box or its surroundings lie outside the picture.
///
/// C. Gao, D. Meng, Y. Yang, Y. Wang, X. Zhou and A. G. Hauptmann, Infrared patch-image model for small target detection in
/// a single image, IEEE Transactions on Image Processing 22(12), 2013.
pub fn signal_to_clutter(rgb8: &[u8], size_px: [u32; 2], box_px: [f64; 4]) -> Option<f64> {
    Some(contrast(rgb8, size_px, box_px)?.ratio())
}

/// What [`signal_to_clutter`] is made of.
pub fn contrast(rgb8: &[u8], size_px: [u32; 2], box_px: [f64; 4]) -> Option<Contrast> {
    let width = size_px[0] as usize;
    // The pixels that a box with this margin touches, on one axis.
    let span = |axis: usize, margin_px: f64| {
        let clip = |x: f64| x.clamp(0.0, f64::from(size_px[axis])) as usize;
        clip((box_px[axis] - margin_px).floor())..clip((box_px[axis + 2] + margin_px).ceil())
    };
    let grey = |x: usize, y: usize| {
        let pixel = rgb8.get(3 * (y * width + x)..)?.first_chunk::<3>()?;
        Some(pixel.iter().map(|level| f64::from(*level)).sum::<f64>() / 3.0)
    };
    let [inside, blurred, outside] =
        [0.0, BLURRED_PX, AROUND_PX].map(|margin_px| [0, 1].map(|axis| span(axis, margin_px)));
    let (mut target, mut around) = (Moments::default(), Moments::default());
    for y in outside[1].clone() {
        for x in outside[0].clone() {
            let within = |[columns, rows]: &[std::ops::Range<usize>; 2]| {
                columns.contains(&x) && rows.contains(&y)
            };
            if within(&inside) {
                target.add(grey(x, y)?);
            } else if !within(&blurred) {
                around.add(grey(x, y)?);
            }
        }
    }
    let (target, _) = target.mean_and_deviation()?;
    let (around, deviation) = around.mean_and_deviation()?;
    Some(Contrast {
        target,
        around,
        deviation: deviation.max(ROUNDING),
    })
}

/// Sums of numbers and of their squares.
#[derive(Default)]
struct Moments {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    fn add(&mut self, x: f64) {
        self.count += 1.0;
        self.sum += x;
        self.squares += x * x;
    }

    fn mean_and_deviation(&self) -> Option<(f64, f64)> {
        let mean = self.sum / self.count;
        let variance = self.squares / self.count - mean * mean;
        (self.count > 0.0).then(|| (mean, variance.max(0.0).sqrt()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::rng::Stream;

    const SIZE_PX: [u32; 2] = [64, 48];

    /// Grey noise of deviation `noise` about 120, and a box that is brighter by `signal`.
    fn picture(signal: f64, noise: f64, box_px: [usize; 4], rng: &mut Stream) -> Vec<u8> {
        let places =
            (0..SIZE_PX[1] as usize).flat_map(|y| (0..SIZE_PX[0] as usize).map(move |x| (x, y)));
        places
            .flat_map(|(x, y)| {
                let [x0, y0, x1, y1] = box_px;
                let on = (x0..x1).contains(&x) && (y0..y1).contains(&y);
                let level = 120.0 + noise * rng.normal() + if on { signal } else { 0.0 };
                [level.round() as u8; 3]
            })
            .collect()
    }

    #[test]
    fn it_is_the_difference_over_the_deviation() {
        let mut rng = Stream::new(1, 0, "test");
        let box_px = [30.2, 20.0, 35.9, 24.0];
        for (signal, noise) in [(40.0, 5.0), (-30.0, 4.0), (12.0, 8.0)] {
            let ratios = (0..50).filter_map(|_| {
                let rgb8 = picture(signal, noise, [30, 20, 36, 24], &mut rng);
                signal_to_clutter(&rgb8, SIZE_PX, box_px)
            });
            let ratios: Vec<f64> = ratios.collect();
            let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
            let expected = f64::abs(signal) / noise;
            assert!(
                (mean / expected - 1.0).abs() < 0.05,
                "{mean} for {expected}"
            );
        }
        // Noise alone: the mean of |N(0, 1/n)| with n = 24 pixels is 0.8 / sqrt(24).
        let nothing = (0..400).filter_map(|_| {
            let rgb8 = picture(0.0, 6.0, [0; 4], &mut rng);
            signal_to_clutter(&rgb8, SIZE_PX, box_px)
        });
        let mean = nothing.sum::<f64>() / 400.0;
        assert!((mean - 0.163).abs() < 0.02, "{mean}");
    }

    #[test]
    fn a_plain_picture_shows_a_level_and_no_box_outside_counts() {
        let mut rng = Stream::new(1, 0, "test");
        let white = picture(0.0, 0.0, [0; 4], &mut rng);
        assert_eq!(
            signal_to_clutter(&white, SIZE_PX, [30.0, 20.0, 33.0, 22.0]),
            Some(0.0)
        );
        let one = picture(1.0, 0.0, [30, 20, 33, 22], &mut rng);
        let ratio = signal_to_clutter(&one, SIZE_PX, [30.0, 20.0, 33.0, 22.0]).unwrap();
        assert!((ratio - 1.0 / ROUNDING).abs() < 1e-9, "{ratio}");
        // At the edge what there is counts; beyond it there is nothing.
        assert!(signal_to_clutter(&one, SIZE_PX, [-2.0, 0.0, 2.0, 3.0]).is_some());
        assert_eq!(
            signal_to_clutter(&one, SIZE_PX, [-9.0, 0.0, -3.0, 3.0]),
            None
        );
        assert_eq!(
            signal_to_clutter(&one, SIZE_PX, [0.0, 0.0, 64.0, 48.0]),
            None
        );
        // Fewer pixels than it should have.
        assert_eq!(
            signal_to_clutter(&one[..90], SIZE_PX, [30.0, 20.0, 33.0, 22.0]),
            None
        );
    }
}
