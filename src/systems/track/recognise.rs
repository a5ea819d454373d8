//! What tracks are: their last seconds are kept, and shown to the recogniser.

use crate::components::detect::DetectionBatch;
use crate::components::run::{Failure, SimClock};
use crate::components::track::{Gallery, Recogniser, Tracker};
use crate::inference::{OnnxRecogniser, RecogniserError};
use crate::models::maths::kinematics::los_to_az_el;
use crate::models::optics::chip::chip;
use crate::models::tracking::recognition::{Glimpse, Recognition, Sequence, TrackClass};
use crate::models::tracking::table::{Track, TrackTable};
use bevy::prelude::*;

/// Hits from which on a track is looked at.
const LOOKED_AT_HITS: u32 = 4;
/// Longest time since the last hit of a track that is looked at [s].
const LOOKED_AT_S: f64 = 0.5; // [s]

/// A batch as the gallery takes it: when it was exposed, and which track each detection went to.
pub(crate) struct Hung<'a> {
    pub(crate) batch: &'a DetectionBatch,
    pub(crate) t_s: f64,
    pub(crate) assigned: &'a [Option<u32>],
}

impl Gallery {
    /// Keeps what a batch shows of the tracks of `table`, which has just taken it in; `class` names the
    /// detector's classes, and not what it has not named. A batch without a picture leaves nothing.
    pub(crate) fn hang<'a>(
        &mut self,
        hung: &Hung,
        table: &TrackTable,
        class: impl Fn(u32) -> Option<&'a str>,
    ) {
        let frame = &hung.batch.frame;
        let Some(rgb8) = frame.rgb8.as_deref().filter(|_| self.wanted) else {
            return;
        };
        for joined in &table.joined {
            if let Some(young) = self.histories.remove(&joined.young) {
                self.histories.entry(joined.old).or_default().join(young);
            }
        }
        for id in &table.passed {
            self.histories.remove(id);
        }
        for (detection, id) in hung.batch.detections.iter().zip(hung.assigned) {
            let Some(track) = id.and_then(|id| table.get(id)) else {
                continue;
            };
            let centre_px = detection.centre_px();
            let [x0, y0, x1, y1] = detection.box_px;
            let glimpse = Glimpse {
                tick: frame.tick,
                t_s: hung.t_s,
                tier: frame.tier,
                az_el_rad: los_to_az_el(
                    frame.believed.q_enu_cam * frame.pinhole.ray(centre_px.into()),
                ),
                centre_px,
                size_px: [x1 - x0, y1 - y0],
                ifov_rad: frame.pinhole.ifov_rad(),
                score: detection.score,
                named: class(detection.label).map(TrackClass::of_detector),
            };
            let side_px = glimpse.chip_px(track.size_rad);
            let history = self.histories.entry(track.id).or_default();
            history.take(glimpse, || chip(rgb8, frame.rect, centre_px, side_px));
        }
    }

    /// Forgets the tracks that the table has forgotten.
    pub(crate) fn tidy(&mut self, table: &TrackTable) {
        self.histories.retain(|id, _| table.get(*id).is_some());
    }

    /// The last second of a track, if enough of it was seen; `sky_known`: whether the cameras'
    /// pointing is known.
    pub(crate) fn sequence(&self, track: &Track, t_s: f64, sky_known: bool) -> Option<Sequence> {
        let history = self.histories.get(&track.id)?;
        history.sequence(t_s, track.filter.quality(), sky_known)
    }

    /// What tracks of the table are: `first`, then those looked at longest ago, `most` in all.
    pub(crate) fn recognise(
        &self,
        model: &mut OnnxRecogniser,
        table: &TrackTable,
        first: Option<u32>,
        most: usize,
        (t_s, sky_known): (f64, bool),
    ) -> Result<Vec<(u32, Recognition)>, RecogniserError> {
        let looked_at: Vec<(u32, Sequence)> = in_turn(table, first, t_s)
            .into_iter()
            .filter_map(|track| Some((track.id, self.sequence(track, t_s, sky_known)?)))
            .take(most)
            .collect();
        let (ids, sequences): (Vec<u32>, Vec<Sequence>) = looked_at.into_iter().unzip();
        Ok(ids
            .into_iter()
            .zip(model.recognise(&sequences, t_s)?)
            .collect())
    }
}

