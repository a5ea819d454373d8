//! What a station makes of its tracks: which is the target, and how it is held.

pub mod belief;
mod choice;
mod conduct;
pub mod gallery;
pub mod look;
pub mod machine;
pub mod situation;
pub mod tasking;
mod terms;
pub mod tracker;
pub mod tuning;
