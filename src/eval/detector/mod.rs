//! `boresight eval detector`: a model on annotated pictures.

pub mod metrics;

use super::coco::{Coco, Picture};
use super::page::{note, number, standalone, table};
use super::{cost, mot, progress, quoted, threads, within_share};
use crate::app::{self, RunError};
use crate::eval::detector::metrics::{
    ALL, BANDS, Band, Criterion, Image, Matching, Truth, mean_average_precision, recall_level,
};
use crate::inference::{DetectorError, OnnxDetector};
use crate::recording::encode_jpeg;
use crate::report::{Across, Chart, Escaped, MissStats, STYLE, Scale, Series};
use base64::{Engine as _, prelude::BASE64_STANDARD};
use clap::Args;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
use std::num::NonZeroUsize;
use std::path::PathBuf;
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
    /// Category that counts; may be repeated (default: the only one, or those named uav, drone, fpv,
    /// quadcopter or hexacopter).
    #[arg(long, value_name = "NAME")]
    pub category: Vec<String>,
    /// Score from which on detections count for the figures at a threshold (default: the one that
    /// the model recommends).
    #[arg(long)]
    pub threshold: Option<f64>,
    /// Look at the first so many pictures only.
    #[arg(long)]
    pub frames: Option<NonZeroUsize>,
    /// Threads of the model (default: all cores).
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// The rate at which the recall is given [false alarms a frame].
const FPPI: f64 = 0.1;
/// Most pictures of missed boxes, and of false alarms.
const PICTURES: usize = 12;
/// Shortest side of such a picture [px].
const CROP_PX: f64 = 96.0;

/// What was measured, as `detector.json` has it; its keys do not change. A figure without boxes to
/// measure it on is null.
#[derive(Debug, Serialize)]
pub struct Evaluation {
    /// Version of the program.
    pub version: &'static str,
    /// The command that repeats it.
    pub command: String,
    /// The model.
    pub model: PathBuf,
    /// The annotation file.
    pub data: PathBuf,
    /// Categories that count.
    pub categories: Vec<String>,
    /// Pictures.
    pub images: usize,
    /// Boxes that count.
    pub boxes: usize,
    /// Regions that are ignored.
    pub ignored: usize,
    /// Average precision at an IoU of 0.5.
    pub map50: Option<f64>,
    /// Mean over IoU of 0.5 to 0.95.
    pub map50_95: Option<f64>,
    /// Average precision by the root of the box's area.
    pub ap_by_size: BySize,
    /// Largest recall with at most 0.1 false alarms a frame, IoU of 0.5.
    pub recall_at_fppi_0_1: Option<f64>,
    /// The score from which on detections count there; null if none may.
    pub score_at_fppi_0_1: Option<f64>,
    /// Precision over recall.
    pub precision_recall: PrecisionRecall,
    /// The score of `--threshold`, or the one that the model recommends.
    pub threshold: f64,
    /// Recall of the detections from that score on, IoU of 0.5.
    pub recall_at_threshold: Option<f64>,
    /// False alarms a frame among them.
    pub false_alarms_per_frame: f64,
    /// Share of the boxes hit at an IoU of 0.5 whose category the detection's class names; null if
    /// model or categories have one class only.
    pub class_accuracy: Option<f64>,
    /// Distance of the centres of detections and boxes that match at an IoU of 0.5.
    pub miss_distance_px: Miss,
    /// The same with the centre in the box as match, for loosely drawn boxes.
    pub centre_hit: CentreHit,
    /// Parameters; null if the file does not show them.
    pub params: Option<u64>,
    /// Operations of the largest picture, 10⁹; null if they could not be counted.
    pub gflops: Option<f64>,
    /// Width and height of the model's input for that picture [px].
    pub gflops_size_px: [u32; 2],
    /// Why there are no GFLOPs.
    pub gflops_missing: Option<String>,
    /// Pictures over the time that the detector took for them, decoding apart.
    pub frames_per_s: f64,
    /// Median time of a picture [ms].
    pub frame_ms_median: Option<f64>,
    /// Threads of the model, on the CPU.
    pub threads: usize,
    /// The largest missed boxes and the most confident false alarms at 0.1 false alarms a frame.
    pub worst: Vec<Worst>,
}

