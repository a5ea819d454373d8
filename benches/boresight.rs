//! Speed: ticks without cameras, rendered frames, readback, inference, and where a run's time
//! goes. `cargo bench` takes some three minutes on two cores.

use bevy::ecs::schedule::SingleThreadedExecutor;
use bevy::prelude::*;
use boresight::app::{self, Options};
use boresight::components::capture::{Frames, Readout, SensorCamera, Tier};
use boresight::components::detect::DetectionQueue;
use boresight::components::mount::{Stations, first_station};
use boresight::components::render::SensorViews;
use boresight::components::run::{Kept, SimClock};
use boresight::components::track::{Tracker, TrackingState};
use boresight::inference::OnnxDetector;
use boresight::media::image::encode_jpeg;
use boresight::models::ground::city::{City, CityParams};
use boresight::models::ground::dsm::{LineOfSight, Solids};
use boresight::models::ground::lattice::Lattice;
use boresight::models::ground::triangles::TriangleTree;
use boresight::models::maths::geodesy::{Geodetic, SiteFrame};
use boresight::models::maths::rng::Stream;
use boresight::models::optics::camera::PixelRect;
use boresight::models::optics::seeing::{
    FrameSeeing, FrozenAir, Lens, Look, Picture, Pupil, SEEING_STREAM, SeeingOptics, SeenThrough,
    Sight, WarpScratch,
};
use boresight::models::shape::mesh::MeshData;
use boresight::models::shape::textured::TexturedMesh;
use boresight::models::tiles::selection::{SelectOptions, View, ideal_cut};
use boresight::models::tiles::selector::{Selector, SelectorOptions};
use boresight::models::tiles::tree::{Refine, Tile, TileId, Tree};
use boresight::models::tiles::volume::BoundingVolume;
use boresight::scenario::Loaded;
use boresight::simulation::{Builder, Simulation};
use boresight::sources::{Layer, LayerKind};
use boresight::systems::capture;
use boresight::systems::render::renderer::Renderer;
use boresight::systems::{control, operator, track};
use boresight_geodata::build::{BuildOptions, build};
use boresight_wave::{Aperture, Grid, VonKarman, Wave, even_layers};
use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use glam::{DAffine3, DMat3, DVec2, DVec3};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

const DEMO: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/scenarios/urban_intercept.toml"
);

/// Sight lines a second over the generated city: columns of its raster, and the triangles of its meshes.
fn sight_lines(c: &mut Criterion) {
    let city = City::generate(&CityParams::default()).expect("the default city is sound");
    let triangles = city
        .chunks()
        .iter()
        .flat_map(MeshData::corners_m)
        .collect::<Vec<_>>();
    let mut group = c.benchmark_group("sight lines");
    group.bench_function("tree of triangles, made", |b| {
        b.iter_batched(
            || triangles.clone(),
            TriangleTree::new,
            BatchSize::PerIteration,
        );
    });
    let solids = Solids {
        triangles: TriangleTree::new(triangles),
        land: Lattice::around(city.dsm.terrain(), 100.0, false, |_| None),
    };
    let eye = city.station_enu_m();
    let ends: Vec<DVec3> = (0..1_000)
        .map(|k| {
            let k = f64::from(k);
            ((100.0 + 0.9 * k) * DVec2::from_angle(2.4 * k)).extend(5.0 + (7.3 * k) % 80.0)
        })
        .collect();
    group.throughput(Throughput::Elements(ends.len() as u64));
    for (name, dsm) in [
        ("columns", city.dsm.clone()),
        ("triangles", city.dsm.clone().with_solids(solids)),
    ] {
        group.bench_function(name, |b| {
            b.iter(|| {
                let clear = |to: &&DVec3| dsm.line_of_sight(eye, **to) == LineOfSight::Clear;
                ends.iter().filter(clear).count()
            });
        });
    }
    group.finish();
}

/// What the station has.
fn of<C: Component>(world: &World) -> &C {
    first_station(world).expect("a station has all its parts")
}

