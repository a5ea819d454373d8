//! The command line.

use crate::run::{self, Options, RunError};
use crate::scenario::Scenario;
use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

/// Simulator of urban laser counter-UAV systems. Simulation only: it drives no real mount and no
/// real laser.
#[derive(Parser, Debug)]
#[command(name = "boresight", version)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    /// Run a scenario without a window.
    Run(RunArgs),
}

#[derive(Args, Debug)]
struct ScenarioArgs {
    /// Scenario file (TOML).
    scenario: PathBuf,
    /// Seed instead of the scenario's.
    #[arg(long)]
    seed: Option<u64>,
    /// Worker threads (default: all cores); changes no result.
    #[arg(long)]
    threads: Option<usize>,
    /// Change a value of the scenario, such as `detector.kind=truth`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

#[derive(Args, Debug)]
struct RunArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Folder for run.mcap, summary.json and report.html.
    #[arg(long, default_value = "out")]
    out: PathBuf,
    /// Render no camera pictures; needs `--set detector.kind=truth`.
    #[arg(long)]
    no_capture: bool,
}

/// Carries out a command line.
pub fn run(cli: Cli) -> Result<(), RunError> {
    match cli.command {
        Command::Run(args) => {
            let loaded = Scenario::load(&args.scenario.scenario, &args.scenario.set)?;
            let options = Options {
                seed: args.scenario.seed,
                threads: args.scenario.threads,
                capture: !args.no_capture,
                out: Some(args.out),
                window: false,
            };
            let mut app = run::build(&loaded, &options)?;
            while !run::step(app.world_mut())? {}
            Ok(())
        }
    }
}
