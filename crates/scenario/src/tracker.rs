//! From detections to a target: the tracker.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{Check, FRACTION};
use boresight_models::decision::tuning::TrackerTuning;

/// How detections become tracks and which of them becomes the target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Tracker")]
pub struct TrackerConfig {
    /// Which detection belongs to the target; absent: "paper" with the paper's controller,
    /// "global" with any other.
    pub rule: Option<AssociationRule>,
    /// Standard deviation of a detection's centre that the tracker assumes; absent: the truth
    /// detector's noise, or 0.5 for an ONNX model.
    pub centre_sigma_px: Option<f64>,
    /// Share of its frames in which the detector must see a track for that to speak for a UAV.
    pub min_quality: f64,
    /// Score from which on a detection speaks for a UAV; absent: 0.72 for the truth
    /// detector, half way between its scores of UAVs and of distractors, and what fits the box's size for an
    /// ONNX model.
    pub min_score: Option<f64>,
    /// Another track becomes the target when it could reach the asset sooner by this factor.
    pub switch_ratio: f64,
    /// The protected asset, east, north, up from the site; absent: the station itself.
    pub asset_enu_m: Option<[f64; 3]>,
    /// A UAV that comes this close to the asset unharmed has got through.
    pub asset_radius_m: f64,
    /// What its decisions are tuned by.
    pub tuning: TrackerTuning,
}

impl Default for TrackerConfig {
    fn default() -> Self {
        Self {
            rule: None,
            centre_sigma_px: None,
            min_quality: 0.6,
            min_score: None,
            switch_ratio: 1.5,
            asset_enu_m: None,
            asset_radius_m: 50.0,
            tuning: TrackerTuning::default(),
        }
    }
}

/// Rules by which detections belong to the target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AssociationRule {
    /// The detection nearest to the image centre is the target, as in the paper.
    Paper,
    /// All detections are assigned to all tracks at the least total cost.
    Global,
}

impl TrackerConfig {
    pub(super) fn check(&self, check: &mut Check) {
        check.maybe_within("centre_sigma_px", self.centre_sigma_px, 0.01..=20.0);
        check.within("min_quality", self.min_quality, FRACTION);
        check.maybe_within("min_score", self.min_score, FRACTION);
        check.positive("asset_radius_m", self.asset_radius_m);
        check.within("switch_ratio", self.switch_ratio, 1.0..=f64::MAX);
        check.table("tuning", |check| tuning(check, &self.tuning));
    }
}

/// Times, ratios and scores are above 0, since most of them divide; lengths, angles and rates are not below it. What speaks against
/// something is not above 0, and the rest are numbers that an exponential can take.
fn tuning(check: &mut Check, tuning: &TrackerTuning) {
    check.ascending("closer_look_px", tuning.closer_look_px, 0.0..=1e6);
    numbers(check, tuning);
    check.table("evidence", |check| {
        let evidence = &tuning.evidence;
        check.not_descending("of_shape", evidence.of_shape, -100.0..=100.0);
        numbers(check, evidence);
    });
}

/// Each number of a table of tuned ones, by its name.
fn numbers(check: &mut Check, table: &impl Serialize) {
    const LENGTHS: [&str; 5] = ["_m", "_px", "_rad", "_radps", "_mps"];
    const AGAINST: [&str; 5] = [
        "before_scenery",
        "before_scenery_unjudged",
        "cue_against",
        "disproved",
        "other_class",
    ];
    let Ok(serde_json::Value::Object(values)) = serde_json::to_value(table) else {
        return;
    };
    for (key, value) in &values {
        if value.is_array() || value.is_object() {
            continue;
        }
        // JSON has no infinity.
        let value = value.as_f64().unwrap_or(f64::INFINITY);
        let range = match key.as_str() {
            key if key.ends_with("_s") => 1e-6..=1e6,
            "rigid_ratio" | "clear_score" => 1e-6..=100.0,
            key if LENGTHS.iter().any(|unit| key.ends_with(unit)) => 0.0..=1e6,
            key if AGAINST.contains(&key) => -100.0..=0.0,
            key if key.starts_with("chosen") || key == "surely_none" => -100.0..=100.0,
            _ => 0.0..=100.0,
        };
        check.within(key, value, range);
    }
}
