//! How the members of a swarm fly: their goal, speed and distances, how low, and what they do in a beam.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a UAV does while a beam heats it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Evasion {
    /// Pulls to one side and the other.
    Jink,
    /// Goes down to a tenth of its height, 10 m at least.
    Dive,
    /// Goes away from its mates, to four times the distance.
    Spread,
}

/// A low approach behind buildings, and the rise at its end.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PopUp {
    /// Distance from the goal, on the map, at which a member rises [m].
    pub at_m: f64,
    /// Height over what is below until then [m]. A flock also goes where it is lowest, around high buildings.
    #[serde(default = "default_low_m")]
    pub low_m: f64,
}

fn default_low_m() -> f64 {
    6.0 // [m]
}

/// How the members of a swarm fly.
#[derive(Clone, Debug, PartialEq)]
pub struct Behaviour {
    /// Where it flies to [m].
    pub goal_enu_m: DVec3,
    /// Its speed [m/s].
    pub speed_mps: f64,
    /// Distance that members keep from each other [m].
    pub separation_m: f64,
    /// Whether they keep their slots; otherwise they flock.
    pub keeps_formation: bool,
    /// Height over what is below and ahead [m]; `None` keeps to the straight way.
    pub above_ground_m: Option<f64>,
    /// How it approaches low; `None` does not.
    pub pop_up: Option<PopUp>,
    /// What they do in a beam.
    pub evasion: Vec<Evasion>,
}

/// Most acceleration of a member [m/s²]: a multirotor leans by 30° for it.
pub const MOST_MPS2: f64 = 5.5;
/// Time in which a member turns to the velocity that it wants [s], and makes up for an error of its place [s].
pub(super) const TURN_S: f64 = 0.6;
pub(super) const PLACE_S: f64 = 2.0;

impl Behaviour {
    /// How far a member looks for mates [m].
    pub fn reach_m(&self) -> f64 {
        4.0 * self.separation_m
    }
}
