//! Wavefront OBJ with its materials (MTL): what photogrammetry programs and modellers write.

mod material;
mod parse;

use super::Layer;
use super::error::{Fault, SourceError, read_bytes};
use super::mesh::{linear, picture, placed, triangles, upright};
use super::options::Options;
use boresight_common::warning::Notes;
use boresight_models::shape::textured::{Look, Texture, TexturedMesh};
use earcut::Earcut;
use glam::DVec3;
use material::{Map, Material};
use parse::{NONE, Wavefront};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const MEND: &str = "export it again, with faces over vertices that are numbers";

/// A mesh with its textures, as one surface. Colours and textures are taken to hold the light already.
///
/// Records that are damaged, and libraries and textures that are missing, are left out and said in the layer's warnings.
/// Fails where no face is left, or where nothing says where it stands.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let bytes = read_bytes(path)?;
    let mut notes = Notes::default();
    let text = String::from_utf8_lossy(&bytes);
    let mut found = Wavefront::parse(&text, &mut notes);
    drop(text);
    drop(bytes);
    if found.faces.is_empty() {
        let what = match notes.count_left_out() {
            0 => "no faces".to_string(),
            n => format!(
                "no faces: {n} statements are no numbers or name vertices that are not there"
            ),
        };
        return Err(Fault::new("OBJ", what, MEND).of(path));
    }
    in_units(&mut found.colors, &mut notes);
    let folder = path.parent().unwrap_or(Path::new("."));
    let materials = materials(&found, folder, &mut notes);
    let mut textures = Textures {
        folder,
        read: BTreeMap::new(),
    };
    let mut meshes = Vec::new();
    for ([material, _], mesh) in split(&found, &mut notes) {
        let mut mesh = mesh;
        if let Some(material) = materials.get(material as usize) {
            look(&mut mesh, material, &mut textures, &mut notes);
        }
        mesh.look.unlit = mesh.look.texture.is_some() || !mesh.colors.is_empty();
        meshes.push(mesh);
    }
    upright(&mut meshes, options, path, &mut notes)?;
    placed(meshes, options, path, notes)
}

/// Brings colours of vertices to 0..1: some programs write 0..255.
fn in_units(colors: &mut [Option<[f32; 3]>], notes: &mut Notes) {
    let most = colors
        .iter()
        .flatten()
        .flatten()
        .fold(0.0_f32, |a, b| a.max(*b));
    if most > 1.0 {
        let what = format!("colours of vertices up to {most}, taken as of 0 to 255");
        notes.assume("v", what, "write them as 0 to 1");
        for color in colors.iter_mut().flatten() {
            *color = color.map(|x| x / 255.0);
        }
    }
}

/// The materials that the file uses, by their numbers there; plain ones where no library has them.
fn materials(found: &Wavefront, folder: &Path, notes: &mut Notes) -> Vec<Material> {
    let mut known = BTreeMap::new();
    for line in &found.libraries {
        let mut take = |name: &str, notes: &mut Notes| {
            let name = name.trim_matches('"').replace('\\', "/");
            let bytes = std::fs::read(folder.join(name));
            bytes.map(|bytes| material::parse(&String::from_utf8_lossy(&bytes), &mut known, notes))
        };
        // The line names one file, perhaps with spaces, or several.
        if take(line, notes).is_err() {
            for name in line.split_ascii_whitespace() {
                if let Err(error) = take(name, notes) {
                    notes.leave_out("material libraries", format!("{line}: {error}"));
                }
            }
        }
    }
    let mut one = |name: &String| {
        known.get(name).cloned().unwrap_or_else(|| {
            notes.leave_out("materials that no library has, of plain colour", name);
            Material::default()
        })
    };
    found.materials.iter().map(&mut one).collect()
}

/// What tells meshes apart: the material, and whether corners have places in a texture (1) and normals (2).
type Kind = [u32; 2];

/// A mesh in the making.
#[derive(Default)]
struct Part {
    numbers: HashMap<[u32; 3], u32>,
    corners: Vec<[u32; 3]>,
    indices: Vec<u32>,
}