/// The tracks that are worth a look at `t_s`: `first`, then those looked at longest ago.
fn in_turn(table: &TrackTable, first: Option<u32>, t_s: f64) -> Vec<&Track> {
    let seen =
        |track: &&Track| track.total_hits() >= LOOKED_AT_HITS && t_s - track.seen_s() < LOOKED_AT_S;
    let mut tracks: Vec<&Track> = table.tracks.iter().filter(seen).collect();
    let looked_at_s = |track: &Track| track.recognition.map_or(f64::NEG_INFINITY, |r| r.t_s);
    // The sort is stable: of tracks that have waited as long the older identity comes first.
    tracks.sort_by(|a, b| {
        let others = |track: &Track| Some(track.id) != first;
        let waiting = || looked_at_s(a).total_cmp(&looked_at_s(b));
        others(a).cmp(&others(b)).then_with(waiting)
    });
    tracks
}

/// Asks the recogniser what the tracks are, and gives them the answers that have arrived.
pub fn recognise(
    clock: Res<SimClock>,
    mut stations: Query<(&mut Recogniser, &mut Gallery, &mut Tracker)>,
    mut failure: ResMut<Failure>,
) {
    for (mut recogniser, mut gallery, mut tracker) in &mut stations {
        if let Err(error) = ask(&clock, &mut recogniser, &mut gallery, &mut tracker) {
            failure.set(error);
        }
    }
}

