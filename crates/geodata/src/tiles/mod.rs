//! 3D Tiles 1.0 and 1.1: tilesets and their contents, read and checked.
pub mod content;
pub mod error;
pub mod expansion;
pub mod fetch;
pub mod heights;
pub mod inspect;
mod json;
mod read;
mod rules;
mod semantics;
pub mod settled;
mod subtree;
pub mod tileset;
pub mod validate;
