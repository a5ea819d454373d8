//! From a tile's content to meshes and textures for the GPU: few and large, for each costs a draw.

use crate::picture::{picture_bytes, picture_texture};
use crate::{PreparedTile, TilePart, TileSurface, TilesLight};
use bevy::asset::RenderAssetUsages;
use bevy::camera::primitives::Aabb;
use bevy::mesh::{Indices, PrimitiveTopology, VertexAttributeValues};
use bevy::prelude::*;
use boresight_geodata::tiles::content::Content;
use boresight_models::shape::textured::{Look, PlacedMesh, PointCloud, Texture, TexturedMesh};
use glam::{DAffine3, DMat3, DVec3};
use std::sync::Arc;

/// Of a mesh with more places than this, every place is an entity of its own; one with fewer is copied.
const MOST_COPIES: usize = 4;

/// The light that a look has in a tileset.
fn baked(look: &Look, light: TilesLight) -> bool {
    match light {
        TilesLight::AsStored => look.unlit,
        TilesLight::Baked => true,
        TilesLight::Relit => false,
    }
}

/// Whether two looks can be one mesh.
fn alike(a: &Look, b: &Look) -> bool {
    let same_picture = match (&a.texture, &b.texture) {
        (Some(a), Some(b)) => Arc::ptr_eq(a, b),
        (None, None) => true,
        _ => false,
    };
    let rest = |look: &Look| {
        let cutoff = look.alpha_cutoff.map(f32::to_bits);
        (look.repeats, look.unlit, look.double_sided, cutoff)
    };
    same_picture && rest(a) == rest(b)
}

/// A mesh that grows: vertices in the frame of the tileset's entity, in f64 until it is complete.
#[derive(Default)]
struct Group {
    positions_m: Vec<DVec3>,
    normals: Vec<[f32; 3]>,
    uv: Vec<[f32; 2]>,
    colors: Vec<[f32; 4]>,
    indices: Vec<u32>,
}

impl Group {
    /// Adds a mesh at a place, with the normals of its triangles where it is `lit` and has none.
    fn add(&mut self, mesh: &TexturedMesh, to_entity_m: DAffine3, lit: bool) {
        let vertices = mesh.positions.len();
        let flat = lit && mesh.normals.len() != vertices;
        // Vertices of this group for those of the mesh: of a flat one each corner is a vertex.
        let sources: Vec<u32> = if flat {
            mesh.indices.clone()
        } else {
            (0..vertices as u32).collect()
        };
        let first = self.positions_m.len() as u32;
        let at = |i: u32| to_entity_m.transform_point3(mesh.vertex_m(i));
        self.positions_m.extend(sources.iter().map(|i| at(*i)));
        if flat {
            for corners in mesh.indices.as_chunks::<3>().0 {
                let [a, b, c] = corners.map(at);
                let normal = (b - a).cross(c - a).normalize_or(DVec3::Z).as_vec3();
                self.normals.extend([normal.to_array(); 3]);
            }
            self.indices.extend(first..first + sources.len() as u32);
        } else {
            if lit {
                let cofactors = to_entity_m.matrix3.inverse().transpose();
                self.normals.extend(mesh.normals.iter().map(|n| {
                    let turned = cofactors * DVec3::from(n.map(f64::from));
                    turned.normalize_or(DVec3::Z).as_vec3().to_array()
                }));
            }
            self.indices.extend(mesh.indices.iter().map(|i| first + i));
        }
        let uv = |i: u32| mesh.uv.get(i as usize).copied().unwrap_or_default();
        self.uv.extend(sources.iter().map(|i| uv(*i)));
        let tint = mesh.look.base_color;
        let color = |i: u32| {
            let own = mesh.colors.get(i as usize).copied().unwrap_or([1.0; 4]);
            std::array::from_fn(|k| own[k] * tint[k])
        };
        self.colors.extend(sources.iter().map(|i| color(*i)));
    }

