//! The window's free camera.

use crate::components::capture::SensorCamera;
use crate::components::environment::Environment;
use crate::components::flight::{Flight, Uav};
use crate::components::mount::{CameraView, Mount};
use crate::components::render::{SceneHandles, WINDOW_LAYER};
use crate::components::view::{FreeCamera, Session, Sight, WindowCamera, WindowFrame};
use crate::models::maths::kinematics::{az_el_to_los, los_to_az_el};
use crate::systems::render::scene::{bevy_attitude, place_in_site};
use crate::systems::view::exposure::shown_in;
use crate::systems::view::keys::context_settings;
use bevy::camera::Exposure;
use bevy::camera::visibility::RenderLayers;
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::input::mouse::AccumulatedMouseMotion;
use bevy::prelude::*;
use bevy::render::renderer::RenderAdapterInfo;
use bevy::render::view::{ColorGrading, Msaa, NoIndirectDrawing};
use bevy_egui::PrimaryEguiContext;
use bevy_egui::input::EguiWantsInput;
use big_space::prelude::CellCoord;
use boresight_tiles::SeesTiles;
use glam::{DVec2, DVec3};

/// Vertical field of view of the free camera [rad].
const VFOV_RAD: f64 = 0.85;

/// Longest wall-clock time that counts as passed between two window frames [s].
pub const LONGEST_FRAME_S: f64 = 0.25;

/// Spawns the window's camera, with nothing to be seen yet.
pub fn spawn_window_camera(
    mut commands: Commands,
    adapter: Option<Res<RenderAdapterInfo>>,
    session: Option<Res<Session>>,
) {
    // A software rasteriser has no time for four samples a pixel, but a picture is worth them.
    let software = adapter.is_some_and(|info| info.device_type == wgpu::DeviceType::Cpu);
    let pictured = session.is_some_and(|session| session.screenshot.is_some());
    commands.spawn((
        (WindowCamera, SeesTiles),
        (PrimaryEguiContext, context_settings()),
        Camera3d::default(),
        Camera {
            is_active: false,
            clear_color: ClearColorConfig::Custom(Color::srgb(0.04, 0.05, 0.06)),
            ..default()
        },
        RenderLayers::from_layers(&[0, WINDOW_LAYER]),
        Projection::Perspective(PerspectiveProjection {
            fov: VFOV_RAD as f32,
            near: 0.5,
            far: 100_000.0,
            ..default()
        }),
        if software && !pictured {
            Msaa::Off
        } else {
            Msaa::Sample4
        },
        (Exposure::default(), ColorGrading::default()),
        // By it the shader knows the window.
        Tonemapping::Reinhard,
        NoIndirectDrawing,
        Transform::default(),
        Visibility::default(),
    ));
}

/// Puts the window's camera into the built scene: behind and above the station, looking over it to the first UAV.
pub fn place_window_camera(world: &mut World) {
    let mut cameras = world.query_filtered::<Entity, With<WindowCamera>>();
    let (Some(site_grid), Some(entity)) = (
        (world.get_resource::<SceneHandles>()).map(|scene| scene.site_grid),
        cameras.iter(world).next(),
    ) else {
        return;
    };
    let mut mounts = world.query::<&Mount>();
    let mount = mounts
        .iter(world)
        .next()
        .map(|mount| (mount.r_enu_m, mount.gimbal.state.az_el_rad()));
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
        vfov_rad: VFOV_RAD,
    };
    let light = shown_in(world.resource::<Environment>());
    let mut window = world.entity_mut(entity);
    window.insert((light, placed(&camera), ChildOf(site_grid)));
    if let Some(mut camera) = window.get_mut::<Camera>() {
        // The sky covers everything.
        camera.clear_color = ClearColorConfig::None;
    }
    world.insert_resource(camera);
}

/// Where the free camera stands in the scene.
fn placed(camera: &FreeCamera) -> (CellCoord, Transform) {
    place_in_site(camera.r_enu_m, bevy_attitude(camera.q_enu_cam()))
}

