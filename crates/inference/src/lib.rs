#![doc = include_str!("../README.md")]

mod error;
mod interface;
mod model;
mod recogniser;
mod runtime;
mod worker;

pub use error::DetectorError;
pub use model::{OnnxDetector, View};
pub use recogniser::{OnnxRecogniser, RecogniserError};
pub use runtime::{Setup, providers, runtime_path};
pub use runtime::{environment, first_line};
pub use worker::{Answer, DetectorInput, Inference};

#[cfg(test)]
mod tests;
