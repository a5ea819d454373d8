//! A real city in the scene: its tiles for sensors and window, in the light of the scene.

use crate::components::capture::SensorCamera;
use crate::components::environment::CityTiles;
use crate::components::mount::CameraView;
use crate::components::render::{
    CityTilesets, LeanMaterial, LeanPaint, SENSOR_LAYER, SceneHandles, Shading, Solids,
    WINDOW_LAYER,
};
use crate::components::tiles::{OpenTiles, TilePaint, TileSurface, Tiles, TilesMode, TilesPlace};
use crate::models::tiles::selection::View;
use crate::models::tiles::steady::steady_view;
use crate::systems::render::scene::grid;
use crate::systems::tiles::prepare::for_each_triangle;
use crate::systems::tiles::settle::{open, settle};
use bevy::camera::visibility::RenderLayers;
use bevy::prelude::*;
use big_space::prelude::CellCoord;
use glam::DVec3;

/// Bytes of meshes and textures that are kept for the sensors beside what they see, and for the window.
const BYTE_BUDGET: u64 = 1 << 30;

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

/// Puts a city's tiles into the spawned scene; `windowed`: for a window as well.
pub fn spawn_city_tiles(world: &mut World, city: &CityTiles, windowed: bool) {
    let site_grid = world.resource::<SceneHandles>().site_grid;
    let mut spawn = |mode, layer| {
        let tiles = Tiles {
            place: TilesPlace::At(city.enu_from_root),
            mode,
            byte_budget: BYTE_BUDGET,
            layers: RenderLayers::layer(layer),
            ..Tiles::new(&city.location)
        };
        let parts = (tiles, grid(), CellCoord::default(), ChildOf(site_grid));
        world.spawn(parts).id()
    };
    let tilesets = CityTilesets {
        sensors: spawn(TilesMode::Settled, SENSOR_LAYER),
        window: windowed.then(|| spawn(TilesMode::Streamed, WINDOW_LAYER)),
    };
    world.insert_resource(tilesets);
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
