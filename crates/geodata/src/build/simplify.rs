//! Fewer triangles for the same shape (eq. 1): edge collapse and vertex clustering, both meshoptimizer's.
//!
//! Edge collapse comes first, since it keeps textures and topology. Where it cannot reach the number, what carries no
//! texture is clustered. Vertices on planes that the cell shares with others stay, and stay themselves.

use super::measure::farthest;
use super::mesh::{Material, Mesh, one_material_a_triangle};
use meshopt::{SimplifyOptions, SimplifyVertex, VertexDataAdapter, typed_to_bytes};

/// Weight of an 8-bit-like step of colour against shape: a full change of colour counts as this share of the cell.
const COLOR_WEIGHT: f32 = 0.005;
/// Edge collapse stops at this error, as a share of the mesh's extent.
const MOST_ERROR: f32 = 0.1;
/// A result of so many times the wanted triangles is good enough to leave the topology alone.
const ENOUGH: f64 = 1.1;

/// A simpler mesh.
#[derive(Debug)]
pub(super) struct Simplified {
    pub mesh: Mesh,
    /// Farthest that the two surfaces lie apart, as meshoptimizer says and as measured, in steps of the lattice.
    pub error: f64,
}

/// Keeps some share of the triangles. `locked` says which vertices must stay.
pub(super) fn simplify(
    mesh: &Mesh,
    materials: &[Material],
    keep: f64,
    locked: impl Fn([i32; 3]) -> bool,
) -> Simplified {
    let Some([low, _]) = mesh.bounds() else {
        return Simplified {
            mesh: mesh.clone(),
            error: 0.0,
        };
    };
    let target = ((mesh.triangle_count() as f64 * keep) as usize).max(1);
    let places: Vec<[f32; 3]> = (mesh.vertices.iter())
        .map(|v| std::array::from_fn(|k| (v.at[k] - low[k]) as f32))
        .collect();
    let locks: Vec<bool> = mesh.vertices.iter().map(|v| locked(v.at)).collect();
    let few = |indices: &[u32]| indices.len() as f64 <= 3.0 * ENOUGH * target as f64;
    let cautious = collapse(mesh, materials, &places, &locks, target, false);
    let mut tried = vec![cautious];
    if !few(&tried[0].0) {
        tried.push(collapse(mesh, materials, &places, &locks, target, true));
        let left = if tried[1].0.len() < tried[0].0.len() {
            1
        } else {
            0
        };
        let left = tried[left].0.clone();
        tried.push(cluster(mesh, materials, &places, &locks, &left, target));
        tried.retain(|(indices, _)| !indices.is_empty());
        let least = tried.iter().map(|(indices, _)| indices.len()).min();
        if tried.iter().any(|(indices, _)| few(indices)) {
            tried.retain(|(indices, _)| few(indices));
        } else {
            tried.retain(|(indices, _)| Some(indices.len()) == least);
        }
    }
    // What the library says of errors is a mean, and counts colours: where there is a choice, what is measured decides.
    let colored = colored(mesh);
    let results = tried.into_iter().map(|(indices, said)| {
        let simple = Mesh {
            vertices: mesh.vertices.clone(),
            indices,
        };
        let simple = one_material_a_triangle(simple).welded();
        let measured = farthest(mesh, &simple).max(farthest(&simple, mesh));
        let error = if colored {
            measured
        } else {
            measured.max(f64::from(said))
        };
        Simplified {
            mesh: simple,
            error,
        }
    });
    let whole = || Simplified {
        mesh: mesh.clone(),
        error: 0.0,
    };
    results
        .min_by(|a, b| a.error.total_cmp(&b.error))
        .unwrap_or_else(whole)
}

/// Whether its vertices differ in colour.
fn colored(mesh: &Mesh) -> bool {
    mesh.vertices
        .iter()
        .any(|v| v.color != mesh.vertices[0].color)
}

/// Edge collapse. Across seams of colour too where `bold`; never across those of textures.
fn collapse(
    mesh: &Mesh,
    materials: &[Material],
    places: &[[f32; 3]],
    locks: &[bool],
    target: usize,
    bold: bool,
) -> (Vec<u32>, f32) {
    let Ok(adapter) = VertexDataAdapter::new(typed_to_bytes(places), size_of::<[f32; 3]>(), 0)
    else {
        return (mesh.indices.clone(), 0.0);
    };
    let extent = meshopt::simplify_scale(&adapter);
    let textured = |material: u32| materials[material as usize].texture.is_some();
    let flags: Vec<SimplifyVertex> = (locks.iter().zip(&mesh.vertices))
        .map(|(&lock, vertex)| match lock {
            true => SimplifyVertex::Lock,
            false if textured(vertex.material) => SimplifyVertex::Protect,
            false => SimplifyVertex::None,
        })
        .collect();
    let mut options = SimplifyOptions::ErrorAbsolute;
    if bold {
        options |= SimplifyOptions::Permissive;
    }
    let mut error = 0.0;
    let limit = extent * MOST_ERROR;
    let indices = if colored(mesh) {
        let colors: Vec<[f32; 3]> = (mesh.vertices.iter())
            .map(|v| std::array::from_fn(|k| f32::from(v.color[k]) / 65535.0))
            .collect();
        meshopt::simplify_with_attributes_and_locks(
            &mesh.indices,
            &adapter,
            colors.as_flattened(),
            &[COLOR_WEIGHT; 3],
            size_of::<[f32; 3]>(),
            &flags,
            3 * target,
            limit,
            options,
            Some(&mut error),
        )
    } else {
        meshopt::simplify_with_locks(
            &mesh.indices,
            &adapter,
            &flags,
            3 * target,
            limit,
            options,
            Some(&mut error),
        )
    };
    (indices, error)
}

/// Vertex clustering of the triangles without texture that edge collapse has left.
fn cluster(
    mesh: &Mesh,
    materials: &[Material],
    places: &[[f32; 3]],
    locks: &[bool],
    left: &[u32],
    target: usize,
) -> (Vec<u32>, f32) {
    let Ok(adapter) = VertexDataAdapter::new(typed_to_bytes(places), size_of::<[f32; 3]>(), 0)
    else {
        return (Vec::new(), 0.0);
    };
    let textured = |triangle: &&[u32; 3]| {
        let vertex = mesh.vertices[triangle[0] as usize];
        materials[vertex.material as usize].texture.is_some()
    };
    let (left, _) = left.as_chunks::<3>();
    let mut indices = left.iter().filter(textured).copied().collect::<Vec<_>>();
    // From the triangles as they were: what edge collapse has thinned out clusters badly.
    let plain: Vec<u32> = (mesh.triangles().iter())
        .filter(|triangle| !textured(triangle))
        .flatten()
        .copied()
        .collect();
    let share = plain.len() as f64 / mesh.indices.len() as f64;
    let wanted = (target.saturating_sub(indices.len()))
        .max((target as f64 * share) as usize)
        .max(1);
    let mut error = 0.0;
    let wanted = (3 * wanted).min(plain.len());
    let fewer =
        meshopt::simplify_sloppy_with_locks(&plain, &adapter, locks, wanted, 1.0, Some(&mut error));
    indices.extend(fewer.as_chunks::<3>().0);
    (
        indices.into_flattened(),
        error * meshopt::simplify_scale(&adapter),
    )
}
