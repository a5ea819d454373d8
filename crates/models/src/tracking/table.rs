//! The track table: sightings of all cameras become tracks with one identity each.
//!
//! One table serves the three cameras. A frame is assigned as a whole, at the least total cost
//! (global nearest neighbour, [`crate::maths::assignment`]): the cost of a pair is the squared
//! distance in standard deviations plus the squared difference of log sizes, so that two targets
//! at different ranges stay apart while their sight lines cross, plus the log of the spread, so
//! that a vague track does not take the sighting of a sharp one. The deviations are those that the
//! track's own flutter has shown ([`crate::tracking::flutter`]).
//!
//! Detections below the detector's threshold go on with tracks that are established, and start none
//! (Y. Zhang et al., "ByteTrack", 2022).

use crate::ground::dsm::{Dsm, LineOfSight};
use crate::maths::assignment::{Pair, assign};
use crate::maths::kinematics::{los_to_az_el, wrap_pi};
use crate::optics::tier::{PerTier, Tier};
use crate::tracking::estimation::{Gating, LosFilter, LosFilterParams, LosState};
use crate::tracking::evidence::{Evidence, EvidenceParams, logit, named_share, probability};
use crate::tracking::flutter::{Flutter, Place};
use crate::tracking::ranging::Ranging;
use crate::tracking::recognition::{Recognition, TrackClass};
use crate::tracking::scenery::Scenery;
use glam::{DVec2, DVec3};
use nalgebra::{Matrix2, Vector2};
use std::ops::Range;

/// A detection as a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Azimuth and elevation [rad].
    pub az_el_rad: DVec2,
    /// Standard deviation on the sky [rad].
    pub sigma_rad: f64,
    /// Larger side of the box [rad].
    pub size_rad: f64,
    /// Confidence of the detector.
    pub score: f64,
    /// Index of its class among the detector's.
    pub label: u32,
    /// Whether its score falls short of the detector's threshold.
    pub weak: bool,
}

/// A direction in which a track was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighted {
    /// When [s].
    pub t_s: f64,
    /// Azimuth and elevation [rad].
    pub az_el_rad: DVec2,
    /// Standard deviation on the sky, its flutter counted [rad].
    pub sigma_rad: f64,
}

/// An echo of the range finder from a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lased {
    /// When [s].
    pub t_s: f64,
    /// The range [m].
    pub range_m: f64,
    /// Its standard deviation [m].
    pub sigma_m: f64,
}

/// What one frame of a camera saw.
pub struct CameraLook<'a> {
    /// What the camera is for.
    pub tier: Tier,
    /// Time of the exposure [s].
    pub t_s: f64,
    /// Angle of a pixel [rad].
    pub ifov_rad: f64,
    /// How what it shows is read.
    pub reads: &'a EvidenceParams,
    /// The detections.
    pub sightings: &'a [Sighting],
    /// Whether a direction (azimuth, elevation) lay in the pixels that were read out.
    pub in_view: &'a dyn Fn(DVec2) -> bool,
    /// Whether sightings that fit no track start new ones.
    pub start_tracks: bool,
}

/// A stretch of time in which the city hides a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Occlusion {
    /// When it goes behind something [s].
    pub enter_s: f64,
    /// When it comes out again [s]; `None` if that lies beyond the prediction.
    pub exit_s: Option<f64>,
    /// Where it comes out, azimuth and elevation [rad]; the end of the prediction if it does not.
    pub exit_az_el_rad: DVec2,
}

impl Occlusion {
    /// Whether the track is hidden at `t_s`.
    pub fn hides(&self, t_s: f64) -> bool {
        t_s >= self.enter_s && self.exit_s.is_none_or(|exit_s| t_s < exit_s)
    }

    /// Whether it is hidden at `t_s` even if the prediction errs by a fair margin at both ends.
    fn surely_hides(&self, t_s: f64) -> bool {
        const MARGIN_S: f64 = 0.2;
        // Behind the building the prediction drifts, since nothing is seen.
        const DRIFT: f64 = 0.15;
        let early_s = MARGIN_S + DRIFT * (t_s - self.enter_s);
        self.hides(t_s - MARGIN_S) && self.hides(t_s + early_s)
    }
}

