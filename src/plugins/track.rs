//! Tracks and the tracking state.

use crate::components::detect::DetectorInUse;
use crate::components::mount::{Mount, Station};
use crate::components::run::{PartError, RunScenario, Seed, SetUp, SimClock, Tick, TickSet};
use crate::components::track::{
    Gallery, Judge, MeasuredRecogniser, RangeFinder, Recogniser, Recognitions, TrackStage, Tracker,
    TrackerParams,
};
use crate::inference::OnnxRecogniser;
use crate::models::decision::gallery;
use crate::parameters::track::tracker_params;
use crate::plugins::run::fallible;
use crate::systems::detect::measured;
use crate::systems::run::nothing_failed;
use crate::systems::track::{self as systems};
use bevy::prelude::*;

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
            TrackerParams(params),
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
    seed: Res<Seed>,
    stations: Query<Entity, With<Station>>,
) -> Result<(), PartError> {
    let config = &loaded.scenario.recogniser;
    let key = "recogniser.onnx_model";
    for station in &stations {
        let detector = &loaded.scenario.detector;
        let judge = if config.is_measured(detector) {
            let refuse = |error: measured::ModelError| loaded.refuse("detector.measured", error);
            let model = measured::load(&detector.measured).map_err(refuse)?;
            let seed = seed.0;
            Some(Judge::Measured(Box::new(MeasuredRecogniser {
                model,
                seed,
            })))
        } else {
            (config.model(detector))
                .map(|file| OnnxRecogniser::load(file, key).map(Judge::Network))
                .transpose()
                .map_err(|error| loaded.refuse(key, error))?
        };
        let gallery = Gallery(gallery::Gallery {
            wanted: matches!(judge, Some(Judge::Network(_))),
            ..default()
        });
        let recogniser = Recogniser {
            judge,
            rate_hz: config.rate_hz,
            max_tracks: config.max_tracks as usize,
            latency_ticks: clock.ticks_of(RECOGNISER_LATENCY_S),
        };
        let waiting = Recognitions::default();
        commands
            .entity(station)
            .insert((gallery, recogniser, waiting));
    }
    Ok(())
}
