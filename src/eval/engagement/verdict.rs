//! What became of an engagement, from what was seen of it: plain functions of its record.

use super::recipe::Nearness;
use crate::components::track::TrackingState;
use crate::models::decision::belief::Term;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Least size of a UAV in the search camera that counts as visible [px].
pub const LEAST_PX: f64 = 2.0;
/// Time in all for which a UAV must have been visible for its engagement to be scored [s].
pub const VISIBLE_S: f64 = 1.0;
/// A UAV is neutralised in time when it is so this long after it first was visible [s].
pub const IN_TIME_S: f64 = 20.0;
/// Share of the time from acquisition to the end for which the UAV must be held.
pub const HELD_SHARE: f64 = 0.95;
/// Time in all for which the rules must have allowed fire at the UAV [s].
pub const OPEN_S: f64 = 4.0;
/// A detection of the UAV speaks for this long [s].
pub const LATELY_S: f64 = 0.5;

/// What something is, by truth.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum What {
    /// The UAV.
    Uav,
    /// Something else that flies, by its kind.
    Other(String),
    /// Nothing that flies: buildings, trees, clouds.
    Scenery,
}

impl What {
    /// In a word.
    pub fn name(&self) -> &str {
        match self {
            Self::Uav => "uav",
            Self::Other(kind) => kind,
            Self::Scenery => "scenery",
        }
    }
}

/// Why an engagement failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// No detection lay on the UAV, though it was in view.
    NotDetected,
    /// The detector found the UAV, but its track did not become the target.
    Refused,
    /// The UAV was the target, but the next camera did not take it over: the mount turned to it, or
    /// the coarse camera held it, and no more.
    HandOver,
    /// The UAV had been held and was lost, though the detector went on finding it.
    TrackBroken,
    /// The target was something else, or something else was fired at.
    WrongObject,
    /// The tracker gave the UAV up as none and left it alone.
    DeclaredNoUav,
    /// The lock stood, and an interlock kept the laser from firing.
    Interlock,
    /// The UAV was held precisely or fired at, or the search never came to it: time ran out.
    OutOfTime,
}

impl Cause {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::NotDetected,
        Self::Refused,
        Self::HandOver,
        Self::TrackBroken,
        Self::WrongObject,
        Self::DeclaredNoUav,
        Self::Interlock,
        Self::OutOfTime,
    ];

    /// As figures and pages name it.
    pub fn name(self) -> &'static str {
        match self {
            Self::NotDetected => "not detected",
            Self::Refused => "detected but refused",
            Self::HandOver => "lost in hand-over",
            Self::TrackBroken => "track broken",
            Self::WrongObject => "wrong object",
            Self::DeclaredNoUav => "declared no UAV",
            Self::Interlock => "interlock",
            Self::OutOfTime => "out of time",
        }
    }
}

/// An instant of an engagement.
#[derive(Clone, Debug, PartialEq)]
pub struct Glance {
    /// Whether the UAV is in clear sight and at least [`LEAST_PX`] in the search camera, wherever that looks.
    pub shown: bool,
    /// Whether it has been in the search camera's field while it was shown.
    pub met: bool,
    /// The state of the tracker.
    pub state: TrackingState,
    /// What its target is.
    pub target: Option<What>,
    /// Whether a detection lay on the UAV in the last [`LATELY_S`] in which a camera had it in view.
    pub found: bool,
    /// Whether the coarse camera has held it before.
    pub acquired: bool,
    /// Whether the tracker has given it up as no UAV and not taken it up again.
    pub rejected: bool,
    /// Whether the laser fires.
    pub firing: bool,
    /// Whether an interlock keeps it from firing.
    pub interlocked: bool,
}

/// What the time of an instant is charged to; nothing while the UAV is hidden or too small, or before the
/// search has come to it.
pub fn charge(now: &Glance) -> Option<Cause> {
    if !now.shown || !now.met {
        return None;
    }
    let unseen = if now.acquired {
        Cause::TrackBroken
    } else {
        Cause::Refused
    };
    let unseen = if now.found {
        unseen
    } else {
        Cause::NotDetected
    };
    Some(match (&now.target, now.state) {
        (Some(What::Uav), state) => match state {
            TrackingState::Acquire | TrackingState::Coarse => Cause::HandOver,
            TrackingState::Engage if now.interlocked && !now.firing => Cause::Interlock,
            TrackingState::Precise | TrackingState::Engage => Cause::OutOfTime,
            TrackingState::Search | TrackingState::Lost => unseen,
        },
        (Some(_), _) => Cause::WrongObject,
        (None, _) if now.rejected => Cause::DeclaredNoUav,
        (None, _) => unseen,
    })
}

