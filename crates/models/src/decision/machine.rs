//! The state machine of an engagement.

use super::situation::{CONFIRM_HITS, Situation, is_unlikely, wants_closer_look};
use super::tracker::{BoresightError, Tracker, TrackingState};
use crate::optics::tier::Tier;
use crate::tracking::cartesian::TargetCue;
use crate::tracking::evidence::{named_share, probability};
use crate::tracking::table::{Track, TrackTable, separation_rad};

/// Hits that bring a lost target back: of the coarse camera, and of the search camera.
const AGAIN_HITS: u32 = 2;
const REFIND_HITS: u32 = 3;
/// Time for which a track that no camera could confirm is left alone [s].
const REJECTED_S: f64 = 10.0;
/// How long the precise camera has to confirm what the coarse one holds in its field, in times of that camera's patience.
const CLOSER_PATIENCES: f64 = 4.0;
/// Time the coarse camera has to confirm a candidate [s], and a lost target to come back.
const ACQUIRE_TIMEOUT_S: f64 = 3.0;
const LOST_TIMEOUT_S: f64 = 3.0;
/// How long another track must have been the greater threat before it becomes the target [s].
const RIVAL_S: f64 = 1.0;
/// Log-odds at which a target is given up (one to seven): as far below even odds as it was above them when
/// it was chosen, and then some.
pub const GIVEN_UP: f64 = -2.0;
/// Log-odds below which not even the smallest is shown to the precise camera.
const SURELY_NONE: f64 = -1.5;
/// Time for which it must have been held before it is doubted [s]; by the precise camera, whose pictures must first take the
/// place of dots in the second that is judged, and of what the radar points at.
const DOUBT_AFTER_S: f64 = 0.3;
const DOUBT_CLOSE_S: f64 = 1.0;
/// A target that has been fired at for so long [s] and sinks faster by this [m/s] than before it, for this
/// long [s], has been dealt with.
const FIRED_S: f64 = 0.1;
const FALLING_MPS: f64 = 6.0;
const FALLING_S: f64 = 0.3;
/// Time for which a target that stands before scenery may be less than surely a UAV [s].
const BEFORE_SCENERY_S: f64 = 2.0;
/// A target that the range finder says to be no UAV for so long [s] is left alone for so long [s].
const DISPROVED_S: f64 = 0.3;
const DISPROVED_BARRED_S: f64 = 60.0;
/// Time for which an engaged target that is seen well may be less than surely a UAV [s], at odds up to these; in
/// proportion to them for a likelier one, and twice as long for the smallest.
const DOUBTFUL_S: f64 = 4.0;
const DOUBTFUL_ODDS: f64 = 4.0;
/// Time for which a target at another range than the radar's may be less than surely a UAV [s].
const ANOTHER_S: f64 = 2.0;
/// Time over which the flutter of a target's box evens out [s].
const FLUTTER_S: f64 = 0.2;
/// Lock and break radius as a share of the smaller side of a large target's box: a beam on a larger body
/// may wander more.
const LOCK_SHARE: f64 = 0.1;
const BREAK_SHARE: f64 = 0.25;
/// Share of the precise camera's field that a target may fill: beyond, its edges come and go.
const FITS_SHARE: f64 = 0.8;
/// Time over which what the recogniser says of a target evens out for fire [s], and what the radar says for it.
const SURE_S: f64 = 0.5;
const VOUCHED_S: f64 = 1.0;
/// What the radar says on the mean for a target that is not doubted: it has one at that range, too.
const VOUCHED: f64 = 0.5;
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
        towards(&mut tracker.mean_log_odds, log_odds, SURE_S);
        towards(&mut tracker.radar_log_odds, says, VOUCHED_S);
        tracker.queue = now.queue(tracker);
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
    if let Some(reason) = disproof(now, tracker) {
        let until_s = now.t_s() + DISPROVED_BARRED_S;
        tracker.give_up(tick, Some(until_s), reason);
        return;
    }
    let rejected = if stands(now, tracker) {
        Some("it stands before scenery, and is not surely a UAV")
    } else if is_doubtful(now, tracker) {
        Some("engaged for some seconds, and not surely a UAV")
    } else if is_another(now, tracker) {
        Some("the radar has its target at another range, and this is not surely a UAV")
    } else {
        None
    };
    if let Some(reason) = rejected {
        let until_s = now.t_s() + REJECTED_S;
        tracker.give_up(tick, Some(until_s), reason);
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
    let fired = now.at_s(tracker.fired_ticks) >= FIRED_S;
    // One that dived at the station before it was hit still attacks, and one that rose has only levelled off.
    let sinks =
        (tracker.sink_at_fire_mps).is_some_and(|before| sink_mps - before.max(0.0) > FALLING_MPS);
    if !(fired && sinks && tracker.lased) {
        tracker.falling_since = None;
        return false;
    }
    let since = *tracker.falling_since.get_or_insert(now.tick);
    now.at_s(now.tick - since) > FALLING_S
}

