//! Orders from their scenario.

use crate::components::operator::{Command, Designation};
use crate::models::flight::guided::Goal;
use crate::models::flight::multirotor::MAX_ROTORS;
use crate::scenario::{FlyOrder, OrderConfig, Scenario};
use glam::DVec3;

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
        OrderConfig {
            camera: Some(camera),
            ..
        } => Command::Camera(camera.clone()),
        OrderConfig { fly: Some(fly), .. } => Command::Fly(fly.clone()),
        _ => Command::Target(
            match (order.designate.as_ref().and_then(index), order.track) {
                (Some(index), _) => Designation::Uav(index),
                (None, Some(id)) => Designation::Track(id),
                (None, None) => Designation::Release,
            },
        ),
    }
}

/// What a UAV with so many rotors is told by an order that a scenario checked, or why it cannot be told that.
pub fn goal(order: &FlyOrder, rotor_count: usize) -> Result<Goal, String> {
    if let Some(rotors) = &order.rotors {
        if rotors.len() != rotor_count {
            let given = rotors.len();
            return Err(format!(
                "it has {rotor_count} rotors, the order {given}: give one number for each"
            ));
        }
        let mut throttle = [0.0; MAX_ROTORS];
        throttle
            .iter_mut()
            .zip(rotors)
            .for_each(|(own, share)| *own = *share);
        return Ok(Goal::Rotors(throttle));
    }
    if order.land {
        return Ok(Goal::Land);
    }
    Ok(match order.velocity_enu_mps {
        Some(v_enu_mps) => Goal::Velocity(v_enu_mps.into()),
        None => Goal::Path(
            order.path_enu_m.iter().copied().map(DVec3::from).collect(),
            order.speed_mps.unwrap_or(FlyOrder::SPEED_MPS),
        ),
    })
}
