//! The window: it looks, sets the pace and passes on what the operator asks for.
//!
//! A window frame first draws, then runs ticks. Drawing first lets the frame's Bevy main schedule
//! be the one that meets the fresh input; the sensor frames inside the ticks, which run that
//! schedule too, find none left. The wall clock decides how many ticks run and enters no state.

use crate::app::{self, Options, RunError};
use crate::components::beam::BeamState;
use crate::components::capture::{Frames, Readout, SensorCamera, Tier};
use crate::components::clock::SimClock;
use crate::components::environment::Environment;
use crate::components::flight::{Distractor, Flight, HeatedSkin, Uav, UavStatus};
use crate::components::mount::Mount;
use crate::components::record::History;
use crate::components::track::{Tracker, TrackingState};
use crate::components::view::{
    FreeCamera, Insets, Pacing, StepSize, TargetChoice, Uploaded, WindowCamera, WindowFrame,
};
use crate::media::image::encode_jpeg;
use crate::models::maths::kinematics::{az_el_to_los, los_to_az_el};
use crate::models::tracking::table::separation_rad;
use crate::report::summary::{self, Finished};
use crate::scenario::Loaded;
use crate::systems::capture::{bevy_attitude, sync_scene};
use crate::systems::detect::Detector;
use crate::systems::engage::Interlocks;
use crate::systems::render::renderer::Renderer;
use crate::systems::render::scene::{self, SceneHandles};
use bevy::asset::RenderAssetUsages;
use bevy::camera::Exposure;
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::ecs::schedule::ScheduleLabel;
use bevy::input::mouse::AccumulatedMouseMotion;
use bevy::prelude::*;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};
use bevy::render::renderer::RenderAdapterInfo;
use bevy::render::view::screenshot::{Screenshot, ScreenshotCaptured};
use bevy::render::view::{Msaa, NoIndirectDrawing};
use bevy_egui::egui::{self, Align2, Color32, FontId, Pos2, Rect, Stroke, StrokeKind, vec2};
use bevy_egui::input::EguiWantsInput;
use bevy_egui::{EguiContexts, EguiTextureHandle, EguiUserTextures, PrimaryEguiContext};
use big_space::prelude::CellCoord;
use glam::{DVec2, DVec3};
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::mpsc::{Sender, channel};
use std::time::{Duration, Instant};

/// The schedule of one window frame.
#[derive(ScheduleLabel, Clone, Debug, PartialEq, Eq, Hash)]
pub struct Frame;

/// Wall-clock time that the ticks of a window frame may take.
const TICK_BUDGET: Duration = Duration::from_millis(50);
/// The same while nobody watches, on the way to a screenshot.
const UNWATCHED_BUDGET: Duration = Duration::from_secs(1);
/// Longest wall-clock time that counts as passed between two window frames [s].
const LONGEST_FRAME_S: f64 = 0.25;
/// Window frames drawn before a screenshot, so that panels have found their sizes.
const SETTLE_FRAMES: u32 = 5;
/// Simulated time within which a step to the next exposure gives up [s].
const STEP_FRAME_LIMIT_S: f64 = 1.0;
/// Quality of a screenshot's JPEG.
const SCREENSHOT_QUALITY: u8 = 85;

/// A picture of the window to be taken.
struct Shot {
    file: PathBuf,
    /// Window frames drawn since its time came.
    drawn: u32,
}

/// What a window session keeps between its frames.
#[derive(Resource)]
pub struct Session {
    loaded: Loaded,
    options: Options,
    started: Instant,
    last: Instant,
    /// Wall-clock and simulated time of the last window frames [s].
    lately: VecDeque<(f64, f64)>,
    shot: Option<Shot>,
    /// The end of the session is told here, before winit clears the world.
    ended: Option<Sender<Result<Finished, RunError>>>,
}

/// The picture that Bevy took of the window.
#[derive(Resource)]
struct Taken(Image);

/// Whether there is a display that a window can be opened on.
pub fn display() -> Result<(), RunError> {
    let named = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    if cfg!(target_os = "linux") && !named("DISPLAY") {
        Err(RunError::NoDisplay)
    } else {
        Ok(())
    }
}

/// Whether a picture of the window can be written to that file.
pub fn check_screenshot(file: &std::path::Path) -> Result<(), RunError> {
    let extension = file.extension().and_then(|extension| extension.to_str());
    if extension.is_some_and(|extension| matches!(extension, "jpg" | "jpeg")) {
        return Ok(());
    }
    let why = format!("{} must end in .jpg", file.display());
    Err(RunError::Argument {
        argument: "--screenshot",
        why,
    })
}

/// Runs the app with its window until that is closed; what the session left is written as in a
/// run without a window.
pub fn drive(
    app: &mut App,
    loaded: &Loaded,
    options: &Options,
    screenshot: Option<(PathBuf, f64)>,
) -> Result<Option<Finished>, RunError> {
    let (sender, receiver) = channel();
    let world = app.world_mut();
    spawn_window_camera(world);
    let shot = screenshot.map(|(file, at_s)| {
        let tick = world.resource::<SimClock>().ticks_of(at_s);
        let mut pacing = world.resource_mut::<Pacing>();
        pacing.speed = f64::INFINITY;
        pacing.pause_at = Some(tick);
        pacing.paused = tick == 0;
        Shot { file, drawn: 0 }
    });
    let now = Instant::now();
    world.insert_resource(Session {
        loaded: loaded.clone(),
        options: options.clone(),
        started: now,
        last: now,
        lately: VecDeque::new(),
        shot,
        ended: Some(sender),
    });
    app.run();
    receiver.try_recv().ok().transpose()
}

