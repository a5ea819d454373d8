//! Rates and means with intervals.

use serde::Serialize;

/// Normal quantile of a two-sided 95 % interval.
const Z95: f64 = 1.959_964;

/// A success rate with its 95 % Wilson score interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Rate {
    /// Successes.
    pub successes: usize,
    /// Trials.
    pub trials: usize,
    /// Successes over trials; absent without trials.
    pub rate: Option<f64>,
    /// Lower and upper bound.
    pub interval_95: [f64; 2],
}

impl Rate {
    /// The rate of `successes` in `trials`.
    pub fn of(successes: usize, trials: usize) -> Self {
        let rate = (trials > 0).then(|| successes as f64 / trials as f64);
        Self {
            successes,
            trials,
            rate,
            interval_95: rate.map_or([0.0, 1.0], |rate| wilson_95(rate, trials as f64)),
        }
    }

    /// The share of trials that succeeded.
    pub fn count(trials: impl IntoIterator<Item = bool>) -> Self {
        let (successes, n) = trials
            .into_iter()
            .fold((0, 0), |(k, n), yes| (k + usize::from(yes), n + 1));
        Self::of(successes, n)
    }

    /// The rate as a sentence has it, such as `3 of 20 (5–36 %)`.
    pub fn text(&self) -> String {
        let [low, high] = self.interval_95.map(|x| 100.0 * x);
        format!(
            "{} of {} ({low:.0}–{high:.0} %)",
            self.successes, self.trials
        )
    }
}

/// How a share of the same trials differs between two ways of making them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Paired {
    /// Trials that count for both.
    pub trials: usize,
    /// Successes of the first way alone, and of the second alone.
    pub only: [usize; 2],
    /// Share of the second less that of the first; absent without trials.
    pub difference: Option<f64>,
    /// Its 95 % interval.
    pub interval_95: [f64; 2],
    /// Chance of as uneven a split of the trials in which they differ, if neither way is better (two-sided exact test of
    /// McNemar, Psychometrika 12 (1947) 153).
    pub p: f64,
}

impl Paired {
    /// Of pairs of outcomes of the first and the second way. The interval is that of A. Agresti and Y. Min, Stat. Med. 24 (2005)
    /// 729: Wald's after half a trial is added to each of the four cells.
    pub fn of(pairs: impl IntoIterator<Item = [bool; 2]>) -> Self {
        let (mut trials, mut only) = (0, [0; 2]);
        for pair in pairs {
            trials += 1;
            match pair {
                [true, false] => only[0] += 1,
                [false, true] => only[1] += 1,
                _ => {}
            }
        }
        let [first, second] = only.map(|count| count as f64);
        let more = trials as f64 + 2.0;
        let middle = (second - first) / more;
        let spread = (first + second + 1.0 - (second - first).powi(2) / more).sqrt() / more;
        let half = Z95 * spread;
        Self {
            trials,
            only,
            difference: (trials > 0).then(|| (second - first) / trials as f64),
            interval_95: [middle - half, middle + half].map(|x| x.clamp(-1.0, 1.0)),
            p: even_split(only[0].min(only[1]), only[0] + only[1]),
        }
    }

    /// Whether the second way does better or worse than the first beyond chance, at 5 %.
    pub fn tells(&self) -> bool {
        self.p < 0.05
    }
}

/// Chance that of so many fair coins one side shows up at most `least` times, whichever it is.
fn even_split(least: usize, coins: usize) -> f64 {
    let mut term = 0.5_f64.powi(coins as i32);
    let mut sum = 0.0;
    for count in 0..=least {
        sum += term;
        term *= (coins - count) as f64 / (count as f64 + 1.0);
    }
    f64::min(2.0 * sum, 1.0)
}

/// The 95 % score interval of a rate in so many trials (Wilson, J. Am. Stat. Assoc. 22 (1927) 209).
pub fn wilson_95(rate: f64, trials: f64) -> [f64; 2] {
    let (p, n) = (rate, trials);
    let z2 = Z95 * Z95;
    let centre = p + z2 / (2.0 * n);
    let half = Z95 * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt();
    // At a rate of 0 or 1 the bound is exact but for rounding.
    [centre - half, centre + half].map(|x| (x / (1.0 + z2 / n)).clamp(0.0, 1.0))
}

