//! Angular motion of the mast or roof a station stands on.
//!
//! Either three modes per axis, each white noise shaped by ẍ + 2ζωẋ + ω²x = w(t): the sway of the
//! building, the first bending mode of the mast, and a broad, well-damped band for machinery and
//! wind buffeting. Each is stepped with its exact transition matrix and exact process-noise
//! covariance, so rms and spectrum do not depend on the step. Or a given power spectral density,
//! cut into bands of equal logarithmic width, each a sinusoid of the band's power with a random
//! phase and a random frequency in it (Shinozuka and Deodatis 1991): the power of every band is
//! exact, the amplitude distribution nearly Gaussian. Small rotations: the three axes add as a
//! rotation vector.

use std::f64::consts::TAU;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::models::mirror::{SecondOrderError, second_order_transition};
use crate::models::rng::Stream;

/// One mode of the base's angular motion.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct TiltMode {
    /// Natural frequency [Hz].
    pub frequency_hz: f64,
    /// Damping ratio.
    pub damping: f64,
    /// Stationary rms rotation about east, north and up [rad].
    pub rms_rad: [f64; 3],
}

impl TiltMode {
    /// One-sided power spectral density [1/Hz, of a unit-rms process] at `f_hz`; times rms² it is
    /// rad²/Hz.
    pub fn psd_unit_per_hz(&self, f_hz: f64) -> f64 {
        let (w0, w) = (TAU * self.frequency_hz, TAU * f_hz);
        // The white noise of two-sided density 4ζω³ gives unit variance.
        let gap = w0 * w0 - w * w;
        let drag = 2.0 * self.damping * w0 * w;
        2.0 * 4.0 * self.damping * w0.powi(3) / (gap * gap + drag * drag)
    }
}

/// Base motion of a station.
#[derive(Clone, Copy, Debug, Deserialize, JsonSchema, PartialEq, Serialize)]
pub struct BaseMotionParams {
    /// Sway of the building.
    pub sway: TiltMode,
    /// First bending mode of the mast.
    pub mast: TiltMode,
    /// Broadband vibration.
    pub broadband: TiltMode,
}

impl Default for BaseMotionParams {
    /// A short mast on a tall office roof in a fresh breeze. Building sway near 0.3 Hz with 1 %
    /// damping is usual for some 150 m of height (f ≈ 46/H, Eurocode 1 part 1-4); the amplitudes
    /// are engineering assumptions to be replaced by a site's measurement.
    fn default() -> Self {
        Self {
            sway: TiltMode {
                frequency_hz: 0.3,
                damping: 0.01,
                rms_rad: [100e-6, 100e-6, 30e-6], // [rad]
            },
            mast: TiltMode {
                frequency_hz: 12.0,
                damping: 0.03,
                rms_rad: [50e-6, 50e-6, 20e-6], // [rad]
            },
            broadband: TiltMode {
                frequency_hz: 60.0,
                damping: 0.7,
                rms_rad: [5e-6, 5e-6, 5e-6], // [rad]
            },
        }
    }
}

/// One mode's exact discretisation (of a unit-rms process) and state per axis.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ModeState {
    transition: [[f64; 2]; 2],
    /// Lower Cholesky factor of the process-noise covariance: (l11, l21, l22).
    noise: [f64; 3],
    stationary_rate_per_s: f64,
    rms_rad: DVec3,
    x: DVec3,
    v: DVec3,
}

/// Why a base motion cannot be made from a spectrum.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum SpectrumError {
    /// Fewer than two points.
    #[error("a spectrum needs two points or more")]
    TooShort,
    /// A frequency that does not rise, or is not positive.
    #[error("frequency {0} Hz of the spectrum: frequencies must be positive and rise")]
    Frequency(f64),
    /// A density that is not positive.
    #[error("density {0} rad^2/Hz of the spectrum must be positive: leave out what has none")]
    Density(f64),
}

/// A one-sided power spectral density given at some frequencies, a power law between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum(Vec<[f64; 2]>);

impl Spectrum {
    /// The spectrum through `points`, each a frequency [Hz] and a density [rad²/Hz].
    pub fn new(points: &[[f64; 2]]) -> Result<Self, SpectrumError> {
        if points.len() < 2 {
            return Err(SpectrumError::TooShort);
        }
        let mut last = 0.0;
        for &[frequency_hz, density] in points {
            if !(frequency_hz > last && frequency_hz.is_finite()) {
                return Err(SpectrumError::Frequency(frequency_hz));
            }
            if !(density > 0.0 && density.is_finite()) {
                return Err(SpectrumError::Density(density));
            }
            last = frequency_hz;
        }
        Ok(Self(points.to_vec()))
    }

