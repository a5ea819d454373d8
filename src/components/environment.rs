//! The site's world: city, weather, light.

use crate::models::atmosphere::Cn2Profile;
use crate::models::city::City;
use crate::models::geodesy::SiteFrame;
use crate::models::sky::Sky;
use crate::models::weather::Weather;
use crate::models::wind::MeanWind;
use bevy::prelude::*;
use glam::DVec3;
use std::sync::Arc;

/// Everything around the engagement that does not change during a run.
#[derive(Resource, Clone)]
pub struct Environment {
    /// The local frame on the Earth.
    pub site: SiteFrame,
    /// Terrain, buildings and their height raster.
    pub city: Arc<City>,
    /// Wind, visibility, temperature.
    pub weather: Weather,
    /// Mean wind over height.
    pub mean_wind: MeanWind,
    /// Air density at the site [kg/m^3].
    pub air_density_kgpm3: f64,
    /// Optical turbulence over height above the ground.
    pub cn2: Cn2Profile,
    /// Unit vector to the sun.
    pub sun_dir_enu: DVec3,
    /// Light of sun and sky.
    pub sky: Sky,
    /// Master seed of the run.
    pub seed: u64,
}
