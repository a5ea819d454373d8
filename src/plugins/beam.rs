//! The beam's way and its heat.

use crate::plugins::clock::{Tick, TickSet};
use crate::systems::beam as systems;
use bevy::prelude::*;

/// The beam's way and its heat.
pub struct BeamPlugin;

impl Plugin for BeamPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(
            Tick,
            (
                systems::propagate,
                systems::count_distractors,
                systems::heat,
            )
                .chain()
                .in_set(TickSet::Beam),
        );
    }
}
