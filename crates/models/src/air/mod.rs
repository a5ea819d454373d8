//! The air and its light: atmosphere, weather and its reports, wind, optical turbulence, sky and sun.

pub mod atmosphere;
pub mod backdrop;
pub mod daylight;
pub mod metar;
pub mod shared_gusts;
pub mod sky;
pub mod sun;
pub mod turbulence;
pub mod weather;
pub mod wind;
