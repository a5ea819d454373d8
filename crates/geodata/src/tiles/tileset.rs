//! A tileset: its tree, and how the rest of it is read.

use crate::tiles::content::UpAxis;
use crate::tiles::error::TilesError;
use crate::tiles::expansion::{Expansion, Facts, Loose, TilesetFile, Wait};
use crate::tiles::fetch::{Fetcher, is_address};
use crate::tiles::read::{Above, MOST_LEVELS, tileset};
use crate::tiles::subtree::{contradictions, subtree};
use boresight_models::tiles::tree::{Refine, TileId, Tree};
use glam::DAffine3;
use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;
use std::path::Path;

/// The most tiles that are kept of one tileset.
const MOST_TILES: usize = 8 << 20;
/// How often a tileset may lead to another.
const MOST_FILES_DEEP: usize = 64;

/// A tileset, as far as it was read.
#[derive(Clone, Debug)]
pub struct Tileset {
    /// Its tiles.
    pub tree: Tree,
    fetcher: Fetcher,
    files: Vec<TilesetFile>,
    /// The file of each tile.
    file_of: Vec<u32>,
    waiting: BTreeMap<TileId, Wait>,
    facts: BTreeMap<TileId, Facts>,
    failures: Vec<(TileId, TilesError)>,
}

impl Tileset {
    /// Reads the first file of a tileset: a `tileset.json`, a folder with one, a `.3tz` or `.zip` archive, or an
    /// address.
    pub fn open(location: &str) -> Result<Self, TilesError> {
        Self::open_with(location, Fetcher::default())
    }

    /// The same, read with a fetcher of the caller's.
    pub fn open_with(location: &str, fetcher: Fetcher) -> Result<Self, TilesError> {
        let location = first_file(location)?;
        let bytes = fetcher.read(&location)?;
        let above = Above {
            to_root_m: DAffine3::IDENTITY,
            refine: Refine::Replace,
            depth: 0,
            up_axis: UpAxis::Y,
        };
        let mut read = self::tileset(&fetcher, &location, &bytes, above)?;
        let mut new = Self {
            tree: Tree::default(),
            fetcher,
            files: read.file.take().into_iter().collect(),
            file_of: Vec::new(),
            waiting: BTreeMap::new(),
            facts: BTreeMap::new(),
            failures: Vec::new(),
        };
        let (root, rest) = match read.tiles.split_first_mut() {
            Some((root, rest)) => (root, rest.iter_mut()),
            None => return Ok(new),
        };
        let children = root.children.clone();
        new.tree = Tree::new(root.tile.clone());
        new.note(TileId(0), 0, root);
        let mut tiles: Vec<Option<Loose>> = rest.map(|loose| Some(loose.clone())).collect();
        tiles.insert(0, None);
        new.graft(TileId(0), 0, tiles, children);
        Ok(new)
    }

    /// Reads what a tile waits for ([`boresight_models::tiles::tree::Tile::unread`]) and adds it to the tree. A failure
    /// marks the tile as failed, so that its parent stays, and is told here and kept among the [`Tileset::failures`].
    /// A tile that waits for nothing stays as it is.
    pub fn expand(&mut self, tile: TileId) -> Result<(), TilesError> {
        let Some(request) = self.request(tile) else {
            return Ok(());
        };
        let read = request.read();
        self.adopt(tile, read)
    }

    /// What is to be read of a tile that waits; reading it takes no tileset, so another thread may.
    /// `None` where the tile waits for nothing.
    pub fn request(&self, tile: TileId) -> Option<Request> {
        let wait = self.waiting.get(&tile)?.clone();
        let waiting = self.tree.tile(tile);
        let file = self.file_of[tile.index()] as usize;
        let above = std::iter::successors(Some(file), |i| self.files[*i].parent);
        Some(Request {
            fetcher: self.fetcher.clone(),
            location: waiting.unread.clone()?,
            wait,
            above: Above {
                to_root_m: waiting.to_root_m,
                refine: waiting.refine,
                depth: self.tree.depth(tile) + 1,
                up_axis: self.files[file].up_axis,
            },
            files: above.map(|i| self.files[i].location.clone()).collect(),
        })
    }

    /// Adds what a [`Request`] read, as [`Tileset::expand`] does.
    pub fn adopt(
        &mut self,
        tile: TileId,
        read: Result<Expansion, TilesError>,
    ) -> Result<(), TilesError> {
        if self.waiting.remove(&tile).is_none() {
            return Ok(());
        }
        let full = |read: &Expansion| self.tree.tiles().len() + read.tiles.len() > MOST_TILES;
        let read = match read {
            Ok(read) if full(&read) => Err(TilesError::Fetch {
                location: self.tree.tile(tile).unread.clone().unwrap_or_default(),
                reason: format!("the tileset has more than {MOST_TILES} tiles; split it"),
            }),
            read => read,
        };
        let mut read = match read {
            Ok(read) => read,
            Err(error) => {
                self.fail(tile, error.clone());
                return Err(error);
            }
        };
        let mut file = self.file_of[tile.index()];
        if let Some(new) = read.file.take() {
            let parent = Some(file as usize);
            file = self.files.len() as u32;
            self.files.push(TilesetFile { parent, ..new });
        }
        self.tree.unfold(tile, std::mem::take(&mut read.contents));
        if !read.facts.is_empty() {
            self.facts.insert(tile, read.facts);
        }
        let tiles = read.tiles.into_iter().map(Some).collect();
        self.graft(tile, file, tiles, read.roots);
        Ok(())
    }

