//! The command line.

use crate::app::{self, Options, RunError};
use crate::components::environment::Environment;
use crate::components::run::RunScenario;
use crate::dataset::{self, DatasetError};
use crate::eval::{self, EvalError};
use crate::experiment::diff::{Comparison, Tolerances};
use crate::experiment::{self, ExperimentError};
use crate::fit_detector;
use crate::fmu::{self, FmuError};
use crate::georef::{self, GeorefError};
use crate::lint;
use crate::new::{self, NewError};
use crate::output::{self, OutputError};
use crate::progress::Progress;
use crate::recording::film::{self, FilmError};
use crate::recording::read::Recorded;
use crate::report::summary::{self, Finished};
use crate::scenario::catalogue::{self, UavError};
use crate::scenario::{self, Faults, Loaded, Scenario};
use crate::serve::{self, ServeError};
use crate::simulation::{Builder, Simulation, SimulationError, UavView, View};
use crate::stop;
use crate::tiles_command::{self as tiles, Tiles};
use crate::tune::{self, TuneError};
use crate::validate::{self, ValidateError};
use crate::view::{self, ViewError};
use crate::warning::{self, StrictError};
use clap::{Args, Parser, Subcommand};
use std::ffi::OsString;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// `println!` that does not mind a closed pipe: `boresight run … | head` is no error.
macro_rules! say {
    ($($argument:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stdout(), $($argument)*);
    }};
}

