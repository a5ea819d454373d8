//! Pictures on surfaces, as the GPU takes them.

use bevy::asset::RenderAssetUsages;
use bevy::color::Srgba;
use bevy::image::{Image, ImageAddressMode, ImageFilterMode, ImageSampler, ImageSamplerDescriptor};
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};
use std::sync::LazyLock;

/// Longest side of a texture that every GPU takes [px]; of a larger picture the finest levels are left out.
const LONGEST_PX: u32 = 8_192;

/// Linear light of each value of sRGB, and from which linear light on a value is the next.
static SRGB: LazyLock<([f32; 256], [f32; 255])> = LazyLock::new(|| {
    let decode = |x: f32| Srgba::gamma_function(x / 255.0);
    (
        std::array::from_fn(|i| decode(i as f32)),
        std::array::from_fn(|i| decode(i as f32 + 0.5)),
    )
});

/// A pixel's light times its alpha, and its alpha: what may be averaged.
type Light = [f32; 4];

fn decode(rgba: [u8; 4]) -> Light {
    let alpha = f32::from(rgba[3]) / 255.0;
    let light = |i: usize| SRGB.0[rgba[i] as usize] * alpha;
    [light(0), light(1), light(2), alpha]
}

/// A pixel as bytes; its alpha times `more`.
fn encode(light: Light, more: f32) -> [u8; 4] {
    let alpha = light[3];
    let value = |i: usize| {
        let linear = light[i] / alpha.max(1e-6);
        SRGB.1.partition_point(|next| *next <= linear) as u8
    };
    [
        value(0),
        value(1),
        value(2),
        (alpha * more * 255.0 + 0.5) as u8,
    ]
}

/// Up to three neighbours along an axis that a pixel of the next level covers, with their shares.
fn taps(i: u32, from: u32, to: u32) -> impl Iterator<Item = (u32, f32)> {
    let scale = from as f32 / to as f32;
    let (low, high) = (i as f32 * scale, (i + 1) as f32 * scale);
    (low as u32..from.min(high.ceil() as u32)).map(move |k| {
        let share = high.min(k as f32 + 1.0) - low.max(k as f32);
        (k, share / scale)
    })
}

/// The next level of a picture: each of its pixels the mean of the light that it covers.
fn halved([width, height]: [u32; 2], at: impl Fn(u32, u32) -> Light) -> ([u32; 2], Vec<Light>) {
    let next = [width, height].map(|n| (n / 2).max(1));
    let mut level = Vec::with_capacity(next[0] as usize * next[1] as usize);
    for y in 0..next[1] {
        for x in 0..next[0] {
            let mut sum = [0.0; 4];
            for (v, share_v) in taps(y, height, next[1]) {
                for (u, share_u) in taps(x, width, next[0]) {
                    for (sum, light) in sum.iter_mut().zip(at(u, v)) {
                        *sum += share_u * share_v * light;
                    }
                }
            }
            level.push(sum);
        }
    }
    (next, level)
}

/// Bytes of a picture of so many pixels with all its levels.
pub fn picture_bytes([width, height]: [u32; 2]) -> u64 {
    u64::from(width) * u64::from(height) * 4 * 4 / 3
}

/// By how much the alpha of a level must grow so that as large a `share` of it reaches `cutoff` as of the first: a mean of
/// leaves and holes would else lie below it, and distant trees lose their crowns (Castaño, "Computing alpha mipmaps", 2010).
fn kept_share(level: &[Light], share: f32, cutoff: f32) -> f32 {
    let mut alphas: Vec<f32> = level.iter().map(|light| light[3]).collect();
    alphas.sort_by(f32::total_cmp);
    let holes = ((1.0 - share) * alphas.len() as f32).round() as usize;
    let least = alphas.get(holes).copied().unwrap_or(1.0);
    if least > 0.0 { cutoff / least } else { 1.0 }
}