    /// Mean square [rad²] of what lies between two frequencies [Hz].
    pub fn power_rad2(&self, from_hz: f64, to_hz: f64) -> f64 {
        let mut sum = 0.0;
        for pair in self.0.windows(2) {
            let [[f0, s0], [f1, s1]] = [pair[0], pair[1]];
            let (low, high) = (from_hz.max(f0), to_hz.min(f1));
            if low >= high {
                continue;
            }
            // S = s0 (f/f0)^slope, integrated; expm1 keeps the digits at slope −1.
            let slope = (s1 / s0).ln() / (f1 / f0).ln();
            let (n, x) = (slope + 1.0, (high / low).ln());
            let width = if (n * x).abs() < 1e-12 {
                x
            } else {
                (n * x).exp_m1() / n
            };
            sum += s0 * (low / f0).powf(slope) * low * width;
        }
        sum
    }
}

/// Sinusoids of the synthesis, per axis.
const LINES: usize = 96;

/// One band of a spectrum: a phasor per axis, all turning at one frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Line {
    omega_radps: f64,
    amplitude_rad: f64,
    /// Cosine and sine of the phase advance of a step.
    turn: [f64; 2],
    re: DVec3,
    im: DVec3,
}

#[derive(Clone, Debug, PartialEq)]
// A run has one of them: its size does not matter.
#[allow(clippy::large_enum_variant)]
enum Source {
    Modes {
        modes: Box<[ModeState; 3]>,
        started: bool,
    },
    Lines(Vec<Line>),
}

/// The angular motion of a station's base; stationary from its first step.
#[derive(Clone, Debug, PartialEq)]
pub struct BaseMotion(Source);

impl BaseMotion {
    /// A base motion to be stepped every `dt_s`.
    pub fn new(params: &BaseMotionParams, dt_s: f64) -> Result<Self, SecondOrderError> {
        Ok(Self(Source::Modes {
            modes: Box::new([
                ModeState::new(&params.sway, dt_s)?,
                ModeState::new(&params.mast, dt_s)?,
                ModeState::new(&params.broadband, dt_s)?,
            ]),
            started: false,
        }))
    }

    /// A base motion of the given spectrum about each of the three axes, independent of each other,
    /// to be stepped every `dt_s`.
    pub fn from_spectrum(spectrum: &Spectrum, dt_s: f64, rng: &mut Stream) -> Self {
        let first_hz = spectrum.0[0][0];
        let ratio = spectrum.0[spectrum.0.len() - 1][0] / first_hz;
        let edge = |k: usize| first_hz * ratio.powf(k as f64 / LINES as f64);
        let lines = (0..LINES).map(|k| {
            let (low, high) = (edge(k), edge(k + 1));
            let omega_radps = TAU * rng.range(low, high);
            let mut phase = || (TAU * rng.uniform()).sin_cos();
            let [x, y, z] = [phase(), phase(), phase()];
            let (sin, cos) = (omega_radps * dt_s).sin_cos();
            Line {
                omega_radps,
                amplitude_rad: (2.0 * spectrum.power_rad2(low, high)).sqrt(),
                turn: [cos, sin],
                re: DVec3::new(x.1, y.1, z.1),
                im: DVec3::new(x.0, y.0, z.0),
            }
        });
        Self(Source::Lines(lines.collect()))
    }

    /// Advances one step (the first of the modes draws the stationary state itself) and returns the
    /// tilt: a rotation vector about the `enu` axes [rad].
    pub fn step(&mut self, rng: &mut Stream) -> DVec3 {
        match &mut self.0 {
            Source::Modes { modes, started } => {
                for mode in modes.iter_mut() {
                    if *started {
                        mode.advance(rng);
                    } else {
                        mode.start(rng);
                    }
                }
                *started = true;
            }
            Source::Lines(lines) => {
                for line in lines {
                    let [c, s] = line.turn;
                    let (re, im) = (line.re, line.im);
                    line.re = c * re - s * im;
                    line.im = s * re + c * im;
                }
            }
        }
        self.tilt_rad()
    }

    /// Present tilt, a rotation vector about the `enu` axes [rad].
    pub fn tilt_rad(&self) -> DVec3 {
        match &self.0 {
            Source::Modes { modes, .. } => modes.iter().map(|m| m.rms_rad * m.x).sum(),
            Source::Lines(lines) => lines.iter().map(|l| l.amplitude_rad * l.re).sum(),
        }
    }

