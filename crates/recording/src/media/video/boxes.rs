//! The boxes of an MP4 or MOV file (ISO/IEC 14496-12): how they lie in one another, and the file's index.

use super::error::VideoError;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// Largest index: the tables of hours of video are some megabytes.
const MAX_INDEX_BYTES: u64 = 1 << 28; // [byte]

/// What is wrong with the boxes of a file.
pub(super) enum Broken {
    Format(String),
    Truncated(String),
    /// Fragments without the index that they continue.
    Segment,
}

impl Broken {
    pub(super) fn at(self, path: &Path) -> VideoError {
        let path = path.into();
        match self {
            Broken::Format(why) => VideoError::Format { path, why },
            Broken::Truncated(why) => VideoError::Truncated { path, why },
            Broken::Segment => VideoError::Segment { path },
        }
    }
}

pub(super) fn format(why: impl Into<String>) -> Broken {
    Broken::Format(why.into())
}

/// What a file says of its frames.
pub(super) struct Index {
    /// The content of its `moov` box.
    pub(super) moov: Vec<u8>,
    /// Where the `moof` boxes of its fragments begin [byte], and their contents.
    pub(super) fragments: Vec<(u64, Vec<u8>)>,
    /// Its length [byte].
    pub(super) length: u64,
    /// The box that goes on after the end of the file, behind a whole index.
    pub(super) cut: Option<String>,
}

/// A box of a file: its kind, where it begins, where its content does, and where it ends [byte].
struct Span {
    kind: [u8; 4],
    start: u64,
    content: u64,
    end: u64,
}

fn io(error: io::Error) -> Broken {
    Broken::Truncated(error.to_string())
}

/// The box at `at` of a file of `length` bytes; the end is behind the file's if the box is cut off.
fn span(file: &mut File, at: u64, length: u64) -> Result<Option<Span>, Broken> {
    let mut head = [0; 16];
    let here = (length - at).min(16) as usize;
    file.seek(SeekFrom::Start(at)).map_err(io)?;
    file.read_exact(&mut head[..here]).map_err(io)?;
    if here < 8 {
        return Ok(None);
    }
    let (size, skip) = match u32_at(&head, 0).unwrap_or(0) {
        0 => (length - at, 8),
        1 => (
            u64_at(&head, 8).filter(|_| here == 16).unwrap_or(u64::MAX),
            16,
        ),
        size => (u64::from(size), 8),
    };
    let end = at.saturating_add(size);
    Ok(Some(Span {
        kind: [head[4], head[5], head[6], head[7]],
        start: at,
        content: at + skip,
        end: if size < skip { u64::MAX } else { end },
    }))
}

/// The content of a box that lies in the file.
fn content(file: &mut File, span: &Span, room: &mut u64) -> Result<Vec<u8>, Broken> {
    let size = span.end - span.content;
    *room = (room.checked_sub(size)).ok_or_else(|| format("its index is too long"))?;
    let mut data = vec![0; size as usize];
    file.seek(SeekFrom::Start(span.content)).map_err(io)?;
    file.read_exact(&mut data).map_err(io)?;
    Ok(data)
}

/// The index of a file.
pub(super) fn index(file: &mut File) -> Result<Index, Broken> {
    let length = file.seek(SeekFrom::End(0)).map_err(io)?;
    let (mut at, mut known, mut room) = (0, false, MAX_INDEX_BYTES);
    let (mut moov, mut fragments, mut cut) = (None, Vec::new(), None);
    while at < length {
        let Some(span) = span(file, at, length)? else {
            break;
        };
        // A file of another kind shows at its first box.
        known |= matches!(
            &span.kind,
            b"ftyp" | b"styp" | b"moov" | b"mdat" | b"free" | b"skip" | b"wide" | b"pnot"
        );
        if !known {
            break;
        }
        if span.end > length {
            let name = String::from_utf8_lossy(&span.kind).into_owned();
            cut = Some(format!(
                "its '{name}' box goes on after the end of the file"
            ));
            break;
        }
        match &span.kind {
            b"moov" if moov.is_none() => moov = Some(content(file, &span, &mut room)?),
            b"moof" => fragments.push((span.start, content(file, &span, &mut room)?)),
            _ => {}
        }
        let fragmented = |moov: &Vec<u8>| child(moov, b"mvex").is_some();
        if moov.as_ref().is_some_and(|moov| !fragmented(moov)) {
            break;
        }
        at = span.end;
    }
    match (moov, cut) {
        (Some(moov), cut) => Ok(Index {
            moov,
            fragments,
            length,
            cut,
        }),
        (None, _) if !fragments.is_empty() => Err(Broken::Segment),
        (None, Some(cut)) => Err(Broken::Truncated(cut)),
        (None, None) if known => Err(Broken::Truncated("it has no 'moov' box (its index)".into())),
        (None, None) => Err(format("it is no MP4 or MOV file")),
    }
}

pub(super) fn u32_at(data: &[u8], at: usize) -> Option<u32> {
    let bytes = data.get(at..)?.first_chunk::<4>()?;
    Some(u32::from_be_bytes(*bytes))
}

pub(super) fn u64_at(data: &[u8], at: usize) -> Option<u64> {
    let bytes = data.get(at..)?.first_chunk::<8>()?;
    Some(u64::from_be_bytes(*bytes))
}

/// The content of the first box of a kind among boxes that follow each other.
pub(super) fn child<'a>(data: &'a [u8], kind: &[u8; 4]) -> Option<&'a [u8]> {
    children(data).find(|(k, _)| k == kind).map(|(_, d)| d)
}

/// Kind and content of boxes that follow each other, up to the first that does not fit.
pub(super) fn children(mut data: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    std::iter::from_fn(move || {
        let kind = *data.get(4..)?.first_chunk::<4>()?;
        let (size, skip) = match u32_at(data, 0)? {
            0 => (data.len(), 8),
            1 => (usize::try_from(u64_at(data, 8)?).ok()?, 16),
            size => (size as usize, 8),
        };
        let content = data.get(skip..size)?;
        data = &data[size..];
        Some((kind, content))
    })
}

/// Rows of `N` numbers of a table: version and flags, `extra` bytes, count, rows. `None` if it ends
/// too early.
pub(super) fn rows<const N: usize>(
    table: &[u8],
    extra: usize,
) -> Option<impl Iterator<Item = [u32; N]>> {
    let count = u32_at(table, 4 + extra)? as usize;
    let data = table.get(8 + extra..)?;
    let data = data.get(..count.checked_mul(4 * N)?)?;
    Some(
        data.chunks_exact(4 * N)
            .map(|row| std::array::from_fn(|i| u32_at(row, 4 * i).unwrap_or(0))),
    )
}

/// The version of a full box, and its flags.
pub(super) fn version_flags(data: &[u8]) -> Option<(u8, u32)> {
    let word = u32_at(data, 0)?;
    Some(((word >> 24) as u8, word & 0xff_ffff))
}

/// What is wrong with a table.
pub(super) fn damaged(name: &str) -> Broken {
    format(format!("its table '{name}' is damaged"))
}
