//! Orders from their scenario.

use crate::components::operator::{Command, Designation};
use crate::scenario::{OrderConfig, Scenario};

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
