//! The state machine of an engagement.

use super::belief::{Belief, Term};
use super::choice::is_unlikely;
use super::situation::{CONFIRM_HITS, Situation};
use super::tracker::{BoresightError, Tracker, TrackingState};
use crate::optics::tier::Tier;
use crate::tracking::cartesian::TargetCue;
use crate::tracking::evidence::probability;
use crate::tracking::table::{JUDGED_HITS, Track, TrackTable, separation_rad};
use std::collections::BTreeMap;

/// Even odds: what is less likely is sure enough for nothing.
const EVEN: f64 = 0.5;
/// Longest time between two judgements that counts [s].
const LONGEST_WEIGHED_S: f64 = 0.2;

/// Moves the state machine by one look at the situation; `weighs`: tracks are judged now, and threats
/// compared.
pub fn step(now: &Situation, tracker: &mut Tracker, firing: bool, weighs: bool) {
    let tick = now.tick;
    if weighs {
        let elapsed_s = now.at_s(tick - tracker.weighed_tick);
        tracker.weighed_tick = tick;
        let elapsed_s = elapsed_s.min(LONGEST_WEIGHED_S);
        now.weigh(&mut tracker.table, elapsed_s);
        let says = tracker
            .target_track()
            .map_or(0.0, |track| now.vouches(track));
        let towards = |mean: &mut f64, value: f64, memory_s: f64| {
            *mean += (1.0 - (-elapsed_s / memory_s).exp()) * (value - *mean);
        };
        let judged = |track: &Track| track.recognition.map(|_| track.log_odds());
        let log_odds = tracker.target_track().and_then(judged).unwrap_or(0.0);
        towards(&mut tracker.mean_log_odds, log_odds, now.tuning().sure_s);
        towards(&mut tracker.radar_log_odds, says, now.tuning().vouched_s);
        tracker.queue = now.queue(tracker);
        tracker.beliefs = beliefs(now, tracker);
    }
    if tracker.state == TrackingState::Search {
        if let Some(track) = now.candidate(tracker) {
            let (id, threat_s) = (track.id, now.threat_s(track));
            let reason = format!(
                "track {id} {}, could arrive in {threat_s:.0} s",
                now.reason(track)
            );
            tracker.acquire(tick, id, reason);
        }
        return;
    }
    if tracker.target_track().is_none() {
        tracker.give_up(tick, None, "no camera saw the target any more");
        return;
    }
    if falls(now, tracker, firing) {
        tracker.give_up(tick, Some(f64::INFINITY), "the target falls");
        return;
    }
    if let Some((reason, until_s)) = doubted(now, tracker) {
        tracker.give_up(tick, until_s, reason);
        return;
    }
    if !firing && !tracker.designated && tracker.target.is_some_and(|id| now.spares(id)) {
        tracker.give_up(tick, None, "another station's, or not the most pressing");
        return;
    }
    hold(now, tracker);
    // What is being fired at is not left for another; who has a task has the defence's choice.
    if !now.params.nearest_to_centre
        && !tracker.designated
        && !firing
        && now.task().is_none()
        && matches!(
            tracker.state,
            TrackingState::Coarse
                | TrackingState::Precise
                | TrackingState::Engage
                | TrackingState::Lost
        )
    {
        if weighs {
            compare(now, tracker);
        }
    } else {
        tracker.rival = None;
    }
}

/// What speaks for each track that has been seen often enough to be judged.
fn beliefs(now: &Situation, tracker: &Tracker) -> BTreeMap<u32, Belief> {
    let judged = (tracker.table.tracks.iter()).filter(|track| track.total_hits() >= JUDGED_HITS);
    let belief = |track: &Track| match tracker.target {
        Some(id) if id == track.id => now.belief_in_target(track, tracker.radar_log_odds),
        _ => now.belief(track),
    };
    judged.map(|track| (track.id, belief(track))).collect()
}