    /// Present angular velocity about the `enu` axes [rad/s]: what a base gyro measures.
    pub fn rate_radps(&self) -> DVec3 {
        match &self.0 {
            Source::Modes { modes, .. } => modes.iter().map(|m| m.rms_rad * m.v).sum(),
            Source::Lines(lines) => lines
                .iter()
                .map(|l| -(l.omega_radps * l.amplitude_rad) * l.im)
                .sum(),
        }
    }
}

impl ModeState {
    fn new(mode: &TiltMode, dt_s: f64) -> Result<Self, SecondOrderError> {
        if let Some(bad) = mode
            .rms_rad
            .iter()
            .find(|rms| !(**rms >= 0.0 && rms.is_finite()))
        {
            return Err(SecondOrderError::Amplitude(*bad));
        }
        let phi = second_order_transition(mode.frequency_hz, mode.damping, dt_s)?;
        let omega = TAU * mode.frequency_hz;
        let w2 = omega * omega;
        // The stationary covariance is diag(1, ω²), so Q = P − Φ P Φᵀ.
        let q11 = 1.0 - (phi[0][0].powi(2) + w2 * phi[0][1].powi(2));
        let q12 = -(phi[0][0] * phi[1][0] + w2 * phi[0][1] * phi[1][1]);
        let q22 = w2 - (phi[1][0].powi(2) + w2 * phi[1][1].powi(2));
        // Rounding may leave a tiny negative pivot when the step is far below the period.
        let l11 = q11.max(0.0).sqrt();
        let l21 = if l11 > 0.0 { q12 / l11 } else { 0.0 };
        let l22 = (q22 - l21 * l21).max(0.0).sqrt();
        Ok(Self {
            transition: phi,
            noise: [l11, l21, l22],
            stationary_rate_per_s: omega,
            rms_rad: DVec3::from_array(mode.rms_rad),
            x: DVec3::ZERO,
            v: DVec3::ZERO,
        })
    }

    fn start(&mut self, rng: &mut Stream) {
        self.x = rng.normal3();
        self.v = self.stationary_rate_per_s * rng.normal3();
    }

