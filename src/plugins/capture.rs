//! Exposures and their pictures.

use crate::plugins::clock::{Tick, TickSet};
use crate::systems::capture as systems;
use bevy::prelude::*;

/// Exposures and their pictures.
pub struct CapturePlugin;

impl Plugin for CapturePlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(
            Tick,
            (systems::expose, systems::render_frames)
                .chain()
                .in_set(TickSet::Capture),
        );
    }
}