/// Puts the free camera behind and above the station, looking over it to the first UAV.
fn spawn_window_camera(world: &mut World) {
    let Some(site_grid) = world
        .get_resource::<SceneHandles>()
        .map(|scene| scene.site_grid)
    else {
        return;
    };
    let mut mounts = world.query::<&Mount>();
    let mount = mounts
        .iter(world)
        .next()
        .map(|mount| (mount.r_enu_m, mount.gimbal.az_el_rad()));
    let (r_station_enu_m, gaze_rad) = mount.unwrap_or((DVec3::ZERO, DVec2::ZERO));
    let mut uavs = world.query::<(&Uav, &Flight)>();
    let first = uavs.iter(world).find(|(uav, _)| uav.index == 0);
    let to = first.map_or(az_el_to_los(gaze_rad), |(_, flight)| {
        flight.state.r_enu_m - r_station_enu_m
    });
    let azimuth_rad = los_to_az_el(to).x;
    let back_m = az_el_to_los(DVec2::new(azimuth_rad, 0.0));
    let camera = FreeCamera {
        r_enu_m: r_station_enu_m - 60.0 * back_m + 30.0 * DVec3::Z,
        azimuth_rad,
        elevation_rad: -0.09,
        vfov_rad: 0.85,
    };
    // Grey of 18 % on level ground comes out at a linear 0.2; moonless night sets the limit.
    let klx = world
        .resource::<Environment>()
        .sky
        .global_illuminance_klx()
        .max(1e-5);
    let exposure = 0.2 * std::f64::consts::PI / (0.18 * klx);
    // A software rasteriser has no time for four samples a pixel, but a picture is worth them.
    let software = world
        .get_resource::<RenderAdapterInfo>()
        .is_some_and(|info| info.device_type == wgpu::DeviceType::Cpu);
    let pictured = world.resource::<Pacing>().pause_at.is_some();
    world.spawn((
        WindowCamera,
        PrimaryEguiContext,
        Camera3d::default(),
        Camera {
            is_active: false,
            clear_color: ClearColorConfig::None,
            ..default()
        },
        Projection::Perspective(PerspectiveProjection {
            fov: camera.vfov_rad as f32,
            near: 0.5,
            far: 100_000.0,
            ..default()
        }),
        if software && !pictured {
            Msaa::Off
        } else {
            Msaa::Sample4
        },
        Exposure {
            ev100: -(1.2 * exposure).log2() as f32,
        },
        Tonemapping::None,
        NoIndirectDrawing,
        placed(&camera),
        Visibility::default(),
        ChildOf(site_grid),
    ));
    world.insert_resource(camera);
}

/// Where the free camera stands in the scene.
fn placed(camera: &FreeCamera) -> (CellCoord, Transform) {
    scene::place(
        &scene::grid(),
        camera.r_enu_m,
        bevy_attitude(camera.q_enu_cam()),
    )
}

/// One frame of the window: draw, then as many ticks as are due.
pub fn frame(world: &mut World) {
    let now = Instant::now();
    let Some(mut session) = world.remove_resource::<Session>() else {
        return;
    };
    let wall_s = (now - session.last).as_secs_f64();
    session.last = now;
    world.insert_resource(WindowFrame {
        active: true,
        wall_s,
    });
    draw(world);
    world.resource_mut::<WindowFrame>().active = false;

    let mut failure = None;
    let closing = !world.resource::<Messages<AppExit>>().is_empty();
    if !closing {
        choose_target(world);
        let before = world.resource::<SimClock>().t_s();
        let budget = if session.shot.is_some() {
            UNWATCHED_BUDGET
        } else {
            TICK_BUDGET
        };
        let began = Instant::now();
        let in_budget = || began.elapsed() < budget;
        if let Err(error) = advance(world, wall_s.min(LONGEST_FRAME_S), in_budget) {
            failure = Some(error);
        }
        let simulated_s = world.resource::<SimClock>().t_s() - before;
        session.lately.push_back((wall_s, simulated_s));
        if session.lately.len() > 30 {
            session.lately.pop_front();
        }
        let (wall_s, simulated_s) = session
            .lately
            .iter()
            .fold((0.0, 0.0), |sum, x| (sum.0 + x.0, sum.1 + x.1));
        world.resource_mut::<Pacing>().reached = simulated_s / wall_s.max(1e-9);
        match picture(world, &mut session.shot) {
            Ok(false) => {}
            Ok(true) => {
                world.write_message(AppExit::Success);
            }
            Err(error) => failure = Some(error),
        }
    }
    if failure.is_some() {
        world.write_message(AppExit::error());
    }
    if !world.resource::<Messages<AppExit>>().is_empty()
        && let Some(ended) = session.ended.take()
    {
        let result = match failure {
            Some(error) => Err(error),
            None => {
                let elapsed = session.started.elapsed();
                summary::conclude(world, &session.loaded, &session.options, elapsed)
                    .map_err(RunError::from)
            }
        };
        // The receiver waits in `drive` for the event loop to return.
        let _ = ended.send(result);
    }
    world.insert_resource(session);
}

