//! What tracks are: their last seconds are kept, and shown to the recogniser.

use crate::components::detect::DetectionBatch;
use crate::components::run::{Failure, SimClock};
use crate::components::track::{Gallery, Recogniser, Tracker};
use crate::inference::{OnnxRecogniser, RecogniserError};
use crate::models::maths::kinematics::los_to_az_el;
use crate::models::optics::camera::Pinhole;
use crate::models::optics::chip::chip;
use crate::models::tracking::recognition::{Glimpse, ObjectClass, Recognition, Sequence};
use crate::models::tracking::table::{Track, TrackTable};
use bevy::prelude::*;
use glam::DVec3;

/// Hits from which on a track is looked at.
const LOOKED_AT_HITS: u32 = 4;
/// Longest time since the last hit of a track that is looked at [s].
const LOOKED_AT_S: f64 = 0.5; // [s]

/// A batch as the gallery takes it: where its camera was, when, and which track each detection went to.
pub(crate) struct Hung<'a> {
    pub(crate) batch: &'a DetectionBatch,
    pub(crate) pinhole: &'a Pinhole,
    pub(crate) r_enu_m: DVec3,
    pub(crate) t_s: f64,
    pub(crate) assigned: &'a [Option<u32>],
}

impl Gallery {
    /// Keeps what a batch shows of the tracks of `table`, which has just taken it in; `class` names the
    /// detector's classes. A batch without a picture leaves nothing.
    pub(crate) fn hang<'a>(
        &mut self,
        hung: &Hung,
        table: &TrackTable,
        class: impl Fn(u32) -> &'a str,
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
        let pose = frame.pointing.believed_pose(hung.r_enu_m, frame.tier);
        for (detection, id) in hung.batch.detections.iter().zip(hung.assigned) {
            let Some(track) = id.and_then(|id| table.get(id)) else {
                continue;
            };
            let centre_px = detection.centre_px();
            let [x0, y0, x1, y1] = detection.box_px;
            let glimpse = Glimpse {
                tick: frame.tick,
                t_s: hung.t_s,
                tier: frame.tier as usize,
                az_el_rad: los_to_az_el(pose.q_enu_cam * hung.pinhole.ray(centre_px.into())),
                centre_px,
                size_px: [x1 - x0, y1 - y0],
                ifov_rad: hung.pinhole.ifov_rad(),
                score: detection.score,
                named: ObjectClass::of_detector(class(detection.label)),
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
        let seen = |track: &&Track| {
            track.total_hits() >= LOOKED_AT_HITS && t_s - track.seen_s() < LOOKED_AT_S
        };
        let mut tracks: Vec<&Track> = table.tracks.iter().filter(seen).collect();
        let looked_at_s = |track: &Track| track.recognition.map_or(f64::NEG_INFINITY, |r| r.t_s);
        // The sort is stable: of tracks as old the older identity comes first.
        tracks.sort_by(|a, b| {
            let waits = |track: &Track| (Some(track.id) != first, looked_at_s(track));
            let (a, b) = (waits(a), waits(b));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
        });
        let looked_at: Vec<(u32, Sequence)> = tracks
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

/// Asks the recogniser what the tracks are, and gives them the answers that have arrived.
pub fn recognise(
    clock: Res<SimClock>,
    mut recogniser: ResMut<Recogniser>,
    mut gallery: ResMut<Gallery>,
    mut tracker: ResMut<Tracker>,
    mut failure: ResMut<Failure>,
) {
    let recogniser = &mut *recogniser;
    let Some(model) = &mut recogniser.model else {
        return;
    };
    if clock.due(recogniser.rate_hz) {
        gallery.tidy(&tracker.table);
        let most = recogniser.max_tracks;
        let at = (clock.t_s(), true);
        let found = gallery.recognise(model, &tracker.table, tracker.target, most, at);
        match found {
            Ok(found) => {
                let arrives = clock.tick + recogniser.latency_ticks;
                let waiting = found.into_iter().map(|(id, found)| (arrives, id, found));
                recogniser.waiting.extend(waiting);
            }
            Err(error) => failure.set(error),
        }
    }
    recogniser.waiting.retain(|(arrives, id, found)| {
        let here = *arrives <= clock.tick;
        if here && let Some(track) = tracker.table.get_mut(*id) {
            track.recognition = Some(*found);
        }
        !here
    });
}
