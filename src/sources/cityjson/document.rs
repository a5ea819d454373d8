//! The members of a CityJSON file that make surfaces.

use crate::sources::error::Fault;
use glam::DVec3;
use serde::de::{Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, de};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::fmt;

/// Nested lists of numbers; `null` is a number that is missing.
#[derive(Clone, Debug, PartialEq)]
pub enum Nest {
    /// A number, or none.
    Number(Option<usize>),
    /// A list.
    List(Vec<Nest>),
}

impl Default for Nest {
    fn default() -> Self {
        Self::List(Vec::new())
    }
}

impl Nest {
    /// The list; empty for a number.
    pub fn items(&self) -> &[Nest] {
        match self {
            Self::List(items) => items,
            Self::Number(_) => &[],
        }
    }

    /// The number; none for a list.
    pub fn index(&self) -> Option<usize> {
        match self {
            Self::Number(number) => *number,
            Self::List(_) => None,
        }
    }
}

impl<'de> Deserialize<'de> for Nest {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Nested;
        impl<'de> Visitor<'de> for Nested {
            type Value = Nest;
            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("lists of whole numbers")
            }
            fn visit_u64<E: de::Error>(self, value: u64) -> Result<Nest, E> {
                Ok(Nest::Number(usize::try_from(value).ok()))
            }
            fn visit_i64<E: de::Error>(self, _: i64) -> Result<Nest, E> {
                Ok(Nest::Number(None))
            }
            fn visit_unit<E: de::Error>(self) -> Result<Nest, E> {
                Ok(Nest::Number(None))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Nest, A::Error> {
                let mut items = Vec::new();
                while let Some(item) = seq.next_element()? {
                    items.push(item);
                }
                Ok(Nest::List(items))
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Nest, A::Error> {
                while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
                Ok(Nest::Number(None))
            }
        }
        from.deserialize_any(Nested)
    }
}

/// `"2.2"` (since 1.1) or `2.2` (1.0).
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub enum Lod {
    /// A text.
    Text(String),
    /// A number.
    Number(f64),
}

impl Lod {
    /// The level as a number.
    pub fn level(&self) -> f64 {
        match self {
            Self::Text(text) => text
                .parse()
                .ok()
                .filter(|v: &f64| v.is_finite())
                .unwrap_or(0.0),
            Self::Number(level) => *level,
        }
    }
}

/// Scale and shift of whole-number vertices.
#[derive(Clone, Copy, Debug, Deserialize)]
pub struct Transform {
    scale: [f64; 3],
    translate: [f64; 3],
}

/// What surfaces of a geometry are.
#[derive(Clone, Debug, Deserialize)]
pub struct Semantics {
    /// The kinds.
    #[serde(default)]
    pub surfaces: Vec<SemanticSurface>,
    /// Which surface has which.
    #[serde(default)]
    pub values: Nest,
}

/// A kind of surface.
#[derive(Clone, Debug, Deserialize)]
pub struct SemanticSurface {
    /// `RoofSurface`, `WallSurface`, …
    #[serde(rename = "type", default)]
    pub kind: String,
}

/// A theme of materials on a geometry.
#[derive(Clone, Debug, Deserialize)]
pub struct MaterialTheme {
    /// One for all surfaces.
    #[serde(default)]
    pub value: Option<usize>,
    /// One for each.
    #[serde(default)]
    pub values: Option<Nest>,
}

/// A theme of textures on a geometry.
#[derive(Clone, Debug, Deserialize)]
pub struct TextureTheme {
    /// Texture and texture vertices of each ring.
    #[serde(default)]
    pub values: Nest,
}

/// A geometry, or an instance of a template.
#[derive(Clone, Debug, Deserialize)]
pub struct Geometry {
    /// `Solid`, `MultiSurface`, …
    #[serde(rename = "type", default)]
    pub kind: String,
    /// Level of detail.
    #[serde(default)]
    pub lod: Option<Lod>,
    /// Indices of vertices.
    #[serde(default)]
    pub boundaries: Nest,
    /// What its surfaces are.
    #[serde(default)]
    pub semantics: Option<Semantics>,
    /// By theme.
    #[serde(default)]
    pub material: BTreeMap<String, MaterialTheme>,
    /// By theme.
    #[serde(default)]
    pub texture: BTreeMap<String, TextureTheme>,
    /// Which template it is an instance of.
    #[serde(default)]
    pub template: Option<usize>,
    /// From the template's frame to about the reference point, row by row.
    #[serde(rename = "transformationMatrix", default)]
    pub matrix: Vec<f64>,
}

/// A city object.
#[derive(Clone, Debug, Deserialize)]
pub struct Object {
    /// `Building`, `Road`, …
    #[serde(rename = "type", default)]
    pub kind: String,
    /// What is known of it.
    #[serde(default)]
    pub attributes: Map<String, Value>,
    /// Its geometries.
    #[serde(default)]
    pub geometry: Vec<Geometry>,
    /// What it is a part of.
    #[serde(default)]
    pub parents: Vec<String>,
}

