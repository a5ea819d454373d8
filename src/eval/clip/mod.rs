//! `boresight eval clip`: a detector and the tracker on clips of real cameras.

mod draw;
pub mod figures;
mod follow;
mod page;
mod play;
pub mod truth;

use super::EvalError;
use super::shared::{put, put_json, quoted, threads, within, within_share, writable};
use crate::inference::OnnxDetector;
use crate::media::video::Clip;
use clap::Args;
use figures::{Evaluation, Tally};
use play::play;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use truth::BoxFile;

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
    /// Detections with a lower score are dropped, 0 to 1; the model's own threshold by default.
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
    #[arg(long, default_value_t = 1.0)]
    pub fov_deg: f64,
    /// Standard deviation of a detection's centre that the tracker counts on [px]; on real pixels
    /// it is larger than the 0.5 px of a run.
    #[arg(long, default_value_t = 2.0)]
    pub centre_sigma_px: f64,
    /// Pictures a second of a folder [Hz].
    #[arg(long, default_value_t = 30.0)]
    pub rate_hz: f64,
    /// Threads of the model (default: all cores).
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// Carries out the evaluation and writes what it leaves.
pub fn evaluate(arguments: &Arguments) -> Result<Evaluation, EvalError> {
    let fov_deg = arguments.fov_deg;
    within_share("--threshold", arguments.threshold)?;
    within("--fov-deg", fov_deg, 0.01, 170.0)?;
    within("--centre-sigma-px", arguments.centre_sigma_px, 0.01, 20.0)?;
    within("--rate-hz", arguments.rate_hz, 0.1, 10_000.0)?;
    let boxes = arguments.boxes.as_deref();
    let truth = boxes
        .map(|path| BoxFile::load(path, &arguments.category))
        .transpose()?;
    let threads = threads(arguments.threads);
    let mut model = OnnxDetector::load(&arguments.model, threads)?;
    let threshold = arguments.threshold.unwrap_or(model.score_threshold());
    let arguments = &Arguments {
        threshold: Some(threshold),
        ..arguments.clone()
    };
    // What cannot be read or written is told before the work.
    for file in &arguments.files {
        let clip = Clip::open(file, arguments.rate_hz)?;
        if let Some(truth) = &truth {
            truth.check(file, &clip)?;
        }
    }
    writable(&arguments.out.join("clip.json"))?;
    let head = |files: &[PathBuf]| Evaluation {
        version: crate::VERSION,
        command: command(arguments, files, threads, threshold),
        model: arguments.model.clone(),
        boxes_file: arguments.boxes.clone(),
        threshold,
        fov_deg,
        centre_sigma_px: arguments.centre_sigma_px,
        threads,
        figures: Tally::default().figures(),
        clips: Vec::new(),
    };
    let several = arguments.files.len() > 1;
    let names = folder_names(&arguments.files);
    let mut all = Tally::default();
    let mut clips = Vec::new();
    for (file, name) in arguments.files.iter().zip(&names) {
        let folder = if several {
            arguments.out.join(name)
        } else {
            arguments.out.clone()
        };
        let played = play(&mut model, file, name, truth.as_ref(), arguments, &folder)?;
        all.add(&played.tally);
        clips.push(played.clip.clone());
        let evaluation = Evaluation {
            figures: played.clip.figures.clone(),
            clips: vec![played.clip.clone()],
            ..head(std::slice::from_ref(file))
        };
        write(
            &folder,
            &evaluation,
            page::of_one(&evaluation, name, &played),
        )?;
    }
    let evaluation = Evaluation {
        figures: all.figures(),
        clips,
        ..head(&arguments.files)
    };
    if several {
        let page = page::of_all(&evaluation, &names);
        write(&arguments.out, &evaluation, page)?;
    }
    Ok(evaluation)
}

fn write(folder: &Path, evaluation: &Evaluation, page: String) -> Result<(), EvalError> {
    put_json(&folder.join("clip.json"), evaluation)?;
    Ok(put(&folder.join("clip.html"), page)?)
}

/// The command that repeats the evaluation of `files`.
fn command(arguments: &Arguments, files: &[PathBuf], threads: usize, threshold: f64) -> String {
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
    format!(
        "boresight eval clip{files} --model {} --threshold {}{boxes}{categories} --fov-deg {} \
         --centre-sigma-px {} --rate-hz {} --threads {threads}",
        quoted(arguments.model.display()),
        threshold,
        arguments.fov_deg,
        arguments.centre_sigma_px,
        arguments.rate_hz
    )
}

/// A folder for every clip: its name without ending, numbered where that is not unique.
fn folder_names(files: &[PathBuf]) -> Vec<String> {
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

#[cfg(test)]
mod tests;
