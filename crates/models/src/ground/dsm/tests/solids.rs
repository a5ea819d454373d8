//! Sight lines among triangles: boxes, a bridge, an arch, a slope.

use super::*;
use crate::ground::raster::{self, RasterFrame};
use crate::maths::rng::Stream;
use crate::shape::mesh::MeshData;

type Triangle = [DVec3; 3];

/// The two triangles of a parallelogram from `a` along two sides.
fn quad(a: DVec3, u: DVec3, v: DVec3) -> [Triangle; 2] {
    [[a, a + u, a + u + v], [a, a + u + v, a + v]]
}

/// The outside of a box.
fn cuboid(low: DVec3, high: DVec3) -> Vec<Triangle> {
    let size = high - low;
    let [x, y, z] = [size.x * DVec3::X, size.y * DVec3::Y, size.z * DVec3::Z];
    let faces = [
        quad(low, y, x),
        quad(low + z, x, y),
        quad(low, x, z),
        quad(low + y, z, x),
        quad(low, z, y),
        quad(low + x, y, z),
    ];
    faces.concat()
}

/// The place of some triangles over ground of a slope to the east, by raster and by triangles.
fn places(stands: &[Triangle], slope: f64, cell_m: f64) -> [Dsm; 2] {
    let half = 300.0;
    let ground = |e: f64, n: f64| DVec3::new(e, n, slope * e);
    let [a, b, c, d] = [
        ground(-half, -half),
        ground(half, -half),
        ground(half, half),
        ground(-half, half),
    ];
    let all = [[a, b, c], [a, c, d]]
        .into_iter()
        .chain(stands.iter().copied());
    let all: Vec<Triangle> = all.collect();
    let frame = RasterFrame::covering(DVec2::splat(-half), DVec2::splat(half), cell_m);
    let (surface, _) = raster::hits(&frame, all.iter().copied());
    let (terrain, _) = raster::hits(&frame, all[..2].iter().copied());
    let columns = Dsm::new(terrain.clone(), surface, 0.0);
    let land = Lattice::around(&terrain, 50.0, false, |_| None);
    let inside = |p: DVec2| p.abs().max_element() < half;
    let around = land.meshes(cell_m, inside, |_| [0.1; 3]);
    let around = around.iter().flat_map(MeshData::corners_m);
    let triangles = TriangleTree::new(all.into_iter().chain(around).collect());
    let solids = Solids { triangles, land };
    [columns.clone(), columns.with_solids(solids)]
}

#[test]
fn raster_and_triangles_agree_on_boxes_to_a_cell() {
    let mut rng = Stream::new(5, 0, "solid");
    let boxes: Vec<[DVec3; 2]> = (0..30)
        .map(|_| {
            let low = DVec2::new(rng.range(-250.0, 220.0), rng.range(-250.0, 220.0)).floor();
            let size = DVec3::new(
                rng.range(5.0, 30.0),
                rng.range(5.0, 30.0),
                rng.range(5.0, 60.0),
            );
            [low.extend(0.0), low.extend(0.0) + size.floor()]
        })
        .collect();
    let stands: Vec<Triangle> = (boxes.iter())
        .flat_map(|[low, high]| cuboid(*low, *high))
        .collect();
    let [columns, solids] = places(&stands, 0.0, 1.0);
    let (mut hits, mut differ) = (0, 0);
    for _ in 0..5_000 {
        let mut point = |low: f64, high: f64| {
            DVec3::new(
                rng.range(-280.0, 280.0),
                rng.range(-280.0, 280.0),
                rng.range(low, high),
            )
        };
        let (a, b) = (point(61.0, 90.0), point(0.5, 60.0));
        let free = |r: DVec3| r.z > columns.surface_m(r.x, r.y);
        if !free(a) {
            continue;
        }
        let dir = (b - a).normalize();
        let [of_columns, of_solids] =
            [&columns, &solids].map(|dsm| dsm.first_hit_kind(a, dir, 1_000.0));
        // On whole cells both are the same boxes but for rounding at their edges.
        match (of_columns, of_solids) {
            (Some((one_m, kind)), Some((other_m, other))) if (one_m - other_m).abs() < 1e-3 => {
                hits += 1;
                assert_eq!(kind, other, "at {}", a + dir * one_m);
            }
            (None, None) => {}
            _ => differ += 1,
        }
        assert_eq!(free(b), !solids.inside(b), "{b}");
    }
    assert!(hits > 3_000 && differ < 5, "{hits} {differ}");
}

