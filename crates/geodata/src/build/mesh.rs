//! What a build works on: all layers in one frame, on one lattice, with one list of materials.
//!
//! Vertices lie on a lattice of 2²² steps over the site, so that places compare exactly, planes between cells fall on it
//! and a tile's f32 coordinates hold it without rounding: what two tiles share is the same to the bit in both.

use super::pictures::Picture;
use super::report::BuildError;
use crate::sources::{Layer, LayerKind};
use boresight_models::maths::geodesy::SiteFrame;
use boresight_models::shape::textured::{Look, Texture, TexturedMesh};
use glam::{DQuat, DVec3, Vec3};
use serde_json::{Map, Value};
use std::sync::Arc;

/// Steps of the lattice over the longest side of the data, as a power of two.
const LATTICE_BITS: i32 = 22;
/// Cells are cut at most this often.
pub(super) const MOST_LEVELS: u32 = 12;
/// What lies farther from the site is a mistake in the source's coordinates [m].
pub(super) const FARTHEST_M: f64 = 200_000.0;
/// A texture that repeats more often than this along a side of a mesh, or over its whole area, is kept apart from the
/// atlases.
const MOST_REPEATS: f32 = 2.0;
/// Normals closer to their triangle's than this cosine are its own.
const FLAT_COS: f32 = 0.99995;
/// The feature of a vertex that has none.
pub(super) const NO_FEATURE: u32 = u32::MAX;
/// The group of a triangle that is cut where a cell ends.
pub(super) const FREE: u32 = u32::MAX;

/// A corner of triangles. Its bytes have no gaps: equal vertices have equal bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Vertex {
    /// Place on the lattice.
    pub at: [i32; 3],
    /// Unit normal; zero where triangles are flat.
    pub normal: [f32; 3],
    /// Place in the source's own texture, (0, 0) at its top left.
    pub uv: [f32; 2],
    /// Linear RGBA, 65535 being one.
    pub color: [u16; 4],
    /// Row of the table of features, or [`NO_FEATURE`].
    pub feature: u32,
    /// Index of the material.
    pub material: u32,
}

/// Triangles of any materials.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Mesh {
    pub vertices: Vec<Vertex>,
    /// Three per triangle.
    pub indices: Vec<u32>,
}

impl Mesh {
    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.indices.len() / 3
    }

    /// The triangles' corners.
    pub fn triangles(&self) -> &[[u32; 3]] {
        self.indices.as_chunks::<3>().0
    }

    /// Adds another mesh as it is.
    pub fn append(&mut self, other: &Self) {
        let first = self.vertices.len() as u32;
        self.vertices.extend_from_slice(&other.vertices);
        self.indices.extend(other.indices.iter().map(|i| i + first));
    }

    /// The same triangles without vertices that are there twice or unused, and without triangles of no area.
    pub fn welded(&self) -> Self {
        let (count, remap) = meshopt::generate_vertex_remap(&self.vertices, Some(&self.indices));
        let mut vertices = vec![Vertex::default(); count];
        for (vertex, &new) in self.vertices.iter().zip(&remap) {
            if let Some(place) = vertices.get_mut(new as usize) {
                *place = *vertex;
            }
        }
        let mut indices = Vec::with_capacity(self.indices.len());
        for triangle in self.triangles() {
            let corners = triangle.map(|i| self.vertices[i as usize].at);
            if corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0] {
                indices.extend(triangle.map(|i| remap[i as usize]));
            }
        }
        Self { vertices, indices }
    }

    /// Least and greatest coordinates of the vertices that triangles use.
    pub fn bounds(&self) -> Option<[[i32; 3]; 2]> {
        let mut used = self.indices.iter().map(|&i| self.vertices[i as usize].at);
        let first = used.next()?;
        Some(used.fold([first, first], |[low, high], at| {
            [
                std::array::from_fn(|k| low[k].min(at[k])),
                std::array::from_fn(|k| high[k].max(at[k])),
            ]
        }))
    }
}

