//! The laser beam, and what it does to a UAV.

pub mod beam;
pub mod propagation;
pub mod range_finder;
pub mod target;
