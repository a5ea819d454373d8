//! `boresight eval engagement`: engagements drawn from a recipe, and what became of them.
//!
//! Every draw is an ordinary scenario that is written down, so that `boresight run` repeats it. Draws are
//! made in processes of their own, one a core: Bevy's task pools are one per process, and what one
//! run takes ends with it. A draw that is made is a file; an evaluation that was stopped goes on with those
//! that are not.

mod arguments;
pub mod draw;
mod job;
mod page;
pub mod recipe;
pub mod results;
pub mod verdict;
mod watch;

use super::EvalError;
use super::shared::{progress, within};
use crate::app;
use crate::output::{put_json, writable};
use crate::parallel::threads;
pub use arguments::Arguments;
use job::{Bench, Outcome};
use recipe::Recipe;
use results::Results;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Carries out the evaluation; what to tell the user.
pub fn evaluate(arguments: &Arguments) -> Result<String, EvalError> {
    within("--n", arguments.n.into(), 1.0, 100_000.0)?;
    let recipe = Recipe::load(&arguments.recipe)?;
    let bench = Bench {
        arguments,
        recipe: &recipe,
    };
    if let Some(index) = arguments.draw {
        let outcome = bench.make(index)?;
        return Ok(format!("draw {index}: {}", in_short(&outcome)));
    }
    let json = arguments.out.join("results.json");
    writable(&json)?;
    // What keeps all of them from running is told before the work.
    let (_, loaded) = bench.draw(0)?;
    let rendered = !loaded.scenario.detector.is_truth();
    if rendered {
        app::adapter()?;
    }
    app::check(&loaded)?;
    let key = bench.key(&loaded)?;
    make_all(&bench, &key)?;
    let draws: Vec<Outcome> = (0..arguments.n)
        .map(|index| bench.made(index, &key).ok_or(EvalError::NoDraw { index }))
        .collect::<Result<_, _>>()?;
    let detector = if rendered {
        "rendered pixels"
    } else {
        "truth detector"
    };
    let results = Results::of(arguments.command(), detector, draws);
    put_json(&json, &results)?;
    page::write(&arguments.out, &results)?;
    let page = arguments.out.join("results.html");
    Ok(format!("{}page  {}", results.text(), page.display()))
}

/// Makes the draws that are not there, side by side.
fn make_all(bench: &Bench, key: &str) -> Result<(), EvalError> {
    let arguments = bench.arguments;
    let waiting: Vec<u32> = (0..arguments.n)
        .filter(|index| bench.made(*index, key).is_none())
        .collect();
    let there = arguments.n as usize - waiting.len();
    if there > 0 {
        progress(&format!("{there} of {} draws are there", arguments.n));
    }
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(there));
    let failure: Mutex<Option<EvalError>> = Mutex::new(None);
    let work = || {
        while let Some(index) = waiting.get(next.fetch_add(1, Ordering::Relaxed)) {
            let started = Instant::now();
            match spawned(arguments, *index) {
                Ok(()) => {
                    let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                    let short = bench.made(*index, key).map(|o| in_short(&o));
                    progress(&format!(
                        "{done} of {}: draw {index}: {} ({:.0} s)",
                        arguments.n,
                        short.unwrap_or_default(),
                        started.elapsed().as_secs_f64()
                    ));
                }
                Err(error) => {
                    // What has not begun need not begin.
                    next.store(waiting.len(), Ordering::Relaxed);
                    let mut first = failure.lock().unwrap_or_else(PoisonError::into_inner);
                    first.get_or_insert(error);
                }
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..threads(arguments.jobs).min(waiting.len()) {
            scope.spawn(work);
        }
    });
    match failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(error) => Err(error),
        None => Ok(()),
    }
}

/// Makes a draw in a process of its own.
fn spawned(arguments: &Arguments, index: u32) -> Result<(), EvalError> {
    let process = |source| EvalError::Program { source };
    let output = Command::new(std::env::current_exe().map_err(process)?)
        .args(["eval", "engagement", "--draw", &index.to_string()])
        .args(arguments.options())
        .stdin(Stdio::null())
        .output()
        .map_err(process)?;
    if output.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    let last = said.lines().last().unwrap_or_default();
    Err(EvalError::Draw {
        index,
        status: output.status,
        message: last.trim_start_matches("error: ").to_owned(),
    })
}

/// What became of a draw, in short.
fn in_short(outcome: &Outcome) -> String {
    let verdict = &outcome.verdict;
    let end = match (verdict.cause, outcome.record.neutralised_s) {
        (Some(cause), _) => format!("failed, {}", cause.name()),
        (None, Some(t_s)) => format!("neutralised after {t_s:.1} s"),
        (None, None) => "never visible".into(),
    };
    format!("{}: {end}", outcome.description())
}
