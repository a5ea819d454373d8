//! Frames become detections, which wait out readout and inference.

pub mod appearance;
pub mod measured;
pub mod onnx;
pub mod recorded;
pub mod truth;

use crate::components::capture::{ExposedFrame, Frames, Readout, SensorCamera};
use crate::components::detect::{
    DetectionBatch, DetectionQueue, Detector, DetectorContext, DetectorInUse, Moving, Question,
};
use crate::components::run::{Failure, PartError, SimClock, Stopwatch};
use crate::models::sensing::moving::{Dot, Picture};
use crate::scenario;
use bevy::prelude::*;
use std::time::Instant;

/// What makes a detector for a run.
pub type MakeDetector = fn(&DetectorContext) -> Result<Box<dyn Detector>, PartError>;

/// The detectors that every run knows, by the names that scenarios give them.
pub const DETECTORS: [(&str, MakeDetector); 4] = [
    (scenario::ONNX, |context| Ok(Box::new(onnx::make(context)?))),
    (scenario::TRUTH, |context| {
        Ok(Box::new(truth::make(context)))
    }),
    (scenario::MEASURED, |context| {
        Ok(Box::new(measured::make(context)?))
    }),
    (scenario::RECORDED, |context| {
        Ok(Box::new(recorded::make(context)?))
    }),
];

/// Hands every frame of this tick to the detector, which may work on them until they are due.
pub fn ask(
    frames: Res<Frames>,
    cameras: Query<(&SensorCamera, &Readout)>,
    mut detector: ResMut<DetectorInUse>,
    mut queues: Query<&mut DetectionQueue>,
    mut stopwatch: ResMut<Stopwatch>,
) {
    let started = Instant::now();
    let mut questions = Vec::new();
    for frame in &frames.0 {
        let (Ok((camera, readout)), Ok(mut queue)) =
            (cameras.get(frame.camera), queues.get_mut(frame.station))
        else {
            continue;
        };
        let question = Question {
            frame: frame.clone(),
            look: detector.look(readout, frame.rect),
            shrunk: detector.shrinks(readout),
        };
        queue.push(DetectionBatch {
            frame: frame.clone(),
            available_tick: frame.tick + camera.latency_ticks,
            look: question.look,
            shrunk: question.shrunk,
            detections: Vec::new(),
            best_scores: Vec::new(),
            moving: Vec::new(),
            answered: false,
        });
        detector.asked.push_back(frame.station);
        questions.push(question);
    }
    if !questions.is_empty() {
        detector.detector.ask(questions);
    }
    stopwatch.inference += started.elapsed();
}

/// Finds what moves in the frames of this tick, while the detector works on them.
pub fn find_moving(
    clock: Res<SimClock>,
    frames: Res<Frames>,
    mut cameras: Query<&mut Moving>,
    mut queues: Query<&mut DetectionQueue>,
) {
    for frame in &frames.0 {
        if let (Ok(mut moving), Ok(mut queue)) =
            (cameras.get_mut(frame.camera), queues.get_mut(frame.station))
        {
            let dots = moving_in(&mut moving, frame, clock.at_s(frame.tick));
            queue.note_moving(frame, dots);
        }
    }
}

/// Releases what has become available. A network has until then to answer; only what is still missing at that tick is
/// waited for.
pub fn answer(
    clock: Res<SimClock>,
    mut detector: ResMut<DetectorInUse>,
    mut queues: Query<&mut DetectionQueue>,
    mut stopwatch: ResMut<Stopwatch>,
    mut failure: ResMut<Failure>,
) {
    let detector = &mut *detector;
    let started = Instant::now();
    let moving = detector.moving();
    // Answers come in the order of the questions, whose ever they are.
    while queues.iter().any(|queue| queue.wants_answer(clock.tick))
        && let Some(station) = detector.asked.pop_front()
    {
        let found = detector.detector.answer().unwrap_or_else(|error| {
            failure.set(error);
            Vec::new()
        });
        if let Ok(mut queue) = queues.get_mut(station) {
            queue.answer(found, detector.reading.weak_score, &moving);
        }
    }
    stopwatch.inference += started.elapsed();
    for mut queue in &mut queues {
        queue.release(clock.tick);
    }
}

/// Answers all that has been asked, whether it is due or not.
pub fn answer_all(world: &mut World) -> Result<(), PartError> {
    world.resource_scope(|world, mut detector: Mut<DetectorInUse>| {
        let moving = detector.moving();
        while let Some(station) = detector.asked.pop_front() {
            let found = detector.detector.answer()?;
            if let Some(mut queue) = world.get_mut::<DetectionQueue>(station) {
                queue.answer(found, detector.reading.weak_score, &moving);
            }
        }
        Ok(())
    })
}

/// What moves in a frame against the scenery, where the whole sensor was read and somebody looks for that.
fn moving_in(moving: &mut Moving, frame: &ExposedFrame, t_s: f64) -> Vec<Dot> {
    let sensor_px = [frame.pinhole.width_px, frame.pinhole.height_px];
    let (Some(dots), Some(rgb8)) = (&mut moving.0, &frame.rgb8) else {
        return Vec::new();
    };
    if frame.rect.size_px != sensor_px {
        return Vec::new();
    }
    let picture = Picture {
        t_s,
        exposure_s: frame.conditions.exposure.time_s,
        q_enu_cam: frame.believed.q_enu_cam,
        rgb8,
    };
    dots.look(&frame.pinhole, &picture)
}
