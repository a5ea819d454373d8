//! PLY meshes, ASCII or binary: colours at vertices or faces, or textures as MeshLab writes them.

mod parse;

use super::Layer;
use super::error::{Fault, SourceError, read_bytes};
use super::mesh::{linear, picture, placed, triangles, upright};
use super::options::Options;
use boresight_common::warning::Notes;
use boresight_models::shape::textured::TexturedMesh;
use earcut::Earcut;
use glam::DVec3;
use parse::{Element, Row};
use std::collections::BTreeMap;
use std::path::Path;

const MEND: &str = "export it again as a triangle mesh with x, y and z of each vertex";

/// A vertex as the file has it.
#[derive(Clone, Copy, Debug)]
struct Vertex {
    place: DVec3,
    normal: [f32; 3],
    /// As the file has it.
    color: [f32; 4],
    uv: [f32; 2],
}

/// What a file holds.
#[derive(Debug, Default)]
struct Model {
    vertices: Vec<Vertex>,
    /// Whether vertices have normals, colours, places in a texture.
    has: [bool; 3],
    /// Vertices of all faces, one face behind the other.
    corners: Vec<u32>,
    faces: Vec<Face>,
    /// Places in the texture, two numbers for each of `corners`; empty where faces have none.
    uv: Vec<f32>,
    /// Names of textures.
    textures: Vec<String>,
}

/// A face as the file has it.
#[derive(Clone, Copy, Debug)]
struct Face {
    /// Where its corners begin.
    start: usize,
    /// The number of its texture.
    texture: u32,
    /// As the file has it.
    color: Option<[f32; 4]>,
}

/// A mesh with colours or textures, as one surface. Both are taken to hold the light already.
///
/// Faces that are damaged and textures that are missing are left out and said in the layer's warnings. Fails where the file is damaged,
/// has no faces, or where nothing says where it stands.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let bytes = read_bytes(path)?;
    let mut notes = Notes::default();
    let model = model(&bytes, &mut notes);
    let model = model.map_err(|what| Fault::new("PLY", what, MEND).of(path))?;
    drop(bytes);
    let mut meshes = meshes(&model, path, &mut notes);
    if meshes.is_empty() {
        let what = format!("all {} faces are left out", model.faces.len());
        return Err(Fault::new("PLY", what, MEND).of(path));
    }
    upright(&mut meshes, options, path, &mut notes)?;
    placed(meshes, options, path, notes)
}

/// What the file holds.
fn model(bytes: &[u8], notes: &mut Notes) -> Result<Model, String> {
    let (header, mut rows) = parse::header(bytes)?;
    let mut found = Model::default();
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => rows.read(element, vertices(element, &mut found, notes))?,
            "face" => rows.read(element, faces(element, &mut found))?,
            "tristrips" => rows.read(element, strips(element, &mut found))?,
            name => {
                rows.read(element, |_| {})?;
                if element.count > 0 {
                    let what = format!("{} rows of '{name}' are not read", element.count);
                    notes.assume(
                        "elements",
                        what,
                        "the surface is that of 'vertex' and 'face'",
                    );
                }
            }
        }
    }
    if found.faces.is_empty() {
        return Err("no faces: it is a point cloud".into());
    }
    let texture = |comment: &String| {
        let (key, name) = comment.split_once(char::is_whitespace)?;
        key.eq_ignore_ascii_case("TextureFile")
            .then(|| name.trim().to_string())
    };
    found.textures = header.comments.iter().filter_map(texture).collect();
    in_units(&mut found, header.elements.iter(), notes);
    if !header.is_text() {
        precision(&found, &header.elements, notes);
    }
    Ok(found)
}

/// Where an element has the first of some properties.
fn index(element: &Element, names: &[&str]) -> Option<usize> {
    let find = |name: &&str| {
        element
            .properties
            .iter()
            .position(|property| property.name == *name)
    };
    names.iter().find_map(find)
}

/// The properties of a colour.
const COLOR: [[&str; 4]; 4] = [
    ["red", "r", "diffuse_red", "Red"],
    ["green", "g", "diffuse_green", "Green"],
    ["blue", "b", "diffuse_blue", "Blue"],
    ["alpha", "a", "diffuse_alpha", "Alpha"],
];

/// Takes in rows of vertices.
fn vertices<'m>(
    element: &Element,
    found: &'m mut Model,
    notes: &mut Notes,
) -> impl FnMut(&Row) + use<'m> {
    let place = ["x", "y", "z"].map(|name| index(element, &[name]));
    let normal = ["nx", "ny", "nz"].map(|name| index(element, &[name]));
    let color = COLOR.map(|names| index(element, &names));
    let uv = [
        index(element, &["s", "u", "texture_u", "texture_s"]),
        index(element, &["t", "v", "texture_v", "texture_t"]),
    ];
    found.has = [
        normal.iter().all(Option::is_some),
        color[..3].iter().all(Option::is_some),
        uv.iter().all(Option::is_some),
    ];
    if place.contains(&None) {
        notes.assume("vertex", "not all of x, y and z are there", MEND);
    }
    move |row: &Row| {
        let number = |at: Option<usize>| at.and_then(|at| row.get(at).first().copied());
        let part = |at: Option<usize>, plain: f64| number(at).unwrap_or(plain) as f32;
        found.vertices.push(Vertex {
            place: place.map(|at| number(at).unwrap_or(f64::NAN)).into(),
            normal: normal.map(|at| part(at, 0.0)),
            color: color.map(|at| part(at, f64::NAN)),
            uv: uv.map(|at| part(at, 0.0)),
        });
    }
}