/// Why a command cannot be carried out. Each prints as one line that says what to do about it.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// A run.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A run from its opening to what it leaves.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// An evaluation.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// A warning where none is wanted.
    #[error(transparent)]
    Strict(#[from] StrictError),
    /// A film.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// An experiment.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// The placement of a model.
    #[error(transparent)]
    Georef(#[from] GeorefError),
    /// The tuning of a mount.
    #[error(transparent)]
    Tune(#[from] TuneError),
    /// A measured detector.
    #[error(transparent)]
    Fit(#[from] fit_detector::FitError),
    /// A file that a command leaves.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A new scenario.
    #[error(transparent)]
    New(#[from] NewError),
    /// A run for clients.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// A unit for co-simulation.
    #[error(transparent)]
    Fmu(#[from] FmuError),
    /// A window.
    #[error(transparent)]
    View(#[from] ViewError),
    /// A tileset.
    #[error(transparent)]
    Tiles(#[from] tiles::CommandError),
    /// A set of annotated pictures.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// A file of the catalogue.
    #[error(transparent)]
    Uav(#[from] UavError),
    /// The checks of the models.
    #[error(transparent)]
    Validate(#[from] ValidateError),
    /// The time of a picture of the window.
    #[error("--screenshot: '{0}' is not a number of seconds; give FILE SECONDS")]
    Seconds(String),
    /// An option that only a simulation has.
    #[error("{0}: a recording is played back as it is; with --simulate its scenario runs again")]
    PlaysBack(&'static str),
    /// A second file beside a simulation.
    #[error("{}: only recordings are shown beside each other; give two of them (.mcap)", .0.display())]
    Beside(PathBuf),
    /// A run would write over the recording that it is made from.
    #[error("{}: the new recording would take its place; name another folder with --out", .0.display())]
    Overwrites(PathBuf),
}

/// Simulator of urban laser counter-UAV systems. Simulation only: it drives no real mount and no
/// real laser.
#[derive(Parser, Debug)]
#[command(name = "boresight", version)]
pub struct Cli {
    /// Warnings are errors: the command ends with 2 where something is warned of: of its input before its work, of what
    /// it leaves behind it.
    #[arg(long, global = true)]
    strict: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand, Debug)]
enum Command {
    /// Run a scenario without a window; leaves run.mcap, summary.json and report.html.
    Run(RunArgs),
    /// Open the same simulation in a window, or play recordings back.
    View(ViewArgs),
    /// Serve a run to clients in other programs: they step it, look at it and give it orders, over a socket.
    Serve(ServeArgs),
    /// Write a station of a scenario as a co-simulation unit (FMI 3.0), for Simulink, Modelica tools and others.
    Fmu(FmuArgs),
    /// Check a scenario without running it: all errors at once, warnings of what makes no sense, and who is seen when, from
    /// where and how large.
    Check(CheckArgs),
    /// Write a commented scenario to start from, and the schema by which editors complete it.
    New(new::Arguments),
    /// Hold scenarios to what they expect of their runs. Ends with 0 where all is met, with 1 where something is
    /// not, with 2 where a scenario cannot be run.
    Test(experiment::test::Arguments),
    /// Make a film of a recording.
    Video(film::Arguments),
    /// Compare two recordings, or a recording and a new run of the scenario inside it: equal, or where they part
    /// and what follows. Ends with 0 where they are equal, with 1 where they are not.
    Diff(experiment::diff::Arguments),
    /// Carry out an experiment: a scenario with factors varied, on all cores; leaves a table and a page. Ends with 0
    /// where every run has its figures, with 1 where a run failed, with 2 where the experiment cannot be carried out.
    Sweep(experiment::sweep::Arguments),
    /// Measure the loops of a scenario's mount: margins, bandwidths, Bode and step plots, and the
    /// gains that follow.
    Tune(TuneArgs),
    /// Fit where a local model stands on the Earth to ground control points. Ends with 1 where a point that is used does not
    /// belong with the others.
    Georef(georef::Arguments),
    /// Measure the tracking over many runs and write numbers, pictures and a page.
    #[command(subcommand)]
    Eval(EvalCommand),
    /// Make a measured detector, which needs no pictures, of what a network and a recogniser said in engagements on rendered
    /// pixels.
    FitDetector(fit_detector::Arguments),
    /// Render annotated pictures for training and testing detectors, from a recipe.
    Dataset(dataset::Arguments),
    /// Run scenarios and write the last seconds of their tracks, for training a recogniser.
    Tracks(dataset::tracks::Arguments),
    /// Real cities as 3D Tiles.
    #[command(subcommand)]
    Tiles(Tiles),
    /// Hold every model to closed forms and published values; leaves report.html, checks.json and plots. Ends with 0 where
    /// every check is green, with 1 where one is red.
    Validate(validate::Arguments),
    /// List the UAV models.
    Models,
    /// Say what this machine offers: graphics adapter, ONNX Runtime, threads.
    Doctor,
    /// Write the scenario format's JSON Schema and reference page.
    Schema {
        /// Folder for scenarios.schema.json and scenarios.md.
        #[arg(long, default_value = "docs")]
        out: PathBuf,
    },
}

#[derive(Subcommand, Debug)]
enum EvalCommand {
    /// Acquisition, tracking and pointing: the paper's Table 2, the jitter budget, manoeuvres,
    /// occlusion, several targets.
    Tracking(eval::tracking::Arguments),
    /// Engagements drawn from a recipe, on rendered pixels: acquired, held, neutralised, and each failure
    /// with its cause and the frames that show it.
    Engagement(eval::engagement::Arguments),
    /// What each term and rule of the tracker brings: the same engagements with all of them and without each.
    Ablation(eval::ablation::Arguments),
    /// A detector on annotated pictures (COCO): average precision, recall, miss distance, size and speed.
    Detector(eval::detector::Arguments),
    /// A detector and the tracker on real clips: MP4 files or folders of pictures.
    Clip(eval::clip::Arguments),
}

#[derive(Args, Debug)]
struct ScenarioArgs {
    /// Scenario file (TOML), or a recording (MCAP): the scenario inside it, with its seed.
    scenario: PathBuf,
    /// Change a value of the scenario, such as `detector.kind=truth`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl ScenarioArgs {
    /// The scenario, and the seed of the recording it is from.
    fn load(&self) -> Result<(Loaded, Option<u64>), CliError> {
        if self.scenario.extension().is_some_and(|end| end == "mcap") {
            let recorded = Recorded::open(&self.scenario).map_err(ExperimentError::from)?;
            let loaded = recorded.scenario(&self.set).map_err(RunError::from)?;
            return Ok((loaded, Some(recorded.seed)));
        }
        let loaded = Scenario::load(&self.scenario, &self.set).map_err(RunError::from)?;
        Ok((loaded, None))
    }

    /// As [`Self::load`], with all errors of a scenario file.
    fn load_all(&self) -> Result<Result<Loaded, Faults>, CliError> {
        match self.scenario.extension().is_some_and(|end| end == "mcap") {
            true => Ok(Ok(self.load()?.0)),
            false => Ok(Scenario::load_all(&self.scenario, &self.set)),
        }
    }

    /// Refuses an output folder whose recording is the one that is run again.
    fn keeps(&self, out: &Path) -> Result<(), CliError> {
        let real = |path: &Path| path.canonicalize().ok();
        let own = real(&out.join("run.mcap"));
        if own.is_some() && own == real(&self.scenario) {
            return Err(CliError::Overwrites(self.scenario.clone()));
        }
        Ok(())
    }
}

#[derive(Args, Debug)]
struct CheckArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Write a map as SVG: buildings, stations, sectors, paths.
    #[arg(long, value_name = "FILE")]
    map: Option<PathBuf>,
}

#[derive(Args, Debug)]
struct RunArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Seed instead of the scenario's.
    #[arg(long)]
    seed: Option<u64>,
    /// Worker threads (default: all cores); changes no result.
    #[arg(long)]
    threads: Option<usize>,
    /// Folder for run.mcap, summary.json and report.html.
    #[arg(long, default_value = "out")]
    out: PathBuf,
    /// Render no camera pictures; needs `--set detector.kind=truth`.
    #[arg(long)]
    no_capture: bool,
    #[command(flatten)]
    live: LiveArgs,
    /// Simulated seconds per wall-clock second at most, such as 1 (default: as fast as it goes); changes no result.
    #[arg(long, value_parser = pace)]
    pace: Option<f64>,
}

#[derive(Args, Debug)]
struct ServeArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Seed instead of the scenario's.
    #[arg(long)]
    seed: Option<u64>,
    /// Worker threads (default: all cores); changes no result.
    #[arg(long)]
    threads: Option<usize>,
    /// Folder for run.mcap, summary.json, report.html, and scenario.toml, which repeats the run without its clients;
    /// nothing is written without it.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Render no camera pictures; needs `--set detector.kind=truth`, or `outside`.
    #[arg(long)]
    no_capture: bool,
    /// Go by the clock, so many simulated seconds a second, such as 1 (default: wait for clients to step).
    #[arg(long, value_parser = pace)]
    pace: Option<f64>,
    #[command(flatten)]
    serve: serve::Arguments,
}

#[derive(Args, Debug)]
struct FmuArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    #[command(flatten)]
    fmu: fmu::Arguments,
}

#[derive(Args, Debug)]
struct LiveArgs {
    /// Serve the recording's topics to Foxglove over its WebSocket while the run goes on, on this address and port;
    /// port 0 is a free one. Only this machine reaches the default.
    #[arg(
        long = "live",
        value_name = "ADDRESS",
        num_args = 0..=1,
        default_missing_value = "127.0.0.1:8765",
        value_parser = address
    )]
    address: Option<SocketAddr>,
}

/// An address by number or name, such as `localhost:8765`.
fn address(text: &str) -> Result<SocketAddr, String> {
    let wanted = "expected an address and a port, such as 127.0.0.1:8765";
    let mut found = text
        .to_socket_addrs()
        .map_err(|e| format!("{wanted} ({e})"))?;
    found.next().ok_or(wanted.to_owned())
}

fn pace(text: &str) -> Result<f64, &'static str> {
    let usable = |pace: &f64| pace.is_finite() && *pace > 0.0;
    let pace = text.parse().ok().filter(usable);
    pace.ok_or("must be a number above 0")
}

#[derive(Args, Debug)]
struct ViewArgs {
    /// Scenario file (TOML) to simulate, or recording (MCAP) to play back.
    file: PathBuf,
    /// A second recording, played back beside the first.
    beside: Option<PathBuf>,
    /// Simulate the scenario in a recording again instead of playing it back.
    #[arg(long)]
    simulate: bool,
    /// Change a value of the scenario, such as `detector.kind=truth`; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seed instead of the scenario's.
    #[arg(long)]
    seed: Option<u64>,
    /// Folder for a recording; nothing is written without it.
    #[arg(long)]
    out: Option<PathBuf>,
    #[command(flatten)]
    live: LiveArgs,
    /// Save a picture of the window here after that many seconds of simulated time and close.
    #[arg(long, num_args = 2, value_names = ["FILE", "SECONDS"])]
    screenshot: Option<Vec<String>>,
    /// Write the scenario with the orders given in the window here: run again, it repeats the session.
    #[arg(long, value_name = "FILE")]
    save_orders: Option<PathBuf>,
}

#[derive(Args, Debug)]
struct TuneArgs {
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// Axis of the gimbal.
    #[arg(long, value_enum, default_value = "azimuth")]
    axis: tune::AxisName,
    /// Folder for tune.json and tune.html.
    #[arg(long, default_value = "out")]
    out: PathBuf,
}

/// The whole program: reads the command line, the program's name first, carries it out, says what failed, and returns the
/// exit code. Bad input of every kind ends with 2, so that scripts can tell it from a crash and from a stop.
pub fn program(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are errors to the parser. Nobody is left to be told of a closed pipe.
            let _ = error.print();
            return u8::try_from(error.exit_code()).unwrap_or(2);
        }
    };
    run(cli).unwrap_or_else(|error| {
        eprintln!("error: {error}");
        ended(2)
    })
}

