//! Files and folders that a command leaves.

use std::path::{Path, PathBuf};

/// Why a file or folder cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// A folder that cannot be made.
    #[error("output folder {path}: {source}; name a folder that can be written with --out")]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file that cannot be written.
    #[error("output {path}: {source}; name a folder that can be written with --out")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

/// Makes sure that a folder exists.
pub fn create_dir(path: &Path) -> Result<(), OutputError> {
    std::fs::create_dir_all(path).map_err(|source| OutputError::Folder {
        path: path.to_owned(),
        source,
    })
}

/// Writes a file whole.
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), OutputError> {
    std::fs::write(path, bytes).map_err(|source| OutputError::File {
        path: path.to_owned(),
        source,
    })
}
