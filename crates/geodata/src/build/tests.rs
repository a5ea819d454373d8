//! Tiles as they are written, read back.

use super::measure::farthest_between;
use super::options::{BuildOptions, Division, Pictures};
use super::{BuildReport, build};
use crate::sources::{Layer, LayerKind};
use crate::tiles::content::{Content, UpAxis, decode};
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use boresight_models::shape::textured::{Look, Texture, TexturedMesh};
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::Arc;

fn site() -> SiteFrame {
    SiteFrame::new(Geodetic {
        latitude_rad: 0.8,
        longitude_rad: 0.15,
        height_m: 430.0,
    })
}

fn layer(kind: LayerKind, meshes: Vec<TexturedMesh>) -> Layer {
    Layer {
        kind,
        site: site(),
        meshes,
        features: Vec::new(),
        warnings: Vec::new(),
    }
}

/// Height of the hills of the tests [m].
fn height_m(e: f64, n: f64) -> f64 {
    12.0 * (e / 60.0).sin() * (n / 45.0).cos() + 1.5 * (e / 9.0).sin() + 0.01 * e
}

/// Smooth colours over the unit square, sRGB.
fn shade(u: f64, v: f64) -> [u8; 3] {
    let wave = |x: f64| (127.5 + 100.0 * x.sin()) as u8;
    [wave(7.0 * u), wave(5.0 * v), wave(4.0 * (u + v))]
}

/// Hills of `n` × `n` cells of some size [m] under a picture.
fn hills(n: u32, cell_m: f64) -> TexturedMesh {
    let side = 512;
    let mut rgba = Vec::new();
    for y in 0..side {
        for x in 0..side {
            let at = |k: u32| (f64::from(k) + 0.5) / f64::from(side);
            rgba.extend(shade(at(x), at(y)));
            rgba.push(255);
        }
    }
    let mut mesh = TexturedMesh {
        origin_m: DVec3::new(100.0, -50.0, 20.0),
        look: Look {
            texture: Some(Arc::new(Texture {
                size_px: [side; 2],
                rgba,
            })),
            repeats: false,
            unlit: true,
            ..Look::default()
        },
        ..TexturedMesh::default()
    };
    for j in 0..=n {
        for i in 0..=n {
            let [e, y] = [i, j].map(|k| f64::from(k) * cell_m);
            mesh.positions
                .push([e, y, height_m(e, y)].map(|x| x as f32));
            mesh.uv
                .push([i as f32 / n as f32, 1.0 - j as f32 / n as f32]);
            if i < n && j < n {
                let a = j * (n + 1) + i;
                let b = a + n + 1;
                mesh.indices.extend([a, a + 1, b + 1, a, b + 1, b]);
            }
        }
    }
    mesh
}

/// A box on the ground about a point, of one feature.
fn house(e: f64, n: f64, half_m: f64, height_m: f64) -> TexturedMesh {
    let corner = |k: usize| {
        let sign = |b: usize| if k >> b & 1 == 1 { half_m } else { -half_m };
        [sign(0), sign(1), if k >> 2 == 1 { height_m } else { 0.0 }].map(|x| x as f32)
    };
    let sides = [
        [0, 1, 5, 4],
        [1, 3, 7, 5],
        [3, 2, 6, 7],
        [2, 0, 4, 6],
        [4, 5, 7, 6],
    ];
    TexturedMesh {
        origin_m: DVec3::new(e, n, 0.0),
        positions: (0..8).map(corner).collect(),
        indices: (sides.iter())
            .flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d])
            .collect(),
        ..TexturedMesh::default()
    }
}

/// A town: a house a feature, with properties.
fn town(n: usize) -> Layer {
    let mut layer = layer(LayerKind::Buildings, Vec::new());
    for k in 0..n * n {
        let (i, j) = ((k % n) as f64, (k / n) as f64);
        let mut mesh = house(
            30.0 * i,
            25.0 * j,
            6.0 + (k % 3) as f64,
            5.0 + (k % 7) as f64,
        );
        mesh.features = vec![k as u32; 8];
        let shade = 0.2 + 0.1 * (k % 5) as f32;
        mesh.colors = vec![[shade, shade, 0.3, 1.0]; 8];
        layer.meshes.push(mesh);
        let row = json!({ "name": format!("house {k}"), "storeys": k % 4 + 1, "height_m": 5.5 });
        layer.features.extend(row.as_object().cloned());
    }
    layer
}

