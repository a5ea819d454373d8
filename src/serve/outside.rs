//! A detector in another program: frames go out to a client, and its boxes come back.

use super::convert::frame;
use super::inbox::Client;
use crate::models::flight::class::ObjectClass;
use crate::simulation::FrameView;
use crate::simulation::parts::{
    Detection, Detector, DetectorContext, PartError, Question, Reading,
};
use crate::systems::detect::recorded::{Answer, classes, reading};
use boresight_lockstep::proto;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The name by which a scenario calls it (`detector.kind`).
pub(super) const OUTSIDE: &str = "outside";
/// Detections in a frame at most.
const MOST_BOXES: usize = 10_000;

/// Between the run's detector and the client that is it.
#[derive(Default)]
pub(super) struct Link {
    state: Mutex<State>,
    answered: Condvar,
}

#[derive(Default)]
struct State {
    client: Option<(Client, proto::BeDetector)>,
    /// Questions without an answer that was taken, in their order.
    open: VecDeque<Open>,
    /// The answers that were taken, to be kept.
    taken: Vec<Answer>,
    /// Number of the next question.
    next: u64,
    /// Why no answers come any more.
    failed: Option<String>,
}

struct Open {
    question: u64,
    tick: u64,
    camera: Arc<str>,
    found: Option<Vec<Detection>>,
}

impl Link {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A client takes the part; an error says who has it.
    pub(super) fn join(&self, client: &Client, wants: proto::BeDetector) -> Result<(), String> {
        let mut state = self.lock();
        match &state.client {
            Some((other, _)) if other.id != client.id => {
                return Err(format!("{other} is the detector already; one is enough"));
            }
            _ => {}
        }
        state.client = Some((client.clone(), wants));
        Ok(())
    }

    /// Whether a client has the part.
    pub(super) fn is_there(&self) -> bool {
        self.lock().client.is_some()
    }

    /// A client has left.
    pub(super) fn leave(&self, id: u64) {
        let mut state = self.lock();
        if let Some((client, _)) = state.client.take_if(|(client, _)| client.id == id)
            && !state.open.is_empty()
        {
            state.failed = Some(format!(
                "{client}, the run's detector, has left with {} frames unanswered",
                state.open.len()
            ));
        }
        self.answered.notify_all();
    }

    /// The run begins anew: nothing is open any more.
    pub(super) fn reset(&self) {
        let mut state = self.lock();
        state.open.clear();
        state.taken.clear();
        state.failed = None;
    }

    /// The answers that the run has taken, and forgets here.
    pub(super) fn answers(&self) -> Vec<Answer> {
        std::mem::take(&mut self.lock().taken)
    }

    /// What a client has found; an error says what is wrong with it. Answers to what is open no more count for nothing.
    pub(super) fn answer(&self, id: u64, detected: proto::Detected) -> Result<(), String> {
        let found = detections(&detected)?;
        let mut state = self.lock();
        if state
            .client
            .as_ref()
            .is_none_or(|(client, _)| client.id != id)
        {
            return Err("this client is not the detector: send be_detector first".into());
        }
        let question = detected.question;
        if question >= state.next {
            return Err(format!(
                "question {question} has not been asked; repeat the number of a question"
            ));
        }
        if let Some(open) = state.open.iter_mut().find(|open| open.question == question) {
            open.found = Some(found);
        }
        self.answered.notify_all();
        Ok(())
    }

    /// Sends a frame to the client.
    fn ask(&self, asked: &Question) {
        let mut state = self.lock();
        let question = state.next;
        state.next += 1;
        state.open.push_back(Open {
            question,
            tick: asked.frame.tick,
            camera: asked.frame.name.clone(),
            found: None,
        });
        let Some((client, wants)) = state.client.clone() else {
            let why = format!(
                "no client was the run's detector in tick {}",
                asked.frame.tick
            );
            state.failed.get_or_insert(why);
            return;
        };
        drop(state);
        let look = asked.look;
        let question = proto::Question {
            question,
            frame: Some(frame(FrameView::asked(asked), wants.pixels, wants.truth)),
            x_px: look.offset_px[0],
            y_px: look.offset_px[1],
            width_px: look.size_px[0],
            height_px: look.size_px[1],
        };
        client.outbox.send(&proto::Reply {
            id: 0,
            what: Some(proto::reply::What::Question(question)),
        });
    }

