//! Two-axis fast steering mirror: a second-order servo per axis with a limited stroke.
//!
//! Angles are deflections of the line of sight. The linear part is stepped exactly for a command
//! held over the tick (state-transition matrix); the stroke limits the command, as the position
//! loop of a real mirror does, so the transient overshoot (4.6 % at ζ = 0.7) may pass it briefly.
//! Nothing here unloads the mirror: the tuned law's gimbal closes on the line of sight itself, which
//! brings the mirror back to its centre.

use glam::DVec2;

use crate::maths::second_order::{SecondOrderError, second_order_transition};

/// A fast steering mirror's servo; both axes alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorParams {
    /// Natural frequency of the closed position loop [Hz].
    pub natural_frequency_hz: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Largest commanded line-of-sight deflection to each side of each axis [rad].
    pub stroke_rad: f64,
}

impl Default for MirrorParams {
    /// A voice-coil mirror of 50 mm class with several milliradians of stroke. Newport's FSM-300
    /// manual (25 mm) gives 400 Hz at 60° of lag, which at ζ = 0.7 is a natural frequency of
    /// 715 Hz; Nam et al. 2017 reach a small-signal bandwidth of 500 Hz with a larger mirror.
    fn default() -> Self {
        Self {
            natural_frequency_hz: 500.0, // [Hz]
            damping: 0.7,
            stroke_rad: 5e-3, // [rad]
        }
    }
}

#[cfg(test)]
impl MirrorParams {
    /// Delay [s] of the mirror behind a steadily moving command: 2ζ/ω.
    pub(crate) fn delay_s(&self) -> f64 {
        2.0 * self.damping / (std::f64::consts::TAU * self.natural_frequency_hz)
    }
}

/// Share of the stroke from which a command counts as one to the stop: controllers limit their
/// commands to the stroke, but for rounding.
const STOP_SHARE: f64 = 0.999;

/// A fast steering mirror: line-of-sight deflection right (x, cross-elevation) and up (y).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mirror {
    transition: [[f64; 2]; 2],
    stroke_rad: f64,
    deflection_rad: DVec2,
    rate_radps: DVec2,
    at_stop: bool,
}

impl Mirror {
    /// A centred mirror at rest, to be stepped every `dt_s`.
    pub fn new(params: &MirrorParams, dt_s: f64) -> Result<Self, SecondOrderError> {
        if !(params.stroke_rad >= 0.0 && params.stroke_rad.is_finite()) {
            return Err(SecondOrderError::Amplitude(params.stroke_rad));
        }
        Ok(Self {
            transition: second_order_transition(params.natural_frequency_hz, params.damping, dt_s)?,
            stroke_rad: params.stroke_rad,
            deflection_rad: DVec2::ZERO,
            rate_radps: DVec2::ZERO,
            at_stop: false,
        })
    }

    /// Holds `command_rad` (limited to the stroke) over one step and returns the deflection [rad].
    pub fn step(&mut self, command_rad: DVec2) -> DVec2 {
        let limit = DVec2::splat(self.stroke_rad);
        let target = command_rad.clamp(-limit, limit);
        self.at_stop = command_rad.abs().max_element() >= STOP_SHARE * self.stroke_rad;
        let offset = self.deflection_rad - target;
        let [[a, b], [c, d]] = self.transition;
        let rate = self.rate_radps;
        self.deflection_rad = target + a * offset + b * rate;
        self.rate_radps = c * offset + d * rate;
        self.deflection_rad
    }

    /// Present line-of-sight deflection [rad], right and up.
    pub fn deflection_rad(&self) -> DVec2 {
        self.deflection_rad
    }

    /// Whether the last command asked for the end of the stroke or more, on either axis.
    pub fn at_stop(&self) -> bool {
        self.at_stop
    }

    /// Present line-of-sight rate [rad/s], right and up.
    pub fn rate_radps(&self) -> DVec2 {
        self.rate_radps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const DT: f64 = 1.0 / 960.0;

    #[test]
    fn step_response_is_the_closed_form() {
        for damping in [0.05f64, 0.7, 1.0, 1.8] {
            let params = MirrorParams {
                damping,
                ..Default::default()
            };
            let mut mirror = Mirror::new(&params, DT).unwrap();
            let w = TAU * params.natural_frequency_hz;
            let closed = |t: f64| {
                let s = damping * w;
                if damping < 1.0 {
                    let wd = w * (1.0 - damping * damping).sqrt();
                    1.0 - (-s * t).exp() * ((wd * t).cos() + s / wd * (wd * t).sin())
                } else if damping == 1.0 {
                    1.0 - (-w * t).exp() * (1.0 + w * t)
                } else {
                    let root = w * (damping * damping - 1.0).sqrt();
                    let (p, q) = (s - root, s + root);
                    1.0 - (q * (-p * t).exp() - p * (-q * t).exp()) / (q - p)
                }
            };
            for k in 1..200 {
                let y = mirror.step(DVec2::new(1e-3, -2e-3));
                let expected = 1e-3 * closed(f64::from(k) * DT);
                assert!((y.x - expected).abs() < 1e-9 * 1e-3, "{damping} {k}");
                assert!((y.y + 2.0 * expected).abs() < 2e-9 * 1e-3);
            }
        }
    }

    #[test]
    fn stroke_limits_and_ramp_delay() {
        let params = MirrorParams::default();
        let mut mirror = Mirror::new(&params, DT).unwrap();
        for _ in 0..500 {
            mirror.step(DVec2::new(1.0, -1.0));
        }
        assert!((mirror.deflection_rad() - DVec2::new(5e-3, -5e-3)).length() < 1e-15);
        assert!(mirror.at_stop());
        mirror.step(DVec2::new(0.0, -5e-3));
        assert!(mirror.at_stop());
        mirror.step(DVec2::splat(4.9e-3));
        assert!(!mirror.at_stop());
        // A ramp sampled and held lags by 2ζ/ω + dt/2 on average over the tick; at the tick's end
        // the held command is one dt old.
        let mut mirror = Mirror::new(&params, DT).unwrap();
        let rate = 0.01; // [rad/s]
        let mut t = 0.0;
        for _ in 0..300 {
            mirror.step(DVec2::splat(rate * t));
            t += DT;
        }
        let lag = t - mirror.deflection_rad().x / rate;
        assert!(
            (lag - params.delay_s() - 0.5 * DT).abs() < 0.1 * DT,
            "{lag}"
        );
    }

    #[test]
    fn bad_mirrors_are_refused() {
        let bad = |f: fn(&mut MirrorParams)| {
            let mut p = MirrorParams::default();
            f(&mut p);
            Mirror::new(&p, DT).is_err()
        };
        assert!(bad(|p| p.natural_frequency_hz = 0.0));
        assert!(bad(|p| p.damping = -0.7));
        assert!(bad(|p| p.stroke_rad = f64::NAN));
        assert!(Mirror::new(&MirrorParams::default(), 0.0).is_err());
    }
}