    fn advance(&mut self, rng: &mut Stream) {
        let (n1, n2) = (rng.normal3(), rng.normal3());
        let [[a, b], [c, d]] = self.transition;
        let [l11, l21, l22] = self.noise;
        let (x, v) = (self.x, self.v);
        self.x = a * x + b * v + l11 * n1;
        self.v = c * x + d * v + l21 * n1 + l22 * n2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 1.0 / 960.0;

    fn only(mode: TiltMode) -> BaseMotionParams {
        let quiet = TiltMode {
            rms_rad: [0.0; 3],
            ..mode
        };
        BaseMotionParams {
            sway: quiet,
            mast: mode,
            broadband: quiet,
        }
    }

    #[test]
    fn psd_integrates_to_one_and_peaks_at_resonance() {
        let mode = BaseMotionParams::default().mast;
        let step = 1e-3;
        let sum: f64 = (0..4_000_000)
            .map(|k| mode.psd_unit_per_hz((f64::from(k) + 0.5) * step) * step)
            .sum();
        // The tail above 4 kHz is below 1e-8.
        assert!((sum - 1.0).abs() < 1e-6, "{sum}");
        // Peak at f0 √(1 − 2ζ²), height 2·4ζω³/(4ζ²ω⁴(1−ζ²)) = 2/(ζω(1−ζ²)).
        let z2 = mode.damping.powi(2);
        let peak = mode.psd_unit_per_hz(12.0 * (1.0 - 2.0 * z2).sqrt());
        assert!((peak * mode.damping * TAU * 12.0 * (1.0 - z2) / 2.0 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn ensemble_is_stationary_from_the_first_step() {
        let params = BaseMotionParams::default();
        let rms: [f64; 3] = std::array::from_fn(|i| {
            (params.sway.rms_rad[i].powi(2)
                + params.mast.rms_rad[i].powi(2)
                + params.broadband.rms_rad[i].powi(2))
            .sqrt()
        });
        let n = 4000;
        for steps in [1, 2, 700] {
            let mut sum = DVec3::ZERO;
            let mut rate_sum = 0.0;
            for run in 0..n {
                let mut rng = Stream::new(1, run, "base");
                let mut base = BaseMotion::new(&params, DT).unwrap();
                let mut tilt = DVec3::ZERO;
                for _ in 0..steps {
                    tilt = base.step(&mut rng);
                }
                sum += tilt * tilt;
                rate_sum += base.rate_radps().x.powi(2);
            }
            // Five standard errors of a variance estimate.
            let bound = 5.0 * (2.0 / n as f64).sqrt();
            for (s, r) in sum.to_array().iter().zip(rms) {
                assert!((s / n as f64 / (r * r) - 1.0).abs() < bound, "{steps}");
            }
            let rate = |m: &TiltMode| (TAU * m.frequency_hz * m.rms_rad[0]).powi(2);
            let rate2 = rate(&params.sway) + rate(&params.mast) + rate(&params.broadband);
            assert!((rate_sum / n as f64 / rate2 - 1.0).abs() < bound, "{steps}");
        }
    }

    #[test]
    fn spectrum_follows_the_closed_form() {
        let mode = BaseMotionParams::default().mast;
        let mut base = BaseMotion::new(&only(mode), DT).unwrap();
        let mut rng = Stream::new(3, 0, "base");
        // Averaged periodogram over 1 s blocks with a Hann window at three frequencies.
        let block = 960;
        let blocks = 1500;
        let probes = [6.0, 12.0, 24.0]; // [Hz]
        let mut power = [0.0; 3];
        for _ in 0..blocks {
            let mut re = [0.0; 3];
            let mut im = [0.0; 3];
            for k in 0..block {
                let x = base.step(&mut rng).x / mode.rms_rad[0];
                let t = f64::from(k) * DT;
                let hann = 1.0 - (TAU * f64::from(k) / f64::from(block)).cos();
                for (i, f) in probes.iter().enumerate() {
                    re[i] += hann * x * (TAU * f * t).cos();
                    im[i] += hann * x * (TAU * f * t).sin();
                }
            }
            for i in 0..3 {
                // One-sided: 2 |X|² dt / Σ w², and Σ w² = 3/2 per sample.
                power[i] += 2.0 * (re[i].powi(2) + im[i].powi(2)) * DT / (1.5 * f64::from(block));
            }
        }
        for (i, f) in probes.iter().enumerate() {
            // The window's smoothing kernel in frequency has lines (1/6, 2/3, 1/6) at 1 Hz
            // spacing only for line spectra; average the closed form over the main lobe instead.
            let kernel = |u: f64| {
                let sinc = |x: f64| {
                    if x.abs() < 1e-9 {
                        1.0
                    } else {
                        (x * TAU / 2.0).sin() / (x * TAU / 2.0)
                    }
                };
                (sinc(u) + 0.5 * (sinc(u - 1.0) + sinc(u + 1.0))).powi(2) / 1.5
            };
            let du = 0.01;
            let expected: f64 = (-800..=800)
                .map(|k| f64::from(k) * du)
                .map(|u| kernel(u) * mode.psd_unit_per_hz((f + u).abs()) * du)
                .sum();
            let ratio = power[i] / f64::from(blocks) / expected;
            // Each estimate averages 1500 exponential variables: 5/√1500 = 0.13.
            assert!((ratio - 1.0).abs() < 0.13, "{f} {ratio}");
        }
        assert!(power[1] > 10.0 * power[0] && power[1] > 10.0 * power[2]);
    }

    #[test]
    fn step_size_does_not_change_the_process() {
        // Two steps of dt have the transition and the noise of one step of 2 dt.
        let mode = BaseMotionParams::default().mast;
        let fine = ModeState::new(&mode, DT).unwrap();
        let coarse = ModeState::new(&mode, 2.0 * DT).unwrap();
        let f = fine.transition;
        let [l11, l21, l22] = fine.noise;
        let q = [[l11 * l11, l11 * l21], [l11 * l21, l21 * l21 + l22 * l22]];
        let mut sum = q;
        for i in 0..2 {
            for j in 0..2 {
                for a in 0..2 {
                    for b in 0..2 {
                        sum[i][j] += f[i][a] * q[a][b] * f[j][b];
                    }
                }
            }
        }
        let [m11, m21, m22] = coarse.noise;
        assert!((sum[0][0] / (m11 * m11) - 1.0).abs() < 1e-9);
        assert!((sum[0][1] / (m11 * m21) - 1.0).abs() < 1e-9);
        assert!((sum[1][1] / (m21 * m21 + m22 * m22) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn spectrum_integrates_power_laws() {
        // Flat, then f⁻², then 1/f, by hand.
        let spectrum = Spectrum::new(&[[1.0, 2.0], [10.0, 2.0], [100.0, 0.02], [200.0, 0.01]]);
        let spectrum = spectrum.unwrap();
        assert!((spectrum.power_rad2(1.0, 10.0) - 18.0).abs() < 1e-12);
        // ∫ 200 f⁻² = 200 (1/10 − 1/100).
        assert!((spectrum.power_rad2(10.0, 100.0) - 18.0).abs() < 1e-12);
        // ∫ 2/f = 2 ln 2.
        assert!((spectrum.power_rad2(100.0, 1e9) - 2.0 * 2.0f64.ln()).abs() < 1e-12);
        assert!((spectrum.power_rad2(5.0, 20.0) - (10.0 + 10.0)).abs() < 1e-12);
        assert_eq!(Spectrum::new(&[[1.0, 1.0]]), Err(SpectrumError::TooShort));
        let falls = Spectrum::new(&[[2.0, 1.0], [1.0, 1.0]]);
        assert_eq!(falls, Err(SpectrumError::Frequency(1.0)));
        let empty = Spectrum::new(&[[1.0, 1.0], [2.0, 0.0]]);
        assert_eq!(empty, Err(SpectrumError::Density(0.0)));
    }

    #[test]
    fn synthesis_has_the_given_spectrum() {
        // A mast at 10 Hz above a falling background [rad²/Hz].
        let points = [
            [0.2, 1e-9],
            [8.0, 2e-11],
            [10.0, 1e-9],
            [13.0, 2e-11],
            [200.0, 1e-14],
        ];
        let spectrum = Spectrum::new(&points).unwrap();
        let mut rng = Stream::new(11, 0, "base motion");
        let mut base = BaseMotion::from_spectrum(&spectrum, DT, &mut rng);
        // Mean square over 400 s: cross terms of neighbouring lines fade with their spacing times
        // the time, below 2 % here; and none of it depends on the axis.
        let n = 960 * 400;
        let mut sum = DVec3::ZERO;
        let mut kept = Vec::new();
        for k in 0..n {
            let tilt = base.step(&mut rng);
            sum += tilt * tilt;
            // 120 Hz is enough for the bands below.
            if k % 8 == 0 {
                kept.push(tilt.x);
            }
        }
        // The rate is the derivative: by the trapezium over a short step.
        let dt = DT / 64.0;
        let mut fine = BaseMotion::from_spectrum(&spectrum, dt, &mut rng);
        for _ in 0..1000 {
            let (before, rate) = (fine.tilt_rad(), fine.rate_radps());
            let slope = (fine.step(&mut rng) - before) / dt;
            let mean = 0.5 * (rate + fine.rate_radps());
            assert!((slope - mean).length() < 1e-7);
        }
        let total = spectrum.power_rad2(0.2, 200.0);
        for axis in (sum / f64::from(n)).to_array() {
            assert!((axis / total - 1.0).abs() < 0.02, "{}", axis / total);
        }
        // Power between band edges, by projection on every multiple of 1/400 Hz in between.
        let edge = |k: i32| 0.2 * 1000.0f64.powf(f64::from(k) / 96.0);
        for (low, high) in [(30, 40), (50, 56), (56, 60)] {
            let (from, to) = ((edge(low) * 400.0) as i32, (edge(high) * 400.0) as i32);
            let mut power = 0.0;
            for j in from..to {
                let turn = 8.0 * TAU * f64::from(j) / f64::from(n);
                let (mut re, mut im) = (0.0, 0.0);
                let (mut c, mut s) = (1.0, 0.0);
                let (dc, ds) = (turn.cos(), turn.sin());
                for x in &kept {
                    (re, im) = (re + x * c, im + x * s);
                    (c, s) = (c * dc - s * ds, s * dc + c * ds);
                }
                power += 2.0 * (re * re + im * im) / (kept.len() as f64).powi(2);
            }
            let expected = spectrum.power_rad2(edge(low), edge(high));
            // What leaks over the edges of a band with no window.
            assert!(
                (power / expected - 1.0).abs() < 0.03,
                "{low} {}",
                power / expected
            );
        }
        // The same seed gives the same motion.
        let again = |seed| {
            let mut rng = Stream::new(seed, 0, "base motion");
            BaseMotion::from_spectrum(&spectrum, DT, &mut rng)
        };
        assert_eq!(again(3), again(3));
        assert_ne!(again(3), again(4));
    }

    #[test]
    fn bad_parameters_are_refused() {
        let mut params = BaseMotionParams::default();
        params.mast.rms_rad[1] = -1.0;
        assert!(BaseMotion::new(&params, DT).is_err());
        params = BaseMotionParams::default();
        params.sway.frequency_hz = 0.0;
        assert!(BaseMotion::new(&params, DT).is_err());
    }
}
