//! The tracker from its scenario.

use crate::components::detect::Reading;
use crate::models::decision::situation::{MOVING_RADPS, patience_s};
use crate::models::decision::tracker::TrackerParams;
use crate::models::optics::tier::{PerTier, Tier};
use crate::models::tracking::evidence::{EvidenceParams, ScoreModel};
use crate::scenario::{self, AssociationRule, ResolvedCamera, Scenario};
use glam::DVec3;

/// How the tracker of a scenario works, for a station with these cameras at `r_station_enu_m` [m].
pub fn tracker_params(
    scenario: &Scenario,
    cameras: &[ResolvedCamera],
    r_station_enu_m: DVec3,
    reading: &Reading,
) -> TrackerParams {
    let scenario::TrackerConfig {
        rule,
        centre_sigma_px,
        min_quality,
        min_score,
        switch_ratio,
        asset_enu_m,
        asset_radius_m: _,
        tuning,
    } = scenario.tracker;
    let engage = &scenario.engage;
    let paper = scenario.controller.is_paper();
    let of_tier = |tier: Tier| {
        let own = cameras.iter().filter(move |camera| camera.tier == tier);
        own.map(|camera| &camera.config)
    };
    let precise_field_rad = of_tier(Tier::Precise).next().map_or(0.0, |precise| {
        let height_share = f64::from(precise.height_px) / f64::from(precise.width_px);
        precise.hfov_deg.to_radians() * height_share.min(1.0)
    });
    // The slowest of a tier sets its patience; what is not there has none.
    let slowest_s = |tier: Tier| {
        let slowest_hz = of_tier(tier).map(|camera| camera.rate_hz).min();
        slowest_hz.map_or(0.0, |rate_hz| patience_s(f64::from(rate_hz)))
    };
    TrackerParams {
        nearest_to_centre: rule.map_or(paper, |rule| rule == AssociationRule::Paper),
        linear_angles: paper,
        centre_sigma_px: centre_sigma_px.unwrap_or(reading.centre_sigma_px),
        centre_sigma_rel: reading.centre_sigma_rel,
        start_score: reading.start_score,
        reads: EvidenceParams {
            min_quality,
            score: min_score.map_or(reading.score, ScoreModel::Fixed),
            other_classes: 0,
            tuning: tuning.evidence,
        },
        precise_field_rad,
        switch_ratio,
        r_asset_enu_m: asset_enu_m.map_or(r_station_enu_m, DVec3::from_array),
        moving_radps: MOVING_RADPS,
        open_sky: true,
        aim: (!reading.boxes_part).then_some(engage.aim),
        lock_radius_px: engage.lock_radius_px,
        lock_dwell_s: engage.lock_dwell_s,
        break_radius_px: engage.break_radius_px,
        min_uav_probability: engage.min_uav_probability,
        max_span_m: engage.max_span_m,
        patience_s: PerTier::of(slowest_s),
        tuning,
    }
}
