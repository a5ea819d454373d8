//! glTF and GLB, as the readers of tiles decode them.

use super::Layer;
use super::error::{Fault, SourceError, read_bytes};
use super::mesh::placed;
use super::options::Options;
use crate::tiles::content::{UpAxis, decode};
use crate::tiles::fetch::unescape;
use boresight_common::warning::Notes;
use boresight_models::shape::textured::{PlacedMesh, TexturedMesh};
use glam::{DAffine3, DVec3, Vec3};
use std::path::{Component, Path, PathBuf};

/// What mends a model of which nothing else is known.
const AGAIN: &str = "export it again as glTF 2.0 or GLB";

/// Its meshes as one surface, z up; light and unlit as the file says.
///
/// Fails where the file or what it refers to is missing or damaged, or where nothing says where it stands.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let bytes = read_bytes(path)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let fetch = |uri: &str| beside(folder, uri);
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    let content = decode(bytes, UpAxis::Y, &fetch).map_err(|error| {
        // Most faults end with what mends them.
        let said = error.fault.to_string();
        let (what, mend) = said.rsplit_once("; ").unwrap_or((&said, AGAIN));
        let place = format!("model, {}", error.place);
        Fault::new(place.trim_end_matches(", "), what, mend).of(path)
    })?;
    let mut notes = Notes::default();
    for note in &content.notes {
        notes.assume("model", note, "the rest is read");
    }
    let clouds = content.points.len();
    if clouds > 0 {
        notes.assume(
            "model",
            format!("{clouds} point clouds are left out"),
            "the rest is read",
        );
    }
    let features = content.features;
    let meshes = (content.meshes.iter())
        .flat_map(|placed| placed.placements.iter().map(|to| standing(placed, to)))
        .collect();
    let layer = placed(meshes, options, path, notes)?;
    Ok(Layer { features, ..layer })
}

/// A file inside the model's folder, by its URI: percent escapes and backslashes stand for what they mean.
fn beside(folder: &Path, uri: &str) -> Result<Vec<u8>, String> {
    let plain = |uri: &str| {
        let uri = uri.split(['?', '#']).next().unwrap_or(uri);
        let name = String::from_utf8_lossy(&unescape(uri)).replace('\\', "/");
        folder.join(name)
    };
    let inside = |path: &PathBuf| {
        let within = path.strip_prefix(folder).unwrap_or(path);
        let deep = within
            .components()
            .try_fold(0_usize, |deep, part| match part {
                Component::Normal(_) => Some(deep + 1),
                Component::CurDir => Some(deep),
                Component::ParentDir => deep.checked_sub(1),
                Component::RootDir | Component::Prefix(_) => None,
            });
        deep.is_some()
    };
    if uri.contains("://") {
        return Err("addresses are not fetched; put the file beside the model".into());
    }
    // A name may hold what looks like an escape.
    let literal = folder.join(uri);
    let path = if literal.is_file() {
        literal
    } else {
        plain(uri)
    };
    if !inside(&path) {
        return Err("it lies outside the model's folder".into());
    }
    read_bytes(&path).map_err(|error| match error {
        SourceError::Read { source, .. } => source.to_string(),
        SourceError::Content { fault, .. } => fault.what,
    })
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

#[cfg(test)]
mod tests;
