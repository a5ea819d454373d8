//! The mount's motion.

use crate::plugins::clock::{Tick, TickSet};
use crate::systems::mount as systems;
use bevy::prelude::*;

/// The mount's motion.
pub struct MountPlugin;

impl Plugin for MountPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(Tick, systems::turn.in_set(TickSet::Mount));
    }
}
