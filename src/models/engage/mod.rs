//! What may be fired at, and what first: interlocks and threats.

pub mod interlock;
pub mod threat;
