//! Rings of the ways of a multipolygon, and which of them are holes.

use boresight_models::maths::polygon;
use earcut::Earcut;
use glam::DVec2;
use std::collections::{BTreeMap, BTreeSet};

/// Share of a ring that must lie in another, for the ring to lie in it.
const INSIDE: f64 = 0.5;

/// Rings of nodes that ways close, end to end, and how many ways close none. Of a way that leads nowhere, as a spur does, the others
/// are joined without it.
pub fn join(ids: &[i64], ways: &BTreeMap<i64, Vec<i64>>) -> (Vec<Vec<i64>>, usize) {
    let once: BTreeSet<&i64> = ids.iter().collect();
    let mut left: Vec<Vec<i64>> = (once.into_iter().filter_map(|id| ways.get(id)))
        .filter(|way| way.len() >= 2)
        .cloned()
        .collect();
    let mut found = Vec::new();
    let mut open = 0;
    while let Some(first) = left.pop() {
        let mut chain = vec![first];
        loop {
            let begin = chain.first().and_then(|way| way.first()).copied();
            let end = chain.last().and_then(|way| way.last()).copied();
            if begin == end {
                let ring = chain.iter().flat_map(|way| &way[..way.len() - 1]);
                found.push(ring.copied().collect());
                break;
            }
            let meets = |way: &Vec<i64>| way.first().copied() == end || way.last().copied() == end;
            if let Some(next) = left.iter().position(meets) {
                let mut way = left.swap_remove(next);
                if way.first().copied() != end {
                    way.reverse();
                }
                chain.push(way);
                continue;
            }
            // The last way leads nowhere: what comes before it may go on without it.
            open += 1;
            chain.pop();
            if chain.is_empty() {
                break;
            }
        }
    }
    (found, open)
}

/// Leaves out rings of the same corners as one before them.
pub fn distinct(rings: impl Iterator<Item = (Vec<DVec2>, bool)>) -> Vec<(Vec<DVec2>, bool)> {
    let mut known = BTreeSet::new();
    let corners = |ring: &[DVec2]| {
        let bits = ring.iter().map(|r| r.to_array().map(f64::to_bits));
        bits.collect::<BTreeSet<[u64; 2]>>()
    };
    rings
        .filter(|(ring, _)| known.insert(corners(ring)))
        .collect()
}

/// For each ring those that it lies in; `hole` says which are meant as holes.
pub fn around(rings: &[Vec<DVec2>], hole: &[bool]) -> Vec<Vec<usize>> {
    let origin = rings.iter().flatten().next().copied().unwrap_or_default();
    let about = |ring: &Vec<DVec2>| ring.iter().map(|r| *r - origin).collect::<Vec<DVec2>>();
    let rings: Vec<Vec<DVec2>> = rings.iter().map(about).collect();
    let areas: Vec<f64> = rings
        .iter()
        .map(|ring| polygon::area_m2(ring).abs())
        .collect();
    let mut scratch = Earcut::new();
    let parts: Vec<Vec<(DVec2, f64)>> =
        rings.iter().map(|ring| parts(ring, &mut scratch)).collect();
    let lies_in = |k: usize, other: usize| {
        if k == other || areas[k] >= areas[other] {
            return false;
        }
        let inside = parts[k]
            .iter()
            .filter(|(r, _)| polygon::encloses(&rings[other], *r));
        let share = inside.map(|(_, area)| area).sum::<f64>() / areas[k];
        // What is said to be a hole may cross the outline.
        let crosses = || {
            rings[k]
                .iter()
                .any(|r| polygon::encloses(&rings[other], *r))
        };
        share > INSIDE || (hole.get(k) == Some(&true) && crosses())
    };
    let all = 0..rings.len();
    all.clone()
        .map(|k| all.clone().filter(|other| lies_in(k, *other)).collect())
        .collect()
}

/// Points inside a ring, with the area that each stands for: corners may lie on another ring's edge, the middles of triangles do not.
fn parts(ring: &[DVec2], scratch: &mut Earcut<f64>) -> Vec<(DVec2, f64)> {
    let points: Vec<[f64; 2]> = ring.iter().map(|r| r.to_array()).collect();
    let mut indices: Vec<usize> = Vec::new();
    scratch.earcut_slice(&points, &[], &mut indices);
    let part = |t: &[usize]| {
        let [a, b, c] = [ring[t[0]], ring[t[1]], ring[t[2]]];
        ((a + b + c) / 3.0, 0.5 * (b - a).perp_dot(c - a).abs())
    };
    indices.chunks_exact(3).map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spur_costs_no_ring() {
        let parts: [&[i64]; 3] = [&[1, 2, 3], &[3, 9], &[3, 4, 1]];
        for order in [[0, 1, 2], [1, 0, 2], [2, 0, 1], [0, 2, 1]] {
            let ways: BTreeMap<i64, Vec<i64>> =
                (1..).zip(order.map(|k| parts[k].to_vec())).collect();
            let (found, open) = join(&[1, 2, 3], &ways);
            assert!(
                found.len() == 1 && found[0].len() == 4 && open == 1,
                "{order:?}: {found:?}"
            );
        }
        let two: BTreeMap<i64, Vec<i64>> =
            [(1, vec![1, 2, 3, 1]), (2, vec![5, 6, 7]), (3, vec![7, 5])].into();
        assert_eq!(join(&[1, 2, 3, 3], &two).0.len(), 2);
        assert_eq!(join(&[2], &two), (vec![], 1));
    }

    #[test]
    fn rings_lie_in_each_other_by_their_area() {
        let ring = |points: &[[f64; 2]]| points.iter().map(|p| DVec2::from(*p)).collect::<Vec<_>>();
        // A U, and a band along its inner edge with many corners there.
        let u = ring(&[
            [0.0, 0.0],
            [30.0, 0.0],
            [30.0, 30.0],
            [20.0, 30.0],
            [20.0, 10.0],
            [10.0, 10.0],
            [10.0, 30.0],
            [0.0, 30.0],
        ]);
        let mut band = ring(&[
            [8.0, 28.0],
            [8.0, 8.0],
            [22.0, 8.0],
            [22.0, 28.0],
            [20.0, 28.0],
        ]);
        band.extend((1..9).map(|k| DVec2::new(20.0, 28.0 - 2.0 * f64::from(k))));
        band.extend(ring(&[
            [20.0, 10.0],
            [15.0, 10.0],
            [10.0, 10.0],
            [10.0, 20.0],
            [10.0, 28.0],
        ]));
        // Corners that are all the outline's, and half outside.
        let hexagon = ring(&[
            [0.0, 0.0],
            [10.0, 0.0],
            [20.0, 10.0],
            [20.0, 20.0],
            [10.0, 30.0],
            [0.0, 30.0],
        ]);
        let five: Vec<DVec2> = [0, 1, 3, 4, 5].map(|k| hexagon[k]).to_vec();
        for (outer, inner) in [(&u, &band), (&hexagon, &five)] {
            let found = around(&[outer.clone(), inner.clone()], &[false, false]);
            assert_eq!(found, [vec![], vec![0]]);
            assert_eq!(
                around(&[inner.clone(), outer.clone()], &[false, false]),
                [vec![1], vec![]]
            );
        }
        let across = ring(&[[28.0, 2.0], [34.0, 2.0], [34.0, 4.0], [28.0, 4.0]]);
        assert_eq!(
            around(&[u.clone(), across.clone()], &[false, true]),
            [vec![], vec![0]]
        );
        let none: [Vec<usize>; 2] = [vec![], vec![]];
        assert_eq!(around(&[u, across], &[false, false]), none);
    }
}
