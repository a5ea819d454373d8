#![doc = include_str!("../README.md")]

mod components;
pub mod paint;
pub mod picture;
mod plugin;
pub mod prepare;
pub mod settle;
pub mod show;
pub mod stream;
pub mod watch;

pub use components::*;
pub use plugin::{FollowTiles, TilesPlugin};
