//! The sky behind what is solid, added to the rendered pixels.

use super::image::STRIPS;
use crate::components::capture::{ExposedFrame, PixelRect};
use crate::components::environment::Environment;
use crate::models::optics::background::Background;
use crate::models::optics::camera::Pinhole;
use bevy::prelude::*;
use bevy::tasks::ComputeTaskPool;

/// The sky behind a rectangle of a sensor, seen with so many samples a pixel.
pub(super) fn background<'a>(
    world: &'a World,
    frame: &ExposedFrame,
    (pinhole, rect, samples): (Pinhole, PixelRect, u32),
) -> Background<'a> {
    Background {
        backdrop: &world.resource::<Environment>().backdrop,
        pinhole,
        q_enu_cam: frame.pose.q_enu_cam,
        rect,
        samples,
    }
}

/// Adds the sky to the rendered rectangle of a sensor.
pub(super) fn add_sky(
    world: &World,
    frame: &ExposedFrame,
    view: (Pinhole, PixelRect, u32),
    pixels: &mut [u8],
) {
    let background = background(world, frame, view);
    let [width, height] = view.1.size_px.map(|n| n as usize);
    let strip = height.div_ceil(STRIPS);
    ComputeTaskPool::get().scope(|scope| {
        for (i, rows) in pixels.chunks_mut(8 * width * strip).enumerate() {
            scope.spawn(async move { background.fill(i * strip, rows) });
        }
    });
}
