//! What was read for a tile, before it is in a tree.

use crate::tiles::content::UpAxis;
use boresight_models::tiles::implicit::{Coordinates, Scheme};
use boresight_models::tiles::tree::{Refine, Tile};
use boresight_models::tiles::volume::BoundingVolume;
use glam::DAffine3;
use serde_json::Value;
use std::ops::Range;
use std::sync::Arc;

/// Tiles that were read, ready to be added below the tile that waited for them.
#[derive(Clone, Debug, Default)]
pub struct Expansion {
    /// Level by level; the children of one tile stand side by side.
    pub(super) tiles: Vec<Loose>,
    /// Which of them are children of the tile that waited.
    pub(super) roots: Range<usize>,
    /// Contents of the tile that waited: known only now where it roots a subtree.
    pub(super) contents: Vec<String>,
    /// What else is known of it.
    pub(super) facts: Facts,
    /// The file, where it is a tileset of its own.
    pub(super) file: Option<TilesetFile>,
}

/// A tile without a place in a tree.
#[derive(Clone, Debug)]
pub(super) struct Loose {
    pub tile: Tile,
    pub children: Range<usize>,
    /// What [`Tile::unread`] is.
    pub wait: Option<Wait>,
    /// Whether it only leads to an external tileset.
    pub always: bool,
    pub facts: Facts,
}

impl Loose {
    pub(super) fn new(tile: Tile) -> Self {
        Self {
            tile,
            children: 0..0,
            wait: None,
            always: false,
            facts: Facts::default(),
        }
    }

    /// Takes contents in: external tilesets among them are left over where they need tiles of their own.
    pub(super) fn take_contents(&mut self, contents: Vec<String>, children: bool) -> Vec<String> {
        let (mut external, plain): (Vec<_>, Vec<_>) =
            contents.into_iter().partition(|uri| is_tileset(uri));
        self.tile.contents = plain;
        if external.is_empty() {
            return external;
        }
        self.always = self.tile.contents.is_empty();
        if external.len() == 1 && self.always && !children {
            self.tile.unread = external.pop();
            self.wait = Some(Wait::Tileset);
        }
        external
    }

    /// A tile below this one that only leads to an external tileset.
    pub(super) fn leading_to(&self, external: String) -> Self {
        let mut tile = Tile {
            contents: Vec::new(),
            unread: Some(external),
            ..self.tile.clone()
        };
        tile.viewer_request_volume = None;
        Self {
            wait: Some(Wait::Tileset),
            always: true,
            ..Self::new(tile)
        }
    }
}

/// Whether a content is a tileset of its own, as its name tells.
pub(super) fn is_tileset(uri: &str) -> bool {
    let path = uri.split(['?', '#']).next().unwrap_or(uri);
    let path = path.to_ascii_lowercase();
    path.ends_with(".json") || path.ends_with(".3tz")
}

/// What a tile waits for.
#[derive(Clone, Debug)]
pub(super) enum Wait {
    /// An external tileset.
    Tileset,
    /// The subtree of a tiling that the tile roots.
    Subtree(Arc<Tiling>, Coordinates),
}

/// An implicit tiling, as its root tile describes it.
#[derive(Clone, Debug)]
pub(super) struct Tiling {
    pub scheme: Scheme,
    pub subtree_levels: u32,
    pub available_levels: u32,
    /// The file that its references lie beside.
    pub base: String,
    pub subtrees: String,
    pub contents: Vec<String>,
    pub volume: BoundingVolume,
    pub error_m: f64,
    pub refine: Refine,
    pub to_root_m: DAffine3,
    /// Classes of its metadata.
    pub schema: Option<Arc<Value>>,
}

/// What is known of a tile beside its shape.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facts {
    /// Its metadata: class and properties.
    pub metadata: Option<Value>,
    /// The groups that its contents belong to.
    pub groups: Vec<u64>,
}

impl Facts {
    pub(super) fn is_empty(&self) -> bool {
        self.metadata.is_none() && self.groups.is_empty()
    }
}

/// One file with a tileset.
#[derive(Clone, Debug, PartialEq)]
pub struct TilesetFile {
    /// Where it lies.
    pub location: String,
    /// The file that refers to it, by its number.
    pub parent: Option<usize>,
    /// Version of its format: 1.0 or 1.1.
    pub version: String,
    /// Which axis of its glTF points up; an external tileset that does not say has that of its parent.
    pub up_axis: UpAxis,
    /// Its metadata, and those of its groups: class and properties.
    pub metadata: Option<Value>,
    /// Metadata of its groups of contents.
    pub groups: Vec<Value>,
    /// The schema of its metadata.
    pub schema: Option<Arc<Value>>,
    /// Extensions that it uses.
    pub extensions: Vec<String>,
}