/// An sRGB texture of a picture (red, green, blue, alpha, row by row from the top) with all its mip levels,
/// box-filtered in linear light. Where alpha below `cutoff` (in 255ths) is a hole, all levels have holes of the same share. A picture with fewer bytes than pixels goes on in black.
pub fn picture_texture(size_px: [u32; 2], rgba: &[u8], repeats: bool, cutoff: Option<u8>) -> Image {
    let size_px = size_px.map(|n| n.max(1));
    let pixels = rgba.as_chunks::<4>().0;
    let width = size_px[0] as usize;
    let first = |x: u32, y: u32| {
        let pixel = pixels.get(y as usize * width + x as usize);
        pixel.map_or([0.0, 0.0, 0.0, 1.0], |pixel| decode(*pixel))
    };
    let mut levels: Vec<([u32; 2], Vec<u8>)> = Vec::new();
    let mut exact = rgba.to_vec();
    exact.resize(4 * width * size_px[1] as usize, 0);
    levels.push((size_px, exact));
    let solid = cutoff.map(|cutoff| {
        let kept = pixels.iter().filter(|pixel| pixel[3] >= cutoff).count();
        (
            kept as f32 / pixels.len().max(1) as f32,
            f32::from(cutoff) / 255.0,
        )
    });
    let mut level = None;
    while levels.last().is_some_and(|(size, _)| *size != [1, 1]) {
        let (size, light) = match &level {
            None => halved(size_px, first),
            Some((size, light)) => {
                let size: [u32; 2] = *size;
                let light: &Vec<Light> = light;
                halved(size, |x, y| light[(y * size[0] + x) as usize])
            }
        };
        let more = solid.map_or(1.0, |(share, cutoff)| kept_share(&light, share, cutoff));
        let bytes = light
            .iter()
            .flat_map(|light| encode(*light, more))
            .collect();
        levels.push((size, bytes));
        level = Some((size, light));
    }
    levels.retain(|(size, _)| size[0].max(size[1]) <= LONGEST_PX);
    let size = levels.first().map_or([1, 1], |(size, _)| *size);
    let mut image = Image::new_uninit(
        Extent3d {
            width: size[0],
            height: size[1],
            depth_or_array_layers: 1,
        },
        TextureDimension::D2,
        TextureFormat::Rgba8UnormSrgb,
        RenderAssetUsages::RENDER_WORLD,
    );
    image.texture_descriptor.mip_level_count = levels.len() as u32;
    image.data = Some(levels.into_iter().flat_map(|(_, bytes)| bytes).collect());
    image.sampler = if repeats {
        sampler(ImageAddressMode::Repeat)
    } else {
        sampler(ImageAddressMode::ClampToEdge)
    };
    image
}

/// A sampler between pixels and levels that treats what lies outside the picture so.
pub fn sampler(address_mode: ImageAddressMode) -> ImageSampler {
    ImageSampler::Descriptor(ImageSamplerDescriptor {
        address_mode_u: address_mode,
        address_mode_v: address_mode,
        mag_filter: ImageFilterMode::Linear,
        min_filter: ImageFilterMode::Linear,
        mipmap_filter: ImageFilterMode::Linear,
        ..Default::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_has_the_mean_light_of_the_first() {
        // Odd sides: a pixel of the next level covers parts of its neighbours.
        let size_px = [7, 5];
        let rgba: Vec<u8> = (0..7 * 5_u32)
            .flat_map(|i| [(i * 37 % 256) as u8, (i * 91 % 256) as u8, 200, 255])
            .collect();
        let image = picture_texture(size_px, &rgba, true, None);
        assert_eq!(image.texture_descriptor.mip_level_count, 3);
        let data = image.data.unwrap();
        assert_eq!(&data[..rgba.len()], rgba);
        assert_eq!(data.len(), 4 * (35 + 3 * 2 + 1));
        let mean = |channel: usize| {
            let light = rgba.chunks(4).map(|p| SRGB.0[p[channel] as usize]);
            light.sum::<f32>() / 35.0
        };
        let last = &data[data.len() - 4..];
        for channel in 0..3 {
            let expected = Srgba::gamma_function_inverse(mean(channel)) * 255.0;
            assert!(
                (f32::from(last[channel]) - expected).abs() <= 0.51,
                "{last:?}"
            );
        }
    }

    #[test]
    fn holes_lend_their_colour_to_nobody() {
        let rgba = [255, 0, 0, 255, 0, 255, 0, 0].repeat(2);
        let data = picture_texture([2, 2], &rgba, false, None).data.unwrap();
        assert_eq!(&data[16..], [255, 0, 0, 128]);
    }

    #[test]
    fn leaves_stay_leaves_in_every_level() {
        // A quarter of the pixels, one of each four: their mean is far below the cut.
        let rgba: Vec<u8> = (0..16 * 16_u32)
            .flat_map(|i| {
                [
                    0,
                    90,
                    0,
                    if (i % 16 + i / 16 * 5) % 4 == 0 {
                        255
                    } else {
                        0
                    },
                ]
            })
            .collect();
        let image = picture_texture([16, 16], &rgba, true, Some(128));
        let second = &image.data.unwrap()[4 * 256..4 * (256 + 64)];
        let solid = second.chunks(4).filter(|pixel| pixel[3] >= 128).count();
        assert!(solid >= 16, "{solid} of 64");
    }

    #[test]
    fn a_picture_cut_short_is_no_panic() {
        let image = picture_texture([4, 4], &[255; 12], false, None);
        assert_eq!(image.data.unwrap().len(), 4 * (16 + 4 + 1));
        let empty = picture_texture([0, 0], &[], false, None);
        assert_eq!(empty.data.unwrap().len(), 4);
    }
}
