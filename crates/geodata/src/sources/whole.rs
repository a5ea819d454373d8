//! Outlines that cross or touch themselves or their holes, as shapes that a roof can be put on.

use boresight_models::maths::polygon;
use glam::DVec2;
use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::float::simplify::SimplifyShape;
use i_overlay::float::single::SingleFloatOverlay;

/// More corners than this are not compared pair by pair.
const MOST_PAIRED: usize = 4000;
/// Areas that differ by less than this share are equal.
const SAME_AREA: f64 = 1e-6;

/// Shapes of an outline and its holes each: open rings, outlines counter-clockwise.
#[derive(Clone, Debug, PartialEq)]
pub struct Mended {
    /// The shapes.
    pub shapes: Vec<Vec<Vec<DVec2>>>,
    /// Whether they hold less or more than the rings say: the outline's area without the holes'.
    pub other_area: bool,
}

/// What rings enclose (the first is the outline, the others are holes). What a ring runs around in either sense is inside it; holes
/// take away what they hold of the outline. `None` where the rings are one shape already.
pub fn mended(rings: &[Vec<DVec2>]) -> Option<Mended> {
    let rings: Vec<Vec<DVec2>> = rings.iter().map(|ring| open(ring)).collect();
    if !rings.iter().flatten().all(|r| r.is_finite()) || is_whole(&rings) {
        return None;
    }
    // The library works on a grid over all that it is given: beside a stray hole an outline would lose its digits.
    let origin = rings.first()?.first().copied()?;
    let [low, high] = bounds(&rings[0]);
    let near = |ring: &&Vec<DVec2>| {
        let [a, b] = bounds(ring);
        a.cmple(high).all() && b.cmpge(low).all()
    };
    let path = |ring: &Vec<DVec2>| -> Vec<[f64; 2]> {
        let clockwise = polygon::area_m2(&about(ring, origin)) < 0.0;
        let points = ring.iter().map(|r| (*r - origin).to_array());
        match clockwise {
            true => points.rev().collect(),
            false => points.collect(),
        }
    };
    let outline = vec![path(&rings[0])].simplify_shape(FillRule::NonZero);
    let holes: Vec<_> = rings[1..].iter().filter(near).map(path).collect();
    let shapes = match holes.is_empty() {
        true => outline,
        false => {
            let holes = holes.simplify_shape(FillRule::NonZero);
            outline.overlay(&holes, OverlayRule::Difference, FillRule::NonZero)
        }
    };
    let shapes: Vec<Vec<Vec<DVec2>>> = shapes
        .into_iter()
        .map(|shape| {
            let ring =
                |ring: Vec<[f64; 2]>| ring.into_iter().map(|r| DVec2::from(r) + origin).collect();
            shape.into_iter().map(ring).collect()
        })
        .collect();
    let area = |rings: &[Vec<DVec2>]| -> f64 {
        let areas = rings
            .iter()
            .map(|ring| polygon::area_m2(&about(ring, origin)).abs());
        areas
            .enumerate()
            .map(|(k, area)| if k == 0 { area } else { -area })
            .sum()
    };
    let stated = area(&rings);
    let found: f64 = shapes.iter().map(|shape| area(shape)).sum();
    let other_area = (found - stated).abs() > SAME_AREA * stated.abs();
    // Rings of more corners than are compared may have been whole.
    let many = rings.iter().map(Vec::len).sum::<usize>() > MOST_PAIRED;
    let whole = many && shapes.len() == 1 && shapes[0].len() == rings.len() && !other_area;
    (!whole).then_some(Mended { shapes, other_area })
}

/// A ring without its repeated corners.
fn open(ring: &[DVec2]) -> Vec<DVec2> {
    let mut ring = ring.to_vec();
    ring.dedup();
    while ring.len() > 1 && ring.first() == ring.last() {
        ring.pop();
    }
    ring
}

fn about(ring: &[DVec2], origin: DVec2) -> Vec<DVec2> {
    ring.iter().map(|r| *r - origin).collect()
}

fn bounds(ring: &[DVec2]) -> [DVec2; 2] {
    let low = ring.iter().fold(DVec2::INFINITY, |a, b| a.min(*b));
    let high = ring.iter().fold(DVec2::NEG_INFINITY, |a, b| a.max(*b));
    [low, high]
}

