//! Which station takes which target.
//!
//! A pair costs the logarithm of (time in which the target could be at the asset, over its probability of being a UAV)
//! times (time until the station would have engaged it): what is twice as urgent may take twice as long. Each station
//! takes one target and each target one station, at the least total cost ([`assign`]); the weapon–target assignment
//! of the literature (A. S. Manne, "A target-assignment problem", 1958) for effectors that take one target at a
//! time and are assigned anew many times a second.

use crate::engage::interlock::arc_distance_rad;
use crate::maths::assignment::{Pair, assign};
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How targets are assigned to stations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AllocationRule {
    /// The assignment of the least total cost.
    #[default]
    LeastCost,
    /// The cheapest pair, then the cheapest of what is left.
    Greedy,
    /// None: every station takes what is cheapest for itself, whatever the others do.
    None,
}

impl AllocationRule {
    /// Its name in scenarios.
    pub fn name(self) -> &'static str {
        match self {
            Self::LeastCost => "least_cost",
            Self::Greedy => "greedy",
            Self::None => "none",
        }
    }
}

/// From a mount at rest on a target to the first shot [s]: confirmation by the cameras, lock, echo; as runs show.
pub const LOCKED_S: f64 = 1.0;

/// What a station offers for a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offer {
    /// Time until it would have engaged it [s]; infinite if it cannot.
    pub engaged_s: f64,
    /// Whether nothing is foreseen to come between.
    pub steady: bool,
}

/// A station's offer for a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bid {
    /// Index of the station.
    pub station: usize,
    /// Index of the target.
    pub target: usize,
    /// The offer.
    pub offer: Offer,
}

/// The target of each of `stations` stations. `expected_s` is for each target the time in which it could be at
/// the asset over its probability of being a UAV [s]; another target must be cheaper than a station's `present` one
/// by the factor `hysteresis`, unless something is about to come between the station and that.
pub fn allocate(
    rule: AllocationRule,
    stations: usize,
    expected_s: &[f64],
    bids: &[Bid],
    present: &[Option<usize>],
    hysteresis: f64,
) -> Vec<Option<usize>> {
    /// Any pair is better than two that stay alone.
    const ALONE: f64 = 1e3;
    let pairs: Vec<Pair> = (bids.iter())
        .filter(|bid| bid.offer.engaged_s.is_finite())
        .map(|bid| {
            let held = present.get(bid.station).copied().flatten() == Some(bid.target);
            let kept = if held && bid.offer.steady {
                hysteresis.ln()
            } else {
                0.0
            };
            let urgency = expected_s[bid.target].clamp(1e-3, 1e6).ln();
            Pair {
                row: bid.station,
                column: bid.target,
                cost: urgency + bid.offer.engaged_s.max(1e-3).ln() - kept - ALONE,
            }
        })
        .collect();
    match rule {
        AllocationRule::LeastCost => assign(stations, expected_s.len(), &pairs),
        AllocationRule::Greedy => greedy(stations, pairs),
        AllocationRule::None => alone(stations, &pairs),
    }
}

/// As `allocate` answers to offers, but so that no station looks along another's beam, which scatters light, if that can
/// be had at a bearable price: where a beam would pass a line of sight as closely as a precise camera's field, the
/// offers of that station for that target count twice as long, and `allocate` is asked again, twice at most.
/// Stations and targets stand there [m].
pub fn allocate_apart(
    stations_enu_m: &[DVec3],
    targets_enu_m: &[DVec3],
    bids: &[Bid],
    allocate: impl Fn(&[Bid]) -> Vec<Option<usize>>,
) -> Vec<Option<usize>> {
    const DEARER: f64 = 2.0;
    const ROUNDS: usize = 2;
    let first = allocate(bids);
    let (mut assigned, mut offers) = (first.clone(), bids.to_vec());
    for _ in 0..ROUNDS {
        let dazzled = dazzled(stations_enu_m, targets_enu_m, &assigned);
        if dazzled.is_empty() {
            return assigned;
        }
        for bid in &mut offers {
            if dazzled.contains(&(bid.station, bid.target)) {
                bid.offer.engaged_s *= DEARER;
            }
        }
        assigned = allocate(&offers);
    }
    // Better a target in another's light than a worse choice for nothing.
    if dazzled(stations_enu_m, targets_enu_m, &assigned).is_empty() {
        assigned
    } else {
        first
    }
}

