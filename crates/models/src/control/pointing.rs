//! What a law offers that points by a predicted line of sight.

use super::law::{HandOver, PointingInput, PointingOutput};
use crate::mount::gimbal::GimbalParams;
use std::fmt::Debug;

/// A law that points gimbal and mirror by a predicted line of sight.
pub trait PointingLaw: CloneLaw + Debug + Send + Sync {
    /// How far ahead of a tick's start the line of sight is to be predicted [s].
    fn lead_s(&self) -> f64 {
        0.0
    }

    /// The commands of one tick.
    fn command(
        &mut self,
        hand_over: &mut HandOver,
        gimbal: &GimbalParams,
        input: &PointingInput,
    ) -> PointingOutput;

    /// Why it cannot go on, in words, once; the run ends with them. Asked after every tick.
    fn fault(&mut self) -> Option<String> {
        None
    }

    /// Forgets what a pause in the tracking has made stale.
    fn rest(&mut self) {}

    /// Its gimbal rate per angle still to turn [1/s], where that can be changed.
    fn gimbal_gain_per_s(&mut self) -> Option<&mut f64> {
        None
    }

    /// Its gains, with names and units.
    fn gains(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }
}

/// A law that can be copied with its memory: whatever is [`Clone`].
pub trait CloneLaw {
    /// The copy.
    fn boxed(&self) -> Box<dyn PointingLaw>;
}

impl<L: PointingLaw + Clone + 'static> CloneLaw for L {
    fn boxed(&self) -> Box<dyn PointingLaw> {
        Box::new(self.clone())
    }
}

impl Clone for Box<dyn PointingLaw> {
    fn clone(&self) -> Self {
        (**self).boxed()
    }
}
