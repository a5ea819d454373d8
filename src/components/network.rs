//! The stations' network: the link, each station's picture of all objects, who takes which.

use crate::components::record::TopicOf;
use crate::models::decision::tasking;
use crate::models::engage::allocation::{AllocationRule, Offer};
use crate::models::maths::rng::Stream;
use crate::models::tracking::picture::{Fix, Follower, OwnFrame, Picture};
use bevy::prelude::*;
use schemars::JsonSchema;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

/// How the stations of a run are linked; absent where they are not.
#[derive(Resource, Clone, Copy, Debug)]
pub struct Network {
    /// Reports a second of every station.
    pub rate_hz: u32,
    /// Ticks from a report to its arrival.
    pub latency_ticks: u64,
    /// Share of the reports that are lost, at each receiver.
    pub loss: f64,
    /// A station whose last report is older is not counted on.
    pub silent_ticks: u64,
    /// For how long measurements wait for others of the same time [s]: all stations take them in in one order.
    pub hold_s: f64,
    /// How targets are assigned.
    pub rule: AllocationRule,
    /// Another target must be cheaper by this factor.
    pub hysteresis: f64,
    /// Where the pictures are recorded.
    pub topic: TopicOf<NetworkState>,
}

/// A station's picture and its task, as they are recorded.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct NetworkState {
    /// The station.
    pub station: String,
    /// The object that it follows, if it has one.
    pub task: Option<String>,
    /// Whether it is to engage that, or only to watch it.
    pub engages: bool,
    /// Objects that wait, the most pressing first.
    pub queue: Vec<String>,
    /// All objects that it knows of.
    pub objects: Vec<ObjectState>,
}

/// An object of a station's picture, as it is recorded.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct ObjectState {
    /// Its identity.
    pub identity: String,
    /// Position [m] and velocity [m/s], east, north, up.
    pub r_enu_m: [f64; 3],
    pub v_enu_mps: [f64; 3],
    /// Standard deviation of the position, root of the sum over the axes [m].
    pub sigma_m: f64,
    /// Log-odds that it is a UAV.
    pub log_odds: f64,
    /// Tracks of stations that follow it.
    pub followers: Vec<String>,
    /// A station saw it fall.
    pub dealt_with: bool,
}

/// What a station says of a track.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackReport {
    /// The track.
    pub follower: Follower,
    /// What the station calls the object.
    pub identity: Option<Follower>,
    /// Measurements since the last report.
    pub fixes: Vec<Fix>,
    /// Log-odds that it is a UAV.
    pub log_odds: f64,
    /// It was fired at and falls.
    pub fell: bool,
}

/// What a station sends to all.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// The station's number.
    pub station: usize,
    /// When it was sent.
    pub tick: u64,
    /// Its tracks.
    pub tracks: Vec<TrackReport>,
    /// What it offers for each object.
    pub offers: BTreeMap<Follower, Offer>,
}

/// A station's end of the link.
#[derive(Component, Clone, Debug)]
pub struct Link {
    /// Reports on their way to it, with the tick of their arrival.
    pub inbox: VecDeque<(u64, Arc<Report>)>,
    /// Which of them are lost.
    pub rng: Stream,
    /// Measurements that wait for others of the same time.
    pub waiting: Vec<Fix>,
    /// The last report of each station that has arrived.
    pub latest: BTreeMap<usize, Arc<Report>>,
    /// When the last measurement of each of its tracks was made that it sent [s]: of direction or position, of range.
    pub sent_s: BTreeMap<Follower, [f64; 2]>,
    /// Its last offers.
    pub offers: BTreeMap<Follower, Offer>,
}

/// The frame and the clock in which a station speaks to others.
#[derive(Component, Clone, Copy, Debug, Deref)]
pub struct Surveyed(pub OwnFrame);

/// All that a station knows of the objects about.
#[derive(Component, Clone, Debug, Default, Deref, DerefMut)]
pub struct SharedPicture(pub Picture);

pub use crate::models::decision::tasking::Task;

/// Which object a station is to follow, and what comes next.
#[derive(Component, Clone, Debug, Default, Deref, DerefMut)]
pub struct Tasking(pub tasking::Tasking);

/// How long the stations have held an object.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Holding {
    /// When it was first in a picture, and last seen by a camera of a station [s].
    pub from_s: f64,
    pub to_s: f64,
    /// Longest time between two exposures that showed it, of whatever station [s].
    pub longest_gap_s: f64,
    /// The stations whose cameras followed it.
    pub stations: BTreeSet<usize>,
    /// Who was assigned to engage it, one after the other: (time [s], station).
    pub engaged_by: Vec<(f64, usize)>,
}

/// What became of the objects, for summary and report.
#[derive(Resource, Clone, Debug, Default)]
pub struct Holdings(pub BTreeMap<Follower, Holding>);