/// A number as an index; one that is none names no vertex.
fn whole(number: &f64) -> u32 {
    match number.fract() == 0.0 && (0.0..f64::from(u32::MAX)).contains(number) {
        true => *number as u32,
        false => u32::MAX,
    }
}

/// Takes in rows of faces.
fn faces<'m>(element: &Element, found: &'m mut Model) -> impl FnMut(&Row) + use<'m> {
    let corners = index(
        element,
        &["vertex_indices", "vertex_index", "vertex_indexes"],
    );
    let uv = index(element, &["texcoord"]);
    let texture = index(element, &["texnumber"]);
    let color = COLOR.map(|names| index(element, &names));
    move |row: &Row| {
        let list = |at: Option<usize>| at.map_or(&[][..], |at| row.get(at));
        let start = found.corners.len();
        found.corners.extend(list(corners).iter().map(whole));
        if uv.is_some() {
            let mut each = list(uv).iter().map(|x| *x as f32);
            let count = 2 * (found.corners.len() - start);
            found
                .uv
                .extend((0..count).map(|_| each.next().unwrap_or_default()));
        }
        let part = |at: Option<usize>| list(at).first().map_or(f32::NAN, |x| *x as f32);
        found.faces.push(Face {
            start,
            texture: list(texture).first().map_or(0, whole),
            color: color[..3]
                .iter()
                .all(Option::is_some)
                .then(|| color.map(part)),
        });
    }
}

/// Takes in strips of triangles, which numbers below 0 part.
fn strips<'m>(element: &Element, found: &'m mut Model) -> impl FnMut(&Row) + use<'m> {
    let corners = index(element, &["vertex_indices", "vertex_index"]);
    move |row: &Row| {
        let all = corners.map_or(&[][..], |at| row.get(at));
        for strip in all.split(|number| *number < 0.0) {
            for (k, triangle) in strip.windows(3).enumerate() {
                let [a, b, c] = [0, 1, 2].map(|i| whole(&triangle[i]));
                if a == b || b == c || a == c {
                    continue;
                }
                let start = found.corners.len();
                found
                    .corners
                    .extend(if k % 2 == 0 { [a, b, c] } else { [b, a, c] });
                found.faces.push(Face {
                    start,
                    texture: 0,
                    color: None,
                });
            }
        }
    }
}

/// Coarser steps than this between coordinates are said [unit of the file].
const COARSE: f64 = 0.01;

/// Notes places whose digits 32 bits do not hold: the file was written so.
fn precision(found: &Model, elements: &[Element], notes: &mut Notes) {
    let vertex = elements.iter().find(|element| element.name == "vertex");
    let kind = vertex.and_then(|vertex| Some(vertex.properties[index(vertex, &["x"])?].kind));
    let far = (found.vertices.iter()).fold(0.0_f64, |far, v| far.max(v.place.abs().max_element()));
    let step = far * f64::from(f32::EPSILON);
    if kind == Some(parse::Kind::F32) && step > COARSE {
        let what = format!(
            "numbers of 32 bits hold coordinates up to {far:.0} in steps of {step:.2} alone"
        );
        notes.assume(
            "vertex",
            what,
            "export doubles, or take an offset off first",
        );
    }
}

/// Brings colours to 0..1 by the kind of their numbers, or by their size where floats are of 0 to 255.
fn in_units<'e>(found: &mut Model, elements: impl Iterator<Item = &'e Element>, notes: &mut Notes) {
    for element in elements {
        let Some(at) = index(element, &COLOR[0]) else {
            continue;
        };
        let kind = element.properties[at].kind;
        let mut colors: Vec<&mut [f32; 4]> = match element.name.as_str() {
            "vertex" => found
                .vertices
                .iter_mut()
                .map(|vertex| &mut vertex.color)
                .collect(),
            "face" => found
                .faces
                .iter_mut()
                .filter_map(|face| face.color.as_mut())
                .collect(),
            _ => continue,
        };
        let most = colors
            .iter()
            .flat_map(|color| color.iter())
            .fold(0.0_f32, |a, b| a.max(*b));
        let full = match kind {
            parse::Kind::U16 => 65535.0,
            kind if !kind.is_float() || most > 1.0 => 255.0,
            _ => 1.0,
        };
        if kind.is_float() && most > 1.0 {
            let what = format!("colours up to {most}, taken as of 0 to 255");
            notes.assume(&element.name, what, "write them as 0 to 1");
        }
        for part in colors.iter_mut().flat_map(|color| color.iter_mut()) {
            // What a colour lacks is full: that is its alpha.
            *part = if part.is_nan() {
                1.0
            } else {
                (*part / full).clamp(0.0, 1.0)
            };
        }
    }
}

