//! What the defence wants of one of its stations.

use crate::tracking::cartesian::{CartesianTrack, TargetCue};
use crate::tracking::picture::Follower;
use glam::{DVec2, DVec3};
use std::collections::BTreeSet;

/// An object that a station is to follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Task {
    /// The object.
    pub identity: Follower,
    /// Whether it is to engage it, or only to watch it for the station that does.
    pub engages: bool,
    /// The object's number in the station's own track table.
    pub track: Option<u32>,
    /// Where it is.
    pub object: CartesianTrack,
}

/// Which object a station is to follow, and what comes next.
#[derive(Clone, Debug, Default)]
pub struct Tasking {
    /// The object; `None` without one.
    pub task: Option<Task>,
    /// Numbers of its tracks that are other stations' business, or nobody's yet.
    pub spared: BTreeSet<u32>,
    /// Which object each station is assigned to engage, as this one sees it.
    pub assigned: Vec<Option<Follower>>,
    /// The objects that wait, the most pressing first.
    pub queue: Vec<Follower>,
}

impl Tasking {
    /// Where the station at `r_station_enu_m` [m] finds its object at `t_s` [s].
    pub fn cue(&self, r_station_enu_m: DVec3, t_s: f64) -> Option<TargetCue> {
        /// The straight flight that is assumed errs by this much [m].
        const STRAYS_M: f64 = 2.0;
        let task = self.task.as_ref()?;
        let mut cue = task.object.cue(r_station_enu_m, t_s);
        cue.sigma_rad = cue.sigma_rad.max(DVec2::splat(STRAYS_M / cue.range_m));
        Some(cue)
    }

    /// Whether a track may be fired at: it is no other station's.
    pub fn permits(&self, track: u32) -> bool {
        let watched = |task: &Task| task.track == Some(track) && !task.engages;
        !self.spared.contains(&track) && !self.task.as_ref().is_some_and(watched)
    }
}
