//! Backgrounds, ways to fly and parts of a set, drawn in given shares.

use crate::models::maths::rng::Stream;
use serde::{Deserialize, Serialize};

/// What stands behind the targets of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Background {
    /// Nothing but sky in the whole picture.
    Sky,
    /// Trees and fields, or their skyline.
    Forest,
    /// Buildings, or their skyline.
    Urban,
}

/// How the UAVs of a still fly.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// Level, tilted by a few degrees.
    Level,
    /// Tilted hard to any side.
    Manoeuvre,
    /// Pitched up or down.
    ClimbDive,
}

impl Motion {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Level, Self::Manoeuvre, Self::ClimbDive];
}

/// Which part of the set a scene belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// Training.
    Train,
    /// Validation.
    Val,
}

impl Split {
    /// The folder's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
        }
    }
}

/// `count` picks in the proportions of `shares`, met as exactly as whole numbers allow and
/// shuffled.
pub fn quota(count: u32, shares: &[f64], rng: &mut Stream) -> Vec<usize> {
    let total: f64 = shares.iter().sum();
    let mut picks = Vec::with_capacity(count as usize);
    let mut sum = 0.0;
    for (i, share) in shares.iter().enumerate() {
        sum += share;
        let until = (f64::from(count) * sum / total).round() as usize;
        picks.resize(until, i);
    }
    for i in (1..picks.len()).rev() {
        picks.swap(i, pick(i + 1, rng));
    }
    picks
}

/// A whole number below `count`.
pub fn pick(count: usize, rng: &mut Stream) -> usize {
    ((rng.uniform() * count as f64) as usize).min(count.saturating_sub(1))
}

/// The index of one of `shares`, in their proportions.
pub fn choose(shares: &[f64], rng: &mut Stream) -> usize {
    let mut rest = rng.uniform() * shares.iter().sum::<f64>();
    for (i, share) in shares.iter().enumerate() {
        rest -= share;
        if rest < 0.0 {
            return i;
        }
    }
    shares.len().saturating_sub(1)
}

/// A draw between two limits, even over the logarithm.
pub fn log_range([from, to]: [f64; 2], rng: &mut Stream) -> f64 {
    rng.range(from.ln(), to.ln()).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotas_are_met_exactly_and_shuffled() {
        let mut rng = Stream::new(1, 0, "test");
        let picks = quota(200, &[0.45, 0.275, 0.275], &mut rng);
        let count = |kind| picks.iter().filter(|pick| **pick == kind).count();
        assert_eq!([count(0), count(1), count(2)], [90, 55, 55]);
        assert!(picks.windows(2).filter(|w| w[0] != w[1]).count() > 60);
        // Shares need not add up to 1, nor the count divide.
        let picks = quota(7, &[2.0, 1.0], &mut rng);
        assert_eq!(picks.iter().filter(|pick| **pick == 0).count(), 5);
        assert!(quota(0, &[1.0], &mut rng).is_empty());
    }
}
