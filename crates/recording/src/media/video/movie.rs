//! The video track of a file: which it is, its frames, and what is to become of them.

use super::boxes::{Broken, Index, child, children, format, u32_at};
use super::description::{Description, descriptions, is_h264};
use super::edits::{edits, place};
use super::fragments::append;
use super::tables::{Sample, samples};
use super::turn::{Turn, matrix};
use boresight_common::warning::Notes;

/// The video track of a file.
pub(super) struct Movie {
    /// Its frames in the order in which they are stored.
    pub(super) samples: Vec<Sample>,
    /// When those that are shown are, in their order [s from the first].
    pub(super) times_s: Vec<f64>,
    /// How its frames are coded, and what they are to be.
    pub(super) descriptions: Vec<Description>,
    /// How its pictures are turned.
    pub(super) turn: Turn,
    /// What is taken for granted or left out.
    pub(super) notes: Notes,
}

/// A video track, its boxes.
struct Track<'a> {
    trak: &'a [u8],
    tkhd: &'a [u8],
    stbl: &'a [u8],
    /// Units of time a second [Hz].
    hz: f64,
}

impl<'a> Track<'a> {
    /// A video track; none for another.
    fn of(trak: &'a [u8]) -> Option<Result<Self, Broken>> {
        let mdia = child(trak, b"mdia")?;
        (child(mdia, b"hdlr")?.get(8..12) == Some(b"vide")).then_some(())?;
        Some(Self::read(trak, mdia))
    }

    fn read(trak: &'a [u8], mdia: &'a [u8]) -> Result<Self, Broken> {
        let minf = child(mdia, b"minf").unwrap_or_default();
        let hz = child(mdia, b"mdhd")
            .and_then(timescale_hz)
            .ok_or_else(|| format("it has no time scale"))?;
        let stbl = child(minf, b"stbl").ok_or_else(|| format("it has no table of frames"))?;
        let dref = child(minf, b"dinf").and_then(|dinf| child(dinf, b"dref"));
        let mut references = children(dref.and_then(|dref| dref.get(8..)).unwrap_or_default());
        if references.any(|(_, data)| data.get(3).is_some_and(|flags| flags & 1 == 0)) {
            return Err(format("its frames lie in another file"));
        }
        Ok(Self {
            trak,
            tkhd: child(trak, b"tkhd").unwrap_or_default(),
            stbl,
            hz,
        })
    }

    fn is_enabled(&self) -> bool {
        self.tkhd.get(3).is_none_or(|flags| flags & 1 != 0)
    }

    fn id(&self) -> u32 {
        let long = self.tkhd.first() == Some(&1);
        u32_at(self.tkhd, if long { 20 } else { 12 }).unwrap_or(0)
    }
}

/// Units of time a second of an `mdhd` or `mvhd` box [Hz].
fn timescale_hz(header: &[u8]) -> Option<f64> {
    let long = header.first() == Some(&1);
    let hz = u32_at(header, if long { 20 } else { 12 })?;
    (hz > 0).then_some(f64::from(hz))
}

impl Movie {
    /// The video track of a file: the first of H.264 that is enabled.
    pub(super) fn parse(index: &Index) -> Result<Self, Broken> {
        let mut notes = Notes::default();
        let track = chosen(&index.moov, &mut notes)?;
        let descriptions = descriptions(track.stbl)?;
        let mut samples = match child(track.stbl, b"stsz").or(child(track.stbl, b"stz2")) {
            // The tables of a fragmented file may be missing.
            None if !index.fragments.is_empty() => Vec::new(),
            _ => samples(track.stbl, index.length)?,
        };
        let lost = append(&mut samples, index, track.id())?;
        if let Some(cut) = index
            .cut
            .as_ref()
            .filter(|_| lost || !index.fragments.is_empty())
        {
            let mend = "the frames before it are read; copy or record the file again";
            notes.assume("fragments", cut, mend);
        }
        let stored = samples.len();
        samples.retain(|sample| sample.size > 0);
        for _ in samples.len()..stored {
            notes.leave_out("frames without content", "its tables");
        }
        if samples.is_empty() {
            return Err(format("it holds no frames"));
        }
        if (samples.iter()).any(|sample| sample.description >= descriptions.len()) {
            return Err(format(
                "its frames have a description that it does not hold",
            ));
        }
        let mvhd = child(&index.moov, b"mvhd").unwrap_or_default();
        let movie_hz = timescale_hz(mvhd).unwrap_or(track.hz);
        let times_s = place(&mut samples, &edits(track.trak)?, movie_hz, track.hz)?;
        let long = |header: &[u8]| header.first() == Some(&1);
        let movie = matrix(mvhd, if long(mvhd) { 48 } else { 36 });
        let turned = matrix(track.tkhd, if long(track.tkhd) { 52 } else { 40 });
        Ok(Self {
            samples,
            times_s,
            descriptions,
            turn: Turn::of(turned, movie)?,
            notes,
        })
    }
}

/// The track that is played.
fn chosen<'a>(moov: &'a [u8], notes: &mut Notes) -> Result<Track<'a>, Broken> {
    if child(moov, b"cmov").is_some() {
        return Err(format("its index is compressed ('cmov')"));
    }
    let found = children(moov)
        .filter(|(kind, _)| kind == b"trak")
        .filter_map(|(_, trak)| Track::of(trak))
        .collect::<Result<Vec<Track<'a>>, Broken>>()?;
    let enabled = found.iter().any(Track::is_enabled);
    let count = found.len();
    let mut tracks: Vec<Track<'a>> = (found.into_iter())
        .filter(|track| !enabled || track.is_enabled())
        .collect();
    let h264 = tracks.iter().filter(|track| is_h264(track.stbl)).count();
    if h264 > 1 || (h264 == 1 && count > 1) {
        let what =
            format!("it holds {count} video tracks: the first of H.264 that is enabled is read");
        notes.assume(
            "tracks",
            what,
            "keep one with `ffmpeg -i IN -map 0:v:N -c copy OUT.mp4`",
        );
    }
    let at = tracks
        .iter()
        .position(|track| is_h264(track.stbl))
        .unwrap_or(0);
    match at < tracks.len() {
        true => Ok(tracks.swap_remove(at)),
        false => Err(format("it holds no video track")),
    }
}
