//! Polygons with holes, gathered into triangle meshes.

use boresight_common::warning::Notes;
use boresight_models::maths::polygon;
use boresight_models::shape::textured::{Look, TexturedMesh};
use earcut::Earcut;
use glam::{DVec2, DVec3};

/// A corner of a polygon: its place [m] and its place in the texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Where it lies [m].
    pub r_m: DVec3,
    /// Place in the texture, (0, 0) at its top left.
    pub uv: [f32; 2],
}

impl From<DVec3> for Corner {
    fn from(r_m: DVec3) -> Self {
        Self { r_m, uv: [0.0; 2] }
    }
}

/// Twice the area vector of a ring [m²]: its length is twice the area, its direction the side from which the ring runs
/// counter-clockwise (Newell).
pub fn area_vector_m2(ring: &[Corner]) -> DVec3 {
    let Some(first) = ring.first() else {
        return DVec3::ZERO;
    };
    let arms = ring.windows(2);
    arms.map(|pair| (pair[0].r_m - first.r_m).cross(pair[1].r_m - first.r_m))
        .sum()
}

/// Shares by which a hole is made smaller where it touches another ring, the least first.
const HAIRS: [f64; 3] = [1e-7, 1e-5, 1e-3];
/// Share of its area by which the triangles of a polygon must miss it for its rings to cross.
const CROSSED: f64 = 0.02;
/// Share of its area by which the triangles of a polygon may miss it.
const MISSED: f64 = 1e-5;

/// Whether triangles have the area of an outline without its holes; `holes` are where these begin.
fn covers(points: &[[f64; 2]], holes: &[usize], indices: &[usize]) -> bool {
    let ends = holes.iter().copied().chain([points.len()]);
    let area = |ring: &[[f64; 2]]| {
        let ring: Vec<DVec2> = ring.iter().copied().map(DVec2::from).collect();
        polygon::area_m2(&ring).abs()
    };
    let mut from = 0;
    let mut wanted = 0.0;
    for to in ends {
        let own = area(&points[from..to]);
        wanted += if from == 0 { own } else { -own };
        from = to;
    }
    let triangles = indices.chunks_exact(3);
    let found: f64 = triangles
        .map(|t| area(&[points[t[0]], points[t[1]], points[t[2]]]))
        .sum();
    (found - wanted).abs() <= MISSED * wanted.abs()
}

/// Triangles of a polygon: its first ring is the outline, the others are holes. Indices count the corners of all rings in order.
/// They wind as the outline does; a polygon without area has none.
pub fn triangulate(rings: &[Vec<Corner>], scratch: &mut Earcut<f64>) -> Vec<[usize; 3]> {
    let Some(outline) = rings.first().filter(|ring| ring.len() >= 3) else {
        return Vec::new();
    };
    let normal = area_vector_m2(outline).normalize_or_zero();
    if normal == DVec3::ZERO || !normal.is_finite() {
        return Vec::new();
    }
    if rings.len() == 1 && outline.len() == 3 {
        return vec![[0, 1, 2]];
    }
    let (x, y) = normal.any_orthonormal_pair();
    let origin = outline[0].r_m;
    let flat = |corner: &Corner| {
        let r = corner.r_m - origin;
        [r.dot(x), r.dot(y)]
    };
    let points: Vec<[f64; 2]> = rings.iter().flatten().map(flat).collect();
    if !points.iter().flatten().all(|v| v.is_finite()) {
        return Vec::new();
    }
    let mut holes = Vec::new();
    let mut at = outline.len();
    for ring in &rings[1..] {
        if ring.len() >= 3 {
            holes.push(at);
        }
        at += ring.len();
    }
    // A hole of fewer corners than three would run into the ring before it.
    if holes.len() + 1 != rings.len() {
        return Vec::new();
    }
    let mut indices = Vec::new();
    scratch.earcut_slice(&points, &holes, &mut indices);
    if !holes.is_empty() && !covers(&points, &holes, &indices) {
        // A hole that touches the outline or another one, or leaves it by a rounding, is not always cut out: a hair smaller it is.
        let starts: Vec<usize> = holes.iter().copied().chain([points.len()]).collect();
        for hair in HAIRS {
            let mut smaller = points.clone();
            for ring in starts.windows(2).map(|ends| ends[0]..ends[1]) {
                let sum: DVec2 = points[ring.clone()].iter().copied().map(DVec2::from).sum();
                let middle = sum / ring.len() as f64;
                for k in ring {
                    smaller[k] = middle.lerp(points[k].into(), 1.0 - hair).to_array();
                }
            }
            let mut again = Vec::new();
            scratch.earcut_slice(&smaller, &holes, &mut again);
            if covers(&smaller, &holes, &again) {
                indices = again;
                break;
            }
        }
    }
    let turned = |t: &[usize]| {
        let [a, b, c] = [t[0], t[1], t[2]].map(|k| DVec2::from(points[k]));
        if (b - a).perp_dot(c - a) < 0.0 {
            [t[0], t[2], t[1]]
        } else {
            [t[0], t[1], t[2]]
        }
    };
    indices.chunks_exact(3).map(turned).collect()
}

