//! The ground's picture and the table of the sky, as the GPU takes them.

use crate::models::air::backdrop::Backdrop;
use crate::models::ground::city::GroundMap;
use bevy::asset::RenderAssetUsages;
use bevy::image::{Image, ImageAddressMode};
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};
use boresight_tiles::picture::{picture_texture, sampler};
use glam::{DVec2, DVec3};

/// The texture of the generated city's ground.
pub fn ground_texture(map: &GroundMap) -> Image {
    let rgba: Vec<u8> = (map.rgb.iter())
        .flat_map(|[r, g, b]| [*r, *g, *b, 255])
        .collect();
    picture_texture([map.size_px as u32; 2], &rgba, false, None)
}

/// The direction of a point of the sky table, its square being -1..1 in both axes: the upper half
/// of an octahedron, turned by 45 deg so that it fills the square.
fn sky_direction(u: f64, v: f64) -> DVec3 {
    let flat = 0.5 * DVec2::new(u - v, u + v);
    flat.extend(1.0 - flat.x.abs() - flat.y.abs()).normalize()
}

/// The sky's luminance with its clouds as a float texture of `side` texels each way; alpha: what clouds
/// leave of the sun's disc.
pub fn sky_texture(backdrop: &Backdrop, side: u32) -> Image {
    let half = |x: f64| half::f16::from_f64(x.min(65_000.0)).to_le_bytes();
    let at = |i: u32| (2.0 * f64::from(i) + 1.0) / f64::from(side) - 1.0;
    let bytes = (0..side)
        .flat_map(|j| (0..side).map(move |i| sky_direction(at(i), at(j))))
        .flat_map(|dir| {
            let detail_rad = std::f64::consts::PI / f64::from(side);
            let ([r, g, b], left) = backdrop.clouded(dir, backdrop.sky.radiance(dir), detail_rad);
            [r, g, b, left]
        })
        .flat_map(half)
        .collect();
    let mut image = Image::new(
        Extent3d {
            width: side,
            height: side,
            depth_or_array_layers: 1,
        },
        TextureDimension::D2,
        bytes,
        TextureFormat::Rgba16Float,
        RenderAssetUsages::RENDER_WORLD,
    );
    image.sampler = sampler(ImageAddressMode::ClampToEdge);
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sky_table_is_read_where_it_was_written() {
        for (u, v) in [(0.3, -0.6), (0.0, 0.0), (-0.9, 0.9), (0.99, 0.5)] {
            let dir = sky_direction(u, v);
            // As the shader reads it.
            let flat = dir.truncate() / (dir.x.abs() + dir.y.abs() + dir.z);
            assert!((flat.x + flat.y - u).abs() < 1e-12 && (flat.y - flat.x - v).abs() < 1e-12);
            assert!(dir.z > -1e-12, "the table holds the upper half: {dir}");
        }
    }
}
