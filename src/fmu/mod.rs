//! `boresight fmu`: a station of a scenario as a co-simulation unit of FMI 3.0, for Simulink, Modelica tools and others.
//!
//! A unit is an archive: its description, the library that runs the simulation (the crate `boresight-fmu`), and the
//! scenario with what it names. What description and library share is [`VARIABLES`].

mod bundle;
mod description;
mod error;
mod variables;

pub use description::IDENTIFIER;
pub use error::FmuError;
pub use variables::{
    Causality, STATES, TIME, Type, VARIABLES, Variable, number_of, reference, variable,
};

use crate::app;
use crate::scenario::{Loaded, Scenario};
use clap::Args;
use description::Described;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Where a unit has its library.
const PLATFORM: &str = "binaries/x86_64-linux";
/// The library as it is built.
const BUILT: &str = "libboresight_fmu.so";
/// The guide inside the unit.
const GUIDE: &str = include_str!("../../docs/fmu.md");

/// What `boresight fmu` is asked for, beside the scenario.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// File of the unit.
    #[arg(long, default_value = "station.fmu")]
    pub out: PathBuf,
    /// Name of the station that the unit is (default: the first).
    #[arg(long)]
    station: Option<String>,
    /// The library that runs the simulation (default: libboresight_fmu.so beside the program).
    #[arg(long, value_name = "FILE")]
    library: Option<PathBuf>,
}

/// Writes a unit.
pub fn export(args: &Arguments, loaded: &Loaded) -> Result<(), FmuError> {
    let scenario = &loaded.scenario;
    offered(scenario)?;
    let station = station_of(scenario, args.station.as_deref())?;
    let library = library(args)?;
    let staged = tempfile::tempdir().map_err(|error| FmuError::Archive(args.out.clone(), error))?;
    let resources = staged.path();
    let from = loaded.path.parent().unwrap_or(Path::new("."));
    let text = bundle::write(scenario, from, resources)?;
    crate::output::put(&resources.join(bundle::STATION), &station)?;
    // What is missing among the resources is found now, and not by who opens the unit.
    let token = token(&text, &station);
    let (again, _) = opened(resources, &token)?;
    app::check(&again)?;
    let may_fire = scenario.engage.authorised;
    let xml = description::xml(&Described {
        name: &scenario.name,
        description: &scenario.description,
        station: &station,
        token: &token,
        seed: scenario.seed,
        may_fire,
        tick_hz: scenario.tick_hz,
        duration_s: scenario.duration_s,
    });
    let written = archive(&args.out, &xml, &library, resources);
    written.map_err(|error| FmuError::Archive(args.out.clone(), error))
}

/// The scenario and the station of a unit, from its resources; `token` is what its description says.
pub fn opened(resources: &Path, token: &str) -> Result<(Loaded, String), FmuError> {
    let read = |name: &str| {
        let path = resources.join(name);
        fs::read_to_string(&path).map_err(|error| FmuError::File(path, error.to_string()))
    };
    let (text, station) = (read(bundle::SCENARIO)?, read(bundle::STATION)?);
    let own = self::token(&text, &station);
    if own != token {
        return Err(FmuError::Token(token.to_owned(), own));
    }
    let path = resources.join(bundle::SCENARIO);
    let plain = Scenario::load(&path, &[]);
    // A file of a UAV is not found before it is said where it lies.
    let text = toml::from_str::<Scenario>(&text).ok();
    let changes = text.map(|scenario| bundle::found_in(&scenario, resources));
    let loaded = match changes.filter(|changes| !changes.is_empty()) {
        Some(changes) => Scenario::load(&path, &changes)?,
        None => plain?,
    };
    Ok((loaded, station))
}

/// What description and resources of one unit have in common.
fn token(scenario: &str, station: &str) -> String {
    let version = crate::VERSION;
    let hash = xxh3_64(format!("{version}\n{station}\n{scenario}").as_bytes());
    format!("boresight-{version}-{hash:016x}")
}

/// Refuses what a unit has no part for.
fn offered(scenario: &Scenario) -> Result<(), FmuError> {
    if !scenario.detector.is_truth() {
        let kind = format!("detector.kind = \"{}\"", scenario.detector.kind);
        return Err(FmuError::Detector(kind, "set detector.kind=truth"));
    }
    if scenario.recogniser.onnx_model.is_some() {
        let named = "recogniser.onnx_model".to_owned();
        return Err(FmuError::Detector(named, "leave it out"));
    }
    Ok(())
}

fn station_of(scenario: &Scenario, wanted: Option<&str>) -> Result<String, FmuError> {
    let names: Vec<String> = scenario
        .stations()
        .into_iter()
        .map(|station| station.name)
        .collect();
    match wanted {
        None => Ok(names.into_iter().next().unwrap_or_default()),
        Some(name) if names.iter().any(|own| own == name) => Ok(name.to_owned()),
        Some(name) => Err(FmuError::Station(name.to_owned(), names.join(", "))),
    }
}

/// Where the library lies.
fn library(args: &Arguments) -> Result<PathBuf, FmuError> {
    let beside = || {
        let program = std::env::current_exe().and_then(|path| path.canonicalize());
        let program = program.unwrap_or_default();
        program.with_file_name(BUILT)
    };
    let path = args.library.clone().unwrap_or_else(beside);
    match path.is_file() {
        true => Ok(path),
        false => Err(FmuError::Library(path)),
    }
}

/// Puts the unit together. It takes its name once it is whole.
fn archive(out: &Path, xml: &str, library: &Path, resources: &Path) -> io::Result<()> {
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let file = tempfile::NamedTempFile::new_in(folder)?;
    let mut zip = ZipWriter::new(file.as_file());
    let deflated = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .large_file(true);
    zip.start_file("modelDescription.xml", deflated)?;
    zip.write_all(xml.as_bytes())?;
    zip.start_file(
        format!("{PLATFORM}/{IDENTIFIER}.so"),
        deflated.unix_permissions(0o755),
    )?;
    io::copy(&mut File::open(library)?, &mut zip)?;
    zip.start_file("documentation/fmu.md", deflated)?;
    zip.write_all(GUIDE.as_bytes())?;
    let mut waiting = vec![resources.to_owned()];
    while let Some(at) = waiting.pop() {
        let mut below: Vec<PathBuf> = (fs::read_dir(&at)?.map(|entry| entry.map(|of| of.path())))
            .collect::<io::Result<_>>()?;
        below.sort_unstable();
        for path in below {
            if path.is_dir() {
                waiting.push(path);
                continue;
            }
            let name = path.strip_prefix(resources).map_err(io::Error::other)?;
            let name = name.to_string_lossy().replace('\\', "/");
            zip.start_file(format!("resources/{name}"), deflated)?;
            io::copy(&mut File::open(&path)?, &mut zip)?;
        }
    }
    zip.finish()?;
    let kept = file.persist(out).map_err(|error| error.error)?;
    kept.set_permissions(std::os::unix::fs::PermissionsExt::from_mode(0o644))
}
