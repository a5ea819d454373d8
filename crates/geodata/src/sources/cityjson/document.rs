//! The members of a CityJSON file that make surfaces, and the documents of a sequence.

use super::tolerant::{List, Maybe, Nest, Number, Point, Table, Text};
use crate::sources::error::Fault;
use boresight_common::warning::Notes;
use glam::DVec3;
use serde::Deserialize;
use serde_json::Value;

/// Scale and shift of whole-number vertices.
#[derive(Clone, Copy, Debug)]
pub struct Transform {
    scale: DVec3,
    translate: DVec3,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
struct StatedTransform {
    scale: List<Number>,
    translate: List<Number>,
}

/// What surfaces of a geometry are.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Semantics {
    /// The kinds.
    pub surfaces: List<Maybe<SemanticSurface>>,
    /// Which surface has which.
    pub values: Nest,
}

/// A kind of surface.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct SemanticSurface {
    /// `RoofSurface`, `WallSurface`, …
    #[serde(rename = "type")]
    pub kind: Text,
}

impl Semantics {
    /// The kind of a surface.
    pub fn kind(&self, index: usize) -> Option<&str> {
        self.surfaces.0.get(index)?.0.as_ref()?.kind.0.as_deref()
    }
}

/// A theme of materials on a geometry.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct MaterialTheme {
    /// One for all surfaces.
    pub value: Nest,
    /// One for each.
    pub values: Nest,
}

/// A theme of textures on a geometry.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct TextureTheme {
    /// Texture and texture vertices of each ring.
    pub values: Nest,
}

/// A geometry, or an instance of a template.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Geometry {
    /// `Solid`, `MultiSurface`, …
    #[serde(rename = "type")]
    pub kind: Text,
    /// Level of detail: `"2.2"` (since 1.1) or `2.2` (1.0).
    pub lod: Text,
    /// Indices of vertices.
    pub boundaries: Nest,
    /// What its surfaces are.
    pub semantics: Maybe<Semantics>,
    /// By theme.
    pub material: Table<Maybe<MaterialTheme>>,
    /// By theme.
    pub texture: Table<Maybe<TextureTheme>>,
    /// Which template it is an instance of.
    pub template: Nest,
    /// From the template's frame to about the reference point, row by row.
    #[serde(rename = "transformationMatrix")]
    pub matrix: List<Number>,
}

impl Geometry {
    /// Its own level of detail as a number; 0 where none is stated.
    pub fn level(&self) -> f64 {
        let text = self.lod.or_empty();
        let digits = text.trim_start_matches(|c: char| !c.is_ascii_digit());
        let level = digits.parse::<f64>().ok();
        level.filter(|v| v.is_finite()).unwrap_or(0.0)
    }
}

/// A city object.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Object {
    /// `Building`, `Road`, …
    #[serde(rename = "type")]
    pub kind: Text,
    /// What is known of it.
    pub attributes: Table<Value>,
    /// Its geometries.
    pub geometry: List<Maybe<Geometry>>,
    /// What it is a part of.
    pub parents: List<Text>,
    /// Its parts.
    pub children: List<Text>,
}

/// Geometries that instances share.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Templates {
    /// The geometries.
    pub templates: List<Maybe<Geometry>>,
    /// Their vertices.
    #[serde(rename = "vertices-templates")]
    pub vertices: List<Point>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
struct Material {
    #[serde(rename = "diffuseColor")]
    diffuse: List<Number>,
    transparency: Option<Number>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
struct Image {
    image: Text,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
struct Appearance {
    materials: List<Maybe<Material>>,
    textures: List<Maybe<Image>>,
    #[serde(rename = "vertices-texture")]
    vertices: List<List<Number>>,
    #[serde(rename = "default-theme-texture")]
    texture_theme: Text,
    #[serde(rename = "default-theme-material")]
    material_theme: Text,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
struct Metadata {
    #[serde(rename = "referenceSystem")]
    system: Value,
    #[serde(rename = "geographicalExtent")]
    extent: List<Number>,
}

/// A CityJSON document, or a feature of a sequence.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Document {
    #[serde(rename = "type")]
    kind: Text,
    version: Text,
    transform: Maybe<StatedTransform>,
    metadata: Maybe<Metadata>,
    /// By their names.
    #[serde(rename = "CityObjects")]
    pub objects: Table<Maybe<Object>>,
    vertices: List<Point>,
    appearance: Maybe<Appearance>,
    /// Shared geometries.
    #[serde(rename = "geometry-templates")]
    pub templates: Maybe<Templates>,
}

impl Document {
    /// The coordinate reference system that it names.
    ///
    /// Fails where it states one in a form that is not understood.
    pub fn reference_system(&self) -> Result<Option<String>, Fault> {
        let stated = self.metadata.0.as_ref().map(|it| &it.system);
        let name = match stated {
            None | Some(Value::Null) => return Ok(None),
            Some(Value::String(name)) => name.trim().trim_end_matches('/').to_string(),
            Some(Value::Number(code)) => format!("EPSG:{code}"),
            Some(Value::Object(parts)) => {
                let code = parts.iter().find(|(key, _)| key.to_lowercase() == "epsg");
                match code {
                    Some((_, Value::Number(code))) => format!("EPSG:{code}"),
                    Some((_, Value::String(code))) => format!("EPSG:{code}"),
                    _ => return Err(system_fault(stated)),
                }
            }
            other => return Err(system_fault(other)),
        };
        if name.is_empty() {
            return Ok(None);
        }
        // The register's address of a compound system: crs-compound?1=…&2=…
        let parts = name.split_once("crs-compound?").map(|(_, parts)| {
            let code = |part: &str| {
                let address = part.split_once('=').map_or(part, |(_, address)| address);
                let address = address.trim_end_matches('/');
                address
                    .rsplit(['/', ':'])
                    .next()
                    .unwrap_or(address)
                    .to_string()
            };
            let codes: Vec<String> = parts.split('&').map(code).collect();
            format!("EPSG:{}", codes.join("+"))
        });
        Ok(Some(parts.unwrap_or(name)))
    }

