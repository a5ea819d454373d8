//! Tiles in pictures: brightness, holes, and what comes with a frame.

use crate::common::{ROOT, rendering};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use bevy::camera::visibility::RenderLayers;
use bevy::prelude::*;
use big_space::prelude::CellCoord;
use boresight::app::{self, Options};
use boresight::components::capture::{ExposedFrame, Frames, Tier};
use boresight::components::environment::{CityTiles, Environment};
use boresight::components::render::{CityTilesets, SENSOR_LAYER, SceneHandles};
use boresight::components::run::{SetUp, TickSet};
use boresight::models::tiles::selection::View;
use boresight::scenario::{Loaded, Scenario};
use boresight::systems::render::scene::grid;
use boresight::tiles::tileset::Tileset;
use boresight_tiles::TilesPlugin;
use boresight_tiles::{
    OpenTiles, TileLoaded, Tiles, TilesCount, TilesLight, TilesPlace, TilesViews,
};
use glam::{DAffine3, DVec2, DVec3};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::{Arc, Mutex};
use tempfile::TempDir;

/// A square panel that faces south, 100 m north of the station.
struct Panel {
    east_m: f64,
    color: [f32; 4],
    unlit: bool,
    /// A PNG on it.
    picture: Option<Vec<u8>>,
    cutoff: Option<f32>,
}

const NORTH_M: f64 = 100.0;
const UP_M: f64 = 48.0;
const SIDE_M: f64 = 1.6;

/// The panel as glTF, whose y is up.
fn gltf(panel: &Panel) -> String {
    let corner = |u: f64, v: f64| {
        let [east, up] = [panel.east_m + u * SIDE_M, UP_M + v * SIDE_M];
        [east as f32, up as f32, -NORTH_M as f32]
    };
    let corners = [
        corner(-0.5, -0.5),
        corner(0.5, -0.5),
        corner(0.5, 0.5),
        corner(-0.5, 0.5),
    ];
    let uv = [[0.0_f32, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
    let mut bytes: Vec<u8> = Vec::new();
    bytes.extend(corners.iter().flatten().flat_map(|x| x.to_le_bytes()));
    bytes.extend(
        corners
            .iter()
            .flat_map(|_| [0.0_f32, 0.0, 1.0])
            .flat_map(|x| x.to_le_bytes()),
    );
    bytes.extend(uv.iter().flatten().flat_map(|x| x.to_le_bytes()));
    bytes.extend([0_u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    let data =
        |kind: &str, bytes: &[u8]| format!("data:{kind};base64,{}", BASE64_STANDARD.encode(bytes));
    let low = corners[0];
    let high = corners[2];
    let mut material = json!({
        "pbrMetallicRoughness": { "baseColorFactor": panel.color, "metallicFactor": 0 },
        "extensions": if panel.unlit { json!({ "KHR_materials_unlit": {} }) } else { json!({}) },
    });
    if let Some(cutoff) = panel.cutoff {
        material["alphaMode"] = json!("MASK");
        material["alphaCutoff"] = json!(cutoff);
    }
    let mut document = json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2 }, "indices": 3, "material": 0,
        }] }],
        "buffers": [{ "byteLength": bytes.len(), "uri": data("application/octet-stream", &bytes) }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 96, "byteLength": 32 },
            { "buffer": 0, "byteOffset": 128, "byteLength": 12 },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": low, "max": high },
            { "bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3" },
            { "bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2" },
            { "bufferView": 3, "componentType": 5123, "count": 6, "type": "SCALAR" },
        ],
    });
    if let Some(png) = &panel.picture {
        document["images"] = json!([{ "uri": data("image/png", png) }]);
        document["textures"] = json!([{ "source": 0 }]);
        material["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
    }
    document["materials"] = json!([material]);
    document.to_string()
}