/// A tile as it lies on disk.
struct Read {
    level: usize,
    error_m: f64,
    low: DVec3,
    high: DVec3,
    uri: String,
    content: Content,
    leaf: bool,
}

impl Read {
    fn corners(&self) -> Vec<[DVec3; 3]> {
        let mut out = Vec::new();
        for placed in &self.content.meshes {
            for to in &placed.placements {
                let at = |&i: &u32| to.transform_point3(placed.mesh.vertex_m(i));
                let (triangles, _) = placed.mesh.indices.as_chunks::<3>();
                out.extend(triangles.iter().map(|[a, b, c]| [at(a), at(b), at(c)]));
            }
        }
        out
    }
}

fn open(folder: &Path, uri: &str) -> Content {
    let bytes = std::fs::read(folder.join(uri)).unwrap();
    decode(&bytes, UpAxis::Y, &|_| Err("nothing lies outside".into())).unwrap()
}

fn tileset(folder: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(folder.join("tileset.json")).unwrap()).unwrap()
}

fn bounds(tile: &Value) -> (DVec3, DVec3) {
    let numbers = tile["boundingVolume"]["box"].as_array().unwrap();
    let at = |k: usize| numbers[k].as_f64().unwrap();
    let middle = DVec3::new(at(0), at(1), at(2));
    let half = DVec3::new(at(3), at(7), at(11));
    (middle - half, middle + half)
}

/// Every tile of an explicit tileset.
fn tiles(folder: &Path) -> Vec<Read> {
    let tileset = tileset(folder);
    let mut out = Vec::new();
    let mut open_tiles = vec![(0, &tileset["root"])];
    while let Some((level, tile)) = open_tiles.pop() {
        let (low, high) = bounds(tile);
        let uri = tile["content"]["uri"].as_str().unwrap().to_owned();
        let children = tile["children"].as_array();
        for child in children.into_iter().flatten() {
            let (child_low, child_high) = bounds(child);
            let slack = DVec3::splat(1e-9);
            assert!((child_low + slack).cmpge(low).all() && (child_high - slack).cmple(high).all());
            assert!(child["geometricError"].as_f64() <= tile["geometricError"].as_f64());
            open_tiles.push((level + 1, child));
        }
        out.push(Read {
            level,
            error_m: tile["geometricError"].as_f64().unwrap(),
            low,
            high,
            content: open(folder, &uri),
            uri,
            leaf: children.is_none(),
        });
    }
    out
}

fn built(layers: &[Layer], options: &BuildOptions) -> (tempfile::TempDir, BuildReport) {
    let folder = tempfile::tempdir().unwrap();
    let report = build(layers, options, folder.path()).unwrap();
    (folder, report)
}

fn small() -> BuildOptions {
    BuildOptions {
        max_triangles: 2_200,
        max_texture_px: 512,
        pictures: Pictures::Png,
        threads: NonZeroUsize::new(2),
        ..BuildOptions::default()
    }
}

fn corners_of(mesh: &TexturedMesh) -> Vec<[DVec3; 3]> {
    let (triangles, _) = mesh.indices.as_chunks::<3>();
    triangles
        .iter()
        .map(|t| t.map(|i| mesh.vertex_m(i)))
        .collect()
}

