//! City, weather and light from their scenario.

use crate::components::environment::{CityTiles, Environment};
use crate::models::air::atmosphere::air_density_kgpm3;
use crate::models::air::backdrop::Backdrop;
use crate::models::air::sky::{GROUND_ALBEDO, Sky};
use crate::models::air::wind::MeanWind;
use crate::models::ground::city::City;
use crate::models::maths::geodesy::SiteFrame;
use crate::place::{self, made_from};
use crate::scenario::{Above, InputError, Loaded};
use crate::warning;
use glam::DVec3;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// How far from the site point anything may be placed [m].
pub const FARTHEST_M: f64 = 50_000.0;

/// The scenario with its places above ground and roofs where they are in a city; `None` where it has none.
pub fn placed(
    loaded: &Loaded,
    site: &SiteFrame,
    city: &City,
) -> Result<Option<Loaded>, InputError> {
    loaded.placed(|place| {
        let r_enu_m = place.in_site(site);
        let under_m = match place.above {
            Above::Ground => city.dsm.terrain_m(r_enu_m.x, r_enu_m.y),
            Above::Roof => city.dsm.surface_m(r_enu_m.x, r_enu_m.y),
            Above::Ellipsoid | Above::Site => 0.0,
        };
        let found = r_enu_m + under_m * DVec3::Z;
        let far = found.truncate().length() > FARTHEST_M;
        match far {
            true => Err(format!(
                "lies {:.0} km from the site point: give a place within {:.0} km of it",
                1e-3 * found.truncate().length(),
                1e-3 * FARTHEST_M
            )),
            false => Ok(found),
        }
    })
}

/// The surroundings that a scenario describes; `city` is taken if it has the scenario's parameters.
pub fn environment(
    loaded: &Loaded,
    city: Option<Arc<City>>,
    seed: u64,
) -> Result<Environment, InputError> {
    let scenario = &loaded.scenario;
    let site = scenario.site.frame();
    let (weather, pressure_pa, sun) = loaded.weather_and_sun()?;
    let warnings = scenario.weather.notes().warnings(&loaded.path);
    warning::tell(&warnings).map_err(|error| loaded.refuse("weather.metar", error))?;
    let sun_dir_enu = sun.sun_dir_enu();
    let own = made_from(&scenario.city, folder(loaded));
    let (city, tiles) = match city.filter(|city| city.params == own) {
        Some(city) => (city, None),
        None if own.is_real() => real_city(loaded, &site)?,
        None => (generated_city(loaded, sun_dir_enu)?, None),
    };
    let mean_height_m = city.roughness.mean_height_m;
    let day = sun_dir_enu.z > 0.0;
    // The displacement is counted from the roofs that UAVs fly above.
    let roughness_m = city.roughness.length_m();
    let weather = scenario.weather.at_site(weather, roughness_m);
    let mean_wind = MeanWind::new(
        weather.wind_speed_mps,
        weather.wind_from_rad.to_degrees(),
        roughness_m,
        city.roughness.displacement_m(),
    )
    .map_err(|error| loaded.refuse("weather", error))?;
    let sky = Sky::new(
        sun_dir_enu,
        weather.visibility_m,
        weather.cloud_cover,
        GROUND_ALBEDO,
    );
    let clouds = scenario.weather.cloud_texture.then_some(seed);
    Ok(Environment {
        air_density_kgpm3: air_density_kgpm3(
            pressure_pa,
            weather.temperature_k,
            weather.relative_humidity,
        ),
        cn2: scenario.turbulence.cn2_profile(mean_height_m, day),
        site,
        city,
        tiles,
        weather,
        mean_wind,
        backdrop: Backdrop::new(sky, sun_dir_enu).with_clouds(weather.cloud_cover, clouds),
    })
}

/// The folder of a scenario's file.
pub fn folder(loaded: &Loaded) -> &Path {
    loaded.path.parent().unwrap_or(Path::new(""))
}

/// The scenario's real city, and its tiles.
pub fn real_city(
    loaded: &Loaded,
    site: &SiteFrame,
) -> Result<(Arc<City>, Option<CityTiles>), InputError> {
    let params = &loaded.scenario.city;
    let place = place::load(params, site, folder(loaded)).map_err(|error| {
        let key = error.key(params.tileset.is_some());
        loaded.refuse(&format!("city.{key}"), error)
    })?;
    warning::tell(&place.warnings).map_err(|error| loaded.refuse("city", error))?;
    let tiles = CityTiles {
        tileset: Arc::new(Mutex::new(place.tileset)),
        location: place.location,
        site: *site,
        enu_from_root: place.enu_from_root,
        light: params.light.unwrap_or_default(),
        summary: place.summary,
        warnings: place.warnings,
    };
    Ok((Arc::new(place.city), Some(tiles)))
}

/// The city of a scenario, to be used by several runs without pictures.
pub fn city_of(loaded: &Loaded) -> Result<Arc<City>, InputError> {
    let scenario = &loaded.scenario;
    match scenario.city.is_real() {
        true => Ok(real_city(loaded, &scenario.site.frame())?.0),
        false => City::generate(&scenario.city)
            .map(Arc::new)
            .map_err(|error| loaded.refuse("city", error)),
    }
}

/// A scenario with its places in its city, and the city.
pub fn placed_in_city(loaded: Loaded) -> Result<(Loaded, Arc<City>), InputError> {
    let city = city_of(&loaded)?;
    let placed = placed(&loaded, &loaded.scenario.site.frame(), &city)?;
    Ok((placed.unwrap_or(loaded), city))
}

/// The scenario's city under its sun.
pub fn generated_city(loaded: &Loaded, sun_dir_enu: DVec3) -> Result<Arc<City>, InputError> {
    let mut city =
        City::generate(&loaded.scenario.city).map_err(|error| loaded.refuse("city", error))?;
    city.bake_shadows(sun_dir_enu);
    Ok(Arc::new(city))
}
