//! Materials and textures of glTF as looks.

use super::document::{Document, extension};
use super::schema::{Material, SpecularGlossiness, Texture, TextureInfo, TextureTransform};
use crate::tiles::content::error::{ContentError, Fault};
use crate::tiles::content::picture;
use boresight_models::shape::textured::{self, Look};
use serde::Deserialize;
use serde_json::Value;
use std::cell::OnceCell;
use std::sync::Arc;

/// A look, and which coordinates its texture takes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Surface {
    /// The look.
    pub look: Look,
    /// The set of texture coordinates.
    pub tex_coord: u32,
    /// What they are multiplied with and added to: rows of a 2 × 3 matrix; `None` leaves them.
    pub transform: Option<[[f32; 3]; 2]>,
    /// What was not taken over.
    pub notes: Vec<String>,
}

/// The pictures of a file, each decoded once.
pub(crate) struct Looks<'d, 'b> {
    document: &'d Document<'b>,
    pictures: Vec<OnceCell<Arc<textured::Texture>>>,
}

impl<'d, 'b> Looks<'d, 'b> {
    /// None decoded so far.
    pub fn new(document: &'d Document<'b>) -> Self {
        let pictures = document.root.images.iter().map(|_| OnceCell::new());
        Self {
            document,
            pictures: pictures.collect(),
        }
    }

    /// The look of a material; that of glTF's default material without one.
    pub fn look(&self, index: Option<usize>) -> Result<Surface, ContentError> {
        let Some(index) = index else {
            return Ok(Surface::default());
        };
        let place = format!("material {index}");
        let material = self.document.root.materials.get(index);
        let absent = || ContentError::damaged(&place, "there is none");
        self.read(material.ok_or_else(absent)?, &place)
    }

    fn read(&self, material: &Material, place: &str) -> Result<Surface, ContentError> {
        let named = |name: &str| material.extensions.contains_key(name);
        let pbr = &material.pbr_metallic_roughness;
        let (mut factor, mut info) = (pbr.base_color_factor, pbr.base_color_texture.clone());
        let name = "KHR_materials_pbrSpecularGlossiness";
        if let Some(other) = extension::<SpecularGlossiness>(&material.extensions, name, place)? {
            factor = other.diffuse_factor.or(factor);
            info = other.diffuse_texture.or(info);
        }
        let (mut alpha_cutoff, mut note) = (None, None::<&str>);
        if let Some(own) = material.extensions.get("KHR_techniques_webgl") {
            note = Some("shaders of a material's own are left out, but for what they call diffuse");
            let values = own.get("values").and_then(Value::as_object);
            let named = |name: &str| name.to_ascii_lowercase().contains("diffuse");
            let values = values.into_iter().flatten().filter(|(name, _)| named(name));
            for (_, value) in values {
                info = info.or_else(|| TextureInfo::deserialize(value).ok());
                factor = factor.or_else(|| <[f32; 4]>::deserialize(value).ok());
            }
        }
        let mut base_color = factor.unwrap_or([1.0; 4]);
        if !base_color.iter().all(|x| x.is_finite()) {
            return Err(ContentError::damaged(place, "its colour is not finite"));
        }
        let cutoff = material.alpha_cutoff.unwrap_or(0.5);
        match material.alpha_mode.as_deref() {
            Some("MASK") => alpha_cutoff = Some(cutoff),
            Some("BLEND") => {
                note = Some(
                    "blended materials are drawn as solid, with holes where alpha is below a half",
                );
                // Glass stays: only what a picture makes transparent is a hole.
                alpha_cutoff = info.as_ref().map(|_| 0.5 * base_color[3]);
            }
            _ => base_color[3] = 1.0,
        }
        let mut found = Surface {
            look: Look {
                base_color,
                unlit: named("KHR_materials_unlit"),
                double_sided: material.double_sided,
                alpha_cutoff,
                ..Look::default()
            },
            notes: note.into_iter().map(str::to_owned).collect(),
            ..Surface::default()
        };
        if let Some(info) = info {
            self.texture(&info, &mut found, place)?;
        }
        Ok(found)
    }

    /// Adds a texture to a look.
    fn texture(
        &self,
        info: &TextureInfo,
        found: &mut Surface,
        place: &str,
    ) -> Result<(), ContentError> {
        const CLAMP: u32 = 33_071; // CLAMP_TO_EDGE
        let root = &self.document.root;
        let absent = || ContentError::damaged(place, format!("there is no texture {}", info.index));
        let texture = root.textures.get(info.index).ok_or_else(absent)?;
        found.tex_coord = info.tex_coord;
        let name = "KHR_texture_transform";
        if let Some(t) = extension::<TextureTransform>(&info.extensions, name, place)? {
            found.tex_coord = t.tex_coord.unwrap_or(info.tex_coord);
            let ([x, y], [u, v]) = (t.offset, t.scale.unwrap_or([1.0; 2]));
            let (sin, cos) = t.rotation.sin_cos();
            // Counter-clockwise in coordinates whose v points down.
            let rows = [[cos * u, sin * v, x], [-sin * u, cos * v, y]];
            if !rows.as_flattened().iter().all(|x| x.is_finite()) {
                return Err(ContentError::damaged(
                    place,
                    "its texture transform is not finite",
                ));
            }
            found.transform = Some(rows);
        }
        let sampler = texture.sampler.and_then(|i| root.samplers.get(i));
        let clamps = |wrap: Option<u32>| wrap == Some(CLAMP);
        found.look.repeats = !sampler.is_some_and(|s| clamps(s.wrap_s) && clamps(s.wrap_t));
        match self.picture(texture, place) {
            Ok(picture) => found.look.texture = picture,
            Err(why) if matches!(why.fault, Fault::TooLarge { .. }) => return Err(why),
            // The surface stands without it.
            Err(why) => found.notes.push(format!("a texture is left out: {why}")),
        }
        Ok(())
    }

    /// The picture of a texture: the one of an extension where there is one.
    fn picture(
        &self,
        texture: &Texture,
        place: &str,
    ) -> Result<Option<Arc<textured::Texture>>, ContentError> {
        let other = |name: &str| {
            let source = texture.extensions.get(name)?.get("source")?.as_u64()?;
            usize::try_from(source).ok()
        };
        let source = other("KHR_texture_basisu").or_else(|| other("EXT_texture_webp"));
        let Some(index) = source.or(texture.source) else {
            return Ok(None);
        };
        let absent = || ContentError::damaged(place, format!("there is no image {index}"));
        let cell = self.pictures.get(index).ok_or_else(absent)?;
        if let Some(found) = cell.get() {
            return Ok(Some(Arc::clone(found)));
        }
        let document = self.document;
        let image = &document.root.images[index];
        let place = format!("image {index}");
        let read;
        let bytes = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => {
                read = document.read(uri, &place)?;
                read.as_slice()
            }
            (None, Some(view)) => document.view(view, &place)?,
            _ => {
                return Err(ContentError::damaged(
                    place,
                    "it has neither a URI nor bytes",
                ));
            }
        };
        let [columns, rows] = picture::size(bytes, &place)?;
        document.spend(4 * columns as usize * rows as usize, &place)?;
        let found = Arc::new(picture::decode(bytes, &place)?);
        Ok(Some(Arc::clone(cell.get_or_init(|| found))))
    }
}
