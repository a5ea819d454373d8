//! Snapshots that clients have taken of the run.

use crate::simulation::{Frame, Snapshot};
use std::collections::{BTreeMap, VecDeque};

/// Snapshots that are kept: the oldest gives way to one more.
const MOST_KEPT: usize = 64;

/// A snapshot, and what the session kept beside the run.
#[derive(Clone)]
pub(super) struct Mark {
    pub run: Snapshot,
    pub frames: BTreeMap<usize, Frame>,
    /// Orders that had been taken.
    pub orders: usize,
    /// Number of the event after the last.
    pub event: u64,
}

/// The newest snapshots, with their numbers.
#[derive(Default)]
pub(super) struct Marks {
    kept: VecDeque<(u64, Mark)>,
    taken: u64,
}

impl Marks {
    /// Keeps a snapshot under the number that is returned.
    pub(super) fn keep(&mut self, mark: Mark) -> u64 {
        self.taken += 1;
        self.kept.push_back((self.taken, mark));
        if self.kept.len() > MOST_KEPT {
            self.kept.pop_front();
        }
        self.taken
    }

    /// The snapshot of a number, or why there is none.
    pub(super) fn get(&self, number: u64) -> Result<Mark, String> {
        let kept = self.kept.iter().find(|(own, _)| *own == number);
        kept.map(|(_, mark)| mark.clone()).ok_or_else(|| {
            format!(
                "restore: there is no snapshot {number}: the newest {MOST_KEPT} are kept, until the run begins anew"
            )
        })
    }

    /// The run begins anew: snapshots are of another now, and numbers are not given twice.
    pub(super) fn forget(mut self) -> Self {
        self.kept.clear();
        self
    }
}
