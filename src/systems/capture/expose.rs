//! The shutter: the cameras that are due expose, with their pose, rectangle and geometric truth.

use super::conditions;
use super::projected::projected;
use super::seeing;
use super::stray::{Lit, Sources};
use crate::components::capture::{
    AutoExposure, CameraOf, ExposedFrame, Exposures, Frames, PixelRect, Readout, SensorCamera,
    StrayOptics,
};
use crate::components::detect::region_px;
use crate::components::environment::Environment;
use crate::components::flight::{Distractor, Flight, Uav, UavShape};
use crate::components::mount::{Boresight, CameraView};
use crate::components::run::SimClock;
use crate::models::ground::dsm::LineOfSight;
use bevy::ecs::query::QueryData;
use bevy::ecs::system::SystemState;
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
    stray: &'static StrayOptics,
}

/// What flies, as cameras see it.
type Flying<'w, 's> = Query<
    'w,
    's,
    (
        &'static Uav,
        &'static Flight,
        &'static UavShape,
        Has<Distractor>,
    ),
>;

/// A camera whose shutter opens.
struct Shutter<'a> {
    entity: Entity,
    station: Entity,
    camera: &'a SensorCamera,
    view: &'a CameraView,
    boresight: &'a Boresight,
    stray: &'a StrayOptics,
    /// Exposures before.
    number: u64,
    rect: PixelRect,
}

/// Opens the shutter of every camera that is due: pose, rectangle and geometric truth.
pub fn expose(
    clock: Res<SimClock>,
    environment: Res<Environment>,
    mut cameras: Query<Exposing>,
    uavs: Flying,
    sources: Sources,
    mut frames: ResMut<Frames>,
) {
    frames.0.clear();
    let mut lit = None;
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
            stray,
        } = camera;
        let Some(rect) = read_out(camera, readout) else {
            continue;
        };
        if !clock.tick.is_multiple_of(camera.period_ticks) {
            continue;
        }
        let lit = lit.get_or_insert_with(|| sources.lit(&clock, &environment));
        if lit.blanks(of.0, stray) {
            continue;
        }
        let shutter = Shutter {
            entity,
            station: of.0,
            camera,
            view,
            boresight,
            stray,
            number: exposures.0,
            rect,
        };
        let frame = shutter.open(&clock, &environment, &mut auto, &uavs, lit);
        frames.0.push(Arc::new(frame));
        exposures.0 += 1;
    }
    // A plugin's own components may change the order in which queries meet the cameras.
    frames.0.sort_by_key(|frame| frame.index);
}

/// What a camera would expose now if it were due and read all of its sensor. Nothing of the run changes.
pub(super) fn would_expose(world: &mut World, camera: Entity) -> Option<ExposedFrame> {
    let mut parts = SystemState::<(
        Res<SimClock>,
        Res<Environment>,
        Query<Exposing>,
        Flying,
        Sources,
    )>::new(world);
    let (clock, environment, cameras, uavs, sources) = parts.get_mut(world).ok()?;
    let cameras = cameras.as_readonly();
    let exposing = cameras.get(camera).ok()?;
    let shutter = Shutter {
        entity: camera,
        station: exposing.of.0,
        camera: exposing.camera,
        view: exposing.view,
        boresight: exposing.boresight,
        stray: exposing.stray,
        number: exposing.exposures.0,
        rect: whole(exposing.camera),
    };
    let mut auto = *exposing.auto;
    let lit = sources.lit(&clock, &environment);
    Some(shutter.open(&clock, &environment, &mut auto, &uavs, &lit))
}

impl Shutter<'_> {
    fn open(
        self,
        clock: &SimClock,
        environment: &Environment,
        auto: &mut AutoExposure,
        uavs: &Flying,
        lit: &Lit,
    ) -> ExposedFrame {
        let Self { camera, view, .. } = self;
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
        let flying = |index| {
            let (_, flight, ..) = uavs.iter().find(|(uav, ..)| uav.index == index)?;
            Some((flight.aim_enu_m(), flight.state.v_enu_mps))
        };
        let motion = conditions::image_motion(
            &camera.pinhole,
            &pose,
            view.q_before_enu_cam,
            now.1,
            &truth,
            flying,
        );
        let stray = lit.seen(self.station, (camera, self.stray), environment, &pose);
        let light = (motion, stray);
        let conditions = conditions::conditions(auto, camera, environment, &pose, now, light);
        let times_s = [clock.t_s(), conditions.exposure.time_s];
        let seeing = seeing::of_frame(environment, camera, &pose, times_s, &truth, flying);
        ExposedFrame {
            camera: self.entity,
            station: self.station,
            index: camera.index,
            name: camera.name.clone(),
            tier: camera.tier,
            pinhole: camera.pinhole,
            tick: clock.tick,
            number: self.number,
            pose: view.pose,
            believed: view.believed,
            boresight: *self.boresight,
            rect: self.rect,
            conditions,
            truth,
            seeing,
            rgb8: None,
        }
    }
}

/// All of a camera's sensor.
fn whole(camera: &SensorCamera) -> PixelRect {
    PixelRect {
        offset_px: [0, 0],
        size_px: [camera.pinhole.width_px, camera.pinhole.height_px],
    }
}

/// The pixels that a camera reads out; none while it idles.
fn read_out(camera: &SensorCamera, readout: &Readout) -> Option<PixelRect> {
    let whole = whole(camera);
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
            Some(PixelRect::window(whole.size_px, *centre_px, side))
        }
        _ => Some(whole),
    }
}