/// `urban_intercept` with `uavs` UAVs that circle 1 km away, so that a bench may go on for ever, and
/// overrides.
fn demo(uavs: usize, overrides: &[&str]) -> Loaded {
    let mut text = std::fs::read_to_string(DEMO).expect("the demo is there");
    let orbit = |i: usize| {
        let (east_m, up_m) = (
            -707.0 - 20.0 * (i % 10) as f64,
            90.0 + 20.0 * (i / 10) as f64,
        );
        format!(
            "{{ kind = \"orbit\", centre_enu_m = [{east_m}, 707.0, {up_m}], radius_m = 40.0, \
             speed_mps = 8.0 }}"
        )
    };
    for i in 1..uavs {
        let trajectory = orbit(i);
        write!(
            text,
            "\n[[uavs]]\nname = \"more {i}\"\nmodel = \"phantom4\"\ntrajectory = {trajectory}\n"
        )
        .expect("a string takes everything");
    }
    let first = format!("uavs.0.trajectory={}", orbit(0));
    let overrides: Vec<&str> = [&first[..]]
        .into_iter()
        .chain(overrides.iter().copied())
        .collect();
    let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
    Loaded::parse(text, DEMO.into(), overrides).expect("the demo is valid")
}

/// Ticks per second without images: with the truth detector at the cameras' rates, and bare,
/// with cameras that expose once a second.
fn ticks(criterion: &mut Criterion) {
    const TICKS: u64 = 96;
    let mut group = criterion.benchmark_group("tick");
    group
        .sample_size(10)
        .measurement_time(Duration::from_secs(3));
    group
        .warm_up_time(Duration::from_millis(500))
        .throughput(Throughput::Elements(TICKS));
    let truth = ["detector.kind=truth", "engage.authorised=false"];
    let slow =
        ["search", "coarse", "precise"].map(|camera| format!("station.cameras.{camera}.rate_hz=1"));
    for uavs in [1, 10, 100] {
        for (name, bare) in [("truth detector", false), ("bare", true)] {
            let slow = slow.iter().map(String::as_str).filter(|_| bare);
            let overrides: Vec<&str> = truth.into_iter().chain(slow).collect();
            let loaded = demo(uavs, &overrides);
            let mut app = app::build(&loaded, &Options::default()).expect("the demo builds");
            group.bench_function(format!("{uavs} UAV, {name}"), |bencher| {
                bencher.iter(|| {
                    for _ in 0..TICKS {
                        app::step(app.world_mut()).expect("a tick");
                    }
                });
            });
            // A station that has lost its target has less to do.
            println!(
                "{uavs} UAV, {name}: ends in {}",
                of::<Tracker>(app.world()).state.name()
            );
        }
    }
    // What a second station costs, and the network between the two.
    const TWO: &str = "stations=[{ name = 'west', position_enu_m = [0, 0, 60] }, { name = 'east', position_enu_m = [150, 40, 62] }]";
    const ONE: &str = "stations=[{ name = 'west', position_enu_m = [0, 0, 60] }]";
    for (name, stations) in [("one station", ONE), ("two stations", TWO)] {
        let overrides = [truth[0], truth[1], stations];
        let loaded = demo(1, &overrides);
        let mut app = app::build(&loaded, &Options::default()).expect("the demo builds");
        group.bench_function(name, |bencher| {
            bencher.iter(|| {
                for _ in 0..TICKS {
                    app::step(app.world_mut()).expect("a tick");
                }
            });
        });
    }
    // A flock of a thousand: mates and collisions are looked for, and gusts are shared.
    const FLOCK: &str = "swarms=[{ name = 's', count = 1000, models = ['fpv5', 'mavic2'], formation = 'grid', \
                         from = [{ azimuth_deg = 315, distance_m = 900, above_m = 80 }], to_enu_m = [0, 0, 60], \
                         keep_formation = false, above_ground_m = 40 }]";
    let loaded = demo(1, &[truth[0], truth[1], "uavs=[]", FLOCK]);
    let mut app = app::build(&loaded, &Options::default()).expect("the flock builds");
    group.bench_function(
        "1000 UAVs in a flock, collisions, shared gusts",
        |bencher| {
            bencher.iter(|| {
                for _ in 0..TICKS {
                    app::step(app.world_mut()).expect("a tick");
                }
            });
        },
    );
    group.finish();
}

