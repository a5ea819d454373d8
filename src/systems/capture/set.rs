//! Cameras that operators set.

use crate::components::capture::{SensorCamera, StationCameras};
use crate::components::mount::Station;
use crate::components::operator::{Command, Operator};
use crate::components::run::SimClock;
use crate::parameters::capture::ordered;
use bevy::prelude::*;

/// Sets cameras as operators ordered in the last tick.
pub fn set_cameras(
    clock: Res<SimClock>,
    stations: Query<(&Station, &Operator, &StationCameras)>,
    mut cameras: Query<&mut SensorCamera>,
) {
    for (station, operator, own) in &stations {
        for command in &operator.due {
            let Command::Camera(order) = command else {
                continue;
            };
            let name = station.named(&order.name);
            let mut own = cameras.iter_many_mut(own.entities());
            while let Some(mut camera) = own.fetch_next() {
                if *camera.name == *name {
                    let frame_s = clock.at_s(camera.period_ticks);
                    camera.control = ordered(camera.control, order, frame_s);
                }
            }
        }
    }
}
