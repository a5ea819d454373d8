//! What a build says of itself, and why it cannot be done.

use boresight_common::output::OutputError;
use std::path::PathBuf;

/// Why tiles cannot be built; each prints as one line that says what to do about it.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    /// A file that cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Layers without a triangle.
    #[error("the sources hold no triangles; give a source with a surface")]
    Empty,
    /// A coordinate that is no number, or too far from the site.
    #[error(
        "layer {layer}, mesh {mesh}: vertex {vertex} lies {distance_m:.0} m from the site, farther than {limit_m:.0} m; \
         check the source's coordinate system (--crs) or its placement (--georef)"
    )]
    Far {
        /// Which layer, from 0.
        layer: usize,
        /// Which of its meshes, from 0.
        mesh: usize,
        /// Which of its vertices, from 0.
        vertex: usize,
        /// How far [m].
        distance_m: f64,
        /// How far one may be [m].
        limit_m: f64,
    },
    /// A mesh whose lists do not fit each other.
    #[error("layer {layer}, mesh {mesh}: {what}; the source is damaged: export it again")]
    Mesh {
        /// Which layer, from 0.
        layer: usize,
        /// Which of its meshes, from 0.
        mesh: usize,
        /// What is wrong.
        what: &'static str,
    },
    /// An option outside its range.
    #[error("{option} = {value} is out of range; give a value from {low} to {high}")]
    Option {
        /// The option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// The least that is allowed.
        low: f64,
        /// The most that is allowed.
        high: f64,
    },
    /// A texture that cannot be stored.
    #[error("texture of {}: {what}; try --pictures png", path.display())]
    Picture {
        /// The tile's content.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// Indices or vertices that cannot be compressed.
    #[error("{}: {what}; leave out --meshopt", path.display())]
    Compression {
        /// The tile's content.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
}

/// The tiles of one level, the root's being 0.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct LevelReport {
    /// Tiles with content.
    pub tiles: usize,
    /// Triangles of them.
    pub triangles: usize,
    /// Of the tiles that have children: share of the children's triangles that they keep; 0 without such tiles.
    pub share: f64,
    /// Largest geometric error [m].
    pub error_m: f64,
    /// Bytes of contents.
    pub bytes: u64,
}

/// What was built.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct BuildReport {
    /// Triangles of the layers.
    pub triangles_in: usize,
    /// Triangles of all tiles.
    pub triangles_out: usize,
    /// The levels, root first.
    pub levels: Vec<LevelReport>,
    /// Bytes of all files.
    pub bytes: u64,
    /// Features with properties.
    pub features: usize,
    /// Side of the lattice that vertices are rounded to [m].
    pub lattice_m: f64,
}

impl BuildReport {
    /// Tiles with content.
    pub fn tiles(&self) -> usize {
        self.levels.iter().map(|level| level.tiles).sum()
    }
}