/// Carries out a command line, and returns the exit code.
fn run(cli: Cli) -> Result<u8, CliError> {
    if cli.strict {
        warning::be_strict();
    }
    let done: Result<(), CliError> = match cli.command {
        Command::Test(args) => {
            stop::listen();
            let tests = experiment::test::test(&args)?;
            say!("{}", tests.text());
            return Ok(ended(tests.exit_code()));
        }
        Command::Sweep(args) => {
            stop::listen();
            let swept = experiment::sweep::sweep(&args)?;
            say!("{}", swept.text());
            if swept.table {
                say!("table {}", args.out.join("table.parquet").display());
                say!("page  {}", args.out.join("sweep.html").display());
            }
            return Ok(ended(swept.exit_code()));
        }
        Command::Video(args) => {
            let pictures = film::film(&args)?;
            say!("film  {} ({pictures} pictures)", args.film.display());
            Ok(())
        }
        Command::Diff(args) => {
            let comparison = diff(&args)?;
            say!("{}", comparison.text());
            return Ok(u8::from(!comparison.equal()));
        }
        Command::Run(args) => {
            let (loaded, seed) = args.scenario.load()?;
            args.scenario.keeps(&args.out)?;
            let options = Options {
                seed: args.seed.or(seed),
                threads: args.threads,
                capture: !args.no_capture,
                out: Some(args.out.clone()),
                live: args.live.address,
                pace: args.pace,
                log: true,
                ..Options::default()
            };
            let pace = options.pace;
            let run = Builder::loaded(loaded).options(options).open()?;
            // From here on there is something to end whole; before, a signal ends the program.
            stop::listen();
            let finished = run_to_end(run, pace)?;
            say!("{}", summary::table(&finished.summary).trim_end());
            say!("report  {}", args.out.join("report.html").display());
            if let Some(t_s) = finished.summary.stopped_s {
                let [run, sums, page] = ["run.mcap", "summary.json", "report.html"]
                    .map(|name| args.out.join(name).display().to_string());
                let there = format!(
                    "{run}, {sums} and {page} hold the run to {t_s:.2} s; the same command makes it whole, from its \
                     beginning"
                );
                say!("{}", stop::said(&there).unwrap_or(there));
            }
            warning::tell(&finished.warnings)?;
            return Ok(ended(0));
        }
        Command::Serve(args) => {
            let (loaded, seed) = args.scenario.load()?;
            args.out
                .iter()
                .try_for_each(|out| args.scenario.keeps(out))?;
            let options = Options {
                seed: args.seed.or(seed),
                threads: args.threads,
                capture: !args.no_capture && !loaded.scenario.detector.is_blind(),
                on_demand: !args.no_capture && loaded.scenario.detector.is_blind(),
                out: args.out.clone(),
                pace: args.pace,
                log: true,
                ..Options::default()
            };
            let finished = serve::serve(&args.serve, loaded, options)?;
            say!("{}", summary::table(&finished.summary).trim_end());
            if let Some(out) = &args.out {
                say!("report  {}", out.join("report.html").display());
            }
            warning::tell(&finished.warnings)?;
            return Ok(ended(0));
        }
        Command::Fmu(args) => {
            let (loaded, _) = args.scenario.load()?;
            fmu::export(&args.fmu, &loaded)?;
            say!("unit  {}", args.fmu.out.display());
            Ok(())
        }
        Command::View(args) => return view(args),
        Command::Check(args) => return check(&args),
        Command::New(args) => {
            let [path, schema] = new::new(&args)?;
            say!("scenario  {}", path.display());
            say!("schema    {} (for editors)", schema.display());
            say!(
                "next      boresight check {}",
                output::quoted(path.display())
            );
            Ok(())
        }
        Command::Tune(args) => {
            let (loaded, _) = args.scenario.load()?;
            let tuning = tune::Tuning::measure(&loaded, args.axis)?;
            say!("{}", tuning.table().trim_end());
            let page = tuning.write(&args.out)?;
            say!("page  {}", page.display());
            Ok(())
        }
        Command::Eval(command) => return eval(command),
        Command::FitDetector(args) => {
            say!("{}", fit_detector::carry_out(&args)?);
            Ok(())
        }
        Command::Dataset(args) => {
            stop::listen();
            say!("{}", dataset::dataset(&args)?.trim_end());
            return Ok(ended(0));
        }
        Command::Tracks(args) => {
            stop::listen();
            say!("{}", dataset::tracks::tracks(&args)?.trim_end());
            return Ok(ended(0));
        }
        Command::Georef(args) => {
            let found = georef::georeference(&args)?;
            say!("{}", found.to_text().trim_end());
            if let Some(out) = &args.out {
                found.write(out)?;
                say!("wrote {}", out.display());
            }
            if !found.sound() {
                return Ok(1);
            }
            Ok(())
        }
        Command::Tiles(command) => {
            let (text, code) = tiles::run(&command)?;
            say!("{}", text.trim_end());
            return Ok(code);
        }
        Command::Validate(args) => {
            let found = validate::validate(&args)?;
            if args.json {
                say!("{}", found.json().map_err(ValidateError::from)?);
            } else {
                say!("{}", found.text().trim_end());
                say!("page  {}", args.out.join("report.html").display());
            }
            return Ok(found.exit_code());
        }
        Command::Models => {
            say!("{}", models()?.trim_end());
            Ok(())
        }
        Command::Doctor => {
            doctor();
            Ok(())
        }
        Command::Schema { out } => {
            output::create_dir(&out)?;
            for (name, text) in [
                ("scenarios.schema.json", scenario::json_schema()),
                ("scenarios.md", scenario::docs_markdown()),
            ] {
                let path = out.join(name);
                output::write(&path, text)?;
                say!("{}", path.display());
            }
            Ok(())
        }
    };
    done.map(|()| 0)
}

