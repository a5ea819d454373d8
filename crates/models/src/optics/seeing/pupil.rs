//! Apertures, by what they leave of a wave of the wavefront.

use std::f64::consts::PI;

/// Arguments up to which the disc's average is tabulated, and steps of one.
const REACH: f64 = 128.0;
const STEPS: f64 = 16.0;

/// An aperture: the mean of a wavefront's gradient over it is the tilt that it sees or sends.
#[derive(Clone, Debug)]
pub enum Pupil {
    /// A clear disc, as a lens has.
    Disc {
        /// Diameter [m].
        diameter_m: f64,
        /// Averages of a wave over the disc, by the wavenumber times the radius.
        table: Vec<f32>,
    },
    /// A Gaussian beam.
    Gaussian {
        /// 1/e² radius of its irradiance [m].
        radius_m: f64,
    },
}

impl Pupil {
    /// A disc of a diameter [m].
    pub fn disc(diameter_m: f64) -> Self {
        let count = (REACH * STEPS) as usize + 2;
        let table = (0..count).map(|i| disc_average(i as f64 / STEPS) as f32);
        Self::Disc {
            diameter_m,
            table: table.collect(),
        }
    }

    /// A beam of a 1/e² radius [m].
    pub fn gaussian(radius_m: f64) -> Self {
        Self::Gaussian { radius_m }
    }

    /// Mean of a wave of wavenumber `kappa_radpm` [rad/m] over the aperture, of its middle's value: 2 J1(x)/x, x = κ D/2, of a
    /// disc; exp(-κ² W²/8) of a beam, weighted with its irradiance.
    pub fn average(&self, kappa_radpm: f64) -> f64 {
        match self {
            Self::Disc { diameter_m, table } => {
                let at = 0.5 * diameter_m * kappa_radpm * STEPS;
                let (cell, rest) = (at as usize, at.fract());
                match table.get(cell..cell.saturating_add(2)) {
                    Some(&[a, b]) => f64::from(a) + rest * f64::from(b - a),
                    _ => 0.0,
                }
            }
            Self::Gaussian { radius_m } => (-(kappa_radpm * radius_m).powi(2) / 8.0).exp(),
        }
    }
}

/// 2 J1(x)/x.
fn disc_average(x: f64) -> f64 {
    if x < 1e-6 {
        1.0
    } else {
        2.0 * bessel(1, x) / x
    }
}

/// Bessel's function J of an integer order, by the trapezoidal rule on his integral (1/π) ∫ cos(n τ - x sin τ) dτ from 0 to π,
/// which converges faster than any power for a periodic integrand.
pub(super) fn bessel(order: i32, x: f64) -> f64 {
    let n = 32 + 2 * x.abs() as usize;
    let sum: f64 = (0..n)
        .map(|i| {
            let tau = PI * (i as f64 + 0.5) / n as f64;
            (f64::from(order) * tau - x * tau.sin()).cos()
        })
        .sum();
    sum / n as f64
}