/// One object that is followed.
#[derive(Clone, Debug)]
pub struct Track {
    /// Identity; never used again.
    pub id: u32,
    /// Estimate of its line of sight.
    pub filter: LosFilter,
    /// Estimate of its range.
    pub range: Ranging,
    /// Where it was last seen.
    pub sighted: Sighted,
    /// Its last echo.
    pub lased: Option<Lased>,
    /// Frames of each camera that saw it.
    pub hits: PerTier<u32>,
    /// Frames of each camera that should have seen it, from the first on that did.
    looks: PerTier<u32>,
    /// Frames in a row that should have seen it and did not, of cameras that have seen it before.
    pub misses: u32,
    /// Time of the first exposure that saw it [s].
    pub started_s: f64,
    /// Time of the last exposure of each camera that saw it [s].
    pub last_hit_s: PerTier<Option<f64>>,
    /// Larger side of its box [rad], smoothed.
    pub size_rad: f64,
    /// Mean score of its detections, of the last twenty or so.
    pub score: f64,
    /// Scores of its detections summed by class, the older ones fading.
    votes: Vec<f64>,
    /// What speaks for its being a UAV.
    pub evidence: Evidence,
    /// How much its box flutters in each camera.
    flutter: PerTier<Flutter>,
    /// What it has shown of its flight.
    pub conduct: Conduct,
    /// Pulses of the range finder in a row without an echo where its range is expected.
    unanswered: u32,
    /// Pulses in a row that something nearer answered first, and how far that was the last time [m].
    nearer: (u32, f64),
    /// Whether a radar has told its range.
    ranged_by_radar: bool,
    /// It is no target until then [s]: it has fallen, or no camera could confirm it.
    pub barred_until_s: f64,
    /// The next time that the city hides it, as far as predicted.
    pub occlusion: Option<Occlusion>,
    /// What it was last found to be, since nothing passed it.
    pub recognition: Option<Recognition>,
    /// When something else that flies last passed before or behind it [s], if it had been recognised by then.
    pub passed_s: Option<f64>,
}

/// How a track behaves, judged over time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conduct {
    /// Time for which it has been seen to move, less that for which it stood still [s].
    pub moving_s: f64,
    /// Time for which it has stood still [s].
    pub still_s: f64,
    /// It has flown: scenery does not.
    pub flown: bool,
    /// It began where scenery is known to be.
    pub in_scenery: bool,
    /// Whether the sky is clear behind it and some way below it.
    pub in_sky: bool,
    /// What those say of it that fly along with it, as log-odds: 0, or less.
    pub company: f64,
}