    /// Scale and shift of its vertices, where they are stated.
    ///
    /// Fails where they are none.
    pub fn transform(&self) -> Result<Option<Transform>, Fault> {
        let Some(stated) = &self.transform.0 else {
            return Ok(None);
        };
        let three = |name: &str, list: &List<Number>, sound: &dyn Fn(f64) -> bool| {
            let all: Vec<f64> = list.0.iter().map(|n| n.0).collect();
            let what = format!("its {name} {all:?} is none");
            let three = <[f64; 3]>::try_from(all).ok();
            let three = three.filter(|three| three.iter().all(|v| v.is_finite() && sound(*v)));
            let mend = "write three numbers, no scale of them zero";
            three
                .map(DVec3::from)
                .ok_or_else(|| Fault::new("transform", what, mend))
        };
        Ok(Some(Transform {
            scale: three("scale", &stated.scale, &|v| v != 0.0)?,
            translate: three("translate", &stated.translate, &|_| true)?,
        }))
    }

    /// Its vertices in its coordinate reference system; a feature's with the transform of its sequence. One that is no point is `NaN`.
    pub fn positions(&self, transform: Option<Transform>) -> impl Iterator<Item = DVec3> {
        self.vertices.0.iter().map(move |v| match transform {
            Some(t) => DVec3::from(v.0) * t.scale + t.translate,
            None => DVec3::from(v.0),
        })
    }

    /// Lowest and highest corner that it states for itself.
    pub fn extent(&self) -> Option<[DVec3; 2]> {
        let all = &self.metadata.0.as_ref()?.extent.0;
        let [a, b, c, d, e, f] = all.iter().map(|n| n.0).collect::<Vec<_>>()[..] else {
            return None;
        };
        let corners = [DVec3::new(a, b, c), DVec3::new(d, e, f)];
        corners.iter().all(|r| r.is_finite()).then_some(corners)
    }

    /// Colour of a material.
    pub fn material(&self, index: usize) -> Option<[f32; 4]> {
        let materials = &self.appearance.0.as_ref()?.materials.0;
        let material = materials.get(index)?.0.as_ref()?;
        // Colours of files are meant for the screen.
        let linear = |v: &Number| v.0.clamp(0.0, 1.0).powf(2.2) as f32;
        let [r, g, b] = material.diffuse.0.iter().map(linear).collect::<Vec<_>>()[..] else {
            return None;
        };
        let transparency = material.transparency.map_or(0.0, |v| v.0);
        let seen = 1.0 - transparency.clamp(0.0, 1.0) as f32;
        let color = [r, g, b, if seen.is_finite() { seen } else { 1.0 }];
        color.iter().all(|v| v.is_finite()).then_some(color)
    }

    /// Path of a texture's picture.
    pub fn image(&self, index: usize) -> Option<&str> {
        let textures = &self.appearance.0.as_ref()?.textures.0;
        textures.get(index)?.0.as_ref()?.image.0.as_deref()
    }

    /// A place in a texture, (0, 0) at its bottom left.
    pub fn texture_vertex(&self, index: usize) -> Option<[f64; 2]> {
        let vertex = &self.appearance.0.as_ref()?.vertices.0.get(index)?.0;
        match vertex[..] {
            [Number(u), Number(v)] if u.is_finite() && v.is_finite() => Some([u, v]),
            _ => None,
        }
    }

