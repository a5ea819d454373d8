//! The numbers of a measured detector, and what it says with them.

use super::noise::{Draws, Of};
use super::scenery::pick;
use super::{Appearance, KNOTS_PX, Noise, Scenery, TERMS, at_size};
use crate::optics::detection::Detection;
use crate::optics::tier::Tier;
use crate::sensing::moving::MovingAs;
use crate::tracking::evidence::{logit, probability};
use crate::tracking::recognition::{CLASSES, TrackClass};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// A detector and a recogniser as they were measured: a model file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// What was measured, and from what.
    pub of: String,
    /// The detector's classes.
    pub classes: Vec<String>,
    /// Scores from which on a box goes on with a track, starts one, and says nothing either way.
    pub floor: f64,
    pub start: f64,
    pub neutral: f64,
    /// By what things are: UAV, bird, anything else that flies.
    pub uav: Kind,
    pub bird: Kind,
    pub other: Kind,
    /// What it takes for something where nothing flies.
    pub scenery: Scenery,
    /// What the recogniser makes of scenery.
    pub scenery_named: Names,
}

/// What is said of things of a kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kind {
    /// Whether they are found, and how surely.
    pub scores: Scores,
    /// Shares of the detector's classes, and of what only moves, at each knot of size.
    pub named: Vec<[f64; KNOTS_PX.len()]>,
    /// How a class goes on from frame to frame.
    pub naming: Noise,
    /// Chance in a frame of the search camera that what has no box is found by its motion, at each knot of size.
    pub moving: [f64; KNOTS_PX.len()],
    /// Where boxes lie.
    pub boxes: Boxes,
    /// What the recogniser makes of them.
    pub recognised: Names,
}

/// Whether a thing is found, and with what score.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scores {
    /// What the probit of being found gains with each of [`Appearance::terms`].
    pub found: [f64; TERMS],
    /// What the mean of the score's logit gains with each, of a thing that is found, were there no floor, and its standard
    /// deviation.
    pub logit: [f64; TERMS],
    pub sigma: f64,
    /// How both go on.
    pub noise: Noise,
}

/// Errors of boxes, at each knot of size, of the side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Boxes {
    /// Standard deviation of their middles about their mean [px], of the middle one of all things.
    pub off_px: [f64; KNOTS_PX.len()],
    /// Standard deviation of that mean, and of the log of a thing's own standard deviation, both over the middle one's.
    pub bias: f64,
    pub spread: f64,
    /// How errors go on.
    pub off: Noise,
    /// Mean and standard deviation of the log of a side over the true one, and how it goes on.
    pub log_side: [f64; KNOTS_PX.len()],
    pub log_side_sigma: [f64; KNOTS_PX.len()],
    pub side: Noise,
}

/// What a recogniser says: a normal logit of the UAV's probability at each knot of size; the others share the rest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Names {
    /// Mean and standard deviation of the logit, and how it goes on.
    pub logit: [f64; KNOTS_PX.len()],
    pub sigma: [f64; KNOTS_PX.len()],
    pub noise: Noise,
    /// Shares of the classes that are no UAV.
    pub others: [f64; CLASSES],
}

