//! How what is said goes on over time.

use super::super::{LookRow, Noise};
use std::collections::BTreeMap;

/// Spans between the two of a pair [s]: before the middle parts of [`Noise`] change, after the first has, and after both.
const SPANS_S: [[f64; 2]; 3] = [[1e-6, 0.1], [0.5, 0.8], [4.0, 6.0]]; // [s]
/// So many pairs that are half as much alike as those of the span before are taken as known beside the data.
const PAIRS_KNOWN: f64 = 20.0;
/// What is farther from the mean than this counts as no farther, in standard deviations: a box on a neighbour is no noise.
const FARTHEST: f64 = 3.0;

/// How noise goes on, of residuals of things at times [s].
pub(super) fn parts<K: Ord>(mut residuals: Vec<(K, f64, f64)>) -> Noise {
    let count = residuals.len().max(1) as f64;
    let mean = residuals.iter().map(|(.., value)| value).sum::<f64>() / count;
    let squares: f64 = residuals
        .iter()
        .map(|(.., value)| (value - mean).powi(2))
        .sum();
    let sigma = (squares / count).sqrt().max(1e-6);
    // A box on a neighbour is no noise.
    for (.., value) in &mut residuals {
        *value = ((*value - mean) / sigma).clamp(-FARTHEST, FARTHEST);
    }
    let squares: f64 = residuals.iter().map(|(.., value)| value * value).sum();
    let variance = (squares / count).max(1e-6);
    goes_on(residuals, |a, b| a * b / variance)
}

/// How names go on: how often they are the same again, beyond chance.
pub(super) fn naming(looks: &[(usize, &LookRow)]) -> Noise {
    let named: Vec<_> = (looks.iter())
        .filter_map(|(run, look)| {
            let key = (*run, look.thing, look.appearance.tier);
            Some((key, look.t_s, look.found.as_ref()?.name.as_str()))
        })
        .collect();
    let mut shares: BTreeMap<&str, f64> = BTreeMap::new();
    for (.., name) in &named {
        *shares.entry(name).or_default() += 1.0 / named.len() as f64;
    }
    let chance: f64 = shares.values().map(|share| share * share).sum();
    let beyond = (1.0 - chance).max(1e-6);
    goes_on(named, |a, b| {
        (f64::from(u8::from(a == b)) - chance) / beyond
    })
}

/// How values of things at times [s] go on, by how much alike two of them are: 1 for what is the same, 0 by chance.
fn goes_on<K: Ord, V>(values: Vec<(K, f64, V)>, alike: impl Fn(&V, &V) -> f64) -> Noise {
    let mut series: BTreeMap<K, Vec<(f64, V)>> = BTreeMap::new();
    for (key, t_s, value) in values {
        series.entry(key).or_default().push((t_s, value));
    }
    let mut sums = [(0.0, 0.0); 3];
    for values in series.values_mut() {
        values.sort_by(|a, b| a.0.total_cmp(&b.0));
        // A pair after each value is enough.
        for (index, (t_s, value)) in values.iter().enumerate() {
            for ([least_s, most_s], sums) in SPANS_S.iter().zip(&mut sums) {
                let later =
                    values[index..].partition_point(|(later_s, _)| later_s - t_s < *least_s);
                let pair = values
                    .get(index + later)
                    .filter(|(later_s, _)| later_s - t_s < *most_s);
                if let Some((_, other)) = pair {
                    sums.0 += alike(value, other);
                    sums.1 += 1.0;
                }
            }
        }
    }
    // Each part less than the one before; of few pairs half of it.
    let mut before = 1.0;
    let [next, half, long] = sums.map(|(sum, count)| {
        let alike: f64 = (sum + PAIRS_KNOWN * 0.5 * before) / (count + PAIRS_KNOWN);
        before = alike.clamp(0.0, before);
        before
    });
    Noise {
        frame: 1.0 - next,
        changing: [next - half, half - long],
        lasting: long,
    }
}
