//! Wavefront OBJ with its materials (MTL), read by `tobj`: what photogrammetry programs write.

use super::Layer;
use super::error::{Fault, SourceError, read_bytes};
use super::mesh::{linear, picture, placed};
use super::options::Options;
use crate::models::shape::textured::{Look, Texture, TexturedMesh};
use glam::DVec3;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Cursor;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Coordinates beyond this lose digits as f32: they are read about the first vertex [m].
const FAR_M: f64 = 4096.0;
const MEND: &str = "export it again, as triangles with one material library beside it";

/// A mesh with its textures, as one surface. Colours and textures are taken to hold the light already.
///
/// Fails where the file, a material or a texture is missing or damaged, or where nothing says where it stands.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let bytes = read_bytes(path)?;
    let fault = |what: String| Fault::new("OBJ", what, MEND).of(path);
    let text = String::from_utf8_lossy(&bytes);
    let origin = far_origin(&text);
    let near = match origin {
        Some(origin) => about(&text, origin),
        None => text.into_owned(),
    };
    let folder = path.parent().unwrap_or(Path::new("."));
    let load = || {
        tobj::load_obj_buf(
            &mut Cursor::new(near.as_bytes()),
            &tobj::GPU_LOAD_OPTIONS,
            |library| {
                let bytes = std::fs::read(folder.join(library));
                let bytes = bytes.map_err(|_| tobj::LoadError::OpenFileFailed)?;
                tobj::load_mtl_buf(&mut Cursor::new(bytes))
            },
        )
    };
    // The library checks indices, but promises nothing.
    let loaded = catch_unwind(AssertUnwindSafe(load)).map_err(|_| fault("damaged".into()))?;
    let (models, materials) = loaded.map_err(|error| fault(error.to_string()))?;
    let used = models.iter().any(|model| model.mesh.material_id.is_some());
    let materials = match materials {
        Ok(materials) => materials,
        Err(error) if used || names_library(&near) => {
            return Err(fault(format!("its material library: {error}")));
        }
        Err(_) => Vec::new(),
    };
    let mut textures: BTreeMap<PathBuf, Arc<Texture>> = BTreeMap::new();
    let mut meshes = Vec::new();
    for model in models {
        let material = model.mesh.material_id.and_then(|id| materials.get(id));
        let mut mesh = converted(model.mesh).map_err(fault)?;
        if let Some(material) = material {
            look(&mut mesh, material, folder, &mut textures)?;
        }
        mesh.look.unlit = mesh.look.texture.is_some() || !mesh.colors.is_empty();
        mesh.origin_m = origin.unwrap_or_default();
        meshes.push(mesh);
    }
    placed(meshes, options, path)
}

/// Whether the file names a material library.
fn names_library(text: &str) -> bool {
    text.lines()
        .any(|line| line.trim_start().starts_with("mtllib "))
}

/// The coordinates of a line `v x y z …`, and the rest of it.
fn vertex(line: &str) -> Option<(DVec3, &str)> {
    let mut rest = line.trim_start().strip_prefix("v")?;
    rest.starts_with([' ', '\t']).then_some(())?;
    let mut r = [0.0; 3];
    for x in &mut r {
        rest = rest.trim_start();
        let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
        *x = rest[..end].parse().ok()?;
        rest = &rest[end..];
    }
    Some((r.into(), rest))
}

/// The first vertex, in whole numbers, where coordinates are too large for f32.
fn far_origin(text: &str) -> Option<DVec3> {
    let (first, _) = text.lines().find_map(vertex)?;
    (first.abs().max_element() > FAR_M).then(|| first.round())
}

/// The same file with coordinates about an origin.
fn about(text: &str, origin: DVec3) -> String {
    let mut out = String::with_capacity(text.len());
    for line in text.lines() {
        match vertex(line) {
            Some((r, rest)) => {
                let r = r - origin;
                // Writing to a string does not fail.
                let _ = write!(out, "v {:.6} {:.6} {:.6}{rest}", r.x, r.y, r.z);
            }
            None => out.push_str(line),
        }
        out.push('\n');
    }
    out
}

/// A mesh without its look.
fn converted(mesh: tobj::Mesh) -> Result<TexturedMesh, String> {
    let count = mesh.positions.len() / 3;
    let of_all = |list: &[f32], width: usize| list.len() == width * count;
    if mesh.indices.iter().any(|&i| i as usize >= count) {
        return Err("a face names a vertex that is not there".into());
    }
    let colors = (mesh.vertex_color.as_chunks::<3>().0.iter())
        .map(|&[r, g, b]| [linear(r), linear(g), linear(b), 1.0]);
    Ok(TexturedMesh {
        positions: mesh.positions.as_chunks::<3>().0.to_vec(),
        normals: if of_all(&mesh.normals, 3) {
            mesh.normals.as_chunks::<3>().0.to_vec()
        } else {
            Vec::new()
        },
        uv: if of_all(&mesh.texcoords, 2) {
            (mesh.texcoords.as_chunks::<2>().0.iter())
                .map(|&[u, v]| [u, 1.0 - v])
                .collect()
        } else {
            Vec::new()
        },
        colors: if of_all(&mesh.vertex_color, 3) {
            colors.collect()
        } else {
            Vec::new()
        },
        indices: mesh.indices,
        ..TexturedMesh::default()
    })
}

/// Colour and texture of a material. A texture takes the colour's place.
fn look(
    mesh: &mut TexturedMesh,
    material: &tobj::Material,
    folder: &Path,
    textures: &mut BTreeMap<PathBuf, Arc<Texture>>,
) -> Result<(), SourceError> {
    let alpha = material.dissolve.unwrap_or(1.0);
    let [r, g, b] = material.diffuse.unwrap_or([1.0; 3]).map(linear);
    mesh.look = Look {
        base_color: [r, g, b, alpha],
        ..Look::default()
    };
    let Some(name) = material
        .diffuse_texture
        .as_deref()
        .filter(|_| !mesh.uv.is_empty())
    else {
        return Ok(());
    };
    // Options may stand before the name; names have slashes of either kind.
    let name = name.trim().replace('\\', "/");
    let last = || name.split_whitespace().last().unwrap_or(&name);
    let mut path = folder.join(&name);
    if !path.exists() && name.starts_with('-') {
        path = folder.join(last());
    }
    let texture = match textures.get(&path) {
        Some(texture) => Arc::clone(texture),
        None => {
            let texture = picture(&path)?;
            textures.insert(path, Arc::clone(&texture));
            texture
        }
    };
    mesh.look.base_color = [1.0, 1.0, 1.0, alpha];
    mesh.look.texture = Some(texture);
    Ok(())
}