/// Whether no edges meet but at the corners between them, and every hole lies inside the outline and in no other hole.
fn is_whole(rings: &[Vec<DVec2>]) -> bool {
    let Some(outline) = rings.first() else {
        return true;
    };
    if rings.iter().map(Vec::len).sum::<usize>() > MOST_PAIRED {
        return false;
    }
    let edges: Vec<(usize, usize, [DVec2; 2])> = (rings.iter().enumerate())
        .flat_map(|(number, ring)| {
            let ends = ring.iter().zip(ring.iter().cycle().skip(1));
            ends.enumerate()
                .map(move |(k, (a, b))| (number, k, [*a, *b]))
        })
        .collect();
    let apart = |a: &(usize, usize, [DVec2; 2]), b: &(usize, usize, [DVec2; 2])| {
        let last = rings[a.0].len() - 1;
        let follows = a.0 == b.0 && a.1 + 1 == b.1;
        let neighbours = follows || (a.0 == b.0 && a.1 == 0 && b.1 == last);
        let [from, corner, to] = if follows {
            [a.2[0], b.2[0], b.2[1]]
        } else {
            [b.2[0], a.2[0], a.2[1]]
        };
        match neighbours {
            true => !turns_back(from, corner, to),
            false => !meet(a.2, b.2),
        }
    };
    let all_apart =
        (edges.iter().enumerate()).all(|(k, a)| edges[k + 1..].iter().all(|b| apart(a, b)));
    let holes = &rings[1..];
    let nested = |(k, hole): (usize, &Vec<DVec2>)| {
        hole.first().is_none_or(|first| {
            let mut others = holes.iter().enumerate().filter(|(other, _)| *other != k);
            polygon::encloses(outline, *first)
                && !others.any(|(_, other)| polygon::encloses(other, *first))
        })
    };
    all_apart && holes.iter().enumerate().all(nested)
}

/// Whether an outline goes back at a corner the way it came.
fn turns_back(from: DVec2, corner: DVec2, to: DVec2) -> bool {
    let (before, after) = (corner - from, to - corner);
    let straight = before.perp_dot(after).abs() <= 1e-9 * before.length() * after.length();
    straight && before.dot(after) < 0.0
}

