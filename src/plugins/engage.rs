//! Interlocks and fire.

use crate::plugins::clock::{Tick, TickSet};
use crate::systems::engage as systems;
use bevy::prelude::*;

/// Interlocks and fire.
pub struct EngagePlugin;

impl Plugin for EngagePlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(Tick, systems::decide_fire.in_set(TickSet::Engage));
    }
}
