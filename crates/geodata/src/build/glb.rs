//! A tile's content as a binary glTF (Khronos glTF 2.0), with features and their properties.

use super::atlas::Atlas;
use super::mesh::{Material, Mesh, Scene};
use super::options::{BuildOptions, Pictures};
use super::pictures::encode;
use super::report::BuildError;
use super::table::Table;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Component types of accessors (glTF 2.0, 3.6.2.2).
const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;

/// Which picture triangles show.
#[derive(Clone, Copy, PartialEq)]
enum Paint {
    Plain,
    Atlas,
    Tiled(usize),
}

/// What triangles of one primitive have in common.
#[derive(Clone, Copy, PartialEq)]
struct Class {
    paint: Paint,
    look: Material,
}

/// The binary chunk and the lists that point into it.
#[derive(Default)]
struct Parts {
    bytes: Vec<u8>,
    /// Length of what compressed views decode to.
    decoded: usize,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshopt: bool,
}

impl Parts {
    /// Stores bytes as they are, at a multiple of eight.
    fn raw(&mut self, data: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(8), 0);
        self.views.push(json!({
            "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": data.len(),
        }));
        self.bytes.extend_from_slice(data);
        self.views.len() - 1
    }

    /// Stores what vertices or indices consist of; `packed` holds it compressed, in this mode.
    fn geometry(
        &mut self,
        data: &[u8],
        stride: usize,
        indices: bool,
        packed: impl FnOnce() -> Result<Vec<u8>, meshopt::Error>,
    ) -> Result<usize, meshopt::Error> {
        let target = if indices { 34963 } else { 34962 };
        if !self.meshopt {
            let view = self.raw(data);
            self.views[view]["target"] = json!(target);
            if !indices {
                self.views[view]["byteStride"] = json!(stride);
            }
            return Ok(view);
        }
        let packed = packed()?;
        let view = self.raw(&packed);
        self.decoded = self.decoded.next_multiple_of(8);
        let mode = if indices { "TRIANGLES" } else { "ATTRIBUTES" };
        let mut value = json!({
            "buffer": 1, "byteOffset": self.decoded, "byteLength": data.len(), "target": target,
            "extensions": { "EXT_meshopt_compression": {
                "buffer": 0, "byteOffset": self.bytes.len() - packed.len(), "byteLength": packed.len(),
                "byteStride": stride, "count": data.len() / stride, "mode": mode,
            }},
        });
        if !indices {
            value["byteStride"] = json!(stride);
        }
        self.decoded += data.len();
        self.views[view] = value;
        Ok(view)
    }

    /// Stores one number list a vertex.
    fn attribute<const N: usize>(&mut self, list: &[[f32; N]]) -> Result<usize, meshopt::Error> {
        let data: Vec<u8> = list
            .as_flattened()
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let packed = || meshopt::encode_vertex_buffer_level(list, 2, Some(0));
        let view = self.geometry(&data, size_of::<[f32; N]>(), false, packed)?;
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"][N];
        self.accessors.push(json!({
            "bufferView": view, "componentType": F32, "count": list.len(), "type": kind,
        }));
        Ok(self.accessors.len() - 1)
    }

    fn colors(&mut self, list: &[[u16; 4]]) -> Result<usize, meshopt::Error> {
        let data: Vec<u8> = list
            .as_flattened()
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let packed = || meshopt::encode_vertex_buffer_level(list, 2, Some(0));
        let view = self.geometry(&data, size_of::<[u16; 4]>(), false, packed)?;
        self.accessors.push(json!({
            "bufferView": view, "componentType": U16, "normalized": true, "count": list.len(), "type": "VEC4",
        }));
        Ok(self.accessors.len() - 1)
    }

    fn indices(&mut self, list: &[u32], vertices: usize) -> Result<usize, meshopt::Error> {
        let short = vertices <= usize::from(u16::MAX);
        let data: Vec<u8> = if short {
            list.iter()
                .flat_map(|&i| (i as u16).to_le_bytes())
                .collect()
        } else {
            list.iter().flat_map(|i| i.to_le_bytes()).collect()
        };
        let stride = if short { 2 } else { 4 };
        let packed = || meshopt::encode_index_buffer(list, vertices);
        let view = self.geometry(&data, stride, true, packed)?;
        self.accessors.push(json!({
            "bufferView": view, "componentType": if short { U16 } else { U32 }, "count": list.len(),
            "type": "SCALAR",
        }));
        Ok(self.accessors.len() - 1)
    }
}

/// Triangles of one class, with vertices of their own in the order of their use.
struct Primitive {
    class: Class,
    indices: Vec<u32>,
    /// Vertices of the tile's mesh.
    vertices: Vec<u32>,
}

