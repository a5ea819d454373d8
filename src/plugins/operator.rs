//! The operator's orders.

use crate::components::mount::Station;
use crate::components::operator::{Command, Designation, Operator, Order};
use crate::components::run::{RunScenario, SetUp, SimClock, Tick, TickSet};
use crate::components::track::TrackStage;
use crate::scenario::{OrderConfig, Scenario};
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
        let meant = (scenario.operator.iter()).filter(|order| order.is_for(&station.name));
        let orders = meant.map(|order| Order {
            tick: clock.ticks_of(order.t_s),
            command: command(order, scenario),
        });
        commands.entity(entity).insert(Operator {
            orders: orders.collect(),
            ..default()
        });
    }
}

/// What an order that a scenario checked commands.
pub fn command(order: &OrderConfig, scenario: &Scenario) -> Command {
    let index = |name: &String| scenario.flying().position(|known| known == name);
    match order {
        OrderConfig {
            fire: Some(may), ..
        } => Command::Fire(*may),
        OrderConfig {
            slew_deg: Some(az_el_deg),
            ..
        } => Command::Slew(*az_el_deg),
        OrderConfig {
            law: Some(name), ..
        } => Command::Law(name.clone()),
        OrderConfig {
            gains: Some(gains), ..
        } => Command::Gains(*gains),
        OrderConfig {
            weather: Some(weather),
            ..
        } => Command::Weather(*weather),
        OrderConfig {
            drive: Some(drive), ..
        } => Command::Drive(*drive),
        _ => Command::Target(
            match (order.designate.as_ref().and_then(index), order.track) {
                (Some(index), _) => Designation::Uav(index),
                (None, Some(id)) => Designation::Track(id),
                (None, None) => Designation::Release,
            },
        ),
    }
}
