//! Mathematics that belongs to no domain: rotations, random streams, assignment, frequency responses.

pub mod assignment;
pub mod frequency;
pub mod kinematics;
pub mod rng;
