use super::buildings::add_part;
use super::country::GLADE_M;
use super::ground_map::MAP_PX;
use super::trees::add_tree;
use super::*;
use crate::ground::dsm::LineOfSight;
use crate::maths::polygon::{area_m2, centroid, encloses};
use crate::shape::mesh::{MeshData, Surface};

fn city() -> City {
    City::generate(&CityParams::default()).unwrap()
}

#[test]
fn repeats_for_a_seed_and_differs_between_seeds() {
    let (a, b) = (city(), city());
    assert_eq!(a.ground_map, b.ground_map);
    assert_eq!(a.dsm.surface(), b.dsm.surface());
    let c = City::generate(&CityParams {
        seed: 2,
        ..CityParams::default()
    })
    .unwrap();
    assert_ne!(a.ground_map, c.ground_map);
}

#[test]
fn fits_the_triangle_budget_and_stays_well_formed() {
    let chunks = city().chunks();
    let total: usize = chunks.iter().map(MeshData::triangle_count).sum();
    assert!((100_000..=250_000).contains(&total), "{total} triangles");
    for mesh in &chunks {
        let at = |v: &[[f32; 3]], i: u32| DVec3::from(v[i as usize].map(f64::from));
        for t in mesh.indices.chunks_exact(3) {
            let [a, b, c] = [t[0], t[1], t[2]].map(|i| at(&mesh.positions, i));
            let area = (b - a).cross(c - a);
            for &i in t {
                assert!(area.dot(at(&mesh.normals, i)) > 0.0);
            }
        }
        assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
        assert!(
            mesh.colors
                .iter()
                .flatten()
                .all(|c| (0.0..=1.0).contains(c))
        );
    }
}

#[test]
fn walls_face_away_from_the_inside_of_their_outlines() {
    const STEP_M: f64 = 0.01;
    let mut walls = 0;
    for building in city().buildings {
        for part in &building.parts {
            let mut mesh = MeshData::new(DVec3::ZERO);
            add_part(&mut mesh, part, &building);
            for t in mesh.indices.chunks_exact(3) {
                let at = |i: u32| DVec3::from(mesh.positions[i as usize].map(f64::from));
                let [a, b, c] = [at(t[0]), at(t[1]), at(t[2])];
                let normal = (b - a).cross(c - a).normalize_or_zero();
                if normal == DVec3::ZERO {
                    continue;
                }
                let middle = (a + b + c) / 3.0;
                // Roofs look up. A parapet has an inner face too.
                if normal.z.abs() > 0.01 || middle.z > part.eaves_m {
                    assert!(normal.z > -0.01, "a roof of {:?} looks down", building.kind);
                    continue;
                }
                let beside = |step: f64| (middle + step * normal).truncate();
                let inside = |p: DVec2| encloses(&part.outline_enu_m, p);
                assert!(
                    !inside(beside(STEP_M)),
                    "{:?}: a wall looks in",
                    building.kind
                );
                assert!(
                    inside(beside(-STEP_M)),
                    "{:?}: no house behind",
                    building.kind
                );
                walls += 1;
            }
        }
    }
    assert!(walls > 50_000, "{walls}");
}

#[test]
fn buildings_stand_in_the_surface_raster() {
    let city = city();
    assert!(city.buildings.len() > 2000);
    for b in city
        .buildings
        .iter()
        .filter(|b| b.kind != BuildingKind::Bridge)
    {
        let main = &b.parts[0];
        let center = centroid(b.footprint_enu_m());
        if main.outline_enu_m.len() == 4 && area_m2(b.footprint_enu_m()) > 60.0 {
            let z = city.dsm.surface_m(center.x, center.y);
            assert!(
                z >= main.eaves_m - 1e-3,
                "{z} below the eaves {}",
                main.eaves_m
            );
        }
        let cap = CityParams::default().max_height_m.max(60.0) + 20.0;
        assert!(b.height_m() > 2.0 && b.height_m() < cap, "{}", b.height_m());
    }
}

#[test]
fn the_station_overlooks_the_city() {
    let city = city();
    let eye = city.station_enu_m();
    assert!((35.0..=60.0).contains(&eye.z), "{eye}");
    for (range, least) in [(300.0, 0.95), (1000.0, 0.8)] {
        let seen = (0..360)
            .filter(|deg| {
                let az = f64::from(*deg).to_radians();
                let uav = DVec3::new(range * az.sin(), range * az.cos(), 60.0);
                city.dsm.line_of_sight(eye, uav) == LineOfSight::Clear
            })
            .count() as f64
            / 360.0;
        assert!(seen > least, "{seen} of the bearings at {range} m");
    }
    // A street behind the first row of houses is hidden from the ground, not from the sky.
    let low = (0..360)
        .filter(|deg| {
            let az = f64::from(*deg).to_radians();
            let p = DVec3::new(600.0 * az.sin(), 600.0 * az.cos(), 0.0);
            let p = p + DVec3::Z * (city.dsm.surface_m(p.x, p.y) + 0.5);
            city.dsm.line_of_sight(eye, p) == LineOfSight::Clear
        })
        .count();
    assert!(
        low < 340,
        "{low} of 360 points are all seen: nothing blocks"
    );
}

