//! The mathematics: plain functions and types in f64, no ECS; each cites its equation or source.

pub mod air;
pub mod control;
pub mod engage;
pub mod flight;
pub mod ground;
pub mod laser;
pub mod maths;
pub mod mount;
pub mod optics;
pub mod shape;
pub mod tiles;
pub mod tracking;
