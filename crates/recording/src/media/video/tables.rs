//! Where the frames of a track lie, and when they are shown, from its tables (`stbl`).

use super::boxes::{Broken, child, damaged, rows, u32_at};

/// A frame as it lies in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    /// Where it begins in the file [byte].
    pub(super) offset: u64,
    /// Its length [byte].
    pub(super) size: u32,
    /// Time at which it is decoded, in units of the track.
    pub(super) decoded: i64,
    /// Time until the next one is, in units of the track.
    pub(super) duration: i64,
    /// Time at which it is shown, in units of the track.
    pub(super) shown: i64,
    /// Which of the track's descriptions it has.
    pub(super) description: usize,
    /// Its place in the order of what is shown; none where it is not shown.
    pub(super) place: Option<usize>,
}

/// The frames of an `stbl` box of a file of `length` bytes, in the order in which they are stored.
pub(super) fn samples(stbl: &[u8], length: u64) -> Result<Vec<Sample>, Broken> {
    let sizes = match (child(stbl, b"stsz"), child(stbl, b"stz2")) {
        (None, Some(stz2)) => compact_sizes(stz2)?,
        _ => sizes(table(stbl, b"stsz")?, length)?,
    };
    let places = places(stbl, &sizes)?;
    let durations = values("stts", table(stbl, b"stts")?, sizes.len())?;
    // Shifts of what is shown in another order than it is stored.
    let shifts = child(stbl, b"ctts")
        .map(|ctts| values("ctts", ctts, sizes.len()))
        .transpose()?;
    let (count, mut decoded) = (sizes.len(), 0_i64);
    let mut samples = Vec::with_capacity(count);
    for (i, (size, (offset, description))) in sizes.into_iter().zip(places).enumerate() {
        if offset.saturating_add(u64::from(size)) > length {
            return Err(Broken::Truncated(format!(
                "frame {i} of {count} lies behind the end of the file"
            )));
        }
        let duration = durations[i].max(0);
        samples.push(Sample {
            offset,
            size,
            decoded,
            duration,
            shown: decoded + shifts.as_ref().map_or(0, |shifts| shifts[i]),
            description,
            place: None,
        });
        decoded += duration;
    }
    Ok(samples)
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
        // All of them lie in the file.
        (Some(size), Some(count)) if u64::from(count) * u64::from(size) <= length => {
            Ok(vec![size; count as usize])
        }
        _ => Err(damaged("stsz")),
    }
}

/// The size of every frame [byte], in a table of 4, 8 or 16 bits each.
fn compact_sizes(stz2: &[u8]) -> Result<Vec<u32>, Broken> {
    let read = || {
        let bits = usize::from(*stz2.get(7)?);
        let count = u32_at(stz2, 8)? as usize;
        let data = stz2.get(12..)?;
        let size = |i: usize| match bits {
            4 => (data.get(i / 2)).map(|byte| u32::from(byte >> (4 * (1 - i % 2)) & 15)),
            8 => data.get(i).map(|byte| u32::from(*byte)),
            16 => {
                let pair = data.get(2 * i..)?.first_chunk::<2>()?;
                Some(u32::from(u16::from_be_bytes(*pair)))
            }
            _ => None,
        };
        // As many as there are bytes for.
        (count.checked_mul(bits)? <= 8 * data.len()).then_some(())?;
        (0..count).map(size).collect::<Option<Vec<u32>>>()
    };
    read().ok_or_else(|| damaged("stz2"))
}

/// Where every frame begins [byte], and which description it has: chunks of frames, and runs of chunks with equally many.
fn places(stbl: &[u8], sizes: &[u32]) -> Result<Vec<(u64, usize)>, Broken> {
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
    let mut places = Vec::with_capacity(sizes.len());
    let mut run = 0;
    for (i, chunk) in chunks.iter().enumerate() {
        while runs
            .get(run + 1)
            .is_some_and(|next| next[0] as usize <= i + 1)
        {
            run += 1;
        }
        let [_, per_chunk, description] = *runs.get(run).ok_or_else(|| damaged("stsc"))?;
        let description = (description as usize).saturating_sub(1);
        let mut offset = *chunk;
        for _ in 0..per_chunk {
            let Some(size) = sizes.get(places.len()) else {
                break;
            };
            places.push((offset, description));
            offset = offset.saturating_add(u64::from(*size));
        }
    }
    if places.len() == sizes.len() {
        Ok(places)
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