/// The front door over the engine: a second of `urban_intercept` from its first half second on. `benches/doors.py` measures
/// the same from Python.
fn front_door(criterion: &mut Criterion) {
    const TICKS: u64 = 960;
    let opened = || {
        let mut run = Simulation::builder("scenarios/urban_intercept.toml")
            .set("detector.kind=truth")
            .set("engage.authorised=false")
            .open()
            .expect("the scenario opens");
        run.step(TICKS / 2).expect("half a second");
        run
    };
    let mut group = criterion.benchmark_group("front door");
    group
        .throughput(Throughput::Elements(TICKS))
        .sample_size(10);
    for ticks in [1, 20, TICKS] {
        group.bench_function(format!("step({ticks})"), |bencher| {
            let step = |run: &mut Simulation| {
                for _ in 0..TICKS / ticks {
                    run.step(ticks).expect("ticks");
                }
            };
            bencher.iter_batched_ref(opened, step, BatchSize::PerIteration);
        });
    }
    group.throughput(Throughput::Elements(1));
    let mut run = opened();
    group.bench_function("snapshot", |bencher| {
        bencher.iter(|| run.snapshot().expect("a snapshot"));
    });
    let snapshot = run.snapshot().expect("a snapshot");
    group.bench_function("restore", |bencher| {
        bencher.iter(|| run.restore(&snapshot).expect("its own"));
    });
    group.finish();
}

/// Tracking and control alone: a second of a live run's detections, fed again to those systems.
fn track_and_control(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("track and control");
    for uavs in [1, 100] {
        // Side by side in the coarse camera's field, so that every one of them has a track.
        let hover = |i: usize| {
            let (east_m, up_m) = (-707.0 - 3.0 * (i % 10) as f64, 90.0 + 3.0 * (i / 10) as f64);
            format!(
                "uavs.{i}.trajectory={{ kind = \"hover\", position_enu_m = [{east_m}, 707.0, {up_m}] }}"
            )
        };
        let mut overrides = vec![
            "detector.kind=truth".to_owned(),
            "engage.authorised=false".to_owned(),
            "station.cameras.coarse.readout=full".to_owned(),
        ];
        overrides.extend((0..uavs).map(hover));
        let overrides: Vec<&str> = overrides.iter().map(String::as_str).collect();
        let loaded = demo(uavs, &overrides);
        let mut app = app::build(&loaded, &Options::default()).expect("the demo builds");
        let world = app.world_mut();
        while of::<Tracker>(world).state != TrackingState::Precise {
            assert!(!app::step(world).expect("a tick"), "nothing is held");
        }
        for _ in 0..world.resource::<SimClock>().tick_hz {
            app::step(world).expect("a tick");
        }
        let (clock, tracker) = (*world.resource::<SimClock>(), of::<Tracker>(world).clone());
        let second: Vec<_> = (0..clock.tick_hz)
            .map(|_| {
                app::step(world).expect("a tick");
                of::<DetectionQueue>(world).arrived.clone()
            })
            .collect();
        println!(
            "{uavs} UAV: {} tracks at the end of the second",
            of::<Tracker>(world).table.tracks.len()
        );
        let station = world.resource::<Stations>().0[0];
        let mut schedule = Schedule::default();
        schedule.set_executor(SingleThreadedExecutor::new());
        schedule.add_systems(
            (
                track::associate,
                track::find_range,
                track::aim,
                track::foresee,
                operator::obey,
                track::decide,
                control::command_mount,
                control::choose_readouts,
            )
                .chain(),
        );
        group
            .sample_size(10)
            .throughput(Throughput::Elements(second.len() as u64));
        group.bench_function(format!("{uavs} UAV"), |bencher| {
            bencher.iter_batched(
                || (tracker.clone(), second.clone()),
                |(tracker, second)| {
                    world.entity_mut(station).insert(tracker);
                    *world.resource_mut::<SimClock>() = clock;
                    for arrived in second {
                        world.resource_mut::<SimClock>().tick += 1;
                        let queue = world.get_mut::<DetectionQueue>(station);
                        queue.expect("a station has a queue").arrived = arrived;
                        schedule.run(world);
                    }
                },
                BatchSize::PerIteration,
            );
        });
    }
    group.finish();
}

/// Sets one camera to `readout` and the others to rest, and the clock to a tick at which it is
/// due; gives the entity that renders its frames and their size.
fn only(world: &mut World, tier: Tier, readout: Readout) -> (Entity, [u32; 2]) {
    let hz = u64::from(world.resource::<SimClock>().tick_hz);
    world.resource_mut::<SimClock>().tick = 10 * hz;
    let mut chosen = None;
    let mut cameras = world.query::<(&SensorCamera, &SensorViews, &mut Readout)>();
    for (camera, views, mut state) in cameras.iter_mut(world) {
        *state = Readout::Off;
        if camera.tier == tier {
            *state = readout;
            let sensor_px = [camera.pinhole.width_px, camera.pinhole.height_px];
            let size_px = match (readout, camera.window_px) {
                (Readout::Around { .. }, Some(side)) => [side; 2],
                _ => sensor_px,
            };
            let view = views.sizes.iter().find(|(size, _)| *size == size_px);
            chosen = view.map(|(_, view)| (*view, size_px));
        }
    }
    chosen.expect("every tier has a camera")
}