/// Draws the window; no sensor camera is active meanwhile.
fn draw(world: &mut World) {
    let Some(mut renderer) = world.remove_non_send::<Renderer>() else {
        return;
    };
    let activate = |world: &mut World, active: bool| {
        let mut cameras = world.query_filtered::<&mut Camera, With<WindowCamera>>();
        for mut camera in cameras.iter_mut(world) {
            camera.is_active = active;
        }
    };
    activate(world, true);
    sync_scene(world);
    renderer.render(world);
    activate(world, false);
    world.insert_non_send(renderer);
}

/// Runs the ticks that are due after `wall_s` more seconds of wall-clock time [s], as long as
/// `in_budget` says that there is time for another; returns how many ran.
pub fn advance(
    world: &mut World,
    wall_s: f64,
    mut in_budget: impl FnMut() -> bool,
) -> Result<u64, RunError> {
    let clock = *world.resource::<SimClock>();
    let mut pacing = world.resource_mut::<Pacing>();
    if pacing.over {
        return Ok(0);
    }
    let step = pacing.step.take();
    let mut due = match step {
        Some(StepSize::Tick) => 1,
        Some(StepSize::Frame) => clock.ticks_of(STEP_FRAME_LIMIT_S),
        None if pacing.paused => return Ok(0),
        None if pacing.speed.is_infinite() => u64::MAX,
        None => {
            pacing.owed_ticks += wall_s * pacing.speed * f64::from(clock.tick_hz);
            pacing.owed_ticks as u64
        }
    };
    if let (None, Some(pause_at)) = (step, pacing.pause_at) {
        due = due.min(pause_at.saturating_sub(clock.tick));
    }
    let mut ran = 0;
    while ran < due && (step.is_some() || in_budget()) {
        let over = app::step(world)?;
        ran += 1;
        if over {
            world.resource_mut::<Pacing>().over = true;
            break;
        }
        if step == Some(StepSize::Frame) && !world.resource::<Frames>().0.is_empty() {
            break;
        }
    }
    let tick = clock.tick + ran;
    let mut pacing = world.resource_mut::<Pacing>();
    // What did not fit into the budget is forgotten: the pace drops, no backlog grows.
    pacing.owed_ticks = if step.is_none() && ran == due && pacing.speed.is_finite() {
        pacing.owed_ticks - ran as f64
    } else {
        0.0
    };
    if pacing.pause_at.is_some_and(|pause_at| tick >= pause_at) {
        pacing.pause_at = None;
        pacing.paused = true;
    }
    Ok(ran)
}

/// Makes the track that the operator chose the target, and logs that it was the operator.
fn choose_target(world: &mut World) {
    let Some(id) = world.resource_mut::<TargetChoice>().0.take() else {
        return;
    };
    let tick = world.resource::<SimClock>().tick;
    let mut tracker = world.resource_mut::<Tracker>();
    if tracker.table.get(id).is_none() || tracker.target == Some(id) {
        return;
    }
    tracker.designated = true;
    tracker.acquire(tick, id, format!("operator chose track {id}"));
}

/// Takes the picture of the window once its time has come; true when it is saved.
fn picture(world: &mut World, shot: &mut Option<Shot>) -> Result<bool, RunError> {
    let pacing = world.resource::<Pacing>();
    let Some(shot) = shot.as_mut().filter(|_| pacing.paused || pacing.over) else {
        return Ok(false);
    };
    shot.drawn += 1;
    if shot.drawn == SETTLE_FRAMES {
        world.spawn(Screenshot::primary_window()).observe(
            |taken: On<ScreenshotCaptured>, mut commands: Commands| {
                commands.insert_resource(Taken(taken.image.clone()));
            },
        );
    }
    let Some(Taken(image)) = world.remove_resource::<Taken>() else {
        return Ok(false);
    };
    let encoded = |why: String| RunError::Image(why);
    let image = image
        .try_into_dynamic()
        .map_err(|error| encoded(error.to_string()))?
        .to_rgb8();
    let side = |side: u32| u16::try_from(side).map_err(|error| encoded(error.to_string()));
    let (width, height) = (side(image.width())?, side(image.height())?);
    let jpeg = encode_jpeg(image.as_raw(), width, height, SCREENSHOT_QUALITY)
        .map_err(|error| encoded(error.to_string()))?;
    std::fs::write(&shot.file, jpeg).map_err(|source| RunError::Argument {
        argument: "--screenshot",
        why: format!("{}: {source}", shot.file.display()),
    })?;
    Ok(true)
}

/// Pause and single steps from the keyboard.
pub fn obey_keys(
    keys: Res<ButtonInput<KeyCode>>,
    wants: Res<EguiWantsInput>,
    mut pacing: ResMut<Pacing>,
) {
    if wants.wants_any_keyboard_input() {
        return;
    }
    if keys.just_pressed(KeyCode::Space) {
        pacing.paused = !pacing.paused;
    }
    for (key, step) in [
        (KeyCode::Period, StepSize::Tick),
        (KeyCode::Slash, StepSize::Frame),
    ] {
        if keys.just_pressed(key) {
            pacing.paused = true;
            pacing.step = Some(step);
        }
    }
}

