//! Files and folders that a command leaves.

use std::path::{Path, PathBuf};

/// Why a file or folder cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("output {path}: {source}; name a folder that can be written with --out")]
pub struct OutputError {
    /// The folder or file.
    pub path: PathBuf,
    /// What the system said.
    pub source: std::io::Error,
}

/// Makes sure that a folder exists.
pub fn create_dir(path: &Path) -> Result<(), OutputError> {
    std::fs::create_dir_all(path).map_err(|source| OutputError {
        path: path.to_owned(),
        source,
    })
}

/// Writes a file whole.
pub fn write(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), OutputError> {
    std::fs::write(path, bytes).map_err(|source| OutputError {
        path: path.to_owned(),
        source,
    })
}