/// Milliseconds per frame over `urban_intercept`'s city, once the precise camera holds the UAV.
fn frames(criterion: &mut Criterion) {
    let loaded = demo(1, &["detector.kind=truth", "engage.authorised=false"]);
    let options = Options {
        capture: true,
        ..Options::default()
    };
    let mut app = app::build(&loaded, &options).expect("a graphics adapter");
    let world = app.world_mut();
    while of::<Tracker>(world).state != TrackingState::Precise {
        assert!(
            !app::step(world).expect("a tick"),
            "the precise camera never gets the UAV"
        );
    }
    let mut group = criterion.benchmark_group("frame");
    group
        .sample_size(10)
        .measurement_time(Duration::from_secs(3));
    group.warm_up_time(Duration::from_millis(500));
    let around = Readout::Around {
        centre_px: [320.0, 240.0],
        target_px: 20.0,
    };
    for (name, tier, readout) in [
        ("precise 640x480", Tier::Precise, Readout::Full),
        ("precise 256x256", Tier::Precise, around),
        ("search 640x480", Tier::Search, Readout::Full),
    ] {
        let (view, size_px) = only(world, tier, readout);
        let capture = |world: &mut World| {
            world
                .run_system_cached(capture::expose)
                .expect("an exposure");
            capture::render_frames(world);
        };
        capture(world);
        assert_eq!(world.resource::<Frames>().0.len(), 1);
        group.bench_function(format!("{name}, with sensor model and truth"), |bencher| {
            bencher.iter(|| capture(world));
        });

        let mut renderer = Kept::<Renderer>::take(world).expect("a renderer");
        let mut pixels = Vec::new();
        let activate = |world: &mut World| {
            world.get_mut::<Camera>(view).expect("a view").is_active = true;
        };
        activate(world);
        group.bench_function(format!("{name}, rendering and readback"), |bencher| {
            bencher.iter(|| {
                renderer.render(world);
                renderer
                    .read(view, size_px, &mut pixels)
                    .expect("a picture");
            });
        });
        // The picture is finished: what is left is the copy.
        group.bench_function(format!("{name}, readback alone"), |bencher| {
            bencher.iter(|| {
                renderer
                    .read(view, size_px, &mut pixels)
                    .expect("a picture")
            });
        });
        world.get_mut::<Camera>(view).expect("a view").is_active = false;
        Kept::put(world, renderer);
    }
    group.finish();
}