/// How a command ends that can be stopped: by what stopped it, else with `code`.
fn ended(code: u8) -> u8 {
    stop::asked().map_or(code, stop::Stop::exit_code)
}

/// Carries out an evaluation.
fn eval(command: EvalCommand) -> Result<u8, CliError> {
    // A draw of its own process leaves nothing until it is whole: a signal ends it at once.
    if !matches!(&command, EvalCommand::Engagement(args) if args.draw.is_some()) {
        stop::listen();
    }
    let (text, left) = match command {
        EvalCommand::Tracking(args) => {
            let page = args.out.join("tracking.html");
            (
                eval::tracking::evaluate(&args)?.text(),
                Some(("page", page)),
            )
        }
        EvalCommand::Engagement(args) => (eval::engagement::evaluate(&args)?, None),
        EvalCommand::Ablation(args) => (eval::ablation::evaluate(&args)?, None),
        EvalCommand::Detector(args) => {
            let page = args.out.join("detector.html");
            (
                eval::detector::evaluate(&args)?.text(),
                Some(("page", page)),
            )
        }
        EvalCommand::Clip(args) => {
            let page = args.out.join("clip.html");
            (eval::clip::evaluate(&args)?.text(), Some(("page", page)))
        }
    };
    say!("{}", text.trim_end());
    if let Some((what, path)) = left {
        say!("{what}  {}", path.display());
    }
    Ok(ended(0))
}

