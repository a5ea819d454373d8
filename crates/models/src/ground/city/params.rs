//! What a city is generated from, and the values it takes.

use std::ops::{Range, RangeInclusive};

use crate::shape::textured::{TilesLight, UpAxis};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Seeds of the cities that are kept for judging: nothing that learns is shown one of them.
pub const JUDGED_SEEDS: Range<u64> = 1_000_000..2_000_000;

/// The seed of a city to learn from: the drawn one, or where that is kept for judging, another that is not.
pub fn learned_seed(drawn: u64) -> u64 {
    if JUDGED_SEEDS.contains(&drawn) {
        drawn + (JUDGED_SEEDS.end - JUDGED_SEEDS.start)
    } else {
        drawn
    }
}

/// What a city looks like, or which real one it is.
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
    /// A real city in place of a generated one, as 3D Tiles: a `tileset.json`, a folder with one, a `.3tz` archive or an
    /// address; a path is relative to the scenario's folder. All keys above are then left out.
    pub tileset: Option<String>,
    /// A real city in place of a generated one, from raw data: CityJSON, GeoTIFF heights, footprints (GeoJSON, OSM), IFC, OBJ,
    /// glTF, PLY. It is built into tiles once and kept. All keys above are then left out.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sources: Vec<CitySource>,
    /// Where the origin of a tileset that is not placed on the Earth lies: its axes are then the site's east, north, up;
    /// absent: at the site point.
    pub origin_enu_m: Option<[f64; 3]>,
    /// Parameters that place such a tileset, as `boresight georef` writes them.
    pub georef: Option<String>,
    /// Error of the shape that sight lines, crashes and the wind see; absent: 1 m.
    pub detail_m: Option<f64>,
    /// Distance from the site point to each side within which the real city is known to them; absent: 2000 m.
    pub radius_m: Option<f64>,
    /// A height raster (GeoTIFF) of the land around a real city, out to 20 km; absent: its border's heights go on.
    pub horizon: Option<CitySource>,
    /// How a real city is lit: "as_stored" (photographs have their light in them, the rest is lit by sun and sky), "baked" (all of
    /// it is photographs) or "relit" (all of it is lit); absent: as stored.
    pub light: Option<TilesLight>,
}

/// A file of raw data: its path, relative to the scenario's folder, or a table with what is to be known beside it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "expected a path, or a table of file, crs, geoid_height_m, georef, orthophoto, terrain, terrain_crs, base_height_m, building_height_m, lod, mesh_unit and mesh_up"
)]
pub enum CitySource {
    /// A path.
    File(String),
    /// A path and more.
    With(Box<SourceParams>),
}

/// A file of raw data with what is to be known beside it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SourceParams {
    /// Its path, relative to the scenario's folder.
    pub file: String,
    /// Its coordinate reference system, such as "EPSG:7415" or "EPSG:2056+5728", where it names none or a wrong one.
    pub crs: Option<String>,
    /// Height of the geoid over the ellipsoid, in place of EGM96's.
    pub geoid_height_m: Option<f64>,
    /// Parameters that place a local model, as `boresight georef` writes them.
    pub georef: Option<String>,
    /// A picture from above for a height raster: a GeoTIFF, or a JPEG or PNG with a world file.
    pub orthophoto: Option<String>,
    /// A height raster that footprints stand on.
    pub terrain: Option<String>,
    /// The reference system of that raster, where it names none or a wrong one.
    pub terrain_crs: Option<String>,
    /// Height of the ground under footprints where no terrain is given.
    pub base_height_m: Option<f64>,
    /// Height of a building whose source gives none.
    pub building_height_m: Option<f64>,
    /// Level of detail of a city model.
    pub lod: Option<String>,
    /// Unit of an OBJ's or PLY's coordinates, such as "mm" or "ft"; absent: metres, or that of `crs`.
    pub mesh_unit: Option<String>,
    /// Axis of an OBJ or PLY that points up; absent: z.
    pub mesh_up: Option<UpAxis>,
}

impl CityParams {
    /// The paths and addresses in them, which count from the scenario's folder.
    pub fn paths_mut(&mut self) -> Vec<&mut String> {
        let mut paths: Vec<&mut String> = self.tileset.iter_mut().chain(&mut self.georef).collect();
        for source in self.sources.iter_mut().chain(&mut self.horizon) {
            match source {
                CitySource::File(file) => paths.push(file),
                CitySource::With(with) => {
                    let beside = [&mut with.georef, &mut with.orthophoto, &mut with.terrain];
                    paths.push(&mut with.file);
                    paths.extend(beside.into_iter().flatten());
                }
            }
        }
        paths
    }
}

impl CitySource {
    /// With all that may be known.
    pub fn params(&self) -> SourceParams {
        match self {
            Self::With(params) => (**params).clone(),
            Self::File(file) => SourceParams {
                file: file.clone(),
                crs: None,
                geoid_height_m: None,
                georef: None,
                orthophoto: None,
                terrain: None,
                terrain_crs: None,
                base_height_m: None,
                building_height_m: None,
                lod: None,
                mesh_unit: None,
                mesh_up: None,
            },
        }
    }
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
            tileset: None,
            sources: Vec::new(),
            origin_enu_m: None,
            georef: None,
            detail_m: None,
            radius_m: None,
            horizon: None,
            light: None,
        }
    }
}

