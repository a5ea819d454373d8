//! One object that is followed: what is kept of it, and what that says of its flight and its sightings.

use super::sighting::Sighted;
use crate::optics::tier::{PerTier, Tier};
use crate::tracking::estimation::LosFilter;
use crate::tracking::evidence::Evidence;
use crate::tracking::flutter::Flutter;
use crate::tracking::ranging::Ranging;
use crate::tracking::recognition::Recognition;
use glam::{DVec2, DVec3};

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
    pub(super) fn surely_hides(&self, t_s: f64) -> bool {
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
    pub(super) looks: PerTier<u32>,
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
    pub(super) votes: Vec<f64>,
    /// What speaks for its being a UAV.
    pub evidence: Evidence,
    /// How much its box flutters in each camera.
    pub(super) flutter: PerTier<Flutter>,
    /// What it has shown of its flight.
    pub conduct: Conduct,
    /// Pulses of the range finder in a row without an echo where its range is expected.
    pub(super) unanswered: u32,
    /// Pulses in a row that something nearer answered first, and how far that was the last time [m].
    pub(super) nearer: (u32, f64),
    /// Whether a radar has told its range.
    pub(super) ranged_by_radar: bool,
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

/// Hits that make a track worth judging: a false alarm seldom comes back.
pub const JUDGED_HITS: u32 = 3;
/// Hits from which on a track is established: a young one goes after more misses in a row than hits.
pub(super) const ESTABLISHED_HITS: u32 = 30;
/// Hits from which on a weak detection may go on with a track.
pub(super) const CONFIRMED_HITS: u32 = 6;

impl Track {
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
}
