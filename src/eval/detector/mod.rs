//! `boresight eval detector`: a model on annotated pictures.

pub mod coco;
pub mod cost;
pub mod figures;
pub mod metrics;
pub mod operating;
mod page;

use super::EvalError;
use super::shared::{progress, within_share};
use crate::inference::{DetectorError, OnnxDetector};
use crate::models::optics::detection::Detection;
use crate::output::{OutputError, put, put_json, quoted, writable};
use crate::parallel::threads;
use crate::stop;
use crate::warning;
use clap::{Args, ValueEnum};
use coco::{Coco, Half, Id, Picture};
use figures::{CentreHit, Cost, Evaluation, FPPI, Figures, PrecisionRecall, Speed, Worst};
use metrics::{ALL, AnnotatedImage, Criterion, Matching, Truth};
use operating::Counted;
use serde::Serialize;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What `boresight eval detector` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// ONNX model with the interface of training/README.md.
    #[arg(long)]
    pub model: PathBuf,
    /// COCO annotations: the JSON file, or a folder with annotations.json, one other .json file, or
    /// annotations/*.json. Pictures (PNG, JPEG) lie beside it, in images/ or in frames/.
    #[arg(long)]
    pub data: PathBuf,
    /// Folder for detector.json, detector.html, its chart and detections.json.
    #[arg(long, default_value = "out/eval")]
    pub out: PathBuf,
    /// Category that counts; may be repeated (default: those called like a UAV, such as uav, drone or
    /// quadcopter, or the only one).
    #[arg(long, value_name = "NAME")]
    pub category: Vec<String>,
    /// Score from which on detections count for the figures at a threshold (default: the one that
    /// the model recommends).
    #[arg(long)]
    pub threshold: Option<f64>,
    /// Look at the first so many pictures only.
    #[arg(long)]
    pub frames: Option<NonZeroUsize>,
    /// Look at the pictures of one half of the clips only, by the parity of the last number in their
    /// names: whoever makes a detector looks at `development` alone, and at `unseen` when it is done.
    #[arg(long)]
    pub half: Option<Half>,
    /// Threads of the model (default: all cores).
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// Most pictures of missed boxes, and of false alarms.
const PICTURES: usize = 12;

/// No picture is of the half asked for.
#[derive(Debug, thiserror::Error)]
#[error(
    "--half: no picture is of that half; clips belong to one by the last number in their names"
)]
struct EmptyHalf;

/// Carries out the evaluation and writes what it leaves.
pub fn evaluate(arguments: &Arguments) -> Result<Evaluation, EvalError> {
    let mut coco = Coco::load(&arguments.data, &arguments.category)?;
    coco.leave_out_absent();
    warning::tell(&coco.warnings())?;
    if let Some(half) = arguments.half {
        coco.halve(half);
        if coco.pictures.is_empty() {
            return Err(EvalError::own(EmptyHalf));
        }
    }
    coco.truncate(arguments.frames.map_or(usize::MAX, NonZeroUsize::get));
    within_share("--threshold", arguments.threshold)?;
    let threads = threads(arguments.threads);
    let mut model = OnnxDetector::load(&arguments.model, threads)?;
    let out = &arguments.out;
    let json = out.join("detector.json");
    // What cannot be read or written is told before the work.
    writable(&json)?;
    for picture in &coco.pictures {
        model.input_px(picture.size_px())?;
        coco.path(picture)?;
    }
    let all = coco.pictures.len();
    let (images, named, times) = detect(&mut model, &coco)?;
    coco.truncate(images.len());
    let cost = cost(&arguments.model, &model, &coco, out)?;
    let speed = Speed::of(&times, threads);
    let stopped = stop::said(&format!(
        "the figures are of the first {} of {all} pictures; the same command looks at all",
        images.len()
    ));
    let evaluation = Evaluation {
        stopped: stopped.filter(|_| images.len() < all),
        ..measure(arguments, &coco, &model, (&images, &named), cost, speed)
    };
    put_json(&json, &evaluation)?;
    let results = out.join("detections.json");
    let text =
        results_json(&coco, &model, &images, &named).map_err(|source| OutputError::Json {
            path: results.clone(),
            source,
        })?;
    put(&results, text)?;
    page::write(out, &coco, &images, &evaluation)?;
    Ok(evaluation)
}

