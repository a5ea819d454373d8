//! Why a recording could not be made.

use crate::live::LiveError;
use crate::media::image::ImageError;
use mcap::McapError;
use std::io;
use std::path::{Path, PathBuf};

/// Why a recording could not be made.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file could not be created.
    #[error("{}: the recording cannot be created: {source}; name a folder that can be written with --out", path.display())]
    Create {
        /// The file asked for.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// There is no room left where the recording lies.
    #[error("{}: the disk is full, and the recording cut short; make room, or name another folder with --out", path.display())]
    DiskFull {
        /// The recording.
        path: PathBuf,
    },
    /// Writing failed for another reason.
    #[error("{}: the recording cannot be written: {source}; name a folder that can be written with --out", path.display())]
    Write {
        /// The recording.
        path: PathBuf,
        /// What the MCAP writer said.
        source: McapError,
    },
    /// A message could not be encoded.
    #[error("a message cannot be encoded: {0}; this is a fault of the program: please report it")]
    Encode(#[from] prost::EncodeError),
    /// A message is older than the last one.
    #[error(
        "message of tick {tick} after tick {last}: a recording runs forwards; this is a fault of the program: please report it"
    )]
    Backwards {
        /// Tick of the late message.
        tick: u64,
        /// Newest tick written.
        last: u64,
    },
    /// It cannot be served.
    #[error(transparent)]
    Live(#[from] LiveError),
    /// A picture could not be encoded.
    #[error("a picture cannot be recorded: {0}; this is a fault of the program: please report it")]
    Picture(#[from] ImageError),
    /// The thread that writes could not be started.
    #[error(
        "the thread that writes the recording cannot be started: {0}; let the system have more threads (ulimit -u)"
    )]
    Thread(io::Error),
    /// It has failed before.
    #[error("the recording has ended; the error before this one says why")]
    Ended,
}

pub(crate) fn write_error(path: &Path, source: McapError) -> RecordingError {
    let path = path.to_owned();
    match source {
        McapError::Io(error) if error.kind() == io::ErrorKind::StorageFull => {
            RecordingError::DiskFull { path }
        }
        source => RecordingError::Write { path, source },
    }
}
