//! `scaling`: a Gaussian whose radius and wander are those of theory.

use super::crossing::{Across, Expected, Propagation, PropagationContext, Sent, Shape};
use crate::laser::beam::wander_correlation_time_s;
use crate::maths::rng::Stream;
use glam::DVec2;
use std::error::Error;

/// A short-term spot that wanders and breathes. Turbulence takes no power from it: where the peak falls, the spot grows.
///
/// Wander and breathing change as the air passes the aperture's diameter (frozen flow). Where cameras look through the same
/// turbulence, the wander is its: what moves the image turns the beam.
#[derive(Clone, Debug)]
pub struct Scaling {
    wander_rng: Stream,
    breath_rng: Stream,
    /// Wander about each axis, and logarithm of the peak, of unit variance.
    wander: DVec2,
    breath: f64,
    /// What theory expects, and whether of a beam that is on.
    expected: Option<(bool, Expected)>,
}

impl Scaling {
    /// One in its stationary state.
    pub fn new(context: &PropagationContext) -> Self {
        let (mut wander_rng, mut breath_rng) = (
            context.stream("beam wander"),
            context.stream("scintillation"),
        );
        let wander = DVec2::new(wander_rng.normal(), wander_rng.normal());
        let breath = breath_rng.normal();
        Self {
            wander_rng,
            breath_rng,
            wander,
            breath,
            expected: None,
        }
    }
}

impl Propagation for Scaling {
    fn cross(&mut self, sent: &Sent) -> Result<Across, Box<dyn Error + Send + Sync>> {
        let w0_m = sent.laser.aperture_radius_m;
        let time_s = wander_correlation_time_s(w0_m, sent.air.warmed.crosswind_mps);
        // The exact update of an Ornstein–Uhlenbeck process.
        let keep = (-sent.dt_s / time_s).exp();
        let kick = (1.0 - keep * keep).max(0.0).sqrt();
        self.wander = keep * self.wander
            + kick * DVec2::new(self.wander_rng.normal(), self.wander_rng.normal());
        self.breath = keep * self.breath + kick * self.breath_rng.normal();
        let (_, expected) = match self.expected {
            Some(known) if known.0 == sent.fires && !sent.is_new => known,
            _ => *self.expected.insert((sent.fires, sent.expected())),
        };
        let variance = sent.air.turbulence.peak_log_variance(w0_m);
        let relative = (variance.sqrt() * self.breath - 0.5 * variance).exp();
        let wander_m = expected.wander_axis_m();
        Ok(Across {
            power_w: expected.power_w,
            centre_m: wander_m * sent.turned.unwrap_or(self.wander),
            shape: Shape::Gaussian {
                radius_m: expected.short_m / relative.sqrt(),
            },
            relative,
        })
    }

    fn boxed(&self) -> Box<dyn Propagation> {
        Box::new(self.clone())
    }
}
