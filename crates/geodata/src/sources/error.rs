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

/// Refuses what none of the readers takes, by its name: packed files, text in UTF-16, and the page that a server sends in place of a
/// file.
fn refuse_others(bytes: &[u8]) -> Result<(), Fault> {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let head = text.trim_ascii_start();
    let head: Vec<u8> = head.iter().take(16).map(u8::to_ascii_lowercase).collect();
    let page = ["<!doctype html", "<html"];
    let (what, mend) = match text {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] | [b'{', 0, ..] | [0, b'{', ..] => {
            ("its text is UTF-16", "save it as UTF-8")
        }
        [0x1f, 0x8b, ..] => ("it is compressed with gzip", "unpack it"),
        [b'B', b'Z', b'h', b'1'..=b'9', ..] => ("it is compressed with bzip2", "unpack it"),
        [0xfd, b'7', b'z', b'X', b'Z', 0, ..] => ("it is compressed with xz", "unpack it"),
        [0x28, 0xb5, 0x2f, 0xfd, ..] => ("it is compressed with Zstandard", "unpack it"),
        [b'7', b'z', 0xbc, 0xaf, ..] => ("it is a 7z archive", "unpack it"),
        [b'P', b'K', 3, 4, ..] => ("it is a ZIP archive", "unpack it, and name the file inside"),
        _ if page.iter().any(|page| head.starts_with(page.as_bytes())) => {
            ("it is a web page", "fetch the file itself")
        }
        _ => return Ok(()),
    };
    Err(Fault::new("file", what, mend))
}

/// All bytes of a file.
///
/// Fails where it cannot be read, is larger than 4 GiB, packed, or a web page.
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
    let bytes = std::fs::read(path).map_err(failed)?;
    refuse_others(&bytes).map_err(|fault| fault.of(path))?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_files_and_pages_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("city.json");
        let wide =
            |text: &str| -> Vec<u8> { text.encode_utf16().flat_map(u16::to_le_bytes).collect() };
        let cases: [(Vec<u8>, &str); 8] = [
            (wide("{\"type\": 1}"), "UTF-16"),
            (wide("\u{feff}ISO-10303-21;"), "UTF-16"),
            (vec![0x1f, 0x8b, 8, 0], "gzip"),
            (b"BZh91AY".to_vec(), "bzip2"),
            (b"\xfd7zXZ\0\0".to_vec(), "xz"),
            (b"\x28\xb5\x2f\xfd\0".to_vec(), "Zstandard"),
            (b"PK\x03\x04".to_vec(), "ZIP"),
            (b"\xef\xbb\xbf\n <!DOCTYPE html><html>".to_vec(), "web page"),
        ];
        for (bytes, name) in cases {
            std::fs::write(&path, bytes).unwrap();
            let said = read_bytes(&path).unwrap_err().to_string();
            assert!(
                said.contains(name) && said.contains("city.json: file: "),
                "{said}"
            );
        }
        for plain in ["", "{}", "<?xml version=\"1.0\"?>", "P3 1 1", "{\"a\": 1}"] {
            std::fs::write(&path, plain).unwrap();
            assert_eq!(read_bytes(&path).unwrap(), plain.as_bytes());
        }
    }
}
