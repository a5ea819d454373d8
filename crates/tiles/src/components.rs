//! Tilesets in a scene: which, how they are loaded, and what of them is there.

use bevy::camera::primitives::Aabb;
use bevy::camera::visibility::RenderLayers;
use bevy::prelude::*;
use bevy::tasks::Task;
use boresight_geodata::tiles::error::TilesError;
use boresight_geodata::tiles::expansion::Expansion;
use boresight_geodata::tiles::tileset::Tileset;
pub use boresight_models::shape::textured::TilesLight;
use boresight_models::tiles::selection::{Occluder, SelectOptions, View};
use boresight_models::tiles::selector::Selector;
use boresight_models::tiles::tree::TileId;
use glam::{DAffine3, DVec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A tileset to be shown. Its tiles become children of the entity that has this; where that entity is also a
/// big_space grid, they lie in the grid's cells, so that f32 appears only relative to a cell. Without a grid they have
/// a plain transform, which is right for what is near the entity.
#[derive(Component, Clone, Debug)]
#[require(TilesViews, TilesCount, Transform, Visibility)]
pub struct Tiles {
    /// A `tileset.json`, a folder with one, a `.3tz` archive, or an address.
    pub location: String,
    /// Where it stands.
    pub place: TilesPlace,
    /// How fine, and whether what no camera sees is left out.
    pub select: SelectOptions,
    /// Most bytes of meshes and textures that are kept. What is drawn is kept in any case: streaming then
    /// chooses coarser tiles, settled loading does not.
    pub byte_budget: u64,
    /// When what is missing is loaded.
    pub mode: TilesMode,
    /// Whether it is lit again.
    pub light: TilesLight,
    /// Tiles that are read and decoded at the same time; what is drawn in the end does not depend on it.
    pub at_once: usize,
    /// Which cameras draw it.
    pub layers: RenderLayers,
}

impl Tiles {
    /// A tileset with the defaults: streamed, 16 px, 1 GiB, light as the file says, centred.
    pub fn new(location: impl Into<String>) -> Self {
        Self {
            location: location.into(),
            place: TilesPlace::Centred,
            select: SelectOptions::default(),
            byte_budget: 1 << 30,
            mode: TilesMode::Streamed,
            light: TilesLight::AsStored,
            at_once: 4,
            layers: RenderLayers::default(),
        }
    }
}

/// Where a tileset stands about its entity, whose axes are x east, y north, z up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TilesPlace {
    /// With the middle of its root at the entity; an earth-centred one with its east, north and up there.
    Centred,
    /// By a transform from the tileset's root frame (earth-centred for georeferenced ones) to the entity's [m].
    At(DAffine3),
}

/// When what a tileset lacks is loaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TilesMode {
    /// By other threads, the most urgent first, while coarser tiles stay in its place: for windows.
    Streamed,
    /// At once: a frame waits until all that its cameras ask for is there. The same triangles on every
    /// machine: for recordings, data sets and tests.
    Settled,
}

/// How a surface of a tile is drawn. Colours of its vertices, where it has any, tint it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TileSurface {
    /// Whether its colours have the light in them, so that it is not lit again. Without this, sun and sky
    /// light its albedo, for which it needs normals.
    pub baked: bool,
    /// Whether there is a picture on it.
    pub picture: bool,
    /// Whether its back is seen too.
    pub two_sided: bool,
    /// Where its alpha is below this, in 255ths, there is a hole.
    pub cutoff: Option<u8>,
}

/// Makes materials for tiles of an application's own: a resource. [`StandardPaint`] makes Bevy's.
pub trait TilePaint: Resource + Clone {
    /// The material.
    type Material: Material;

    /// The material of a surface with its picture.
    fn paint(&self, surface: TileSurface, picture: Option<Handle<Image>>) -> Self::Material;
}

/// Tiles in Bevy's own material: unlit where light is baked in.
#[derive(Resource, Clone, Copy, Debug, Default)]
pub struct StandardPaint;

/// Marks cameras that tilesets are loaded for.
#[derive(Component, Clone, Copy, Debug, Default)]
pub struct SeesTiles;

