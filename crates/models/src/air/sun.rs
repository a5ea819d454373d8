//! The sun's direction, by NREL's Solar Position Algorithm (Reda & Andreas 2004, +-0.0003 deg)
//! through the `solar-positioning` crate.

use chrono::{DateTime, Utc};
use glam::DVec3;
use solar_positioning::{Location, RefractionCorrection, SolarPositions, delta_t};

use crate::maths::geodesy::Geodetic;

/// The sun's position could not be computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "no sun position for {utc} at latitude {latitude_deg} deg, longitude {longitude_deg} deg: \
     {reason}; correct the scenario's time, site or weather"
)]
pub struct SunError {
    utc: DateTime<Utc>,
    latitude_deg: f64,
    longitude_deg: f64,
    reason: String,
}

/// The sun as seen from a site, refraction included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Azimuth, clockwise from true north [rad].
    pub azimuth_rad: f64,
    /// Apparent elevation of the disc's centre [rad].
    pub elevation_rad: f64,
}

impl Sun {
    /// The sun over `site` at `utc`, refracted by air of `pressure_pa` and `temperature_k` at the
    /// site; delta T is the Espenak-Meeus estimate for the date.
    pub fn new(
        utc: &DateTime<Utc>,
        site: Geodetic,
        pressure_pa: f64,
        temperature_k: f64,
    ) -> Result<Self, SunError> {
        let location = Location {
            latitude: site.latitude_rad.to_degrees(),
            longitude: site.longitude_rad.to_degrees(),
        };
        let position = || {
            let delta_t_s = delta_t::estimate_from_date_like(utc)?;
            let air = RefractionCorrection::new(pressure_pa / 100.0, temperature_k - 273.15)?;
            SolarPositions::new().at(utc, location, site.height_m, delta_t_s, Some(air))
        };
        let position = position().map_err(|error: solar_positioning::Error| SunError {
            utc: *utc,
            latitude_deg: location.latitude,
            longitude_deg: location.longitude,
            reason: error.to_string(),
        })?;
        Ok(Self {
            azimuth_rad: position.azimuth().to_radians(),
            elevation_rad: position.elevation_angle().to_radians(),
        })
    }

    /// The unit vector from the site to the sun, in ENU.
    pub fn sun_dir_enu(&self) -> DVec3 {
        let (sin_az, cos_az) = self.azimuth_rad.sin_cos();
        let (sin_el, cos_el) = self.elevation_rad.sin_cos();
        DVec3::new(sin_az * cos_el, cos_az * cos_el, sin_el)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn golden() -> Geodetic {
        Geodetic {
            latitude_rad: 39.742476_f64.to_radians(),
            longitude_rad: (-105.1786_f64).to_radians(),
            height_m: 1830.14,
        }
    }

    #[test]
    fn nrel_published_example() {
        let utc = "2003-10-17T19:30:30Z".parse().unwrap();
        let sun = Sun::new(&utc, golden(), 82_000.0, 284.15).unwrap();
        // The example fixes delta T at 67 s; the estimate for 2003 is 64.6 s, which moves the sun
        // by less than 3e-5 deg.
        assert!((90.0 - sun.elevation_rad.to_degrees() - 50.11162).abs() < 1e-4);
        assert!((sun.azimuth_rad.to_degrees() - 194.34024).abs() < 1e-4);
        let dir = sun.sun_dir_enu();
        assert!((dir.length() - 1.0).abs() < 1e-15);
        // South by south-west, well up.
        assert!(
            dir.x < 0.0 && dir.y < 0.0 && (dir.z - 50.11162_f64.to_radians().cos()).abs() < 1e-5
        );
    }

    #[test]
    fn bad_input_is_an_error() {
        let utc = "2003-10-17T19:30:30Z".parse().unwrap();
        let nowhere = Geodetic {
            latitude_rad: 2.0,
            ..golden()
        };
        let error = Sun::new(&utc, nowhere, 82_000.0, 284.15).unwrap_err();
        assert!(error.to_string().contains("latitude 114.59"));
        assert!(Sun::new(&utc, golden(), 82_000.0, f64::NAN).is_err());
    }
}
