//! Site, city, weather and light; the air at every UAV.

use crate::components::run::{Options, PartError, RunScenario, Seed, SetUp, Tick, TickSet};
use crate::parameters::environment::{environment, placed};
use crate::plugins::run::fallible;
use crate::systems::environment as systems;
use bevy::prelude::*;
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
    mut loaded: ResMut<RunScenario>,
    options: Res<Options>,
    seed: Res<Seed>,
) -> Result<(), PartError> {
    // Baked shadows depend on the sun, and only pictures show them.
    let city = options.city.clone().filter(|_| !options.capture);
    let environment = environment(&loaded, city, seed.0)?;
    // What follows reads places as numbers.
    if let Some(placed) = placed(&loaded, &environment.site, &environment.city)? {
        loaded.0 = Arc::new(placed);
    }
    commands.insert_resource(environment);
    Ok(())
}
