//! Heights of a place in a file beside its tileset: what the physics of a city was made with, so that it need not be found
//! in triangles again.
//!
//! The file (`heights.bin`) is a line with its name, the length of a TOML head (u32, little-endian), the head, and the
//! rasters' heights (f32, little-endian): terrain, then surface; then the corners of the triangles that stand outside them
//! (f64, little-endian).

use boresight_models::ground::city::City;
use boresight_models::ground::dsm::{Dsm, HeightGrid};
use boresight_models::ground::footprints::surveyed;
use boresight_models::ground::roughness::Roughness;
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file beside `tileset.json`.
pub const FILE: &str = "heights.bin";
const MAGIC: &[u8] = b"boresight heights 2\n";
/// Longest head that is read [byte].
const MOST_HEAD: usize = 64 << 20;

/// Heights of a place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heights {
    head: Head,
    /// The bare ground, where a source said which it is [m, ENU of the site].
    pub terrain: Option<HeightGrid>,
    /// The highest point of each cell, where sight lines meet columns and no triangles [m].
    pub surface: Option<HeightGrid>,
    /// What sight lines meet outside the surface [m].
    beyond: Vec<[DVec3; 3]>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Head {
    site: Site,
    terrain: Option<Frame>,
    surface: Option<Frame>,
    city: Option<CityHead>,
}

/// Where the rasters' east, north, up begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Site {
    latitude_rad: f64,
    longitude_rad: f64,
    height_m: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Frame {
    origin_e_m: f64,
    origin_n_m: f64,
    cell_m: f64,
    nx: usize,
    ny: usize,
}

/// What is known of a generated city besides its surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct CityHead {
    station_enu_m: [f64; 3],
    mean_height_m: f64,
    outside_m: f64,
    triangles_beyond: usize,
    buildings: Vec<BuildingHead>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct BuildingHead {
    outline_en_m: Vec<[f64; 2]>,
    base_m: f64,
    top_m: f64,
}

/// A generated city as the physics sees it.
#[derive(Clone, Debug)]
pub struct Columns {
    /// Heights and sight lines.
    pub dsm: Dsm,
    /// Its buildings.
    pub buildings: Vec<boresight_models::ground::city::Building>,
    /// How they slow the wind.
    pub roughness: Roughness,
    /// Where a station stands whose place is not given [m].
    pub station_enu_m: DVec3,
}

/// Why a file of heights cannot be used; prints as one line.
#[derive(Debug, thiserror::Error)]
#[error("{FILE}: {0}; delete it, or build the tiles again")]
pub struct HeightsError(String);

impl Heights {
    /// Those of a city whose sight lines meet columns: a generated one.
    pub fn of_city(city: &City, site: &SiteFrame) -> Self {
        let buildings = city.buildings.iter().map(|building| BuildingHead {
            outline_en_m: (building.footprint_enu_m().iter())
                .map(|p| p.to_array())
                .collect(),
            base_m: building.base_m,
            top_m: building.base_m + building.height_m(),
        });
        let city_head = CityHead {
            station_enu_m: city.station_enu_m().to_array(),
            mean_height_m: city.roughness.mean_height_m,
            outside_m: city.dsm.terrain_m(f64::MAX, f64::MAX),
            triangles_beyond: city.dsm.beyond().count(),
            buildings: buildings.collect(),
        };
        let mut new = Self::of_terrain(Some(city.dsm.terrain().clone()), site);
        new.surface = Some(city.dsm.surface().clone());
        new.beyond = city.dsm.beyond().collect();
        new.head.city = Some(city_head);
        new
    }

    /// Those of a place of which the bare ground may be known; the rest is found in the triangles.
    pub fn of_terrain(terrain: Option<HeightGrid>, site: &SiteFrame) -> Self {
        let origin = site.origin();
        Self {
            head: Head {
                site: Site {
                    latitude_rad: origin.latitude_rad,
                    longitude_rad: origin.longitude_rad,
                    height_m: origin.height_m,
                },
                ..Head::default()
            },
            terrain,
            surface: None,
            beyond: Vec::new(),
        }
    }

