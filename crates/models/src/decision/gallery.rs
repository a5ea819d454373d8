//! What each track looked like in its last second, for a recogniser.

use super::look::Shown;
use crate::maths::kinematics::los_to_az_el;
use crate::optics::chip::chip;
use crate::tracking::recognition::{Glimpse, History, Sequence, TrackClass};
use crate::tracking::table::{Track, TrackTable};
use std::collections::BTreeMap;

/// Hits from which on a track is looked at.
const LOOKED_AT_HITS: u32 = 4;
/// Longest time since the last hit of a track that is looked at [s].
const LOOKED_AT_S: f64 = 0.5; // [s]

/// What each track looked like in its last second.
#[derive(Clone, Debug, Default)]
pub struct Gallery {
    /// Whether anybody looks at it; otherwise it stays empty.
    pub wanted: bool,
    /// The histories by the tracks' identities.
    pub histories: BTreeMap<u32, History>,
}

impl Gallery {
    /// Keeps what a frame shows of the tracks of `table`, which has just taken it in: which of them each detection went
    /// to is in `assigned`. `class` names the detector's classes, and not what it has not named. A frame without a picture
    /// leaves nothing.
    pub fn hang<'a>(
        &mut self,
        shown: &Shown,
        assigned: &[Option<u32>],
        table: &TrackTable,
        class: impl Fn(u32) -> Option<&'a str>,
    ) {
        let Some((rgb8, rect)) = shown.picture.filter(|_| self.wanted) else {
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
        for (detection, id) in shown.detections.iter().zip(assigned) {
            let Some(track) = id.and_then(|id| table.get(id)) else {
                continue;
            };
            let centre_px = detection.centre_px();
            let [x0, y0, x1, y1] = detection.box_px;
            let glimpse = Glimpse {
                tick: shown.tick,
                t_s: shown.t_s,
                tier: shown.tier,
                az_el_rad: los_to_az_el(
                    shown.believed.q_enu_cam * shown.pinhole.ray(centre_px.into()),
                ),
                centre_px,
                size_px: [x1 - x0, y1 - y0],
                ifov_rad: shown.pinhole.ifov_rad(),
                score: detection.score,
                named: class(detection.label).map(TrackClass::of_detector),
            };
            let side_px = glimpse.chip_px(track.size_rad);
            let history = self.histories.entry(track.id).or_default();
            history.take(glimpse, || chip(rgb8, rect, centre_px, side_px));
        }
    }

    /// Forgets the tracks that the table has forgotten.
    pub fn tidy(&mut self, table: &TrackTable) {
        self.histories.retain(|id, _| table.get(*id).is_some());
    }

    /// The last second of a track, if enough of it was seen; `sky_known`: whether the cameras'
    /// pointing is known.
    pub fn sequence(&self, track: &Track, t_s: f64, sky_known: bool) -> Option<Sequence> {
        let history = self.histories.get(&track.id)?;
        history.sequence(t_s, track.filter.quality(), sky_known)
    }

    /// The tracks of the table that a recogniser is to look at, with their last seconds: `first`, then those looked at
    /// longest ago, `most` in all.
    pub fn looked_at(
        &self,
        table: &TrackTable,
        first: Option<u32>,
        most: usize,
        (t_s, sky_known): (f64, bool),
    ) -> (Vec<u32>, Vec<Sequence>) {
        (in_turn(table, first, t_s).into_iter())
            .filter_map(|track| Some((track.id, self.sequence(track, t_s, sky_known)?)))
            .take(most)
            .unzip()
    }
}

/// The tracks that are worth a look at `t_s`: `first`, then those looked at longest ago.
pub fn in_turn(table: &TrackTable, first: Option<u32>, t_s: f64) -> Vec<&Track> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::kinematics::boresight_chain;
    use crate::optics::camera::{Pinhole, PixelRect};
    use crate::optics::detection::Detection;
    use crate::optics::tier::Tier;
    use crate::tracking::evidence::EvidenceParams;
    use crate::tracking::recognition::Recognition;
    use crate::tracking::table::{CameraLook, Sighting};
    use glam::{DVec2, DVec3};

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
        let at_rad = DVec2::new(0.2, 0.1);
        let zero = DVec3::ZERO;
        let believed = boresight_chain(zero, zero, at_rad.x, at_rad.y, DVec2::ZERO, zero);
        let mut table = table(&[0.2], 10);
        let id = table.tracks[0].id;
        let mut gallery = Gallery {
            wanted: true,
            ..Gallery::default()
        };
        let hang = |gallery: &mut Gallery, table: &TrackTable, tick: u64, rgb8: Option<&[u8]>| {
            let shown = Shown {
                tick,
                t_s: tick as f64 / 960.0,
                look: rect,
                detections: &[Detection::new([28.0, 20.0, 36.0, 28.0], 0.8, 0)],
                picture: rgb8.map(|rgb8| (rgb8, rect)),
                ..Shown::whole(Tier::Coarse, pinhole, believed)
            };
            gallery.hang(&shown, &[Some(id)], table, |_| Some("bird"));
        };
        // A run without pictures keeps nothing.
        hang(&mut gallery, &table, 0, None);
        assert!(gallery.histories.is_empty());
        for tick in [60, 120, 180, 240] {
            hang(&mut gallery, &table, tick, Some(&picture));
        }
        let sequence = gallery.sequence(&table.tracks[0], 0.3, true).unwrap();
        let steps: Vec<_> = sequence.steps.iter().flatten().collect();
        assert_eq!(steps.len(), 4);
        let glimpse = steps[0].glimpses[0];
        assert_eq!(
            (glimpse.named, glimpse.size_px),
            (Some(TrackClass::Bird), [8.0, 8.0])
        );
        assert!((glimpse.az_el_rad - at_rad).length() < 1e-6, "{glimpse:?}");
        // Dark in the middle, bright around.
        let chip = &steps[0].chip;
        assert!(chip[3 * (12 * 24 + 12)] < 20 && chip[0] == 200);
        // Pictures from before something passed it may be of that.
        table.passed = vec![id];
        hang(&mut gallery, &table, 300, Some(&picture));
        assert!(gallery.sequence(&table.tracks[0], 0.4, true).is_none());
        gallery.tidy(&TrackTable::default());
        assert!(gallery.histories.is_empty());
    }
}
