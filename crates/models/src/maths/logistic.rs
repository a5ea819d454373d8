//! Logistic regression, with the intervals of data that come in groups.
//!
//! The log-odds of a case are the sum of its numbers, each times a weight. The weights are those of greatest likelihood, by Newton's
//! method. Cases of one group are alike: the weights' covariance is the sandwich that counts groups, not cases (K.-Y. Liang,
//! S. L. Zeger, "Longitudinal data analysis using generalized linear models", Biometrika 73, 1986).

use nalgebra::{SMatrix, SVector};

/// Rounds of Newton's method: more than any data at hand need.
const ROUNDS: usize = 50;
/// Steps below this are none.
const CONVERGED: f64 = 1e-9;
/// Longest step: where the data are nearly parted, Newton's overshoot.
const LONGEST: f64 = 4.0;
/// Normal quantile of a two-sided 95 % interval.
const Z95: f64 = 1.959_964;

/// A case: its numbers, and whether it came true.
pub type Case<const N: usize> = ([f64; N], bool);

/// A weight and half of its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weight {
    /// The weight.
    pub value: f64,
    /// Half of its interval's width.
    pub half_95: f64,
}

/// Weights of cases in groups, none of a number that is nought in all of them; `None` where the data do not tell them: too few, or all of one kind.
pub fn weights<const N: usize>(groups: &[Vec<Case<N>>]) -> Option<[Weight; N]> {
    let mut beta = SVector::<f64, N>::zeros();
    let mut covariance = None;
    for _ in 0..ROUNDS {
        let mut information = SMatrix::<f64, N, N>::zeros();
        let mut gradient = SVector::<f64, N>::zeros();
        for (x, came_true) in groups.iter().flatten() {
            let x = SVector::from(*x);
            let p = probability(beta.dot(&x));
            information += x * x.transpose() * (p * (1.0 - p));
            gradient += x * (f64::from(u8::from(*came_true)) - p);
        }
        for i in 0..N {
            if information[(i, i)] == 0.0 {
                information[(i, i)] = 1.0;
            }
        }
        let inverse = information.try_inverse()?;
        let step = inverse * gradient;
        beta += step * (LONGEST / step.norm().max(LONGEST));
        if step.norm() < CONVERGED {
            covariance = Some(inverse);
            break;
        }
    }
    let inverse = covariance?;
    let mut between = SMatrix::<f64, N, N>::zeros();
    for group in groups {
        let mut score = SVector::<f64, N>::zeros();
        for (x, came_true) in group {
            let x = SVector::from(*x);
            score += x * (f64::from(u8::from(*came_true)) - probability(beta.dot(&x)));
        }
        between += score * score.transpose();
    }
    let covariance = inverse * between * inverse;
    let weight = |i: usize| Weight {
        value: beta[i],
        half_95: Z95 * covariance[(i, i)].max(0.0).sqrt(),
    };
    let all = std::array::from_fn(weight);
    all.iter()
        .all(|weight| weight.value.is_finite() && weight.half_95.is_finite())
        .then_some(all)
}

/// The probability of natural log-odds.
pub fn probability(log_odds: f64) -> f64 {
    1.0 / (1.0 + (-log_odds).exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::rng::Stream;

    /// Groups of cases whose log-odds are 0.5 − 1.5 x₁; a group's second number is the same for all of it, and says nothing.
    fn groups(n: usize, seed: u64) -> Vec<Vec<Case<3>>> {
        let mut rng = Stream::new(seed, 0, "logistic");
        let mut group = || {
            let common = rng.normal();
            let mut case = || {
                let x = rng.normal();
                let p = probability(0.5 - 1.5 * x);
                ([1.0, x, common], rng.uniform() < p)
            };
            (0..10).map(|_| case()).collect()
        };
        (0..n).map(|_| group()).collect()
    }

    #[test]
    fn weights_are_found_within_their_intervals() {
        let truth = [0.5, -1.5, 0.0];
        let n = 60;
        let mut inside = 0;
        for seed in 0..n {
            let found = weights(&groups(100, seed)).unwrap();
            inside += (found.iter().zip(truth))
                .filter(|(weight, truth)| (weight.value - truth).abs() < weight.half_95)
                .count();
        }
        // 95 % of 180, with four deviations of that count: 171 ± 12.
        assert!(inside > 159, "{inside}");
    }

    #[test]
    fn groups_that_are_one_case_over_and_over_count_once() {
        let few = groups(60, 3);
        let flat: Vec<Vec<Case<3>>> = few.iter().flatten().map(|case| vec![*case]).collect();
        let often: Vec<Vec<Case<3>>> = flat.iter().map(|group| group.repeat(9)).collect();
        let (once, again) = (weights(&flat).unwrap(), weights(&often).unwrap());
        for (a, b) in once.iter().zip(again) {
            assert!((a.value - b.value).abs() < 1e-6);
            assert!((a.half_95 / b.half_95 - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn what_is_all_of_one_kind_tells_no_weights() {
        let all_true = vec![vec![([1.0, 0.5], true); 20]];
        assert_eq!(weights(&all_true), None);
        let half = [vec![([1.0, 0.0], true), ([1.0, 0.0], false)]];
        assert_eq!(weights(&half).unwrap()[1].value, 0.0);
    }
}
