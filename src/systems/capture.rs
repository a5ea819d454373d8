//! Cameras that are due expose: truth, picture and pose of one tick.

pub mod conditions;
mod digits;
mod expose;
mod image;
pub mod metering;
mod patches;
mod photo;
mod projected;
mod read;
pub(crate) mod seeing;
mod set;
mod shot;
mod sky;
mod stray;

pub use digits::DIGITS;
pub(crate) use digits::{alpha_at, digit_of};
pub use expose::{Exposing, expose};
pub(crate) use image::form_image;
pub use image::{CaptureError, ImageScratch};
pub use patches::{MAGNIFIED_SAMPLES, MAGNIFY, PATCH_PX, PATCHES, magnified, spawn_magnifiers};
pub use photo::{measure_depth, photograph};
pub use projected::projected;
pub(crate) use read::read;
pub use set::set_cameras;
pub(crate) use shot::{Shot, draw};
pub use stray::pause_lasers;

use crate::components::capture::{ExposedFrame, Frames, SensorCamera};
use crate::components::render::SensorViews;
use crate::components::run::{Failure, Kept, Options, Seed, Stopwatch};
use crate::systems::render::city_tiles::settle_city;
use crate::systems::render::renderer::Renderer;
use bevy::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// Renders the exposed frames, if this run renders at all.
pub fn render_frames(world: &mut World) {
    let idle = world.resource::<Frames>().0.is_empty() || world.resource::<Options>().on_demand;
    if idle || !world.contains_resource::<Kept<Renderer>>() {
        return;
    }
    let started = Instant::now();
    if let Some(mut renderer) = Kept::<Renderer>::take(world) {
        let mut scratch = Kept::<ImageScratch>::take(world).unwrap_or_default();
        let result = render_with(world, &mut renderer, &mut scratch);
        Kept::put(world, scratch);
        Kept::put(world, renderer);
        if let Err(error) = result {
            world.resource_mut::<Failure>().set(error);
        }
    }
    world.resource_mut::<Stopwatch>().render += started.elapsed();
}

fn render_with(
    world: &mut World,
    renderer: &mut Renderer,
    scratch: &mut ImageScratch,
) -> Result<(), CaptureError> {
    let mut frames = std::mem::take(&mut world.resource_mut::<Frames>().0);
    let rendered = render_each(world, renderer, scratch, &mut frames);
    world.resource_mut::<Frames>().0 = frames;
    rendered
}

/// Renders frames that were exposed in this tick, and fills in what their pictures tell.
fn render_each(
    world: &mut World,
    renderer: &mut Renderer,
    scratch: &mut ImageScratch,
    frames: &mut [Arc<ExposedFrame>],
) -> Result<(), CaptureError> {
    settle_city(world);
    let mut cameras = world.query::<(&SensorCamera, &SensorViews)>();
    let shots: Vec<_> = frames
        .iter()
        .filter_map(|frame| {
            let (camera, views) = cameras.get(world, frame.camera).ok()?;
            let solids = world.get(frame.station);
            Some(Shot::new(frame, camera.clone(), views, solids))
        })
        .collect();
    let digits = draw(world, renderer, frames, &shots);
    let seed = *world.resource::<Seed>();
    for (frame, shot) in frames.iter_mut().zip(&shots) {
        // Nobody else holds a frame before the tick goes on: nothing is copied.
        let frame = Arc::make_mut(frame);
        read(world, renderer, frame, shot, &digits, scratch)?;
        seeing::disturb(world, frame, scratch);
        let key = seed.stream(frame.tick, &frame.name).bits();
        let rgb8 = form_image(frame, &shot.camera.sensor, key, scratch)?;
        frame.rgb8 = Some(Arc::new(rgb8));
    }
    Ok(())
}
