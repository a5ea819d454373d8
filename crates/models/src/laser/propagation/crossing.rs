//! A beam in a tick, what lies across it, and what takes it there.

use crate::air::atmosphere::transmittance;
use crate::air::turbulence::PathTurbulence;
use crate::laser::beam::{
    BloomingAir, Laser, blooming_factor, irradiance_wpm2, peak_irradiance_wpm2, power_in_bucket_w,
};
use crate::maths::rng::Stream;
use boresight_wave::{Layer, Spot};
use glam::DVec2;
use std::error::Error;
use std::fmt::Debug;
use std::sync::Arc;

/// The air between a laser and the place that its beam is followed to; good for a fraction of a second.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamAir {
    /// Integrals of the turbulence.
    pub turbulence: PathTurbulence,
    /// The path in layers of equal thickness, from the laser on; their winds are right and down of the beam's axes, less the
    /// beam's own turning.
    pub layers: Vec<Layer>,
    /// The air that the beam warms.
    pub warmed: BloomingAir,
}

/// A beam in one tick.
#[derive(Debug)]
pub struct Sent<'a> {
    /// The laser.
    pub laser: &'a Laser,
    /// Whether it emits: a beam that does not warms no air.
    pub fires: bool,
    /// Range of what it is followed to [m].
    pub range_m: f64,
    /// Distance at which it is focused [m]; infinite: collimated.
    pub focus_m: f64,
    /// The air.
    pub air: &'a BeamAir,
    /// Whether the air has been worked out anew since the last tick.
    pub is_new: bool,
    /// Length of the tick [s].
    pub dt_s: f64,
    /// Where the turbulence that the station's cameras look through turns the beam, of unit variance about each axis, right and
    /// down; none: the propagation draws its own.
    pub turned: Option<DVec2>,
}

/// What lies across a beam at its target's range.
#[derive(Clone, Debug)]
pub struct Across {
    /// Power of all of it [W].
    pub power_w: f64,
    /// Where its middle lies [m], right and down of the beam's axis.
    pub centre_m: DVec2,
    /// Its shape about the middle.
    pub shape: Shape,
    /// Greatest irradiance over its mean without fluctuation [-].
    pub relative: f64,
}

/// A spot's shape.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A Gaussian of a 1/e² radius [m].
    Gaussian {
        /// The radius [m].
        radius_m: f64,
    },
    /// A map about the beam's axis rather than the spot's middle, columns to the right, rows downwards.
    Map(Arc<Spot>),
}

impl Across {
    /// Irradiance at a place [W/m²], right and down of the beam's axis [m].
    pub fn at_wpm2(&self, place_m: DVec2) -> f64 {
        match &self.shape {
            Shape::Gaussian { radius_m } => {
                irradiance_wpm2(self.power_w, *radius_m, (place_m - self.centre_m).length())
            }
            Shape::Map(spot) => spot.at_wpm2(place_m.x, place_m.y),
        }
    }

    /// Greatest irradiance [W/m²].
    pub fn peak_wpm2(&self) -> f64 {
        match &self.shape {
            Shape::Gaussian { radius_m } => peak_irradiance_wpm2(self.power_w, *radius_m),
            Shape::Map(spot) => spot.peak_wpm2(),
        }
    }

    /// 1/e² radius of the Gaussian of its power and peak [m].
    pub fn radius_m(&self) -> f64 {
        match &self.shape {
            Shape::Gaussian { radius_m } => *radius_m,
            Shape::Map(spot) => spot.radius_m(),
        }
    }

    /// Power within a radius [m] about a place [W].
    pub fn power_in_bucket_w(&self, place_m: DVec2, radius_m: f64) -> f64 {
        match &self.shape {
            Shape::Gaussian { radius_m: own } => power_in_bucket_w(
                self.power_w,
                *own,
                (place_m - self.centre_m).length(),
                radius_m,
            ),
            Shape::Map(spot) => spot
                .power_in_buckets_w(place_m.to_array(), &[radius_m])
                .iter()
                .sum(),
        }
    }
}

/// A way to take a beam through the air, with its memory.
pub trait Propagation: Debug + Send + Sync {
    /// Takes the beam through the air of a tick.
    ///
    /// # Errors
    /// The beam is one that it cannot take, such as one that its samples do not hold.
    fn cross(&mut self, sent: &Sent) -> Result<Across, Box<dyn Error + Send + Sync>>;

    /// A copy with the same memory.
    fn boxed(&self) -> Box<dyn Propagation>;
}

impl Clone for Box<dyn Propagation> {
    fn clone(&self) -> Self {
        self.boxed()
    }
}

/// How finely a wave is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveSettings {
    /// Times a second that the beam is sent through the air [Hz], a divisor of the tick rate. Between them the spot stays.
    pub rate_hz: u32,
    /// Clear aperture over the beam's 1/e² radius [-]: 1.6 lets 99.4 % through.
    pub clear_ratio: f64,
}

impl Default for WaveSettings {
    fn default() -> Self {
        Self {
            rate_hz: 120,
            clear_ratio: 1.6,
        }
    }
}

/// What a propagation is made of.
#[derive(Clone, Copy, Debug)]
pub struct PropagationContext {
    /// Seed of the run.
    pub seed: u64,
    /// The station's place in the scenario.
    pub station: u64,
    /// Ticks a second [Hz].
    pub tick_hz: u32,
    /// Outer and inner scale of the turbulence [m].
    pub scales_m: [f64; 2],
    /// Drift [1/s] and volatility [1/√s] of the paper's equation 7.
    pub paper: [f64; 2],
    /// Settings of `wave`.
    pub wave: WaveSettings,
}

impl PropagationContext {
    /// The stream of a purpose.
    pub fn stream(&self, purpose: &str) -> Stream {
        Stream::new(self.seed, self.station, purpose)
    }
}

/// What theory expects of a beam on the average, without jitter: the same for every propagation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// Long-term 1/e² radius [m].
    pub long_m: f64,
    /// Short-term 1/e² radius [m].
    pub short_m: f64,
    /// Power that arrives [W].
    pub power_w: f64,
}

impl Expected {
    /// Wander about each axis [m, rms] by which a spot of the short-term radius averages to the long-term one.
    pub fn wander_axis_m(&self) -> f64 {
        0.5 * (self.long_m.powi(2) - self.short_m.powi(2)).max(0.0).sqrt()
    }
}

impl Sent<'_> {
    /// What theory expects of it.
    pub fn expected(&self) -> Expected {
        let w_m = self.laser.spot_radius_m(self.range_m, self.focus_m);
        // Blooming spreads the power that it takes from the peak. A beam that is off warms nothing.
        let bloomed = match self.fires {
            true => {
                let warmed = &self.air.warmed;
                let number = (self.laser).distortion_number(self.range_m, self.focus_m, warmed);
                blooming_factor(number).sqrt()
            }
            false => 1.0,
        };
        let turbulence = &self.air.turbulence;
        Expected {
            long_m: turbulence.long_term_radius_m(w_m) / bloomed,
            short_m: turbulence.short_term_radius_m(w_m) / bloomed,
            power_w: self.laser.power_w
                * transmittance(self.air.warmed.extinction_per_m, self.range_m),
        }
    }
}
