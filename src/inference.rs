//! ONNX detectors through ONNX Runtime, loaded at run time.
//!
//! A model takes `image`, f32 `[1, 3, H, W]`, RGB 0 to 1, native resolution, and gives `boxes` f32
//! `[N, 4]` (x0, y0, x1, y1 in input pixels), `scores` f32 `[N]` and `labels` i64 `[N]`, or takes
//! `[B, 3, H, W]` for any B and gives each with a leading B; its metadata says
//! `boresight.interface = 1`, which `classes` there are and how pictures are padded
//! (training/README.md).

use crate::models::optics::camera::PixelRect;
use crate::models::optics::detection::{Detection, Padding, planes};
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
mod tests;
