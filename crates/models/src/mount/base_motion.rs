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
use thiserror::Error;

use crate::maths::rng::Stream;
use crate::maths::second_order::{SecondOrderError, second_order_transition};

/// One mode of the base's angular motion.
#[derive(Clone, Copy, Debug, PartialEq)]
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
#[derive(Clone, Copy, Debug, PartialEq)]
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
    #[error("a spectrum of fewer than two points; give two or more")]
    TooShort,
    /// A frequency that does not rise, or is not positive.
    #[error(
        "frequency {0} Hz of the spectrum is not above the one before it, or above 0; sort the points by frequency"
    )]
    Frequency(f64),
    /// A density that is not positive.
    #[error("density {0} rad^2/Hz of the spectrum must be positive; leave out what has none")]
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

    /// Mean square [rad²] of the motion between two frequencies [Hz].
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
enum MotionSource {
    Modes {
        modes: Box<[ModeState; 3]>,
        started: bool,
    },
    Lines(Vec<Line>),
}

/// The angular motion of a station's base; stationary from its first step.
#[derive(Clone, Debug, PartialEq)]
pub struct BaseMotion(MotionSource);

impl BaseMotion {
    /// A base motion to be stepped every `dt_s`.
    pub fn new(params: &BaseMotionParams, dt_s: f64) -> Result<Self, SecondOrderError> {
        Ok(Self(MotionSource::Modes {
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
        Self(MotionSource::Lines(lines.collect()))
    }

    /// Advances one step (the first of the modes draws the stationary state itself) and returns the
    /// tilt: a rotation vector about the `enu` axes [rad].
    pub fn step(&mut self, rng: &mut Stream) -> DVec3 {
        match &mut self.0 {
            MotionSource::Modes { modes, started } => {
                for mode in modes.iter_mut() {
                    if *started {
                        mode.advance(rng);
                    } else {
                        mode.start(rng);
                    }
                }
                *started = true;
            }
            MotionSource::Lines(lines) => {
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
            MotionSource::Modes { modes, .. } => modes.iter().map(|m| m.rms_rad * m.x).sum(),
            MotionSource::Lines(lines) => lines.iter().map(|l| l.amplitude_rad * l.re).sum(),
        }
    }

    /// Present angular velocity about the `enu` axes [rad/s]: what a base gyro measures.
    pub fn rate_radps(&self) -> DVec3 {
        match &self.0 {
            MotionSource::Modes { modes, .. } => modes.iter().map(|m| m.rms_rad * m.v).sum(),
            MotionSource::Lines(lines) => lines
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
mod tests;
