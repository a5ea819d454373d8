//! PLY meshes, ASCII or binary, read by `ply-rs-bw`: colours at vertices, or a texture as MeshLab writes it.

use super::Layer;
use super::error::{Fault, SourceError, read_bytes};
use super::mesh::{linear, picture, placed};
use super::options::Options;
use crate::models::shape::textured::TexturedMesh;
use glam::DVec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};
use std::path::Path;

const MEND: &str = "export it again as a triangle mesh with x, y and z of each vertex";

/// A vertex as the file has it.
#[derive(Clone, Debug)]
struct Vertex {
    place: [f64; 3],
    normal: Option<[f32; 3]>,
    /// Of 0..1, sRGB.
    color: Option<[f32; 4]>,
    uv: Option<[f32; 2]>,
}

/// A face as the file has it.
#[derive(Clone, Debug)]
struct Face {
    corners: Vec<u32>,
    /// Two for each corner.
    uv: Vec<f32>,
}

/// Any number.
fn number(property: &Property) -> Option<f64> {
    Some(match *property {
        Property::Char(x) => x.into(),
        Property::UChar(x) => x.into(),
        Property::Short(x) => x.into(),
        Property::UShort(x) => x.into(),
        Property::Int(x) => x.into(),
        Property::UInt(x) => x.into(),
        Property::Float(x) => x.into(),
        Property::Double(x) => x,
        _ => return None,
    })
}

