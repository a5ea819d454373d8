//! `boresight sweep`: an experiment's runs on all cores, resumed after a kill, and one table of them.
//!
//! Every run that is over is a line of a journal in the output folder. The table is made of the journals once all runs
//! are in them, ordered by their numbers: it depends neither on cores nor on the order in which runs end.

mod page;
pub mod plan;
pub mod run;
mod table;

use super::ExperimentError;
use super::figures::figure;
use super::runner::{Runner, Unmade};
use crate::output::{self, OutputError};
use crate::parallel::{in_parallel, threads};
use crate::progress::Progress;
use crate::stop;
use clap::Args;
use plan::{Plan, PlannedRun};
use run::{Done, Down, STATE_HASH};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read as _, Seek as _, SeekFrom, Write as _};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
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
    /// Make only every N-th run, from the I-th on, and no table: `2/8`. For clusters.
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
    /// Hash of what all runs of the experiment share ([`Plan::hash`]).
    experiment: String,
    version: String,
    /// Hash of the program.
    program: String,
}

impl Header {
    /// That of the runs which this program would make.
    fn of(plan: &Plan) -> Result<Self, ExperimentError> {
        let program = std::env::current_exe()
            .and_then(std::fs::read)
            .map_err(ExperimentError::Program)?;
        Ok(Self {
            experiment: plan.hash.clone(),
            version: crate::VERSION.into(),
            program: format!("{:016x}", xxh3_64(&program)),
        })
    }
}

/// How it went.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Swept {
    /// Runs that were asked for: of the experiment, or of its shard.
    pub runs: u64,
    /// Those of them that failed.
    pub failed: u64,
    /// Whether the table was written.
    pub table: bool,
    /// Those of them that earlier calls had made.
    pub resumed: u64,
    /// Those of them that were not made, because the command was stopped.
    pub left: u64,
}

impl Swept {
    /// In a line.
    pub fn text(&self) -> String {
        let Self {
            runs,
            failed,
            resumed,
            left,
            ..
        } = self;
        let earlier = match resumed {
            0 => String::new(),
            resumed => format!(", {resumed} of them made before"),
        };
        let again = match failed {
            0 => "",
            _ => ": a further sweep into this folder makes them again",
        };
        let not_made = match left {
            0 => String::new(),
            left => format!(", {left} not made"),
        };
        let text = format!("{runs} runs{earlier}{not_made}, {failed} failed{again}");
        let there = format!(
            "{} of {runs} runs are in the journal; the same command goes on with the others",
            runs - left
        );
        match stop::said(&there).filter(|_| *left > 0) {
            Some(stopped) => format!("{text}\n{stopped}"),
            None => text,
        }
    }

    /// 0 where every run has its figures, else 1.
    pub fn exit_code(&self) -> u8 {
        u8::from(self.failed > 0)
    }
}

/// Carries out an experiment, or its shard.
pub fn sweep(arguments: &Arguments) -> Result<Swept, ExperimentError> {
    let plan = Plan::read(&arguments.experiment)?;
    output::create_dir(&arguments.out)?;
    let header = Header::of(&plan)?;
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
    // Nobody else writes it from before it is read.
    let path = arguments.out.join(format!("{JOURNAL}{name}.jsonl"));
    let journal = match arguments.merge {
        false => Some(Journal::open(&path)?),
        true => None,
    };
    let mut done = BTreeMap::new();
    for path in journals(&arguments.out)? {
        for run in read_journal(&path, &header)? {
            keep(&mut done, run);
        }
    }
    let key = |index: &u64| plan.key(&plan.run(*index));
    let found = |done: &BTreeMap<String, Done>, good: bool| {
        let is = |index: &&u64| {
            done.get(&key(index))
                .is_some_and(|run| run.result.is_ok() == good)
        };
        wanted.iter().filter(is).count() as u64
    };
    // A run that failed is made again: the cause may be gone.
    let succeeded = |index: &u64| done.get(&key(index)).is_some_and(|run| run.result.is_ok());
    let left: Vec<u64> = (wanted.iter().copied())
        .filter(|index| !succeeded(index))
        .collect();
    let resumed = (wanted.len() - left.len()) as u64;
    if let Some(journal) = journal {
        journal.begin(&header)?;
        for run in make(&plan, &left, &journal, threads(arguments.jobs))? {
            keep(&mut done, run);
        }
    }
    let (good, failed) = (found(&done, true), found(&done, false));
    let missing = (0..plan.runs()).find(|index| !done.contains_key(&key(index)));
    if let Some(missing) = missing.filter(|_| arguments.merge) {
        let there = (0..plan.runs()).filter(|index| done.contains_key(&key(index)));
        return Err(ExperimentError::Path {
            path: arguments.out.clone(),
            what: format!(
                "its journals hold {} of {} runs, run {missing} is the first that is missing; make the other shards",
                there.count(),
                plan.runs(),
            ),
        });
    }
    let table = missing.is_none() && arguments.shard.is_none();
    if table {
        let row = |index| {
            let run = plan.run(index);
            let done = done.get(&plan.key(&run))?.clone();
            Some((run, done))
        };
        let rows: Vec<(PlannedRun, Done)> = (0..plan.runs()).filter_map(row).collect();
        table::write(&arguments.out, &plan, &rows)?;
        page::write(&arguments.out, &plan, &rows, &arguments.experiment)?;
    }
    Ok(Swept {
        runs: wanted.len() as u64,
        failed,
        table,
        resumed,
        left: wanted.len() as u64 - good - failed,
    })
}

