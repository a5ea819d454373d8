//! The air at every UAV.

use crate::components::environment::Environment;
use crate::components::flight::{Air, Flight};
use crate::components::run::{Seed, SimClock};
use crate::models::air::shared_gusts::SharedNoise;
use bevy::prelude::*;

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