/// Polygons of one look.
#[derive(Debug, Default)]
struct Part {
    look: Look,
    corners: Vec<Corner>,
    normals: Vec<DVec3>,
    colors: Vec<[f32; 4]>,
    features: Vec<u32>,
    indices: Vec<u32>,
}

/// Most corners of a mesh.
const MOST_CORNERS: usize = 1 << 20;

/// Collects polygons and hands them out as meshes.
pub struct Surfaces {
    parts: Vec<Part>,
    /// Polygons whose triangles do not have their area: rings that cross.
    crossed: usize,
    scratch: Earcut<f64>,
}

impl Default for Surfaces {
    fn default() -> Self {
        Self {
            parts: vec![Part::default()],
            crossed: 0,
            scratch: Earcut::new(),
        }
    }
}

impl Surfaces {
    /// A new look beside the plain one (0).
    pub fn add_look(&mut self, look: Look) -> usize {
        self.parts.push(Part {
            look,
            ..Part::default()
        });
        self.parts.len() - 1
    }

    /// A polygon of a feature: its outline and holes, open rings, counter-clockwise seen from outside. Whether it has an area.
    pub fn polygon(
        &mut self,
        rings: &[Vec<Corner>],
        feature: u32,
        color: [f32; 4],
        look: usize,
    ) -> bool {
        let triangles = triangulate(rings, &mut self.scratch);
        let Some(part) = self.parts.get_mut(look).filter(|_| !triangles.is_empty()) else {
            return false;
        };
        let normal = area_vector_m2(&rings[0]).normalize_or_zero();
        let twice = |ring: &Vec<Corner>| area_vector_m2(ring).length();
        let wanted = twice(&rings[0]) - rings[1..].iter().map(twice).sum::<f64>();
        let all: Vec<DVec3> = rings.iter().flatten().map(|corner| corner.r_m).collect();
        let area = |t: &[usize; 3]| {
            (all[t[1]] - all[t[0]])
                .cross(all[t[2]] - all[t[0]])
                .length()
        };
        let found: f64 = triangles.iter().map(area).sum();
        // Polygons that are not quite flat have a little more.
        self.crossed += usize::from((found - wanted).abs() > CROSSED * wanted.abs());
        let base = part.corners.len() as u32;
        for corner in rings.iter().flatten() {
            part.corners.push(*corner);
            part.normals.push(normal);
            part.colors.push(color);
            part.features.push(feature);
        }
        let indices = triangles.into_iter().flatten();
        part.indices.extend(indices.map(|k| base + k as u32));
        true
    }

    /// Says to the notes how many polygons cross themselves or their holes.
    pub fn note(&self, notes: &mut Notes) {
        if self.crossed > 0 {
            let what = format!(
                "{} cross themselves or their holes: drawn as far as they can be cut into triangles",
                self.crossed
            );
            notes.assume(
                "surfaces",
                what,
                "draw them anew, holes inside their outlines",
            );
        }
    }

    /// The meshes, each about the middle of its corners.
    pub fn finish(self) -> Vec<TexturedMesh> {
        let full = self
            .parts
            .into_iter()
            .filter(|part| !part.indices.is_empty());
        full.flat_map(Part::split).map(Part::mesh).collect()
    }
}

impl Part {
    /// Parts of at most `MOST_CORNERS` corners.
    fn split(self) -> Vec<Self> {
        if self.corners.len() <= MOST_CORNERS {
            return vec![self];
        }
        let mut parts = Vec::new();
        let mut place = vec![u32::MAX; self.corners.len()];
        let mut part = Self {
            look: self.look.clone(),
            ..Self::default()
        };
        let mut used = Vec::new();
        for triangle in self.indices.chunks_exact(3) {
            for &k in triangle {
                let k = k as usize;
                if place[k] == u32::MAX {
                    place[k] = part.corners.len() as u32;
                    used.push(k);
                    part.corners.push(self.corners[k]);
                    part.normals.push(self.normals[k]);
                    part.colors.push(self.colors[k]);
                    part.features.push(self.features[k]);
                }
                part.indices.push(place[k]);
            }
            if part.corners.len() + 3 > MOST_CORNERS {
                for k in used.drain(..) {
                    place[k] = u32::MAX;
                }
                let next = Self {
                    look: self.look.clone(),
                    ..Self::default()
                };
                parts.push(std::mem::replace(&mut part, next));
            }
        }
        parts.push(part);
        parts
    }

