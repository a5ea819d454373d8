//! What the cameras see: materials, big space, and the scene that stands for the truth.

use crate::components::capture::SensorCamera;
use crate::components::environment::Environment;
use crate::components::flight::{Flight, Uav, UavShape};
use crate::components::mount::Mount;
use crate::components::render::{
    LEAN_SHADER, LeanMaterial, LeanPaint, SceneHandles, SensorViews, Solids,
};
use crate::components::run::{Failure, Kept, Options};
use crate::models::ground::skyline::Skyline;
use crate::systems::capture::{ImageScratch, spawn_magnifiers};
use crate::systems::render::city_tiles::{settle_city, spawn_city_tiles, spawn_window_tiles};
use crate::systems::render::renderer::{Renderer, attach_unwritten, settle, spawn_sensor_view};
use crate::systems::render::scene;
use bevy::light::cluster::GlobalClusterSettings;
use bevy::prelude::*;
use bevy::render::batching::gpu_preprocessing::{GpuPreprocessingMode, GpuPreprocessingSupport};
use bevy::render::view::{prepare_view_attachments, prepare_view_targets};
use bevy::render::{Render, RenderApp, RenderStartup, RenderSystems, init_gpu_resource};
use bevy::transform::TransformSystems;
use big_space::grid::local_origin::LocalFloatingOrigin;
use big_space::plugin::{BigSpaceCorePlugin, BigSpaceSystems};
use big_space::prelude::{BigSpace, Grid};
use boresight_tiles::TilesPlugin;

/// Meshes are placed on the CPU: there are some hundred, and a compute shader in every view costs more than
/// their matrices.
const BY_HAND: GpuPreprocessingSupport = GpuPreprocessingSupport {
    max_supported_mode: GpuPreprocessingMode::None,
};

/// Materials, shader and big space; needs Bevy's own rendering plugins.
pub struct ScenePlugin;

impl Plugin for ScenePlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins(BigSpaceCorePlugin)
            .add_systems(
                PostUpdate,
                // As `BigSpacePropagationPlugin` has them, but with the flat `propagate_high_precision`: the other form hands every
                // entity to the task pool through channels, which costs more than the sums. Nothing lies outside the big space.
                (
                    BigSpace::find_floating_origin,
                    LocalFloatingOrigin::compute_all,
                    Grid::tag_low_precision_roots,
                    Grid::propagate_root_grids,
                    Grid::propagate_high_precision,
                    Grid::propagate_low_precision,
                )
                    .chain()
                    .after(BigSpaceSystems::RecenterLargeTransforms)
                    .in_set(TransformSystems::Propagate),
            )
            .add_plugins(MaterialPlugin::<LeanMaterial>::default())
            .add_plugins(TilesPlugin::<LeanPaint>::painted());
        if let Some(renderer) = app.get_sub_app_mut(RenderApp) {
            // Bevy asks before the first frame and again when it has the device.
            renderer.insert_resource(BY_HAND).add_systems(
                RenderStartup,
                (|mut commands: Commands| commands.insert_resource(BY_HAND))
                    .after(init_gpu_resource::<GpuPreprocessingSupport>),
            );
            renderer.add_systems(
                Render,
                attach_unwritten
                    .in_set(RenderSystems::PrepareViews)
                    .after(prepare_view_attachments)
                    .before(prepare_view_targets),
            );
        }
        let mut shaders = app.world_mut().resource_mut::<Assets<Shader>>();
        // The handle is a constant of this crate, so it is always there to insert at.
        let _ = shaders.insert(
            &LEAN_SHADER,
            Shader::from_wgsl(include_str!("../../assets/shaders/lean.wgsl"), "lean.wgsl"),
        );
    }

    /// Runs after Bevy's own, which finds out what the adapter can do.
    fn finish(&self, app: &mut App) {
        // There are no lamps to sort into clusters; on the GPU that is five passes a view.
        if let Some(mut clusters) = app.world_mut().get_resource_mut::<GlobalClusterSettings>() {
            clusters.gpu_clustering = None;
        }
    }
}

/// Whether this run renders at all, and nothing has failed so far.
pub fn renders(renderer: Option<Res<Kept<Renderer>>>, failure: Res<Failure>) -> bool {
    renderer.is_some() && !failure.is_set()
}

/// Builds the scene around the truth that was set up: city, sky, UAVs, and a view for each camera.
pub fn show(world: &mut World) {
    let environment = world.resource::<Environment>().clone();
    let mut mounts = world.query::<(Entity, &Mount)>();
    let stations: Vec<_> = (mounts.iter(world))
        .map(|(entity, mount)| (entity, mount.r_enu_m))
        .collect();
    let eyes_enu_m: Vec<_> = stations.iter().map(|(_, r_enu_m)| *r_enu_m).collect();
    let tiles = environment.city.chunks();
    for (station, r_enu_m) in stations {
        let solids = Solids(Skyline::new(&tiles, r_enu_m));
        world.entity_mut(station).insert(solids);
    }
    let hidden = scene::spawn(world, &environment, tiles, &eyes_enu_m);
    let mut uavs = world.query::<(&Uav, &Flight, &UavShape)>();
    let uavs: Vec<_> = uavs
        .iter(world)
        .map(|(uav, flight, shape)| (uav.index, flight.state, shape.mesh.clone()))
        .collect();
    for (index, state, mesh) in uavs {
        scene::spawn_uav(world, index, &mesh, (state.r_enu_m, state.q_enu_body));
    }
    let mut cameras = world.query::<(Entity, &SensorCamera)>();
    let cameras: Vec<_> = cameras
        .iter(world)
        .map(|(entity, camera)| (entity, camera.clone()))
        .collect();
    for (entity, camera) in cameras {
        let views = spawn_views(world, &camera);
        world.entity_mut(entity).insert(views);
    }
    if let Some(city) = &environment.tiles {
        spawn_city_tiles(world, city);
        settle_city(world);
    }
    if let Some(mut renderer) = Kept::<Renderer>::take(world) {
        settle(world, &mut renderer);
        Kept::put(world, renderer);
    }
    Kept::put(world, ImageScratch::default());
    if world.resource::<Options>().window {
        let r_station_enu_m = eyes_enu_m.first().copied().unwrap_or_default();
        scene::spawn_for_window(world, &environment, &hidden, r_station_enu_m);
        if let Some(city) = &environment.tiles {
            spawn_window_tiles(world, city);
        }
    }
}

/// Sides of the squares that a view renders when nothing else is to be seen [px].
const SQUARES_PX: [u32; 3] = [64, 128, 256];

/// The render cameras of a sensor: squares about a UAV before the sky, its readout window, the sensor's
/// lower half and all of it.
fn spawn_views(world: &mut World, camera: &SensorCamera) -> SensorViews {
    let site_grid = world.resource::<SceneHandles>().site_grid;
    let [width, height] = [camera.pinhole.width_px, camera.pinhole.height_px];
    let mut sizes: Vec<[u32; 2]> = SQUARES_PX
        .into_iter()
        .chain(camera.window_px)
        .map(|side| [side.min(width), side.min(height)])
        .chain([[width, height.div_ceil(2)], [width, height]])
        .collect();
    sizes.sort_by_key(|[width, height]| (width * height, *width));
    sizes.dedup();
    let mut view = |size_px| spawn_sensor_view(world, site_grid, size_px, camera.antialias);
    SensorViews {
        sizes: sizes
            .into_iter()
            .map(|size_px| (size_px, view(size_px)))
            .collect(),
        magnifiers: spawn_magnifiers(world, site_grid),
    }
}
