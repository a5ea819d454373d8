//! What speaks for a track's being a UAV: each term.

use super::belief::Belief;
use super::situation::Situation;
use crate::engage::interlock::FAR_M;
use crate::maths::kinematics::az_el_to_los;
use crate::tracking::cartesian::TargetCue;
use crate::tracking::recognition::Recognition;
use crate::tracking::table::{Track, separation_rad};
use glam::DVec2;

/// A radar has its target where a track is up to so many deviations of its cue away.
const CUED_SIGMAS: f64 = 2.0;
/// Rates that the radar sees are none below so many deviations: by chance few are above.
const FLYING_SIGMAS: f64 = 3.0;
/// Age up to which an echo is the last of a pulse train [s]: the range finder sends ten a second.
const NEW_ECHO_S: f64 = 0.25;
/// A range less sure than this, over the range, comes from the size alone; the spans of the catalogue's UAVs
/// part from the one assumed by this, in the logarithm.
const MEASURED_REL: f64 = 0.3;
const SPANS_SIGMA_REL: f64 = 0.8;
/// A target's squared distance from the cue at which that says nothing: the mean of three Gaussian degrees
/// of freedom, doubled; and the mean of that of its two rates, below which they say nothing.
const CUE_NEUTRAL: f64 = 6.0;
const RATES_EXPECTED: f64 = 2.0;
/// The one that a target exceeds once in a thousand times: chi-squared of three degrees of freedom (direction and
/// range), and what its rates add.
const CUE_ELSEWHERE: f64 = 16.0;
/// Squared distance of a hovering UAV's rates from the radar's that is exceeded once in a hundred times.
const RATES_MOST: f64 = 9.2;

