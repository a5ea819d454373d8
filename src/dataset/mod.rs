//! `dataset`: annotated pictures by the loop's own renderer, cameras and sensor model.
//!
//! A recipe and its seed determine every byte of a set. A scene (one place, time, weather and camera) is drawn from
//! streams of its own, so that neither the order nor the number of scenes made at once matters. Its
//! pictures are written first and its annotations last, by renaming: a scene that has a record is
//! whole, and a run that was stopped continues with the scenes that have none.

mod assign;
mod coco;
mod draw;
mod exposure;
mod label;
mod merge;
mod page;
mod recipe;
mod scene;
mod sequence;
mod shares;
mod shoot;
mod stage;
mod statistics;

pub use recipe::Recipe;

use crate::app::RunError;
use crate::media::image::ImageError;
use crate::models::air::wind::WindError;
use crate::models::flight::uav::{UavClass, UavKind, model};
use crate::models::ground::city::CityError;
use crate::models::optics::camera::CameraError;
use crate::models::optics::sensor::SensorError;
use crate::output::{self, OutputError};
use crate::scenario::InputError;
use crate::systems::capture::CaptureError;
use assign::assign_scenes;
use clap::Args;
use coco::SceneRecord;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use merge::merge;
use scene::Scene;
use shoot::make;
use stage::Stage;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::mpsc::sync_channel;

/// What `dataset` is told.
#[derive(Args, Debug)]
pub struct Arguments {
    /// Recipe file (TOML).
    recipe: PathBuf,
    /// Folder for the set; a run that was stopped goes on in it.
    #[arg(long)]
    out: PathBuf,
    /// Make these scenes only, counted from 0: FROM..TO, without TO itself.
    #[arg(long, value_name = "FROM..TO")]
    scenes: Option<String>,
    /// Worker threads (default: all cores); changes no picture.
    #[arg(long)]
    threads: Option<usize>,
}

/// Why a set cannot be made; each prints as one line.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The recipe.
    #[error(transparent)]
    Recipe(#[from] InputError),
    /// The scenes that are asked for.
    #[error("--scenes: '{text}' is no range FROM..TO within 0..{count}")]
    Range {
        /// What was given.
        text: String,
        /// Scenes of the whole set.
        count: u32,
    },
    /// The folder holds another set.
    #[error(
        "{path} holds a set of another recipe or program version; name another folder with --out, \
         or empty this one"
    )]
    OtherRecipe {
        /// The folder.
        path: PathBuf,
    },
    /// A file of the set cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A record of a scene is damaged.
    #[error("{path}: {source}; delete the file, and the scene is made anew")]
    Record {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// The city of a scene cannot be generated.
    #[error("scene {scene}: city: {source}")]
    City {
        /// The scene.
        scene: u32,
        /// What is wrong.
        source: CityError,
    },
    /// The camera of a scene is impossible.
    #[error("scene {scene}: camera: {source}")]
    Camera {
        /// The scene.
        scene: u32,
        /// What is wrong.
        source: CameraError,
    },
    /// The wind of a scene is impossible.
    #[error("scene {scene}: weather: {source}")]
    Wind {
        /// The scene.
        scene: u32,
        /// What is wrong.
        source: WindError,
    },
    /// No view of a scene shows what the recipe wants.
    #[error(
        "scene {scene} has no view that the recipe allows; widen camera.hfov_deg or camera.height_m"
    )]
    NoView {
        /// The scene.
        scene: u32,
    },
    /// A sensor of a scene.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// A frame without its picture.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// A picture cannot be encoded, or not be read for the page of the set.
    #[error("{path}: {source}; delete the record of its scene, and the scene is made anew")]
    Picture {
        /// The picture.
        path: PathBuf,
        /// What is wrong.
        source: image::ImageError,
    },
    /// A picture of the page cannot be encoded.
    #[error("the page: {0}")]
    Preview(#[from] ImageError),
    /// Records and statistics that cannot be encoded.
    #[error("cannot encode a file of the set: {0}")]
    Json(#[from] serde_json::Error),
    /// The renderer.
    #[error(transparent)]
    Renderer(Box<RunError>),
}

impl From<RunError> for DatasetError {
    fn from(error: RunError) -> Self {
        Self::Renderer(Box::new(error))
    }
}

/// Version of the folder's layout and of what is drawn; a change of either raises it.
const FORMAT: u32 = 2;

/// The categories: number and name.
pub const CATEGORIES: [(u32, &str); 3] = [(1, "fpv"), (2, "quadcopter"), (3, "hexacopter")];

/// The category of a UAV.
pub fn category(kind: UavKind) -> u32 {
    match model(kind).class {
        UavClass::Fpv => 1,
        UavClass::Quadcopter => 2,
        UavClass::Hexacopter => 3,
    }
}

/// Makes the set, or continues it; what to tell the user.
pub fn dataset(arguments: &Arguments) -> Result<String, DatasetError> {
    let (recipe, text) = Recipe::load(&arguments.recipe)?;
    let scenes = scenes(
        arguments.scenes.as_deref(),
        recipe.scenes + recipe.sequences.count,
    )?;
    let out = &arguments.out;
    let digest = digest(&recipe)?;
    claim(out, &text, &digest)?;
    let assigned = assign_scenes(&recipe);
    let waiting: Vec<u32> = scenes.clone().filter(|index| !done(out, *index)).collect();
    let bar = bar(waiting.len() as u64);
    if !waiting.is_empty() {
        let mut stage = Stage::new(arguments.threads)?;
        // The next scene is generated while this one is rendered.
        let (give, take) = sync_channel(1);
        let (recipe, assigned) = (&recipe, &assigned);
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for index in waiting {
                    let (background, split) = assigned[index as usize];
                    let scene = Scene::draw(recipe, index, background);
                    // Nobody listens after an error.
                    if give.send((scene, split)).is_err() {
                        break;
                    }
                }
            });
            for (scene, split) in take {
                make(recipe, scene?, split, &mut stage, out)?;
                bar.inc(1);
                if bar.is_hidden() && bar.position().is_multiple_of(10) {
                    let total = bar.length().unwrap_or(0);
                    eprintln!("{} of {total} scenes", bar.position());
                }
            }
            Ok::<_, DatasetError>(())
        })?;
    }
    bar.finish_and_clear();
    merge(&recipe, &digest, assigned.len(), out)
}

