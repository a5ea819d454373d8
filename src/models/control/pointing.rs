//! The laws that point by a predicted line of sight, as one type.

use super::law::{HandOver, PointingInput, PointingOutput};
use super::lqg::{LqgMemory, LqgPointing};
use super::tuned::TunedPointing;
use crate::models::mount::gimbal::GimbalParams;

/// A law that points by a predicted line of sight.
// A run has one of them: its size does not matter, and being `Copy` does.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PointingLaw {
    /// Cascaded loops with tuned gains.
    Tuned(TunedPointing),
    /// Optimal regulator, with its memory.
    Lqg(LqgPointing, LqgMemory),
}

impl PointingLaw {
    /// How far ahead of a tick's start the line of sight is to be predicted [s].
    pub fn lead_s(&self) -> f64 {
        match self {
            PointingLaw::Tuned(law) => law.lead_s,
            PointingLaw::Lqg(..) => 0.0,
        }
    }

    /// The commands of one tick.
    pub fn command(
        &mut self,
        hand_over: &mut HandOver,
        gimbal: &GimbalParams,
        input: &PointingInput,
    ) -> PointingOutput {
        match self {
            PointingLaw::Tuned(law) => law.command(hand_over, gimbal, input),
            PointingLaw::Lqg(law, memory) => law.command(memory, hand_over, gimbal, input),
        }
    }

    /// Forgets what a pause in the tracking has made stale.
    pub fn rest(&mut self) {
        if let PointingLaw::Lqg(_, memory) = self {
            memory.rest();
        }
    }
}