/// Sorts the triangles by class, in the order of the materials.
fn primitives(scene: &Scene, mesh: &Mesh) -> Vec<Primitive> {
    let mut classes: Vec<(Class, Vec<u32>)> = Vec::new();
    let class_of: Vec<usize> = (scene.materials.iter())
        .map(|material| {
            let paint = match material.texture {
                None => Paint::Plain,
                Some(texture) if material.tiled => Paint::Tiled(texture),
                Some(_) => Paint::Atlas,
            };
            let look = Material {
                texture: None,
                tiled: false,
                wraps: false,
                plain: 0,
                ..*material
            };
            let class = Class { paint, look };
            let found = classes.iter().position(|(known, _)| *known == class);
            found.unwrap_or_else(|| {
                classes.push((class, Vec::new()));
                classes.len() - 1
            })
        })
        .collect();
    for triangle in mesh.triangles() {
        let material = mesh.vertices[triangle[0] as usize].material;
        classes[class_of[material as usize]].1.extend(triangle);
    }
    classes.retain(|(_, indices)| !indices.is_empty());
    (classes.into_iter())
        .map(|(class, indices)| {
            let cached = meshopt::optimize_vertex_cache(&indices, mesh.vertices.len());
            let mut moved = vec![u32::MAX; mesh.vertices.len()];
            let mut vertices = Vec::new();
            let mut place = |i: u32| {
                if moved[i as usize] == u32::MAX {
                    moved[i as usize] = vertices.len() as u32;
                    vertices.push(i);
                }
                moved[i as usize]
            };
            Primitive {
                class,
                indices: cached.into_iter().map(&mut place).collect(),
                vertices,
            }
        })
        .collect()
}

