//! The window: it looks, and sets the pace; it changes nothing in the simulation.

use crate::run::RunError;
use crate::scenario::Loaded;
use bevy::prelude::*;
use std::path::PathBuf;

/// Runs the app with its window.
pub fn drive(
    _app: &mut App,
    _loaded: &Loaded,
    _screenshot: Option<(PathBuf, f64)>,
) -> Result<(), RunError> {
    Ok(())
}
