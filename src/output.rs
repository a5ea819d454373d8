//! Files and folders that a command leaves, and the words of its command line.

use serde::Serialize;
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
    /// What was found cannot be written as JSON.
    #[error("cannot encode {path}: {source}")]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
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

/// Writes a file and the folders above it.
pub(crate) fn put(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), OutputError> {
    if let Some(folder) = path.parent() {
        create_dir(folder)?;
    }
    write(path, bytes)
}

/// Writes what was found as JSON.
pub(crate) fn put_json(path: &Path, value: &impl Serialize) -> Result<(), OutputError> {
    let text = serde_json::to_string_pretty(value).map_err(|source| OutputError::Json {
        path: path.into(),
        source,
    })?;
    put(path, text + "\n")
}

/// Makes sure, before the work, that a file can be written; what it holds stays.
pub(crate) fn writable(path: &Path) -> Result<(), OutputError> {
    let failed = |path: PathBuf| move |source| OutputError::File { path, source };
    if let Some(folder) = path.parent() {
        create_dir(folder)?;
    }
    let new = !path.exists();
    (std::fs::OpenOptions::new().append(true).create(true))
        .open(path)
        .map_err(failed(path.into()))?;
    if new {
        std::fs::remove_file(path).map_err(failed(path.into()))?;
    }
    Ok(())
}

/// A word of a command line, quoted where a shell would read it otherwise.
pub(crate) fn quoted(word: impl std::fmt::Display) -> String {
    let word = word.to_string();
    let plain = |c: char| c.is_alphanumeric() || "/._-+,:=@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}
