//! Tracks and the tracking state.

use crate::components::detect::{DetectorInUse, Reading};
use crate::components::mount::{Mount, Station};
use crate::components::run::{PartError, RunScenario, Seed, SetUp, SimClock, Tick, TickSet};
use crate::components::track::{
    Gallery, RangeFinder, Recogniser, TrackStage, Tracker, TrackerParams,
};
use crate::inference::OnnxRecogniser;
use crate::models::optics::tier::{PerTier, Tier};
use crate::models::tracking::evidence::{EvidenceParams, ScoreModel};
use crate::plugins::run::fallible;
use crate::scenario::{self, AssociationRule, ResolvedCamera, Scenario};
use crate::systems::run::nothing_failed;
use crate::systems::track::{self as systems, patience_s};
use bevy::prelude::*;
use glam::DVec3;

/// Adds the domain to both schedules, in [`TickSet::Track`].
pub struct TrackPlugin;

impl Plugin for TrackPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(
            SetUp,
            (set_up.run_if(nothing_failed), fallible(set_up_recogniser))
                .chain()
                .in_set(TickSet::Track),
        )
        .configure_sets(
            Tick,
            (
                TrackStage::Associate,
                TrackStage::Recognise,
                TrackStage::Range,
                TrackStage::Foresee,
                TrackStage::Obey,
                TrackStage::Share,
                TrackStage::Decide,
            )
                .chain()
                .in_set(TickSet::Track),
        )
        .add_systems(
            Tick,
            (
                systems::associate.in_set(TrackStage::Associate),
                systems::recognise::recognise.in_set(TrackStage::Recognise),
                systems::find_range.in_set(TrackStage::Range),
                (systems::aim, systems::foresee)
                    .chain()
                    .in_set(TrackStage::Foresee),
                systems::decide.in_set(TrackStage::Decide),
            ),
        );
    }
}

fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    detector: Res<DetectorInUse>,
    stations: Query<(Entity, &Station, &Mount)>,
) {
    let scenario = &loaded.scenario;
    let known = scenario.stations();
    for (entity, station, mount) in &stations {
        let cameras = &known[station.index].config.cameras.all();
        let mut params = tracker_params(scenario, cameras, mount.r_enu_m, &detector.reading);
        params.reads.other_classes = detector.other_classes();
        commands.entity(entity).insert((
            params,
            Tracker::default(),
            RangeFinder {
                params: default(),
                rng: seed.stream(station.index as u64, "range finder"),
            },
        ));
    }
}

/// From a question to the recogniser to its answer: a small network on chips that are there.
const RECOGNISER_LATENCY_S: f64 = 0.005; // [s]

/// The recogniser works on pictures: beside the truth detector, which needs none, it would make a
/// rendered run another than a blind one.
fn set_up_recogniser(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    clock: Res<SimClock>,
    stations: Query<Entity, With<Station>>,
) -> Result<(), PartError> {
    let config = &loaded.scenario.recogniser;
    let key = "recogniser.onnx_model";
    for station in &stations {
        let model = (config.model(&loaded.scenario.detector))
            .map(|file| OnnxRecogniser::load(file, key))
            .transpose()
            .map_err(|error| loaded.refuse(key, error))?;
        let gallery = Gallery {
            wanted: model.is_some(),
            ..default()
        };
        let recogniser = Recogniser {
            model,
            rate_hz: config.rate_hz,
            max_tracks: config.max_tracks as usize,
            latency_ticks: clock.ticks_of(RECOGNISER_LATENCY_S),
            waiting: Vec::new(),
        };
        commands.entity(station).insert((gallery, recogniser));
    }
    Ok(())
}

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
        },
        precise_field_rad,
        switch_ratio,
        r_asset_enu_m: asset_enu_m.map_or(r_station_enu_m, DVec3::from_array),
        moving_radps: systems::MOVING_RADPS,
        open_sky: true,
        aim: (!reading.boxes_part).then_some(engage.aim),
        lock_radius_px: engage.lock_radius_px,
        lock_dwell_s: engage.lock_dwell_s,
        break_radius_px: engage.break_radius_px,
        fire_belief: engage.min_uav_probability,
        max_span_m: engage.max_span_m,
        patience_s: PerTier::of(slowest_s),
    }
}