/// Whether the target has been falling since it was fired at.
fn falls(now: &Situation, tracker: &mut Tracker, firing: bool) -> bool {
    let Some(sink_mps) = tracker.target_track().map(|track| now.sink_mps(track)) else {
        return false;
    };
    // The laser fires at what is engaged; in the tick of a change it may still be on at the last target.
    if firing && tracker.state == TrackingState::Engage {
        tracker.sink_at_fire_mps.get_or_insert(sink_mps);
        tracker.fired_ticks += 1;
    }
    let fired = now.at_s(tracker.fired_ticks) >= now.tuning().fired_s;
    // One that dived at the station before it was hit still attacks, and one that rose has only levelled off.
    let sinks = (tracker.sink_at_fire_mps)
        .is_some_and(|before| sink_mps - before.max(0.0) > now.tuning().falling_mps);
    if !(fired && sinks && tracker.lased) {
        tracker.falling_since = None;
        return false;
    }
    let since = *tracker.falling_since.get_or_insert(now.tick);
    now.at_s(now.tick - since) > now.tuning().falling_s
}

/// Why a target is to be given up as no UAV, and until when it is left alone then [s], if it is.
///
/// What is held keeps the station from everything else. That is worth while for as long as what it may bring outweighs what its
/// being none has cost: for its odds times the time that a UAV is worth. What is sure enough for fire costs nothing.
fn doubted(now: &Situation, tracker: &mut Tracker) -> Option<(String, Option<f64>)> {
    let elapsed_s = now
        .at_s(now.tick - tracker.doubt_tick)
        .min(LONGEST_WEIGHED_S);
    tracker.doubt_tick = now.tick;
    let (tuning, track) = (now.tuning(), tracker.target_track()?);
    let belief = now.belief_in_target(track, tracker.radar_log_odds);
    let id = track.id;
    tracker.beliefs.insert(id, belief);
    let track = tracker.target_track()?;
    // The paper's rule has no track to judge by; what tumbles looks like no UAV, and is soon seen to fall.
    let left_alone =
        now.params.nearest_to_centre || tracker.designated || tracker.falling_since.is_some();
    if left_alone {
        tracker.forget_doubt();
        return None;
    }
    let unseen = track.hidden(now.t_s()) || !now.fresh(track);
    if unseen {
        return None;
    }
    let believed = probability(belief.log_odds());
    // From where the radar points a search comes back to the same: to hold that costs nothing either.
    let sure = if now.cued(track) {
        EVEN
    } else {
        f64::max(now.params.min_uav_probability, EVEN)
    };
    if believed >= sure {
        tracker.forget_doubt();
        return None;
    }
    let worth_s = (tuning.worth_s * belief.log_odds().exp()).max(tuning.least_doubt_s);
    let (doubt, unsure_s) = (
        tracker.doubt + elapsed_s / worth_s,
        tracker.unsure_s + elapsed_s,
    );
    // A moment at poor odds does not use up what it is worth, nor do poor odds of long ago what it is worth now.
    if doubt < 1.0 || unsure_s < worth_s {
        (tracker.doubt, tracker.unsure_s) = (doubt, unsure_s);
        return None;
    }
    let against = belief.against();
    let reason = format!(
        "{}: belief {:.0} %, seen in {:.0} % of the frames, with a mean score of {:.2}",
        against.against(),
        100.0 * believed,
        100.0 * track.filter.quality(),
        track.score
    );
    // What would not be chosen again has its evidence for a bar: what speaks for it anew must outweigh it first.
    let again = now.belief(track).log_odds() >= now.chosen(track);
    let barred_s = match against {
        Term::Echo => Some(tuning.disproved_barred_s),
        _ => again.then_some(tuning.rejected_s),
    };
    Some((reason, barred_s.map(|barred_s| now.t_s() + barred_s)))
}

/// Whether a cue may mean a track, by their directions.
pub fn points_at(cue: &TargetCue, track: &Track, t_s: f64) -> bool {
    const GATE_SIGMAS: f64 = 3.0;
    let gate_rad = GATE_SIGMAS * cue.sigma_rad.max_element();
    separation_rad(track.filter.predicted(t_s).az_el_rad(), cue.az_el_rad) < gate_rad
}

/// The range of a cue goes to the track that it points at, if there is only one.
pub fn take_radar_range(cue: &TargetCue, table: &mut TrackTable, id: u32, t_s: f64) {
    let mut near = table
        .tracks
        .iter_mut()
        .filter(|track| track.total_hits() >= CONFIRM_HITS && points_at(cue, track, t_s));
    if let (Some(track), None) = (near.next(), near.next())
        && track.id == id
    {
        track.ranged_by_radar(cue.range_m, cue.range_sigma_m, t_s);
    }
}

