//! How far two surfaces lie apart.

use super::mesh::Mesh;
use glam::DVec3;
use rstar::{AABB, PointDistance, RTree, RTreeObject};

/// Most points that one surface is sampled at.
const MOST_POINTS: usize = 40_000;

/// A triangle in a tree of boxes.
struct Triangle([DVec3; 3]);

impl RTreeObject for Triangle {
    type Envelope = AABB<[f64; 3]>;

    fn envelope(&self) -> Self::Envelope {
        let [a, b, c] = self.0;
        AABB::from_corners(a.min(b).min(c).to_array(), a.max(b).max(c).to_array())
    }
}

impl PointDistance for Triangle {
    fn distance_2(&self, point: &[f64; 3]) -> f64 {
        let point = DVec3::from(*point);
        point.distance_squared(nearest_on(self.0, point))
    }
}

/// The point of a triangle that is nearest to another (Ericson, "Real-Time Collision Detection", 5.1.5).
pub(super) fn nearest_on([a, b, c]: [DVec3; 3], p: DVec3) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    if sum <= 0.0 {
        return a;
    }
    a + ab * (vb / sum) + ac * (vc / sum)
}

/// The corners of a mesh's triangles, in steps of the lattice.
fn corners(mesh: &Mesh) -> Vec<[DVec3; 3]> {
    let at = |i: u32| DVec3::from(mesh.vertices[i as usize].at.map(f64::from));
    mesh.triangles().iter().map(|t| t.map(at)).collect()
}

/// Farthest that a surface's vertices and the middles of its triangles lie from another surface, in steps of the lattice.
pub(super) fn farthest(from: &Mesh, to: &Mesh) -> f64 {
    farthest_between(&corners(from), corners(to))
}

/// Farthest that the vertices and middles of some triangles lie from other triangles.
pub(super) fn farthest_between(from: &[[DVec3; 3]], to: Vec<[DVec3; 3]>) -> f64 {
    let tree = RTree::bulk_load(to.into_iter().map(Triangle).collect());
    let points = (from.iter()).flat_map(|t| [t[0], (t[0] + t[1] + t[2]) / 3.0]);
    // An odd stride meets vertices and middles by turns.
    let every = (2 * from.len()).div_ceil(MOST_POINTS) | 1;
    points
        .step_by(every)
        .filter_map(|point| {
            let point = point.to_array();
            let nearest = tree.nearest_neighbor(point)?;
            Some(nearest.distance_2(&point))
        })
        .fold(0.0, f64::max)
        .sqrt()
}
