//! The rows of runs, by what they are of.

use super::super::{FalseRow, FrameRow, LookRow, NamedRow, Row};
use crate::optics::tier::Tier;
use crate::tracking::recognition::TrackClass;
use std::collections::BTreeMap;

/// Of each thing so long counts, from when a camera first had it in view [s]: what goes wrong lasts, and would count many times.
const COUNTED_S: f64 = 8.0; // [s]
/// Where the answers on scenery stand among those by kind.
pub(super) const SCENERY: usize = 3;

/// The rows of a run.
pub type Run = Vec<Row>;

/// The rows by what they are of.
#[derive(Default)]
pub(super) struct Data<'a> {
    pub(super) looks: [Vec<(usize, &'a LookRow)>; 3],
    pub(super) false_boxes: Vec<(usize, &'a FalseRow)>,
    pub(super) frames: Vec<(usize, &'a FrameRow)>,
    pub(super) named: [Vec<(usize, &'a NamedRow)>; 4],
}

impl<'a> Data<'a> {
    /// Those of some runs, of each thing the first that count.
    pub(super) fn of(runs: &'a [Run]) -> Self {
        let mut data = Self::default();
        let mut first_s = BTreeMap::new();
        for (run, rows) in runs.iter().enumerate() {
            let mut counts = |thing: usize, tier: Option<Tier>, t_s: f64| {
                t_s - *first_s.entry((run, thing, tier)).or_insert(t_s) < COUNTED_S
            };
            for row in rows {
                match row {
                    Row::Look(look) => {
                        if counts(look.thing, Some(look.appearance.tier), look.t_s) {
                            data.looks[group(&look.kind)].push((run, look));
                        }
                    }
                    Row::False(found) => data.false_boxes.push((run, found)),
                    Row::Frame(frame) => data.frames.push((run, frame)),
                    Row::Named(named) => match named.thing {
                        Some(thing) if counts(thing, None, named.t_s) => {
                            data.named[group(&named.kind)].push((run, named));
                        }
                        Some(_) => {}
                        None => data.named[SCENERY].push((run, named)),
                    },
                }
            }
        }
        data
    }
}

/// Which kinds are fitted together.
fn group(kind: &str) -> usize {
    match TrackClass::of_detector(kind) {
        TrackClass::Uav => 0,
        TrackClass::Bird => 1,
        _ => 2,
    }
}