/// The greatest value of a number's kind: what a whole colour is stored as.
fn full(property: &Property) -> f32 {
    match property {
        Property::UChar(_) => 255.0,
        Property::UShort(_) => 65535.0,
        _ => 1.0,
    }
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self {
            place: [f64::NAN; 3],
            normal: None,
            color: None,
            uv: None,
        }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(x) = number(&property) else {
            return PropertyAccessResult::Ignored;
        };
        let part = || (x as f32 / full(&property)).clamp(0.0, 1.0);
        match name {
            "x" => self.place[0] = x,
            "y" => self.place[1] = x,
            "z" => self.place[2] = x,
            "nx" => self.normal.get_or_insert_default()[0] = x as f32,
            "ny" => self.normal.get_or_insert_default()[1] = x as f32,
            "nz" => self.normal.get_or_insert_default()[2] = x as f32,
            "red" | "r" | "diffuse_red" => self.color.get_or_insert([1.0; 4])[0] = part(),
            "green" | "g" | "diffuse_green" => self.color.get_or_insert([1.0; 4])[1] = part(),
            "blue" | "b" | "diffuse_blue" => self.color.get_or_insert([1.0; 4])[2] = part(),
            "alpha" => self.color.get_or_insert([1.0; 4])[3] = part(),
            "s" | "u" | "texture_u" => self.uv.get_or_insert_default()[0] = x as f32,
            "t" | "v" | "texture_v" => self.uv.get_or_insert_default()[1] = x as f32,
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self {
            corners: Vec::new(),
            uv: Vec::new(),
        }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        /// A negative number names no vertex.
        fn whole<T: TryInto<u32>>(list: Vec<T>) -> Vec<u32> {
            list.into_iter()
                .map(|i| i.try_into().unwrap_or(u32::MAX))
                .collect()
        }
        match (name, property) {
            ("vertex_indices" | "vertex_index", list) => {
                self.corners = match list {
                    Property::ListChar(list) => whole(list),
                    Property::ListUChar(list) => whole(list),
                    Property::ListShort(list) => whole(list),
                    Property::ListUShort(list) => whole(list),
                    Property::ListInt(list) => whole(list),
                    Property::ListUInt(list) => list,
                    _ => return PropertyAccessResult::UnsupportedType,
                }
            }
            ("texcoord", Property::ListFloat(list)) => self.uv = list,
            ("texcoord", Property::ListDouble(list)) => {
                self.uv = list.into_iter().map(|x| x as f32).collect();
            }
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

/// An element that is of no use here.
struct Other;

impl PropertyAccess for Other {
    fn new() -> Self {
        Self
    }
}

/// A mesh with colours or a texture, as one surface. Both are taken to hold the light already.
///
/// Fails where the file or its texture is missing or damaged, has no faces, or where nothing says where it stands.
pub fn read(path: &Path, options: &Options) -> Result<Layer, SourceError> {
    let bytes = read_bytes(path)?;
    let mesh = parsed(&bytes, path)?;
    placed(vec![mesh], options, path)
}

/// The file's mesh.
fn parsed(bytes: &[u8], path: &Path) -> Result<TexturedMesh, SourceError> {
    let fault = |what: String| Fault::new("PLY", what, MEND).of(path);
    let mut reader = Reader::new(bytes);
    let header = Parser::<Vertex>::new().read_header(&mut reader);
    let header = header.map_err(|error| fault(error.to_string()))?;
    let (mut vertices, mut faces): (Vec<Vertex>, Vec<Face>) = Default::default();
    for (name, element) in &header.elements {
        // Every row has at least a byte.
        if element.count > bytes.len() {
            let what = format!("{} of '{name}' in {} bytes", element.count, bytes.len());
            return Err(fault(what));
        }
        let read = match name.as_str() {
            "vertex" => Parser::new()
                .read_payload_for_element(&mut reader, element, &header)
                .map(|read| vertices = read),
            "face" => Parser::new()
                .read_payload_for_element(&mut reader, element, &header)
                .map(|read| faces = read),
            _ => Parser::<Other>::new()
                .read_payload_for_element(&mut reader, element, &header)
                .map(|_| ()),
        };
        read.map_err(|error| fault(error.to_string()))?;
    }
    let named = header.comments.iter().find_map(|comment| {
        let (key, name) = comment.trim().split_once(' ')?;
        key.eq_ignore_ascii_case("TextureFile")
            .then_some(name.trim())
    });
    let mut mesh = joined(&vertices, &faces).map_err(fault)?;
    if let Some(name) = named.filter(|_| !mesh.uv.is_empty()) {
        let folder = path.parent().unwrap_or(Path::new("."));
        mesh.look.texture = Some(picture(&folder.join(name))?);
    }
    mesh.look.unlit = mesh.look.texture.is_some() || !mesh.colors.is_empty();
    Ok(mesh)
}

/// Vertices and faces as a mesh; a corner with a place of its own in the texture is a vertex of its own.
fn joined(vertices: &[Vertex], faces: &[Face]) -> Result<TexturedMesh, String> {
    let origin_m = vertices
        .first()
        .map_or(DVec3::ZERO, |v| DVec3::from(v.place).round());
    let by_face = faces.iter().any(|face| !face.uv.is_empty());
    let (normals, colors) = (
        vertices.iter().all(|v| v.normal.is_some()),
        vertices.iter().all(|v| v.color.is_some()),
    );
    let uv = by_face || vertices.iter().all(|v| v.uv.is_some());
    let mut mesh = TexturedMesh {
        origin_m,
        ..TexturedMesh::default()
    };
    let mut add = |vertex: &Vertex, place: [f32; 2]| {
        let at = DVec3::from(vertex.place) - origin_m;
        mesh.positions.push(at.as_vec3().to_array());
        if normals {
            mesh.normals.push(vertex.normal.unwrap_or_default());
        }
        if colors {
            let [r, g, b, a] = vertex.color.unwrap_or_default();
            mesh.colors.push([linear(r), linear(g), linear(b), a]);
        }
        if uv {
            mesh.uv.push([place[0], 1.0 - place[1]]);
        }
        mesh.positions.len() as u32 - 1
    };
    if !by_face {
        for vertex in vertices {
            add(vertex, vertex.uv.unwrap_or_default());
        }
    }
    let mut indices = Vec::new();
    for (k, face) in faces.iter().enumerate() {
        let mut corners = Vec::with_capacity(face.corners.len());
        for (c, &i) in face.corners.iter().enumerate() {
            let vertex = (vertices.get(i as usize))
                .ok_or_else(|| format!("face {k} names a vertex that is not there"))?;
            corners.push(if by_face {
                let place = |k: usize| face.uv.get(2 * c + k).copied().unwrap_or_default();
                add(vertex, [place(0), place(1)])
            } else {
                i
            });
        }
        for pair in corners.windows(2).skip(1) {
            indices.extend([corners[0], pair[0], pair[1]]);
        }
    }
    if indices.is_empty() {
        return Err("no faces: it is a point cloud".into());
    }
    mesh.indices = indices;
    Ok(mesh)
}
