//! The figures of a page: their values, means and intervals.

use super::groups::Row;
use crate::experiment::figures::{Kind, range};
use crate::experiment::sweep::plan::{Plan, PlannedRun};
use crate::experiment::sweep::run::Done;
use crate::models::engage::outcome::Outcome;
use crate::models::maths::statistics::{Mean, wilson_95};
use crate::report::chart::Scale;
use std::collections::BTreeMap;

/// A figure of every run that has it, as a number.
pub(super) struct Figure<'a> {
    pub(super) name: String,
    /// Whether its values are 1 and 0, of runs that end so and others.
    pub(super) share: bool,
    /// Whether the runs have several seeds.
    pub(super) seeds: bool,
    /// Least and most that it can be.
    pub(super) range: [f64; 2],
    /// The run, and its value.
    pub(super) values: Vec<(&'a PlannedRun, f64)>,
}

impl Figure<'_> {
    /// Its value, if all runs have the same.
    pub(super) fn constant(&self) -> Option<f64> {
        let (_, first) = self.values.first()?;
        let same = |(_, value): &(&PlannedRun, f64)| value == first;
        self.values.iter().all(same).then_some(*first)
    }

    /// Whether it counts: all its values are whole numbers, and it is no share.
    pub(super) fn whole(&self) -> bool {
        !self.share && self.values.iter().all(|(_, value)| value.fract() == 0.0)
    }

    /// How its means become heights.
    pub(super) fn scale(&self) -> Scale {
        match self.whole() {
            true => Scale::Whole,
            false => Scale::Linear,
        }
    }
}

/// The figures to be shown: numbers, and the share of runs that end neutralised.
pub(super) fn figures<'a>(plan: &Plan, rows: &'a [Row]) -> Vec<Figure<'a>> {
    let of = |(key, kind): &(String, Kind)| {
        let value = |done: &Done| {
            let value = done.result.as_ref().ok()?.get(key)?;
            match kind {
                Kind::Number => value.as_f64(),
                Kind::Text if key == "outcome" => {
                    let won = value.as_str() == Some(Outcome::Neutralised.name());
                    Some(f64::from(u8::from(won)))
                }
                Kind::Text => None,
            }
        };
        let values: Vec<(&PlannedRun, f64)> = (rows.iter())
            .filter_map(|(run, done)| Some((run, value(done)?)))
            .collect();
        let share = *kind == Kind::Text;
        let name = match share {
            false => key.clone(),
            true => "share neutralised".to_owned(),
        };
        let figure = Figure {
            name,
            share,
            seeds: plan.seeds() > 1,
            range: match share {
                false => range(key),
                true => [0.0, 1.0],
            },
            values,
        };
        (!figure.values.is_empty()).then_some(figure)
    };
    plan.figures.iter().filter_map(of).collect()
}

/// The values of a figure in a group of runs, with their seeds.
pub(super) type Values = Vec<(u64, f64)>;

/// The values of a figure in each of so many groups; `group` finds that of a run's number.
pub(super) fn values(
    figure: &Figure,
    groups: usize,
    group: impl Fn(usize) -> usize,
) -> Vec<Values> {
    let mut values = vec![Values::new(); groups];
    for (run, value) in &figure.values {
        values[group(run.index as usize)].push((run.seed, *value));
    }
    values
}

