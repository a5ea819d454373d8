//! The Earth below: geodesy, the height raster, the generated city.

pub mod city;
pub mod dsm;
pub mod geodesy;
