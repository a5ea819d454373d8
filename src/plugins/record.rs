//! State hash, statistics, recording.

use crate::plugins::clock::{Tick, TickSet};
use crate::systems::record as systems;
use bevy::prelude::*;

/// State hash, statistics, recording.
pub struct RecordPlugin;

impl Plugin for RecordPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(
            Tick,
            (
                systems::hash_state,
                systems::keep_history,
                systems::write_recording,
            )
                .chain()
                .in_set(TickSet::Record),
        );
    }
}
