//! Automatic exposure and white balance of a camera.
//!
//! The control is highlight-weighted, as machine-vision and video cameras offer it: a metered
//! luminance that leans to the bright parts of the field is put at a set share of the white level,
//! with the exposure time first and gain after it, and approached exponentially in stops.
//!
//! Assumptions: gain amplifies without noise of its own; the metered luminance is the caller's, so
//! that a simulation may meter its model of the light and stay the same with and without pictures.

use crate::air::daylight::{chromaticity_x, daylight};

/// The exponent of the metered mean: the fourth power leans to the bright parts.
const METER_POWER: f64 = 4.0;
/// A camera that is read less often than it could be exposes for longer where light is short, for half the time since it was
/// last read and up to this [s]: as one of 30 Hz.
const LONGEST_S: f64 = 1.0 / 60.0;
/// Gain above which a camera is read less often, to expose for longer: 24 dB.
const NOISY_GAIN: f64 = 16.0;
/// The chromaticities x of the daylights that automatic white balance makes up for, about 10,000 K
/// to 4,000 K: bluer dusk stays a little blue, a sunset and lamplight a little red.
const BALANCED_X: [f64; 2] = [0.279, 0.382];

/// How a frame is exposed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Exposure time [s].
    pub time_s: f64,
    /// Amplification, 1 or more: a full well over it gives the brightest code.
    pub gain: f64,
}

impl Default for Exposure {
    /// A millisecond without gain.
    fn default() -> Self {
        Self {
            time_s: 1e-3, // [s]
            gain: 1.0,
        }
    }
}

/// Limits and pace of an automatic exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureControl {
    /// Share of the white level at which the metered luminance is put.
    pub level: f64,
    /// Shortest and longest exposure time [s].
    pub time_s: [f64; 2],
    /// Largest gain of an automatic exposure; a fixed one has none.
    pub max_gain: f64,
    /// Time constant of the approach [s].
    pub settling_s: f64,
}

impl ExposureControl {
    /// Whether there is nothing to control.
    pub fn is_fixed(&self) -> bool {
        self.time_s[0] == self.time_s[1]
    }

    /// The same for a frame that is read `since_s` [s] after the one before.
    pub fn read_after(mut self, since_s: f64) -> Self {
        if !self.is_fixed() {
            self.time_s[1] = self.time_s[1].max(LONGEST_S.min(0.5 * since_s));
        }
        self
    }

    /// Of how many frames, `frame_s` [s] apart, one is to be read where the light asks for a product of time and gain of
    /// `product_s` [s]: as many as keep the gain from being noisy, down to 30 Hz.
    pub fn read_every(&self, product_s: f64, frame_s: f64) -> u64 {
        let time_s = (product_s / NOISY_GAIN).min(LONGEST_S);
        if self.is_fixed() || time_s <= self.time_s[1] {
            1
        } else {
            (2.0 * time_s / frame_s).round().max(1.0) as u64
        }
    }

    /// The product of time and gain [s] that puts `metered_kcd_m2` at the level, for a sensor that
    /// `saturation_kcd_s_m2` fills; within the limits.
    pub fn wanted_s(&self, metered_kcd_m2: f64, saturation_kcd_s_m2: f64) -> f64 {
        // In the dark the quotient is infinite; the limits hold for it too.
        (self.level * saturation_kcd_s_m2 / metered_kcd_m2)
            .min(self.time_s[1] * if self.is_fixed() { 1.0 } else { self.max_gain })
            .max(self.time_s[0])
    }

    /// The same with another time: a fixed one [s], or automatic, up to half the time between frames.
    pub fn timed(self, fixed_s: Option<f64>, frame_s: f64) -> Self {
        /// Shortest automatic exposure: that of the preset's camera [s].
        const SHORTEST_S: f64 = 4e-6;
        let automatic = [SHORTEST_S, (0.5 * frame_s).max(SHORTEST_S)];
        Self {
            time_s: fixed_s.map_or(automatic, |time_s| [time_s; 2]),
            ..self
        }
    }

    /// The product of time and gain [s] a time `dt_s` after it was `now_s`.
    pub fn approach_s(&self, now_s: f64, wanted_s: f64, dt_s: f64) -> f64 {
        let share = -(-dt_s / self.settling_s).exp_m1();
        now_s * (wanted_s / now_s).powf(share)
    }

    /// The product of time and gain [s] as a frame's setting: time up to its limit, then gain.
    pub fn setting(&self, product_s: f64) -> Exposure {
        let time_s = product_s.clamp(self.time_s[0], self.time_s[1]);
        Exposure {
            time_s,
            gain: (product_s / time_s).clamp(1.0, self.max_gain),
        }
    }
}

