//! The numbers by which a tracker decides.

use crate::tracking::evidence::EvidenceTuning;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What the tracker's decisions are tuned by. Log-odds are natural logarithms. The last word of each says where its default is
/// from: derived from something stated, or chosen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TrackerTuning {
    /// Frames that must show a track before it may become the target: a false alarm seldom comes back. Chosen.
    pub candidate_hits: u32,
    /// Log-odds from which on a track is chosen that is large enough to be named: four to one. Chosen.
    pub chosen: f64,
    /// `chosen` of a track that only a closer look can tell. Chosen.
    pub chosen_small: f64,
    /// Sizes up to which only a closer look can tell what something is, and from which on none is needed [px]. Chosen.
    pub closer_look_px: [f64; 2],
    /// Log-odds from which on a track takes the place of a target that is itself likely. Chosen.
    pub rival: f64,
    /// How long another track must have been the greater threat before it becomes the target [s]. Chosen.
    pub rival_s: f64,

    /// Least significance of a rate on the sky that counts as flight, in deviations. Chosen.
    pub moving_sigmas: f64,
    /// How long a track must move to be no scenery for the moment [s]. Chosen.
    pub moved_s: f64,
    /// How long a track must move to have flown for good: scenery does not [s]. Chosen.
    pub flown_s: f64,
    /// How long what stands still must do so to be learned as scenery [s]. Chosen.
    pub learned_s: f64,
    /// Clear sky that must lie below what stands in the sky [rad]. Chosen.
    pub sky_margin_rad: f64,
    /// What it says against a track that it stands before scenery, as log-odds below 0, once a recogniser has judged it and no
    /// closer look is wanted. Chosen.
    pub before_scenery: f64,
    /// `before_scenery` of what no recogniser has judged: a detector takes the same facade for the same in every frame. Chosen.
    pub before_scenery_unjudged: f64,

    /// What a radar's cue adds at most to the log-odds of a track at its place. Chosen.
    pub cue_for: f64,
    /// What a radar's cue says of a track elsewhere, as log-odds below 0. Chosen.
    pub cue_against: f64,
    /// What a radar adds to the log-odds of a track that has flown and flies as its target does: enough for a close look, no word
    /// on fire. Chosen.
    pub cue_for_flying: f64,

    /// Widest angle between two tracks that fly along with each other [rad]. Chosen.
    pub company_rad: f64,
    /// Least distance of a track's company from it, in its sizes: nothing so far is a part of it. Chosen.
    pub company_sizes: f64,
    /// Slowest flight that can be in company [rad/s]. Chosen.
    pub company_radps: f64,
    /// Share by which the rates of two that fly along may differ. Chosen.
    pub company_rates: f64,
    /// Time over which what a track's company says evens out [s]. Chosen.
    pub company_s: f64,
    /// How much oftener two that fly along are of a kind because of that than two of any kinds by chance; 0: company says nothing.
    /// Chosen.
    pub company_of_a_kind: f64,

    /// What the range finder says, as log-odds below 0, of a track that is too large for a UAV, or as far as what stands behind it.
    /// Chosen: no looks outweigh it.
    pub disproved: f64,
    /// What never flew and is nearer to the city's surface behind it than this, or as little beyond it, is part of it [m]: the
    /// raster's cells and crowns err by so much. Chosen.
    pub surface_m: f64,
    /// Probability by the recogniser from which on a plain picture outweighs `surface_m`. Chosen.
    pub plain_probability: f64,
    /// Log-odds by the detector from which on a plain picture outweighs `surface_m`. Chosen.
    pub plain_log_odds: f64,
    /// Size from which on a plain picture outweighs `surface_m` [px]. Chosen.
    pub plain_px: f64,

    /// For how long the search is given up for a UAV, at even odds [s]: a target that is not sure enough for fire is held for
    /// its odds times this. Chosen.
    pub worth_s: f64,
    /// A target is doubted for so long at least before it is given up [s]. Chosen.
    pub least_doubt_s: f64,
    /// For how long a track is left alone that was given up and would be chosen again [s]. Chosen.
    pub rejected_s: f64,
    /// For how long a track is left alone that the range finder has disproved [s]. Chosen.
    pub disproved_barred_s: f64,
    /// Log-odds below which not even the smallest is shown to the precise camera. Chosen.
    pub surely_none: f64,
    /// Time that the coarse camera has to confirm a candidate [s]. Chosen.
    pub acquire_timeout_s: f64,
    /// Time that a lost target has to come back, beside that for which the city hides it [s]. Chosen.
    pub lost_timeout_s: f64,
    /// Hits of the coarse camera that bring a lost target back. Chosen.
    pub again_hits: u32,
    /// Hits of the search camera that bring a lost target back. Chosen.
    pub refind_hits: u32,

    /// Time over which what is recognised in a target evens out before it counts for fire [s]. Chosen.
    pub sure_s: f64,
    /// Time over which what the radar says of a target evens out before it counts for fire [s]. Chosen.
    pub vouched_s: f64,
    /// For how long a target must have been fired at to fall of it [s]. Chosen.
    pub fired_s: f64,
    /// By how much faster than before a target sinks that falls [m/s]. Chosen.
    pub falling_mps: f64,
    /// For how long a target must sink so fast to have fallen [s]. Chosen.
    pub falling_s: f64,
    /// Time over which the flutter of a target's box evens out [s]. Chosen.
    pub flutter_s: f64,
    /// Lock radius as a share of the smaller side of a large target's box: a beam on a larger body may wander more. Chosen.
    pub lock_share: f64,
    /// Radius beyond which the lock breaks, as such a share. Chosen.
    pub break_share: f64,
    /// Share of the precise camera's field that a target may fill: beyond, its edges come and go. Chosen.
    pub fits_share: f64,

    /// What the looks of a track are weighed by until a recogniser has judged it.
    pub evidence: EvidenceTuning,
}