/// Average precision by size band.
#[derive(Debug, Serialize)]
pub struct BySize {
    /// Below 8 px.
    pub below_8_px: Size,
    /// 8 to 16 px.
    pub from_8_to_16_px: Size,
    /// 16 to 32 px.
    pub from_16_to_32_px: Size,
    /// Above 32 px.
    pub above_32_px: Size,
}

/// One size band.
#[derive(Debug, Serialize)]
pub struct Size {
    /// Boxes that count.
    pub boxes: usize,
    /// Average precision at an IoU of 0.5.
    pub ap50: Option<f64>,
    /// Mean over IoU of 0.5 to 0.95.
    pub ap50_95: Option<f64>,
}

impl Size {
    fn of(images: &[Image], band: Band) -> Self {
        let matching = Matching::of(images, Criterion::Iou(0.5), band);
        Self {
            boxes: matching.boxes,
            ap50: matching.average_precision(),
            ap50_95: mean_average_precision(images, band),
        }
    }
}

/// Precision over recall; lists are empty without boxes.
#[derive(Debug, Serialize)]
pub struct PrecisionRecall {
    /// 0 to 1 in steps of 0.01.
    pub recall: Vec<f64>,
    /// Interpolated precision at an IoU of 0.5.
    pub iou_0_50: Vec<f64>,
    /// The same at 0.75.
    pub iou_0_75: Vec<f64>,
    /// The same with the centre in the box as match.
    pub centre: Vec<f64>,
}

/// Miss distance of eq. 12 [px]; null without matches.
#[derive(Clone, Debug, Serialize)]
pub struct Miss {
    /// Mean.
    pub mean: Option<f64>,
    /// Root mean square.
    pub rms: Option<f64>,
    /// Median.
    pub median: Option<f64>,
    /// Matches.
    pub n: usize,
}

impl Miss {
    pub(super) fn of(px: impl IntoIterator<Item = f64>) -> Self {
        let stats = MissStats::of(px);
        Self {
            mean: stats.map(|s| s.mean),
            rms: stats.map(|s| s.rms),
            median: stats.map(|s| s.p50),
            n: stats.map_or(0, |s| s.n),
        }
    }
}

impl std::fmt::Display for Miss {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let [mean, rms, median] = [self.mean, self.rms, self.median].map(|px| number(px, 2));
        write!(f, "{mean} / {rms} / {median} px ({} matches)", self.n)
    }
}

/// Figures with the centre in the box as match.
#[derive(Debug, Serialize)]
pub struct CentreHit {
    /// Average precision.
    pub ap: Option<f64>,
    /// Largest recall with at most 0.1 false alarms a frame.
    pub recall_at_fppi_0_1: Option<f64>,
    /// Recall at the threshold.
    pub recall_at_threshold: Option<f64>,
    /// False alarms a frame there.
    pub false_alarms_per_frame: f64,
    /// Miss distance.
    pub miss_distance_px: Miss,
}

/// A box that was missed, or a false alarm.
#[derive(Debug, Serialize)]
pub struct Worst {
    /// `missed` or `false_alarm`.
    pub kind: &'static str,
    /// File of the picture.
    pub file_name: String,
    /// x0, y0, x1, y1 [px].
    pub box_px: [f64; 4],
    /// Score of the false alarm; of the missed box, the best score of a detection that matches it.
    pub score: Option<f64>,
    #[serde(skip)]
    image: usize,
}

