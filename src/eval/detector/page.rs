//! The page of the evaluation, and its figures as text.

use super::coco::{Coco, CocoError};
use super::figures::{Evaluation, Size, Worst};
use super::metrics::AnnotatedImage;
use super::operating::AtThreshold;
use crate::eval::EvalError;
use crate::media::image::jpeg_of;
use crate::output::{columns, put};
use crate::report::chart::{Across, Chart, Scale, Series};
use crate::report::page::{Head, data_url, note, number, page, table};
use image::imageops;
use maud::{Markup, html};
use std::path::Path;

/// Shortest side of a picture of a missed box or false alarm [px].
const CROP_PX: f64 = 96.0;

/// Head of the table of sources.
const SOURCES: [&str; 10] = [
    "source",
    "pictures",
    "boxes",
    "mAP@50",
    "mAP@50–95",
    "AP@50 below 8 px",
    "recall at 0.1 false alarms",
    "from a score of",
    "recall at the threshold",
    "false alarms a frame there",
];

fn share(value: Option<f64>) -> String {
    number(value, 4)
}

impl Evaluation {
    /// The figures with their names.
    fn rows(&self) -> Vec<(&'static str, String)> {
        let mut rows = self.accuracy_rows();
        rows.extend(self.centre_rows());
        rows.extend(self.cost_rows());
        rows
    }

    fn accuracy_rows(&self) -> Vec<(&'static str, String)> {
        let size = |size: &Size| {
            format!(
                "{} / {} ({} boxes)",
                share(size.ap50),
                share(size.ap50_95),
                size.boxes
            )
        };
        vec![
            ("pictures", self.all.images.to_string()),
            (
                "boxes",
                format!("{}, {} regions ignored", self.all.boxes, self.ignored),
            ),
            ("mAP@50", share(self.all.map50)),
            ("mAP@50–95", share(self.all.map50_95)),
            (
                "AP@50 / 50–95 below 8 px",
                size(&self.all.ap_by_size.below_8_px),
            ),
            ("8 to 16 px", size(&self.all.ap_by_size.from_8_to_16_px)),
            ("16 to 32 px", size(&self.all.ap_by_size.from_16_to_32_px)),
            ("above 32 px", size(&self.all.ap_by_size.above_32_px)),
            (
                "recall at 0.1 false alarms a frame",
                format!(
                    "{} from a score of {} on",
                    share(self.all.recall_at_fppi_0_1),
                    number(self.all.score_at_fppi_0_1, 3)
                ),
            ),
            (
                "recall / false alarms a frame at the threshold",
                format!(
                    "{} / {:.3} from a score of {} on",
                    share(self.all.recall_at_threshold),
                    self.all.false_alarms_per_frame,
                    self.threshold
                ),
            ),
            (
                "recommended threshold: rendered / real video",
                format!("{} / {}", self.recommended[0], self.recommended[1]),
            ),
            ("class right where hit", share(self.class_accuracy)),
            (
                "miss distance: mean / rms / median",
                self.all.miss_distance_px.to_string(),
            ),
        ]
    }

