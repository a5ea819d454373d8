//! Hashes by which runs and the files that they read are told apart.

use crate::models::flight::trajectory::Trajectory;
use crate::scenario::Scenario;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::Xxh3;

/// The files that the runs of a scenario read.
pub(super) fn named_files(scenario: &Scenario) -> BTreeSet<PathBuf> {
    let detector = &scenario.detector;
    let mut files: BTreeSet<PathBuf> = (scenario.recogniser.model(detector).map(Path::to_path_buf))
        .into_iter()
        .chain(detector.is_onnx().then(|| detector.onnx_model.clone()))
        .chain(detector.is_measured().then(|| detector.measured.clone()))
        .collect();
    let flights = (scenario.uavs.iter().map(|uav| &uav.trajectory))
        .chain(scenario.distractors.iter().map(|other| &other.trajectory));
    for flight in flights {
        if let Trajectory::Recorded { file } = flight {
            files.insert(file.into());
        }
    }
    // What is no path is a name of the catalogue, which the program holds.
    let models = scenario.uavs.iter().map(|uav| &uav.model);
    files.extend(
        models
            .filter(|model| model.ends_with(".toml"))
            .map(PathBuf::from),
    );
    files
}

/// A digest of the contents of files; 0 of none.
pub(super) fn digest(files: &BTreeSet<PathBuf>) -> u64 {
    if files.is_empty() {
        return 0;
    }
    let mut hasher = Xxh3::new();
    for file in files {
        // One that is not there is told by the runs.
        let bytes = std::fs::read(crate::data::found(file)).unwrap_or_default();
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(&bytes);
    }
    hasher.digest()
}

/// A hash of words and a number, in hexadecimal digits.
pub(super) fn hash_of<'a>(words: impl Iterator<Item = &'a str>, number: u64) -> String {
    let mut hasher = Xxh3::new();
    for word in words {
        hasher.update(&(word.len() as u64).to_le_bytes());
        hasher.update(word.as_bytes());
    }
    hasher.update(&number.to_le_bytes());
    format!("{:016x}", hasher.digest())
}