/// The scenes asked for.
fn scenes(text: Option<&str>, count: u32) -> Result<std::ops::Range<u32>, DatasetError> {
    let Some(text) = text else {
        return Ok(0..count);
    };
    let parsed = text
        .split_once("..")
        .and_then(|(from, to)| Some(from.parse::<u32>().ok()?..to.parse::<u32>().ok()?));
    match parsed {
        Some(range) if range.start < range.end && range.end <= count => Ok(range),
        _ => Err(DatasetError::Range {
            text: text.to_owned(),
            count,
        }),
    }
}

fn bar(scenes: u64) -> ProgressBar {
    let bar = ProgressBar::new(scenes);
    if !std::io::stderr().is_terminal() {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    let template = "[{bar:30}] {pos} of {len} scenes, {per_sec}, {eta} left";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar
}

/// Tells a recipe and program version from others: a folder can be continued under the same one.
fn digest(recipe: &Recipe) -> Result<String, DatasetError> {
    let json = serde_json::to_string(recipe)?;
    let text = format!("{FORMAT} {} {json}", crate::VERSION);
    Ok(format!(
        "{:032x}",
        xxhash_rust::xxh3::xxh3_128(text.as_bytes())
    ))
}

/// Writes a file that is either whole or not there.
fn write(path: &Path, bytes: &[u8]) -> Result<(), DatasetError> {
    let partial = path.with_extension("partial");
    output::write(&partial, bytes)?;
    std::fs::rename(&partial, path).map_err(|source| {
        DatasetError::Output(OutputError {
            path: path.to_owned(),
            source,
        })
    })
}

/// Makes `out` the folder of this recipe, or confirms that it is.
fn claim(out: &Path, text: &str, digest: &str) -> Result<(), DatasetError> {
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

fn record_path(out: &Path, scene: u32) -> PathBuf {
    out.join("scenes").join(format!("{scene:05}.json"))
}

/// Whether a scene is whole.
fn done(out: &Path, scene: u32) -> bool {
    let Ok(text) = std::fs::read_to_string(record_path(out, scene)) else {
        return false;
    };
    serde_json::from_str::<SceneRecord>(&text).is_ok_and(|record| {
        let folder = out.join(record.split.name());
        (record.images.iter()).all(|image| folder.join(&image.file_name).is_file())
    })
}
