//! Triangle meshes as plain data: what the geometry models produce and a renderer uploads.
//!
//! Builders take coordinates of the mesh's parent frame (ENU or body) as f64 and store f32 about
//! an f64 origin, so that a city tile kilometres away keeps sub-millimetre vertices.

use glam::{DAffine3, DMat3, DVec2, DVec3, Vec3};
use std::collections::BTreeMap;

use crate::maths::polygon::rectangle;

/// What a fragment shader draws on a triangle; stored as f32 in [`MeshData::surface`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Surface {
    /// Uniform albedo.
    Plain = 0,
    /// A wall with punched windows; uv is in metres.
    FacadeResidential = 1,
    /// A wall with ribbon or curtain glazing; uv is in metres.
    FacadeOffice = 2,
    /// Terrain: the albedo is the ground map at uv.
    Ground = 3,
    /// Leaves.
    Foliage = 4,
    /// A water surface.
    Water = 5,
}

impl Surface {
    /// Every kind, each at its number.
    pub const ALL: [Self; 6] = [
        Self::Plain,
        Self::FacadeResidential,
        Self::FacadeOffice,
        Self::Ground,
        Self::Foliage,
        Self::Water,
    ];
}

/// How a face is painted.
#[derive(Clone, Copy, Debug)]
pub struct Paint {
    /// Linear RGB albedo.
    pub albedo: [f32; 3],
    /// The surface kind.
    pub surface: Surface,
    /// Per-object random number in 0..1 (window phase, share of lit windows, tint).
    pub variant: f32,
}

impl Paint {
    /// A uniform surface of linear RGB albedo.
    pub fn plain(albedo: [f32; 3]) -> Self {
        Self {
            albedo,
            surface: Surface::Plain,
            variant: 0.0,
        }
    }
}

/// An indexed triangle mesh; triangles wind counter-clockwise seen from outside.
#[derive(Clone, Debug, Default)]
pub struct MeshData {
    /// Where the local frame's origin lies in the parent frame [m]; the axes are parallel.
    pub origin_enu_m: DVec3,
    /// Vertices about the origin [m].
    pub positions: Vec<[f32; 3]>,
    /// Unit outward normals.
    pub normals: Vec<[f32; 3]>,
    /// Linear RGB albedo, and ambient occlusion in 0..1 (1: the whole hemisphere is open).
    pub colors: Vec<[f32; 4]>,
    /// Facades: metres along the wall and above ground; ground: map coordinates 0..1; blades: place on the half
    /// chord, -1 to 1, and its angle [rad].
    pub uv: Vec<[f32; 2]>,
    /// [`Surface`] as f32, and the variant in 0..1; of a blade the angle from one to the next [rad].
    pub surface: Vec<[f32; 2]>,
    /// Three per triangle.
    pub indices: Vec<u32>,
}

impl MeshData {
    /// An empty mesh about an origin [m].
    pub fn new(origin_enu_m: DVec3) -> Self {
        Self {
            origin_enu_m,
            ..Self::default()
        }
    }

    /// The mesh in parts of one surface kind each, in the kinds' order: a triangle is of the kind of its
    /// first vertex.
    pub fn by_surface(&self) -> Vec<(Surface, Self)> {
        let kind_of = |triangle: [u32; 3]| self.surface[triangle[0] as usize][0] as usize;
        let parts = self.parted(kind_of).into_iter();
        parts
            .filter_map(|(kind, part)| Some((*Surface::ALL.get(kind)?, part)))
            .collect()
    }

    /// The mesh cut along a square grid on the map, of this side [m] from the origin on: a triangle goes where its
    /// middle lies, whole, and keeps its place among the others.
    pub fn cut(&self, side_m: f64) -> Vec<Self> {
        let cell_of = |triangle: [u32; 3]| {
            let corners = triangle.map(|i| Vec3::from(self.positions[i as usize]));
            let middle = (corners[0] + corners[1] + corners[2]).as_dvec3() / 3.0;
            [middle.x, middle.y].map(|x| (x / side_m).floor() as i64)
        };
        self.parted(cell_of).into_values().collect()
    }

