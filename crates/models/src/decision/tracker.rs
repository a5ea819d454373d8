//! What a tracker knows and where its engagement stands.

use super::belief::Belief;
use super::tuning::TrackerTuning;
use crate::flight::uav::AimPart;
use crate::maths::kinematics::wrap_pi;
use crate::optics::tier::{PerTier, Tier};
use crate::tracking::estimation::LosState;
use crate::tracking::evidence::{EvidenceParams, probability};
use crate::tracking::table::{JoinedTrack, Track, TrackTable};
use glam::{DQuat, DVec2, DVec3};
use std::collections::BTreeMap;

/// Stages of an engagement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrackingState {
    /// The search camera scans its sector.
    Search,
    /// The mount turns to a candidate; the coarse camera is to confirm it.
    Acquire,
    /// The coarse camera holds the target.
    Coarse,
    /// The precise camera holds it.
    Precise,
    /// As precise, and steady enough to fire.
    Engage,
    /// No camera sees it; its track is extrapolated.
    Lost,
}

impl TrackingState {
    /// The state as recordings and reports name it.
    pub fn name(self) -> &'static str {
        match self {
            TrackingState::Search => "search",
            TrackingState::Acquire => "acquire",
            TrackingState::Coarse => "coarse",
            TrackingState::Precise => "precise",
            TrackingState::Engage => "engage",
            TrackingState::Lost => "lost",
        }
    }

    /// Whether the target is acquired: a camera holds it, the coarse or the precise one.
    pub fn acquired(self) -> bool {
        self.holds(Tier::Coarse) || self.holds(Tier::Precise)
    }

    /// Whether a camera of `tier` holds the target in this state.
    pub fn holds(self, tier: Tier) -> bool {
        match tier {
            Tier::Search => false,
            Tier::Coarse => matches!(self, Self::Coarse | Self::Precise | Self::Engage),
            Tier::Precise => matches!(self, Self::Precise | Self::Engage),
        }
    }
}

/// A step of the state machine.
#[derive(Clone, Debug, PartialEq)]
pub struct StateChange {
    /// Tick of the change.
    pub tick: u64,
    /// The state entered.
    pub to: TrackingState,
    /// Reason, as the log shows it.
    pub reason: String,
}

/// A measured error of the target from a camera's boresight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoresightError {
    /// Tick of the exposure.
    pub exposure_tick: u64,
    /// First tick in which the tracker knew it.
    pub available_tick: u64,
    /// Right and down, by the controller's pixel-to-angle map [rad].
    pub angle_rad: DVec2,
    /// Right and down in the picture [px].
    pub offset_px: DVec2,
    /// Half of the smaller side of the target's box [px].
    pub half_side_px: f64,
}

/// How detections become tracks, and tracks targets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerParams {
    /// The paper's rule: whatever the detector sees nearest to the image centre is the target.
    /// Otherwise identity comes from the track table.
    pub nearest_to_centre: bool,
    /// The linear map of eq. 8 from pixels to angles, for the paper's control laws.
    pub linear_angles: bool,
    /// Standard deviation of a detection's centre that the station counts on [px].
    pub centre_sigma_px: f64,
    /// What a larger box adds to that, as a share of its side.
    pub centre_sigma_rel: f64,
    /// Detections of a lower score go on with a track but start none.
    pub start_score: f64,
    /// How the detector's answers are read.
    pub reads: EvidenceParams,
    /// The smaller field of view of the precise camera [rad].
    pub precise_field_rad: f64,
    /// Another track must be nearer to the asset in time by this factor to become the target.
    pub switch_ratio: f64,
    /// What is protected [m].
    pub r_asset_enu_m: DVec3,
    /// Least rate on the sky that counts as flight [rad/s].
    pub moving_radps: f64,
    /// Whether clear sky is behind everything where no height raster says what is.
    pub open_sky: bool,
    /// The part aimed at, for a detector that boxes the whole UAV; `None` for one that boxes the
    /// part itself.
    pub aim: Option<AimPart>,
    /// Precise errors up to this count as locked [px].
    pub lock_radius_px: f64,
    /// How long the lock must hold before the state is Engage [s].
    pub lock_dwell_s: f64,
    /// A precise error beyond this ends Engage [px].
    pub break_radius_px: f64,
    /// Probability of a UAV from which on a target may be fired at.
    pub min_uav_probability: f64,
    /// Size from which on a target is too large for a UAV [m].
    pub max_span_m: f64,
    /// Time without a hit after which a camera, by tier, has lost the target [s]: [`patience_s`].
    pub patience_s: PerTier<f64>,
    /// What decisions are tuned by.
    pub tuning: TrackerTuning,
}