/// A mesh in the making.
#[derive(Default)]
struct Part {
    /// Corners of the file's list that are vertices of their own, or vertices of the file.
    sources: Vec<(u32, u32)>,
    numbers: BTreeMap<(u32, u32), u32>,
    indices: Vec<u32>,
}

/// Its faces as triangles, a mesh for each texture. A corner with a place of its own in the texture, or a colour of its face, is a vertex of its own.
fn meshes(model: &Model, path: &Path, notes: &mut Notes) -> Vec<TexturedMesh> {
    let shared = u32::MAX;
    let mut parts: BTreeMap<u32, Part> = BTreeMap::new();
    let mut scratch = Earcut::new();
    for (k, face) in model.faces.iter().enumerate() {
        let end = model
            .faces
            .get(k + 1)
            .map_or(model.corners.len(), |next| next.start);
        let corners = &model.corners[face.start..end];
        let places: Option<Vec<DVec3>> = (corners.iter())
            .map(|&i| Some(model.vertices.get(i as usize)?.place).filter(|place| place.is_finite()))
            .collect();
        let place = || format!("face {k}");
        let Some(places) = places else {
            notes.leave_out(
                "faces with a vertex that is not there or no number",
                place(),
            );
            continue;
        };
        if places.len() < 3 {
            notes.leave_out("faces of fewer than three corners", place());
            continue;
        }
        let triangles = triangles(&places, &mut scratch);
        if triangles.is_empty() {
            notes.leave_out("faces without an area", place());
        }
        let own = !model.uv.is_empty() || face.color.is_some();
        let part = parts.entry(face.texture).or_default();
        for corner in triangles.into_iter().flatten() {
            let at = (face.start + corner) as u32;
            let key = (corners[corner], if own { at } else { shared });
            let number = *part.numbers.entry(key).or_insert_with(|| {
                part.sources
                    .push((key.0, if own { k as u32 } else { shared }));
                part.sources.len() as u32 - 1
            });
            part.indices.push(number);
        }
    }
    let whole = parts
        .into_iter()
        .filter(|(_, part)| !part.indices.is_empty());
    whole
        .map(|(texture, part)| meshed(model, &part, texture, path, notes))
        .collect()
}

/// A part as a mesh, about one of its own vertices: places are far from the file's origin.
fn meshed(
    model: &Model,
    part: &Part,
    texture: u32,
    path: &Path,
    notes: &mut Notes,
) -> TexturedMesh {
    let middle = part.indices[part.indices.len() / 2] as usize;
    let vertex = |source: &(u32, u32)| &model.vertices[source.0 as usize];
    let origin_m = vertex(&part.sources[middle]).place.round();
    let mut mesh = TexturedMesh {
        origin_m,
        indices: part.indices.clone(),
        ..TexturedMesh::default()
    };
    let mut places = vec![[0.0; 2]; part.sources.len()];
    for (key, number) in &part.numbers {
        let at = 2 * key.1 as usize;
        if let Some(place) = model.uv.get(at..at.saturating_add(2)) {
            places[*number as usize] = [place[0], place[1]];
        }
    }
    let by_face = !model.uv.is_empty();
    let colored = part.sources.iter().any(|source| {
        model
            .faces
            .get(source.1 as usize)
            .is_some_and(|face| face.color.is_some())
    });
    for (source, place) in part.sources.iter().zip(places) {
        let vertex = vertex(source);
        mesh.positions
            .push((vertex.place - origin_m).as_vec3().to_array());
        if model.has[0] {
            mesh.normals.push(vertex.normal);
        }
        let face = model
            .faces
            .get(source.1 as usize)
            .and_then(|face| face.color);
        if model.has[1] || colored {
            let plain = if model.has[1] { vertex.color } else { [1.0; 4] };
            let [r, g, b, a] = face.filter(|_| !model.has[1]).unwrap_or(plain);
            mesh.colors.push([linear(r), linear(g), linear(b), a]);
        }
        if by_face || model.has[2] {
            let [u, v] = if by_face { place } else { vertex.uv };
            mesh.uv.push([u, 1.0 - v]);
        }
    }
    if let Some(name) = model
        .textures
        .get(texture as usize)
        .filter(|_| !mesh.uv.is_empty())
    {
        let folder = path.parent().unwrap_or(Path::new("."));
        match picture(&folder.join(name.replace('\\', "/"))) {
            Ok(texture) => mesh.look.texture = Some(texture),
            Err(error) => notes.leave_out("textures", error),
        }
    }
    mesh.look.unlit = mesh.look.texture.is_some() || !mesh.colors.is_empty();
    mesh
}

#[cfg(test)]
mod tests;