impl Measured {
    /// What is wrong with the numbers, and where, if anything is.
    pub fn fault(&self) -> Option<String> {
        let kinds = [
            ("uav", &self.uav),
            ("bird", &self.bird),
            ("other", &self.other),
        ];
        let places = [
            ("search", &self.scenery.search),
            ("coarse", &self.scenery.coarse),
            ("precise", &self.scenery.precise),
        ];
        let share = |value: f64| (0.0..=1.0).contains(&value);
        let mut rules = vec![
            (
                "floor, start and neutral must be above 0 and below 1".to_owned(),
                {
                    [self.floor, self.start, self.neutral]
                        .iter()
                        .all(|score| *score > 0.0 && *score < 1.0)
                },
            ),
            (
                "scenery_named: a share is below 0 or no number".to_owned(),
                self.scenery_named.is_sound(),
            ),
        ];
        for (name, kind) in kinds {
            let rule = |what: &str| format!("{name}.{what}");
            let sigma = kind.scores.sigma;
            rules.extend([
                (
                    rule("scores.sigma must be above 0"),
                    sigma > 0.0 && sigma.is_finite(),
                ),
                (
                    rule("named must have a row a class"),
                    kind.named.len() == self.classes.len(),
                ),
                (
                    rule("named: a share is below 0"),
                    kind.named.iter().flatten().all(|value| *value >= 0.0),
                ),
                (
                    rule("moving must be from 0 to 1"),
                    kind.moving.iter().all(|value| share(*value)),
                ),
                (
                    rule("recognised: a share is below 0 or no number"),
                    kind.recognised.is_sound(),
                ),
                (rule("noise: a share is below 0 or above 1"), {
                    let noises = [
                        kind.scores.noise,
                        kind.naming,
                        kind.boxes.off,
                        kind.boxes.side,
                    ];
                    noises.iter().all(Noise::is_sound)
                }),
            ]);
        }
        for (name, place) in places {
            let rule = |what: &str| format!("scenery.{name}.{what}");
            rules.extend([
                (
                    rule("sky_per_mpx and solid_per_mpx must be from 0 to 1e6"),
                    {
                        [place.sky_per_mpx, place.solid_per_mpx]
                            .iter()
                            .all(|rate| (0.0..=1e6).contains(rate))
                    },
                ),
                (rule("duty must be from 0 to 1"), share(place.duty)),
                (
                    rule("named must have a number a class"),
                    place.named.len() == self.classes.len(),
                ),
                (
                    rule("scores must be from 0 to 1"),
                    place.scores.iter().all(|score| share(*score)),
                ),
            ]);
        }
        rules
            .into_iter()
            .find_map(|(rule, kept)| (!kept).then_some(rule))
    }

    /// What is said of things of a class.
    pub fn kind(&self, class: TrackClass) -> &Kind {
        match class {
            TrackClass::Uav => &self.uav,
            TrackClass::Bird => &self.bird,
            _ => &self.other,
        }
    }

    /// What is said of a thing with a true box [px, full sensor], if anything.
    pub fn found(
        &self,
        class: TrackClass,
        seen: &Appearance,
        true_px: [f64; 4],
        draws: &Draws,
    ) -> Option<Detection> {
        let kind = self.kind(class);
        let noise = draws.noise(Of::Score, &kind.scores.noise);
        let boxed = |score: f64, label: u32| {
            let box_px = kind.boxes.drawn(seen.size_px, true_px, draws);
            Detection::new(box_px, score, label)
        };
        if let Some(score) = kind.scores.drawn(seen, noise, self.floor) {
            // Numbers from 0 to 1 that go on like the noise.
            let share = normal_share(draws.noise(Of::Name, &kind.naming));
            let shares = kind
                .named
                .iter()
                .map(|shares| at_size(shares, seen.size_px));
            return Some(boxed(score, pick(shares, share)));
        }
        let moves = draws.even < at_size(&kind.moving, seen.size_px);
        (moves && seen.tier == Tier::Search)
            .then(|| boxed(self.start.max(MovingAs::NEUTRAL), self.classes.len() as u32))
    }

    /// Probability of each class that the recogniser gives a track of a thing of a class, or of scenery, that measures
    /// so many pixels in its best view.
    pub fn recognised(
        &self,
        class: Option<TrackClass>,
        size_px: f64,
        draws: &Draws,
    ) -> [f64; CLASSES] {
        class
            .map_or(&self.scenery_named, |class| &self.kind(class).recognised)
            .drawn(class, size_px, draws)
    }
}

impl Scores {
    /// Chance that a thing is found.
    pub fn chance(&self, seen: &Appearance) -> f64 {
        normal_share(weighed(seen, &self.found))
    }

    /// Mean of the logit of what is found, were there no floor.
    pub fn mean(&self, seen: &Appearance) -> f64 {
        weighed(seen, &self.logit)
    }