/// Flies the free camera: WASD and QE, the mouse with its right button held, shift for haste.
pub fn fly_camera(
    frame: Res<WindowFrame>,
    keys: Res<ButtonInput<KeyCode>>,
    buttons: Res<ButtonInput<MouseButton>>,
    motion: Res<AccumulatedMouseMotion>,
    wants: Res<EguiWantsInput>,
    environment: Res<Environment>,
    mut camera: ResMut<FreeCamera>,
    view: Single<(&mut CellCoord, &mut Transform), With<WindowCamera>>,
) {
    const LOOK_RAD_PER_PX: f64 = 3e-3;
    const SPEED_MPS: f64 = 60.0;
    const HASTE: f64 = 8.0;
    const STEEPEST_RAD: f64 = 1.5;
    const LEAST_HEIGHT_M: f64 = 2.0;
    // Inside the sky dome, and near enough to the floating origin for millimetres in f32.
    const FARTHEST_M: f64 = 20_000.0;
    if buttons.pressed(MouseButton::Right) && !wants.wants_any_pointer_input() {
        let turn = motion.delta.as_dvec2() * LOOK_RAD_PER_PX;
        camera.azimuth_rad = (camera.azimuth_rad + turn.x).rem_euclid(std::f64::consts::TAU);
        camera.elevation_rad = (camera.elevation_rad - turn.y).clamp(-STEEPEST_RAD, STEEPEST_RAD);
    }
    if !wants.wants_any_keyboard_input() {
        let axis = |plus: KeyCode, minus: KeyCode| {
            f64::from(i8::from(keys.pressed(plus)) - i8::from(keys.pressed(minus)))
        };
        let q = camera.q_enu_cam();
        let way = q * DVec3::X * axis(KeyCode::KeyD, KeyCode::KeyA)
            + q * DVec3::Z * axis(KeyCode::KeyW, KeyCode::KeyS)
            + DVec3::Z * axis(KeyCode::KeyE, KeyCode::KeyQ);
        let haste = if keys.any_pressed([KeyCode::ShiftLeft, KeyCode::ShiftRight]) {
            HASTE
        } else {
            1.0
        };
        let step_s = frame.wall_s.min(LONGEST_FRAME_S);
        let r_enu_m = camera.r_enu_m + way.normalize_or_zero() * (SPEED_MPS * haste * step_s);
        camera.r_enu_m = r_enu_m.clamp_length_max(FARTHEST_M);
    }
    let floor_m = environment
        .city
        .dsm
        .terrain_m(camera.r_enu_m.x, camera.r_enu_m.y);
    camera.r_enu_m.z = camera.r_enu_m.z.max(floor_m + LEAST_HEIGHT_M);
    let (mut cell, mut transform) = view.into_inner();
    (*cell, *transform) = placed(&camera);
}

const GREEN: Color32 = Color32::from_rgb(60, 220, 150);
const AMBER: Color32 = Color32::from_rgb(255, 190, 70);
const RED: Color32 = Color32::from_rgb(255, 70, 60);
const GREY: Color32 = Color32::from_rgb(165, 170, 180);
const DARK: Color32 = Color32::from_rgba_premultiplied(10, 12, 16, 235);
const PANEL_WIDTH: f32 = 250.0;
const INSET_WIDTH: f32 = 300.0;
/// Share of a readout window's width that its inset shows: targets there are a few pixels large.
const INSET_ZOOM: f32 = 0.5;

fn status_colour(status: UavStatus) -> Color32 {
    match status {
        UavStatus::Flying => AMBER,
        UavStatus::Falling | UavStatus::Down => GREEN,
        UavStatus::Crashed => GREY,
    }
}

/// Where points of the optical frame lie on the screen.
struct Screen {
    centre: Pos2,
    /// Focal length [points].
    focal: f64,
}

impl Screen {
    /// Nearest distance that is drawn [m].
    const NEAR_M: f64 = 0.5;

    fn new(rect: Rect, camera: &FreeCamera) -> Self {
        let focal = 0.5 * f64::from(rect.height()) / (0.5 * camera.vfov_rad).tan();
        Self {
            centre: rect.center(),
            focal,
        }
    }

    fn at(&self, r_cam_m: DVec3) -> Option<Pos2> {
        (r_cam_m.z >= Self::NEAR_M).then(|| {
            let [x, y] = [r_cam_m.x, r_cam_m.y].map(|x| (self.focal * x / r_cam_m.z) as f32);
            self.centre + vec2(x, y)
        })
    }

    /// The part of a line in front of the camera.
    fn line(&self, a_cam_m: DVec3, b_cam_m: DVec3) -> Option<[Pos2; 2]> {
        let clipped = |a: DVec3, b: DVec3| {
            let share = (Self::NEAR_M - a.z) / (b.z - a.z);
            // The clipped end must not fall short of the near distance by rounding.
            if a.z < Self::NEAR_M {
                a.lerp(b, share).with_z(Self::NEAR_M)
            } else {
                a
            }
        };
        if a_cam_m.z < Self::NEAR_M && b_cam_m.z < Self::NEAR_M {
            return None;
        }
        Some([
            self.at(clipped(a_cam_m, b_cam_m))?,
            self.at(clipped(b_cam_m, a_cam_m))?,
        ])
    }
}

/// Text with a dark rim, so that it reads over sky and city.
fn rimmed(painter: &egui::Painter, at: Pos2, align: Align2, text: &str, colour: Color32) {
    let font = FontId::proportional(13.0);
    for rim in [
        vec2(1.0, 1.0),
        vec2(-1.0, -1.0),
        vec2(1.0, -1.0),
        vec2(-1.0, 1.0),
    ] {
        painter.text(
            at + rim,
            align,
            text,
            font.clone(),
            Color32::from_black_alpha(160),
        );
    }
    painter.text(at, align, text, font, colour);
}