    /// The mesh with its own origin, and what it takes.
    fn finish(self, surface: TileSurface, topology: PrimitiveTopology) -> Option<Finished> {
        let first = *self.positions_m.first()?;
        let (low, high) = (self.positions_m.iter())
            .fold((first, first), |(low, high), p| (low.min(*p), high.max(*p)));
        let origin_m = 0.5 * (low + high);
        let half = 0.5 * (high - low);
        let local = |p: &DVec3| (*p - origin_m).as_vec3().to_array();
        let positions: Vec<[f32; 3]> = self.positions_m.iter().map(local).collect();
        let mut bytes = 12 * positions.len() + 4 * self.indices.len();
        let vertices = positions.len();
        let mut mesh = Mesh::new(topology, RenderAssetUsages::RENDER_WORLD)
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions);
        if self.normals.len() == vertices {
            bytes += 12 * vertices;
            mesh.insert_attribute(Mesh::ATTRIBUTE_NORMAL, self.normals);
        }
        if surface.picture {
            bytes += 8 * vertices;
            mesh.insert_attribute(Mesh::ATTRIBUTE_UV_0, self.uv);
        }
        if self.colors.iter().any(|color| *color != [1.0; 4]) {
            bytes += 16 * vertices;
            mesh.insert_attribute(Mesh::ATTRIBUTE_COLOR, self.colors);
        }
        let triangles = match topology {
            PrimitiveTopology::TriangleList => self.indices.len() / 3,
            _ => 0,
        };
        if topology == PrimitiveTopology::TriangleList {
            mesh.insert_indices(Indices::U32(self.indices));
        }
        Some(Finished {
            mesh,
            bounds: Aabb {
                center: default(),
                half_extents: half.as_vec3a(),
            },
            origin_m,
            triangles,
            bytes: bytes as u64,
        })
    }
}

struct Finished {
    mesh: Mesh,
    bounds: Aabb,
    origin_m: DVec3,
    triangles: usize,
    bytes: u64,
}

/// The pictures of a tile, each once.
#[derive(Default)]
struct Pictures(Vec<(Arc<Texture>, bool, Option<u8>)>);

impl Pictures {
    fn number(&mut self, texture: &Arc<Texture>, repeats: bool, cutoff: Option<u8>) -> usize {
        let same = |(own, repeated, cut): &(Arc<Texture>, bool, Option<u8>)| {
            Arc::ptr_eq(own, texture) && (*repeated, *cut) == (repeats, cutoff)
        };
        self.0.iter().position(same).unwrap_or_else(|| {
            self.0.push((texture.clone(), repeats, cutoff));
            self.0.len() - 1
        })
    }
}

/// A rotation with a stretch along each axis, if that is what a matrix is.
fn turned(matrix: DMat3) -> Option<(Quat, Vec3)> {
    let scale = DVec3::new(
        matrix.x_axis.length(),
        matrix.y_axis.length(),
        matrix.z_axis.length(),
    );
    let axes = DMat3::from_cols(
        matrix.x_axis / scale.x,
        matrix.y_axis / scale.y,
        matrix.z_axis / scale.z,
    );
    let askew = (axes.transpose() * axes - DMat3::IDENTITY).to_cols_array();
    let regular = askew.iter().all(|x| x.abs() < 1e-6) && matrix.determinant() > 0.0;
    regular.then(|| (glam::DQuat::from_mat3(&axes).as_quat(), scale.as_vec3()))
}

