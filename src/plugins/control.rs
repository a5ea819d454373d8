//! Commands for mount and cameras.

use crate::plugins::clock::{Tick, TickSet};
use crate::systems::control as systems;
use bevy::prelude::*;

/// Commands for mount and cameras.
pub struct ControlPlugin;

impl Plugin for ControlPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(
            Tick,
            (
                systems::track_by_radar,
                systems::command_mount,
                systems::choose_readouts,
            )
                .chain()
                .in_set(TickSet::Control),
        );
    }
}
