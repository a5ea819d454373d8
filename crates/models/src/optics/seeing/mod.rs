//! Seeing: how turbulence on the way moves, warps and blurs what a camera sees.
//!
//! The air about a station is a few layers at fixed distances, each a fixed sum of plane waves of optical path ([`FrozenAir`])
//! that the wind carries (frozen flow). What an aperture sees of it is a pure function of direction, time and range: nothing
//! is remembered between frames. A camera and a laser of one station look through the same air.
//!
//! Tilt is the mean gradient of the wavefront over the aperture (G-tilt), which is the image's centroid. Rays are straight
//! (geometric optics); the source is a point at its range, so that a layer at z is seen through (1 - z/L) of the aperture.

mod air;
mod blur;
mod frame;
mod pupil;
mod ripples;
mod sight;
mod warp;

pub use air::{FrozenAir, LAYERS, LayerWinds, SEEING_STREAM};
pub use blur::{long_exposure_sigma_rad, near_field, short_exposure_sigma_rad};
pub use frame::{FrameSeeing, SeeingOptics, SeenThrough};
pub use pupil::Pupil;
pub use ripples::{Lens, Look, Ripples};
pub use sight::Sight;
pub use warp::{Part, Picture, ShiftMap, WarpScratch};

#[cfg(test)]
mod tests;
