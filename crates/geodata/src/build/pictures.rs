//! Textures at every half resolution, and how they are stored.

use super::options::Pictures;
use boresight_models::shape::textured::Texture;
use image::ImageEncoder as _;
use std::sync::{Arc, LazyLock, OnceLock};

/// Quality of JPEGs, of 100.
const QUALITY: u8 = 88;
/// Pictures of fewer pixels are stored without loss.
const SMALL_PX: usize = 64 * 64;

/// A texture and its halves.
#[derive(Debug)]
pub(super) struct Picture {
    full: Arc<Texture>,
    halves: OnceLock<Vec<Texture>>,
}

impl Picture {
    /// A texture; its halves are made when they are first asked for.
    pub fn new(full: Arc<Texture>) -> Self {
        Self {
            full,
            halves: OnceLock::new(),
        }
    }

    /// The texture after so many halvings, or the last that is more than a pixel.
    pub fn at(&self, halvings: u32) -> &Texture {
        let Some(k) = (halvings as usize).checked_sub(1) else {
            return &self.full;
        };
        let halves = self.halves.get_or_init(|| {
            let mut all: Vec<Texture> = Vec::new();
            while let last = all.last().unwrap_or(&self.full)
                && last.size_px != [1, 1]
            {
                all.push(half(last));
            }
            all
        });
        halves.get(k).or(halves.last()).unwrap_or(&self.full)
    }

    /// How often it can be halved.
    pub fn halvings(&self) -> u32 {
        let side = self.full.size_px[0].max(self.full.size_px[1]);
        u32::BITS - side.saturating_sub(1).leading_zeros()
    }
}

/// Linear value of each 8-bit sRGB value (IEC 61966-2-1).
pub(super) static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|value| {
        let x = value as f32 / 255.0;
        if x <= 0.04045 {
            x / 12.92
        } else {
            ((x + 0.055) / 1.055).powf(2.4)
        }
    })
});

/// 8-bit sRGB value of each of 4096 linear ones.
static SRGB: LazyLock<Vec<u8>> = LazyLock::new(|| {
    (0..4096)
        .map(|k| {
            let x = k as f32 / 4095.0;
            let y = if x <= 0.003_130_8 {
                12.92 * x
            } else {
                1.055 * x.powf(1.0 / 2.4) - 0.055
            };
            (y * 255.0).round() as u8
        })
        .collect()
});

/// 8-bit sRGB value of a linear one.
pub(super) fn srgb(linear: f32) -> u8 {
    SRGB[(linear.clamp(0.0, 1.0) * 4095.0).round() as usize]
}

/// The texture at half the resolution: means of light, weighted by alpha.
fn half(texture: &Texture) -> Texture {
    let [w, h] = texture.size_px.map(|side| side as usize);
    let size = [w.div_ceil(2), h.div_ceil(2)];
    let mut rgba = Vec::with_capacity(4 * size[0] * size[1]);
    for y in 0..size[1] {
        for x in 0..size[0] {
            let mut sum = [0.0_f32; 4];
            let mut plain = [0.0_f32; 3];
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let (sx, sy) = ((2 * x + dx).min(w - 1), (2 * y + dy).min(h - 1));
                let pixel = &texture.rgba[4 * (sy * w + sx)..][..4];
                let alpha = f32::from(pixel[3]);
                for c in 0..3 {
                    sum[c] += alpha * LINEAR[pixel[c] as usize];
                    plain[c] += LINEAR[pixel[c] as usize];
                }
                sum[3] += alpha;
            }
            for c in 0..3 {
                rgba.push(srgb(if sum[3] > 0.0 {
                    sum[c] / sum[3]
                } else {
                    plain[c] / 4.0
                }));
            }
            rgba.push((sum[3] / 4.0).round() as u8);
        }
    }
    Texture {
        size_px: size.map(|side| side as u32),
        rgba,
    }
}

/// A picture as a file's bytes and its media type.
pub(super) fn encode(
    texture: &Texture,
    pictures: Pictures,
) -> Result<(Vec<u8>, &'static str), String> {
    let [w, h] = texture.size_px;
    let opaque = texture.rgba.iter().skip(3).step_by(4).all(|&a| a == 255);
    let mut bytes = Vec::new();
    let small = texture.rgba.len() / 4 < SMALL_PX;
    let rgb = || -> Vec<u8> {
        let (pixels, _) = texture.rgba.as_chunks::<4>();
        pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect()
    };
    if opaque && pictures == Pictures::Jpeg && !small {
        let side = |side: u32| u16::try_from(side).map_err(|_| format!("{side} px is too wide"));
        jpeg_encoder::Encoder::new(&mut bytes, QUALITY)
            .encode(&rgb(), side(w)?, side(h)?, jpeg_encoder::ColorType::Rgb)
            .map_err(|error| error.to_string())?;
        return Ok((bytes, "image/jpeg"));
    }
    let png = image::codecs::png::PngEncoder::new(&mut bytes);
    let written = if opaque {
        png.write_image(&rgb(), w, h, image::ExtendedColorType::Rgb8)
    } else {
        png.write_image(&texture.rgba, w, h, image::ExtendedColorType::Rgba8)
    };
    written.map_err(|error| error.to_string())?;
    Ok((bytes, "image/png"))
}
