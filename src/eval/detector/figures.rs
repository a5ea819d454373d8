//! What the evaluation measured, as `detector.json` has it.

use super::metrics::{
    ALL, AnnotatedImage, BANDS, Band, Criterion, Matching, mean_average_precision, recall_level,
};
use super::operating::Operating;
use crate::report::page::number;
use crate::report::statistics::MissStats;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

/// The rate at which the recall is given [false alarms a frame].
pub(super) const FPPI: f64 = 0.1;

/// What was measured, as `detector.json` has it; its keys do not change. A figure without boxes to
/// measure it on is null.
#[derive(Debug, Serialize)]
pub struct Evaluation {
    /// Version of the program.
    pub version: &'static str,
    /// The command that repeats it.
    pub command: String,
    /// What was left out, where it was stopped.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped: Option<String>,
    /// The model file.
    pub model: PathBuf,
    /// The annotation file.
    pub data: PathBuf,
    /// Categories that count.
    pub categories: Vec<String>,
    /// The figures of all pictures.
    #[serde(flatten)]
    pub all: Figures,
    /// Regions that are ignored.
    pub ignored: usize,
    /// Precision over recall.
    pub precision_recall: PrecisionRecall,
    /// Thresholds that the model recommends: of rendered pictures, and of real video.
    pub recommended: [f64; 2],
    /// The score of `--threshold`, or the one that the model recommends.
    pub threshold: f64,
    /// Recall and false alarms over the threshold, and what false alarms lie on.
    #[serde(flatten)]
    pub operating: Operating,
    /// Share of the boxes hit at an IoU of 0.5 whose category the detection's class names; null if
    /// model or categories have one class only.
    pub class_accuracy: Option<f64>,
    /// Miss distance and the like with the centre in the box as match, for loosely drawn boxes.
    pub centre_hit: CentreHit,
    /// Figures of each source that the pictures name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub by_source: BTreeMap<String, Figures>,
    /// What the model costs.
    #[serde(flatten)]
    pub cost: Cost,
    /// How fast it was.
    #[serde(flatten)]
    pub speed: Speed,
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

impl BySize {
    /// The bands of all pictures.
    pub(super) fn of(images: &[AnnotatedImage]) -> Self {
        let [below_8_px, from_8_to_16_px, from_16_to_32_px, above_32_px] =
            BANDS.map(|band| Size::of(images, band));
        Self {
            below_8_px,
            from_8_to_16_px,
            from_16_to_32_px,
            above_32_px,
        }
    }
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
    fn of(images: &[AnnotatedImage], band: Band) -> Self {
        let matching = Matching::of(images, Criterion::Iou(0.5), band);
        Self {
            boxes: matching.boxes,
            ap50: matching.average_precision(),
            ap50_95: mean_average_precision(images, band),
        }
    }
}

/// Figures of some pictures, such as those of one source.
#[derive(Debug, Serialize)]
pub struct Figures {
    /// Number of pictures.
    pub images: usize,
    /// Boxes that count.
    pub boxes: usize,
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
    /// Recall of the detections from the evaluation's threshold on, IoU of 0.5.
    pub recall_at_threshold: Option<f64>,
    /// False alarms a frame among them.
    pub false_alarms_per_frame: f64,
    /// Distance of the centres of detections and boxes that match at an IoU of 0.5.
    pub miss_distance_px: Miss,
}

impl Figures {
    /// The figures of detections in some pictures, matched at an IoU of 0.5 as `half`, from a score of `threshold` on where
    /// they have one.
    pub(super) fn of(images: &[AnnotatedImage], half: &Matching, threshold: f64) -> Self {
        let recall = half.recall_at(FPPI);
        let (recall_at_threshold, false_alarms_per_frame) = half.at_score(threshold);
        Self {
            images: images.len(),
            boxes: half.boxes,
            map50: half.average_precision(),
            map50_95: mean_average_precision(images, ALL),
            ap_by_size: BySize::of(images),
            recall_at_fppi_0_1: recall.map(|(recall, _)| recall),
            score_at_fppi_0_1: recall.map(|(_, score)| score).filter(|s| s.is_finite()),
            recall_at_threshold,
            false_alarms_per_frame,
            miss_distance_px: Miss::of(half.miss_distances_px(images)),
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

impl PrecisionRecall {
    /// The curves of matchings at an IoU of 0.5, of 0.75, and by the centre.
    pub(super) fn of(half: &Matching, strict: &Matching, centre: &Matching) -> Self {
        let curve = |matching: &Matching| matching.precision().map_or(Vec::new(), |p| p.to_vec());
        let iou_0_50 = curve(half);
        Self {
            recall: (0..iou_0_50.len()).map(recall_level).collect(),
            iou_0_50,
            iou_0_75: curve(strict),
            centre: curve(centre),
        }
    }
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
    /// Number of matches.
    pub n: usize,
}

impl Miss {
    pub(in crate::eval) fn of(px: impl IntoIterator<Item = f64>) -> Self {
        let stats = MissStats::of(px);
        Self {
            mean: stats.map(|s| s.mean),
            rms: stats.map(|s| s.rms),
            median: stats.map(|s| s.p50),
            n: stats.map_or(0, |s| s.n),
        }
    }
}

impl fmt::Display for Miss {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
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

impl CentreHit {
    /// The figures of detections from a score of `threshold` on.
    pub(super) fn of(images: &[AnnotatedImage], centre: &Matching, threshold: f64) -> Self {
        let (recall_at_threshold, false_alarms_per_frame) = centre.at_score(threshold);
        Self {
            ap: centre.average_precision(),
            recall_at_fppi_0_1: centre.recall_at(FPPI).map(|(recall, _)| recall),
            recall_at_threshold,
            false_alarms_per_frame,
            miss_distance_px: Miss::of(centre.miss_distances_px(images)),
        }
    }
}

/// What a model costs.
#[derive(Debug, Serialize)]
pub struct Cost {
    /// Parameters; null if the file does not show them.
    pub params: Option<u64>,
    /// Operations of the largest picture, 10⁹; null if they could not be counted.
    pub gflops: Option<f64>,
    /// Width and height of the model's input for that picture [px].
    pub gflops_size_px: [u32; 2],
    /// Why there are no GFLOPs.
    pub gflops_missing: Option<String>,
}

/// How fast a model is.
#[derive(Debug, Serialize)]
pub struct Speed {
    /// Pictures over the time that the detector took for them, decoding apart.
    pub frames_per_s: f64,
    /// Median time of a picture [ms].
    pub frame_ms_median: Option<f64>,
    /// Threads of the model, on the CPU.
    pub threads: usize,
}

impl Speed {
    /// From the time of each picture.
    pub(super) fn of(times: &[Duration], threads: usize) -> Self {
        let times_ms = MissStats::of(times.iter().map(|time| 1e3 * time.as_secs_f64()));
        let seconds: f64 = times.iter().map(Duration::as_secs_f64).sum();
        Self {
            frames_per_s: times.len() as f64 / seconds.max(f64::MIN_POSITIVE),
            frame_ms_median: times_ms.map(|s| s.p50),
            threads,
        }
    }
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
    /// Its place among the pictures.
    #[serde(skip)]
    pub(super) image: usize,
}
