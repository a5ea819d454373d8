//! The ground: the height raster and the generated city.

pub mod city;
pub mod dsm;
