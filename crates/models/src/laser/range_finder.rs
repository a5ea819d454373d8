//! Pulsed laser range finder: which of the surfaces in its field answer, by the lidar equation and the noise of its receiver.
//!
//! A diffuse surface that fills the share f of the field at range R sends back
//! P ∝ ρ · f · τ(R)² / R² (R. M. Measures, *Laser Remote Sensing*, 1984, ch. 7, for a target that is
//! wholly seen by the receiver). The constant is the instrument's: it is given by its rating, the range
//! at which it sees an extended target of known reflectance in known air with every other pulse.
//!
//! The receiver's noise is Gaussian, and an echo is what passes a threshold of so many of its deviations: one of that strength is
//! found half of the time, and noise alone passes it in one of the range bins now and then (the same, ch. 6). Aerosol sends back
//! as a diffuse surface of reflectance π β ΔR would, β being its backscatter and ΔR the length of the pulse. The threshold stands
//! above that, as instruments' adaptive thresholds do: air is no echo, and hides what is weaker.

use crate::maths::rng::Stream;
use libm::erfc;
use std::f64::consts::{PI, SQRT_2};

/// What an instrument can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeFinderParams {
    /// Wavelength [m].
    pub wavelength_m: f64,
    /// Half of the beam's field [rad].
    pub half_field_rad: f64,
    /// Standard deviation of a range [m].
    pub sigma_m: f64,
    /// Range at which an extended target answers every other pulse [m].
    pub rated_range_m: f64,
    /// Reflectance of that target.
    pub rated_reflectance: f64,
    /// Extinction of the air in which that is so [1/m].
    pub rated_extinction_per_m: f64,
    /// Deviations of the noise at which the threshold stands.
    pub threshold: f64,
    /// Length of the pulse, and of a range bin [m].
    pub pulse_m: f64,
    /// Range up to which it is blind [m].
    pub blind_m: f64,
    /// Extinction of aerosol over its backscatter [sr].
    pub lidar_ratio_sr: f64,
}

