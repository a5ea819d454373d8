//! Tilesets in a scene: opened, watched, loaded and drawn.

pub mod paint;
pub mod prepare;
pub mod settle;
pub mod show;
pub mod stream;
pub mod watch;