impl Conduct {
    /// Whether it is scenery for all that is known.
    pub fn is_scenery(&self) -> bool {
        self.in_scenery && !self.flown
    }
}

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

    /// Whether it has been dealt with and falls.
    pub fn fallen(&self) -> bool {
        self.barred_until_s == f64::INFINITY
    }

    /// Whether it is left alone at `t_s` [s].
    pub fn is_barred(&self, t_s: f64) -> bool {
        t_s < self.barred_until_s
    }

    /// Share of the frames that show it: of late by all cameras, or by the one that sees it best, since that saw it first. A
    /// wide camera in which it is too small says nothing against what a finer one sees.
    pub fn seen_share(&self) -> f64 {
        let by_one = |tier: Tier| {
            let [hits, looks] = [self.hits[tier], self.looks[tier]].map(f64::from);
            (self.hits[tier] >= JUDGED_HITS).then_some(hits / looks)
        };
        let shares = Tier::ALL.into_iter().filter_map(by_one);
        shares.fold(self.filter.quality(), f64::max)
    }

    /// Hits of all cameras.
    pub fn total_hits(&self) -> u32 {
        self.hits.each().iter().sum()
    }

    /// Index of the class that its detections name most, among the detector's.
    pub fn label(&self) -> u32 {
        let best = |best: usize, class: usize| {
            if self.votes[class] > self.votes[best] {
                class
            } else {
                best
            }
        };
        (0..self.votes.len()).fold(0, best) as u32
    }

    /// Time of the newest exposure that saw it [s].
    pub fn seen_s(&self) -> f64 {
        self.last_hit_s
            .each()
            .iter()
            .flatten()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max)
    }

    /// Whether the city is expected to hide it at `t_s`.
    pub fn hidden(&self, t_s: f64) -> bool {
        self.occlusion.is_some_and(|occlusion| occlusion.hides(t_s))
    }

    /// Rates on the sky, cross-elevation and elevation [rad/s], and their standard deviations.
    pub fn rates(&self, t_s: f64) -> (DVec2, DVec2) {
        let los = self.filter.predicted(t_s);
        let cos_el = los.el_rad.cos();
        let rate = DVec2::new(los.az_rate_radps * cos_el, los.el_rate_radps);
        let sigma = DVec2::new(
            los.covariance[0][(1, 1)].sqrt() * cos_el,
            los.covariance[1][(1, 1)].sqrt(),
        );
        (rate, sigma)
    }

    /// Rate on the sky [rad/s] and how many standard deviations it differs from zero.
    pub fn motion(&self, t_s: f64) -> (f64, f64) {
        let (rate, sigma) = self.rates(t_s);
        (rate.length(), (rate / sigma).length())
    }

    /// The range finder's last echo from it, if that still says how far it is.
    pub fn echo(&self, t_s: f64) -> Option<Lased> {
        self.lased.filter(|lased| t_s - lased.t_s < ECHO_S)
    }

    /// Its size [m]: the larger side of its box at the range of that echo.
    pub fn measured_span_m(&self, t_s: f64) -> Option<f64> {
        self.echo(t_s).map(|lased| self.size_rad * lased.range_m)
    }

    /// Estimated position [m] and velocity [m/s] at `t_s`, seen from `r_station_enu_m`.
    pub fn position_enu(&self, r_station_enu_m: DVec3, t_s: f64) -> Option<(DVec3, DVec3)> {
        let (d_enu, d_dot_enu) = self.filter.predicted(t_s).direction_enu();
        let (range_m, _) = self.range.range_m(t_s)?;
        let closing_mps = self.range.closing_mps(t_s)?;
        Some((
            r_station_enu_m + range_m * d_enu,
            range_m * d_dot_enu - closing_mps * d_enu,
        ))
    }

    /// Takes in a measured range [m] with its standard deviation [m]; the manoeuvres that the
    /// filter expects on the sky follow from it.
    pub fn ranged(&mut self, range_m: f64, sigma_m: f64, t_s: f64) {
        if !self
            .range
            .gate_m(t_s)
            .is_none_or(|gate| gate.contains(&range_m))
        {
            self.range.restart();
        }
        self.unanswered = 0;
        self.range.on_laser(range_m, sigma_m, t_s);
        if let Some((range_m, _)) = self.range.range_m(t_s) {
            self.filter.set_range_m(range_m);
        }
    }

    /// Takes in the range [m] that a radar tells, with its standard deviation [m].
    pub fn ranged_by_radar(&mut self, range_m: f64, sigma_m: f64, t_s: f64) {
        self.ranged_by_radar = true;
        self.ranged(range_m, sigma_m, t_s);
    }

    /// The ranges [m] at which an echo may be the target's at `t_s` [s]; all of them after several pulses
    /// without one, or that something nearer kept answering first, since the estimate may be wrong: it was another's
    /// echo, or no target is so large.
    pub fn range_gate(&self, t_s: f64) -> Range<f64> {
        const UNANSWERED: u32 = 4;
        const NEARER: u32 = 5;
        if self.unanswered >= UNANSWERED || self.nearer.0 >= NEARER {
            return 0.0..f64::INFINITY;
        }
        self.range.gate_m(t_s).unwrap_or(0.0..f64::INFINITY)
    }

    /// Notes the first thing that a pulse met, in the gate or not [m]: the first pulse of all may have passed the target by
    /// and met the hill behind it. Where a radar has told the range, what is nearer is another thing.
    pub fn met_first(&mut self, first_m: Option<f64>, t_s: f64) {
        if self.ranged_by_radar {
            return;
        }
        // What keeps its distance so well from pulse to pulse is one thing [m].
        const SAME_M: f64 = 10.0;
        let gate = self.range.gate_m(t_s);
        let (pulses, before_m) = self.nearer;
        self.nearer = match first_m.filter(|m| gate.is_some_and(|gate| *m < gate.start)) {
            Some(m) if pulses > 0 && (m - before_m).abs() < SAME_M => (pulses + 1, m),
            Some(m) => (1, m),
            None => (0, 0.0),
        };
    }

    /// A pulse had no echo within the gate.
    pub fn unanswered(&mut self) {
        self.unanswered += 1;
    }

    /// Foresees when the city will next hide this track from `r_station_enu_m`, up to `horizon_s`
    /// after `t_s`. `None` if it stays in sight, or if its range is known too badly to tell.
    ///
    /// The line of sight is sampled every 0.1 s and the edges are bisected to 1 ms; what hides for
    /// less than the sampling is not seen.
    pub fn foresee_occlusion(
        &self,
        dsm: &Dsm,
        r_station_enu_m: DVec3,
        t_s: f64,
        horizon_s: f64,
    ) -> Option<Occlusion> {
        const STEP_S: f64 = 0.1;
        const LARGEST_SPREAD: f64 = 0.1; // of the range
        let (range_m, sigma_m) = self.range.range_m(t_s)?;
        if sigma_m > LARGEST_SPREAD * range_m {
            return None;
        }
        // Over seconds a straight flight is a better guess than constant rates of the angles.
        let (r_enu_m, v_enu_mps) = self.position_enu(r_station_enu_m, t_s)?;
        let ahead = |at_s: f64| r_enu_m + v_enu_mps * (at_s - t_s);
        let blocked =
            |at_s: f64| dsm.line_of_sight(r_station_enu_m, ahead(at_s)) != LineOfSight::Clear;
        let az_el_rad = |at_s: f64| los_to_az_el(ahead(at_s) - r_station_enu_m);
        // Between `before` (not yet `to`) and `after` (already `to`).
        let edge = |mut before: f64, mut after: f64, to: bool| {
            while after - before > 1e-3 {
                let middle = 0.5 * (before + after);
                if blocked(middle) == to {
                    after = middle;
                } else {
                    before = middle;
                }
            }
            after
        };
        let steps = (horizon_s / STEP_S).ceil() as usize;
        let times = (0..=steps).map(|i| t_s + STEP_S * i as f64);
        let mut enter_s = None;
        for at in times {
            match (enter_s, blocked(at)) {
                (None, true) if at == t_s => enter_s = Some(t_s),
                (None, true) => enter_s = Some(edge(at - STEP_S, at, true)),
                (Some(enter_s), false) => {
                    let exit_s = edge(at - STEP_S, at, false);
                    return Some(Occlusion {
                        enter_s,
                        exit_s: Some(exit_s),
                        exit_az_el_rad: az_el_rad(exit_s),
                    });
                }
                _ => {}
            }
        }
        enter_s.map(|enter_s| Occlusion {
            enter_s,
            exit_s: None,
            exit_az_el_rad: az_el_rad(t_s + horizon_s),
        })
    }
}