/// How triangles look, without what their vertices say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Material {
    /// Which texture.
    pub texture: Option<usize>,
    /// Whether the texture repeats, so that no atlas can hold it.
    pub tiled: bool,
    /// Whether places outside 0..1 show the texture again.
    pub wraps: bool,
    /// The material of the same look without a texture.
    pub plain: u32,
    pub unlit: bool,
    pub double_sided: bool,
    pub alpha_cutoff: Option<f32>,
    /// Whether vertices carry normals.
    pub normals: bool,
    /// Whether vertices carry features.
    pub featured: bool,
}

/// All layers, ready to be cut.
#[derive(Debug)]
pub(super) struct Scene {
    pub site: SiteFrame,
    /// Where the lattice begins [m, ENU of the site].
    pub origin_m: DVec3,
    /// A step of it [m].
    pub step_m: f64,
    /// Steps along the root cell's side, a multiple of 2^[`MOST_LEVELS`].
    pub side: i32,
    pub materials: Vec<Material>,
    pub textures: Vec<Picture>,
    pub features: Vec<Map<String, Value>>,
    pub mesh: Mesh,
    /// What each triangle belongs to: an index of `groups`, or [`FREE`].
    pub group_of: Vec<u32>,
    /// Bounds of what stays in one piece.
    pub groups: Vec<[[i32; 3]; 2]>,
    /// Triangles of the layers as they came.
    pub triangles_in: usize,
}

impl Scene {
    /// A place on the lattice in the site's frame [m].
    pub fn place_m(&self, at: [i32; 3]) -> DVec3 {
        self.origin_m + DVec3::from(at.map(f64::from)) * self.step_m
    }
}

/// From a layer's frame to the site's.
struct Move {
    turn: DQuat,
    shift_m: DVec3,
}

impl Move {
    fn between(layer: &SiteFrame, site: &SiteFrame) -> Self {
        let inverse = site.q_ecef_enu().inverse();
        let apart_m = layer.enu_to_ecef(DVec3::ZERO) - site.enu_to_ecef(DVec3::ZERO);
        if apart_m == DVec3::ZERO {
            // The very same frame: no rounding.
            return Self {
                turn: DQuat::IDENTITY,
                shift_m: DVec3::ZERO,
            };
        }
        Self {
            turn: inverse * layer.q_ecef_enu(),
            shift_m: inverse * apart_m,
        }
    }

    fn place_m(&self, r_m: DVec3) -> DVec3 {
        self.turn * r_m + self.shift_m
    }
}

/// Whether a mesh's lists fit each other.
fn check(mesh: &TexturedMesh, features: usize) -> Result<(), &'static str> {
    let count = mesh.positions.len();
    let fits = |length: usize| length == 0 || length == count;
    if !(fits(mesh.normals.len())
        && fits(mesh.uv.len())
        && fits(mesh.colors.len())
        && fits(mesh.features.len()))
    {
        return Err("its lists of vertices differ in length");
    }
    if !mesh.indices.len().is_multiple_of(3) {
        return Err("its number of indices is no multiple of three");
    }
    if mesh.indices.iter().any(|&i| i as usize >= count) {
        return Err("a triangle names a vertex that is not there");
    }
    if (mesh.features.iter()).any(|&f| f != NO_FEATURE && f as usize >= features) {
        return Err("a vertex names a feature that is not there");
    }
    let finite = |list: &[f32]| list.iter().all(|x| x.is_finite());
    if !(finite(mesh.uv.as_flattened())
        && finite(mesh.normals.as_flattened())
        && finite(mesh.colors.as_flattened()))
    {
        return Err("a normal, colour or place in the texture is no number");
    }
    Ok(())
}

