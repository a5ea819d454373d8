//! An object of the picture: its estimate, who follows it, and the fixes that it takes in.

use super::fix::{Fix, Follower, Measured, Sensor};
use crate::tracking::cartesian::CartesianTrack;
use std::collections::BTreeMap;

/// What is known of an object's follower.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Followed {
    /// Time of its last fix that fitted [s].
    pub last_s: f64,
    /// Fixes in a row that did not.
    pub(super) misfits: u32,
    /// Log-odds that it is a UAV, as the station last judged.
    pub log_odds: f64,
}

/// An object of the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct SharedObject {
    /// Its name among the stations.
    pub identity: Follower,
    /// Where it is and how it moves.
    pub track: CartesianTrack,
    /// Who follows it.
    pub followers: BTreeMap<Follower, Followed>,
    /// A station saw it fall.
    pub dealt_with: bool,
}

/// Squared distance beyond which a fix does not fit the object that its follower follows (five deviations).
const GATE: f64 = 25.0;
/// Fixes in a row that end that.
const MISFITS: u32 = 3;

impl SharedObject {
    /// Log-odds that it is a UAV: what the stations' cameras say, each of which sees it from its own side.
    pub fn log_odds(&self) -> f64 {
        const MOST: f64 = 5.0;
        let cameras = self.of(Sensor::Cameras);
        cameras
            .map(|(_, followed)| followed.log_odds.clamp(-MOST, MOST))
            .sum()
    }

    /// Its followers of a kind.
    fn of(&self, sensor: Sensor) -> impl Iterator<Item = (&Follower, &Followed)> {
        (self.followers.iter()).filter(move |(follower, _)| follower.sensor == sensor)
    }

    /// The number that a station's track table has for it.
    pub fn number_at(&self, station: usize) -> Option<u32> {
        let mut own = self
            .of(Sensor::Cameras)
            .filter(|(f, _)| f.station == station);
        // The latest, where a track has taken another's place.
        let first = own.next()?;
        let latest = own.fold(first, |a, b| if b.1.last_s > a.1.last_s { b } else { a });
        Some(latest.0.number)
    }

    /// Squared distance of a fix from where the object is expected.
    pub(super) fn distance2(&self, fix: &Fix) -> f64 {
        match &fix.measured {
            Measured::Bearing(bearing) => self.track.bearing_distance2(fix.t_s, bearing),
            Measured::Position(r_enu_m, covariance) => {
                self.track.position_distance2(fix.t_s, *r_enu_m, covariance)
            }
            Measured::Range(..) => 0.0,
        }
    }

    /// A station saw it fall.
    pub(super) fn fell(&mut self) {
        self.dealt_with = true;
        self.track.falls();
    }

    /// Takes another object in, which it is.
    pub(super) fn absorb(&mut self, other: Self) {
        self.identity = self.identity.min(other.identity);
        if other.track.sigma_m() < self.track.sigma_m() {
            self.track = other.track;
        }
        self.followers.extend(other.followers);
    }

    /// Takes in a fix of one of its followers; false if that does not follow it any more.
    pub(super) fn take(&mut self, fix: &Fix) -> bool {
        let far = self.distance2(fix) > GATE;
        let Some(followed) = self.followers.get_mut(&fix.follower) else {
            return false;
        };
        if far {
            followed.misfits += 1;
            return followed.misfits < MISFITS;
        }
        followed.misfits = 0;
        followed.last_s = followed.last_s.max(fix.t_s);
        match &fix.measured {
            Measured::Bearing(bearing) => self.track.take_bearing(fix.t_s, bearing),
            Measured::Position(r_enu_m, covariance) => {
                self.track.take_position(fix.t_s, *r_enu_m, covariance);
            }
            Measured::Range(from_enu_m, range_m, sigma_m) => {
                self.track
                    .take_range(fix.t_s, *from_enu_m, *range_m, *sigma_m);
            }
        }
        true
    }
}