/// The content of a tile. `path` is named in errors.
pub(super) fn encoded(
    scene: &Scene,
    mesh: &Mesh,
    atlas: Option<&Atlas>,
    halvings: u32,
    options: &BuildOptions,
    path: &Path,
) -> Result<Vec<u8>, BuildError> {
    let compression = |error: meshopt::Error| BuildError::Compression {
        path: path.into(),
        what: error.to_string(),
    };
    let picture = |what: String| BuildError::Picture {
        path: path.into(),
        what,
    };
    let mut parts = Parts {
        meshopt: options.meshopt,
        ..Parts::default()
    };
    let mut extensions: Vec<&str> = Vec::new();
    let table = Table::of(&scene.features, mesh);
    let [low, high] = mesh.bounds().unwrap_or_default();
    let middle: [i32; 3] =
        std::array::from_fn(|k| ((i64::from(low[k]) + i64::from(high[k])) / 2) as i32);
    let (mut materials, mut pictures, mut images) = (Vec::new(), Vec::new(), Vec::new());
    let (mut samplers, mut written) = (Vec::new(), Vec::new());
    for primitive in primitives(scene, mesh) {
        let class = primitive.class;
        let vertex = |&i: &u32| &mesh.vertices[i as usize];
        let all = || primitive.vertices.iter().map(vertex);
        // glTF is y up: east, up, south.
        let places: Vec<[f32; 3]> = (all())
            .map(|v| [0, 2, 1].map(|k| (f64::from(v.at[k] - middle[k]) * scene.step_m) as f32))
            .map(|[e, u, n]| [e, u, 0.0 - n])
            .collect();
        let mut attributes = Map::new();
        let position = parts.attribute(&places).map_err(compression)?;
        let bound = |pick: fn(f32, f32) -> f32, from: f32| {
            let all = places.iter();
            all.fold([from; 3], |b, p| std::array::from_fn(|k| pick(b[k], p[k])))
        };
        parts.accessors[position]["min"] = json!(bound(f32::min, f32::INFINITY));
        parts.accessors[position]["max"] = json!(bound(f32::max, f32::NEG_INFINITY));
        attributes.insert("POSITION".into(), json!(position));
        if class.look.normals {
            let normals: Vec<[f32; 3]> = (all())
                .map(|v| [v.normal[0], v.normal[2], 0.0 - v.normal[1]])
                .map(|n| if n == [0.0; 3] { [0.0, 1.0, 0.0] } else { n })
                .collect();
            let normals = parts.attribute(&normals).map_err(compression)?;
            attributes.insert("NORMAL".into(), json!(normals));
        }
        let uv: Option<Vec<[f32; 2]>> = match class.paint {
            Paint::Plain => None,
            Paint::Tiled(_) => Some(all().map(|v| v.uv).collect()),
            Paint::Atlas => atlas.map(|atlas| {
                let uv = |&i: &u32| atlas.uv[i as usize];
                primitive.vertices.iter().map(uv).collect()
            }),
        };
        if let Some(uv) = uv {
            let uv = parts.attribute(&uv).map_err(compression)?;
            attributes.insert("TEXCOORD_0".into(), json!(uv));
        }
        if all().any(|v| v.color != [u16::MAX; 4]) {
            let colors: Vec<[u16; 4]> = all().map(|v| v.color).collect();
            let colors = parts.colors(&colors).map_err(compression)?;
            attributes.insert("COLOR_0".into(), json!(colors));
        }
        let mut value = json!({ "mode": 4, "material": materials.len() });
        if class.look.featured && table.count() > 0 {
            let rows: Vec<[f32; 1]> = all().map(|v| [table.row(v.feature) as f32]).collect();
            let rows = parts.attribute(&rows).map_err(compression)?;
            attributes.insert("_FEATURE_ID_0".into(), json!(rows));
            let mut ids = json!({ "featureCount": table.count(), "attribute": 0 });
            if table.has_columns() {
                ids["propertyTable"] = json!(0);
            }
            value["extensions"] = json!({ "EXT_mesh_features": { "featureIds": [ids] } });
            extensions.push("EXT_mesh_features");
        }
        let indices = parts.indices(&primitive.indices, primitive.vertices.len());
        value["indices"] = json!(indices.map_err(compression)?);
        value["attributes"] = Value::Object(attributes);
        written.push(value);
        let texture = match class.paint {
            Paint::Plain => None,
            Paint::Atlas => atlas.map(|atlas| (&atlas.texture, false)),
            Paint::Tiled(t) => Some((scene.textures[t].at(halvings), true)),
        };
        let mut surface = json!({ "metallicFactor": 0.0, "roughnessFactor": 1.0 });
        if let Some((texture, repeats)) = texture {
            let known = pictures.iter().position(|p| *p == class.paint);
            let index = match known {
                Some(index) => index,
                None => {
                    // Repeating textures are small, and JPEG's blocks would repeat with them.
                    let how = if repeats {
                        Pictures::Png
                    } else {
                        options.pictures
                    };
                    let (bytes, kind) = encode(texture, how).map_err(picture)?;
                    let view = parts.raw(&bytes);
                    images.push(json!({ "bufferView": view, "mimeType": kind }));
                    let wrap = if repeats { 10497 } else { 33071 };
                    samplers.push(json!({
                        "magFilter": 9729, "minFilter": 9987, "wrapS": wrap, "wrapT": wrap,
                    }));
                    pictures.push(class.paint);
                    pictures.len() - 1
                }
            };
            surface["baseColorTexture"] = json!({ "index": index });
        }
        let mut material = json!({ "pbrMetallicRoughness": surface });
        if class.look.double_sided {
            material["doubleSided"] = json!(true);
        }
        if let Some(cutoff) = class.look.alpha_cutoff {
            material["alphaMode"] = json!("MASK");
            material["alphaCutoff"] = json!(cutoff);
        }
        if class.look.unlit {
            material["extensions"] = json!({ "KHR_materials_unlit": {} });
            extensions.push("KHR_materials_unlit");
        }
        materials.push(material);
    }
    let origin = scene.place_m(middle);
    let mut root = json!({
        "asset": { "version": "2.0", "generator": "boresight" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "translation": [origin.x, origin.z, -origin.y] }],
        "meshes": [{ "primitives": written }],
        "materials": materials,
    });
    if !images.is_empty() {
        let textures = (0..images.len()).map(|i| json!({ "source": i, "sampler": i }));
        root["textures"] = textures.collect();
        root["samplers"] = Value::Array(samplers);
        root["images"] = Value::Array(images);
    }
    if table.has_columns() {
        root["extensions"] = json!({
            "EXT_structural_metadata": table.encoded(|bytes| parts.raw(bytes)),
        });
        extensions.push("EXT_structural_metadata");
    }
    if parts.meshopt {
        extensions.push("EXT_meshopt_compression");
        root["extensionsRequired"] = json!(["EXT_meshopt_compression"]);
    }
    extensions.sort_unstable();
    extensions.dedup();
    if !extensions.is_empty() {
        root["extensionsUsed"] = json!(extensions);
    }
    let mut buffers = vec![json!({ "byteLength": parts.bytes.len() })];
    if parts.meshopt {
        buffers.push(json!({
            "byteLength": parts.decoded,
            "extensions": { "EXT_meshopt_compression": { "fallback": true } },
        }));
    }
    root["accessors"] = Value::Array(parts.accessors);
    root["bufferViews"] = Value::Array(parts.views);
    root["buffers"] = Value::Array(buffers);
    Ok(container(root.to_string().into_bytes(), parts.bytes))
}

/// The two chunks of a binary glTF (glTF 2.0, 4.4).
fn container(mut json: Vec<u8>, mut binary: Vec<u8>) -> Vec<u8> {
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let length = 12 + 8 + json.len() + 8 + binary.len();
    let mut out = Vec::with_capacity(length);
    out.extend(b"glTF");
    for word in [2, length as u32, json.len() as u32] {
        out.extend(word.to_le_bytes());
    }
    out.extend(b"JSON");
    out.extend(&json);
    out.extend((binary.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(&binary);
    out
}
