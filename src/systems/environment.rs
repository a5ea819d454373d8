//! The air at every UAV, and the weather that operators change.

use crate::components::environment::Environment;
use crate::components::flight::{Air, Flight};
use crate::components::mount::Mount;
use crate::components::operator::{Command, Operator};
use crate::components::run::{Failure, Seed, SimClock};
use crate::models::air::shared_gusts::SharedNoise;
use crate::models::air::sky::{GROUND_ALBEDO, Sky};
use crate::models::air::weather::Weather;
use crate::models::air::wind::WindError;
use crate::scenario::WeatherOrder;
use bevy::prelude::*;

impl Environment {
    /// Takes over what an order changes of the weather, and the light that follows from it.
    fn change(&mut self, order: &WeatherOrder) -> Result<(), WindError> {
        let before = self.weather;
        let wind_speed_mps = order.wind_speed_mps.unwrap_or(before.wind_speed_mps);
        let wind_from_rad = (order.wind_from_deg).map_or(before.wind_from_rad, f64::to_radians);
        self.mean_wind = (self.mean_wind).changed(wind_speed_mps, wind_from_rad.to_degrees())?;
        self.weather = Weather {
            wind_speed_mps,
            wind_from_rad,
            gust_mps: before
                .gust_mps
                .filter(|gust_mps| *gust_mps >= wind_speed_mps),
            visibility_m: order.visibility_m.unwrap_or(before.visibility_m),
            ..before
        };
        self.backdrop.sky = Sky::new(
            self.backdrop.sun_dir_enu,
            self.weather.visibility_m,
            self.weather.cloud_cover,
            GROUND_ALBEDO,
        );
        Ok(())
    }
}

/// Changes the weather as operators ordered in the last tick: what reads it follows by itself, and the air
/// around UAVs and mounts goes on in the new wind.
pub fn change_weather(
    operators: Query<&Operator>,
    mut environment: ResMut<Environment>,
    mut uavs: Query<&mut Air>,
    mut mounts: Query<&mut Mount>,
    mut failure: ResMut<Failure>,
) {
    for command in operators.iter().flat_map(|operator| &operator.due) {
        let Command::Weather(order) = command else {
            continue;
        };
        if let Err(error) = environment.change(order) {
            failure.set(error);
        }
        let Environment {
            mean_wind, weather, ..
        } = &*environment;
        for mut air in &mut uavs {
            let gusts = air.gusts.clone().carried_by(mean_wind);
            air.gusts = gusts.reaching(weather.gust_mps);
        }
        let winds = mounts
            .iter_mut()
            .filter_map(|mount| mount.into_inner().wind.as_mut());
        for wind in winds {
            wind.mean_enu_mps = mean_wind.mean_wind_enu_mps(wind.height_agl_m);
            wind.gusts = (wind.gusts.clone().carried_by(mean_wind)).reaching(weather.gust_mps);
        }
    }
}

/// Mean wind and gusts at every UAV, where it was at the end of the last tick.
pub fn blow(
    clock: Res<SimClock>,
    seed: Res<Seed>,
    environment: Res<Environment>,
    mut uavs: Query<(&Flight, &mut Air)>,
) {
    let dt_s = clock.dt_s();
    let mut shared = None;
    for (flight, mut air) in &mut uavs {
        let r = flight.state.r_enu_m;
        let height_agl_m = r.z - environment.city.dsm.terrain_m(r.x, r.y);
        let mean = environment.mean_wind.mean_wind_enu_mps(height_agl_m);
        let airspeed_mps = (flight.state.v_enu_mps - mean).length();
        let Air {
            gusts,
            rng,
            wind_enu_mps,
        } = &mut *air;
        let gust = match rng {
            Some(rng) => gusts.step(dt_s, height_agl_m, airspeed_mps, rng),
            None => {
                let noise = shared.get_or_insert_with(|| {
                    SharedNoise::draw(1, &mut seed.stream(clock.tick, "shared gusts"))
                });
                gusts.step_together(dt_s, r, height_agl_m, airspeed_mps, noise)
            }
        };
        *wind_enu_mps = mean + gust;
    }
}
