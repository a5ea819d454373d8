//! The pictures of a scene: drawn, rendered, developed, annotated and written.

use super::coco::{self, Annotation, CameraRecord, Origin, Picture, SceneRecord, Setting, Truth};
use super::draw::{self, Still};
use super::error::DatasetError;
use super::recipe::Recipe;
use super::scene::Scene;
use super::shares::{self, Motion, Split};
use super::stage::{Placed, Rendered, Stage};
use super::store::{record_path, write};
use super::{exposure, label, sequence};
use crate::models::bodies::raster;
use crate::models::maths::rng::Stream;
use crate::stop;
use crate::systems::capture;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageResult};
use std::path::{Path, PathBuf};
use std::sync::mpsc::sync_channel;

/// Draws of a still before it is left without a UAV.
const DRAWS: u64 = 200;
/// Renders of a still before it is left without a UAV.
const RENDERS: u32 = 12;
/// Boxes whose longer side is below this cannot be told from noise [px].
const MIN_SIDE_PX: f64 = 2.0;
/// Draws of a sequence before the scene is given up.
const SEQUENCE_DRAWS: u64 = 2_000;
/// What shows less of itself than this has no box: a distractor, or in sequences a UAV until it shows again.
const MIN_SEQUENCE_VISIBLE: f64 = 0.1;

/// A picture on its way to its file.
type Developed = (PathBuf, Vec<u8>);

/// Renders a scene's pictures and writes them, its record last.
pub fn make(
    recipe: &Recipe,
    scene: Scene,
    split: Split,
    stage: &mut Stage,
    out: &Path,
) -> Result<(), DatasetError> {
    let size_px = [
        scene.camera.pinhole.width_px,
        scene.camera.pinhole.height_px,
    ];
    stage.set(
        scene.environment.clone(),
        scene.camera.r_enu_m,
        size_px,
        &scene.props,
        &scene.clutter,
    );
    // Pictures are compressed and written while the next ones are rendered.
    let (give, take) = sync_channel::<Developed>(8);
    let images = std::thread::scope(|scope| {
        let writer = scope.spawn(move || {
            take.into_iter().try_for_each(|(path, rgb8)| {
                let file = png(&rgb8, size_px).map_err(|source| DatasetError::Picture {
                    path: path.clone(),
                    source,
                })?;
                write(&path, &file)
            })
        });
        let folder = out.join(split.name());
        // The writer stops at its first error, which is told below.
        let mut keep = |image: &Picture, rgb8: Vec<u8>| {
            let path = folder.join(&image.file_name);
            give.send((path, rgb8)).is_ok() && stop::asked().is_none()
        };
        let images = if scene.index < recipe.scenes {
            stills(recipe, &scene, stage, &mut keep)
        } else {
            let number = scene.index - recipe.scenes;
            let name = sequence_name(number);
            coco::sequence_folder(out, &name)?;
            frames(recipe, &scene, &name, stage, &mut keep)
        };
        drop(give);
        match writer.join() {
            Ok(result) => result.and(images),
            Err(panic) => std::panic::resume_unwind(panic),
        }
    })?;
    // A scene of some of its pictures is none.
    if stop::asked().is_some() {
        return Err(DatasetError::Stopped);
    }
    let record = SceneRecord {
        scene: scene.index,
        split,
        origin: Origin::Rendered(Setting {
            background: scene.background,
            sun_elevation_deg: scene.environment.backdrop.sun_dir_enu.z.asin().to_degrees(),
            visibility_m: scene.environment.weather.visibility_m,
            cloud_cover: scene.environment.weather.cloud_cover,
            camera: CameraRecord {
                hfov_deg: scene.camera.pinhole.hfov_rad().to_degrees(),
                r_enu_m: scene.camera.r_enu_m.to_array(),
            },
        }),
        sequence: (scene.index >= recipe.scenes)
            .then(|| sequence_name(scene.index - recipe.scenes)),
        images,
    };
    let path = record_path(out, scene.index);
    write(&path, &serde_json::to_vec(&record)?)
}

/// Name of a sequence by its number.
fn sequence_name(number: u32) -> String {
    format!("c{number:04}")
}