/// The figures of the detections in all pictures.
fn measure(
    arguments: &Arguments,
    coco: &Coco,
    model: &OnnxDetector,
    (images, named): (&[AnnotatedImage], &[Vec<Detection>]),
    cost: Cost,
    speed: Speed,
) -> Evaluation {
    let half = Matching::of(images, Criterion::Iou(0.5), ALL);
    let centre = Matching::of(images, Criterion::Centre, ALL);
    let strict = Matching::of(images, Criterion::Iou(0.75), ALL);
    let recall = half.recall_at(FPPI);
    let threshold = arguments.threshold.unwrap_or(model.score_threshold());
    let counted = Counted {
        coco,
        images,
        named,
        classes: model.classes(),
        half: &half,
        threshold,
    };
    Evaluation {
        version: crate::VERSION,
        command: command(arguments, speed.threads),
        stopped: None,
        model: arguments.model.clone(),
        data: coco.file.clone(),
        categories: coco.categories.values().cloned().collect(),
        all: Figures::of(images, &half, threshold),
        ignored: coco.truth.iter().flatten().filter(|t| t.ignored).count(),
        precision_recall: PrecisionRecall::of(&half, &strict, &centre),
        recommended: [model.score_threshold(), model.score_threshold_video()],
        threshold,
        operating: counted.operating(),
        class_accuracy: class_accuracy(coco, model.classes(), images, &half),
        centre_hit: CentreHit::of(images, &centre, threshold),
        by_source: by_source(coco, images, threshold),
        cost,
        speed,
        worst: worst(coco, images, &half, recall),
    }
}

/// The figures of each source that the pictures name.
fn by_source(coco: &Coco, images: &[AnnotatedImage], threshold: f64) -> BTreeMap<String, Figures> {
    let mut sources: BTreeMap<&String, Vec<AnnotatedImage>> = BTreeMap::new();
    for (picture, image) in coco.pictures.iter().zip(images) {
        if let Some(source) = &picture.source {
            sources.entry(source).or_default().push(image.clone());
        }
    }
    (sources.into_iter())
        .map(|(source, images)| {
            let half = Matching::of(&images, Criterion::Iou(0.5), ALL);
            (source.clone(), Figures::of(&images, &half, threshold))
        })
        .collect()
}

/// The command that repeats the evaluation.
fn command(arguments: &Arguments, threads: usize) -> String {
    let mut options: String = (arguments.category.iter())
        .map(|name| format!(" --category {}", quoted(name)))
        .collect();
    if let Some(threshold) = arguments.threshold {
        options += &format!(" --threshold {threshold}");
    }
    if let Some(frames) = arguments.frames {
        options += &format!(" --frames {frames}");
    }
    if let Some(half) = arguments.half.and_then(|half| half.to_possible_value()) {
        options += &format!(" --half {}", half.get_name());
    }
    format!(
        "boresight eval detector --model {} --data {}{options} --threads {threads}",
        quoted(arguments.model.display()),
        quoted(arguments.data.display())
    )
}

/// What the model in `path` costs for the largest of the pictures.
fn cost(path: &Path, model: &OnnxDetector, coco: &Coco, out: &Path) -> Result<Cost, EvalError> {
    let bytes = std::fs::read(path).map_err(|error| DetectorError::Unreadable {
        path: path.into(),
        why: error.to_string(),
        named_in: "--model",
    })?;
    let area = |picture: &&Picture| u64::from(picture.width) * u64::from(picture.height);
    let largest = coco.pictures.iter().max_by_key(area);
    let input_px = model.input_px(largest.map_or([0, 0], Picture::size_px))?;
    let gflops = cost::gflops(path, input_px, &out.join("detector-profile"));
    Ok(Cost {
        params: cost::parameters(&bytes),
        gflops_missing: gflops.as_ref().err().map(ToString::to_string),
        gflops: gflops.ok(),
        gflops_size_px: input_px,
    })
}

/// The detections in every picture: those called UAVs, the others; and the time that each picture took.
type Detected = (Vec<AnnotatedImage>, Vec<Vec<Detection>>, Vec<Duration>);

