//! Interlocks that decide whether the laser may fire, and the order of threats.

pub mod interlock;
pub mod threat;
