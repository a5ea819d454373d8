//! ONNX detectors through ONNX Runtime, loaded at run time.
//!
//! A model takes `image`, f32 `[1, 3, H, W]`, RGB 0 to 1, native resolution, and gives `boxes` f32
//! `[N, 4]` (x0, y0, x1, y1 in input pixels), `scores` f32 `[N]` and `labels` i64 `[N]`, or takes
//! `[B, 3, H, W]` for any B and gives each with a leading B; its metadata says
//! `boresight.interface = 1`, which `classes` there are and how pictures are padded
//! (training/README.md).

use crate::models::camera::PixelRect;
use crate::models::detection::{Detection, Padding, planes};
use crate::scenario::Provider;
use bevy::platform::cell::SyncCell;
use ort::ep::{CUDA, ExecutionProvider, TensorRT};
use ort::session::{Session, builder::SessionBuilder};
use ort::value::{Outlet, TensorElementType, TensorRef, ValueType};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock, mpsc};
use std::thread::JoinHandle;

/// Why a detector cannot be used.
#[derive(Clone, Debug, thiserror::Error)]
pub enum DetectorError {
    /// No ONNX Runtime library.
    #[error(
        "ONNX Runtime's shared library was not found ({0}); run ./setup.sh, or set \
         ORT_DYLIB_PATH to libonnxruntime.so"
    )]
    NoRuntime(String),
    /// The library is there but does not start.
    #[error("ONNX Runtime at {path} does not start: {why}")]
    Runtime {
        /// The library.
        path: PathBuf,
        /// What it said.
        why: String,
    },
    /// The model file cannot be read.
    #[error(
        "detector model {path}: cannot be read ({why}); name an existing .onnx file with {named_in}"
    )]
    Unreadable {
        /// The model file.
        path: PathBuf,
        /// What the system said.
        why: String,
        /// The argument or key that named it.
        named_in: &'static str,
    },
    /// The file is no model that the runtime takes.
    #[error("detector model {path}: not a usable ONNX model ({why}); export it again (opset 17)")]
    Broken {
        /// The model file.
        path: PathBuf,
        /// What the runtime said.
        why: String,
    },
    /// The model needs a later runtime.
    #[error(
        "detector model {path}: its {what} {has} is newer than the {most} that the loaded ONNX \
         Runtime knows; export it with opset 17 and IR version 8"
    )]
    TooNew {
        /// The model file.
        path: PathBuf,
        /// Which version it is about.
        what: &'static str,
        /// The model's.
        has: u32,
        /// The runtime's last.
        most: u32,
    },
    /// The runtime has no such execution provider, or it does not start.
    #[error(
        "execution provider {provider}: {why}; set ORT_DYLIB_PATH to an ONNX Runtime that has it, \
         or detector.provider to \"cpu\""
    )]
    Provider {
        /// Its name.
        provider: Provider,
        /// What is missing.
        why: String,
    },
    /// The runtime failed while the model ran.
    #[error("detector model {path}: it cannot be run: {why}")]
    Run {
        /// The model file.
        path: PathBuf,
        /// What the runtime says.
        why: String,
    },
    /// The thread of the detector has ended; it does so only when it panics.
    #[error("the detector's thread has ended")]
    Ended,
    /// The model does not have the documented inputs and outputs.
    #[error("detector model {path}: {why}; see the interface in training/README.md")]
    Interface {
        /// The model file.
        path: PathBuf,
        /// What differs.
        why: String,
    },
}

/// A loaded model.
pub struct OnnxDetector {
    session: Session,
    path: PathBuf,
    classes: Vec<String>,
    score_threshold: f64,
    padding: Padding,
    /// Whether it takes several pictures at once.
    batches: bool,
    planes: Vec<f32>,
}

/// How a model is loaded.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    /// Threads of its operations.
    pub threads: usize,
    /// What runs it.
    pub provider: Provider,
    /// The argument or key that names its file, for errors.
    pub named_in: &'static str,
}

/// Version of the interface that this build speaks.
const INTERFACE: &str = "1";

