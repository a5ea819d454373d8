//! Any 3D Tiles in a window of plain Bevy: the plugin alone, without a simulation.
//!
//! `cargo run --release --example tiles_viewer -- TILESET [--settled] [--relit] [--distance RADII] [--azimuth DEG]
//! [--elevation DEG] [--error PX] [--budget MIB] [--screenshot FILE] [--fly SECONDS]`
//!
//! W, A, S, D, Q, E fly, shift is for haste, the arrows look around. `--screenshot` saves a picture once all is loaded, `--fly`
//! circles for so long and prints frames per second.

use bevy::asset::RenderAssetUsages;
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::prelude::*;
use bevy::render::RenderPlugin;
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured};
use bevy::window::PresentMode;
use boresight::models::tiles::selection::SelectOptions;
use boresight_tiles::TilesPlugin;
use boresight_tiles::show::radius_m;
use boresight_tiles::{OpenTiles, SeesTiles, TileFailed, Tiles, TilesCount, TilesLight, TilesMode};
use std::process::ExitCode;

/// What the command line asks for.
#[derive(Resource, Clone)]
struct Wish {
    tiles: Tiles,
    distance: f32,
    azimuth_rad: f32,
    elevation_rad: f32,
    screenshot: Option<String>,
    fly_s: Option<f32>,
}

/// Where the camera stands, and what was counted so far.
#[derive(Resource, Default)]
struct Flight {
    radius_m: Option<f32>,
    /// Whether no tile has anything to draw.
    bare: bool,
    frames: u32,
    seconds: f32,
    most_bytes: u64,
    still: u32,
}

fn wish(mut arguments: impl Iterator<Item = String>) -> Result<Wish, String> {
    let location = arguments.next().ok_or("which tileset?")?;
    let mut wish = Wish {
        tiles: Tiles::new(location),
        distance: 1.6,
        azimuth_rad: 0.6,
        elevation_rad: 0.5,
        screenshot: None,
        fly_s: None,
    };
    while let Some(name) = arguments.next() {
        match name.as_str() {
            "--settled" => wish.tiles.mode = TilesMode::Settled,
            "--relit" => wish.tiles.light = TilesLight::Relit,
            "--baked" => wish.tiles.light = TilesLight::Baked,
            "--uncut" => wish.tiles.select.cull = false,
            _ => {
                let value = arguments.next().ok_or(format!("{name} of what?"))?;
                let number = || value.parse::<f32>().map_err(|_| format!("{name} {value}?"));
                match name.as_str() {
                    "--distance" => wish.distance = number()?,
                    "--azimuth" => wish.azimuth_rad = number()?.to_radians(),
                    "--elevation" => wish.elevation_rad = number()?.to_radians(),
                    "--error" => {
                        wish.tiles.select = SelectOptions {
                            max_error_px: f64::from(number()?),
                            ..wish.tiles.select
                        };
                    }
                    "--budget" => wish.tiles.byte_budget = (number()? as u64) << 20,
                    "--screenshot" => wish.screenshot = Some(value),
                    "--fly" => wish.fly_s = Some(number()?),
                    _ => return Err(format!("{name}?")),
                }
            }
        }
    }
    Ok(wish)
}

fn main() -> ExitCode {
    let wish = match wish(std::env::args().skip(1)) {
        Ok(wish) => wish,
        Err(error) => {
            eprintln!("{error}");
            return ExitCode::FAILURE;
        }
    };
    let window = Window {
        title: "3D Tiles".into(),
        resolution: (1280, 800).into(),
        present_mode: PresentMode::AutoNoVsync,
        ..default()
    };
    let window = WindowPlugin {
        primary_window: Some(window),
        ..default()
    };
    let rendering = RenderPlugin {
        // A pipeline that is still compiling would leave holes in a picture.
        synchronous_pipeline_compilation: true,
        ..default()
    };
    let mut app = App::new();
    let bevy = DefaultPlugins.set(window).set(rendering);
    app.add_plugins((bevy, TilesPlugin::default()))
        .insert_resource(ClearColor(Color::srgb(0.53, 0.68, 0.85)))
        .insert_resource(GlobalAmbientLight {
            brightness: 600.0,
            ..default()
        })
        .insert_resource(wish)
        .init_resource::<Flight>()
        .add_systems(Startup, begin)
        .add_systems(Update, (place, fly, tell, picture).chain());
    match app.run() {
        AppExit::Success => ExitCode::SUCCESS,
        AppExit::Error(_) => ExitCode::FAILURE,
    }
}

fn begin(mut commands: Commands, wish: Res<Wish>) {
    commands.spawn(wish.tiles.clone());
    commands.spawn((
        Camera3d::default(),
        SeesTiles,
        Tonemapping::None,
        Projection::Perspective(PerspectiveProjection {
            fov: 60_f32.to_radians(),
            near: 0.1,
            far: 1e6,
            ..default()
        }),
    ));
    commands.spawn((
        DirectionalLight {
            illuminance: 5_000.0,
            ..default()
        },
        Transform::from_xyz(0.4, -0.6, 1.0).looking_at(Vec3::ZERO, Vec3::Z),
    ));
}

