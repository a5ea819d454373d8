//! `boresight fit-detector`: a measured detector of what a network said in engagements on rendered pixels.

use crate::dataset::kept::refuse_kept;
use crate::eval::engagement::LOOKS;
use crate::inference::{DetectorError, OnnxDetector};
use crate::models::sensing::measured::{Fitted, Measured, Row, Run, fit, foretold};
use crate::output::{self, OutputError, columns};
use crate::scenario::{DetectorConfig, InputError, Scenario};
use clap::Args;
use std::path::{Path, PathBuf};

/// What `boresight fit-detector` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// Folders of `boresight eval engagement --looks`.
    #[arg(required = true)]
    pub folders: Vec<PathBuf>,
    /// The network that looked there (ONNX).
    #[arg(long, default_value_os_t = DetectorConfig::default().onnx_model)]
    pub model: PathBuf,
    /// A folder of other engagements, to hold the fit to: it learns nothing of them.
    #[arg(long, value_name = "FOLDER")]
    pub against: Option<PathBuf>,
    /// The file of the measured detector.
    #[arg(long, default_value = "out/measured.json")]
    pub out: PathBuf,
}

/// Why no detector could be fitted.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// The network.
    #[error(transparent)]
    Detector(#[from] DetectorError),
    /// A folder or file of looks cannot be read.
    #[error("{}: {source}; name a folder of `boresight eval engagement --looks`", path.display())]
    Unread {
        /// The folder or file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A line is no look.
    #[error("{}:{line}: {source}; make the engagement again with `boresight eval engagement --looks`", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// Another network looked there.
    #[error("{}:{line}: {what}; name the network that looked there (--model), and folders of one network and one threshold", path.display())]
    Another {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// What tells.
        what: String,
    },
    /// An engagement shows what is kept for judging.
    #[error("{source}; make the engagements again with `boresight eval engagement --looks`")]
    Kept {
        /// What, and in which scenario.
        source: InputError,
    },
    /// Nobody looked at a UAV.
    #[error("{}: no look at a UAV; make more engagements with `boresight eval engagement --looks`", .0.display())]
    Nothing(PathBuf),
    /// The result.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Fits a measured detector and writes it; what to tell the user.
pub fn carry_out(arguments: &Arguments) -> Result<String, FitError> {
    let network = OnnxDetector::load(&arguments.model, 1)?;
    let mut reader = Reader {
        classes: network.classes(),
        scores: None,
    };
    let mut runs = Vec::new();
    for folder in &arguments.folders {
        runs.extend(reader.read(folder)?);
    }
    let of = format!("{}, {} engagements", arguments.model.display(), runs.len());
    let nothing = || FitError::Nothing(arguments.folders[0].clone());
    let fitted = fit(
        &runs,
        network.classes().to_vec(),
        network.score_neutral(),
        of,
    );
    let Fitted { model, counts } = fitted.ok_or_else(nothing)?;
    output::put_json(&arguments.out, &model)?;
    let [uavs, birds, others, false_boxes, named] = counts;
    let mut said = format!(
        "{} engagements: {uavs} looks at UAVs, {birds} at birds, {others} at other things that fly, {false_boxes} false boxes, \
         {named} answers of the recogniser\n",
        runs.len()
    );
    let held_to = match &arguments.against {
        Some(folder) => reader.read(folder)?,
        None => Vec::new(),
    };
    if held_to.is_empty() {
        said += &shares("the same engagements", &model, &runs);
    } else {
        said += &shares("engagements that it did not learn from", &model, &held_to);
    }
    Ok(format!("{said}model {}", arguments.out.display()))
}

/// Shares of the looks at UAVs that are found, by size, as the model foretells and as they were.
fn shares(of: &str, model: &Measured, runs: &[Run]) -> String {
    let mut rows = Vec::new();
    for (size_px, count, foretold, found) in foretold(model, runs) {
        if count > 0 {
            let percent = |share: f64| format!("{:.0} %", 100.0 * share);
            rows.push(vec![
                format!("{size_px:.0}"),
                count.to_string(),
                percent(foretold),
                percent(found),
            ]);
        }
    }
    let head = ["UAV [px]", "looks", "foretold", "found"];
    format!("UAVs found in {of}:\n{}", columns(&head, &rows, 0))
}

/// Reads the looks of one network.
struct Reader<'a> {
    /// The network's classes.
    classes: &'a [String],
    /// Scores from which on its boxes went on with a track, and started one.
    scores: Option<[f64; 2]>,
}

impl Reader<'_> {
    /// The looks of the engagements in a folder.
    fn read(&mut self, folder: &Path) -> Result<Vec<Run>, FitError> {
        let draws = folder.join("draws");
        let mut files = Vec::new();
        for entry in std::fs::read_dir(&draws).map_err(|source| unread(&draws, source))? {
            let path = entry.map_err(|source| unread(&draws, source))?.path();
            if path.to_string_lossy().ends_with(LOOKS) {
                files.push(path);
            }
        }
        files.sort_unstable();
        files.iter().map(|path| self.run(path)).collect()
    }

    /// The looks of an engagement.
    fn run(&mut self, path: &Path) -> Result<Run, FitError> {
        // A folder without the scenarios tells nothing of what they show.
        let scenario = PathBuf::from(path.to_string_lossy().replace(LOOKS, ".toml"));
        if scenario.exists() {
            let loaded = Scenario::load(&scenario, &[]).and_then(|loaded| refuse_kept(&loaded));
            loaded.map_err(|source| FitError::Kept { source })?;
        }
        let text = std::fs::read_to_string(path).map_err(|source| unread(path, source))?;
        let row = |(index, line): (usize, &str)| {
            let line_number = index + 1;
            let row = serde_json::from_str(line).map_err(|source| FitError::Line {
                path: path.into(),
                line: line_number,
                source,
            })?;
            match self.stranger(&row) {
                Some(what) => Err(FitError::Another {
                    path: path.into(),
                    line: line_number,
                    what,
                }),
                None => Ok(row),
            }
        };
        text.lines().enumerate().map(row).collect()
    }

    /// What in a row is not of the network.
    fn stranger(&mut self, row: &Row) -> Option<String> {
        let name = match row {
            Row::Look(look) => &look.found.as_ref()?.name,
            Row::False(found) => &found.name,
            Row::Frame(frame) => {
                let scores = [frame.floor, frame.start];
                let before = *self.scores.get_or_insert(scores);
                let what = || {
                    format!(
                        "boxes from a score of {} on, elsewhere {}",
                        scores[0], before[0]
                    )
                };
                return (scores != before).then(what);
            }
            Row::Named(_) => return None,
        };
        let what = || format!("the class '{name}' is none of the network's");
        (!self.classes.contains(name)).then(what)
    }
}

fn unread(path: &Path, source: std::io::Error) -> FitError {
    let path = path.into();
    FitError::Unread { path, source }
}
