//! Rate gyro of one or more axes: white noise, bias that wanders, drift, bandwidth and delay.
//!
//! The noise is that of IEEE Std 952: angle random walk N, bias instability B and rate random walk
//! K, whose Allan deviations over an averaging time τ are N/√τ, about 0.664 B and K √(τ/3). Bias
//! instability is flicker, which has no finite model; a first-order Gauss–Markov process stands
//! for it, its Allan deviation as high at the top as flicker's floor. What turns reaches the
//! reading through a first-order low pass and a pure delay. Both are known from the data sheet,
//! so that a station may allow for their sum, [`GyroParams::lag_s`].

use std::collections::VecDeque;
use std::f64::consts::TAU;

use glam::DVec3;
use thiserror::Error;

use crate::maths::rng::Stream;

/// One degree an hour [rad/s].
pub const DEG_PER_HOUR: f64 = std::f64::consts::PI / 180.0 / 3600.0;
/// One degree a root hour [rad/√s].
pub const DEG_PER_ROOT_HOUR: f64 = std::f64::consts::PI / 180.0 / 60.0;

/// Correlation time of the wandering bias [s]: flicker's floor is flat about its top, at 1.89 times
/// this (IEEE Std 952, annex C). Chosen; runs are shorter.
const BIAS_TIME_S: f64 = 100.0;
/// Standard deviation of that process by the bias instability: 0.664 is flicker's Allan floor, 0.618
/// the top of a Gauss–Markov process of unit variance (0.437 √2).
const BIAS_SIGMA: f64 = 0.664 / 0.618;

/// A gyro's flaws; each may be 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GyroParams {
    /// Angle random walk N [rad/√s].
    pub angle_walk: f64,
    /// Bias instability B [rad/s].
    pub bias_radps: f64,
    /// Rate random walk K [rad/s/√s].
    pub rate_walk: f64,
    /// Frequency at which the reading is 3 dB down [Hz]; `None` reads without a filter.
    pub bandwidth_hz: Option<f64>,
    /// Pure delay of the reading [s].
    pub delay_s: f64,
}

/// A gyro parameter out of its range.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("gyro parameter {name} = {value} is out of range; give a plain value, not below 0")]
pub struct GyroError {
    /// Field name.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
}

impl GyroParams {
    /// A small closed-loop fibre gyro (assumed, no particular product): the class is sold with 0.01
    /// to 0.02°/√h, 0.05 to 0.1°/h and up to a kilohertz.
    pub const FIBRE: Self = Self {
        angle_walk: 0.01 * DEG_PER_ROOT_HOUR,
        bias_radps: 0.05 * DEG_PER_HOUR,
        rate_walk: 0.01 * DEG_PER_HOUR / 60.0, // 0.01°/h/√h
        bandwidth_hz: Some(1000.0),            // [Hz]
        delay_s: 0.1e-3,                       // [s]
    };
    /// A tactical MEMS gyro (assumed): fifteen times the walk, ten times the bias, slower.
    pub const MEMS: Self = Self {
        angle_walk: 0.15 * DEG_PER_ROOT_HOUR,
        bias_radps: 0.5 * DEG_PER_HOUR,
        rate_walk: 0.1 * DEG_PER_HOUR / 60.0,
        bandwidth_hz: Some(260.0), // [Hz]
        delay_s: 1.5e-3,           // [s]
    };

    /// Time [s] by which a slow motion is read late: delay and filter together.
    pub fn lag_s(&self) -> f64 {
        self.delay_s + self.bandwidth_hz.map_or(0.0, |hz| 1.0 / (TAU * hz))
    }

    /// This gyro without noise.
    pub fn quiet(self) -> Self {
        Self {
            angle_walk: 0.0,
            bias_radps: 0.0,
            rate_walk: 0.0,
            ..self
        }
    }