#[test]
fn a_sight_line_goes_under_a_bridge_and_not_through_its_deck() {
    // A deck from 8 m to 9 m up on two abutments.
    let at = DVec3::new;
    let mut bridge = cuboid(at(-60.0, -5.0, 8.0), at(60.0, 5.0, 9.0));
    bridge.extend(cuboid(at(-70.0, -5.0, 0.0), at(-60.0, 5.0, 9.0)));
    bridge.extend(cuboid(at(60.0, -5.0, 0.0), at(70.0, 5.0, 9.0)));
    let [columns, solids] = places(&bridge, 0.0, 1.0);
    let (eye, under, over) = (at(0.0, -80.0, 3.0), at(5.0, 60.0, 4.0), at(0.0, 60.0, 20.0));
    assert_eq!(solids.line_of_sight(eye, under), LineOfSight::Clear);
    // Columns are solid down to the ground.
    assert_ne!(columns.line_of_sight(eye, under), LineOfSight::Clear);
    let blocked = solids.line_of_sight(eye, over);
    // z rises 17 m over 140 m: at the near edge, 75 m out, it is 12.1 m up, above the deck.
    assert_eq!(blocked, LineOfSight::Clear);
    let low = at(0.0, 60.0, 14.0);
    // 11 m over 140 m: 8.89 m up at the near edge, in the deck.
    let LineOfSight::BlockedAt(range_m) = solids.line_of_sight(eye, low) else {
        panic!("through the deck");
    };
    assert!(
        (range_m - 75.0 / 140.0 * eye.distance(low)).abs() < 1e-6,
        "{range_m}"
    );
    assert!(!solids.inside(at(0.0, 0.0, 4.0)) && columns.inside(at(0.0, 0.0, 4.0)));
    assert!(solids.inside(at(0.0, 0.0, 8.5)) && solids.inside(at(65.0, 0.0, 3.0)));
    assert!(!solids.inside(at(0.0, 0.0, 9.1)) && solids.inside(at(0.0, 0.0, -0.1)));
    // Who flies under it is free; who flies up meets its underside, and is put below it.
    assert!(!solids.meets(at(0.0, 0.0, 4.0), at(0.0, 0.1, 4.0)));
    let (before, after) = (at(0.0, 0.0, 7.99), at(0.0, 0.0, 8.02));
    assert!(solids.meets(before, after));
    let free = solids.nearest_clear([before, after], 0.5, 0.2);
    assert!((free - at(0.0, 0.0, 7.495)).length() < 1e-6, "{free}");
    assert!(solids.clear(at(0.0, 0.0, 4.0), 20.0) && !solids.clear(at(55.0, 0.0, 4.0), 10.0));
    assert_eq!(solids.surface_m(0.0, 0.0), 9.0);
    let kind = |dir: DVec3| solids.first_hit_kind(eye, dir.normalize(), 5e3).unwrap().1;
    assert_eq!(kind(at(0.0, 75.0, 5.5)), HitKind::Building);
    assert_eq!(kind(at(0.0, 75.0, -3.0)), HitKind::Ground);
    // Beyond the raster the land goes on.
    assert_eq!(kind(at(1.0, -5_000.0, -40.0)), HitKind::Ground);
}

#[test]
fn an_arch_is_open_in_the_middle() {
    // Half a ring of 20 m and 16 m about the north axis, 6 m deep, of 40 pieces.
    let rim = |k: i32, radius_m: f64| {
        let angle = std::f64::consts::PI * f64::from(k) / 40.0;
        DVec3::new(radius_m * angle.cos(), -3.0, radius_m * angle.sin())
    };
    let deep = 6.0 * DVec3::Y;
    let pieces = (0..40).flat_map(|k| {
        let [a, b] = [k, k + 1].map(|k| rim(k, 20.0));
        let [c, d] = [k, k + 1].map(|k| rim(k, 16.0));
        [
            quad(a, deep, b - a),
            quad(c, d - c, deep),
            [[a, b, d], [a, d, c]],
            [
                [a + deep, d + deep, b + deep],
                [a + deep, c + deep, d + deep],
            ],
        ]
    });
    let arch: Vec<Triangle> = pieces.flatten().collect();
    let [columns, solids] = places(&arch, 0.0, 1.0);
    for step in 0..200 {
        let angle = std::f64::consts::PI * (f64::from(step) + 0.5) / 200.0;
        for (radius_m, open) in [(15.9, true), (16.1, false), (19.8, false), (20.1, true)] {
            let at = DVec3::new(radius_m * angle.cos(), -90.0, radius_m * angle.sin());
            if at.z < 0.2 {
                continue;
            }
            let sight = solids.line_of_sight(at, at + 180.0 * DVec3::Y);
            assert_eq!(sight == LineOfSight::Clear, open, "{radius_m} {angle}");
        }
    }
    let through = DVec3::new(0.0, -90.0, 8.0);
    assert_ne!(
        columns.line_of_sight(through, through + 180.0 * DVec3::Y),
        LineOfSight::Clear
    );
}

#[test]
fn a_slope_is_met_where_it_is() {
    let [_, solids] = places(&[], 0.2, 2.0);
    let mut rng = Stream::new(6, 0, "slope");
    for _ in 0..500 {
        let e = rng.range(-200.0, 200.0);
        let a = DVec3::new(e, rng.range(-200.0, 200.0), 0.2 * e + rng.range(1.0, 30.0));
        let dir = DVec3::new(rng.normal(), rng.normal(), -1.0).normalize();
        // (a + t·dir).z = 0.2 (a + t·dir).x
        let t = (0.2 * a.x - a.z) / (dir.z - 0.2 * dir.x);
        let at = a + t * dir;
        if t < 0.0 || at.truncate().abs().max_element() > 299.0 {
            continue;
        }
        let (range_m, kind) = solids.first_hit_kind(a, dir, 2_000.0).unwrap();
        assert!((range_m - t).abs() < 1e-6 && kind == HitKind::Ground);
        assert!(solids.inside(at - 0.01 * DVec3::Z) && !solids.inside(at + 0.01 * DVec3::Z));
    }
}
