//! Pulsed laser range finder: which of the surfaces in its field answers, by the lidar equation.
//!
//! A diffuse surface that fills the share f of the field at range R sends back
//! P ∝ ρ · f · τ(R)² / R² (R. M. Measures, *Laser Remote Sensing*, 1984, ch. 7, for a target that is
//! wholly seen by the receiver). The constant is the instrument's: it is given by its rating, the range
//! at which it just sees an extended target of known reflectance in known air.

use std::f64::consts::PI;

/// What an instrument can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeFinderParams {
    /// Wavelength [m].
    pub wavelength_m: f64,
    /// Half of the beam's field [rad].
    pub half_field_rad: f64,
    /// Standard deviation of a range [m].
    pub sigma_m: f64,
    /// Range at which an extended target just answers [m].
    pub rated_range_m: f64,
    /// Reflectance of that target.
    pub rated_reflectance: f64,
    /// Extinction of the air in which that is so [1/m].
    pub rated_extinction_per_m: f64,
}

impl Default for RangeFinderParams {
    /// An eye-safe instrument of the middle class (assumption): 10 km on an extended target of 30 %
    /// in 23 km of visibility, where aerosol takes some 0.044 per km at 1.55 µm.
    fn default() -> Self {
        Self {
            wavelength_m: 1.55e-6,            // [m]
            half_field_rad: 5e-4,             // [rad]
            sigma_m: 0.5,                     // [m]
            rated_range_m: 10_000.0,          // [m]
            rated_reflectance: 0.3,           // share
            rated_extinction_per_m: 0.044e-3, // [1/m]
        }
    }
}

/// Diffuse reflectance of airframes, birds, walls and ground at the range finder's wavelength
/// (assumption).
pub const REFLECTANCE: f64 = 0.3;

/// A surface that the pulse may meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LitSurface {
    /// Its range [m].
    pub range_m: f64,
    /// Its area across the beam [m²]; infinite for one that fills the field.
    pub area_m2: f64,
    /// Its diffuse reflectance.
    pub reflectance: f64,
}

impl RangeFinderParams {
    /// Power of a surface's echo over the least that is seen, in air of `extinction_per_m` [1/m].
    pub fn margin(&self, surface: &LitSurface, extinction_per_m: f64) -> f64 {
        let received = |range_m: f64, reflectance: f64, share: f64, extinction_per_m: f64| {
            reflectance * share * (-2.0 * extinction_per_m * range_m).exp() / (range_m * range_m)
        };
        let spot_m2 = PI * (self.half_field_rad * surface.range_m).powi(2);
        let share = (surface.area_m2 / spot_m2).min(1.0);
        let least = received(
            self.rated_range_m,
            self.rated_reflectance,
            1.0,
            self.rated_extinction_per_m,
        );
        received(
            surface.range_m,
            surface.reflectance,
            share,
            extinction_per_m,
        ) / least
    }

    /// The range of the first echo that is strong enough [m], without its error.
    pub fn first_echo_m(
        &self,
        surfaces: impl IntoIterator<Item = LitSurface>,
        extinction_per_m: f64,
    ) -> Option<f64> {
        surfaces
            .into_iter()
            .filter(|surface| self.margin(surface, extinction_per_m) >= 1.0)
            .map(|surface| surface.range_m)
            .min_by(f64::total_cmp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FINDER: fn() -> RangeFinderParams = RangeFinderParams::default;

    fn extended(range_m: f64, reflectance: f64) -> LitSurface {
        LitSurface {
            range_m,
            area_m2: f64::INFINITY,
            reflectance,
        }
    }

    #[test]
    fn the_rated_target_just_answers() {
        let finder = FINDER();
        let rated = extended(finder.rated_range_m, finder.rated_reflectance);
        let margin = finder.margin(&rated, finder.rated_extinction_per_m);
        assert!((margin - 1.0).abs() < 1e-12, "{margin}");
        assert_eq!(
            finder.first_echo_m([extended(10_001.0, 0.3)], 0.044e-3),
            None
        );
    }

    #[test]
    fn a_small_target_fades_with_the_fourth_power() {
        let finder = FINDER();
        let uav = |range_m| LitSurface {
            range_m,
            area_m2: 0.07, // [m²]
            reflectance: 0.3,
        };
        // In clear air, where it is smaller than the spot: twice as far is a sixteenth.
        let ratio = finder.margin(&uav(1_000.0), 0.0) / finder.margin(&uav(2_000.0), 0.0);
        assert!((ratio - 16.0).abs() < 1e-9, "{ratio}");
        // So near that it fills the spot, the second power is left.
        let ratio = finder.margin(&uav(100.0), 0.0) / finder.margin(&uav(200.0), 0.0);
        assert!((ratio - 4.0).abs() < 1e-9, "{ratio}");
    }

    #[test]
    fn fog_swallows_the_echo() {
        let finder = FINDER();
        // 200 m of visibility: 19.6 per km; there and back over 600 m keep 6e-11.
        assert_eq!(finder.first_echo_m([extended(600.0, 0.3)], 19.6e-3), None);
        assert_eq!(
            finder.first_echo_m([extended(100.0, 0.3)], 19.6e-3),
            Some(100.0)
        );
    }

    #[test]
    fn the_first_echo_counts() {
        let bird = LitSurface {
            range_m: 300.0,
            area_m2: 0.02,
            reflectance: 0.3,
        };
        let wall = extended(900.0, 0.3);
        assert_eq!(FINDER().first_echo_m([wall, bird], 0.1e-3), Some(300.0));
        assert_eq!(FINDER().first_echo_m([], 0.1e-3), None);
    }
}
