//! What a unit brings along: the scenario, and the files that it names.

use super::error::FmuError;
use crate::output;
use crate::place::located;
use crate::scenario::Scenario;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Name of the scenario among the resources.
pub const SCENARIO: &str = "scenario.toml";
/// Name of the file that names the station.
pub const STATION: &str = "station.txt";
/// Folder of what the scenario names.
const FILES: &str = "files";
/// Files of a tileset's folder at most: more is a disc, and not a tileset.
const MOST_FILES: usize = 100_000;

/// Writes the scenario into a folder, with what it names beside it, and returns its text.
pub(super) fn write(scenario: &Scenario, from: &Path, into: &Path) -> Result<String, FmuError> {
    let mut scenario = scenario.clone();
    let mut taken = Taken {
        into: into.to_owned(),
        names: BTreeMap::new(),
    };
    for path in scenario.paths_mut() {
        let at = located(from, path);
        if !at.contains("://") {
            *path = taken.take(Path::new(&at))?;
        }
    }
    for uav in &mut scenario.uavs {
        if uav.model.ends_with(".toml") {
            let at = crate::data::found(Path::new(&uav.model));
            uav.model = taken.take(&at)?;
        }
    }
    let text = toml::to_string(&scenario).map_err(FmuError::Scenario)?;
    output::put(&into.join(SCENARIO), &text)?;
    Ok(text)
}

/// Changes by which the scenario finds its UAVs' files in the resources: those count from the working directory.
pub(super) fn found_in(scenario: &Scenario, resources: &Path) -> Vec<String> {
    let uavs = scenario.uavs.iter().enumerate();
    uavs.filter(|(_, uav)| uav.model.ends_with(".toml"))
        .map(|(at, uav)| {
            let file = resources.join(&uav.model).to_string_lossy().into_owned();
            format!("uavs.{at}.model={}", toml::Value::String(file))
        })
        .collect()
}

/// Files that were taken, each into a folder of its own.
struct Taken {
    into: PathBuf,
    names: BTreeMap<PathBuf, String>,
}

impl Taken {
    /// Takes a file, and where it lies then, seen from the scenario.
    fn take(&mut self, at: &Path) -> Result<String, FmuError> {
        if let Some(name) = self.names.get(at) {
            return Ok(name.clone());
        }
        let name = at
            .file_name()
            .map(|name| name.to_string_lossy().into_owned());
        let name = name.ok_or_else(|| FmuError::File(at.to_owned(), "names no file".to_owned()))?;
        let folder = format!("{FILES}/{}", self.names.len());
        let to = self.into.join(&folder);
        let copied = match at.extension().is_some_and(|end| end == "json") {
            // A tileset is its folder.
            true => at.parent().map_or(Ok(0), |from| copy_all(from, &to, 0)),
            false => copy_stem(at, &to),
        };
        copied.map_err(|error| FmuError::File(at.to_owned(), error.to_string()))?;
        let name = format!("{folder}/{name}");
        self.names.insert(at.to_owned(), name.clone());
        Ok(name)
    }
}

/// Copies a file and those beside it that differ in their ending alone, such as a world file.
fn copy_stem(at: &Path, to: &Path) -> std::io::Result<usize> {
    fs::create_dir_all(to)?;
    let beside = at.parent().filter(|folder| !folder.as_os_str().is_empty());
    let mut copied = 0;
    for entry in fs::read_dir(beside.unwrap_or(Path::new(".")))? {
        let path = entry?.path();
        let same = path.file_stem() == at.file_stem() || path.file_name() == at.file_name();
        if let (true, Some(name)) = (same && path.is_file(), path.file_name()) {
            fs::copy(&path, to.join(name))?;
            copied += 1;
        }
    }
    match copied {
        0 => Err(std::io::Error::from(std::io::ErrorKind::NotFound)),
        copied => Ok(copied),
    }
}

/// Copies a folder and what is below it.
fn copy_all(from: &Path, to: &Path, before: usize) -> std::io::Result<usize> {
    fs::create_dir_all(to)?;
    let mut copied = before;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let to = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            copied = copy_all(&entry.path(), &to, copied)?;
        } else {
            fs::copy(entry.path(), to)?;
            copied += 1;
        }
        if copied > MOST_FILES {
            let why = format!("its folder holds more than {MOST_FILES} files");
            return Err(std::io::Error::other(why));
        }
    }
    Ok(copied)
}
