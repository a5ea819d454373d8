//! Boresight: a deterministic simulator of urban laser counter-UAV systems.
//!
//! It simulates; it drives no real mount and no real laser.

pub mod app;
pub mod cli;
pub mod components;
pub mod data;
pub mod dataset;
pub mod eval;
pub mod experiment;
pub mod georef;
pub mod inference;
pub mod lint;
pub mod media;
pub mod models;
pub mod new;
pub mod output;
mod parallel;
pub mod place;
pub mod plugins;
mod progress;
pub mod projection;
pub mod recording;
pub mod report;
pub mod scenario;
pub mod sources;
pub mod stop;
pub mod systems;
pub mod tiles;
pub mod tiles_command;
pub mod tune;
pub mod view;
pub mod warning;

/// Version of the program, as artefacts carry it.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
