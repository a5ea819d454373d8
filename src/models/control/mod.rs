//! Control laws of mount and mirror, and how their gains are derived.

pub mod lqg;
pub mod paper;
pub mod pointing;
pub mod tuning;
