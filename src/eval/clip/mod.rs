//! `boresight eval clip`: a detector and the tracker on clips of real cameras.

mod arguments;
mod draw;
pub mod figures;
pub mod follow;
mod page;
mod play;
pub mod truth;

use super::EvalError;
use super::shared::{within, within_share};
use crate::inference::OnnxDetector;
use crate::media::video::Clip;
use crate::output::{put, put_json, writable};
use crate::parallel::threads;
use crate::stop;
use crate::warning;
pub use arguments::Arguments;
use arguments::{command, folder_names};
use figures::{Evaluation, Tally};
use play::play;
pub use play::weak_score;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use truth::BoxFile;

/// Carries out the evaluation and writes what it leaves.
pub fn evaluate(arguments: &Arguments) -> Result<Evaluation, EvalError> {
    let fov_deg = arguments.fov_deg;
    within_share("--threshold", arguments.threshold)?;
    within("--uav-probability", arguments.uav_probability, 0.0, 1.0)?;
    within("--fov-deg", fov_deg, 0.01, 170.0)?;
    within("--centre-sigma-px", arguments.centre_sigma_px, 0.01, 20.0)?;
    within("--rate-hz", arguments.rate_hz, 0.1, 10_000.0)?;
    let boxes = arguments.boxes.as_deref();
    let truth = boxes
        .map(|path| BoxFile::load(path, &arguments.category))
        .transpose()?;
    let threads = threads(arguments.threads);
    let mut model = OnnxDetector::load(&arguments.model, threads)?;
    let threshold = arguments.threshold.unwrap_or(model.score_threshold_video());
    let arguments = &Arguments {
        threshold: Some(threshold),
        ..arguments.clone()
    };
    // What cannot be read or written is told before the work.
    for file in &arguments.files {
        let clip = Clip::open(file, arguments.rate_hz)?;
        warning::tell(clip.warnings())?;
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
        recogniser: arguments.recogniser.clone(),
        uav_probability: arguments.uav_probability,
        threshold,
        fov_deg,
        centre_sigma_px: arguments.centre_sigma_px,
        threads,
        stopped: None,
        figures: Tally::default().figures(),
        by_label: BTreeMap::new(),
        clips: Vec::new(),
    };
    let several = arguments.files.len() > 1;
    let names = folder_names(&arguments.files);
    let mut all = Tally::default();
    let mut by_label: BTreeMap<String, Tally> = BTreeMap::new();
    let mut clips = Vec::new();
    let mut all_stopped = None;
    for (file, name) in arguments.files.iter().zip(&names) {
        let folder = if several {
            arguments.out.join(name)
        } else {
            arguments.out.clone()
        };
        let played = play(&mut model, file, name, truth.as_ref(), arguments, &folder)?;
        all.add(&played.tally);
        for label in &played.clip.labels {
            by_label
                .entry(label.clone())
                .or_default()
                .add(&played.tally);
        }
        clips.push(played.clip.clone());
        let stopped = stop::said(&format!(
            "{name} is played to {:.2} s; the same command plays all anew",
            played.end_s
        ));
        let evaluation = Evaluation {
            stopped: stopped.clone(),
            figures: played.clip.figures.clone(),
            clips: vec![played.clip.clone()],
            ..head(std::slice::from_ref(file))
        };
        write(
            &folder,
            &evaluation,
            page::of_one(&evaluation, name, &played),
        )?;
        if stopped.is_some() {
            all_stopped = stopped;
            break;
        }
    }
    let evaluation = Evaluation {
        stopped: all_stopped,
        figures: all.figures(),
        by_label: (by_label.into_iter())
            .map(|(label, tally)| (label, tally.figures()))
            .collect(),
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

#[cfg(test)]
mod tests;
