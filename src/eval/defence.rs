//! `boresight eval defence`: one raid against more and more of its stations, by every rule of assignment.
//!
//! Every number comes from runs that `boresight run` repeats, but for the stations that are left out. The runs are
//! blind: the truth detector proves nothing about finding or choosing targets.

use super::EvalError;
use super::shared::{in_parallel, progress, within};
use crate::app::{self, Options};
use crate::models::engage::allocation::AllocationRule;
use crate::models::ground::city::City;
use crate::models::maths::statistics::{Mean, Rate};
use crate::output::{put, put_json, quoted, writable};
use crate::parallel::threads;
use crate::plugins::environment::placed_in_city;
use crate::report::chart::{Across, Chart, Scale, Series};
use crate::report::summary::{Summary, finish};
use crate::scenario::{Loaded, Scenario};
use crate::stop;
use clap::Args;
use serde::Serialize;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// What `boresight eval defence` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// The raid: a scenario with several stations and the truth detector.
    #[arg(long, default_value = "scenarios/raid.toml")]
    pub scenario: PathBuf,
    /// Seeds of each case, from 1.
    #[arg(long, default_value_t = 20)]
    pub seeds: u32,
    /// Runs at a time; by default one a core.
    #[arg(long)]
    pub jobs: Option<NonZeroUsize>,
    /// Folder for defence.json and defence.svg.
    #[arg(long, default_value = "out/defence")]
    pub out: PathBuf,
}

/// The raid against some of its stations by one rule.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Case {
    /// The first so many stations of the scenario.
    pub stations: usize,
    /// How targets are assigned.
    pub rule: AllocationRule,
    /// UAVs of a run that came within the asset's radius unharmed.
    pub leakers: Mean,
    /// Runs in which every UAV was brought down.
    pub cleared: Rate,
    /// Time at which the last one was, in those \[s\].
    pub clear_s: Mean,
    /// From a kill to the station's next first shot \[s\].
    pub kill_to_shot_s: Mean,
    /// UAVs not brought down yet, mean over the runs: (time \[s\], number).
    pub left: Series,
}

/// What the evaluation found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// Version of the program.
    pub version: &'static str,
    /// The command that makes it.
    pub command: String,
    /// What was left out, where it was stopped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
    /// The cases.
    pub cases: Vec<Case>,
}

/// One run.
struct Job {
    loaded: Loaded,
    seed: u64,
    city: Arc<City>,
}

/// Carries out the evaluation and writes what it leaves.
pub fn evaluate(arguments: &Arguments) -> Result<Evaluation, EvalError> {
    within("--seeds", arguments.seeds.into(), 1.0, 10_000.0)?;
    let raid = Scenario::load(&arguments.scenario, &[])?;
    let (raid, city) = placed_in_city(raid)?;
    let json = arguments.out.join("defence.json");
    writable(&json)?;
    let mut cases = Vec::new();
    'cases: for stations in 1..=raid.scenario.stations.len().max(1) {
        for rule in rules(stations) {
            let mut loaded = raid.clone();
            loaded.scenario.stations.truncate(stations);
            let mut network = loaded.scenario.network().unwrap_or_default();
            network.assignment = *rule;
            loaded.scenario.network = Some(network);
            let jobs: Vec<Job> = (1..=u64::from(arguments.seeds))
                .map(|seed| Job {
                    loaded: loaded.clone(),
                    seed,
                    city: city.clone(),
                })
                .collect();
            let label = format!("{stations} stations, {}", rule.name());
            let runs = match in_parallel(&label, &jobs, threads(arguments.jobs), run) {
                Err(EvalError::Stopped) if !cases.is_empty() => break 'cases,
                runs => runs?,
            };
            let case = case(stations, *rule, &raid.scenario, &runs);
            progress(&format!("{label}: leakers {}", case.leakers.text()));
            cases.push(case);
        }
    }
    let evaluation = Evaluation {
        version: crate::VERSION,
        command: command(arguments),
        stopped: stop::said(&format!(
            "{} cases are whole and here; the same command makes all of them again",
            cases.len()
        )),
        cases,
    };
    put_json(&json, &evaluation)?;
    if let Some(svg) = evaluation.chart(raid.scenario.duration_s) {
        put(&arguments.out.join("defence.svg"), svg)?;
    }
    Ok(evaluation)
}

