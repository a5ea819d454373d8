//! Detections and their latency.

use crate::plugins::clock::{Tick, TickSet};
use crate::systems::detect as systems;
use bevy::prelude::*;

/// Detections and their latency.
pub struct DetectPlugin;

impl Plugin for DetectPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(Tick, systems::detect.in_set(TickSet::Detect));
    }
}
