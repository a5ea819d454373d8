//! Identities that come together: tracks that pass each other, and young ones that continue a silent one.

use super::track::{CONFIRMED_HITS, ESTABLISHED_HITS, Track};
use super::tracks::{JoinedTrack, TrackTable};
use crate::maths::kinematics::wrap_pi;
use crate::optics::tier::Tier;
use crate::tracking::estimation::LosState;
use nalgebra::{Matrix2, Vector2};

/// Two tracks pass each other that touch, and at their rates did not so long ago [s]: parts of one object keep together.
const APART_S: f64 = 0.5;
/// Longest time without a hit of a track that passes another [s].
const PASSING_S: f64 = 0.3;

impl TrackTable {
    /// Notes which tracks of what flies pass each other. They may leave as each other: what they were found to be before says
    /// nothing about them any more.
    pub(super) fn note_passes(&mut self, predicted: &[LosState], t_s: f64) {
        let flies = |track: &Track| {
            track.total_hits() >= CONFIRMED_HITS
                && t_s - track.seen_s() < PASSING_S
                // The rates of a younger one say nothing yet.
                && t_s - track.started_s > APART_S
                && (track.conduct.flown || track.conduct.in_sky)
        };
        let flying: Vec<usize> = (0..self.tracks.len())
            .filter(|i| flies(&self.tracks[*i]))
            .collect();
        let passes = |a: usize, b: usize| {
            let reach_rad = 0.5 * (self.tracks[a].size_rad + self.tracks[b].size_rad);
            let [(at_a, v_a), (at_b, v_b)] = [a, b].map(|i| predicted[i].direction_enu());
            (at_a - at_b).length() < reach_rad && (v_a - v_b).length() * APART_S > reach_rad
        };
        let passed = |a: &usize| flying.iter().any(|b| a != b && passes(*a, *b));
        let passed: Vec<usize> = flying.iter().copied().filter(passed).collect();
        self.passed.clear();
        for i in passed {
            let track = &mut self.tracks[i];
            if track.recognition.take().is_some() || track.passed_s.is_some() {
                track.passed_s = Some(t_s);
            }
            self.passed.push(track.id);
        }
    }

    /// Joins to every established track that has gone silent the young track that continues it
    /// best: begun since, and near it in direction and rate. The older identity goes on.
    pub(super) fn stitch(&mut self, t_s: f64, assigned: &mut [Option<u32>]) {
        self.joined.clear();
        let mut young = 0;
        while young < self.tracks.len() {
            match self.continued_by(young, t_s) {
                Some(old) => {
                    let fresh = self.tracks.remove(young);
                    // It began later, so it comes after the one it continues in the list.
                    let track = &mut self.tracks[old];
                    self.joined.push(JoinedTrack {
                        young: fresh.id,
                        old: track.id,
                    });
                    for id in assigned.iter_mut().filter(|id| **id == Some(fresh.id)) {
                        *id = Some(track.id);
                    }
                    track.filter = fresh.filter;
                    track.sighted = fresh.sighted;
                    track.misses = fresh.misses;
                    track.size_rad = fresh.size_rad;
                    track.score = fresh.score;
                    track.recognition = fresh.recognition.or(track.recognition);
                    track.passed_s = fresh.passed_s.or(track.passed_s);
                    track.evidence.join(&fresh.evidence);
                    track.flutter = fresh.flutter;
                    track.conduct.flown |= fresh.conduct.flown;
                    track.barred_until_s = track.barred_until_s.max(fresh.barred_until_s);
                    for tier in Tier::ALL {
                        track.hits[tier] += fresh.hits[tier];
                        track.looks[tier] += fresh.looks[tier];
                        let last_s = &mut track.last_hit_s[tier];
                        *last_s = fresh.last_hit_s[tier].or(*last_s);
                    }
                }
                None => young += 1,
            }
        }
    }

    /// The silent track that track `young` continues.
    fn continued_by(&self, young: usize, t_s: f64) -> Option<usize> {
        const SILENT_S: f64 = 0.2;
        const LEAST_HITS: u32 = 6;
        const YOUNG_S: f64 = 1.5;
        // Rms acceleration while nobody sees it [m/s²].
        const UNSEEN_MPS2: f64 = 2.0;
        // Chi-squared of four degrees of freedom, 99.9 %.
        const GATE: f64 = 18.5;
        let fresh = &self.tracks[young];
        if fresh.total_hits() < LEAST_HITS || t_s - fresh.started_s > YOUNG_S {
            return None;
        }
        // What stands before scenery does not continue what flew.
        let stands = !fresh.conduct.in_sky && fresh.conduct.moving_s <= 0.0;
        let b = fresh.filter.predicted(t_s);
        let mut best: Option<(f64, usize)> = None;
        for (old, track) in self.tracks[..young].iter().enumerate() {
            let seen_s = track.seen_s();
            if track.total_hits() < ESTABLISHED_HITS
                || t_s - seen_s < SILENT_S
                || fresh.started_s < seen_s
                || stands && track.conduct.flown
                // A track that appeared while the city hid the silent one is another object.
                || (track.occlusion)
                    .is_some_and(|occlusion| occlusion.surely_hides(fresh.started_s))
            {
                continue;
            }
            let a = track.filter.predicted(t_s);
            // Unseen manoeuvres come on top of the filter's own uncertainty.
            let unseen_s = fresh.started_s - seen_s;
            let range_m = track
                .range
                .range_m(t_s)
                .map_or(1_000.0, |(range_m, _)| range_m);
            let agility = UNSEEN_MPS2 / range_m * Vector2::new(0.5 * unseen_s * unseen_s, unseen_s);
            let agility = Matrix2::from_diagonal(&agility.component_mul(&agility));
            // An azimuth turns faster than the sky by 1/cos(el).
            let scales = [1.0 / a.el_rad.cos().max(0.05), 1.0];
            let differences = [
                [
                    wrap_pi(b.az_rad - a.az_rad),
                    b.az_rate_radps - a.az_rate_radps,
                ],
                [b.el_rad - a.el_rad, b.el_rate_radps - a.el_rate_radps],
            ];
            let distance2: f64 = (0..2)
                .map(|axis| {
                    let sum = a.covariance[axis] + b.covariance[axis];
                    let sum =
                        sum.fixed_view::<2, 2>(0, 0) + agility * (scales[axis] * scales[axis]);
                    let d = Vector2::from(differences[axis]);
                    sum.try_inverse()
                        .map_or(f64::INFINITY, |inverse| d.dot(&(inverse * d)))
                })
                .sum();
            let size = (fresh.size_rad / track.size_rad).ln() / self.params.size_log_sigma;
            let cost = distance2 + size * size;
            if cost < GATE && best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, old));
            }
        }
        best.map(|(_, old)| old)
    }
}