/// Moves the window's camera. Free: WASD and QE fly, the mouse with its right button held looks, shift is for
/// haste. Beside a UAV the mouse turns around it, W and S change the distance. With a camera it looks as that does.
pub fn fly_camera(
    frame: Res<WindowFrame>,
    keys: Res<ButtonInput<KeyCode>>,
    buttons: Res<ButtonInput<MouseButton>>,
    motion: Res<AccumulatedMouseMotion>,
    wants: Res<EguiWantsInput>,
    environment: Res<Environment>,
    mut sight: ResMut<Sight>,
    mut camera: ResMut<FreeCamera>,
    uavs: Query<(&Uav, &Flight)>,
    cameras: Query<(&SensorCamera, &CameraView)>,
    view: Single<(&mut CellCoord, &mut Transform, &mut Projection), With<WindowCamera>>,
) {
    const LOOK_RAD_PER_PX: f64 = 3e-3;
    const SPEED_MPS: f64 = 60.0;
    const HASTE: f64 = 8.0;
    const STEEPEST_RAD: f64 = 1.5;
    const LEAST_HEIGHT_M: f64 = 2.0;
    /// Change of the distance from a UAV in a second, as a share of it.
    const APPROACH_PER_S: f64 = 1.5;
    const DISTANCES_M: [f64; 2] = [1.0, 2_000.0];
    /// The window shows somewhat more than the camera whose way it looks.
    const AROUND: f64 = 1.5;
    // Inside the sky dome, and near enough to the floating origin for millimetres in f32.
    const FARTHEST_M: f64 = 20_000.0;
    if buttons.pressed(MouseButton::Right) && !wants.wants_any_pointer_input() {
        let turn = motion.delta.as_dvec2() * LOOK_RAD_PER_PX;
        camera.azimuth_rad = (camera.azimuth_rad + turn.x).rem_euclid(std::f64::consts::TAU);
        camera.elevation_rad = (camera.elevation_rad - turn.y).clamp(-STEEPEST_RAD, STEEPEST_RAD);
    }
    let pressed = |key| !wants.wants_any_keyboard_input() && keys.pressed(key);
    let axis = |plus: KeyCode, minus: KeyCode| {
        f64::from(i8::from(pressed(plus)) - i8::from(pressed(minus)))
    };
    let haste = if pressed(KeyCode::ShiftLeft) || pressed(KeyCode::ShiftRight) {
        HASTE
    } else {
        1.0
    };
    let step_s = frame.wall_s.min(LONGEST_FRAME_S);
    camera.vfov_rad = VFOV_RAD;
    match *sight {
        Sight::Free => {
            let q = camera.q_enu_cam();
            let way = q * DVec3::X * axis(KeyCode::KeyD, KeyCode::KeyA)
                + q * DVec3::Z * axis(KeyCode::KeyW, KeyCode::KeyS)
                + DVec3::Z * axis(KeyCode::KeyE, KeyCode::KeyQ);
            let r_enu_m = camera.r_enu_m + way.normalize_or_zero() * (SPEED_MPS * haste * step_s);
            camera.r_enu_m = r_enu_m.clamp_length_max(FARTHEST_M);
        }
        Sight::Chase {
            uav,
            ref mut distance_m,
        } => {
            let nearer = axis(KeyCode::KeyW, KeyCode::KeyS);
            *distance_m *= (-nearer * APPROACH_PER_S * haste * step_s).exp();
            *distance_m = distance_m.clamp(DISTANCES_M[0], DISTANCES_M[1]);
            let chased = uavs.iter().find(|(own, _)| own.index == uav);
            if let Some((_, flight)) = chased {
                let ahead = az_el_to_los(DVec2::new(camera.azimuth_rad, camera.elevation_rad));
                camera.r_enu_m = flight.state.r_enu_m - *distance_m * ahead;
            }
        }
        Sight::Camera(index) => {
            let looking = cameras.iter().find(|(own, _)| own.index == index);
            if let Some((own, view)) = looking {
                let az_el_rad = los_to_az_el(view.pose.q_enu_cam * DVec3::Z);
                camera.r_enu_m = view.pose.r_enu_m;
                (camera.azimuth_rad, camera.elevation_rad) = (az_el_rad.x, az_el_rad.y);
                let half = 0.5 * f64::from(own.pinhole.height_px) / own.pinhole.focal_px;
                camera.vfov_rad = 2.0 * (AROUND * half).atan();
            }
        }
    }
    if !matches!(*sight, Sight::Camera(_)) {
        let floor_m = environment
            .city
            .dsm
            .terrain_m(camera.r_enu_m.x, camera.r_enu_m.y);
        camera.r_enu_m.z = camera.r_enu_m.z.max(floor_m + LEAST_HEIGHT_M);
    }
    let (mut cell, mut transform, mut projection) = view.into_inner();
    (*cell, *transform) = placed(&camera);
    if let Projection::Perspective(perspective) = &mut *projection {
        perspective.fov = camera.vfov_rad as f32;
    }
}