impl Situation<'_> {
    /// What speaks for a track that is no target yet.
    pub fn belief(&self, track: &Track) -> Belief {
        let radar = self.cue_log_odds(track) + self.flying_log_odds(track);
        let conduct = &track.conduct;
        let moves = conduct.in_sky || conduct.flown || conduct.moving_s >= self.tuning().moved_s;
        let place = self.place_log_odds(track, conduct.is_scenery() || !moves);
        Belief([track.log_odds(), place, radar, 0.0])
    }

    /// What speaks for the target; `vouched` is what the radar says of it for fire, evened out. Another's cue says nothing against
    /// it: a radar has many targets.
    pub(super) fn belief_in_target(&self, track: &Track, vouched: f64) -> Belief {
        let cued = if self.cued(track) {
            self.cue_log_odds(track).max(0.0)
        } else {
            0.0
        };
        let radar = vouched + cued + self.flying_log_odds(track);
        let echo = if self.is_disproved(track) {
            self.tuning().disproved
        } else {
            0.0
        };
        let place = self.place_log_odds(track, track.conduct.is_scenery());
        Belief([track.log_odds(), place, radar, echo])
    }

    /// How much a track that the recogniser has judged is so small that only a closer look can tell
    /// what it is, 0 to 1.
    pub(super) fn wants_closer_look(&self, track: &Track) -> f64 {
        let [small_px, plain_px] = self.tuning().closer_look_px;
        if track.recognition.is_some() {
            let size_px = track.evidence.best_px();
            1.0 - ((size_px - small_px) / (plain_px - small_px)).clamp(0.0, 1.0)
        } else {
            0.0
        }
    }

    /// What it says whether a track stands before scenery: unless the radar has its target there, it is a part of that as far as
    /// its looks do not tell.
    fn place_log_odds(&self, track: &Track, stands: bool) -> f64 {
        let tuning = self.tuning();
        if !stands {
            0.0
        } else if self.elsewhere(track) {
            // What its radar follows flies elsewhere.
            tuning.before_scenery_unjudged
        } else if self.cued(track) {
            0.0
        } else if track.recognition.is_some() {
            tuning.before_scenery * (1.0 - self.wants_closer_look(track))
        } else {
            tuning.before_scenery_unjudged
        }
    }

    /// What the radar's cue says for a track, as log-odds.
    fn cue_log_odds(&self, track: &Track) -> f64 {
        let tuning = self.tuning();
        self.cue_of(track).map_or(0.0, |cue| {
            let distance2 = self.cue_distance2(cue, track);
            (0.5 * (CUE_NEUTRAL - distance2)).clamp(tuning.cue_against, tuning.cue_for)
        })
    }

    /// What the radar adds to the log-odds of a track that has flown and flies as its target does: enough for a close look, no
    /// word on fire.
    pub(super) fn flying_log_odds(&self, track: &Track) -> f64 {
        let flies = |cue: &TargetCue| {
            cue.rate_radps.length() > FLYING_SIGMAS * cue.rate_sigma_radps.max_element()
        };
        let both_fly = track.conduct.flown && self.cue_of(track).is_some_and(flies);
        if self.by_radar && both_fly && self.cued(track) {
            self.tuning().cue_for_flying
        } else {
            0.0
        }
    }

    /// What the radar says of a target for fire, as log-odds. It speaks for one that it has where the range finder's last
    /// echo came from, and sees fly alike: a bird that is there by chance flies its own way. It speaks against one from which
    /// the echo came from another range.
    pub(super) fn vouches(&self, track: &Track) -> f64 {
        match self.is_ranged_elsewhere(track) {
            Some(true) => self.tuning().cue_against,
            Some(false) if self.cued(track) => self.cue_log_odds(track).max(0.0),
            _ => 0.0,
        }
    }

    /// The radar's target that a track is nearest to.
    pub fn cue_of(&self, track: &Track) -> Option<&TargetCue> {
        let distance2 = |cue: &TargetCue| self.cue_distance2(cue, track);
        (self.cues.iter()).min_by(|a, b| distance2(a).total_cmp(&distance2(b)))
    }

    /// Squared distance of a track from a radar's target, in deviations: of direction, range and, as far as
    /// they differ more than noise, rates.
    fn cue_distance2(&self, cue: &TargetCue, track: &Track) -> f64 {
        let los = track.filter.predicted(self.t_s());
        let apart_rad = separation_rad(los.az_el_rad(), cue.az_el_rad);
        let direction = apart_rad
            / cue
                .sigma_rad
                .max_element()
                .hypot(los.sigma_rad().max_element());
        let range = self.range_deviations(cue, track);
        let rates = (self.rates_distance2(cue, track) - RATES_EXPECTED).max(0.0);
        direction * direction + range * range + rates
    }

    /// How much further a track is than the radar's target, in deviations.
    fn range_deviations(&self, cue: &TargetCue, track: &Track) -> f64 {
        let range = track.range.range_m(self.t_s());
        range.map_or(0.0, |(range_m, sigma_m)| {
            let sigma_rel = sigma_m / range_m;
            let sigma_rel = if sigma_rel > MEASURED_REL {
                sigma_rel.max(SPANS_SIGMA_REL)
            } else {
                sigma_rel
            };
            let sigma = sigma_rel.hypot(cue.range_sigma_m / cue.range_m);
            (range_m / cue.range_m).ln() / sigma
        })
    }

    /// Squared distance of a track's rates on the sky from those that the radar sees, in deviations.
    fn rates_distance2(&self, cue: &TargetCue, track: &Track) -> f64 {
        let (rate_radps, sigma_radps) = track.rates(self.t_s());
        let variance = sigma_radps * sigma_radps + cue.rate_sigma_radps * cue.rate_sigma_radps;
        let off_radps = rate_radps - cue.rate_radps;
        (off_radps * off_radps / variance).element_sum()
    }

    /// Whether the radar has its target where a track is, and sees it fly alike.
    pub(super) fn cued(&self, track: &Track) -> bool {
        let at = track.filter.predicted(self.t_s()).az_el_rad();
        self.cues.iter().any(|cue| {
            separation_rad(at, cue.az_el_rad) < CUED_SIGMAS * cue.sigma_rad.max_element()
                && self.rates_distance2(cue, track) < RATES_MOST
        })
    }

    /// Whether a track is no UAV by the range finder: it is too large, or stands where the city's surface is behind it.
    fn is_disproved(&self, track: &Track) -> bool {
        let span_m = track.measured_span_m(self.t_s());
        span_m.is_some_and(|span_m| {
            span_m > self.params.max_span_m
                || track.conduct.is_scenery()
                    && !self.cued(track)
                    && !self.is_plainly_uav(track)
                    && self.is_on_surface(track)
        })
    }

    /// Whether a track looks so much like a UAV, and is seen so well, that where it stands says nothing against it: what hovers
    /// beside a crown echoes from as far as the crown does.
    fn is_plainly_uav(&self, track: &Track) -> bool {
        let tuning = self.tuning();
        let found = |found: Recognition| found.p_uav() >= tuning.plain_probability;
        track.found().is_some_and(found)
            && track.evidence.log_odds() >= tuning.plain_log_odds
            && track.evidence.best_px() >= tuning.plain_px
    }

    /// Whether a new echo of the range finder from a track comes from where the city's surface is, behind it or at its lower
    /// edge.
    fn is_on_surface(&self, track: &Track) -> bool {
        let t_s = self.t_s();
        let at = track.filter.predicted(t_s).az_el_rad();
        let edge = at - DVec2::new(0.0, 0.5 * track.size_rad);
        let behind_m = |az_el_rad: DVec2| {
            let los = az_el_to_los(az_el_rad);
            (self.dsm?).first_hit(self.r_station_enu_m, los, FAR_M)
        };
        (track.echo(t_s))
            .filter(|echo| t_s - echo.t_s < NEW_ECHO_S)
            .is_some_and(|echo| {
                let near_m = self.tuning().surface_m + 3.0 * echo.sigma_m;
                [at, edge]
                    .into_iter()
                    .filter_map(behind_m)
                    .any(|range_m| (range_m - echo.range_m).abs() < near_m)
            })
    }

    /// Whether the radar's targets are surely others: in another direction, at another range, or in flight.
    fn elsewhere(&self, track: &Track) -> bool {
        self.cue_of(track)
            .is_some_and(|cue| self.cue_distance2(cue, track) > CUE_ELSEWHERE)
    }

    /// Whether the range finder has a track at another range than the radar's target; `None` without an echo or a radar.
    fn is_ranged_elsewhere(&self, track: &Track) -> Option<bool> {
        let cue = self.cue_of(track).filter(|_| self.by_radar)?;
        track.echo(self.t_s())?;
        Some(self.range_deviations(cue, track).powi(2) > CUE_ELSEWHERE)
    }
}