/// Marks the station, the UAVs and the beam.
pub fn draw_overlay(
    mut contexts: EguiContexts,
    camera: Res<FreeCamera>,
    station: Single<(&Mount, &BeamState)>,
    uavs: Query<(&Uav, &Flight, &UavStatus, Option<&Distractor>)>,
) -> Result {
    let ctx = contexts.ctx_mut()?;
    let painter = ctx.layer_painter(egui::LayerId::background());
    let screen = Screen::new(ctx.viewport_rect(), &camera);
    let (mount, beam) = *station;
    let station_cam_m = camera.to_cam(mount.r_enu_m);
    if let Some(at) = screen.at(station_cam_m) {
        painter.circle_filled(at, 3.5, GREEN);
        rimmed(
            &painter,
            at + vec2(0.0, 8.0),
            Align2::CENTER_TOP,
            "station",
            GREEN,
        );
    }
    for (uav, flight, status, distractor) in &uavs {
        let r_cam_m = camera.to_cam(flight.state.r_enu_m);
        if beam.firing
            && beam.aimed == Some(uav.index)
            && let Some(line) = screen.line(station_cam_m, r_cam_m)
        {
            painter.line_segment(line, Stroke::new(4.0, RED.gamma_multiply(0.35)));
            painter.line_segment(line, Stroke::new(1.5, RED));
        }
        let Some(at) = screen.at(r_cam_m) else {
            continue;
        };
        let (colour, word) = match distractor {
            Some(distractor) => (GREY, distractor.kind.name()),
            None => (status_colour(*status), status.name()),
        };
        painter.circle_stroke(at, 12.0, Stroke::new(3.5, Color32::from_black_alpha(110)));
        painter.circle_stroke(at, 12.0, Stroke::new(1.8, colour));
        let range_m = flight.state.r_enu_m.distance(mount.r_enu_m);
        let text = format!("{}  {range_m:.0} m  {word}", uav.name);
        rimmed(
            &painter,
            at + vec2(0.0, -17.0),
            Align2::CENTER_BOTTOM,
            &text,
            colour,
        );
    }
    Ok(())
}

/// The region that panels take their place from.
fn screen_ui(ctx: &egui::Context) -> egui::Ui {
    let layer = egui::UiBuilder::new()
        .layer_id(egui::LayerId::background())
        .max_rect(ctx.viewport_rect());
    egui::Ui::new(ctx.clone(), "window".into(), layer)
}

fn panel_frame() -> egui::Frame {
    egui::Frame::new().fill(DARK).inner_margin(10.0)
}

/// A line of the panel: what, and how much.
fn row(ui: &mut egui::Ui, name: &str, value: String) {
    ui.horizontal(|ui| {
        ui.colored_label(GREY, name);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(egui::RichText::new(value).color(Color32::WHITE));
        });
    });
}

fn heading(ui: &mut egui::Ui, text: &str) {
    ui.add_space(8.0);
    ui.label(egui::RichText::new(text).strong().color(AMBER));
}

/// The panel: pace, tracking, target choice, engagement, weather.
pub fn draw_panel(
    mut contexts: EguiContexts,
    clock: Res<SimClock>,
    environment: Res<Environment>,
    tracker: Res<Tracker>,
    detector: Res<Detector>,
    interlocks: Res<Interlocks>,
    mut pacing: ResMut<Pacing>,
    mut choice: ResMut<TargetChoice>,
    station: Single<(&Mount, &BeamState)>,
    uavs: Query<(&Uav, &Flight, &UavStatus, &HeatedSkin)>,
) -> Result {
    let ctx = contexts.ctx_mut()?;
    let (mount, beam) = *station;
    let panel = egui::Panel::left("panel")
        .exact_size(PANEL_WIDTH)
        .resizable(false)
        .show_separator_line(false)
        .frame(panel_frame());
    panel.show(&mut screen_ui(ctx), |ui| {
        egui::ScrollArea::vertical().show(ui, |ui| {
            ui.spacing_mut().item_spacing.y = 3.0;
            ui.visuals_mut().override_text_color = Some(Color32::from_gray(200));
            pace(ui, &clock, &mut pacing);
            tracking(ui, &clock, &tracker);
            let known: Vec<_> = uavs
                .iter()
                .map(|(uav, flight, ..)| {
                    (
                        uav.name.as_str(),
                        los_to_az_el(flight.state.r_enu_m - mount.r_enu_m),
                    )
                })
                .collect();
            targets(ui, &clock, &tracker, &detector, &known, &mut choice);
            heading(ui, "UAVs");
            for (uav, _, status, skin) in &uavs {
                ui.colored_label(
                    status_colour(*status),
                    format!("{}: {}", uav.name, status.name()),
                );
                row(
                    ui,
                    "skin",
                    format!("{:.0} °C", skin.skin.temperature_k - 273.15),
                );
            }
            heading(ui, "Engagement");
            let (word, colour) = if beam.firing {
                ("FIRING", RED)
            } else {
                ("safe", GREEN)
            };
            ui.colored_label(colour, format!("laser: {word}"));
            for interlock in &interlocks.0 {
                ui.colored_label(GREY, format!("interlock: {interlock}"));
            }
            let shown = |value: f64| if beam.firing { value } else { 0.0 };
            row(
                ui,
                "power at target",
                format!("{:.0} W", shown(beam.power_at_target_w)),
            );
            row(
                ui,
                "power in bucket",
                format!("{:.0} W", shown(beam.power_in_bucket_w)),
            );
            row(
                ui,
                "irradiance",
                format!("{:.1} W/cm²", 1e-4 * shown(beam.irradiance_wpm2)),
            );
            let millimetres = |m: f64| format!("{:.0} mm", 1e3 * shown(m));
            row(ui, "spot radius", millimetres(beam.spot_radius_m));
            row(ui, "spot off aim point", millimetres(beam.offset_m));
            row(ui, "dwell", format!("{:.2} s", beam.dwell_s));
            row(
                ui,
                "energy emitted",
                format!("{:.1} kJ", 1e-3 * beam.energy_j),
            );
            heading(ui, "Weather");
            let weather = &environment.weather;
            let wind_deg = weather.wind_from_rad.to_degrees();
            row(
                ui,
                "wind",
                format!("{:.1} m/s from {wind_deg:03.0}°", weather.wind_speed_mps),
            );
            row(
                ui,
                "visibility",
                format!("{:.1} km", 1e-3 * weather.visibility_m),
            );
            row(
                ui,
                "temperature",
                format!("{:.0} °C", weather.temperature_k - 273.15),
            );
            row(
                ui,
                "cloud cover",
                format!("{:.0} %", 100.0 * weather.cloud_cover),
            );
            row(
                ui,
                "rain",
                format!("{:.1} mm/h", weather.precipitation_mmph),
            );
            ui.add_space(8.0);
            ui.small("Fly: W A S D Q E, shift for haste. Look: right mouse button.");
            ui.small("Space: pause. Full stop: one tick. Slash: one frame.");
        });
    });
    Ok(())
}

