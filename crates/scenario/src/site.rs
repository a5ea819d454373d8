//! Where and when a scenario takes place.

use std::fmt;

use chrono::{DateTime, Utc};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{Check, ELEVATION};
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};

/// The site point: WGS-84 geodetic coordinates of the local origin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Site {
    /// Geodetic latitude, north positive.
    pub latitude_deg: f64,
    /// Longitude, east positive.
    pub longitude_deg: f64,
    /// Height of the street level above the ellipsoid.
    pub altitude_m: f64,
}

impl Site {
    /// The point on the Earth.
    pub fn geodetic(&self) -> Geodetic {
        Geodetic {
            latitude_rad: self.latitude_deg.to_radians(),
            longitude_rad: self.longitude_deg.to_radians(),
            height_m: self.altitude_m,
        }
    }

    /// The local frame there.
    pub fn frame(&self) -> SiteFrame {
        SiteFrame::new(self.geodetic())
    }

    pub(super) fn check(&self, check: &mut Check) {
        check.within("latitude_deg", self.latitude_deg, ELEVATION);
        check.within("longitude_deg", self.longitude_deg, -180.0..=180.0);
        check.within("altitude_m", self.altitude_m, -500.0..=9000.0);
    }
}

/// Accepts TOML's own date-time and RFC 3339 text.
pub(super) fn date_time<'de, D: serde::Deserializer<'de>>(
    deserializer: D,
) -> Result<DateTime<Utc>, D::Error> {
    use serde::de::{Error, MapAccess, Visitor, value::MapAccessDeserializer};

    struct TimeVisitor;
    impl<'de> Visitor<'de> for TimeVisitor {
        type Value = DateTime<Utc>;

        fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
            formatter.write_str("a time with its zone such as 2025-06-21T10:00:00Z")
        }

        fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
            DateTime::parse_from_rfc3339(text)
                .map(|time| time.with_timezone(&Utc))
                .map_err(|_| E::invalid_value(serde::de::Unexpected::Str(text), &self))
        }

        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
            let time = toml::value::Datetime::deserialize(MapAccessDeserializer::new(map))?;
            self.visit_str(&time.to_string())
        }
    }
    deserializer.deserialize_any(TimeVisitor)
}
