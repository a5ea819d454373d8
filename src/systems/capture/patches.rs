//! Patches: the surroundings of what is small, rendered enlarged and averaged into the frame.

use super::digits::{alpha_at, shows};
use crate::components::capture::{ExposedFrame, PixelRect, UavInFrame};
use crate::models::optics::background::open_share;
use crate::models::optics::camera::Pinhole;
use crate::systems::render::renderer::spawn_sensor_view;
use bevy::prelude::*;

/// The surroundings of something that flies and is too small for four samples a pixel: an airframe of three pixels is
/// all thin arms and legs, and its centroid would be off by a third of a pixel. They are rendered
/// [`MAGNIFY`] times enlarged and, where they show it, averaged into the frame. Birds as well as UAVs: no sort of thing must
/// be told by the renderer's samples.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patch {
    /// Scenario index of what is small.
    pub(crate) uav: usize,
    /// Where the patch lies on the sensor.
    pub(crate) rect: PixelRect,
}

/// Enlargement of a patch.
pub const MAGNIFY: u32 = 8;
/// Samples of an enlarged pixel.
pub const MAGNIFIED_SAMPLES: u32 = 4;
/// Side of a patch [px].
pub const PATCH_PX: u32 = 16;
/// Most patches of a frame: what is small beyond them has four samples a pixel.
pub const PATCHES: usize = 7;
/// What has a box smaller than this gets a patch [px]: the patch holds the box with a margin.
const SMALL_PX: f64 = 8.0;

/// A patch's camera: the same sensor with [`MAGNIFY`] times the pixels.
pub fn magnified(pinhole: &Pinhole) -> Pinhole {
    Pinhole {
        width_px: MAGNIFY * pinhole.width_px,
        height_px: MAGNIFY * pinhole.height_px,
        focal_px: f64::from(MAGNIFY) * pinhole.focal_px,
    }
}

impl Patch {
    /// A patch about everything that is small in a frame, UAVs first, the nearest before others.
    pub(super) fn all(frame: &ExposedFrame) -> Vec<Self> {
        let small = |seen: &&UavInFrame| {
            let [x0, y0, x1, y1] = seen.box_px;
            (x1 - x0).max(y1 - y0) < SMALL_PX
        };
        let mut small: Vec<_> = frame.truth.iter().filter(small).collect();
        small.sort_by(|a, b| {
            let order = a.distractor.cmp(&b.distractor);
            order.then(a.range_m.total_cmp(&b.range_m))
        });
        (small.into_iter())
            .filter_map(|seen| Self::about(frame, seen))
            .collect()
    }

    fn about(frame: &ExposedFrame, nearest: &UavInFrame) -> Option<Self> {
        let [x0, y0, x1, y1] = nearest.box_px;
        let centre = [0.5 * (x0 + x1), 0.5 * (y0 + y1)];
        let mut offset_px = [0; 2];
        for i in 0..2 {
            let low = f64::from(frame.rect.offset_px[i]);
            let high = low + f64::from(frame.rect.size_px[i]) - f64::from(PATCH_PX);
            let at = (centre[i] - 0.5 * f64::from(PATCH_PX)).round();
            if high < low || at < low || at > high {
                return None;
            }
            offset_px[i] = at as u32;
        }
        Some(Self {
            uav: nearest.uav,
            rect: PixelRect {
                offset_px,
                size_px: [PATCH_PX; 2],
            },
        })
    }

    /// The patch on the magnified sensor.
    pub(super) fn magnified_rect(&self) -> PixelRect {
        PixelRect {
            offset_px: self.rect.offset_px.map(|x| MAGNIFY * x),
            size_px: [MAGNIFY * PATCH_PX; 2],
        }
    }