/// A tileset of panels, each a tile of its own.
fn tileset(panels: &[Panel]) -> TempDir {
    let folder = TempDir::new().unwrap();
    let bounds = |east_m: f64, half_m: f64| json!({ "box": [east_m, NORTH_M, UP_M, half_m, 0, 0, 0, 1, 0, 0, 0, 1] });
    let children: Vec<Value> = (panels.iter().enumerate())
        .map(|(i, panel)| {
            let name = format!("{i}.gltf");
            std::fs::write(folder.path().join(&name), gltf(panel)).unwrap();
            json!({
                "boundingVolume": bounds(panel.east_m, 1.0), "geometricError": 0,
                "content": { "uri": name },
            })
        })
        .collect();
    let tileset = json!({
        "asset": { "version": "1.1" },
        "geometricError": 1000,
        "root": {
            "boundingVolume": bounds(0.0, 20.0), "geometricError": 1000, "refine": "ADD",
            "children": children,
        },
    });
    std::fs::write(folder.path().join("tileset.json"), tileset.to_string()).unwrap();
    folder
}

/// An empty plain under a high sun in the south.
fn plain(more: &[&str]) -> Loaded {
    let set = [
        "detector.kind=truth",
        "uavs=[]",
        "station.position_enu_m=[0, 0, 48]",
        "station.cameras.search={ vignetting_percent = 0, prnu_percent = 0, dsnu_e = 0 }",
        "search={ centre_azimuth_deg = 0, elevation_deg = 0, pattern = 'stare' }",
        "city={ building_density = 0, max_trees = 0, relief_m = 0, river = false }",
        "weather={ visibility_m = 50000, wind_speed_mps = 0 }",
    ];
    let path = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    let set: Vec<String> = set.iter().chain(more).map(ToString::to_string).collect();
    Scenario::load(&path, &set).unwrap()
}

/// A run with a tileset put into its surroundings.
fn with_tiles(loaded: &Loaded, folder: &TempDir) -> App {
    let options = Options {
        capture: true,
        ..Options::default()
    };
    let location = folder.path().display().to_string();
    app::build_with(loaded, &options, |app| {
        let add = move |mut environment: ResMut<Environment>| {
            environment.tiles = Some(CityTiles {
                tileset: Arc::new(Mutex::new(Tileset::open(&location).unwrap())),
                location: location.clone(),
                site: environment.site,
                enu_from_root: DAffine3::IDENTITY,
                light: TilesLight::AsStored,
                summary: String::new(),
                warnings: Vec::new(),
            });
        };
        let between = (add.after(TickSet::Environment)).before(TickSet::Flight);
        app.add_systems(SetUp, between);
    })
    .unwrap()
}

/// The search camera's next frame.
fn search_frame(app: &mut App) -> Arc<ExposedFrame> {
    loop {
        app::step(app.world_mut()).unwrap();
        let mut frames = app.world().resource::<Frames>().0.iter();
        if let Some(frame) = frames.find(|frame| frame.tier == Tier::Search) {
            return frame.clone();
        }
    }
}

/// Linear signal of an 8-bit code (IEC 61966-2-1).
fn linear(code: u8) -> f64 {
    let code = f64::from(code) / 255.0;
    if code <= 0.040_45 {
        code / 12.92
    } else {
        ((code + 0.055) / 1.055).powf(2.4)
    }
}

/// The mean signal about a place in a frame.
fn signal(frame: &ExposedFrame, at_enu_m: DVec3) -> [f64; 3] {
    const HALF_PX: i32 = 3;
    let to_cam = frame.pose.q_enu_cam.inverse() * (at_enu_m - frame.pose.r_enu_m);
    let px: DVec2 = frame.pinhole.project(to_cam).unwrap();
    let rgb8 = frame.rgb8.as_ref().unwrap();
    let mut sum = [0.0; 3];
    for dy in -HALF_PX..=HALF_PX {
        for dx in -HALF_PX..=HALF_PX {
            let (x, y) = (px.x as i32 + dx, px.y as i32 + dy);
            let pixel =
                &rgb8[3 * (y as usize * frame.rect.size_px[0] as usize + x as usize)..][..3];
            for (sum, code) in sum.iter_mut().zip(pixel) {
                *sum += linear(*code);
            }
        }
    }
    sum.map(|sum| sum / f64::from((2 * HALF_PX + 1).pow(2)))
}