    /// The mesh in parts, each about the same origin with the vertices that its triangles need.
    fn parted<K: Ord>(&self, key_of: impl Fn([u32; 3]) -> K) -> BTreeMap<K, Self> {
        let mut triangles_of: BTreeMap<K, Vec<[u32; 3]>> = BTreeMap::new();
        for triangle in self.indices.as_chunks::<3>().0 {
            let triangles = triangles_of.entry(key_of(*triangle)).or_default();
            triangles.push(*triangle);
        }
        let mut moved = vec![u32::MAX; self.positions.len()];
        let part = |(key, triangles): (K, Vec<[u32; 3]>)| {
            let mut part = Self::new(self.origin_enu_m);
            for old in triangles.iter().flatten().map(|i| *i as usize) {
                if moved[old] == u32::MAX {
                    moved[old] = part.positions.len() as u32;
                    part.positions.push(self.positions[old]);
                    part.normals.push(self.normals[old]);
                    part.colors.push(self.colors[old]);
                    part.uv.push(self.uv[old]);
                    part.surface.push(self.surface[old]);
                }
                part.indices.push(moved[old]);
            }
            for old in triangles.into_iter().flatten() {
                moved[old as usize] = u32::MAX;
            }
            (key, part)
        };
        triangles_of.into_iter().map(part).collect()
    }

    /// Orders the triangles from near to far as seen from a place [m] in the parent frame: drawn so, hardly
    /// any is shaded and then covered.
    pub fn sort_from(&mut self, eye_enu_m: DVec3) {
        let eye = (eye_enu_m - self.origin_enu_m).as_vec3();
        let (triangles, _) = self.indices.as_chunks::<3>();
        let mut ranked: Vec<(f32, [u32; 3])> = triangles
            .iter()
            .map(|triangle| {
                let corners = triangle.map(|i| Vec3::from(self.positions[i as usize]));
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
                (middle.distance_squared(eye), *triangle)
            })
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.indices = ranked
            .into_iter()
            .flat_map(|(_, corners)| corners)
            .collect();
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.indices.len() / 3
    }

    /// The corners of every triangle in the parent frame [m].
    pub fn corners_m(&self) -> impl Iterator<Item = [DVec3; 3]> {
        let at =
            |i: u32| self.origin_enu_m + DVec3::from(self.positions[i as usize].map(f64::from));
        (self.indices.as_chunks::<3>().0.iter()).map(move |triangle| triangle.map(at))
    }

    /// Corners (minimum, maximum) of the bounding box about the origin [m]; None when empty.
    pub fn bounds_m(&self) -> Option<(DVec3, DVec3)> {
        let mut points = self.positions.iter().map(|p| DVec3::from(p.map(f64::from)));
        let first = points.next()?;
        Some(points.fold((first, first), |(low, high), p| (low.min(p), high.max(p))))
    }

    /// Signed volume [m³] by the divergence theorem; positive for a closed mesh facing outward.
    pub fn signed_volume_m3(&self) -> f64 {
        let at = |i: u32| DVec3::from(self.positions[i as usize].map(f64::from));
        self.indices
            .chunks_exact(3)
            .map(|t| at(t[0]).dot(at(t[1]).cross(at(t[2]))) / 6.0)
            .sum()
    }

    /// Adds another mesh, moved by `to_parent_m` in this mesh's parent frame.
    pub fn append(&mut self, part: &MeshData, to_parent_m: DAffine3) {
        let first = self.positions.len() as u32;
        let offset = part.origin_enu_m;
        let origin = self.origin_enu_m;
        // Normals transform by the cofactor matrix, right for stretches and mirrors alike.
        let m: DMat3 = to_parent_m.matrix3;
        let mirrored = m.determinant() < 0.0;
        let normal_map = m.inverse().transpose();
        for (p, n) in part.positions.iter().zip(&part.normals) {
            let p = to_parent_m.transform_point3(DVec3::from(p.map(f64::from)) + offset) - origin;
            let n = (normal_map * DVec3::from(n.map(f64::from))).normalize_or_zero();
            self.positions.push(p.as_vec3().to_array());
            self.normals.push(n.as_vec3().to_array());
        }
        self.colors.extend_from_slice(&part.colors);
        self.uv.extend_from_slice(&part.uv);
        self.surface.extend_from_slice(&part.surface);
        self.indices
            .extend(part.indices.chunks_exact(3).flat_map(|t| {
                let [a, b, c] = [t[0] + first, t[1] + first, t[2] + first];
                if mirrored { [a, c, b] } else { [a, b, c] }
            }));
    }