/// Renders a scene's stills.
fn stills(
    recipe: &Recipe,
    scene: &Scene,
    stage: &mut Stage,
    keep: &mut impl FnMut(&Picture, Vec<u8>) -> bool,
) -> Result<Vec<Picture>, DatasetError> {
    let mut rng = Stream::new(recipe.seed, u64::from(scene.index), "dataset motions");
    let motions = shares::quota(recipe.stills, &recipe.motions.shares(), &mut rng);
    let mut images = Vec::new();
    for (number, kind) in motions.into_iter().enumerate() {
        let (mut image, rgb8) = still(recipe, scene, number as u64, Motion::ALL[kind], stage)?;
        image.file_name = format!("images/s{:05}_{number:04}.png", scene.index);
        let goes_on = keep(&image, rgb8);
        images.push(image);
        if !goes_on {
            break;
        }
    }
    Ok(images)
}

/// Renders a scene's sequence.
fn frames(
    recipe: &Recipe,
    scene: &Scene,
    name: &str,
    stage: &mut Stage,
    keep: &mut impl FnMut(&Picture, Vec<u8>) -> bool,
) -> Result<Vec<Picture>, DatasetError> {
    let sequences = &recipe.sequences;
    let entity = u64::from(scene.index) << 32;
    for attempt in 0..SEQUENCE_DRAWS {
        let mut rng = Stream::new(recipe.seed, entity | attempt, "dataset clip");
        let motion = Motion::ALL[shares::choose(&recipe.motions.shares(), &mut rng)];
        let Some(mut course) = sequence::draw(recipe, scene, motion, sequences.frames, &mut rng)
        else {
            continue;
        };
        let mut images = Vec::new();
        for number in 1..=sequences.frames {
            let still = course.still(scene, motion);
            let mut rendered = stage.render(
                still.pose,
                scene.camera.pinhole,
                &scene.sensor,
                exposure::conditions(scene, &still.pose, None, 0.0),
                &scene.props,
                &still.placed,
            )?;
            rendered.frame.conditions =
                exposure::conditions(scene, &still.pose, Some(&stage.scratch.pixels), 0.0);
            let annotations: Vec<_> = (still.placed.iter())
                .filter_map(|placed| annotation(recipe, scene, &rendered, stage, placed))
                .filter(|seen| seen.shows(MIN_SEQUENCE_VISIBLE))
                .map(|seen| Annotation {
                    ignore: seen.ignore && !seen.class.is_uav(),
                    ..seen
                })
                .collect();
            // A sequence begins with a UAV that can be seen.
            let mut uavs = (annotations.iter()).filter(|seen| seen.class.is_uav());
            let contrast = |seen: &Annotation| seen.contrast >= recipe.targets.min_contrast;
            let any = uavs.clone().next().is_some();
            if number == 1 && !(any && uavs.all(contrast)) {
                break;
            }
            let key = rng.bits();
            let rgb8 = develop(&rendered, key, stage)?;
            let image = Picture {
                file_name: format!("../sequences/{name}/img1/{number:06}.png"),
                width: scene.camera.pinhole.width_px,
                height: scene.camera.pinhole.height_px,
                motion: Some(motion),
                annotations,
            };
            let goes_on = keep(&image, rgb8);
            images.push(image);
            if !goes_on {
                break;
            }
            course.advance(scene, 1.0 / sequences.rate_hz, &mut rng);
        }
        if !images.is_empty() {
            return Ok(images);
        }
    }
    Err(DatasetError::NoView { scene: scene.index })
}

/// Draws and renders one still until its UAVs can be seen.
fn still(
    recipe: &Recipe,
    scene: &Scene,
    number: u64,
    motion: Motion,
    stage: &mut Stage,
) -> Result<(Picture, Vec<u8>), DatasetError> {
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
    Err(DatasetError::NoView { scene: scene.index })
}