/// Settings of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableParams {
    /// Filter of every track.
    pub filter: LosFilterParams,
    /// A sighting belongs to no track that is further away than this many standard deviations.
    pub gate_sigmas: f64,
    /// Standard deviation of the logarithm of a box's size about the track's.
    pub size_log_sigma: f64,
    /// A young track goes after more misses in a row than it has hits, in cameras that have seen it; this is the longest time
    /// without a hit for any that is not hidden by the city [s].
    pub max_coast_s: f64,
    /// Longest time without a hit behind a building [s].
    pub max_hidden_s: f64,
    /// Tracks kept; the ones with the fewest hits go first.
    pub max_tracks: usize,
    /// Span that objects are assumed to have until their range is measured [m].
    pub span_m: f64,
    /// Standard deviation of that span, over the span.
    pub span_sigma_rel: f64,
}

impl Default for TableParams {
    fn default() -> Self {
        Self {
            filter: LosFilterParams::default(),
            gate_sigmas: 4.0,
            size_log_sigma: 0.3,
            max_coast_s: 3.0,   // [s]
            max_hidden_s: 12.0, // [s]
            max_tracks: 128,
            // The catalogue's UAVs span 0.2 m to 1.7 m, most of them near 0.4 m.
            span_m: 0.45, // [m]
            span_sigma_rel: 0.5,
        }
    }
}

/// A track that turned out to continue an older one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JoinedTrack {
    /// Identity that ended.
    pub young: u32,
    /// Identity that goes on.
    pub old: u32,
}