    /// Checks every field.
    pub fn validate(&self) -> Result<(), GyroError> {
        let fields = [
            ("angle_walk", self.angle_walk, 0.0),
            ("bias_radps", self.bias_radps, 0.0),
            ("rate_walk", self.rate_walk, 0.0),
            ("bandwidth_hz", self.bandwidth_hz.unwrap_or(1.0), 1e-3),
            ("delay_s", self.delay_s, 0.0),
        ];
        let wrong = fields
            .iter()
            .find(|(_, value, least)| !(value.is_finite() && value >= least));
        wrong.map_or(Ok(()), |&(name, value, _)| Err(GyroError { name, value }))
    }
}

/// What a gyro of `N` axes adds to what it reads.
#[derive(Clone, Debug)]
struct Noise<const N: usize> {
    params: GyroParams,
    rng: Stream,
    bias_radps: [f64; N],
    drift_radps: [f64; N],
}

impl<const N: usize> Noise<N> {
    /// The bias at the start is taken to be calibrated away; it wanders from there.
    fn new(params: GyroParams, rng: Stream) -> Self {
        Self {
            params,
            rng,
            bias_radps: [0.0; N],
            drift_radps: [0.0; N],
        }
    }

    /// Adds the noise of a tick of `dt_s` [s] to rates [rad/s].
    fn add(&mut self, mut rates_radps: [f64; N], dt_s: f64) -> [f64; N] {
        let keep = (-dt_s / BIAS_TIME_S).exp();
        let kick_radps = BIAS_SIGMA * self.params.bias_radps * (1.0 - keep * keep).sqrt();
        for (i, rate_radps) in rates_radps.iter_mut().enumerate() {
            self.bias_radps[i] = keep * self.bias_radps[i] + kick_radps * self.rng.normal();
            self.drift_radps[i] += self.params.rate_walk * dt_s.sqrt() * self.rng.normal();
            let white_radps = self.params.angle_walk / dt_s.sqrt() * self.rng.normal();
            *rate_radps += self.bias_radps[i] + self.drift_radps[i] + white_radps;
        }
        rates_radps
    }
}

/// The way of `N` rates through a gyro's filter and delay.
#[derive(Clone, Debug)]
struct Lag<const N: usize> {
    filtered_radps: [f64; N],
    /// Filtered rates of the last ticks, the newest first.
    line: VecDeque<[f64; N]>,
}

impl<const N: usize> Lag<N> {
    /// At rest so far.
    fn new() -> Self {
        Self {
            filtered_radps: [0.0; N],
            line: VecDeque::new(),
        }
    }

    /// What comes out of rates [rad/s] that are held over a tick of `dt_s` [s].
    fn pass(&mut self, params: &GyroParams, rates_radps: [f64; N], dt_s: f64) -> [f64; N] {
        // Mean of the filter's output over the tick: so the sum of what comes out lags the sum of the rates by
        // the filter's own 1/ω, however coarse the tick.
        let mut mean_radps = rates_radps;
        if let Some(hz) = params.bandwidth_hz {
            let turn = TAU * hz * dt_s;
            let through = -(-turn).exp_m1();
            for i in 0..N {
                let behind_radps = rates_radps[i] - self.filtered_radps[i];
                mean_radps[i] -= behind_radps * through / turn;
                self.filtered_radps[i] += through * behind_radps;
            }
        }
        let late = params.delay_s / dt_s;
        let (whole, part) = (late.floor() as usize, late.fract());
        self.line.push_front(mean_radps);
        self.line.truncate(whole + 2);
        let at = |ago: usize| self.line.get(ago).copied().unwrap_or([0.0; N]);
        let (newer, older) = (at(whole), at(whole + 1));
        std::array::from_fn(|i| (1.0 - part) * newer[i] + part * older[i])
    }
}

/// A gyro of `N` axes.
#[derive(Clone, Debug)]
pub struct Gyro<const N: usize> {
    noise: Noise<N>,
    lag: Lag<N>,
}

impl<const N: usize> Gyro<N> {
    /// A gyro at rest.
    pub fn new(params: GyroParams, rng: Stream) -> Self {
        Self {
            noise: Noise::new(params, rng),
            lag: Lag::new(),
        }
    }