/// Puts all layers on one lattice.
pub(super) fn gather(layers: &[Layer], octree: bool) -> Result<Scene, BuildError> {
    let Some(site) = layers.first().map(|layer| layer.site) else {
        return Err(BuildError::Empty);
    };
    let mut low_m = DVec3::INFINITY;
    let mut high_m = DVec3::NEG_INFINITY;
    let mut triangles_in = 0;
    for (l, layer) in layers.iter().enumerate() {
        let to_site = Move::between(&layer.site, &site);
        for (m, mesh) in layer.meshes.iter().enumerate() {
            check(mesh, layer.features.len()).map_err(|what| BuildError::Mesh {
                layer: l,
                mesh: m,
                what,
            })?;
            triangles_in += mesh.triangle_count();
            for &index in &mesh.indices {
                let at_m = to_site.place_m(mesh.vertex_m(index));
                let distance_m = at_m.length();
                // Also what is no number.
                if distance_m.is_nan() || distance_m > FARTHEST_M {
                    return Err(BuildError::Far {
                        layer: l,
                        mesh: m,
                        vertex: index as usize,
                        distance_m,
                        limit_m: FARTHEST_M,
                    });
                }
                low_m = low_m.min(at_m);
                high_m = high_m.max(at_m);
            }
        }
    }
    if triangles_in == 0 {
        return Err(BuildError::Empty);
    }
    let size_m = (high_m - low_m).max(DVec3::splat(1e-3));
    let bits = (size_m.max_element().log2().ceil() as i32 - LATTICE_BITS).max(-LATTICE_BITS);
    let step_m = 2f64.powi(bits);
    let cut_m = if octree {
        size_m.max_element()
    } else {
        size_m.x.max(size_m.y)
    };
    let part = 1 << MOST_LEVELS;
    let side = ((cut_m / step_m / f64::from(part)).floor() as i32 + 1) * part;
    let mut scene = Scene {
        site,
        origin_m: (low_m / step_m).floor() * step_m,
        step_m,
        side,
        materials: Vec::new(),
        textures: Vec::new(),
        features: Vec::new(),
        mesh: Mesh::default(),
        group_of: Vec::new(),
        groups: Vec::new(),
        triangles_in,
    };
    let mut pictures: Vec<Arc<Texture>> = Vec::new();
    for layer in layers {
        let first = scene.features.len() as u32;
        scene.features.extend(layer.features.iter().cloned());
        let to_site = Move::between(&layer.site, &site);
        for mesh in &layer.meshes {
            add_mesh(&mut scene, &mut pictures, layer.kind, mesh, first, &to_site);
        }
    }
    scene.textures = pictures.into_iter().map(Picture::new).collect();
    Ok(scene)
}

/// Adds a mesh of a layer.
fn add_mesh(
    scene: &mut Scene,
    pictures: &mut Vec<Arc<Texture>>,
    kind: LayerKind,
    mesh: &TexturedMesh,
    first_feature: u32,
    to_site: &Move,
) {
    let look = &mesh.look;
    let textured = (look.texture.as_ref())
        .filter(|t| !mesh.uv.is_empty() && t.size_px.iter().all(|&side| side > 0))
        .filter(|t| t.rgba.len() == 4 * t.size_px[0] as usize * t.size_px[1] as usize);
    let texture = textured.map(|texture| {
        let known = |known: &Arc<Texture>| Arc::ptr_eq(known, texture) || **known == **texture;
        pictures.iter().position(known).unwrap_or_else(|| {
            pictures.push(Arc::clone(texture));
            pictures.len() - 1
        })
    });
    let Uv {
        tiled,
        wraps,
        shift: uv_shift,
        limit: uv_limit,
    } = uv_habit(mesh, look, texture.is_some());
    let smooth = smooth(mesh);
    let mut material_of = |normals: bool, featured: bool| {
        let bare = Material {
            texture: None,
            tiled: false,
            wraps: false,
            plain: 0,
            unlit: look.unlit,
            double_sided: look.double_sided,
            alpha_cutoff: None,
            normals,
            featured,
        };
        let plain = intern(&mut scene.materials, bare);
        if texture.is_none() {
            return plain;
        }
        intern(
            &mut scene.materials,
            Material {
                texture,
                tiled,
                wraps,
                plain,
                alpha_cutoff: look.alpha_cutoff,
                ..bare
            },
        )
    };
    // By whether a triangle is smooth, and whether it has a feature.
    let mut material_by = [[None; 2]; 2];
    let mut own = Mesh {
        vertices: Vec::with_capacity(mesh.positions.len()),
        indices: mesh.indices.clone(),
    };
    let lattice = |r_m: DVec3| {
        ((r_m - scene.origin_m) / scene.step_m)
            .round()
            .to_array()
            .map(|x| x as i32)
    };
    for i in 0..mesh.positions.len() {
        let color = mesh.colors.get(i).copied().unwrap_or([1.0; 4]);
        let feature = mesh.features.get(i).copied().unwrap_or(NO_FEATURE);
        let normal = match mesh.normals.get(i).filter(|_| smooth[i]) {
            Some(normal) => {
                let turned = to_site.turn.as_quat() * Vec3::from(*normal);
                turned.normalize_or(Vec3::Z).to_array().map(|x| x + 0.0)
            }
            None => [0.0; 3],
        };
        let uv = match texture {
            Some(_) => std::array::from_fn(|k| {
                (mesh.uv[i][k] - uv_shift[k]).clamp(-uv_limit, uv_limit) + 0.0
            }),
            None => [0.0; 2],
        };
        own.vertices.push(Vertex {
            at: lattice(to_site.place_m(mesh.vertex_m(i as u32))),
            normal,
            uv,
            color: std::array::from_fn(|k| {
                ((color[k] * look.base_color[k]).clamp(0.0, 1.0) * 65535.0).round() as u16
            }),
            feature: if feature == NO_FEATURE {
                NO_FEATURE
            } else {
                feature + first_feature
            },
            material: *material_by[usize::from(smooth[i])][usize::from(feature != NO_FEATURE)]
                .get_or_insert_with(|| material_of(smooth[i], feature != NO_FEATURE)),
        });
    }
    // A triangle is of its first corner's material and feature.
    let own = one_material_a_triangle(own).welded();
    if kind == LayerKind::Terrain {
        scene.group_of.extend(vec![FREE; own.triangle_count()]);
    } else {
        group(scene, &own);
    }
    scene.mesh.append(&own);
}

