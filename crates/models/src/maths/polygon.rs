//! Outlines in the plane: clipping, areas, boxes, point tests. Corners run counter-clockwise [m].

use glam::DVec2;

/// A rectangle in any direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientedRectangle {
    /// Its middle [m].
    pub center_m: DVec2,
    /// Unit vector along its first side.
    pub axis: DVec2,
    /// Half sizes along the axis and to its left [m].
    pub half_m: DVec2,
}

impl OrientedRectangle {
    /// Its corners, counter-clockwise [m].
    pub fn corners(&self) -> [DVec2; 4] {
        rectangle(self.center_m, self.axis, self.half_m)
    }
}

/// Corners of a rectangle, counter-clockwise, with half sizes along `axis` and to its left [m].
pub fn rectangle(center_m: DVec2, axis: DVec2, half_m: DVec2) -> [DVec2; 4] {
    let (x, y) = (axis * half_m.x, axis.perp() * half_m.y);
    [
        center_m - x - y,
        center_m + x - y,
        center_m + x + y,
        center_m - x + y,
    ]
}

/// The part of a convex polygon on the side `normal` points to.
pub fn clip(outline: &[DVec2], through: DVec2, normal: DVec2) -> Vec<DVec2> {
    let side = |p: DVec2| (p - through).dot(normal);
    let mut kept = Vec::with_capacity(outline.len() + 1);
    for (k, &a) in outline.iter().enumerate() {
        let b = outline[(k + 1) % outline.len()];
        let (sa, sb) = (side(a), side(b));
        if sa >= 0.0 {
            kept.push(a);
        }
        if (sa >= 0.0) != (sb >= 0.0) {
            kept.push(a.lerp(b, sa / (sa - sb)));
        }
    }
    kept
}

/// A convex polygon whose edge `k`, from corner `k` on, is moved inward by `by_m(k)` [m].
pub fn inset(outline: &[DVec2], by_m: impl Fn(usize) -> f64) -> Vec<DVec2> {
    let n = outline.len();
    (0..n).fold(outline.to_vec(), |rest, k| {
        let (a, b) = (outline[k], outline[(k + 1) % n]);
        let inward = (b - a).perp().normalize_or_zero();
        clip(&rest, a + inward * by_m(k), inward)
    })
}

/// Keeps of corners closer together than `gap_m` [m] the first.
pub fn simplified(outline: &[DVec2], gap_m: f64) -> Vec<DVec2> {
    let mut kept: Vec<DVec2> = Vec::with_capacity(outline.len());
    for &p in outline {
        if kept.iter().all(|q| q.distance(p) > gap_m) {
            kept.push(p);
        }
    }
    kept
}

/// Area of a simple polygon [m²]; negative if its corners run clockwise.
pub fn area_m2(outline: &[DVec2]) -> f64 {
    let n = outline.len();
    (0..n)
        .map(|k| 0.5 * outline[k].perp_dot(outline[(k + 1) % n]))
        .sum()
}

/// Centroid of a simple polygon; its first corner if it has no area.
pub fn centroid(outline: &[DVec2]) -> DVec2 {
    let first = outline.first().copied().unwrap_or_default();
    let (mut sum, mut area) = (DVec2::ZERO, 0.0);
    for k in 2..outline.len() {
        let (a, b) = (outline[k - 1] - first, outline[k] - first);
        let twice = a.perp_dot(b);
        sum += (a + b) * twice / 3.0;
        area += twice;
    }
    if area.abs() > 1e-9 {
        first + sum / area
    } else {
        first
    }
}

/// Whether a point lies inside a convex polygon, or on its edge.
pub fn contains(outline: &[DVec2], p: DVec2) -> bool {
    (0..outline.len()).all(|k| {
        let (a, b) = (outline[k], outline[(k + 1) % outline.len()]);
        (b - a).perp_dot(p - a) >= 0.0
    })
}

/// Unit vector along the longest edge.
pub fn main_axis(outline: &[DVec2]) -> DVec2 {
    let n = outline.len();
    (0..n)
        .map(|k| outline[(k + 1) % n] - outline[k])
        .fold(DVec2::ZERO, |best, e| {
            if e.length() > best.length() { e } else { best }
        })
        .normalize_or(DVec2::X)
}

/// Least and greatest coordinate along a unit vector [m].
pub fn span(outline: &[DVec2], axis: DVec2) -> [f64; 2] {
    outline
        .iter()
        .map(|p| p.dot(axis))
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
            [low.min(x), high.max(x)]
        })
}

