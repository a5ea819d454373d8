//! The evaluations: engagements drawn from a recipe, tracking over many runs, a detector on annotated
//! pictures, detector and tracker on clips of real cameras, several stations against a raid.

pub mod clip;
pub mod defence;
pub mod detector;
pub mod engagement;
mod shared;
pub mod statistics;
pub mod tracking;

use crate::app::RunError;
use crate::inference::{DetectorError, RecogniserError};
use crate::media::image::ImageError;
use crate::media::video::VideoError;
use crate::models::ground::city::CityError;
use crate::models::optics::camera::CameraError;
use crate::output::OutputError;
use crate::scenario::InputError;
use crate::warning::StrictError;
use clip::truth::BoxesError;
use detector::coco::CocoError;
use engagement::draw::DrawError;

/// Why an evaluation cannot be carried out.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// One of its runs.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A recipe, or the scenario of a draw.
    #[error(transparent)]
    Input(#[from] InputError),
    /// An engagement that cannot be drawn.
    #[error(transparent)]
    Drawn(#[from] DrawError),
    /// A draw whose process failed.
    #[error("draw {index} ({status}): {message}; `--draw {index}` makes it alone")]
    Draw {
        /// Its number.
        index: u32,
        /// How its process ended.
        status: std::process::ExitStatus,
        /// What that said last.
        message: String,
    },
    /// The record of a draw is gone.
    #[error("draw {index} has no record of this evaluation; run the command again")]
    NoDraw {
        /// Its number.
        index: u32,
    },
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
    /// Annotated pictures.
    #[error(transparent)]
    Coco(#[from] CocoError),
    /// The boxes of clips.
    #[error(transparent)]
    Boxes(#[from] BoxesError),
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
    /// No picture is of the half asked for.
    #[error(
        "--half: no picture is of that half; clips belong to one by the last number in their names"
    )]
    EmptyHalf,
    /// The field of view does not fit the clip's pictures.
    #[error("--fov-deg: {0}; give another angle")]
    FieldOfView(CameraError),
    /// The city of the runs.
    #[error("the city of the evaluation: {0}; this is a fault of the program: please report it")]
    City(#[from] CityError),
}