/// Takes in a run that is over; one that succeeded stands against one that failed.
fn keep(done: &mut BTreeMap<String, Done>, run: Done) {
    let stands = done.get(&run.key).is_some_and(|known| known.result.is_ok());
    if !stands {
        done.insert(run.key.clone(), run);
    }
}

/// Makes runs on so many threads and writes each to the journal when it is over; those of them that are over when the
/// command is stopped.
fn make(
    plan: &Plan,
    left: &[u64],
    journal: &Journal,
    threads: usize,
) -> Result<Vec<Done>, ExperimentError> {
    let template = "{prefix} [{bar:30}] {pos} of {len} runs{left}";
    let progress = Progress::new(left.len() as u64, template);
    let bar = progress.bar();
    bar.set_prefix(plan.experiment.name.clone());
    let runner = Runner::default();
    let made = in_parallel(left, threads, |index| {
        let Some(done) = one(plan, *index, &runner) else {
            return Ok(None);
        };
        // Without a journal the work would be lost.
        journal.write(&done)?;
        bar.inc(1);
        progress.say(|| {
            let name = &plan.experiment.name;
            format!("{name}: {} of {} runs", bar.position(), left.len())
        });
        Ok(Some(done))
    });
    bar.finish_and_clear();
    made.map(|made| made.into_iter().flatten().collect())
}

