//! The evaluations: engagements drawn from a recipe, what each rule of the tracker brings in them, tracking over many runs,
//! a detector on annotated pictures, detector and tracker on clips of real cameras.

pub mod ablation;
pub mod clip;
pub mod detector;
pub mod engagement;
mod error;
mod shared;
pub mod statistics;
pub mod tracking;

pub use error::EvalError;