/// How many frames of a camera had the UAV in view, and in how many a detection lay on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Looks {
    /// Frames that the detector looked at with the UAV in view and in clear sight.
    pub frames: u32,
    /// Those with a detection on it.
    pub found: u32,
    /// Those before it was acquired, where pictures are rendered.
    pub before: u32,
    /// Its mean [signal-to-clutter ratio](crate::models::optics::clutter::signal_to_clutter) in these.
    pub clutter_ratio: f64,
}

impl Looks {
    /// Takes in the signal-to-clutter ratio in a frame before it was acquired.
    pub fn stands_out(&mut self, ratio: f64) {
        self.before += 1;
        self.clutter_ratio += (ratio - self.clutter_ratio) / f64::from(self.before);
    }
}

/// A UAV that was given up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GivenUp {
    /// When [s].
    pub t_s: f64,
    /// Why, in the tracker's words.
    pub reason: String,
    /// Whether the tracker leaves its track alone from then on.
    pub rejected: bool,
}

/// What was believed of a track at one time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Believed {
    /// What it was.
    pub what: What,
    /// What each [`Term`] said, as log-odds, to a hundredth.
    pub terms: [f64; Term::ALL.len()],
}

/// What was seen of an engagement. Times are counted from its start, durations in all [s].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Length.
    pub end_s: f64,
    /// Time for which the UAV was in clear sight and large enough, wherever the cameras looked.
    pub shown_s: f64,
    /// Time for which it was so in the search camera's field.
    pub visible_s: f64,
    /// When it first was.
    pub visible_from_s: Option<f64>,
    /// Mean size while it was shown, in the search and the precise camera: the longer side [px].
    pub size_px: Option<[f64; 2]>,
    /// Least angle between it and anything else that flies while it was shown [deg].
    pub nearest_deg: Option<f64>,
    /// When the coarse camera first held it.
    pub acquired_s: Option<f64>,
    /// When the precise camera first held it.
    pub precise_s: Option<f64>,
    /// When its skin failed.
    pub neutralised_s: Option<f64>,
    /// Whether it flew into something.
    pub crashed: bool,
    /// Time from acquisition on, with the UAV shown.
    pub after_s: f64,
    /// What of it a camera held what.
    pub held_s: BTreeMap<String, f64>,
    /// What the coarse or precise camera held before or after that was something else, and when it began.
    pub acquired_else: Vec<(f64, String)>,
    /// What was fired at, and for how long.
    pub fired_s: BTreeMap<String, f64>,
    /// When the UAV was given up though it was shown.
    pub given_up: Vec<GivenUp>,
    /// How often the target's identity changed.
    pub target_changes: u32,
    /// Most tracks at once.
    pub tracks: usize,
    /// Time for which the rules would have allowed fire at the UAV, by truth: what lies behind it, its
    /// line of sight, the sun.
    pub open_s: f64,
    /// Time with a lock on the UAV, by what kept the laser from firing.
    pub interlocks_s: BTreeMap<String, f64>,
    /// Time by what it is charged to.
    pub charges_s: BTreeMap<Cause, f64>,
    /// Frames of the search, coarse and precise camera.
    pub looks: [Looks; 3],
    /// The tracker's states: when, which, why. Long lists are cut in the middle.
    pub states: Vec<(f64, String, String)>,
    /// What was believed of the tracks from time to time.
    pub beliefs: Vec<Believed>,
}

/// What became of an engagement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Whether it is scored: the UAV was visible for long enough.
    pub visible: bool,
    /// Whether the coarse camera held the UAV.
    pub acquired: bool,
    /// Share of the time from acquisition to the end for which it was held.
    pub held_share: Option<f64>,
    /// Whether the rules allowed fire.
    pub open: bool,
    /// Whether the UAV was neutralised in time.
    pub neutralised: bool,
    /// Whether anything else was fired at.
    pub fired_else: bool,
    /// Whether the UAV was given up though it was shown.
    pub given_up: bool,
    /// Why it failed, if it did.
    pub cause: Option<Cause>,
}

impl Verdict {
    /// Judges a record.
    pub fn of(record: &Record) -> Self {
        let held = |what: &str| record.held_s.get(what).copied().unwrap_or(0.0);
        // What never was large enough to be visible is not scored where it is won either.
        let times_s = record.visible_from_s.zip(record.neutralised_s);
        let neutralised = times_s.is_some_and(|(from_s, t_s)| t_s - from_s <= IN_TIME_S);
        let mut verdict = Self {
            visible: record.visible_s >= VISIBLE_S || neutralised,
            acquired: record.acquired_s.is_some(),
            held_share: (record.after_s > 0.0).then(|| held(What::Uav.name()) / record.after_s),
            open: record.open_s >= OPEN_S || neutralised,
            neutralised,
            fired_else: record.fired_s.keys().any(|what| what != What::Uav.name()),
            given_up: !record.given_up.is_empty(),
            cause: None,
        };
        verdict.cause = verdict.failed(record).then(|| verdict.because(record));
        verdict
    }

