//! A loaded model and its answers.

use super::error::DetectorError;
use super::interface::Interface;
use super::runtime::{Setup, first_line, refused, session};
use boresight_models::flight::class::is_uav;
use boresight_models::optics::camera::PixelRect;
use boresight_models::optics::detection::{Detection, Padding, planes};
use boresight_scenario::Provider;
use ort::session::Session;
use ort::value::TensorRef;
use std::path::{Path, PathBuf};

/// A loaded model.
pub struct OnnxDetector {
    session: Session,
    path: PathBuf,
    classes: Vec<String>,
    score_threshold: f64,
    score_threshold_video: f64,
    score_neutral: f64,
    padding: Padding,
    /// Whether it takes several pictures at once.
    pub(super) batches: bool,
    planes: Vec<f32>,
}

/// What a model looks at: a part of an 8-bit RGB picture.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// The whole picture's rows.
    pub rgb8: &'a [u8],
    /// Pixels of a row.
    pub width_px: u32,
    /// The part, in pixels of the picture.
    pub look: PixelRect,
}

impl OnnxDetector {
    /// Loads and checks the model at `path`, named by `--model`, which then runs on `threads`
    /// threads of the CPU.
    pub fn load(path: &Path, threads: usize) -> Result<Self, DetectorError> {
        let setup = Setup {
            threads,
            provider: Provider::Cpu,
            named_in: "--model",
        };
        Self::load_with(path, &setup)
    }

    /// Loads and checks the model at `path`.
    pub fn load_with(path: &Path, setup: &Setup) -> Result<Self, DetectorError> {
        let path = &boresight_common::data::found(path);
        let unreadable = |error: std::io::Error| DetectorError::Unreadable {
            path: path.into(),
            why: error.to_string(),
            named_in: setup.named_in,
        };
        if std::fs::metadata(path).map_err(unreadable)?.is_dir() {
            return Err(unreadable(std::io::ErrorKind::IsADirectory.into()));
        }
        std::fs::File::open(path).map_err(unreadable)?;
        let session = session(setup)?
            .commit_from_file(path)
            .map_err(|error| refused(path, &error.to_string()))?;
        let wrong = |why| DetectorError::Interface {
            path: path.into(),
            why,
        };
        let Interface {
            classes,
            score_threshold,
            score_threshold_video,
            score_neutral,
            padding,
            batches,
        } = Interface::of(&session).map_err(wrong)?;
        let mut detector = Self {
            session,
            path: path.into(),
            classes,
            score_threshold,
            score_threshold_video,
            score_neutral,
            padding,
            batches,
            planes: Vec::new(),
        };
        // Grey frames show a model that answers nonsense before the run starts; two of them, one that
        // declares batches and takes single pictures only.
        const PROBE_PX: u32 = 128;
        let fixed_px = detector.padding.fixed_px;
        let probe_px = fixed_px.map(|side| side.map_or(PROBE_PX, |side| side.min(PROBE_PX)));
        let grey = vec![128; 3 * (probe_px[0] * probe_px[1]) as usize];
        let view = View {
            rgb8: &grey,
            width_px: probe_px[0],
            look: PixelRect {
                offset_px: [0, 0],
                size_px: probe_px,
            },
        };
        detector.detect_all(&[view])?;
        if detector.batches {
            detector.detect_all(&[view; 2])?;
        }
        Ok(detector)
    }

    /// Names of the classes; labels are indices into them.
    pub fn classes(&self) -> &[String] {
        &self.classes
    }

    /// Score from which on its maker recommends to believe a detection.
    pub fn score_threshold(&self) -> f64 {
        self.score_threshold
    }

    /// The same on video of real cameras; that of rendered pictures where the model names none.
    pub fn score_threshold_video(&self) -> f64 {
        self.score_threshold_video
    }

    /// Score of a detection that speaks neither for a UAV nor against it.
    pub fn score_neutral(&self) -> f64 {
        self.score_neutral
    }

    /// Whether the class of this index is one of UAVs.
    pub fn is_uav(&self, label: u32) -> bool {
        (self.classes.get(label as usize)).is_none_or(|name| is_uav(name))
    }

    /// Width and height of its input for a picture of `size_px`; an error for a picture larger than
    /// it takes.
    pub fn input_px(&self, size_px: [u32; 2]) -> Result<[u32; 2], DetectorError> {
        self.padding.input_px(size_px).ok_or_else(|| {
            let [width, height] = self
                .padding
                .fixed_px
                .map(|side| side.map_or_else(|| "any".into(), |side| side.to_string()));
            let [w, h] = size_px;
            self.interface_error(format!(
                "it takes pictures of at most {width} x {height} px, not {w} x {h}"
            ))
        })
    }

    fn interface_error(&self, why: String) -> DetectorError {
        DetectorError::Interface {
            path: self.path.clone(),
            why,
        }
    }

    /// Appends the detections in an 8-bit RGB image of width and height `size_px`, in the
    /// image's own pixels, most confident first.
    pub fn detect(
        &mut self,
        rgb8: &[u8],
        size_px: [u32; 2],
        out: &mut Vec<Detection>,
    ) -> Result<(), DetectorError> {
        let whole = PixelRect {
            offset_px: [0, 0],
            size_px,
        };
        let view = View {
            rgb8,
            width_px: size_px[0],
            look: whole,
        };
        out.extend(self.detect_all(&[view])?.into_iter().flatten());
        Ok(())
    }

