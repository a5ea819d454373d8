//! `paper`: the paper's equation 7.

use super::crossing::{Across, Propagation, PropagationContext, Sent, Shape};
use crate::maths::rng::Stream;
use glam::DVec2;
use std::error::Error;
use std::ops::RangeInclusive;

/// The paper's eq. 7, dI = -γ I dt + σ I dW: geometric Brownian motion, updated exactly, on all of a beam of the short-term
/// radius that does not wander.
///
/// It is **not** of mean one, nor stationary: E[I] = I0 e^(-γ t) and var[ln I] = σ² t grow and decay without bound. Kept to
/// reproduce the paper.
#[derive(Clone, Debug)]
pub struct PaperPropagation {
    /// Drift γ [1/s].
    pub gamma_per_s: f64,
    /// Volatility σ [1/sqrt(s)].
    pub sigma_per_sqrt_s: f64,
    /// Present relative intensity I/I0 [-]; starts at 1.
    pub intensity: f64,
    rng: Stream,
}

impl PaperPropagation {
    /// Accepted drift [1/s]. At the upper end the intensity falls by e in a tenth of a second.
    pub const DRIFT_RANGE_PER_S: RangeInclusive<f64> = 0.0..=10.0;
    /// Accepted volatility [1/sqrt(s)]. At the upper end the logarithm's deviation after a minute is 77, beyond any physical
    /// channel and still a finite number.
    pub const VOLATILITY_RANGE_PER_SQRT_S: RangeInclusive<f64> = 0.0..=10.0;

    /// One at I = I0; the paper prints neither drift nor volatility.
    pub fn new(context: &PropagationContext) -> Self {
        let [gamma_per_s, sigma_per_sqrt_s] = context.paper;
        Self {
            gamma_per_s,
            sigma_per_sqrt_s,
            intensity: 1.0,
            rng: context.stream("scintillation"),
        }
    }

    /// Advances by `dt_s` [s] and returns the relative intensity [-].
    pub fn step(&mut self, dt_s: f64) -> f64 {
        let sigma = self.sigma_per_sqrt_s;
        let drift = (-self.gamma_per_s - 0.5 * sigma * sigma) * dt_s;
        self.intensity *= (drift + sigma * dt_s.sqrt() * self.rng.normal()).exp();
        self.intensity
    }
}

impl Propagation for PaperPropagation {
    fn cross(&mut self, sent: &Sent) -> Result<Across, Box<dyn Error + Send + Sync>> {
        let relative = self.step(sent.dt_s);
        let expected = sent.expected();
        Ok(Across {
            power_w: expected.power_w * relative,
            centre_m: DVec2::ZERO,
            shape: Shape::Gaussian {
                radius_m: expected.short_m,
            },
            relative,
        })
    }

    fn boxed(&self) -> Box<dyn Propagation> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn its_intensity_is_geometric_brownian_motion() {
        let (gamma, sigma, t) = (0.7, 0.5, 0.8);
        let mut rng = Stream::new(9, 0, "paper");
        let n = 200_000;
        let (mut mean, mut log_mean, mut log_square) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            let mut own = PaperPropagation {
                gamma_per_s: gamma,
                sigma_per_sqrt_s: sigma,
                intensity: 1.0,
                rng,
            };
            // Unequal steps: the update is exact for any.
            own.step(0.3 * t);
            let i = own.step(0.7 * t);
            rng = own.rng;
            mean += i;
            log_mean += i.ln();
            log_square += i.ln() * i.ln();
        }
        let n = f64::from(n);
        let (mean, log_mean) = (mean / n, log_mean / n);
        let log_variance = log_square / n - log_mean * log_mean;
        let variance = sigma * sigma * t;
        let expected = (-gamma * t).exp();
        // Five standard errors each.
        let error = expected * (variance.exp_m1() / n).sqrt();
        assert!((mean - expected).abs() < 5.0 * error);
        assert!((log_mean + (gamma + 0.5 * sigma * sigma) * t).abs() < 5.0 * (variance / n).sqrt());
        assert!((log_variance - variance).abs() < 5.0 * variance * (2.0 / n).sqrt());
    }
}
