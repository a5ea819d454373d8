//! What is asked of a build.

use super::report::BuildError;
use std::num::NonZeroUsize;

/// How cells are cut into smaller ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Division {
    /// Into four on the map: terrain and cities.
    #[default]
    Quadtree,
    /// Into eight: what is as high as it is wide.
    Octree,
}

/// How textures are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Pictures {
    /// JPEG, but PNG where there are holes or few pixels.
    #[default]
    Jpeg,
    /// PNG: no loss.
    Png,
}

/// What is asked of a build.
#[derive(Clone, Debug, PartialEq)]
pub struct BuildOptions {
    /// How cells are cut.
    pub division: Division,
    /// The most triangles of a tile that is cut no further.
    pub max_triangles: usize,
    /// The widest atlas of a tile [px].
    pub max_texture_px: u32,
    /// Share of its children's triangles that a tile keeps.
    pub keep: f64,
    /// Whether `tileset.json` states a rule and subtrees instead of every tile.
    pub implicit: bool,
    /// Whether vertices and indices are compressed (`EXT_meshopt_compression`).
    pub meshopt: bool,
    /// How textures are stored.
    pub pictures: Pictures,
    /// Threads; `None`: one a core. They change no result.
    pub threads: Option<NonZeroUsize>,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            division: Division::Quadtree,
            max_triangles: 12_000,
            max_texture_px: 1024,
            keep: 0.25,
            implicit: false,
            meshopt: false,
            pictures: Pictures::Jpeg,
            threads: None,
        }
    }
}

impl Division {
    /// Axes along which cells are cut.
    pub(super) fn axes(self) -> usize {
        match self {
            Self::Quadtree => 2,
            Self::Octree => 3,
        }
    }
}

impl BuildOptions {
    /// Refuses what cannot be built.
    pub(super) fn check(&self) -> Result<(), BuildError> {
        let within = |option, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) {
                return Ok(());
            }
            Err(BuildError::Option {
                option,
                value,
                low,
                high,
            })
        };
        within("--max-triangles", self.max_triangles as f64, 100.0, 1e6)?;
        within("--texture-px", f64::from(self.max_texture_px), 64.0, 8192.0)?;
        within("--keep", self.keep, 0.01, 0.9)
    }
}
