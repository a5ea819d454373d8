//! The window.

use bevy::prelude::*;

/// The window.
pub struct ViewPlugin;

impl Plugin for ViewPlugin {
    fn build(&self, _app: &mut App) {}
}
