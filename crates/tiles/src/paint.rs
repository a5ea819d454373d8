//! Materials for tiles.

use crate::{StandardPaint, TilePaint, TileSurface};
use bevy::prelude::*;
use bevy::render::render_resource::Face;

impl TilePaint for StandardPaint {
    type Material = StandardMaterial;

    fn paint(&self, surface: TileSurface, picture: Option<Handle<Image>>) -> StandardMaterial {
        StandardMaterial {
            base_color_texture: picture,
            unlit: surface.baked,
            double_sided: surface.two_sided,
            cull_mode: (!surface.two_sided).then_some(Face::Back),
            alpha_mode: match surface.cutoff {
                Some(alpha) => AlphaMode::Mask(f32::from(alpha) / 255.0),
                None => AlphaMode::Opaque,
            },
            perceptual_roughness: 1.0,
            reflectance: 0.0,
            ..default()
        }
    }
}
