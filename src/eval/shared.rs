//! What the evaluations share: words of their commands, limits of their arguments, files, progress, and
//! when a track counts as confirmed.

use super::EvalError;
use crate::models::tracking::table::Track;
use crate::output::{self, OutputError};
use serde::Serialize;
use std::io::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// A word of a command line, quoted where a shell would read it otherwise.
pub(crate) fn quoted(word: impl std::fmt::Display) -> String {
    let word = word.to_string();
    let plain = |c: char| c.is_alphanumeric() || "/._-+,:=@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

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

/// Threads of a model: `wanted`, or one a core.
pub(crate) fn threads(wanted: Option<NonZeroUsize>) -> usize {
    let cores = || std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
    wanted.unwrap_or_else(cores).get()
}

/// One line on standard error; a closed pipe is no error.
pub(crate) fn progress(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Writes a file and the folders above it.
pub(crate) fn put(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), OutputError> {
    if let Some(folder) = path.parent() {
        output::create_dir(folder)?;
    }
    output::write(path, bytes)
}

/// Writes what was measured as JSON.
pub(crate) fn put_json(path: &Path, value: &impl Serialize) -> Result<(), EvalError> {
    let text = serde_json::to_string_pretty(value).map_err(|source| EvalError::Json {
        path: path.into(),
        source,
    })?;
    Ok(put(path, text + "\n")?)
}

/// Makes sure, before the work, that a file can be written; what it holds stays.
pub(crate) fn writable(path: &Path) -> Result<(), OutputError> {
    let failed = |path: PathBuf| move |source| OutputError::File { path, source };
    if let Some(folder) = path.parent() {
        output::create_dir(folder)?;
    }
    let new = !path.exists();
    (std::fs::OpenOptions::new().append(true).create(true))
        .open(path)
        .map_err(failed(path.into()))?;
    if new {
        std::fs::remove_file(path).map_err(failed(path.into()))?;
    }
    Ok(())
}

/// Works on every job, on so many threads, and says how far it has come; results come in the order of the
/// jobs. After an error no further job is begun.
pub(crate) fn in_parallel<J: Sync, T: Send>(
    label: &str,
    jobs: &[J],
    threads: usize,
    work: impl Fn(&J) -> Result<T, EvalError> + Sync,
) -> Result<Vec<T>, EvalError> {
    const OFTEN: usize = 20;
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let slots: Vec<Mutex<Option<Result<T, EvalError>>>> =
        jobs.iter().map(|_| Mutex::new(None)).collect();
    let loops = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let (Some(job), Some(slot)) = (jobs.get(index), slots.get(index)) else {
                break;
            };
            let result = work(job);
            if result.is_err() {
                // What has not begun need not begin.
                next.store(jobs.len(), Ordering::Relaxed);
            }
            *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            if done.is_multiple_of(OFTEN) || done == jobs.len() || threads == 1 {
                progress(&format!("{label}: {done} of {} runs", jobs.len()));
            }
        }
    };
    if threads == 1 {
        loops();
    } else {
        std::thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(loops);
            }
        });
    }
    slots
        .into_iter()
        .filter_map(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner))
        .collect()
}

/// A track is confirmed from this many hits on, and while the last one is this fresh [s].
const CONFIRMED_HITS: u32 = 6;
/// Longest time since the last hit of a track that counts as seen [s].
pub(crate) const FRESH_S: f64 = 0.25;

/// Whether a track is confirmed at `t_s`.
pub(crate) fn confirmed(track: &Track, t_s: f64) -> bool {
    track.total_hits() >= CONFIRMED_HITS
        && track.filter.coast_s(t_s) < FRESH_S
        && track.log_odds() > 0.0
}
