#![doc = include_str!("../README.md")]

pub mod build;
pub mod place;
pub mod projection;
pub mod sources;
pub mod tiles;
