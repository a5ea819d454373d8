//! What the command line asks for, and the command that repeats it.

use super::follow::{CENTRE_SIGMA_PX, FOV_DEG};
use crate::output::quoted;
use clap::Args;
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// What `boresight eval clip` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// Clips: MP4 or MOV files with H.264, or folders of numbered pictures (PNG, JPEG).
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// ONNX model with the interface of training/README.md.
    #[arg(long)]
    pub model: PathBuf,
    /// Folder for clip.json, clip.html, overlay.mp4 and tracks.txt; of several clips, each has a
    /// folder in it.
    #[arg(long, default_value = "out/clip")]
    pub out: PathBuf,
    /// Detections with a lower score are dropped, 0 to 1; by default the one that the model
    /// recommends for real video.
    #[arg(long)]
    pub threshold: Option<f64>,
    /// Truth: a list of {file, frames, boxes_xywh}, boxes by label for every frame; for folders of
    /// pictures also COCO annotations.
    #[arg(long, value_name = "JSON")]
    pub boxes: Option<PathBuf>,
    /// Label of the boxes that are UAVs; may be repeated (default: uav, drone and kinds of them,
    /// but not bird, airplane, helicopter, balloon).
    #[arg(long, value_name = "NAME")]
    pub category: Vec<String>,
    /// Horizontal field of view that the tracker counts on [deg].
    #[arg(long, default_value_t = FOV_DEG)]
    pub fov_deg: f64,
    /// Standard deviation of a detection's centre that the tracker counts on [px]; on real pixels
    /// it is larger than the 0.5 px of a run.
    #[arg(long, default_value_t = CENTRE_SIGMA_PX)]
    pub centre_sigma_px: f64,
    /// ONNX recogniser with the interface of training/README.md: the figures also say how often a track is
    /// held as a UAV.
    #[arg(long, value_name = "ONNX")]
    pub recogniser: Option<PathBuf>,
    /// Least probability with which the recogniser's word counts as "a UAV", 0 to 1. The default is the highest
    /// at which, on clips held out from its training, UAVs are held as such as long as at 0.5.
    #[arg(long, default_value_t = 0.7)]
    pub uav_probability: f64,
    /// Pictures a second of a folder [Hz].
    #[arg(long, default_value_t = 30.0)]
    pub rate_hz: f64,
    /// Threads of the model (default: all cores).
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// The command that repeats the evaluation of `files`.
pub(super) fn command(
    arguments: &Arguments,
    files: &[PathBuf],
    threads: usize,
    threshold: f64,
) -> String {
    let files: String = (files.iter())
        .map(|file| format!(" {}", quoted(file.display())))
        .collect();
    let boxes = arguments.boxes.as_ref();
    let boxes = boxes.map_or(String::new(), |b| {
        format!(" --boxes {}", quoted(b.display()))
    });
    let categories: String = (arguments.category.iter())
        .map(|name| format!(" --category {}", quoted(name)))
        .collect();
    let recogniser = (arguments.recogniser.as_ref()).map_or(String::new(), |file| {
        let (file, p) = (quoted(file.display()), arguments.uav_probability);
        format!(" --recogniser {file} --uav-probability {p}")
    });
    format!(
        "boresight eval clip{files} --model {} --threshold {}{boxes}{categories}{recogniser} --fov-deg {} \
         --centre-sigma-px {} --rate-hz {} --threads {threads}",
        quoted(arguments.model.display()),
        threshold,
        arguments.fov_deg,
        arguments.centre_sigma_px,
        arguments.rate_hz
    )
}

/// A folder for every clip: its name without ending, numbered where that is not unique.
pub(super) fn folder_names(files: &[PathBuf]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for file in files {
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        let mut name = stem.to_string();
        let mut number = 2;
        while name.is_empty() || names.contains(&name) {
            name = format!("{stem}-{number}");
            number += 1;
        }
        names.push(name);
    }
    names
}