/// Checks a scenario: its text, its set-up, and what of it makes no sense.
fn check(args: &CheckArgs) -> Result<u8, CliError> {
    use std::io::Write as _;
    let loaded = match args.scenario.load_all()? {
        Ok(loaded) => loaded,
        Err(faults) => {
            for error in faults.all() {
                // A closed pipe is no error.
                let _ = writeln!(std::io::stderr(), "error: {error}");
            }
            return Ok(2);
        }
    };
    let set_up = app::checked(&loaded)?;
    // With changes it is another scenario than the one that expects.
    let unchanged = args.scenario.set.is_empty();
    if let Some(expect) = loaded.scenario.expected.as_ref().filter(|_| unchanged) {
        experiment::test::check(&loaded, expect).map_err(ExperimentError::from)?;
    }
    let world = set_up.world();
    let environment = world.resource::<Environment>();
    let scene = lint::Scene {
        loaded: &world.resource::<RunScenario>().0,
        city: &environment.city,
        weather: environment.weather,
        sun_dir_enu: environment.backdrop.sun_dir_enu,
    };
    say!("city  {}", environment.describe());
    let table = lint::table(&scene);
    if !table.is_empty() {
        say!("{}", table.trim_end());
    }
    if let Some(map) = &args.map {
        output::put(map, lint::svg(&scene))?;
        say!("map   {}", map.display());
    }
    let warnings = lint::warnings(&scene);
    warning::tell(&warnings)?;
    match warning::told() {
        0 => say!("{}: ok", loaded.path.display()),
        count => say!(
            "{}: ok, {}",
            loaded.path.display(),
            output::counted(count, "warning")
        ),
    }
    Ok(0)
}

