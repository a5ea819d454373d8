//! The orders of a run, as a scenario.

use crate::components::mount::{Station, Stations};
use crate::components::operator::{Command, Designation, Operator};
use crate::components::run::{Options, SimClock};
use crate::place::located;
use crate::scenario::{Loaded, OrderConfig};
use bevy::prelude::World;
use std::path::Path;

/// The scenario as it was run, with the orders that were given meanwhile.
pub(crate) fn with_orders(
    world: &World,
    loaded: &Loaded,
    options: &Options,
) -> Result<String, toml::ser::Error> {
    let clock = world.resource::<SimClock>();
    let mut scenario = loaded.scenario.clone();
    scenario.seed = options.seed.unwrap_or(scenario.seed);
    let stations = &world.resource::<Stations>().0;
    let mut orders = Vec::new();
    for station in stations {
        let (Some(operator), Some(own)) = (
            world.get::<Operator>(*station),
            world.get::<Station>(*station),
        ) else {
            continue;
        };
        orders.extend(operator.orders.iter().map(|order| {
            let mut config = OrderConfig {
                t_s: clock.at_s(order.tick),
                // Of one station an order need not say whose it is.
                station: (stations.len() > 1).then(|| own.name.clone()),
                ..OrderConfig::default()
            };
            match &order.command {
                Command::Target(Designation::Uav(index)) => {
                    config.designate = loaded.scenario.flying().nth(*index).map(String::from);
                }
                Command::Target(Designation::Track(id)) => config.track = Some(*id),
                Command::Target(Designation::Release) => {}
                Command::Fire(may) => config.fire = Some(*may),
                Command::Slew(az_el_deg) => config.slew_deg = Some(*az_el_deg),
                Command::Law(name) => config.law = Some(name.clone()),
                Command::Gains(gains) => config.gains = Some(*gains),
                Command::Weather(weather) => config.weather = Some(*weather),
                Command::Drive(drive) => config.drive = Some(*drive),
                Command::Camera(camera) => config.camera = Some(camera.clone()),
                Command::Fly(fly) => config.fly = Some(fly.clone()),
            }
            config
        }));
    }
    orders.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    scenario.operator = orders;
    // What the scenario names is found from wherever the file will lie.
    let folder = loaded.path.parent().unwrap_or(Path::new("."));
    let folder = folder.canonicalize().unwrap_or(folder.to_owned());
    for path in scenario.paths_mut() {
        *path = located(&folder, path);
    }
    toml::to_string(&scenario)
}
