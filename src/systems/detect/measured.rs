//! A detector as it was measured: truth without a picture, and what the network was found to make of it.

use super::appearance::{appearance, patch, shown_box_px};
use crate::components::capture::ExposedFrame;
use crate::components::detect::{Detector, DetectorContext, Question, Reading, Surroundings};
use crate::components::run::{PartError, Seed};
use crate::models::maths::kinematics::az_el_to_los;
use crate::models::optics::detection::Detection;
use crate::models::sensing::measured::{Draws, Measured};
use glam::DVec2;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Why a file is no measured detector.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// It cannot be read.
    #[error("{}: {source}; `boresight fit-detector` makes such a file", path.display())]
    Unread {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It holds something else.
    #[error("{}: {source}; `boresight fit-detector` makes such a file", path.display())]
    Other {
        /// The file.
        path: PathBuf,
        /// Why.
        source: serde_json::Error,
    },
    /// Its numbers cannot be.
    #[error("{}: {fault}; `boresight fit-detector` makes such a file", path.display())]
    Fault {
        /// The file.
        path: PathBuf,
        /// Which, and what they must be.
        fault: String,
    },
}

/// The measured detector of a file.
pub fn load(path: &Path) -> Result<Measured, ModelError> {
    let path = crate::data::found(path);
    let text = std::fs::read_to_string(&path).map_err(|source| ModelError::Unread {
        path: path.clone(),
        source,
    })?;
    let model: Measured = serde_json::from_str(&text).map_err(|source| ModelError::Other {
        path: path.clone(),
        source,
    })?;
    match model.fault() {
        Some(fault) => Err(ModelError::Fault { path, fault }),
        None => Ok(model),
    }
}

/// The measured detector of a scenario.
pub fn make(context: &DetectorContext) -> Result<MeasuredDetector, PartError> {
    let settings = &context.loaded.scenario.detector;
    let refuse = |error: ModelError| context.loaded.refuse("detector.measured", error);
    let mut model = load(&settings.measured).map_err(refuse)?;
    if !settings.moving {
        for kind in [&mut model.uav, &mut model.bird, &mut model.other] {
            kind.moving = Default::default();
        }
    }
    let start_score = settings.score_threshold.unwrap_or(model.start);
    let roi_px = Some(settings.roi_px).filter(|side| *side > 0);
    let weak_score = (settings.weak_share * start_score).max(model.floor);
    Ok(MeasuredDetector {
        reading: Reading::of_network(start_score, weak_score, model.neutral, roi_px),
        model,
        surroundings: context.surroundings.clone(),
        seed: context.seed,
        answers: VecDeque::new(),
    })
}

/// What the measured network would have found.
pub struct MeasuredDetector {
    model: Measured,
    reading: Reading,
    surroundings: Arc<Surroundings>,
    seed: Seed,
    answers: VecDeque<Vec<Detection>>,
}

impl Detector for MeasuredDetector {
    fn classes(&self) -> &[String] {
        &self.model.classes
    }

    fn reading(&self) -> Reading {
        self.reading
    }

    fn wants_pictures(&self) -> bool {
        false
    }

    fn ask(&mut self, questions: Vec<Question>) {
        let answers: Vec<_> = questions
            .iter()
            .map(|question| self.found(question))
            .collect();
        self.answers.extend(answers);
    }

    fn answer(&mut self) -> Result<Vec<Detection>, PartError> {
        Ok(self.answers.pop_front().unwrap_or_default())
    }
}

/// A number of a frame that no other of the run has.
fn frame_key(frame: &ExposedFrame) -> u64 {
    frame.tick << 8 | frame.index as u64
}

impl MeasuredDetector {
    fn found(&self, question: &Question) -> Vec<Detection> {
        let Question {
            frame,
            look,
            shrunk,
        } = question;
        let t_s = frame.tick as f64 / self.surroundings.tick_hz;
        let draws = |thing: usize| Draws::new(self.seed.0, thing as u64, t_s, frame_key(frame));
        let things = frame
            .truth
            .iter()
            .filter(|seen| seen.clear && look.holds(seen.aim_px));
        let mut found: Vec<Detection> = things
            .filter_map(|seen| {
                let class = self.surroundings.kind(seen.uav);
                let appearance = appearance(&self.surroundings, frame, seen, *shrunk);
                self.model.found(
                    class,
                    &appearance,
                    shown_box_px(frame, seen),
                    &draws(seen.uav),
                )
            })
            .collect();
        let places = self.model.scenery.of(frame.tier);
        let (r_enu_m, q_enu_cam) = (frame.pose.r_enu_m, frame.pose.q_enu_cam);
        let seed = self.seed.0 ^ (frame.index as u64).rotate_left(48);
        let boxes = places.boxes(
            seed,
            &patch(frame, look),
            t_s,
            frame_key(frame),
            |az_el_rad| {
                self.surroundings
                    .is_sky(r_enu_m, az_el_to_los(DVec2::from(az_el_rad)))
            },
        );
        found.extend(boxes.into_iter().filter_map(|place| {
            let r_cam = q_enu_cam.inverse() * az_el_to_los(DVec2::from(place.az_el_rad));
            let [x, y] = frame
                .pinhole
                .project(r_cam)
                .filter(|px| look.holds((*px).into()))?
                .into();
            let half_px = 0.5 * place.side_px * f64::from(*shrunk);
            let box_px = [x - half_px, y - half_px, x + half_px, y + half_px];
            Some(Detection::new(box_px, place.score, place.label))
        }));
        found
    }
}
