//! The tree of tiles, as it is known so far.

use crate::tiles::volume::{BoundingVolume, Bounds, largest_scale};
use glam::{DAffine3, DVec3};
use std::ops::Range;

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

impl TileId {
    /// Its place among [`Tree::tiles`].
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// A tile.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
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
    /// What has to be read before its children, and its contents where it roots a subtree of implicit tiles, are
    /// known: the location of an external tileset or of a subtree. Only [`Tree::unfold`] changes it.
    pub unread: Option<String>,
}

/// What selection reads of a tile, apart from the rest so that a walk stays in the cache.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Node {
    /// Middle of the volume in the tree's frame [m].
    pub center_m: DVec3,
    /// Radius of the ball around it [m].
    pub radius_m: f64,
    /// The geometric error in the tree's frame [m].
    pub error_m: f64,
    /// The parent, and the root itself for the root.
    pub parent: u32,
    /// The first child and their number.
    pub children: [u32; 2],
    /// How children show more.
    pub refine: Refine,
    /// Whether it has contents.
    pub content: bool,
    /// Whether something must be read first.
    pub unread: bool,
    /// Whether it refines however small its error is.
    pub always: bool,
    /// Whether a viewer request volume is to be asked.
    pub request: bool,
    /// Whether it could not be read.
    pub failed: bool,
}

impl Node {
    /// The places of its children.
    pub fn child_range(&self) -> Range<usize> {
        let [first, count] = self.children.map(|n| n as usize);
        first..first + count
    }
}

/// The tiles of a tileset, those read so far. The root is the first; a parent stands before its children, and the
/// children of one tile stand side by side.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tree {
    tiles: Vec<Tile>,
    nodes: Vec<Node>,
    bounds: Vec<Bounds>,
}

impl Tree {
    /// A tree of one tile.
    pub fn new(root: Tile) -> Self {
        let mut tree = Self::default();
        tree.push(None, root);
        tree
    }

    /// The root; `None` for a tree that nothing was read into.
    pub fn root(&self) -> Option<TileId> {
        (!self.tiles.is_empty()).then_some(TileId(0))
    }

    /// All tiles; the place of one is its [`TileId`].
    pub fn tiles(&self) -> &[Tile] {
        &self.tiles
    }

    /// A tile of this tree.
    pub fn tile(&self, id: TileId) -> &Tile {
        &self.tiles[id.index()]
    }

    /// The tile that it refines; `None` for the root.
    pub fn parent(&self, id: TileId) -> Option<TileId> {
        (id.0 > 0).then(|| TileId(self.nodes[id.index()].parent))
    }

    /// Its children, in the file's order.
    pub fn children(&self, id: TileId) -> impl DoubleEndedIterator<Item = TileId> + use<> {
        self.child_range(id).map(TileId)
    }

    /// The tile's volume in the tree's frame.
    pub fn bounds(&self, id: TileId) -> &Bounds {
        &self.bounds[id.index()]
    }

    /// The tile's geometric error in the tree's frame [m]: scaled with the largest scale of its transform.
    pub fn error_m(&self, id: TileId) -> f64 {
        self.nodes[id.index()].error_m
    }

    /// How many tiles stand above it.
    pub fn depth(&self, id: TileId) -> usize {
        std::iter::successors(Some(id), |id| self.parent(*id)).count() - 1
    }

    /// Whether it could not be read: [`Tree::fail`].
    pub fn failed(&self, id: TileId) -> bool {
        self.nodes[id.index()].failed
    }

    /// Marks a tile as one that cannot be read: its parent is drawn in its place, and it is asked for no more.
    pub fn fail(&mut self, id: TileId) {
        let node = &mut self.nodes[id.index()];
        (node.failed, node.unread) = (true, false);
        self.tiles[id.index()].unread = None;
    }

    /// Gives a tile that has none its children, side by side; their place.
    pub fn add_children(&mut self, parent: TileId, children: Vec<Tile>) -> Range<u32> {
        let first = self.tiles.len() as u32;
        if !self.child_range(parent).is_empty() || children.is_empty() {
            return first..first;
        }
        self.nodes[parent.index()].children = [first, children.len() as u32];
        for child in children {
            self.push(Some(parent), child);
        }
        first..self.tiles.len() as u32
    }

    /// Notes that what a tile waited for was read: its contents are known, and so are soon its children.
    pub fn unfold(&mut self, id: TileId, contents: Vec<String>) {
        let (tile, node) = (&mut self.tiles[id.index()], &mut self.nodes[id.index()]);
        (tile.unread, node.unread) = (None, false);
        node.content = !contents.is_empty();
        tile.contents = contents;
    }

    /// Lets a tile refine however small its error: one that only leads to an external tileset.
    pub fn always_refine(&mut self, id: TileId) {
        self.nodes[id.index()].always = true;
    }

    pub(super) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    fn child_range(&self, id: TileId) -> Range<u32> {
        let [first, count] = self.nodes[id.index()].children;
        first..first + count
    }

    fn push(&mut self, parent: Option<TileId>, tile: Tile) {
        let error_m = tile.geometric_error_m * largest_scale(&tile.to_root_m);
        let above_m = parent.map_or(f64::INFINITY, |id| self.error_m(id));
        let bounds = Bounds::of(&tile.volume, &tile.to_root_m);
        self.bounds.push(bounds);
        self.nodes.push(Node {
            center_m: bounds.center_m,
            radius_m: bounds.radius_m(),
            error_m,
            parent: parent.map_or(0, |id| id.0),
            children: [0; 2],
            refine: tile.refine,
            content: !tile.contents.is_empty(),
            unread: tile.unread.is_some(),
            always: error_m > above_m,
            request: tile.viewer_request_volume.is_some(),
            failed: false,
        });
        self.tiles.push(tile);
    }
}
