//! Meshes moved to where they stand: once with f64 offsets, or many times as placements.

use boresight_models::shape::textured::{PlacedMesh, PointCloud, TexturedMesh};
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::sync::Arc;

/// Where a mesh stands, and which feature it is there, if it is one as a whole.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stand {
    /// From the mesh's parent frame to the content's.
    pub to_content: DAffine3,
    /// The feature.
    pub feature: Option<u32>,
}

/// Positions through a transform, about the middle of their box: the f64 origin of the content's frame and what
/// remains beside it. `None` if they are beyond all numbers.
fn moved(origin_m: DVec3, positions: &mut [[f32; 3]], to: DAffine3) -> Option<DVec3> {
    let at = |p: &[f32; 3]| origin_m + Vec3::from(*p).as_dvec3();
    let first = positions.first().map(at)?;
    let (low, high) = positions.iter().fold((first, first), |(low, high), p| {
        let p = at(p);
        (low.min(p), high.max(p))
    });
    let middle = 0.5 * (low + high);
    let origin = to.transform_point3(middle);
    for p in &mut *positions {
        *p = to.transform_vector3(at(p) - middle).as_vec3().to_array();
    }
    let finite = origin.is_finite() && positions.as_flattened().iter().all(|x| x.is_finite());
    finite.then_some(origin)
}

/// Normals through a transform: by its cofactors, which need no inverse.
fn turn(normals: &mut [[f32; 3]], to: DMat3) {
    let [x, y, z] = [to.x_axis, to.y_axis, to.z_axis];
    let sign = if to.determinant() < 0.0 { -1.0 } else { 1.0 };
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    for n in normals {
        let turned = sign * (cofactors * Vec3::from(*n).as_dvec3());
        *n = turned.normalize_or(DVec3::Z).as_vec3().to_array();
    }
}

/// Turns every triangle's other side out.
fn flip(indices: &mut [u32]) {
    for corners in indices.as_chunks_mut::<3>().0 {
        corners.swap(1, 2);
    }
}

/// The mesh in the content's frame; `None` if it is beyond all numbers.
pub(crate) fn baked(mut mesh: TexturedMesh, to: DAffine3) -> Option<TexturedMesh> {
    mesh.origin_m = moved(mesh.origin_m, &mut mesh.positions, to)?;
    turn(&mut mesh.normals, to.matrix3);
    if to.matrix3.determinant() < 0.0 {
        flip(&mut mesh.indices);
    }
    Some(mesh)
}

/// The points in the content's frame; `None` if they are beyond all numbers.
pub(crate) fn baked_points(mut cloud: PointCloud, to: DAffine3) -> Option<PointCloud> {
    cloud.origin_m = moved(cloud.origin_m, &mut cloud.positions, to)?;
    turn(&mut cloud.normals, to.matrix3);
    Some(cloud)
}

/// A mesh at many places. Placements that mirror get a mirrored mesh and mirror no more; those that squeeze it to
/// nothing go.
pub(crate) fn placed(mesh: TexturedMesh, stands: &[Stand]) -> Vec<PlacedMesh> {
    const MIRROR: DMat3 = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    let with_features = stands.iter().any(|stand| stand.feature.is_some());
    let some = |mirrors: bool| {
        let turned = |stand: &&Stand| {
            let volume = stand.to_content.matrix3.determinant();
            if mirrors { volume < 0.0 } else { volume > 0.0 }
        };
        let (mut placements, mut features) = (Vec::new(), Vec::new());
        for stand in stands.iter().filter(turned) {
            let back = if mirrors { MIRROR } else { DMat3::IDENTITY };
            placements.push(stand.to_content * DAffine3::from_mat3(back));
            if with_features {
                let none = boresight_models::shape::textured::NO_FEATURE;
                features.push(stand.feature.unwrap_or(none));
            }
        }
        (placements, features)
    };
    let (straight, mirrored) = (some(false), some(true));
    let mut found = Vec::new();
    if !mirrored.0.is_empty() {
        let mut mesh = mesh.clone();
        mesh.origin_m.x = -mesh.origin_m.x;
        for vector in mesh.positions.iter_mut().chain(&mut mesh.normals) {
            vector[0] = -vector[0];
        }
        flip(&mut mesh.indices);
        found.push((mesh, mirrored));
    }
    if !straight.0.is_empty() {
        found.insert(0, (mesh, straight));
    }
    let place = |(mesh, (placements, placement_features))| PlacedMesh {
        mesh: Arc::new(mesh),
        placements,
        placement_features,
    };
    found.into_iter().map(place).collect()
}