/// Mean and its 95 % interval, which is over the seeds where there are several; one value has none. That of a share is
/// Wilson's, which keeps to 0 to 1 by itself. Student's t of a mean knows no bounds: it is cut to what the figure can be,
/// so that no count or time is written below 0. This leaves out only what the mean cannot be: the interval holds it as
/// often as before.
pub(super) fn estimate(figure: &Figure, values: &[(u64, f64)]) -> Option<(f64, Option<[f64; 2]>)> {
    let mut by_seed: BTreeMap<u64, (f64, f64)> = BTreeMap::new();
    for (seed, value) in values {
        let (sum, count) = by_seed.entry(*seed).or_default();
        (*sum, *count) = (*sum + value, *count + 1.0);
    }
    let samples: Vec<f64> = match figure.seeds {
        false => values.iter().map(|(_, value)| *value).collect(),
        true => by_seed.values().map(|(sum, count)| sum / count).collect(),
    };
    let mean = Mean::of(&samples);
    let middle = mean.mean?;
    let interval = match figure.share {
        // However the runs of a seed depend on each other, they say no less than one of them.
        true => Some(wilson_95(middle, samples.len() as f64)),
        false => mean.half_95.map(|half| {
            let [least, most] = figure.range;
            [(middle - half).max(least), (middle + half).min(most)]
        }),
    };
    Some((middle, interval))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_over_the_seeds() {
        let figure = |share, seeds| Figure {
            name: String::new(),
            share,
            seeds,
            range: [f64::NEG_INFINITY, f64::INFINITY],
            values: Vec::new(),
        };
        let estimate = |share, values: &[(u64, f64)]| estimate(&figure(share, true), values);
        // Two points a seed, which differ by the point alone: 1 and 3, 2 and 4, 3 and 5.
        let values = [(1, 1.0), (1, 3.0), (2, 2.0), (2, 4.0), (3, 3.0), (3, 5.0)];
        let (mean, interval) = estimate(false, &values).unwrap();
        // Means 2, 3, 4 of three seeds: 4.3027 / √3.
        let half = 4.302_653 / 3f64.sqrt();
        let [low, high] = interval.unwrap();
        assert_eq!(mean, 3.0);
        assert!((high - 3.0 - half).abs() < 1e-5 && (3.0 - low - half).abs() < 1e-5);
        // One seed: over its runs. One value: none.
        let (mean, interval) = super::estimate(&figure(false, false), &values).unwrap();
        // s = √2, t = 2.5706.
        let half = 2.570_582 * (2.0f64 / 6.0).sqrt();
        assert!((interval.unwrap()[1] - mean - half).abs() < 1e-5);
        assert_eq!(estimate(false, &values[..1]), Some((1.0, None)));
        assert_eq!(estimate(false, &[]), None);
        // Two of three seeds won at both points are no more than two of three.
        let won = [(1, 1.0), (1, 1.0), (2, 1.0), (2, 1.0), (3, 0.0), (3, 0.0)];
        let (share, interval) = estimate(true, &won).unwrap();
        assert_eq!(
            (share, interval),
            (2.0 / 3.0, Some(wilson_95(2.0 / 3.0, 3.0)))
        );
    }

    #[test]
    fn intervals_keep_to_what_a_figure_can_be() {
        let of = |range: [f64; 2], values: &[f64]| {
            let figure = Figure {
                name: String::new(),
                share: false,
                seeds: true,
                range,
                values: Vec::new(),
            };
            let values: Vec<(u64, f64)> = (0..).zip(values.iter().copied()).collect();
            estimate(&figure, &values).unwrap()
        };
        // Leakers of three seeds: 1 ± 4.3027 by Student's t.
        let (mean, interval) = of([0.0, f64::INFINITY], &[0.0, 0.0, 3.0]);
        let [low, high] = interval.unwrap();
        assert!(mean == 1.0 && low == 0.0 && (high - 5.302_653).abs() < 1e-5);
        // Scores from 0 to 1, at both ends.
        let (_, interval) = of([0.0, 1.0], &[0.1, 0.9, 0.8]);
        assert_eq!(interval, Some([0.0, 1.0]));
        // What can be negative is not cut.
        let (_, interval) = of([f64::NEG_INFINITY, f64::INFINITY], &[0.0, 0.0, 3.0]);
        assert!((interval.unwrap()[0] + 3.302_653).abs() < 1e-5);
        // Nor is what lies far from its bounds.
        let (_, interval) = of([0.0, f64::INFINITY], &[9.0, 10.0, 11.0]);
        let half = 4.302_653 / 3f64.sqrt();
        assert!((interval.unwrap()[0] - 10.0 + half).abs() < 1e-5);
    }

    #[test]
    fn counts_are_whole_and_shares_are_not() {
        let run = PlannedRun {
            index: 0,
            settings: Vec::new(),
            seed: 1,
        };
        let scale = |share: bool, values: &[f64]| {
            let figure = Figure {
                name: String::new(),
                share,
                seeds: true,
                range: [0.0, 1.0],
                values: values.iter().map(|value| (&run, *value)).collect(),
            };
            figure.scale()
        };
        assert_eq!(scale(false, &[0.0, 3.0, 1.0]), Scale::Whole);
        assert_eq!(scale(false, &[0.0, 3.5, 1.0]), Scale::Linear);
        assert_eq!(scale(true, &[0.0, 1.0]), Scale::Linear);
    }
}
