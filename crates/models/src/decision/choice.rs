//! Which track to take for the target.

use super::belief::Term;
use super::situation::{CONFIRM_HITS, Situation};
use super::tracker::Tracker;
use crate::engage::allocation::LOCKED_S;
use crate::optics::tier::Tier;
use crate::tracking::search::Sector;
use crate::tracking::table::{Track, separation_rad};

/// Whether a track has been looked at closely and is more likely no UAV: as a target it has no more right than any other.
pub(super) fn is_unlikely(track: &Track) -> bool {
    track.hits[Tier::Precise] >= CONFIRM_HITS
        && track.recognition.is_some()
        && track.log_odds() < 0.0
}

impl Situation<'_> {
    /// Log-odds from which on a track is chosen.
    pub(super) fn chosen(&self, track: &Track) -> f64 {
        let tuning = self.tuning();
        tuning.chosen - (tuning.chosen - tuning.chosen_small) * self.wants_closer_look(track)
    }

    /// The most threatening track beside the target that looks like a UAV, each threat weighed with how
    /// likely it is one.
    pub(super) fn candidate<'t>(&self, tracker: &'t Tracker) -> Option<&'t Track> {
        let (tracks, tuning) = (tracker.table.tracks.iter(), self.tuning());
        tracks
            .filter(|track| Some(track.id) != tracker.target && self.may_be_target(track))
            .filter(|track| !self.spares(track.id))
            .filter_map(|track| {
                let belief = self.belief(track);
                // Beside a target the radar's cue, which may be the target's own, says nothing.
                let by_looks = belief.without(Term::Radar);
                let (log_odds, least) = match tracker.target_track().filter(|t| !is_unlikely(t)) {
                    // One that is itself in doubt gives way to what would be chosen.
                    Some(target) if target.log_odds() < tuning.chosen => (by_looks, tuning.chosen),
                    Some(_) => (by_looks, tuning.rival),
                    None => (belief.log_odds(), self.chosen(track)),
                };
                if log_odds < least {
                    return None;
                }
                // The defence has weighed the threats.
                let tasked = self.task().is_some_and(|task| task.track == Some(track.id));
                let cost = self.cost(track, log_odds);
                Some((if tasked { 0.0 } else { cost }, track))
            })
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.id.cmp(&b.1.id)))
            .map(|(_, track)| track)
    }

    /// The tracks that would be targets if the present one were dealt with, the most pressing first.
    pub(super) fn queue(&self, tracker: &Tracker) -> Vec<u32> {
        let tracks = tracker.table.tracks.iter();
        let mut waiting: Vec<(f64, u32)> = tracks
            .filter(|track| Some(track.id) != tracker.target && self.may_be_target(track))
            .filter(|track| !self.spares(track.id))
            .filter_map(|track| {
                let log_odds = self.belief(track).without(Term::Radar);
                (log_odds >= self.chosen(track)).then(|| (self.cost(track, log_odds), track.id))
            })
            .collect();
        waiting.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        waiting.into_iter().map(|(_, id)| id).collect()
    }

    /// What taking a track for a target costs, as [`crate::models::engage::allocation`] has it [s²].
    fn cost(&self, track: &Track, log_odds: f64) -> f64 {
        let at = track.filter.predicted(self.t_s()).az_el_rad();
        let slew_s = self.mount.map_or(0.0, |(points_rad, slew)| {
            slew.slew_s(separation_rad(at, points_rad))
        });
        self.expected_s(track, log_odds) * (slew_s + LOCKED_S)
    }

    /// Time that a track needs to reach the asset over its probability of being a UAV [s].
    pub(super) fn expected_s(&self, track: &Track, log_odds: f64) -> f64 {
        self.threat_s(track) * (1.0 + (-log_odds).exp())
    }

    /// Whether a track has been seen long enough, and is seen.
    pub fn may_be_target(&self, track: &Track) -> bool {
        let here = |area: &Sector| area.contains(track.filter.predicted(self.t_s()).az_el_rad());
        self.within.as_ref().is_none_or(here)
            && track.total_hits() >= self.tuning().candidate_hits
            && !track.is_barred(self.t_s())
            && (track.misses == 0 || self.fresh(track))
    }

    /// Why a track may be a UAV.
    pub(super) fn reason(&self, track: &Track) -> String {
        let (rate_radps, _) = track.motion(self.t_s());
        let belief = format!(
            "{:.0} % a UAV, seen in {:.0} % of its frames",
            100.0 * track.uav_belief(),
            100.0 * track.filter.quality()
        );
        if track.conduct.moving_s > 0.0 {
            format!("moves at {:.1} mrad/s, {belief}", 1e3 * rate_radps)
        } else if track.conduct.in_sky {
            format!("stands in clear sky, {belief}")
        } else {
            format!("seems to hover, {belief}")
        }
    }
}