    /// The themes of materials and of textures that are shown where nothing else is said.
    pub fn themes(&self) -> [Option<&str>; 2] {
        let appearance = self.appearance.0.as_ref();
        [
            appearance.and_then(|it| it.material_theme.0.as_deref()),
            appearance.and_then(|it| it.texture_theme.0.as_deref()),
        ]
    }
}

fn system_fault(stated: Option<&Value>) -> Fault {
    let what = format!(
        "{} is no coordinate reference system",
        stated.unwrap_or(&Value::Null)
    );
    let mend = "write https://www.opengis.net/def/crs/EPSG/0/CODE, or name the system with --crs";
    Fault::new("referenceSystem", what, mend)
}

/// What mends a file that is none.
const MEND: &str = "name a CityJSON file (1.0, 1.1, 2.0) or a CityJSONSeq";

/// Without blanks and record marks at both ends.
fn trimmed(text: &[u8]) -> &[u8] {
    let blank = |b: &u8| b.is_ascii_whitespace() || *b == 0x1e;
    let from = text.iter().position(|b| !blank(b)).unwrap_or(text.len());
    let to = text.iter().rposition(|b| !blank(b)).map_or(from, |k| k + 1);
    &text[from..to]
}

/// The document of a file, or the documents of a sequence, its head first. Lines that are damaged are counted and left out.
pub fn parse(bytes: &[u8], notes: &mut Notes) -> Result<Vec<Document>, Fault> {
    let text = trimmed(bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes));
    let mut stream = serde_json::Deserializer::from_slice(text).into_iter::<Maybe<Document>>();
    let head = match stream.next() {
        Some(Ok(Maybe(Some(head)))) => head,
        Some(Err(error)) => return Err(Fault::new("JSON", error, MEND)),
        _ => return Err(Fault::new("JSON", "it holds no object", MEND)),
    };
    let rest = &text[stream.byte_offset()..];
    let kind = head.kind.or_empty();
    if kind == "CityJSONFeature" {
        let what = "the sequence begins with a CityJSONFeature, without its head";
        return Err(Fault::new("type", what, "put the CityJSON line first"));
    }
    if kind != "CityJSON" {
        return Err(Fault::new("type", format!("'{kind}' is no CityJSON"), MEND));
    }
    check(&head, notes)?;
    let first = 1 + text[..stream.byte_offset()]
        .iter()
        .filter(|b| **b == b'\n')
        .count();
    let mut documents = vec![head];
    // Features that run over several lines are read where nothing is damaged.
    let whole: Result<Vec<_>, _> = stream.collect();
    let features: Vec<(usize, Option<Document>)> = match whole {
        Ok(all) => {
            let numbered = all.into_iter().enumerate();
            numbered
                .map(|(k, Maybe(one))| (first + 1 + k, one))
                .collect()
        }
        Err(_) => {
            let lines = rest.split(|b| *b == b'\n').enumerate();
            let lines = lines.map(|(k, line)| (first + k, trimmed(line)));
            let own = lines.filter(|(_, line)| !line.is_empty());
            let read = |line: &[u8]| serde_json::from_slice::<Maybe<Document>>(line).ok();
            own.map(|(k, line)| (k, read(line).and_then(|one| one.0)))
                .collect()
        }
    };
    for (line, feature) in features {
        let place = format!("line {line}");
        match feature {
            Some(feature) if feature.kind.or_empty() == "CityJSONFeature" => {
                documents.push(feature);
            }
            Some(other) if other.kind.or_empty() == "CityJSON" => {
                let what = "a second CityJSON head: what follows has another transform";
                return Err(Fault::new(place, what, "split the file there"));
            }
            Some(_) => notes.leave_out("lines that are no CityJSONFeature", place),
            None => notes.leave_out("damaged lines", place),
        }
    }
    Ok(documents)
}

/// Whether a document's version is known and has what it needs.
fn check(head: &Document, notes: &mut Notes) -> Result<(), Fault> {
    let version = head.version.or_empty();
    let known = ["1.0", "1.1", "2.0"]
        .into_iter()
        .find(|known| version.starts_with(known) || known.strip_suffix(".0") == Some(version));
    if version.is_empty() {
        let what = "it states none: read as 2.0, and without a transform as 1.0";
        notes.assume("version", what, "state it");
    } else if known.is_none() {
        let what = format!("'{version}' is none of 1.0, 1.1, 2.0");
        return Err(Fault::new("version", what, "upgrade the file with cjio"));
    }
    let needed = matches!(known, Some("1.1" | "2.0"));
    if head.transform()?.is_none() && needed {
        let what = format!("it is missing, which CityJSON {version} needs");
        let mend = "state scale and translate, or version 1.0 for vertices as they stand";
        return Err(Fault::new("transform", what, mend));
    }
    Ok(())
}
