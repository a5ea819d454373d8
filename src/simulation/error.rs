//! What keeps a simulation from being opened, going on or being finished.

use crate::app::RunError;
use crate::recording::read::ReadError;
use crate::report::ReportError;
use crate::scenario::{InputError, OrderError};
use crate::systems::capture::CaptureError;
use std::fmt;
use std::path::PathBuf;

/// Why a simulation cannot be opened, go on or be finished. Each prints as one line that names the mend.
///
/// Its `Debug` is that line, too, so that a program whose `main` returns it ends with it.
#[derive(thiserror::Error)]
pub enum SimulationError {
    /// The scenario cannot be read or is not valid.
    #[error(transparent)]
    Scenario(#[from] InputError),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] ReadError),
    /// The run cannot be built, or failed.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Summary or report cannot be written.
    #[error(transparent)]
    Report(#[from] ReportError),
    /// A picture cannot be taken.
    #[error(transparent)]
    Picture(#[from] CaptureError),
    /// An order that nobody can obey.
    #[error(transparent)]
    Order(#[from] OrderError),
    /// Changes to a scenario that has been loaded.
    #[error("{}: is loaded already: give the changes to the one who loads it", .0.display())]
    Changed(PathBuf),
    /// A part of the caller's own cannot be added.
    #[error("{0}")]
    Part(String),
    /// An order after the end.
    #[error("the run is over: an order changes nothing any more")]
    Over,
    /// A snapshot of another run.
    #[error("the snapshot is of another run: a run goes back to its own alone")]
    OtherRun,
    /// A recording would hold what never was.
    #[error("a run that is recorded does not go back: open it without a recording")]
    Recorded,
    /// A step after the run had failed.
    #[error("the run has failed before and cannot go on; open it anew")]
    Failed,
}

impl fmt::Debug for SimulationError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{self}")
    }
}
