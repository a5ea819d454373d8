//! Detections become tracks.

use crate::components::detect::{DetectionQueue, DetectorInUse};
use crate::components::run::SimClock;
use crate::components::track::{Gallery, Tracker, TrackerParams};
use crate::models::decision::look::take_in;
use bevy::prelude::*;

/// Updates the track table with the batches that arrived in this tick.
pub fn associate(
    clock: Res<SimClock>,
    detector: Res<DetectorInUse>,
    mut stations: Query<(&TrackerParams, &DetectionQueue, &mut Gallery, &mut Tracker)>,
) {
    for (params, queue, mut gallery, mut tracker) in &mut stations {
        for batch in &queue.arrived {
            let shown = batch.shown(clock.at_s(batch.frame.tick));
            let assigned = take_in(&mut tracker, params, &shown);
            gallery.hang(&shown, &assigned, &tracker.table, |label| {
                detector.named(label)
            });
        }
    }
}
