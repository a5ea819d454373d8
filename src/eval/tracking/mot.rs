//! Tracks and truth in MOTChallenge form, for an independent scorer.
//!
//! The layout is the one `MotChallenge2DBox` of TrackEval reads with `SKIP_SPLIT_FOL`:
//! `gt/SEQUENCE/gt/gt.txt`, `gt/SEQUENCE/seqinfo.ini`, `trackers/RULE/data/SEQUENCE.txt`.

use super::job::{Observed, Snapshot, Square};
use crate::output::OutputError;
use crate::output::put;
use std::fmt::Write as _;
use std::path::Path;

/// Boxes are squares about the aim point, no smaller than this [px]: intersection over union of
/// boxes of a few pixels would measure the noise of a pixel, not identities.
pub const MIN_SIDE_PX: f64 = 8.0;

/// A square with the smallest side that is scored.
fn scored([x, y, side]: Square) -> [f64; 4] {
    let side = side.max(MIN_SIDE_PX);
    [x - 0.5 * side, y - 0.5 * side, side, side]
}

/// One line: frame and identity from 1, left, top, width, height, confidence, class, visibility.
fn line(out: &mut String, frame: usize, id: u64, square: Square) {
    let [left, top, width, height] = scored(square);
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "{frame},{id},{left:.3},{top:.3},{width:.3},{height:.3},1,1,1"
    );
}

/// Truth and tracker of one set of a run.
#[derive(Debug, Default, PartialEq)]
pub struct Sequence {
    /// Text of `gt.txt`.
    pub truth: String,
    /// Text of the tracker's file.
    pub tracker: String,
    /// Number of frames.
    pub frames: usize,
}

/// All UAVs in the frame, against the confirmed tracks; against the one locked object under the
/// paper's rule, which knows no other.
pub fn all(observed: &Observed, paper: bool) -> Sequence {
    sequence(&observed.snapshots, |snapshot, truth, tracker| {
        for seen in snapshot
            .uavs
            .iter()
            .filter(|seen| seen.clear && seen.inside)
        {
            truth.push((seen.uav as u64 + 1, seen.square));
        }
        if paper {
            tracker.extend(snapshot.locked.map(|(_, square)| (1, square)));
        } else {
            let tracks = snapshot.tracks.iter();
            tracker.extend(tracks.map(|(id, square)| (u64::from(*id) + 1, *square)));
        }
    })
}

/// The UAV that was locked first, against the locked object.
pub fn lock(observed: &Observed, paper: bool) -> Sequence {
    sequence(&observed.snapshots, |snapshot, truth, tracker| {
        let first = snapshot
            .uavs
            .iter()
            .find(|seen| Some(seen.uav) == observed.lock.first_uav);
        truth.extend(
            first
                .filter(|seen| seen.clear)
                .map(|seen| (seen.uav as u64 + 1, seen.square)),
        );
        tracker.extend(snapshot.locked.map(|(id, square)| {
            let id = if paper { 1 } else { u64::from(id) + 1 };
            (id, square)
        }));
    })
}

type Boxes = Vec<(u64, Square)>;

fn sequence(snapshots: &[Snapshot], boxes: impl Fn(&Snapshot, &mut Boxes, &mut Boxes)) -> Sequence {
    let mut sequence = Sequence {
        frames: snapshots.len(),
        ..Sequence::default()
    };
    for (index, snapshot) in snapshots.iter().enumerate() {
        let (mut truth, mut tracker) = (Vec::new(), Vec::new());
        boxes(snapshot, &mut truth, &mut tracker);
        for (id, square) in truth {
            line(&mut sequence.truth, index + 1, id, square);
        }
        for (id, square) in tracker {
            line(&mut sequence.tracker, index + 1, id, square);
        }
    }
    sequence
}

/// Writes a sequence of a rule below `folder`.
pub fn write(
    folder: &Path,
    name: &str,
    rule: &str,
    rate_hz: u32,
    [width_px, height_px]: [u32; 2],
    sequence: &Sequence,
) -> Result<(), OutputError> {
    // Each rule steers the cameras its own way, so that each has its own truth in the frame.
    let gt = folder.join(rule).join("gt").join(name);
    let data = folder.join(rule).join("trackers").join(rule).join("data");
    put(&gt.join("gt").join("gt.txt"), &sequence.truth)?;
    put(
        &gt.join("seqinfo.ini"),
        format!(
            "[Sequence]\nname={name}\nimDir=img1\nframeRate={rate_hz}\nseqLength={}\n\
             imWidth={width_px}\nimHeight={height_px}\nimExt=.jpg\n",
            sequence.frames
        ),
    )?;
    put(&data.join(format!("{name}.txt")), &sequence.tracker)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::eval::tracking::job::Seen;

    #[test]
    fn a_line_has_the_fields_of_the_format() {
        let mut out = String::new();
        line(&mut out, 3, 7, [100.0, 50.0, 12.0]);
        line(&mut out, 3, 8, [100.0, 50.0, 2.0]);
        assert_eq!(
            out,
            "3,7,94.000,44.000,12.000,12.000,1,1,1\n3,8,96.000,46.000,8.000,8.000,1,1,1\n"
        );
    }

    #[test]
    fn the_sets_hold_what_they_say() {
        let seen = |uav, clear, inside| Seen {
            uav,
            square: [10.0 * uav as f64, 0.0, 8.0],
            clear,
            inside,
        };
        let mut observed = Observed {
            snapshots: vec![Snapshot {
                uavs: vec![
                    seen(0, true, true),
                    seen(1, false, true),
                    seen(2, true, false),
                ],
                tracks: vec![(4, [0.0, 0.0, 8.0]), (9, [50.0, 0.0, 8.0])],
                locked: Some((4, [0.0, 0.0, 8.0])),
            }],
            ..Observed::default()
        };
        observed.lock.first_uav = Some(2);
        let rows = |text: &str| text.lines().count();
        let ours = all(&observed, false);
        assert_eq!((rows(&ours.truth), rows(&ours.tracker)), (1, 2));
        let paper = all(&observed, true);
        assert!(paper.tracker.starts_with("1,1,"));
        let one = lock(&observed, false);
        assert!(one.truth.starts_with("1,3,") && one.tracker.starts_with("1,5,"));
    }
}
