//! Triangles and base colours of a binary glTF 2.0 file (Khronos Group, glTF 2.0 specification,
//! ISO/IEC 12113:2022). Textures, animations and everything that is no triangle are left out.

use glam::{DAffine3, DMat3, DMat4, DVec3};
use gltf::accessor::{DataType, Dimensions};
use gltf::buffer::Source;
use gltf::mesh::Mode;
use gltf::{Accessor, Document, Gltf, Primitive, Semantic};
use thiserror::Error;

use crate::shape::mesh::{MeshData, Paint};

/// Most triangles of a body: silhouettes and occlusion visit each of them in every frame.
pub const MAX_TRIANGLES: usize = 100_000;

/// Why a glTF file cannot be used.
#[derive(Debug, Error)]
pub enum GltfError {
    /// It is something else.
    #[error("is no binary glTF 2.0 file; export the shape as .glb")]
    NotBinary,
    /// It contradicts the specification, or needs an extension.
    #[error("{0}; export the shape anew, as plain .glb without compression")]
    Invalid(#[from] gltf::Error),
    /// A part of its data is not where or what it should be.
    #[error("its {what} are damaged, or lie in another file; export the shape anew, as one .glb")]
    Data {
        /// The part.
        what: &'static str,
    },
    /// Nothing to draw.
    #[error("has no triangles; export a mesh of triangles in its scene")]
    NoTriangles,
    /// Too much to draw.
    #[error("has more than {MAX_TRIANGLES} triangles; simplify the shape")]
    TooMany,
}

/// The triangles of the file's scene in body axes [m, body]: glTF looks along +z with +y up.
pub fn gltf_mesh(bytes: &[u8]) -> Result<MeshData, GltfError> {
    const HEADER: usize = 12; // [byte]
    // The crate subtracts the header's length from the file's without asking.
    let length = bytes.get(8..HEADER).and_then(|field| field.try_into().ok());
    let length = length.map_or(0, u32::from_le_bytes) as usize;
    if !bytes.starts_with(b"glTF") || length < HEADER {
        return Err(GltfError::NotBinary);
    }
    let Gltf { document, blob } = Gltf::from_slice_without_validation(bytes)?;
    let root = document.into_json();
    // The crate's validation looks these up before it has checked them.
    let primitives = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let mut accessors = primitives.flat_map(|primitive| primitive.attributes.values());
    if accessors.any(|accessor| accessor.value() >= root.accessors.len()) {
        return Err(GltfError::Data { what: "accessors" });
    }
    let document = Document::from_json(root)?;
    let blob = blob.unwrap_or_default();
    // Forward is glTF's z, left its x, up its y.
    let to_body = DAffine3::from_mat3(DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X));
    let mut mesh = MeshData::new(DVec3::ZERO);
    let scene = document
        .default_scene()
        .or_else(|| document.scenes().next());
    let roots = scene.iter().flat_map(gltf::Scene::nodes);
    let mut waiting: Vec<_> = roots.map(|node| (node, to_body)).collect();
    let mut visits = 0;
    while let Some((node, to_parent)) = waiting.pop() {
        // A node has one parent; without this a circle of nodes would never end.
        visits += 1;
        if visits > document.nodes().len() {
            return Err(GltfError::Data { what: "nodes" });
        }
        let columns = node
            .transform()
            .matrix()
            .map(|column| column.map(f64::from));
        let to_body = to_parent * DAffine3::from_mat4(DMat4::from_cols_array_2d(&columns));
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            if primitive.mode() == Mode::Triangles {
                mesh.append(&triangles(&primitive, &blob)?, to_body);
            }
            if mesh.triangle_count() > MAX_TRIANGLES {
                return Err(GltfError::TooMany);
            }
        }
        waiting.extend(node.children().map(|child| (child, to_body)));
    }
    if mesh.indices.is_empty() {
        return Err(GltfError::NoTriangles);
    }
    if !mesh.positions.iter().flatten().all(|x| x.is_finite()) {
        return Err(GltfError::Data { what: "positions" });
    }
    Ok(mesh)
}

