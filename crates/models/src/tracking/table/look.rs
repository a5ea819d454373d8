//! What a frame changes of a track that it shows, or should have shown.

use super::sighting::{CameraLook, Sighted, Sighting};
use super::track::{CONFIRMED_HITS, Track};
use crate::tracking::estimation::Gating;
use crate::tracking::flutter::Place;

/// Size at which a camera that has not yet confirmed a track is taken to see it, over that in its best view.
const UNCONFIRMED_SHARE: f64 = 0.5;
/// Share of the newest sighting in a track's smoothed size, and the least in its score and class.
const SMOOTHING: f64 = 0.2;
/// Most by which one sighting counts as larger or smaller than the track, in the logarithm: a box that
/// clings to another part for a frame does not change the size.
const MOST_GROWTH: f64 = 0.5;
const LEAST_SCORE_SHARE: f64 = 0.05;

impl Track {
    /// Offers a sighting to the filter. One that is too old for the filter still counts as a hit.
    pub(super) fn take(&mut self, look: &CameraLook, sighting: &Sighting) -> Gating {
        // What was offered shows its flutter whether it is accepted or not: so the filter learns that it
        // must not be as sure of the next.
        let flutter = &mut self.flutter[look.tier];
        flutter.on_sighting(Place {
            t_s: look.t_s,
            az_el_rad: sighting.az_el_rad,
            sigma_rad: sighting.sigma_rad,
            size_rad: sighting.size_rad,
        });
        let sigma_rad = flutter.place_ratio() * sighting.sigma_rad;
        let gating = self.filter.update(sighting.az_el_rad, sigma_rad, look.t_s);
        if !matches!(gating, Gating::Rejected { .. }) {
            self.record(look, sighting);
        }
        gating
    }

    /// A frame that should have shown it did not.
    pub(super) fn missed(&mut self, look: &CameraLook) {
        // Three cameras read 210 frames a second of what the mount turns to, and the two finer ones may not have it yet.
        if self.hits[look.tier] > 0 {
            self.misses += 1;
            self.looks[look.tier] += 1;
        }
        self.filter.miss(look.t_s);
        let mut size_px = self.size_rad / look.ifov_rad;
        if self.hits[look.tier] < CONFIRMED_HITS {
            // A camera that has never shown it may be turned past it: its view is not yet the best one.
            size_px = size_px.min(UNCONFIRMED_SHARE * self.evidence.best_px());
        }
        let says = (look.reads.of_miss(), None);
        (self.evidence).on_look(look.reads, says, size_px, look.t_s);
    }

    pub(super) fn record(&mut self, look: &CameraLook, sighting: &Sighting) {
        self.hits[look.tier] += 1;
        self.looks[look.tier] += 1;
        let last_s = &mut self.last_hit_s[look.tier];
        *last_s = Some(last_s.map_or(look.t_s, |last_s| last_s.max(look.t_s)));
        self.misses = 0;
        let growth = (sighting.size_rad / self.size_rad).ln();
        self.size_rad *= (SMOOTHING * growth.clamp(-MOST_GROWTH, MOST_GROWTH)).exp();
        let flutter = self.flutter[look.tier];
        if look.t_s >= self.sighted.t_s {
            self.sighted = Sighted {
                t_s: look.t_s,
                az_el_rad: sighting.az_el_rad,
                sigma_rad: flutter.place_ratio() * sighting.sigma_rad,
            };
        }
        let size_px = self.size_rad / look.ifov_rad;
        let lambda = look
            .reads
            .of_hit(sighting.score, sighting.label, size_px, flutter.ratio());
        let says = (lambda, Some(look.reads.names_none(sighting.label)));
        self.evidence.on_look(look.reads, says, size_px, look.t_s);
        // The mean of the first ones, so that a candidate is judged by several frames.
        let share = (1.0 / f64::from(self.total_hits())).max(LEAST_SCORE_SHARE);
        self.score += share * (sighting.score - self.score);
        for votes in &mut self.votes {
            *votes *= 1.0 - LEAST_SCORE_SHARE;
        }
        let class = sighting.label as usize;
        if self.votes.len() <= class {
            self.votes.resize(class + 1, 0.0);
        }
        self.votes[class] += sighting.score;
        // A box's side is good to about two standard deviations of its centre, or what its size flutters by.
        let sigma_rel = 2.0 * flutter.size_ratio().max(1.0) * sighting.sigma_rad
            / sighting.size_rad.max(sighting.sigma_rad);
        self.range.on_size(sighting.size_rad, sigma_rel, look.t_s);
    }
}
