//! Boresight: a deterministic simulator of urban laser counter-UAV systems.
//!
//! UAVs fly through a city; cameras render them, a detector finds them, trackers and controllers point gimbal and
//! mirror, and a laser heats the target through turbulent air. It simulates; it drives no real mount and no real laser.
//!
//! # Start here
//!
//! [`simulation::Simulation`] is the front door: open a scenario, step it, look at it, give it orders.
//!
//! ```
//! use boresight::simulation::{Simulation, SimulationError};
//!
//! let mut run = Simulation::builder("scenarios/urban_intercept.toml")
//!     .set("detector.kind=truth") // no pictures, no network
//!     .open()?;
//! run.run_until(1.0)?;
//! for station in run.view().stations() {
//!     if let Some(target) = station.target() {
//!         println!("{}: track {}, a UAV by {:.2}", station.name(), target.id(), target.uav_probability());
//!     }
//! }
//! # Ok::<(), SimulationError>(())
//! ```
//!
//! # Where things are
//!
//! | what | where |
//! |---|---|
//! | a run | [`simulation`] |
//! | scenario files, the catalogue of UAVs | [`scenario`] |
//! | the mathematics, without an engine | [`models`] |
//! | recordings and media | [`recording`], [`media`] |
//! | detector and recogniser | [`inference`] |
//! | raw geodata, georeferencing, 3D Tiles | [`sources`], [`projection`], [`tiles`], [`place`] |
//! | what a run leaves: summary, report | [`report`] |
//! | sweeps, tests, comparisons | [`experiment`] |
//! | evaluations of engagement, tracking, detector, clips | [`eval`] |
//! | annotated pictures | [`dataset`] |
//! | every model against its references | [`validate`] |
//! | a run for clients in other programs | [`serve`] |
//! | a station as a co-simulation unit | [`fmu`] |
//! | the same run as a Bevy app: data, behaviour, wiring | [`components`], [`systems`], [`plugins`], [`app`] |
//!
//! The folder `examples` has a file for each thing that one may want to do first.

pub mod app;
pub mod cli;
pub mod components;
pub mod dataset;
pub mod eval;
pub mod experiment;
pub mod fit_detector;
pub mod fmu;
pub mod georef;
pub mod lint;
pub mod new;
pub mod parameters;
pub mod plugins;
pub mod report;
pub mod serve;
pub mod simulation;
pub mod systems;
pub mod tiles_command;
pub mod tune;
pub mod validate;
pub mod view;

pub use boresight_common::{VERSION, data, output, parallel, progress, stop, warning};
pub use boresight_geodata::{place, projection, sources, tiles};
pub use boresight_inference as inference;
pub use boresight_models as models;
pub use boresight_recording::{self as recording, media};
pub use boresight_scenario as scenario;

#[cfg(doctest)]
#[doc = include_str!("../docs/rust.md")]
struct Guide;
