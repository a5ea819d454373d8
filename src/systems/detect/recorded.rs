//! A detector whose answers were kept: so a run whose detector was another program repeats without it.
//!
//! The file is a table with a row for each box, frames in the order of the questions; a frame in which nothing was found has
//! a row without a box.

use crate::components::detect::{Detector, DetectorContext, Question, Reading};
use crate::components::run::PartError;
use crate::models::flight::class::ObjectClass;
use crate::models::optics::detection::Detection;
use crate::place::located;
use crate::scenario::{DetectorConfig, RECORDED};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};

/// The score from which on a box starts a track where the scenario says nothing, and that which speaks neither for a UAV
/// nor against it.
const START_SCORE: f64 = 0.3;
const NEUTRAL_SCORE: f64 = 0.3;

/// How answers of a detector in another program are read: as those of a network that names every class.
pub fn reading(config: &DetectorConfig) -> Reading {
    let start_score = config.score_threshold.unwrap_or(START_SCORE);
    let roi_px = (config.roi_px > 0).then_some(config.roi_px);
    let weak_score = config.weak_share * start_score;
    Reading::of_network(start_score, weak_score, NEUTRAL_SCORE, roi_px)
}

/// The classes that such a detector names.
pub fn classes() -> Vec<String> {
    let names = ObjectClass::ALL.map(|class| class.name().to_owned());
    names.to_vec()
}

/// What was found in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// Tick of its exposure.
    pub tick: u64,
    /// Name of its camera.
    pub camera: String,
    /// What was found, in the order in which it was told.
    pub found: Vec<Detection>,
}

/// A row of the table.
#[derive(Debug, Serialize, Deserialize)]
struct Row {
    tick: u64,
    camera: String,
    /// x0, y0, x1, y1 on the full sensor [px].
    x0_px: Option<f64>,
    y0_px: Option<f64>,
    x1_px: Option<f64>,
    y1_px: Option<f64>,
    /// Confidence, 0 to 1.
    score: Option<f64>,
    /// Name of its class.
    class: Option<String>,
}

/// The table of answers, as text. Numbers are written so that they are read again bit for bit.
pub fn table(answers: &[Answer]) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for Answer {
        tick,
        camera,
        found,
    } in answers
    {
        let row = |found: Option<&Detection>| {
            let corner = |index: usize| found.map(|found| found.box_px[index]);
            let class = found.and_then(|found| ObjectClass::ALL.get(found.label as usize));
            Row {
                tick: *tick,
                camera: camera.clone(),
                x0_px: corner(0),
                y0_px: corner(1),
                x1_px: corner(2),
                y1_px: corner(3),
                score: found.map(|found| found.score),
                class: class.map(|class| class.name().to_owned()),
            }
        };
        match found[..] {
            [] => writer.serialize(row(None))?,
            _ => found
                .iter()
                .try_for_each(|found| writer.serialize(row(Some(found))))?,
        }
    }
    writer
        .into_inner()
        .map_err(|error| error.into_error().into())
}

/// The kept answers of a scenario.
pub fn make(context: &DetectorContext) -> Result<RecordedDetector, PartError> {
    let loaded = &context.loaded;
    let config = &loaded.scenario.detector;
    let key = "detector.answers";
    let Some(file) = &config.answers else {
        let why = format!("a detector of the kind \"{RECORDED}\" needs the file of its answers");
        return Err(loaded.refuse(key, why).into());
    };
    let path = PathBuf::from(located(
        loaded.path.parent().unwrap_or(Path::new(".")),
        file,
    ));
    let answers = read(&path).map_err(|why| loaded.refuse(key, why))?;
    Ok(RecordedDetector {
        path,
        classes: classes(),
        reading: reading(config),
        answers,
        open: VecDeque::new(),
    })
}

/// Reads a table of answers, each with the number of its first line; an error names the line.
fn read(path: &Path) -> Result<VecDeque<(Answer, u64)>, String> {
    let of = |why: &dyn std::fmt::Display| format!("{}: {why}", path.display());
    let mut reader = csv::Reader::from_path(path).map_err(|error| of(&error))?;
    let header = reader.headers().map_err(|error| of(&error))?.clone();
    let mut answers: VecDeque<(Answer, u64)> = VecDeque::new();
    for record in reader.records() {
        let record = record.map_err(|error| of(&error))?;
        let line = record.position().map_or(0, csv::Position::line);
        let wrong = |why: &dyn std::fmt::Display| of(&format!("line {line}: {why}"));
        let row: Row = record
            .deserialize(Some(&header))
            .map_err(|error| wrong(&error))?;
        let found = row.detection().map_err(|why| wrong(&why))?;
        match answers.back_mut() {
            Some((answer, _)) if (answer.tick, &answer.camera) == (row.tick, &row.camera) => {
                answer.found.extend(found);
            }
            _ => {
                let answer = Answer {
                    tick: row.tick,
                    camera: row.camera,
                    found: found.into_iter().collect(),
                };
                answers.push_back((answer, line));
            }
        }
    }
    Ok(answers)
}