/// Least share that `successes` in `trials` show with a confidence from 0 to 1: the one-sided lower limit of
/// Clopper and Pearson (Biometrika 26 (1934) 404), below which so many successes or more have a chance of at most
/// 1 − confidence. By bisection, to 1e-12.
pub fn least_share(successes: usize, trials: usize, confidence: f64) -> f64 {
    if successes == 0 || trials == 0 {
        return 0.0;
    }
    let n = trials as f64;
    // Logarithms of the binomial coefficients from `successes` to `trials`.
    let mut ln_choose: f64 = (0..successes)
        .map(|k| ((n - k as f64) / (k as f64 + 1.0)).ln())
        .sum();
    let mut terms = vec![ln_choose];
    for k in successes..trials {
        ln_choose += ((n - k as f64) / (k as f64 + 1.0)).ln();
        terms.push(ln_choose);
    }
    let chance = |p: f64| -> f64 {
        let term = |(more, ln_choose): (usize, &f64)| {
            let k = (successes + more) as f64;
            let misses = n - k;
            let ln_misses = if misses > 0.0 {
                misses * (-p).ln_1p()
            } else {
                0.0
            };
            (ln_choose + k * p.ln() + ln_misses).exp()
        };
        terms.iter().enumerate().map(term).sum()
    };
    let (mut low, mut high) = (0.0, 1.0);
    while high - low > 1e-12 {
        let middle = 0.5 * (low + high);
        if chance(middle) > 1.0 - confidence {
            high = middle;
        } else {
            low = middle;
        }
    }
    low
}

/// Quantile of a two-sided 95 % interval by Student's t with so many degrees of freedom, at least 1. Up to 200 by
/// bisection of the finite sums of Abramowitz and Stegun (1964), 26.7.3 and 26.7.4, to 1e-12 of the angle; above by their
/// expansion about the normal quantile, 26.7.5, three terms, which is off by less than 1e-6 there.
fn students_t95(free: usize) -> f64 {
    const MOST_SUMMED: usize = 200;
    let n = free as f64;
    if free > MOST_SUMMED {
        let z = Z95;
        return z
            + (z.powi(3) + z) / (4.0 * n)
            + (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * n * n);
    }
    // The chance of |t| up to √n tan θ.
    let chance = |theta: f64| {
        let (sin, cos) = theta.sin_cos();
        let odd = free % 2;
        let mut term = if odd == 1 { cos } else { 1.0 };
        let mut sum = term;
        for power in (odd..).step_by(2).take_while(|power| power + 4 <= free) {
            let k = power as f64;
            term *= cos * cos * (k + 1.0) / (k + 2.0);
            sum += term;
        }
        match free {
            1 => theta * std::f64::consts::FRAC_2_PI,
            _ if odd == 1 => (theta + sin * sum) * std::f64::consts::FRAC_2_PI,
            _ => sin * sum,
        }
    };
    let (mut low, mut high) = (0.0, std::f64::consts::FRAC_PI_2);
    while high - low > 1e-12 {
        let middle = 0.5 * (low + high);
        if chance(middle) < 0.95 {
            low = middle;
        } else {
            high = middle;
        }
    }
    n.sqrt() * (0.5 * (low + high)).tan()
}

/// A mean with its 95 % interval by Student's t.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Mean {
    /// The mean; absent without samples.
    pub mean: Option<f64>,
    /// Half the width of the interval; absent below two samples.
    pub half_95: Option<f64>,
    /// Number of samples.
    pub n: usize,
}

impl Mean {
    /// The mean of samples.
    pub fn of(samples: &[f64]) -> Self {
        let n = samples.len();
        let mean = (n > 0).then(|| samples.iter().sum::<f64>() / n as f64);
        let half_95 = mean.filter(|_| n > 1).map(|mean| {
            let free = n - 1;
            let variance = samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / free as f64;
            students_t95(free) * (variance / n as f64).sqrt()
        });
        Self { mean, half_95, n }
    }

    /// The mean as a table has it, such as `3.2 ± 0.4`.
    pub fn text(&self) -> String {
        match (self.mean, self.half_95) {
            (Some(mean), Some(half)) => format!("{mean:.1} ± {half:.1}"),
            (Some(mean), None) => format!("{mean:.1}"),
            _ => "–".into(),
        }
    }
}

