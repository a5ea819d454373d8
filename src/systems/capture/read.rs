//! A rendered frame read back: its pixels, with sky and patches, and the truth that they tell.

use super::digits::{alpha_at, digit_of};
use super::image::{CaptureError, ImageScratch};
use super::patches::{MAGNIFIED_SAMPLES, MAGNIFY, PATCH_PX, Patch, magnified};
use super::shot::Shot;
use super::sky::{add_sky, background};
use crate::components::capture::{ExposedFrame, PixelRect, RenderedTruth, SensorCamera};
use crate::components::flight::{Flight, Uav, UavShape};
use crate::models::bodies::Rotors;
use crate::models::bodies::raster::{self, Coverage};
use crate::systems::render::renderer::Renderer;
use bevy::prelude::*;

/// Reads a frame that [`draw`] rendered: its truth, and its pixels into `scratch`.
pub(crate) fn read(
    world: &mut World,
    renderer: &mut Renderer,
    frame: &mut ExposedFrame,
    shot: &Shot,
    digits: &[u32],
    scratch: &mut ImageScratch,
) -> Result<(), CaptureError> {
    let camera = &shot.camera;
    let (pinhole, rect) = (camera.pinhole, frame.rect);
    scratch.pixels.clear();
    scratch
        .pixels
        .resize(8 * (rect.size_px[0] * rect.size_px[1]) as usize, 0);
    if let Some((view, part)) = shot.view {
        renderer.read(view, part.size_px, &mut scratch.part)?;
        paste(&scratch.part, part, rect, &mut scratch.pixels);
    }
    let samples = camera.antialias;
    add_sky(world, frame, (pinhole, rect, samples), &mut scratch.pixels);
    count_identities(world, frame, camera, digits, &scratch.pixels, None);
    let patches = shot.patches.iter().zip(&mut scratch.enlarged);
    for ((patch, magnifier), enlarged) in patches {
        renderer.read(*magnifier, patch.magnified_rect().size_px, enlarged)?;
        count_identities(world, frame, camera, digits, enlarged, Some(patch));
        let mut sky = vec![0; 8 * (PATCH_PX * PATCH_PX) as usize];
        background(world, frame, (pinhole, patch.rect, samples)).fill(0, &mut sky);
        let (digit, into) = (digits[patch.uav], (rect, samples));
        patch.blend(enlarged, &sky, digit, into, &mut scratch.pixels);
    }
    Ok(())
}

/// Puts the pixels of a part of a frame at their place.
fn paste(pixels: &[u8], part: PixelRect, frame: PixelRect, out: &mut [u8]) {
    let [left, top] = [0, 1].map(|i| (part.offset_px[i] - frame.offset_px[i]) as usize);
    let length = 8 * part.size_px[0] as usize;
    let rows = out
        .chunks_exact_mut(8 * frame.size_px[0] as usize)
        .skip(top);
    for (row, line) in rows.zip(pixels.chunks_exact(length)) {
        row[8 * left..8 * left + length].copy_from_slice(line);
    }
}

/// Fills in the truth that the identity samples of a rendered frame, or of a patch of it, tell.
fn count_identities(
    world: &mut World,
    frame: &mut ExposedFrame,
    camera: &SensorCamera,
    digits: &[u32],
    pixels: &[u8],
    patch: Option<&Patch>,
) {
    let (pinhole, rect, scale, antialias) = match patch {
        None => (camera.pinhole, frame.rect, 1.0, camera.antialias),
        Some(patch) => {
            let (pinhole, rect) = (magnified(&camera.pinhole), patch.magnified_rect());
            (pinhole, rect, f64::from(MAGNIFY), MAGNIFIED_SAMPLES)
        }
    };
    let mut uavs = world.query::<(&Uav, &Flight, &UavShape)>();
    let samples = f64::from(antialias);
    let [width, height] = rect.size_px;
    let [left, top] = rect.offset_px;
    for seen in &mut frame.truth {
        if patch.is_some_and(|patch| patch.uav != seen.uav) {
            continue;
        }
        let Some((_, flight, shape)) = uavs.iter(world).find(|(uav, ..)| uav.index == seen.uav)
        else {
            continue;
        };
        let mut visible = Coverage::default();
        // Every sample of the UAV lies in the box of its projection, a pixel more for rounding.
        let [x0, y0, x1, y1] = seen.box_px.map(|px| scale * px);
        let clip = |low: f64, high: f64, offset: u32, size: u32| {
            let local = |x: f64| (x - f64::from(offset)).clamp(0.0, f64::from(size)) as u32;
            local(low.floor() - 1.0)..local(high.ceil() + 1.0)
        };
        for y in clip(y0, y1, top, height) {
            for x in clip(x0, x1, left, width) {
                let alpha = alpha_at(pixels, (y * width + x) as usize);
                let count = digit_of((alpha * samples).round() as u32, digits[seen.uav]);
                visible.add(left + x, top + y, f64::from(count));
            }
        }
        let state = &flight.state;
        let whole = raster::sampled_silhouette(
            &pinhole,
            &frame.pose,
            (state.r_enu_m, state.q_enu_body),
            Rotors::of(state, camera.sensor.smeared_s(&frame.conditions.exposure)),
            &shape.mesh,
            rect,
            antialias,
        )
        .coverage();
        seen.rendered = Some(RenderedTruth {
            box_px: visible.box_px().map(|px| px.map(|x| x / scale)),
            centroid_px: visible.centroid_px().map(|px| px.map(|x| x / scale)),
            visible_fraction: if whole.samples > 0.0 {
                (visible.samples / whole.samples).min(1.0)
            } else {
                0.0
            },
        });
    }
}