/// All tracks, oldest first.
#[derive(Clone, Debug, Default)]
pub struct TrackTable {
    /// Settings of gates, memory and size.
    pub params: TableParams,
    /// The tracks, in the order they were started.
    pub tracks: Vec<Track>,
    /// Identities that the last frame ended.
    pub joined: Vec<JoinedTrack>,
    /// Identities of which the last frame may show either of two: they passed each other.
    pub passed: Vec<u32>,
    /// Where scenery has been seen.
    pub scenery: Scenery,
    next_id: u32,
}

/// Great-circle distance of two nearby directions [rad].
pub fn separation_rad(a: DVec2, b: DVec2) -> f64 {
    let d = wrap_pi(a.x - b.x) * (0.5 * (a.y + b.y)).cos();
    d.hypot(a.y - b.y)
}

/// Hits that make a track worth judging: a false alarm seldom comes back.
pub const JUDGED_HITS: u32 = 3;
/// Hits from which on a track is established: a young one goes after more misses in a row than hits.
const ESTABLISHED_HITS: u32 = 30;
/// An echo of the range finder says for so long how far its track is [s].
const ECHO_S: f64 = 1.0;
/// Manned aircraft are longer than this [m] from any side, a small helicopter's cabin from ahead included; a box shows but so small
/// a part of one this often, as against what is so small.
const LEAST_AIRCRAFT_M: f64 = 2.0;
const PART_OF_AIRCRAFT: f64 = 0.05;
/// What a recogniser's word counts on what is too small to be named.
const OF_THE_UNNAMED: f64 = 0.3;
/// Hits from which on a weak detection may go on with a track.
const CONFIRMED_HITS: u32 = 6;
/// Size at which a camera that has not yet confirmed a track is taken to see it, over that in its best view.
const UNCONFIRMED_SHARE: f64 = 0.5;
/// Largest box of which weak detections start a track [px].
const WEAK_START_PX: f64 = 6.0;
/// Extra cost of a pair with a weak detection: a strong one within 3σ is preferred.
const WEAK_COST: f64 = 9.0;
/// Share of the newest sighting in a track's smoothed size, and the least in its score and class.
const SMOOTHING: f64 = 0.2;
/// Most by which one sighting counts as larger or smaller than the track, in the logarithm: a box that
/// clings to another part for a frame does not change the size.
const MOST_GROWTH: f64 = 0.5;
const LEAST_SCORE_SHARE: f64 = 0.05;
/// Squared distance up to which a sighting is offered to a track, over the gate's.
const OFFERED: f64 = 4.0;
/// Two tracks pass each other that touch, and at their rates did not so long ago [s]: parts of one object keep together.
const APART_S: f64 = 0.5;
/// Longest time without a hit of a track that passes another [s].
const PASSING_S: f64 = 0.3;

impl TrackTable {
    /// The track of an identity.
    pub fn get(&self, id: u32) -> Option<&Track> {
        self.tracks.iter().find(|track| track.id == id)
    }

    /// The track of an identity, to be changed.
    pub fn get_mut(&mut self, id: u32) -> Option<&mut Track> {
        self.tracks.iter_mut().find(|track| track.id == id)
    }

    /// Takes a frame in, at the least total cost; what is left over starts a track or counts as a
    /// miss. Returns for each sighting the track it went to.
    pub fn update(&mut self, look: &CameraLook) -> Vec<Option<u32>> {
        let mut assigned = vec![None; look.sightings.len()];
        let predicted: Vec<LosState> = self
            .tracks
            .iter()
            .map(|track| track.filter.predicted(look.t_s))
            .collect();
        self.note_passes(&predicted, look.t_s);
        let pairs = self.pairs(look, &predicted);
        let chosen = assign(self.tracks.len(), look.sightings.len(), &pairs);
        for (row, column) in chosen.into_iter().enumerate() {
            let track = &mut self.tracks[row];
            let hit = column.is_some_and(|column| {
                let gating = track.take(look, &look.sightings[column]);
                let refused = matches!(gating, Gating::Rejected { .. });
                if !refused {
                    assigned[column] = Some(track.id);
                }
                !refused
            });
            if !hit && !track.hidden(look.t_s) && (look.in_view)(predicted[row].az_el_rad()) {
                track.missed(look);
            }
        }
        self.forget_silent(look.t_s);
        if look.start_tracks {
            for (s, sighting) in look.sightings.iter().enumerate() {
                if assigned[s].is_none() && !sighting.weak && !self.covers(sighting, look.t_s) {
                    assigned[s] = self.start(look, sighting);
                }
            }
            self.forget_surplus();
        }
        self.stitch(look.t_s, &mut assigned);
        assigned
    }

