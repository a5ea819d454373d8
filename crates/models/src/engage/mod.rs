//! Interlocks that decide whether the laser may fire, and the order of threats.

pub mod allocation;
pub mod interlock;
pub mod outcome;
pub mod threat;
