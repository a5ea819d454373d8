//! Triangles of a place in a tree of boxes: rays, nearest points, all in f64 and the same on every machine.
//!
//! The tree splits by the surface area heuristic over bins of centroids (Wald, "On fast construction of SAH-based
//! bounding volume hierarchies", 2007). A ray meets a triangle by the watertight test of Woop, Benthin and Wald (JCGT 2013):
//! none slips through the edge between two.

use glam::{DVec2, DVec3};

/// Triangles of a leaf at most, unless their middles coincide.
const LEAF: usize = 4;
/// Bins that a split is sought among.
const BINS: usize = 16;
/// Below this many levels boxes are halved by number, so that no input makes a deep tree.
const SAH_LEVELS: usize = 32;
/// Levels at most: those by number halve at least 2^32 triangles.
const MOST_LEVELS: usize = SAH_LEVELS + 33;

/// A box of the tree.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: DVec3,
    high: DVec3,
    /// A leaf's first triangle; an inner box's second child, whose first follows it.
    at: u32,
    /// Triangles of a leaf; 0 is an inner box.
    count: u32,
}

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Where along the ray: the point is a + t·d.
    pub t: f64,
    /// The triangle's number in the tree.
    pub triangle: usize,
}

/// Triangles, sorted into boxes.
#[derive(Clone, Debug, Default)]
pub struct TriangleTree {
    nodes: Vec<Node>,
    corners: Vec<[DVec3; 3]>,
}

/// A segment a + t·d as the watertight test wants it.
struct Ray {
    a: DVec3,
    inverse: DVec3,
    /// The axes, the longest of d last, in an order that keeps the winding.
    axes: [usize; 3],
    shear: DVec3,
}

impl Ray {
    fn new(a: DVec3, d: DVec3) -> Self {
        let size = d.abs();
        let z = if size.x >= size.y && size.x >= size.z {
            0
        } else if size.y >= size.z {
            1
        } else {
            2
        };
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if d[z] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        // A zero must not make 0 · ∞.
        let inverse = |x: f64| if x == 0.0 { 1e300 } else { 1.0 / x };
        Self {
            a,
            inverse: DVec3::new(inverse(d.x), inverse(d.y), inverse(d.z)),
            axes: [x, y, z],
            shear: DVec3::new(d[x] / d[z], d[y] / d[z], 1.0 / d[z]),
        }
    }

    /// Where it enters a box, if it does before `most`.
    fn enters(&self, node: &Node, most: f64) -> Option<f64> {
        /// Rounding of the three products (Ize, "Robust BVH ray traversal", 2013).
        const SLACK: f64 = 1.0 + 8.0 * f64::EPSILON;
        let one = (node.low - self.a) * self.inverse;
        let other = (node.high - self.a) * self.inverse;
        let enter = one.min(other).max_element().max(0.0);
        let leave = one.max(other).min_element() * SLACK;
        (enter <= leave && enter <= most).then_some(enter)
    }

    /// Where it meets a triangle, from either side.
    fn meets(&self, corners: &[DVec3; 3]) -> Option<f64> {
        let [x, y, z] = self.axes;
        let sheared = corners.map(|corner| {
            let r = corner - self.a;
            DVec3::new(
                r[x] - self.shear.x * r[z],
                r[y] - self.shear.y * r[z],
                self.shear.z * r[z],
            )
        });
        let [a, b, c] = sheared;
        let u = c.truncate().perp_dot(b.truncate());
        let v = a.truncate().perp_dot(c.truncate());
        let w = b.truncate().perp_dot(a.truncate());
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let sum = u + v + w;
        let t = (u * a.z + v * b.z + w * c.z) / sum;
        (sum != 0.0 && t >= 0.0).then_some(t)
    }
}

