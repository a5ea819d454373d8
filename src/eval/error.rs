//! What keeps an evaluation from being carried out.

use crate::app::RunError;
use crate::experiment::runner::Unmade;
use crate::inference::{DetectorError, RecogniserError};
use crate::media::image::ImageError;
use crate::media::video::VideoError;
use crate::output::OutputError;
use crate::scenario::InputError;
use crate::simulation::SimulationError;
use crate::warning::StrictError;

/// Why an evaluation cannot be carried out.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// What it runs.
    #[error(transparent)]
    Run(#[from] RunError),
    /// One of its runs.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// A recipe, or the scenario of a draw.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A run that the program itself failed in.
    #[error("a fault of the program: {0}")]
    Fault(String),
    /// It was stopped from outside; what it has by then is told where it is caught.
    #[error("stopped before any part of it was whole; the same command begins again")]
    Stopped,
    /// The program itself.
    #[error("this program cannot be run or read: {source}; start it by its path")]
    Program {
        /// What the system said.
        source: std::io::Error,
    },
    /// The detector.
    #[error(transparent)]
    Detector(#[from] DetectorError),
    /// The recogniser.
    #[error(transparent)]
    Recogniser(#[from] RecogniserError),
    /// Warnings that are errors.
    #[error(transparent)]
    Strict(#[from] StrictError),
    /// A clip.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// A picture for a page.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A file that it leaves.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A number of the command line.
    #[error("{argument}: {value} is out of range; give {low} to {high}")]
    OutOfRange {
        /// The argument.
        argument: &'static str,
        /// What was given.
        value: f64,
        /// The least that is taken.
        low: f64,
        /// The most that is taken.
        high: f64,
    },
    /// What only one of the evaluations can meet: an error of its own.
    #[error(transparent)]
    Own(Box<dyn std::error::Error + Send + Sync>),
}

impl From<Unmade> for EvalError {
    fn from(unmade: Unmade) -> Self {
        match unmade {
            Unmade::Stopped => Self::Stopped,
            Unmade::Failed(error) => Self::Simulation(error),
            Unmade::Fault(said) => Self::Fault(said),
        }
    }
}

impl EvalError {
    /// An error of one evaluation's own.
    pub(super) fn own(error: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self::Own(Box::new(error))
    }
}