    /// Averages the enlarged pixels into those of the frame that show the UAV of identity `digit`, and adds the `sky` that the
    /// frame has there; identities stay as they are, and so does all around it: scenery sampled more finely than the rest
    /// would tell where the UAV is.
    pub(super) fn blend(
        &self,
        enlarged: &[u8],
        sky: &[u8],
        digit: u32,
        into: (PixelRect, u32),
        out: &mut [u8],
    ) {
        let (frame, samples) = into;
        let side = (MAGNIFY * PATCH_PX) as usize;
        let value = |bytes: &[u8]| half::f16::from_le_bytes([bytes[0], bytes[1]]).to_f32();
        let [column, row] = [0, 1].map(|i| (self.rect.offset_px[i] - frame.offset_px[i]) as usize);
        let width = frame.size_px[0] as usize;
        for y in 0..PATCH_PX as usize {
            for x in 0..PATCH_PX as usize {
                let (mut rgb, mut open) = ([0.0; 3], 0.0);
                let at = (row + y) * width + column + x;
                let mut shown = shows(alpha_at(out, at), samples, digit);
                for row in y * MAGNIFY as usize..(y + 1) * MAGNIFY as usize {
                    let first = 8 * (row * side + x * MAGNIFY as usize);
                    for pixel in enlarged[first..first + 8 * MAGNIFY as usize].chunks_exact(8) {
                        for (channel, sum) in rgb.iter_mut().enumerate() {
                            *sum += value(&pixel[2 * channel..]);
                        }
                        let alpha = value(&pixel[6..]);
                        open += open_share(alpha, MAGNIFIED_SAMPLES);
                        shown |= shows(alpha.into(), MAGNIFIED_SAMPLES, digit);
                    }
                }
                if !shown {
                    continue;
                }
                let sky = &sky[8 * (y * PATCH_PX as usize + x)..];
                for (channel, sum) in rgb.iter().enumerate() {
                    let sum = sum + open * value(&sky[2 * channel..]);
                    let mean = half::f16::from_f32(sum / (MAGNIFY * MAGNIFY) as f32);
                    let at = 8 * at + 2 * channel;
                    out[at..at + 2].copy_from_slice(&mean.to_le_bytes());
                }
            }
        }
    }
}

/// Spawns the cameras that enlarge what is small in a sensor's frames.
pub fn spawn_magnifiers(world: &mut World, site_grid: Entity) -> Vec<Entity> {
    let size_px = [MAGNIFY * PATCH_PX; 2];
    let view = |_| spawn_sensor_view(world, site_grid, size_px, MAGNIFIED_SAMPLES);
    (0..PATCHES).map(view).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_around_an_enlarged_uav_stays_as_it_is() {
        let rgba = |rgb: f32, alpha: f32| {
            [rgb, rgb, rgb, alpha].map(|value| half::f16::from_f32(value).to_le_bytes())
        };
        let rect = |offset_px, size_px| PixelRect { offset_px, size_px };
        let frame = rect([8, 4], [32, 24]);
        let patch = Patch {
            uav: 0,
            rect: rect([16, 9], [PATCH_PX; 2]),
        };
        let mut pixels = rgba(0.625, 0.0).as_flattened().repeat(32 * 24);
        let sky = rgba(0.75, 0.0).as_flattened().repeat(256);
        // Scenery everywhere but in one pixel: there the UAV fills the left half, and the right is open.
        let [column, row] = [3, 5];
        let side = MAGNIFY * PATCH_PX;
        let mut enlarged = Vec::new();
        for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
            let pixel = match (x / MAGNIFY == column && y / MAGNIFY == row, x % MAGNIFY < 4) {
                (false, _) => rgba(0.125, 1.0),
                (true, true) => rgba(0.25, 26.0),
                (true, false) => rgba(0.0, 0.0),
            };
            enlarged.extend(pixel.as_flattened());
        }
        patch.blend(&enlarged, &sky, 2, (frame, 4), &mut pixels);
        let at = ((9 - 4 + row) * 32 + 16 - 8 + column) as usize;
        for (index, pixel) in pixels.chunks_exact(8).enumerate() {
            let expected = rgba(
                if index == at {
                    0.5 * (0.25 + 0.75)
                } else {
                    0.625
                },
                0.0,
            );
            assert_eq!(pixel, expected.as_flattened(), "{index}");
        }
    }
}
