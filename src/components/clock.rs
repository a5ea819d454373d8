//! Simulated time.

use bevy::prelude::Resource;

/// The simulation's own clock: fixed ticks, never the wall clock.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Eq)]
pub struct SimClock {
    /// Ticks since the start; the state after the systems of tick `n` is the state at `n / tick_hz`.
    pub tick: u64,
    /// Ticks per second.
    pub tick_hz: u32,
}

impl SimClock {
    /// Simulated time [s].
    pub fn t_s(&self) -> f64 {
        self.tick as f64 / f64::from(self.tick_hz)
    }

    /// Length of a tick [s].
    pub fn dt_s(&self) -> f64 {
        1.0 / f64::from(self.tick_hz)
    }

    /// Simulated time of `tick` [s].
    pub fn at_s(&self, tick: u64) -> f64 {
        tick as f64 / f64::from(self.tick_hz)
    }

    /// Whole ticks that cover a duration; a latency never ends early.
    pub fn ticks_of(&self, duration_s: f64) -> u64 {
        // The small slack keeps a duration that is a whole number of ticks from rounding up.
        (duration_s * f64::from(self.tick_hz) - 1e-9)
            .ceil()
            .max(0.0) as u64
    }
}
