//! Rates with intervals, root mean squares, and what became of a lock.

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
    /// The rate of `successes` in `trials` (Wilson, J. Am. Stat. Assoc. 22 (1927) 209).
    pub fn of(successes: usize, trials: usize) -> Self {
        let rate = (trials > 0).then(|| successes as f64 / trials as f64);
        let interval_95 = rate.map_or([0.0, 1.0], |p| {
            let n = trials as f64;
            let z2 = Z95 * Z95;
            let centre = p + z2 / (2.0 * n);
            let half = Z95 * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt();
            // At a rate of 0 or 1 the bound is exact but for rounding.
            [centre - half, centre + half].map(|x| (x / (1.0 + z2 / n)).clamp(0.0, 1.0))
        });
        Self {
            successes,
            trials,
            rate,
            interval_95,
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
    /// The mean of samples. The quantile of Student's t is its expansion about the normal one (Abramowitz and
    /// Stegun, 1964, 26.7.5, three terms), good to 0.2 % from five samples on.
    pub fn of(samples: &[f64]) -> Self {
        let n = samples.len();
        let mean = (n > 0).then(|| samples.iter().sum::<f64>() / n as f64);
        let half_95 = mean.filter(|_| n > 1).map(|mean| {
            let free = (n - 1) as f64;
            let variance = samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / free;
            let z = Z95;
            let t = z
                + (z.powi(3) + z) / (4.0 * free)
                + (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * free * free);
            t * (variance / n as f64).sqrt()
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

/// Sum of squares and largest value of an error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Samples.
    pub n: u64,
    /// Sum of the squares.
    pub square: f64,
    /// Largest value.
    pub peak: f64,
}

impl Sums {
    /// Adds a sample.
    pub fn push(&mut self, value: f64) {
        self.n += 1;
        self.square += value * value;
        self.peak = self.peak.max(value);
    }

    /// Adds the samples of another.
    pub fn merge(&mut self, other: &Self) {
        self.n += other.n;
        self.square += other.square;
        self.peak = self.peak.max(other.peak);
    }

    /// Root mean square, if there are samples.
    pub fn rms(&self) -> Option<f64> {
        (self.n > 0).then(|| (self.square / self.n as f64).sqrt())
    }
}

/// What the tracker holds at one instant, by truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hold {
    /// Time [s].
    pub t_s: f64,
    /// Whether the tracker claims a target: it coarse-tracks, precise-tracks or engages.
    pub held: bool,
    /// The UAV on the claimed line of sight, if there is one.
    pub on: Option<usize>,
}

/// What became of the first lock of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Lock {
    /// The UAV locked first, by its index in the scenario; absent if none ever was.
    pub first_uav: Option<usize>,
    /// When that was [s].
    pub locked_s: Option<f64>,
    /// Whether the lock was lost: the tracker went over to something else, or did not hold that
    /// UAV at the end of the run.
    pub lost: bool,
    /// How often the tracker went over from one thing to another.
    pub switches: u32,
    /// Time for which something else than that UAV was held [s].
    pub false_lock_s: f64,
}

/// Something is held once the tracker has been on it this long without a break [s]: two UAVs that
/// cross in the image are one for a few frames.
pub const DWELL_S: f64 = 0.25;

/// Follows a lock through a run; `holds` in order of time.
pub fn lock(holds: &[Hold]) -> Lock {
    let mut lock = Lock::default();
    let mut attached: Option<Option<usize>> = None;
    // What the tracker has been on of late, since when, and when that was last seen.
    let mut candidate: Option<(Option<usize>, f64, f64)> = None;
    for hold in holds {
        if !hold.held {
            candidate = None;
            continue;
        }
        let (since_s, before_s) = match candidate {
            Some((on, since_s, before_s)) if on == hold.on => (since_s, before_s),
            _ => (hold.t_s, hold.t_s),
        };
        candidate = Some((hold.on, since_s, hold.t_s));
        let stretch_s = hold.t_s - since_s;
        if stretch_s < DWELL_S {
            continue;
        }
        // The stretch counts from its start once it has proved to be one.
        let step_s = if before_s - since_s < DWELL_S {
            stretch_s
        } else {
            hold.t_s - before_s
        };
        if lock.first_uav.is_none() && hold.on.is_some() {
            lock.first_uav = hold.on;
            lock.locked_s = Some(since_s);
        } else if lock.first_uav.is_some() && attached.is_some_and(|on| on != hold.on) {
            lock.switches += 1;
        }
        attached = Some(hold.on);
        if hold.on.is_none() || hold.on != lock.first_uav {
            lock.false_lock_s += step_s;
            lock.lost |= lock.first_uav.is_some();
        }
    }
    let holds_first =
        holds.last().is_some_and(|last| last.held) && attached.flatten() == lock.first_uav;
    lock.lost |= lock.first_uav.is_some() && !holds_first;
    lock
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn rms_and_peak() {
        let mut sums = Sums::default();
        assert_eq!(sums.rms(), None);
        [3.0, 4.0].into_iter().for_each(|x| sums.push(x));
        assert!((sums.rms().unwrap() - 12.5f64.sqrt()).abs() < 1e-15);
        assert_eq!(sums.peak, 4.0);
    }

    /// Samples at 60 Hz of pieces (seconds, held, on).
    fn series(pieces: &[(f64, bool, Option<usize>)]) -> Vec<Hold> {
        let mut holds: Vec<Hold> = Vec::new();
        for &(seconds, held, on) in pieces {
            for _ in 0..(60.0 * seconds) as usize {
                holds.push(Hold {
                    t_s: holds.len() as f64 / 60.0,
                    held,
                    on,
                });
            }
        }
        holds
    }

    #[test]
    fn a_lock_survives_crossings_and_gaps() {
        let kept = lock(&series(&[
            (1.0, false, None),
            (4.0, true, Some(1)),
            (0.1, true, Some(0)),
            (2.0, true, Some(1)),
            (1.0, false, None),
            (1.0, true, Some(1)),
        ]));
        assert_eq!(kept.first_uav, Some(1));
        assert!((kept.locked_s.unwrap() - 1.0).abs() < 1e-9);
        assert!(!kept.lost && kept.switches == 0);
        assert_eq!(kept.false_lock_s, 0.0);
    }

    #[test]
    fn a_lock_is_lost_to_another_to_nothing_and_at_the_end() {
        let other = lock(&series(&[(2.0, true, Some(0)), (3.0, true, Some(1))]));
        assert!(other.lost && other.switches == 1);
        assert!((other.false_lock_s - 3.0).abs() < 0.02, "{other:?}");
        // Back again: still lost once, two switches.
        let back = lock(&series(&[
            (2.0, true, Some(0)),
            (1.0, true, None),
            (2.0, true, Some(0)),
        ]));
        assert!(back.lost && back.switches == 2);
        assert!((back.false_lock_s - 1.0).abs() < 0.02, "{back:?}");
        let end = lock(&series(&[(2.0, true, Some(0)), (1.0, false, None)]));
        assert!(end.lost && end.switches == 0 && end.false_lock_s == 0.0);
        // A decoy before anything else is no lost lock, but a false one for its time.
        let decoy = lock(&series(&[(2.0, true, None), (2.0, true, Some(0))]));
        assert!(!decoy.lost && decoy.switches == 0, "{decoy:?}");
        assert!((decoy.false_lock_s - 2.0).abs() < 0.02);
        assert_eq!(lock(&series(&[(2.0, true, None)])).first_uav, None);
    }

    #[test]
    fn a_mean_has_students_interval() {
        // Twenty numbers 1 to 20: s = 5.916, t = 2.0930 for 19 degrees of freedom.
        let samples: Vec<f64> = (1..=20).map(f64::from).collect();
        let mean = Mean::of(&samples);
        assert_eq!(mean.mean, Some(10.5));
        assert!((mean.half_95.unwrap() - 2.769).abs() < 2e-3, "{mean:?}");
        assert_eq!(mean.text(), "10.5 ± 2.8");
        assert_eq!(
            (Mean::of(&[]).text(), Mean::of(&[2.0]).text()),
            ("–".into(), "2.0".into())
        );
    }
}
