//! Why a real city cannot be had.

use crate::models::ground::survey::SurveyError;
use crate::tiles::error::TilesError;
use crate::tiles::heights::HeightsError;

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
        "has more than {most} triangles at detail_m = {detail_m} within radius_m = {radius_m}: raise the one or lower \
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
    #[error("the tileset is placed on the Earth already: leave {0} out")]
    Placed(&'static str),
    /// Raw data.
    #[error("raw data are not built yet: build them with boresight tiles build, and name the tileset")]
    NoSources,
    /// Parameters of a placement.
    #[error("parameters of boresight georef are not read yet: give origin_enu_m")]
    NoGeoref,
}

impl PlaceError {
    /// The key of `[city]` that it is about.
    pub fn key(&self, tileset: bool) -> &'static str {
        match self {
            Self::Placed(key) => key,
            Self::NoGeoref => "georef",
            Self::TooMany { .. } => "detail_m",
            _ if tileset => "tileset",
            _ => "sources",
        }
    }
}