    /// Its constants.
    pub fn params(&self) -> &GyroParams {
        &self.noise.params
    }

    /// Reads rates [rad/s] that were held over a tick of `dt_s` [s].
    pub fn read(&mut self, rates_radps: [f64; N], dt_s: f64) -> [f64; N] {
        let late_radps = self.lag.pass(&self.noise.params, rates_radps, dt_s);
        self.noise.add(late_radps, dt_s)
    }
}

/// A gyro that integrates the tilt of a base from a levelled start.
#[derive(Clone, Debug)]
pub struct TiltGyro {
    noise: Noise<3>,
    rate_lag: Lag<3>,
    turn_lag: Lag<3>,
    turned_enu_rad: DVec3,
    /// Measured rate about east, north and up [rad/s].
    pub rate_enu_radps: DVec3,
    /// Tilt [rad]: what it turned, brought forward by the gyro's known lag.
    pub tilt_enu_rad: DVec3,
}

impl TiltGyro {
    /// A gyro that knows the tilt [rad] it starts at.
    pub fn new(params: GyroParams, rng: Stream, tilt_enu_rad: DVec3) -> Self {
        Self {
            noise: Noise::new(params, rng),
            rate_lag: Lag::new(),
            turn_lag: Lag::new(),
            turned_enu_rad: tilt_enu_rad,
            rate_enu_radps: DVec3::ZERO,
            tilt_enu_rad,
        }
    }

