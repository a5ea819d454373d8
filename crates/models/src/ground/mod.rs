//! The ground: rasters and triangles of heights, the generated city, what is known of a real one, skylines, what is
//! seen from a place, where a local model stands.

pub mod city;
pub mod dsm;
pub mod footprints;
pub mod georeference;
pub mod height_grid;
pub mod lattice;
pub mod raster;
pub mod roughness;
pub mod skyline;
pub mod survey;
pub mod triangles;
pub mod visible;
