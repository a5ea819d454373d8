//! The laser in the picture: what its beam, its spot and other lamps bring into a camera.
//!
//! - [`scatter`]: how much the air throws into a direction;
//! - [`beam`]: a beam in that air as a camera beside it, or far from it, sees it;
//! - [`glint`]: what a lit surface sends back;
//! - [`lamp`]: searchlights and dazzlers that shine on a station;
//! - [`response`]: what a line of light is to a silicon camera behind a filter;
//! - [`light`]: all of it together, pixel by pixel.
//!
//! Light of one wavelength is worked out in watts and turned into the luminance that makes as many electrons in the
//! same pixel: noise, full well and codes follow as for any light.
//!
//! Assumptions: single scattering; a beam is a Gaussian without turbulence; polarisation, speckle, and light that the
//! laser's own optics scatter into a camera behind the same mirror are left out.

pub mod beam;
pub mod glint;
pub mod lamp;
pub mod light;
pub mod response;
pub mod scatter;
