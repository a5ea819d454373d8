//! A primitive of a glTF mesh: its triangles or points, with their attributes.

use super::document::{Document, extension, layout};
use super::draco;
use super::features::{Features, Ids};
use super::look::Looks;
use super::schema::{self, Draco};
use crate::tiles::content::error::ContentError;
use boresight_models::shape::textured::{PointCloud, TexturedMesh};
use glam::Vec3;

/// What a primitive draws.
pub(crate) enum Drawn {
    /// Triangles.
    Mesh(TexturedMesh),
    /// Points.
    Points(PointCloud),
    /// Nothing that is read.
    Nothing,
}

/// A primitive's attributes, compressed or not.
struct Source<'s, 'b> {
    document: &'s Document<'b>,
    primitive: &'s schema::Primitive,
    draco: Option<(Draco, draco::Mesh)>,
    place: &'s str,
}

impl Source<'_, '_> {
    /// `N` numbers for each vertex; `None` where the primitive has no such attribute. `least` components are needed,
    /// what is missing to `N` is `fill`.
    fn floats<const N: usize>(
        &self,
        name: &str,
        least: usize,
        fill: [f32; N],
    ) -> Result<Option<Vec<[f32; N]>>, ContentError> {
        let Some(index) = self.primitive.attributes.get(name) else {
            return Ok(None);
        };
        let place = format!("{}, {name}", self.place);
        let accessor = self.document.accessor(*index, &place)?;
        let (_, components) = layout(accessor, &place)?;
        if !(least..=N).contains(&components) {
            let why = format!("{} where {N} numbers belong", accessor.shape);
            return Err(ContentError::damaged(place, why));
        }
        let found = match self.compressed(name) {
            Some((id, mesh)) => {
                self.document
                    .spend(mesh.points.count.saturating_mul(4 * N), &place)?;
                mesh.floats(id, accessor, fill, &place)
            }
            None => self.document.floats(accessor, fill, &place),
        };
        found.map(Some)
    }

    /// One whole number for each vertex.
    fn whole(&self, name: &str) -> Result<Option<Vec<u32>>, ContentError> {
        let Some(index) = self.primitive.attributes.get(name) else {
            return Ok(None);
        };
        let place = format!("{}, {name}", self.place);
        let found = match self.compressed(name) {
            Some((id, mesh)) => mesh.whole(id, &place),
            None => (self.document).whole(self.document.accessor(*index, &place)?, &place),
        };
        found.map(Some)
    }

    /// An attribute's number among those that Draco compressed.
    fn compressed(&self, name: &str) -> Option<(usize, &draco::Mesh)> {
        let (draco, mesh) = self.draco.as_ref()?;
        Some((*draco.attributes.get(name)?, mesh))
    }
}

/// Three corners a triangle, of an indexed list, strip or fan; a strip's triangles of no area are what joins its parts.
fn triangles(corners: Vec<u32>, mode: u32) -> Vec<u32> {
    const STRIP: u32 = 5;
    const FAN: u32 = 6;
    let proper = |[a, b, c]: &[u32; 3]| a != b && b != c && a != c;
    match mode {
        STRIP => {
            let each = corners.windows(3).enumerate().map(|(i, w)| match i % 2 {
                0 => [w[0], w[1], w[2]],
                _ => [w[1], w[0], w[2]],
            });
            each.filter(proper).flatten().collect()
        }
        FAN => {
            let rim = corners.get(1..).unwrap_or_default();
            let each = rim.windows(2).map(|w| [corners[0], w[0], w[1]]);
            each.filter(proper).flatten().collect()
        }
        _ => {
            let mut corners = corners;
            corners.truncate(corners.len() / 3 * 3);
            corners
        }
    }
}

/// Unit vectors of vectors.
fn units(mut vectors: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
    for v in &mut vectors {
        *v = Vec3::from(*v).normalize_or(Vec3::Z).to_array();
    }
    vectors
}

