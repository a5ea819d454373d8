//! The range of a track: echoes of the range finder, and what a radar tells.

use super::track::{Lased, Track};
use std::ops::Range;

/// An echo of the range finder says for so long how far its track is [s].
const ECHO_S: f64 = 1.0;

impl Track {
    /// The range finder's last echo from it, if that still says how far it is.
    pub fn echo(&self, t_s: f64) -> Option<Lased> {
        self.lased.filter(|lased| t_s - lased.t_s < ECHO_S)
    }

    /// Its size [m]: the larger side of its box at the range of that echo.
    pub fn measured_span_m(&self, t_s: f64) -> Option<f64> {
        self.echo(t_s).map(|lased| self.size_rad * lased.range_m)
    }

    /// Takes in a measured range [m] with its standard deviation [m]; the manoeuvres that the
    /// filter expects on the sky follow from it.
    pub fn ranged(&mut self, range_m: f64, sigma_m: f64, t_s: f64) {
        if !self
            .range
            .gate_m(t_s)
            .is_none_or(|gate| gate.contains(&range_m))
        {
            self.range.restart();
        }
        self.unanswered = 0;
        self.range.on_laser(range_m, sigma_m, t_s);
        if let Some((range_m, _)) = self.range.range_m(t_s) {
            self.filter.set_range_m(range_m);
        }
    }

    /// Takes in the range [m] that a radar tells, with its standard deviation [m].
    pub fn ranged_by_radar(&mut self, range_m: f64, sigma_m: f64, t_s: f64) {
        self.ranged_by_radar = true;
        self.ranged(range_m, sigma_m, t_s);
    }

    /// The ranges [m] at which an echo may be the target's at `t_s` [s]; all of them after several pulses
    /// without one, or that something nearer kept answering first, since the estimate may be wrong: it was another's
    /// echo, or no target is so large.
    pub fn range_gate(&self, t_s: f64) -> Range<f64> {
        const UNANSWERED: u32 = 4;
        const NEARER: u32 = 5;
        if self.unanswered >= UNANSWERED || self.nearer.0 >= NEARER {
            return 0.0..f64::INFINITY;
        }
        self.range.gate_m(t_s).unwrap_or(0.0..f64::INFINITY)
    }

    /// Notes the first thing that a pulse met, in the gate or not [m]: the first pulse of all may have passed the target by
    /// and met the hill behind it. Where a radar has told the range, what is nearer is another thing.
    pub fn met_first(&mut self, first_m: Option<f64>, t_s: f64) {
        if self.ranged_by_radar {
            return;
        }
        // What keeps its distance so well from pulse to pulse is one thing [m].
        const SAME_M: f64 = 10.0;
        let gate = self.range.gate_m(t_s);
        let (pulses, before_m) = self.nearer;
        self.nearer = match first_m.filter(|m| gate.is_some_and(|gate| *m < gate.start)) {
            Some(m) if pulses > 0 && (m - before_m).abs() < SAME_M => (pulses + 1, m),
            Some(m) => (1, m),
            None => (0, 0.0),
        };
    }

    /// A pulse had no echo within the gate.
    pub fn unanswered(&mut self) {
        self.unanswered += 1;
    }
}
