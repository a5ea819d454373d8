//! A real city in the scene: its tiles for sensors and window, in the light of the scene.

use crate::components::capture::SensorCamera;
use crate::components::environment::{CityTiles, Environment};
use crate::components::mount::CameraView;
use crate::components::render::{
    CityTilesets, LeanMaterial, LeanPaint, SENSOR_LAYER, SceneHandles, Shading, Solids,
    WINDOW_LAYER,
};
use crate::models::ground::dsm::Dsm;
use crate::models::tiles::horizon::Horizon;
use crate::models::tiles::selection::View;
use crate::models::tiles::steady::steady_view;
use crate::systems::render::scene::grid;
use bevy::camera::visibility::RenderLayers;
use bevy::prelude::*;
use big_space::prelude::CellCoord;
use boresight_tiles::prepare::for_each_triangle;
use boresight_tiles::settle::{open, settle};
use boresight_tiles::{
    OpenTiles, TilePaint, TileSurface, Tiles, TilesMode, TilesOccluder, TilesPlace, TilesViews,
};
use glam::{DAffine3, DMat3, DVec3};
use std::sync::Arc;

/// Bytes of meshes and textures that are kept for the sensors beside what they see, and for the window.
const BYTE_BUDGET: u64 = 1 << 30;

/// The horizon behind which the window loads nothing: azimuths, and steps of so many metres.
const AZIMUTHS: usize = 720;
const STEPS: usize = 400;
const STEP_M: f64 = 5.0; // [m]

impl TilePaint for LeanPaint {
    type Material = LeanMaterial;

    fn paint(&self, surface: TileSurface, picture: Option<Handle<Image>>) -> LeanMaterial {
        LeanMaterial {
            picture: picture.unwrap_or_else(|| self.0.picture.clone()),
            shading: Shading::Tile(surface),
            ..self.0.clone()
        }
    }
}

/// Puts a city's tiles into the spawned scene, for the sensors.
pub fn spawn_city_tiles(world: &mut World, city: &CityTiles) {
    let tilesets = CityTilesets {
        sensors: spawn_tileset(world, city, TilesMode::Settled, SENSOR_LAYER),
        window: None,
    };
    world.insert_resource(tilesets);
}

/// Puts them there a second time, for a window.
pub fn spawn_window_tiles(world: &mut World, city: &CityTiles) {
    let window = spawn_tileset(world, city, TilesMode::Streamed, WINDOW_LAYER);
    if let Some(mut tilesets) = world.get_resource_mut::<CityTilesets>() {
        tilesets.window = Some(window);
    }
}

fn spawn_tileset(world: &mut World, city: &CityTiles, mode: TilesMode, layer: usize) -> Entity {
    let site_grid = world.resource::<SceneHandles>().site_grid;
    let tiles = Tiles {
        place: TilesPlace::At(city.enu_from_root),
        mode,
        light: city.light,
        byte_budget: BYTE_BUDGET,
        layers: RenderLayers::layer(layer),
        ..Tiles::new(&city.location)
    };
    let parts = (tiles, grid(), CellCoord::default(), ChildOf(site_grid));
    world.spawn(parts).id()
}

/// Loads the tiles that this tick's pictures are drawn from: those that all cameras ask for as they stand now, whether they are
/// due or not. So the tiles are a function of the poses, and no camera's depend on another's rate.
pub fn settle_city(world: &mut World) {
    let Some(CityTilesets { sensors, .. }) = world.get_resource().copied() else {
        return;
    };
    if !open(world, sensors) {
        return;
    }
    let Some(entity_from_root_m) = world
        .get::<OpenTiles>(sensors)
        .map(|o| o.entity_from_root_m)
    else {
        return;
    };
    let root_from_enu_m = entity_from_root_m.inverse();
    let along = |dir: DVec3| root_from_enu_m.transform_vector3(dir).normalize();
    let mut cameras = world.query::<(&SensorCamera, &CameraView)>();
    let mut views: Vec<(usize, View)> = (cameras.iter(world))
        .map(|(camera, view)| {
            let pose = view.pose;
            let enu = steady_view(&camera.pinhole, pose.r_enu_m, pose.q_enu_cam);
            let view = View {
                r_root_m: root_from_enu_m.transform_point3(enu.r_root_m),
                forward: along(enu.forward),
                up: along(enu.up),
                ..enu
            };
            (camera.index, view)
        })
        .collect();
    views.sort_by_key(|(index, _)| *index);
    let views: Vec<View> = views.into_iter().map(|(_, view)| view).collect();
    // Above the skyline nothing is rendered: it must know all that can be drawn.
    let mut stations = world.query_filtered::<Entity, With<Solids>>();
    let stations: Vec<Entity> = stations.iter(world).collect();
    let mut skylines: Vec<(Entity, Solids)> = (stations.into_iter())
        .filter_map(|station| Some((station, world.entity_mut(station).take::<Solids>()?)))
        .collect();
    settle::<LeanPaint>(world, sensors, &views, &mut |prepared| {
        for_each_triangle(prepared, |corners_enu_m| {
            for (_, solids) in &mut skylines {
                solids.0.add(corners_enu_m);
            }
        });
    });
    for (station, solids) in skylines {
        world.entity_mut(station).insert(solids);
    }
}

/// Hides from the window what lies behind the surface that the physics knows. Bridges and arches count as solid there; sensors
/// see all that is in their field.
pub fn hide_behind_horizon(
    tilesets: Option<Res<CityTilesets>>,
    environment: Res<Environment>,
    views: Query<(&TilesViews, &OpenTiles)>,
    mut known: Local<Option<Arc<Horizon>>>,
    mut commands: Commands,
) {
    let Some(window) = tilesets.and_then(|tilesets| tilesets.window) else {
        return;
    };
    let Ok((TilesViews(views), open)) = views.get(window) else {
        return;
    };
    let Some(eye_root_m) = views.first().map(|view| view.r_root_m) else {
        return;
    };
    if known.as_ref().is_some_and(|known| known.holds(eye_root_m)) {
        return;
    }
    let horizon = Arc::new(horizon(
        &environment.city.dsm,
        &open.entity_from_root_m,
        eye_root_m,
    ));
    *known = Some(horizon.clone());
    commands.entity(window).insert(TilesOccluder(horizon));
}

/// The horizon of the surface about an eye in a tileset's root frame, which `enu_from_root_m` places.
pub fn horizon(dsm: &Dsm, enu_from_root_m: &DAffine3, eye_root_m: DVec3) -> Horizon {
    let eye_enu_m = enu_from_root_m.transform_point3(eye_root_m);
    let root_from_enu_m = enu_from_root_m.inverse();
    let axis = |axis: DVec3| root_from_enu_m.transform_vector3(axis).normalize();
    let axes = DMat3::from_cols(axis(DVec3::X), axis(DVec3::Y), axis(DVec3::Z));
    let above_m = |east_m: f64, north_m: f64| {
        dsm.surface_m(eye_enu_m.x + east_m, eye_enu_m.y + north_m) - eye_enu_m.z
    };
    Horizon::new(eye_root_m, axes, AZIMUTHS, STEP_M, STEPS, &above_m)
}
