//! Checks of what types cannot say: ranges, and values that contradict each other.

use std::ops::RangeInclusive;

use super::text::{join, related};

/// Longest run, and latest order in it [s].
pub(super) const MAX_DURATION_S: f64 = 86_400.0;
/// Rates of the simulation clock [Hz].
pub(super) const TICK_HZ: RangeInclusive<f64> = 1.0..=100_000.0;
/// From 0 on.
pub const AT_LEAST_ZERO: RangeInclusive<f64> = 0.0..=f64::MAX;
/// A share or a chance.
pub const FRACTION: RangeInclusive<f64> = 0.0..=1.0;
/// Azimuths [deg].
pub(super) const TURN: RangeInclusive<f64> = -360.0..=360.0;
/// Elevations [deg].
pub(super) const ELEVATION: RangeInclusive<f64> = -90.0..=90.0;

/// A value that cannot stay as it is.
pub(super) struct Problem {
    /// Its dotted path.
    pub(super) path: String,
    /// Path of the value that it contradicts.
    pub(super) with: Option<&'static str>,
    /// What was found and what would be right.
    pub(super) message: String,
}

/// Goes through the values of a document and keeps every problem, of one value the first. Keys are those of the table
/// that [`Check::table`] has entered.
#[derive(Default)]
pub struct Check {
    /// Path of the table that is being checked.
    table: String,
    problems: Vec<Problem>,
}

impl Check {
    pub(super) fn into_problems(self) -> Vec<Problem> {
        self.problems
    }

    /// Whether a value whose path begins so has a problem.
    pub(super) fn found_in(&self, path: &str) -> bool {
        self.problems
            .iter()
            .any(|known| known.path.starts_with(path))
    }

    /// Checks the table `key` of the present one.
    pub fn table(&mut self, key: &str, check: impl FnOnce(&mut Self)) {
        let len = self.table.len();
        join(&mut self.table, key);
        check(self);
        self.table.truncate(len);
    }

    /// Keeps a problem of the value `key`, or of the present table itself if `key` is empty, unless
    /// one was found there, around it or inside it before: it may follow from that.
    fn keep(&mut self, key: &str, with: Option<&'static str>, message: String) {
        let mut path = self.table.clone();
        if !key.is_empty() {
            join(&mut path, key);
        }
        let told = |known: &Problem| {
            related(&known.path, &path) || with.is_some_and(|with| related(&known.path, with))
        };
        if !self.problems.iter().any(told) {
            self.problems.push(Problem {
                path,
                with,
                message,
            });
        }
    }

    /// The value `key` must be right; `message` says what it is and what would be right.
    pub fn that(&mut self, ok: bool, key: &str, message: impl FnOnce() -> String) {
        if !ok {
            self.keep(key, None, message());
        }
    }

    /// The value `key` must agree with another, whose whole path `with` is: an error of that one is told in its place.
    pub fn agrees(
        &mut self,
        ok: bool,
        (key, with): (&str, &'static str),
        message: impl FnOnce() -> String,
    ) {
        if !ok {
            self.keep(key, Some(with), message());
        }
    }

    /// A value must lie in a range.
    pub fn within(&mut self, key: &str, value: f64, range: RangeInclusive<f64>) {
        self.that(range.contains(&value), key, || {
            let (low, high) = (range.start(), range.end());
            match *high {
                f64::MAX => format!("found {value}, must be at least {low}"),
                _ => format!("found {value}, must be from {low} to {high}"),
            }
        });
    }

    /// A value that is given must lie in a range.
    pub fn maybe_within(&mut self, key: &str, value: Option<f64>, range: RangeInclusive<f64>) {
        if let Some(value) = value {
            self.within(key, value, range);
        }
    }

    /// A value must be above 0.
    pub fn positive(&mut self, key: &str, value: f64) {
        self.that(value > 0.0, key, || {
            format!("found {value}, must be above 0")
        });
    }

    /// Two limits must lie in a range, the first below the second.
    pub fn ascending(&mut self, key: &str, [from, to]: [f64; 2], range: RangeInclusive<f64>) {
        self.both_within(key, [from, to], range);
        self.that(from < to, key, || {
            format!("found [{from}, {to}], the first must be below the second")
        });
    }

    /// Two limits must lie in a range, the first not above the second.
    pub fn not_descending(&mut self, key: &str, [from, to]: [f64; 2], range: RangeInclusive<f64>) {
        self.both_within(key, [from, to], range);
        self.that(from <= to, key, || {
            format!("found [{from}, {to}], the first must not be above the second")
        });
    }

    fn both_within(&mut self, key: &str, [from, to]: [f64; 2], range: RangeInclusive<f64>) {
        self.within(&format!("{key}[0]"), from, range.clone());
        self.within(&format!("{key}[1]"), to, range);
    }

    /// A name must not be empty, nor one of the `earlier` ones.
    pub(super) fn name(&mut self, key: &str, name: &str, earlier: &[&str]) {
        self.that(!name.trim().is_empty(), key, || {
            "must not be empty".to_owned()
        });
        self.that(!earlier.contains(&name), key, || {
            format!("the name '{name}' is taken by an earlier one - give each its own")
        });
    }

    /// A rate must divide the scenario's tick rate.
    pub(super) fn rate(&mut self, key: &str, rate_hz: u32, tick_hz: u32) {
        let divides = |rate: u32| rate > 0 && tick_hz.is_multiple_of(rate);
        // An absurd tick rate has an error of its own.
        if divides(rate_hz) || !TICK_HZ.contains(&tick_hz.into()) {
            return;
        }
        let nearest = (1..=tick_hz)
            .filter(|rate| divides(*rate))
            .min_by_key(|rate| rate.abs_diff(rate_hz))
            .unwrap_or(1);
        let message = format!(
            "{rate_hz} Hz does not divide tick_hz = {tick_hz} - the nearest rate that does is \
             {nearest} Hz"
        );
        self.keep(key, Some("tick_hz"), message);
    }
}