#[test]
fn every_level_keeps_a_third_at_most_and_errs_by_no_more_than_it_says() {
    let mesh = hills(128, 2.0);
    let input = corners_of(&mesh);
    let (folder, report) = built(&[layer(LayerKind::Terrain, vec![mesh])], &small());
    assert_eq!(report.triangles_in, 32_768);
    assert!(report.levels.len() >= 3, "{report:?}");
    let tiles = tiles(folder.path());
    for (level, state) in report.levels.iter().enumerate() {
        assert!(state.share <= 0.3, "level {level}: {state:?}");
        let of_level = || tiles.iter().filter(|t| t.level == level);
        assert_eq!(of_level().count(), state.tiles);
        let mut whole = Vec::new();
        let mut error_m = 0.0_f64;
        for tile in of_level() {
            let corners = tile.corners();
            let shown_m = farthest_between(&corners, input.clone());
            // A leaf says 0: nothing is finer. It is rounded to the lattice, and the input to f32.
            let says_m = tile.error_m.max(2.0 * report.lattice_m);
            assert!(
                shown_m <= says_m,
                "{}: {shown_m} m for {says_m} m",
                tile.uri
            );
            error_m = error_m.max(says_m);
            for corner in corners.as_flattened() {
                let slack = DVec3::splat(1e-6);
                assert!((corner + slack).cmpge(tile.low).all());
                assert!((corner - slack).cmple(tile.high).all());
            }
            whole.extend(corners);
        }
        // Where cells are cut less often, their leaves show the rest.
        let above = tiles.iter().filter(|t| t.leaf && t.level < level);
        whole.extend(above.flat_map(Read::corners));
        let missed_m = farthest_between(&input, whole);
        assert!(
            missed_m <= error_m,
            "level {level}: {missed_m} m for {error_m} m"
        );
    }
    let levels = &report.levels;
    assert!(
        levels
            .windows(2)
            .all(|pair| pair[0].error_m >= pair[1].error_m)
    );
    assert!(tiles.iter().any(|t| t.leaf && t.error_m == 0.0));
}

#[test]
fn tiles_of_one_level_meet_without_cracks() {
    let mesh = hills(96, 2.5);
    let (folder, report) = built(&[layer(LayerKind::Terrain, vec![mesh])], &small());
    let tiles = tiles(folder.path());
    let index = |uri: &str| -> [i64; 2] {
        let parts: Vec<&str> = uri.trim_end_matches(".glb").split('/').collect();
        [parts[2], parts[3]].map(|x| x.parse().unwrap())
    };
    let bits = |r: DVec3| r.to_array().map(f64::to_bits);
    let mut borders = 0;
    for a in &tiles {
        for b in tiles.iter().filter(|b| b.level == a.level) {
            let ([ax, ay], [bx, by]) = (index(&a.uri), index(&b.uri));
            let axis = match (bx - ax, by - ay) {
                (1, 0) => 0,
                (0, 1) => 1,
                _ => continue,
            };
            // Terrain has no overhangs: what both have at the greatest coordinate of one is the border.
            let plane = a.high[axis];
            let on_plane = |tile: &Read| -> BTreeSet<[u64; 3]> {
                let all = tile.corners().into_flattened().into_iter();
                all.filter(|r| (r[axis] - plane).abs() < 1e-9)
                    .map(bits)
                    .collect()
            };
            let (left, right) = (on_plane(a), on_plane(b));
            assert!(left.len() > 2, "{} and {}", a.uri, b.uri);
            assert_eq!(left, right, "{} and {}", a.uri, b.uri);
            borders += 1;
        }
    }
    assert!(borders > 2 * report.levels.len(), "{borders}");
}

#[test]
fn atlases_show_what_the_source_shows() {
    let mesh = hills(64, 4.0);
    let origin_m = mesh.origin_m;
    let (folder, _) = built(&[layer(LayerKind::Terrain, vec![mesh])], &small());
    let mut seen = 0;
    for tile in tiles(folder.path()) {
        for placed in &tile.content.meshes {
            let mesh = &placed.mesh;
            let texture = mesh.look.texture.as_ref().unwrap();
            assert!(mesh.look.unlit);
            for [a, b, c] in mesh.indices.as_chunks::<3>().0 {
                let weights = [(a, 0.2), (b, 0.3), (c, 0.5)];
                let mut at_m = DVec3::ZERO;
                let mut uv = [0.0_f64; 2];
                for (&i, weight) in weights {
                    at_m += weight * placed.placements[0].transform_point3(mesh.vertex_m(i));
                    for (k, x) in uv.iter_mut().enumerate() {
                        *x += weight * f64::from(mesh.uv[i as usize][k]);
                    }
                }
                let r = (at_m - origin_m) / 256.0;
                let wanted = shade(r.x, 1.0 - r.y);
                let px = [0, 1].map(|k| (uv[k] * f64::from(texture.size_px[k])) as u32);
                let at = 4 * (px[1] * texture.size_px[0] + px[0]) as usize;
                for c in 0..3 {
                    let (got, wanted) = (i32::from(texture.rgba[at + c]), i32::from(wanted[c]));
                    // Half a pixel of the coarsest level shifts the colours by less than this.
                    assert!(
                        (got - wanted).abs() <= 8,
                        "{}: {got} for {wanted}",
                        tile.uri
                    );
                }
                seen += 1;
            }
        }
    }
    assert!(seen > 8_000, "{seen}");
}

