//! Whether a track is a UAV, as log-odds gathered over the last second.
//!
//! Every look at a track says something: whether the detector saw it, with what score, as which class,
//! whether its size holds still. What it says is put as a log-likelihood ratio λ. Looks close in time err alike: a
//! look counts as one tenth of a second of independent news, and the evidence is the mean of λ with a memory
//! of one second, times the ten such looks in it (a sequential test with forgetting: A. Wald, *Sequential
//! Analysis*, 1947). A picture of few pixels tells little: the evidence of a dot is bounded, and what a camera
//! saw in many pixels is not talked down by another that sees few.

pub use crate::maths::logistic::probability;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Sizes up to which a class says nothing, and from which on it says all [px].
const NAMED_PX: [f64; 2] = [6.0, 12.0];
/// Size from which on names weigh more than what a recogniser makes of shape and flight [px]: smaller UAVs at dusk have been
/// called aeroplanes for ten seconds.
const PLAIN_PX: f64 = 24.0;
/// Looks closer together than this err alike [s]; chosen.
const CORRELATED_S: f64 = 0.1;

/// What the looks of a track are weighed by. Log-odds are natural logarithms. The last word of each says where its default is from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct EvidenceTuning {
    /// For how long a look counts [s]. Chosen.
    pub memory_s: f64,
    /// Log-odds that all looks say at most, so that a judgement of minutes can be undone in a second. Chosen.
    pub most: f64,
    /// Log-odds that the score of one look says at most. Chosen.
    pub most_of_score: f64,
    /// How much more than its logit a network's score says: of its detections, those of UAVs and others part faster. Measured.
    pub score_slope: f64,
    /// Log-odds between "seen" and "not seen". Chosen.
    pub seen_step: f64,
    /// What a box of a class that is no UAV says, as log-odds below 0. Chosen.
    pub other_class: f64,
    /// How much a rigid body's box flutters at most, over what its noise allows; a flapping bird's does 2 to 5 times as much, in
    /// size or place. Measured.
    pub rigid_ratio: f64,
    /// Log-odds that a box's flutter says at least, where it is more than a rigid body's, and at most, where it is less. Chosen.
    pub of_shape: [f64; 2],
    /// Score from which on a box's flutter counts in full. Chosen.
    pub clear_score: f64,
    /// How long the best view of a track is remembered [s]. Chosen.
    pub view_memory_s: f64,
    /// Least weight of a look at fewer pixels than the best. Chosen.
    pub least_weight: f64,
    /// Log-odds that looks of a network at a dot say at most, and how much more for each pixel of its size. Chosen.
    pub most_of_dot: f64,
    pub most_per_px: f64,
}

impl Default for EvidenceTuning {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl EvidenceTuning {
    /// The defaults.
    pub const DEFAULT: Self = Self {
        memory_s: 1.0, // [s]
        most: 6.0,
        most_of_score: 1.5,
        score_slope: 1.5,
        seen_step: 1.5,
        other_class: -1.5,
        rigid_ratio: 1.5,
        of_shape: [-1.5, 0.5],
        clear_score: 0.5,
        view_memory_s: 10.0, // [s]
        least_weight: 0.02,
        most_of_dot: 2.0,
        most_per_px: 0.25,
    };

    /// Log-odds that a mean look of one is worth: the independent looks of a memory.
    fn looks(&self) -> f64 {
        self.memory_s / CORRELATED_S
    }
}

/// From which score on a detection speaks for a UAV.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ScoreModel {
    /// From this one on, at any size.
    Fixed(f64),
    /// A trained network: from this one on; the fewer pixels, the less its answer says.
    Network(f64),
}

/// How a detector's answers are read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EvidenceParams {
    /// Share of the frames in which it must see a track for its seeing to speak for a UAV.
    pub min_quality: f64,
    /// What its scores mean.
    pub score: ScoreModel,
    /// Bit by bit, which of its classes are no UAVs.
    pub other_classes: u64,
    /// What they are weighed by.
    pub tuning: EvidenceTuning,
}

impl Default for EvidenceParams {
    fn default() -> Self {
        Self {
            min_quality: 0.6,
            score: ScoreModel::Network(NEUTRAL_SCORE),
            other_classes: 0,
            tuning: EvidenceTuning::default(),
        }
    }
}

/// The score that says nothing, of a network that names none (`score_neutral`): three quarters of the odds at which, on rendered
/// pictures, a detection of the network that the tracker's numbers were chosen with was as likely of a UAV as of anything else.
pub const NEUTRAL_SCORE: f64 = 0.289;