/// Makes one run; none where it was stopped.
fn one(plan: &Plan, index: u64, runner: &Runner) -> Option<Done> {
    let run = plan.run(index);
    let over = |scenario_hash, down, result| Done {
        run: index,
        key: plan.key(&run),
        scenario_hash,
        down,
        result,
    };
    let loaded = match plan.scenario(&run) {
        Ok(loaded) => loaded,
        Err(error) => return Some(over(String::new(), Down::default(), Err(error.to_string()))),
    };
    let text = serde_json::to_string(&loaded.scenario).unwrap_or_default();
    let hash = format!("{:016x}", xxh3_64(text.as_bytes()));
    match runner.summary(&loaded, run.seed, plan.experiment.pictures) {
        Ok((summary, _)) => Some(over(hash, Down::of(&summary), Ok(kept(plan, &summary)))),
        Err(Unmade::Stopped) => None,
        Err(why) => Some(over(hash, Down::default(), Err(why.to_string()))),
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

/// The runs of a journal. A line that a killed process or a full disk left half written is none: its run is made again.
fn read_journal(path: &Path, header: &Header) -> Result<Vec<Done>, ExperimentError> {
    let bytes = std::fs::read(path).map_err(|source| OutputError::File {
        path: path.into(),
        source,
    })?;
    let mut lines = bytes
        .split_inclusive(|byte| *byte == b'\n')
        .filter(|line| line.ends_with(b"\n"));
    let Some(first) = lines.next() else {
        return Ok(Vec::new());
    };
    if serde_json::from_slice::<Header>(first).ok().as_ref() != Some(header) {
        let what = "is of another scenario, name, set, keep or file than the experiment's, or of another build of the program; \
                    name another folder with --out, or delete it";
        return Err(ExperimentError::Path {
            path: path.into(),
            what: what.into(),
        });
    }
    Ok(lines
        .filter_map(|line| serde_json::from_slice(line).ok())
        .collect())
}

/// A journal that runs are added to.
struct Journal {
    path: PathBuf,
    file: Mutex<Lines>,
}

/// A file that lines are added to.
struct Lines {
    file: File,
    /// Whether it ends within a line.
    torn: bool,
}

impl Journal {
    /// Opens a journal at its end, for this process alone.
    fn open(path: &Path) -> Result<Self, ExperimentError> {
        let failed = |source| OutputError::File {
            path: path.into(),
            source,
        };
        let mut file = (OpenOptions::new().create(true).append(true).read(true))
            .open(path)
            .map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(ExperimentError::Path {
                    path: path.into(),
                    what: "another sweep is writing it; wait for that, or name another folder with --out".into(),
                });
            }
            // Some network file systems have no locks.
            Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => {}
            Err(TryLockError::Error(error)) => return Err(failed(error).into()),
        }
        let mut last = [b'\n'];
        if file.metadata().map_err(failed)?.len() > 0 {
            file.seek(SeekFrom::End(-1)).map_err(failed)?;
            file.read_exact(&mut last).map_err(failed)?;
        }
        let torn = last != [b'\n'];
        Ok(Self {
            path: path.into(),
            file: Mutex::new(Lines { file, torn }),
        })
    }

    /// Writes the first line where there is none.
    fn begin(&self, header: &Header) -> Result<(), OutputError> {
        let failed = |source| OutputError::File {
            path: self.path.clone(),
            source,
        };
        let bytes = std::fs::read(&self.path).map_err(failed)?;
        if bytes.contains(&b'\n') {
            return Ok(());
        }
        {
            let mut lines = self.file.lock().unwrap_or_else(PoisonError::into_inner);
            lines.file.set_len(0).map_err(failed)?;
            lines.torn = false;
        }
        self.write(header)
    }

    /// Writes a line.
    fn write(&self, line: &impl Serialize) -> Result<(), OutputError> {
        let text = serde_json::to_string(line).unwrap_or_default() + "\n";
        let mut lines = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        // What stands there half written stays a line of its own.
        let before = if lines.torn { "\n" } else { "" };
        lines.torn = true;
        (lines.file.write_all((before.to_owned() + &text).as_bytes())).map_err(|source| {
            OutputError::File {
                path: self.path.clone(),
                source,
            }
        })?;
        lines.torn = false;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(program: &str) -> Header {
        Header {
            experiment: "e".into(),
            version: "v".into(),
            program: program.into(),
        }
    }

    fn done(run: u64, result: Result<(), &str>) -> Done {
        Done {
            run,
            key: run.to_string(),
            scenario_hash: "ü".into(),
            down: Down::default(),
            result: result.map(|()| BTreeMap::new()).map_err(str::to_owned),
        }
    }

    #[test]
    fn a_journal_survives_what_was_cut_and_what_failed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("runs-all.jsonl");
        let read = || read_journal(&path, &header("p")).unwrap();
        let journal = Journal::open(&path).unwrap();
        journal.begin(&header("p")).unwrap();
        journal.write(&done(0, Ok(()))).unwrap();
        journal.write(&done(1, Err("no memory"))).unwrap();
        // Nobody else writes it meanwhile.
        let second = Journal::open(&path).err().unwrap().to_string();
        assert!(second.contains("another sweep"), "{second}");
        drop(journal);
        // Cut inside a character of two bytes.
        let mut bytes = std::fs::read(&path).unwrap();
        let line = serde_json::to_string(&done(2, Ok(()))).unwrap();
        let cut = line.find('ü').unwrap() + 1;
        bytes.extend(&line.as_bytes()[..cut]);
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(read().len(), 2);
        let journal = Journal::open(&path).unwrap();
        journal.begin(&header("p")).unwrap();
        journal.write(&done(2, Ok(()))).unwrap();
        journal.write(&done(1, Ok(()))).unwrap();
        drop(journal);
        let mut all = BTreeMap::new();
        for run in read() {
            keep(&mut all, run);
        }
        // What succeeded at last stands, and a failure from another journal does not undo it.
        keep(&mut all, done(1, Err("late")));
        assert_eq!(all.len(), 3);
        assert!(all.values().all(|run| run.result.is_ok()), "{all:?}");
        // Another build of the program does not go on.
        let other = read_journal(&path, &header("q")).unwrap_err().to_string();
        assert!(other.contains("another build"), "{other}");
        // A first line that was cut leaves nothing behind.
        std::fs::write(&path, "{\"exper").unwrap();
        let journal = Journal::open(&path).unwrap();
        journal.begin(&header("p")).unwrap();
        journal.write(&done(0, Ok(()))).unwrap();
        assert_eq!(read(), [done(0, Ok(()))]);
    }
}