/// A large rectangle along `axis` inside a convex polygon, about its centroid.
pub fn inner_rectangle(outline: &[DVec2], axis: DVec2) -> OrientedRectangle {
    let center_m = centroid(outline);
    let half = |axis: DVec2| {
        let [low, high] = span(outline, axis);
        (high - center_m.dot(axis)).min(center_m.dot(axis) - low)
    };
    let mut half_m = DVec2::new(half(axis), half(axis.perp()));
    for _ in 0..30 {
        if rectangle(center_m, axis, half_m)
            .iter()
            .all(|&c| contains(outline, c))
        {
            break;
        }
        half_m *= 0.95;
    }
    OrientedRectangle {
        center_m,
        axis,
        half_m,
    }
}

/// Whether a point lies inside a simple outline, convex or not (even-odd rule).
pub fn encloses(outline: &[DVec2], p: DVec2) -> bool {
    let mut odd = false;
    for (k, &a) in outline.iter().enumerate() {
        let b = outline[(k + 1) % outline.len()];
        if (a.y > p.y) != (b.y > p.y) && p.x < a.x + (b.x - a.x) * (p.y - a.y) / (b.y - a.y) {
            odd = !odd;
        }
    }
    odd
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(half: f64) -> Vec<DVec2> {
        rectangle(DVec2::ZERO, DVec2::X, DVec2::splat(half)).to_vec()
    }

    #[test]
    fn areas_and_centroids_are_the_closed_forms() {
        let at = DVec2::new(70.0, -40.0);
        let turned = rectangle(at, DVec2::from_angle(0.4), DVec2::new(3.0, 1.5));
        assert!((area_m2(&turned) - 18.0).abs() < 1e-12);
        assert!(centroid(&turned).distance(at) < 1e-12);
        // A right triangle: half the box, at a third of either leg.
        let triangle = [DVec2::ZERO, DVec2::X * 3.0, DVec2::Y * 6.0];
        assert!((area_m2(&triangle) - 9.0).abs() < 1e-12);
        assert!(centroid(&triangle).distance(DVec2::new(1.0, 2.0)) < 1e-12);
        let clockwise: Vec<DVec2> = triangle.into_iter().rev().collect();
        assert!((area_m2(&clockwise) + 9.0).abs() < 1e-12);
    }

    #[test]
    fn clipping_and_insetting_leave_what_lies_inside() {
        let half = clip(&square(2.0), DVec2::X, DVec2::X);
        assert!((area_m2(&half) - 4.0).abs() < 1e-12);
        assert!(half.iter().all(|p| p.x >= 1.0));
        assert!(clip(&square(2.0), DVec2::X * 3.0, DVec2::X).is_empty());
        // Edge 0 is the southern one.
        let smaller = inset(&square(2.0), |k| if k == 0 { 1.0 } else { 0.5 });
        for (axis, expected) in [(DVec2::Y, [-1.0, 1.5]), (DVec2::X, [-1.5, 1.5])] {
            let [low, high] = span(&smaller, axis);
            assert!((low - expected[0]).abs() < 1e-12 && (high - expected[1]).abs() < 1e-12);
        }
        let close = [DVec2::ZERO, DVec2::X * 0.1, DVec2::X, DVec2::Y];
        assert_eq!(simplified(&close, 0.5).len(), 3);
    }

    #[test]
    fn points_are_told_inside_from_outside_in_the_notch_of_an_l_too() {
        let l = [
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 1.0],
            [1.0, 1.0],
            [1.0, 4.0],
            [0.0, 4.0],
        ]
        .map(DVec2::from);
        assert!(encloses(&l, DVec2::new(3.0, 0.5)) && encloses(&l, DVec2::new(0.5, 3.0)));
        assert!(!encloses(&l, DVec2::new(2.0, 2.0)) && !encloses(&l, DVec2::new(5.0, 0.5)));
        assert!(contains(&square(1.0), DVec2::splat(0.99)));
        assert!(!contains(&square(1.0), DVec2::new(1.01, 0.0)));
    }

    #[test]
    fn the_inner_rectangle_lies_inside() {
        let kite = [[0.0, -3.0], [4.0, 0.0], [0.0, 3.0], [-2.0, 0.0]].map(DVec2::from);
        let inner = inner_rectangle(&kite, main_axis(&kite));
        assert!((main_axis(&kite).length() - 1.0).abs() < 1e-12);
        assert!(inner.corners().iter().all(|&c| contains(&kite, c)));
        assert!(area_m2(&inner.corners()) > 0.3 * area_m2(&kite));
    }
}
