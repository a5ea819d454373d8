//! 3D Tiles 1.0 and 1.1: tilesets and their contents, read, checked and built.
pub mod build;
pub mod content;
pub mod error;
pub mod fetch;
pub mod settled;
pub mod tileset;
