//! The folder of a set: whose it is, and which scenes it holds.

use super::coco::SceneRecord;
use super::error::DatasetError;
use super::recipe::Recipe;
use crate::output::{self, OutputError};
use std::path::{Path, PathBuf};

/// Version of the folder's layout and of what is drawn; a change of either raises it.
pub const FORMAT: u32 = 5;

/// Tells a recipe, program version and real clips from others: a folder can be continued under the same ones.
pub fn digest(recipe: &Recipe, boxes: &str) -> Result<String, DatasetError> {
    let json = serde_json::to_string(recipe)?;
    let text = format!("{FORMAT} {} {json} {boxes}", crate::VERSION);
    Ok(format!(
        "{:032x}",
        xxhash_rust::xxh3::xxh3_128(text.as_bytes())
    ))
}

/// Writes a file that is either whole or not there.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), DatasetError> {
    let partial = path.with_extension("partial");
    output::write(&partial, bytes)?;
    std::fs::rename(&partial, path).map_err(|source| {
        DatasetError::Output(OutputError::File {
            path: path.to_owned(),
            source,
        })
    })
}

/// Makes `out` the folder of this recipe, or confirms that it is.
pub fn claim(out: &Path, text: &str, digest: &str) -> Result<(), DatasetError> {
    let mark = out.join("scenes").join("digest");
    match std::fs::read_to_string(&mark) {
        Ok(found) if found == digest => return Ok(()),
        Ok(_) => return Err(DatasetError::OtherRecipe { path: out.into() }),
        Err(_) if out.join("recipe.toml").exists() => {
            return Err(DatasetError::OtherRecipe { path: out.into() });
        }
        Err(_) => {}
    }
    for folder in [
        "scenes",
        "train/images",
        "train/labels",
        "val/images",
        "val/labels",
    ] {
        output::create_dir(&out.join(folder))?;
    }
    write(&mark, digest.as_bytes())?;
    write(&out.join("recipe.toml"), text.as_bytes())
}

/// The record of a scene; there when the scene is whole.
pub fn record_path(out: &Path, scene: u32) -> PathBuf {
    out.join("scenes").join(format!("{scene:05}.json"))
}

/// Whether a scene is whole.
pub fn done(out: &Path, scene: u32) -> bool {
    let Ok(text) = std::fs::read_to_string(record_path(out, scene)) else {
        return false;
    };
    serde_json::from_str::<SceneRecord>(&text).is_ok_and(|record| {
        let folder = out.join(record.split.name());
        (record.images.iter()).all(|image| folder.join(&image.file_name).is_file())
    })
}
