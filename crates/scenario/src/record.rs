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
    /// Which frames are kept: "all", "none" or { every = n }, one in n of each camera. Most of a recording are pictures:
    /// what it grows by in a second is about that many times smaller.
    pub images: Images,
    /// JPEG quality of the kept frames, 1 to 100.
    pub jpeg_quality: u8,
    /// Most bits to a pixel of a kept frame: one that would take more, such as the noise of a night, is kept in the best
    /// lower quality that fits.
    pub picture_bits_per_px: f64,
}

impl Default for Record {
    fn default() -> Self {
        Self {
            state_hz: 120,
            images: Images::All,
            jpeg_quality: 90,
            picture_bits_per_px: 1.0,
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
        // Below, JPEG's own head would not fit into a small window; above there is nothing to bound.
        check.within("picture_bits_per_px", self.picture_bits_per_px, 0.4..=24.0);
    }
}