    /// Whether its rasters lie in the frame of a site.
    pub fn is_of(&self, site: &SiteFrame) -> bool {
        /// Farther apart, cells of the rasters would lie elsewhere [m].
        const APART_M: f64 = 1e-3;
        let Site {
            latitude_rad,
            longitude_rad,
            height_m,
        } = self.head.site;
        let own = Geodetic {
            latitude_rad,
            longitude_rad,
            height_m,
        };
        own.to_ecef().distance(site.origin().to_ecef()) < APART_M
    }

    /// The city of columns that it holds; `None` where the physics is to be found in triangles.
    pub fn columns(self) -> Option<Columns> {
        let (head, terrain, surface) = (self.head.city?, self.terrain?, self.surface?);
        let building = |head: BuildingHead| {
            let outline = head.outline_en_m.into_iter().map(DVec2::from_array);
            surveyed(outline.collect(), head.base_m, head.top_m)
        };
        Some(Columns {
            dsm: Dsm::new(terrain, surface, head.outside_m).with_beyond(self.beyond),
            buildings: head.buildings.into_iter().map(building).collect(),
            roughness: Roughness {
                mean_height_m: head.mean_height_m,
                shares: None,
            },
            station_enu_m: head.station_enu_m.into(),
        })
    }

    /// The file's bytes.
    pub fn to_bytes(&self) -> Result<Vec<u8>, HeightsError> {
        let frame = |grid: &HeightGrid| Frame {
            origin_e_m: grid.origin_e_m,
            origin_n_m: grid.origin_n_m,
            cell_m: grid.cell_m,
            nx: grid.nx,
            ny: grid.ny,
        };
        let head = Head {
            terrain: self.terrain.as_ref().map(frame),
            surface: self.surface.as_ref().map(frame),
            ..self.head.clone()
        };
        let head = toml::to_string(&head).map_err(|error| HeightsError(error.to_string()))?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend((head.len() as u32).to_le_bytes());
        bytes.extend(head.as_bytes());
        for grid in [&self.terrain, &self.surface].into_iter().flatten() {
            bytes.extend(
                grid.heights_m
                    .iter()
                    .flat_map(|height_m| height_m.to_le_bytes()),
            );
        }
        let numbers = self.beyond.iter().flatten().flat_map(DVec3::to_array);
        bytes.extend(numbers.flat_map(f64::to_le_bytes));
        Ok(bytes)
    }

    /// Writes the file into a tileset's folder.
    pub fn write(&self, folder: &Path) -> Result<(), HeightsError> {
        std::fs::write(folder.join(FILE), self.to_bytes()?)
            .map_err(|error| HeightsError(format!("cannot be written: {error}")))
    }

