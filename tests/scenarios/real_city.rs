//! `urban_intercept` over real cities, blind: acquisition, occlusion, backstop. Data that are not there are skipped.

use crate::common::{BLIND, ROOT, boresight, stderr};
use boresight::app;
use boresight::components::environment::Environment;
use boresight::models::ground::city::City;
use boresight::models::ground::dsm::{HitKind, LineOfSight};
use boresight::models::ground::triangles::TriangleTree;
use boresight::models::maths::geodesy::{Geodetic, SiteFrame};
use boresight::models::shape::mesh::MeshData;
use boresight::models::shape::textured::TexturedMesh;
use boresight::models::tiles::selection::{SelectOptions, View, ideal_cut_behind};
use boresight::models::tiles::tree::TileId;
use boresight::scenario::Scenario;
use boresight::sources::{Layer, LayerKind};
use boresight::systems::render::city_tiles::horizon;
use boresight::tiles::heights::Heights;
use boresight::tiles::settled::{content, settle};
use boresight_geodata::build::{BuildOptions, build};
use boresight_tiles::TilesLight;
use boresight_tiles::prepare::{for_each_triangle, prepare};
use glam::{DVec2, DVec3};
use serde_json::Value;
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A file of the data that lie beside the repository; `None`, with a word, where it is absent.
fn data(path: &str) -> Option<PathBuf> {
    let found = Path::new(ROOT).join("../shared/data").join(path);
    let found = match found.exists() {
        true => found,
        false => Path::new("/work/shared/data").join(path),
    };
    if !found.exists() {
        println!("skipped: {path} is not there");
        return None;
    }
    Some(found)
}

/// `urban_intercept` with another site, city, station and UAV; the rest of the file stays.
fn demo(site: [f64; 3], city: &str, station: &str, start: &str, more: &str) -> String {
    let text = std::fs::read_to_string(Path::new(ROOT).join("scenarios/urban_intercept.toml"));
    let mut text = text.unwrap();
    let [lat, lon, height_m] = site;
    for (from, to) in [
        ("latitude_deg = 47.3769", format!("latitude_deg = {lat}")),
        ("longitude_deg = 8.5417", format!("longitude_deg = {lon}")),
        ("altitude_m = 455.0", format!("altitude_m = {height_m}")),
        ("[-776.4, 635.0, 80.0]", start.to_owned()),
        (
            "[station.laser]",
            format!("[city]\n{city}\n\n[station]\nposition_enu_m = {station}\n\n[station.laser]"),
        ),
    ] {
        assert!(text.contains(from), "the demo has no {from}");
        text = text.replace(from, &to);
    }
    format!("{}\n{more}", text.split("[expect]").next().unwrap())
}

/// `urban_intercept` with a UAV that hovers at a place, the search about it.
fn hovering(demo: &str, place: &str, azimuth_deg: f64, more: &str) -> String {
    let old = demo
        .lines()
        .find(|line| line.starts_with("trajectory"))
        .unwrap();
    let own = format!("trajectory = {{ kind = \"hover\", position_enu_m = {place} }}");
    demo.replace(old, &own)
        .replace("duration_s = 25.0", "duration_s = 8.0")
        .replace(
            "centre_azimuth_deg = 315.0",
            &format!("centre_azimuth_deg = {azimuth_deg:.1}"),
        )
        .replace(
            "[[engage.keep_out]]",
            &format!("{more}\n[[engage.keep_out]]"),
        )
}

/// The `[engage]` under which only the sky stands behind a target, or a building and the ground may, too.
const SKY_ALONE: &str = "[engage]\nmin_clear_range_m = 10\n";
const ANY_BACKSTOP: &str =
    "[engage]\nallow_backstop = [\"sky\", \"building\", \"ground\"]\nmin_clear_range_m = 10\n";

