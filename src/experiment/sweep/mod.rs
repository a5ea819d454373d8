//! `boresight sweep`: an experiment's runs on all cores, resumed after a kill, and one table of them.
//!
//! Every run that is over is a line of a journal in the output folder. The table is made of the journals once all runs
//! are in them, ordered by their numbers: it depends neither on cores nor on the order in which runs end.

mod page;
pub mod plan;
pub mod run;
mod table;

use super::figures::figure;
use super::{ExperimentError, Runner};
use crate::output::{self, OutputError};
use crate::parallel::threads;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use plan::{Plan, PlannedRun};
use run::{Done, STATE_HASH};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use xxhash_rust::xxh3::xxh3_64;

/// What `boresight sweep` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// Experiment file (TOML).
    pub experiment: PathBuf,
    /// Folder for the table (table.parquet, table.csv), the page (sweep.html), the failed runs (failed.csv) and the
    /// journals; an experiment that was stopped goes on in it.
    #[arg(long)]
    pub out: PathBuf,
    /// Runs at a time; by default one a core. It changes no result.
    #[arg(long)]
    pub jobs: Option<NonZeroUsize>,
    /// Make only every n-th run, from the i-th on, and no table: `2/8`. For clusters.
    #[arg(long, value_name = "I/N", value_parser = shard)]
    pub shard: Option<Shard>,
    /// Make no run: put the journals of all shards in the folder together.
    #[arg(long, conflicts_with = "shard")]
    pub merge: bool,
}

/// A part of the runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Its number, from 1.
    pub number: u64,
    /// How many there are.
    pub of: u64,
}

/// Reads `2/8`.
fn shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/');
    let numbers = parts.and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
    match numbers {
        Some((number, of)) if (1..=of).contains(&number) => Ok(Shard { number, of }),
        _ => Err("expected I/N such as 2/8, I from 1 to N".into()),
    }
}

/// First line of a journal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Header {
    experiment: String,
    version: String,
}

/// How it went.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Swept {
    /// Runs of the experiment, and those that failed.
    pub runs: u64,
    /// Runs that failed.
    pub failed: u64,
    /// Whether the table was written.
    pub table: bool,
    /// Runs that earlier calls had made.
    pub resumed: u64,
}

impl Swept {
    /// In a line.
    pub fn text(&self) -> String {
        let Self {
            runs,
            failed,
            resumed,
            ..
        } = self;
        let earlier = match resumed {
            0 => String::new(),
            resumed => format!(", {resumed} of them made before"),
        };
        format!("{runs} runs{earlier}, {failed} failed")
    }
}

/// Carries out an experiment, or its shard.
pub fn sweep(arguments: &Arguments) -> Result<Swept, ExperimentError> {
    let plan = Plan::read(&arguments.experiment)?;
    output::create_dir(&arguments.out)?;
    let header = Header {
        experiment: plan.hash.clone(),
        version: crate::VERSION.into(),
    };
    let mut done = BTreeMap::new();
    for path in journals(&arguments.out)? {
        for run in read_journal(&path, &header)? {
            done.insert(run.run, run);
        }
    }
    let resumed = done.len() as u64;
    let (name, wanted): (String, Vec<u64>) = match arguments.shard {
        Some(Shard { number, of }) => (
            format!("{number}-of-{of}"),
            (0..plan.runs())
                .skip(number as usize - 1)
                .step_by(of as usize)
                .collect(),
        ),
        None => ("all".into(), (0..plan.runs()).collect()),
    };
    if !arguments.merge {
        let left: Vec<u64> = (wanted.iter().copied())
            .filter(|index| !done.contains_key(index))
            .collect();
        let path = arguments.out.join(format!("{JOURNAL}{name}.jsonl"));
        let journal = Journal::open(&path, &header)?;
        for run in make(&plan, &left, &journal, threads(arguments.jobs))? {
            done.insert(run.run, run);
        }
    }
    let failed = done.values().filter(|run| run.result.is_err()).count() as u64;
    let whole = done.len() as u64 == plan.runs();
    if arguments.merge && !whole {
        let missing = (0..plan.runs()).find(|index| !done.contains_key(index));
        return Err(ExperimentError::Path {
            path: arguments.out.clone(),
            what: format!(
                "its journals hold {} of {} runs, run {} is the first that is missing: make the other shards",
                done.len(),
                plan.runs(),
                missing.unwrap_or(0)
            ),
        });
    }
    if whole && arguments.shard.is_none() {
        let rows: Vec<(PlannedRun, Done)> = (done.into_values())
            .map(|run| (plan.run(run.run), run))
            .collect();
        table::write(&arguments.out, &plan, &rows)?;
        page::write(&arguments.out, &plan, &rows, &arguments.experiment)?;
    }
    Ok(Swept {
        runs: wanted.len() as u64,
        failed,
        table: whole && arguments.shard.is_none(),
        resumed,
    })
}