fn pace(ui: &mut egui::Ui, clock: &SimClock, pacing: &mut Pacing) {
    ui.label(
        egui::RichText::new(format!("{:.3} s", clock.t_s()))
            .size(26.0)
            .monospace()
            .color(Color32::WHITE),
    );
    ui.horizontal(|ui| {
        let word = if pacing.paused { "Play" } else { "Pause" };
        if ui
            .add_enabled(!pacing.over, egui::Button::new(word))
            .clicked()
        {
            pacing.paused = !pacing.paused;
        }
        for (word, step) in [("+1 tick", StepSize::Tick), ("+1 frame", StepSize::Frame)] {
            if ui
                .add_enabled(!pacing.over, egui::Button::new(word))
                .clicked()
            {
                pacing.paused = true;
                pacing.step = Some(step);
            }
        }
        if pacing.over {
            ui.colored_label(AMBER, "over");
        }
    });
    let mut unbound = pacing.speed.is_infinite();
    if ui.checkbox(&mut unbound, "as fast as possible").changed() {
        pacing.speed = if unbound { f64::INFINITY } else { 1.0 };
    }
    if !unbound {
        let range = 0.1..=10.0;
        ui.add(
            egui::Slider::new(&mut pacing.speed, range)
                .logarithmic(true)
                .suffix("×"),
        );
    }
    row(ui, "reached", format!("{:.2}× real time", pacing.reached));
}

fn tracking(ui: &mut egui::Ui, clock: &SimClock, tracker: &Tracker) {
    const SHOWN: usize = 4;
    heading(ui, "Tracking");
    let colour = match tracker.state {
        TrackingState::Engage => RED,
        TrackingState::Coarse | TrackingState::Precise => GREEN,
        TrackingState::Lost => GREY,
        TrackingState::Search | TrackingState::Acquire => AMBER,
    };
    ui.label(
        egui::RichText::new(tracker.state.name().to_uppercase())
            .size(18.0)
            .color(colour),
    );
    let since_s = clock.at_s(clock.tick - tracker.since_tick);
    row(ui, "for", format!("{since_s:.2} s"));
    row(
        ui,
        "range finder",
        tracker
            .range_m
            .map_or("none".into(), |range_m| format!("{range_m:.0} m")),
    );
    for change in tracker.changes.iter().rev().take(SHOWN) {
        let at_s = clock.at_s(change.tick);
        ui.small(format!(
            "{at_s:.2} s {}: {}",
            change.to.name(),
            change.reason
        ));
    }
}

fn targets(
    ui: &mut egui::Ui,
    clock: &SimClock,
    tracker: &Tracker,
    detector: &Detector,
    known: &[(&str, DVec2)],
    choice: &mut TargetChoice,
) {
    /// A track this near to a UAV is listed under its name [rad].
    const SAME_RAD: f64 = 5e-3;
    heading(ui, "Target");
    if tracker.table.tracks.is_empty() {
        ui.colored_label(GREY, "no tracks");
    }
    for track in &tracker.table.tracks {
        let az_el_rad = track.filter.predicted(clock.t_s()).az_el_rad();
        let name = known
            .iter()
            .map(|(name, at_rad)| (separation_rad(*at_rad, az_el_rad), *name))
            .filter(|(apart_rad, _)| *apart_rad < SAME_RAD)
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or("unknown", |(_, name)| name);
        let [az_deg, el_deg] = az_el_rad.to_array().map(f64::to_degrees);
        let az_deg = az_deg.rem_euclid(360.0);
        let class = detector.class(track.label());
        let text = format!("#{} {name}, {class} {az_deg:.0}° {el_deg:.1}°", track.id);
        if ui.radio(tracker.target == Some(track.id), text).clicked() {
            choice.0 = Some(track.id);
        }
    }
    ui.small("Choosing makes the run differ from the scripted one; the log names the operator.");
}