    /// Reads the file's bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, HeightsError> {
        let fault = |what: &str| HeightsError(what.to_owned());
        let rest = bytes.strip_prefix(MAGIC);
        let rest = rest.ok_or_else(|| fault("is no file of heights"))?;
        let (length, rest) = rest
            .split_first_chunk::<4>()
            .ok_or_else(|| fault("is cut off"))?;
        let length = u32::from_le_bytes(*length) as usize;
        if length > rest.len().min(MOST_HEAD) {
            return Err(fault("is cut off"));
        }
        let (head, mut rest) = rest.split_at(length);
        let head = std::str::from_utf8(head).map_err(|_| fault("its head is no text"))?;
        let head: Head = toml::from_str(head).map_err(|error| fault(error.message()))?;
        let mut grid = |frame: Option<Frame>| -> Result<Option<HeightGrid>, HeightsError> {
            let Some(frame) = frame else {
                return Ok(None);
            };
            let count = frame.nx.checked_mul(frame.ny).filter(|count| *count > 0);
            let bytes = count.and_then(|count| count.checked_mul(4));
            let bytes = bytes.filter(|bytes| *bytes <= rest.len());
            let bytes = bytes.ok_or_else(|| fault("a raster is cut off"))?;
            let (own, after) = rest.split_at(bytes);
            rest = after;
            let heights_m = own
                .as_chunks::<4>()
                .0
                .iter()
                .map(|b| f32::from_le_bytes(*b));
            let heights_m: Vec<f32> = heights_m.collect();
            let sound = frame.cell_m > 0.0
                && frame.cell_m.is_finite()
                && frame.origin_e_m.is_finite()
                && frame.origin_n_m.is_finite()
                && heights_m.iter().all(|height_m| height_m.is_finite());
            if !sound {
                return Err(fault("a raster holds what is no number"));
            }
            Ok(Some(HeightGrid {
                origin_e_m: frame.origin_e_m,
                origin_n_m: frame.origin_n_m,
                cell_m: frame.cell_m,
                nx: frame.nx,
                ny: frame.ny,
                heights_m,
            }))
        };
        let terrain = grid(head.terrain)?;
        let surface = grid(head.surface)?;
        let count = head.city.as_ref().map_or(0, |city| city.triangles_beyond);
        let numbers: Vec<f64> = rest
            .as_chunks::<8>()
            .0
            .iter()
            .map(|b| f64::from_le_bytes(*b))
            .collect();
        let (triangles, _) = numbers.as_chunks::<9>();
        if triangles.len() < count {
            return Err(fault("the triangles outside its rasters are cut off"));
        }
        let corners = |triangle: &[f64; 9]| [0, 3, 6].map(|k| DVec3::from_slice(&triangle[k..]));
        let beyond: Vec<[DVec3; 3]> = triangles[..count].iter().map(corners).collect();
        if !beyond.iter().flatten().all(|r| r.is_finite()) {
            return Err(fault("a triangle holds what is no number"));
        }
        Ok(Self {
            head: Head {
                terrain: None,
                surface: None,
                ..head
            },
            terrain,
            surface,
            beyond,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use boresight_models::ground::city::CityParams;

    fn site(height_m: f64) -> SiteFrame {
        SiteFrame::new(Geodetic {
            latitude_rad: 0.8269,
            longitude_rad: 0.1490,
            height_m,
        })
    }

    #[test]
    fn a_generated_city_comes_back_bit_for_bit() {
        let params = CityParams {
            extent_m: 800.0,
            ..CityParams::default()
        };
        let city = City::generate(&params).unwrap();
        let bytes = Heights::of_city(&city, &site(455.0)).to_bytes().unwrap();
        let read = Heights::from_bytes(&bytes).unwrap();
        assert!(read.is_of(&site(455.0)) && !read.is_of(&site(456.0)));
        let columns = read.columns().unwrap();
        assert_eq!(columns.dsm.surface(), city.dsm.surface());
        assert_eq!(columns.dsm.terrain(), city.dsm.terrain());
        assert_eq!(columns.station_enu_m, city.station_enu_m());
        assert_eq!(columns.roughness, city.roughness);
        assert_eq!(columns.buildings.len(), city.buildings.len());
        let there = |dsm: &Dsm| dsm.terrain_m(9_000.0, 0.0);
        assert_eq!(there(&columns.dsm), there(&city.dsm));
        let (eye, along) = (city.station_enu_m(), DVec3::new(0.7, 0.7, 0.002));
        let far = |dsm: &Dsm| dsm.first_hit_kind(eye, along.normalize(), 20_000.0);
        assert!(far(&city.dsm).is_some_and(|(range_m, _)| range_m > 3_000.0));
        assert_eq!(far(&columns.dsm), far(&city.dsm));
        for cut in [0, 10, 22, 300, bytes.len() - 1] {
            assert!(Heights::from_bytes(&bytes[..cut]).is_err(), "{cut}");
        }
        let terrain = Heights::of_terrain(Some(city.dsm.terrain().clone()), &site(455.0));
        let read = Heights::from_bytes(&terrain.to_bytes().unwrap()).unwrap();
        assert_eq!(read.terrain.as_ref(), Some(city.dsm.terrain()));
        assert!(read.columns().is_none());
    }
}
