//! Image formation: the sensor's picture of rendered pixels, strip by strip.

use super::patches::PATCHES;
use crate::components::capture::ExposedFrame;
use crate::models::optics::seeing::{Picture, WarpScratch};
use crate::models::optics::sensor::{self, Scratch};
use crate::systems::render::renderer::RenderError;
use bevy::tasks::ComputeTaskPool;

/// Why an exposed frame has no picture.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The frame could not be read back.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The sensor model refused the frame.
    #[error(transparent)]
    Sensor(#[from] sensor::SensorError),
}

/// What frames are warped in.
#[derive(Debug, Default)]
pub(super) struct SeeingScratch {
    pub(super) picture: Picture,
    pub(super) strips: [WarpScratch; STRIPS],
}

/// What image formation keeps between frames.
#[derive(Default)]
pub struct ImageScratch {
    /// The frame: rows of half-float RGBA.
    pub(crate) pixels: Vec<u8>,
    /// The part of it that was rendered.
    pub(super) part: Vec<u8>,
    /// Its enlarged patches.
    pub(crate) enlarged: [Vec<u8>; PATCHES],
    /// What the air before the lens is worked out in.
    pub(super) air: SeeingScratch,
    /// Scratch of each strip of rows.
    strips: [Scratch; STRIPS],
}

/// Strips of rows that are exposed side by side; the noise does not depend on their number.
pub(super) const STRIPS: usize = 4;

/// The sensor's 8-bit picture of a rendered frame.
pub(crate) fn form_image(
    frame: &ExposedFrame,
    sensor: &sensor::Sensor,
    key: u64,
    scratch: &mut ImageScratch,
) -> Result<Vec<u8>, sensor::SensorError> {
    let [width, height] = frame.rect.size_px.map(|n| n as usize);
    let mut rgb8 = vec![0; 3 * width * height];
    let rendered = sensor::RenderedFrame {
        rgba16f: &scratch.pixels,
        width,
        height,
        origin_px: frame.rect.offset_px,
        conditions: &frame.conditions,
    };
    let strip = height.div_ceil(STRIPS);
    let results = ComputeTaskPool::get().scope(|scope| {
        let parts = rgb8.chunks_mut(3 * width * strip).zip(&mut scratch.strips);
        for (i, (part, scratch)) in parts.enumerate() {
            let rows = i * strip..height.min((i + 1) * strip);
            scope.spawn(async move { sensor.expose(&rendered, rows, key, scratch, part) });
        }
    });
    results.into_iter().collect::<Result<(), _>>()?;
    Ok(rgb8)
}
