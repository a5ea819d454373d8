//! The rooms that read files of others, alone: what a fuzz target needs, without the engine.

#![allow(dead_code, unused_imports)]

#[path = "../src/media/mod.rs"]
pub mod media;
#[path = "../src/models/mod.rs"]
pub mod models;
#[path = "../src/output.rs"]
pub mod output;
#[path = "../src/parallel.rs"]
pub mod parallel;
#[path = "../src/projection/mod.rs"]
pub mod projection;
#[path = "../src/sources/mod.rs"]
pub mod sources;
#[path = "../src/tiles/mod.rs"]
pub mod tiles;
#[path = "../src/warning.rs"]
pub mod warning;