/// Where ONNX Runtime's library is looked for: `ORT_DYLIB_PATH`, else the cache that `setup.sh`
/// fills.
pub fn runtime_path() -> Result<PathBuf, DetectorError> {
    if let Some(path) = std::env::var_os("ORT_DYLIB_PATH") {
        let path = PathBuf::from(path);
        // The loader can hang on a missing file, so it is looked at first.
        return if path.is_file() {
            Ok(path)
        } else {
            Err(DetectorError::NoRuntime(format!(
                "ORT_DYLIB_PATH = {}",
                path.display()
            )))
        };
    }
    let cache = std::env::var_os("XDG_CACHE_HOME")
        .map(PathBuf::from)
        .or_else(|| std::env::var_os("HOME").map(|home| Path::new(&home).join(".cache")))
        .map(|cache| cache.join("boresight/onnxruntime"))
        .ok_or_else(|| DetectorError::NoRuntime("neither XDG_CACHE_HOME nor HOME is set".into()))?;
    let mut found: Vec<PathBuf> = std::fs::read_dir(&cache)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path().join("libonnxruntime.so"))
        .filter(|path| path.is_file())
        .collect();
    found.sort();
    found
        .pop()
        .ok_or_else(|| DetectorError::NoRuntime(format!("none under {}", cache.display())))
}

/// The process-wide runtime: ONNX Runtime can be loaded once only.
pub(crate) fn environment() -> Result<&'static ort::environment::Environment, DetectorError> {
    static ENVIRONMENT: OnceLock<Result<ort::environment::Environment, String>> = OnceLock::new();
    let path = runtime_path()?;
    ENVIRONMENT
        .get_or_init(|| {
            ort::init_from(&path)
                .map_err(|error| error.to_string())?
                .build()
                .map_err(|error| error.to_string())
        })
        .as_ref()
        .map_err(|why| DetectorError::Runtime {
            path,
            why: why.clone(),
        })
}