/// ln(p / (1 − p)).
pub fn logit(p: f64) -> f64 {
    let p = p.clamp(1e-3, 1.0 - 1e-3);
    (p / (1.0 - p)).ln()
}

/// How much the class says that is named at such a size, 0 to 1: nobody can name the smallest.
pub fn named_share(size_px: f64) -> f64 {
    ((size_px - NAMED_PX[0]) / (NAMED_PX[1] - NAMED_PX[0])).clamp(0.0, 1.0)
}

impl EvidenceParams {
    /// What a score says.
    fn of_score(&self, score: f64) -> f64 {
        match self.score {
            ScoreModel::Fixed(neutral) => logit(score) - logit(neutral),
            ScoreModel::Network(neutral) => {
                self.tuning.score_slope * (logit(score) - logit(neutral))
            }
        }
    }

    /// Whether a class is no UAV.
    pub fn names_none(&self, label: u32) -> bool {
        label < 64 && self.other_classes >> label & 1 == 1
    }

    /// What a detection says: of this score, class and size, its box fluttering so many times as much as
    /// a rigid body's.
    pub fn of_hit(&self, score: f64, label: u32, size_px: f64, flutter: f64) -> f64 {
        let tuning = &self.tuning;
        let of_score = if self.names_none(label) {
            tuning.other_class * named_share(size_px)
        } else {
            (self.of_score(score)).clamp(-tuning.most_of_score, tuning.most_of_score)
        };
        // The box of a faint picture flutters with its noise, whatever it shows.
        let clear = (score / tuning.clear_score).min(1.0);
        let [least, most] = tuning.of_shape;
        let of_shape = clear * (tuning.rigid_ratio / flutter).ln().clamp(least, most);
        tuning.seen_step * (1.0 - self.min_quality) + of_score + of_shape
    }

    /// What it says that a track in view was not seen.
    pub fn of_miss(&self) -> f64 {
        -self.tuning.seen_step * self.min_quality
    }

    /// Most that a view of so many pixels can say, as log-odds.
    fn bound(&self, size_px: f64) -> f64 {
        match self.score {
            ScoreModel::Fixed(_) => self.tuning.most,
            ScoreModel::Network(_) => {
                let tuning = &self.tuning;
                (tuning.most_of_dot + tuning.most_per_px * size_px).min(tuning.most)
            }
        }
    }
}

/// The evidence gathered on one track.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Mean of λ, times the independent looks of a memory.
    log_odds: f64,
    last_s: Option<f64>,
    /// Size in the best view of it [px].
    best_px: f64,
    /// Weight of the detections that named it no UAV, and of all, with the memory of the mean.
    named: [f64; 2],
}

impl Evidence {
    /// Log-odds that it is a UAV.
    pub fn log_odds(&self) -> f64 {
        self.log_odds
    }

    /// Size in the best view of it [px].
    pub fn best_px(&self) -> f64 {
        self.best_px
    }

    /// Whether most of its detections of late name it no UAV, though it is large enough to be plain.
    pub fn is_named_none(&self) -> bool {
        let [none, all] = self.named;
        self.best_px >= PLAIN_PX && none > 0.5 * all
    }

    /// Takes in that a look at `t_s` [s], in which the track measures `size_px`, says λ; `names_none`: whether its detection
    /// names it no UAV, if there is one.
    pub fn on_look(
        &mut self,
        params: &EvidenceParams,
        (lambda, names_none): (f64, Option<bool>),
        size_px: f64,
        t_s: f64,
    ) {
        let tuning = &params.tuning;
        let since_s = self.last_s.map_or(CORRELATED_S, |last_s| t_s - last_s);
        self.last_s = Some(self.last_s.map_or(t_s, |last_s| last_s.max(t_s)));
        let elapsed_s = since_s.clamp(0.0, CORRELATED_S);
        self.best_px = size_px.max(self.best_px * (-since_s.max(0.0) / tuning.view_memory_s).exp());
        let view = match params.score {
            ScoreModel::Fixed(_) => 1.0,
            ScoreModel::Network(_) => (size_px / self.best_px).powi(2).max(tuning.least_weight),
        };
        let share = 1.0 - (-view * elapsed_s / tuning.memory_s).exp();
        self.log_odds += share * (tuning.looks() * lambda - self.log_odds);
        if let Some(none) = names_none {
            let now = [f64::from(u8::from(none)), 1.0];
            for (sum, now) in self.named.iter_mut().zip(now) {
                *sum += share * (now - *sum);
            }
        }
        let bound = params.bound(self.best_px);
        self.log_odds = self.log_odds.clamp(-bound, bound);
    }

