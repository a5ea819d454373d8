//! Followers find their objects: they join one that they fit, or start one where they cross.

use super::fix::{Follower, Measured, Sensor};
use super::known::{Loose, Picture, ROUNDS};
use super::object::SharedObject;
use crate::maths::assignment::{Pair, assign};
use crate::tracking::cartesian::{CartesianTrack, FIRST_VELOCITY_SIGMA_MPS, crossing};
use glam::DVec3;
use nalgebra::Matrix3;
use std::collections::{BTreeMap, BTreeSet};

/// Squared distance below which it may be a fix of an object that it does not follow yet: 99.9 % of a direction's
/// two degrees of freedom; a position's third makes it 99.7 %.
const FITS: f64 = 13.8;
/// Time without a fix after which another of the same station may take a follower's place [s].
const REPLACED_S: f64 = 1.0;

impl Picture {
    /// Followers with news that fit an object; those that have done so for long enough join it.
    pub(super) fn join(&mut self, news: &[Follower]) -> BTreeSet<Follower> {
        let mut suited = BTreeSet::new();
        // The followers of one sensor see different things: they are assigned together.
        for own in news.chunk_by(|a, b| (a.station, a.sensor) == (b.station, b.sensor)) {
            let mut pairs = Vec::new();
            for (row, follower) in own.iter().enumerate() {
                let fix = &self.loose[follower].fix;
                for (column, object) in self.objects.iter().enumerate() {
                    let taken = object.followers.iter().any(|(other, followed)| {
                        (other.station, other.sensor) == (follower.station, follower.sensor)
                            && fix.t_s - followed.last_s < REPLACED_S
                    });
                    let cost = object.distance2(fix) - FITS;
                    // What is near one that falls may be its neighbour.
                    if !taken && !object.dealt_with && cost < 0.0 {
                        pairs.push(Pair { row, column, cost });
                    }
                }
            }
            let chosen = assign(own.len(), self.objects.len(), &pairs);
            for (follower, column) in own.iter().zip(chosen) {
                let Some(column) = column else { continue };
                suited.insert(*follower);
                let identity = self.objects[column].identity;
                if self.suits(*follower, identity) >= ROUNDS
                    && let Some(loose) = self.loose.remove(follower)
                {
                    self.objects[column]
                        .followers
                        .insert(*follower, loose.followed());
                }
            }
        }
        suited
    }

    /// For how many rounds in a row a loose follower has suited the same.
    fn suits(&mut self, follower: Follower, whom: Follower) -> u32 {
        let Some(loose) = self.loose.get_mut(&follower) else {
            return 0;
        };
        let rounds = match loose.suits {
            Some((before, rounds)) if before == whom => rounds + 1,
            _ => 1,
        };
        loose.suits = Some((whom, rounds));
        rounds
    }

    /// Loose followers that fit no object start some: alone where the range is known, otherwise two whose directions
    /// cross.
    pub(super) fn cross(&mut self, news: &[Follower]) {
        for follower in news {
            let loose = &self.loose[follower];
            let Some((r_enu_m, covariance)) = loose.position() else {
                continue;
            };
            // A track may be another's that will suit soon: only a radar is believed at once.
            if follower.sensor == Sensor::Radar || self.suits(*follower, *follower) >= ROUNDS {
                self.start(&[*follower], r_enu_m, &covariance);
            }
        }
        let left: Vec<Follower> = (news.iter().copied())
            .filter(|f| {
                self.loose
                    .get(f)
                    .is_some_and(|loose| loose.position().is_none())
            })
            .collect();
        let groups: Vec<&[Follower]> = left.chunk_by(|a, b| a.station == b.station).collect();
        for (i, first) in groups.iter().enumerate() {
            for second in &groups[i + 1..] {
                self.cross_two(first, second);
            }
        }
    }

    /// Starts objects where the directions of two stations' followers cross.
    fn cross_two(&mut self, first: &[Follower], second: &[Follower]) {
        let mut pairs = Vec::new();
        let mut places = BTreeMap::new();
        for (row, a) in first.iter().enumerate() {
            for (column, b) in second.iter().enumerate() {
                let (Some(a), Some(b)) = (self.loose.get(a), self.loose.get(b)) else {
                    continue;
                };
                let (Measured::Bearing(of_a), Measured::Bearing(of_b)) =
                    (a.fix.measured, b.fix.measured)
                else {
                    continue;
                };
                let moved_m = FIRST_VELOCITY_SIGMA_MPS[0] * (a.fix.t_s - b.fix.t_s).abs();
                if let Some(place) = crossing(&of_a, &of_b, moved_m) {
                    // Which of several crosses best is left to the rounds: the likelier are UAVs.
                    let cost = -1.0 - 1.0 / (1.0 + (-a.log_odds - b.log_odds).exp());
                    pairs.push(Pair { row, column, cost });
                    places.insert((row, column), place);
                }
            }
        }
        let chosen = assign(first.len(), second.len(), &pairs);
        for (row, column) in chosen.into_iter().enumerate() {
            let Some(column) = column else { continue };
            let (a, b) = (first[row], second[column]);
            let rounds = self.suits(a, b).min(self.suits(b, a));
            if rounds >= ROUNDS
                && let Some((r_enu_m, covariance)) = places.get(&(row, column))
            {
                self.start(&[a, b], *r_enu_m, covariance);
            }
        }
    }

    /// Starts an object of loose followers.
    fn start(&mut self, followers: &[Follower], r_enu_m: DVec3, covariance_m2: &Matrix3<f64>) {
        let loose: BTreeMap<Follower, Loose> = (followers.iter())
            .filter_map(|follower| self.loose.remove_entry(follower))
            .collect();
        let t_s = (loose.values()).fold(f64::NEG_INFINITY, |t_s, loose| t_s.max(loose.fix.t_s));
        let Some(identity) = loose.keys().next().copied() else {
            return;
        };
        self.objects.push(SharedObject {
            identity,
            track: CartesianTrack::start(t_s, r_enu_m, covariance_m2),
            followers: loose
                .iter()
                .map(|(f, loose)| (*f, loose.followed()))
                .collect(),
            dealt_with: false,
        });
    }
}