/// Steps the states that have a target.
fn hold(now: &Situation, tracker: &mut Tracker) {
    let (tick, params, tuning) = (now.tick, now.params, now.tuning());
    let in_state_s = now.at_s(tick - tracker.since_tick);
    let Some(track) = tracker.target_track() else {
        return;
    };
    let quality = track.filter.quality();
    let log_odds = track.log_odds() + now.flying_log_odds(track);
    let hidden = track.hidden(now.t_s());
    let fits = track.size_rad < tuning.fits_share * params.precise_field_rad;
    // The paper's rule has no track to judge by.
    let judged = !params.nearest_to_centre;
    let hits = tracker.hits_in_state;
    match tracker.state {
        TrackingState::Search => {}
        TrackingState::Acquire => {
            // What is as small to the coarse camera, too, is shown to the precise one unless it is surely none.
            let convincing =
                !judged || log_odds > tuning.surely_none * now.wants_closer_look(track);
            if hits[Tier::Coarse] >= CONFIRM_HITS && convincing {
                let reason = format!(
                    "coarse camera confirms with {CONFIRM_HITS} hits, seen in {:.0} % of the frames",
                    100.0 * quality
                );
                tracker.change(tick, TrackingState::Coarse, reason);
            } else if hits[Tier::Precise] >= CONFIRM_HITS && convincing && fits {
                // It found the candidate before the coarse camera.
                let reason = format!("precise camera confirms with {CONFIRM_HITS} hits");
                tracker.change(tick, TrackingState::Precise, reason);
            } else if !hidden && in_state_s > tuning.acquire_timeout_s + hidden_s(track) {
                // What the precise camera has seen is a UAV, wherever it is now.
                let bar = track.hits[Tier::Precise] < CONFIRM_HITS;
                let until_s = bar.then_some(now.t_s() + tuning.rejected_s);
                let reason = format!(
                    "coarse camera saw the candidate {} times in {in_state_s:.1} s",
                    hits[Tier::Coarse]
                );
                tracker.give_up(tick, until_s, reason);
            }
        }
        TrackingState::Coarse => {
            if hits[Tier::Precise] >= CONFIRM_HITS && fits {
                let reason = format!("precise camera confirms with {CONFIRM_HITS} hits");
                tracker.change(tick, TrackingState::Precise, reason);
            } else if now.lost_by(tracker, Tier::Coarse) {
                lose(now, tracker, Tier::Coarse);
            }
        }
        TrackingState::Precise | TrackingState::Engage => {
            if now.lost_by(tracker, Tier::Precise) {
                if now.lost_by(tracker, Tier::Coarse) {
                    lose(now, tracker, Tier::Precise);
                } else {
                    tracker.change(tick, TrackingState::Coarse, silence(now, Tier::Precise));
                }
            } else if !fits && !now.lost_by(tracker, Tier::Coarse) {
                let reason = "too large for the precise camera";
                tracker.change(tick, TrackingState::Coarse, reason);
            } else if let Some(error) = tracker.error[Tier::Precise] {
                lock(now, tracker, &error);
            }
        }
        TrackingState::Lost => find_again(now, tracker, in_state_s),
    }
}

/// Steps a lost target: a camera sees it again, or it is given up.
fn find_again(now: &Situation, tracker: &mut Tracker, in_state_s: f64) {
    let Some(track) = tracker.target_track() else {
        return;
    };
    let (id, hits) = (track.id, tracker.hits_in_state);
    let hidden_s = if track.hidden(now.t_s()) {
        in_state_s
    } else {
        hidden_s(track)
    };
    // What was hardly seen before is not waited for as long as what is known.
    let followed_s = track.seen_s() - track.started_s;
    let waits = in_state_s <= now.tuning().lost_timeout_s + hidden_s.min(followed_s);
    let reason = format!("track {id} seen again after {in_state_s:.2} s");
    if hits[Tier::Coarse] >= now.tuning().again_hits {
        tracker.change(now.tick, TrackingState::Coarse, reason);
    } else if hits[Tier::Precise] >= CONFIRM_HITS {
        tracker.change(now.tick, TrackingState::Precise, reason);
    } else if hits[Tier::Search] >= now.tuning().refind_hits {
        let reason = format!("search camera sees track {id} again after {in_state_s:.2} s");
        tracker.change(now.tick, TrackingState::Acquire, reason);
    } else if !waits {
        let reason = format!("not seen again within {in_state_s:.1} s");
        tracker.give_up(now.tick, None, reason);
    }
}