impl Row {
    /// The detection of the row, if it has one, or what is wrong with it.
    fn detection(&self) -> Result<Option<Detection>, String> {
        let Self {
            x0_px: Some(x0),
            y0_px: Some(y0),
            x1_px: Some(x1),
            y1_px: Some(y1),
            score: Some(score),
            class: Some(class),
            ..
        } = self
        else {
            let numbers = [self.x0_px, self.y0_px, self.x1_px, self.y1_px, self.score];
            return match numbers == [None; 5] && self.class.is_none() {
                true => Ok(None),
                false => Err(
                    "has a part of a box: give its corners, score and class, or none of them"
                        .into(),
                ),
            };
        };
        let label = ObjectClass::ALL
            .iter()
            .position(|known| known.name() == class);
        let Some(label) = label else {
            let known = ObjectClass::ALL.map(ObjectClass::name).join(", ");
            return Err(format!("class '{class}': must be one of {known}"));
        };
        let box_px = [*x0, *y0, *x1, *y1];
        let finite = box_px.iter().all(|x| x.is_finite());
        if !(finite && x0 < x1 && y0 < y1) {
            return Err(format!("{box_px:?} encloses nothing"));
        }
        if !(0.0..=1.0).contains(score) {
            return Err(format!("score {score}: must be between 0 and 1"));
        }
        Ok(Some(Detection::new(box_px, *score, label as u32)))
    }
}

/// Gives the answers that were kept.
pub struct RecordedDetector {
    path: PathBuf,
    classes: Vec<String>,
    reading: Reading,
    /// With the numbers of their lines.
    answers: VecDeque<(Answer, u64)>,
    /// Ticks and cameras that were asked for.
    open: VecDeque<(u64, String)>,
}

impl Detector for RecordedDetector {
    fn classes(&self) -> &[String] {
        &self.classes
    }

    fn reading(&self) -> Reading {
        self.reading
    }

    fn wants_pictures(&self) -> bool {
        false
    }

    fn ask(&mut self, questions: Vec<Question>) {
        let asked = questions
            .into_iter()
            .map(|question| (question.frame.tick, question.frame.name.to_string()));
        self.open.extend(asked);
    }

    fn answer(&mut self) -> Result<Vec<Detection>, PartError> {
        let path = self.path.display();
        let Some((tick, camera)) = self.open.pop_front() else {
            return Ok(Vec::new());
        };
        let Some((answer, line)) = self.answers.pop_front() else {
            return Err(format!(
                "{path}: has no answer for tick {tick} of {camera}: the run was shorter when it was recorded"
            )
            .into());
        };
        if (answer.tick, &answer.camera) != (tick, &camera) {
            return Err(format!(
                "{path}: line {line}: is of tick {} of {}, the run asks for tick {tick} of {camera}: run the scenario \
                 that lies beside it unchanged, with the program that wrote it",
                answer.tick, answer.camera
            )
            .into());
        }
        Ok(answer.found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn file(text: &[u8]) -> tempfile::NamedTempFile {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text).unwrap();
        file
    }

    #[test]
    fn answers_are_read_bit_for_bit_and_a_wrong_line_is_named() {
        let answer = |tick, found| Answer {
            tick,
            camera: "ctv".into(),
            found,
        };
        let third = 1.0 / 3.0;
        let one = Detection::new([0.1, 0.2, third, 5e3], 0.7, 1);
        let two = Detection::new([1.0, 2.0, 3.0, 4.0], third, 0);
        let answers = [
            answer(16, vec![one, two]),
            answer(32, vec![]),
            answer(48, vec![two]),
        ];
        let text = table(&answers).unwrap();
        let again: Vec<Answer> = read(file(&text).path())
            .unwrap()
            .into_iter()
            .map(|(answer, _)| answer)
            .collect();
        assert_eq!(again, answers);

        let text = String::from_utf8(text).unwrap();
        for (from, to, words) in [
            (",0.7,", ",1.7,", "line 2: score 1.7"),
            (",0.7,", ",,", "line 2: has a part of a box"),
            (",0.1,", ",9.0,", "line 2: [9.0, 0.2,"),
            ("16,", "x,", "line 2: "),
            ("x0_px", "x", "line 2: has a part"),
        ] {
            let error = read(file(text.replacen(from, to, 1).as_bytes()).path()).unwrap_err();
            assert!(error.contains(words), "{error}");
        }
    }
}
