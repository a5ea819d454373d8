//! The tree of tiles, as it is known so far.

use crate::models::tiles::volume::BoundingVolume;
use glam::DAffine3;

/// How a tile's children show more of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refine {
    /// They are drawn in its place.
    Replace,
    /// They are drawn beside it.
    Add,
}

/// Which tile of a [`Tree`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TileId(pub u32);

/// A tile.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// The tile that it refines; `None` for the root.
    pub parent: Option<TileId>,
    /// Where its descendants and itself lie, in the tile's frame.
    pub volume: BoundingVolume,
    /// A viewer outside this does not see it at all.
    pub viewer_request_volume: Option<BoundingVolume>,
    /// Error of the shape where its children are not drawn, in the tile's frame [m].
    pub geometric_error_m: f64,
    /// How its children show more.
    pub refine: Refine,
    /// From the tile's frame to the tree's (earth-centred for georeferenced data): the product of all transforms above.
    pub to_root_m: DAffine3,
    /// Where its contents are read: absolute locations.
    pub contents: Vec<String>,
    /// Its children, in the file's order.
    pub children: Vec<TileId>,
    /// What has to be read before children are known: an external tileset or a subtree of implicit tiles.
    pub unread: Option<String>,
}

/// The tiles of a tileset, those read so far. The root is the first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tree {
    /// All of them; a parent stands before its children.
    pub tiles: Vec<Tile>,
}