/// Overlapping Allan deviation of samples over `m` of them, in their unit (IEEE Std 952-1997, annex C); `None`
/// of fewer than `2m + 1` samples, or of none at a time.
pub fn allan_deviation(samples: &[f64], m: usize) -> Option<f64> {
    if m == 0 || samples.len() <= 2 * m {
        return None;
    }
    let mut sums = vec![0.0];
    let mut sum = 0.0;
    for sample in samples {
        sum += sample;
        sums.push(sum);
    }
    let steps = sums.windows(2 * m + 1);
    let count = steps.len() as f64;
    let squares = steps.map(|w| (w[2 * m] - 2.0 * w[m] + w[0]).powi(2));
    Some((squares.sum::<f64>() / (2.0 * count)).sqrt() / m as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_that_agree_tell_nothing() {
        let pairs = |both: usize, first: usize, second: usize| {
            let of = |pair: [bool; 2], count: usize| std::iter::repeat_n(pair, count);
            Paired::of(
                of([true, true], both)
                    .chain(of([true, false], first))
                    .chain(of([false, true], second)),
            )
        };
        let same = pairs(98, 0, 0);
        assert_eq!((same.difference, same.p), (Some(0.0), 1.0));
        // 1.96 / 100.
        assert!((same.interval_95[1] - 0.0196).abs() < 1e-4, "{same:?}");
        // 2 · (1 + 10 + 45) / 1024 of ten coins.
        let worse = pairs(40, 8, 2);
        assert!((worse.p - 0.109_375).abs() < 1e-12, "{worse:?}");
        assert_eq!(worse.difference, Some(-0.12));
        assert!(!worse.tells() && pairs(40, 10, 1).tells());
        // Nothing is known of nothing.
        assert_eq!(Paired::of([]).difference, None);
        assert!(Paired::of([]).interval_95[0] < -0.9);
    }

    #[test]
    fn wilson_intervals_match_newcombe() {
        // Newcombe, Statistics in Medicine 17 (1998) 857, table I, method 3.
        for (k, n, low, high) in [
            (81, 263, 0.2553, 0.3662),
            (15, 148, 0.0624, 0.1605),
            (0, 20, 0.0, 0.1611),
            (1, 29, 0.0061, 0.1718),
        ] {
            let [a, b] = Rate::of(k, n).interval_95;
            assert!(
                (a - low).abs() < 6e-5 && (b - high).abs() < 6e-5,
                "{k}/{n}: {a} {b}"
            );
        }
        assert_eq!(Rate::of(0, 0).rate, None);
    }

    #[test]
    fn the_least_share_is_clopper_and_pearsons() {
        // One-sided limits of an exact binomial test.
        for (successes, trials, confidence, wanted) in [
            (20, 20, 0.95, 0.05f64.powf(1.0 / 20.0)),
            (19, 20, 0.95, 0.783_894_3),
            (18, 20, 0.95, 0.717_381_5),
            (0, 20, 0.95, 0.0),
            (50, 100, 0.99, 0.380_717_5),
        ] {
            let found = least_share(successes, trials, confidence);
            assert!(
                (found - wanted).abs() < 1e-6,
                "{successes} of {trials}: {found}"
            );
        }
    }

    #[test]
    fn a_mean_has_students_interval() {
        // Fisher and Yates, Statistical Tables, table III, and NIST's handbook, 1.3.6.7.2.
        for (free, t) in [
            (1, 12.7062),
            (2, 4.3027),
            (3, 3.1824),
            (4, 2.7764),
            (5, 2.5706),
            (9, 2.2622),
            (10, 2.2281),
            (30, 2.0423),
            (100, 1.9840),
            (200, 1.9719),
            (201, 1.9718),
            (1000, 1.9623),
        ] {
            let found = students_t95(free);
            assert!((found - t).abs() < 6e-5, "{free}: {found}");
        }
        // Twenty numbers 1 to 20: s = 5.916, t = 2.0930 for 19 degrees of freedom.
        let samples: Vec<f64> = (1..=20).map(f64::from).collect();
        let mean = Mean::of(&samples);
        assert_eq!(mean.mean, Some(10.5));
        assert!((mean.half_95.unwrap() - 2.768_81).abs() < 1e-5, "{mean:?}");
        assert_eq!(mean.text(), "10.5 ± 2.8");
        assert_eq!(
            (Mean::of(&[]).text(), Mean::of(&[2.0]).text()),
            ("–".into(), "2.0".into())
        );
    }

    #[test]
    fn allan_deviation_of_a_ramp_is_its_rise_over_root_two() {
        // Means of neighbouring spans of m lie m steps apart.
        let ramp: Vec<f64> = (0..100).map(|k| 0.5 * f64::from(k)).collect();
        for m in [1, 7, 40] {
            let expected = 0.5 * m as f64 / 2f64.sqrt();
            assert!((allan_deviation(&ramp, m).unwrap() - expected).abs() < 1e-9);
        }
        assert_eq!(allan_deviation(&ramp, 50), None);
        assert_eq!(allan_deviation(&ramp, 0), None);
    }
}
