//! Detections on their way and what the tracker makes of them.

use crate::components::capture::{PixelRect, Tier};
use crate::components::mount::Pointing;
use crate::models::maths::kinematics::wrap_pi;
use crate::models::optics::detection::Detection;
use crate::models::tracking::estimation::LosState;
use crate::models::tracking::table::{JoinedTrack, Track, TrackTable};
use bevy::prelude::*;
use glam::DVec2;
use std::collections::VecDeque;

/// The detections of one frame.
#[derive(Clone, Debug)]
pub struct DetectionBatch {
    /// The camera.
    pub tier: Tier,
    /// Tick of the exposure.
    pub exposure_tick: u64,
    /// First tick in which the tracker may see them.
    pub available_tick: u64,
    /// The station's pointing at the exposure, as it knew it.
    pub pointing: Pointing,
    /// The pixels in which the detector looked.
    pub rect: PixelRect,
    /// Detections above the threshold, in full-sensor pixels.
    pub detections: Vec<Detection>,
}

impl DetectionBatch {
    /// What tells it from others.
    pub fn key(&self) -> (u64, Tier) {
        (self.exposure_tick, self.tier)
    }
}

/// Batches that wait out their latency.
#[derive(Resource, Default, Debug)]
pub struct DetectionQueue {
    /// Ordered by (available tick, exposure tick, tier).
    pub waiting: VecDeque<DetectionBatch>,
    /// Keys of those whose detections are not known yet, in the order in which the detector got
    /// their frames.
    pub pending: VecDeque<(u64, Tier)>,
    /// The batches that arrived in this tick.
    pub arrived: Vec<DetectionBatch>,
}

impl DetectionQueue {
    /// Queues a batch at its place.
    pub fn push(&mut self, batch: DetectionBatch) {
        let key = |b: &DetectionBatch| (b.available_tick, b.exposure_tick, b.tier);
        let at = self.waiting.partition_point(|b| key(b) <= key(&batch));
        self.waiting.insert(at, batch);
    }

    /// Whether a batch that is available at `tick` still lacks its detections.
    pub fn wants_answer(&self, tick: u64) -> bool {
        (self.waiting.iter())
            .take_while(|batch| batch.available_tick <= tick)
            .any(|batch| self.pending.contains(&batch.key()))
    }

    /// Puts the detector's next answer, in pixels of the part that it looked at, into its batch.
    pub fn answered(&mut self, found: Vec<Detection>) {
        let Some(key) = self.pending.pop_front() else {
            return;
        };
        if let Some(batch) = self.waiting.iter_mut().find(|batch| batch.key() == key) {
            let offset_px = batch.rect.offset_px;
            batch.detections = found.iter().map(|d| d.shifted(offset_px)).collect();
        }
    }

    /// Moves what is available at `tick` to `arrived`.
    pub fn release(&mut self, tick: u64) {
        self.arrived.clear();
        while self
            .waiting
            .front()
            .is_some_and(|batch| batch.available_tick <= tick)
        {
            self.arrived.extend(self.waiting.pop_front());
        }
    }
}

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
}

/// A step of the state machine.
#[derive(Clone, Debug, PartialEq)]
pub struct StateChange {
    /// When.
    pub tick: u64,
    /// To which state.
    pub to: TrackingState,
    /// Why.
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
    /// Distance [px].
    pub distance_px: f64,
    /// Half of the smaller side of the target's box [px].
    pub half_side_px: f64,
}

/// What an operator orders.
#[derive(Clone, Debug, PartialEq)]
pub struct Order {
    /// When.
    pub tick: u64,
    /// The UAV that is pointed at, by its scenario index; `None` leaves the choice to the tracker.
    pub designate: Option<usize>,
}

/// The operator's orders, in order of time, and those that wait for a track to hold on to.
#[derive(Resource, Clone, Debug, Default)]
pub struct Operator {
    /// All orders.
    pub orders: Vec<Order>,
    /// The first that has not been carried out.
    pub next: usize,
}

/// The tracker: table, state machine, what it knows of its target.
#[derive(Resource, Clone, Debug)]
pub struct Tracker {
    /// All tracks.
    pub table: TrackTable,
    /// Present state.
    pub state: TrackingState,
    /// Tick of the last change.
    pub since_tick: u64,
    /// Identity of the target's track.
    pub target: Option<u32>,
    /// Tracks that turned out to be no target, and since when.
    pub rejected: Vec<(u32, u64)>,
    /// Hits of the target by each camera since the last change of state.
    pub hits_in_state: [u32; 3],
    /// Last measured error of the target from each camera's boresight.
    pub error: [Option<BoresightError>; 3],
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
    /// How fast the target lost height when the laser was first fired at it [m/s].
    pub sink_at_fire_mps: Option<f64>,
    /// Since when the target, fired at, has been falling.
    pub falling_since: Option<u64>,
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
            rejected: Vec::new(),
            hits_in_state: [0; 3],
            error: [None; 3],
            locked_since: None,
            range_m: None,
            aim_rad: DVec2::ZERO,
            designated: false,
            rival: None,
            lased: false,
            sink_at_fire_mps: None,
            falling_since: None,
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
        self.hits_in_state = [0; 3];
        if !matches!(to, TrackingState::Precise | TrackingState::Engage) {
            self.locked_since = None;
        }
        self.changes.push(StateChange {
            tick,
            to,
            reason: reason.into(),
        });
    }

    /// Takes up a target and turns to it.
    pub fn acquire(&mut self, tick: u64, id: u32, reason: impl Into<String>) {
        self.target = Some(id);
        self.rejected.retain(|(rejected, _)| *rejected != id);
        self.forget();
        self.change(tick, TrackingState::Acquire, reason);
    }

    /// Gives the target up; `reject` keeps its track from becoming the target again.
    pub fn give_up(&mut self, tick: u64, reject: bool, reason: impl Into<String>) {
        let target = self.target.take();
        if reject {
            self.rejected.extend(target.map(|id| (id, tick)));
        }
        self.designated = false;
        self.forget();
        self.change(tick, TrackingState::Search, reason);
    }

    /// Forgets what was known of the former target.
    fn forget(&mut self) {
        self.error = [None; 3];
        self.range_m = None;
        self.aim_rad = DVec2::ZERO;
        self.rival = None;
        self.lased = false;
        self.sink_at_fire_mps = None;
        self.falling_since = None;
    }

    /// Takes over the identities that the table has joined to older ones.
    pub fn follow_joined(&mut self) {
        for JoinedTrack { young, old } in &self.table.joined {
            let rename = |id: &mut u32| {
                if id == young {
                    *id = *old;
                }
            };
            // The young track has been judged on its own: what was held against the old is over.
            self.rejected.retain(|(id, _)| id != old);
            self.target.iter_mut().for_each(rename);
            self.rival.iter_mut().for_each(|(id, _)| rename(id));
            self.rejected.iter_mut().for_each(|(id, _)| rename(id));
        }
    }

    /// The line of sight to the part aimed at, predicted for `t_s`.
    pub fn aim_los(&self, t_s: f64) -> Option<LosState> {
        let mut los = self.target_track()?.filter.predicted(t_s);
        los.az_rad = wrap_pi(los.az_rad + self.aim_rad.x / los.el_rad.cos().max(0.05));
        los.el_rad += self.aim_rad.y;
        Some(los)
    }

    /// The target's track.
    pub fn target_track(&self) -> Option<&Track> {
        self.target.and_then(|id| self.table.get(id))
    }
}
