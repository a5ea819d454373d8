//! How a beam crosses the air: what lies across it at its target in each tick.
//!
//! A [`Propagation`] is a part of its own, as pointing laws and detectors are: `scaling` moves a Gaussian by theory, `wave`
//! sends the wave itself through screens, `paper` is the paper's equation 7.

mod crossing;
mod paper;
mod scaling;
mod wave;

pub use crossing::{
    Across, BeamAir, Expected, Propagation, PropagationContext, Sent, Shape, WaveSettings,
};
pub use paper::PaperPropagation;
pub use scaling::Scaling;
pub use wave::WavePropagation;

use std::error::Error;

/// What makes a propagation.
pub type MakePropagation =
    fn(&PropagationContext) -> Result<Box<dyn Propagation>, Box<dyn Error + Send + Sync>>;

/// Those that every run knows, by the names that scenarios give them.
pub const PROPAGATIONS: [(&str, MakePropagation); 3] = [
    ("scaling", |context| Ok(Box::new(Scaling::new(context)))),
    ("paper", |context| {
        Ok(Box::new(PaperPropagation::new(context)))
    }),
    ("wave", |context| {
        Ok(Box::new(WavePropagation::new(context)?))
    }),
];

#[cfg(test)]
mod tests;
