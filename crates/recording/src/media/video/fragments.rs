//! Where the frames of a track lie, and when they are shown, from its fragments (`moof`).

use super::boxes::{Broken, Index, child, children, damaged, u32_at, u64_at, version_flags};
use super::tables::Sample;

/// What holds for the frames of a track where a fragment does not say otherwise (`trex`).
#[derive(Clone, Copy, Debug, Default)]
struct Defaults {
    description: u32,
    duration: u32,
    size: u32,
}

/// Numbers of a full box that follow each other.
struct Fields<'a> {
    data: &'a [u8],
    at: usize,
}

impl Fields<'_> {
    fn next(&mut self) -> Option<u32> {
        self.at += 4;
        u32_at(self.data, self.at - 4)
    }

    /// The next number, where the flags say that it is there.
    fn next_if(&mut self, there: bool) -> Option<Option<u32>> {
        match there {
            true => self.next().map(Some),
            false => Some(None),
        }
    }
}

/// The most frames that a file can hold: one a byte.
fn too_many(samples: &[Sample], index: &Index) -> bool {
    samples.len() as u64 > index.length
}

/// Appends the frames of track `track` in the fragments of a file to those of its tables; whether frames behind the end
/// of a file that is cut off were left out.
pub(super) fn append(samples: &mut Vec<Sample>, index: &Index, track: u32) -> Result<bool, Broken> {
    let defaults = child(&index.moov, b"mvex")
        .into_iter()
        .flat_map(children)
        .filter(|(kind, trex)| kind == b"trex" && u32_at(trex, 4) == Some(track))
        .find_map(|(_, trex)| {
            Some(Defaults {
                description: u32_at(trex, 8)?,
                duration: u32_at(trex, 12)?,
                size: u32_at(trex, 16)?,
            })
        })
        .unwrap_or_default();
    for (start, moof) in &index.fragments {
        // Data follows that of the track before, where nothing else is said.
        let mut behind = *start;
        for (kind, traf) in children(moof) {
            if &kind == b"traf" {
                let run = Fragment::read(traf, *start, behind, defaults);
                let run = run.ok_or_else(|| damaged("tfhd"))?;
                behind = run.append(samples, traf, index, track)?;
            }
        }
    }
    let whole =
        |sample: &Sample| sample.offset.saturating_add(u64::from(sample.size)) <= index.length;
    let first_lost = samples.iter().position(|sample| !whole(sample));
    match first_lost {
        None => Ok(false),
        Some(first) if index.cut.is_some() && first > 0 => {
            samples.truncate(first);
            Ok(true)
        }
        Some(first) => Err(Broken::Truncated(format!(
            "frame {first} of {} lies behind the end of the file",
            samples.len()
        ))),
    }
}

/// What one fragment says of one track.
struct Fragment {
    track: u32,
    /// Where its data is counted from [byte].
    base: u64,
    defaults: Defaults,
    /// When its first frame is decoded, where it says so.
    decoded: Option<i64>,
}

impl Fragment {
    fn read(traf: &[u8], moof: u64, behind: u64, mut defaults: Defaults) -> Option<Self> {
        let tfhd = child(traf, b"tfhd")?;
        let (_, flags) = version_flags(tfhd)?;
        let track = u32_at(tfhd, 4)?;
        let mut fields = Fields { data: tfhd, at: 8 };
        let base = match flags & 1 {
            0 => None,
            _ => {
                fields.at += 8;
                Some(u64_at(tfhd, 8)?)
            }
        };
        let description = fields.next_if(flags & 2 != 0)?;
        let duration = fields.next_if(flags & 8 != 0)?;
        let size = fields.next_if(flags & 0x10 != 0)?;
        defaults.description = description.unwrap_or(defaults.description);
        defaults.duration = duration.unwrap_or(defaults.duration);
        defaults.size = size.unwrap_or(defaults.size);
        let from_moof = flags & 0x2_0000 != 0;
        let tfdt = child(traf, b"tfdt");
        let decoded = tfdt.and_then(|tfdt| match tfdt.first()? {
            0 => u32_at(tfdt, 4).map(i64::from),
            _ => u64_at(tfdt, 4).and_then(|time| i64::try_from(time).ok()),
        });
        Some(Self {
            track,
            base: base.unwrap_or(if from_moof { moof } else { behind }),
            defaults,
            decoded,
        })
    }

    /// Appends its frames if it is of track `track`; where its data ends [byte].
    fn append(
        &self,
        samples: &mut Vec<Sample>,
        traf: &[u8],
        index: &Index,
        track: u32,
    ) -> Result<u64, Broken> {
        let goes_on = || (samples.last()).map_or(0, |last| last.decoded + last.duration);
        let mut decoded = self.decoded.unwrap_or_else(goes_on);
        let mut at = self.base;
        for (kind, trun) in children(traf) {
            if &kind != b"trun" {
                continue;
            }
            let run = self.run(trun, &mut at, &mut decoded, index);
            let run = run.ok_or_else(|| damaged("trun"))?;
            if self.track == track {
                samples.extend(run);
            }
            if too_many(samples, index) {
                return Err(damaged("trun"));
            }
        }
        Ok(at)
    }

    /// The frames of a run; moves on the place of its data and the time.
    fn run(
        &self,
        trun: &[u8],
        at: &mut u64,
        decoded: &mut i64,
        index: &Index,
    ) -> Option<Vec<Sample>> {
        let (_, flags) = version_flags(trun)?;
        let count = u32_at(trun, 4)? as usize;
        let mut fields = Fields { data: trun, at: 8 };
        if let Some(shift) = fields.next_if(flags & 1 != 0)? {
            *at = self
                .base
                .checked_add_signed(i64::from(shift.cast_signed()))?;
        }
        fields.next_if(flags & 4 != 0)?;
        // Frames of one size lie in the file; sizes of their own each take bytes of the run.
        if flags & 0x200 == 0 {
            let all = (count as u64).checked_mul(self.defaults.size.max(1).into())?;
            (all <= index.length).then_some(())?;
        }
        let mut samples = Vec::new();
        for _ in 0..count {
            let duration = fields.next_if(flags & 0x100 != 0)?;
            let size = fields.next_if(flags & 0x200 != 0)?;
            fields.next_if(flags & 0x400 != 0)?;
            let shift = fields.next_if(flags & 0x800 != 0)?.unwrap_or(0);
            let size = size.unwrap_or(self.defaults.size);
            let duration = i64::from(duration.unwrap_or(self.defaults.duration));
            samples.push(Sample {
                offset: *at,
                size,
                decoded: *decoded,
                duration,
                // Shifts may be negative, and are so in files of either version.
                shown: decoded.checked_add(i64::from(shift.cast_signed()))?,
                description: (self.defaults.description as usize).saturating_sub(1),
                place: None,
            });
            *at = at.checked_add(u64::from(size))?;
            *decoded = decoded.checked_add(duration)?;
        }
        Some(samples)
    }
}
