//! Mathematics that belongs to no domain: rotations, random streams, assignment, frequency responses,
//! quantiles.

pub mod assignment;
pub mod frequency;
pub mod kinematics;
pub mod quantile;
pub mod rng;
