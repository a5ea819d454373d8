//! The weather as AirSim's clients set it.

use crate::models::air::atmosphere::{Hydrometeor, precipitation_extinction_per_m};
use crate::simulation::View;

/// Visibility in AirSim's densest fog \[m\].
const DENSEST_M: f64 = 100.0;
/// AirSim's heaviest rain \[mm/h\].
const HEAVIEST_MMPH: f64 = 50.0;
/// Koschmieder's constant: visibility times extinction.
const KOSCHMIEDER: f64 = 3.912;

/// The weather as clients have set it.
#[derive(Clone, Debug)]
pub(super) struct Sky {
    /// Visibility of the scenario \[m\].
    own_m: f64,
    pub enabled: bool,
    /// 0 to 1.
    pub fog: f64,
    pub rain: f64,
}

impl Sky {
    /// The scenario's own.
    pub(super) fn new(view: View) -> Self {
        Self {
            own_m: view.air().weather().visibility_m,
            enabled: false,
            fog: 0.0,
            rain: 0.0,
        }
    }

    /// The visibility that follows \[m\]: fog takes it from the scenario's to [`DENSEST_M`] by equal factors, rain adds the
    /// extinction of its drops.
    pub(super) fn visibility_m(&self) -> f64 {
        if !self.enabled {
            return self.own_m;
        }
        let densest_m = DENSEST_M.min(self.own_m);
        let in_fog_m = self.own_m * (densest_m / self.own_m).powf(self.fog);
        let drops_per_m =
            precipitation_extinction_per_m(Hydrometeor::Rain, self.rain * HEAVIEST_MMPH);
        KOSCHMIEDER / (KOSCHMIEDER / in_fog_m + drops_per_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fog_and_rain_lower_the_visibility() {
        let clear = Sky {
            own_m: 10_000.0,
            enabled: true,
            fog: 0.0,
            rain: 0.0,
        };
        let with = |fog, rain| {
            Sky {
                fog,
                rain,
                ..clear.clone()
            }
            .visibility_m()
        };
        assert!((with(0.0, 0.0) - 10_000.0).abs() < 1e-6);
        assert!((with(0.5, 0.0) - 1_000.0).abs() < 1e-6);
        assert!((with(1.0, 0.0) - DENSEST_M).abs() < 1e-6);
        // 50 mm/h: 1.076 * 50^0.67 dB/km.
        let drops_per_m = 1.076 * 50f64.powf(0.67) * std::f64::consts::LN_10 * 1e-4;
        let wanted_m = KOSCHMIEDER / (KOSCHMIEDER / 10_000.0 + drops_per_m);
        assert!(
            (with(0.0, 1.0) - wanted_m).abs() < 1e-6 && wanted_m < 2_500.0,
            "{wanted_m}"
        );
        let off = Sky {
            enabled: false,
            fog: 1.0,
            ..clear
        };
        assert_eq!(off.visibility_m(), 10_000.0);
    }
}
