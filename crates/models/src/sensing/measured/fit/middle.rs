//! Figures of most of some values: what is far off is a box on a neighbour.

use crate::maths::quantile::quantile;

/// The middle one of some values; nothing of none.
pub(super) fn median(values: &[f64]) -> f64 {
    let mut ascending = values.to_vec();
    ascending.sort_by(f64::total_cmp);
    quantile(&ascending, 0.5).unwrap_or(0.0)
}

/// Standard deviation about nothing, by the middle two thirds: a box on a neighbour is no error of this size.
pub(super) fn rms_of_most(values: &[f64]) -> f64 {
    let magnitudes: Vec<f64> = values.iter().map(|value| value.abs()).collect();
    let mut ascending = magnitudes;
    ascending.sort_by(f64::total_cmp);
    quantile(&ascending, 0.683).unwrap_or(0.0)
}
