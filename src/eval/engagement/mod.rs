//! `boresight eval engagement`: engagements drawn from a recipe, and what became of them.
//!
//! Every draw is an ordinary scenario that is written down, so that `boresight run` repeats it. Draws are
//! made in processes of their own, one a core: Bevy's task pools are one per process, and what one
//! run takes ends with it. A draw that is made is a file; an evaluation that was stopped goes on with those
//! that are not.

mod arguments;
pub mod belief;
pub mod draw;
mod job;
mod looks;
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
use crate::scenario::Loaded;
use crate::stop;
pub use arguments::Arguments;
use job::Bench;
pub use job::{LOOKS, Outcome};
use recipe::{Recipe, Rules};
use results::Results;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Engagements that were made.
pub struct Drawn {
    /// What became of each.
    pub draws: Vec<Outcome>,
    /// What found the UAVs.
    pub detector: &'static str,
    /// The rules of fire among which each has one.
    pub rules: Vec<Rules>,
    /// What was left out, where they were stopped.
    pub stopped: Option<String>,
}

/// The recipe, with the rules of fire that are asked for; what is kept of looks is learned from.
fn recipe(arguments: &Arguments) -> Result<Recipe, EvalError> {
    let recipe = Recipe::load(&arguments.recipe)?;
    let recipe = if arguments.looks {
        recipe.to_learn_from().map_err(EvalError::own)?
    } else {
        recipe
    };
    match &arguments.rules {
        Some(name) => recipe.under(name).map_err(EvalError::own),
        None => Ok(recipe),
    }
}

/// Carries out the evaluation; what to tell the user.
pub fn evaluate(arguments: &Arguments) -> Result<String, EvalError> {
    if let Some(index) = arguments.draw {
        let recipe = recipe(arguments)?;
        let bench = Bench {
            arguments,
            recipe: &recipe,
        };
        let outcome = bench.make(index)?;
        return Ok(format!("draw {index}: {}", in_short(&outcome)));
    }
    let json = arguments.out.join("results.json");
    writable(&json)?;
    let Drawn {
        draws,
        detector,
        rules,
        stopped,
    } = drawn(arguments)?;
    let results = Results {
        stopped,
        ..Results::of(arguments.command(), detector, rules, draws)
    };
    put_json(&json, &results)?;
    page::write(&arguments.out, &results)?;
    let page = arguments.out.join("results.html");
    Ok(format!("{}page  {}", results.text(), page.display()))
}

/// Makes the engagements, those that are there already excepted.
pub fn drawn(arguments: &Arguments) -> Result<Drawn, EvalError> {
    within("--n", arguments.n.into(), 1.0, 100_000.0)?;
    let recipe = recipe(arguments)?;
    let bench = Bench {
        arguments,
        recipe: &recipe,
    };
    let loaded = checked(&bench)?;
    let key = bench.key(&loaded)?;
    let stopped = match make_all(&bench, &key) {
        Err(EvalError::Stopped) => true,
        done => done.map(|()| false)?,
    };
    let made = (0..arguments.n).map(|index| (index, bench.made(index, &key)));
    let draws: Vec<Outcome> = made
        // What a stop has left out is made by the next call.
        .filter(|(_, outcome)| !stopped || outcome.is_some())
        .map(|(index, outcome)| {
            outcome.ok_or_else(|| EvalError::own(MissingDraw::Record { index }))
        })
        .collect::<Result<_, _>>()?;
    if draws.is_empty() {
        return Err(EvalError::Stopped);
    }
    let said = stop::said(&format!(
        "{} of {} draws are made and counted here; the same command makes the others",
        draws.len(),
        arguments.n
    ));
    let detector = match &loaded.scenario.detector {
        detector if detector.is_truth() => "truth detector",
        detector if detector.is_measured() => "measured detector",
        _ => "rendered pixels",
    };
    Ok(Drawn {
        draws,
        detector,
        rules: recipe.rules.clone(),
        stopped: said.filter(|_| stopped),
    })
}

/// Says what keeps all engagements from running, before the work.
pub fn check(arguments: &Arguments) -> Result<(), EvalError> {
    let recipe = recipe(arguments)?;
    let bench = Bench {
        arguments,
        recipe: &recipe,
    };
    checked(&bench).map(|_| ())
}

/// The scenario of the first draw, once it is known that it can be run.
fn checked(bench: &Bench) -> Result<Loaded, EvalError> {
    let (_, loaded) = bench.draw(0)?;
    if !loaded.scenario.detector.is_blind() {
        app::adapter()?;
    }
    app::check(&loaded)?;
    Ok(loaded)
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
        while stop::asked().is_none()
            && let Some(index) = waiting.get(next.fetch_add(1, Ordering::Relaxed))
        {
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
                    let error = match stop::asked() {
                        Some(_) => EvalError::Stopped,
                        None => error,
                    };
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
    if stop::asked().is_some() {
        return Err(EvalError::Stopped);
    }
    match failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(error) => Err(error),
        None => Ok(()),
    }
}

/// Makes a draw in a process of its own.
fn spawned(arguments: &Arguments, index: u32) -> Result<(), EvalError> {
    /// How often it is looked whether it has ended, or is to.
    const LOOK: Duration = Duration::from_millis(20);
    let process = |source| EvalError::Program { source };
    // A file takes what the process says without anybody who reads it meanwhile.
    let mut errors = tempfile::tempfile().map_err(process)?;
    let mut child = Command::new(std::env::current_exe().map_err(process)?)
        .args(["eval", "engagement", "--draw", &index.to_string()])
        .args(arguments.options())
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(errors.try_clone().map_err(process)?)
        .spawn()
        .map_err(process)?;
    let status = loop {
        if let Some(status) = child.try_wait().map_err(process)? {
            break status;
        }
        if stop::asked().is_some() {
            // It may have ended since.
            let _ = child.kill();
            child.wait().map_err(process)?;
            return Err(EvalError::Stopped);
        }
        std::thread::sleep(LOOK);
    };
    if status.success() {
        return Ok(());
    }
    let mut said = Vec::new();
    (errors.seek(SeekFrom::Start(0)))
        .and_then(|_| errors.read_to_end(&mut said))
        .map_err(process)?;
    let said = String::from_utf8_lossy(&said);
    let last = said.lines().last().unwrap_or_default();
    Err(EvalError::own(MissingDraw::Failed {
        index,
        status,
        message: last.trim_start_matches("error: ").to_owned(),
    }))
}

/// Why there is nothing of a draw.
#[derive(Debug, thiserror::Error)]
enum MissingDraw {
    /// Its process failed.
    #[error("draw {index} ({status}): {message}; `--draw {index}` makes it alone")]
    Failed {
        /// Its number.
        index: u32,
        /// How its process ended.
        status: std::process::ExitStatus,
        /// What that said last.
        message: String,
    },
    /// Its record is gone.
    #[error("draw {index} has no record of this evaluation; run the command again")]
    Record {
        /// Its number.
        index: u32,
    },
}

/// What became of a draw, in short.
fn in_short(outcome: &Outcome) -> String {
    let verdict = &outcome.verdict;
    let end = match (verdict.cause, outcome.record.neutralised_s) {
        (Some(cause), _) => format!("failed, {}", cause.name()),
        (None, Some(t_s)) => format!("neutralised after {t_s:.1} s"),
        (None, None) if verdict.visible => "held, fire was not allowed".into(),
        (None, None) => "never visible".into(),
    };
    format!("{}: {end}", outcome.description())
}
