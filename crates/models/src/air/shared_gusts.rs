//! Noise that drives the gusts of neighbours, so that they share what is larger than their distance.
//!
//! Dryden's filter is driven by white noise. Here the noise is a field in space, a new one in each tick: plane waves
//! `A cos(k r) + B sin(k r)` of random wave vector `k` and standard normal `A` and `B` (Kraichnan, Phys. Fluids 13, 22, 1970).
//! Whatever `k` and wherever `r`, that is standard normal and independent from tick to tick: every UAV keeps Dryden's
//! variance and spectrum exactly. Two places share `E[cos(k d)]` of it. That is `exp(-d/L)`, Dryden's longitudinal
//! correlation, for wave vectors from its spectrum in three dimensions, `(1 + k²L²)^-2`: Cauchy's distribution. The
//! filter averages over the ticks of `L/V`, hundreds or thousands, so that one wave a tick is enough.

use crate::maths::rng::Stream;
use glam::DVec3;

/// Least length scale [m]: 10 ft, that of MIL-F-8785C. Each rung of the ladder is twice the one before it; the last is
/// above the greatest, 1000 ft.
const FINEST_M: f64 = 3.048; // [m]
const RUNGS: usize = 8;
/// Numbers that a UAV's three filters take: one along the wind, two across it, two upright.
pub const NUMBERS: usize = 5;
/// How many of them go by the length scale of the horizontal gusts, which come first.
const HORIZONTAL: usize = 3;

/// One plane wave of each number.
#[derive(Clone, Copy, Debug)]
struct Wave {
    k_radpm: DVec3,
    cos: [f64; NUMBERS],
    sin: [f64; NUMBERS],
}

/// A field of noise: `waves` waves for each rung.
#[derive(Clone, Debug)]
pub struct SharedNoise(Vec<[Wave; RUNGS]>);

impl SharedNoise {
    /// Draws a field. One wave does in a tick; what stands alone, as the gusts at the start, needs
    /// hundreds, since `n` waves leave a correlation of some `1/sqrt(2 n)` between places that should share nothing.
    pub fn draw(waves: usize, rng: &mut Stream) -> Self {
        let mut wave = |rung: usize| {
            let l_m = FINEST_M * (1 << rung) as f64;
            // A wave vector beyond all measure would leave no digits of the phase.
            let chi = rng.normal().abs().max(1e-6);
            let k_radpm = rng.normal3() / (chi * l_m);
            let [cos, sin] = [(); 2].map(|()| [(); NUMBERS].map(|()| rng.normal()));
            Wave { k_radpm, cos, sin }
        };
        Self((0..waves).map(|_| std::array::from_fn(&mut wave)).collect())
    }

    /// The numbers at a place [m], for length scales of horizontal and upright gusts [m]: of unit variance.
    pub fn normals(&self, r_enu_m: DVec3, l_u_m: f64, l_w_m: f64) -> [f64; NUMBERS] {
        let mut numbers = [0.0; NUMBERS];
        for (l_m, of) in [(l_u_m, 0..HORIZONTAL), (l_w_m, HORIZONTAL..NUMBERS)] {
            let (rung, share) = rung(l_m);
            for waves in &self.0 {
                for (rung, share) in [(rung, 1.0 - share), (rung + 1, share)] {
                    let wave = &waves[rung];
                    let (sin, cos) = wave.k_radpm.dot(r_enu_m).sin_cos();
                    let weight = (share / self.0.len() as f64).sqrt();
                    for number in of.clone() {
                        numbers[number] +=
                            weight * (wave.cos[number] * cos + wave.sin[number] * sin);
                    }
                }
            }
        }
        numbers
    }
}

/// The rung below a length scale [m], and the next one's share of the variance, which makes the scale of the two that one.
fn rung(l_m: f64) -> (usize, f64) {
    let rungs = (l_m / FINEST_M).max(1.0);
    let rung = (rungs.log2() as usize).min(RUNGS - 2);
    (rung, (rungs / (1 << rung) as f64 - 1.0).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Products of the numbers at two places, averaged over so many fields: horizontal and upright.
    fn shared(from_m: DVec3, to_m: DVec3, [l_u_m, l_w_m]: [f64; 2], fields: u64) -> [f64; 2] {
        let mut sums = [0.0; NUMBERS];
        for field in 0..fields {
            let noise = SharedNoise::draw(1, &mut Stream::new(9, field, "shared gusts"));
            let [a, b] = [from_m, to_m].map(|r| noise.normals(r, l_u_m, l_w_m));
            for (sum, (a, b)) in sums.iter_mut().zip(a.iter().zip(b)) {
                *sum += a * b / fields as f64;
            }
        }
        let (horizontal, upright) = sums.split_at(HORIZONTAL);
        [horizontal, upright].map(|sums| sums.iter().sum::<f64>() / sums.len() as f64)
    }

    #[test]
    fn neighbours_share_what_is_larger_than_their_distance() {
        let scales_m = [240.0, 80.0]; // [m], about 80 m above the ground
        let from_m = DVec3::new(430.0, -810.0, 80.0);
        for (d_m, direction) in [
            (0.0, DVec3::X),
            (5.0, DVec3::X),
            (10.0, DVec3::Y),
            (40.0, DVec3::new(0.6, 0.0, 0.8)),
            (100.0, DVec3::new(0.8, -0.6, 0.0)),
            (300.0, DVec3::Y),
            (1_500.0, DVec3::X),
        ] {
            let got = shared(from_m, from_m + d_m * direction, scales_m, 20_000);
            for (got, l_m) in got.into_iter().zip(scales_m) {
                let wanted = (-d_m / l_m).exp();
                // Five standard errors, and what two rungs differ from one exponential.
                assert!((got - wanted).abs() < 0.045, "{d_m} m: {got}, {wanted}");
            }
        }
    }

    #[test]
    fn numbers_are_standard_normal_and_independent() {
        let fields = 40_000;
        let r_enu_m = DVec3::new(-700.0, 700.0, 90.0);
        let (mut squares, mut fourths) = ([0.0; NUMBERS], 0.0);
        let (mut crossed, mut successive, mut before) = (0.0, 0.0, 0.0);
        for field in 0..fields {
            let noise = SharedNoise::draw(1, &mut Stream::new(4, field, "shared gusts"));
            let numbers = noise.normals(r_enu_m, 150.0, 150.0);
            for (square, number) in squares.iter_mut().zip(numbers) {
                *square += number * number / fields as f64;
            }
            fourths += numbers[0].powi(4) / fields as f64;
            crossed += numbers[2] * numbers[3] / fields as f64;
            successive += numbers[0] * before / fields as f64;
            before = numbers[0];
        }
        let error = 1.0 / (fields as f64).sqrt();
        for square in squares {
            assert!((square - 1.0).abs() < 5.0 * 2f64.sqrt() * error, "{square}");
        }
        assert!((fourths - 3.0).abs() < 5.0 * 96f64.sqrt() * error);
        assert!(crossed.abs() < 5.0 * error && successive.abs() < 5.0 * error);
    }

    #[test]
    fn rungs_have_the_scale_that_is_wanted() {
        for l_m in [3.048, 4.0, 23.0, 100.0, 304.8] {
            let (below, share) = rung(l_m);
            let got_m = FINEST_M * (1 << below) as f64 * (1.0 + share);
            assert!((got_m - l_m).abs() < 1e-9, "{got_m} m for {l_m} m");
        }
        assert_eq!(rung(0.0), (0, 0.0));
        assert_eq!(rung(1e9), (RUNGS - 2, 1.0));
    }
}
