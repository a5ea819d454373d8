//! A tileset: its tree, and how the rest of it is read.

use crate::models::tiles::tree::{TileId, Tree};
use crate::tiles::content::UpAxis;
use crate::tiles::error::TilesError;
use crate::tiles::fetch::Fetcher;

/// A tileset, as far as it was read.
#[derive(Clone, Debug)]
pub struct Tileset {
    /// Its tiles.
    pub tree: Tree,
    fetcher: Fetcher,
    failures: Vec<(TileId, TilesError)>,
}

impl Tileset {
    /// Reads the first file of a tileset: a `tileset.json`, a folder with one, a `.3tz` archive, or an address.
    pub fn open(location: &str) -> Result<Self, TilesError> {
        Err(TilesError::Fetch {
            location: location.into(),
            reason: "tilesets are not read yet".into(),
        })
    }

    /// Reads what a tile waits for ([`crate::models::tiles::tree::Tile::unread`]) and adds it to the tree. A failure marks the tile
    /// as failed, so that its parent stays, and is told here alone. A tile that waits for nothing stays as it is.
    pub fn expand(&mut self, tile: TileId) -> Result<(), TilesError> {
        let _ = tile;
        Ok(())
    }

    /// What is read of it, away from the tree: on another thread, while the tree is in use. `None` where the tile waits for nothing.
    pub fn request(&self, tile: TileId) -> Option<Request> {
        let _ = tile;
        None
    }

    /// Adds what a [`Request`] read, as [`Tileset::expand`] does.
    pub fn adopt(
        &mut self,
        tile: TileId,
        read: Result<Expansion, TilesError>,
    ) -> Result<(), TilesError> {
        let _ = tile;
        read.map(|_| ())
    }

    /// Notes that a tile cannot be shown, so that its parent is drawn in its place.
    pub fn fail(&mut self, tile: TileId, error: TilesError) {
        self.tree.fail(tile);
        self.failures.push((tile, error));
    }

    /// What could not be read so far, each once, in the order of failing.
    pub fn failures(&self) -> &[(TileId, TilesError)] {
        &self.failures
    }

    /// What its files are read with.
    pub fn fetcher(&self) -> Fetcher {
        self.fetcher.clone()
    }

    /// Which axis of a tile's glTF points up.
    pub fn up_axis(&self, tile: TileId) -> UpAxis {
        let _ = tile;
        UpAxis::Y
    }
}

/// What is to be read for a tile; owns all that reading needs.
#[derive(Clone, Debug)]
pub struct Request {}

impl Request {
    /// Fetches and reads it.
    pub fn read(&self) -> Result<Expansion, TilesError> {
        Ok(Expansion {})
    }
}

/// What was read for a tile.
#[derive(Clone, Debug)]
pub struct Expansion {}
