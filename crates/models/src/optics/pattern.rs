//! What differs from pixel to pixel of one sensor: offsets and sensitivities that stay.
//!
//! White and Gaussian from pixel to pixel, by a hash of the sensor's key and the pixel; no columns or
//! rows stand out, and no pixel is defect. Kept in a byte each, in steps of a 24th of the standard
//! deviation.

use super::noise;

/// Steps a standard deviation.
const STEPS: f32 = 24.0;

/// The fixed pattern of one sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct FixedPattern {
    width: usize,
    /// Of every row the even columns, then the odd ones.
    sensitivity: Vec<i8>,
    offset: Vec<i8>,
}

impl FixedPattern {
    /// The pattern of a sensor of `width` by `height` pixels with the key `key`.
    pub fn new(width: usize, height: usize, key: u64) -> Self {
        let mut noise = vec![0.0; width];
        let mut draw = |purpose: u64| -> Vec<i8> {
            (0..height)
                .flat_map(|y| {
                    noise::row(noise::key(key ^ purpose, y as u64), 0, &mut noise);
                    let stored = |z: &f32| (z * STEPS).round().clamp(-127.0, 127.0) as i8;
                    noise.iter().map(stored).collect::<Vec<_>>()
                })
                .collect()
        };
        Self {
            width,
            sensitivity: draw(1),
            offset: draw(2),
        }
    }

    /// The relative sensitivities and the offsets of every second pixel of row `y` from column `x`
    /// on, in units of [`FixedPattern::UNIT`] standard deviations.
    pub fn half_row(&self, x: usize, y: usize) -> Option<[&[i8]; 2]> {
        let evens = self.width.div_ceil(2);
        let (start, end) = if x.is_multiple_of(2) {
            (x / 2, evens)
        } else {
            (evens + x / 2, self.width)
        };
        let row = y * self.width;
        let part = row + start..row + end;
        Some([self.sensitivity.get(part.clone())?, self.offset.get(part)?])
    }

    /// Standard deviations a unit of what is kept.
    pub const UNIT: f32 = 1.0 / STEPS;
}
