//! The points of an experiment: every combination, a Latin hypercube, or Sobol's sequence.

use super::factor::{Factor, Setting};
use super::file::Sampling;
use crate::models::maths::rng::Stream;

/// The factors' values at a point, by its number.
pub(super) fn settings(
    factors: &[Factor],
    sampling: Sampling,
    strata: &[Vec<f64>],
    point: u64,
) -> Vec<Setting> {
    let mut rest = point;
    // The last factor changes fastest.
    let mut settings: Vec<Setting> = (factors.iter().enumerate().rev())
        .map(|(dimension, factor)| match sampling {
            Sampling::Grid => {
                let at = rest % factor.count();
                rest /= factor.count();
                factor.at(at)
            }
            Sampling::LatinHypercube => factor.between(strata[dimension][point as usize]),
            Sampling::Sobol => {
                let u = sobol_burley::sample(point as u32, dimension as u32, 0);
                factor.between(f64::from(u))
            }
        })
        .collect();
    settings.reverse();
    settings
}

/// For each point a place from 0 to 1 in a stratum of its own, in random order.
pub(super) fn strata(points: u64, factor: u64) -> Vec<f64> {
    let mut rng = Stream::new(0, factor, "latin hypercube");
    let mut order: Vec<u64> = (0..points).collect();
    for last in (1..order.len()).rev() {
        let other = (rng.uniform() * (last + 1) as f64) as usize;
        order.swap(last, other.min(last));
    }
    order
        .into_iter()
        .map(|stratum| (stratum as f64 + rng.uniform()) / points as f64)
        .collect()
}
