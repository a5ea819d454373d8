//! The shutter: the cameras that are due expose, with their pose, rectangle and geometric truth.

use super::conditions;
use super::projected::projected;
use crate::components::capture::{
    AutoExposure, CameraOf, ExposedFrame, Exposures, Frames, PixelRect, Readout, SensorCamera,
};
use crate::components::detect::region_px;
use crate::components::environment::Environment;
use crate::components::flight::{Distractor, Flight, Uav, UavShape};
use crate::components::mount::{Boresight, CameraView};
use crate::components::run::SimClock;
use crate::models::ground::dsm::LineOfSight;
use bevy::ecs::query::QueryData;
use bevy::prelude::*;
use std::sync::Arc;

/// A camera as it exposes.
#[derive(QueryData)]
#[query_data(mutable)]
pub struct Exposing {
    entity: Entity,
    of: &'static CameraOf,
    camera: &'static SensorCamera,
    readout: &'static Readout,
    view: &'static CameraView,
    boresight: &'static Boresight,
    exposures: &'static mut Exposures,
    auto: &'static mut AutoExposure,
}

/// Opens the shutter of every camera that is due: pose, rectangle and geometric truth.
pub fn expose(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut cameras: Query<Exposing>,
    uavs: Query<(&Uav, &Flight, &UavShape, Has<Distractor>)>,
    mut frames: ResMut<Frames>,
) {
    frames.0.clear();
    for camera in &mut cameras {
        let ExposingItem {
            entity,
            of,
            camera,
            readout,
            view,
            boresight,
            mut exposures,
            mut auto,
        } = camera;
        let Some(rect) = read_out(camera, readout) else {
            continue;
        };
        if !clock.tick.is_multiple_of(camera.period_ticks) {
            continue;
        }
        let pose = view.pose;
        let mut truth: Vec<_> = uavs
            .iter()
            .filter_map(|(uav, flight, shape, distractor)| {
                let mut seen = projected(&camera.pinhole, &pose, flight, shape)?;
                let sight = environment.line_of_sight(pose.r_enu_m, flight.aim_enu_m());
                seen.uav = uav.index;
                seen.distractor = distractor;
                seen.clear = sight == LineOfSight::Clear;
                Some(seen)
            })
            .collect();
        truth.sort_by_key(|seen| seen.uav);
        let now = (clock.tick, clock.dt_s());
        let motion = conditions::image_motion(
            &camera.pinhole,
            &pose,
            view.q_before_enu_cam,
            now.1,
            &truth,
            |index| {
                let (_, flight, ..) = uavs.iter().find(|(uav, ..)| uav.index == index)?;
                Some((flight.aim_enu_m(), flight.state.v_enu_mps))
            },
        );
        let conditions =
            conditions::conditions(&mut auto, camera, &environment, &pose, now, motion);
        frames.0.push(Arc::new(ExposedFrame {
            camera: entity,
            station: of.0,
            index: camera.index,
            name: camera.name.clone(),
            tier: camera.tier,
            pinhole: camera.pinhole,
            tick: clock.tick,
            number: exposures.0,
            pose: view.pose,
            believed: view.believed,
            boresight: *boresight,
            rect,
            conditions,
            truth,
            rgb8: None,
        }));
        exposures.0 += 1;
    }
    // A plugin's own components may change the order in which queries meet the cameras.
    frames.0.sort_by_key(|frame| frame.index);
}

/// The pixels that a camera reads out; none while it idles.
fn read_out(camera: &SensorCamera, readout: &Readout) -> Option<PixelRect> {
    let sensor_px = [camera.pinhole.width_px, camera.pinhole.height_px];
    match (readout, camera.window_px) {
        (Readout::Off, _) => None,
        // What is too large for the window is read in full.
        (
            Readout::Around {
                centre_px,
                target_px,
            },
            Some(side),
        ) if region_px(*target_px, side) == side => {
            Some(PixelRect::window(sensor_px, *centre_px, side))
        }
        _ => Some(PixelRect {
            offset_px: [0, 0],
            size_px: sensor_px,
        }),
    }
}
