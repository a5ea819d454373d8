//! Settled loading: everything that a cut needs is there before it is used, the same on every machine.

use crate::tiles::content::{self, Content, UpAxis};
use crate::tiles::error::TilesError;
use crate::tiles::fetch::{Fetcher, resolve};
use crate::tiles::tileset::Tileset;
use boresight_models::tiles::selection::{Cut, SelectOptions, View, fixed_cut, ideal_cut};
use boresight_models::tiles::tree::{TileId, Tree};
use glam::DVec3;

/// The cut that the views ask for, after everything that it needs was expanded. What cannot be read is told by
/// [`Tileset::failures`] and leaves its parent; only a tileset of which nothing can be read is an error.
pub fn settle(
    tileset: &mut Tileset,
    views: &[View],
    options: &SelectOptions,
) -> Result<Cut, TilesError> {
    settle_by(tileset, &|tree| ideal_cut(tree, views, options))
}

/// A fixed level of detail, whatever is on screen: the coarsest tiles of error `error_m` [m] or less that come
/// within `radius_m` [m] of a point of the tree's frame.
pub fn finest(
    tileset: &mut Tileset,
    center_root_m: DVec3,
    radius_m: f64,
    error_m: f64,
) -> Result<Cut, TilesError> {
    settle_by(tileset, &|tree| {
        fixed_cut(tree, center_root_m, radius_m, error_m)
    })
}

/// Expands what a cut needs until it needs no more.
pub fn settle_by(tileset: &mut Tileset, choose: &dyn Fn(&Tree) -> Cut) -> Result<Cut, TilesError> {
    loop {
        let cut = choose(&tileset.tree);
        if cut.unread.is_empty() {
            return match tileset.failures() {
                [(TileId(0), error), ..] if cut.draw.is_empty() => Err(error.clone()),
                _ => Ok(cut),
            };
        }
        for tile in cut.unread {
            // A failure is kept in the tileset; the next cut goes without.
            let _ = tileset.expand(tile);
        }
    }
}

/// All contents of a tile in one, in the tile's frame; numbers of features are made those of the one.
pub fn content(tileset: &Tileset, tile: TileId) -> Result<Content, TilesError> {
    let contents = &tileset.tree.tile(tile).contents;
    content_of(&tileset.fetcher(), contents, tileset.up_axis(tile))
}

/// As [`content`], away from the tileset: on another thread, while it is in use.
pub fn content_of(
    fetcher: &Fetcher,
    contents: &[String],
    up_axis: UpAxis,
) -> Result<Content, TilesError> {
    let mut whole = Content::default();
    for location in contents {
        let bytes = fetcher.read(location)?;
        let fetch = |uri: &str| -> Result<Vec<u8>, String> {
            let location = resolve(location, uri).map_err(|error| error.to_string())?;
            fetcher.read(&location).map_err(|error| error.to_string())
        };
        let part = content::decode(&bytes, up_axis, &fetch);
        let part = part.map_err(|error| TilesError::Content {
            location: location.clone(),
            reason: error.to_string(),
        })?;
        whole.append(part);
    }
    Ok(whole)
}

/// A cut and its contents, tile by tile in the order of [`Cut::draw`]. A tile whose contents cannot be read or decoded
/// is marked as failed, and the cut is chosen again, until all that it draws is there.
pub fn load(
    tileset: &mut Tileset,
    choose: &dyn Fn(&Tree) -> Cut,
) -> Result<Vec<(TileId, Content)>, TilesError> {
    let mut have = std::collections::BTreeMap::new();
    loop {
        let cut = settle_by(tileset, choose)?;
        let mut failed = false;
        for tile in &cut.draw {
            if have.contains_key(tile) {
                continue;
            }
            match content(tileset, *tile) {
                Ok(content) => _ = have.insert(*tile, content),
                Err(error) => {
                    tileset.fail(*tile, error);
                    failed = true;
                }
            }
        }
        if !failed {
            let found = cut.draw.into_iter();
            return Ok(found
                .filter_map(|tile| Some((tile, have.remove(&tile)?)))
                .collect());
        }
    }
}

#[cfg(test)]
mod tests;
