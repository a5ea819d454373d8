//! The two-axis mount: gimbal, fast steering mirror, motion of the base.

pub mod base_motion;
pub mod gimbal;
pub mod mirror;
