//! Two-axis fast steering mirror: a second-order servo per axis with a limited stroke.
//!
//! Angles are deflections of the line of sight. The linear part is stepped exactly for a command
//! held over the tick (state-transition matrix); the stroke limits the command, as the position
//! loop of a real mirror does, so the transient overshoot (4.6 % at ζ = 0.7) may pass it briefly.
//! The loop closes on a sensor, so that the mirror follows the sensor's noise as far as it can.
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
    /// Noise of its position sensor on each axis, one reading a tick, as an angle of the line of sight [rad, 1 σ].
    pub noise_rad: f64,
}

impl Default for MirrorParams {
    /// A voice-coil mirror of 50 mm class with several milliradians of stroke. Newport's FSM-300
    /// manual (25 mm) gives 400 Hz at 60° of lag, which at ζ = 0.7 is a natural frequency of
    /// 715 Hz; Nam et al. 2017 reach a small-signal bandwidth of 500 Hz with a larger mirror. The same
    /// manual gives a noise of 3 µrad of the mirror up to 10 kHz: of its part up to 480 Hz, half of a
    /// tick's rate, a tenfold telescope leaves 0.13 µrad of the line of sight.
    fn default() -> Self {
        Self {
            natural_frequency_hz: 500.0, // [Hz]
            damping: 0.7,
            stroke_rad: 5e-3,   // [rad]
            noise_rad: 0.13e-6, // [rad]
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
    /// What the sensor adds in this tick.
    noise_rad: DVec2,
    rate_radps: DVec2,
    at_stop: bool,
}

impl Mirror {
    /// A centred mirror at rest, to be stepped every `dt_s`.
    pub fn new(params: &MirrorParams, dt_s: f64) -> Result<Self, SecondOrderError> {
        for size_rad in [params.stroke_rad, params.noise_rad] {
            if !(size_rad >= 0.0 && size_rad.is_finite()) {
                return Err(SecondOrderError::Amplitude(size_rad));
            }
        }
        Ok(Self {
            transition: second_order_transition(params.natural_frequency_hz, params.damping, dt_s)?,
            stroke_rad: params.stroke_rad,
            deflection_rad: DVec2::ZERO,
            noise_rad: DVec2::ZERO,
            rate_radps: DVec2::ZERO,
            at_stop: false,
        })
    }

    /// Takes the noise of the sensor's next reading [rad], right and up: the loop follows it in the next step.
    pub fn read(&mut self, noise_rad: DVec2) {
        self.noise_rad = noise_rad;
    }

    /// Line-of-sight deflection by its sensor [rad], right and up.
    pub fn measured_rad(&self) -> DVec2 {
        self.deflection_rad + self.noise_rad
    }

    /// Holds `command_rad` (limited to the stroke) over one step and returns the deflection [rad].
    pub fn step(&mut self, command_rad: DVec2) -> DVec2 {
        let limit = DVec2::splat(self.stroke_rad);
        let target = command_rad.clamp(-limit, limit);
        self.at_stop = command_rad.abs().max_element() >= STOP_SHARE * self.stroke_rad;
        // What reads as the target is the target less the noise.
        let target = target - self.noise_rad;
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
    fn the_mirror_follows_its_sensors_noise() {
        // White noise of one reading a tick through the sampled loop: the variance of x with
        // x' = A x − B n is what the discrete Lyapunov equation gives, summed here over the impulse's
        // response.
        let params = MirrorParams::default();
        let mut impulse = Mirror::new(&params, DT).unwrap();
        impulse.read(DVec2::new(-1.0, 0.0));
        let mut answer = vec![impulse.step(DVec2::ZERO).x];
        impulse.read(DVec2::ZERO);
        answer.extend((0..100).map(|_| impulse.step(DVec2::ZERO).x));
        let gain = answer.iter().map(|x| x * x).sum::<f64>().sqrt();
        let mut mirror = Mirror::new(&params, DT).unwrap();
        let mut rng = crate::maths::rng::Stream::new(1, 0, "mirror");
        let mut square = 0.0;
        for _ in 0..40_000 {
            mirror.step(DVec2::ZERO);
            let noise = params.noise_rad * DVec2::new(rng.normal(), rng.normal());
            mirror.read(noise);
            square += mirror.deflection_rad().length_squared();
            assert_eq!(mirror.measured_rad(), mirror.deflection_rad() + noise);
        }
        let rms_rad = (square / 80_000.0).sqrt();
        assert!((rms_rad / (gain * params.noise_rad) - 1.0).abs() < 0.02);
        assert!(gain > 0.7 && gain < 1.3, "{gain}");
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
        assert!(bad(|p| p.noise_rad = -1e-6));
        assert!(Mirror::new(&MirrorParams::default(), 0.0).is_err());
    }
}
