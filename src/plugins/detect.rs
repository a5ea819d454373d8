//! The detector; detections and their latency.

use crate::components::capture::SensorCamera;
use crate::components::detect::{DetectionQueue, Detector};
use crate::components::mount::Station;
use crate::components::run::{Options, PartError, RunScenario, Seed, SetUp, Tick, TickSet};
use crate::inference::{Inference, OnnxDetector, Setup};
use crate::models::optics::detection::TruthErrors;
use crate::plugins::run::fallible;
use crate::scenario::DetectorKind;
use crate::systems::detect as systems;
use bevy::prelude::*;

/// Adds the domain to both schedules, in [`TickSet::Detect`].
pub struct DetectPlugin;

impl Plugin for DetectPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(SetUp, fallible(set_up).in_set(TickSet::Detect))
            .add_systems(Tick, systems::detect.in_set(TickSet::Detect));
    }
}

/// Threads of the detector: fixed, since the order of its sums must not depend on the machine.
const INFERENCE_THREADS: usize = 2;

/// Why the detector's thread does not work.
#[derive(Debug, thiserror::Error)]
#[error("cannot start the detector's thread: {0}")]
pub struct ThreadError(std::io::Error);

fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    options: Res<Options>,
    stations: Query<Entity, With<Station>>,
    cameras: Query<&SensorCamera>,
) -> Result<(), PartError> {
    for station in &stations {
        commands.entity(station).insert(DetectionQueue::default());
    }
    let settings = &loaded.scenario.detector;
    commands.insert_resource(match settings.kind {
        DetectorKind::Onnx => {
            let setup = Setup {
                threads: INFERENCE_THREADS,
                provider: settings.provider,
                named_in: "detector.onnx_model",
            };
            let model = OnnxDetector::load_with(&settings.onnx_model, &setup)
                .map_err(|error| loaded.refuse("detector.onnx_model", error))?;
            for camera in &cameras {
                model
                    .input_px([camera.pinhole.width_px, camera.pinhole.height_px])
                    .map_err(|error| loaded.refuse("detector.onnx_model", error))?;
            }
            let recommended = model.score_threshold();
            let inference = if options.one_thread {
                Inference::on_caller(model)
            } else {
                Inference::on_thread(model).map_err(ThreadError)?
            };
            let score_threshold = settings.score_threshold.unwrap_or(recommended);
            Detector::Onnx {
                inference: Box::new(inference),
                score_threshold,
                weak_threshold: settings.weak_share * score_threshold,
                roi_px: Some(settings.roi_px).filter(|side| *side > 0),
                asked: default(),
            }
        }
        DetectorKind::Truth => {
            let errors = &settings.truth;
            Detector::Truth {
                errors: TruthErrors {
                    noise_px: errors.noise_px,
                    miss_rate: errors.miss_rate,
                    distractor_rate: errors.distractor_rate,
                    false_alarms_per_frame: errors.false_alarms_per_frame,
                },
                seed: seed.0,
            }
        }
    });
    Ok(())
}