/// Places about a station that are hidden from it, and in sight before something solid, with room around them.
fn hidden_and_walled(environment: &Environment, eye: DVec3) -> [Option<DVec3>; 2] {
    let dsm = &environment.city.dsm;
    let around = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| 2.5 * axis);
    let around = around.map(|off| [off, -off]).into_iter().flatten();
    let around: Vec<DVec3> = around.chain([DVec3::ZERO]).collect();
    let all = |r: DVec3, holds: &dyn Fn(DVec3) -> bool| around.iter().all(|off| holds(r + off));
    let clear = |r| environment.line_of_sight(eye, r) == LineOfSight::Clear;
    let stopped = |r: DVec3| dsm.first_hit(eye, (r - eye).normalize(), 5_000.0).is_some();
    let mut found = [None; 2];
    for k in 0..40_000 {
        let k = f64::from(k);
        let range_m = 20.0 + 100.0 * (k / 13_000.0).exp();
        let p = eye.truncate() + range_m * DVec2::from_angle(2.4 * k);
        let r = p.extend(dsm.surface_m(p.x, p.y) + 6.0 + (0.37 * k) % 12.0);
        // Nothing to fly into within six metres.
        let open = (0..6).all(|turn| {
            let p = p + 6.0 * DVec2::from_angle(f64::from(turn));
            dsm.surface_m(p.x, p.y) < r.z - 5.0
        });
        if !open {
            continue;
        }
        if found[0].is_none() && all(r, &|r| !clear(r)) {
            found[0] = Some(r);
        }
        if found[1].is_none() && all(r, &|r| clear(r) && stopped(r)) {
            found[1] = Some(r);
        }
    }
    found
}

/// What a window leaves out behind the horizon of the surface, all around an eye and eight others near it: tiles, and
/// the share of its rays that would have met one of them.
fn horizon_hides_only_what_is_hidden(environment: &Environment, place: &str, eye: DVec3) {
    let (dsm, city) = (&environment.city.dsm, environment.tiles.as_ref().unwrap());
    let mut tileset = city.tileset.lock().unwrap().clone();
    let root_from_enu = city.enu_from_root.inverse();
    let along = |v: DVec3| root_from_enu.transform_vector3(v).normalize();
    let mut known: BTreeMap<TileId, Vec<[DVec3; 3]>> = BTreeMap::new();
    let (mut drawn, mut left, mut rays, mut lost) = ([0; 2], 0, 0, 0);
    for k in 0..9 {
        let off = f64::from(k) * 12.0 * DVec2::from_angle(2.4 * f64::from(k));
        let p = eye.truncate() + off;
        let eye = match k {
            0 => eye,
            _ => p.extend(dsm.surface_m(p.x, p.y) + 3.0),
        };
        let eye_root = root_from_enu.transform_point3(eye);
        let horizon = horizon(dsm, &city.enu_from_root, eye_root);
        for turn in 0..4 {
            let forward = DVec2::from_angle(f64::from(turn) * FRAC_PI_2).extend(-0.1);
            let view = View {
                r_root_m: eye_root,
                forward: along(forward),
                up: along(DVec3::Z),
                fovy_rad: 1.0,
                size_px: [1280, 800],
            };
            let select = SelectOptions::default();
            let open = settle(&mut tileset, &[view], &select).unwrap().draw;
            let behind = ideal_cut_behind(&tileset.tree, &[view], &select, Some(&horizon));
            assert!(behind.draw.iter().all(|tile| open.contains(tile)));
            let hidden = |tile: &TileId| !behind.draw.contains(tile);
            left += open.iter().filter(|tile| hidden(tile)).count();
            let mut corners = Vec::new();
            let mut owner = Vec::new();
            for (index, tile) in open.iter().enumerate() {
                let triangles = known.entry(*tile).or_insert_with(|| {
                    let content = content(&tileset, *tile).unwrap();
                    let to_enu = city.enu_from_root * tileset.tree.tile(*tile).to_root_m;
                    let mut triangles = Vec::new();
                    let prepared = prepare(&content, to_enu, TilesLight::AsStored);
                    for_each_triangle(&prepared, |corners| triangles.push(corners));
                    triangles
                });
                drawn[0] += triangles.len();
                drawn[1] += if hidden(tile) { 0 } else { triangles.len() };
                corners.extend(triangles.iter().copied());
                owner.extend(triangles.iter().map(|_| index));
            }
            let solids = TriangleTree::new(corners.clone());
            // The tree sorts its triangles: their corners tell whose they are.
            let key = |c: &[DVec3; 3]| c.map(|c| c.to_array().map(f64::to_bits));
            let owner: BTreeMap<_, usize> = corners.iter().map(key).zip(owner).collect();
            let right = forward.cross(DVec3::Z).normalize();
            for (x, y) in (0..80).flat_map(|x| (0..50).map(move |y| (x, y))) {
                let [x, y] = [f64::from(x) / 40.0 - 1.0, f64::from(y) / 25.0 - 1.0];
                let up = right.cross(forward.normalize());
                let ray = forward.normalize() + 0.546 * (1.6 * x * right + y * up);
                let Some(hit) = solids.first_hit(eye, 5_000.0 * ray.normalize()) else {
                    continue;
                };
                rays += 1;
                let tile = open[owner[&key(&solids.corners_m(hit.triangle))]];
                lost += usize::from(hidden(&tile));
            }
        }
    }
    println!(
        "{place}: {left} tiles left out behind the horizon, {drawn:?} triangles, {lost} of {rays} rays lost"
    );
    // Zürich's tiles are larger than its ridges.
    assert!(rays > 10_000 && (left > 0 || place == "Zürich"));
    assert!(1000 * lost <= rays, "{place}: {lost} of {rays}");
}