/// The tracker: table, state machine, what it knows of its target.
#[derive(Clone, Debug)]
pub struct Tracker {
    /// Tracks of everything that the cameras report.
    pub table: TrackTable,
    /// State of the engagement after this tick.
    pub state: TrackingState,
    /// Tick of the last change.
    pub since_tick: u64,
    /// Identity of the target's track.
    pub target: Option<u32>,
    /// The tracks that would be next, the most pressing first.
    pub queue: Vec<u32>,
    /// When the tracks' conduct was last judged.
    pub weighed_tick: u64,
    /// Hits of the target by each camera since the last change of state.
    pub hits_in_state: PerTier<u32>,
    /// Last measured error of the target from each camera's boresight.
    pub error: PerTier<Option<BoresightError>>,
    /// Since when the precise error has stayed inside the lock radius.
    pub locked_since: Option<u64>,
    /// Range of the target, once it is known well enough to focus at [m].
    pub range_m: Option<f64>,
    /// Where the part aimed at is, from the middle of the target's picture: right (x) and up (y) on
    /// the sky [rad].
    pub aim_rad: DVec2,
    /// The target was designated by an operator: nothing else takes its place.
    pub designated: bool,
    /// Since when another track has been the greater threat, and which.
    pub rival: Option<(u32, u64)>,
    /// Whether the range finder had an echo of the target.
    pub lased: bool,
    /// For how many ticks the laser has been fired at the target.
    pub fired_ticks: u64,
    /// How fast the target lost height when the laser was first fired at it [m/s].
    pub sink_at_fire_mps: Option<f64>,
    /// Since when the target, fired at, has been falling.
    pub falling_since: Option<u64>,
    /// The last precise error's exposure, and the mean of the last ones, right and down [px].
    pub settling: Option<(u64, DVec2)>,
    /// Each camera's last exposure, by its number: when [s], and how the station believed it to be turned.
    pub turned: BTreeMap<usize, (f64, DQuat)>,
    /// What speaks for each track's being a UAV, by its identity, once it has been weighed.
    pub beliefs: BTreeMap<u32, Belief>,
    /// How far the target has used up what it was worth holding without being sure of it: given up at 1.
    pub doubt: f64,
    /// For how long it has been held so [s]: given up once that is more than it is worth now.
    pub unsure_s: f64,
    /// When both were last weighed.
    pub doubt_tick: u64,
    /// The target's log-odds by the recogniser since it was chosen, evened out over half a second from even odds on.
    pub mean_log_odds: f64,
    /// What the radar adds to the log-odds of the target for fire, or takes from them.
    pub radar_log_odds: f64,
    /// Every change so far.
    pub changes: Vec<StateChange>,
}

impl Default for Tracker {
    fn default() -> Self {
        Self {
            table: TrackTable::default(),
            state: TrackingState::Search,
            since_tick: 0,
            target: None,
            queue: Vec::new(),
            weighed_tick: 0,
            hits_in_state: PerTier::default(),
            error: PerTier::default(),
            locked_since: None,
            range_m: None,
            aim_rad: DVec2::ZERO,
            designated: false,
            rival: None,
            lased: false,
            fired_ticks: 0,
            sink_at_fire_mps: None,
            falling_since: None,
            settling: None,
            turned: BTreeMap::new(),
            beliefs: BTreeMap::new(),
            doubt: 0.0,
            unsure_s: 0.0,
            doubt_tick: 0,
            mean_log_odds: 0.0,
            radar_log_odds: 0.0,
            changes: vec![StateChange {
                tick: 0,
                to: TrackingState::Search,
                reason: "start".into(),
            }],
        }
    }
}

impl Tracker {
    /// Changes state and logs why.
    pub fn change(&mut self, tick: u64, to: TrackingState, reason: impl Into<String>) {
        self.state = to;
        self.since_tick = tick;
        self.hits_in_state = PerTier::default();
        if !matches!(to, TrackingState::Precise | TrackingState::Engage) {
            self.locked_since = None;
            self.settling = None;
        }
        self.changes.push(StateChange {
            tick,
            to,
            reason: reason.into(),
        });
    }

    /// The state after `tick`, which must not lie ahead.
    pub fn state_at(&self, tick: u64) -> TrackingState {
        let earlier = self.changes.iter().rev().find(|change| change.tick <= tick);
        earlier.map_or(self.state, |change| change.to)
    }

