//! The tracking loops of a scenario.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{AT_LEAST_ZERO, Check};

/// The tracking loops: a preset, and what differs from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Controller")]
pub struct ControllerConfig {
    /// The loops to start from: "tuned" (exact pixel-to-angle map, prediction over the latency, gains tuned for
    /// this mount), "lqg" (the same with one optimal regulator for gimbal and mirror), "paper" (the paper's
    /// equations 8 to 10 with its printed gains and its linear map), or a law that a plugin adds.
    pub preset: String,
    /// Gains of the coarse loop; absent: the preset's.
    pub coarse: Option<Gains>,
    /// Gains of the precise loop; absent: the preset's.
    pub precise: Option<Gains>,
}

/// The preset that is no law on a predicted line of sight: the paper's equations 8 to 10 with its printed gains
/// and its linear pixel-to-angle map.
pub const PAPER: &str = "paper";

/// Gains of one proportional-integral-derivative loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gains {
    /// Proportional gain.
    pub kp: f64,
    /// Integral gain, per second.
    pub ki_per_s: f64,
    /// Derivative gain, in seconds.
    pub kd_s: f64,
}

impl Default for ControllerConfig {
    fn default() -> Self {
        Self {
            preset: "tuned".into(),
            coarse: None,
            precise: None,
        }
    }
}

impl ControllerConfig {
    /// Whether the loops are the paper's.
    pub fn is_paper(&self) -> bool {
        self.preset == PAPER
    }

    pub(super) fn check(&self, check: &mut Check) {
        for (name, gains) in [("coarse", self.coarse), ("precise", self.precise)] {
            if let Some(gains) = gains {
                check.table(name, |check| gains.check(check));
            }
        }
    }
}

impl Gains {
    pub(super) fn check(&self, check: &mut Check) {
        check.within("kp", self.kp, AT_LEAST_ZERO);
        check.within("ki_per_s", self.ki_per_s, AT_LEAST_ZERO);
        check.within("kd_s", self.kd_s, AT_LEAST_ZERO);
    }
}