#[test]
fn shadows_fall_away_from_the_sun_and_replace_each_other() {
    let mut city = city();
    let bright = |city: &City, e: f64, n: f64| {
        let px = city.params.extent_m / MAP_PX as f64;
        let column = ((e + city.params.extent_m / 2.0) / px) as usize;
        let row = ((city.params.extent_m / 2.0 - n) / px) as usize;
        city.ground_map.rgb[row * MAP_PX + column]
            .map(u32::from)
            .iter()
            .sum::<u32>()
    };
    let free = bright(&city, 22.0, 0.0);
    // Sun in the west at 45 degrees: the 45 m tower's shadow covers 11..56 m east of it.
    let west = DVec3::new(-1.0, 0.0, 1.0).normalize();
    city.bake_shadows(west);
    let once = city.ground_map.clone();
    assert!(bright(&city, 22.0, 0.0) < free * 3 / 4);
    city.bake_shadows(west);
    assert_eq!(once, city.ground_map);
    city.bake_shadows(DVec3::Z);
    assert!(bright(&city, 22.0, 0.0) > free * 9 / 10);
}

#[test]
fn works_over_its_parameter_range() {
    for seed in 0..4 {
        let params = CityParams {
            seed,
            extent_m: 900.0 + 300.0 * seed as f64,
            river: seed % 2 == 0,
            relief_m: 20.0 * seed as f64,
            building_density: seed as f64 / 3.0,
            max_trees: 100,
            ..CityParams::default()
        };
        let city = City::generate(&params).unwrap();
        assert!(!city.chunks().is_empty());
        assert!(city.trees.len() <= 100);
    }
}

fn country(forest_share: f64, seed: u64) -> City {
    City::generate(&CityParams {
        forest_share,
        seed,
        extent_m: 1200.0,
        building_density: 0.0,
        river: seed % 2 == 1,
        ..CityParams::default()
    })
    .unwrap()
}

#[test]
fn woods_cover_their_share_around_an_open_site() {
    for (share, seed) in [(0.25, 1), (0.5, 2), (0.7, 3), (0.5, 4)] {
        let city = country(share, seed);
        let (mut wooded, mut land) = (0, 0);
        for k in 0..100 * 100 {
            let p = DVec2::new((k % 100) as f64, (k / 100) as f64) * 11.5 - 570.0;
            let river = city.river.as_ref();
            if river.is_some_and(|r| r.offset_m(p).abs() < r.half_width_m + 10.0) {
                continue;
            }
            land += 1;
            let above_m = city.dsm.surface_m(p.x, p.y) - city.dsm.terrain_m(p.x, p.y);
            wooded += usize::from(above_m > 3.0);
        }
        let cover = f64::from(wooded as u32) / f64::from(land);
        // Crowns of a stand leave gaps, and stand over its edge.
        println!("share {share}: covered {cover}, {} trees", city.trees.len());
        assert!(
            (0.65 * share..1.15 * share).contains(&cover),
            "{share}: {cover}"
        );
        assert!(
            (1_000..17_000).contains(&city.trees.len()),
            "{}",
            city.trees.len()
        );
        let near = |t: &Tree| t.base_enu_m.truncate().length() < GLADE_M;
        assert!(!city.trees.iter().any(near));
        assert!(
            city.trees
                .iter()
                .all(|t| (3.9..=25.0).contains(&t.height_m))
        );
        let kinds = |kind| city.trees.iter().filter(|t| t.kind == kind).count();
        assert!(kinds(TreeKind::Conifer) > 100 && kinds(TreeKind::Conifer) < city.trees.len());
        // A few farms and no tower.
        assert!(
            (1..25).contains(&city.buildings.len()),
            "{}",
            city.buildings.len()
        );
        assert!(city.station_enu_m().z < 5.0);
    }
}

#[test]
fn tree_lines_stand_behind_fields() {
    let city = country(0.45, 5);
    let eye = DVec3::new(0.0, 0.0, city.dsm.terrain_m(0.0, 0.0) + 4.0);
    // Nearest ground that a level line of sight a little up runs into.
    let hidden = (0..360)
        .filter(|deg| {
            let (sin, cos) = f64::from(*deg).to_radians().sin_cos();
            let far = eye + DVec3::new(500.0 * sin, 500.0 * cos, 8.0);
            let near = eye + DVec3::new(24.0 * sin, 24.0 * cos, 0.0);
            assert_eq!(city.dsm.line_of_sight(eye, near), LineOfSight::Clear);
            city.dsm.line_of_sight(eye, far) != LineOfSight::Clear
        })
        .count();
    assert!(hidden > 250, "{hidden} of 360 bearings end on trees");
}

#[test]
fn woods_repeat_for_a_seed_within_the_triangle_budget() {
    let started = std::time::Instant::now();
    let (a, b) = (country(0.6, 7), country(0.6, 7));
    println!("{:.2} s each", started.elapsed().as_secs_f64() / 2.0);
    assert_eq!(a.ground_map, b.ground_map);
    assert_eq!(a.dsm.surface(), b.dsm.surface());
    let total: usize = a.chunks().iter().map(MeshData::triangle_count).sum();
    println!("{} trees, {total} triangles", a.trees.len());
    assert!(total < 900_000, "{total}");
    // Only woods carry coordinates for their leaves: a city's trees cost what they did.
    let leaves = |city: &City, given: bool| {
        let chunks = city.chunks();
        let mut crowns = chunks.iter().flat_map(|c| c.surface.iter().zip(&c.uv));
        crowns.all(|(s, uv)| s[0] != Surface::Foliage as u8 as f32 || (uv[1] > 0.0) == given)
    };
    assert!(leaves(&a, true) && leaves(&city(), false));
    let per_tree = |kind| {
        let mut mesh = MeshData::new(DVec3::ZERO);
        let tree = Tree {
            kind,
            inner: false,
            ..a.trees[0]
        };
        add_tree(&mut mesh, &tree, true);
        mesh.triangle_count()
    };
    for kind in [TreeKind::Broadleaf, TreeKind::Conifer, TreeKind::Bare] {
        let count = per_tree(kind);
        assert!((20..100).contains(&count), "{kind:?}: {count}");
    }
}