/// Brings new camera pictures to the GPU. Each camera keeps its one image: egui's own textures
/// are new images at every change, and those are drawn a frame too late to be seen while the
/// simulation runs.
pub fn upload_pictures(
    history: Res<History>,
    mut insets: ResMut<Insets>,
    mut images: ResMut<Assets<Image>>,
    mut textures: ResMut<EguiUserTextures>,
) -> Result {
    for (latest, inset) in history.latest.iter().zip(&mut insets.0) {
        let Some(frame) = latest else { continue };
        if inset.as_ref().is_some_and(|inset| inset.t_s == frame.t_s) {
            continue;
        }
        let [width, height] = frame.size_px;
        let rgba8 = frame
            .rgb8
            .chunks_exact(3)
            .flat_map(|p| [p[0], p[1], p[2], 255])
            .collect();
        let picture = Image::new(
            Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            TextureDimension::D2,
            rgba8,
            TextureFormat::Rgba8UnormSrgb,
            RenderAssetUsages::RENDER_WORLD,
        );
        match inset {
            Some(inset) => {
                inset.t_s = frame.t_s;
                images.insert(inset.image.id(), picture)?;
            }
            None => {
                let image = images.add(picture);
                let texture = textures.add_image(EguiTextureHandle::Weak(image.id()));
                *inset = Some(Uploaded {
                    t_s: frame.t_s,
                    image,
                    texture,
                });
            }
        }
    }
    Ok(())
}