/// Asks a station's recogniser, when it is time, and takes in its answers.
fn ask(
    clock: &SimClock,
    recogniser: &mut Recogniser,
    gallery: &mut Gallery,
    tracker: &mut Tracker,
) -> Result<(), RecogniserError> {
    let Some(model) = &mut recogniser.model else {
        return Ok(());
    };
    if clock.due(recogniser.rate_hz) {
        gallery.tidy(&tracker.table);
        let most = recogniser.max_tracks;
        let at = (clock.t_s(), true);
        let found = gallery.recognise(model, &tracker.table, tracker.target, most, at)?;
        let arrives = clock.tick + recogniser.latency_ticks;
        let waiting = found.into_iter().map(|(id, found)| (arrives, id, found));
        recogniser.waiting.extend(waiting);
    }
    recogniser.waiting.retain(|(arrives, id, found)| {
        let here = *arrives <= clock.tick;
        // An answer about what was seen before something passed it comes too late.
        let still = |track: &&mut Track| track.passed_s.is_none_or(|passed_s| passed_s < found.t_s);
        if here && let Some(track) = tracker.table.get_mut(*id).filter(still) {
            track.recognition = Some(match track.recognition {
                Some(before) => found.after(&before),
                None => *found,
            });
        }
        !here
    });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::capture::{ExposedFrame, PixelRect, Tier};
    use crate::components::mount::{OpticalPath, Pointing};
    use crate::models::optics::camera::Pinhole;
    use crate::models::optics::detection::Detection;
    use crate::models::tracking::evidence::EvidenceParams;
    use crate::models::tracking::table::{CameraLook, Sighting};
    use glam::{DVec2, DVec3};
    use std::sync::Arc;

    /// A table that has seen things at these azimuths [rad] in so many frames at 60 Hz.
    fn table(azimuths_rad: &[f64], frames: u32) -> TrackTable {
        let mut table = TrackTable::default();
        for frame in 0..frames {
            let sighting = |az_rad: &f64| Sighting {
                az_el_rad: DVec2::new(*az_rad, 0.1),
                sigma_rad: 1e-5,
                size_rad: 1e-3,
                score: 0.9,
                label: 0,
                weak: false,
            };
            table.update(&CameraLook {
                tier: Tier::Coarse,
                t_s: f64::from(frame) / 60.0,
                ifov_rad: 1e-4,
                reads: &EvidenceParams::default(),
                sightings: &azimuths_rad.iter().map(sighting).collect::<Vec<_>>(),
                in_view: &|_| true,
                start_tracks: true,
            });
        }
        table
    }

    #[test]
    fn the_target_is_looked_at_first_and_then_who_has_waited_longest() {
        let mut table = table(&[0.1, 0.2, 0.3, 0.4], 10);
        let looked_at_s = [Some(0.1), None, Some(0.05), None];
        for (track, t_s) in table.tracks.iter_mut().zip(looked_at_s) {
            track.recognition = t_s.map(|t_s| Recognition {
                probabilities: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                t_s,
            });
        }
        let turn = |first, t_s| -> Vec<u32> {
            in_turn(&table, first, t_s)
                .iter()
                .map(|track| track.id)
                .collect()
        };
        assert_eq!(turn(Some(0), 0.2), [0, 1, 3, 2]);
        assert_eq!(turn(None, 0.2), [1, 3, 2, 0]);
        // What has long been silent is left alone.
        assert!(turn(Some(0), 3.0).is_empty());
    }

    #[test]
    fn pictures_of_tracks_are_kept_until_the_table_forgets_them() {
        let pinhole = Pinhole::from_hfov(64, 48, 0.05).unwrap();
        let rect = PixelRect {
            offset_px: [0, 0],
            size_px: [64, 48],
        };
        let mut picture = vec![200_u8; 3 * 64 * 48];
        for y in 20..28 {
            picture[3 * (64 * y + 28)..3 * (64 * y + 36)].fill(10);
        }
        let pointing = Pointing {
            az_el_rad: DVec2::new(0.2, 0.1),
            ..Pointing::default()
        };
        let frame = |tick: u64, rgb8: Option<Vec<u8>>| ExposedFrame {
            tick,
            believed: pointing.pose(DVec3::ZERO, OpticalPath::OnGimbal, DVec3::ZERO),
            rgb8: rgb8.map(Arc::new),
            ..ExposedFrame::bare(Tier::Coarse, pinhole)
        };
        let mut table = table(&[0.2], 10);
        let id = table.tracks[0].id;
        let mut gallery = Gallery {
            wanted: true,
            ..Gallery::default()
        };
        let hang = |gallery: &mut Gallery, table: &TrackTable, tick: u64, rgb8: Option<Vec<u8>>| {
            let batch = DetectionBatch {
                frame: Arc::new(frame(tick, rgb8)),
                available_tick: tick,
                look: rect,
                shrunk: 1,
                detections: vec![Detection::new([28.0, 20.0, 36.0, 28.0], 0.8, 0)],
                best_scores: Vec::new(),
                moving: Vec::new(),
                answered: true,
            };
            let hung = Hung {
                batch: &batch,
                t_s: tick as f64 / 960.0,
                assigned: &[Some(id)],
            };
            gallery.hang(&hung, table, |_| Some("bird"));
        };
        // A run without pictures keeps nothing.
        hang(&mut gallery, &table, 0, None);
        assert!(gallery.histories.is_empty());
        for tick in [60, 120, 180, 240] {
            hang(&mut gallery, &table, tick, Some(picture.clone()));
        }
        let sequence = gallery.sequence(&table.tracks[0], 0.3, true).unwrap();
        let steps: Vec<_> = sequence.steps.iter().flatten().collect();
        assert_eq!(steps.len(), 4);
        let glimpse = steps[0].glimpses[0];
        assert_eq!(
            (glimpse.named, glimpse.size_px),
            (Some(TrackClass::Bird), [8.0, 8.0])
        );
        assert!(
            (glimpse.az_el_rad - pointing.az_el_rad).length() < 1e-6,
            "{glimpse:?}"
        );
        // Dark in the middle, bright around.
        let chip = &steps[0].chip;
        assert!(chip[3 * (12 * 24 + 12)] < 20 && chip[0] == 200);
        // Pictures from before something passed it may be of that.
        table.passed = vec![id];
        hang(&mut gallery, &table, 300, Some(picture.clone()));
        assert!(gallery.sequence(&table.tracks[0], 0.4, true).is_none());
        gallery.tidy(&TrackTable::default());
        assert!(gallery.histories.is_empty());
    }
}