fn png(rgba: impl Fn(u32, u32) -> [u8; 4]) -> Vec<u8> {
    let picture = image::RgbaImage::from_fn(64, 64, |x, y| image::Rgba(rgba(x, y)));
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture
        .write_to(&mut bytes, image::ImageFormat::Png)
        .unwrap();
    bytes.into_inner()
}

#[test]
fn tiles_are_as_bright_as_the_light_of_the_scene_makes_them() {
    let _one = rendering();
    const GREY: [f32; 4] = [0.3, 0.3, 0.3, 1.0];
    let plain_panel = |east_m, unlit| Panel {
        east_m,
        color: GREY,
        unlit,
        picture: None,
        cutoff: None,
    };
    // A picture of the same grey: 0.3 is 149 in sRGB.
    let pictured = |east_m, unlit| Panel {
        color: [1.0; 4],
        picture: Some(png(|_, _| [149, 149, 149, 255])),
        ..plain_panel(east_m, unlit)
    };
    let holed = Panel {
        picture: Some(png(|x, _| [149, 149, 149, if x < 32 { 0 } else { 255 }])),
        cutoff: Some(0.5),
        ..pictured(4.0, true)
    };
    let panels = [
        plain_panel(-4.0, true),
        plain_panel(-2.0, false),
        pictured(0.0, true),
        pictured(2.0, false),
        holed,
    ];
    let folder = tileset(&panels);
    let mut app = with_tiles(&plain(&[]), &folder);
    let frame = search_frame(&mut app);
    let environment = app.world().resource::<Environment>();
    let sky = &environment.backdrop.sky;
    let green = |rgb: [f64; 3]| rgb[1];
    // Light on the level, and on a wall that faces south.
    let sun = green(sky.sun_illuminance());
    let (down, up) = (green(sky.ambient_down()), green(sky.ambient_up()));
    let level_klx = sun * environment.backdrop.sun_dir_enu.z + down;
    let wall_klx = sun * (-environment.backdrop.sun_dir_enu.y).max(0.0) + 0.5 * (down + up);
    let at = |east_m| green(signal(&frame, DVec3::new(east_m, NORTH_M, UP_M)));
    let [baked, lit, baked_picture, lit_picture] = [-4.0, -2.0, 0.0, 2.0].map(at);
    println!("{baked} {lit} {baked_picture} {lit_picture}, {level_klx} {wall_klx} klx");
    // Air-light over 100 m and eight bits: a few per cent.
    assert!((baked / lit / (level_klx / wall_klx) - 1.0).abs() < 0.04);
    assert!((baked_picture / baked - 1.0).abs() < 0.03);
    assert!((lit_picture / lit - 1.0).abs() < 0.03);
    // Through the hole the sky or the plain is seen, beside it the panel.
    let beside = at(4.0 + 0.25 * SIDE_M);
    let through = at(4.0 - 0.25 * SIDE_M);
    assert!((beside / baked - 1.0).abs() < 0.05, "{beside}");
    assert!((through / baked - 1.0).abs() > 0.1, "{through}");
}

