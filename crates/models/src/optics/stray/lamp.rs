//! Searchlights and dazzlers: lamps with a beam that shine on a station.

use std::f64::consts::{LN_2, PI};

/// What a lamp shines with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LampLight {
    /// White light [cd] on the axis.
    White(f64),
    /// A laser: power [W] and wavelength [m].
    Line(f64, f64),
}

/// A lamp whose beam is a Gaussian over the angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LampBeam {
    /// What it shines with.
    pub light: LampLight,
    /// Full width of the beam at half of its intensity [rad].
    pub width_rad: f64,
}

impl LampBeam {
    /// Intensity at an angle [rad] from the axis: [cd] of white light, [W/sr] of a line.
    pub fn intensity(&self, off_rad: f64) -> f64 {
        let narrow = 4.0 * LN_2 / (self.width_rad * self.width_rad);
        let axis = match self.light {
            LampLight::White(candela) => candela,
            // The integral of the Gaussian over small angles is pi / narrow.
            LampLight::Line(power_w, _) => power_w * narrow / PI,
        };
        axis * (-narrow * off_rad * off_rad).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_beam_is_half_at_half_its_width_and_holds_its_power() {
        let lamp = LampBeam {
            light: LampLight::Line(5.0, 532e-9),
            width_rad: 0.02,
        };
        let half = lamp.intensity(0.01) / lamp.intensity(0.0);
        assert!((half - 0.5).abs() < 1e-12, "{half}");
        let power_w: f64 = (0..10_000)
            .map(|i| {
                let theta = 1e-5 * (f64::from(i) + 0.5);
                lamp.intensity(theta) * 2.0 * PI * theta.sin() * 1e-5
            })
            .sum();
        assert!((power_w / 5.0 - 1.0).abs() < 1e-3, "{power_w}");
    }
}