/// What looks at a tileset now, in its root frame: of the cameras with [`SeesTiles`], written before each
/// selection, or whatever an application puts there that has no such camera.
#[derive(Component, Clone, Debug, Default, PartialEq)]
pub struct TilesViews(pub Vec<View>);

/// Knows what is hidden from the views of a streamed tileset, beside whose [`Tiles`] it stands: that is neither loaded nor
/// drawn. Settled tilesets take none: what they show is a function of tileset and views.
#[derive(Component, Clone)]
pub struct TilesOccluder(pub Arc<dyn Occluder + Send + Sync>);

/// What of a tileset is there.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TilesCount {
    /// Tiles that are drawn.
    pub drawn: usize,
    /// Triangles of these.
    pub triangles: usize,
    /// Tiles that are kept, drawn or not.
    pub kept: usize,
    /// Bytes of meshes and textures that are kept.
    pub bytes: u64,
    /// Tiles that are asked for and not there yet.
    pub missing: usize,
    /// Tiles whose parents are drawn because they cannot be read.
    pub failed: usize,
}

/// A tile was loaded.
#[derive(Message, Clone, Debug)]
pub struct TileLoaded {
    /// The entity with [`Tiles`].
    pub tileset: Entity,
    /// Which tile.
    pub tile: TileId,
}

/// A tile, or a whole tileset, cannot be read. Told once; the tile's parent is drawn in its place.
#[derive(Message, Clone, Debug)]
pub struct TileFailed {
    /// The entity with [`Tiles`].
    pub tileset: Entity,
    /// Which tile; the root if nothing can be read.
    pub tile: TileId,
    /// Why.
    pub error: String,
}

/// A tile's content, ready for the GPU.
#[derive(Clone, Debug, Default)]
pub struct PreparedTile {
    /// Its meshes.
    pub parts: Vec<TilePart>,
    /// Its pictures.
    pub pictures: Vec<Image>,
    /// Triangles of all parts at all their places.
    pub triangles: usize,
    /// Bytes of meshes and pictures.
    pub bytes: u64,
}

/// Meshes of one look, in one.
#[derive(Clone, Debug)]
pub struct TilePart {
    /// The mesh.
    pub mesh: Mesh,
    /// Its bounds.
    pub bounds: Aabb,
    /// How it is drawn.
    pub surface: TileSurface,
    /// Its picture's number in [`PreparedTile::pictures`].
    pub picture: Option<usize>,
    /// Where it stands in the frame of the tileset's entity: origin [m], rotation and scale.
    pub places: Vec<(DVec3, Quat, Vec3)>,
}

/// A tile that is there.
#[derive(Clone, Debug, Default)]
pub struct KeptTile {
    /// What draws it.
    pub entities: Vec<Entity>,
    /// Its triangles.
    pub triangles: usize,
    /// Its bytes.
    pub bytes: u64,
    /// Whether it is drawn.
    pub drawn: bool,
    /// When it was drawn last, in selections.
    pub drawn_at: u64,
}

/// A tileset that was opened, and its tiles.
#[derive(Component, Clone, Debug)]
pub struct OpenTiles {
    /// The tree, as far as it is known.
    pub tileset: Tileset,
    /// From the root frame to the entity's [m].
    pub entity_from_root_m: DAffine3,
    /// The tiles that are there.
    pub kept: BTreeMap<TileId, KeptTile>,
    /// Selections so far.
    pub selections: u64,
    /// Views and answer of the last selection of settled loading.
    pub settled: Option<(Vec<View>, Vec<TileId>)>,
    /// Failures told so far.
    pub told: usize,
}

/// A tileset that is being opened on another thread.
#[derive(Component, Debug)]
pub struct OpeningTiles(pub Task<Result<Tileset, TilesError>>);

/// What streamed loading keeps from frame to frame.
#[derive(Component, Debug)]
pub struct StreamedTiles {
    /// Chooses what is drawn, loaded and dropped.
    pub selector: Selector,
    /// What is being read.
    pub pending: BTreeMap<TileId, Task<Arrived>>,
}

/// What another thread has read.
#[derive(Debug)]
pub enum Arrived {
    /// More of the tree.
    Branch(Box<Result<Expansion, TilesError>>),
    /// A content.
    Content(Box<Result<PreparedTile, TilesError>>),
}