/// A primitive in its node's axes; flat where the file has no normals.
fn triangles(primitive: &Primitive, blob: &[u8]) -> Result<MeshData, GltfError> {
    let damaged = |what| move || GltfError::Data { what };
    let [r, g, b, _] = (primitive.material().pbr_metallic_roughness()).base_color_factor();
    let paint = Paint::plain([r, g, b]);
    let positions = primitive.get(&Semantic::Positions);
    let positions = (positions.and_then(|accessor| vectors(&accessor, blob)))
        .ok_or_else(damaged("positions"))?;
    let indices = match primitive.indices() {
        None => (0..positions.len() as u32).collect(),
        Some(accessor) => whole_numbers(&accessor, blob).ok_or_else(damaged("indices"))?,
    };
    let (corners, _) = indices.as_chunks::<3>();
    if corners.len() > MAX_TRIANGLES {
        return Err(GltfError::TooMany);
    }
    if indices.iter().any(|i| *i as usize >= positions.len()) {
        return Err(damaged("indices")());
    }
    let mut mesh = MeshData::new(DVec3::ZERO);
    match primitive.get(&Semantic::Normals) {
        None => {
            for corners in corners {
                let at = |i: u32| DVec3::from(positions[i as usize].map(f64::from));
                mesh.face(&corners.map(at), paint);
            }
        }
        Some(accessor) => {
            let normals = vectors(&accessor, blob).filter(|n| n.len() == positions.len());
            mesh.normals = normals.ok_or_else(damaged("normals"))?;
            let count = positions.len();
            mesh.colors = vec![[r, g, b, 1.0]; count];
            mesh.uv = vec![[0.0; 2]; count];
            mesh.surface = vec![[f32::from(paint.surface as u8), paint.variant]; count];
            mesh.indices = corners.as_flattened().to_vec();
            mesh.positions = positions;
        }
    }
    Ok(mesh)
}

/// The bytes of each element of an accessor.
fn elements<'b>(
    accessor: &Accessor,
    blob: &'b [u8],
) -> Option<impl Iterator<Item = &'b [u8]> + use<'b>> {
    let view = (accessor.view()).filter(|_| accessor.sparse().is_none())?;
    let buffer = view.buffer();
    if buffer.index() != 0 || !matches!(buffer.source(), Source::Bin) {
        return None;
    }
    let (size, count) = (accessor.size(), accessor.count());
    let stride = view.stride().unwrap_or(size);
    let data = blob.get(view.offset()..view.offset().checked_add(view.length())?)?;
    let data = data.get(accessor.offset()..)?;
    let end = stride.checked_mul(count.max(1) - 1)?.checked_add(size)?;
    let fits = stride >= size && (count == 0 || end <= data.len());
    fits.then(|| (0..count).map(move |i| &data[i * stride..][..size]))
}

/// Three floats an element.
fn vectors(accessor: &Accessor, blob: &[u8]) -> Option<Vec<[f32; 3]>> {
    let kind = (accessor.data_type(), accessor.dimensions());
    let bytes = elements(accessor, blob).filter(|_| kind == (DataType::F32, Dimensions::Vec3))?;
    let vector = |bytes: &[u8]| {
        let (floats, _) = bytes.as_chunks::<4>();
        [0, 1, 2].map(|i| {
            floats
                .get(i)
                .map_or(0.0, |float| f32::from_le_bytes(*float))
        })
    };
    Some(bytes.map(vector).collect())
}

/// One whole number an element.
fn whole_numbers(accessor: &Accessor, blob: &[u8]) -> Option<Vec<u32>> {
    let whole = matches!(
        accessor.data_type(),
        DataType::U8 | DataType::U16 | DataType::U32
    );
    let plain = whole && accessor.dimensions() == Dimensions::Scalar;
    let bytes = elements(accessor, blob).filter(|_| plain)?;
    let number = |bytes: &[u8]| {
        bytes
            .iter()
            .rev()
            .fold(0, |high, low| high << 8 | u32::from(*low))
    };
    Some(bytes.map(number).collect())
}

#[cfg(test)]
mod tests;
