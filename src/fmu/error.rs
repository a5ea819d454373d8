//! Why there is no unit.

use crate::app::RunError;
use crate::output::OutputError;
use crate::scenario::InputError;
use std::io;
use std::path::PathBuf;

/// Why there is no unit, or it cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum FmuError {
    /// A scenario that needs more than a unit has.
    #[error("{0}: is not offered in a unit, which renders nothing and holds no network; {1}")]
    Detector(String, &'static str),
    /// A station that is not there.
    #[error("--station {0}: there is no such station: there are {1}")]
    Station(String, String),
    /// No library.
    #[error("{}: is not there; build it (cargo build --release --workspace) or name it with --library", .0.display())]
    Library(PathBuf),
    /// A file that the scenario names.
    #[error("{path}: cannot be taken into the unit: {why}", path = .0.display(), why = .1)]
    File(PathBuf, String),
    /// The scenario as TOML.
    #[error(
        "the scenario cannot be written as TOML: {0}; this is a fault of the program: please report it"
    )]
    Scenario(toml::ser::Error),
    /// The scenario.
    #[error(transparent)]
    Input(#[from] InputError),
    /// Its set-up.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A file.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The archive.
    #[error("{path}: cannot be written: {why}", path = .0.display(), why = .1)]
    Archive(PathBuf, io::Error),
    /// A unit that is not what its description says.
    #[error(
        "the instantiation token is '{0}', and the unit's own is '{1}': description and resources are of two units"
    )]
    Token(String, String),
}
