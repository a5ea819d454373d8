//! Who follows what, and what it measures: followers and their fixes.

use crate::tracking::cartesian::Bearing;
use glam::DVec3;
use nalgebra::Matrix3;

/// What of a station follows an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Sensor {
    /// Its cameras and range finder: a track of its table.
    Cameras,
    /// Its radar.
    Radar,
}

/// A station's track of one thing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Follower {
    /// The station's number.
    pub station: usize,
    /// What follows.
    pub sensor: Sensor,
    /// Its own number of the track.
    pub number: u32,
}

impl Follower {
    /// Its name, that of its station given.
    pub fn named(&self, station: &str) -> String {
        match self.sensor {
            Sensor::Cameras => format!("{station}/{}", self.number),
            Sensor::Radar => format!("{station}/radar {}", self.number),
        }
    }
}

/// What a follower measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Measured {
    /// A direction.
    Bearing(Bearing),
    /// A position [m] and its covariance [m²].
    Position(DVec3, Matrix3<f64>),
    /// A range from a place [m], with its standard deviation [m].
    Range(DVec3, f64, f64),
}

/// A measurement of a follower.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// Whose.
    pub follower: Follower,
    /// When it was measured [s].
    pub t_s: f64,
    /// What was measured.
    pub measured: Measured,
}
