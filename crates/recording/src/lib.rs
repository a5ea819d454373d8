#![doc = include_str!("../README.md")]

mod annotations;
mod error;
mod file;
pub mod film;
pub mod live;
pub mod media;
pub mod read;
mod recorder;
mod scene;
mod sink;
pub mod timeline;
mod topics;

pub use annotations::BoxAnnotation;
pub(crate) use annotations::{CLASS, COUNTS, SCORE};
pub use error::RecordingError;
pub use foxglove::messages::log::Level as LogLevel;
pub use recorder::{Recorder, log_time_ns};
pub use scene::{CITY, FrameTransform, Rgba, SceneEntity, SceneShape};
pub use sink::{Picture, Written};
pub use topics::{Meta, OwnMessage, OwnTopic};

/// The project's own messages, generated from `proto/boresight.proto`.
pub mod proto {
    include!(concat!(env!("OUT_DIR"), "/boresight.rs"));
}

// One for each message of the proto file that is a topic.
include!(concat!(env!("OUT_DIR"), "/topics.rs"));

#[cfg(test)]
mod tests;
