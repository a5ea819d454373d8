//! Streamed loading: other threads read and decode what is most urgent, and coarser tiles stay in its place until then.

use super::prepare::prepare;
use super::show::{count, draw, failed, forget, keep, opened, tell, tell_failures};
use crate::{
    Arrived, OpenTiles, OpeningTiles, StreamedTiles, TileLoaded, TilePaint, Tiles, TilesMode,
    TilesOccluder, TilesViews,
};
use bevy::prelude::*;
use bevy::tasks::{AsyncComputeTaskPool, Task, block_on};
use boresight_geodata::tiles::settled;
use boresight_geodata::tiles::tileset::Tileset;
use boresight_models::tiles::selection::Occluder;
use boresight_models::tiles::selector::{Selector, SelectorOptions};
use boresight_models::tiles::tree::TileId;
use std::collections::BTreeMap;

/// Bytes that are handed to the GPU in a frame, at least one tile's [byte]: more would show as a stutter.
const MOST_BYTES_A_FRAME: u64 = 64 << 20;

/// Lets every streamed tileset follow what looks at it.
pub fn stream<P: TilePaint>(world: &mut World) {
    let mut tilesets = world.query::<(Entity, &Tiles)>();
    let streamed: Vec<(Entity, Tiles)> = (tilesets.iter(world))
        .filter(|(_, tiles)| tiles.mode == TilesMode::Streamed)
        .map(|(entity, tiles)| (entity, tiles.clone()))
        .collect();
    for (tileset, tiles) in streamed {
        let taken = world
            .entity_mut(tileset)
            .take::<(OpenTiles, StreamedTiles)>();
        let Some((mut open, mut streamed)) = taken else {
            open_meanwhile(world, tileset, &tiles);
            continue;
        };
        receive::<P>(world, (tileset, &tiles), &mut open, &mut streamed);
        let views = world
            .get::<TilesViews>(tileset)
            .map(|views| views.0.clone());
        if let Some(views) = views.filter(|views| !views.is_empty()) {
            let occluder = world.get::<TilesOccluder>(tileset);
            let occluder = occluder.map(|TilesOccluder(o)| &**o as &dyn Occluder);
            let step = (streamed.selector).update(&open.tileset.tree, &views, occluder);
            for tile in step.drop {
                forget(world, &mut open, tile);
            }
            for tile in step.load {
                streamed.pending.insert(tile, load(&open, tile, &tiles));
            }
            draw(world, &mut open, &step.draw);
        }
        tell_failures(world, tileset, &mut open);
        let count = count(&open, streamed.pending.len());
        world.entity_mut(tileset).insert((open, streamed, count));
    }
}

/// Opens a tileset on another thread.
fn open_meanwhile(world: &mut World, tileset: Entity, tiles: &Tiles) {
    let Some(opening) = world.entity_mut(tileset).take::<OpeningTiles>() else {
        let location = tiles.location.clone();
        let task = AsyncComputeTaskPool::get().spawn(async move { Tileset::open(&location) });
        world.entity_mut(tileset).insert(OpeningTiles(task));
        return;
    };
    if !opening.0.is_finished() {
        world.entity_mut(tileset).insert(opening);
        return;
    }
    match block_on(opening.0) {
        Ok(read) => {
            let streamed = StreamedTiles {
                selector: Selector::new(SelectorOptions {
                    select: tiles.select,
                    budget_bytes: tiles.byte_budget,
                    at_once: tiles.at_once.max(1),
                    ..SelectorOptions::default()
                }),
                pending: BTreeMap::new(),
            };
            let open = opened(tiles, read);
            world.entity_mut(tileset).insert((open, streamed));
        }
        Err(error) => {
            tell(world, failed(tileset, TileId(0), &error));
            // Not tried again in every frame.
            world.entity_mut(tileset).remove::<Tiles>();
        }
    }
}

/// Reads a tile on another thread.
fn load(open: &OpenTiles, tile: TileId, tiles: &Tiles) -> Task<Arrived> {
    let pool = AsyncComputeTaskPool::get();
    if let Some(request) = open.tileset.request(tile) {
        return pool.spawn(async move { Arrived::Branch(Box::new(request.read())) });
    }
    let (fetcher, up_axis) = (open.tileset.fetcher(), open.tileset.up_axis(tile));
    let contents = open.tileset.tree.tile(tile).contents.clone();
    let to_entity = open.entity_from_root_m * open.tileset.tree.tile(tile).to_root_m;
    let light = tiles.light;
    pool.spawn(async move {
        let content = settled::content_of(&fetcher, &contents, up_axis);
        Arrived::Content(Box::new(
            content.map(|content| prepare(&content, to_entity, light)),
        ))
    })
}

/// Takes over what was read since.
fn receive<P: TilePaint>(
    world: &mut World,
    (tileset, tiles): (Entity, &Tiles),
    open: &mut OpenTiles,
    streamed: &mut StreamedTiles,
) {
    let finished = |(tile, task): (&TileId, &Task<Arrived>)| task.is_finished().then_some(*tile);
    let arrived: Vec<TileId> = streamed.pending.iter().filter_map(finished).collect();
    let mut bytes = 0;
    for tile in arrived {
        if bytes >= MOST_BYTES_A_FRAME {
            break;
        }
        let Some(task) = streamed.pending.remove(&tile) else {
            continue;
        };
        match block_on(task) {
            Arrived::Branch(read) => {
                // A failure is noted in the tileset, and told below with others.
                let _ = open.tileset.adopt(tile, *read);
                streamed.selector.released(tile);
            }
            Arrived::Content(read) => match *read {
                Ok(prepared) => {
                    bytes += prepared.bytes;
                    streamed.selector.loaded(tile, prepared.bytes);
                    let kept = keep::<P>(world, (tileset, tiles), prepared);
                    open.kept.insert(tile, kept);
                    world.write_message(TileLoaded { tileset, tile });
                }
                Err(error) => {
                    open.tileset.fail(tile, error);
                    streamed.selector.released(tile);
                }
            },
        }
    }
}
