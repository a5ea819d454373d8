//! Tracks and the tracking state.

use crate::plugins::clock::{Tick, TickSet};
use crate::systems::track as systems;
use bevy::prelude::*;

/// Tracks and the tracking state.
pub struct TrackPlugin;

impl Plugin for TrackPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(
            Tick,
            (
                systems::associate,
                systems::find_range,
                systems::aim,
                systems::foresee,
                systems::obey,
                systems::decide,
            )
                .chain()
                .in_set(TickSet::Track),
        );
    }
}