impl TriangleTree {
    /// Sorts triangles [m]; those with a corner that is no number are left out.
    pub fn new(mut corners: Vec<[DVec3; 3]>) -> Self {
        corners.retain(|triangle| triangle.iter().all(|corner| corner.is_finite()));
        corners.truncate(u32::MAX as usize);
        let mut order: Vec<u32> = (0..corners.len() as u32).collect();
        let mut nodes = Vec::new();
        if !corners.is_empty() {
            split(&corners, &mut order, 0, 0, &mut nodes);
        }
        let corners = order.iter().map(|i| corners[*i as usize]).collect();
        Self { nodes, corners }
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// The corners of a triangle [m].
    pub fn corners_m(&self, triangle: usize) -> [DVec3; 3] {
        self.corners[triangle]
    }

    /// Unit normal of a triangle, towards where it winds counter-clockwise; zero where it has no area.
    pub fn normal(&self, triangle: usize) -> DVec3 {
        let [a, b, c] = self.corners[triangle];
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// What a + t·d meets first for t in 0..1; of what is met at once the lower number.
    pub fn first_hit(&self, a: DVec3, d: DVec3) -> Option<Hit> {
        if self.nodes.is_empty() || d == DVec3::ZERO || !(a.is_finite() && d.is_finite()) {
            return None;
        }
        let ray = Ray::new(a, d);
        let mut best: Option<Hit> = None;
        let mut waiting = [(0_u32, 0.0_f64); MOST_LEVELS + 1];
        let mut count = 0;
        let most = |best: &Option<Hit>| best.map_or(1.0, |hit| hit.t);
        if let Some(enter) = ray.enters(&self.nodes[0], 1.0) {
            waiting[0] = (0, enter);
            count = 1;
        }
        while count > 0 {
            count -= 1;
            let (at, enter) = waiting[count];
            if enter > most(&best) {
                continue;
            }
            let node = &self.nodes[at as usize];
            if node.count > 0 {
                for triangle in node.at as usize..(node.at + node.count) as usize {
                    let Some(t) = ray.meets(&self.corners[triangle]) else {
                        continue;
                    };
                    let nearer = match best {
                        Some(hit) => t < hit.t || (t == hit.t && triangle < hit.triangle),
                        None => t <= 1.0,
                    };
                    if nearer {
                        best = Some(Hit { t, triangle });
                    }
                }
                continue;
            }
            let children = [at + 1, node.at].map(|child| {
                let enter = ray.enters(&self.nodes[child as usize], most(&best));
                enter.map(|enter| (child, enter))
            });
            // The nearer one is taken up next.
            let (first, second) = match children {
                [Some(a), Some(b)] if b.1 < a.1 => (Some(a), Some(b)),
                [a, b] => (b, a),
            };
            for child in [first, second].into_iter().flatten() {
                waiting[count] = child;
                count += 1;
            }
        }
        best
    }

    /// The nearest point of any triangle within `reach_m` of a point [m], and the triangle.
    pub fn nearest(&self, r: DVec3, reach_m: f64) -> Option<(DVec3, usize)> {
        if self.nodes.is_empty() || !r.is_finite() {
            return None;
        }
        let mut best: Option<(f64, DVec3, usize)> = None;
        let mut waiting = vec![0_u32];
        while let Some(at) = waiting.pop() {
            let node = &self.nodes[at as usize];
            let most = best.map_or(reach_m * reach_m, |(apart, ..)| apart);
            let outside = (node.low - r).max(r - node.high).max(DVec3::ZERO);
            if outside.length_squared() > most {
                continue;
            }
            if node.count == 0 {
                waiting.extend([node.at, at + 1]);
                continue;
            }
            for triangle in node.at as usize..(node.at + node.count) as usize {
                let point = nearest_on(&self.corners[triangle], r);
                let apart = point.distance_squared(r);
                let most = best.map_or(reach_m * reach_m, |(apart, ..)| apart);
                let lower = best.is_some_and(|(apart, _, other)| apart == most && triangle < other);
                if apart < most || (apart == most && (best.is_none() || lower)) {
                    best = Some((apart, point, triangle));
                }
            }
        }
        best.map(|(_, point, triangle)| (point, triangle))
    }

    /// The triangles whose boxes touch a box [m], by their number.
    pub fn in_box(&self, low: DVec3, high: DVec3) -> Vec<usize> {
        let touches = |l: DVec3, h: DVec3| l.cmple(high).all() && h.cmpge(low).all();
        let mut found = Vec::new();
        let mut waiting = Vec::from_iter((!self.nodes.is_empty()).then_some(0_u32));
        while let Some(at) = waiting.pop() {
            let node = &self.nodes[at as usize];
            if !touches(node.low, node.high) {
                continue;
            }
            if node.count == 0 {
                waiting.extend([node.at, at + 1]);
                continue;
            }
            found.extend(
                (node.at as usize..(node.at + node.count) as usize).filter(|triangle| {
                    let [a, b, c] = self.corners[*triangle];
                    touches(a.min(b).min(c), a.max(b).max(c))
                }),
            );
        }
        found.sort_unstable();
        found
    }
}

/// Adds the box of some triangles and what lies below it; `first` is the place of `order` in the whole.
fn split(
    corners: &[[DVec3; 3]],
    order: &mut [u32],
    first: usize,
    level: usize,
    nodes: &mut Vec<Node>,
) {
    let bounds = |triangle: u32| {
        let [a, b, c] = corners[triangle as usize];
        (a.min(b).min(c), a.max(b).max(c))
    };
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let join = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
    let middle = |(low, high): (DVec3, DVec3)| 0.5 * (low + high);
    let (low, high) = order.iter().map(|i| bounds(*i)).fold(none, join);
    let own = nodes.len();
    nodes.push(Node {
        low,
        high,
        at: first as u32,
        count: order.len() as u32,
    });
    let point = |r: DVec3| (r, r);
    let middles = (order.iter()).fold(none, |all, i| join(all, point(middle(bounds(*i)))));
    let spread = middles.1 - middles.0;
    if order.len() <= LEAF || level + 1 >= MOST_LEVELS {
        return;
    }
    let axis = (0..3).fold(0, |best, axis| {
        if spread[axis] > spread[best] {
            axis
        } else {
            best
        }
    });
    let half = if spread[axis] > 0.0 && level < SAH_LEVELS {
        let bin_of = |i: u32| {
            let share = (middle(bounds(i))[axis] - middles.0[axis]) / spread[axis];
            ((share * BINS as f64) as usize).min(BINS - 1)
        };
        let mut bins = [(none, 0_usize); BINS];
        for i in order.iter() {
            let bin = &mut bins[bin_of(*i)];
            *bin = (join(bin.0, bounds(*i)), bin.1 + 1);
        }
        let area = |(low, high): (DVec3, DVec3)| {
            let size = (high - low).max(DVec3::ZERO);
            size.x * size.y + size.y * size.z + size.z * size.x
        };
        let cost = |bins: &[((DVec3, DVec3), usize)]| {
            let (all, count) = (bins.iter()).fold((none, 0), |(all, count), bin| {
                (join(all, bin.0), count + bin.1)
            });
            (area(all) * count as f64, count)
        };
        let best = (1..BINS)
            .map(|cut| {
                let (left, right) = (cost(&bins[..cut]), cost(&bins[cut..]));
                let both = left.1 > 0 && right.1 > 0;
                let sum = if both {
                    left.0 + right.0
                } else {
                    f64::INFINITY
                };
                (sum, cut)
            })
            .fold((f64::INFINITY, BINS / 2), |best, one| {
                if one.0 < best.0 { one } else { best }
            });
        let mut left = 0;
        for k in 0..order.len() {
            if bin_of(order[k]) < best.1 {
                order.swap(left, k);
                left += 1;
            }
        }
        left
    } else {
        0
    };
    // What lies all in one place is halved by number.
    let half = if half == 0 || half == order.len() {
        order.len() / 2
    } else {
        half
    };
    let (left, right) = order.split_at_mut(half);
    split(corners, left, first, level + 1, nodes);
    nodes[own].at = nodes.len() as u32;
    nodes[own].count = 0;
    split(corners, right, first + half, level + 1, nodes);
}

/// The point of a triangle nearest to `r` (Ericson, "Real-Time Collision Detection", 2005, 5.1.5).
fn nearest_on([a, b, c]: &[DVec3; 3], r: DVec3) -> DVec3 {
    let (ab, ac, ar) = (*b - *a, *c - *a, r - *a);
    let [d1, d2] = [ab.dot(ar), ac.dot(ar)];
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    let br = r - *b;
    let [d3, d4] = [ab.dot(br), ac.dot(br)];
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    let vc = DVec2::new(d1, d3).perp_dot(DVec2::new(d2, d4));
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return *a + d1 / (d1 - d3) * ab;
    }
    let cr = r - *c;
    let [d5, d6] = [ab.dot(cr), ac.dot(cr)];
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        return *a + d2 / (d2 - d6) * ac;
    }
    let va = d3 * d6 - d5 * d4;
    let (to_c, to_b) = (d4 - d3, d5 - d6);
    if va <= 0.0 && to_c >= 0.0 && to_b >= 0.0 && to_c + to_b > 0.0 {
        return *b + to_c / (to_c + to_b) * (*c - *b);
    }
    let sum = va + vb + vc;
    if sum == 0.0 {
        return *a;
    }
    *a + vb / sum * ab + vc / sum * ac
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maths::rng::Stream;

