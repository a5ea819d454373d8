//! What a track is held to be: its evidence, and what the recogniser found.

use super::track::{Lased, Track};
use crate::tracking::evidence::{logit, named_share, probability};
use crate::tracking::recognition::{Recognition, TrackClass};

/// Manned aircraft are longer than this [m] from any side, a small helicopter's cabin from ahead included; a box shows but so small
/// a part of one this often, as against what is so small.
const LEAST_AIRCRAFT_M: f64 = 2.0;
pub(super) const PART_OF_AIRCRAFT: f64 = 0.05;
/// What a recogniser's word counts on what is too small to be named.
const OF_THE_UNNAMED: f64 = 0.3;

impl Track {
    /// Log-odds that it is a UAV: the one place in which what speaks for it is put together. A recogniser,
    /// which has seen all that the evidence counts and the pictures besides, has the word; of the smallest it mostly
    /// says which birds and UAVs are about where it learned.
    pub fn log_odds(&self) -> f64 {
        match self.recognised() {
            Some(found) => logit(found.p_uav()) + self.conduct.company,
            None => self.evidence.log_odds(),
        }
    }

    /// What the recogniser last found it to be, which sees no distance, and what the range finder's last echo makes of its size.
    pub fn found(&self) -> Option<Recognition> {
        let is_small = |lased: &Lased| self.size_rad * lased.range_m < LEAST_AIRCRAFT_M;
        let found = self.recognition?;
        Some(match self.lased.filter(is_small) {
            Some(_) => found.weighed(
                &[TrackClass::Aeroplane, TrackClass::Helicopter],
                PART_OF_AIRCRAFT,
            ),
            None => found,
        })
    }

    /// What it was found to be, as far as that counts: less of what is too small to be named.
    pub fn recognised(&self) -> Option<Recognition> {
        let named = named_share(self.evidence.best_px());
        let share = OF_THE_UNNAMED + (1.0 - OF_THE_UNNAMED) * named;
        let found = self.found()?;
        let p_uav = found.p_uav();
        let counted = probability(share * logit(p_uav));
        // What is left goes to the other classes as they stand.
        let others = (1.0 - counted) / (1.0 - p_uav).max(1e-6);
        let mut probabilities = found.probabilities.map(|p| p * others);
        probabilities[TrackClass::Uav as usize] = counted;
        Some(Recognition {
            probabilities,
            ..found
        })
    }

    /// Probability that it is a UAV.
    pub fn uav_belief(&self) -> f64 {
        probability(self.log_odds())
    }
}