/// Makes runs on so many threads and writes each to the journal when it is over.
fn make(
    plan: &Plan,
    left: &[u64],
    journal: &Journal,
    threads: usize,
) -> Result<Vec<Done>, ExperimentError> {
    let bar = ProgressBar::new(left.len() as u64);
    // The template is a constant; should it be refused, the default style serves.
    if let Ok(style) =
        ProgressStyle::with_template("{prefix} [{bar:30}] {pos} of {len} runs, {eta} left")
    {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_prefix(plan.experiment.name.clone());
    let (next, runner) = (AtomicUsize::new(0), Runner::default());
    let made = Mutex::new(Vec::new());
    let failure = Mutex::new(None);
    let work = || {
        while let Some(index) = left.get(next.fetch_add(1, Ordering::Relaxed)) {
            let done = one(plan, *index, &runner);
            let kept = journal.write(&done);
            bar.inc(1);
            match kept {
                Ok(()) => made
                    .lock()
                    .unwrap_or_else(PoisonError::into_inner)
                    .push(done),
                Err(error) => {
                    // Without a journal the work would be lost.
                    next.store(left.len(), Ordering::Relaxed);
                    *failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                }
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..threads.min(left.len()) {
            scope.spawn(work);
        }
    });
    bar.finish_and_clear();
    match failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(error) => Err(error.into()),
        None => Ok(made.into_inner().unwrap_or_else(PoisonError::into_inner)),
    }
}

/// Makes one run.
fn one(plan: &Plan, index: u64, runner: &Runner) -> Done {
    let run = plan.run(index);
    let loaded = match plan.scenario(&run) {
        Ok(loaded) => loaded,
        Err(error) => {
            return Done {
                run: index,
                scenario_hash: String::new(),
                result: Err(error.to_string()),
            };
        }
    };
    let text = serde_json::to_string(&loaded.scenario).unwrap_or_default();
    let result = runner
        .run(&loaded, run.seed, plan.experiment.pictures)
        .map(|(summary, _)| kept(plan, &summary));
    Done {
        run: index,
        scenario_hash: format!("{:016x}", xxh3_64(text.as_bytes())),
        result,
    }
}

/// The figures of a summary that the table has.
fn kept(plan: &Plan, summary: &Value) -> BTreeMap<String, Value> {
    let keys = plan.figures.iter().map(|(key, _)| key.as_str());
    keys.chain([STATE_HASH])
        .map(|key| (key.to_owned(), figure(summary, key).unwrap_or_default()))
        .collect()
}

/// How the names of journals begin.
const JOURNAL: &str = "runs-";

/// The journals in a folder, in order.
fn journals(folder: &Path) -> Result<Vec<PathBuf>, ExperimentError> {
    let failed = |source| OutputError::File {
        path: folder.into(),
        source,
    };
    let entries = std::fs::read_dir(folder)
        .and_then(|entries| entries.collect::<Result<Vec<_>, _>>())
        .map_err(failed)?;
    let is_journal = |path: &PathBuf| {
        let name = path
            .file_name()
            .and_then(|name| name.to_str())
            .unwrap_or("");
        name.starts_with(JOURNAL) && name.ends_with(".jsonl")
    };
    let paths = entries.into_iter().map(|entry| entry.path());
    let mut found: Vec<PathBuf> = paths.filter(is_journal).collect();
    found.sort();
    Ok(found)
}

/// The runs of a journal, without a line that a killed process left half written.
fn read_journal(path: &Path, header: &Header) -> Result<Vec<Done>, ExperimentError> {
    let text = std::fs::read_to_string(path).map_err(|source| OutputError::File {
        path: path.into(),
        source,
    })?;
    let mut lines = text
        .split_inclusive('\n')
        .filter(|line| line.ends_with('\n'));
    let Some(first) = lines.next() else {
        return Ok(Vec::new());
    };
    let wrong = |what: &str| ExperimentError::Path {
        path: path.into(),
        what: what.to_owned(),
    };
    if serde_json::from_str::<Header>(first).ok().as_ref() != Some(header) {
        return Err(wrong(
            "is of another experiment, scenario or version: name another folder with --out, or delete it",
        ));
    }
    let read = |line: &str| {
        serde_json::from_str(line)
            .map_err(|_| wrong("holds a line that is no run: delete the file"))
    };
    lines.map(read).collect()
}

/// A journal that runs are added to.
struct Journal {
    path: PathBuf,
    file: Mutex<File>,
}

impl Journal {
    /// Opens a journal at its end; half a line there goes.
    fn open(path: &Path, header: &Header) -> Result<Self, ExperimentError> {
        let failed = |source| OutputError::File {
            path: path.into(),
            source,
        };
        let before = std::fs::read(path).unwrap_or_default();
        let whole = before
            .iter()
            .rposition(|byte| *byte == b'\n')
            .map_or(0, |at| at + 1);
        let file = (OpenOptions::new().create(true).append(true).open(path)).map_err(failed)?;
        file.set_len(whole as u64).map_err(failed)?;
        let journal = Self {
            path: path.into(),
            file: Mutex::new(file),
        };
        if whole == 0 {
            journal.write(header)?;
        }
        Ok(journal)
    }

    /// Writes a line.
    fn write(&self, line: &impl Serialize) -> Result<(), OutputError> {
        let text = serde_json::to_string(line).unwrap_or_default() + "\n";
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(text.as_bytes())
            .map_err(|source| OutputError::File {
                path: self.path.clone(),
                source,
            })
    }
}