#[test]
fn buildings_keep_what_is_known_of_them() {
    let town = town(24);
    let (folder, report) = built(std::slice::from_ref(&town), &small());
    assert_eq!(report.features, 576);
    let mut known: BTreeMap<String, usize> = BTreeMap::new();
    let all = tiles(folder.path());
    for tile in all.iter().filter(|t| t.leaf) {
        for row in &tile.content.features {
            let name = row["name"].as_str().unwrap();
            let k: usize = name.trim_start_matches("house ").parse().unwrap();
            assert_eq!(row["storeys"], json!(k % 4 + 1));
            assert_eq!(row["height_m"], json!(5.5));
            *known.entry(name.into()).or_default() += 1;
        }
        // The vertices of a row's triangles are those of its house.
        for placed in &tile.content.meshes {
            for (i, &feature) in placed.mesh.features.iter().enumerate() {
                let row = &tile.content.features[feature as usize];
                let name = row["name"].as_str().unwrap();
                let k: usize = name.trim_start_matches("house ").parse().unwrap();
                let middle = town.meshes[k].origin_m;
                let at_m = placed.placements[0].transform_point3(placed.mesh.vertex_m(i as u32));
                assert!((at_m - middle).abs().max_element() < 12.0);
            }
        }
    }
    // Each in one piece, in one leaf.
    assert_eq!(known.len(), 576);
    assert!(known.values().all(|&count| count == 1));
    for state in &report.levels {
        assert!(state.share <= 0.3, "{state:?}");
    }
}

#[test]
fn the_same_bytes_on_any_number_of_threads() {
    let layers = [layer(LayerKind::Terrain, vec![hills(64, 4.0)]), town(10)];
    let all = |threads: usize| {
        let options = BuildOptions {
            threads: NonZeroUsize::new(threads),
            pictures: Pictures::Jpeg,
            ..small()
        };
        let (folder, report) = built(&layers, &options);
        let mut files: BTreeMap<String, Vec<u8>> = BTreeMap::new();
        let names = tiles(folder.path()).into_iter().map(|tile| tile.uri);
        for name in names.chain(["tileset.json".into()]) {
            files.insert(
                name.clone(),
                std::fs::read(folder.path().join(name)).unwrap(),
            );
        }
        (report, files)
    };
    let (report, files) = all(1);
    assert!(files.len() > 5);
    assert!(all(4) == (report, files));
}

#[test]
fn a_build_takes_away_what_an_earlier_one_left() {
    let (folder, _) = built(&[layer(LayerKind::Terrain, vec![hills(64, 4.0)])], &small());
    let folder = folder.path();
    let old: Vec<_> = tiles(folder).into_iter().map(|tile| tile.uri).collect();
    assert!(old.len() > 1);
    let own = folder.join("notes.txt");
    for path in [&own, &folder.join("heights.bin")] {
        std::fs::write(path, "mine").unwrap();
    }
    let layers = [layer(LayerKind::Terrain, vec![hills(2, 4.0)])];
    build(&layers, &small(), folder).unwrap();
    let new: Vec<_> = tiles(folder).into_iter().map(|tile| tile.uri).collect();
    for uri in old {
        assert_eq!(folder.join(&uri).exists(), new.contains(&uri), "{uri}");
    }
    assert!(own.exists() && !folder.join("heights.bin").exists());
    // What others wrote stays.
    std::fs::write(folder.join("tileset.json"), "{}").unwrap();
    std::fs::write(folder.join("content/0/own.glb"), "mine").unwrap();
    build(&layers, &small(), folder).unwrap();
    assert!(folder.join("content/0/own.glb").exists());
}