impl Default for TrackerTuning {
    fn default() -> Self {
        Self {
            candidate_hits: 6,
            chosen: 1.5,
            chosen_small: -0.15,
            closer_look_px: [8.0, 16.0], // [px]
            rival: 4.0,
            rival_s: 1.0, // [s]
            moving_sigmas: 6.0,
            moved_s: 0.2,         // [s]
            flown_s: 0.5,         // [s]
            learned_s: 0.8,       // [s]
            sky_margin_rad: 4e-3, // [rad]
            before_scenery: -0.7,
            before_scenery_unjudged: -8.0,
            cue_for: 1.0,
            cue_against: -3.0,
            cue_for_flying: 2.0,
            company_rad: 0.05, // [rad]
            company_sizes: 2.0,
            company_radps: 3e-3, // [rad/s]
            company_rates: 0.2,
            company_s: 1.0, // [s]
            company_of_a_kind: 15.0,
            disproved: -8.0,
            surface_m: 8.0, // [m]
            plain_probability: 0.95,
            plain_log_odds: 4.0,
            plain_px: 24.0,           // [px]
            worth_s: 1.0,             // [s]
            least_doubt_s: 0.3,       // [s]
            rejected_s: 10.0,         // [s]
            disproved_barred_s: 60.0, // [s]
            surely_none: -1.5,
            acquire_timeout_s: 3.0, // [s]
            lost_timeout_s: 3.0,    // [s]
            again_hits: 2,
            refind_hits: 3,
            sure_s: 0.5,      // [s]
            vouched_s: 1.0,   // [s]
            fired_s: 0.1,     // [s]
            falling_mps: 6.0, // [m/s]
            falling_s: 0.3,   // [s]
            flutter_s: 0.2,   // [s]
            lock_share: 0.1,
            break_share: 0.25,
            fits_share: 0.8,
            evidence: EvidenceTuning::default(),
        }
    }
}
