//! What a run writes down.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::Check;

/// What a run writes down.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Record {
    /// Rate of the recorded states; must divide `tick_hz`.
    pub state_hz: u32,
    /// Which frames are kept: "all", "none" or { every = n }.
    pub images: Images,
    /// JPEG quality of the kept frames, 1 to 100.
    pub jpeg_quality: u8,
}

impl Default for Record {
    fn default() -> Self {
        Self {
            state_hz: 120,
            images: Images::All,
            jpeg_quality: 90,
        }
    }
}

/// Which camera frames are recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Images {
    /// Every frame.
    All,
    /// No frame.
    None,
    /// One frame in so many, of each camera.
    Every(u32),
}

impl Record {
    pub(super) fn check(&self, check: &mut Check, tick_hz: u32) {
        check.rate("state_hz", self.state_hz, tick_hz);
        if let Images::Every(frames) = self.images {
            check.within("images.every", frames.into(), 1.0..=f64::MAX);
        }
        check.within("jpeg_quality", self.jpeg_quality.into(), 1.0..=100.0);
    }
}
