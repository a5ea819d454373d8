//! Tracks and the tracking state.

use crate::components::mount::Mount;
use crate::components::run::{PartError, RunScenario, Seed, SetUp, SimClock, Tick, TickSet};
use crate::components::track::{
    Designation, Gallery, Operator, Order, RangeFinder, Recogniser, Tracker, TrackerParams,
};
use crate::inference::OnnxRecogniser;
use crate::plugins::run::fallible;
use crate::scenario::{self, AssociationRule, ControllerPreset, DetectorKind, Scenario};
use crate::systems::run::nothing_failed;
use crate::systems::track::{self as systems, patience_s};
use bevy::prelude::*;
use glam::DVec3;

/// Adds the domain to both schedules, in [`TickSet::Track`].
pub struct TrackPlugin;

impl Plugin for TrackPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Tracker>()
            .add_systems(SetUp, set_up.in_set(TickSet::Track).run_if(nothing_failed))
            .add_systems(SetUp, fallible(set_up_recogniser).in_set(TickSet::Track))
            .add_systems(
                Tick,
                (
                    systems::associate,
                    systems::recognise::recognise,
                    systems::find_range,
                    systems::aim,
                    systems::foresee,
                    systems::obey,
                    systems::decide,
                )
                    .chain()
                    .in_set(TickSet::Track),
            );
    }
}

fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    clock: Res<SimClock>,
    mount: Single<&Mount>,
) {
    let scenario = &loaded.scenario;
    commands.insert_resource(tracker_params(scenario, mount.r_enu_m));
    commands.insert_resource(operator(scenario, *clock));
    commands.insert_resource(RangeFinder {
        params: default(),
        rng: seed.stream(0, "range finder"),
    });
}

/// From a question to the recogniser to its answer: a small network on chips that are there.
const RECOGNISER_LATENCY_S: f64 = 0.005; // [s]

/// The recogniser works on pictures: beside the truth detector, which needs none, it would make a
/// rendered run another than a blind one.
fn set_up_recogniser(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    clock: Res<SimClock>,
) -> Result<(), PartError> {
    let config = &loaded.scenario.recogniser;
    let named = !config.onnx_model.as_os_str().is_empty();
    let wanted = named && loaded.scenario.detector.kind == DetectorKind::Onnx;
    let key = "recogniser.onnx_model";
    let model = wanted
        .then(|| OnnxRecogniser::load(&config.onnx_model, key))
        .transpose()
        .map_err(|error| loaded.refuse(key, error))?;
    commands.insert_resource(Gallery {
        wanted,
        ..default()
    });
    commands.insert_resource(Recogniser {
        model,
        rate_hz: config.rate_hz,
        max_tracks: config.max_tracks as usize,
        latency_ticks: clock.ticks_of(RECOGNISER_LATENCY_S),
        waiting: Vec::new(),
    });
    Ok(())
}

/// How the tracker of a scenario works, for a station at `r_station_enu_m` [m].
pub fn tracker_params(scenario: &Scenario, r_station_enu_m: DVec3) -> TrackerParams {
    let scenario::TrackerConfig {
        rule,
        centre_sigma_px,
        min_quality,
        min_score,
        switch_ratio,
        asset_enu_m,
    } = scenario.tracker;
    let engage = &scenario.engage;
    let paper = scenario.controller.preset == ControllerPreset::Paper;
    let (specified_px, least_score, aim) = match scenario.detector.kind {
        DetectorKind::Onnx => (0.5, 0.0, Some(engage.aim)), // [px], score
        // With no noise at all the filter would ignore its own prediction.
        DetectorKind::Truth => (scenario.detector.truth.noise_px.max(0.02), 0.72, None),
    };
    TrackerParams {
        nearest_to_centre: rule.map_or(paper, |rule| rule == AssociationRule::Paper),
        linear_angles: paper,
        centre_sigma_px: centre_sigma_px.unwrap_or(specified_px),
        min_quality,
        min_score: min_score.unwrap_or(least_score),
        switch_ratio,
        r_asset_enu_m: asset_enu_m.map_or(r_station_enu_m, DVec3::from_array),
        aim,
        lock_radius_px: engage.lock_radius_px,
        lock_dwell_s: engage.lock_dwell_s,
        break_radius_px: engage.break_radius_px,
        patience_s: (scenario.station.cameras.resolved())
            .map(|camera| patience_s(f64::from(camera.rate_hz))),
    }
}

/// The operator's orders of a scenario.
fn operator(scenario: &Scenario, clock: SimClock) -> Operator {
    let index = |name: &String| scenario.flying().position(|known| known == name);
    let orders = scenario.operator.iter().map(|order| Order {
        tick: clock.ticks_of(order.t_s),
        target: match (order.designate.as_ref().and_then(index), order.track) {
            (Some(index), _) => Designation::Uav(index),
            (None, Some(id)) => Designation::Track(id),
            (None, None) => Designation::Release,
        },
    });
    Operator {
        orders: orders.collect(),
        next: 0,
    }
}