/// The metered luminance of samples of the field: their mean in the fourth power, which sky or a
/// sunlit wall decides where there is some of it.
pub fn metered(samples_kcd_m2: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = samples_kcd_m2.fold((0.0, 0.0), |(sum, n), luminance| {
        (sum + luminance.powf(METER_POWER), n + 1.0)
    });
    (sum / f64::max(count, 1.0)).powf(1.0 / METER_POWER)
}

/// Gains of the red, green and blue channel that show a grey surface under `illuminant` (linear
/// sRGB) grey. As cameras do, they look for the light among the daylights; the smallest is 1, so that
/// what saturates stays white.
pub fn white_balance(illuminant: [f64; 3]) -> [f64; 3] {
    let Some(x) = chromaticity_x(illuminant) else {
        return [1.0; 3];
    };
    let light = daylight(x.clamp(BALANCED_X[0], BALANCED_X[1]));
    let most = light.into_iter().fold(0.0, f64::max);
    light.map(|channel| most / channel)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONTROL: ExposureControl = ExposureControl {
        level: 0.5,
        time_s: [1e-5, 4e-3],
        max_gain: 16.0,
        settling_s: 0.25,
    };

    #[test]
    fn a_camera_that_is_seldom_read_exposes_for_longer() {
        let longest_s = |since_s| CONTROL.read_after(since_s).time_s[1];
        assert_eq!(
            [1.0 / 125.0, 0.02, 10.0].map(longest_s),
            [4e-3, 0.01, 1.0 / 60.0]
        );
        let fixed = ExposureControl {
            time_s: [2e-3; 2],
            ..CONTROL
        };
        assert_eq!(fixed.read_after(1.0), fixed);
    }

    #[test]
    fn a_camera_is_read_less_often_where_gain_would_be_noisy() {
        let every = |product_s| CONTROL.read_every(product_s, 8e-3);
        // Up to 4 ms at a gain of 16 each frame is read; beyond, the gain stays at 16 down to 30 Hz.
        assert_eq!([0.01, 0.06, 0.128, 0.2, 9.0].map(every), [1, 1, 2, 3, 4]);
        let fixed = ExposureControl {
            time_s: [2e-3; 2],
            ..CONTROL
        };
        assert_eq!(fixed.read_every(9.0, 8e-3), 1);
    }

    #[test]
    fn time_comes_before_gain_and_both_end_at_their_limits() {
        for (metered_kcd_m2, time_s, gain) in [
            (5.0, 1e-3, 1.0),
            (1.25, 4e-3, 1.0),
            (0.625, 4e-3, 2.0),
            (0.0, 4e-3, 16.0),
            (1e9, 1e-5, 1.0),
        ] {
            let found = CONTROL.setting(CONTROL.wanted_s(metered_kcd_m2, 1e-2));
            assert!((found.time_s / time_s - 1.0).abs() < 1e-12, "{found:?}");
            assert!((found.gain / gain - 1.0).abs() < 1e-12, "{found:?}");
        }
    }

    #[test]
    fn the_approach_is_exponential_in_stops() {
        // Four stops apart; after one time constant 1/e of them are left, in steps or at once.
        let (start, wanted) = (1e-3, 16e-3);
        let once = CONTROL.approach_s(start, wanted, 0.25);
        let left = (wanted / once).log2();
        assert!((left - 4.0 / std::f64::consts::E).abs() < 1e-12, "{left}");
        let stepped = (0..25).fold(start, |now, _| CONTROL.approach_s(now, wanted, 0.01));
        assert!((stepped / once - 1.0).abs() < 1e-12);
    }

    #[test]
    fn metering_leans_to_the_bright_parts() {
        assert!((metered([3.0; 12].into_iter()) - 3.0).abs() < 1e-12);
        let half_dark = metered([0.1, 8.0].into_iter());
        // 8 (1/2)^(1/4)
        assert!((half_dark - 6.727_171).abs() < 1e-4, "{half_dark}");
        assert_eq!(metered(std::iter::empty()), 0.0);
    }

    #[test]
    fn white_balance_makes_grey_grey_within_its_range() {
        for x in [0.29, 0.3127, 0.34, 0.37] {
            let illuminant = daylight(x);
            let gains = white_balance(illuminant);
            let grey: Vec<f64> = (0..3).map(|c| gains[c] * illuminant[c]).collect();
            assert!(grey.iter().all(|g| (g / grey[0] - 1.0).abs() < 1e-3));
            assert!((gains.into_iter().fold(f64::MAX, f64::min) - 1.0).abs() < 1e-12);
        }
        // Deep twilight stays blue, a black night is left alone.
        let dusk = white_balance([0.6, 1.0, 2.1]);
        assert!(dusk[2] * 2.1 > 1.3 * dusk[0] * 0.6);
        assert_eq!(white_balance([0.0; 3]), [1.0; 3]);
    }
}
