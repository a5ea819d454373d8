//! Settled loading: a frame waits until all that its cameras ask for is there.

use super::prepare::prepare;
use super::show::{count, draw, failed, forget_beyond, keep, opened, tell, tell_failures};
use crate::{OpenTiles, PreparedTile, TileLoaded, TilePaint, Tiles, TilesMode, TilesViews};
use bevy::prelude::*;
use boresight_common::parallel::in_parallel;
use boresight_geodata::tiles::error::TilesError;
use boresight_geodata::tiles::settled;
use boresight_geodata::tiles::tileset::Tileset;
use boresight_models::tiles::selection::View;
use boresight_models::tiles::tree::TileId;
use std::convert::Infallible;

/// Tiles that are decoded before they are handed to the GPU: bounds the memory that both need at once.
const AT_ONCE: usize = 16;

/// Opens the tileset of an entity where it is not open yet; whether it is open then. One that cannot be opened is told once.
pub fn open(world: &mut World, tileset: Entity) -> bool {
    if world.get::<OpenTiles>(tileset).is_some() {
        return true;
    }
    let Some(tiles) = world.get::<Tiles>(tileset).cloned() else {
        return false;
    };
    match Tileset::open(&tiles.location) {
        Ok(read) => {
            let open = opened(&tiles, read);
            world.entity_mut(tileset).insert(open);
            true
        }
        Err(error) => {
            tell(world, failed(tileset, TileId(0), &error));
            // Not tried again in every frame.
            world.entity_mut(tileset).remove::<Tiles>();
            false
        }
    }
}

/// Brings the tileset of an entity to the cut that `views` (in its root frame) ask for, and draws it. `new` is
/// shown what was loaded for it. The cut depends on tileset and views alone, whatever was loaded before.
pub fn settle<P: TilePaint>(
    world: &mut World,
    tileset: Entity,
    views: &[View],
    new: &mut dyn FnMut(&PreparedTile),
) {
    if !open(world, tileset) {
        return;
    }
    let Some(tiles) = world.get::<Tiles>(tileset).cloned() else {
        return;
    };
    let Some(mut open) = world.entity_mut(tileset).take::<OpenTiles>() else {
        return;
    };
    let asked = |(own, _): &(Vec<View>, Vec<TileId>)| own == views;
    if !open.settled.as_ref().is_some_and(asked) {
        match load::<P>(world, (tileset, &tiles), &mut open, views, new) {
            Ok(cut) => {
                draw(world, &mut open, &cut);
                forget_beyond(world, &mut open, tiles.byte_budget);
                open.settled = Some((views.to_vec(), cut));
            }
            Err(error) => {
                // What was drawn stays; tried again when the views change.
                tell(world, failed(tileset, TileId(0), &error));
                let before = open.settled.take().map_or_else(Vec::new, |(_, cut)| cut);
                open.settled = Some((views.to_vec(), before));
            }
        }
        tell_failures(world, tileset, &mut open);
    }
    let count = count(&open, 0);
    world.entity_mut(tileset).insert((open, count));
}

/// Loads what a cut lacks; a tile that cannot be read leaves its parent, for which the cut is chosen anew.
fn load<P: TilePaint>(
    world: &mut World,
    (tileset, tiles): (Entity, &Tiles),
    open: &mut OpenTiles,
    views: &[View],
    new: &mut dyn FnMut(&PreparedTile),
) -> Result<Vec<TileId>, TilesError> {
    loop {
        let cut = settled::settle(&mut open.tileset, views, &tiles.select)?.draw;
        let lacks = |tile: &&TileId| !open.kept.contains_key(tile);
        let missing: Vec<TileId> = cut.iter().filter(lacks).copied().collect();
        let mut whole = true;
        for some in missing.chunks(AT_ONCE) {
            let read = |tile: &TileId| {
                let content = settled::content(&open.tileset, *tile);
                let to_entity = open.entity_from_root_m * open.tileset.tree.tile(*tile).to_root_m;
                let prepared = content.map(|content| prepare(&content, to_entity, tiles.light));
                Ok::<_, Infallible>((*tile, prepared))
            };
            // Nothing is refused: what cannot be read is a result like others.
            let Ok(read) = in_parallel(some, tiles.at_once.max(1), read);
            for (tile, prepared) in read {
                match prepared {
                    Ok(prepared) => {
                        new(&prepared);
                        let kept = keep::<P>(world, (tileset, tiles), prepared);
                        open.kept.insert(tile, kept);
                        world.write_message(TileLoaded { tileset, tile });
                    }
                    Err(error) => {
                        whole = false;
                        open.tileset.fail(tile, error);
                    }
                }
            }
        }
        if whole {
            return Ok(cut);
        }
    }
}

/// Settles every tileset that is loaded so, for what looks at it.
pub fn settle_all<P: TilePaint>(world: &mut World) {
    let mut tilesets = world.query::<(Entity, &Tiles, &TilesViews)>();
    let due: Vec<(Entity, Vec<View>)> = (tilesets.iter(world))
        .filter(|(_, tiles, views)| tiles.mode == TilesMode::Settled && !views.0.is_empty())
        .map(|(entity, _, views)| (entity, views.0.clone()))
        .collect();
    for (tileset, views) in due {
        settle::<P>(world, tileset, &views, &mut |_| {});
    }
}