/// `urban_intercept`'s site before a city that fills the picture: the generated one, and real ones whose data lie beside the
/// repository.
fn places() -> Vec<(&'static str, Loaded)> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let mars = data.join("tiles/mars-terrain/example/public/data");
    let folder = std::env::temp_dir().join(format!("boresight-bench-{}", std::process::id()));
    // Its own frame has y up: the tileset around it that is shipped turns it.
    for inside in ["mars", "data"] {
        std::fs::create_dir_all(folder.join(inside)).expect("a folder");
    }
    let tileset = folder.join("mars/tileset.json");
    let around =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/real_cities/mars/tileset.json");
    std::fs::copy(around, &tileset).expect("a file");
    if let Ok(mars) = mars.canonicalize() {
        std::os::unix::fs::symlink(mars, folder.join("data/mars")).expect("a link");
    }
    let delft = data.join("cityjson/delft.city.json");
    let all = [
        (
            "generated city",
            None,
            [47.3769, 8.5417, 455.0],
            String::new(),
            ("[0, 0, 60]", 315.0, -10.0),
        ),
        (
            "woods",
            None,
            [47.3769, 8.5417, 455.0],
            "city={ seed = 3, forest_share = 0.5, building_density = 0.1 }".to_owned(),
            ("[0, 0, 40]", 20.0, -3.0),
        ),
        (
            "Delft, CityJSON",
            Some(delft.clone()),
            [52.0113, 4.3683, 43.0],
            format!("city={{ sources = [{delft:?}] }}"),
            (
                "{ east_m = 0, north_m = 0, height_m = 40, above = \"roof\" }",
                300.0,
                -20.0,
            ),
        ),
        (
            "Mars, photogrammetry",
            Some(mars),
            [47.3769, 8.5417, 455.0],
            format!("city={{ tileset = {tileset:?}, detail_m = 0.5, radius_m = 200 }}"),
            (
                "{ east_m = -130, north_m = 50, height_m = 30, above = \"roof\" }",
                110.0,
                -20.0,
            ),
        ),
    ];
    let mut places = Vec::new();
    for (name, needs, [lat, lon, height_m], city, (station, azimuth_deg, elevation_deg)) in all {
        if needs.is_some_and(|file| !file.exists()) {
            println!("{name}: skipped, its data are not there");
            continue;
        }
        let mut overrides = vec![
            "detector.kind=truth".to_owned(),
            format!(
                "site={{ latitude_deg = {lat}, longitude_deg = {lon}, altitude_m = {height_m} }}"
            ),
            format!("station.position_enu_m={station}"),
            // It looks down at the city and stays there.
            format!(
                "search={{ centre_azimuth_deg = {azimuth_deg}, elevation_deg = {elevation_deg}, width_deg = 1, \
                 height_deg = 1 }}"
            ),
            "uavs.0.trajectory={ kind = \"hover\", position_enu_m = [-776.4, 635.0, 300.0] }"
                .into(),
        ];
        overrides.extend((!city.is_empty()).then_some(city));
        let text = std::fs::read_to_string(DEMO).expect("the demo is there");
        let loaded = Loaded::parse(text, DEMO.into(), overrides).expect("a valid scenario");
        places.push((name, loaded));
    }
    places
}

/// Milliseconds per 640 × 480 frame that a city fills, rendering and readback; the pictures lie in the folder that is
/// printed.
fn frames_of_places(criterion: &mut Criterion) {
    let options = Options {
        capture: true,
        ..Options::default()
    };
    let mut group = criterion.benchmark_group("place");
    group
        .sample_size(10)
        .measurement_time(Duration::from_secs(3));
    group.warm_up_time(Duration::from_millis(500));
    let folder = std::env::temp_dir();
    for (name, loaded) in places() {
        let mut app = app::build(&loaded, &options).expect("a place");
        let world = app.world_mut();
        for _ in 0..48 {
            app::step(world).expect("a tick");
        }
        for (camera, tier) in [("search", Tier::Search), ("precise", Tier::Precise)] {
            let (view, size_px) = only(world, tier, Readout::Full);
            world
                .run_system_cached(capture::expose)
                .expect("an exposure");
            capture::render_frames(world);
            let frame = &world.resource::<Frames>().0[0];
            if let Some(rgb8) = &frame.rgb8 {
                let jpeg = encode_jpeg(rgb8, size_px[0] as u16, size_px[1] as u16, 90);
                let file = folder.join(format!("boresight {name}, {camera}.jpg"));
                std::fs::write(&file, jpeg.expect("a JPEG")).expect("a file");
                println!("{}", file.display());
            }
            let mut renderer = Kept::<Renderer>::take(world).expect("a renderer");
            let mut pixels = Vec::new();
            world.get_mut::<Camera>(view).expect("a view").is_active = true;
            group.bench_function(format!("{name}, {camera}"), |bencher| {
                bencher.iter(|| {
                    renderer.render(world);
                    renderer
                        .read(view, size_px, &mut pixels)
                        .expect("a picture");
                });
            });
            world.get_mut::<Camera>(view).expect("a view").is_active = false;
            Kept::put(world, renderer);
        }
    }
    group.finish();
}

