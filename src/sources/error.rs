//! Why a source cannot be read: the file, the place in it, what is wrong there and what mends it.

use std::path::{Path, PathBuf};

/// What is wrong inside a file, found without knowing its name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {what}; {mend}")]
pub struct Fault {
    /// Where in the file: a line, an object's name, a key.
    pub place: String,
    /// What is wrong there.
    pub what: String,
    /// What to do about it.
    pub mend: String,
}

impl Fault {
    /// A fault at a place.
    pub fn new(place: impl ToString, what: impl ToString, mend: impl ToString) -> Self {
        Self {
            place: place.to_string(),
            what: what.to_string(),
            mend: mend.to_string(),
        }
    }

    /// The error of the file that has this fault.
    pub fn of(self, path: &Path) -> SourceError {
        SourceError::Content {
            path: path.into(),
            fault: self,
        }
    }
}

/// Why a source cannot be read; each prints as one line that says what to do about it.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A file that cannot be opened or read to its end.
    #[error("{}: {source}; name a file that can be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file whose content is damaged, or more than is read here.
    #[error("{}: {fault}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong in it.
        fault: Fault,
    },
}

/// The most bytes of one file that a reader takes into memory.
const MOST_BYTES: u64 = 4 << 30; // [B]

/// All bytes of a file.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, SourceError> {
    let failed = |source| SourceError::Read {
        path: path.into(),
        source,
    };
    let size = std::fs::metadata(path).map_err(failed)?.len();
    if size > MOST_BYTES {
        let what = format!("{size} bytes are more than {MOST_BYTES}");
        return Err(Fault::new("file", what, "split it").of(path));
    }
    std::fs::read(path).map_err(failed)
}
