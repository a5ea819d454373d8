//! One draw made: its scenario, its run, the files that it leaves.
//!
//! A draw whose record is there is whole: the record is written last, by renaming.

use super::arguments::Arguments;
use super::draw::{Draw, Facts};
use super::recipe::Recipe;
use super::verdict::{Record, Verdict};
use super::watch::Watch;
use crate::eval::EvalError;
use crate::experiment::runner::Runner;
use crate::media::image::encode_jpeg;
use crate::models::sensing::measured::Row;
use crate::output::OutputError;
use crate::output::{put, put_json, quoted};
use crate::report::run::ContactFrame;
use crate::scenario::{Loaded, Scenario};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::{Xxh3, xxh3_128};

/// What a draw leaves.
#[derive(Serialize, Deserialize)]
pub struct Outcome {
    /// Tells program, recipe, seed, changes and model from others.
    pub key: String,
    /// What was drawn.
    pub facts: Facts,
    /// What was seen of it.
    pub record: Record,
    /// What became of it.
    pub verdict: Verdict,
    /// The command that repeats the run.
    pub command: String,
    /// Pictures of the moment that shows a failure; their pixels lie beside the record.
    pub pictures: Vec<ContactFrame>,
}

/// What follows a draw's number in the name of the file of its looks.
pub const LOOKS: &str = ".looks.jsonl";

/// The evaluation that a draw belongs to.
pub struct Bench<'a> {
    pub(super) arguments: &'a Arguments,
    pub(super) recipe: &'a Recipe,
}

/// Where draw `index` leaves a file.
fn file(out: &Path, index: u32, rest: &str) -> PathBuf {
    out.join("draws").join(format!("{index:05}{rest}"))
}

/// Where a picture of draw `index` lies.
pub fn picture(out: &Path, index: u32, camera: &str) -> PathBuf {
    file(out, index, &format!("-{camera}.jpg"))
}

/// Where what detector and recogniser said in draw `index` lies.
fn looks(out: &Path, index: u32) -> PathBuf {
    file(out, index, LOOKS)
}

impl Bench<'_> {
    /// Draws engagement `index` and writes its scenario.
    pub fn draw(&self, index: u32) -> Result<(Facts, Loaded), EvalError> {
        let draw = Draw::new(self.recipe, self.arguments.seed, index)?;
        let path = file(&self.arguments.out, index, ".toml");
        put(&path, &draw.scenario)?;
        let loaded = Scenario::load(&path, &self.changes())?;
        Ok((draw.facts, loaded))
    }

    /// Changes to every scenario, as `--set` takes them.
    fn changes(&self) -> Vec<String> {
        let truth = self.arguments.truth.then(|| "detector.kind=truth".into());
        truth
            .into_iter()
            .chain(self.arguments.set.clone())
            .collect()
    }

    /// What tells draws of this program, recipe, seed, model and of these changes from others.
    pub fn key(&self, loaded: &Loaded) -> Result<String, EvalError> {
        let program = std::env::current_exe();
        let program = program.and_then(|path| digest(&path));
        let program = program.map_err(|source| EvalError::Program { source })?;
        let detector = &loaded.scenario.detector;
        // One that cannot be read is refused by the run, with its line.
        let model = if detector.is_onnx() {
            digest(&detector.onnx_model).unwrap_or_default()
        } else {
            0
        };
        let recogniser =
            (loaded.scenario.recogniser.model(detector)).and_then(|file| digest(file).ok());
        let text = format!(
            "{program} {model} {recogniser:?} {} {:?} {:?}",
            self.arguments.seed,
            self.changes(),
            self.recipe
        );
        Ok(format!("{:032x}", xxh3_128(text.as_bytes())))
    }

    /// The outcome of draw `index` from an earlier evaluation with this key.
    pub fn made(&self, index: u32, key: &str) -> Option<Outcome> {
        let text = std::fs::read_to_string(file(&self.arguments.out, index, ".json")).ok()?;
        let outcome: Outcome = serde_json::from_str(&text).ok()?;
        let wants_looks = self.arguments.looks && !looks(&self.arguments.out, index).exists();
        (outcome.key == key && !wants_looks).then_some(outcome)
    }

    /// Runs draw `index` to its end and writes what it leaves.
    pub fn make(&self, index: u32) -> Result<Outcome, EvalError> {
        let (facts, loaded) = self.draw(index)?;
        let key = self.key(&loaded)?;
        let (record, pictures, rows) = watched(&loaded, self.arguments.looks)?;
        let outcome = Outcome {
            key,
            facts,
            verdict: Verdict::of(&record),
            record,
            command: self.command(&loaded),
            pictures,
        };
        let out = &self.arguments.out;
        for frame in &outcome.pictures {
            let jpeg = encode_jpeg(&frame.rgb8, frame.width, frame.height, 80)?;
            put(&picture(out, index, &frame.camera), jpeg)?;
        }
        if self.arguments.looks {
            let path = looks(out, index);
            let json = |row| serde_json::to_string(row);
            let lines: Result<Vec<String>, _> = rows.iter().map(json).collect();
            let lines = lines.map_err(|source| OutputError::Json {
                path: path.clone(),
                source,
            })?;
            put(&path, lines.join("\n"))?;
        }
        let path = file(out, index, ".json");
        let partial = path.with_extension("partial");
        put_json(&partial, &outcome)?;
        std::fs::rename(&partial, &path).map_err(|source| OutputError::File { path, source })?;
        Ok(outcome)
    }

    /// The command that repeats a run with everything recorded.
    fn command(&self, loaded: &Loaded) -> String {
        let set = self.changes();
        let set = set.iter().map(|set| format!(" --set {}", quoted(set)));
        let blind = loaded.scenario.detector.is_blind();
        format!(
            "boresight run {}{}{}",
            quoted(loaded.path.display()),
            if blind { " --no-capture" } else { "" },
            set.collect::<String>()
        )
    }
}

/// A digest of a file's bytes.
fn digest(path: &Path) -> std::io::Result<u64> {
    let mut hasher = Xxh3::new();
    hasher.update(&std::fs::read(crate::data::found(path))?);
    Ok(hasher.digest())
}

/// A run watched until its UAV has come to its end, or its time is over.
fn watched(
    loaded: &Loaded,
    looks: bool,
) -> Result<(Record, Vec<ContactFrame>, Vec<Row>), EvalError> {
    let pictures = !loaded.scenario.detector.is_blind();
    let seed = loaded.scenario.seed;
    let seen = Runner::default().make(loaded, seed, pictures, |mut run| {
        let mut watch = Watch::new(run.world_mut(), looks);
        run.watch(|run| watch.tick(run.world()))?;
        let rows = watch.rows();
        let (record, pictures) = watch.conclude(run.world(), |record| Verdict::of(record).cause);
        Ok((record, pictures, rows))
    })?;
    Ok(seen)
}
