//! The network as a detector: pictures go in, boxes with scores come out.

use crate::components::capture::PixelRect;
use crate::components::detect::{Detector, DetectorContext, Question, Reading};
use crate::components::run::PartError;
use crate::inference::{DetectorInput, Inference, OnnxDetector, Setup};
use crate::models::optics::detection::Detection;
use std::collections::VecDeque;
use std::sync::Arc;

/// Threads of the detector: fixed, since the order of its sums must not depend on the machine.
const INFERENCE_THREADS: usize = 2;

/// Why the detector's thread does not work.
#[derive(Debug, thiserror::Error)]
#[error(
    "the detector's thread cannot be started: {0}; let the system have more threads (ulimit -u)"
)]
pub struct ThreadError(std::io::Error);

/// The network of a scenario.
pub fn make(context: &DetectorContext) -> Result<NetworkDetector, PartError> {
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
    let (recommended, neutral) = (model.score_threshold(), model.score_neutral());
    let inference = if context.options.one_thread {
        Inference::on_caller(model)
    } else {
        Inference::on_thread(model).map_err(ThreadError)?
    };
    let start_score = settings.score_threshold.unwrap_or(recommended);
    let roi_px = Some(settings.roi_px).filter(|side| *side > 0);
    let weak_score = settings.weak_share * start_score;
    let reading = Reading::of_network(start_score, weak_score, neutral, roi_px);
    Ok(NetworkDetector::new(inference, reading))
}

/// A network on the rendered pictures.
pub struct NetworkDetector {
    inference: Inference,
    reading: Reading,
    /// Where each question without an answer looks: offset [px] and by how much its picture is shrunk; `None` without a
    /// picture.
    open: VecDeque<Option<([u32; 2], u32)>>,
}

impl NetworkDetector {
    /// The network at work, and how it is read.
    pub fn new(inference: Inference, reading: Reading) -> Self {
        Self {
            inference,
            reading,
            open: VecDeque::new(),
        }
    }
}

impl Detector for NetworkDetector {
    fn classes(&self) -> &[String] {
        self.inference.classes()
    }

    fn reading(&self) -> Reading {
        self.reading
    }

    fn ask(&mut self, questions: Vec<Question>) {
        let mut pictures = Vec::new();
        for question in questions {
            let picture = picture(&question);
            let place = (question.look.offset_px, question.shrunk);
            self.open.push_back(picture.is_some().then_some(place));
            pictures.extend(picture);
        }
        if !pictures.is_empty() {
            self.inference.submit(pictures);
        }
    }

    fn answer(&mut self) -> Result<Vec<Detection>, PartError> {
        let Some((offset_px, shrunk)) = self.open.pop_front().flatten() else {
            return Ok(Vec::new());
        };
        let placed = |found: &Detection| found.enlarged(f64::from(shrunk)).shifted(offset_px);
        Ok(self.inference.fetch()?.iter().map(placed).collect())
    }
}

/// The part of a frame to look at as the network takes it; none in a run that renders nothing.
fn picture(question: &Question) -> Option<DetectorInput> {
    let Question {
        frame,
        look,
        shrunk,
    } = question;
    let shrunk = *shrunk;
    let [left, top] = frame.rect.offset_px;
    let [x, y] = look.offset_px;
    let look = PixelRect {
        offset_px: [x - left, y - top],
        ..*look
    };
    let (rgb8, width_px) = (frame.rgb8.clone()?, frame.rect.size_px[0]);
    if shrunk <= 1 {
        return Some(DetectorInput {
            rgb8,
            width_px,
            look,
        });
    }
    let size_px = look.size_px.map(|side| side / shrunk);
    Some(DetectorInput {
        rgb8: Arc::new(shrink(&rgb8, width_px, look.offset_px, size_px, shrunk)),
        width_px: size_px[0],
        look: PixelRect {
            offset_px: [0, 0],
            size_px,
        },
    })
}

/// `size_px` pixels, each the mean of `times` by `times` of a picture with rows of `width_px` RGB pixels.
fn shrink(
    rgb8: &[u8],
    width_px: u32,
    offset_px: [u32; 2],
    size_px: [u32; 2],
    times: u32,
) -> Vec<u8> {
    let mean = |x: u32, y: u32, channel: usize| {
        let (left, top) = (offset_px[0] + times * x, offset_px[1] + times * y);
        let rows = (top..top + times).flat_map(|y| (left..left + times).map(move |x| (x, y)));
        let value = |(x, y)| rgb8.get(3 * (y * width_px + x) as usize + channel).copied();
        let sum: u32 = rows.map(|at| u32::from(value(at).unwrap_or(0))).sum();
        ((sum + times * times / 2) / (times * times)) as u8
    };
    let places = (0..size_px[1]).flat_map(|y| (0..size_px[0]).map(move |x| (x, y)));
    places
        .flat_map(|(x, y)| [0, 1, 2].map(|channel| mean(x, y, channel)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shrunk_pixel_is_the_mean_of_its_own() {
        // Columns 0, 10, 20, ... in every row; the red plane of a part that begins at (2, 1).
        let rgb8: Vec<u8> = (0..6 * 8).flat_map(|i| [10 * (i % 8), 0, 255]).collect();
        let small = shrink(&rgb8, 8, [2, 1], [3, 2], 2);
        assert_eq!(small.len(), 3 * 3 * 2);
        assert_eq!([small[0], small[3], small[6], small[9]], [25, 45, 65, 25]);
        assert_eq!(small[2], 255);
    }
}
