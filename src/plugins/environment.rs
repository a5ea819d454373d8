//! Site, city, weather and light; the air at every UAV.

use crate::components::environment::Environment;
use crate::components::run::{Options, PartError, RunScenario, SetUp, Tick, TickSet};
use crate::models::air::atmosphere::{air_density_kgpm3, pressure_at_pa};
use crate::models::air::sky::{GROUND_ALBEDO, Sky};
use crate::models::air::sun::Sun;
use crate::models::air::wind::MeanWind;
use crate::models::ground::city::City;
use crate::models::maths::geodesy::{Geodetic, SiteFrame};
use crate::plugins::run::fallible;
use crate::scenario::{InputError, Loaded};
use crate::systems::environment as systems;
use bevy::prelude::*;
use glam::DVec3;
use std::sync::Arc;

/// Adds the domain to both schedules, in [`TickSet::Environment`].
pub struct EnvironmentPlugin;

impl Plugin for EnvironmentPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(SetUp, fallible(set_up).in_set(TickSet::Environment))
            .add_systems(
                Tick,
                (systems::change_weather, systems::blow)
                    .chain()
                    .in_set(TickSet::Environment),
            );
    }
}

fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    options: Res<Options>,
) -> Result<(), PartError> {
    // Baked shadows depend on the sun, and only pictures show them.
    let city = options.city.clone().filter(|_| !options.capture);
    commands.insert_resource(environment(&loaded, city)?);
    Ok(())
}

/// The surroundings that a scenario describes; `city` is taken if it has the scenario's parameters.
fn environment(loaded: &Loaded, city: Option<Arc<City>>) -> Result<Environment, InputError> {
    let scenario = &loaded.scenario;
    let weather =
        (scenario.weather.resolved()).map_err(|error| loaded.refuse("weather.metar", error))?;
    let site = SiteFrame::new(Geodetic {
        latitude_rad: scenario.site.latitude_deg.to_radians(),
        longitude_rad: scenario.site.longitude_deg.to_radians(),
        height_m: scenario.site.altitude_m,
    });
    let pressure_pa = pressure_at_pa(weather.pressure_pa, scenario.site.altitude_m);
    let sun = Sun::new(
        &scenario.time_utc,
        site.origin(),
        pressure_pa,
        weather.temperature_k,
    )
    .map_err(|error| loaded.refuse("time_utc", error))?;
    let sun_dir_enu = sun.sun_dir_enu();
    let city = match city.filter(|city| city.params == scenario.city) {
        Some(city) => city,
        None => generated_city(loaded, sun_dir_enu)?,
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
    Ok(Environment {
        air_density_kgpm3: air_density_kgpm3(
            pressure_pa,
            weather.temperature_k,
            weather.relative_humidity,
        ),
        cn2: scenario.turbulence.cn2_profile(mean_height_m, day),
        sky: Sky::new(
            sun_dir_enu,
            weather.visibility_m,
            weather.cloud_cover,
            GROUND_ALBEDO,
        ),
        site,
        city,
        tiles: None,
        weather,
        mean_wind,
        sun_dir_enu,
    })
}

/// The scenario's city under its sun.
fn generated_city(loaded: &Loaded, sun_dir_enu: DVec3) -> Result<Arc<City>, InputError> {
    let mut city =
        City::generate(&loaded.scenario.city).map_err(|error| loaded.refuse("city", error))?;
    city.bake_shadows(sun_dir_enu);
    Ok(Arc::new(city))
}
