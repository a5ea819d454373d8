//! What a city is generated from, and the values it takes.

use std::ops::RangeInclusive;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// What a city looks like.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CityParams {
    /// Side of the built square about the site point [m].
    pub extent_m: f64,
    /// Seed of the layout.
    pub seed: u64,
    /// Share of lots that are built on, 0..1.
    pub building_density: f64,
    /// Height of the tallest downtown towers [m].
    pub max_height_m: f64,
    /// Peak height of the terrain's undulation [m].
    pub relief_m: f64,
    /// Whether a river crosses the city north of the site point.
    pub river: bool,
    /// Share of the area given to the main park, 0..0.3.
    pub park_share: f64,
    /// Most trees planted in a city; woods of `forest_share` have up to 15,000 of their own.
    pub max_trees: u32,
    /// Roof height of the station's tower [m].
    pub station_height_m: f64,
    /// Share of the land under woods, 0..1. Above 0 there is open country in place of the city: woods,
    /// fields, a road and a few houses, more of them with `building_density`; the station then has no
    /// tower and stands on the open ground at the site point.
    pub forest_share: f64,
}

impl Default for CityParams {
    fn default() -> Self {
        Self {
            extent_m: 2400.0,
            seed: 1,
            building_density: 0.93,
            max_height_m: 120.0,
            relief_m: 9.0,
            river: true,
            park_share: 0.04,
            max_trees: 2000,
            station_height_m: 45.0,
            forest_share: 0.0,
        }
    }
}

/// Why a city cannot be generated.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CityError {
    /// A parameter is outside its range.
    #[error("city {field} = {value} is outside {low}..{high}")]
    OutOfRange {
        /// Parameter name.
        field: &'static str,
        /// Its value.
        value: f64,
        /// Least value.
        low: f64,
        /// Greatest value.
        high: f64,
    },
}

impl CityParams {
    /// Every bounded parameter: its name, its value, and the range it must lie in.
    pub fn ranges(&self) -> [(&'static str, f64, RangeInclusive<f64>); 7] {
        [
            ("extent_m", self.extent_m, 800.0..=6000.0),
            ("building_density", self.building_density, 0.0..=1.0),
            ("max_height_m", self.max_height_m, 20.0..=400.0),
            ("relief_m", self.relief_m, 0.0..=60.0),
            ("park_share", self.park_share, 0.0..=0.3),
            ("station_height_m", self.station_height_m, 30.0..=120.0),
            ("forest_share", self.forest_share, 0.0..=1.0),
        ]
    }

    /// The first parameter outside its range, as an error.
    pub fn validate(&self) -> Result<(), CityError> {
        for (field, value, range) in self.ranges() {
            if !range.contains(&value) {
                return Err(CityError::OutOfRange {
                    field,
                    value,
                    low: *range.start(),
                    high: *range.end(),
                });
            }
        }
        Ok(())
    }

    /// Whether there is open country in place of the city.
    pub(super) fn is_country(&self) -> bool {
        self.forest_share > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_outside_their_ranges_are_named() {
        assert_eq!(CityParams::default().validate(), Ok(()));
        let bad = CityParams {
            extent_m: f64::NAN,
            ..CityParams::default()
        };
        assert!(matches!(
            bad.validate(),
            Err(CityError::OutOfRange {
                field: "extent_m",
                ..
            })
        ));
        let bad = CityParams {
            park_share: 0.31,
            ..CityParams::default()
        };
        let text = "city park_share = 0.31 is outside 0..0.3";
        assert_eq!(bad.validate().map_err(|e| e.to_string()), Err(text.into()));
    }
}