/// A million triangles of hills: meshoptimizer's edge collapse to a quarter, and the whole building of tiles on one
/// thread.
fn simplification(criterion: &mut Criterion) {
    const SIDE: u32 = 708;
    let at = |k: u32| {
        let [x, y] = [k % SIDE, k / SIDE].map(|k| k as f32);
        let z =
            20.0 * (0.02 * x).sin() * (0.017 * y).cos() + 2.0 * (0.3 * x).sin() * (0.21 * y).sin();
        [2.0 * x, 2.0 * y, z]
    };
    let positions: Vec<[f32; 3]> = (0..SIDE * SIDE).map(at).collect();
    let cells = (0..SIDE - 1).flat_map(|y| (0..SIDE - 1).map(move |x| y * SIDE + x));
    let indices: Vec<u32> = cells
        .flat_map(|k| [k, k + 1, k + SIDE + 1, k, k + SIDE + 1, k + SIDE])
        .collect();
    let mut group = criterion.benchmark_group("simplification");
    group
        .sample_size(10)
        .measurement_time(Duration::from_secs(3))
        .throughput(Throughput::Elements(indices.len() as u64 / 3));
    let adapter = meshopt::VertexDataAdapter::new(
        meshopt::typed_to_bytes(&positions),
        size_of::<[f32; 3]>(),
        0,
    );
    let adapter = adapter.expect("vertices");
    group.bench_function("edge collapse", |bencher| {
        bencher.iter(|| {
            let options = meshopt::SimplifyOptions::LockBorder;
            meshopt::simplify(&indices, &adapter, indices.len() / 4, 0.1, options, None)
        });
    });
    let layer = Layer {
        kind: LayerKind::Surface,
        site: SiteFrame::new(Geodetic {
            latitude_rad: 0.8,  // [rad]
            longitude_rad: 0.1, // [rad]
            height_m: 0.0,      // [m]
        }),
        meshes: vec![TexturedMesh {
            normals: vec![[0.0; 3]; positions.len()],
            positions: positions.clone(),
            indices: indices.clone(),
            ..TexturedMesh::default()
        }],
        features: Vec::new(),
        warnings: Vec::new(),
    };
    let folder = std::env::temp_dir().join(format!("boresight-bench-{}", std::process::id()));
    let options = BuildOptions {
        threads: std::num::NonZeroUsize::new(1),
        ..BuildOptions::default()
    };
    group.bench_function("tiles built", |bencher| {
        bencher.iter(|| build(std::slice::from_ref(&layer), &options, &folder).expect("tiles"));
    });
    group.finish();
    // What is left behind in the temporary folder harms nobody.
    let _ = std::fs::remove_dir_all(folder);
}

/// Milliseconds per inference of the default model, on a picture with noise.
fn inference(criterion: &mut Criterion) {
    let model = boresight::scenario::DetectorConfig::default().onnx_model;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(model);
    let mut detector = OnnxDetector::load(&path, 2).expect("the shipped model");
    let mut group = criterion.benchmark_group("inference");
    group
        .sample_size(10)
        .measurement_time(Duration::from_secs(3));
    group.warm_up_time(Duration::from_millis(500));
    for size_px in [[640u32, 480], [256, 256], [128, 128]] {
        let [width, height] = size_px;
        let rgb8: Vec<u8> = (0..3 * width * height)
            .map(|i| (100 + i.wrapping_mul(2_654_435_761) % 7) as u8)
            .collect();
        group.bench_function(format!("{width}x{height}"), |bencher| {
            bencher.iter(|| {
                let mut found = Vec::new();
                detector
                    .detect(&rgb8, size_px, &mut found)
                    .expect("an answer");
                found
            });
        });
    }
    group.finish();
}

/// A picture of 640 × 480 px as JPEG, by the encoder of the recording and by that of `image`; the sizes are
/// printed.
fn jpeg(criterion: &mut Criterion) {
    const QUALITY: u8 = 85;
    let (width, height) = (640_u16, 480_u16);
    // A slope of sky with noise of some grey levels and a dark disc, much like a frame.
    let rgb8: Vec<u8> = (0..u32::from(width) * u32::from(height))
        .flat_map(|i| {
            let (x, y) = (i % u32::from(width), i / u32::from(width));
            let noise = (i.wrapping_mul(2_654_435_761) >> 29) as u8;
            let dark = x.abs_diff(400).pow(2) + y.abs_diff(200).pow(2) < 400;
            let grey = if dark { 40 } else { 120 + (y / 8) as u8 } + noise;
            [grey - 10, grey, grey + 12]
        })
        .collect();
    let ours = || encode_jpeg(&rgb8, width, height, QUALITY).expect("a JPEG");
    let theirs = || {
        let mut jpeg = Vec::with_capacity(rgb8.len() / 8);
        JpegEncoder::new_with_quality(&mut jpeg, QUALITY)
            .encode(&rgb8, width.into(), height.into(), ExtendedColorType::Rgb8)
            .expect("a JPEG");
        jpeg
    };
    println!(
        "JPEG of 640x480: jpeg-encoder {} bytes, image {} bytes",
        ours().len(),
        theirs().len()
    );
    let mut group = criterion.benchmark_group("jpeg");
    group
        .sample_size(10)
        .measurement_time(Duration::from_secs(3));
    group.bench_function("jpeg-encoder", |bencher| bencher.iter(ours));
    group.bench_function("image", |bencher| bencher.iter(theirs));
    group.finish();
}

