//! The operator's orders.

use crate::components::mount::Station;
use crate::components::operator::{Operator, Order};
use crate::components::run::{RunScenario, SetUp, SimClock, Tick, TickSet};
use crate::components::track::TrackStage;
use crate::parameters::operator::command;
use crate::systems::operator as systems;
use crate::systems::run::nothing_failed;
use bevy::prelude::*;

/// Adds the domain to the set-up, and to the ticks in [`TrackStage::Obey`].
pub struct OperatorPlugin;

impl Plugin for OperatorPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(SetUp, set_up.run_if(nothing_failed).in_set(TickSet::Track))
            .add_systems(Tick, systems::obey.in_set(TrackStage::Obey));
    }
}

fn set_up(
    mut commands: Commands,
    loaded: Res<RunScenario>,
    clock: Res<SimClock>,
    stations: Query<(Entity, &Station)>,
) {
    let scenario = &loaded.scenario;
    for (entity, station) in &stations {
        let meant = scenario
            .operator
            .iter()
            .map(|order| (order, command(order, scenario)));
        let meant = meant.filter(|(order, command)| station.obeys(order, command));
        let orders = meant.map(|(order, command)| Order {
            tick: clock.ticks_of(order.t_s),
            command,
        });
        commands.entity(entity).insert(Operator {
            orders: orders.collect(),
            ..default()
        });
    }
}