    /// Adds one vertex of the parent frame and returns its index.
    pub fn vertex(
        &mut self,
        at_m: DVec3,
        normal: DVec3,
        uv: [f32; 2],
        ao: f32,
        paint: Paint,
    ) -> u32 {
        let [r, g, b] = paint.albedo;
        self.positions
            .push((at_m - self.origin_enu_m).as_vec3().to_array());
        self.normals.push(normal.as_vec3().to_array());
        self.colors.push([r, g, b, ao]);
        self.uv.push(uv);
        self.surface
            .push([paint.surface as u8 as f32, paint.variant]);
        (self.positions.len() - 1) as u32
    }

    /// Adds a flat convex polygon, corners counter-clockwise from outside, with uv and ambient
    /// occlusion per corner. A polygon without area is left out.
    pub fn face_with(&mut self, corners_m: &[DVec3], uv: &[[f32; 2]], ao: &[f32], paint: Paint) {
        let normal = newell(corners_m);
        if normal == DVec3::ZERO || uv.len() < corners_m.len() || ao.len() < corners_m.len() {
            return;
        }
        let first = self.positions.len() as u32;
        for ((&p, &uv), &ao) in corners_m.iter().zip(uv).zip(ao) {
            self.vertex(p, normal, uv, ao, paint);
        }
        for i in 2..corners_m.len() as u32 {
            self.indices.extend([first, first + i - 1, first + i]);
        }
    }

    /// Adds a flat convex polygon without uv, fully open to the sky.
    pub fn face(&mut self, corners_m: &[DVec3], paint: Paint) {
        let n = corners_m.len();
        self.face_with(corners_m, &vec![[0.0; 2]; n], &vec![1.0; n], paint);
    }

    /// Adds a flat horizontal polygon facing up at height `z_m`; any simple outline, CCW from above.
    pub fn floor(&mut self, outline_m: &[DVec2], z_m: f64, ao: f32, paint: Paint) {
        let first = self.positions.len() as u32;
        for p in outline_m {
            self.vertex(p.extend(z_m), DVec3::Z, [0.0; 2], ao, paint);
        }
        for [a, b, c] in triangulate(outline_m) {
            self.indices
                .extend([first + a as u32, first + b as u32, first + c as u32]);
        }
    }

    /// Adds a closed upright prism over a simple CCW outline.
    pub fn prism(&mut self, outline_m: &[DVec2], z_low_m: f64, z_high_m: f64, paint: Paint) {
        let n = outline_m.len();
        for i in 0..n {
            let (a, b) = (outline_m[i], outline_m[(i + 1) % n]);
            let corners = [
                a.extend(z_low_m),
                b.extend(z_low_m),
                b.extend(z_high_m),
                a.extend(z_high_m),
            ];
            self.face(&corners, paint);
        }
        self.floor(outline_m, z_high_m, 1.0, paint);
        let first = self.positions.len() as u32;
        for p in outline_m {
            self.vertex(p.extend(z_low_m), DVec3::NEG_Z, [0.0; 2], 0.5, paint);
        }
        for [a, b, c] in triangulate(outline_m) {
            self.indices
                .extend([first + a as u32, first + c as u32, first + b as u32]);
        }
    }

    /// Adds an axis-aligned box.
    pub fn cuboid(&mut self, low_m: DVec3, high_m: DVec3, paint: Paint) {
        let outline = rectangle(
            (low_m.truncate() + high_m.truncate()) * 0.5,
            DVec2::X,
            (high_m.truncate() - low_m.truncate()) * 0.5,
        );
        self.prism(&outline, low_m.z, high_m.z, paint);
    }