    /// Reads a tick of `dt_s` [s]: the base's turn [rad] in it and its rate [rad/s] at the end. The turn is integrated
    /// inside, as a fibre gyro does; the rate is of the moment, as the rotors' gyros read theirs: the station
    /// compares the two, and a load that stands still in space turns against the base as the base turns.
    pub fn read(&mut self, turned_enu_rad: DVec3, rate_enu_radps: DVec3, dt_s: f64) {
        let params = self.noise.params;
        let added = DVec3::from(self.noise.add([0.0; 3], dt_s));
        let rate = self.rate_lag.pass(&params, rate_enu_radps.to_array(), dt_s);
        let turn = (turned_enu_rad / dt_s).to_array();
        let turn = DVec3::from(self.turn_lag.pass(&params, turn, dt_s));
        self.rate_enu_radps = DVec3::from(rate) + added;
        self.turned_enu_rad += (turn + added) * dt_s;
        self.tilt_enu_rad = self.turned_enu_rad + self.rate_enu_radps * params.lag_s();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::statistics::allan_deviation;

    const DT_S: f64 = 1.0 / 960.0; // [s]

    fn noise(params: GyroParams, dt_s: f64, count: usize) -> Vec<f64> {
        let mut gyro = Gyro::<1>::new(params, Stream::new(3, 0, "gyro"));
        (0..count).map(|_| gyro.read([0.0], dt_s)[0]).collect()
    }

    #[test]
    fn allan_deviation_is_that_of_the_standard() {
        let only = GyroParams::default();
        // Angle random walk: N/√τ.
        let walk = noise(
            GyroParams {
                angle_walk: 2e-6,
                ..only
            },
            DT_S,
            200_000,
        );
        for m in [1, 10, 100, 1000] {
            let theory = 2e-6 / (m as f64 * DT_S).sqrt();
            let ratio = allan_deviation(&walk, m).unwrap() / theory;
            assert!((ratio - 1.0).abs() < 0.1, "{m}: {ratio}");
        }
        // Rate random walk: K √(τ/3).
        let drift = noise(
            GyroParams {
                rate_walk: 1e-7,
                ..only
            },
            DT_S,
            400_000,
        );
        for m in [100, 1000, 5000] {
            let theory = 1e-7 * (m as f64 * DT_S / 3.0).sqrt();
            let ratio = allan_deviation(&drift, m).unwrap() / theory;
            assert!((ratio - 1.0).abs() < 0.15, "{m}: {ratio}");
        }
        // Bias instability: 0.664 B at the top, τ = 1.89 times the correlation time.
        let bias = noise(
            GyroParams {
                bias_radps: 1e-6,
                ..only
            },
            1.0,
            400_000,
        );
        let ratio = allan_deviation(&bias, 189).unwrap() / 0.664e-6;
        assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
    }

    #[test]
    fn a_ramp_is_read_late_by_the_lag() {
        let params = GyroParams {
            bandwidth_hz: Some(200.0),
            delay_s: 2.6e-3,
            ..GyroParams::default()
        };
        let mut gyro = Gyro::<2>::new(params, Stream::new(0, 0, "gyro"));
        let mut late_s = 0.0;
        for k in 0..200 {
            let t_s = f64::from(k) * DT_S;
            let read = gyro.read([t_s, -2.0 * t_s], DT_S);
            assert!((read[1] + 2.0 * read[0]).abs() < 1e-12);
            late_s = t_s - read[0];
        }
        assert!((late_s - params.lag_s()).abs() < 1e-9, "{late_s}");
        // With neither it is the rate itself.
        let mut plain = Gyro::<1>::new(GyroParams::default(), Stream::new(0, 0, "gyro"));
        assert_eq!(plain.read([0.25], DT_S), [0.25]);
    }

    #[test]
    fn the_filter_is_three_decibels_down_at_its_bandwidth() {
        let params = GyroParams {
            bandwidth_hz: Some(50.0),
            ..GyroParams::default()
        };
        let dt_s = 1e-5; // [s], so fine that the held rate does not matter
        let mut gyro = Gyro::<1>::new(params, Stream::new(0, 0, "gyro"));
        let mut peak = 0.0_f64;
        for k in 0..20_000 {
            let read = gyro.read([(TAU * 50.0 * f64::from(k) * dt_s).sin()], dt_s);
            if k > 10_000 {
                peak = peak.max(read[0]);
            }
        }
        assert!((peak - 0.5_f64.sqrt()).abs() < 2e-3, "{peak}");
    }

    #[test]
    fn the_tilt_allows_for_the_lag() {
        // A base that sways by 100 µrad at 1 Hz: what the lag costs is left to second order.
        let params = GyroParams::FIBRE.quiet();
        let sway = |t_s: f64| 1e-4 * (TAU * t_s).sin();
        let mut gyro = TiltGyro::new(params, Stream::new(0, 0, "gyro"), DVec3::ZERO);
        let (mut worst_rad, mut late_rad) = (0.0_f64, 0.0_f64);
        for k in 1..2000 {
            let t_s = f64::from(k) * DT_S;
            let rate_radps = 1e-4 * TAU * (TAU * t_s).cos();
            let turned_rad = sway(t_s) - sway(t_s - DT_S);
            gyro.read(DVec3::X * turned_rad, DVec3::X * rate_radps, DT_S);
            if k < 100 {
                continue; // it starts with a jerk
            }
            worst_rad = worst_rad.max((gyro.tilt_enu_rad.x - sway(t_s)).abs());
            late_rad = late_rad.max((gyro.turned_enu_rad.x - sway(t_s)).abs());
        }
        assert!(late_rad > 1e-7, "{late_rad}");
        assert!(worst_rad < 0.01 * late_rad, "{worst_rad} {late_rad}");
    }

    #[test]
    fn bad_gyros_are_refused() {
        assert_eq!(GyroParams::FIBRE.validate(), Ok(()));
        assert_eq!(GyroParams::MEMS.validate(), Ok(()));
        for bad in [
            GyroParams {
                delay_s: -1e-3,
                ..GyroParams::FIBRE
            },
            GyroParams {
                angle_walk: f64::NAN,
                ..GyroParams::FIBRE
            },
            GyroParams {
                bandwidth_hz: Some(0.0),
                ..GyroParams::FIBRE
            },
        ] {
            assert!(bad.validate().is_err(), "{bad:?}");
        }
    }
}