/// Compares two recordings, or one and a new run of its scenario.
fn diff(args: &experiment::diff::Arguments) -> Result<Comparison, CliError> {
    let tolerances = Tolerances::parse(&args.tolerance)?;
    let open = |path: &Path| -> Result<Recorded, ExperimentError> {
        let recorded = Recorded::open(path)?;
        recorded.check()?;
        Ok(recorded)
    };
    let a = open(&args.a)?;
    if let Some(b) = &args.b {
        return Ok(Comparison::of(&a, &open(b)?, &tolerances));
    }
    let folder = tempfile::tempdir().map_err(ExperimentError::Folder)?;
    let options = Options {
        seed: Some(a.seed),
        capture: a.has_pictures(),
        out: Some(folder.path().into()),
        log: true,
        ..Options::default()
    };
    let again = a.scenario(&[]).map_err(RunError::from)?;
    run_to_end(Builder::loaded(again).options(options).open()?, None)?;
    let b = open(&folder.path().join("run.mcap"))?;
    Ok(Comparison::of(&a, &b, &tolerances))
}

/// Runs a scenario in a window, or plays recordings back in one.
fn view(args: ViewArgs) -> Result<u8, CliError> {
    let screenshot = match args.screenshot.as_deref() {
        Some([file, seconds]) => {
            let at_s = (seconds.parse()).map_err(|_| CliError::Seconds(seconds.clone()))?;
            Some((PathBuf::from(file), at_s))
        }
        _ => None,
    };
    let recorded = args.file.extension().is_some_and(|end| end == "mcap");
    if recorded && !args.simulate {
        let only_simulated = [
            (!args.set.is_empty(), "--set"),
            (args.seed.is_some(), "--seed"),
            (args.out.is_some(), "--out"),
            (args.save_orders.is_some(), "--save-orders"),
            (args.live.address.is_some(), "--live"),
        ];
        if let Some((_, name)) = only_simulated.into_iter().find(|(given, _)| *given) {
            return Err(CliError::PlaysBack(name));
        }
        let recordings: Result<Vec<_>, _> = (std::iter::once(&args.file).chain(&args.beside))
            .map(|path| Recorded::open(path).map_err(ExperimentError::from))
            .collect();
        stop::listen();
        view::play(recordings?, screenshot)?;
        return Ok(ended(0));
    }
    if let Some(beside) = args.beside {
        return Err(CliError::Beside(beside));
    }
    let scenario = ScenarioArgs {
        scenario: args.file,
        set: args.set,
    };
    let (loaded, seed) = scenario.load()?;
    args.out.iter().try_for_each(|out| scenario.keeps(out))?;
    let options = Options {
        seed: args.seed.or(seed),
        capture: true,
        out: args.out,
        live: args.live.address,
        window: true,
        log: true,
        ..Options::default()
    };
    let keep = view::Keep {
        screenshot,
        orders: args.save_orders,
    };
    stop::listen();
    if let Some(finished) = view::view(&loaded, &options, &keep)? {
        say!("{}", summary::table(&finished.summary).trim_end());
        let kept = (options.out.iter().chain(&keep.orders)).map(|path| path.display().to_string());
        let kept: Vec<String> = kept.collect();
        let there = match kept.is_empty() {
            true => "nothing was asked to be kept (--out, --save-orders)".to_owned(),
            false => format!("{} hold the session", kept.join(" and ")),
        };
        if let Some(said) = stop::said(&there) {
            say!("{said}");
        }
        warning::tell(&finished.warnings)?;
    }
    Ok(ended(0))
}