    /// Adds tiles below one of the tree, level by level.
    fn graft(
        &mut self,
        below: TileId,
        file: u32,
        mut tiles: Vec<Option<Loose>>,
        roots: Range<usize>,
    ) {
        let mut waiting = VecDeque::from([(below, roots)]);
        while let Some((parent, range)) = waiting.pop_front() {
            let children = tiles.get_mut(range).unwrap_or_default();
            let mut children: Vec<Loose> = children.iter_mut().filter_map(Option::take).collect();
            let placed = children.iter().map(|child| child.tile.clone()).collect();
            let places = self.tree.add_children(parent, placed);
            for (place, child) in places.zip(&mut children) {
                let id = TileId(place);
                self.note(id, file, child);
                if !child.children.is_empty() {
                    waiting.push_back((id, child.children.clone()));
                }
            }
        }
    }

    /// Keeps what is known of a new tile beside its shape.
    fn note(&mut self, id: TileId, file: u32, loose: &mut Loose) {
        self.file_of.resize(id.index() + 1, file);
        if loose.always {
            self.tree.always_refine(id);
        }
        if let Some(wait) = loose.wait.take() {
            self.waiting.insert(id, wait);
        }
        if !loose.facts.is_empty() {
            self.facts.insert(id, std::mem::take(&mut loose.facts));
        }
    }

    /// Notes that a tile cannot be shown, so that its parent is drawn in its place; a second time is not noted.
    pub fn fail(&mut self, tile: TileId, error: TilesError) {
        if !self.tree.failed(tile) {
            self.waiting.remove(&tile);
            self.tree.fail(tile);
            self.failures.push((tile, error));
        }
    }

    /// What could not be read so far, each once, in the order of failing.
    pub fn failures(&self) -> &[(TileId, TilesError)] {
        &self.failures
    }

    /// What its files are read with.
    pub fn fetcher(&self) -> Fetcher {
        self.fetcher.clone()
    }

    /// The files with tilesets that were read, the first one first.
    pub fn files(&self) -> &[TilesetFile] {
        &self.files
    }

    /// The file that a tile stands in.
    pub fn file(&self, tile: TileId) -> &TilesetFile {
        &self.files[self.file_of[tile.index()] as usize]
    }

    /// Metadata and groups of a tile, where it has any.
    pub fn facts(&self, tile: TileId) -> Option<&Facts> {
        self.facts.get(&tile)
    }

    /// Which axis of a tile's glTF points up.
    pub fn up_axis(&self, tile: TileId) -> UpAxis {
        self.file(tile).up_axis
    }
}

/// What is to be read for a tile; owns all that reading needs.
#[derive(Clone, Debug)]
pub struct Request {
    fetcher: Fetcher,
    location: String,
    wait: Wait,
    above: Above,
    /// The files that lead here, the nearest first.
    files: Vec<String>,
}

impl Request {
    /// Fetches and reads it.
    pub fn read(&self) -> Result<Expansion, TilesError> {
        let fault = |fault: &str| TilesError::Format {
            location: self.files.first().cloned().unwrap_or_default(),
            place: format!("reference to {}", self.location),
            fault: fault.into(),
        };
        if self.above.depth > MOST_LEVELS || self.files.len() > MOST_FILES_DEEP {
            return Err(fault("leads too deep; make the tree flatter"));
        }
        match &self.wait {
            Wait::Tileset => {
                let location = first_file(&self.location)?;
                if self.files.contains(&location) {
                    return Err(fault(
                        "leads back to a tileset that it stands in; take it out",
                    ));
                }
                let bytes = self.fetcher.read(&location)?;
                tileset(&self.fetcher, &location, &bytes, self.above)
            }
            Wait::Subtree(tiling, place) => {
                let bytes = self.fetcher.read(&self.location)?;
                subtree(&self.fetcher, &self.location, &bytes, tiling, *place)
            }
        }
    }
}

impl Request {
    /// What contradicts itself in what is to be read, where it is a subtree that can be read; tilesets have rules of their own.
    pub(super) fn contradictions(&self) -> Vec<TilesError> {
        let Wait::Subtree(tiling, _) = &self.wait else {
            return Vec::new();
        };
        let bytes = self.fetcher.read(&self.location);
        let found =
            bytes.and_then(|bytes| contradictions(&self.fetcher, &self.location, &bytes, tiling));
        // What cannot be read is told where it is read.
        found.unwrap_or_default()
    }
}

/// The file that a location of a tileset means.
fn first_file(location: &str) -> Result<String, TilesError> {
    let path = Path::new(location);
    let end = path.extension().and_then(|end| end.to_str()).unwrap_or("");
    let end = end.to_ascii_lowercase();
    let unsupported = |what: &str, mend: &str| TilesError::Unsupported {
        location: location.into(),
        what: what.into(),
        mend: mend.into(),
    };
    if end == "3dtiles" {
        return Err(unsupported(
            "a .3dtiles package (SQLite)",
            "convert it to .3tz or to a folder",
        ));
    }
    if is_address(location) {
        return match &end[..] {
            "3tz" | "zip" => Err(unsupported("an archive on a network", "fetch it to a file")),
            _ if location.ends_with('/') => Ok(format!("{location}tileset.json")),
            _ => Ok(location.into()),
        };
    }
    let packed = ["3tz", "zip"].contains(&&end[..]) && path.is_file();
    if packed || path.is_dir() {
        let first = path.join("tileset.json");
        return Ok(first.to_str().unwrap_or(location).into());
    }
    Ok(location.into())
}

#[cfg(test)]
mod tests;