/// The pairs of station and target whose line of sight another pair's beam passes closely.
fn dazzled(
    stations_enu_m: &[DVec3],
    targets_enu_m: &[DVec3],
    assigned: &[Option<usize>],
) -> Vec<(usize, usize)> {
    /// The field of a usual precise camera [rad].
    const FIELD_RAD: f64 = 0.017;
    let pairs = || {
        let pairs = assigned.iter().enumerate();
        pairs.filter_map(|(station, target)| Some((station, (*target)?)))
    };
    let meets = |(station, target): &(usize, usize)| {
        let from_enu_m = stations_enu_m[*station];
        let direction = (targets_enu_m[*target] - from_enu_m).normalize_or_zero();
        let mut others = pairs().filter(|(other, at)| other != station && at != target);
        others.any(|(other, at)| {
            let beam_enu_m = [stations_enu_m[other], targets_enu_m[at]];
            arc_distance_rad(from_enu_m, direction, beam_enu_m) < FIELD_RAD
        })
    };
    pairs().filter(meets).collect()
}

/// The target that each station without one of its own watches, in case the station that engages it loses it: idle
/// stations share the targets out among themselves, as if nobody had them.
pub fn watch(
    assigned: &[Option<usize>],
    expected_s: &[f64],
    bids: &[Bid],
    present: &[Option<usize>],
    hysteresis: f64,
) -> Vec<Option<usize>> {
    let idle: Vec<Bid> = (bids.iter())
        .filter(|bid| assigned[bid.station].is_none())
        .copied()
        .collect();
    let (rule, stations) = (AllocationRule::LeastCost, assigned.len());
    allocate(rule, stations, expected_s, &idle, present, hysteresis)
}

/// Each station's cheapest pair.
fn alone(stations: usize, pairs: &[Pair]) -> Vec<Option<usize>> {
    let cheapest = |station: usize| {
        let own = pairs.iter().filter(|pair| pair.row == station);
        own.min_by(|a, b| a.cost.total_cmp(&b.cost).then(a.column.cmp(&b.column)))
    };
    (0..stations)
        .map(|station| cheapest(station).map(|pair| pair.column))
        .collect()
}