/// Carries out the evaluation and writes what it leaves.
pub fn detector(arguments: &Arguments) -> Result<Evaluation, RunError> {
    let mut coco = Coco::load(&arguments.data, &arguments.category)?;
    coco.truncate(arguments.frames.map_or(usize::MAX, NonZeroUsize::get));
    within_share("--threshold", arguments.threshold)?;
    let threads = threads(arguments.threads);
    let mut model = OnnxDetector::load(&arguments.model, threads)?;
    let out = &arguments.out;
    // What cannot be read or written is told before the work.
    mot::writable(&out.join("detector.json"))?;
    for picture in &coco.pictures {
        model.input_px([picture.width, picture.height])?;
        coco.path(picture)?;
    }
    let (images, times) = detect(&mut model, &coco)?;
    let times_ms = MissStats::of(times.iter().map(|time| 1e3 * time.as_secs_f64()));
    let seconds: f64 = times.iter().map(Duration::as_secs_f64).sum();
    let bytes = std::fs::read(&arguments.model).map_err(|error| DetectorError::Unreadable {
        path: arguments.model.clone(),
        why: error.to_string(),
        named_in: "--model",
    })?;
    let area = |picture: &&Picture| u64::from(picture.width) * u64::from(picture.height);
    let largest = coco.pictures.iter().max_by_key(area);
    let size_px = largest.map_or([0, 0], |picture| [picture.width, picture.height]);
    let input_px = model.input_px(size_px)?;
    let gflops = cost::gflops(&arguments.model, input_px, &out.join("detector-profile"));

    let half = Matching::of(&images, Criterion::Iou(0.5), ALL);
    let centre = Matching::of(&images, Criterion::Centre, ALL);
    let strict = Matching::of(&images, Criterion::Iou(0.75), ALL);
    let curve = |matching: &Matching| matching.precision().map_or(Vec::new(), |p| p.to_vec());
    let recall = half.recall_at(FPPI);
    let [tiny, small, medium, large] = BANDS.map(|band| Size::of(&images, band));
    let threshold = arguments.threshold.unwrap_or(model.score_threshold());
    let (recall_there, alarms_there) = half.at_score(threshold);
    let (centre_recall_there, centre_alarms_there) = centre.at_score(threshold);
    let mut options: String = (arguments.category.iter())
        .map(|name| format!(" --category {}", quoted(name)))
        .collect();
    if let Some(threshold) = arguments.threshold {
        options += &format!(" --threshold {threshold}");
    }
    if let Some(frames) = arguments.frames {
        options += &format!(" --frames {frames}");
    }
    let evaluation = Evaluation {
        version: app::VERSION,
        command: format!(
            "boresight eval detector --model {} --data {}{options} --threads {threads}",
            quoted(arguments.model.display()),
            quoted(arguments.data.display())
        ),
        model: arguments.model.clone(),
        data: coco.file.clone(),
        categories: coco.categories.values().cloned().collect(),
        images: images.len(),
        boxes: half.boxes,
        ignored: coco.truth.iter().flatten().filter(|t| t.ignored).count(),
        map50: half.average_precision(),
        map50_95: mean_average_precision(&images, ALL),
        ap_by_size: BySize {
            below_8_px: tiny,
            from_8_to_16_px: small,
            from_16_to_32_px: medium,
            above_32_px: large,
        },
        recall_at_fppi_0_1: recall.map(|(recall, _)| recall),
        score_at_fppi_0_1: recall.map(|(_, score)| score).filter(|s| s.is_finite()),
        precision_recall: PrecisionRecall {
            recall: half
                .precision()
                .map_or(Vec::new(), |p| (0..p.len()).map(recall_level).collect()),
            iou_0_50: curve(&half),
            iou_0_75: curve(&strict),
            centre: curve(&centre),
        },
        threshold,
        recall_at_threshold: recall_there,
        false_alarms_per_frame: alarms_there,
        class_accuracy: class_accuracy(&coco, model.classes(), &images, &half),
        miss_distance_px: Miss::of(half.miss_distances_px(&images)),
        centre_hit: CentreHit {
            ap: centre.average_precision(),
            recall_at_fppi_0_1: centre.recall_at(FPPI).map(|(recall, _)| recall),
            recall_at_threshold: centre_recall_there,
            false_alarms_per_frame: centre_alarms_there,
            miss_distance_px: Miss::of(centre.miss_distances_px(&images)),
        },
        params: cost::parameters(&bytes),
        gflops_missing: gflops.as_ref().err().map(ToString::to_string),
        gflops: gflops.ok(),
        gflops_size_px: input_px,
        frames_per_s: images.len() as f64 / seconds.max(f64::MIN_POSITIVE),
        frame_ms_median: times_ms.map(|s| s.p50),
        threads,
        worst: worst(&coco, &images, &half, recall),
    };
    write(arguments, &coco, &images, &evaluation)?;
    Ok(evaluation)
}