    /// The answer to the oldest question; waits for it so long at most.
    fn wait(&self, longest: Duration) -> Result<Vec<Detection>, String> {
        let until = Instant::now() + longest;
        let mut state = self.lock();
        loop {
            if state.open.front().is_some_and(|open| open.found.is_some()) {
                let Some(Open {
                    tick,
                    camera,
                    found,
                    ..
                }) = state.open.pop_front()
                else {
                    return Ok(Vec::new());
                };
                let found = found.unwrap_or_default();
                state.taken.push(Answer {
                    tick,
                    camera: camera.to_string(),
                    found: found.clone(),
                });
                return Ok(found);
            }
            if let Some(why) = &state.failed {
                return Err(why.clone());
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                let who = state
                    .client
                    .as_ref()
                    .map_or_else(String::new, |(client, _)| client.to_string());
                let why = format!(
                    "{who}, the run's detector, has not answered a frame within {} s; give it more with --detector-timeout",
                    longest.as_secs_f64()
                );
                state.failed = Some(why.clone());
                return Err(why);
            }
            let woken = self.answered.wait_timeout(state, left);
            state = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

/// What a client's answer says, or what is wrong with it.
fn detections(detected: &proto::Detected) -> Result<Vec<Detection>, String> {
    let proto::Detected { question, boxes } = detected;
    if boxes.len() > MOST_BOXES {
        return Err(format!(
            "question {question}: {} boxes, at most {MOST_BOXES} are taken",
            boxes.len()
        ));
    }
    let detection = |(at, found): (usize, &proto::Box)| {
        let wrong = |what: String| format!("question {question}: boxes[{at}]: {what}");
        let [x0, y0, x1, y1] = found.box_px[..] else {
            return Err(wrong("box_px must be x0, y0, x1, y1".into()));
        };
        let usable = found.box_px.iter().all(|x| x.is_finite()) && x0 < x1 && y0 < y1;
        if !usable {
            return Err(wrong(format!("box_px {:?} encloses nothing", found.box_px)));
        }
        if !(0.0..=1.0).contains(&found.score) {
            return Err(wrong(format!(
                "score {}: must be between 0 and 1",
                found.score
            )));
        }
        let class = match found.class.as_str() {
            "" => Some(ObjectClass::Quadcopter),
            name => ObjectClass::of_name(name),
        };
        let label =
            class.and_then(|class| ObjectClass::ALL.iter().position(|other| *other == class));
        let label = label.ok_or_else(|| {
            let known = ObjectClass::ALL.map(ObjectClass::name).join(", ");
            wrong(format!("class '{}': must be one of {known}", found.class))
        })?;
        Ok(Detection::new([x0, y0, x1, y1], found.score, label as u32))
    };
    boxes.iter().enumerate().map(detection).collect()
}

/// The detector of a run whose detector is a client.
struct Outside {
    link: Arc<Link>,
    classes: Vec<String>,
    pictures: bool,
    reading: Reading,
    longest: Duration,
}

/// Makes it; the client must answer each frame within `longest`.
pub(super) fn make(
    link: Arc<Link>,
    longest: Duration,
    context: &DetectorContext,
) -> Box<dyn Detector> {
    link.reset();
    Box::new(Outside {
        link,
        classes: classes(),
        // What a client looks at is its own affair.
        pictures: context.options.capture,
        reading: reading(&context.loaded.scenario.detector),
        longest,
    })
}

impl Detector for Outside {
    fn classes(&self) -> &[String] {
        &self.classes
    }

    fn reading(&self) -> Reading {
        self.reading
    }

    fn wants_pictures(&self) -> bool {
        self.pictures
    }

    fn ask(&mut self, questions: Vec<Question>) {
        for question in &questions {
            self.link.ask(question);
        }
    }

    fn answer(&mut self) -> Result<Vec<Detection>, PartError> {
        self.link.wait(self.longest).map_err(PartError::from)
    }
}
