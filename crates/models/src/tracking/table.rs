//! The track table: sightings of all cameras become tracks with one identity each.
//!
//! One table serves the three cameras. A frame is assigned as a whole, at the least total cost
//! (global nearest neighbour, [`crate::maths::assignment`]): the cost of a pair is the squared
//! distance in standard deviations plus the squared difference of log sizes, so that two targets
//! at different ranges stay apart while their sight lines cross, plus the log of the spread, so
//! that a vague track does not take the sighting of a sharp one. The deviations are those that the
//! track's own flutter has shown ([`crate::tracking::flutter`]).
//!
//! Detections below the detector's threshold go on with tracks that are established, and start none
//! (Y. Zhang et al., "ByteTrack", 2022).

mod assignment;
mod belief;
mod identity;
mod lasing;
mod look;
mod occlusion;
mod sighting;
mod track;
mod tracks;

pub use sighting::{CameraLook, Sighted, Sighting, separation_rad};
pub use track::{Conduct, JUDGED_HITS, Lased, Occlusion, Track};
pub use tracks::{JoinedTrack, TableParams, TrackTable};

use crate::maths::assignment::assign;
use crate::tracking::estimation::{Gating, LosFilter, LosState};

impl TrackTable {
    /// Takes a frame in, at the least total cost; what is left over starts a track or counts as a
    /// miss. Returns for each sighting the track it went to.
    pub fn update(&mut self, look: &CameraLook) -> Vec<Option<u32>> {
        let mut assigned = vec![None; look.sightings.len()];
        let predicted: Vec<LosState> = self
            .tracks
            .iter()
            .map(|track| track.filter.predicted(look.t_s))
            .collect();
        self.note_passes(&predicted, look.t_s);
        let pairs = self.pairs(look, &predicted);
        let chosen = assign(self.tracks.len(), look.sightings.len(), &pairs);
        for (row, column) in chosen.into_iter().enumerate() {
            let track = &mut self.tracks[row];
            let hit = column.is_some_and(|column| {
                let gating = track.take(look, &look.sightings[column]);
                let refused = matches!(gating, Gating::Rejected { .. });
                if !refused {
                    assigned[column] = Some(track.id);
                }
                !refused
            });
            if !hit && !track.hidden(look.t_s) && (look.in_view)(predicted[row].az_el_rad()) {
                track.missed(look);
            }
        }
        self.forget_silent(look.t_s);
        if look.start_tracks {
            for (s, sighting) in look.sightings.iter().enumerate() {
                if assigned[s].is_none() && !sighting.weak && !self.covers(sighting, look.t_s) {
                    assigned[s] = self.start(look, sighting);
                }
            }
            self.forget_surplus();
        }
        self.stitch(look.t_s, &mut assigned);
        assigned
    }

    /// Gives a sighting to a track at any distance: the paper's rule has no gate.
    /// One that does not fit restarts the track's estimate, under the same identity.
    pub fn force(&mut self, id: u32, look: &CameraLook, sighting: Option<&Sighting>) {
        let filter = self.params.filter;
        self.joined.clear();
        self.passed.clear();
        let Some(track) = self.get_mut(id) else {
            return;
        };
        match sighting {
            None => track.missed(look),
            Some(sighting) if matches!(track.take(look, sighting), Gating::Rejected { .. }) => {
                let (at, sigma) = (sighting.az_el_rad, sighting.sigma_rad);
                if let Ok(fresh) = LosFilter::start(filter, at, sigma, look.t_s) {
                    track.filter = fresh;
                    track.record(look, sighting);
                }
            }
            Some(_) => {}
        }
    }
}

#[cfg(test)]
mod tests;
