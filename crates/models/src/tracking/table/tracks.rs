//! The tracks that are kept: how one starts, and which are forgotten.

use super::sighting::{CameraLook, Sighted, Sighting};
use super::track::{Conduct, ESTABLISHED_HITS, Track};
use crate::optics::tier::PerTier;
use crate::tracking::estimation::{LosFilter, LosFilterParams};
use crate::tracking::evidence::Evidence;
use crate::tracking::ranging::Ranging;
use crate::tracking::scenery::Scenery;

/// Settings of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableParams {
    /// Filter of every track.
    pub filter: LosFilterParams,
    /// A sighting belongs to no track that is further away than this many standard deviations.
    pub gate_sigmas: f64,
    /// Standard deviation of the logarithm of a box's size about the track's.
    pub size_log_sigma: f64,
    /// A young track goes after more misses in a row than it has hits, in cameras that have seen it; this is the longest time
    /// without a hit for any that is not hidden by the city [s].
    pub max_coast_s: f64,
    /// Longest time without a hit behind a building [s].
    pub max_hidden_s: f64,
    /// Tracks kept; the ones with the fewest hits go first.
    pub max_tracks: usize,
    /// Span that objects are assumed to have until their range is measured [m].
    pub span_m: f64,
    /// Standard deviation of that span, over the span.
    pub span_sigma_rel: f64,
}

impl Default for TableParams {
    fn default() -> Self {
        Self {
            filter: LosFilterParams::default(),
            gate_sigmas: 4.0,
            size_log_sigma: 0.3,
            max_coast_s: 3.0,   // [s]
            max_hidden_s: 12.0, // [s]
            max_tracks: 128,
            // The catalogue's UAVs span 0.2 m to 1.7 m, most of them near 0.4 m.
            span_m: 0.45, // [m]
            span_sigma_rel: 0.5,
        }
    }
}

/// A track that turned out to continue an older one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JoinedTrack {
    /// Identity that ended.
    pub young: u32,
    /// Identity that goes on.
    pub old: u32,
}

/// All tracks, oldest first.
#[derive(Clone, Debug, Default)]
pub struct TrackTable {
    /// Settings of gates, memory and size.
    pub params: TableParams,
    /// The tracks, in the order they were started.
    pub tracks: Vec<Track>,
    /// Identities that the last frame ended.
    pub joined: Vec<JoinedTrack>,
    /// Identities of which the last frame may show either of two: they passed each other.
    pub passed: Vec<u32>,
    /// Where scenery has been seen.
    pub scenery: Scenery,
    next_id: u32,
}

impl TrackTable {
    /// The track of an identity.
    pub fn get(&self, id: u32) -> Option<&Track> {
        self.tracks.iter().find(|track| track.id == id)
    }

    /// The track of an identity, to be changed.
    pub fn get_mut(&mut self, id: u32) -> Option<&mut Track> {
        self.tracks.iter_mut().find(|track| track.id == id)
    }

    pub(super) fn start(&mut self, look: &CameraLook, sighting: &Sighting) -> Option<u32> {
        let Sighting {
            az_el_rad,
            sigma_rad,
            size_rad,
            score,
            ..
        } = *sighting;
        let filter = LosFilter::start(self.params.filter, az_el_rad, sigma_rad, look.t_s).ok()?;
        let range = Ranging::new(self.params.span_m, self.params.span_sigma_rel).ok()?;
        let id = self.next_id;
        self.next_id += 1;
        let mut track = Track {
            id,
            filter,
            range,
            sighted: Sighted {
                t_s: look.t_s,
                az_el_rad,
                sigma_rad,
            },
            lased: None,
            hits: PerTier::default(),
            looks: PerTier::default(),
            misses: 0,
            started_s: look.t_s,
            last_hit_s: PerTier::default(),
            size_rad,
            score,
            votes: Vec::new(),
            evidence: Evidence::default(),
            flutter: PerTier::default(),
            conduct: Conduct {
                in_scenery: self.scenery.holds(az_el_rad, look.t_s),
                ..Conduct::default()
            },
            unanswered: 0,
            nearer: (0, 0.0),
            ranged_by_radar: false,
            barred_until_s: f64::NEG_INFINITY,
            occlusion: None,
            recognition: None,
            passed_s: None,
        };
        track.record(look, sighting);
        self.tracks.push(track);
        Some(id)
    }

    /// Drops young tracks that missed more than they hit, and all that have been silent too long.
    pub(super) fn forget_silent(&mut self, t_s: f64) {
        let params = self.params;
        self.tracks.retain(|track| {
            let hits = track.total_hits();
            let silent_s = t_s - track.seen_s();
            let longest_s = if track.hidden(t_s) {
                params.max_hidden_s
            } else {
                // A track that was hidden is given the time from its coming out.
                let exit_s = track.occlusion.and_then(|occlusion| occlusion.exit_s);
                let hidden_s = exit_s.map_or(0.0, |exit_s| exit_s - track.seen_s());
                params.max_coast_s + hidden_s.clamp(0.0, params.max_hidden_s)
            };
            (track.misses <= hits || hits >= ESTABLISHED_HITS) && silent_s < longest_s
        });
    }

    /// Drops the tracks with the fewest hits beyond the number that is kept.
    pub(super) fn forget_surplus(&mut self) {
        while self.tracks.len() > self.params.max_tracks {
            let Some(weakest) = (0..self.tracks.len())
                .min_by_key(|i| (self.tracks[*i].total_hits(), self.tracks[*i].id))
            else {
                break;
            };
            self.tracks.remove(weakest);
        }
    }
}
