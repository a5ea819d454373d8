//! Which part of a frame is rendered, by which views, and its rendering.

use super::digits::assign_digits;
use super::patches::{Patch, magnified};
use crate::components::capture::{ExposedFrame, PixelRect, SensorCamera};
use crate::components::render::{
    DIGIT_OF_TAG, SensorProjection, SensorViews, Solids, UavBody, UavRotor,
};
use crate::models::ground::skyline::Skyline;
use crate::models::optics::camera::Pinhole;
use crate::systems::render::renderer::{Renderer, aim_sensor_view};
use crate::systems::render::scene::{bevy_attitude, place_in_site, sync_scene};
use bevy::mesh::MeshTag;
use bevy::prelude::*;
use std::borrow::Borrow;

/// What renders one frame.
pub(crate) struct Shot {
    pub(crate) camera: SensorCamera,
    /// The view that renders the part with something solid in it, and that part; `None`: all is sky.
    pub(super) view: Option<(Entity, PixelRect)>,
    /// What is small in the frame, and the views that enlarge it.
    pub(crate) patches: Vec<(Patch, Entity)>,
}

impl Shot {
    /// The view of `views` that shows what is solid of `frame`, and what is to be enlarged in it.
    pub(crate) fn new(
        frame: &ExposedFrame,
        camera: SensorCamera,
        views: &SensorViews,
        solids: Option<&Solids>,
    ) -> Self {
        let solid = match solids {
            Some(Solids(skyline)) => solid_part(frame, &camera.pinhole, skyline),
            None => Some(frame.rect),
        };
        Self {
            view: solid.and_then(|solid| views.around(solid, frame.rect)),
            patches: (Patch::all(frame).into_iter())
                .zip(views.magnifiers.iter().copied())
                .collect(),
            camera,
        }
    }
}

impl Shot {
    /// One that a view of its own shows wholly, with nothing enlarged.
    pub(super) fn bare(camera: SensorCamera, view: Entity, rect: PixelRect) -> Self {
        Self {
            camera,
            view: Some((view, rect)),
            patches: Vec::new(),
        }
    }
}

/// The part of a frame outside of which there is only sky: what lies below the skyline, and the boxes of
/// all that flies.
fn solid_part(frame: &ExposedFrame, pinhole: &Pinhole, skyline: &Skyline) -> Option<PixelRect> {
    const MARGIN_PX: f64 = 2.0;
    let PixelRect { offset_px, size_px } = frame.rect;
    let pose = (frame.pose.r_enu_m, frame.pose.q_enu_cam);
    let row = skyline.first_row(pinhole, pose, frame.rect);
    // Corners in the rectangle: lower and upper end.
    let ground = (row < size_px[1]).then_some([[0, row], size_px]);
    let flying = frame.truth.iter().filter_map(|seen| {
        let [x0, y0, x1, y1] = seen.box_px;
        let part = |i: usize, low: f64, high: f64| {
            let local = |x: f64| (x - f64::from(offset_px[i])).clamp(0.0, f64::from(size_px[i]));
            let [low, high] = [
                local(low - MARGIN_PX).floor(),
                local(high + MARGIN_PX).ceil(),
            ];
            (low < high).then_some([low as u32, high as u32])
        };
        let ([left, right], [top, bottom]) = (part(0, x0, x1)?, part(1, y0, y1)?);
        Some([[left, top], [right, bottom]])
    });
    let union = flying.chain(ground).reduce(|a, b| {
        let pick = |k: usize, of: fn(u32, u32) -> u32| [0, 1].map(|i| of(a[k][i], b[k][i]));
        [pick(0, u32::min), pick(1, u32::max)]
    });
    union.map(|[low, high]| PixelRect {
        offset_px: [0, 1].map(|i| offset_px[i] + low[i]),
        size_px: [0, 1].map(|i| high[i] - low[i]),
    })
}

/// The projection that renders a rectangle of a sensor.
fn projection(pinhole: &Pinhole, rect: PixelRect) -> SensorProjection {
    SensorProjection {
        focal_px: pinhole.focal_px,
        sensor_px: [pinhole.width_px, pinhole.height_px],
        offset_px: rect.offset_px,
        size_px: rect.size_px,
    }
}

/// Renders `frames` as `shots` say; the digits by which the UAVs are told apart, by their index.
pub(crate) fn draw(
    world: &mut World,
    renderer: &mut Renderer,
    frames: &[impl Borrow<ExposedFrame>],
    shots: &[Shot],
) -> Vec<u32> {
    sync_scene(world);
    let digits = assign_digits(frames);
    let mut tagged = world.query::<(AnyOf<(&UavBody, &UavRotor)>, &mut MeshTag)>();
    for ((body, rotor), mut tag) in tagged.iter_mut(world) {
        let uav = body.map(|b| b.0).or(rotor.map(|r| r.uav));
        let digit = uav.and_then(|uav| digits.get(uav)).copied().unwrap_or(0);
        let digit = tag.0 & !DIGIT_OF_TAG | digit;
        tag.set_if_neq(MeshTag(digit));
    }
    for (frame, shot) in frames.iter().map(Borrow::borrow).zip(shots) {
        let pinhole = &shot.camera.pinhole;
        let smeared_s = shot.camera.sensor.smeared_s(&frame.conditions.exposure);
        let at = place_in_site(frame.pose.r_enu_m, bevy_attitude(frame.pose.q_enu_cam));
        if let Some((view, rect)) = shot.view {
            aim_sensor_view(world, view, projection(pinhole, rect), at, smeared_s);
        }
        for (patch, magnifier) in &shot.patches {
            let projection = projection(&magnified(pinhole), patch.magnified_rect());
            aim_sensor_view(world, *magnifier, projection, at, smeared_s);
        }
    }
    let active = |shot: &Shot| {
        let magnifiers = shot.patches.iter().map(|(_, view)| *view);
        let view = shot.view.map(|(view, _)| view);
        view.into_iter().chain(magnifiers).collect::<Vec<_>>()
    };
    if shots.iter().flat_map(active).next().is_some() {
        renderer.render(world);
    }
    for view in shots.iter().flat_map(active) {
        if let Some(mut view) = world.get_mut::<Camera>(view) {
            view.is_active = false;
        }
    }
    digits
}