    /// Random triangles, some of them without area.
    fn some(count: usize, rng: &mut Stream) -> Vec<[DVec3; 3]> {
        (0..count)
            .map(|k| {
                let mut point = |spread: f64| {
                    DVec3::new(rng.normal(), rng.normal(), 0.3 * rng.normal()) * spread
                };
                let at = point(100.0);
                let [b, c] = [at + point(8.0), at + point(8.0)];
                if k % 50 == 0 { [at, b, b] } else { [at, b, c] }
            })
            .collect()
    }

    /// Möller and Trumbore's test, one triangle after the other.
    fn plain(triangles: &[[DVec3; 3]], a: DVec3, d: DVec3) -> Option<f64> {
        let meets = |[p, q, r]: &[DVec3; 3]| {
            let (e, f) = (*q - *p, *r - *p);
            let h = d.cross(f);
            let det = e.dot(h);
            let s = (a - *p) / det;
            let u = s.dot(h);
            let g = s.cross(e);
            let v = d.dot(g);
            let t = f.dot(g);
            (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && (0.0..=1.0).contains(&t)).then_some(t)
        };
        triangles.iter().filter_map(meets).min_by(f64::total_cmp)
    }

    #[test]
    fn finds_what_a_walk_over_all_finds() {
        let mut rng = Stream::new(7, 0, "tree");
        let triangles = some(3_000, &mut rng);
        let tree = TriangleTree::new(triangles.clone());
        assert_eq!(tree.len(), 3_000);
        let mut hits = 0;
        for _ in 0..2_000 {
            let mut point = || DVec3::new(rng.normal(), rng.normal(), 0.3 * rng.normal()) * 120.0;
            let (a, b) = (point(), point());
            let got = tree.first_hit(a, b - a);
            let want = plain(&triangles, a, b - a);
            match (got, want) {
                (Some(got), Some(want)) => {
                    assert!((got.t - want).abs() < 1e-9, "{} {want}", got.t);
                    hits += 1;
                }
                (got, want) => assert_eq!(got.map(|hit| hit.t), want),
            }
            let nearest = triangles.iter().map(|t| nearest_on(t, a).distance(a));
            let want = nearest.min_by(f64::total_cmp).unwrap();
            let (point, triangle) = tree.nearest(a, 1e9).unwrap();
            assert!((point.distance(a) - want).abs() < 1e-9);
            assert!((nearest_on(&tree.corners_m(triangle), a) - point).length() < 1e-12);
            assert_eq!(tree.nearest(a, 0.999 * want), None);
        }
        assert!(hits > 500, "{hits}");
    }

