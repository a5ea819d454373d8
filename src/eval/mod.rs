//! The evaluations: tracking over many runs, a detector on annotated pictures, detector and tracker on
//! clips of real cameras.

pub mod clip;
pub mod detector;
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
use clip::truth::BoxesError;
use detector::coco::CocoError;
use std::path::PathBuf;

/// Why an evaluation cannot be carried out.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// One of its runs.
    #[error(transparent)]
    Run(#[from] RunError),
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
    #[error("{argument}: {value}, must be {low} to {high}")]
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
    /// The field of view does not fit the clip's pictures.
    #[error("--fov-deg: {0}")]
    FieldOfView(CameraError),
    /// The city of the runs.
    #[error("the city of the evaluation: {0}")]
    City(#[from] CityError),
    /// The figures cannot be encoded.
    #[error("cannot encode {path}: {source}")]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
}
