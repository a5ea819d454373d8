//! What a station knows of: objects, and the followers that belong to none yet.

use super::fix::{Fix, Follower, Measured};
use super::object::{Followed, SharedObject};
use glam::DVec3;
use nalgebra::Matrix3;
use std::collections::BTreeMap;

/// A follower that belongs to no object yet.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Loose {
    pub(super) fix: Fix,
    /// Its last range, from where and how sure [m].
    pub(super) range: Option<(DVec3, f64, f64)>,
    pub(super) log_odds: f64,
    /// Whether there was a fix since the last round.
    pub(super) fresh: bool,
    /// What it may be of: an object or another loose follower, by name, and for how many rounds.
    pub(super) suits: Option<(Follower, u32)>,
}

impl Loose {
    pub(super) fn followed(&self) -> Followed {
        Followed {
            last_s: self.fix.t_s,
            misfits: 0,
            log_odds: self.log_odds,
        }
    }

    /// Its position [m] and that's covariance [m²], where its range is known.
    pub(super) fn position(&self) -> Option<(DVec3, Matrix3<f64>)> {
        match (self.fix.measured, self.range) {
            (Measured::Position(r_enu_m, covariance), _) => Some((r_enu_m, covariance)),
            (Measured::Bearing(bearing), Some((_, range_m, sigma_m))) => {
                Some(bearing.at_range(range_m, sigma_m))
            }
            _ => None,
        }
    }
}

/// The objects that a station knows of, in the order in which it learned of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// The objects.
    pub objects: Vec<SharedObject>,
    pub(super) loose: BTreeMap<Follower, Loose>,
    /// Objects that may be one, and for how many rounds.
    pub(super) alike: BTreeMap<(Follower, Follower), u32>,
}

/// Rounds in a row that make a follower one of an object's, and two objects one.
pub(super) const ROUNDS: u32 = 5;

impl Picture {
    /// The object of an identity.
    pub fn get(&self, identity: Follower) -> Option<&SharedObject> {
        (self.objects.iter()).find(|object| object.identity == identity)
    }

    /// The object that a follower follows.
    pub fn of(&self, follower: Follower) -> Option<&SharedObject> {
        (self.objects.iter()).find(|object| object.followers.contains_key(&follower))
    }

    fn of_mut(&mut self, follower: Follower) -> Option<&mut SharedObject> {
        (self.objects.iter_mut()).find(|object| object.followers.contains_key(&follower))
    }

    /// Takes in a fix; fixes come in the order of their times.
    pub fn take(&mut self, fix: &Fix) {
        if let Some(object) = self.of_mut(fix.follower) {
            if !object.take(fix) {
                object.followers.remove(&fix.follower);
            }
            return;
        }
        match (fix.measured, self.loose.get_mut(&fix.follower)) {
            (Measured::Range(from_enu_m, range_m, sigma_m), Some(loose)) => {
                loose.range = Some((from_enu_m, range_m, sigma_m));
            }
            (Measured::Range(..), None) => {}
            (_, Some(loose)) => (loose.fix, loose.fresh) = (*fix, true),
            (_, None) => {
                let loose = Loose {
                    fix: *fix,
                    range: None,
                    log_odds: 0.0,
                    fresh: true,
                    suits: None,
                };
                self.loose.insert(fix.follower, loose);
            }
        }
    }

    /// What a follower's station says of it: its log-odds of being a UAV, whether it has been seen to fall, and
    /// what the station calls the object.
    pub fn judge(
        &mut self,
        follower: Follower,
        log_odds: f64,
        fell: bool,
        called: Option<Follower>,
    ) {
        if let Some(loose) = self.loose.get_mut(&follower) {
            loose.log_odds = log_odds;
        }
        let taken = called.is_some_and(|name| self.get(name).is_some());
        let Some(object) = self.of_mut(follower) else {
            return;
        };
        if let Some(followed) = object.followers.get_mut(&follower) {
            followed.log_odds = log_odds;
        }
        if fell {
            object.fell();
        }
        if let Some(name) = called.filter(|name| !taken && *name < object.identity) {
            object.identity = name;
        }
    }
}