fn detect(model: &mut OnnxDetector, coco: &Coco) -> Result<Detected, EvalError> {
    let count = coco.pictures.len();
    let mut images = Vec::with_capacity(count);
    let mut named = Vec::with_capacity(count);
    let mut times = Vec::with_capacity(count);
    let mut shown = Instant::now();
    for (i, (picture, truth)) in coco.pictures.iter().zip(&coco.truth).enumerate() {
        let rgb = coco.image(picture)?;
        let size_px = picture.size_px();
        if i == 0 {
            // Memory is set up at the first picture of a size.
            model.detect(rgb.as_raw(), size_px, &mut Vec::new())?;
        }
        let mut found = Vec::new();
        let started = Instant::now();
        model.detect(rgb.as_raw(), size_px, &mut found)?;
        times.push(started.elapsed());
        let (found, others) = found.into_iter().partition(|d| model.is_uav(d.label));
        named.push(others);
        images.push(AnnotatedImage {
            truth: truth.clone(),
            found,
        });
        if shown.elapsed() > Duration::from_secs(2) || i + 1 == count {
            shown = Instant::now();
            progress(&format!("{} of {count} pictures", i + 1));
        }
        if stop::asked().is_some() {
            break;
        }
    }
    Ok((images, named, times))
}

/// Share of the boxes hit whose category is what the detection's class is called; `None` without
/// hits, or if model or categories leave no choice.
fn class_accuracy(
    coco: &Coco,
    classes: &[String],
    images: &[AnnotatedImage],
    matching: &Matching,
) -> Option<f64> {
    if classes.len() < 2 || coco.categories.len() < 2 {
        return None;
    }
    let right: Vec<bool> = (matching.marks.iter())
        .filter(|mark| mark.is_hit())
        .filter_map(|mark| {
            let found = images.get(mark.image)?.found.get(mark.found)?;
            let category = coco.category.get(mark.image)?.get(mark.hit?)?;
            let name = coco.categories.get(category)?;
            let class = classes.get(found.label as usize)?;
            Some(class.eq_ignore_ascii_case(name))
        })
        .collect();
    let hits = right.iter().filter(|right| **right).count();
    (!right.is_empty()).then(|| hits as f64 / right.len() as f64)
}

/// What goes most wrong at the score of `recall`: the largest boxes missed there, and the most
/// confident false alarms; one of each a scene or clip, whose pictures resemble each other.
fn worst(
    coco: &Coco,
    images: &[AnnotatedImage],
    matching: &Matching,
    recall: Option<(f64, f64)>,
) -> Vec<Worst> {
    let least = recall.map_or(f64::INFINITY, |(_, score)| score);
    let entry = |kind, image: usize, box_px, score| Worst {
        kind,
        file_name: (coco.pictures.get(image)).map_or(String::new(), |p| p.file_name.clone()),
        box_px,
        score,
        image,
    };
    let hits: BTreeMap<(usize, usize), f64> = (matching.marks.iter())
        .filter_map(|mark| Some(((mark.image, mark.hit?), mark.score)))
        .collect();
    let mut missed: Vec<(f64, Worst)> = (images.iter().enumerate())
        .flat_map(|(i, image)| image.truth.iter().enumerate().map(move |(k, t)| (i, k, t)))
        .filter(|(_, _, truth)| !truth.ignored)
        .map(|(i, k, truth)| (i, truth, hits.get(&(i, k)).copied()))
        .filter(|(_, _, score)| score.is_none_or(|score| score < least))
        .map(|(i, truth, score): (usize, &Truth, _)| {
            (truth.area_px2, entry("missed", i, truth.box_px, score))
        })
        .collect();
    missed.sort_by(|a, b| b.0.total_cmp(&a.0));
    let alarms = (matching.marks.iter())
        .filter(|mark| mark.is_false_alarm())
        .filter_map(|mark| {
            let found = images.get(mark.image)?.found.get(mark.found)?;
            Some(entry(
                "false_alarm",
                mark.image,
                found.box_px,
                Some(mark.score),
            ))
        });
    let clip = |worst: &Worst| (coco.pictures.get(worst.image)).map(Picture::clip);
    let mut shown: Vec<Worst> = Vec::new();
    for worst in missed.into_iter().map(|(_, worst)| worst).chain(alarms) {
        let same = |other: &&Worst| other.kind == worst.kind;
        let new = (shown.iter().filter(same)).all(|other| clip(other) != clip(&worst));
        if new && shown.iter().filter(same).count() < PICTURES {
            shown.push(worst);
        }
    }
    shown
}

/// A detection as `pycocotools` loads it.
#[derive(Serialize)]
struct Found {
    image_id: Id,
    category_id: Id,
    /// x, y, width, height [px].
    bbox: [f64; 4],
    score: f64,
}

