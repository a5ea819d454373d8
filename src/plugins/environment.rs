//! Clock and air.

use crate::plugins::clock::{Tick, TickSet};
use crate::systems::environment as systems;
use bevy::prelude::*;

/// Clock and air.
pub struct EnvironmentPlugin;

impl Plugin for EnvironmentPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(
            Tick,
            (systems::advance_clock, systems::blow)
                .chain()
                .in_set(TickSet::Environment),
        );
    }
}