    /// Whether the UAV was held for long enough, once it was acquired.
    pub fn held(&self) -> Option<bool> {
        self.held_share.map(|share| share >= HELD_SHARE)
    }

    /// Whether any of the shares that are reported counts it as a failure, or the search never looked at
    /// what it could have seen.
    fn failed(&self, record: &Record) -> bool {
        // What the rules forbade to fire at is no failure for being there at the end.
        let won = self.neutralised || !self.open;
        let scored =
            self.visible && !(self.acquired && self.held() != Some(false) && won && !self.given_up);
        self.fired_else || scored || (!self.visible && record.shown_s >= VISIBLE_S)
    }

    /// The cause to which most time is charged. A shot at something else is always the wrong object; time
    /// on the way to fire is no failure of what was neutralised in time.
    fn because(&self, record: &Record) -> Cause {
        if self.fired_else {
            return Cause::WrongObject;
        }
        let blamed = |cause: &Cause| !(self.neutralised && *cause == Cause::OutOfTime);
        let most = (record.charges_s.iter())
            .filter(|(cause, _)| blamed(cause))
            // The first of equals.
            .rev()
            .max_by(|a, b| a.1.total_cmp(b.1));
        most.map_or(Cause::OutOfTime, |(cause, _)| *cause)
    }
}

/// The band of a size in the search camera.
pub fn size_band(size_px: f64) -> &'static str {
    match size_px {
        px if px < 2.0 => "below 2 px",
        px if px < 4.0 => "2–4 px",
        px if px < 8.0 => "4–8 px",
        px if px < 16.0 => "8–16 px",
        _ => "16 px and more",
    }
}

/// The band of how far it stood out before it was acquired, in whichever of the search and the coarse camera showed it more
/// clearly.
pub fn clutter_band([search, coarse, _]: &[Looks; 3]) -> &'static str {
    if search.before + coarse.before == 0 {
        return "never in a picture";
    }
    match search.clutter_ratio.max(coarse.clutter_ratio) {
        ratio if ratio < 0.5 => "below 0.5",
        ratio if ratio < 1.0 => "0.5–1",
        ratio if ratio < 2.0 => "1–2",
        ratio if ratio < 4.0 => "2–4",
        _ => "4 and more",
    }
}

