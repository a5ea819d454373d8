//! The air and its light: atmosphere, weather, wind, optical turbulence, sky and sun.

pub mod atmosphere;
pub mod sky;
pub mod sun;
pub mod turbulence;
pub mod weather;
pub mod wind;