    fn mesh(self) -> TexturedMesh {
        let low = self
            .corners
            .iter()
            .map(|c| c.r_m)
            .fold(DVec3::INFINITY, DVec3::min);
        let high = self
            .corners
            .iter()
            .map(|c| c.r_m)
            .fold(DVec3::NEG_INFINITY, DVec3::max);
        // Whole metres, which f32 and f64 hold alike.
        let origin_m = ((low + high) / 2.0).round();
        let textured = self.look.texture.is_some();
        TexturedMesh {
            origin_m,
            positions: self
                .corners
                .iter()
                .map(|c| (c.r_m - origin_m).as_vec3().into())
                .collect(),
            normals: self.normals.iter().map(|n| n.as_vec3().into()).collect(),
            uv: if textured {
                self.corners.iter().map(|c| c.uv).collect()
            } else {
                Vec::new()
            },
            colors: self.colors,
            features: self.features,
            indices: self.indices,
            look: self.look,
        }
    }
}

/// Volume inside meshes' triangles [m³], by the divergence theorem: of closed shells, and of those that are open in a level at their
/// lowest corner alone.
#[cfg(test)]
pub fn volume_m3(meshes: &[TexturedMesh], feature: Option<u32>) -> f64 {
    let one = |mesh: &TexturedMesh| {
        let own = |t: &&[u32]| feature.is_none_or(|f| mesh.features[t[0] as usize] == f);
        let triangles: Vec<[DVec3; 3]> = (mesh.indices.chunks_exact(3).filter(own))
            .map(|t| [t[0], t[1], t[2]].map(|k| mesh.vertex_m(k)))
            .collect();
        triangles
    };
    let triangles: Vec<[DVec3; 3]> = meshes.iter().flat_map(one).collect();
    let corners = triangles.iter().flatten();
    let low = corners
        .min_by(|a, b| a.z.total_cmp(&b.z))
        .copied()
        .unwrap_or(DVec3::ZERO);
    let volume = |[a, b, c]: &[DVec3; 3]| (a - low).dot((b - low).cross(c - low)) / 6.0;
    triangles.iter().map(volume).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_that_touch_the_outline_or_each_other_are_cut_out() {
        let square = |x: f64, y: f64, w: f64| -> Vec<Corner> {
            let at = [[x, y], [x + w, y], [x + w, y + w], [x, y + w]];
            at.map(|[x, y]| DVec3::new(x, y, 3.0).into()).to_vec()
        };
        let hole = |x: f64, y: f64| {
            let mut ring = square(x, y, 4.0);
            ring.reverse();
            ring
        };
        for (holes, want) in [
            (vec![hole(0.0, 2.0)], 84.0),
            (vec![hole(6.0, 2.0)], 84.0),
            (vec![hole(2.0, 0.0)], 84.0),
            (vec![hole(2.0, 6.0)], 84.0),
            (vec![hole(0.0, 0.0)], 84.0),
            (vec![hole(1.0, 1.0), hole(5.0, 1.0)], 68.0),
            (vec![hole(1.0, 1.0), hole(5.0, 5.0)], 68.0),
            (vec![hole(3.0, 3.0)], 84.0),
        ] {
            let rings: Vec<Vec<Corner>> = std::iter::once(square(0.0, 0.0, 10.0))
                .chain(holes)
                .collect();
            let all: Vec<DVec3> = rings.iter().flatten().map(|corner| corner.r_m).collect();
            let triangles = triangulate(&rings, &mut Earcut::new());
            let area =
                |t: &[usize; 3]| (all[t[1]] - all[t[0]]).cross(all[t[2]] - all[t[0]]).z / 2.0;
            let found: f64 = triangles.iter().map(area).sum();
            assert!((found - want).abs() < 1e-3, "{found} of {want}");
        }
    }

    #[test]
    fn rings_that_leave_by_a_rounding_are_cut_out_and_those_that_cross_are_told() {
        let corners = |at: &[[f64; 2]]| {
            at.iter()
                .map(|[x, z]| Corner::from(DVec3::new(*x, 0.0, *z)))
                .collect::<Vec<_>>()
        };
        let wall = corners(&[[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [0.0, 10.0]]);
        let window = |top: f64| corners(&[[8.0, top], [12.0, top], [12.0, 7.0], [8.0, 7.0]]);
        let told = |rings: &[Vec<Corner>]| {
            let mut surfaces = Surfaces::default();
            surfaces.polygon(rings, 0, [1.0; 4], 0);
            let mut notes = Notes::default();
            surfaces.note(&mut notes);
            let area: f64 = (surfaces.finish().iter())
                .flat_map(|mesh| {
                    mesh.indices
                        .as_chunks::<3>()
                        .0
                        .iter()
                        .map(move |t| t.map(|k| mesh.vertex_m(k)))
                })
                .map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0)
                .sum();
            (area, notes.warnings(std::path::Path::new("a")).len())
        };
        // The chord of a wall of 20 m on the round Earth leaves 8 µm above it.
        for top in [10.0, 10.0 + 8e-6, 10.0 - 8e-6] {
            let (area, told) = told(&[wall.clone(), window(top)]);
            assert!(
                (area - 188.0).abs() < 1e-3 && told == 0,
                "{top}: {area} {told}"
            );
        }
        assert_eq!(told(&[wall.clone(), window(14.0)]).1, 1);
        assert_eq!(told(&[wall]), (200.0, 0));
    }
    use proptest::prelude::*;

    fn ring(corners: &[[f64; 3]]) -> Vec<Corner> {
        corners.iter().map(|r| DVec3::from(*r).into()).collect()
    }

    fn area_m2(rings: &[Vec<Corner>]) -> DVec3 {
        let all: Vec<Corner> = rings.iter().flatten().copied().collect();
        let triangles = triangulate(rings, &mut Earcut::new());
        triangles
            .iter()
            .map(|[a, b, c]| (all[*b].r_m - all[*a].r_m).cross(all[*c].r_m - all[*a].r_m) / 2.0)
            .sum()
    }

    #[test]
    fn a_wall_with_a_window_keeps_its_area_and_side() {
        // 10 m by 4 m facing south, with a window of 2 m by 1 m.
        let wall = ring(&[
            [0.0, 5.0, 0.0],
            [10.0, 5.0, 0.0],
            [10.0, 5.0, 4.0],
            [0.0, 5.0, 4.0],
        ]);
        let window = ring(&[
            [4.0, 5.0, 1.0],
            [4.0, 5.0, 2.0],
            [6.0, 5.0, 2.0],
            [6.0, 5.0, 1.0],
        ]);
        assert!(
            (area_m2(&[wall.clone(), window.clone()]) - DVec3::new(0.0, -38.0, 0.0)).length()
                < 1e-9
        );
        // A hole that runs the same way round is a hole too.
        let same: Vec<Corner> = window.into_iter().rev().collect();
        assert!((area_m2(&[wall.clone(), same]) - DVec3::new(0.0, -38.0, 0.0)).length() < 1e-9);
        let back: Vec<Corner> = wall.into_iter().rev().collect();
        assert!((area_m2(&[back]) - DVec3::new(0.0, 40.0, 0.0)).length() < 1e-9);
    }

    #[test]
    fn what_has_no_area_has_no_triangles() {
        for rings in [
            vec![],
            vec![ring(&[[0.0; 3]; 3])],
            vec![ring(&[[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])],
            vec![ring(&[
                [0.0; 3],
                [f64::NAN, 0.0, 0.0],
                [2.0, 1.0, 0.0],
                [0.0, 1.0, 0.0],
            ])],
        ] {
            assert!(triangulate(&rings, &mut Earcut::new()).is_empty());
        }
    }

    #[test]
    fn many_polygons_are_split_and_stay_themselves() {
        let mut surfaces = Surfaces::default();
        let square = [
            [0.0, 0.0, 3.0],
            [1.0, 0.0, 3.0],
            [1.0, 1.0, 3.0],
            [0.0, 1.0, 3.0],
        ];
        let n = MOST_CORNERS / 4 + 10;
        for k in 0..n {
            let shifted = square.map(|[x, y, z]| [x + k as f64 * 0.01, y, z]);
            surfaces.polygon(&[ring(&shifted)], k as u32, [1.0; 4], 0);
        }
        let meshes = surfaces.finish();
        assert_eq!(meshes.len(), 2);
        let triangles: usize = meshes.iter().map(TexturedMesh::triangle_count).sum();
        assert_eq!(triangles, 2 * n);
        let last = meshes[1].features.last().copied();
        assert_eq!(last, Some(n as u32 - 1));
        let mesh = &meshes[1];
        let r = mesh.vertex_m(mesh.positions.len() as u32 - 1);
        let x = r.x - (n - 1) as f64 * 0.01;
        assert!((-1e-3..1.001).contains(&x) && r.z == 3.0, "{r}");
    }

    proptest! {
        #[test]
        fn any_rings_give_indices_inside(rings in prop::collection::vec(prop::collection::vec([-5..5_i32, -5..5, -1..1], 0..9), 0..4)) {
            let rings: Vec<Vec<Corner>> = rings.iter().map(|r| r.iter().map(|c| DVec3::from(c.map(f64::from)).into()).collect()).collect();
            let corners = rings.iter().map(Vec::len).sum::<usize>();
            for triangle in triangulate(&rings, &mut Earcut::new()) {
                prop_assert!(triangle.iter().all(|k| *k < corners));
            }
        }
    }
}
