//! Tiles that are there: opened, spawned, drawn or hidden, forgotten.

use crate::{
    KeptTile, OpenTiles, PreparedTile, TileFailed, TilePaint, TileSurface, Tiles, TilesCount,
    TilesPlace,
};
use bevy::prelude::*;
use big_space::prelude::Grid;
use boresight_geodata::tiles::error::TilesError;
use boresight_geodata::tiles::tileset::Tileset;
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use boresight_models::tiles::tree::{TileId, Tree};
use glam::DAffine3;
use std::collections::{BTreeMap, BTreeSet};

/// Nearer to the Earth's middle than this no georeferenced tileset lies [m].
const LEAST_EARTH_RADIUS_M: f64 = 6.2e6;

/// Half the extent of a tree's root [m].
pub fn radius_m(tree: &Tree) -> f64 {
    let bounds = tree.root().map(|root| *tree.bounds(root));
    bounds.map_or(0.0, |bounds| {
        if bounds.ball {
            bounds.half_m.x
        } else {
            bounds.half_m.length()
        }
    })
}

/// From a tileset's root frame to its entity's [m].
pub fn entity_from_root_m(tree: &Tree, place: TilesPlace) -> DAffine3 {
    match place {
        TilesPlace::At(transform) => transform,
        TilesPlace::Centred => {
            let root = tree.root().map(|root| tree.bounds(root).center_m);
            let middle_m = root.unwrap_or_default();
            if middle_m.length() < LEAST_EARTH_RADIUS_M {
                return DAffine3::from_translation(-middle_m);
            }
            let site = SiteFrame::new(Geodetic::from_ecef(middle_m));
            let q = site.q_ecef_enu().inverse();
            DAffine3::from_rotation_translation(q, q * -middle_m)
        }
    }
}

/// Takes over a tileset that was opened.
pub fn opened(tiles: &Tiles, tileset: Tileset) -> OpenTiles {
    OpenTiles {
        entity_from_root_m: entity_from_root_m(&tileset.tree, tiles.place),
        tileset,
        kept: BTreeMap::new(),
        selections: 0,
        settled: None,
        told: 0,
    }
}

/// Spawns what draws a tile, hidden.
pub fn keep<P: TilePaint>(
    world: &mut World,
    (tileset, tiles): (Entity, &Tiles),
    prepared: PreparedTile,
) -> KeptTile {
    let grid = world.get::<Grid>(tileset).cloned();
    let paint = world.resource::<P>().clone();
    let mut images = world.resource_mut::<Assets<Image>>();
    let pictures: Vec<Handle<Image>> = (prepared.pictures.into_iter())
        .map(|picture| images.add(picture))
        .collect();
    let mut looks: BTreeMap<(TileSurface, Option<usize>), Handle<P::Material>> = BTreeMap::new();
    let mut entities = Vec::new();
    for part in prepared.parts {
        let mesh = world.resource_mut::<Assets<Mesh>>().add(part.mesh);
        let mut materials = world.resource_mut::<Assets<P::Material>>();
        let look = looks
            .entry((part.surface, part.picture))
            .or_insert_with(|| {
                let picture = part.picture.and_then(|number| pictures.get(number));
                materials.add(paint.paint(part.surface, picture.cloned()))
            });
        for (at_m, rotation, scale) in part.places {
            let (cell, translation) = match &grid {
                Some(grid) => {
                    let (cell, rest) = grid.translation_to_grid(at_m);
                    (Some(cell), rest)
                }
                None => (None, at_m.as_vec3()),
            };
            let mut entity = world.spawn((
                Mesh3d(mesh.clone()),
                MeshMaterial3d(look.clone()),
                Transform {
                    translation,
                    rotation,
                    scale,
                },
                part.bounds,
                tiles.layers.clone(),
                Visibility::Hidden,
                ChildOf(tileset),
            ));
            if let Some(cell) = cell {
                entity.insert(cell);
            }
            entities.push(entity.id());
        }
    }
    KeptTile {
        entities,
        triangles: prepared.triangles,
        bytes: prepared.bytes,
        drawn: false,
        drawn_at: 0,
    }
}

/// Draws those of the tiles that are there, and hides all others.
pub fn draw(world: &mut World, open: &mut OpenTiles, cut: &[TileId]) {
    open.selections += 1;
    let cut: BTreeSet<TileId> = cut.iter().copied().collect();
    for (tile, kept) in &mut open.kept {
        let drawn = cut.contains(tile);
        if drawn {
            kept.drawn_at = open.selections;
        }
        if drawn == kept.drawn {
            continue;
        }
        kept.drawn = drawn;
        for entity in &kept.entities {
            if let Some(mut visibility) = world.get_mut::<Visibility>(*entity) {
                *visibility = if drawn {
                    Visibility::Inherited
                } else {
                    Visibility::Hidden
                };
            }
        }
    }
}

/// Forgets a tile.
pub fn forget(world: &mut World, open: &mut OpenTiles, tile: TileId) {
    let Some(kept) = open.kept.remove(&tile) else {
        return;
    };
    for entity in kept.entities {
        world.despawn(entity);
    }
}

/// Forgets what was not drawn for the longest time until the rest fits into a budget of bytes.
pub fn forget_beyond(world: &mut World, open: &mut OpenTiles, byte_budget: u64) {
    let mut bytes: u64 = open.kept.values().map(|kept| kept.bytes).sum();
    let mut idle: Vec<(u64, TileId)> = (open.kept.iter())
        .filter(|(_, kept)| !kept.drawn)
        .map(|(tile, kept)| (kept.drawn_at, *tile))
        .collect();
    idle.sort_unstable();
    for (_, tile) in idle {
        if bytes <= byte_budget {
            break;
        }
        bytes -= open.kept.get(&tile).map_or(0, |kept| kept.bytes);
        forget(world, open, tile);
    }
}

/// What is there, in numbers; `missing`: what is asked for and not there.
pub fn count(open: &OpenTiles, missing: usize) -> TilesCount {
    let drawn = open.kept.values().filter(|kept| kept.drawn);
    TilesCount {
        drawn: drawn.clone().count(),
        triangles: drawn.map(|kept| kept.triangles).sum(),
        kept: open.kept.len(),
        bytes: open.kept.values().map(|kept| kept.bytes).sum(),
        missing,
        failed: open.tileset.failures().len(),
    }
}

/// Tells of failures that nobody was told of.
pub fn tell_failures(world: &mut World, tileset: Entity, open: &mut OpenTiles) {
    let news: Vec<TileFailed> = (open.tileset.failures().iter())
        .skip(open.told)
        .map(|(tile, error)| failed(tileset, *tile, error))
        .collect();
    open.told += news.len();
    news.into_iter().for_each(|failure| tell(world, failure));
}

/// Tells of a failure, in the log and to whoever reads the messages.
pub fn tell(world: &mut World, failure: TileFailed) {
    warn!("{}", failure.error);
    world.write_message(failure);
}

/// The message of a tile that cannot be read.
pub fn failed(tileset: Entity, tile: TileId, error: &TilesError) -> TileFailed {
    TileFailed {
        tileset,
        tile,
        error: error.to_string(),
    }
}
