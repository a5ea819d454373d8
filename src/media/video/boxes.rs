//! The boxes of an MP4 or MOV file: where its frames lie, and when they are shown.
//!
//! The crate `re_mp4` 0.5 reads the same tables but cannot replace this: it panics on damaged files. It
//! indexes the tables without asking how long they are (`stsc.entries[0]` of an empty table,
//! `stts.entries[i]` of one that counts too few frames), subtracts one from entries of 0, and fills
//! memory with as many samples as a damaged `stsz` claims.

use super::error::VideoError;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

/// A frame as it lies in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    /// Where it begins in the file [byte].
    pub(super) offset: u64,
    /// Its length [byte].
    pub(super) size: u32,
    /// Time at which it is shown, in units of the track.
    pub(super) shown: i64,
    /// Its place in the order of these times.
    pub(super) place: usize,
}

/// Largest `moov` box: the tables of hours of video are some megabytes.
const MAX_MOOV_BYTES: u64 = 1 << 28; // [byte]

/// What is wrong with the boxes of a file.
pub(super) enum Broken {
    Format(String),
    Truncated(String),
}

impl Broken {
    pub(super) fn at(self, path: &Path) -> VideoError {
        let path = path.into();
        match self {
            Broken::Format(why) => VideoError::Format { path, why },
            Broken::Truncated(why) => VideoError::Truncated { path, why },
        }
    }
}

pub(super) fn format(why: impl Into<String>) -> Broken {
    Broken::Format(why.into())
}

/// The `moov` box of a file, and the file's length.
pub(super) fn moov(file: &mut File) -> Result<(Vec<u8>, u64), Broken> {
    let io = |error: io::Error| Broken::Truncated(error.to_string());
    let length = file.seek(SeekFrom::End(0)).map_err(io)?;
    let (mut at, mut known) = (0, false);
    while at < length {
        let mut head = [0; 16];
        let here = (length - at).min(16) as usize;
        file.seek(SeekFrom::Start(at)).map_err(io)?;
        file.read_exact(&mut head[..here]).map_err(io)?;
        let kind = [head[4], head[5], head[6], head[7]];
        // A file of another kind shows at its first box.
        known |= matches!(
            &kind,
            b"ftyp" | b"moov" | b"mdat" | b"free" | b"skip" | b"wide" | b"pnot"
        );
        if !known || here < 8 {
            break;
        }
        let (size, skip) = match u32_at(&head, 0).unwrap_or(0) {
            0 => (length - at, 8),
            1 => (
                u64_at(&head, 8).filter(|_| here == 16).unwrap_or(u64::MAX),
                16,
            ),
            size => (u64::from(size), 8),
        };
        let end = at.checked_add(size).filter(|_| size >= skip);
        let Some(end) = end.filter(|end| *end <= length) else {
            let name = String::from_utf8_lossy(&kind).into_owned();
            return Err(Broken::Truncated(format!(
                "its '{name}' box goes on after the end of the file"
            )));
        };
        if &kind == b"moov" {
            if size > MAX_MOOV_BYTES {
                return Err(format("its index is too long"));
            }
            let mut data = vec![0; (size - skip) as usize];
            file.seek(SeekFrom::Start(at + skip)).map_err(io)?;
            file.read_exact(&mut data).map_err(io)?;
            return Ok((data, length));
        }
        at = end;
    }
    if known {
        Err(Broken::Truncated("it has no 'moov' box (its index)".into()))
    } else {
        Err(format("it is no MP4 or MOV file"))
    }
}

fn u32_at(data: &[u8], at: usize) -> Option<u32> {
    let bytes = data.get(at..)?.first_chunk::<4>()?;
    Some(u32::from_be_bytes(*bytes))
}

fn u64_at(data: &[u8], at: usize) -> Option<u64> {
    let bytes = data.get(at..)?.first_chunk::<8>()?;
    Some(u64::from_be_bytes(*bytes))
}

/// The content of the first box of a kind among boxes that follow each other.
fn child<'a>(data: &'a [u8], kind: &[u8; 4]) -> Option<&'a [u8]> {
    children(data).find(|(k, _)| k == kind).map(|(_, d)| d)
}

