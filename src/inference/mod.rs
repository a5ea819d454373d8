//! ONNX detectors through ONNX Runtime, loaded at run time.
//!
//! A model takes `image`, f32 `[1, 3, H, W]`, RGB 0 to 1, native resolution, and gives `boxes` f32
//! `[N, 4]` (x0, y0, x1, y1 in input pixels), `scores` f32 `[N]` and `labels` i64 `[N]`, or takes
//! `[B, 3, H, W]` for any B and gives each with a leading B; its metadata says
//! `boresight.interface = 1`, which `classes` there are and how pictures are padded
//! (training/README.md).

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
pub(crate) use runtime::{environment, first_line};
pub use worker::{Answer, DetectorInput, Inference};

#[cfg(test)]
mod tests;
