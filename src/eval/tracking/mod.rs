//! `boresight eval tracking`: many runs of acquisition, tracking and pointing, and what they add up to.
//!
//! Every number comes from runs that `boresight run` repeats: the JSON names scenario, changes and
//! seeds of each. The truth is only looked at, never fed back.

mod bench;
mod budget;
pub mod job;
pub mod mot;
mod page;
pub mod results;
mod targets;

use super::EvalError;
use super::shared::progress;
use crate::output::{put_json, writable};
use crate::stop;
use bench::Bench;
use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use results::Evaluation;
use std::path::PathBuf;
use std::time::Instant;

/// What `boresight eval tracking` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// Folder for tracking.json, tracking.html, the pictures and the MOTChallenge files.
    #[arg(long, default_value = "out/eval")]
    pub out: PathBuf,
    /// Few seeds and short runs.
    #[arg(long)]
    pub quick: bool,
    /// Only this section; may be repeated.
    #[arg(long, value_name = "SECTION")]
    pub only: Vec<Section>,
}

/// Parts of the evaluation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Section {
    /// The paper's Table 2: miss distances of three UAVs.
    Table2,
    /// Line-of-sight error with a detector of 0.1 px noise.
    Precision,
    /// A UAV that weaves at 3 m/s².
    Weave,
    /// A UAV that is hidden for a second.
    Occlusion,
    /// Several targets: association by the paper's rule and by ours.
    Suite,
    /// Probability and time of acquisition.
    Search,
    /// The line-of-sight error by cause.
    Budget,
}

/// Carries out the evaluation and writes what it leaves.
pub fn evaluate(arguments: &Arguments) -> Result<Evaluation, EvalError> {
    let mut bench = Bench::new(arguments.quick, &arguments.out);
    let mut evaluation = Evaluation {
        version: crate::VERSION,
        command: command(arguments),
        quick: arguments.quick,
        ..Evaluation::default()
    };
    let json = arguments.out.join("tracking.json");
    writable(&json)?;
    let (mut left, mut measured) = (Vec::new(), 0);
    for section in Section::value_variants() {
        if !arguments.only.is_empty() && !arguments.only.contains(section) {
            continue;
        }
        let started = Instant::now();
        match measure(*section, &mut bench, &mut evaluation) {
            Err(EvalError::Stopped) => {
                left.extend(section.to_possible_value());
                continue;
            }
            done => done?,
        }
        measured += 1;
        progress(&format!(
            "{section:?}: {:.0} s",
            started.elapsed().as_secs_f64()
        ));
    }
    // An earlier evaluation's files stay where this one has nothing.
    if measured == 0 && !left.is_empty() {
        return Err(EvalError::Stopped);
    }
    evaluation.not_run = bench.not_run;
    if let Some(said) = not_measured(arguments, &left) {
        evaluation.not_run.push(said);
    }
    evaluation.targets = evaluation.targets();
    put_json(&json, &evaluation)?;
    page::write(&arguments.out, &evaluation)?;
    Ok(evaluation)
}

/// Measures a section.
fn measure(
    section: Section,
    bench: &mut Bench,
    evaluation: &mut Evaluation,
) -> Result<(), EvalError> {
    if stop::asked().is_some() {
        return Err(EvalError::Stopped);
    }
    match section {
        Section::Table2 => evaluation.table2 = bench.table2()?,
        Section::Precision => evaluation.precision = bench.precision()?,
        Section::Weave => evaluation.weave = bench.weave()?,
        Section::Occlusion => evaluation.occlusion = bench.occlusion()?,
        Section::Suite => evaluation.suite = bench.suite()?,
        Section::Search => evaluation.search = bench.search()?,
        Section::Budget => evaluation.budget = bench.budget()?,
    }
    Ok(())
}

/// What is said of the sections that a stop has left out.
fn not_measured(arguments: &Arguments, left: &[PossibleValue]) -> Option<String> {
    let names: Vec<&str> = left.iter().map(PossibleValue::get_name).collect();
    let only: String = names.iter().map(|name| format!(" --only {name}")).collect();
    let rest = Arguments {
        only: Vec::new(),
        ..arguments.clone()
    };
    let there = format!(
        "{}; `{}{only}` makes them",
        names.join(", "),
        command(&rest)
    );
    stop::said(&there).filter(|_| !left.is_empty())
}

/// The command that repeats the evaluation.
fn command(arguments: &Arguments) -> String {
    let quick = if arguments.quick { " --quick" } else { "" };
    let sections = arguments.only.iter().filter_map(|section| {
        let value = section.to_possible_value()?;
        Some(format!(" --only {}", value.get_name()))
    });
    let sections: String = sections.collect();
    format!("boresight eval tracking{quick}{sections}")
}
