//! The weather at the site.

use super::atmosphere::{
    Hydrometeor, KOSCHMIEDER, extinction_per_m, precipitation_extinction_per_m,
};

/// The visibility taken where a report says only "10 km or more" [m]: the "clear" 23 km of the
/// LOWTRAN standard atmospheres.
pub const OPEN_VISIBILITY_M: f64 = 23_000.0;

/// Cover from which on a layer counts as closed, 7 oktas.
pub const OVERCAST_COVER: f64 = 0.875;

/// The weather at the site.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weather {
    /// Mean wind speed 10 m above open ground as reported, or above the site's displacement height [m/s].
    pub wind_speed_mps: f64,
    /// Direction the wind blows from, clockwise from true north [rad].
    pub wind_from_rad: f64,
    /// Gust speed, where gusts are reported: the highest mean over 3 s in ten minutes [m/s].
    pub gust_mps: Option<f64>,
    /// Meteorological visibility, through the precipitation too [m].
    pub visibility_m: f64,
    /// Air temperature [K].
    pub temperature_k: f64,
    /// Relative humidity over water, 0 to 1.
    pub relative_humidity: f64,
    /// Air pressure [Pa].
    pub pressure_pa: f64,
    /// Share of the sky that cloud covers, 0 to 1.
    pub cloud_cover: f64,
    /// Height above ground of the base of the layer that covers most, where it is known [m].
    pub cloud_base_m: Option<f64>,
    /// Precipitation rate as water [mm/h].
    pub precipitation_mmph: f64,
    /// Whether the precipitation is snow.
    pub snow: bool,
}

impl Weather {
    /// This weather with the visibility that its precipitation leaves of open air, but at least
    /// `least_m` [m].
    pub(super) fn with_precipitation_in_open_air(self, least_m: f64) -> Self {
        if self.precipitation_mmph <= 0.0 {
            return self;
        }
        let total_per_m = KOSCHMIEDER / OPEN_VISIBILITY_M + self.precipitation_per_m();
        Self {
            visibility_m: (KOSCHMIEDER / total_per_m).max(least_m),
            ..self
        }
    }

    /// This weather with precipitation of `rate_mmph` [mm/h of water] in place of its own: the
    /// aerosol stays, the visibility changes with what falls.
    ///
    /// It is snow below 1 °C, where it snows as often as it rains (Jennings et al., Nat. Commun. 9,
    /// 1148, 2018: the mean over the northern hemisphere).
    pub fn with_precipitation(self, rate_mmph: f64) -> Self {
        /// Scattering of clean air at 550 nm and sea level [1/m] (Bucholtz, Appl. Opt. 34, 2765,
        /// 1995).
        const CLEAN_AIR_PER_M: f64 = 1.16e-5;
        let aerosol_per_m = self.aerosol_extinction_per_m(550e-9);
        let air_per_m = if aerosol_per_m > 0.0 {
            aerosol_per_m.max(CLEAN_AIR_PER_M)
        } else {
            // A shower hid more than was reported, and nothing is known of the air between its drops.
            KOSCHMIEDER / OPEN_VISIBILITY_M
        };
        let mut changed = Self {
            precipitation_mmph: rate_mmph,
            snow: self.temperature_k < 274.15, // [K]
            ..self
        };
        changed.visibility_m = KOSCHMIEDER / (air_per_m + changed.precipitation_per_m());
        changed
    }

    /// Extinction [1/m] at `wavelength_m` [m]: that of the aerosol, which falls with the
    /// wavelength, and that of the precipitation, which does not.
    pub fn extinction_per_m(&self, wavelength_m: f64) -> f64 {
        let whole_per_m = KOSCHMIEDER / self.visibility_m;
        self.aerosol_extinction_per_m(wavelength_m) + self.precipitation_per_m().min(whole_per_m)
    }

    /// The aerosol's part of the extinction [1/m] at `wavelength_m` [m]: what the visibility
    /// leaves beside the precipitation.
    pub fn aerosol_extinction_per_m(&self, wavelength_m: f64) -> f64 {
        let precipitation_per_m = self.precipitation_per_m();
        let visibility_m = if precipitation_per_m > 0.0 {
            KOSCHMIEDER / (KOSCHMIEDER / self.visibility_m - precipitation_per_m).max(0.0)
        } else {
            self.visibility_m
        };
        extinction_per_m(visibility_m, wavelength_m)
    }

    /// Extinction [1/m] that the precipitation alone causes.
    fn precipitation_per_m(&self) -> f64 {
        let falls = match (self.snow, self.temperature_k < 273.15) {
            (false, _) => Hydrometeor::Rain,
            (true, false) => Hydrometeor::WetSnow,
            (true, true) => Hydrometeor::DrySnow,
        };
        precipitation_extinction_per_m(falls, self.precipitation_mmph)
    }

    /// Height above ground [m] from which on cloud hides everything: the base of a layer that
    /// covers 7/8 of the sky or more.
    pub fn ceiling_m(&self) -> Option<f64> {
        self.cloud_base_m
            .filter(|_| self.cloud_cover >= OVERCAST_COVER)
    }
}

#[cfg(test)]
mod tests;