impl Default for RangeFinderParams {
    /// An eye-safe instrument of the middle class (assumption): 10 km on an extended target of 30 %
    /// in 23 km of visibility, where aerosol takes some 0.044 per km at 1.55 µm; a pulse of 10 ns; one false echo in some 500
    /// pulses over all ranges. Fog has a lidar ratio of 18 sr (O'Connor et al., J. Atmos. Oceanic Technol. 21, 2004, 777, for
    /// droplets), haze up to 50 sr.
    fn default() -> Self {
        Self {
            wavelength_m: 1.55e-6,            // [m]
            half_field_rad: 5e-4,             // [rad]
            sigma_m: 0.5,                     // [m]
            rated_range_m: 10_000.0,          // [m]
            rated_reflectance: 0.3,           // share
            rated_extinction_per_m: 0.044e-3, // [1/m]
            threshold: 5.0,                   // deviations
            pulse_m: 1.5,                     // [m]
            blind_m: 50.0,                    // [m]
            lidar_ratio_sr: 18.0,             // [sr]
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
    /// Share of the pulse's power that falls on it.
    pub share: f64,
    /// Its diffuse reflectance.
    pub reflectance: f64,
}

impl RangeFinderParams {
    /// Share of the pulse that falls on a surface of an area [m²] across the beam at a range [m], `off_rad` beside the axis: the
    /// beam is Gaussian, its 1/e² radius half the field.
    pub fn share(&self, area_m2: f64, range_m: f64, off_rad: f64) -> f64 {
        let radius_m = self.half_field_rad * range_m;
        let peak_per_m2 = 2.0 / (PI * radius_m * radius_m);
        let beside = (-2.0 * (off_rad / self.half_field_rad).powi(2)).exp();
        // A disc of that area, filled from the axis outwards.
        beside * (1.0 - (-peak_per_m2 * area_m2).exp())
    }

    /// Power of a surface's echo over the threshold that stands above the air's, in air of `extinction_per_m` [1/m].
    pub fn margin(&self, surface: &LitSurface, extinction_per_m: f64) -> f64 {
        let air = self.aerosol(surface.range_m, extinction_per_m);
        self.strength(surface, extinction_per_m) / (1.0 + self.strength(&air, extinction_per_m))
    }

    /// Power of a surface's echo over the threshold in air that sends nothing back, but takes `extinction_per_m` [1/m].
    pub fn strength(&self, surface: &LitSurface, extinction_per_m: f64) -> f64 {
        let received = |range_m: f64, reflectance: f64, share: f64, extinction_per_m: f64| {
            reflectance * share * (-2.0 * extinction_per_m * range_m).exp() / (range_m * range_m)
        };
        let least = received(
            self.rated_range_m,
            self.rated_reflectance,
            1.0,
            self.rated_extinction_per_m,
        );
        received(
            surface.range_m,
            surface.reflectance,
            surface.share,
            extinction_per_m,
        ) / least
    }

    /// Chance that a pulse's echo of such a margin is found.
    pub fn detection_chance(&self, margin: f64) -> f64 {
        0.5 * erfc(self.threshold * (1.0 - margin) / SQRT_2)
    }

    /// False echoes of a pulse within so many metres of range, as a mean.
    pub fn false_echoes(&self, span_m: f64) -> f64 {
        self.detection_chance(0.0) * span_m / self.pulse_m
    }

    /// The aerosol at a range [m] as a surface, in air of `extinction_per_m` [1/m].
    fn aerosol(&self, range_m: f64, extinction_per_m: f64) -> LitSurface {
        LitSurface {
            range_m,
            share: 1.0,
            reflectance: PI * extinction_per_m / self.lidar_ratio_sr * self.pulse_m,
        }
    }

    /// The ranges [m] of one pulse's echoes, nearest first, without the error of a range: surfaces that are found, and
    /// false ones up to the rated range.
    pub fn echoes_m(
        &self,
        surfaces: &[LitSurface],
        extinction_per_m: f64,
        rng: &mut Stream,
    ) -> Vec<f64> {
        let mut found = |surface: &LitSurface| {
            let chance = self.detection_chance(self.margin(surface, extinction_per_m));
            rng.uniform() < chance && surface.range_m > self.blind_m
        };
        let mut echoes_m: Vec<f64> = (surfaces.iter())
            .filter(|surface| found(surface))
            .map(|surface| surface.range_m)
            .collect();
        for _ in 0..rng.poisson(self.false_echoes(self.rated_range_m)) {
            echoes_m.push(rng.range(self.blind_m, self.rated_range_m));
        }
        echoes_m.sort_by(f64::total_cmp);
        echoes_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FINDER: fn() -> RangeFinderParams = RangeFinderParams::default;

    fn extended(range_m: f64) -> LitSurface {
        LitSurface {
            range_m,
            share: 1.0,
            reflectance: 0.3,
        }
    }

    /// Share of the pulses with an echo within a metre of a range [m].
    fn answered(surfaces: &[LitSurface], extinction_per_m: f64, at_m: f64) -> f64 {
        let (finder, mut rng, n) = (FINDER(), Stream::new(1, 0, "test"), 4000);
        let found = (0..n).filter(|_| {
            let echoes_m = finder.echoes_m(surfaces, extinction_per_m, &mut rng);
            echoes_m.iter().any(|echo_m| (echo_m - at_m).abs() < 1.0)
        });
        found.count() as f64 / f64::from(n)
    }

    #[test]
    fn the_rated_target_answers_every_other_pulse() {
        let finder = FINDER();
        let rated = extended(finder.rated_range_m);
        let margin = finder.strength(&rated, finder.rated_extinction_per_m);
        assert!((margin - 1.0).abs() < 1e-12, "{margin}");
        let found = answered(&[rated], finder.rated_extinction_per_m, 10_000.0);
        // Five standard errors of a half.
        assert!((found - 0.5).abs() < 0.04, "{found}");
        assert!(answered(&[extended(7_000.0)], finder.rated_extinction_per_m, 7_000.0) > 0.99);
        assert!(
            answered(
                &[extended(14_000.0)],
                finder.rated_extinction_per_m,
                14_000.0
            ) < 0.01
        );
    }

    #[test]
    fn a_small_target_fades_with_the_fourth_power_and_beside_the_axis() {
        let finder = FINDER();
        let uav = |range_m: f64, off_rad: f64| LitSurface {
            range_m,
            share: finder.share(0.07, range_m, off_rad),
            reflectance: 0.3,
        };
        // In clear air, where it is much smaller than the spot: twice as far is a sixteenth, but for 2 % of how it fills that.
        let ratio = finder.margin(&uav(2_000.0, 0.0), 0.0) / finder.margin(&uav(4_000.0, 0.0), 0.0);
        assert!((ratio / 16.0 - 1.0).abs() < 0.02, "{ratio}");
        // What fills the spot fades with the second power.
        let wall = |range_m: f64| finder.margin(&extended(range_m), 0.0);
        assert!((wall(1_000.0) / wall(2_000.0) / 4.0 - 1.0).abs() < 1e-12);
        // At the edge of the field the Gaussian is at 1/e².
        let edge = uav(1_000.0, finder.half_field_rad);
        let ratio = edge.share / uav(1_000.0, 0.0).share;
        assert!((ratio - (-2.0_f64).exp()).abs() < 1e-12, "{ratio}");
    }

    #[test]
    fn fog_swallows_the_echo_and_hides_what_is_weaker_than_its_own() {
        // 200 m of visibility: 19.6 per km; there and back over 600 m keep 6e-11.
        assert!(answered(&[extended(600.0)], 19.6e-3, 600.0) < 0.01);
        assert!(answered(&[extended(100.0)], 19.6e-3, 100.0) > 0.99);
        // At 60 m that air sends back what 0.5 % of reflectance would.
        let faint = |reflectance: f64| LitSurface {
            reflectance,
            ..extended(60.0)
        };
        assert!(answered(&[faint(3e-3)], 19.6e-3, 60.0) < 0.02);
        assert!(answered(&[faint(15e-3)], 19.6e-3, 60.0) > 0.98);
        // Noise alone is no echo there.
        assert!(answered(&[], 19.6e-3, 60.0) < 0.01);
    }

    #[test]
    fn several_answer_nearest_first_and_noise_now_and_then() {
        let (finder, mut rng) = (FINDER(), Stream::new(2, 0, "test"));
        let bird = LitSurface {
            range_m: 300.0,
            share: finder.share(0.02, 300.0, 0.0),
            reflectance: 0.3,
        };
        let echoes_m = finder.echoes_m(&[extended(900.0), bird], 0.1e-3, &mut rng);
        assert_eq!(echoes_m, [300.0, 900.0]);
        let n = 40_000;
        let false_ones: usize = (0..n)
            .map(|_| finder.echoes_m(&[], 0.0, &mut rng).len())
            .sum();
        let mean = finder.false_echoes(finder.rated_range_m);
        // Five standard errors of a Poisson mean.
        let bound = 5.0 * (mean / f64::from(n)).sqrt();
        assert!(
            (false_ones as f64 / f64::from(n) - mean).abs() < bound,
            "{false_ones} {mean}"
        );
    }
}