    /// Takes over what a track says that continues this one: the better view counts.
    pub fn join(&mut self, young: &Self) {
        if young.best_px >= self.best_px {
            self.log_odds = young.log_odds;
            self.named = young.named;
        }
        self.best_px = self.best_px.max(young.best_px);
        self.last_s = young.last_s.or(self.last_s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Log-odds after looks at `hz` [Hz] for `span_s` [s], each with this score (0: not seen).
    fn after(
        start: Evidence,
        hz: u32,
        span_s: f64,
        size_px: f64,
        score: impl Fn(u32) -> f64,
    ) -> Evidence {
        let params = EvidenceParams::default();
        let mut evidence = start;
        let from_s = start.last_s.unwrap_or(0.0);
        for i in 1..=(span_s * f64::from(hz)) as u32 {
            let lambda = match score(i) {
                0.0 => params.of_miss(),
                score => params.of_hit(score, 0, size_px, 1.0),
            };
            evidence.on_look(
                &params,
                (lambda, None),
                size_px,
                from_s + f64::from(i) / f64::from(hz),
            );
        }
        evidence
    }

    #[test]
    fn the_frame_rate_does_not_matter() {
        let at = |hz| after(Evidence::default(), hz, 0.3, 20.0, |_| 0.5).log_odds();
        assert!(
            (at(30) - at(120)).abs() < 0.15 * at(30),
            "{} {}",
            at(30),
            at(120)
        );
    }

    #[test]
    fn a_judgement_takes_time_and_can_be_undone() {
        let sure = after(Evidence::default(), 60, 2.0, 20.0, |_| 0.7);
        assert_eq!(sure.log_odds(), EvidenceTuning::default().most);
        // Three bad frames are no verdict, a bad second is.
        let still = after(sure, 60, 0.05, 20.0, |_| 0.2);
        assert!(still.log_odds() > 4.0, "{}", still.log_odds());
        let doubted = after(sure, 60, 1.2, 20.0, |i| if i % 3 == 0 { 0.2 } else { 0.0 });
        assert!(doubted.log_odds() < -2.0, "{}", doubted.log_odds());
    }

    #[test]
    fn a_dot_has_no_name() {
        let params = EvidenceParams {
            other_classes: 0b10,
            ..EvidenceParams::default()
        };
        let named = |size_px| params.of_hit(0.35, 1, size_px, 1.0);
        assert!(named(6.0) > 0.5 && named(12.0) < -0.4);
        assert!((named(9.0) - 0.5 * (named(6.0) + named(12.0))).abs() < 1e-12);
        assert_eq!(named(12.0), named(40.0));
    }

    #[test]
    fn what_most_detections_name_none_is_named_none() {
        let params = EvidenceParams {
            other_classes: 0b10,
            ..EvidenceParams::default()
        };
        let after = |size_px: f64, labels: [u32; 3]| {
            let mut evidence = Evidence::default();
            for i in 0..60 {
                let label = labels[i % 3];
                let says = (0.0, Some(params.names_none(label)));
                evidence.on_look(&params, says, size_px, i as f64 / 60.0);
            }
            evidence
        };
        assert!(after(30.0, [1, 1, 0]).is_named_none());
        assert!(!after(30.0, [1, 0, 0]).is_named_none());
        assert!(!after(20.0, [1, 1, 1]).is_named_none());
        // Frames without it name nothing.
        let mut unseen = after(30.0, [1, 1, 0]);
        unseen.on_look(&params, (params.of_miss(), None), 30.0, 1.1);
        assert!(unseen.is_named_none());
    }

    #[test]
    fn a_dot_does_not_overrule_a_picture() {
        let dot = after(Evidence::default(), 30, 3.0, 3.0, |_| 0.6);
        assert!((2.0..3.0).contains(&dot.log_odds()), "{}", dot.log_odds());
        let seen = after(dot, 60, 2.0, 40.0, |_| 0.15);
        assert!(seen.log_odds() < -2.0);
        let again = after(seen, 30, 3.0, 3.0, |_| 0.6);
        assert!(again.log_odds() < 0.0, "{}", again.log_odds());
    }
}