/// Whether two edges have a point in common.
fn meet([a, b]: [DVec2; 2], [c, d]: [DVec2; 2]) -> bool {
    let boxes = a.min(b).cmple(c.max(d)).all() && c.min(d).cmple(a.max(b)).all();
    let side = |p: DVec2, q: DVec2, r: DVec2| (q - p).perp_dot(r - p);
    boxes && side(a, b, c) * side(a, b, d) <= 0.0 && side(c, d, a) * side(c, d, b) <= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Far from the origin, as in a map.
    const AT: DVec2 = DVec2::new(2_683_000.0, 1_247_000.0);

    fn ring(points: &[[f64; 2]]) -> Vec<DVec2> {
        points.iter().map(|p| DVec2::from(*p) + AT).collect()
    }

    fn square(x: f64, y: f64, side: f64) -> Vec<DVec2> {
        ring(&[
            [x, y],
            [x + side, y],
            [x + side, y + side],
            [x, y + side],
            [x, y],
        ])
    }

    /// Areas of the shapes [m²], ascending.
    fn areas_m2(rings: &[Vec<DVec2>]) -> Option<Vec<f64>> {
        let area = |shape: &Vec<Vec<DVec2>>| -> f64 {
            shape
                .iter()
                .map(|ring| polygon::area_m2(&about(ring, AT)))
                .sum()
        };
        let mut found: Vec<f64> = mended(rings)?.shapes.iter().map(area).collect();
        found.sort_by(f64::total_cmp);
        Some(found)
    }

    #[test]
    fn rings_that_cross_or_touch_enclose_what_they_run_around() {
        let outer = square(0.0, 0.0, 10.0);
        let bow = ring(&[[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]]);
        let twice = ring(&[
            [0.0, 0.0],
            [10.0, 0.0],
            [10.0, 10.0],
            [0.0, 10.0],
            [0.0, 0.0],
            [5.0, 5.0],
            [15.0, 5.0],
            [15.0, 15.0],
            [5.0, 15.0],
            [5.0, 5.0],
        ]);
        let eight = ring(&[
            [0.0, 0.0],
            [10.0, 0.0],
            [10.0, 14.0],
            [14.0, 14.0],
            [14.0, 10.0],
            [0.0, 10.0],
        ]);
        let with = |hole: Vec<DVec2>| vec![outer.clone(), hole];
        type Case = (&'static str, Vec<Vec<DVec2>>, Vec<f64>);
        let cases: Vec<Case> = vec![
            ("bow tie", vec![bow], vec![25.0, 25.0]),
            ("loops that overlap", vec![twice], vec![175.0]),
            ("figure of eight", vec![eight], vec![16.0, 100.0]),
            ("hole outside", with(square(30.0, 0.0, 4.0)), vec![100.0]),
            ("hole far off", with(square(3e6, 0.0, 4.0)), vec![100.0]),
            ("hole at the edge", with(square(0.0, 2.0, 4.0)), vec![84.0]),
            (
                "hole across the edge",
                with(square(8.0, 2.0, 4.0)),
                vec![92.0],
            ),
            (
                "hole within a hole",
                vec![outer.clone(), square(1.0, 1.0, 8.0), square(3.0, 3.0, 2.0)],
                vec![36.0],
            ),
            (
                "holes that overlap",
                vec![outer.clone(), square(1.0, 1.0, 4.0), square(3.0, 3.0, 4.0)],
                vec![72.0],
            ),
            ("hole of all", with(outer.clone()), vec![]),
            (
                "hole across",
                with(ring(&[[-1.0, 4.0], [11.0, 4.0], [11.0, 6.0], [-1.0, 6.0]])),
                vec![40.0, 40.0],
            ),
        ];
        for (name, rings, want) in cases {
            let found = areas_m2(&rings).unwrap_or_else(|| panic!("{name} is taken as whole"));
            let near = found.len() == want.len()
                && found.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-3);
            assert!(near, "{name}: {found:?}, wanted {want:?}");
        }
    }

    #[test]
    fn rings_that_touch_hold_what_they_say() {
        let outer = square(0.0, 0.0, 10.0);
        for (rings, m2) in [
            (
                vec![outer.clone(), ring(&[[0.0, 0.0], [3.0, 1.0], [1.0, 3.0]])],
                96.0,
            ),
            (
                vec![outer.clone(), square(2.0, 2.0, 3.0), square(5.0, 5.0, 3.0)],
                82.0,
            ),
            (vec![outer, square(0.0, 2.0, 4.0)], 84.0),
            // A spike, which encloses nothing.
            (
                vec![ring(&[
                    [0.0, 0.0],
                    [10.0, 0.0],
                    [25.0, 0.0],
                    [10.0, 0.0],
                    [10.0, 10.0],
                    [0.0, 10.0],
                ])],
                100.0,
            ),
        ] {
            assert!(!mended(&rings).unwrap().other_area);
            let found_m2: f64 = areas_m2(&rings).unwrap().iter().sum();
            assert!((found_m2 - m2).abs() < 1e-3, "{found_m2} of {m2}");
        }
    }

    #[test]
    fn what_is_whole_stays_as_it_is() {
        let outer = square(0.0, 0.0, 10.0);
        let mut twice = outer.clone();
        twice.insert(1, twice[1]);
        for rings in [
            vec![outer.clone()],
            vec![twice],
            vec![outer.clone(), square(2.0, 2.0, 4.0)],
            vec![outer.into_iter().rev().collect()],
            vec![],
            vec![vec![]],
            vec![ring(&[[0.0, 0.0], [f64::NAN, 1.0], [1.0, 1.0]])],
        ] {
            assert_eq!(mended(&rings), None, "{rings:?}");
        }
    }

    proptest! {
        /// Whatever the rings, what comes out is whole, and no larger than the box of the outline.
        #[test]
        fn what_is_mended_is_whole(
            outline in prop::collection::vec(prop::array::uniform2(0.0..50.0_f64), 3..9),
            hole in prop::collection::vec(prop::array::uniform2(0.0..50.0_f64), 3..6),
        ) {
            let mended = mended(&[ring(&outline), ring(&hole)]);
            for shape in mended.iter().flat_map(|mended| &mended.shapes) {
                prop_assert!(shape.iter().all(|ring| ring.len() >= 3));
                let area_m2: f64 = shape.iter().map(|ring| polygon::area_m2(&about(ring, AT))).sum();
                prop_assert!((0.0..=2500.0).contains(&area_m2), "{area_m2}");
            }
        }
    }
}