/// Makes a tile's meshes and textures. `entity_from_tile_m`: from the tile's frame to that of the tileset's entity.
pub fn prepare(content: &Content, entity_from_tile_m: DAffine3, light: TilesLight) -> PreparedTile {
    let mut prepared = PreparedTile::default();
    let mut pictures = Pictures::default();
    let mut groups: Vec<(&Look, Group)> = Vec::new();
    for PlacedMesh {
        mesh, placements, ..
    } in &content.meshes
    {
        let mesh: &TexturedMesh = mesh;
        if mesh.indices.is_empty() {
            continue;
        }
        let lit = !baked(&mesh.look, light);
        let places: Vec<DAffine3> = (placements.iter())
            .map(|place| entity_from_tile_m * *place)
            .collect();
        let spread: Option<Vec<_>> = (places.iter())
            .map(|place| {
                let (rotation, scale) = turned(place.matrix3)?;
                Some((place.translation, rotation, scale))
            })
            .collect();
        match spread.filter(|_| places.len() > MOST_COPIES) {
            Some(spread) => {
                let mut group = Group::default();
                group.add(mesh, DAffine3::IDENTITY, lit);
                let surface = surface(&mesh.look, light);
                if let Some(finished) = group.finish(surface, PrimitiveTopology::TriangleList) {
                    let places = spread.into_iter().map(|(at_m, rotation, scale)| {
                        let offset_m = rotation.as_dquat() * (scale.as_dvec3() * finished.origin_m);
                        (at_m + offset_m, rotation, scale)
                    });
                    let places = places.collect();
                    put(
                        &mut prepared,
                        &mut pictures,
                        &mesh.look,
                        (surface, finished),
                        places,
                    );
                }
            }
            None => {
                let known = groups.iter().position(|(look, _)| alike(look, &mesh.look));
                let number = known.unwrap_or_else(|| {
                    groups.push((&mesh.look, Group::default()));
                    groups.len() - 1
                });
                for place in places {
                    groups[number].1.add(mesh, place, lit);
                }
            }
        }
    }
    for (look, group) in groups {
        let surface = surface(look, light);
        if let Some(finished) = group.finish(surface, PrimitiveTopology::TriangleList) {
            let places = vec![(finished.origin_m, Quat::IDENTITY, Vec3::ONE)];
            put(
                &mut prepared,
                &mut pictures,
                look,
                (surface, finished),
                places,
            );
        }
    }
    for cloud in &content.points {
        if let Some(finished) = points(cloud, entity_from_tile_m) {
            let places = vec![(finished.origin_m, Quat::IDENTITY, Vec3::ONE)];
            put(
                &mut prepared,
                &mut pictures,
                &Look::default(),
                (POINTS, finished),
                places,
            );
        }
    }
    for (texture, repeats, cutoff) in pictures.0 {
        prepared.bytes += picture_bytes(texture.size_px);
        let picture = picture_texture(texture.size_px, &texture.rgba, repeats, cutoff);
        prepared.pictures.push(picture);
    }
    prepared
}

/// Points face the sky: nobody knows better.
const POINTS: TileSurface = TileSurface {
    baked: true,
    picture: false,
    two_sided: true,
    cutoff: None,
};

fn points(cloud: &PointCloud, entity_from_tile_m: DAffine3) -> Option<Finished> {
    let mut group = Group::default();
    for (i, p) in cloud.positions.iter().enumerate() {
        let at_m = cloud.origin_m + DVec3::from(p.map(f64::from));
        group
            .positions_m
            .push(entity_from_tile_m.transform_point3(at_m));
        group
            .colors
            .push(cloud.colors.get(i).copied().unwrap_or([1.0; 4]));
    }
    group.finish(POINTS, PrimitiveTopology::PointList)
}

fn surface(look: &Look, light: TilesLight) -> TileSurface {
    let alpha = |cutoff: f32| (cutoff.clamp(0.0, 1.0) * 255.0).ceil() as u8;
    TileSurface {
        baked: baked(look, light),
        picture: look.texture.is_some(),
        two_sided: look.double_sided,
        cutoff: look
            .alpha_cutoff
            .filter(|_| look.texture.is_some())
            .map(alpha),
    }
}

fn put(
    prepared: &mut PreparedTile,
    pictures: &mut Pictures,
    look: &Look,
    (surface, finished): (TileSurface, Finished),
    places: Vec<(DVec3, Quat, Vec3)>,
) {
    let picture = (look.texture.as_ref())
        .map(|texture| pictures.number(texture, look.repeats, surface.cutoff));
    prepared.triangles += finished.triangles * places.len();
    prepared.bytes += finished.bytes;
    prepared.parts.push(TilePart {
        mesh: finished.mesh,
        bounds: finished.bounds,
        surface,
        picture,
        places,
    });
}