#[test]
fn tiles_that_come_with_a_frame_are_in_it() {
    let _one = rendering();
    let panel = |east_m| Panel {
        east_m,
        color: [0.8, 0.2, 0.2, 1.0],
        unlit: true,
        picture: Some(png(|x, y| [(4 * x) as u8, (4 * y) as u8, 60, 255])),
        cutoff: None,
    };
    let folder = tileset(&[panel(-20.0), panel(0.0), panel(20.0)]);
    // The camera turns over the panels, of which it sees one at a time.
    let loaded = plain(&[
        "search={ centre_azimuth_deg = 0, elevation_deg = 0, width_deg = 40, height_deg = 1, pattern = 'raster' }",
        "station.cameras.search.hfov_deg=6",
    ]);
    let mut app = with_tiles(&loaded, &folder);
    let mut whole = with_tiles(&loaded, &folder);
    let sensors = whole.world().resource::<CityTilesets>().sensors;
    let mut tiles = whole.world_mut().get_mut::<Tiles>(sensors).unwrap();
    tiles.select.cull = false;
    whole
        .world_mut()
        .get_mut::<OpenTiles>(sensors)
        .unwrap()
        .settled = None;
    let mut most = 0;
    let mut least = usize::MAX;
    for _ in 0..60 {
        let [own, other] = [&mut app, &mut whole].map(search_frame);
        assert_eq!(own.tick, other.tick);
        let drawn = app.world().get::<TilesCount>(sensors).unwrap().drawn;
        most = most.max(drawn);
        least = least.min(drawn);
        assert!(own.rgb8 == other.rgb8, "tick {}: {drawn} tiles", own.tick);
        let all = whole.world().get::<TilesCount>(sensors).unwrap();
        assert_eq!((all.drawn, all.failed), (3, 0));
    }
    assert!(least < most, "{least} to {most} tiles were drawn");
}

/// Five minutes over real terrain without a picture: what is drawn, kept and loaded.
#[derive(Debug, Default)]
struct Flown {
    most_bytes: u64,
    least_drawn: usize,
    drawn: f64,
    triangles: f64,
    loaded: usize,
    last: TilesCount,
}

/// Flies circles over `mars-terrain`, whose y points up, with a camera that looks ahead and down.
fn flown(budget_bytes: u64, cull: bool) -> Option<Flown> {
    const STEPS: u32 = 3_000; // ten a second
    let file = "../shared/data/tiles/mars-terrain/example/public/data/tileset.json";
    let path = Path::new(ROOT).join(file);
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
        return None;
    }
    let mut tiles = Tiles::new(path.display().to_string());
    (tiles.byte_budget, tiles.select.cull) = (budget_bytes, cull);
    let mut app = App::new();
    app.add_plugins((
        MinimalPlugins,
        AssetPlugin::default(),
        TilesPlugin::default(),
    ))
    .init_asset::<Mesh>()
    .init_asset::<Image>()
    .init_asset::<StandardMaterial>();
    let tileset = app.world_mut().spawn(tiles).id();
    let mut flown = Flown {
        least_drawn: usize::MAX,
        ..Flown::default()
    };
    let mut began = false;
    for step in 0..STEPS {
        let (sin, cos) =
            (f64::from(step) / f64::from(STEPS) * 5.0 * std::f64::consts::TAU).sin_cos();
        let middle_m = DVec3::new(216.0, 32.0, 91.0);
        let view = View {
            r_root_m: middle_m + DVec3::new(120.0 * cos, 40.0, 90.0 * sin),
            forward: DVec3::new(-sin, -0.6, cos).normalize(),
            up: DVec3::Y,
            fovy_rad: 1.0,
            size_px: [1280, 800],
        };
        app.world_mut()
            .entity_mut(tileset)
            .insert(TilesViews(vec![view]));
        app.update();
        std::thread::sleep(std::time::Duration::from_millis(2));
        let count = *app.world().get::<TilesCount>(tileset).unwrap();
        flown.most_bytes = flown.most_bytes.max(count.bytes);
        began |= count.drawn > 0;
        if began {
            flown.least_drawn = flown.least_drawn.min(count.drawn);
        }
        flown.drawn += count.drawn as f64 / f64::from(STEPS);
        flown.triangles += count.triangles as f64 / f64::from(STEPS);
        let mut loaded = app.world_mut().resource_mut::<Messages<TileLoaded>>();
        flown.loaded += loaded.drain().count();
        flown.last = count;
    }
    Some(flown)
}