/// How near something else was, as figures name it.
pub fn nearness_name(nearness: Nearness) -> &'static str {
    match nearness {
        Nearness::None => "none",
        Nearness::Far => "far",
        Nearness::Near => "near",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn glance() -> Glance {
        Glance {
            shown: true,
            met: true,
            state: TrackingState::Search,
            target: None,
            found: false,
            acquired: false,
            rejected: false,
            firing: false,
            interlocked: false,
        }
    }

    #[test]
    fn time_without_the_target_is_charged_by_what_the_detector_found() {
        let charged = |change: fn(&mut Glance)| {
            let mut now = glance();
            change(&mut now);
            charge(&now)
        };
        assert_eq!(charged(|_| {}), Some(Cause::NotDetected));
        assert_eq!(charged(|now| now.acquired = true), Some(Cause::NotDetected));
        assert_eq!(charged(|now| now.found = true), Some(Cause::Refused));
        let broken = |now: &mut Glance| (now.found, now.acquired) = (true, true);
        assert_eq!(charged(broken), Some(Cause::TrackBroken));
        let rejected = |now: &mut Glance| (now.found, now.rejected) = (true, true);
        assert_eq!(charged(rejected), Some(Cause::DeclaredNoUav));
        // What is hidden, too small or not yet come to is nobody's fault.
        assert_eq!(charged(|now| now.shown = false), None);
        assert_eq!(charged(|now| now.met = false), None);
    }

    #[test]
    fn time_with_a_target_is_charged_by_what_it_is_and_how_far_it_got() {
        let on = |state, target: What| Glance {
            state,
            target: Some(target),
            found: true,
            acquired: true,
            ..glance()
        };
        let uav = |state| on(state, What::Uav);
        for (state, cause) in [
            (TrackingState::Acquire, Cause::HandOver),
            (TrackingState::Coarse, Cause::HandOver),
            (TrackingState::Precise, Cause::OutOfTime),
            (TrackingState::Engage, Cause::OutOfTime),
            (TrackingState::Lost, Cause::TrackBroken),
        ] {
            assert_eq!(charge(&uav(state)), Some(cause), "{state:?}");
            for what in [What::Other("bird".into()), What::Scenery] {
                assert_eq!(charge(&on(state, what)), Some(Cause::WrongObject));
            }
        }
        let unseen = Glance {
            found: false,
            ..uav(TrackingState::Lost)
        };
        assert_eq!(charge(&unseen), Some(Cause::NotDetected));
        let locked = Glance {
            interlocked: true,
            ..uav(TrackingState::Engage)
        };
        assert_eq!(charge(&locked), Some(Cause::Interlock));
        // It still fires by the last tick's command.
        let firing = Glance {
            firing: true,
            ..locked
        };
        assert_eq!(charge(&firing), Some(Cause::OutOfTime));
    }

    #[test]
    fn the_clearer_camera_says_how_far_it_stood_out() {
        let seen = |ratios: &[f64]| {
            let mut looks = Looks::default();
            ratios.iter().for_each(|ratio| looks.stands_out(*ratio));
            looks
        };
        let band = |search, coarse| clutter_band(&[seen(search), seen(coarse), seen(&[9.0])]);
        assert_eq!(band(&[], &[]), "never in a picture");
        assert_eq!(band(&[0.2, 0.6], &[]), "below 0.5");
        assert_eq!(band(&[0.2, 0.6], &[1.0, 2.0, 1.5]), "1–2");
        assert_eq!(band(&[5.0, 3.0], &[0.9]), "4 and more");
    }

    /// Acquired after a second, neutralised after five.
    fn won() -> Record {
        Record {
            end_s: 5.0,
            shown_s: 5.0,
            visible_s: 5.0,
            visible_from_s: Some(0.0),
            acquired_s: Some(1.0),
            neutralised_s: Some(5.0),
            after_s: 4.0,
            held_s: BTreeMap::from([("uav".into(), 3.9)]),
            fired_s: BTreeMap::from([("uav".into(), 2.0)]),
            open_s: 5.0,
            charges_s: BTreeMap::from([(Cause::HandOver, 0.5), (Cause::OutOfTime, 3.5)]),
            ..Record::default()
        }
    }

    #[test]
    fn a_won_engagement_has_no_cause() {
        let verdict = Verdict::of(&won());
        assert!(verdict.visible && verdict.acquired && verdict.open && verdict.neutralised);
        assert_eq!((verdict.held(), verdict.cause), (Some(true), None));
        assert!(!verdict.fired_else && !verdict.given_up);
        // One that was always too small to be visible counts neither way.
        let small = Record {
            shown_s: 0.0,
            visible_s: 0.0,
            visible_from_s: None,
            open_s: 0.0,
            ..won()
        };
        let verdict = Verdict::of(&small);
        assert!(!verdict.visible && !verdict.neutralised);
        assert_eq!(verdict.cause, None);
    }

    #[test]
    fn each_shortfall_fails_an_engagement_for_one_cause() {
        let cause = |change: fn(&mut Record)| {
            let mut record = won();
            change(&mut record);
            Verdict::of(&record).cause
        };
        // Too late, and in time.
        assert_eq!(
            cause(|r| r.neutralised_s = Some(20.1)),
            Some(Cause::OutOfTime)
        );
        assert_eq!(cause(|r| r.neutralised_s = Some(20.0)), None);
        assert_eq!(cause(|r| r.neutralised_s = None), Some(Cause::OutOfTime));
        assert_eq!(
            cause(|r| {
                r.neutralised_s = None;
                r.charges_s.insert(Cause::Interlock, 10.0);
            }),
            Some(Cause::Interlock)
        );
        // Neutralised in time, but the hold was poor: not for want of time.
        assert_eq!(
            cause(|r| {
                r.held_s.insert("uav".into(), 3.0);
                r.charges_s.insert(Cause::TrackBroken, 0.9);
            }),
            Some(Cause::TrackBroken)
        );
        // Held, where the rules never allowed fire.
        assert_eq!(
            cause(|r| {
                (r.neutralised_s, r.open_s) = (None, 3.9);
                r.charges_s.insert(Cause::Interlock, 10.0);
            }),
            None
        );
        let given_up = |r: &mut Record| {
            r.given_up.push(GivenUp {
                t_s: 2.0,
                reason: "no UAV".into(),
                rejected: true,
            });
        };
        assert_eq!(cause(given_up), Some(Cause::HandOver));
        // A shot at a bird outweighs all.
        assert_eq!(
            cause(|r| {
                r.fired_s.insert("bird".into(), 0.01);
            }),
            Some(Cause::WrongObject)
        );
        // Not scored, but the search might have looked.
        let unseen = |r: &mut Record| {
            *r = Record {
                shown_s: 5.0,
                ..Record::default()
            };
        };
        assert_eq!(cause(unseen), Some(Cause::OutOfTime));
        // Never large enough, or hidden: nothing to fail at.
        assert_eq!(cause(|r| *r = Record::default()), None);
        // Of equals, the first.
        assert_eq!(
            cause(|r| {
                r.neutralised_s = None;
                r.charges_s = BTreeMap::from([(Cause::Refused, 2.0), (Cause::HandOver, 2.0)]);
            }),
            Some(Cause::Refused)
        );
    }
}