/// Where the time of a short camera run goes, with the detector on its own thread and without;
/// printed, since it is one run each and no distribution.
fn shares(_: &mut Criterion) {
    let loaded = demo(1, &["duration_s=2"]);
    let folder = std::env::temp_dir().join(format!("boresight-bench-{}", std::process::id()));
    for one_thread in [true, false] {
        let options = Options {
            capture: true,
            one_thread,
            out: Some(folder.clone()),
            ..Options::default()
        };
        let builder = Builder::loaded(loaded.clone()).options(options);
        let mut run = builder.open().expect("a run");
        run.step(u64::MAX).expect("its ticks");
        let finished = run.finish().expect("its summary");
        let share = finished.summary.share;
        println!(
            "shares of 2 s of urban_intercept, recorded, detector {}: rendering {:.1} %, waiting for \
             inference {:.1} %, other {:.1} %; real-time factor {:.3}",
            if one_thread {
                "within the tick"
            } else {
                "on its thread"
            },
            100.0 * share.render,
            100.0 * share.inference,
            100.0 * share.other,
            finished.summary.real_time_factor
        );
    }
    // What is left behind in the temporary folder harms nobody.
    let _ = std::fs::remove_dir_all(folder);
}

/// A quadtree of 100,001 tiles on 4 km of ground.
fn city_of_tiles() -> Tree {
    const TILES: usize = 100_000;
    let tile = |x_m: f64, y_m: f64, edge_m: f64| Tile {
        volume: BoundingVolume::Box {
            center_m: DVec3::new(x_m, y_m, 20.0),
            half_axes_m: DMat3::from_diagonal(DVec3::new(0.5 * edge_m, 0.5 * edge_m, 20.0)),
        },
        viewer_request_volume: None,
        geometric_error_m: edge_m / 32.0,
        refine: Refine::Replace,
        to_root_m: DAffine3::IDENTITY,
        contents: vec![String::new()],
        unread: None,
    };
    let mut tree = Tree::new(tile(0.0, 0.0, 4096.0));
    let mut places = vec![[0.0, 0.0, 4096.0]];
    let mut next = 0;
    while places.len() <= TILES {
        let [x_m, y_m, edge_m] = places[next];
        let off_m = 0.25 * edge_m;
        let quarters = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
            .map(|[east, north]| [x_m + east * off_m, y_m + north * off_m, 0.5 * edge_m]);
        let tiles = quarters.map(|[x_m, y_m, edge_m]| tile(x_m, y_m, edge_m));
        tree.add_children(TileId(next as u32), tiles.into());
        places.extend(quarters);
        next += 1;
    }
    tree
}

/// Choosing tiles of 100,001: for four cameras at once over a city, and with every tile looked at.
fn selection(criterion: &mut Criterion) {
    let tree = city_of_tiles();
    let view = |fovy_deg: f64, size_px| View {
        r_root_m: DVec3::new(-300.0, -900.0, 60.0),
        forward: DVec3::new(0.3, 0.94, -0.05).normalize(),
        up: DVec3::Z,
        fovy_rad: fovy_deg.to_radians(),
        size_px,
    };
    let views = [
        view(60.0, [1920, 1080]),
        view(30.0, [640, 480]),
        view(6.0, [640, 480]),
        view(1.0, [640, 480]),
    ];
    let options = SelectOptions::default();
    let mut group = criterion.benchmark_group("selection");
    let visited = ideal_cut(&tree, &views, &options).visited;
    group.bench_function(format!("four_cameras_{visited}_looked_at"), |bencher| {
        bencher.iter(|| ideal_cut(&tree, &views, &options));
    });
    let mut selector = Selector::new(SelectorOptions {
        budget_bytes: u64::MAX,
        at_once: 1000,
        ..SelectorOptions::default()
    });
    loop {
        let step = selector.update(&tree, &views, None);
        if step.complete {
            break;
        }
        (step.load.iter()).for_each(|tile| selector.loaded(*tile, 100_000));
    }
    group.bench_function("four_cameras_frame", |bencher| {
        bencher.iter(|| selector.update(&tree, &views, None));
    });
    let everything = SelectOptions {
        max_error_px: 0.0,
        cull: true,
    };
    let above = View {
        r_root_m: DVec3::new(0.0, 0.0, 6000.0),
        forward: -DVec3::Z,
        up: DVec3::Y,
        ..view(60.0, [1920, 1920])
    };
    let visited = ideal_cut(&tree, &[above], &everything).visited;
    group.bench_function(format!("one_camera_{visited}_looked_at"), |bencher| {
        bencher.iter(|| ideal_cut(&tree, &[above], &everything));
    });
    group.finish();
}

