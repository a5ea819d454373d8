//! The beam and the heat it leaves.

pub mod beam;
pub mod range_finder;
pub mod thermal;