/// The number of a material, with a place in the list; a material without texture is its own plain one.
fn intern(materials: &mut Vec<Material>, material: Material) -> u32 {
    let same = |m: &Material| {
        let plain = match material.texture {
            Some(_) => material.plain,
            None => m.plain,
        };
        *m == Material { plain, ..material }
    };
    let found = materials.iter().position(same).unwrap_or_else(|| {
        let plain = match material.texture {
            Some(_) => material.plain,
            None => materials.len() as u32,
        };
        materials.push(Material { plain, ..material });
        materials.len() - 1
    });
    found as u32
}

/// How a mesh uses its texture.
struct Uv {
    /// It repeats too often for an atlas.
    tiled: bool,
    /// It repeats.
    wraps: bool,
    /// What to take off all places.
    shift: [f32; 2],
    /// Their limit.
    limit: f32,
}

/// How a mesh uses its texture.
fn uv_habit(mesh: &TexturedMesh, look: &Look, textured: bool) -> Uv {
    if !textured || !look.repeats {
        // The border continues: what lies far outside shows the border's pixels anyway.
        return Uv {
            tiled: false,
            wraps: false,
            shift: [0.0; 2],
            limit: 2.0,
        };
    }
    /// A little beyond the border is rounding, not another turn.
    const ROUNDING: f32 = 1e-3;
    let mut low = [f32::INFINITY; 2];
    let mut high = [f32::NEG_INFINITY; 2];
    for &i in &mesh.indices {
        for k in 0..2 {
            low[k] = low[k].min(mesh.uv[i as usize][k]);
            high[k] = high[k].max(mesh.uv[i as usize][k]);
        }
    }
    let area = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|i| mesh.uv[i as usize]);
        let [u, v] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1]]);
        0.5 * (u[0] * v[1] - u[1] * v[0]).abs()
    };
    let (triangles, _) = mesh.indices.as_chunks::<3>();
    let used: f32 = triangles.iter().map(area).sum();
    if used > MOST_REPEATS || (0..2).any(|k| high[k] - low[k] > MOST_REPEATS) {
        return Uv {
            tiled: true,
            wraps: true,
            shift: [0.0; 2],
            limit: f32::MAX,
        };
    }
    let shift = low.map(|x| (x + ROUNDING).floor());
    Uv {
        tiled: false,
        wraps: (0..2).any(|k| high[k] - shift[k] > 1.0 + ROUNDING),
        shift,
        limit: 4.0,
    }
}

