//! Files made by hand, and what they show.

mod compression;
mod damage;
mod formats;
mod metadata;
mod models;
mod real;

use super::{Content, ContentError, UpAxis, decode};
use glam::DVec3;
use serde_json::{Value, json};

/// A content that refers to nothing.
fn alone(bytes: &[u8]) -> Result<Content, ContentError> {
    decode(bytes, UpAxis::Y, &|uri| {
        Err(format!("{uri} was not to be read"))
    })
}

/// Little-endian bytes.
macro_rules! bytes {
    ($kind:ty; $($x:expr),* $(,)?) => {{
        let all: &[$kind] = &[$($x),*];
        all.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>()
    }};
}
use bytes;

/// A glTF file under construction: binary data with a view and an accessor for each part.
#[derive(Default)]
struct Model {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Model {
    /// Adds an accessor of a kind of number, with its data; its number.
    fn add(&mut self, shape: &str, kind: u32, count: usize, data: &[u8]) -> usize {
        let view = self.view(data);
        let (view, normalized) = (json!(view), false);
        self.accessors.push(
            json!({"bufferView": view, "componentType": kind, "count": count,
            "type": shape, "normalized": normalized}),
        );
        self.accessors.len() - 1
    }

    /// Adds a buffer view; its number.
    fn view(&mut self, data: &[u8]) -> usize {
        while !self.bin.len().is_multiple_of(8) {
            self.bin.push(0);
        }
        let (at, length) = (self.bin.len(), data.len());
        self.views
            .push(json!({"buffer": 0, "byteOffset": at, "byteLength": length}));
        self.bin.extend(data);
        self.views.len() - 1
    }

    /// A .glb with the rest of its JSON.
    fn glb(&self, rest: Value) -> Vec<u8> {
        let mut root = json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}], "buffers": [{"byteLength": self.bin.len()}],
            "bufferViews": self.views, "accessors": self.accessors});
        let (root_map, rest) = (root.as_object_mut().unwrap(), rest);
        root_map.extend(rest.as_object().unwrap().clone());
        glb(&root, &self.bin)
    }
}

/// A .glb of JSON and binary data.
fn glb(json: &Value, bin: &[u8]) -> Vec<u8> {
    let pad = |mut data: Vec<u8>, with: u8| {
        while !data.len().is_multiple_of(4) {
            data.push(with);
        }
        data
    };
    let (json, bin) = (
        pad(json.to_string().into_bytes(), b' '),
        pad(bin.to_vec(), 0),
    );
    let length = 12 + 8 + json.len() + 8 + bin.len();
    let mut file = b"glTF".to_vec();
    file.extend(bytes![u32; 2, length as u32, json.len() as u32]);
    file.extend(b"JSON");
    file.extend(json);
    file.extend(bytes![u32; bin.len() as u32]);
    file.extend(b"BIN\0");
    file.extend(bin);
    file
}

/// The triangle (0, 0, 0), (1, 0, 0), (0, 2, 0) in glTF's axes.
const CORNERS: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0];

/// A model with that triangle, and its JSON's `meshes`.
fn triangle() -> (Model, Value) {
    let mut model = Model::default();
    let data: Vec<u8> = CORNERS.iter().flat_map(|x| x.to_le_bytes()).collect();
    let positions = model.add("VEC3", 5126, 3, &data);
    let meshes = json!([{"primitives": [{"attributes": {"POSITION": positions}}]}]);
    (model, meshes)
}

/// That triangle as a .glb.
fn triangle_glb() -> Vec<u8> {
    let (model, meshes) = triangle();
    model.glb(json!({ "meshes": meshes }))
}

/// A tile of 3D Tiles 1.0: what stands between its tables' lengths and them, its tables, and what follows.
fn tile(magic: &[u8; 4], more: &[u8], tables: [&[u8]; 4], body: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    for table in tables {
        file.extend(bytes![u32; table.len() as u32]);
    }
    file.extend(more);
    file.extend(tables.concat());
    file.extend(body);
    let mut all = magic.to_vec();
    all.extend(bytes![u32; 1, 12 + file.len() as u32]);
    all.extend(file);
    all
}

/// The corners of all triangles in the content's frame, in order [m].
fn corners(content: &Content) -> Vec<DVec3> {
    let mut found = Vec::new();
    for placed in &content.meshes {
        for to_content in &placed.placements {
            assert!(to_content.matrix3.determinant() > 0.0);
            let mesh = &placed.mesh;
            let at = |i: &u32| to_content.transform_point3(mesh.vertex_m(*i));
            found.extend(mesh.indices.iter().map(at));
        }
    }
    found
}

/// Asserts that points are where they should be, to a micrometre at these sizes.
#[track_caller]
fn near(found: &[DVec3], expected: &[[f64; 3]]) {
    assert_eq!(found.len(), expected.len(), "{found:?}");
    for (found, expected) in found.iter().zip(expected) {
        let expected = DVec3::from(*expected);
        assert!(
            (*found - expected).abs().max_element() < 1e-6,
            "{found} instead of {expected}"
        );
    }
}
