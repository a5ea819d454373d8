//! The site's world: city, weather, light.

use crate::models::air::atmosphere::Cn2Profile;
use crate::models::air::backdrop::Backdrop;
use crate::models::air::weather::Weather;
use crate::models::air::wind::MeanWind;
use crate::models::ground::city::City;
use crate::models::ground::dsm::LineOfSight;
use crate::models::maths::geodesy::SiteFrame;
use crate::models::optics::seeing::{FrozenAir, LayerWinds, Sight};
use crate::models::shape::textured::TilesLight;
use crate::tiles::tileset::Tileset;
use crate::warning::Warning;
use bevy::prelude::*;
use glam::{DAffine3, DVec3};
use std::sync::{Arc, Mutex};

/// Everything around the engagement. Nothing but an order changes it during a run: wind, visibility and light.
#[derive(Resource, Clone)]
pub struct Environment {
    /// The local frame on the Earth.
    pub site: SiteFrame,
    /// Terrain, buildings and their height raster.
    pub city: Arc<City>,
    /// The tiles that show a real city; `None` where the city is generated, or nothing is drawn.
    pub tiles: Option<CityTiles>,
    /// Wind, visibility, temperature.
    pub weather: Weather,
    /// Mean wind over height.
    pub mean_wind: MeanWind,
    /// Air density at the site [kg/m^3].
    pub air_density_kgpm3: f64,
    /// Optical turbulence over height above the ground.
    pub cn2: Cn2Profile,
    /// Sun, sky and clouds.
    pub backdrop: Backdrop,
}

/// The tiles that show a real city.
#[derive(Clone, Debug)]
pub struct CityTiles {
    /// The tileset, as far as it was read: the physics' level of detail is.
    pub tileset: Arc<Mutex<Tileset>>,
    /// Where it is: a path or an address.
    pub location: String,
    /// The local frame on the Earth.
    pub site: SiteFrame,
    /// From the root frame of the tileset's tree [m] to the site's east, north, up [m]: for georeferenced tiles, whose
    /// root is earth-centred, the inverse of the site's place; for others where the scenario puts them.
    pub enu_from_root: DAffine3,
    /// How it is lit.
    pub light: TilesLight,
    /// What it is, in words.
    pub summary: String,
    /// What the readers of its files took for granted or left out.
    pub warnings: Vec<Warning>,
}

impl Environment {
    /// What the city is, in words.
    pub fn describe(&self) -> String {
        if let Some(tiles) = &self.tiles {
            return tiles.summary.clone();
        }
        let surface = self.city.dsm.surface();
        format!(
            "generated, {} m by {} m, {} buildings of {:.1} m on average",
            surface.nx as f64 * surface.cell_m,
            surface.ny as f64 * surface.cell_m,
            self.city.buildings.len(),
            self.city.roughness.mean_height_m,
        )
    }

    /// Whether a point [m, enu] lies in closed cloud or above its base.
    pub fn in_cloud(&self, r_enu_m: DVec3) -> bool {
        self.weather.ceiling_m().is_some_and(|z_m| r_enu_m.z > z_m)
    }

    /// Height of a place [m, enu] above the ground [m], one metre at least.
    pub fn above_ground_m(&self, r_enu_m: DVec3) -> f64 {
        let ground_m = self.city.dsm.terrain_m(r_enu_m.x, r_enu_m.y);
        (r_enu_m.z - ground_m).max(1.0)
    }

    /// The turbulence between a station [m, enu] and what lies `range_m` [m] away in a direction.
    pub fn sight(&self, r_station_enu_m: DVec3, ahead_enu: DVec3, range_m: f64) -> Sight {
        Sight::new(range_m, |along_m| {
            let r_enu_m = r_station_enu_m + along_m * ahead_enu;
            self.cn2.cn2(self.above_ground_m(r_enu_m))
        })
    }

    /// The winds that carry the layers of the air about a station [m, enu].
    pub fn winds(&self, r_station_enu_m: DVec3, air: &FrozenAir) -> LayerWinds {
        /// Rise of the way over which they are taken [-]: that of a look at a UAV 100 m up and 1 km away.
        const RISE: f64 = 0.1;
        let height_m = self.above_ground_m(r_station_enu_m);
        air.winds(|along_m| self.mean_wind.mean_wind_enu_mps(height_m + RISE * along_m))
    }

    /// Whether two points [m, enu] see each other: neither city nor closed cloud in between.
    pub fn line_of_sight(&self, from_enu_m: DVec3, to_enu_m: DVec3) -> LineOfSight {
        let sight = self.city.dsm.line_of_sight(from_enu_m, to_enu_m);
        match self.weather.ceiling_m() {
            Some(base_m) => sight.below(base_m, from_enu_m, to_enu_m),
            None => sight,
        }
    }
}