/// Kind and content of boxes that follow each other, up to the first that does not fit.
fn children(mut data: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
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
fn rows<const N: usize>(table: &[u8], extra: usize) -> Option<impl Iterator<Item = [u32; N]>> {
    let count = u32_at(table, 4 + extra)? as usize;
    let data = table.get(8 + extra..)?;
    let data = data.get(..count.checked_mul(4 * N)?)?;
    Some(
        data.chunks_exact(4 * N)
            .map(|row| std::array::from_fn(|i| u32_at(row, 4 * i).unwrap_or(0))),
    )
}

/// The video track of a file.
#[derive(Debug, PartialEq)]
pub(super) struct Movie {
    /// Units of time a second [Hz].
    pub(super) timescale: u32,
    /// Its frames in the order in which they are stored.
    pub(super) samples: Vec<Sample>,
    /// Bytes of the length before each unit of a sample.
    pub(super) length_bytes: usize,
    /// Parameter sets, with start codes.
    pub(super) head: Vec<u8>,
}

impl Movie {
    /// Reads the content of a `moov` box of a file of `length` bytes.
    pub(super) fn parse(moov: &[u8], length: u64) -> Result<Self, Broken> {
        let is_video = |mdia: &&[u8]| {
            child(mdia, b"hdlr").is_some_and(|hdlr| hdlr.get(8..12) == Some(b"vide"))
        };
        let mdia = children(moov)
            .filter(|(kind, _)| kind == b"trak")
            .filter_map(|(_, trak)| child(trak, b"mdia"))
            .find(is_video)
            .ok_or_else(|| format("it holds no video track"))?;
        let mdhd = child(mdia, b"mdhd").ok_or_else(|| format("it has no time scale"))?;
        let long = mdhd.first() == Some(&1);
        let timescale = u32_at(mdhd, if long { 20 } else { 12 })
            .filter(|scale| *scale > 0)
            .ok_or_else(|| format("it has no time scale"))?;
        let stbl = child(mdia, b"minf")
            .and_then(|minf| child(minf, b"stbl"))
            .ok_or_else(|| format("it has no table of frames"))?;
        let (length_bytes, head) = description(stbl)?;
        let mut movie = Self {
            timescale,
            samples: samples(stbl, length)?,
            length_bytes,
            head,
        };
        if movie.samples.is_empty() {
            return Err(match child(moov, b"mvex") {
                Some(_) => format("it is a fragmented MP4, whose frames have no common table"),
                None => format("it holds no frames"),
            });
        }
        let mut order: Vec<usize> = (0..movie.samples.len()).collect();
        order.sort_by_key(|i| movie.samples[*i].shown);
        for (place, i) in order.into_iter().enumerate() {
            movie.samples[i].place = place;
        }
        Ok(movie)
    }
}

/// Bytes of a unit's length, and the parameter sets.
fn description(stbl: &[u8]) -> Result<(usize, Vec<u8>), Broken> {
    let entry = child(stbl, b"stsd")
        .and_then(|stsd| children(stsd.get(8..)?).next())
        .ok_or_else(|| format("it does not say how its video is coded"))?;
    let (kind, entry) = entry;
    if !matches!(&kind, b"avc1" | b"avc3") {
        let name = String::from_utf8_lossy(&kind).into_owned();
        return Err(format(format!("its video is '{name}', not H.264")));
    }
    // 78 bytes of a visual sample entry come before its boxes.
    let avcc = entry
        .get(78..)
        .and_then(|boxes| child(boxes, b"avcC"))
        .ok_or_else(|| format("it lacks the parameters of its H.264 video"))?;
    let read = || {
        let length_bytes = usize::from(avcc.get(4)? & 3) + 1;
        let mut head = Vec::new();
        let mut rest = avcc.get(5..)?;
        for mask in [0x1f, 0xff] {
            let (count, after) = rest.split_first()?;
            rest = after;
            for _ in 0..count & mask {
                let (size, after) = rest.split_at_checked(2)?;
                let size = usize::from(size[0]) << 8 | usize::from(size[1]);
                let (unit, after) = after.split_at_checked(size)?;
                head.extend([0, 0, 0, 1]);
                head.extend(unit);
                rest = after;
            }
        }
        Some((length_bytes, head))
    };
    read().ok_or_else(|| format("the parameters of its H.264 video are damaged"))
}

/// Where the frames lie and when they are shown, from the `stbl` box of a file of `length` bytes.
pub(super) fn samples(stbl: &[u8], length: u64) -> Result<Vec<Sample>, Broken> {
    let sizes = sizes(table(stbl, b"stsz")?, length)?;
    let offsets = offsets(stbl, &sizes)?;
    let durations = values("stts", table(stbl, b"stts")?, sizes.len())?;
    // Shifts of what is shown in another order than it is stored.
    let shifts = child(stbl, b"ctts")
        .map(|ctts| values("ctts", ctts, sizes.len()))
        .transpose()?;
    let (count, mut stored) = (sizes.len(), 0_i64);
    let mut samples = Vec::with_capacity(count);
    for (i, (size, offset)) in sizes.into_iter().zip(offsets).enumerate() {
        if offset.saturating_add(u64::from(size)) > length {
            return Err(Broken::Truncated(format!(
                "frame {i} of {count} lies behind the end of the file"
            )));
        }
        samples.push(Sample {
            offset,
            size,
            shown: stored + shifts.as_ref().map_or(0, |shifts| shifts[i]),
            place: i,
        });
        stored += durations[i].max(0);
    }
    Ok(samples)
}

fn damaged(name: &str) -> Broken {
    format(format!("its table '{name}' is damaged"))
}

fn table<'a>(stbl: &'a [u8], name: &[u8; 4]) -> Result<&'a [u8], Broken> {
    child(stbl, name).ok_or_else(|| damaged(&String::from_utf8_lossy(name)))
}

