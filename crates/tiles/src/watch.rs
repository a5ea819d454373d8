//! What looks at tilesets: cameras as views in a tileset's frame.

use crate::{OpenTiles, SeesTiles, Tiles, TilesViews};
use bevy::camera::visibility::RenderLayers;
use bevy::prelude::*;
use big_space::prelude::{CellCoord, Grid};
use boresight_models::tiles::selection::View;
use glam::{DAffine3, DQuat};

/// A camera that tiles may be loaded for.
type Watching = (
    &'static Camera,
    &'static Transform,
    &'static GlobalTransform,
    Option<&'static CellCoord>,
    Option<&'static ChildOf>,
    Option<&'static RenderLayers>,
);

/// What is asked of a tileset.
type Watched<'a> = (
    Entity,
    &'a Tiles,
    &'a OpenTiles,
    &'a GlobalTransform,
    Option<&'a Grid>,
    &'a mut TilesViews,
);

/// Notes for each tileset which marked cameras look at it. A camera in the tileset's own grid is placed in f64; of
/// others the transform that Bevy or big_space propagated last is taken.
pub fn watch(mut tilesets: Query<Watched>, cameras: Query<Watching, With<SeesTiles>>) {
    for (entity, tiles, open, at, grid, mut views) in &mut tilesets {
        let root_from_entity_m = open.entity_from_root_m.inverse();
        let mut seen: Option<Vec<View>> = None;
        for (camera, transform, global, cell, parent, layers) in &cameras {
            if !camera.is_active || !tiles.layers.intersects(layers.unwrap_or_default()) {
                continue;
            }
            let own = parent.is_some_and(|parent| parent.parent() == entity);
            let entity_from_camera_m = match (own, grid, cell) {
                (true, Some(grid), Some(cell)) => DAffine3::from_rotation_translation(
                    transform.rotation.as_dquat(),
                    grid.grid_position_double(cell, transform),
                ),
                (true, ..) => DAffine3::from_rotation_translation(
                    transform.rotation.as_dquat(),
                    transform.translation.as_dvec3(),
                ),
                _ => {
                    let relative =
                        at.affine().as_daffine3().inverse() * global.affine().as_daffine3();
                    let (_, q, r_m) = relative.to_scale_rotation_translation();
                    DAffine3::from_rotation_translation(q, r_m)
                }
            };
            let views = seen.get_or_insert_default();
            views.extend(view(camera, root_from_entity_m * entity_from_camera_m));
        }
        if let Some(seen) = seen {
            views.set_if_neq(TilesViews(seen));
        }
    }
}

/// A perspective camera's view; none of one that has no picture yet.
fn view(camera: &Camera, root_from_camera_m: DAffine3) -> Option<View> {
    let size_px = camera.physical_viewport_size()?.to_array();
    let focal = f64::from(camera.clip_from_view().y_axis.y);
    let perspective = camera.clip_from_view().z_axis.w != 0.0;
    let (_, q, r_root_m) = root_from_camera_m.to_scale_rotation_translation();
    let along = |q: DQuat, axis: glam::DVec3| (q * axis).normalize();
    (perspective && focal > 0.0).then(|| View {
        r_root_m,
        // Bevy's cameras look along -z with y up.
        forward: along(q, glam::DVec3::NEG_Z),
        up: along(q, glam::DVec3::Y),
        fovy_rad: 2.0 * focal.recip().atan(),
        size_px,
    })
}
