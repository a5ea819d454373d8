//! The station's mount: gimbal, mirror and the base they stand on.

use crate::components::environment::Environment;
use crate::components::mount::{MountCommand, Station, Stations};
use crate::components::run::{PartError, RunScenario, Seed, SetUp, SimClock, Tick, TickSet};
use crate::parameters::mount::mount;
use crate::plugins::run::fallible;
use crate::systems::mount as systems;
use bevy::prelude::*;

/// Adds the domain to both schedules, in [`TickSet::Mount`].
pub struct MountPlugin;

impl Plugin for MountPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(SetUp, fallible(set_up).in_set(TickSet::Mount))
            .add_systems(
                Tick,
                (systems::turn, systems::look)
                    .chain()
                    .in_set(TickSet::Mount),
            );
    }
}

/// Spawns the stations with their mounts.
fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    seed: Res<Seed>,
    clock: Res<SimClock>,
    environment: Res<Environment>,
) -> Result<(), PartError> {
    let mut stations = Stations::default();
    for (index, station) in loaded.scenario.stations().into_iter().enumerate() {
        let mount = mount(&loaded, &station, *seed, index as u64, *clock, &environment)?;
        let optics = mount.optics();
        let name = station.name;
        let spawned = commands.spawn((
            Station { index, name },
            mount,
            MountCommand::default(),
            optics,
        ));
        stations.0.push(spawned.id());
    }
    commands.insert_resource(stations);
    Ok(())
}
