//! Linear regression of normal variables of which only a side, or only what is above a floor, is known.

use super::super::TERMS;
use super::super::table::normal_share;
use nalgebra::{SMatrix, SVector};
use std::f64::consts::TAU;

/// Rounds of expectation and maximisation: the last ones change nothing that counts.
const ROUNDS: usize = 60;
/// How strongly a gain is held at what it was before where little is known: as by so many variables.
const HELD: f64 = 5.0;
/// So many variables of a spread of one are taken as known beside the data, so that a few do not make a spread of nothing.
const SPREAD_KNOWN: f64 = 10.0;
/// Share of all that is taken to be cut off at most: beyond, a mean is not to be told from its values.
const MOST_CUT_OFF: f64 = 0.9;

/// What is known of a normal variable.
#[derive(Clone, Copy)]
pub(super) enum Side {
    /// It is above or below this.
    Above(f64),
    Below(f64),
    /// Its value; had it been below the second number, nothing would be known.
    Cut(f64, f64),
}

/// Linear regression by expectation and maximisation of normal variables of which this is known, and their standard deviation
/// where it is not set; little data leave the gains as they were `before`.
pub(super) fn regressed(
    data: &[(SVector<f64, TERMS>, Side)],
    before: SVector<f64, TERMS>,
    set: Option<f64>,
) -> (SVector<f64, TERMS>, f64) {
    let mut normal = SMatrix::<f64, TERMS, TERMS>::identity() * HELD;
    for (terms, _) in data {
        normal += terms * terms.transpose();
    }
    let inverse = normal.try_inverse().unwrap_or_else(SMatrix::zeros);
    let (mut gains, mut sigma) = (before, set.unwrap_or(1.0));
    for _ in 0..ROUNDS {
        let mut right = before * HELD;
        let mut squares = 0.0;
        for (terms, side) in data {
            let mean = gains.dot(terms);
            // What is expected of it, and with what variance.
            let (value, variance) = match *side {
                Side::Below(cut) => below(mean, sigma, cut),
                Side::Above(cut) => {
                    let (value, variance) = below(-mean, sigma, -cut);
                    (-value, variance)
                }
                // For each that is seen, so many were cut off.
                Side::Cut(value, cut) => {
                    let share = normal_share((cut - mean) / sigma).min(MOST_CUT_OFF);
                    let (missing, variance) = below(mean, sigma, cut);
                    let seen = 1.0 - share;
                    let squared = seen * (value - mean).powi(2)
                        + share * (variance + (missing - mean).powi(2));
                    (seen * value + share * missing, squared)
                }
            };
            right += terms * value;
            squares += match side {
                Side::Cut(..) => variance,
                _ => variance + (value - mean).powi(2),
            };
        }
        gains = inverse * right;
        sigma =
            set.unwrap_or(((squares + SPREAD_KNOWN) / (data.len() as f64 + SPREAD_KNOWN)).sqrt());
    }
    (gains, sigma)
}

/// Mean and variance of a normal variable of which it is known that it is below a value.
fn below(mean: f64, sigma: f64, cut: f64) -> (f64, f64) {
    let at = (cut - mean) / sigma;
    let share = normal_share(at);
    if share < 1e-12 {
        return (cut, 0.0);
    }
    let ratio = (-0.5 * at * at).exp() / TAU.sqrt() / share;
    (
        mean - sigma * ratio,
        (sigma * sigma * (1.0 - at * ratio - ratio * ratio)).max(0.0),
    )
}