/// Lets a run go to its end, or until it is stopped from outside, and writes what it leaves.
fn run_to_end(mut run: Simulation, pace: Option<f64>) -> Result<Finished, SimulationError> {
    let scenario = &run.scenario().scenario;
    let (name, duration_s) = (scenario.name.clone(), scenario.duration_s);
    // The bar's position counts milliseconds of simulated time.
    let progress = Progress::new((1e3 * duration_s) as u64, "{prefix} [{bar:16}] {msg}{left}");
    let bar = progress.bar();
    bar.set_prefix(name.clone());
    bar.set_message("begins");
    let started = Instant::now();
    let mut shown = started;
    loop {
        let over = run.step(1)?;
        if over || shown.elapsed() > Duration::from_millis(200) {
            shown = Instant::now();
            let t_s = run.t_s();
            let state = state(run.view(), started.elapsed());
            bar.set_position((1e3 * t_s) as u64);
            bar.set_message(format!("{t_s:.1} s {state}"));
            bar.tick();
            progress.say(|| format!("{name}: {t_s:.1} of {duration_s} s {state}"));
        }
        if over {
            break;
        }
        if let Some(pace) = pace {
            let due = Duration::try_from_secs_f64(run.t_s() / pace).unwrap_or(Duration::MAX);
            std::thread::sleep(due.saturating_sub(started.elapsed()));
        }
    }
    bar.finish_and_clear();
    run.finish()
}

/// Factor of real time, the first station's state, and UAVs brought down, of a run that took so long.
fn state(view: View, elapsed: Duration) -> String {
    let state = view
        .stations()
        .next()
        .map_or("", |first| first.state().name());
    let down = |uav: &UavView| uav.fate().is_some_and(|fate| fate.neutralised_s.is_some());
    let down = view.uavs().filter(down).count();
    let factor = view.t_s() / elapsed.as_secs_f64().max(1e-9);
    format!("at {factor:.2}x, {state}, {down} neutralised")
}

/// The catalogue as a table.
fn models() -> Result<String, UavError> {
    const HEAD: [&str; 6] = ["name", "model", "mass kg", "diagonal m", "props", "max m/s"];
    let mut rows = Vec::new();
    for name in catalogue::names() {
        let uav = catalogue::load(name)?;
        rows.push(vec![
            name.to_owned(),
            uav.name.clone(),
            format!("{:.3}", uav.mass_kg),
            format!("{:.3}", uav.diagonal_m),
            uav.rotor_count.to_string(),
            format!("{:.0}", uav.v_max_mps),
        ]);
    }
    Ok(output::columns(&HEAD, &rows, 2))
}

fn doctor() {
    say!("boresight {}", crate::VERSION);
    match app::adapter() {
        Ok(info) => say!(
            "adapter       {} ({:?}, {:?}, {})",
            info.name,
            info.device_type,
            info.backend,
            info.driver_info
        ),
        Err(error) => say!("adapter       none: {error}"),
    }
    match crate::inference::runtime_path() {
        Ok(path) => {
            say!("onnx runtime  {}", path.display());
            match crate::inference::providers() {
                Ok(names) => say!("providers     {}", names.join(", ")),
                Err(error) => say!("providers     {error}"),
            }
        }
        Err(error) => say!("onnx runtime  none: {error}"),
    }
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    say!("threads       {threads}");
}