/// Acquisition, occlusion and backstop about the station of `demo`, whose city is a tileset in `folder`.
fn hides_and_stops(folder: &Path, place: &str, demo: &str) {
    std::fs::write(folder.join("looked.toml"), demo).unwrap();
    let (environment, scenario) = environment(folder, "looked");
    let eye = DVec3::from(scenario.station.position_enu_m.unwrap());
    horizon_hides_only_what_is_hidden(&environment, place, eye);
    let [hidden, walled] = hidden_and_walled(&environment, eye);
    let hover = |r: DVec3, engage: &str| {
        let off = r - eye;
        let azimuth_deg = off.x.atan2(off.y).to_degrees().rem_euclid(360.0);
        let at = format!("[{}, {}, {}]", r.x, r.y, r.z);
        hovering(demo, &at, azimuth_deg, engage)
    };
    let hidden = hidden.unwrap_or_else(|| panic!("{place} hides nothing"));
    let unseen = run(folder, "hidden", &hover(hidden, ANY_BACKSTOP));
    assert_eq!(
        seconds(&unseen, "time_to_acquire_s"),
        None,
        "{place} at {hidden}: {unseen:#}"
    );
    let walled = walled.unwrap_or_else(|| panic!("{place} stands behind nothing"));
    let held = run(folder, "walled", &hover(walled, SKY_ALONE));
    assert!(
        seconds(&held, "time_to_acquire_s").is_some(),
        "{place} at {walled}: {held:#}"
    );
    assert_eq!(held["energy_j"], 0.0, "{place} at {walled}: {held:#}");
    let fired = run(folder, "fired", &hover(walled, ANY_BACKSTOP));
    assert!(
        fired["energy_j"].as_f64().unwrap() > 0.0,
        "{place} at {walled}: {fired:#}"
    );
    let kind = environment
        .city
        .dsm
        .first_hit_kind(eye, (walled - eye).normalize(), 5_000.0);
    println!(
        "{place}: hidden at {hidden:.0}; at {walled:.0}, before {:?} {:.0} m off, held fire without leave and fired with",
        kind.unwrap().1,
        kind.unwrap().0
    );
}