/// The size of every frame [byte].
fn sizes(stsz: &[u8], length: u64) -> Result<Vec<u32>, Broken> {
    match (u32_at(stsz, 4), u32_at(stsz, 8)) {
        (Some(0), Some(_)) => Ok(rows(stsz, 4)
            .ok_or_else(|| damaged("stsz"))?
            .map(|[size]| size)
            .collect()),
        // No file holds more frames than bytes.
        (Some(size), Some(count)) if u64::from(count) <= length => Ok(vec![size; count as usize]),
        _ => Err(damaged("stsz")),
    }
}

/// Where every frame begins [byte]: chunks of frames, and runs of chunks with equally many.
fn offsets(stbl: &[u8], sizes: &[u32]) -> Result<Vec<u64>, Broken> {
    let chunks: Vec<u64> = match (child(stbl, b"stco"), child(stbl, b"co64")) {
        (Some(stco), _) => rows(stco, 0)
            .ok_or_else(|| damaged("stco"))?
            .map(|[offset]| u64::from(offset))
            .collect(),
        (None, Some(co64)) => rows(co64, 0)
            .ok_or_else(|| damaged("co64"))?
            .map(|[high, low]| u64::from(high) << 32 | u64::from(low))
            .collect(),
        (None, None) => return Err(damaged("stco")),
    };
    let runs: Vec<[u32; 3]> = rows(table(stbl, b"stsc")?, 0)
        .ok_or_else(|| damaged("stsc"))?
        .collect();
    let mut offsets = Vec::with_capacity(sizes.len());
    let mut run = 0;
    for (i, chunk) in chunks.iter().enumerate() {
        while runs
            .get(run + 1)
            .is_some_and(|next| next[0] as usize <= i + 1)
        {
            run += 1;
        }
        let per_chunk = runs.get(run).ok_or_else(|| damaged("stsc"))?[1];
        let mut offset = *chunk;
        for _ in 0..per_chunk {
            let Some(size) = sizes.get(offsets.len()) else {
                break;
            };
            offsets.push(offset);
            offset = offset.saturating_add(u64::from(*size));
        }
    }
    if offsets.len() == sizes.len() {
        Ok(offsets)
    } else {
        Err(damaged("stsc"))
    }
}

/// The value of each of `count` frames in a table of runs.
fn values(name: &str, table: &[u8], count: usize) -> Result<Vec<i64>, Broken> {
    let mut values = Vec::with_capacity(count);
    for [length, value] in rows(table, 0).ok_or_else(|| damaged(name))? {
        let left = count - values.len();
        // Shifts may be negative, and are so in files of either version.
        let value = i64::from(value.cast_signed());
        values.extend(std::iter::repeat_n(value, left.min(length as usize)));
    }
    if values.len() == count {
        Ok(values)
    } else {
        Err(damaged(name))
    }
}