#[test]
fn implicit_tiles_are_where_their_numbers_say() {
    let options = BuildOptions {
        implicit: true,
        ..small()
    };
    let layers = [layer(LayerKind::Terrain, vec![hills(128, 2.0)]), town(12)];
    for division in [Division::Quadtree, Division::Octree] {
        let (folder, report) = built(
            &layers,
            &BuildOptions {
                division,
                ..options.clone()
            },
        );
        let tileset = tileset(folder.path());
        let root = &tileset["root"];
        assert_eq!(
            root["implicitTiling"]["availableLevels"],
            json!(report.levels.len())
        );
        let (low, high) = bounds(root);
        let mut found = 0;
        let mut open_folders = vec![folder.path().join("content")];
        while let Some(next) = open_folders.pop() {
            for entry in std::fs::read_dir(next).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() {
                    open_folders.push(path);
                    continue;
                }
                let uri = path.strip_prefix(folder.path()).unwrap().to_str().unwrap();
                let numbers: Vec<f64> = (uri.trim_end_matches(".glb").split(['/', '\\']).skip(1))
                    .map(|x| x.parse().unwrap())
                    .collect();
                let share = 0.5_f64.powf(numbers[0]);
                let read = Read {
                    level: 0,
                    error_m: 0.0,
                    low,
                    high,
                    uri: uri.into(),
                    content: open(folder.path(), uri),
                    leaf: false,
                };
                for corner in read.corners().into_flattened() {
                    for (axis, number) in numbers[1..].iter().enumerate() {
                        let from = low[axis] + (high[axis] - low[axis]) * share * number;
                        let to = from + (high[axis] - low[axis]) * share;
                        assert!(
                            corner[axis] > from - 1e-6 && corner[axis] < to + 1e-6,
                            "{uri}"
                        );
                    }
                    assert!(corner.z > low.z - 1e-6 && corner.z < high.z + 1e-6);
                }
                found += 1;
            }
        }
        assert_eq!(found, report.tiles());
        assert!(
            folder.path().join("subtrees/0/0/0.subtree").exists()
                == (division == Division::Quadtree)
        );
    }
}

#[test]
fn compressed_tiles_hold_the_same() {
    let layers = [layer(LayerKind::Terrain, vec![hills(48, 4.0)]), town(8)];
    let (plain, large) = built(&layers, &small());
    let options = BuildOptions {
        meshopt: true,
        ..small()
    };
    let (packed, less) = built(&layers, &options);
    assert!(less.bytes < large.bytes);
    for (a, b) in tiles(plain.path()).iter().zip(&tiles(packed.path())) {
        assert_eq!(a.uri, b.uri);
        let sorted = |read: &Read| {
            let mut all = read.corners();
            // The index codec may turn a triangle's corners round.
            for t in &mut all {
                let least =
                    (0..3).min_by(|&i, &j| t[i].to_array().partial_cmp(&t[j].to_array()).unwrap());
                t.rotate_left(least.unwrap());
            }
            let key = |t: &[DVec3; 3]| t.map(|r| r.to_array().map(f64::to_bits));
            all.sort_by_key(key);
            all
        };
        assert_eq!(sorted(a), sorted(b));
        assert_eq!(a.content.features, b.content.features);
    }
}

#[test]
fn layers_of_other_sites_come_into_the_frame_of_the_first() {
    let east = SiteFrame::new(Geodetic {
        longitude_rad: 0.15 + 500.0 / 6_378_137.0 / 0.8_f64.cos(),
        ..site().origin()
    });
    let here = layer(LayerKind::Buildings, vec![house(0.0, 0.0, 5.0, 10.0)]);
    let there = Layer {
        site: east,
        ..here.clone()
    };
    let (folder, _) = built(&[here, there], &small());
    let tiles = tiles(folder.path());
    let most = tiles[0]
        .corners()
        .into_flattened()
        .iter()
        .map(|r| r.x)
        .fold(0.0, f64::max);
    let wanted = site()
        .ecef_to_enu(east.enu_to_ecef(DVec3::new(5.0, 0.0, 0.0)))
        .x;
    assert!((most - wanted).abs() < 0.01, "{most} m for {wanted} m");
    let transform = tileset(folder.path())["root"]["transform"].clone();
    let origin = site().enu_to_ecef(DVec3::ZERO);
    for k in 0..3 {
        assert!((transform[12 + k].as_f64().unwrap() - origin[k]).abs() < 1e-9);
    }
}

