//! Boresight: a deterministic simulator of urban laser counter-UAV systems.
//!
//! It simulates; it drives no real mount and no real laser.

pub mod app;
pub mod cli;
pub mod components;
pub mod dataset;
pub mod eval;
pub mod experiment;
pub mod georef;
pub mod lint;
pub mod new;
pub mod parameters;
pub mod plugins;
pub mod report;
pub mod simulation;
pub mod systems;
pub mod tiles_command;
pub mod tune;
pub mod view;

pub use boresight_common::{VERSION, data, output, parallel, progress, stop, warning};
pub use boresight_geodata::{place, projection, sources, tiles};
pub use boresight_inference as inference;
pub use boresight_models as models;
pub use boresight_recording::{self as recording, media};
pub use boresight_scenario as scenario;