/// Why a city cannot be generated.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CityError {
    /// A parameter is outside its range.
    #[error("{field} = {value} is outside {low}..{high}; give a value inside")]
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
    /// The error of the shape that the physics of a real city may have [m].
    pub fn detail_m(&self) -> f64 {
        self.detail_m.unwrap_or(1.0)
    }

    /// Half the side of the square in which the physics knows a real city [m].
    pub fn radius_m(&self) -> f64 {
        self.radius_m.unwrap_or(2_000.0)
    }

    /// Every bounded parameter: its name, its value, and the range it must lie in.
    pub fn ranges(&self) -> [(&'static str, f64, RangeInclusive<f64>); 9] {
        [
            ("extent_m", self.extent_m, 800.0..=6000.0),
            ("building_density", self.building_density, 0.0..=1.0),
            ("max_height_m", self.max_height_m, 20.0..=400.0),
            ("relief_m", self.relief_m, 0.0..=60.0),
            ("park_share", self.park_share, 0.0..=0.3),
            ("station_height_m", self.station_height_m, 30.0..=120.0),
            ("forest_share", self.forest_share, 0.0..=1.0),
            ("detail_m", self.detail_m(), 0.05..=100.0),
            ("radius_m", self.radius_m(), 50.0..=10_000.0),
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

    /// Whether it is a real city in place of a generated one.
    pub fn is_real(&self) -> bool {
        self.tileset.is_some() || !self.sources.is_empty()
    }

    /// The first key that does not go with the others: its name, and why.
    pub fn contradiction(&self) -> Option<(&'static str, String)> {
        let plain = Self::default();
        let generator = [
            ("extent_m", self.extent_m != plain.extent_m),
            ("seed", self.seed != plain.seed),
            (
                "building_density",
                self.building_density != plain.building_density,
            ),
            ("max_height_m", self.max_height_m != plain.max_height_m),
            ("relief_m", self.relief_m != plain.relief_m),
            ("river", self.river != plain.river),
            ("park_share", self.park_share != plain.park_share),
            ("max_trees", self.max_trees != plain.max_trees),
            (
                "station_height_m",
                self.station_height_m != plain.station_height_m,
            ),
            ("forest_share", self.forest_share != plain.forest_share),
        ];
        let placing = [
            ("origin_enu_m", self.origin_enu_m.is_some()),
            ("georef", self.georef.is_some()),
        ];
        let real = [
            ("detail_m", self.detail_m.is_some()),
            ("radius_m", self.radius_m.is_some()),
            ("horizon", self.horizon.is_some()),
            ("light", self.light.is_some()),
        ];
        let first = |keys: &[(&'static str, bool)]| {
            keys.iter().find(|(_, given)| *given).map(|(key, _)| *key)
        };
        let what = match self.tileset {
            Some(_) => "tileset",
            None => "sources",
        };
        if self.tileset.is_some() && !self.sources.is_empty() {
            let why = "'tileset' names the city already: leave one of the two out";
            return Some(("sources", why.into()));
        }
        if self.is_real() {
            if let Some(key) = first(&generator) {
                let why = format!(
                    "belongs to a generated city, and '{what}' names a real one: leave one of the two out"
                );
                return Some((key, why));
            }
            if self.tileset.is_none()
                && let Some(key) = first(&placing)
            {
                let why = "places a tileset, and 'sources' say themselves where they are: give them their own \
                           crs or georef";
                return Some((key, why.into()));
            }
            return None;
        }
        let key = first(&placing).or_else(|| first(&real))?;
        let why = "belongs to a real city: give 'tileset' or 'sources' too, or leave it out";
        Some((key, why.into()))
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
    fn a_city_to_learn_from_is_none_to_judge_by() {
        let Range { start, end } = JUDGED_SEEDS;
        for kept in [start, start + 1, end - 1] {
            assert!(!JUDGED_SEEDS.contains(&learned_seed(kept)), "{kept}");
        }
        for free in [0, 1, start - 1, end, u64::MAX] {
            assert_eq!(learned_seed(free), free);
        }
    }

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
        let mut both = CityParams {
            tileset: Some("t".into()),
            ..CityParams::default()
        };
        assert_eq!(both.contradiction(), None);
        both.relief_m = 3.0;
        assert_eq!(both.contradiction().unwrap().0, "relief_m");
        let alone = CityParams {
            radius_m: Some(400.0),
            ..CityParams::default()
        };
        assert_eq!(alone.contradiction().unwrap().0, "radius_m");
        let text = "park_share = 0.31 is outside 0..0.3; give a value inside";
        assert_eq!(bad.validate().map_err(|e| e.to_string()), Err(text.into()));
    }
}