#[test]
fn a_flight_of_five_minutes_stays_within_its_budget() {
    const MIB: u64 = 1 << 20;
    for (budget_bytes, cull) in [
        (24 * MIB, true),
        (24 * MIB, false),
        (256 * MIB, true),
        (256 * MIB, false),
    ] {
        let Some(flown) = flown(budget_bytes, cull) else {
            return;
        };
        println!("{} MiB, culling {cull}: {flown:?}", budget_bytes / MIB);
        // A tile that is being read is counted by a guess: one content's worth over, at the most.
        assert!(flown.most_bytes <= budget_bytes + MIB, "{flown:?}");
        assert!(flown.least_drawn > 0, "a hole: {flown:?}");
        assert_eq!(flown.last.failed, 0);
    }
}

/// A coarse panel stays until the fine ones in its place are drawn: the sky never shows between them.
#[test]
fn no_hole_flashes_while_finer_tiles_arrive() {
    let _one = rendering();
    let panel = |east_m| Panel {
        east_m,
        color: [1.0; 4],
        unlit: true,
        picture: Some(png(|_, _| [200, 30, 30, 255])),
        cutoff: None,
    };
    let (nothing, folder) = (tileset(&[]), TempDir::new().unwrap());
    for name in ["coarse", "fine"] {
        let file = folder.path().join(format!("{name}.gltf"));
        std::fs::write(file, gltf(&panel(0.0))).unwrap();
    }
    let bounds = json!({ "box": [0, NORTH_M, UP_M, 1, 0, 0, 0, 1, 0, 0, 0, 1] });
    let leaf =
        json!({ "boundingVolume": bounds, "geometricError": 0, "content": { "uri": "fine.gltf" } });
    let json = json!({
        "asset": { "version": "1.1" },
        "geometricError": 1000,
        "root": {
            "boundingVolume": bounds, "geometricError": 1, "refine": "REPLACE",
            "content": { "uri": "coarse.gltf" }, "children": [leaf],
        },
    });
    std::fs::write(folder.path().join("tileset.json"), json.to_string()).unwrap();
    let mut app = with_tiles(&plain(&[]), &nothing);
    let world = app.world_mut();
    let site_grid = world.resource::<SceneHandles>().site_grid;
    let streamed = Tiles {
        place: TilesPlace::At(DAffine3::IDENTITY),
        layers: RenderLayers::layer(SENSOR_LAYER),
        ..Tiles::new(folder.path().display().to_string())
    };
    let own = world.spawn((streamed, grid(), CellCoord::default(), ChildOf(site_grid)));
    let own = own.id();
    let view = |north_m: f64| View {
        r_root_m: DVec3::new(0.0, north_m, UP_M),
        forward: DVec3::Y,
        up: DVec3::Z,
        fovy_rad: 0.5,
        size_px: [640, 480],
    };
    // By turns from so far that the coarse one will do, and from near.
    let red = |frame: &ExposedFrame| {
        let [r, g, _] = signal(frame, DVec3::new(0.0, NORTH_M, UP_M));
        r > 3.0 * g
    };
    let (mut shown, mut seen) = (false, [false; 2]);
    for number in 0..60 {
        let far = number / 10 % 2 == 0;
        let from = if far {
            NORTH_M - 2_000.0
        } else {
            NORTH_M - 20.0
        };
        let world = app.world_mut();
        world.get_mut::<TilesViews>(own).unwrap().0 = vec![view(from)];
        let is_red = red(&search_frame(&mut app));
        assert!(is_red || !shown, "a hole in frame {number}");
        shown |= is_red;
        let open = app.world().get::<OpenTiles>(own);
        for (tile, kept) in open.iter().flat_map(|open| &open.kept) {
            seen[usize::from(tile.0 > 0)] |= kept.drawn;
        }
        // Other threads read meanwhile.
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    assert!(shown && seen == [true; 2], "{shown} {seen:?}");
}