/// Why a target is no UAV, if the range finder has said so for some time.
fn disproof(now: &Situation, tracker: &mut Tracker) -> Option<String> {
    let left_alone = now.params.nearest_to_centre || tracker.designated;
    let Some(reason) = tracker
        .target_track()
        .and_then(|track| now.disproof(track))
        .filter(|_| !left_alone)
    else {
        tracker.disproved_since = None;
        return None;
    };
    let since = *tracker.disproved_since.get_or_insert(now.tick);
    (now.at_s(now.tick - since) > DISPROVED_S).then_some(reason)
}

/// Whether the target has been mere scenery for so long that the search goes on.
fn stands(now: &Situation, tracker: &mut Tracker) -> bool {
    let left_alone = now.params.nearest_to_centre || tracker.designated;
    let mere = |track: &Track| !track.hidden(now.t_s()) && now.is_mere_scenery(track);
    if left_alone || !tracker.target_track().is_some_and(mere) {
        tracker.scenery_since = None;
        return false;
    }
    let since = *tracker.scenery_since.get_or_insert(now.tick);
    now.at_s(now.tick - since) > BEFORE_SCENERY_S
}

/// Whether the target has been engaged for so long without being recognised surely enough to be fired at that the search
/// goes on: no radar points at it.
fn is_doubtful(now: &Situation, tracker: &mut Tracker) -> bool {
    let left_alone = now.params.nearest_to_centre || tracker.designated;
    let doubtful = |track: &Track| {
        let judged = !track.hidden(now.t_s()) && track.recognition.is_some();
        judged && track.uav_belief() < now.params.min_uav_probability && !now.cued(track)
    };
    let engaged = tracker.state == TrackingState::Engage && !left_alone;
    let target = tracker.target_track().filter(|track| doubtful(track));
    let Some((odds, named)) = target
        .map(|track| {
            let named = named_share(track.evidence.best_px());
            (track.log_odds().exp(), named)
        })
        .filter(|_| engaged)
    else {
        tracker.doubtful_since = None;
        return false;
    };
    let since = *tracker.doubtful_since.get_or_insert(now.tick);
    let longest_s = DOUBTFUL_S * (2.0 - named) * (odds / DOUBTFUL_ODDS).max(1.0);
    now.at_s(now.tick - since) > longest_s
}

