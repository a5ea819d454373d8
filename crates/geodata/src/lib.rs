#![doc = include_str!("../README.md")]

pub mod place;
pub mod projection;
pub mod sources;
pub mod tiles;