/// One station alone has nobody to share with: the two rules that assign are one.
fn rules(stations: usize) -> &'static [AllocationRule] {
    use AllocationRule::{Greedy, LeastCost, None};
    match stations {
        1 => &[LeastCost, None],
        _ => &[LeastCost, Greedy, None],
    }
}

/// Makes a run to its end.
fn run(job: &Job) -> Result<Summary, EvalError> {
    let options = Options {
        seed: Some(job.seed),
        one_thread: true,
        city: Some(job.city.clone()),
        ..Options::default()
    };
    let mut app = app::build(&job.loaded, &options)?;
    while !app::step(app.world_mut())? {}
    let elapsed = Duration::ZERO; // no figure of it is used
    Ok(finish(app.world_mut(), &job.loaded, &options, elapsed).summary)
}

/// Sums up the runs of a case.
fn case(stations: usize, rule: AllocationRule, raid: &Scenario, runs: &[Summary]) -> Case {
    let leakers: Vec<f64> = (runs.iter())
        .map(|run| {
            run.uavs
                .iter()
                .filter(|uav| uav.at_asset_s.is_some())
                .count() as f64
        })
        .collect();
    let cleared: Vec<f64> = runs
        .iter()
        .filter_map(|run| run.time_to_neutralise_s)
        .collect();
    let pauses: Vec<f64> = (runs.iter())
        .flat_map(|run| &run.stations)
        .flat_map(|station| station.kill_to_shot_s.iter().copied())
        .collect();
    let left_at = |t_s: f64| {
        let standing = |run: &Summary| {
            let down = |s: f64| s <= t_s;
            run.uavs
                .iter()
                .filter(|uav| !uav.neutralised_s.is_some_and(down))
                .count()
        };
        runs.iter().map(standing).sum::<usize>() as f64 / runs.len() as f64
    };
    let seconds = raid.duration_s.ceil() as u32;
    Case {
        stations,
        rule,
        leakers: Mean::of(&leakers),
        cleared: Rate::of(cleared.len(), runs.len()),
        clear_s: Mean::of(&cleared),
        kill_to_shot_s: Mean::of(&pauses),
        left: (0..=seconds)
            .map(|t| (f64::from(t), left_at(f64::from(t))))
            .collect(),
    }
}

impl Evaluation {
    /// The figures as a Markdown table.
    pub fn text(&self) -> String {
        let mut text = String::from(
            "| stations | assignment | leakers a run | runs cleared | time to clear [s] | kill to next shot [s] |\n\
             |---|---|---|---|---|---|\n",
        );
        for case in &self.cases {
            text += &format!(
                "| {} | {} | {} | {} | {} | {} |\n",
                case.stations,
                case.rule.name(),
                case.leakers.text(),
                case.cleared.text(),
                case.clear_s.text(),
                case.kill_to_shot_s.text(),
            );
        }
        if let Some(stopped) = &self.stopped {
            text += &format!("\n{stopped}\n");
        }
        text
    }

    /// UAVs left over time by the number of stations, assigned at the least cost.
    fn chart(&self, end_s: f64) -> Option<String> {
        let shown: Vec<&Case> = (self.cases.iter())
            .filter(|case| case.rule == AllocationRule::LeastCost)
            .collect();
        let names: Vec<String> = (shown.iter())
            .map(|case| {
                format!(
                    "{} station{}",
                    case.stations,
                    if case.stations > 1 { "s" } else { "" }
                )
            })
            .collect();
        let series: Vec<(&str, &Series)> = (names.iter().zip(&shown))
            .map(|(name, case)| (name.as_str(), &case.left))
            .collect();
        let chart = Chart {
            title: "Not brought down, mean",
            unit: "UAVs",
            scale: Scale::Linear,
            series: &series,
            limit: None,
        };
        chart.svg_file(&Across::from_zero("time [s]", end_s))
    }
}

/// The command that makes it.
fn command(arguments: &Arguments) -> String {
    let scenario = quoted(arguments.scenario.display());
    format!(
        "boresight eval defence --scenario {scenario} --seeds {}",
        arguments.seeds
    )
}