/// Builds a file into tiles in a folder, as a user would.
fn built(folder: &Path, arguments: &[&str]) {
    let output = boresight()
        .args(["tiles", "build"])
        .args(arguments)
        .arg("--out")
        .arg(folder.join("tiles"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
}

/// Runs a scenario blind in a folder of its own and gives its summary.
fn run(folder: &Path, name: &str, text: &str) -> Value {
    let file = folder.join(format!("{name}.toml"));
    std::fs::write(&file, text).unwrap();
    let out = folder.join(name);
    let output = boresight()
        .arg("run")
        .arg(&file)
        .arg("--out")
        .arg(&out)
        .args(BLIND)
        .env("BORESIGHT_CACHE", folder.join("cache"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{name}: {}", stderr(&output));
    let summary = std::fs::read_to_string(out.join("summary.json")).unwrap();
    serde_json::from_str(&summary).unwrap()
}

/// The surroundings of a scenario.
fn environment(folder: &Path, name: &str) -> (Environment, Scenario) {
    // One variable for this process and those it starts.
    let file = folder.join(format!("{name}.toml"));
    let loaded = Scenario::load(&file, &["detector.kind=truth".into()]).unwrap();
    let app = app::checked(&loaded).unwrap();
    let world = app.world();
    let environment = world.resource::<Environment>().clone();
    let scenario = world.resource::<boresight::components::run::RunScenario>();
    (environment, scenario.scenario.clone())
}

fn seconds(summary: &Value, key: &str) -> Option<f64> {
    summary[key].as_f64()
}

/// The checks that every place must pass. The station stands at `station`, open to the north-west.
fn flown(place: &str, site: [f64; 3], city: &str, station: &str) {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let high = "{ east_m = -776.4, north_m = 635.0, height_m = 300, above = \"ground\" }";
    let sky = demo(site, city, station, high, "");
    let seen = run(folder, "sky", &sky);
    println!(
        "{place}: {} after {:?} s",
        seen["outcome"],
        seconds(&seen, "time_to_neutralise_s")
    );
    assert!(
        seconds(&seen, "time_to_acquire_s").unwrap() < 5.0,
        "{place}: {seen:#}"
    );
    assert_eq!(seen["outcome"], "neutralised", "{place}");

    // Cached tiles would lie elsewhere for this process: sources are looked at through the command alone.
    if city.contains("sources") {
        return;
    }
    let (environment, scenario) = environment(folder, "sky");
    let r_enu_m = DVec3::from(scenario.station.position_enu_m.unwrap());
    let dsm = &environment.city.dsm;
    assert!(r_enu_m.z > dsm.surface_m(r_enu_m.x, r_enu_m.y));
    // A ray down meets the ground where the raster says it is.
    for k in 0..50 {
        let p = r_enu_m.truncate() + 20.0 * DVec2::from_angle(f64::from(k)) * f64::from(k) / 10.0;
        let from = p.extend(r_enu_m.z + 500.0);
        let range_m = dsm.first_hit(from, DVec3::NEG_Z, 5_000.0).unwrap();
        let up_m = from.z - range_m;
        assert!(up_m > dsm.terrain_m(p.x, p.y) - 3.0, "{place} {p}: {up_m}");
    }
}

/// The generated city as a layer of plain triangles about a site.
fn layer(city: &City, site: SiteFrame) -> Layer {
    let mesh = |data: MeshData| TexturedMesh {
        origin_m: data.origin_enu_m,
        positions: data.positions,
        normals: data.normals,
        colors: data
            .colors
            .iter()
            .map(|[r, g, b, _]| [*r, *g, *b, 1.0])
            .collect(),
        indices: data.indices,
        ..TexturedMesh::default()
    };
    Layer {
        kind: LayerKind::Surface,
        site,
        meshes: city.chunks().into_iter().map(mesh).collect(),
        features: Vec::new(),
        warnings: Vec::new(),
    }
}

#[test]
fn the_generated_city_as_tiles_is_the_same_place() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let demo = std::fs::read_to_string(Path::new(ROOT).join("scenarios/urban_intercept.toml"));
    let demo = demo.unwrap();
    let plain = run(folder, "plain", &demo);
    let (generated, scenario) = environment(folder, "plain");
    let site = generated.site;
    let tiles = folder.join("tiles");
    std::fs::create_dir_all(&tiles).unwrap();
    build(
        &[layer(&generated.city, site)],
        &BuildOptions::default(),
        &tiles,
    )
    .unwrap();
    Heights::of_city(&generated.city, &site)
        .write(&tiles)
        .unwrap();
    let tiled = demo.replace("[search]", "[city]\ntileset = \"tiles\"\n\n[search]");
    let again = run(folder, "tiled", &tiled);
    assert_eq!(plain["state_hash"], again["state_hash"]);
    assert_eq!(plain["outcome"], again["outcome"]);
    let (real, _) = environment(folder, "tiled");
    assert!(real.city.is_real() && real.tiles.is_some());
    assert_eq!(real.city.buildings.len(), generated.city.buildings.len());
    let dsm = &generated.city.dsm;
    let street = (0..100).map(|k| 4.0 * f64::from(k) * DVec2::from_angle(0.3 * f64::from(k)));
    let mut street = street.filter(|p| dsm.surface_m(p.x, p.y) - dsm.terrain_m(p.x, p.y) < 0.1);
    let p = street.next().unwrap();
    let eye = p.extend(dsm.surface_m(p.x, p.y) + 2.0);
    horizon_hides_only_what_is_hidden(&real, "generated city", eye);

    // Without the heights the triangles speak: the same sight lines to within a cell or so.
    std::fs::remove_file(tiles.join("heights.bin")).unwrap();
    let (seen, _) = environment(folder, "tiled");
    assert!(seen.city.dsm.solids().is_some());
    let eye = generated.city.station_enu_m();
    let (mut same, mut count, mut blocked) = (0, 0, 0);
    for k in 0..4_000 {
        let k = f64::from(k);
        let p = (60.0 + 0.24 * k) * DVec2::from_angle(2.4 * k);
        let to = p.extend(generated.city.dsm.terrain_m(p.x, p.y) + 3.0 + (7.3 * k) % 60.0);
        if to.z < generated.city.dsm.surface_m(p.x, p.y) {
            continue;
        }
        let [one, other] =
            [&generated, &seen].map(|place| place.line_of_sight(eye, to) == LineOfSight::Clear);
        count += 1;
        same += i32::from(one == other);
        blocked += i32::from(!one);
    }
    println!("{same} of {count} sight lines alike, {blocked} blocked");
    assert!(
        blocked > 300 && f64::from(same) > 0.97 * f64::from(count),
        "{same} of {count}"
    );
    let _ = scenario;
}

#[test]
fn over_delft() {
    let Some(file) = data("cityjson/delft.city.json") else {
        return;
    };
    let city = format!("sources = [{:?}]", file.to_str().unwrap());
    let station = "{ lat = 52.0122, lon = 4.3658, height_m = 25, above = \"roof\" }";
    let site = [52.0122, 4.3658, 43.0];
    flown("Delft", site, &city, station);
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    built(folder, &[file.to_str().unwrap()]);
    // Between the roofs, where there is something to hide behind.
    let station = "{ lat = 52.0122, lon = 4.3658, height_m = 8, above = \"ground\" }";
    let low = demo(site, "tileset = \"tiles\"", station, "[0.0, 0.0, 50.0]", "");
    hides_and_stops(folder, "Delft", &low);
}

#[test]
fn over_zurichs_terrain() {
    let Some(file) = data("dem/zh_dem_25.tif") else {
        return;
    };
    let file = file.to_str().unwrap().to_owned();
    let city = format!("sources = [{{ file = {file:?}, crs = \"EPSG:21781\" }}]\ndetail_m = 5");
    let station = "{ lat = 47.3769, lon = 8.5417, height_m = 20, above = \"ground\" }";
    let site = [47.3769, 8.5417, 455.0];
    flown("Zürich", site, &city, station);
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    built(folder, &[&file, "--crs", "EPSG:21781"]);
    let city = "tileset = \"tiles\"\ndetail_m = 5";
    let low = demo(site, city, station, "[0.0, 0.0, 50.0]", "");
    hides_and_stops(folder, "Zürich", &low);
}

/// A wall of houses to the north of the station, as glTF-less tiles of our own builder.
#[test]
fn houses_hide_and_stand_behind() {
    let folder = TempDir::new().unwrap();
    let folder = folder.path();
    let site = SiteFrame::new(Geodetic {
        latitude_rad: 47.3769_f64.to_radians(),
        longitude_rad: 8.5417_f64.to_radians(),
        height_m: 455.0, // [m]
    });
    let mut data = MeshData::new(DVec3::ZERO);
    let grey = boresight::models::shape::mesh::Paint::plain([0.3; 3]);
    // A sheet: of a slab the lower face would be the lowest hit, which the ground is looked for among.
    let corners = [
        [-600.0, -600.0],
        [600.0, -600.0],
        [600.0, 600.0],
        [-600.0, 600.0],
    ];
    data.floor(&corners.map(DVec2::from), 0.0, 1.0, grey);
    // Behind a slab of 40 m stands nothing, before a long one of 60 m the UAV may fly.
    data.cuboid(
        DVec3::new(-60.0, 200.0, 0.0),
        DVec3::new(-20.0, 215.0, 40.0),
        grey,
    );
    data.cuboid(
        DVec3::new(-580.0, 480.0, 0.0),
        DVec3::new(-380.0, 520.0, 90.0),
        grey,
    );
    let mesh = TexturedMesh {
        positions: data.positions,
        normals: data.normals,
        indices: data.indices,
        ..TexturedMesh::default()
    };
    let own = Layer {
        kind: LayerKind::Surface,
        site,
        meshes: vec![mesh],
        features: Vec::new(),
        warnings: Vec::new(),
    };
    let tiles = folder.join("tiles");
    std::fs::create_dir_all(&tiles).unwrap();
    build(&[own], &BuildOptions::default(), &tiles).unwrap();
    let at = [47.3769, 8.5417, 455.0];
    let station = "{ east_m = 0, north_m = 0, height_m = 20, above = \"ground\" }";
    let city = "tileset = \"tiles\"";
    let plain = demo(at, city, station, "[0.0, 0.0, 50.0]", "");
    let hover = |place: &str, engage: &str| hovering(&plain, place, 330.0, engage);
    // Behind the slab, on its roof's line: hidden; 60 m up: seen.
    let hidden = "{ east_m = -44, north_m = 230, height_m = 10, above = \"ground\" }";
    let summary = run(folder, "hidden", &hover(hidden, ""));
    assert_eq!(seconds(&summary, "time_to_acquire_s"), None, "{summary:#}");
    let (environment, scenario) = environment(folder, "hidden");
    let (eye, uav) = (
        DVec3::from(scenario.station.position_enu_m.unwrap()),
        DVec3::new(-44.0, 230.0, 10.0),
    );
    assert!((eye - DVec3::new(0.0, 0.0, 20.0)).length() < 0.1, "{eye}");
    assert!(matches!(
        environment.line_of_sight(eye, uav),
        LineOfSight::BlockedAt(_)
    ));
    assert_eq!(environment.city.buildings.len(), 2);
    assert!((environment.city.dsm.surface_m(-40.0, 207.0) - 40.0).abs() < 0.2);
    // A roof is a place, too.
    let above = "{ east_m = -44, north_m = 207, height_m = 20, above = \"roof\" }";
    let summary = run(folder, "above", &hover(above, ""));
    assert!(
        seconds(&summary, "time_to_acquire_s").is_some(),
        "{summary:#}"
    );
    assert!(summary["energy_j"].as_f64().unwrap() > 0.0, "{summary:#}");
    // Before the long slab the beam would meet a wall.
    let before = "{ east_m = -430, north_m = 430, height_m = 40, above = \"ground\" }";
    let walled = run(folder, "walled", &hover(before, ""));
    assert_eq!(walled["energy_j"], 0.0, "{walled:#}");
    let wall = DVec3::new(-430.0, 430.0, 40.0) - eye;
    let dsm = &environment.city.dsm;
    let (_, kind) = dsm.first_hit_kind(eye, wall.normalize(), 5_000.0).unwrap();
    assert_eq!(kind, HitKind::Building);
    let text = hover(before, ANY_BACKSTOP);
    let fired = run(folder, "fired", &text);
    assert!(fired["energy_j"].as_f64().unwrap() > 0.0, "{fired:#}");
}

#[test]
fn over_mars() {
    let Some(file) = data("tiles/mars-terrain/example/public/data/tileset.json") else {
        return;
    };
    // Its own frame has y up: the tileset around it that is shipped turns it.
    let folder = TempDir::new().unwrap();
    let tileset = folder.path().join("mars/tileset.json");
    let around = Path::new(ROOT).join("examples/real_cities/mars/tileset.json");
    std::fs::create_dir(folder.path().join("mars")).unwrap();
    std::fs::create_dir(folder.path().join("data")).unwrap();
    std::fs::copy(around, &tileset).unwrap();
    std::os::unix::fs::symlink(file.parent().unwrap(), folder.path().join("data/mars")).unwrap();
    let city = format!(
        "tileset = {:?}\ndetail_m = 0.5\nradius_m = 200",
        tileset.to_str().unwrap()
    );
    // On the rim of its crater.
    let station = "{ east_m = -130, north_m = 50, height_m = 10, above = \"roof\" }";
    let site = [47.3769, 8.5417, 455.0];
    flown("Mars", site, &city, station);
    let low = demo(site, &city, station, "[0.0, 0.0, 50.0]", "");
    hides_and_stops(folder.path(), "Mars", &low);
}