#[test]
fn bad_layers_and_options_are_errors_that_say_where() {
    let folder = tempfile::tempdir().unwrap();
    let fails = |layers: &[Layer], options: &BuildOptions| {
        build(layers, options, folder.path())
            .unwrap_err()
            .to_string()
    };
    assert!(fails(&[], &small()).contains("no triangles"));
    let mut far = house(0.0, 0.0, 5.0, 5.0);
    far.positions[3] = [4e6, 0.0, 0.0];
    let text = fails(&[layer(LayerKind::Buildings, vec![far])], &small());
    assert!(
        text.contains("vertex 3") && text.contains("--crs"),
        "{text}"
    );
    let mut nan = house(0.0, 0.0, 5.0, 5.0);
    nan.positions[2] = [f32::NAN; 3];
    assert!(fails(&[layer(LayerKind::Buildings, vec![nan])], &small()).contains("vertex 2"));
    let mut wild = house(0.0, 0.0, 5.0, 5.0);
    wild.indices[4] = 99;
    assert!(fails(&[layer(LayerKind::Buildings, vec![wild])], &small()).contains("mesh 0"));
    let options = BuildOptions {
        keep: 2.0,
        ..small()
    };
    let good = layer(LayerKind::Buildings, vec![house(0.0, 0.0, 5.0, 5.0)]);
    assert!(fails(&[good], &options).contains("--keep"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_small_mesh_is_built_and_read_back(
        places in proptest::collection::vec(proptest::array::uniform3(-40.0_f32..40.0), 3..60),
        picks in proptest::collection::vec(0_usize..1000, 3..240),
        octree in any::<bool>(),
        implicit in any::<bool>(),
    ) {
        let mesh = TexturedMesh {
            indices: (picks.as_chunks::<3>().0.iter().flatten())
                .map(|pick| (pick % places.len()) as u32)
                .collect(),
            colors: places.iter().map(|p| [p[0].abs() / 40.0, 0.5, 0.5, 1.0]).collect(),
            positions: places,
            ..TexturedMesh::default()
        };
        let area = |t: &[DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).length();
        prop_assume!(corners_of(&mesh).iter().any(|t| area(t) > 1.0));
        let whole = corners_of(&mesh);
        let options = BuildOptions {
            max_triangles: 100,
            division: if octree { Division::Octree } else { Division::Quadtree },
            implicit,
            ..small()
        };
        let (folder, report) = built(&[layer(LayerKind::Surface, vec![mesh])], &options);
        prop_assert!(report.tiles() > 0);
        if !implicit {
            for tile in tiles(folder.path()) {
                let far_m = farthest_between(&tile.corners(), whole.clone());
                prop_assert!(far_m <= tile.error_m.max(2.0 * report.lattice_m), "{far_m} m, {} m", tile.error_m);
            }
        }
    }
}

/// A unit vector is what comes back as a normal.
#[test]
fn normals_of_smooth_meshes_stay() {
    let mut mesh = hills(8, 4.0);
    mesh.look = Look::default();
    mesh.uv.clear();
    mesh.normals = (0..81)
        .map(|k| Vec3::new(0.1 * (k % 3) as f32, 0.2, 1.0).normalize().into())
        .collect();
    let before: BTreeSet<[i32; 3]> = (mesh.normals.iter())
        .map(|n: &[f32; 3]| n.map(|x| (x * 1e4).round() as i32))
        .collect();
    let (folder, _) = built(&[layer(LayerKind::Terrain, vec![mesh])], &small());
    let tiles = tiles(folder.path());
    let mesh = &tiles[0].content.meshes[0];
    let turned = |n: &[f32; 3]| {
        let n = mesh.placements[0].transform_vector3(Vec3::from(*n).as_dvec3());
        n.to_array().map(|x| (x * 1e4).round() as i32)
    };
    let after: BTreeSet<[i32; 3]> = mesh.mesh.normals.iter().map(turned).collect();
    assert_eq!(before, after);
}
