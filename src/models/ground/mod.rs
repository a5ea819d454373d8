//! The ground: the height raster, the generated city, its skyline.

pub mod city;
pub mod dsm;
pub mod roughness;
pub mod skyline;
