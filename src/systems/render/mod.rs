//! Pictures of the truth: the scene that stands for it, and the renderer driven inside the tick.

pub mod city_tiles;
pub mod renderer;
pub mod scene;
pub mod texture;