/// Renders a still; `None` if one of its UAVs cannot be seen well enough.
fn shoot(
    recipe: &Recipe,
    scene: &Scene,
    still: &Still,
    stage: &mut Stage,
    rng: &mut Stream,
) -> Result<Option<(Picture, Vec<u8>)>, DatasetError> {
    let pinhole = scene.camera.pinhole;
    let more_stops = rng.range(-0.3, 0.3);
    let mut rendered = stage.render(
        still.pose,
        pinhole,
        &scene.sensor,
        exposure::conditions(scene, &still.pose, None, more_stops),
        &scene.props,
        &still.placed,
    )?;
    let pixels = &mut stage.scratch.pixels;
    rendered.frame.conditions = exposure::conditions(scene, &still.pose, Some(pixels), more_stops);
    exposure::effects(recipe, scene, &mut rendered, pixels, rng);
    let mut annotations = Vec::new();
    for placed in &still.placed {
        let uav = placed.prop < scene.uavs.len();
        match annotation(recipe, scene, &rendered, stage, placed) {
            // A distractor that is hardly seen is neither asked for nor a false alarm.
            Some(seen) if !uav && !seen.shows(MIN_SEQUENCE_VISIBLE) => {}
            Some(seen) if !(uav && seen.ignore) => annotations.push(seen),
            _ if uav => return Ok(None),
            _ => {}
        }
    }
    let rgb8 = develop(&rendered, rng.bits(), stage)?;
    let image = Picture {
        file_name: String::new(),
        width: pinhole.width_px,
        height: pinhole.height_px,
        motion: Some(still.motion),
        annotations,
    };
    Ok(Some((image, rgb8)))
}

/// What is seen of a prop in the frame rendered last; `None` if it is too little for a box.
fn annotation(
    recipe: &Recipe,
    scene: &Scene,
    rendered: &Rendered,
    stage: &Stage,
    placed: &Placed,
) -> Option<Annotation> {
    let truth = &rendered.frame.truth;
    let seen = truth.iter().find(|seen| seen.uav == placed.prop)?;
    let mesh = &scene.props[placed.prop].mesh;
    let (pinhole, pose, rect) = (
        &scene.camera.pinhole,
        &rendered.frame.pose,
        rendered.frame.rect,
    );
    let (body, rotors) = (placed.body, placed.rotors(rendered.smeared_s));
    let fine = raster::fine_silhouette(pinhole, pose, body, rotors, mesh, rect);
    let own = raster::sampled_silhouette(pinhole, pose, body, rotors, mesh, rect, 4);
    let share = label::visible_share(rendered, &stage.scratch, placed.prop, &fine, &own);
    let label = label::label(&fine, share)?;
    let [x0, y0, x1, y1] = label.box_px;
    if (x1 - x0).max(y1 - y0) < MIN_SIDE_PX {
        return None;
    }
    let pixels = &stage.scratch.pixels;
    let (model, class) = match scene.props[placed.prop].distractor {
        Some(kind) => (kind.name(), kind.class()),
        None => {
            let uav = &scene.uavs[placed.prop];
            (uav.id.as_str(), uav.class)
        }
    };
    let contrast = exposure::contrast(scene, rendered, pixels, &fine, label.box_px);
    let targets = &recipe.targets;
    Some(Annotation {
        model: model.to_owned(),
        class,
        ignore: label.visible_fraction < targets.min_visible || contrast < targets.min_contrast,
        bbox: [x0, y0, x1 - x0, y1 - y0],
        area: label.area_px,
        contrast,
        rendered: Some(Truth {
            aim: seen.aim_px,
            range_m: seen.range_m,
            visible_fraction: label.visible_fraction,
        }),
        track_id: placed.prop as u32 + 1,
    })
}

/// The sensor's picture of the frame rendered last.
fn develop(rendered: &Rendered, key: u64, stage: &mut Stage) -> Result<Vec<u8>, DatasetError> {
    Ok(capture::form_image(
        &rendered.frame,
        &rendered.shot.camera.sensor,
        key,
        &mut stage.scratch,
    )?)
}

/// A picture as a PNG file.
pub fn png(rgb8: &[u8], [width, height]: [u32; 2]) -> ImageResult<Vec<u8>> {
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive)
        .write_image(rgb8, width, height, ExtendedColorType::Rgb8)?;
    Ok(bytes)
}
