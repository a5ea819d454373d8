//! Files and folders that a command leaves, and the words of its command line.

use serde::Serialize;
use std::path::{Path, PathBuf};

/// Why a file or folder cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// A folder that cannot be made.
    #[error(
        "{path}: the folder cannot be made: {source}; name one that can be written (--out, --map or --save-orders)"
    )]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file that cannot be written.
    #[error(
        "{path}: cannot be written: {source}; name a place that can be written (--out, --map or --save-orders)"
    )]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// What was found cannot be written as JSON.
    #[error(
        "{path}: cannot be encoded: {source}; this is a fault of the program: please report it"
    )]
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
pub fn put(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), OutputError> {
    if let Some(folder) = path.parent() {
        create_dir(folder)?;
    }
    write(path, bytes)
}

/// Writes what was found as JSON.
pub fn put_json(path: &Path, value: &impl Serialize) -> Result<(), OutputError> {
    let text = serde_json::to_string_pretty(value).map_err(|source| OutputError::Json {
        path: path.into(),
        source,
    })?;
    put(path, text + "\n")
}

/// Makes sure, before the work, that a file can be written; what it holds stays.
pub fn writable(path: &Path) -> Result<(), OutputError> {
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
pub fn quoted(word: impl std::fmt::Display) -> String {
    let word = word.to_string();
    let plain = |c: char| c.is_alphanumeric() || "/._-+,:=@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

/// A number of things: `1 layer`, `2 layers`.
pub fn counted(count: usize, thing: &str) -> String {
    match count {
        1 => format!("1 {thing}"),
        _ => format!("{count} {thing}s"),
    }
}

/// A table as text: cells under their heads, two blanks apart. The first `left` columns begin at the left, the others,
/// which are numbers, end at the right.
pub fn columns(head: &[&str], rows: &[Vec<String>], left: usize) -> String {
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        let cells = cells.map(|cell| cell.chars().count());
        let head = head[column].chars().count();
        cells.fold(head, usize::max)
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let line = |cells: &mut dyn Iterator<Item = &str>| {
        let padded = cells.zip(&widths).enumerate();
        let padded = padded.map(|(column, (cell, width))| match column < left {
            true => format!("{cell:<width$}"),
            false => format!("{cell:>width$}"),
        });
        let line = padded.collect::<Vec<_>>().join("  ");
        line.trim_end().to_owned() + "\n"
    };
    let mut text = line(&mut head.iter().copied());
    for row in rows {
        text += &line(&mut row.iter().map(String::as_str));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads_stand_over_their_columns() {
        let rows = [["fpv5", "0.62", "–"], ["a longer name", "1500.5", "34"]];
        let rows = rows.map(|row| row.map(String::from).to_vec());
        let text = columns(&["name", "mass kg", "m/s"], &rows, 1);
        let want = "\
name           mass kg  m/s
fpv5              0.62    –
a longer name   1500.5   34
";
        assert_eq!(text, want);
    }
}
