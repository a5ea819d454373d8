//! The front door: a run that is opened, stepped, looked at and given orders, without a word of Bevy.
//!
//! [`Simulation::open`] takes a scenario, or a recording whose run is to be made again. [`Simulation::step`] lets
//! time pass. [`Simulation::view`] shows everything between two ticks: stations with their mounts, beams, tracks and
//! beliefs, cameras, UAVs, the air. [`Simulation::frames`] and [`Simulation::events`] are what came since the step
//! before. [`Simulation::give`] takes the orders that a scenario may hold, too, and [`Builder`] takes detectors, pointing
//! laws, stages of the tracker and topics of one's own.
//!
//! ```
//! use boresight::scenario::OrderConfig;
//! use boresight::simulation::{Simulation, SimulationError};
//!
//! let mut run = Simulation::builder("scenarios/urban_intercept.toml")
//!     .set("detector.kind=truth")
//!     .seed(7)
//!     .open()?;
//! // Nobody fires in the first second.
//! run.give(&OrderConfig { fire: Some(false), ..OrderConfig::default() })?;
//! run.run_until(1.0)?;
//! for station in run.view().stations() {
//!     let pointing = station.mount().az_el_rad;
//!     println!("{} {} looks to {pointing} rad", station.name(), station.state().name());
//!     assert_eq!(station.beam().energy_j, 0.0);
//! }
//! # Ok::<(), SimulationError>(())
//! ```
//!
//! A run has one seed and no other source of chance: the same scenario, seed, parts and orders give the same
//! [`View::state_hash`] after every tick, however the ticks are stepped.
//!
//! [`Simulation::snapshot`] keeps a run's state, and [`Simulation::restore`] goes back to it: so a learner or a debugger
//! branches a run.
//!
//! What a part of one's own is made of stands in [`parts`].
//!
//! Those who want the engine itself find it below, in [`crate::app`].

mod builder;
mod error;
mod events;
mod orders;
mod run;
mod snapshot;
mod view;

pub use crate::components::capture::{Depth, Seen};
pub use crate::components::run::Options;
pub use builder::{Builder, Stage};
pub use error::SimulationError;
pub use events::{Event, What};
pub(crate) use orders::with_orders;
pub use run::Simulation;
pub use snapshot::Snapshot;
pub use view::{
    AirView, Arrived, BurnView, CameraView, Frame, FrameView, Mark, MountView, StationView,
    TrackView, UavView, View,
};

/// What detectors, laws and stages of one's own are made of.
pub mod parts {
    pub use crate::components::detect::{Detector, DetectorContext, Question, Reading};
    pub use crate::components::run::PartError;
    pub use crate::components::track::TrackStage;
    pub use crate::models::control::law::{Aim, HandOver, PointingInput, PointingOutput};
    pub use crate::models::control::pointing::PointingLaw;
    pub use crate::models::control::tuning::MountPlant;
    pub use crate::models::decision::tracker::Tracker;
    pub use crate::models::laser::propagation::{
        Across, Propagation, PropagationContext, Sent, Shape,
    };
    pub use crate::models::mount::gimbal::{GimbalCommand, GimbalParams};
    pub use crate::models::optics::detection::Detection;
    pub use crate::models::tracking::recognition::Recognition;
}