/// How long the city hid a track that has come out again, or should have [s].
fn hidden_s(track: &Track) -> f64 {
    track
        .occlusion
        .and_then(|occlusion| Some(occlusion.exit_s? - occlusion.enter_s))
        .map_or(0.0, |hidden_s| hidden_s.max(0.0))
}

/// Goes to Lost and says why, if the city explains it.
fn lose(now: &Situation, tracker: &mut Tracker, tier: Tier) {
    let foreseen = tracker.target_track().and_then(|track| track.occlusion);
    let reason = match foreseen.filter(|occlusion| occlusion.hides(now.t_s())) {
        Some(occlusion) => match occlusion.exit_s {
            Some(exit_s) => format!("behind a building, expected out at {exit_s:.2} s"),
            None => "behind a building".into(),
        },
        None => silence(now, tier),
    };
    tracker.change(now.tick, TrackingState::Lost, reason);
}

/// Why a camera has lost the target.
fn silence(now: &Situation, tier: Tier) -> String {
    let patience_s = now.params.patience_s[tier];
    format!("{} camera had no hit for {patience_s} s", tier.word())
}

/// Follows the lock of the precise camera between Precise and Engage.
fn lock(now: &Situation, tracker: &mut Tracker, error: &BoresightError) {
    let (tick, params) = (now.tick, now.params);
    let mean_px = match tracker.settling {
        None => error.offset_px,
        Some((exposed, mean_px)) => {
            let since_s = now.at_s(error.exposure_tick.saturating_sub(exposed));
            mean_px.lerp(
                error.offset_px,
                1.0 - (-since_s / now.tuning().flutter_s).exp(),
            )
        }
    };
    tracker.settling = Some((error.exposure_tick, mean_px));
    // A box that flutters about the reticle is on it, however far its middle jumps.
    let distance_px = error.offset_px.length().min(mean_px.length());
    let side_px = 2.0 * error.half_side_px;
    let engaged = tracker.state == TrackingState::Engage;
    let radius_px = if engaged {
        params
            .break_radius_px
            .max(now.tuning().break_share * side_px)
    } else {
        params.lock_radius_px.max(now.tuning().lock_share * side_px)
    };
    if distance_px > radius_px {
        tracker.locked_since = None;
    } else if tracker.locked_since.is_none() {
        tracker.locked_since = Some(tick);
    }
    match (engaged, tracker.locked_since) {
        (false, Some(since)) if now.at_s(tick - since) >= params.lock_dwell_s => {
            let reason = format!(
                "precise error below {radius_px:.0} px for {} s",
                params.lock_dwell_s
            );
            tracker.change(tick, TrackingState::Engage, reason);
        }
        (true, None) => {
            let reason = format!("precise error is {distance_px:.1} px");
            tracker.change(tick, TrackingState::Precise, reason);
        }
        _ => {}
    }
}

/// Turns to another track that has been the greater threat for long enough.
fn compare(now: &Situation, tracker: &mut Tracker) {
    let Some(target) = tracker.target_track() else {
        return;
    };
    // An unlikely one is compared as if there were no target.
    let (ratio, pointed) = if is_unlikely(target) {
        (1.0, 1.0)
    } else {
        (now.params.switch_ratio, 0.0)
    };
    let expected_s = |track: &Track| {
        let belief = now.belief(track);
        let by_radar = pointed * belief.0[Term::Radar as usize];
        now.expected_s(track, belief.without(Term::Radar) + by_radar)
    };
    let held_s = expected_s(target);
    let greater = now.candidate(tracker).and_then(|rival| {
        let less = expected_s(rival) * ratio < held_s;
        less.then(|| {
            let id = rival.id;
            let word = |track: &Track| {
                let (p, in_s) = (100.0 * track.uav_belief(), now.threat_s(track));
                format!("{p:.0} % a UAV that could arrive in {in_s:.0} s")
            };
            let (new, old) = (word(rival), word(target));
            (
                id,
                format!("track {id} is the greater threat: {new}, the target {old}"),
            )
        })
    });
    let Some((id, reason)) = greater else {
        tracker.rival = None;
        return;
    };
    match tracker.rival {
        Some((rival, since)) if rival == id => {
            if now.at_s(now.tick - since) > now.tuning().rival_s {
                tracker.acquire(now.tick, id, reason);
            }
        }
        _ => tracker.rival = Some((id, now.tick)),
    }
}

#[cfg(test)]
mod tests;
