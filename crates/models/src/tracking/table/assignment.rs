//! Which sighting may belong to which track, and at what cost.

use super::sighting::{CameraLook, Sighting, separation_rad};
use super::track::CONFIRMED_HITS;
use super::tracks::TrackTable;
use crate::maths::assignment::Pair;
use crate::maths::kinematics::wrap_pi;
use crate::tracking::estimation::LosState;

/// Largest box of which weak detections start a track [px].
const WEAK_START_PX: f64 = 6.0;
/// Extra cost of a pair with a weak detection: a strong one within 3σ is preferred.
const WEAK_COST: f64 = 9.0;
/// Squared distance up to which a sighting is offered to a track, over the gate's.
const OFFERED: f64 = 4.0;

impl TrackTable {
    /// Whether a sighting lies on the picture of a track: the box of a part of it, or one that
    /// has strayed too far to be taken, is no other object.
    pub(super) fn covers(&self, sighting: &Sighting, t_s: f64) -> bool {
        self.tracks.iter().any(|track| {
            let at = track.filter.predicted(t_s).az_el_rad();
            !track.hidden(t_s) && separation_rad(at, sighting.az_el_rad) < 0.5 * track.size_rad
        })
    }

    /// The pairs of tracks and sightings that may belong together, with their costs; `predicted`
    /// holds the tracks' lines of sight at the exposure.
    pub(super) fn pairs(&self, look: &CameraLook, predicted: &[LosState]) -> Vec<Pair> {
        // Such a pair is always better than two that stay alone.
        const ALONE: f64 = 200.0;
        let mut pairs = Vec::new();
        let gate = self.params.gate_sigmas.powi(2);
        for (row, los) in predicted.iter().enumerate() {
            let track = &self.tracks[row];
            // A sighting in front of the building does not belong to a track behind it.
            if track
                .occlusion
                .is_some_and(|occlusion| occlusion.surely_hides(look.t_s))
            {
                continue;
            }
            let spread = los.sigma_rad();
            let cos_el = los.el_rad.cos();
            let flutter = &track.flutter[look.tier];
            let (place_ratio, size_ratio) = (flutter.place_ratio(), flutter.size_ratio().max(1.0));
            let confirmed = track.total_hits() >= CONFIRMED_HITS;
            for (column, sighting) in look.sightings.iter().enumerate() {
                // What is so small scores low in every frame: several in line are news, if one of them was strong.
                let small = sighting.size_rad < WEAK_START_PX * look.ifov_rad;
                if sighting.weak && !confirmed && !small {
                    continue;
                }
                let noise_rad = place_ratio * sighting.sigma_rad;
                let up = sighting.az_el_rad.y - los.el_rad;
                let variance = |sigma: f64| sigma * sigma + noise_rad * noise_rad;
                let variances = [variance(spread.x), variance(spread.y)];
                if up * up > OFFERED * gate * variances[1] {
                    continue;
                }
                let right = wrap_pi(sighting.az_el_rad.x - los.az_rad) * cos_el;
                let distance2 = right * right / variances[0] + up * up / variances[1];
                let spread_of_sizes = self.params.size_log_sigma * size_ratio;
                let size = (sighting.size_rad / track.size_rad).ln() / spread_of_sizes;
                // A box that touches the sky's noise may be of any size: its vote is limited.
                let cost = distance2
                    + (size * size).min(4.0)
                    + (variances[0] * variances[1] / sighting.sigma_rad.powi(4)).ln()
                    + if sighting.weak { WEAK_COST } else { 0.0 };
                // The filter refuses what lies outside its gate, until it has refused three that
                // fit each other: they are offered from twice as far.
                // What it will refuse must take no sighting from another.
                let share = distance2 / (OFFERED * gate);
                let cost = if distance2 <= self.params.filter.gate_nis {
                    cost - ALONE
                } else {
                    share - 1.0
                };
                if share < 1.0 {
                    pairs.push(Pair { row, column, cost });
                }
            }
        }
        pairs
    }
}
