//! The detector; detections and their latency.

use crate::components::capture::SensorCamera;
use crate::components::detect::{
    DetectionQueue, DetectorContext, DetectorInUse, Detectors, Reading,
};
use crate::components::mount::Station;
use crate::components::run::{Options, PartError, RunScenario, Seed, SetUp, Tick, TickSet};
use crate::inference::{Inference, OnnxDetector, Setup};
use crate::models::optics::detection::TruthErrors;
use crate::plugins::run::fallible;
use crate::scenario;
use crate::systems::detect as systems;
use crate::systems::detect::network::NetworkDetector;
use crate::systems::detect::truth::TruthDetector;
use bevy::prelude::*;

/// Adds the domain to both schedules, in [`TickSet::Detect`].
pub struct DetectPlugin;

impl Plugin for DetectPlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(known())
            .add_systems(SetUp, fallible(set_up).in_set(TickSet::Detect))
            .add_systems(Tick, systems::detect.in_set(TickSet::Detect));
    }
}

/// Threads of the detector: fixed, since the order of its sums must not depend on the machine.
const INFERENCE_THREADS: usize = 2;

/// Why the detector's thread does not work.
#[derive(Debug, thiserror::Error)]
#[error("cannot start the detector's thread: {0}")]
pub struct ThreadError(std::io::Error);

/// The detectors that every run knows.
fn known() -> Detectors {
    let mut detectors = Detectors::default();
    detectors.add(scenario::ONNX, |context| Ok(Box::new(network(context)?)));
    detectors.add(scenario::TRUTH, |context| {
        let errors = &context.loaded.scenario.detector.truth;
        let errors = TruthErrors {
            noise_px: errors.noise_px,
            miss_rate: errors.miss_rate,
            distractor_rate: errors.distractor_rate,
            false_alarms_per_frame: errors.false_alarms_per_frame,
        };
        Ok(Box::new(TruthDetector::new(errors, context.seed)))
    });
    detectors
}

/// The network of a scenario.
fn network(context: &DetectorContext) -> Result<NetworkDetector, PartError> {
    let settings = &context.loaded.scenario.detector;
    let refuse =
        |error: &dyn std::fmt::Display| context.loaded.refuse("detector.onnx_model", error);
    let setup = Setup {
        threads: INFERENCE_THREADS,
        provider: settings.provider,
        named_in: "detector.onnx_model",
    };
    let model = OnnxDetector::load_with(&settings.onnx_model, &setup).map_err(|e| refuse(&e))?;
    for size_px in &context.sensors_px {
        model.input_px(*size_px).map_err(|e| refuse(&e))?;
    }
    let recommended = model.score_threshold();
    let inference = if context.options.one_thread {
        Inference::on_caller(model)
    } else {
        Inference::on_thread(model).map_err(ThreadError)?
    };
    let start_score = settings.score_threshold.unwrap_or(recommended);
    let roi_px = Some(settings.roi_px).filter(|side| *side > 0);
    let reading = Reading::of_network(start_score, settings.weak_share * start_score, roi_px);
    Ok(NetworkDetector::new(inference, reading))
}

fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    options: Res<Options>,
    detectors: Res<Detectors>,
    stations: Query<Entity, With<Station>>,
    cameras: Query<&SensorCamera>,
) -> Result<(), PartError> {
    for station in &stations {
        commands.entity(station).insert(DetectionQueue::default());
    }
    let sensors_px: Vec<[u32; 2]> = (cameras.iter())
        .map(|camera| [camera.pinhole.width_px, camera.pinhole.height_px])
        .collect();
    let context = DetectorContext {
        loaded: loaded.0.clone(),
        options: options.clone(),
        seed: *seed,
        sensors_px,
    };
    let kind = &loaded.scenario.detector.kind;
    let detector = detectors.make(kind, &context).ok_or_else(|| {
        let known: Vec<&str> = detectors.names().collect();
        let hint = scenario::suggestion(kind, &known);
        loaded.refuse("detector.kind", format!("no detector '{kind}'{hint}"))
    })?;
    commands.insert_resource(DetectorInUse::new(detector?));
    Ok(())
}