/// Whether the range finder has had the target at another range than the radar for so long, without it being recognised
/// surely enough to be fired at, that the search goes on. What breaks up and has no echo in between is no less another.
fn is_another(now: &Situation, tracker: &mut Tracker) -> bool {
    let left_alone = now.params.nearest_to_centre || tracker.designated;
    let judged = |track: &&Track| !track.hidden(now.t_s()) && track.recognition.is_some();
    let target = tracker.target_track().filter(judged);
    let elsewhere = target.and_then(|track| now.is_ranged_elsewhere(track));
    let sure = |log_odds: f64| probability(log_odds) >= now.params.min_uav_probability;
    if left_alone || elsewhere == Some(false) || tracker.lately_log_odds().is_none_or(sure) {
        tracker.another_since = None;
        return false;
    }
    if elsewhere.is_none() {
        return false;
    }
    let since = *tracker.another_since.get_or_insert(now.tick);
    now.at_s(now.tick - since) > ANOTHER_S
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
    let (tick, params) = (now.tick, now.params);
    let in_state_s = now.at_s(tick - tracker.since_tick);
    let unlikely_s = unlikely_s(now, tracker);
    let Some(track) = tracker.target_track() else {
        return;
    };
    let quality = track.filter.quality();
    let log_odds = track.log_odds() + now.flying_log_odds(track);
    let hidden = track.hidden(now.t_s());
    let fits = track.size_rad < FITS_SHARE * params.precise_field_rad;
    // The paper's rule has no track to judge by.
    let judged = !params.nearest_to_centre;
    let hits = tracker.hits_in_state;
    let doubt_after_s = match tracker.state {
        TrackingState::Precise | TrackingState::Engage => DOUBT_CLOSE_S,
        TrackingState::Lost => f64::INFINITY,
        _ if now.cued(track) => DOUBT_CLOSE_S,
        _ => DOUBT_AFTER_S,
    };
    // What is lost and seen again by turns is doubted, too, if the recogniser has said so: the evidence falls by itself
    // while nothing is seen.
    let long = |since_s: f64| since_s > DOUBT_CLOSE_S && track.recognition.is_some();
    let unlikely = unlikely_s.is_some_and(|since_s| in_state_s > doubt_after_s || long(since_s));
    let doubted = unlikely && tracker.radar_log_odds < VOUCHED;
    match tracker.state {
        TrackingState::Search => {}
        _ if judged
            && !hidden
            && !tracker.designated
            // What tumbles looks like no UAV, and is soon seen to fall.
            && tracker.falling_since.is_none()
            && doubted =>
        {
            doubt(now, tracker);
        }
        TrackingState::Acquire => {
            // What is as small to the coarse camera, too, is shown to the precise one unless it is surely none.
            let convincing = !judged || log_odds > SURELY_NONE * wants_closer_look(track);
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
            } else if !hidden && in_state_s > ACQUIRE_TIMEOUT_S + hidden_s(track) {
                // What the precise camera has seen is a UAV, wherever it is now.
                let bar = track.hits[Tier::Precise] < CONFIRM_HITS;
                let until_s = bar.then_some(now.t_s() + REJECTED_S);
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
            } else if judged
                && fits
                && !hidden
                && !tracker.designated
                && !now.cued(track)
                && track.hits[Tier::Precise] < CONFIRM_HITS
                && in_state_s > CLOSER_PATIENCES * params.patience_s[Tier::Precise]
            {
                let reason = format!(
                    "precise camera saw the candidate {} times in {in_state_s:.1} s",
                    track.hits[Tier::Precise]
                );
                tracker.give_up(tick, Some(now.t_s() + REJECTED_S), reason);
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

/// For how long the evidence has spoken against the target as strongly as it must for that to be given up [s].
fn unlikely_s(now: &Situation, tracker: &mut Tracker) -> Option<f64> {
    let unlikely = |track: &Track| !track.hidden(now.t_s()) && track.log_odds() < GIVEN_UP;
    if !tracker.target_track().is_some_and(unlikely) {
        tracker.unlikely_since = None;
        return None;
    }
    let since = *tracker.unlikely_since.get_or_insert(now.tick);
    Some(now.at_s(now.tick - since))
}

/// Gives up a target that the evidence has turned against.
fn doubt(now: &Situation, tracker: &mut Tracker) {
    let Some(track) = tracker.target_track() else {
        return;
    };
    let reason = format!(
        "track {} is no UAV: belief {:.0} %, seen in {:.0} % of the frames, with a mean score of {:.2}",
        track.id,
        100.0 * track.uav_belief(),
        100.0 * track.filter.quality(),
        track.score
    );
    // Its evidence is its verdict: what speaks for it anew must outweigh it first.
    tracker.give_up(now.tick, None, reason);
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
    let waits = in_state_s <= LOST_TIMEOUT_S + hidden_s.min(followed_s);
    let reason = format!("track {id} seen again after {in_state_s:.2} s");
    if hits[Tier::Coarse] >= AGAIN_HITS {
        tracker.change(now.tick, TrackingState::Coarse, reason);
    } else if hits[Tier::Precise] >= CONFIRM_HITS {
        tracker.change(now.tick, TrackingState::Precise, reason);
    } else if hits[Tier::Search] >= REFIND_HITS {
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
            mean_px.lerp(error.offset_px, 1.0 - (-since_s / FLUTTER_S).exp())
        }
    };
    tracker.settling = Some((error.exposure_tick, mean_px));
    // A box that flutters about the reticle is on it, however far its middle jumps.
    let distance_px = error.offset_px.length().min(mean_px.length());
    let side_px = 2.0 * error.half_side_px;
    let engaged = tracker.state == TrackingState::Engage;
    let radius_px = if engaged {
        params.break_radius_px.max(BREAK_SHARE * side_px)
    } else {
        params.lock_radius_px.max(LOCK_SHARE * side_px)
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
        now.expected_s(
            track,
            track.log_odds() + pointed * now.pointed_log_odds(track),
        )
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
            if now.at_s(now.tick - since) > RIVAL_S {
                tracker.acquire(now.tick, id, reason);
            }
        }
        _ => tracker.rival = Some((id, now.tick)),
    }
}

#[cfg(test)]
mod tests;