    /// Notes which tracks of what flies pass each other. They may leave as each other: what they were found to be before says
    /// nothing about them any more.
    fn note_passes(&mut self, predicted: &[LosState], t_s: f64) {
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

    /// Whether a sighting lies on the picture of a track: the box of a part of it, or one that
    /// has strayed too far to be taken, is no other object.
    fn covers(&self, sighting: &Sighting, t_s: f64) -> bool {
        self.tracks.iter().any(|track| {
            let at = track.filter.predicted(t_s).az_el_rad();
            !track.hidden(t_s) && separation_rad(at, sighting.az_el_rad) < 0.5 * track.size_rad
        })
    }

    /// The pairs of tracks and sightings that may belong together, with their costs; `predicted`
    /// holds the tracks' lines of sight at the exposure.
    fn pairs(&self, look: &CameraLook, predicted: &[LosState]) -> Vec<Pair> {
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

    /// Drops young tracks that missed more than they hit, and all that have been silent too long.
    fn forget_silent(&mut self, t_s: f64) {
        let params = self.params;
        self.tracks.retain(|track| {
            let hits = track.total_hits();
            let silent_s = t_s - track.seen_s();
            let longest_s = if track.hidden(t_s) {
                params.max_hidden_s
            } else {
                // A track that was hidden is given the time from its coming out.
                let exit_s = track.occlusion.and_then(|occlusion| occlusion.exit_s);
                let hidden_s = exit_s.map_or(0.0, |exit_s| exit_s - track.seen_s());
                params.max_coast_s + hidden_s.clamp(0.0, params.max_hidden_s)
            };
            (track.misses <= hits || hits >= ESTABLISHED_HITS) && silent_s < longest_s
        });
    }

    /// Drops the tracks with the fewest hits beyond the number that is kept.
    fn forget_surplus(&mut self) {
        while self.tracks.len() > self.params.max_tracks {
            let Some(weakest) = (0..self.tracks.len())
                .min_by_key(|i| (self.tracks[*i].total_hits(), self.tracks[*i].id))
            else {
                break;
            };
            self.tracks.remove(weakest);
        }
    }

    /// Joins to every established track that has gone silent the young track that continues it
    /// best: begun since, and near it in direction and rate. The older identity goes on.
    fn stitch(&mut self, t_s: f64, assigned: &mut [Option<u32>]) {
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

    /// Gives a sighting to a track at any distance: the paper's rule has no gate.
    /// One that does not fit restarts the track's estimate, under the same identity.
    pub fn force(&mut self, id: u32, look: &CameraLook, sighting: Option<&Sighting>) {
        let filter = self.params.filter;
        self.joined.clear();
        self.passed.clear();
        let Some(track) = self.get_mut(id) else {
            return;
        };
        match sighting {
            None => track.missed(look),
            Some(sighting) if matches!(track.take(look, sighting), Gating::Rejected { .. }) => {
                let (at, sigma) = (sighting.az_el_rad, sighting.sigma_rad);
                if let Ok(fresh) = LosFilter::start(filter, at, sigma, look.t_s) {
                    track.filter = fresh;
                    track.record(look, sighting);
                }
            }
            Some(_) => {}
        }
    }

    fn start(&mut self, look: &CameraLook, sighting: &Sighting) -> Option<u32> {
        let Sighting {
            az_el_rad,
            sigma_rad,
            size_rad,
            score,
            ..
        } = *sighting;
        let filter = LosFilter::start(self.params.filter, az_el_rad, sigma_rad, look.t_s).ok()?;
        let range = Ranging::new(self.params.span_m, self.params.span_sigma_rel).ok()?;
        let id = self.next_id;
        self.next_id += 1;
        let mut track = Track {
            id,
            filter,
            range,
            sighted: Sighted {
                t_s: look.t_s,
                az_el_rad,
                sigma_rad,
            },
            lased: None,
            hits: PerTier::default(),
            looks: PerTier::default(),
            misses: 0,
            started_s: look.t_s,
            last_hit_s: PerTier::default(),
            size_rad,
            score,
            votes: Vec::new(),
            evidence: Evidence::default(),
            flutter: PerTier::default(),
            conduct: Conduct {
                in_scenery: self.scenery.holds(az_el_rad, look.t_s),
                ..Conduct::default()
            },
            unanswered: 0,
            nearer: (0, 0.0),
            ranged_by_radar: false,
            barred_until_s: f64::NEG_INFINITY,
            occlusion: None,
            recognition: None,
            passed_s: None,
        };
        track.record(look, sighting);
        self.tracks.push(track);
        Some(id)
    }
}

impl Track {
    /// Offers a sighting to the filter. One that is too old for the filter still counts as a hit.
    fn take(&mut self, look: &CameraLook, sighting: &Sighting) -> Gating {
        // What was offered shows its flutter whether it is accepted or not: so the filter learns that it
        // must not be as sure of the next.
        let flutter = &mut self.flutter[look.tier];
        flutter.on_sighting(Place {
            t_s: look.t_s,
            az_el_rad: sighting.az_el_rad,
            sigma_rad: sighting.sigma_rad,
            size_rad: sighting.size_rad,
        });
        let sigma_rad = flutter.place_ratio() * sighting.sigma_rad;
        let gating = self.filter.update(sighting.az_el_rad, sigma_rad, look.t_s);
        if !matches!(gating, Gating::Rejected { .. }) {
            self.record(look, sighting);
        }
        gating
    }

    /// A frame that should have shown it did not.
    fn missed(&mut self, look: &CameraLook) {
        // Three cameras read 210 frames a second of what the mount turns to, and the two finer ones may not have it yet.
        if self.hits[look.tier] > 0 {
            self.misses += 1;
            self.looks[look.tier] += 1;
        }
        self.filter.miss(look.t_s);
        let mut size_px = self.size_rad / look.ifov_rad;
        if self.hits[look.tier] < CONFIRMED_HITS {
            // A camera that has never shown it may be turned past it: its view is not yet the best one.
            size_px = size_px.min(UNCONFIRMED_SHARE * self.evidence.best_px());
        }
        let says = (look.reads.of_miss(), None);
        (self.evidence).on_look(look.reads, says, size_px, look.t_s);
    }

    fn record(&mut self, look: &CameraLook, sighting: &Sighting) {
        self.hits[look.tier] += 1;
        self.looks[look.tier] += 1;
        let last_s = &mut self.last_hit_s[look.tier];
        *last_s = Some(last_s.map_or(look.t_s, |last_s| last_s.max(look.t_s)));
        self.misses = 0;
        let growth = (sighting.size_rad / self.size_rad).ln();
        self.size_rad *= (SMOOTHING * growth.clamp(-MOST_GROWTH, MOST_GROWTH)).exp();
        let flutter = self.flutter[look.tier];
        if look.t_s >= self.sighted.t_s {
            self.sighted = Sighted {
                t_s: look.t_s,
                az_el_rad: sighting.az_el_rad,
                sigma_rad: flutter.place_ratio() * sighting.sigma_rad,
            };
        }
        let size_px = self.size_rad / look.ifov_rad;
        let lambda = look
            .reads
            .of_hit(sighting.score, sighting.label, size_px, flutter.ratio());
        let says = (lambda, Some(look.reads.names_none(sighting.label)));
        self.evidence.on_look(look.reads, says, size_px, look.t_s);
        // The mean of the first ones, so that a candidate is judged by several frames.
        let share = (1.0 / f64::from(self.total_hits())).max(LEAST_SCORE_SHARE);
        self.score += share * (sighting.score - self.score);
        for votes in &mut self.votes {
            *votes *= 1.0 - LEAST_SCORE_SHARE;
        }
        let class = sighting.label as usize;
        if self.votes.len() <= class {
            self.votes.resize(class + 1, 0.0);
        }
        self.votes[class] += sighting.score;
        // A box's side is good to about two standard deviations of its centre, or what its size flutters by.
        let sigma_rel = 2.0 * flutter.size_ratio().max(1.0) * sighting.sigma_rad
            / sighting.size_rad.max(sighting.sigma_rad);
        self.range.on_size(sighting.size_rad, sigma_rel, look.t_s);
    }
}

#[cfg(test)]
mod tests;
