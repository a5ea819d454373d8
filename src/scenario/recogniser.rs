//! What says over time what a track is.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::Check;

/// A network that says over time what a track is: UAV, bird, aeroplane, helicopter, balloon, other.
/// It looks at pictures: beside the truth detector it rests.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Recogniser")]
pub struct RecogniserConfig {
    /// The ONNX file, relative to the working directory; empty: nothing is recognised.
    pub onnx_model: PathBuf,
    /// How often it looks at tracks; must divide `tick_hz`.
    pub rate_hz: u32,
    /// Most tracks that it looks at each time: the target, then those that have waited longest.
    pub max_tracks: u32,
}

impl Default for RecogniserConfig {
    fn default() -> Self {
        Self {
            onnx_model: PathBuf::new(),
            rate_hz: 8,
            max_tracks: 8,
        }
    }
}

impl RecogniserConfig {
    pub(super) fn check(&self, check: &mut Check, tick_hz: u32) {
        check.rate("rate_hz", self.rate_hz, tick_hz);
        check.within("max_tracks", self.max_tracks.into(), 1.0..=1024.0);
    }
}