/// The execution providers that the loaded runtime was built with.
pub fn providers() -> Result<Vec<&'static str>, DetectorError> {
    environment()?;
    let built = |name, available: ort::Result<bool>| available.unwrap_or(false).then_some(name);
    let found = [
        Some("CPU"),
        built("CUDA", CUDA::is_available()),
        built("TensorRT", TensorRT::is_available()),
    ];
    Ok(found.into_iter().flatten().collect())
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
            padding,
            batches,
        } = interface(&session).map_err(wrong)?;
        let mut detector = Self {
            session,
            path: path.into(),
            classes,
            score_threshold,
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
        let wrong = |why: String| DetectorError::Interface {
            path: path.clone(),
            why,
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
        let n = scores.len();
        let centres = match outputs.get("centres") {
            Some(_) => Some(numbers("centres")?.1),
            None => None,
        };
        let batch = if self.batches { "B, " } else { "" };
        if centres.is_some_and(|centres| centres.len() != 2 * n) {
            return Err(wrong(format!("centres are not [{batch}N, 2]")));
        }
        let rows = n / views.len();
        let of_each = [views.len() as i64, rows as i64, 4];
        let expected = &of_each[usize::from(!self.batches)..];
        if shape[..] != *expected || boxes.len() != 4 * n || labels.len() != n {
            return Err(wrong(format!(
                "boxes are not [{batch}N, 4] with one score and one label each"
            )));
        }
        if boxes
            .iter()
            .chain(scores)
            .chain(centres.unwrap_or_default())
            .any(|x| !x.is_finite())
        {
            return Err(wrong(
                "it gives boxes, scores or centres that are not finite".into(),
            ));
        }
        if let Some(score) = scores.iter().find(|score| !(0.0..=1.0).contains(*score)) {
            return Err(wrong(format!(
                "it gives the score {score}, expected 0 to 1"
            )));
        }
        let classes = self.classes.len();
        let class = |label: i64| {
            u32::try_from(label)
                .ok()
                .filter(|&i| (i as usize) < classes)
        };
        if let Some(label) = labels.iter().find(|label| class(**label).is_none()) {
            return Err(wrong(format!(
                "it gives the label {label}, but `classes` has {classes} names, counted from 0"
            )));
        }
        let row = |i: usize| {
            let b = &boxes[4 * i..];
            let mut found = Detection::new(
                [b[0], b[1], b[2], b[3]].map(f64::from),
                f64::from(scores[i]),
                class(labels[i]).unwrap_or_default(),
            );
            if let Some(centres) = centres {
                found.aim_px = [centres[2 * i], centres[2 * i + 1]].map(f64::from);
            }
            found
        };
        let answers = views.iter().enumerate().map(|(k, view)| {
            let size_px = view.look.size_px.map(f64::from);
            let mut found: Vec<Detection> = (k * rows..(k + 1) * rows)
                .map(row)
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
        });
        Ok(answers.collect())
    }
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

/// A session about to load a model.
fn session(setup: &Setup) -> Result<SessionBuilder, DetectorError> {
    let environment = environment()?;
    let provider = setup.provider;
    let unprovided = |why: String| DetectorError::Provider { provider, why };
    let wanted = match provider {
        Provider::Cpu => Vec::new(),
        Provider::Cuda => vec![CUDA::default().build().error_on_failure()],
        Provider::Tensorrt => vec![
            TensorRT::default().build().error_on_failure(),
            CUDA::default().build().error_on_failure(),
        ],
    };
    let there = providers()?;
    if !there.contains(&provider.runtime_name()) {
        return Err(unprovided(format!(
            "the loaded ONNX Runtime has {} only",
            there.join(" and ")
        )));
    }
    let inner = || -> ort::Result<SessionBuilder> {
        Ok(Session::builder(environment)?
            .with_intra_threads(setup.threads)?
            // Idle threads that spin would take the renderer's cores.
            .with_intra_op_spinning(false)?)
    };
    let path = runtime_path()?;
    let builder = inner().map_err(|error| DetectorError::Runtime {
        path,
        why: first_line(&error.to_string()),
    })?;
    builder
        .with_execution_providers(wanted)
        .map_err(|error| unprovided(first_line(&error.to_string())))
}

/// Why the runtime does not take a model, from what it says.
fn refused(path: &Path, message: &str) -> DetectorError {
    let number = |words: &str| -> Option<u32> {
        let (_, rest) = message.split_once(words)?;
        let digits = rest.split(|c: char| !c.is_ascii_digit()).next()?;
        digits.parse().ok()
    };
    let versions = [
        ("opset", "Opset ", "is till opset "),
        (
            "IR version",
            "model IR version: ",
            "max supported IR version: ",
        ),
    ];
    for (what, has, most) in versions {
        if let (Some(has), Some(most)) = (number(has), number(most)) {
            return DetectorError::TooNew {
                path: path.into(),
                what,
                has,
                most,
            };
        }
    }
    DetectorError::Broken {
        path: path.into(),
        why: first_line(message),
    }
}

/// What a model that keeps to the interface says of itself.
struct Interface {
    classes: Vec<String>,
    score_threshold: f64,
    padding: Padding,
    batches: bool,
}

/// Sides of an input that memory holds [px].
const SIDES_PX: std::ops::RangeInclusive<u32> = 1..=8192;

/// What the model says of itself, or in what it differs from the interface.
fn interface(session: &Session) -> Result<Interface, String> {
    let metadata = session.metadata().map_err(|error| error.to_string())?;
    let text = |key: &str| metadata.custom(key);
    let key = "boresight.interface";
    entry(key, text(key), INTERFACE, |found| {
        (found == INTERFACE).then_some(())
    })?;
    let key = "preprocess";
    entry(key, text(key), "native", |found| {
        (found == "native").then_some(())
    })?;
    let key = "classes";
    let classes = entry(key, text(key), "a JSON list of different names", |found| {
        let names: Vec<String> = serde_json::from_str(found).ok()?;
        let good = |i: usize| !names[i].is_empty() && !names[..i].contains(&names[i]);
        (!names.is_empty() && (0..names.len()).all(good)).then_some(names)
    })?;
    let side = |found: &str| found.parse().ok().filter(|side| SIDES_PX.contains(side));
    let [stride_px, min_side_px] = {
        let side = |key| entry(key, text(key), "1 to 8192 px", side);
        [side("stride")?, side("min_side_px")?]
    };
    let key = "score_threshold";
    let score_threshold = entry(key, text(key), "a number from 0 to 1", |found| {
        let score: f64 = found.parse().ok()?;
        (0.0..=1.0).contains(&score).then_some(score)
    })?;

    let list = |outlets: &[Outlet]| {
        let outlets: Vec<_> = (outlets.iter())
            .map(|outlet| format!("`{}`, {}", outlet.name(), spelt(outlet.dtype())))
            .collect();
        outlets.join("; ")
    };
    let inputs = session.inputs();
    let image = (inputs.first())
        .filter(|image| inputs.len() == 1 && image.name() == "image")
        .filter(|image| fits(image.dtype(), TensorElementType::Float32, &[1, 3, -1, -1]))
        .ok_or_else(|| {
            format!(
                "its inputs are {}; expected one input `image`, f32 [1, 3, H, W]",
                list(inputs)
            )
        })?;
    let fixed = |axis: usize| match image.dtype() {
        ValueType::Tensor { shape, .. } => u32::try_from(shape[axis]).ok(),
        _ => None,
    };
    if let Some(side) = [fixed(2), fixed(3)]
        .into_iter()
        .flatten()
        .find(|side| !SIDES_PX.contains(side))
    {
        return Err(format!(
            "its input `image` has a side of {side} px, expected 1 to 8192 px"
        ));
    }
    let batches = fixed(0).is_none();
    let outputs = session.outputs();
    let (float, int) = (TensorElementType::Float32, TensorElementType::Int64);
    for (name, element, shape, expected) in [
        (
            "boxes",
            float,
            &[-1, -1, 4][..],
            ["f32 [N, 4]", "f32 [B, N, 4]"],
        ),
        ("scores", float, &[-1, -1], ["f32 [N]", "f32 [B, N]"]),
        ("labels", int, &[-1, -1], ["i64 [N]", "i64 [B, N]"]),
        (
            "centres",
            float,
            &[-1, -1, 2],
            ["f32 [N, 2] or none", "f32 [B, N, 2] or none"],
        ),
    ] {
        let shape = &shape[usize::from(!batches)..];
        let found = outputs.iter().find(|outlet| outlet.name() == name);
        let good = found.map_or(name == "centres", |outlet| {
            fits(outlet.dtype(), element, shape)
        });
        if !good {
            return Err(format!(
                "its outputs are {}; expected an output `{name}`, {}",
                list(outputs),
                expected[usize::from(batches)]
            ));
        }
    }
    let padding = Padding {
        stride_px,
        min_side_px,
        fixed_px: [fixed(3), fixed(2)],
    };
    Ok(Interface {
        classes,
        score_threshold,
        padding,
        batches,
    })
}

/// A value of the model's metadata.
fn entry<T>(
    key: &str,
    found: Option<String>,
    expected: &str,
    read: impl Fn(&str) -> Option<T>,
) -> Result<T, String> {
    let found = found.as_deref();
    (found.and_then(read)).ok_or_else(|| {
        let found = found.unwrap_or("missing");
        format!("its metadata {key} is {found}, expected {expected}")
    })
}

/// Whether a declared tensor can be of this type and shape, where -1 is any size. Outputs may be
/// declared without a shape.
fn fits(declared: &ValueType, element: TensorElementType, wanted: &[i64]) -> bool {
    let ValueType::Tensor { ty, shape, .. } = declared else {
        return false;
    };
    let side = |(&found, &wanted): (&i64, &i64)| found == -1 || wanted == -1 || found == wanted;
    let same = shape.len() == wanted.len() && shape.iter().zip(wanted).all(side);
    *ty == element && (same || shape.is_empty() && wanted.len() < 4)
}

/// A declared type as errors spell it.
fn spelt(declared: &ValueType) -> String {
    let ValueType::Tensor {
        ty,
        shape,
        dimension_symbols,
    } = declared
    else {
        return declared.to_string();
    };
    let sides: Vec<String> = (shape.iter().enumerate())
        .map(|(i, side)| match dimension_symbols.get(i) {
            _ if *side >= 0 => side.to_string(),
            Some(name) if !name.is_empty() => name.clone(),
            _ => "?".into(),
        })
        .collect();
    format!("{ty} [{}]", sides.join(", "))
}

/// A picture for the detector to look at: a `View` that its thread can own.
#[derive(Clone, Debug)]
pub struct Picture {
    /// 8-bit RGB rows.
    pub rgb8: Arc<Vec<u8>>,
    /// Pixels of a row.
    pub width_px: u32,
    /// The part to look at, in pixels of the picture.
    pub look: PixelRect,
}

/// The detections in a picture, in pixels of the part that was looked at.
pub type Answer = Result<Vec<Detection>, DetectorError>;

/// A model at work: the pictures of a tick are submitted together, and answers fetched in the same
/// order. What is answered does not depend on whether a thread of its own does it, only when.
pub struct Inference {
    classes: Vec<String>,
    worker: Worker,
}

enum Worker {
    /// Works while the caller renders the next frames.
    Thread {
        pictures: Option<mpsc::Sender<Vec<Picture>>>,
        answers: SyncCell<mpsc::Receiver<Answer>>,
        thread: Option<JoinHandle<()>>,
    },
    /// Works in `submit`.
    Caller {
        model: Box<OnnxDetector>,
        waiting: VecDeque<Answer>,
    },
}

/// An answer to each picture; an error is that of all.
fn look(model: &mut OnnxDetector, pictures: &[Picture]) -> Vec<Answer> {
    let views: Vec<View> = (pictures.iter())
        .map(|picture| View {
            rgb8: &picture.rgb8,
            width_px: picture.width_px,
            look: picture.look,
        })
        .collect();
    match model.detect_all(&views) {
        Ok(found) => found.into_iter().map(Ok).collect(),
        Err(error) => vec![Err(error); pictures.len()],
    }
}

impl Inference {
    /// Puts a model to work on a thread of its own.
    pub fn on_thread(mut model: OnnxDetector) -> std::io::Result<Self> {
        let classes = model.classes.clone();
        let (pictures, to_see) = mpsc::channel::<Vec<Picture>>();
        let (answer, answers) = mpsc::channel();
        let thread = std::thread::Builder::new()
            .name("detector".into())
            .spawn(move || {
                for pictures in to_see {
                    for found in look(&mut model, &pictures) {
                        // Nobody waits for the answers when the run is over.
                        if answer.send(found).is_err() {
                            return;
                        }
                    }
                }
            })?;
        Ok(Self {
            classes,
            worker: Worker::Thread {
                pictures: Some(pictures),
                answers: SyncCell::new(answers),
                thread: Some(thread),
            },
        })
    }

    /// Puts a model to work on the caller's thread.
    pub fn on_caller(model: OnnxDetector) -> Self {
        Self {
            classes: model.classes.clone(),
            worker: Worker::Caller {
                model: Box::new(model),
                waiting: VecDeque::new(),
            },
        }
    }

    /// Names of the classes.
    pub fn classes(&self) -> &[String] {
        &self.classes
    }

    /// Hands in the pictures of a tick.
    pub fn submit(&mut self, batch: Vec<Picture>) {
        match &mut self.worker {
            // A thread that has ended is told by `fetch`.
            Worker::Thread { pictures, .. } => {
                if let Some(pictures) = pictures {
                    let _ = pictures.send(batch);
                }
            }
            Worker::Caller { model, waiting } => waiting.extend(look(model, &batch)),
        }
    }

    /// Waits for the answer to the earliest picture that has not been fetched yet.
    pub fn fetch(&mut self) -> Answer {
        match &mut self.worker {
            Worker::Thread { answers, .. } => {
                answers.get().recv().unwrap_or(Err(DetectorError::Ended))
            }
            Worker::Caller { waiting, .. } => {
                waiting.pop_front().unwrap_or(Err(DetectorError::Ended))
            }
        }
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        if let Worker::Thread {
            pictures, thread, ..
        } = self
        {
            // The runtime must not be torn down under a thread that uses it.
            drop(pictures.take());
            if let Some(thread) = thread.take() {
                let _ = thread.join();
            }
        }
    }
}

/// Runtime messages run over several lines; the first says what is wrong.
pub(crate) fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().trim().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn test_model(name: &str) -> PathBuf {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/models");
        folder.join(format!("{name}.onnx"))
    }

    /// A dark quadcopter from the side before grey, 160 x 120 px, 24 px wide, its middle at
    /// `left_px` + 12, 54.5.
    fn quadcopter(left_px: usize) -> Vec<u8> {
        let mut rgb8 = vec![150; 160 * 120 * 3];
        // Rotors, motors, arms, body, legs: rows and columns.
        for (rows, columns) in [
            (50..51, 0..8),
            (50..51, 16..24),
            (51..53, 3..5),
            (51..53, 19..21),
            (53..54, 3..21),
            (52..57, 9..15),
            (57..60, 9..10),
            (57..60, 14..15),
        ] {
            for at in rows.flat_map(|y| columns.clone().map(move |x| 3 * (y * 160 + left_px + x))) {
                rgb8[at..at + 3].fill(20);
            }
        }
        rgb8
    }

    #[test]
    fn the_shipped_models_load() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/models");
        for (name, classes) in [
            ("saliency", &["uav"][..]),
            ("boresight-p2-roi", &["fpv", "quadcopter", "hexacopter"]),
            ("d-fine-nwd-p2-dsam", &["fpv", "quadcopter", "hexacopter"]),
        ] {
            let path = folder.join(format!("{name}.onnx"));
            let mut model = OnnxDetector::load(&path, 1).expect("a shipped model");
            assert_eq!(model.classes(), classes);
            let mut found = Vec::new();
            model
                .detect(&quadcopter(64), [160, 120], &mut found)
                .expect("an answer");
            let [x, y] = found[0].aim_px;
            assert!((x - 76.0).hypot(y - 54.5) < 3.0, "{name}: {:?}", found[0]);
            assert!(found[0].score > 0.3, "{name}: {:?}", found[0]);
        }
    }

    /// The models are those of training/make_broken_models.py.
    #[test]
    fn a_model_that_differs_from_the_interface_is_refused_with_its_fault() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("empty.onnx"), "").expect("written");
        std::fs::write(folder.path().join("text.onnx"), "no model").expect("written");
        let cases: [(PathBuf, &[&str]); 29] = [
            (test_model("absent"), &["cannot be read", "--model"]),
            (folder.path().into(), &["directory", "--model"]),
            (
                folder.path().join("empty.onnx"),
                &["not a usable ONNX model"],
            ),
            (
                folder.path().join("text.onnx"),
                &["not a usable ONNX model"],
            ),
            (
                test_model("truncated"),
                &["not a usable ONNX model", "opset 17"],
            ),
            (
                test_model("wrong_inputs"),
                &["`pixels`, f32 [1, length]", "expected one input `image`"],
            ),
            (
                test_model("input_rank"),
                &["`image`, f32 [3, height, width]"],
            ),
            (
                test_model("input_type"),
                &["`image`, u8 [1, 3", "f32 [1, 3, H, W]"],
            ),
            (test_model("input_channels"), &["f32 [1, 1, height, width]"]),
            (
                test_model("output_name"),
                &["`bboxes`", "an output `boxes`"],
            ),
            (test_model("output_type"), &["`labels`, i32 [1]", "i64 [N]"]),
            (
                test_model("output_shape"),
                &["`boxes`, f32 [1, 5]", "f32 [N, 4]"],
            ),
            (
                test_model("output_batch"),
                &["`boxes`, f32 [1, 4]", "f32 [B, N, 4]"],
            ),
            (
                test_model("interface_missing"),
                &["boresight.interface is missing"],
            ),
            (
                test_model("interface_other"),
                &["boresight.interface is 2, expected 1"],
            ),
            (
                test_model("preprocess"),
                &["preprocess is letterbox, expected native"],
            ),
            (test_model("classes_missing"), &["classes is missing"]),
            (test_model("classes_empty"), &["classes is [], expected"]),
            (test_model("classes_twice"), &["different names"]),
            (test_model("side"), &["a side of 100000 px", "1 to 8192"]),
            (test_model("batch_of_one"), &["boxes are not [B, N, 4]"]),
            (test_model("score"), &["the score 1.5", "0 to 1"]),
            (test_model("stride"), &["stride is 0"]),
            (test_model("min_side"), &["min_side_px is wide"]),
            (test_model("threshold"), &["score_threshold is 1.5"]),
            (test_model("label"), &["label 1", "1 names"]),
            (test_model("opset"), &["opset 99 is newer", "opset 17"]),
            (test_model("ir_version"), &["IR version 99 is newer"]),
            (test_model("nan"), &["not finite"]),
        ];
        for (path, wanted) in cases {
            let Err(error) = OnnxDetector::load(&path, 1) else {
                panic!("{} is taken", path.display());
            };
            let text = error.to_string();
            let file = path.display().to_string();
            assert!(text.contains(&file) && text.lines().count() == 1, "{text}");
            for words in wanted {
                assert!(text.contains(words), "{file}: no '{words}' in {text}");
            }
        }
    }

    #[test]
    fn labels_padding_and_sizes_are_those_of_the_model() {
        let mut model = OnnxDetector::load(&test_model("good"), 1).expect("a model");
        assert_eq!(model.classes(), ["fpv", "quadcopter"]);
        let mut found = Vec::new();
        model
            .detect(&[0; 3 * 35 * 17], [35, 17], &mut found)
            .expect("an answer");
        assert_eq!((found.len(), found[0].label), (1, 1));
        assert_eq!(found[0].box_px, [8.0, 8.0, 16.0, 16.0]);
        // Its box lies beyond this picture, in the padding.
        found.clear();
        model
            .detect(&[0; 3 * 11 * 11], [11, 11], &mut found)
            .expect("an answer");
        assert!(found.is_empty());

        let mut model = OnnxDetector::load(&test_model("fixed_size"), 1).expect("a model");
        assert_eq!(model.input_px([150, 100]).expect("a size"), [200, 100]);
        let grey = vec![9; 3 * 150 * 70];
        model
            .detect(&grey, [150, 70], &mut found)
            .expect("an answer");
        let error = model
            .input_px([150, 101])
            .expect_err("too large")
            .to_string();
        assert!(
            error.contains("at most 200 x 100 px, not 150 x 101"),
            "{error}"
        );
    }

    /// The model's box is as high as the batch, and its score the picture's mean.
    #[test]
    fn views_of_one_size_are_answered_together_each_with_its_own() {
        let mut model = OnnxDetector::load(&test_model("batches"), 1).expect("a model");
        let views = [([70, 40], 51), ([100, 80], 102), ([70, 40], 153)];
        let pictures = views.map(|([w, h], grey)| vec![grey; 3 * w * h]);
        let views: Vec<View> = (views.iter().zip(&pictures))
            .map(|(([w, h], _), rgb8)| View {
                rgb8,
                width_px: *w as u32,
                look: PixelRect {
                    offset_px: [0, 0],
                    size_px: [*w as u32, *h as u32],
                },
            })
            .collect();
        let found = model.detect_all(&views).expect("answers");
        let seen = |i: usize| (found[i][0].box_px[3], found[i][0].score, found[i].len());
        // 40 rows are padded to 64.
        for (i, height_px, score) in [(0, 2.0, 0.125), (1, 1.0, 0.4), (2, 2.0, 0.375)] {
            let (high, mean, count) = seen(i);
            assert_eq!((high, count), (height_px, 1), "{i}");
            assert!((mean - score).abs() < 1e-4, "{i}: {mean}");
        }
        assert!(model.detect_all(&[]).expect("nothing").is_empty());
    }

    #[test]
    fn the_default_detector_takes_batches_and_sees_what_it_sees_alone() {
        let path =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/models/boresight-p2-roi.onnx");
        let mut model = OnnxDetector::load(&path, 1).expect("the shipped model");
        assert!(model.batches);
        let size_px = [160, 120];
        let pictures = [30, 64, 90].map(quadcopter);
        let views = pictures.each_ref().map(|rgb8| View {
            rgb8,
            width_px: 160,
            look: PixelRect {
                offset_px: [0, 0],
                size_px,
            },
        });
        let together = model.detect_all(&views).expect("answers");
        for (rgb8, together) in pictures.iter().zip(together) {
            let mut alone = Vec::new();
            model.detect(rgb8, size_px, &mut alone).expect("an answer");
            let (a, b) = (alone[0], together[0]);
            assert!(a.score > 0.3, "{a:?}");
            assert!((a.score - b.score).abs() < 1e-4, "{a:?} {b:?}");
            assert!((a.aim_px[0] - b.aim_px[0]).abs() < 1e-2, "{a:?} {b:?}");
        }
    }

    #[test]
    fn a_number_that_is_none_in_a_later_picture_is_an_error() {
        let mut model = OnnxDetector::load(&test_model("nan_later"), 1).expect("a model");
        let mut picture = vec![40; 3 * 64 * 64];
        let mut found = Vec::new();
        model
            .detect(&picture, [64, 64], &mut found)
            .expect("an answer");
        picture[0] = 41;
        let error = model
            .detect(&picture, [64, 64], &mut found)
            .expect_err("refused");
        assert!(error.to_string().contains("not finite"), "{error}");
    }

    #[test]
    fn a_provider_that_the_runtime_lacks_is_refused() {
        let there = providers().expect("a runtime");
        for provider in [Provider::Cuda, Provider::Tensorrt] {
            let setup = Setup {
                threads: 1,
                provider,
                named_in: "detector.onnx_model",
            };
            if there.contains(&provider.runtime_name()) {
                continue;
            }
            let Err(error) = OnnxDetector::load_with(&test_model("good"), &setup) else {
                panic!("{provider} is taken");
            };
            let text = error.to_string();
            let name = provider.runtime_name();
            assert!(
                text.contains(name) && text.contains("detector.provider"),
                "{text}"
            );
        }
    }

    /// Answers come in the order of the pictures, and are the same from either worker.
    #[test]
    fn a_thread_of_its_own_answers_as_the_caller_does() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/models/saliency.onnx");
        let load = || OnnxDetector::load(&path, 2).expect("the shipped model");
        let mut workers = [
            Inference::on_thread(load()).expect("a thread"),
            Inference::on_caller(load()),
        ];
        let pictures: Vec<Picture> = (0..6_u32)
            .map(|i| {
                let disc = |at: u32| {
                    let (x, y) = (at % 200, at / 200);
                    (x.abs_diff(60 + 12 * i).pow(2) + y.abs_diff(70).pow(2) < 20) as u8
                };
                let noise = |at: u32| (at.wrapping_mul(2_654_435_761) >> 20 & 3) as u8;
                Picture {
                    rgb8: Arc::new(
                        (0..200 * 150)
                            .flat_map(|at| [160 + noise(at) - 70 * disc(at); 3])
                            .collect(),
                    ),
                    width_px: 200,
                    look: PixelRect {
                        offset_px: [20, 10],
                        size_px: [150, 120],
                    },
                }
            })
            .collect();
        let answers = workers.each_mut().map(|worker| {
            for pictures in pictures.chunks(2) {
                worker.submit(pictures.to_vec());
            }
            let answers: Vec<Vec<Detection>> = (pictures.iter())
                .map(|_| worker.fetch().expect("an answer"))
                .collect();
            answers
        });
        assert_eq!(answers[0], answers[1]);
        for (i, found) in answers[0].iter().enumerate() {
            // The disc's middle in the part that was looked at.
            let [x, y] = found[0].centre_px();
            assert!(found[0].score > 0.5, "{i}: {found:?}");
            assert!(
                (x - (40.5 + 12.0 * i as f64)).hypot(y - 60.5) < 0.5,
                "{i}: {x} {y}"
            );
        }
    }
}
