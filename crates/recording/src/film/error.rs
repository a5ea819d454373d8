//! Why there is no film.

use crate::media::image::ImageError;
use crate::media::video::VideoError;
use crate::read::ReadError;
use std::path::PathBuf;

/// Why there is no film. Each prints as one line.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A picture of it.
    #[error("{}: a picture cannot be read: {source}; make the run again", path.display())]
    Picture {
        /// The recording.
        path: PathBuf,
        /// What is wrong with it.
        source: ImageError,
    },
    /// It has nothing to show.
    #[error("{}: has no {what}", path.display())]
    Nothing {
        /// The recording.
        path: PathBuf,
        /// What is missing, and the mend.
        what: &'static str,
    },
    /// The film cannot be written.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// No picture of that size.
    #[error(
        "a picture of {width} by {height} px cannot be drawn; this is a fault of the program: please report it"
    )]
    Canvas {
        /// Its width [px].
        width: u32,
        /// Its height [px].
        height: u32,
    },
    /// An argument.
    #[error("{0}")]
    Argument(String),
}
