//! What the recogniser makes of things.

use super::super::{KNOTS_PX, NamedRow, Names, at_size, nearest};
use super::going_on::parts;
use crate::tracking::evidence::logit;
use crate::tracking::recognition::{CLASSES, TrackClass};

/// So many answers with the figures of the kind that this one is like, and at each size with those of all sizes, are taken as
/// known beside the data.
const KIND_KNOWN: f64 = 10.0;
const SIZE_KNOWN: f64 = 30.0;
/// Mean and standard deviation of the logit of a kind that is like no other: anything.
const ASSUMED: (f64, f64) = (0.0, 2.0);

/// The recogniser's answers on a kind that is like another.
pub(super) fn names(named: &[(usize, &NamedRow)], like: Option<&Names>) -> Names {
    let mut values: [Vec<f64>; KNOTS_PX.len()] = Default::default();
    let mut others = [0.0; CLASSES];
    for (_, row) in named {
        values[nearest(row.size_px)].push(logit(row.probabilities[0]));
        for (sum, probability) in others.iter_mut().zip(row.probabilities) {
            *sum += probability;
        }
    }
    others[0] = 0.0;
    let sum: f64 = others.iter().sum();
    if sum > 0.0 {
        others = others.map(|other| other / sum);
    } else {
        others[TrackClass::Other as usize] = 1.0;
    }
    let all: Vec<f64> = values.iter().flatten().copied().collect();
    let moments = |values: &[f64], (mean, sigma): (f64, f64), held: f64| {
        let count = values.len() as f64 + held;
        let mean = (values.iter().sum::<f64>() + held * mean) / count;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        (mean, ((squares + held * sigma * sigma) / count).sqrt())
    };
    let whole = moments(
        &all,
        like.map_or(ASSUMED, |like| (like.logit[2], like.sigma[2])),
        KIND_KNOWN,
    );
    let (mut mean, mut sigma) = ([0.0; KNOTS_PX.len()], [0.0; KNOTS_PX.len()]);
    for knot in 0..KNOTS_PX.len() {
        (mean[knot], sigma[knot]) = moments(&values[knot], whole, SIZE_KNOWN);
    }
    let residuals = named.iter().map(|(run, row)| {
        let size_px = row.size_px;
        let value =
            (logit(row.probabilities[0]) - at_size(&mean, size_px)) / at_size(&sigma, size_px);
        ((*run, row.track), row.t_s, value)
    });
    Names {
        noise: parts(residuals.collect()),
        logit: mean,
        sigma,
        others,
    }
}
