//! glTF and GLB, as the readers of tiles decode them.

use super::Layer;
use super::error::{Fault, SourceError, read_bytes};
use super::mesh::placed;
use super::options::Options;
use crate::models::shape::textured::{PlacedMesh, TexturedMesh};
use crate::tiles::content::{UpAxis, decode};
use glam::{DAffine3, DVec3, Vec3};
use std::path::{Component, Path};

/// Its meshes as one surface, z up; light and unlit as the file says.
///
/// Fails where the file or what it refers to is missing or damaged, or where nothing says where it stands.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let bytes = read_bytes(path)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let fetch = |uri: &str| -> Result<Vec<u8>, String> {
        let name = Path::new(uri);
        let inside = |part: Component| matches!(part, Component::Normal(_) | Component::CurDir);
        if !name.components().all(inside) {
            return Err(format!("{uri}: it lies outside the model's folder"));
        }
        read_bytes(&folder.join(name)).map_err(|error| error.to_string())
    };
    let content = decode(&bytes, UpAxis::Y, &fetch).map_err(|error| {
        let mend = "export it again as glTF 2.0 or GLB";
        Fault::new("model", error, mend).of(path)
    })?;
    let features = content.features;
    let meshes = (content.meshes.iter())
        .flat_map(|placed| placed.placements.iter().map(|to| standing(placed, to)))
        .collect();
    let layer = placed(meshes, options, path)?;
    Ok(Layer { features, ..layer })
}

/// A mesh at one of its places.
fn standing(placed: &PlacedMesh, to: &DAffine3) -> TexturedMesh {
    let mesh = &*placed.mesh;
    let mut out = mesh.clone();
    let origin_m = to.transform_point3(mesh.origin_m);
    let place = |p: &[f32; 3]| {
        let at = to.transform_vector3(Vec3::from(*p).as_dvec3());
        at.as_vec3().to_array()
    };
    let turn = to.matrix3.inverse().transpose();
    let turned = |n: &[f32; 3]| {
        let n = turn * Vec3::from(*n).as_dvec3();
        n.normalize_or(DVec3::Z).as_vec3().to_array()
    };
    out.origin_m = origin_m;
    out.positions = mesh.positions.iter().map(place).collect();
    out.normals = mesh.normals.iter().map(turned).collect();
    if to.matrix3.determinant() < 0.0 {
        for triangle in out.indices.as_chunks_mut::<3>().0 {
            triangle.swap(1, 2);
        }
    }
    out
}