    /// The detections in each of several views, in pixels of its part, most confident first. Views of
    /// the same input size are answered together where the model takes batches.
    pub fn detect_all(&mut self, views: &[View]) -> Result<Vec<Vec<Detection>>, DetectorError> {
        let sizes: Vec<[u32; 2]> = (views.iter())
            .map(|view| self.input_px(view.look.size_px))
            .collect::<Result<_, _>>()?;
        let mut found = vec![Vec::new(); views.len()];
        let mut left: Vec<usize> = (0..views.len()).collect();
        while let Some(&first) = left.first() {
            let alike = |i: &usize| *i == first || self.batches && sizes[*i] == sizes[first];
            let (batch, rest): (Vec<usize>, Vec<usize>) = left.iter().partition(|i| alike(i));
            let pictures: Vec<View> = batch.iter().map(|&i| views[i]).collect();
            let answers = self.run(&pictures, sizes[first])?;
            for (i, answer) in batch.into_iter().zip(answers) {
                found[i] = answer;
            }
            left = rest;
        }
        Ok(found)
    }

    /// Runs the model once on views that all become `input_px`; a model that takes no batches gets
    /// one.
    fn run(
        &mut self,
        views: &[View],
        input_px: [u32; 2],
    ) -> Result<Vec<Vec<Detection>>, DetectorError> {
        self.planes.clear();
        for view in views {
            let View {
                rgb8,
                width_px,
                look,
            } = *view;
            planes(rgb8, width_px, look, input_px, &mut self.planes);
        }
        let [width, height] = input_px.map(|n| n as usize);
        let path = &self.path;
        let broken = |error: ort::Error| DetectorError::Broken {
            path: path.clone(),
            why: first_line(&error.to_string()),
        };
        let shape = [views.len(), 3, height, width];
        let image = TensorRef::from_array_view((shape, &self.planes[..])).map_err(broken)?;
        let outputs = (self.session)
            .run(ort::inputs!["image" => image])
            .map_err(|error| DetectorError::Run {
                path: path.clone(),
                why: first_line(&error.to_string()),
            })?;
        let numbers = |name: &str| outputs[name].try_extract_tensor::<f32>().map_err(broken);
        let (shape, boxes) = numbers("boxes")?;
        let (_, scores) = numbers("scores")?;
        let (_, labels) = outputs["labels"]
            .try_extract_tensor::<i64>()
            .map_err(broken)?;
        let centres = match outputs.get("centres") {
            Some(_) => Some(numbers("centres")?.1),
            None => None,
        };
        let raw = RawAnswer {
            shape,
            boxes,
            scores,
            labels,
            centres,
        };
        raw.check(views.len(), self.batches, self.classes.len())
            .map_err(|why| DetectorError::Interface {
                path: path.clone(),
                why,
            })?;
        let rows = scores.len() / views.len();
        let answers = views.iter().enumerate().map(|(k, view)| {
            let rows = k * rows..(k + 1) * rows;
            raw.detections(rows, view.look.size_px.map(f64::from))
        });
        Ok(answers.collect())
    }
}

/// What a model gave for a batch, as it gave it.
struct RawAnswer<'a> {
    /// Of the boxes.
    shape: &'a [i64],
    boxes: &'a [f32],
    scores: &'a [f32],
    labels: &'a [i64],
    centres: Option<&'a [f32]>,
}

impl RawAnswer<'_> {
    /// In what it differs from the interface.
    fn check(&self, views: usize, batches: bool, classes: usize) -> Result<(), String> {
        let n = self.scores.len();
        let centres = self.centres.unwrap_or_default();
        let batch = if batches { "B, " } else { "" };
        if self.centres.is_some() && centres.len() != 2 * n {
            return Err(format!("centres are not [{batch}N, 2]"));
        }
        let of_each = [views as i64, (n / views) as i64, 4];
        let expected = &of_each[usize::from(!batches)..];
        if *self.shape != *expected || self.boxes.len() != 4 * n || self.labels.len() != n {
            return Err(format!(
                "boxes are not [{batch}N, 4] with one score and one label each"
            ));
        }
        let mut numbers = self.boxes.iter().chain(self.scores).chain(centres);
        if numbers.any(|x| !x.is_finite()) {
            return Err("it gives boxes, scores or centres that are not finite".into());
        }
        if let Some(score) = (self.scores.iter()).find(|score| !(0.0..=1.0).contains(*score)) {
            return Err(format!("it gives the score {score}, expected 0 to 1"));
        }
        let is_class = |label: i64| usize::try_from(label).is_ok_and(|label| label < classes);
        if let Some(label) = self.labels.iter().find(|label| !is_class(**label)) {
            return Err(format!(
                "it gives the label {label}, but `classes` has {classes} names, counted from 0"
            ));
        }
        Ok(())
    }

    /// The detections of some rows, in a part of `size_px`, most confident first.
    fn detections(&self, rows: std::ops::Range<usize>, size_px: [f64; 2]) -> Vec<Detection> {
        let mut found: Vec<Detection> = rows
            .map(|row| self.detection(row))
            // The padding is no part of the picture; models with a fixed number of rows fill
            // the rest with boxes without extent.
            .filter(|found| {
                let [x0, y0, x1, y1] = found.box_px;
                let [x, y] = found.centre_px();
                x1 > x0 && y1 > y0 && x <= size_px[0] && y <= size_px[1]
            })
            .collect();
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        found
    }

    fn detection(&self, i: usize) -> Detection {
        let b = &self.boxes[4 * i..];
        let mut found = Detection::new(
            [b[0], b[1], b[2], b[3]].map(f64::from),
            f64::from(self.scores[i]),
            // The labels are checked, and fewer than the names of a file.
            self.labels[i] as u32,
        );
        if let Some(centres) = self.centres {
            found.aim_px = [centres[2 * i], centres[2 * i + 1]].map(f64::from);
        }
        found
    }
}
