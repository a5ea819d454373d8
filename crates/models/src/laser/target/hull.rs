//! Where a ray meets a UAV's own shape.

use crate::shape::mesh::MeshData;
use glam::{DVec3, Vec3};
use rapier3d::parry::query::{Ray, RayCast};
use rapier3d::parry::shape::{FeatureId, TriMesh};

/// How far a ray is followed [m].
const REACH_M: f32 = 100.0;

/// A shape that rays meet, in body axes.
#[derive(Clone)]
pub struct Hull {
    mesh: TriMesh,
    /// Mean albedo of each triangle.
    albedo: Vec<f32>,
    origin_m: DVec3,
}

impl std::fmt::Debug for Hull {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Hull({} triangles)", self.albedo.len())
    }
}

/// Where a ray meets a shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meets {
    /// The place [m, body].
    pub r_body_m: DVec3,
    /// Way to it along the ray [m].
    pub along_m: f64,
    /// Cosine between the ray and the surface's normal, 0 to 1.
    pub cosine: f64,
    /// Mean albedo of the paint there, over red, green and blue.
    pub albedo: f64,
}

impl Hull {
    /// The shape of a mesh; `None` of one without triangles.
    pub fn new(mesh: &MeshData) -> Option<Self> {
        let corners = mesh.indices.chunks_exact(3).map(|c| [c[0], c[1], c[2]]);
        let corners: Vec<[u32; 3]> = corners.collect();
        let albedo = corners.iter().map(|triangle| {
            let sum: f32 = (triangle.iter())
                .flat_map(|i| &mesh.colors[*i as usize][..3])
                .sum();
            sum / 9.0
        });
        let albedo = albedo.collect();
        let vertices = mesh.positions.iter().map(|p| Vec3::from_array(*p));
        Some(Self {
            mesh: TriMesh::new(vertices.collect(), corners).ok()?,
            albedo,
            origin_m: mesh.origin_enu_m,
        })
    }

    /// The first place at which a ray from a place [m, body] along a unit vector meets it.
    pub fn meets(&self, from_body_m: DVec3, along_body: DVec3) -> Option<Meets> {
        // f32 keeps a hundredth of a millimetre over some tens of metres: begin close by.
        let back_m = along_body.dot(from_body_m - self.origin_m);
        let radius_m = f64::from(self.mesh.local_aabb().half_extents().length())
            + f64::from(self.mesh.local_aabb().center().length());
        let ahead_m = (-back_m - radius_m).max(0.0);
        let start_m = from_body_m + ahead_m * along_body;
        let ray = Ray::new((start_m - self.origin_m).as_vec3(), along_body.as_vec3());
        let hit = (self.mesh).cast_local_ray_and_get_normal(&ray, REACH_M, false)?;
        let triangles = self.albedo.len();
        let FeatureId::Face(face) = hit.feature else {
            return None;
        };
        let along_m = ahead_m + f64::from(hit.time_of_impact);
        Some(Meets {
            r_body_m: from_body_m + along_m * along_body,
            along_m,
            cosine: f64::from(hit.normal.dot(ray.dir).abs()).min(1.0),
            albedo: f64::from(self.albedo[face as usize % triangles]),
        })
    }
}
