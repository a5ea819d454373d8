//! How numbers spread, in little memory.

use std::collections::BTreeMap;

/// Steps to a doubling: a step is 2.2 %.
const STEPS: f64 = 32.0;
/// Exponent, in steps, below which numbers are counted as none.
const LEAST: f64 = -20.0 * STEPS;

/// Positive numbers, counted by size in steps of 2.2 %, and their largest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spread {
    steps: BTreeMap<i32, u32>,
    largest: Option<f64>,
}

impl Spread {
    /// Counts a number; what is none, or negative, is left out.
    pub fn add(&mut self, x: f64) {
        if !x.is_finite() || x < 0.0 {
            return;
        }
        let step = (STEPS * x.log2()).max(LEAST).floor() as i32;
        *self.steps.entry(step).or_default() += 1;
        self.largest = Some(self.largest.map_or(x, |largest| largest.max(x)));
    }

    /// How many were counted.
    pub fn count(&self) -> u32 {
        self.steps.values().sum()
    }

    /// The largest.
    pub fn largest(&self) -> Option<f64> {
        self.largest
    }

    /// The median, within 1.1 %.
    pub fn median(&self) -> Option<f64> {
        let half = self.count().div_ceil(2);
        let mut before = 0;
        let mut steps = self.steps.iter();
        let (step, _) = steps.find(|(_, count)| {
            before += **count;
            before >= half
        })?;
        let middle = ((f64::from(*step) + 0.5) / STEPS).exp2();
        let largest = self.largest.unwrap_or(middle);
        // The smallest step holds all that is next to nothing.
        Some(if f64::from(*step) > LEAST {
            middle.min(largest)
        } else {
            0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn nothing_has_no_median() {
        let mut spread = Spread::default();
        spread.add(f64::NAN);
        spread.add(-1.0);
        assert_eq!(
            (spread.count(), spread.median(), spread.largest()),
            (0, None, None)
        );
        spread.add(0.0);
        assert_eq!(
            (spread.count(), spread.median(), spread.largest()),
            (1, Some(0.0), Some(0.0))
        );
    }

    proptest! {
        /// The median is that of the sorted numbers, but for half a step.
        #[test]
        fn the_median_is_that_of_the_numbers(mut xs in prop::collection::vec(1e-3..1e4_f64, 1..200)) {
            let mut spread = Spread::default();
            for x in &xs {
                spread.add(*x);
            }
            xs.sort_by(f64::total_cmp);
            let wanted = xs[xs.len().div_ceil(2) - 1];
            let found = spread.median().unwrap();
            prop_assert!((found / wanted - 1.0).abs() < 0.0111, "{found} for {wanted}");
            prop_assert_eq!(spread.largest(), xs.last().copied());
        }
    }
}
