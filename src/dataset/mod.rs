//! `dataset`: annotated pictures by the loop's own renderer, cameras and sensor model.
//!
//! A recipe and a seed say everything. A scene (one place, time, weather and camera) is drawn from
//! streams of its own, so that neither the order nor the number of scenes made at once matters. Its
//! pictures are written first and its annotations last, by renaming: a scene that has a record is
//! whole, and a run that was stopped goes on with the scenes that have none.

mod coco;
mod draw;
mod exposure;
mod label;
mod recipe;
mod sequence;
mod stage;
mod statistics;

pub use recipe::Recipe;

use crate::app::{self, RunError};
use crate::models::flight::uav::{UavClass, UavKind, model};
use crate::models::maths::rng::Stream;
use crate::models::optics::raster;
use crate::models::optics::sensor::{Sensor, SensorParams};
use crate::systems::capture;
use clap::Args;
use coco::{Annotation, Image, SceneRecord};
use draw::{Motion, Scene, Split};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use stage::{Placed, Rendered, Stage};
use statistics::Statistics;
use std::collections::BTreeMap;
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

/// Why a set cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The recipe cannot be read.
    #[error("recipe {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The recipe is no TOML, or has a key or a type that is not known.
    #[error("{file}:{line}: {why}; docs/dataset.md lists the keys")]
    Recipe {
        /// The file.
        file: String,
        /// The line, from 1.
        line: usize,
        /// What is wrong and where.
        why: String,
    },
    /// A value of the recipe is out of its range.
    #[error("{file}: {key}: {why}")]
    Value {
        /// The file.
        file: String,
        /// The key.
        key: &'static str,
        /// What is wrong.
        why: String,
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
    /// A file of the set cannot be written or read.
    #[error("{path}: {source}; name a folder that can be written with --out")]
    Output {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A record of a scene is damaged.
    #[error("{path}: {why}; delete the file, and the scene is made anew")]
    Record {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
}

/// Version of the folder's layout and of what is drawn: a change of either counts it up.
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

/// Draws of a still, and how many of them are rendered, before it is left without a UAV.
const DRAWS: u64 = 200;
const RENDERS: u32 = 12;
/// Boxes with a side below this are not told from noise [px].
const MIN_SIDE_PX: f64 = 2.0;
/// Draws of a clip before the scene is given up.
const CLIP_DRAWS: u64 = 2_000;
/// In clips, UAVs that show less of themselves than this are left out until they show again.
const MIN_CLIP_VISIBLE: f64 = 0.1;

/// Makes the set, or goes on with it; what to tell the user.
pub fn dataset(arguments: &Arguments) -> Result<String, RunError> {
    let (recipe, text) = Recipe::load(&arguments.recipe)?;
    let scenes = scenes(
        arguments.scenes.as_deref(),
        recipe.scenes + recipe.sequences.count,
    )?;
    let out = &arguments.out;
    let digest = digest(&recipe)?;
    claim(out, &text, &digest)?;
    let plan = draw::plan(&recipe);
    let waiting: Vec<u32> = scenes.clone().filter(|index| !done(out, *index)).collect();
    let bar = bar(waiting.len() as u64);
    if !waiting.is_empty() {
        let mut stage = Stage::new(arguments.threads)?;
        // The next scene is generated while this one is rendered.
        let (give, take) = sync_channel(1);
        let (recipe, plan) = (&recipe, &plan);
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for index in waiting {
                    let (background, split) = plan[index as usize];
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
            Ok::<_, RunError>(())
        })?;
    }
    bar.finish_and_clear();
    merge(&recipe, &digest, &plan, out)
}

/// The scenes asked for.
fn scenes(text: Option<&str>, count: u32) -> Result<std::ops::Range<u32>, RunError> {
    let Some(text) = text else {
        return Ok(0..count);
    };
    let parsed = text
        .split_once("..")
        .and_then(|(from, to)| Some(from.parse::<u32>().ok()?..to.parse::<u32>().ok()?));
    match parsed {
        Some(range) if range.start < range.end && range.end <= count => Ok(range),
        _ => Err(RunError::Argument {
            argument: "--scenes",
            why: format!("'{text}' is no range FROM..TO within 0..{count}"),
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

/// What must agree for a folder to be gone on with.
fn digest(recipe: &Recipe) -> Result<String, RunError> {
    let json = serde_json::to_string(recipe)?;
    let text = format!("{FORMAT} {} {json}", app::VERSION);
    Ok(format!(
        "{:032x}",
        xxhash_rust::xxh3::xxh3_128(text.as_bytes())
    ))
}

fn output(path: &Path) -> impl Fn(std::io::Error) -> DatasetError + '_ {
    |source| DatasetError::Output {
        path: path.into(),
        source,
    }
}

/// Writes a file that is either whole or not there.
fn write(path: &Path, bytes: &[u8]) -> Result<(), DatasetError> {
    let partial = path.with_extension("partial");
    std::fs::write(&partial, bytes).map_err(output(&partial))?;
    std::fs::rename(&partial, path).map_err(output(path))
}

/// Makes the folder one of this recipe, or finds that it is.
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
        let folder = out.join(folder);
        std::fs::create_dir_all(&folder).map_err(output(&folder))?;
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

/// A picture on its way to its file.
type Developed = (PathBuf, Vec<u8>);

/// Renders a scene's pictures and writes them, its record last.
fn make(
    recipe: &Recipe,
    scene: Scene,
    split: Split,
    stage: &mut Stage,
    out: &Path,
) -> Result<(), RunError> {
    let size_px = [scene.pinhole.width_px, scene.pinhole.height_px];
    stage.set(
        scene.environment.clone(),
        scene.r_camera_enu_m,
        size_px,
        &scene.props,
        &scene.clutter,
        scene.clouds,
    );
    // Pictures are compressed and written while the next ones are rendered.
    let (give, take) = sync_channel::<Developed>(8);
    let images = std::thread::scope(|scope| {
        let writer = scope.spawn(move || {
            take.into_iter().try_for_each(|(path, rgb8)| {
                write(&path, &png(&rgb8, size_px)?)?;
                Ok::<_, RunError>(())
            })
        });
        let folder = out.join(split.name());
        // The writer stops at its first error, which is told below.
        let mut keep = |image: &Image, rgb8: Vec<u8>| {
            let path = folder.join(&image.file_name);
            give.send((path, rgb8)).is_ok()
        };
        let images = if scene.index < recipe.scenes {
            stills(recipe, &scene, stage, &mut keep)
        } else {
            let number = scene.index - recipe.scenes;
            let name = format!("c{number:04}");
            coco::sequence_folder(out, &name)
                .map_err(|(path, source)| DatasetError::Output { path, source })?;
            clip(recipe, &scene, &name, stage, &mut keep)
        };
        drop(give);
        match writer.join() {
            Ok(result) => result.and(images),
            Err(panic) => std::panic::resume_unwind(panic),
        }
    })?;
    let record = SceneRecord {
        scene: scene.index,
        split,
        background: scene.background,
        sun_elevation_deg: scene.environment.sun_dir_enu.z.asin().to_degrees(),
        visibility_m: scene.environment.weather.visibility_m,
        cloud_cover: scene.environment.weather.cloud_cover,
        camera: coco::Camera {
            hfov_deg: scene.pinhole.hfov_rad().to_degrees(),
            r_enu_m: scene.r_camera_enu_m.to_array(),
        },
        sequence: (scene.index >= recipe.scenes)
            .then(|| format!("c{:04}", scene.index - recipe.scenes)),
        images,
    };
    let path = record_path(out, scene.index);
    write(&path, &serde_json::to_vec(&record)?)?;
    Ok(())
}

fn motion(number: usize) -> Motion {
    [Motion::Level, Motion::Manoeuvre, Motion::ClimbDive][number]
}

/// Renders a scene's stills.
fn stills(
    recipe: &Recipe,
    scene: &Scene,
    stage: &mut Stage,
    keep: &mut impl FnMut(&Image, Vec<u8>) -> bool,
) -> Result<Vec<Image>, RunError> {
    let shares = &recipe.motions;
    let mut rng = Stream::new(recipe.seed, u64::from(scene.index), "dataset motions");
    let shares = [shares.level, shares.manoeuvre, shares.climb_dive];
    let motions = draw::quota(recipe.stills, &shares, &mut rng);
    let mut images = Vec::new();
    for (number, kind) in motions.into_iter().enumerate() {
        let (mut image, rgb8) = still(recipe, scene, number as u64, motion(kind), stage)?;
        image.file_name = format!("images/s{:05}_{number:04}.png", scene.index);
        let goes_on = keep(&image, rgb8);
        images.push(image);
        if !goes_on {
            break;
        }
    }
    Ok(images)
}

/// Renders a scene's clip.
fn clip(
    recipe: &Recipe,
    scene: &Scene,
    name: &str,
    stage: &mut Stage,
    keep: &mut impl FnMut(&Image, Vec<u8>) -> bool,
) -> Result<Vec<Image>, RunError> {
    let sequences = &recipe.sequences;
    let shares = &recipe.motions;
    let entity = u64::from(scene.index) << 32;
    for attempt in 0..CLIP_DRAWS {
        let mut rng = Stream::new(recipe.seed, entity | attempt, "dataset clip");
        let motion = motion(draw::choose(
            &[shares.level, shares.manoeuvre, shares.climb_dive],
            &mut rng,
        ));
        let Some(mut clip) = sequence::draw(recipe, scene, motion, sequences.frames, &mut rng)
        else {
            continue;
        };
        let mut images = Vec::new();
        for number in 1..=sequences.frames {
            let still = clip.still(scene, motion);
            let rendered = stage.render(
                still.pose,
                scene.pinhole,
                &scene.sensor,
                &scene.props,
                &still.placed,
            )?;
            let params = exposure::settings(scene, &stage.scratch.pixels, 0.0);
            let uavs = still.placed.iter().filter(|p| p.prop < scene.uavs.len());
            let annotations: Vec<_> = uavs
                .filter_map(|placed| annotation(scene, &rendered, stage, placed, &params))
                .filter(|seen| seen.visible_fraction >= MIN_CLIP_VISIBLE)
                .collect();
            // A clip begins with something that can be seen.
            let contrast = |seen: &Annotation| seen.contrast >= recipe.targets.min_contrast;
            if number == 1 && (annotations.is_empty() || !annotations.iter().all(contrast)) {
                break;
            }
            let key = rng.bits();
            let rgb8 = develop(&rendered, &params, key, stage)?;
            let image = Image {
                file_name: format!("../sequences/{name}/img1/{number:06}.png"),
                width: scene.pinhole.width_px,
                height: scene.pinhole.height_px,
                motion,
                distractors: (still.placed.iter())
                    .filter(|p| p.prop >= scene.uavs.len())
                    .count(),
                annotations,
            };
            let goes_on = keep(&image, rgb8);
            images.push(image);
            if !goes_on {
                break;
            }
            clip.advance(scene, 1.0 / sequences.rate_hz, &mut rng);
        }
        if !images.is_empty() {
            return Ok(images);
        }
    }
    Err(no_room(scene))
}

fn no_room(scene: &Scene) -> RunError {
    RunError::Argument {
        argument: "RECIPE",
        why: format!(
            "scene {} has no view as the recipe wants it; widen camera.hfov_deg or camera.height_m",
            scene.index
        ),
    }
}

/// Draws and renders one still until its UAVs can be seen.
fn still(
    recipe: &Recipe,
    scene: &Scene,
    number: u64,
    motion: Motion,
    stage: &mut Stage,
) -> Result<(Image, Vec<u8>), RunError> {
    let entity = u64::from(scene.index) << 32 | number << 16;
    let mut rng = Stream::new(recipe.seed, entity, "dataset count");
    let targets = &recipe.targets;
    let kind = rng.uniform();
    let count = if kind < targets.none {
        0
    } else if kind < targets.none + targets.several {
        2 + (rng.uniform().powi(2) * 3.0) as usize
    } else {
        1
    };
    let mut renders = 0;
    for draw in 0..2 * DRAWS {
        let mut rng = Stream::new(recipe.seed, entity | draw, "dataset still");
        let given_up = draw >= DRAWS || renders >= RENDERS;
        let wanted = if given_up { 0 } else { count };
        let Some(still) = draw::still(recipe, scene, wanted, motion, &mut rng) else {
            continue;
        };
        renders += 1;
        if let Some(done) = shoot(recipe, scene, &still, stage, &mut rng)? {
            return Ok(done);
        }
    }
    Err(no_room(scene))
}

/// Renders a still; `None` if one of its UAVs cannot be seen well enough.
fn shoot(
    recipe: &Recipe,
    scene: &Scene,
    still: &draw::Still,
    stage: &mut Stage,
    rng: &mut Stream,
) -> Result<Option<(Image, Vec<u8>)>, RunError> {
    let pinhole = scene.pinhole;
    let rendered = stage.render(
        still.pose,
        pinhole,
        &scene.sensor,
        &scene.props,
        &still.placed,
    )?;
    let params = exposure::settings(scene, &stage.scratch.pixels, rng.range(-0.3, 0.3));
    let pixels = &mut stage.scratch.pixels;
    exposure::effects(recipe, &rendered, &params, pixels, rng);
    let mut annotations = Vec::new();
    let targets = &recipe.targets;
    for placed in still.placed.iter().filter(|p| p.prop < scene.uavs.len()) {
        match annotation(scene, &rendered, stage, placed, &params) {
            Some(seen)
                if seen.visible_fraction >= targets.min_visible
                    && seen.contrast >= targets.min_contrast =>
            {
                annotations.push(seen);
            }
            _ => return Ok(None),
        }
    }
    let rgb8 = develop(&rendered, &params, rng.bits(), stage)?;
    let image = Image {
        file_name: String::new(),
        width: pinhole.width_px,
        height: pinhole.height_px,
        motion: still.motion,
        distractors: still.placed.len() - annotations.len(),
        annotations,
    };
    Ok(Some((image, rgb8)))
}

/// What is seen of a UAV in the frame rendered last; `None` if it is too little for a box.
fn annotation(
    scene: &Scene,
    rendered: &Rendered,
    stage: &Stage,
    placed: &Placed,
    params: &SensorParams,
) -> Option<Annotation> {
    let truth = &rendered.frame.truth;
    let seen = truth.iter().find(|seen| seen.uav == placed.prop)?;
    let mesh = &scene.props[placed.prop].mesh;
    let (pinhole, pose, rect) = (&scene.pinhole, &rendered.frame.pose, rendered.frame.rect);
    let (body, phases) = (placed.body, &placed.phase_rad);
    let fine = raster::fine_silhouette(pinhole, pose, body, phases, mesh, rect);
    let own = raster::sampled_silhouette(pinhole, pose, body, phases, mesh, rect, 4);
    let share = label::visible_share(rendered, &stage.scratch, placed.prop, &fine, &own);
    let label = label::label(&fine, share)?;
    let [x0, y0, x1, y1] = label.box_px;
    if (x1 - x0).max(y1 - y0) < MIN_SIDE_PX {
        return None;
    }
    let pixels = &stage.scratch.pixels;
    let kind = scene.uavs[placed.prop];
    Some(Annotation {
        category_id: category(kind),
        uav: kind,
        bbox: [x0, y0, x1 - x0, y1 - y0],
        area: label.area_px,
        aim: seen.aim_px,
        range_m: seen.range_m,
        visible_fraction: label.visible_fraction,
        contrast: exposure::contrast(rendered, pixels, &fine, label.box_px, params),
        track_id: placed.prop as u32 + 1,
    })
}

/// The sensor's picture of the frame rendered last.
fn develop(
    rendered: &Rendered,
    params: &SensorParams,
    key: u64,
    stage: &mut Stage,
) -> Result<Vec<u8>, RunError> {
    let sensor = Sensor::new(params)?;
    Ok(capture::form_image(
        &rendered.frame,
        &sensor,
        key,
        &mut stage.scratch,
    )?)
}

/// A picture as a PNG file.
fn png(rgb8: &[u8], [width, height]: [u32; 2]) -> Result<Vec<u8>, RunError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    let image = |error: png::EncodingError| RunError::Image(error.to_string());
    let mut writer = encoder.write_header().map_err(image)?;
    writer.write_image_data(rgb8).map_err(image)?;
    writer.finish().map_err(image)?;
    Ok(bytes)
}

/// Gathers the scenes that are there into the annotation files.
fn merge(
    recipe: &Recipe,
    digest: &str,
    plan: &[(draw::Background, Split)],
    out: &Path,
) -> Result<String, RunError> {
    let mut records = BTreeMap::new();
    for scene in 0..plan.len() as u32 {
        let path = record_path(out, scene);
        let Ok(text) = std::fs::read_to_string(&path) else {
            continue;
        };
        let record: SceneRecord =
            serde_json::from_str(&text).map_err(|error| DatasetError::Record {
                path,
                why: error.to_string(),
            })?;
        records.insert(scene, record);
    }
    let mut text = String::new();
    let mut counts = serde_json::Map::new();
    for split in [Split::Train, Split::Val] {
        let folder = out.join(split.name());
        let of_split: Vec<_> = records.values().filter(|r| r.split == split).collect();
        let file = coco::file(&of_split);
        write(
            &folder.join("annotations.json"),
            &serde_json::to_vec(&file)?,
        )?;
        for record in &of_split {
            if let Some(name) = &record.sequence {
                let folder = out.join("sequences").join(name);
                let (truth, about) = coco::mot(record, name, recipe.sequences.rate_hz);
                write(&folder.join("gt/gt.txt"), truth.as_bytes())?;
                write(&folder.join("seqinfo.ini"), about.as_bytes())?;
                continue;
            }
            for image in &record.images {
                let (name, lines) = coco::yolo(image);
                write(&folder.join("labels").join(name), lines.as_bytes())?;
            }
        }
        let images: usize = of_split.iter().map(|r| r.images.len()).sum();
        let boxes: usize = (of_split.iter().flat_map(|r| &r.images))
            .map(|i| i.annotations.len())
            .sum();
        text += &format!(
            "{:<6} {} scenes, {images} pictures, {boxes} boxes\n",
            split.name(),
            of_split.len()
        );
        counts.insert(
            split.name().into(),
            serde_json::json!({ "scenes": of_split.len(), "images": images, "annotations": boxes }),
        );
    }
    let all: Vec<_> = records.values().collect();
    if !all.is_empty() {
        let parts = [Split::Train, Split::Val].map(|split| {
            let of_split: Vec<_> = all.iter().copied().filter(|r| r.split == split).collect();
            (split.name(), Statistics::of(&of_split))
        });
        let numbers = serde_json::json!({
            "all": Statistics::of(&all),
            parts[0].0: parts[0].1,
            parts[1].0: parts[1].1,
        });
        let json = serde_json::to_vec_pretty(&numbers)?;
        write(&out.join("statistics.json"), &json)?;
        let page = statistics::page(&all, out, &recipe.description)?;
        write(&out.join("statistics.html"), page.as_bytes())?;
    }
    let about = serde_json::json!({
        "format": FORMAT,
        "program": app::VERSION,
        "recipe_digest": digest,
        "seed": recipe.seed,
        "scenes": recipe.scenes,
        "sequences": recipe.sequences.count,
        "complete": records.len() == plan.len(),
        "counts": counts,
    });
    write(
        &out.join("dataset.json"),
        &serde_json::to_vec_pretty(&about)?,
    )?;
    if records.len() < plan.len() {
        text += &format!(
            "{} of {} scenes are there; run it without --scenes for the rest\n",
            records.len(),
            plan.len()
        );
    }
    Ok(text)
}