/// Puts the camera where it was wished, once it is known how large the tileset is.
fn place(
    wish: Res<Wish>,
    time: Res<Time>,
    mut flight: ResMut<Flight>,
    tilesets: Query<&OpenTiles>,
    camera: Single<&mut Transform, With<SeesTiles>>,
) {
    let Ok(open) = tilesets.single() else {
        return;
    };
    let first = flight.radius_m.is_none();
    let tiles = open.tileset.tree.tiles();
    flight.bare = (tiles.iter()).all(|tile| tile.contents.is_empty() && tile.unread.is_none());
    let radius_m = *(flight.radius_m).get_or_insert_with(|| radius_m(&open.tileset.tree) as f32);
    if !first && wish.fly_s.is_none() {
        return;
    }
    let turned_rad = wish.fly_s.map_or(0.0, |_| 0.2 * time.elapsed_secs());
    let (sin_az, cos_az) = (wish.azimuth_rad + turned_rad).sin_cos();
    let (sin_el, cos_el) = wish.elevation_rad.sin_cos();
    let towards = Vec3::new(-sin_az * cos_el, -cos_az * cos_el, sin_el);
    *camera.into_inner() = Transform::from_translation(wish.distance * radius_m * towards)
        .looking_at(Vec3::ZERO, Vec3::Z);
}

fn fly(
    keys: Res<ButtonInput<KeyCode>>,
    time: Res<Time>,
    flight: Res<Flight>,
    camera: Single<&mut Transform, With<SeesTiles>>,
) {
    let mut at = camera.into_inner();
    let axis =
        |plus, minus| f32::from(i8::from(keys.pressed(plus)) - i8::from(keys.pressed(minus)));
    let way = Vec3::new(
        axis(KeyCode::KeyD, KeyCode::KeyA),
        axis(KeyCode::KeyE, KeyCode::KeyQ),
        axis(KeyCode::KeyS, KeyCode::KeyW),
    );
    let haste = if keys.pressed(KeyCode::ShiftLeft) {
        2.0
    } else {
        0.2
    };
    let step = haste * flight.radius_m.unwrap_or(1.0) * time.delta_secs();
    let moved = at.rotation * way * step;
    at.translation += moved;
    let turn = axis(KeyCode::ArrowLeft, KeyCode::ArrowRight) * time.delta_secs();
    let nod = axis(KeyCode::ArrowUp, KeyCode::ArrowDown) * time.delta_secs();
    at.rotation = Quat::from_rotation_z(turn) * at.rotation * Quat::from_rotation_x(nod);
}

/// Shows the counters in the title, and ends a flight with its figures.
fn tell(
    wish: Res<Wish>,
    time: Res<Time>,
    mut flight: ResMut<Flight>,
    counts: Query<&TilesCount>,
    window: Single<&mut Window>,
    mut failures: MessageReader<TileFailed>,
    mut exit: MessageWriter<AppExit>,
) {
    for failure in failures.read() {
        eprintln!("{}", failure.error);
        // Without a root there is nothing to wait for.
        if flight.radius_m.is_none() {
            exit.write(AppExit::error());
        }
    }
    let Ok(count) = counts.single() else {
        return;
    };
    flight.frames += 1;
    flight.seconds += time.delta_secs();
    flight.most_bytes = flight.most_bytes.max(count.bytes);
    let some = count.drawn > 0 || flight.bare;
    flight.still = if flight.radius_m.is_some() && count.missing == 0 && some {
        flight.still + 1
    } else {
        0
    };
    let line = format!(
        "{} tiles, {} triangles, {} kept, {:.1} MiB, {} loading, {} failed",
        count.drawn,
        count.triangles,
        count.kept,
        count.bytes as f64 / f64::from(1 << 20),
        count.missing,
        count.failed
    );
    if let Some(fly_s) = wish.fly_s
        && flight.seconds >= fly_s
    {
        println!(
            "{line}; {:.1} frames/s, at most {:.1} MiB",
            flight.frames as f32 / flight.seconds,
            flight.most_bytes as f64 / f64::from(1 << 20)
        );
        exit.write(AppExit::Success);
    }
    if wish.screenshot.is_some() && flight.still == PICTURED {
        println!("{line}");
    }
    window.into_inner().title = line;
}

/// Frames with nothing missing before the picture is taken.
const PICTURED: u32 = 10;
/// Frames after which it is taken in any case.
const LONGEST: u32 = 3_000;

fn picture(wish: Res<Wish>, flight: Res<Flight>, mut commands: Commands) {
    let Some(file) = wish.screenshot.clone() else {
        return;
    };
    if flight.still == PICTURED || (flight.still < PICTURED && flight.frames == LONGEST) {
        commands.spawn(Screenshot::primary_window()).observe(
            move |taken: On<ScreenshotCaptured>, mut exit: MessageWriter<AppExit>| {
                let mut image = taken.image.clone();
                image.asset_usage = RenderAssetUsages::MAIN_WORLD;
                let saved = (image.try_into_dynamic().map_err(|error| error.to_string()))
                    .and_then(|image| image.to_rgb8().save(&file).map_err(|e| e.to_string()));
                exit.write(match saved {
                    Ok(()) => AppExit::Success,
                    Err(error) => {
                        eprintln!("{file}: {error}");
                        AppExit::error()
                    }
                });
            },
        );
    }
}