    /// The figures with the centre in the box as match.
    fn centre_rows(&self) -> [(&'static str, String); 4] {
        [
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
        ]
    }

    fn cost_rows(&self) -> [(&'static str, String); 3] {
        let (cost, speed) = (&self.cost, &self.speed);
        let [width, height] = cost.gflops_size_px;
        let gflops = match &cost.gflops_missing {
            Some(why) => format!("not counted: {why}"),
            None => format!("{} at {width} × {height} px", number(cost.gflops, 3)),
        };
        [
            (
                "parameters",
                cost.params.map_or("–".into(), |params| params.to_string()),
            ),
            ("GFLOPs", gflops),
            (
                "frames a second, CPU",
                format!(
                    "{:.1} on {} threads, {} ms median",
                    speed.frames_per_s,
                    speed.threads,
                    number(speed.frame_ms_median, 1)
                ),
            ),
        ]
    }

    /// What false alarms lie on, and what distractors are taken for.
    fn distractor_rows(&self) -> Vec<(String, String)> {
        let alarms = (self.operating.alarms_on.iter())
            .map(|(on, rate)| (format!("false alarms a frame on {on}"), rate.text(3)));
        let taken = self.operating.distractors.iter().map(|(name, taken)| {
            let text = format!(
                "{} / {} / {} ({} boxes)",
                taken.as_uav.text(3),
                taken.as_other.text(3),
                taken.rightly.text(3),
                taken.boxes
            );
            (
                format!("{name}: as a UAV / as no UAV / of these rightly"),
                text,
            )
        });
        alarms.chain(taken).collect()
    }

    /// A row for each source.
    fn source_rows(&self) -> Vec<Vec<String>> {
        (self.by_source.iter())
            .map(|(source, of)| {
                vec![
                    source.clone(),
                    of.images.to_string(),
                    of.boxes.to_string(),
                    number(of.map50, 3),
                    number(of.map50_95, 3),
                    number(of.ap_by_size.below_8_px.ap50, 3),
                    number(of.recall_at_fppi_0_1, 3),
                    number(of.score_at_fppi_0_1, 3),
                    number(of.recall_at_threshold, 3),
                    format!("{:.3}", of.false_alarms_per_frame),
                ]
            })
            .collect()
    }

    /// Threshold, recall and false alarms.
    fn threshold_rows(&self) -> Vec<Vec<String>> {
        (self.operating.over_threshold.iter())
            .map(|at| {
                vec![
                    format!("{:.2}", at.threshold),
                    at.recall.text(3),
                    at.false_alarms_per_frame.text(3),
                ]
            })
            .collect()
    }

    /// The figures as lines of text.
    pub fn text(&self) -> String {
        let rows = self
            .rows()
            .into_iter()
            .map(|(name, value)| (name.to_owned(), value));
        let mut text: String = (rows.chain(self.distractor_rows()))
            .map(|(name, value)| format!("{name:<48} {value}\n"))
            .collect();
        if !self.by_source.is_empty() {
            text += &columns(&SOURCES, &self.source_rows(), 1);
        }
        let rows: Vec<Vec<String>> = self.threshold_rows().into_iter().step_by(2).collect();
        text += &columns(&["threshold", "recall", "false alarms a frame"], &rows, 0);
        text += self.stopped.as_deref().unwrap_or_default();
        text
    }
}

/// Writes `detector.html` and its chart.
pub(super) fn write(
    out: &Path,
    coco: &Coco,
    images: &[AnnotatedImage],
    evaluation: &Evaluation,
) -> Result<(), EvalError> {
    let crops = (evaluation.worst.iter())
        .map(|worst| Crop::of(coco, images, worst))
        .collect::<Result<Vec<_>, _>>()?;
    let pr = &evaluation.precision_recall;
    let curves = [&pr.iou_0_50, &pr.iou_0_75, &pr.centre].map(|precision| -> Series {
        (pr.recall.iter().copied())
            .zip(precision.iter().copied())
            .collect()
    });
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
    let across = Across::from_zero("recall", 1.0);
    if let Some(svg) = chart.svg_file(&across) {
        put(&out.join("precision-recall.svg"), svg)?;
    }
    let model = evaluation.model.display().to_string();
    let data = evaluation.data.display().to_string();
    let head = Head {
        title: "Boresight: detector",
        heading: "Detector",
        facts: &[
            ("Model", &model),
            ("Pictures", &data),
            ("Category", &evaluation.categories.join(", ")),
            ("Version", evaluation.version),
            ("", &evaluation.command),
            (evaluation.stopped.as_deref().unwrap_or_default(), ""),
        ],
        ..Head::default()
    };
    let over = |figure: fn(&AtThreshold) -> Option<f64>| -> Series {
        (evaluation.operating.over_threshold.iter())
            .map(|at| (at.threshold, figure(at).unwrap_or(f64::NAN)))
            .collect()
    };
    let series = [
        over(|at| at.recall.value),
        over(|at| at.false_alarms_per_frame.value),
    ];
    let curve = Chart {
        title: "Recall and false alarms a frame",
        unit: "1",
        scale: Scale::Linear,
        series: &[("recall", &series[0]), ("false alarms a frame", &series[1])],
        limit: None,
    };
    let figures = [
        &curve.figure(&Across::from_zero("threshold", 1.0)),
        &chart.figure(&across),
    ];
    let body = body(evaluation, figures, &crops);
    Ok(put(&out.join("detector.html"), page(&head, &body))?)
}

fn body(evaluation: &Evaluation, [curve, chart]: [&Markup; 2], crops: &[Crop]) -> Markup {
    let rows: Vec<Vec<String>> = (evaluation.rows().into_iter())
        .map(|(name, value)| vec![name.into(), value])
        .collect();
    let least = evaluation.all.score_at_fppi_0_1.unwrap_or(f64::INFINITY);
    let others: Vec<Vec<String>> = (evaluation.distractor_rows().into_iter())
        .map(|(name, value)| vec![name, value])
        .collect();
    let intervals = format!(
        "In brackets: 95 % intervals by drawing the {} clips anew. A detection that is called no UAV is \
         no false alarm.",
        evaluation.operating.clips
    );
    html! {
        h2 { "Figures" }
        (table(&["figure", "value"], &rows))
        (note(
            "Average precision as pycocotools gives it: 101 recalls, at most 100 detections a picture. \
             Sizes are roots of the boxes' areas. Detections in ignored regions count neither for nor \
             against.",
        ))
        @if !evaluation.by_source.is_empty() {
            h2 { "By source" }
            (table(&SOURCES, &evaluation.source_rows()))
        }
        h2 { "What is no UAV" }
        (table(&["figure at the threshold", "value"], &others))
        (note(&intervals))
        h2 { "Over the threshold" }
        (table(&["threshold", "recall", "false alarms a frame"], &evaluation.threshold_rows()))
        div .charts style="max-width:44rem" { (curve) }
        h2 { "Precision over recall" }
        div .charts style="max-width:44rem" { (chart) }
        h2 { "Worst misses" }
        (sheet(
            "The largest boxes that are missed at 0.1 false alarms a frame, one a scene.",
            crops.iter().filter(|crop| crop.worst.kind == "missed"),
            least,
        ))
        h2 { "Worst false alarms" }
        (sheet(
            "The most confident detections that match no box at an IoU of 0.5, one a scene.",
            crops.iter().filter(|crop| crop.worst.kind == "false_alarm"),
            least,
        ))
    }
}

/// Pictures with the detections from a score of `least` on.
fn sheet<'a>(text: &str, crops: impl Iterator<Item = &'a Crop<'a>> + Clone, least: f64) -> Markup {
    html! {
        (note(&format!("{text} Green: boxes; orange: detections; dashed: ignored regions.")))
        div .sheet {
            @for crop in crops.clone() { (crop.figure(least)) }
        }
        @if crops.count() == 0 { (note("none")) }
    }
}

/// The surroundings of a missed box or a false alarm.
struct Crop<'a> {
    worst: &'a Worst,
    image: &'a AnnotatedImage,
    /// x0, y0, width, height in the picture [px].
    rect_px: [u32; 4],
    jpeg: Vec<u8>,
}