/// Ten fresh screens of 512 samples a side with a beam's way through them; `benches/peers/screens.py` measures others' screens.
fn wave(criterion: &mut Criterion) {
    let beam = Aperture {
        power_w: 1000.0,
        radius_m: 0.05,
        clear_radius_m: 0.08,
        wavelength_m: 1.064e-6,
        m2: 1.0,
        focus_m: 1000.0,
    };
    let grid = Grid {
        n: 512,
        spacing_m: 1e-3,
    };
    let spectrum = VonKarman {
        outer_m: 20.0,
        inner_m: 5e-3,
    };
    let layers = even_layers(1000.0, 10, |_| (1e-14, [4.0, 0.0]));
    let mut rng = Stream::new(1, 0, "bench");
    let mut normal = || rng.normal();
    let mut group = criterion.benchmark_group("wave");
    group.sample_size(10);
    for threads in [1, 2] {
        group.bench_function(
            format!("ten fresh screens and a beam, {threads} threads"),
            |b| {
                b.iter(|| {
                    let layers = layers.clone();
                    let mut wave = Wave::new(grid, &spectrum, layers, 1000.0, threads, &mut normal);
                    wave.send(&beam, 1e-4)
                });
            },
        );
        let mut wave = Wave::new(
            grid,
            &spectrum,
            layers.clone(),
            1000.0,
            threads,
            &mut normal,
        );
        group.bench_function(format!("carried on, and a beam, {threads} threads"), |b| {
            b.iter(|| {
                wave.carry(1e-3, &mut normal);
                wave.send(&beam, 1e-4)
            });
        });
    }
    group.finish();
}

/// What the air makes of a window of the precise camera, and of one place in it, on one core.
fn seeing(criterion: &mut Criterion) {
    let mut rng = Stream::new(1, 0, SEEING_STREAM);
    let air = Arc::new(FrozenAir::new(&mut rng, 20.0));
    let winds_enu_mps = air.winds(|_| DVec3::new(3.0, 1.0, 0.0));
    let frame = FrameSeeing {
        optics: Arc::new(SeeingOptics {
            air,
            pupil: Pupil::disc(0.045),
            diameter_m: 0.045,
            lens: Lens {
                focal_px: 36_667.0,
                centre_px: DVec2::new(320.0, 240.0),
                pitch_px: 4.0,
                line_s: 0.0,
            },
        }),
        look: Look {
            axes_enu: [DVec3::X, -DVec3::Z, DVec3::Y],
            t_s: 1.0,
            exposure_s: 2e-3,
            winds_enu_mps,
            seen_enu_mps: DVec3::ZERO,
        },
        flying: vec![SeenThrough {
            index: 0,
            box_px: [310.0, 235.0, 330.0, 245.0],
            place_px: DVec2::new(320.0, 240.0),
            sight: Sight::new(1_000.0, |_| 1e-14),
            v_enu_mps: DVec3::X,
        }],
    };
    let behind = Sight::new(2_000.0, |_| 1e-14);
    let rect = PixelRect {
        offset_px: [192, 112],
        size_px: [256; 2],
    };
    let mut pixels = vec![0x38; 8 * 256 * 256];
    let (mut picture, mut scratch) = (Picture::default(), WarpScratch::default());
    let mut group = criterion.benchmark_group("seeing");
    group.bench_function("a window of 256x256", |bencher| {
        bencher.iter(|| {
            let parts = frame.parts(rect, &behind);
            picture.read(&pixels, rect);
            picture.write(&parts, 0..256, &mut scratch, &mut pixels);
        });
    });
    group.bench_function("a UAV's place", |bencher| {
        bencher.iter(|| frame.shift_px(0));
    });
    group.finish();
}

criterion_group!(
    benches,
    seeing,
    wave,
    selection,
    simplification,
    ticks,
    front_door,
    sight_lines,
    track_and_control,
    frames,
    frames_of_places,
    inference,
    jpeg,
    shares
);
criterion_main!(benches);