/// The detections in every picture, and the time that each took.
fn detect(model: &mut OnnxDetector, coco: &Coco) -> Result<(Vec<Image>, Vec<Duration>), RunError> {
    let count = coco.pictures.len();
    let mut images = Vec::with_capacity(count);
    let mut times = Vec::with_capacity(count);
    let mut shown = Instant::now();
    for (i, (picture, truth)) in coco.pictures.iter().zip(&coco.truth).enumerate() {
        let rgb8 = coco.rgb8(i)?;
        let size_px = [picture.width, picture.height];
        if i == 0 {
            // Memory is set up at the first picture of a size.
            model.detect(&rgb8, size_px, &mut Vec::new())?;
        }
        let mut found = Vec::new();
        let started = Instant::now();
        model.detect(&rgb8, size_px, &mut found)?;
        times.push(started.elapsed());
        images.push(Image {
            truth: truth.clone(),
            found,
        });
        if shown.elapsed() > Duration::from_secs(2) || i + 1 == count {
            shown = Instant::now();
            progress(&format!("{} of {count} pictures", i + 1));
        }
    }
    Ok((images, times))
}

/// Share of the boxes hit whose category is what the detection's class is called; `None` without
/// hits, or if model or categories leave no choice.
fn class_accuracy(
    coco: &Coco,
    classes: &[String],
    images: &[Image],
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
    images: &[Image],
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

fn share(value: Option<f64>) -> String {
    number(value, 4)
}

impl Evaluation {
    /// The figures with their names.
    fn rows(&self) -> Vec<(&'static str, String)> {
        let size = |size: &Size| {
            format!(
                "{} / {} ({} boxes)",
                share(size.ap50),
                share(size.ap50_95),
                size.boxes
            )
        };
        let [width, height] = self.gflops_size_px;
        let gflops = match &self.gflops_missing {
            Some(why) => format!("not counted: {why}"),
            None => format!("{} at {width} × {height} px", number(self.gflops, 3)),
        };
        vec![
            ("pictures", self.images.to_string()),
            (
                "boxes",
                format!("{}, {} regions ignored", self.boxes, self.ignored),
            ),
            ("mAP@50", share(self.map50)),
            ("mAP@50–95", share(self.map50_95)),
            (
                "AP@50 / 50–95 below 8 px",
                size(&self.ap_by_size.below_8_px),
            ),
            ("8 to 16 px", size(&self.ap_by_size.from_8_to_16_px)),
            ("16 to 32 px", size(&self.ap_by_size.from_16_to_32_px)),
            ("above 32 px", size(&self.ap_by_size.above_32_px)),
            (
                "recall at 0.1 false alarms a frame",
                format!(
                    "{} from a score of {} on",
                    share(self.recall_at_fppi_0_1),
                    number(self.score_at_fppi_0_1, 3)
                ),
            ),
            (
                "recall / false alarms a frame at the threshold",
                format!(
                    "{} / {:.3} from a score of {} on",
                    share(self.recall_at_threshold),
                    self.false_alarms_per_frame,
                    self.threshold
                ),
            ),
            ("class right where hit", share(self.class_accuracy)),
            (
                "miss distance: mean / rms / median",
                self.miss_distance_px.to_string(),
            ),
            ("centre in the box: AP", share(self.centre_hit.ap)),
            (
                "its recall at 0.1 false alarms a frame",
                share(self.centre_hit.recall_at_fppi_0_1),
            ),
            (
                "its recall / false alarms at the threshold",
                format!(
                    "{} / {:.3}",
                    share(self.centre_hit.recall_at_threshold),
                    self.centre_hit.false_alarms_per_frame
                ),
            ),
            (
                "its miss distance: mean / rms / median",
                self.centre_hit.miss_distance_px.to_string(),
            ),
            (
                "parameters",
                self.params.map_or("–".into(), |params| params.to_string()),
            ),
            ("GFLOPs", gflops),
            (
                "frames a second, CPU",
                format!(
                    "{:.1} on {} threads, {} ms median",
                    self.frames_per_s,
                    self.threads,
                    number(self.frame_ms_median, 1)
                ),
            ),
        ]
    }

    /// The figures as lines of text.
    pub fn text(&self) -> String {
        (self.rows().iter())
            .map(|(name, value)| format!("{name:<48} {value}\n"))
            .collect()
    }
}

/// A detection as `pycocotools` loads it.
#[derive(Serialize)]
struct Found {
    image_id: i64,
    category_id: i64,
    /// x, y, width, height [px].
    bbox: [f64; 4],
    score: f64,
}

/// All detections in COCO's format of results, under the first of the categories that count.
fn results(coco: &Coco, images: &[Image]) -> Result<String, serde_json::Error> {
    let category_id = coco.categories.keys().next().copied().unwrap_or_default();
    let found: Vec<Found> = (coco.pictures.iter().zip(images))
        .flat_map(|(picture, image)| image.found.iter().map(|found| (picture.id, found)))
        .map(|(image_id, found)| {
            let [x0, y0, x1, y1] = found.box_px;
            Found {
                image_id,
                category_id,
                bbox: [x0, y0, x1 - x0, y1 - y0],
                score: found.score,
            }
        })
        .collect();
    serde_json::to_string(&found)
}

fn write(
    arguments: &Arguments,
    coco: &Coco,
    images: &[Image],
    evaluation: &Evaluation,
) -> Result<(), RunError> {
    let out = &arguments.out;
    let text = serde_json::to_string_pretty(evaluation)? + "\n";
    mot::put(&out.join("detector.json"), &text)?;
    mot::put(&out.join("detections.json"), &results(coco, images)?)?;
    let crops = (evaluation.worst.iter())
        .map(|worst| Crop::of(coco, worst))
        .collect::<Result<Vec<_>, _>>()?;
    let mut page = String::new();
    let mut chart = None;
    html(&mut page, &mut chart, images, evaluation, &crops)
        .map_err(std::io::Error::other)
        .map_err(|source| RunError::Output {
            path: out.clone(),
            source,
        })?;
    if let Some(svg) = chart {
        mot::put(&out.join("precision-recall.svg"), &svg)?;
    }
    mot::put(&out.join("detector.html"), &page)
}

/// A piece of a picture.
struct Crop {
    /// x0, y0, width, height in the picture [px].
    rect_px: [u32; 4],
    jpeg: Vec<u8>,
}

impl Crop {
    /// The surroundings of a box.
    fn of(coco: &Coco, worst: &Worst) -> Result<Self, RunError> {
        let rgb8 = coco.rgb8(worst.image)?;
        let size = (coco.pictures.get(worst.image)).map_or([0, 0], |p| [p.width, p.height]);
        let [x0, y0, x1, y1] = worst.box_px;
        let side = CROP_PX.max(3.0 * (x1 - x0).max(y1 - y0)) as u32;
        let place = |low: f64, high: f64, size: u32| {
            let side = side.min(size);
            let first = (0.5 * (low + high) - 0.5 * f64::from(side)).round();
            (first.clamp(0.0, f64::from(size - side)) as u32, side)
        };
        let (left, width) = place(x0, x1, size[0]);
        let (top, height) = place(y0, y1, size[1]);
        let row = 3 * size[0] as usize;
        let piece: Vec<u8> = rgb8
            .chunks_exact(row.max(1))
            .skip(top as usize)
            .take(height as usize)
            .flat_map(|row| &row[3 * left as usize..3 * (left + width) as usize])
            .copied()
            .collect();
        Ok(Self {
            rect_px: [left, top, width, height],
            jpeg: encode_jpeg(&piece, width as u16, height as u16, 90)
                .map_err(|error| RunError::Image(error.to_string()))?,
        })
    }

    fn html(&self, out: &mut String, image: &Image, worst: &Worst, least: f64) -> fmt::Result {
        let [left, top, width, height] = self.rect_px.map(f64::from);
        let unit = width / 320.0;
        writeln!(
            out,
            "<figure><svg viewBox=\"{left} {top} {width} {height}\" font-size=\"{:.2}\" \
             stroke-width=\"{:.2}\" fill=\"none\"><image x=\"{left}\" y=\"{top}\" \
             width=\"{width}\" height=\"{height}\" style=\"image-rendering:pixelated\" \
             href=\"data:image/jpeg;base64,{}\"/>",
            13.0 * unit,
            2.0 * unit,
            BASE64_STANDARD.encode(&self.jpeg)
        )?;
        let mut mark = |[x0, y0, x1, y1]: [f64; 4], style: &str| {
            writeln!(
                out,
                "<rect x=\"{x0:.1}\" y=\"{y0:.1}\" width=\"{:.1}\" height=\"{:.1}\" {style}/>",
                x1 - x0,
                y1 - y0
            )
        };
        for truth in &image.truth {
            if truth.ignored {
                let dash = 6.0 * unit;
                mark(
                    truth.box_px,
                    &format!("stroke=\"#fff\" stroke-dasharray=\"{dash:.2}\""),
                )?;
            } else {
                mark(truth.box_px, "stroke=\"#2fe6a0\"")?;
            }
        }
        let is_worst = |box_px| worst.kind == "false_alarm" && box_px == worst.box_px;
        for found in &image.found {
            if found.score >= least || is_worst(found.box_px) {
                mark(found.box_px, "stroke=\"#ff9d2e\"")?;
            }
        }
        let [x0, y0, x1, y1] = worst.box_px;
        let score = match (worst.kind, worst.score) {
            ("missed", Some(score)) => format!("matched with a score of {score:.2} only"),
            ("missed", None) => "no match at any score".into(),
            (_, score) => format!("score {}", number(score, 2)),
        };
        writeln!(
            out,
            "</svg><figcaption><b>{}</b> <span class=\"note\">{:.0} × {:.0} px, {score}</span></figcaption></figure>",
            Escaped(&worst.file_name),
            x1 - x0,
            y1 - y0,
        )
    }
}

fn html(
    out: &mut String,
    picture: &mut Option<String>,
    images: &[Image],
    evaluation: &Evaluation,
    crops: &[Crop],
) -> fmt::Result {
    writeln!(
        out,
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
         <title>Boresight: detector</title>\n<style>{STYLE}</style>\n</head>\n<body>\n\
         <header>\n<h1>Detector</h1>\n<p class=\"meta\"><span>Model <code>{}</code></span>\
         <span>Pictures <code>{}</code></span><span>Category <code>{}</code></span>\
         <span>Version <code>{}</code></span><span><code>{}</code></span></p>\n</header>",
        Escaped(&evaluation.model.display().to_string()),
        Escaped(&evaluation.data.display().to_string()),
        Escaped(&evaluation.categories.join(", ")),
        evaluation.version,
        Escaped(&evaluation.command)
    )?;
    out.push_str("<h2>Figures</h2>\n");
    let rows: Vec<Vec<String>> = (evaluation.rows().into_iter())
        .map(|(name, value)| vec![name.into(), value])
        .collect();
    table(out, &["figure", "value"], &rows)?;
    note(
        out,
        "Average precision as pycocotools gives it: 101 recalls, at most 100 detections a picture. Sizes are roots of \
         the boxes' areas. Detections in ignored regions count neither for nor against.",
    )?;
    out.push_str(
        "<h2>Precision over recall</h2>\n<div class=\"charts\" style=\"max-width:44rem\">\n",
    );
    let pr = &evaluation.precision_recall;
    let series = |precision: &[f64]| -> Series {
        (pr.recall.iter().copied())
            .zip(precision.iter().copied())
            .collect()
    };
    let curves = [&pr.iou_0_50, &pr.iou_0_75, &pr.centre].map(|curve| series(curve));
    let chart = Chart {
        title: "Precision",
        unit: "1",
        scale: Scale::Linear,
        series: &[
            ("IoU 0.50", &curves[0]),
            ("IoU 0.75", &curves[1]),
            ("centre in the box", &curves[2]),
        ],
        limit: None,
    };
    let mut figure = String::new();
    chart.html(&mut figure, &Across::time("recall", 1.0))?;
    out.push_str(&figure);
    out.push_str("</div>\n");
    *picture = standalone(&chart, &figure);

    let least = evaluation.score_at_fppi_0_1.unwrap_or(f64::INFINITY);
    for (kind, title, text) in [
        (
            "missed",
            "Worst misses",
            "The largest boxes that are missed at 0.1 false alarms a frame, one a scene.",
        ),
        (
            "false_alarm",
            "Worst false alarms",
            "The most confident detections that match no box at an IoU of 0.5, one a scene.",
        ),
    ] {
        writeln!(out, "<h2>{title}</h2>")?;
        note(
            out,
            &format!("{text} Green: boxes; orange: detections; dashed: ignored regions."),
        )?;
        out.push_str("<div class=\"sheet\">\n");
        let shown = evaluation.worst.iter().zip(crops);
        let mut none = true;
        for (worst, crop) in shown.filter(|(worst, _)| worst.kind == kind) {
            if let Some(image) = images.get(worst.image) {
                crop.html(out, image, worst, least)?;
                none = false;
            }
        }
        out.push_str("</div>\n");
        if none {
            note(out, "none")?;
        }
    }
    out.push_str("</body>\n</html>\n");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inference::OnnxDetector;
    use crate::models::optics::detection::Detection;
    use serde_json::{Value, json};
    use std::path::Path;

    fn model(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
    }

    /// A grey picture with soft dark discs: centre and radius [px].
    fn picture(size_px: [u32; 2], discs: &[[f64; 3]]) -> Vec<u8> {
        let [width, height] = size_px;
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Grayscale);
        let data: Vec<u8> = (0..width * height)
            .map(|i| {
                let (x, y) = (f64::from(i % width) + 0.5, f64::from(i / width) + 0.5);
                // Three grey levels of noise, or the detector's thresholds on it would be zero.
                let noise = f64::from(i.wrapping_mul(2_654_435_761) >> 16 & 3);
                let dark: f64 = (discs.iter())
                    .map(|[cx, cy, r]| (r + 0.5 - (x - cx).hypot(y - cy)).clamp(0.0, 1.0))
                    .sum();
                (170.0 + noise - 90.0 * dark) as u8
            })
            .collect();
        let mut writer = encoder.write_header().expect("a header");
        writer.write_image_data(&data).expect("data");
        writer.finish().expect("an end");
        bytes
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
            images.push(json!({"id": i, "file_name": name, "width": width, "height": height}));
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
            threads: NonZeroUsize::new(1),
        };
        let evaluation = detector(&arguments).expect("an evaluation");
        assert_eq!((evaluation.images, evaluation.boxes), (3, 2));
        assert_eq!(evaluation.ignored, 1);
        assert_eq!(evaluation.threshold, 0.5, "the model's own");
        assert_eq!(evaluation.recall_at_threshold, Some(1.0));
        assert_eq!(evaluation.false_alarms_per_frame, 0.0);
        assert_eq!(evaluation.map50, Some(1.0));
        assert_eq!(evaluation.class_accuracy, None, "one class");
        let miss_px = evaluation.miss_distance_px.mean.expect("hits");
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

        arguments.frames = NonZeroUsize::new(1);
        arguments.threshold = Some(1.0);
        let evaluation = detector(&arguments).expect("an evaluation");
        assert_eq!((evaluation.images, evaluation.boxes), (1, 1));
        assert_eq!(evaluation.recall_at_threshold, Some(0.0));
        assert!(evaluation.command.contains("--threshold 1 --frames 1"));
        arguments.threshold = Some(1.5);
        let error = detector(&arguments).expect_err("refused").to_string();
        assert!(error.contains("--threshold"), "{error}");
        arguments.threshold = None;
        arguments.model = model("absent.onnx");
        let error = detector(&arguments).expect_err("refused").to_string();
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
        let images: Vec<Image> = (coco.truth.iter())
            .map(|truth| Image {
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
