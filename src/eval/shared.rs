//! What the evaluations share: limits of their arguments, progress, and when a track counts as confirmed.

use super::EvalError;
use crate::models::tracking::table::Track;
use crate::parallel;
use crate::stop;
use std::io::Write as _;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Refuses a number that is not from `low` to `high`.
pub(crate) fn within(
    argument: &'static str,
    value: f64,
    low: f64,
    high: f64,
) -> Result<(), EvalError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(EvalError::OutOfRange {
        argument,
        value,
        low,
        high,
    })
}

/// Refuses a share, where one is given, that is not from 0 to 1.
pub(crate) fn within_share(argument: &'static str, value: Option<f64>) -> Result<(), EvalError> {
    value.map_or(Ok(()), |value| within(argument, value, 0.0, 1.0))
}

/// One line on standard error; a closed pipe is no error.
pub(crate) fn progress(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// As [`parallel::in_parallel`], and says how far it has come.
pub(crate) fn in_parallel<J: Sync, T: Send>(
    label: &str,
    jobs: &[J],
    threads: usize,
    work: impl Fn(&J) -> Result<T, EvalError> + Sync,
) -> Result<Vec<T>, EvalError> {
    const OFTEN: usize = 20;
    let done = AtomicUsize::new(0);
    parallel::in_parallel(jobs, threads, |job| {
        let result = work(job);
        // What was stopped midway is no result.
        if stop::asked().is_some() {
            return Err(EvalError::Stopped);
        }
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        if done.is_multiple_of(OFTEN) || done == jobs.len() || threads == 1 {
            progress(&format!("{label}: {done} of {} runs", jobs.len()));
        }
        result
    })
}

/// A track is confirmed from this many hits on, and while the last one is this fresh [s].
const CONFIRMED_HITS: u32 = 6;
/// Longest time since the last hit of a track that counts as seen [s].
pub(crate) const FRESH_S: f64 = 0.25;

/// Whether a track was seen often enough, and lately at `t_s`.
pub(crate) fn seen(track: &Track, t_s: f64) -> bool {
    track.total_hits() >= CONFIRMED_HITS && track.filter.coast_s(t_s) < FRESH_S
}

/// Whether a track is confirmed at `t_s`.
pub(crate) fn confirmed(track: &Track, t_s: f64) -> bool {
    seen(track, t_s) && track.log_odds() > 0.0
}
