//! What a run leaves for people and scripts: a self-contained HTML report and the summary's numbers;
//! and what the pages of all commands share.

mod axis;
pub mod chart;
pub mod page;
pub mod run;
pub mod states;
pub mod statistics;
pub mod summary;
pub mod uavs;

use crate::media::image::ImageError;
use crate::output::OutputError;
use crate::recording::RecordingError;

/// Why the summary or the report of a run cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A frame of the contact sheet is no image.
    #[error(
        "report.html: frame {index} of the contact sheet: {source}; this is a fault of the program: please report it"
    )]
    Frame {
        /// Its place in the sheet.
        index: usize,
        /// What is wrong with it.
        source: ImageError,
    },
    /// The recording cannot be closed.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The summary cannot be encoded.
    #[error(
        "summary.json: cannot be encoded: {0}; this is a fault of the program: please report it"
    )]
    Json(#[from] serde_json::Error),
}