    /// Takes up a target and turns to it.
    pub fn acquire(&mut self, tick: u64, id: u32, reason: impl Into<String>) {
        self.target = Some(id);
        self.forget();
        self.doubt_tick = tick;
        self.change(tick, TrackingState::Acquire, reason);
    }

    /// Gives the target up; its track is no target again until `bar_until_s` [s], if there is one.
    pub fn give_up(&mut self, tick: u64, bar_until_s: Option<f64>, reason: impl Into<String>) {
        let target = self.target.take();
        if let (Some(until_s), Some(track)) =
            (bar_until_s, target.and_then(|id| self.table.get_mut(id)))
        {
            track.barred_until_s = until_s;
        }
        self.designated = false;
        self.forget();
        self.change(tick, TrackingState::Search, reason);
    }

    /// Forgets what was known of the former target.
    fn forget(&mut self) {
        self.error = PerTier::default();
        self.range_m = None;
        self.aim_rad = DVec2::ZERO;
        self.rival = None;
        self.lased = false;
        self.fired_ticks = 0;
        self.sink_at_fire_mps = None;
        self.falling_since = None;
        self.forget_doubt();
        self.mean_log_odds = 0.0;
        self.radar_log_odds = 0.0;
    }

    /// The target is beyond doubt.
    pub fn forget_doubt(&mut self) {
        (self.doubt, self.unsure_s) = (0.0, 0.0);
    }

    /// Takes over the identities that the table has joined to older ones.
    pub fn follow_joined(&mut self) {
        for JoinedTrack { young, old } in &self.table.joined {
            let rename = |id: &mut u32| {
                if id == young {
                    *id = *old;
                }
            };
            self.target.iter_mut().for_each(rename);
            self.rival.iter_mut().for_each(|(id, _)| rename(id));
        }
    }

    /// The line of sight to the part aimed at, predicted for `t_s`.
    pub fn aim_los(&self, t_s: f64) -> Option<LosState> {
        let mut los = self.target_track()?.filter.predicted(t_s);
        los.az_rad = wrap_pi(los.az_rad + self.aim_rad.x / los.el_rad.cos().max(0.05));
        los.el_rad += self.aim_rad.y;
        Some(los)
    }

    /// Log-odds that the target is a UAV, by what the cameras saw of it: the recogniser must have been sure for some time, for
    /// of many birds one looks like a UAV for a moment. What is plain and mostly named no UAV is no likelier than not; so is what
    /// something has passed, until it is recognised anew.
    pub fn lately_log_odds(&self) -> Option<f64> {
        let track = self.target_track()?;
        let now = track.log_odds();
        Some(match track.recognition {
            Some(_) if track.evidence.is_named_none() => now.min(0.0),
            Some(_) => now.min(self.mean_log_odds),
            None if track.passed_s.is_some() => now.min(0.0),
            None => now,
        })
    }

    /// Probability that the target is a UAV, as far as fire is concerned: what the radar sees of it counts as well.
    pub fn target_uav_probability(&self) -> Option<f64> {
        let log_odds = self.lately_log_odds()? + self.radar_log_odds;
        Some(probability(log_odds))
    }

    /// What speaks for the target's being a UAV, once it has been weighed.
    pub fn target_belief(&self) -> Option<Belief> {
        self.target.and_then(|id| self.beliefs.get(&id)).copied()
    }

    /// The target's track.
    pub fn target_track(&self) -> Option<&Track> {
        self.target.and_then(|id| self.table.get(id))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_state_at_a_tick_is_that_of_its_last_change() {
        let mut tracker = Tracker::default();
        tracker.acquire(100, 1, "test");
        tracker.change(250, TrackingState::Coarse, "test");
        tracker.change(250, TrackingState::Precise, "test");
        for (tick, state) in [
            (0, TrackingState::Search),
            (99, TrackingState::Search),
            (100, TrackingState::Acquire),
            (250, TrackingState::Precise),
            (900, TrackingState::Precise),
        ] {
            assert_eq!(tracker.state_at(tick), state, "{tick}");
        }
    }

    #[test]
    fn acquired_is_what_a_camera_holds_whichever() {
        let held = [
            (TrackingState::Search, false),
            (TrackingState::Acquire, false),
            (TrackingState::Coarse, true),
            (TrackingState::Precise, true),
            (TrackingState::Engage, true),
            (TrackingState::Lost, false),
        ];
        for (state, acquired) in held {
            assert_eq!(state.acquired(), acquired, "{}", state.name());
        }
    }
}
