//! The two-axis mount: gimbal, fast steering mirror, motion of the base.

pub mod base_motion;
pub mod drive;
pub mod gimbal;
pub mod gyro;
pub mod mirror;
