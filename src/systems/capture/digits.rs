//! The digits in alpha by which a rendered pixel tells the UAVs in it apart.

use crate::components::capture::ExposedFrame;
use std::borrow::Borrow;

/// Alpha of a pixel of half-float RGBA rows.
pub(crate) fn alpha_at(pixels: &[u8], index: usize) -> f64 {
    half::f16::from_le_bytes([pixels[8 * index + 6], pixels[8 * index + 7]]).to_f64()
}

/// Identities a pixel can hold apart: base-5 digits of an integer, above the one that counts the covered
/// samples, that a half float keeps exact after the average over four samples: quarters up to 512, and
/// beyond that only the whole number of four samples of the last identity.
pub const DIGITS: u32 = 4;

/// A digit (1 to [`DIGITS`]) for every UAV, so that UAVs whose boxes touch in any frame differ
/// where four digits allow it; the closer one is served first.
pub(super) fn assign_digits(frames: &[impl Borrow<ExposedFrame>]) -> Vec<u32> {
    let frames: Vec<&ExposedFrame> = frames.iter().map(Borrow::borrow).collect();
    let count = frames
        .iter()
        .flat_map(|f| &f.truth)
        .map(|s| s.uav + 1)
        .max()
        .unwrap_or(0);
    let mut digits = vec![0; count];
    let mut order: Vec<_> = frames
        .iter()
        .flat_map(|f| &f.truth)
        .map(|s| (s.range_m, s.uav))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (_, uav) in order {
        if digits[uav] != 0 {
            continue;
        }
        let taken: Vec<u32> = frames
            .iter()
            .flat_map(|frame| {
                let own = frame.truth.iter().find(|s| s.uav == uav);
                frame
                    .truth
                    .iter()
                    .filter(move |s| own.is_some_and(|own| touch(&own.box_px, &s.box_px)))
            })
            .map(|s| digits[s.uav])
            .collect();
        digits[uav] = (1..=DIGITS)
            .find(|digit| !taken.contains(digit))
            .unwrap_or(1 + uav as u32 % DIGITS);
    }
    digits
}

/// Whether two boxes touch, with a margin for the pixels at their edges.
fn touch(a: &[f64; 4], b: &[f64; 4]) -> bool {
    const MARGIN_PX: f64 = 2.0;
    a[0] <= b[2] + MARGIN_PX
        && b[0] <= a[2] + MARGIN_PX
        && a[1] <= b[3] + MARGIN_PX
        && b[1] <= a[3] + MARGIN_PX
}

/// Whether a pixel with a mean alpha over so many samples shows the UAV of a digit.
pub(super) fn shows(alpha: f64, samples: u32, digit: u32) -> bool {
    digit_of((alpha * f64::from(samples)).round() as u32, digit) > 0
}

/// How many samples of a pixel belong to a digit, given their base-5 sum.
pub(crate) fn digit_of(sum: u32, digit: u32) -> u32 {
    if digit == 0 {
        0
    } else {
        sum / 5u32.pow(digit) % 5
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_survive_the_resolve() {
        // Every way in which four samples meet sky, scenery and four identities, averaged and stored as
        // a half float.
        let alpha = [0, 1, 6, 26, 126, 626];
        for code in 0..6_usize.pow(4) {
            let samples = [1, 6, 36, 216].map(|place| code / place % 6);
            let sum: u32 = samples.iter().map(|kind| alpha[*kind]).sum();
            let stored = half::f16::from_f64(f64::from(sum) / 4.0).to_f64() * 4.0;
            let count = |kind: usize| samples.iter().filter(|k| **k == kind).count() as u32;
            for digit in 1..=DIGITS {
                let counted = digit_of(stored.round() as u32, digit);
                assert_eq!(counted, count(digit as usize + 1), "{samples:?}");
            }
            assert_eq!(stored.round() as u32 % 5, (4 - count(0)) % 5);
        }
    }
}