/// The cheapest pair first.
fn greedy(stations: usize, mut pairs: Vec<Pair>) -> Vec<Option<usize>> {
    pairs.sort_by(|a, b| {
        let earlier = (a.row, a.column).cmp(&(b.row, b.column));
        a.cost.total_cmp(&b.cost).then(earlier)
    });
    let mut chosen = vec![None; stations];
    for pair in pairs {
        if chosen[pair.row].is_none() && !chosen.contains(&Some(pair.column)) {
            chosen[pair.row] = Some(pair.column);
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bids(times_s: &[[f64; 2]]) -> Vec<Bid> {
        let of = |(station, times_s): (usize, &[f64; 2])| {
            let times_s = times_s.iter().enumerate();
            let bid = move |(target, engaged_s): (usize, &f64)| Bid {
                station,
                target,
                offer: Offer {
                    engaged_s: *engaged_s,
                    steady: true,
                },
            };
            times_s.map(bid).collect::<Vec<_>>()
        };
        times_s.iter().enumerate().flat_map(of).collect()
    }

    fn least(
        expected_s: &[f64],
        times_s: &[[f64; 2]],
        present: &[Option<usize>],
    ) -> Vec<Option<usize>> {
        let rule = AllocationRule::LeastCost;
        allocate(
            rule,
            times_s.len(),
            expected_s,
            &bids(times_s),
            present,
            1.5,
        )
    }

    /// Two stations and two targets, whose beams cross where they are the cheapest.
    #[test]
    fn beams_that_cross_are_kept_apart_at_a_bearable_price() {
        let stations_m = [DVec3::new(-150.0, 0.0, 60.0), DVec3::new(150.0, 0.0, 60.0)];
        let targets = |height_m: f64| {
            [
                DVec3::new(-120.0, 700.0, 160.0),
                DVec3::new(120.0, 700.0, height_m),
            ]
        };
        let of = |height_m: f64, times_s: [[f64; 2]; 2]| {
            let bids = bids(&times_s);
            allocate_apart(&stations_m, &targets(height_m), &bids, |bids| {
                allocate(
                    AllocationRule::LeastCost,
                    2,
                    &[60.0; 2],
                    bids,
                    &[None; 2],
                    1.2,
                )
            })
        };
        let (crossed, straight) = ([Some(1), Some(0)], [Some(0), Some(1)]);
        let dear = [[2.0, 1.0], [1.0, 2.0]];
        // In one plane each beam passes before the other's target; of different heights they do not meet.
        assert_eq!(of(160.0, dear), straight);
        assert_eq!(of(240.0, dear), crossed);
        // Light is borne where all else takes too long, or is impossible.
        assert_eq!(of(160.0, [[20.0, 1.0], [1.0, 20.0]]), crossed);
        assert_eq!(of(160.0, [[f64::INFINITY, 1.0], [1.0, 2.0]]), crossed);
    }

    #[test]
    fn the_least_total_is_not_the_cheapest_pair_first() {
        // Greedy takes 3·10 and leaves 60·10; together 4·10 and 9·10 are less: 360 against 1800.
        let times_s = [[3.0, 4.0], [9.0, 60.0]];
        assert_eq!(least(&[10.0; 2], &times_s, &[]), [Some(1), Some(0)]);
        let greedy = allocate(
            AllocationRule::Greedy,
            2,
            &[10.0; 2],
            &bids(&times_s),
            &[],
            1.5,
        );
        assert_eq!(greedy, [Some(0), Some(1)]);
        let none = allocate(
            AllocationRule::None,
            2,
            &[10.0; 2],
            &bids(&times_s),
            &[],
            1.5,
        );
        assert_eq!(none, [Some(0), Some(0)]);
    }

    #[test]
    fn idle_stations_watch_what_they_would_take() {
        // One target, the second station is the quicker.
        let times_s = [[5.0], [3.0], [4.0]];
        let of = |(station, [engaged_s]): (usize, [f64; 1])| Bid {
            station,
            target: 0,
            offer: Offer {
                engaged_s,
                steady: true,
            },
        };
        let bids: Vec<Bid> = times_s.into_iter().enumerate().map(of).collect();
        let assigned = allocate(AllocationRule::LeastCost, 3, &[9.0], &bids, &[], 1.5);
        assert_eq!(assigned, [None, Some(0), None]);
        let watches = |present: &[Option<usize>]| watch(&assigned, &[9.0], &bids, present, 1.5);
        assert_eq!(watches(&[]), [None, None, Some(0)]);
        // Not left for one that is quicker by a fifth.
        assert_eq!(watches(&[Some(0), None, None]), [Some(0), None, None]);
    }

    #[test]
    fn the_urgent_goes_first_and_a_target_is_kept_for_a_little_more() {
        assert_eq!(least(&[10.0, 30.0], &[[4.0, 2.0]], &[]), [Some(0)]);
        assert_eq!(least(&[10.0, 15.0], &[[4.0, 2.0]], &[]), [Some(1)]);
        // 40 against 30: not cheaper by half.
        assert_eq!(least(&[10.0, 15.0], &[[4.0, 2.0]], &[Some(0)]), [Some(0)]);
        assert_eq!(least(&[10.0, 11.0], &[[4.0, 2.0]], &[Some(0)]), [Some(1)]);
        // What is about to be hidden is not kept for less.
        let mut hidden = bids(&[[4.0, 2.0]]);
        hidden[0].offer.steady = false;
        let rule = AllocationRule::LeastCost;
        assert_eq!(
            allocate(rule, 1, &[10.0, 15.0], &hidden, &[Some(0)], 1.5),
            [Some(1)]
        );
        // What it cannot see it does not take.
        assert_eq!(
            least(&[10.0, 99.0], &[[f64::INFINITY, 2.0]], &[]),
            [Some(1)]
        );
    }
}
