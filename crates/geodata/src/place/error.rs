//! Why a real city cannot be had.

use crate::build::BuildError;
use crate::sources::error::SourceError;
use crate::tiles::error::TilesError;
use crate::tiles::heights::HeightsError;
use boresight_models::ground::survey::SurveyError;
use std::path::PathBuf;

/// Why a real city cannot be had; prints as one line that names the mend.
#[derive(Debug, thiserror::Error)]
pub enum PlaceError {
    /// Tiles that cannot be read.
    #[error("{0}")]
    Tileset(TilesError),
    /// Nothing near the site.
    #[error("{0}")]
    Survey(SurveyError),
    /// Damaged heights beside the tiles.
    #[error("{0}: {1}")]
    Heights(String, HeightsError),
    /// More triangles than memory is planned for.
    #[error(
        "has more than {most} triangles at detail_m = {detail_m} within radius_m = {radius_m}; raise the one or lower \
         the other"
    )]
    TooMany {
        /// How many there may be.
        most: usize,
        /// Error of the shape [m].
        detail_m: f64,
        /// Half the square's side [m].
        radius_m: f64,
    },
    /// A placement for tiles that have theirs.
    #[error("the tileset is placed on the Earth already; leave {0} out")]
    Placed(&'static str),
    /// A source that cannot be read.
    #[error("{0}")]
    Source(SourceError),
    /// Sources too large to build at the start of a run.
    #[error(
        "{triangles} triangles are more than {most}; build them apart with boresight tiles build, and name the tileset"
    )]
    TooLarge {
        /// How many there are.
        triangles: usize,
        /// How many there may be.
        most: usize,
    },
    /// Tiles that cannot be built.
    #[error("{0}")]
    Build(BuildError),
    /// A folder that cannot be written.
    #[error("{}: {source}; set BORESIGHT_CACHE to a folder that can be written", folder.display())]
    Cache {
        /// The folder.
        folder: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Parameters of a placement.
    #[error("{0}")]
    Georef(SourceError),
    /// The land around.
    #[error("{0}")]
    Horizon(SourceError),
}

impl PlaceError {
    /// The key of `[city]` that it is about.
    pub fn key(&self, tileset: bool) -> &'static str {
        match self {
            Self::Placed(key) => key,
            Self::Georef(_) => "georef",
            Self::Horizon(_) => "horizon",
            Self::TooMany { .. } => "detail_m",
            _ if tileset => "tileset",
            _ => "sources",
        }
    }
}