    /// Score of a thing at a normal noise, by a detector with a floor; none where it is not found.
    pub fn drawn(&self, seen: &Appearance, noise: f64, floor: f64) -> Option<f64> {
        let chance = self.chance(seen);
        // How high the noise is among all that leave the thing found, 0 to 1.
        let height = (normal_share(noise) - (1.0 - chance)) / chance.max(1e-9);
        (height > 0.0).then(|| {
            let mean = self.mean(seen);
            let below = normal_share((logit(floor) - mean) / self.sigma);
            let share = below + height * (1.0 - below);
            probability(mean + self.sigma * deviations(share)).max(floor)
        })
    }
}

impl Boxes {
    fn drawn(&self, size_px: f64, [x0, y0, x1, y1]: [f64; 4], draws: &Draws) -> [f64; 4] {
        let own = (self.spread * draws.spread).exp();
        let typical_px = at_size(&self.off_px, size_px);
        let off_px = |purpose: Of, mean: f64| {
            typical_px * (self.bias * mean + own * draws.noise(purpose, &self.off))
        };
        let log_side = at_size(&self.log_side, size_px);
        let sigma = at_size(&self.log_side_sigma, size_px);
        let times = |purpose: Of| (log_side + sigma * draws.noise(purpose, &self.side)).exp();
        let x = 0.5 * (x0 + x1) + off_px(Of::Right, draws.mean[0]);
        let y = 0.5 * (y0 + y1) + off_px(Of::Down, draws.mean[1]);
        let (half_x, half_y) = (
            0.5 * (x1 - x0) * times(Of::Width),
            0.5 * (y1 - y0) * times(Of::Height),
        );
        [x - half_x, y - half_y, x + half_x, y + half_y]
    }
}

impl Names {
    fn is_sound(&self) -> bool {
        let sigmas = self.sigma.iter().all(|sigma| *sigma >= 0.0);
        sigmas && self.others.iter().all(|share| *share >= 0.0) && self.noise.is_sound()
    }

    fn drawn(&self, class: Option<TrackClass>, size_px: f64, draws: &Draws) -> [f64; CLASSES] {
        let (mean, sigma) = (at_size(&self.logit, size_px), at_size(&self.sigma, size_px));
        let p_uav = probability(mean + sigma * draws.noise(Of::Recognised, &self.noise));
        let mut shares = self.others;
        // Kinds that were fitted together have the name of each.
        if let Some(class) =
            class.filter(|class| !matches!(class, TrackClass::Uav | TrackClass::Bird))
        {
            shares = [0.0; CLASSES];
            shares[class as usize] = 1.0;
        }
        shares[TrackClass::Uav as usize] = 0.0;
        let sum: f64 = shares.iter().sum();
        let mut probabilities = shares.map(|share| (1.0 - p_uav) * share / sum.max(1e-9));
        probabilities[TrackClass::Uav as usize] = p_uav;
        probabilities
    }
}

fn weighed(seen: &Appearance, gains: &[f64; TERMS]) -> f64 {
    let terms = seen.terms();
    terms
        .iter()
        .zip(gains)
        .map(|(term, gain)| term * gain)
        .sum()
}

/// Standard deviations below which a share of a normal distribution lies: [`normal_share`] turned round, by Newton's method from
/// a logistic curve.
fn deviations(share: f64) -> f64 {
    let share = share.clamp(1e-6, 1.0 - 1e-6);
    let mut at = (share / (1.0 - share)).ln() / 1.702;
    for _ in 0..6 {
        let density = (-0.5 * at * at).exp() / TAU.sqrt();
        at -= ((normal_share(at) - share) / density).clamp(-1.0, 1.0);
    }
    at
}

/// Share of a normal distribution that is below a number of standard deviations.
pub(super) fn normal_share(deviations: f64) -> f64 {
    0.5 * libm::erfc(-deviations * FRAC_1_SQRT_2)
}