/// The faces as triangles, a mesh for each material.
fn split(found: &Wavefront, notes: &mut Notes) -> Vec<(Kind, TexturedMesh)> {
    let mut parts: BTreeMap<Kind, Part> = BTreeMap::new();
    let mut scratch = Earcut::new();
    for (k, (face, material)) in found.faces().enumerate() {
        let has = |axis: usize| face.iter().all(|corner| corner[axis] != NONE);
        let [uv, normals] = [has(1), has(2)];
        let part = parts
            .entry([material, u32::from(uv) + 2 * u32::from(normals)])
            .or_default();
        let place = |corner: &[u32; 3]| found.places[corner[0] as usize];
        let places: Vec<DVec3> = face.iter().map(place).collect();
        let triangles = triangles(&places, &mut scratch);
        if triangles.is_empty() {
            notes.leave_out("faces without an area", format!("face {}", k + 1));
        }
        for corner in triangles.into_iter().flatten() {
            let [vertex, at, normal] = face[corner];
            let key = [
                vertex,
                if uv { at } else { NONE },
                if normals { normal } else { NONE },
            ];
            let index = *part.numbers.entry(key).or_insert_with(|| {
                part.corners.push(key);
                part.corners.len() as u32 - 1
            });
            part.indices.push(index);
        }
    }
    let meshes = parts
        .into_iter()
        .filter(|(_, part)| !part.indices.is_empty());
    meshes
        .map(|(kind, part)| (kind, meshed(found, part, kind)))
        .collect()
}

/// A part as a mesh without its look, about one of its own vertices: places are far from the file's origin.
fn meshed(found: &Wavefront, part: Part, [_, has]: Kind) -> TexturedMesh {
    // One in the middle of the list: the first may be a dummy far off.
    let middle = part.indices[part.indices.len() / 2] as usize;
    let origin_m: DVec3 = found.places[part.corners[middle][0] as usize].round();
    let positions = part.corners.iter().map(|corner| {
        let r_m = found.places[corner[0] as usize] - origin_m;
        r_m.as_vec3().to_array()
    });
    let colors: Option<Vec<[f32; 4]>> = (part.corners.iter())
        .map(|corner| {
            let [r, g, b] = found.colors.get(corner[0] as usize).copied().flatten()?;
            Some([linear(r), linear(g), linear(b), 1.0])
        })
        .collect();
    let uv = part.corners.iter().filter(|_| has & 1 != 0).map(|corner| {
        let [u, v] = found.uvs[corner[1] as usize];
        [u, 1.0 - v]
    });
    let normals = (part.corners.iter().filter(|_| has & 2 != 0))
        .map(|corner| found.normals[corner[2] as usize]);
    TexturedMesh {
        origin_m,
        positions: positions.collect(),
        normals: normals.collect(),
        uv: uv.collect(),
        colors: colors.unwrap_or_default(),
        indices: part.indices,
        ..TexturedMesh::default()
    }
}

/// Pictures that were read, or why they were not.
struct Textures<'f> {
    folder: &'f Path,
    read: BTreeMap<PathBuf, Option<Arc<Texture>>>,
}

impl Textures<'_> {
    /// A texture; `None`, and said to the notes, where it is missing or damaged.
    fn get(&mut self, map: &Map, notes: &mut Notes) -> Option<Arc<Texture>> {
        let beside = self.folder.join(&map.name);
        // Names are often those of the machine that wrote them.
        let path = match beside.exists() {
            true => beside,
            false => self
                .folder
                .join(map.name.rsplit('/').next().unwrap_or(&map.name)),
        };
        let read = || match picture(&path) {
            Ok(texture) => Some(texture),
            Err(error) => {
                notes.leave_out("textures, in whose place stands the colour", error);
                None
            }
        };
        self.read.entry(path.clone()).or_insert_with(read).clone()
    }
}

/// Colour and texture of a material. A texture takes the colour's place.
fn look(mesh: &mut TexturedMesh, material: &Material, textures: &mut Textures, notes: &mut Notes) {
    let [r, g, b] = material.color.map(linear);
    mesh.look = Look {
        base_color: [r, g, b, material.alpha],
        ..Look::default()
    };
    let Some(map) = material.texture.as_ref().filter(|_| !mesh.uv.is_empty()) else {
        return;
    };
    let Some(texture) = textures.get(map, notes) else {
        return;
    };
    for [u, v] in &mut mesh.uv {
        *u = *u * map.scale[0] + map.offset[0];
        *v = 1.0 - ((1.0 - *v) * map.scale[1] + map.offset[1]);
    }
    mesh.look.base_color = [1.0, 1.0, 1.0, material.alpha];
    mesh.look.texture = Some(texture);
}

#[cfg(test)]
mod tests;
