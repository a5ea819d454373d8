//! Gaussian noise by hash: a number for every (key, row, column), whatever order asks for it.

use std::sync::LazyLock;

/// Entries of the table of normal quantiles.
const QUANTILES: usize = 1024;
/// The step of a Weyl sequence of 64 bits, 2^64 / golden ratio.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
/// Numbers that one hash yields, of twenty bits each.
const PER_HASH: usize = 3;

/// Normal quantiles at the middles of 1024 equal steps of probability, scaled so that the sum of
/// two independent picks has unit variance.
static NOISE: LazyLock<[f32; QUANTILES]> = LazyLock::new(|| {
    let density = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    let mut quantiles = [0.0_f64; QUANTILES];
    // Walk the cumulative distribution down from 1/2 by the trapezoidal rule; the upper half is
    // the mirror image.
    let step = 1e-3;
    let (mut x, mut below) = (0.0, 0.5);
    for i in (0..QUANTILES / 2).rev() {
        let wanted = (i as f64 + 0.5) / QUANTILES as f64;
        let slice = |x: f64| 0.5 * step * (density(x) + density(x - step));
        while below - slice(x) > wanted {
            below -= slice(x);
            x -= step;
        }
        quantiles[i] = x - step * (below - wanted) / slice(x);
        quantiles[QUANTILES - 1 - i] = -quantiles[i];
    }
    let variance = quantiles.iter().map(|q| q * q).sum::<f64>() / QUANTILES as f64;
    quantiles.map(|q| (q / (2.0 * variance).sqrt()) as f32)
});

/// A bijective hash of 64 bits (the finaliser of SplitMix64, Steele et al. 2014).
fn hash(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// The key of row `row` of what has the key `key`.
pub fn key(key: u64, row: u64) -> u64 {
    hash(key ^ hash(row))
}

/// The noise of the columns from `first` on of the row with the key `row_key`: mean 0, variance 1,
/// ended at 4.66 standard deviations.
pub fn row(row_key: u64, first: usize, out: &mut [f32]) {
    let table = &*NOISE;
    let pick = |bits: u64, lane: usize| {
        let bits = (bits >> (4 + 20 * lane)) as usize;
        table[bits % QUANTILES] + table[bits / QUANTILES % QUANTILES]
    };
    let group =
        |number: usize| hash(row_key.wrapping_add((number as u64 + 1).wrapping_mul(GOLDEN)));
    // The columns before the first whole group.
    let lead = (first.next_multiple_of(PER_HASH) - first).min(out.len());
    let (head, rest) = out.split_at_mut(lead);
    for (i, noise) in head.iter_mut().enumerate() {
        *noise = pick(group(first / PER_HASH), (first + i) % PER_HASH);
    }
    let begin = (first + lead).div_ceil(PER_HASH);
    let (groups, tail) = rest.as_chunks_mut::<PER_HASH>();
    let end = begin + groups.len();
    for (number, noise) in (begin..).zip(groups) {
        let bits = group(number);
        *noise = [0, 1, 2].map(|lane| pick(bits, lane));
    }
    for (lane, noise) in tail.iter_mut().enumerate() {
        *noise = pick(group(end), lane);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments(values: &[f32]) -> (f64, f64) {
        let n = values.len() as f64;
        let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
        let square = |v: &f32| (f64::from(*v) - mean).powi(2);
        (mean, values.iter().map(square).sum::<f64>() / (n - 1.0))
    }

    #[test]
    fn the_table_is_a_unit_normal() {
        let (mean, variance) = moments(&*NOISE);
        assert!(mean.abs() < 1e-7);
        assert!((2.0 * variance - 1.0).abs() < 2e-3);
        // The published quantile of 0.975, between two entries: 1.959964 before the scaling,
        // which only makes up for the table's cut tails.
        let at = 0.975 * QUANTILES as f64 - 0.5;
        let between = f64::from(NOISE[at as usize])
            + at.fract() * f64::from(NOISE[at as usize + 1] - NOISE[at as usize]);
        assert!(
            (between * 2_f64.sqrt() - 1.959_964).abs() < 4e-3,
            "{between}"
        );
        // The sum of two picks: shares beyond 1, 2 and 3 sigma, and the kurtosis.
        let mut draws = vec![0.0; 1_000_000];
        row(key(7, 3), 0, &mut draws);
        for (sigmas, share) in [(1.0, 0.317_311), (2.0, 0.045_500), (3.0, 0.002_700)] {
            let found = draws.iter().filter(|d| d.abs() > sigmas).count() as f64 / 1e6;
            assert!(
                (found / share - 1.0).abs() < 0.08,
                "{found} beyond {sigmas} sigma"
            );
        }
        let (_, variance) = moments(&draws);
        let fourth = draws.iter().map(|d| f64::from(*d).powi(4)).sum::<f64>() / 1e6;
        assert!((fourth / variance.powi(2) - 3.0).abs() < 0.05);
    }

    #[test]
    fn a_column_has_its_noise_whatever_is_asked_for() {
        let mut whole = vec![0.0; 50];
        row(5, 0, &mut whole);
        for (first, count) in [(0, 1), (1, 1), (1, 2), (2, 7), (3, 3), (17, 33)] {
            let mut part = vec![0.0; count];
            row(5, first, &mut part);
            assert_eq!(part, whole[first..first + count], "{first} {count}");
        }
    }
}
