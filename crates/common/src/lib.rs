#![doc = include_str!("../README.md")]

pub mod data;
pub mod jpeg;
pub mod output;
pub mod palette;
pub mod parallel;
pub mod progress;
pub mod stop;
pub mod warning;

/// Version of the program, as artefacts carry it.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