    #[test]
    fn the_nearest_point_of_a_triangle_is_no_farther_than_any_other() {
        let mut rng = Stream::new(8, 0, "nearest");
        for triangle in some(200, &mut rng) {
            let r = 30.0 * DVec3::new(rng.normal(), rng.normal(), rng.normal()) + triangle[0];
            let found = nearest_on(&triangle, r).distance(r);
            let [a, b, c] = triangle;
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let [u, v] = [i, j].map(|k| f64::from(k) / 20.0);
                    let other = a + u * (b - a) + v * (c - a);
                    assert!(found <= other.distance(r) + 1e-9);
                }
            }
        }
    }

    #[test]
    fn no_ray_slips_through_an_edge() {
        // A fan about a point that is no sum of powers of two; every ray aims at an edge of it.
        let rim = |k: i32| {
            let angle = f64::from(k) * 0.1 * std::f64::consts::TAU;
            DVec3::new(37.1 * angle.cos(), 37.1 * angle.sin(), 0.3 * angle)
        };
        let hub = DVec3::new(0.1, 0.2, 0.7);
        let fan = (0..10).map(|k| [hub, rim(k), rim((k + 1) % 10)]);
        let tree = TriangleTree::new(fan.collect());
        for k in 0..10 {
            for step in 1..40 {
                let to = hub.lerp(rim(k), f64::from(step) / 40.0);
                for eye in [DVec3::new(3.3, -8.1, 90.0), DVec3::new(-60.0, 13.0, 35.0)] {
                    assert!(tree.first_hit(eye, 1.5 * (to - eye)).is_some());
                }
            }
        }
    }

    #[test]
    fn a_pile_of_one_triangle_stays_shallow() {
        let one = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let tree = TriangleTree::new(vec![one; 5_000]);
        let hit = tree.first_hit(DVec3::new(0.2, 0.2, 1.0), 2.0 * DVec3::NEG_Z);
        let hit = hit.unwrap();
        assert!((hit.t - 0.5).abs() < 1e-15 && hit.triangle == 0);
        assert!(tree.in_box(DVec3::splat(0.1), DVec3::splat(0.2)).is_empty());
        assert_eq!(tree.in_box(-DVec3::ONE, DVec3::ONE).len(), 5_000);
        assert!(TriangleTree::new(vec![[DVec3::NAN; 3]]).is_empty());
        assert!(
            TriangleTree::default()
                .first_hit(DVec3::ZERO, DVec3::X)
                .is_none()
        );
    }
}