    /// Adds a closed body through rings of equally many points, smooth along its sides and flat at
    /// its ends. Rings run counter-clockwise seen against the direction from the first ring to the
    /// last (from above for a stack going up); a ring may shrink to a point.
    pub fn loft(&mut self, rings_m: &[Vec<DVec3>], paint: Paint) {
        let Some(sides) = rings_m.first().map(Vec::len) else {
            return;
        };
        if sides < 3 || rings_m.iter().any(|r| r.len() != sides) {
            return;
        }
        let first = self.positions.len() as u32;
        let points: Vec<DVec3> = rings_m.iter().flatten().copied().collect();
        let mut normals = vec![DVec3::ZERO; points.len()];
        for k in 0..(rings_m.len() - 1) * sides {
            let (ring, i) = (k / sides * sides, k % sides);
            let j = (i + 1) % sides;
            let [a, b, c, d] = [ring + i, ring + j, ring + sides + j, ring + sides + i];
            // By quads: triangles would lean the normals toward the side split at a vertex.
            let area = (points[c] - points[a]).cross(points[d] - points[b]);
            [a, b, c, d].iter().for_each(|&v| normals[v] += area);
            for t in [[a, b, c], [a, c, d]] {
                let area = (points[t[1]] - points[t[0]]).cross(points[t[2]] - points[t[0]]);
                // Triangles at a point-like ring have no area.
                if area.length() > 1e-12 {
                    self.indices.extend(t.map(|v| first + v as u32));
                }
            }
        }
        // The coincident points of a ring shrunk to a point share one normal.
        for (r, ring) in rings_m.iter().enumerate() {
            if ring.iter().all(|p| p.distance(ring[0]) < 1e-9) {
                let sum: DVec3 = normals[r * sides..(r + 1) * sides].iter().sum();
                normals[r * sides..(r + 1) * sides].fill(sum);
            }
        }
        for (&p, n) in points.iter().zip(normals) {
            self.vertex(p, n.normalize_or(DVec3::Z), [0.0; 2], 1.0, paint);
        }
        let bottom: Vec<DVec3> = rings_m[0].iter().rev().copied().collect();
        self.face(&bottom, paint);
        self.face(&rings_m[rings_m.len() - 1], paint);
    }

    /// Adds a closed cylinder, cone or frustum between two points with a radius at each [m].
    pub fn frustum(
        &mut self,
        (from_m, from_radius_m): (DVec3, f64),
        (to_m, to_radius_m): (DVec3, f64),
        sides: usize,
        paint: Paint,
    ) {
        let axis = (to_m - from_m).normalize_or(DVec3::Z);
        let rings = [
            ring(from_m, axis, from_radius_m, sides),
            ring(to_m, axis, to_radius_m, sides),
        ];
        self.loft(&rings, paint);
    }

    /// Adds a one-sided disc facing along `normal`.
    pub fn disc(
        &mut self,
        center_m: DVec3,
        normal: DVec3,
        radius_m: f64,
        sides: usize,
        paint: Paint,
    ) {
        self.face(
            &ring(center_m, normal.normalize_or(DVec3::Z), radius_m, sides),
            paint,
        );
    }