/// Reads a primitive; what is left out is said to `note`.
pub(crate) fn read(
    document: &Document,
    looks: &Looks,
    features: &mut Features,
    primitive: &schema::Primitive,
    place: &str,
    note: &mut dyn FnMut(&str),
) -> Result<Drawn, ContentError> {
    const POINTS: u32 = 0;
    const TRIANGLES: u32 = 4;
    let mode = primitive.mode.unwrap_or(TRIANGLES);
    match mode {
        1..=3 => {
            note("lines are left out");
            return Ok(Drawn::Nothing);
        }
        0 | 4..=6 => {}
        other => return Err(ContentError::damaged(place, format!("mode {other}"))),
    }
    let name = "KHR_draco_mesh_compression";
    let draco: Option<Draco> = extension(&primitive.extensions, name, place)?;
    let draco = match draco {
        None => None,
        Some(draco) => {
            let place = format!("{place}, {name}");
            let data = document.view(draco.buffer_view, &place)?;
            let mesh = draco::Mesh::new(document, data, &place)?;
            Some((draco, mesh))
        }
    };
    let source = Source {
        document,
        primitive,
        draco,
        place,
    };
    let Some(positions) = source.floats("POSITION", 3, [0.0; 3])? else {
        note("primitives without positions are left out");
        return Ok(Drawn::Nothing);
    };
    let count = positions.len();
    let same = |name: &str, length: usize| match length == count {
        true => Ok(()),
        false => {
            let why = format!("{length} {name} for {count} positions");
            Err(ContentError::damaged(place, why))
        }
    };
    let corners = match (&source.draco, primitive.indices) {
        (Some((_, mesh)), _) => Some(mesh.indices.clone()),
        (None, Some(index)) => {
            let place = format!("{place}, indices");
            Some(document.whole(document.accessor(index, &place)?, &place)?)
        }
        _ => None,
    };
    if let Some(wrong) = corners.iter().flatten().find(|i| **i as usize >= count) {
        let why = format!("index {wrong} where there are {count} positions");
        return Err(ContentError::damaged(place, why));
    }
    let surface = looks.look(primitive.material)?;
    for text in &surface.notes {
        note(text);
    }
    let normals = source
        .floats("NORMAL", 3, [0.0; 3])?
        .map(units)
        .unwrap_or_default();
    let colors = source.floats("COLOR_0", 3, [1.0; 4])?.unwrap_or_default();
    let ids = ids(&source, features, count, note)?;
    for (name, length) in [
        ("normals", normals.len()),
        ("colours", colors.len()),
        ("feature IDs", ids.len()),
    ] {
        if length > 0 {
            same(name, length)?;
        }
    }
    if mode == POINTS {
        let base = surface.look.base_color;
        let colors = match colors.is_empty() {
            true if base == [1.0; 4] => Vec::new(),
            true => vec![base; count],
            false => colors
                .iter()
                .map(|c| [0, 1, 2, 3].map(|i| c[i] * base[i]))
                .collect(),
        };
        let cloud = PointCloud {
            positions,
            colors,
            normals,
            features: ids,
            ..PointCloud::default()
        };
        return Ok(Drawn::Points(match corners {
            None => cloud,
            Some(corners) => {
                document.spend(corners.len().saturating_mul(44), place)?;
                chosen(&cloud, &corners)
            }
        }));
    }
    let mut look = surface.look;
    let mut uv = Vec::new();
    if look.texture.is_some() {
        let name = format!("TEXCOORD_{}", surface.tex_coord);
        uv = source.floats(&name, 2, [0.0; 2])?.unwrap_or_default();
        if uv.is_empty() && count > 0 {
            note("textures of meshes without texture coordinates are left out");
            look.texture = None;
        } else {
            same("texture coordinates", uv.len())?;
        }
        if let Some(rows) = surface.transform {
            for place in &mut uv {
                let [u, v] = *place;
                *place = rows.map(|[a, b, c]| a * u + b * v + c);
            }
        }
    }
    let corners = match corners {
        Some(corners) => corners,
        None => {
            document.spend(count.saturating_mul(4), place)?;
            (0..count as u32).collect()
        }
    };
    let mode = if source.draco.is_some() {
        TRIANGLES
    } else {
        mode
    };
    if mode != TRIANGLES {
        document.spend(corners.len().saturating_mul(12), place)?;
    }
    Ok(Drawn::Mesh(TexturedMesh {
        positions,
        normals,
        uv,
        colors,
        features: ids,
        indices: triangles(corners, mode),
        look,
        ..TexturedMesh::default()
    }))
}

/// The row of each vertex in the content's table; none where the primitive has no IDs.
fn ids(
    source: &Source,
    features: &mut Features,
    count: usize,
    note: &mut dyn FnMut(&str),
) -> Result<Vec<u32>, ContentError> {
    let Source {
        primitive, place, ..
    } = source;
    let batch = primitive.attributes.contains_key("_BATCHID");
    let name = "EXT_mesh_features";
    let (ids, left_out) = features.choose(&primitive.extensions, name, batch, place)?;
    if let Some(text) = left_out {
        note(text);
    }
    match ids {
        Ids::None => Ok(Vec::new()),
        Ids::Batch => Ok(features.of_batch(source.whole("_BATCHID")?.unwrap_or_default())),
        Ids::Set(set) => {
            let raw = match set.attribute {
                None => (0..count as u32).collect(),
                Some(n) => {
                    let name = format!("_FEATURE_ID_{n}");
                    let absent = || ContentError::damaged(*place, format!("it has no {name}"));
                    source.whole(&name)?.ok_or_else(absent)?
                }
            };
            features.of_set(&set, raw, place)
        }
    }
}

/// The points that indices name.
fn chosen(cloud: &PointCloud, corners: &[u32]) -> PointCloud {
    fn pick<T: Copy>(all: &[T], corners: &[u32]) -> Vec<T> {
        let each = corners.iter().filter_map(|i| all.get(*i as usize));
        each.copied().collect()
    }
    PointCloud {
        origin_m: cloud.origin_m,
        positions: pick(&cloud.positions, corners),
        colors: pick(&cloud.colors, corners),
        normals: pick(&cloud.normals, corners),
        features: pick(&cloud.features, corners),
    }
}
