//! Walls, roofs and floors over outlines.

use crate::sources::surfaces::{Corner, Surfaces};
use boresight_models::maths::polygon;
use glam::{DVec2, DVec3};

/// An open ring of bottom and top corners without repeated ones, counter-clockwise seen from above for an outline, clockwise for a hole.
/// Empty where nothing is left.
pub fn tidy(mut ring: Vec<[DVec3; 2]>, outline: bool) -> Vec<[DVec3; 2]> {
    let same = |a: &[DVec3; 2], b: &[DVec3; 2]| a[0].distance_squared(b[0]) < 1e-6;
    ring.dedup_by(|a, b| same(a, b));
    while ring.len() > 1
        && ring
            .first()
            .zip(ring.last())
            .is_some_and(|(a, b)| same(a, b))
    {
        ring.pop();
    }
    let flat: Vec<DVec2> = ring.iter().map(|c| c[0].truncate()).collect();
    let first = flat.first().copied().unwrap_or_default();
    let twice: f64 = flat
        .windows(2)
        .map(|w| (w[0] - first).perp_dot(w[1] - first))
        .sum();
    if ring.len() < 3 || twice.abs() < 0.02 || !twice.is_finite() {
        return Vec::new();
    }
    if (twice > 0.0) != outline {
        ring.reverse();
    }
    ring
}

/// Walls, roof and floor of a building.
pub fn extrude(
    surfaces: &mut Surfaces,
    rings: &[Vec<[DVec3; 2]>],
    roof_m: f64,
    feature: u32,
    [wall, roof]: [[f32; 4]; 2],
) {
    let eaves = |c: &[DVec3; 2]| c[1] - DVec3::Z * roof_m;
    for ring in rings {
        for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
            let face = [a[0], b[0], eaves(b), eaves(a)].map(Corner::from);
            surfaces.polygon(&[face.to_vec()], feature, wall, 0);
        }
    }
    let floor: Vec<Vec<Corner>> = rings
        .iter()
        .map(|ring| ring.iter().rev().map(|c| c[0].into()).collect())
        .collect();
    surfaces.polygon(&floor, feature, wall, 0);
    if roof_m > 0.0 {
        let outline: Vec<DVec2> = rings[0].iter().map(|c| c[1].truncate()).collect();
        let apex = polygon::centroid(&outline).extend(rings[0][0][1].z);
        for (a, b) in rings[0].iter().zip(rings[0].iter().cycle().skip(1)) {
            surfaces.polygon(
                &[[eaves(a), eaves(b), apex].map(Corner::from).to_vec()],
                feature,
                roof,
                0,
            );
        }
    } else {
        let top: Vec<Vec<Corner>> = rings
            .iter()
            .map(|ring| ring.iter().map(|c| c[1].into()).collect())
            .collect();
        surfaces.polygon(&top, feature, roof, 0);
    }
}