/// Calls for the corners of each of a tile's triangles, and thrice each of its points, in the frame of the tileset's entity [m].
pub fn for_each_triangle(prepared: &PreparedTile, mut call: impl FnMut([DVec3; 3])) {
    for part in &prepared.parts {
        let positions = part.mesh.attribute(Mesh::ATTRIBUTE_POSITION);
        let Some(positions) = positions.and_then(VertexAttributeValues::as_float3) else {
            continue;
        };
        let indices: Vec<[usize; 3]> = match part.mesh.indices() {
            Some(Indices::U32(indices)) => {
                let triangles = indices.as_chunks::<3>().0.iter();
                triangles
                    .map(|triangle| triangle.map(|i| i as usize))
                    .collect()
            }
            _ => (0..positions.len()).map(|i| [i; 3]).collect(),
        };
        for (at_m, rotation, scale) in &part.places {
            let (q, scale) = (rotation.as_dquat(), scale.as_dvec3());
            let place = |i: usize| *at_m + q * (scale * DVec3::from(positions[i].map(f64::from)));
            indices
                .iter()
                .for_each(|triangle| call(triangle.map(place)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle(look: Look) -> Arc<TexturedMesh> {
        Arc::new(TexturedMesh {
            origin_m: DVec3::new(1.0, 2.0, 3.0),
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            uv: vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
            indices: vec![0, 1, 2],
            look,
            ..TexturedMesh::default()
        })
    }

    fn placed(mesh: Arc<TexturedMesh>, placements: Vec<DAffine3>) -> PlacedMesh {
        PlacedMesh {
            mesh,
            placements,
            placement_features: Vec::new(),
        }
    }

    fn positions(part: &TilePart) -> Vec<DVec3> {
        let positions = part.mesh.attribute(Mesh::ATTRIBUTE_POSITION).unwrap();
        let positions = positions.as_float3().unwrap();
        let (at_m, rotation, scale) = part.places[0];
        let local = positions.iter().map(|p| DVec3::from(p.map(f64::from)));
        local
            .map(|p| at_m + rotation.as_dquat() * (scale.as_dvec3() * p))
            .collect()
    }

    #[test]
    fn meshes_of_one_look_become_one_at_their_places() {
        let far = DVec3::new(4e6, 3e5, 5e6);
        let turn = DAffine3::from_rotation_z(0.5);
        let content = Content {
            meshes: vec![
                placed(triangle(Look::default()), vec![DAffine3::IDENTITY]),
                placed(triangle(Look::default()), vec![turn]),
                placed(
                    triangle(Look {
                        unlit: true,
                        ..Look::default()
                    }),
                    vec![DAffine3::IDENTITY],
                ),
            ],
            ..Content::default()
        };
        let to_entity = DAffine3::from_translation(far);
        let prepared = prepare(&content, to_entity, TilesLight::AsStored);
        assert_eq!(prepared.parts.len(), 2);
        assert_eq!(prepared.triangles, 3);
        let lit = &prepared.parts[0];
        assert!(!lit.surface.baked && prepared.parts[1].surface.baked);
        let expected = far + turn.transform_point3(DVec3::new(2.0, 2.0, 3.0));
        // f32 about the mesh's own origin: micrometres, not decimetres as in f32 at 6400 km.
        assert!(positions(lit)[4].distance(expected) < 1e-6);
        // What is lit has normals, what is not needs none.
        let normals = |part: &TilePart| part.mesh.attribute(Mesh::ATTRIBUTE_NORMAL).is_some();
        assert!(normals(lit) && !normals(&prepared.parts[1]));
        let relit = prepare(&content, to_entity, TilesLight::Relit);
        assert!(relit.parts.iter().all(normals));
    }

    #[test]
    fn instances_share_a_mesh() {
        let texture = Arc::new(Texture {
            size_px: [2, 2],
            rgba: vec![255; 16],
        });
        let look = Look {
            texture: Some(texture),
            ..Look::default()
        };
        let places: Vec<DAffine3> = (0..10)
            .map(|i| {
                DAffine3::from_scale_rotation_translation(
                    DVec3::splat(2.0),
                    glam::DQuat::from_rotation_z(0.3),
                    DVec3::new(10.0 * f64::from(i), 0.0, 0.0),
                )
            })
            .collect();
        let mesh = triangle(look);
        let content = Content {
            meshes: vec![placed(mesh.clone(), places.clone())],
            ..Content::default()
        };
        let prepared = prepare(&content, DAffine3::IDENTITY, TilesLight::AsStored);
        assert_eq!((prepared.parts.len(), prepared.pictures.len()), (1, 1));
        assert_eq!(
            (prepared.parts[0].places.len(), prepared.triangles),
            (10, 10)
        );
        let expected = places[0].transform_point3(mesh.vertex_m(1));
        assert!(positions(&prepared.parts[0])[1].distance(expected) < 1e-5);
        assert_eq!(
            prepared.bytes,
            3 * (12 + 12 + 8) + 3 * 4 + 2 * 2 * 4 * 4 / 3
        );
    }
}