/// The pictures of the three cameras with what the detector found in them.
pub fn draw_insets(
    mut contexts: EguiContexts,
    history: Res<History>,
    insets: Res<Insets>,
    detector: Res<Detector>,
    cameras: Query<(&SensorCamera, &Readout)>,
) -> Result {
    let ctx = contexts.ctx_mut()?;
    let panel = egui::Panel::right("insets")
        .exact_size(INSET_WIDTH + 16.0)
        .resizable(false)
        .show_separator_line(false)
        .frame(panel_frame().inner_margin(8.0));
    panel.show(&mut screen_ui(ctx), |ui| {
        let height = (ui.available_height() / 3.0 - 26.0).min(0.75 * INSET_WIDTH);
        for (tier, inset) in Tier::ALL.into_iter().zip(&insets.0) {
            let camera = cameras.iter().find(|(camera, _)| camera.tier == tier);
            let readout = match camera.map(|(_, readout)| *readout) {
                Some(Readout::Full) => "full frame",
                Some(Readout::Around { .. })
                    if camera.is_some_and(|(c, _)| c.window_px.is_none()) =>
                {
                    "full frame, region"
                }
                Some(Readout::Around { .. }) => "window",
                Some(Readout::Off) | None => "off",
            };
            let latest = history.latest[tier as usize].as_ref();
            let when = latest.map_or(String::new(), |frame| format!("{:.3} s", frame.t_s));
            ui.horizontal(|ui| {
                let name = match tier {
                    Tier::Search => "STV search",
                    Tier::Coarse => "CTV coarse",
                    Tier::Precise => "PTV precise",
                };
                ui.strong(name);
                ui.colored_label(GREY, format!("{readout}  {when}"));
            });
            let (slot, _) = ui.allocate_exact_size(vec2(INSET_WIDTH, height), egui::Sense::hover());
            let painter = ui.painter_at(slot);
            painter.rect_filled(slot, 2.0, Color32::from_gray(18));
            let Some(frame) = latest else {
                let text = "no picture yet";
                painter.text(
                    slot.center(),
                    Align2::CENTER_CENTER,
                    text,
                    FontId::proportional(12.0),
                    GREY,
                );
                continue;
            };
            let [width, rows] = frame.size_px.map(|n| n as f32);
            let whole_sensor = camera.is_some_and(|(camera, _)| {
                [camera.pinhole.width_px, camera.pinhole.height_px] == frame.size_px
            });
            let zoom = if whole_sensor { 1.0 } else { INSET_ZOOM };
            let scale = (slot.width() / (zoom * width)).min(slot.height() / (zoom * rows));
            let shown = Rect::from_center_size(slot.center(), vec2(width, rows) * scale);
            if let Some(inset) = inset {
                let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
                painter.image(inset.texture, shown, whole, Color32::WHITE);
            }
            // From sensor pixels to the screen.
            let at = |x: f64, y: f64| {
                let [left, top] = frame.offset_px.map(f64::from);
                shown.min + vec2((x - left) as f32, (y - top) as f32) * scale
            };
            for detection in &frame.detections {
                let [x0, y0, x1, y1] = detection.box_px;
                let found = Rect::from_two_pos(at(x0, y0), at(x1, y1)).expand(2.0);
                let stroke = Stroke::new(1.4, GREEN);
                painter.rect_stroke(found, 0.0, stroke, StrokeKind::Outside);
                painter.text(
                    found.right_top() + vec2(3.0, 0.0),
                    Align2::LEFT_CENTER,
                    detector.caption(detection),
                    FontId::proportional(11.0),
                    GREEN,
                );
            }
            let [x, y] = frame.centre_px;
            let reticle = at(x, y);
            for arm in [
                vec2(1.0, 0.0),
                vec2(-1.0, 0.0),
                vec2(0.0, 1.0),
                vec2(0.0, -1.0),
            ] {
                let line = [reticle + 5.0 * arm, reticle + 14.0 * arm];
                painter.line_segment(line, Stroke::new(1.2, AMBER));
            }
            rimmed(
                &painter,
                slot.left_top() + vec2(5.0, 4.0),
                Align2::LEFT_TOP,
                &format!("{}  {}", tier.name(), frame.state),
                Color32::WHITE,
            );
        }
    });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::components::record::StateHash;
    use crate::scenario::Scenario;
    use std::path::Path;

    fn app() -> App {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/urban_intercept.toml");
        let loaded = match Scenario::load(&path, &["detector.kind=truth".into()]) {
            Ok(loaded) => loaded,
            Err(error) => panic!("{error}"),
        };
        match app::build(&loaded, &Options::default()) {
            Ok(app) => app,
            Err(error) => panic!("{error}"),
        }
    }

    fn advanced(world: &mut World, wall_s: f64) -> u64 {
        match advance(world, wall_s, || true) {
            Ok(ran) => ran,
            Err(error) => panic!("{error}"),
        }
    }

    #[test]
    fn pause_step_resume_run_the_ticks_of_a_run_without_window() {
        let mut app = app();
        let world = app.world_mut();
        let hz = f64::from(world.resource::<SimClock>().tick_hz);
        world.insert_resource(Pacing {
            paused: true,
            ..Pacing::default()
        });
        assert_eq!(advanced(world, 10.0), 0);
        assert_eq!(world.resource::<SimClock>().tick, 0);

        world.resource_mut::<Pacing>().step = Some(StepSize::Tick);
        assert_eq!(advanced(world, 10.0), 1);
        assert_eq!(advanced(world, 10.0), 0);
        assert_eq!(world.resource::<SimClock>().tick, 1);

        // A step to the next exposure ends on the tick that exposes.
        world.resource_mut::<Pacing>().step = Some(StepSize::Frame);
        let to_frame = advanced(world, 0.0);
        assert!(!world.resource::<Frames>().0.is_empty());
        assert_eq!(world.resource::<SimClock>().tick, 1 + to_frame);

        // Three eighths of a tick at a time: the rest is carried over, none is lost.
        world.resource_mut::<Pacing>().paused = false;
        let parts: Vec<u64> = (0..8).map(|_| advanced(world, 0.375 / hz)).collect();
        assert_eq!(parts, [0, 0, 1, 0, 0, 1, 0, 1]);
        world.resource_mut::<Pacing>().speed = 0.5;
        assert_eq!(advanced(world, 200.0 / hz), 100);

        // Time that the budget does not hold is dropped, not made up for later.
        let mut left = 7;
        let budget = || {
            left -= 1;
            left >= 0
        };
        assert!(matches!(advance(world, 100.0 / hz, budget), Ok(7)));
        assert_eq!(advanced(world, 0.0), 0);

        // As fast as possible, to a set tick.
        let tick = world.resource::<SimClock>().tick;
        let mut pacing = world.resource_mut::<Pacing>();
        (pacing.speed, pacing.pause_at) = (f64::INFINITY, Some(tick + 50));
        assert_eq!(advanced(world, 0.0), 50);
        assert!(world.resource::<Pacing>().paused);

        let ticks = world.resource::<SimClock>().tick;
        assert_eq!(ticks, 1 + to_frame + 3 + 100 + 7 + 50);
        let paced = *world.resource::<StateHash>();
        let mut plain = self::app();
        for _ in 0..ticks {
            assert!(matches!(app::step(plain.world_mut()), Ok(false)));
        }
        assert_eq!(paced, *plain.world().resource::<StateHash>());
    }

    #[test]
    fn an_operator_can_only_choose_a_track_that_is_there() {
        let mut app = app();
        let world = app.world_mut();
        world.insert_resource(TargetChoice(Some(99)));
        choose_target(world);
        assert_eq!(world.resource::<Tracker>().target, None);
        for _ in 0..5_000 {
            assert!(matches!(app::step(world), Ok(false)));
            if !world.resource::<Tracker>().table.tracks.is_empty() {
                break;
            }
        }
        let Some(id) = world
            .resource::<Tracker>()
            .table
            .tracks
            .first()
            .map(|track| track.id)
        else {
            panic!("no track within five seconds")
        };
        world.insert_resource(TargetChoice(Some(id)));
        choose_target(world);
        let tracker = world.resource::<Tracker>();
        assert_eq!(
            (tracker.target, tracker.state),
            (Some(id), TrackingState::Acquire)
        );
        let last = tracker.changes.last().map(|change| change.reason.as_str());
        assert_eq!(last, Some(format!("operator chose track {id}").as_str()));
    }

    #[test]
    fn a_line_that_passes_the_camera_is_cut_at_it() {
        let screen = Screen {
            centre: Pos2::new(500.0, 400.0),
            focal: 1_000.0,
        };
        let behind = DVec3::new(0.0, 1.0, -10.0);
        let ahead = DVec3::new(0.0, 0.0, 100.0);
        let Some([a, b]) = screen.line(behind, ahead) else {
            panic!("half of it is in front")
        };
        assert_eq!(b, screen.centre);
        assert!(a.y > 400.0);
        assert!(screen.line(behind, behind).is_none());
    }

    #[test]
    fn a_screenshot_is_a_jpeg() {
        assert!(check_screenshot(Path::new("docs/window.jpg")).is_ok());
        assert!(check_screenshot(Path::new("docs/window.png")).is_err());
    }
}
