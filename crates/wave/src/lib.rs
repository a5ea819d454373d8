#![doc = include_str!("../README.md")]

mod fft;
mod heat;
mod layers;
mod screen;
mod spectrum;
mod spot;
mod wave;

#[cfg(test)]
mod tests;

pub use heat::{Absorbing, HeatedAir};
pub use layers::{Layer, even_layers};
pub use rustfft::num_complex::Complex64;
pub use screen::{Screens, Shift};
pub use spectrum::VonKarman;
pub use spot::{Exposures, Spot};
pub use wave::{Aperture, Sampling, Wave, WaveError};

/// A square of `n` × `n` samples, `spacing_m` apart, the axis at sample (n/2, n/2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Samples along a side; even.
    pub n: usize,
    /// Distance of two samples \[m\].
    pub spacing_m: f64,
}

impl Grid {
    /// Side of the square \[m\].
    pub fn width_m(&self) -> f64 {
        self.n as f64 * self.spacing_m
    }

    /// Place of column or row `i` \[m\] from the axis.
    pub fn place_m(&self, i: usize) -> f64 {
        (i as f64 - (self.n / 2) as f64) * self.spacing_m
    }

    /// Frequency of column or row `i` of a transform \[cycles/m\]: zero first, negative ones behind.
    pub fn frequency_pm(&self, i: usize) -> f64 {
        let signed = if i < self.n.div_ceil(2) {
            i as f64
        } else {
            i as f64 - self.n as f64
        };
        signed / self.width_m()
    }

    /// Samples of the square.
    pub fn samples(&self) -> usize {
        self.n * self.n
    }
}