impl<'a> Crop<'a> {
    fn of(coco: &Coco, images: &'a [AnnotatedImage], worst: &'a Worst) -> Result<Self, EvalError> {
        let absent = || CocoError::Layout {
            path: coco.file.clone(),
            why: format!("it has no picture {}", worst.image),
        };
        let picture = coco.pictures.get(worst.image).ok_or_else(absent)?;
        let image = images.get(worst.image).ok_or_else(absent)?;
        let [x0, y0, x1, y1] = worst.box_px;
        let side = CROP_PX.max(3.0 * (x1 - x0).max(y1 - y0)) as u32;
        let place = |low: f64, high: f64, size: u32| {
            let side = side.min(size);
            let first = (0.5 * (low + high) - 0.5 * f64::from(side)).round();
            (first.clamp(0.0, f64::from(size - side)) as u32, side)
        };
        let (left, width) = place(x0, x1, picture.width);
        let (top, height) = place(y0, y1, picture.height);
        let whole = coco.image(picture)?;
        let piece = imageops::crop_imm(&whole, left, top, width, height).to_image();
        Ok(Self {
            worst,
            image,
            rect_px: [left, top, width, height],
            jpeg: jpeg_of(&piece, 90)?,
        })
    }

    fn figure(&self, least: f64) -> Markup {
        let [left, top, width, height] = self.rect_px;
        let unit = f64::from(width) / 320.0;
        let dash = format!("{:.2}", 6.0 * unit);
        let [x0, y0, x1, y1] = self.worst.box_px;
        html! {
            figure {
                svg viewBox=(format_args!("{left} {top} {width} {height}"))
                    font-size=(format_args!("{:.2}", 13.0 * unit))
                    stroke-width=(format_args!("{:.2}", 2.0 * unit))
                    fill="none"
                {
                    image x=(left) y=(top) width=(width) height=(height)
                        style="image-rendering:pixelated" href=(data_url(&self.jpeg)) {}
                    @for truth in &self.image.truth {
                        @if truth.ignored {
                            (outline(truth.box_px, "#fff", Some(&dash)))
                        } @else {
                            (outline(truth.box_px, "#2fe6a0", None))
                        }
                    }
                    @for found in &self.image.found {
                        @if found.score >= least || self.is_alarm(found.box_px) {
                            (outline(found.box_px, "#ff9d2e", None))
                        }
                    }
                }
                figcaption {
                    b { (self.worst.file_name) } " "
                    span .note {
                        (format_args!("{:.0} × {:.0} px, ", x1 - x0, y1 - y0)) (self.score())
                    }
                }
            }
        }
    }

    /// Whether a box is the false alarm that this picture is about.
    fn is_alarm(&self, box_px: [f64; 4]) -> bool {
        self.worst.kind == "false_alarm" && box_px == self.worst.box_px
    }

    fn score(&self) -> String {
        match (self.worst.kind, self.worst.score) {
            ("missed", Some(score)) => format!("matched with a score of {score:.2} only"),
            ("missed", None) => "no match at any score".into(),
            (_, score) => format!("score {}", number(score, 2)),
        }
    }
}

fn outline([x0, y0, x1, y1]: [f64; 4], stroke: &str, dash: Option<&str>) -> Markup {
    html! {
        rect x=(format_args!("{x0:.1}"))
            y=(format_args!("{y0:.1}"))
            width=(format_args!("{:.1}", x1 - x0))
            height=(format_args!("{:.1}", y1 - y0))
            stroke=(stroke) stroke-dasharray=[dash] {}
    }
}
