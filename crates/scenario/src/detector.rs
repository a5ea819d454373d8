//! What finds UAVs in the images.

use std::fmt;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{Check, FRACTION};

/// What finds UAVs in the images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Detector")]
pub struct DetectorConfig {
    /// "onnx": a neural network on the rendered images; "measured": what that network was measured to find, which needs no
    /// images; "truth": the true positions with errors added, which needs none either; "recorded": answers that were
    /// kept; or a detector of one's own.
    pub kind: String,
    /// The file of the kept answers, relative to the scenario: what a run leaves whose detector was another program.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub answers: Option<String>,
    /// The ONNX file, relative to the working directory or, where it is not there, to the program's data.
    pub onnx_model: PathBuf,
    /// The file of a measured detector and recogniser, relative to the working directory or, where it is not there, to the
    /// program's data; `boresight fit-detector` makes one.
    pub measured: PathBuf,
    /// What runs the network; the loaded ONNX Runtime must have it.
    pub provider: Provider,
    /// Detections with a lower score start no track, 0 to 1; absent: the score that the model recommends.
    pub score_threshold: Option<f64>,
    /// Share of that threshold, 0 to 1, from which on a detection may go on with a track that several
    /// frames have confirmed; what scores lower is dropped.
    pub weak_share: f64,
    /// Side of the square around the predicted target in which the network looks while a camera
    /// follows it, twice the target's size if that is more; 0: in all that the camera reads out.
    pub roi_px: u32,
    /// Whether a search camera's frames are also laid on one another, to find dots by how they move against the scenery.
    pub moving: bool,
    /// Errors of the truth detector.
    pub truth: TruthErrorsConfig,
}

impl Default for DetectorConfig {
    fn default() -> Self {
        Self {
            kind: ONNX.into(),
            answers: None,
            onnx_model: PathBuf::from("assets/models/boresight-p2-roi.onnx"),
            measured: PathBuf::from("assets/models/measured.json"),
            provider: Provider::Cpu,
            score_threshold: None,
            weak_share: 0.5,
            roi_px: 128,
            moving: true,
            truth: TruthErrorsConfig::default(),
        }
    }
}

/// The kind of detector that is a neural network in ONNX form.
pub const ONNX: &str = "onnx";
/// The kind that is the true positions with noise, misses and false alarms; it needs no images.
pub const TRUTH: &str = "truth";

/// The kind that is a statistical model of a network and a recogniser as they were measured; it needs no images.
pub const MEASURED: &str = "measured";

/// The kind that gives the answers that another program gave before.
pub const RECORDED: &str = "recorded";

/// Execution provider of ONNX Runtime.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Provider {
    /// The processor; the only one whose results are the same on every machine.
    Cpu,
    /// An NVIDIA GPU through CUDA.
    Cuda,
    /// An NVIDIA GPU through TensorRT, with CUDA for what that does not take.
    Tensorrt,
}

impl Provider {
    /// Its name in ONNX Runtime.
    pub fn runtime_name(self) -> &'static str {
        match self {
            Self::Cpu => "CPU",
            Self::Cuda => "CUDA",
            Self::Tensorrt => "TensorRT",
        }
    }
}

impl fmt::Display for Provider {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.runtime_name())
    }
}

/// Errors of the truth detector.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "TruthErrors")]
pub struct TruthErrorsConfig {
    /// Standard deviation of the box centre, each axis.
    pub noise_px: f64,
    /// Chance that a visible UAV is missed in a frame, 0 to 1.
    pub miss_rate: f64,
    /// Chance that a visible distractor is reported as a UAV in a frame, 0 to 1.
    pub distractor_rate: f64,
    /// Mean number of false alarms in a frame.
    pub false_alarms_per_frame: f64,
}

impl Default for TruthErrorsConfig {
    fn default() -> Self {
        Self {
            noise_px: 0.5,
            miss_rate: 0.02,
            distractor_rate: 0.3,
            false_alarms_per_frame: 0.01,
        }
    }
}

impl DetectorConfig {
    /// Whether it is a network.
    pub fn is_onnx(&self) -> bool {
        self.kind == ONNX
    }

    /// Whether it is the truth with errors added.
    pub fn is_truth(&self) -> bool {
        self.kind == TRUTH
    }

    /// Whether it is a network's measured likeness.
    pub fn is_measured(&self) -> bool {
        self.kind == MEASURED
    }

    /// Whether it works without pictures, as far as its kind is known.
    pub fn is_blind(&self) -> bool {
        self.is_truth() || self.is_measured()
    }

    pub(super) fn check(&self, check: &mut Check) {
        check.maybe_within("score_threshold", self.score_threshold, FRACTION);
        check.within("weak_share", self.weak_share, FRACTION);
        let roi_px = self.roi_px;
        let right = roi_px == 0 || (16..=8192).contains(&roi_px);
        check.that(right, "roi_px", || {
            format!("found {roi_px}, must be 0 or from 16 to 8192")
        });
        check.table("truth", |check| self.truth.check(check));
        let recorded = self.kind == RECORDED;
        check.that(recorded == self.answers.is_some(), "answers", || match recorded {
            true => format!("is missing: a detector of the kind \"{RECORDED}\" needs the file of its answers"),
            false => format!("belongs to kind = \"{RECORDED}\": leave it out, or say so"),
        });
    }
}

impl TruthErrorsConfig {
    fn check(&self, check: &mut Check) {
        check.within("noise_px", self.noise_px, 0.0..=100.0);
        check.within("miss_rate", self.miss_rate, FRACTION);
        check.within("distractor_rate", self.distractor_rate, FRACTION);
        let false_alarms = self.false_alarms_per_frame;
        check.within("false_alarms_per_frame", false_alarms, 0.0..=100.0);
    }
}
