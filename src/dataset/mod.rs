//! `dataset`: annotated pictures by the loop's own renderer, cameras and sensor model; `tracks`: what
//! the recogniser learns from.
//!
//! A recipe and its seed determine every byte of a set. A scene (one place, time, weather and camera) is drawn from
//! streams of its own, so that neither the order nor the number of scenes made at once matters. Its
//! pictures are written first and its annotations last, by renaming: a scene that has a record is
//! whole, and a run that was stopped continues with the scenes that have none.

mod assign;
mod coco;
mod draw;
mod error;
mod exposure;
pub(crate) mod kept;
mod label;
mod merge;
mod page;
mod real;
mod recipe;
mod scene;
mod sequence;
mod shares;
mod shoot;
mod stage;
mod statistics;
mod store;
mod thin;
pub mod tracks;

pub use error::DatasetError;
pub use recipe::Recipe;

use crate::parallel::{in_parallel, threads};
use crate::progress::Progress;
use crate::stop;
use assign::assign_scenes;
use clap::Args;
use merge::merge;
use real::Clips;
use scene::Scene;
use shoot::make;
use stage::Stage;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::mpsc::sync_channel;
use store::{claim, digest, done};

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
    /// Folder of clips of real cameras with their boxes.json, where the recipe wants real pictures.
    #[arg(long, value_name = "FOLDER")]
    real: Option<PathBuf>,
    /// Worker threads (default: all cores); changes no picture.
    #[arg(long)]
    threads: Option<usize>,
}

/// Makes the set, or continues it; what to tell the user.
pub fn dataset(arguments: &Arguments) -> Result<String, DatasetError> {
    let (recipe, text) = Recipe::load(&arguments.recipe)?;
    let clips = Clips::load(&recipe.real, arguments.real.as_deref())?;
    let rendered = recipe.scenes + recipe.sequences.count;
    let count = rendered + clips.as_ref().map_or(0, Clips::len);
    let scenes = scenes(arguments.scenes.as_deref(), count)?;
    let out = &arguments.out;
    let digest = digest(&recipe, clips.as_ref().map_or("", Clips::text))?;
    claim(out, &text, &digest)?;
    let assigned = assign_scenes(&recipe);
    let waiting: Vec<u32> = scenes.clone().filter(|index| !done(out, *index)).collect();
    let left = waiting.len();
    let progress = Progress::new(
        left as u64,
        "[{bar:30}] {pos} of {len} scenes, {per_sec}{left}",
    );
    let bar = progress.bar();
    let (waiting, filmed): (Vec<u32>, Vec<u32>) =
        waiting.into_iter().partition(|index| *index < rendered);
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
                match make(recipe, scene?, split, &mut stage, out) {
                    Err(DatasetError::Stopped) => break,
                    made => made?,
                }
                bar.inc(1);
                progress.say(|| format!("{} of {left} scenes", bar.position()));
            }
            Ok::<_, DatasetError>(())
        })?;
    }
    if let Some(clips) = &clips {
        let threads = threads(arguments.threads.and_then(NonZeroUsize::new));
        let made = in_parallel(&filmed, threads, |index| {
            clips.make(index - rendered, *index, out)?;
            bar.inc(1);
            progress.say(|| format!("{} of {left} scenes", bar.position()));
            Ok(())
        });
        match made {
            Ok(_) | Err(DatasetError::Stopped) => {}
            Err(error) => return Err(error),
        }
    }
    bar.finish_and_clear();
    let text = merge(&recipe, &digest, count as usize, out)?;
    let said = stop::said(
        "the files about the set tell of the scenes that are whole; the same command goes on",
    );
    Ok(text + said.as_deref().unwrap_or_default())
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
