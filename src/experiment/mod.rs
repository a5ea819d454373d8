//! Experiments on scenarios: what a run must show, and how it is found out.

pub mod diff;
pub mod figures;
pub mod runner;
pub mod sweep;
pub mod test;

use crate::output::OutputError;
use crate::recording::read::ReadError;
use crate::scenario::InputError;
use std::path::PathBuf;

/// Why an experiment cannot be carried out.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A scenario.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A file that it leaves.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A path without scenarios.
    #[error("{}: {what}", path.display())]
    Path {
        /// The path.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A tolerance of `diff`.
    #[error("--tolerance {0}: is no tolerance; write FIELD=MOST such as azimuth_rad=1e-9")]
    Tolerance(String),
    /// No folder for what is thrown away afterwards.
    #[error("no temporary folder: {0}; set TMPDIR to one with room")]
    Folder(std::io::Error),
    /// The program cannot be read to tell its build from others.
    #[error("this program cannot be read: {0}; start it by its path")]
    Program(std::io::Error),
    /// A recording.
    #[error(transparent)]
    Recording(#[from] ReadError),
    /// What was found cannot be written as JSON or XML.
    #[error("{}: cannot be written: {message}; name another file or folder", path.display())]
    Text {
        /// The file.
        path: PathBuf,
        /// What the writer says.
        message: String,
    },
}
