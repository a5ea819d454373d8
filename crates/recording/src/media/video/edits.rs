//! What of a track is shown, and when: its edit list (`elst`).

use super::boxes::{Broken, child, damaged, format, rows};
use super::tables::Sample;

/// A part of a track that is shown, or a gap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Edit {
    /// How long it is shown, in units of the movie; 0: to the end of the track.
    pub(super) duration: u64,
    /// Where it begins in the track, in units of the track; none of a gap.
    pub(super) start: Option<i64>,
    /// How fast it is shown; 0: its first frame stands still.
    pub(super) rate: f64,
}

/// The edit list of a track; empty where there is none.
pub(super) fn edits(trak: &[u8]) -> Result<Vec<Edit>, Broken> {
    let Some(elst) = child(trak, b"edts").and_then(|edts| child(edts, b"elst")) else {
        return Ok(Vec::new());
    };
    let edit = |duration: u64, start: i64, rate: u32| Edit {
        duration,
        start: (start >= 0).then_some(start),
        rate: f64::from(rate.cast_signed()) / 65_536.0,
    };
    let long = |high: u32, low: u32| u64::from(high) << 32 | u64::from(low);
    let list: Option<Vec<Edit>> = match elst.first() {
        Some(1) => rows(elst, 0).map(|rows| {
            let row = |[d1, d0, s1, s0, rate]: [u32; 5]| {
                edit(long(d1, d0), long(s1, s0).cast_signed(), rate)
            };
            rows.map(row).collect()
        }),
        _ => rows(elst, 0).map(|rows| {
            let row = |[d, s, rate]: [u32; 3]| edit(d.into(), s.cast_signed().into(), rate);
            rows.map(row).collect()
        }),
    };
    list.ok_or_else(|| damaged("elst"))
}

/// Places the frames that are shown, and says when each is [s from the first]. Units of time a second [Hz]: of the movie,
/// of the track.
pub(super) fn place(
    samples: &mut [Sample],
    edits: &[Edit],
    movie_hz: f64,
    track_hz: f64,
) -> Result<Vec<f64>, Broken> {
    let mut order: Vec<usize> = (0..samples.len()).collect();
    order.sort_by_key(|i| samples[*i].shown);
    let whole = [Edit {
        duration: 0,
        start: order.first().map(|i| samples[*i].shown),
        rate: 1.0,
    }];
    let edits = if edits.is_empty() { &whole } else { edits };
    let (mut times_s, mut begins_s, mut next) = (Vec::new(), 0.0, 0);
    for edit in edits {
        let length_s = edit.duration as f64 / movie_hz;
        if let Some(start) = edit.start {
            if edit.rate < 0.0 {
                return Err(format("its edit list shows a part backwards"));
            }
            let part = Part {
                start,
                // A still frame is shown once.
                end: match (edit.duration, edit.rate) {
                    (_, 0.0) => start as f64 + 0.5,
                    (0, _) => f64::INFINITY,
                    _ => start as f64 + length_s * track_hz * edit.rate,
                },
                // The length is rounded to units of the movie.
                rounding: 0.5 * track_hz / movie_hz,
            };
            let from = order.partition_point(|i| !part.begun(&samples[*i]));
            // Parts that touch may share a frame by rounding.
            if from + 1 < next {
                return Err(format("its edit list shows a part again"));
            }
            let from = match edit.rate {
                // The frame that is shown at its time.
                0.0 => order
                    .partition_point(|i| samples[*i].shown <= start)
                    .saturating_sub(1),
                _ => from,
            };
            next = next.max(from);
            while let Some(sample) = order.get(next).map(|i| &mut samples[*i]) {
                if edit.rate != 0.0 && part.over(sample) {
                    break;
                }
                sample.place = Some(times_s.len());
                let since = sample.shown.saturating_sub(start) as f64;
                let rate = if edit.rate == 0.0 {
                    f64::INFINITY
                } else {
                    edit.rate
                };
                times_s.push(begins_s + since / track_hz / rate);
                next += 1;
                if edit.rate == 0.0 {
                    break;
                }
            }
        }
        begins_s += length_s;
    }
    let first_s = *(times_s.first()).ok_or_else(|| format("its edit list shows no frame"))?;
    for time_s in &mut times_s {
        *time_s -= first_s;
    }
    Ok(times_s)
}

/// A part of a track, in its units.
struct Part {
    start: i64,
    end: f64,
    rounding: f64,
}

impl Part {
    /// Whether a frame begins in the part or behind it; a unit may be lost to rounding.
    fn begun(&self, sample: &Sample) -> bool {
        sample.shown >= self.start.saturating_sub(1)
    }

    /// Whether a frame begins behind the part, or so shortly before its end that it is in it by rounding alone.
    fn over(&self, sample: &Sample) -> bool {
        let slack = self.rounding.min(0.5 * sample.duration as f64);
        sample.shown as f64 + slack >= self.end
    }
}