/// Geometries that instances share.
#[derive(Clone, Debug, Deserialize)]
pub struct Templates {
    /// The geometries.
    #[serde(default)]
    pub templates: Vec<Geometry>,
    /// Their vertices.
    #[serde(rename = "vertices-templates", default)]
    pub vertices: Vec<[f64; 3]>,
}

#[derive(Clone, Debug, Deserialize)]
struct Material {
    #[serde(rename = "diffuseColor", default)]
    diffuse: Option<[f64; 3]>,
    #[serde(default)]
    transparency: Option<f64>,
}

#[derive(Clone, Debug, Deserialize)]
struct Image {
    #[serde(default)]
    image: String,
}

#[derive(Clone, Debug, Default, Deserialize)]
struct Appearance {
    #[serde(default)]
    materials: Vec<Material>,
    #[serde(default)]
    textures: Vec<Image>,
    #[serde(rename = "vertices-texture", default)]
    vertices: Vec<[f64; 2]>,
}

#[derive(Clone, Debug, Default, Deserialize)]
struct Metadata {
    #[serde(rename = "referenceSystem", default)]
    system: Option<String>,
}

/// A CityJSON document, or a feature of a sequence.
#[derive(Clone, Debug, Deserialize)]
pub struct Document {
    #[serde(rename = "type", default)]
    kind: String,
    #[serde(default)]
    version: Option<String>,
    /// Of whole-number vertices.
    #[serde(default)]
    pub transform: Option<Transform>,
    #[serde(default)]
    metadata: Metadata,
    /// By their names.
    #[serde(rename = "CityObjects", default)]
    pub objects: BTreeMap<String, Object>,
    #[serde(default)]
    vertices: Vec<[f64; 3]>,
    #[serde(default)]
    appearance: Appearance,
    /// Shared geometries.
    #[serde(rename = "geometry-templates", default)]
    pub templates: Option<Templates>,
}

impl Document {
    /// The coordinate reference system that it names.
    pub fn reference_system(&self) -> Option<String> {
        self.metadata.system.clone().filter(|name| !name.is_empty())
    }

    /// Its vertices in its coordinate reference system; a feature's with the transform of its sequence.
    pub fn positions(&self, of_sequence: Option<Transform>) -> impl Iterator<Item = DVec3> {
        let transform = self.transform.or(of_sequence);
        self.vertices.iter().map(move |v| match transform {
            Some(t) => DVec3::from(*v) * DVec3::from(t.scale) + DVec3::from(t.translate),
            None => DVec3::from(*v),
        })
    }

    /// Colour of a material.
    pub fn material(&self, index: usize) -> Option<[f32; 4]> {
        let material = self.appearance.materials.get(index)?;
        // Colours of files are meant for the screen.
        let linear = |v: f64| v.clamp(0.0, 1.0).powf(2.2) as f32;
        let [r, g, b] = material.diffuse?.map(linear);
        Some([
            r,
            g,
            b,
            1.0 - material.transparency.unwrap_or(0.0).clamp(0.0, 1.0) as f32,
        ])
    }

    /// Path of a texture's picture.
    pub fn image(&self, index: usize) -> Option<&str> {
        Some(&self.appearance.textures.get(index)?.image)
    }

    /// A place in a texture, (0, 0) at its bottom left.
    pub fn texture_vertex(&self, index: usize) -> Option<[f64; 2]> {
        self.appearance.vertices.get(index).copied()
    }
}

/// The document of a file, or the documents of a sequence, its head first.
pub fn parse(bytes: &[u8]) -> Result<Vec<Document>, Fault> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let read = serde_json::Deserializer::from_slice(bytes).into_iter::<Document>();
    let documents = read.collect::<Result<Vec<_>, _>>();
    let mend = "name a CityJSON file (1.0, 1.1, 2.0) or a CityJSONSeq";
    let documents = documents.map_err(|error| Fault::new("JSON", error, mend))?;
    let head = documents.first().map_or("", |first| first.kind.as_str());
    if head != "CityJSON"
        || documents[1..]
            .iter()
            .any(|next| next.kind != "CityJSONFeature")
    {
        return Err(Fault::new("type", format!("'{head}' is no CityJSON"), mend));
    }
    let version = documents[0].version.clone().unwrap_or_default();
    if !["1.0", "1.1", "2.0"]
        .iter()
        .any(|known| version.starts_with(known))
    {
        let what = format!("'{version}' is none of 1.0, 1.1, 2.0");
        return Err(Fault::new("version", what, "upgrade the file with cjio"));
    }
    Ok(documents)
}
