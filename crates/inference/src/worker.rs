//! A model at work, on a thread of its own or on the caller's.

use super::error::DetectorError;
use super::model::{OnnxDetector, View};
use boresight_models::optics::camera::PixelRect;
use boresight_models::optics::detection::Detection;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::JoinHandle;

/// A picture for the detector to look at: a `View` that its thread can own.
#[derive(Clone, Debug)]
pub struct DetectorInput {
    /// 8-bit RGB rows.
    pub rgb8: Arc<Vec<u8>>,
    /// Pixels of a row.
    pub width_px: u32,
    /// The part to look at, in pixels of the picture.
    pub look: PixelRect,
}

/// The detections in a picture, in pixels of the part that was looked at.
pub type Answer = Result<Vec<Detection>, DetectorError>;

/// A model at work: the pictures of a tick are submitted together, and answers fetched in the same
/// order. What is answered does not depend on whether a thread of its own does it, only when.
pub struct Inference {
    classes: Vec<String>,
    worker: Worker,
}

enum Worker {
    /// Works while the caller renders the next frames.
    Thread {
        pictures: Option<mpsc::Sender<Vec<DetectorInput>>>,
        /// Behind a lock, which is never taken, since the worker is part of a resource that threads share.
        answers: Mutex<mpsc::Receiver<Answer>>,
        thread: Option<JoinHandle<()>>,
    },
    /// Works in `submit`.
    Caller {
        model: Box<OnnxDetector>,
        waiting: VecDeque<Answer>,
    },
}

/// An answer to each picture; an error is that of all.
fn look(model: &mut OnnxDetector, pictures: &[DetectorInput]) -> Vec<Answer> {
    let views: Vec<View> = (pictures.iter())
        .map(|picture| View {
            rgb8: &picture.rgb8,
            width_px: picture.width_px,
            look: picture.look,
        })
        .collect();
    match model.detect_all(&views) {
        Ok(found) => found.into_iter().map(Ok).collect(),
        Err(error) => vec![Err(error); pictures.len()],
    }
}

impl Inference {
    /// Puts a model to work on a thread of its own.
    pub fn on_thread(mut model: OnnxDetector) -> std::io::Result<Self> {
        let classes = model.classes().to_vec();
        let (pictures, to_see) = mpsc::channel::<Vec<DetectorInput>>();
        let (answer, answers) = mpsc::channel();
        let thread = std::thread::Builder::new()
            .name("detector".into())
            .spawn(move || {
                for pictures in to_see {
                    for found in look(&mut model, &pictures) {
                        // Nobody waits for the answers when the run is over.
                        if answer.send(found).is_err() {
                            return;
                        }
                    }
                }
            })?;
        Ok(Self {
            classes,
            worker: Worker::Thread {
                pictures: Some(pictures),
                answers: Mutex::new(answers),
                thread: Some(thread),
            },
        })
    }

    /// Puts a model to work on the caller's thread.
    pub fn on_caller(model: OnnxDetector) -> Self {
        Self {
            classes: model.classes().to_vec(),
            worker: Worker::Caller {
                model: Box::new(model),
                waiting: VecDeque::new(),
            },
        }
    }

    /// Names of the classes.
    pub fn classes(&self) -> &[String] {
        &self.classes
    }

    /// Hands in the pictures of a tick.
    pub fn submit(&mut self, batch: Vec<DetectorInput>) {
        match &mut self.worker {
            // A thread that has ended is told by `fetch`.
            Worker::Thread { pictures, .. } => {
                if let Some(pictures) = pictures {
                    let _ = pictures.send(batch);
                }
            }
            Worker::Caller { model, waiting } => waiting.extend(look(model, &batch)),
        }
    }

    /// Waits for the answer to the earliest picture that has not been fetched yet.
    pub fn fetch(&mut self) -> Answer {
        match &mut self.worker {
            Worker::Thread { answers, .. } => {
                let answers = answers.get_mut().unwrap_or_else(PoisonError::into_inner);
                answers.recv().unwrap_or(Err(DetectorError::Ended))
            }
            Worker::Caller { waiting, .. } => {
                waiting.pop_front().unwrap_or(Err(DetectorError::Ended))
            }
        }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        if let Worker::Thread {
            pictures, thread, ..
        } = self
        {
            // The runtime must not be torn down under a thread that uses it.
            drop(pictures.take());
            if let Some(thread) = thread.take() {
                let _ = thread.join();
            }
        }
    }
}