    /// Adds an ellipsoid with semi-axes `radii_m`, an icosahedron split `subdivisions` times
    /// (20·4ⁿ triangles).
    pub fn icosphere(&mut self, center_m: DVec3, radii_m: DVec3, subdivisions: u32, paint: Paint) {
        let g = (1.0 + 5f64.sqrt()) / 2.0;
        let mut points: Vec<DVec3> = [
            [-1.0, g, 0.0],
            [1.0, g, 0.0],
            [-1.0, -g, 0.0],
            [1.0, -g, 0.0],
            [0.0, -1.0, g],
            [0.0, 1.0, g],
            [0.0, -1.0, -g],
            [0.0, 1.0, -g],
            [g, 0.0, -1.0],
            [g, 0.0, 1.0],
            [-g, 0.0, -1.0],
            [-g, 0.0, 1.0],
        ]
        .map(|p| DVec3::from(p).normalize())
        .to_vec();
        #[rustfmt::skip]
        let mut triangles: Vec<[u32; 3]> = vec![
            [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11],
            [1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8],
            [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9],
            [4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
        ];
        for _ in 0..subdivisions {
            let mut edges: Vec<([u32; 2], u32)> = Vec::new();
            let mut middle = |a: u32, b: u32| {
                let key = [a.min(b), a.max(b)];
                if let Some(&(_, v)) = edges.iter().find(|(k, _)| *k == key) {
                    return v;
                }
                points.push((points[a as usize] + points[b as usize]).normalize());
                edges.push((key, points.len() as u32 - 1));
                points.len() as u32 - 1
            };
            triangles = triangles
                .iter()
                .flat_map(|&[a, b, c]| {
                    let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                    [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
                })
                .collect();
        }
        let first = self.positions.len() as u32;
        for p in points {
            let normal = (p / radii_m).normalize_or(DVec3::Z);
            self.vertex(center_m + p * radii_m, normal, [0.0; 2], 1.0, paint);
        }
        self.indices
            .extend(triangles.into_iter().flatten().map(|i| first + i));
    }
}

/// Corners of a regular polygon about `axis`, counter-clockwise seen against it [m].
pub fn ring(center_m: DVec3, axis: DVec3, radius_m: f64, sides: usize) -> Vec<DVec3> {
    let (x, y) = axis.any_orthonormal_pair();
    (0..sides)
        .map(|k| {
            let (sin, cos) = (std::f64::consts::TAU * k as f64 / sides as f64).sin_cos();
            center_m + (x * cos + y * sin) * radius_m
        })
        .collect()
}

/// Unit normal of a polygon by Newell's method; zero for a polygon without area.
fn newell(corners_m: &[DVec3]) -> DVec3 {
    let n = corners_m.len();
    if n < 3 {
        return DVec3::ZERO;
    }
    let sum: DVec3 = (1..n - 1)
        .map(|i| (corners_m[i] - corners_m[0]).cross(corners_m[i + 1] - corners_m[0]))
        .sum();
    if sum.length() < 1e-12 {
        DVec3::ZERO
    } else {
        sum.normalize()
    }
}

/// Triangles (corner indices, counter-clockwise) of a simple CCW polygon by ear clipping.
fn triangulate(outline_m: &[DVec2]) -> Vec<[usize; 3]> {
    let turn = |a: DVec2, b: DVec2, c: DVec2| (b - a).perp_dot(c - a);
    let mut left: Vec<usize> = (0..outline_m.len()).collect();
    let mut triangles = Vec::with_capacity(outline_m.len().saturating_sub(2));
    while left.len() > 2 {
        let n = left.len();
        let ear = (0..n).find(|&k| {
            let [i, j, l] = [left[(k + n - 1) % n], left[k], left[(k + 1) % n]];
            let [a, b, c] = [outline_m[i], outline_m[j], outline_m[l]];
            turn(a, b, c) > 0.0
                && left
                    .iter()
                    .filter(|&&v| v != i && v != j && v != l)
                    .all(|&v| {
                        let p = outline_m[v];
                        turn(a, b, p) < 0.0 || turn(b, c, p) < 0.0 || turn(c, a, p) < 0.0
                    })
        });
        // An outline with collinear corners leaves flat ears behind; they carry no area.
        let k = ear.unwrap_or(0);
        if ear.is_some() {
            triangles.push([left[(k + n - 1) % n], left[k], left[(k + 1) % n]]);
        }
        left.remove(k);
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    const GREY: Paint = Paint {
        albedo: [0.4; 3],
        surface: Surface::Plain,
        variant: 0.5,
    };

    #[test]
    fn sorted_triangles_are_the_same_ones_near_to_far() {
        let mut mesh = MeshData::new(DVec3::new(100.0, 0.0, 0.0));
        for x in [130.0, 40.0, 100.0] {
            let at = |y: f64, z: f64| DVec3::new(x, y, z);
            mesh.face(&[at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0)], GREY);
        }
        let before = mesh.clone();
        mesh.sort_from(DVec3::ZERO);
        assert_eq!(mesh.positions, before.positions);
        let (sorted, _) = mesh.indices.as_chunks::<3>();
        let (drawn, _) = before.indices.as_chunks::<3>();
        assert_eq!(sorted, [drawn[1], drawn[2], drawn[0]]);
    }

    fn check_winding(mesh: &MeshData) {
        let at = |v: &Vec<[f32; 3]>, i: u32| DVec3::from(v[i as usize].map(f64::from));
        assert_eq!(mesh.positions.len(), mesh.normals.len());
        assert_eq!(mesh.positions.len(), mesh.colors.len());
        assert_eq!(mesh.positions.len(), mesh.surface.len());
        for t in mesh.indices.chunks_exact(3) {
            let [a, b, c] = [t[0], t[1], t[2]].map(|i| at(&mesh.positions, i));
            let face = (b - a).cross(c - a).normalize();
            for &i in t {
                let normal = at(&mesh.normals, i);
                assert!((normal.length() - 1.0).abs() < 1e-5);
                assert!(face.dot(normal) > 0.1, "{face} against {normal}");
            }
        }
    }

    fn built(build: impl Fn(&mut MeshData)) -> MeshData {
        let mut mesh = MeshData::new(DVec3::new(10.0, -20.0, 5.0));
        build(&mut mesh);
        check_winding(&mesh);
        mesh
    }

    #[test]
    fn volumes_match_closed_forms() {
        let cases = [
            (
                built(|m| m.cuboid(DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0), GREY)),
                6.0,
                1e-5,
            ),
            (
                built(|m| {
                    let l = [(0., 0.), (3., 0.), (3., 1.), (1., 1.), (1., 3.), (0., 3.)];
                    m.prism(&l.map(DVec2::from), -1.0, 1.0, GREY);
                }),
                10.0,
                1e-5,
            ),
            (
                // A 96-gon's area is 0.07 % below the circle's.
                built(|m| m.frustum((DVec3::X, 2.0), (DVec3::X + DVec3::Y * 3.0, 1.0), 96, GREY)),
                PI * 3.0 / 3.0 * (4.0 + 2.0 + 1.0),
                2e-3,
            ),
            (
                built(|m| {
                    m.frustum(
                        (DVec3::ZERO, 1.0),
                        (DVec3::new(1.0, 1.0, 1.0), 0.0),
                        96,
                        GREY,
                    )
                }),
                PI / 3.0 * 3f64.sqrt(),
                2e-3,
            ),
            (
                // The inscribed polyhedron of 1280 faces loses 0.9 %.
                built(|m| m.icosphere(DVec3::ONE, DVec3::new(1.0, 2.0, 0.5), 3, GREY)),
                4.0 / 3.0 * PI,
                1.2e-2,
            ),
        ];
        for (mesh, volume, tolerance) in cases {
            let got = mesh.signed_volume_m3();
            assert!(
                (got / volume - 1.0).abs() < tolerance,
                "{got} against {volume}"
            );
        }
    }

    #[test]
    fn appending_keeps_facing_even_mirrored() {
        let part = built(|m| m.cuboid(DVec3::ZERO, DVec3::ONE, GREY));
        for scale in [DVec3::new(2.0, 1.0, 1.0), DVec3::new(-2.0, 1.0, 1.0)] {
            let mut mesh = MeshData::new(DVec3::ZERO);
            mesh.append(&part, DAffine3::from_scale(scale));
            check_winding(&mesh);
            assert!((mesh.signed_volume_m3() - 2.0).abs() < 1e-5);
        }
    }

    #[test]
    fn a_disc_faces_its_normal() {
        let mesh = built(|m| m.disc(DVec3::ZERO, DVec3::new(1.0, 2.0, -1.0), 1.0, 12, GREY));
        let n = DVec3::from(mesh.normals[0].map(f64::from));
        assert!(n.dot(DVec3::new(1.0, 2.0, -1.0).normalize()) > 1.0 - 1e-6);
    }

    #[test]
    fn origins_cancel() {
        let mesh = built(|m| {
            m.cuboid(
                DVec3::new(9.0, -21.0, 4.0),
                DVec3::new(11.0, -19.0, 6.0),
                GREY,
            )
        });
        assert_eq!(mesh.bounds_m(), Some((-DVec3::ONE, DVec3::ONE)));
    }

    #[test]
    fn cutting_keeps_every_triangle_whole() {
        let mut mesh = MeshData::new(DVec3::new(100.0, 50.0, 0.0));
        for x_m in [-24.0, -4.0, 1.0, 38.0] {
            let low_m = mesh.origin_enu_m + DVec3::new(x_m, 2.0, 0.0);
            mesh.cuboid(
                low_m,
                low_m + DVec3::new(3.0, 4.0, 5.0),
                Paint::plain([0.5; 3]),
            );
        }
        let corners = |mesh: &MeshData| -> Vec<[DVec3; 3]> { mesh.corners_m().collect() };
        let parts = mesh.cut(10.0);
        assert_eq!(parts.len(), 5);
        let mut found: Vec<[DVec3; 3]> = parts.iter().flat_map(corners).collect();
        for triangle in corners(&mesh) {
            let at = found.iter().position(|other| *other == triangle);
            found.swap_remove(at.expect("each triangle is in a part"));
        }
        assert!(found.is_empty());
        for part in &parts {
            let cell = |triangle: [DVec3; 3]| {
                let middle = triangle.iter().sum::<DVec3>() / 3.0 - part.origin_enu_m;
                (middle.truncate() / 10.0).floor()
            };
            let mut cells = part.corners_m().map(cell);
            let first = cells.next();
            assert!(cells.all(|cell| Some(cell) == first));
        }
    }

    #[test]
    fn concave_outlines_keep_their_area() {
        let u: Vec<DVec2> = [
            (0., 0.),
            (5., 0.),
            (5., 4.),
            (4., 4.),
            (4., 1.),
            (1., 1.),
            (1., 4.),
            (0., 4.),
        ]
        .map(DVec2::from)
        .to_vec();
        let area: f64 = triangulate(&u)
            .iter()
            .map(|&[a, b, c]| 0.5 * (u[b] - u[a]).perp_dot(u[c] - u[a]))
            .sum();
        assert!((area - 11.0).abs() < 1e-12);
    }
}
