#![doc = include_str!("../README.md")]

pub mod air;
pub mod bodies;
pub mod control;
pub mod decision;
pub mod engage;
pub mod flight;
pub mod ground;
pub mod laser;
pub mod maths;
pub mod mount;
pub mod optics;
pub mod sensing;
pub mod shape;
pub mod tiles;
pub mod tracking;