/// Whether each vertex has a normal other than those of its triangles. What is flat needs none, and welds.
fn smooth(mesh: &TexturedMesh) -> Vec<bool> {
    let mut smooth = vec![false; mesh.positions.len()];
    if mesh.normals.is_empty() || mesh.look.unlit {
        return smooth;
    }
    for triangle in mesh.indices.as_chunks::<3>().0 {
        let [a, b, c] = triangle.map(|i| Vec3::from(mesh.positions[i as usize]));
        let Some(face) = (b - a).cross(c - a).try_normalize() else {
            continue;
        };
        for &i in triangle {
            smooth[i as usize] |= face.dot(Vec3::from(mesh.normals[i as usize])) <= FLAT_COS;
        }
    }
    // A surface that is smooth somewhere is so in every corner.
    let mut surfaces = Sets::new(smooth.len());
    for triangle in mesh.indices.as_chunks::<3>().0 {
        surfaces.join(triangle[0], triangle[1]);
        surfaces.join(triangle[0], triangle[2]);
    }
    for i in 0..smooth.len() {
        let root = surfaces.root(i as u32) as usize;
        smooth[root] |= smooth[i];
    }
    (0..smooth.len() as u32)
        .map(|i| smooth[surfaces.root(i) as usize])
        .collect()
}

/// Gives every triangle corners of one material and feature: its first one's.
pub(super) fn one_material_a_triangle(mut mesh: Mesh) -> Mesh {
    for t in 0..mesh.triangle_count() {
        let first = mesh.vertices[mesh.indices[3 * t] as usize];
        for corner in 1..3 {
            let vertex = mesh.vertices[mesh.indices[3 * t + corner] as usize];
            if (vertex.material, vertex.feature) != (first.material, first.feature) {
                mesh.indices[3 * t + corner] = mesh.vertices.len() as u32;
                mesh.vertices.push(Vertex {
                    material: first.material,
                    feature: first.feature,
                    ..vertex
                });
            }
        }
    }
    mesh
}

/// Finds what stays in one piece: features, and connected parts of what has none.
fn group(scene: &mut Scene, mesh: &Mesh) {
    let mut sets = Sets::new(mesh.vertices.len());
    // Vertices at one place, or of one feature, belong together.
    let mut order: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    let feature = |i: u32| mesh.vertices[i as usize].feature;
    let at = |i: u32| mesh.vertices[i as usize].at;
    order.sort_unstable_by_key(|&i| (feature(i), at(i), i));
    for pair in order.windows(2) {
        let [a, b] = [pair[0], pair[1]];
        let same_place = feature(a) == feature(b) && at(a) == at(b);
        if same_place || (feature(a) == feature(b) && feature(a) != NO_FEATURE) {
            sets.join(a, b);
        }
    }
    for triangle in mesh.triangles() {
        sets.join(triangle[0], triangle[1]);
        sets.join(triangle[0], triangle[2]);
    }
    let mut number = vec![FREE; mesh.vertices.len()];
    for triangle in mesh.triangles() {
        let root = sets.root(triangle[0]) as usize;
        if number[root] == FREE {
            number[root] = scene.groups.len() as u32;
            let at = mesh.vertices[triangle[0] as usize].at;
            scene.groups.push([at, at]);
        }
        let [low, high] = &mut scene.groups[number[root] as usize];
        for corner in triangle {
            let at = mesh.vertices[*corner as usize].at;
            for k in 0..3 {
                low[k] = low[k].min(at[k]);
                high[k] = high[k].max(at[k]);
            }
        }
        scene.group_of.push(number[root]);
    }
}

/// Disjoint sets of indices.
pub(super) struct Sets(Vec<u32>);

impl Sets {
    /// Every index alone.
    pub fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    /// The least index of a set.
    pub fn root(&mut self, mut i: u32) -> u32 {
        while self.0[i as usize] != i {
            let up = self.0[self.0[i as usize] as usize];
            self.0[i as usize] = up;
            i = up;
        }
        i
    }

    /// Makes one set of two.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        let (low, high) = (a.min(b), a.max(b));
        self.0[high as usize] = low;
    }
}