/// All detections in COCO's format of results: those called UAVs under the first of the categories
/// that count, the others under that of their name, where the set has it.
fn results_json(
    coco: &Coco,
    model: &OnnxDetector,
    images: &[AnnotatedImage],
    named: &[Vec<Detection>],
) -> Result<String, serde_json::Error> {
    let uav_id = coco.categories.keys().next().cloned().unwrap_or_default();
    let of_name = |label: u32| {
        let name = model.classes().get(label as usize)?;
        coco.other_ids.get(name).cloned()
    };
    let mut all: Vec<Found> = Vec::new();
    for ((picture, image), named) in coco.pictures.iter().zip(images).zip(named) {
        let uavs = (image.found.iter()).map(|found| (uav_id.clone(), found));
        let others = named.iter().filter_map(|f| Some((of_name(f.label)?, f)));
        all.extend(uavs.chain(others).map(|(category_id, found)| {
            let [x0, y0, x1, y1] = found.box_px;
            Found {
                image_id: picture.id.clone(),
                category_id,
                bbox: [x0, y0, x1 - x0, y1 - y0],
                score: found.score,
            }
        }));
    }
    serde_json::to_string(&all)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::OnnxDetector;
    use crate::models::optics::detection::Detection;
    use image::{GrayImage, ImageFormat, Luma};
    use serde_json::{Value, json};
    use std::io::Cursor;

    fn model(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
    }

    /// A grey picture with soft dark discs: centre and radius [px].
    fn picture(size_px: [u32; 2], discs: &[[f64; 3]]) -> Vec<u8> {
        let [width, height] = size_px;
        let grey = GrayImage::from_fn(width, height, |x, y| {
            let i = y * width + x;
            let (x, y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
            // Three grey levels of noise, or the detector's thresholds on it would be zero.
            let noise = f64::from(i.wrapping_mul(2_654_435_761) >> 16 & 3);
            let dark: f64 = (discs.iter())
                .map(|[cx, cy, r]| (r + 0.5 - (x - cx).hypot(y - cy)).clamp(0.0, 1.0))
                .sum();
            Luma([(170.0 + noise - 90.0 * dark) as u8])
        });
        let mut bytes = Cursor::new(Vec::new());
        (grey.write_to(&mut bytes, ImageFormat::Png)).expect("a PNG");
        bytes.into_inner()
    }

    /// Two pictures of odd sizes, one of them smaller than the model's least input, with one disc
    /// each, and one with a disc in an ignored region and a second category.
    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        let sizes = [[203_u32, 151], [61, 47], [128, 128]];
        let discs = [[70.0, 60.0, 5.0], [30.0, 22.0, 3.0], [60.0, 64.0, 4.0]];
        let (mut images, mut annotations) = (Vec::new(), Vec::new());
        for (i, ([width, height], [x, y, r])) in sizes.into_iter().zip(discs).enumerate() {
            let name = format!("s{i}_0001.png");
            let bytes = picture([width, height], &[[x, y, r]]);
            std::fs::write(folder.path().join(&name), bytes).expect("written");
            let mut image = json!({"id": i, "file_name": name, "width": width, "height": height});
            if i < 2 {
                image["source"] = ["rendered", "real"][i].into();
            }
            images.push(image);
            annotations.push(json!({
                "id": i, "image_id": i, "category_id": 1 + i % 2, "tight": i != 2,
                "bbox": [x - r, y - r, 2.0 * r, 2.0 * r]
            }));
        }
        let text = json!({
            "images": images, "annotations": annotations,
            "categories": [{"id": 1, "name": "uav"}, {"id": 2, "name": "fpv"}]
        });
        std::fs::write(folder.path().join("annotations.json"), text.to_string()).expect("written");
        folder
    }

    /// From pictures to `detector.json`, with the shipped model.
    #[test]
    fn a_small_set_is_evaluated_end_to_end() {
        let folder = folder();
        let out = folder.path().join("out");
        let mut arguments = Arguments {
            model: model("assets/models/saliency.onnx"),
            data: folder.path().into(),
            out: out.clone(),
            category: Vec::new(),
            threshold: None,
            frames: None,
            half: None,
            threads: NonZeroUsize::new(1),
        };
        let evaluation = evaluate(&arguments).expect("an evaluation");
        assert_eq!((evaluation.all.images, evaluation.all.boxes), (3, 2));
        assert_eq!(evaluation.ignored, 1);
        let sources: Vec<_> = (evaluation.by_source.iter())
            .map(|(name, of)| (name.as_str(), of.images, of.boxes, of.recall_at_threshold))
            .collect();
        let expected = ["real", "rendered"].map(|name| (name, 1, 1, Some(1.0)));
        assert_eq!(sources, expected, "the third picture names none");
        assert_eq!(evaluation.threshold, 0.5, "the model's own");
        assert_eq!(evaluation.all.recall_at_threshold, Some(1.0));
        assert_eq!(evaluation.all.false_alarms_per_frame, 0.0);
        assert_eq!(evaluation.all.map50, Some(1.0));
        assert_eq!(evaluation.class_accuracy, None, "one class");
        let miss_px = evaluation.all.miss_distance_px.mean.expect("hits");
        assert!(miss_px < 0.5, "{miss_px}");
        let text = std::fs::read_to_string(out.join("detector.json")).expect("a file");
        let json: Value = serde_json::from_str(&text).expect("JSON");
        for key in [
            "map50",
            "map50_95",
            "ap_by_size",
            "recall_at_fppi_0_1",
            "precision_recall",
            "miss_distance_px",
            "params",
            "gflops",
            "frames_per_s",
            "class_accuracy",
            "threshold",
            "recall_at_threshold",
            "false_alarms_per_frame",
        ] {
            assert!(json.get(key).is_some(), "{key}");
        }
        assert!(out.join("detector.html").is_file() && out.join("detections.json").is_file());

        // s0 and s2 have even numbers.
        arguments.half = Some(Half::Development);
        let evaluation = evaluate(&arguments).expect("an evaluation");
        assert_eq!((evaluation.all.images, evaluation.all.boxes), (2, 1));
        assert!(evaluation.command.contains("--half development"));
        arguments.half = None;
        arguments.frames = NonZeroUsize::new(1);
        arguments.threshold = Some(1.0);
        let evaluation = evaluate(&arguments).expect("an evaluation");
        assert_eq!((evaluation.all.images, evaluation.all.boxes), (1, 1));
        assert_eq!(evaluation.all.recall_at_threshold, Some(0.0));
        assert!(evaluation.command.contains("--threshold 1 --frames 1"));
        arguments.threshold = Some(1.5);
        let error = evaluate(&arguments).expect_err("refused").to_string();
        assert!(error.contains("--threshold"), "{error}");
        arguments.threshold = None;
        arguments.model = model("absent.onnx");
        let error = evaluate(&arguments).expect_err("refused").to_string();
        assert!(
            error.contains("absent.onnx") && error.contains("--model"),
            "{error}"
        );
    }

    /// Names decide, and hits alone count.
    #[test]
    fn classes_are_compared_by_name() {
        let folder = folder();
        let coco = Coco::load(folder.path(), &[]).expect("a set");
        let classes = ["fpv", "uav"].map(String::from);
        let found = |box_px, label| Detection::new(box_px, 0.9, label);
        let images: Vec<AnnotatedImage> = (coco.truth.iter())
            .map(|truth| AnnotatedImage {
                truth: truth.clone(),
                // `fpv`, right for the second picture only; a miss; the third lies in an ignored box.
                found: vec![found(truth[0].box_px, 0), found([0.0, 0.0, 5.0, 5.0], 1)],
            })
            .collect();
        let half = Matching::of(&images, Criterion::Iou(0.5), ALL);
        assert_eq!(class_accuracy(&coco, &classes, &images, &half), Some(0.5));
        assert_eq!(class_accuracy(&coco, &classes[..1], &images, &half), None);
        assert_eq!(half.at_score(0.5), (Some(1.0), 1.0));
        assert_eq!(half.at_score(0.95), (Some(0.0), 0.0));
        let worst = worst(&coco, &images, &half, half.recall_at(FPPI));
        assert_eq!(worst.iter().filter(|w| w.kind == "missed").count(), 2);
    }

    /// The classes that a model names are those that it is compared by.
    #[test]
    fn a_model_says_its_classes_and_threshold() {
        let model = OnnxDetector::load(&model("assets/models/saliency.onnx"), 1).expect("a model");
        assert_eq!(model.classes(), ["uav"]);
        assert_eq!(model.score_threshold(), 0.5);
        assert_eq!(model.input_px([61, 47]).expect("a size"), [64, 64]);
    }
}
