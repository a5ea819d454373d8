//! The link between stations, and who takes which target.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{Check, FRACTION};
use boresight_models::engage::allocation::AllocationRule;

/// The link between stations, and how targets are assigned to them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Network")]
pub struct NetworkConfig {
    /// Reports a second of every station; must divide `tick_hz`.
    pub rate_hz: u32,
    /// From a report to its arrival.
    pub latency_s: f64,
    /// Share of the reports that are lost, 0 to 1, at each receiver by itself.
    pub loss: f64,
    /// How targets are assigned: "least_cost" (by urgency, slew, dwell and lines of sight together), "greedy"
    /// (the cheapest pair first) or "none" (every station takes what is cheapest for itself).
    pub assignment: AllocationRule,
    /// Another target must be cheaper than the present one by this factor.
    pub hysteresis: f64,
    /// How well a station's place is surveyed: standard deviation, each axis. What it says to the others errs by it.
    pub position_sigma_m: f64,
    /// How well a station is levelled and turned to north: standard deviation about each axis. What it says to the others errs by
    /// it.
    pub alignment_deg: f64,
    /// How well a station's clock is set: standard deviation.
    pub clock_sigma_s: f64,
}

impl Default for NetworkConfig {
    fn default() -> Self {
        Self {
            rate_hz: 20,
            latency_s: 0.05,
            loss: 0.0,
            assignment: AllocationRule::default(),
            hysteresis: 1.5,
            // A mast surveyed by carrier-phase satellite navigation; its north by known landmarks in the precise camera; network time.
            position_sigma_m: 0.03,
            alignment_deg: 0.01,
            clock_sigma_s: 0.001,
        }
    }
}

impl NetworkConfig {
    pub(super) fn check(&self, check: &mut Check, tick_hz: u32) {
        check.rate("rate_hz", self.rate_hz, tick_hz);
        check.within("latency_s", self.latency_s, 0.0..=10.0);
        check.within("loss", self.loss, FRACTION);
        check.within("hysteresis", self.hysteresis, 1.0..=f64::MAX);
        check.within("position_sigma_m", self.position_sigma_m, 0.0..=100.0);
        check.within("alignment_deg", self.alignment_deg, 0.0..=5.0);
        check.within("clock_sigma_s", self.clock_sigma_s, 0.0..=1.0);
    }
}
