//! Root mean squares, and what became of a lock.

use serde::Serialize;

/// Sum of squares and largest value of an error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Samples.
    pub n: u64,
    /// Sum of the squares.
    pub square: f64,
    /// Largest value.
    pub peak: f64,
}

impl Sums {
    /// Adds a sample.
    pub fn push(&mut self, value: f64) {
        self.n += 1;
        self.square += value * value;
        self.peak = self.peak.max(value);
    }

    /// Adds the samples of another.
    pub fn merge(&mut self, other: &Self) {
        self.n += other.n;
        self.square += other.square;
        self.peak = self.peak.max(other.peak);
    }

    /// Root mean square, if there are samples.
    pub fn rms(&self) -> Option<f64> {
        (self.n > 0).then(|| (self.square / self.n as f64).sqrt())
    }
}

/// What the tracker holds at one instant, by truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hold {
    /// Time [s].
    pub t_s: f64,
    /// Whether the tracker claims a target: it coarse-tracks, precise-tracks or engages.
    pub held: bool,
    /// The UAV on the claimed line of sight, if there is one.
    pub on: Option<usize>,
}

/// What became of the first lock of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Lock {
    /// The UAV locked first, by its index in the scenario; absent if none ever was.
    pub first_uav: Option<usize>,
    /// When that was [s].
    pub locked_s: Option<f64>,
    /// Whether the lock was lost: the tracker went over to something else, or did not hold that
    /// UAV at the end of the run.
    pub lost: bool,
    /// How often the tracker went over from one thing to another.
    pub switches: u32,
    /// Time for which something else than that UAV was held [s].
    pub false_lock_s: f64,
}

/// Something is held once the tracker has been on it this long without a break [s]: two UAVs that
/// cross in the image are one for a few frames.
pub const DWELL_S: f64 = 0.25;

/// Follows a lock through a run; `holds` in order of time.
pub fn lock(holds: &[Hold]) -> Lock {
    let mut lock = Lock::default();
    let mut attached: Option<Option<usize>> = None;
    // What the tracker has been on of late, since when, and when that was last seen.
    let mut candidate: Option<(Option<usize>, f64, f64)> = None;
    for hold in holds {
        if !hold.held {
            candidate = None;
            continue;
        }
        let (since_s, before_s) = match candidate {
            Some((on, since_s, before_s)) if on == hold.on => (since_s, before_s),
            _ => (hold.t_s, hold.t_s),
        };
        candidate = Some((hold.on, since_s, hold.t_s));
        let stretch_s = hold.t_s - since_s;
        if stretch_s < DWELL_S {
            continue;
        }
        // The stretch counts from its start once it has proved to be one.
        let step_s = if before_s - since_s < DWELL_S {
            stretch_s
        } else {
            hold.t_s - before_s
        };
        if lock.first_uav.is_none() && hold.on.is_some() {
            lock.first_uav = hold.on;
            lock.locked_s = Some(since_s);
        } else if lock.first_uav.is_some() && attached.is_some_and(|on| on != hold.on) {
            lock.switches += 1;
        }
        attached = Some(hold.on);
        if hold.on.is_none() || hold.on != lock.first_uav {
            lock.false_lock_s += step_s;
            lock.lost |= lock.first_uav.is_some();
        }
    }
    let holds_first =
        holds.last().is_some_and(|last| last.held) && attached.flatten() == lock.first_uav;
    lock.lost |= lock.first_uav.is_some() && !holds_first;
    lock
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rms_and_peak() {
        let mut sums = Sums::default();
        assert_eq!(sums.rms(), None);
        [3.0, 4.0].into_iter().for_each(|x| sums.push(x));
        assert!((sums.rms().unwrap() - 12.5f64.sqrt()).abs() < 1e-15);
        assert_eq!(sums.peak, 4.0);
    }

    /// Samples at 60 Hz of pieces (seconds, held, on).
    fn series(pieces: &[(f64, bool, Option<usize>)]) -> Vec<Hold> {
        let mut holds: Vec<Hold> = Vec::new();
        for &(seconds, held, on) in pieces {
            for _ in 0..(60.0 * seconds) as usize {
                holds.push(Hold {
                    t_s: holds.len() as f64 / 60.0,
                    held,
                    on,
                });
            }
        }
        holds
    }

    #[test]
    fn a_lock_survives_crossings_and_gaps() {
        let kept = lock(&series(&[
            (1.0, false, None),
            (4.0, true, Some(1)),
            (0.1, true, Some(0)),
            (2.0, true, Some(1)),
            (1.0, false, None),
            (1.0, true, Some(1)),
        ]));
        assert_eq!(kept.first_uav, Some(1));
        assert!((kept.locked_s.unwrap() - 1.0).abs() < 1e-9);
        assert!(!kept.lost && kept.switches == 0);
        assert_eq!(kept.false_lock_s, 0.0);
    }

    #[test]
    fn a_lock_is_lost_to_another_to_nothing_and_at_the_end() {
        let other = lock(&series(&[(2.0, true, Some(0)), (3.0, true, Some(1))]));
        assert!(other.lost && other.switches == 1);
        assert!((other.false_lock_s - 3.0).abs() < 0.02, "{other:?}");
        // Back again: still lost once, two switches.
        let back = lock(&series(&[
            (2.0, true, Some(0)),
            (1.0, true, None),
            (2.0, true, Some(0)),
        ]));
        assert!(back.lost && back.switches == 2);
        assert!((back.false_lock_s - 1.0).abs() < 0.02, "{back:?}");
        let end = lock(&series(&[(2.0, true, Some(0)), (1.0, false, None)]));
        assert!(end.lost && end.switches == 0 && end.false_lock_s == 0.0);
        // A decoy before anything else is no lost lock, but a false one for its time.
        let decoy = lock(&series(&[(2.0, true, None), (2.0, true, Some(0))]));
        assert!(!decoy.lost && decoy.switches == 0, "{decoy:?}");
        assert!((decoy.false_lock_s - 2.0).abs() < 0.02);
        assert_eq!(lock(&series(&[(2.0, true, None)])).first_uav, None);
    }
}
