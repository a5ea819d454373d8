//! The laser beam, and the heat it leaves in a UAV's skin.

pub mod beam;
pub mod propagation;
pub mod range_finder;
pub mod thermal;
