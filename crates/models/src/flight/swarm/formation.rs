//! Formations: the places of a swarm's members about their middle.

use crate::maths::rng::Stream;
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How the members of a swarm stand to each other at the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Formation {
    /// Side by side.
    Line,
    /// A V, its point ahead.
    Wedge,
    /// Rows and columns.
    Grid,
    /// A circle.
    Ring,
    /// At random in a ball, no two nearer than half the spacing where there is room.
    #[default]
    Cloud,
    /// One behind the other.
    Stream,
}

impl Formation {
    /// The places of so many members (forward, left, up) [m], about their middle.
    pub fn slots_m(self, count: usize, spacing_m: f64, rng: &mut Stream) -> Vec<DVec3> {
        let side = (count as f64).sqrt().ceil().max(1.0) as usize;
        let mut slots: Vec<DVec3> = Vec::with_capacity(count);
        for index in 0..count {
            let n = index as f64;
            slots.push(match self {
                Self::Line => DVec3::Y * n,
                Self::Stream => DVec3::NEG_X * n,
                Self::Wedge => {
                    let (arm, left) = (index.div_ceil(2) as f64, index % 2 == 0);
                    DVec3::new(-arm, if left { arm } else { -arm }, 0.0)
                }
                Self::Grid => DVec3::new(-((index / side) as f64), (index % side) as f64, 0.0),
                Self::Ring => {
                    let angle = n / count as f64 * std::f64::consts::TAU;
                    // Neighbours on the circle are one spacing apart.
                    let radius = 0.5 / (std::f64::consts::PI / count.max(2) as f64).sin();
                    radius * DVec3::new(angle.cos(), angle.sin(), 0.0)
                }
                Self::Cloud => in_ball(&slots, count, rng),
            });
        }
        let middle = slots.iter().sum::<DVec3>() / count.max(1) as f64;
        slots
            .iter()
            .map(|slot| spacing_m * (slot - middle))
            .collect()
    }
}

/// A place in a ball that has room for `count` members one spacing apart, in spacings.
fn in_ball(taken: &[DVec3], count: usize, rng: &mut Stream) -> DVec3 {
    const TRIES: usize = 30;
    let radius = 0.7 * (count as f64).cbrt();
    let mut at = DVec3::ZERO;
    for _ in 0..TRIES {
        let direction = rng.normal3().normalize_or(DVec3::X);
        at = radius * rng.uniform().cbrt() * direction;
        if taken.iter().all(|other| other.distance(at) > 0.5) {
            break;
        }
    }
    at
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    const ALL: [Formation; 6] = [
        Formation::Line,
        Formation::Wedge,
        Formation::Grid,
        Formation::Ring,
        Formation::Cloud,
        Formation::Stream,
    ];

    pub(in crate::flight::swarm) fn nearest_m(places: &[DVec3]) -> f64 {
        let mut least = f64::INFINITY;
        for (index, a) in places.iter().enumerate() {
            for b in &places[index + 1..] {
                least = least.min(a.distance(*b));
            }
        }
        least
    }

    #[test]
    fn formations_have_their_spacing() {
        for formation in ALL {
            let mut rng = Stream::new(1, 0, "formation");
            let slots = formation.slots_m(40, 8.0, &mut rng);
            assert_eq!(slots.len(), 40);
            let middle = slots.iter().sum::<DVec3>() / 40.0;
            assert!(middle.length() < 1e-9, "{formation:?}");
            let least = if formation == Formation::Cloud {
                4.0
            } else {
                8.0
            };
            let nearest_m = nearest_m(&slots);
            assert!(nearest_m > least - 0.02, "{formation:?}: {nearest_m} m");
        }
        let one = Formation::Wedge.slots_m(1, 8.0, &mut Stream::new(1, 0, "formation"));
        assert_eq!(one, [DVec3::ZERO]);
    }
}
