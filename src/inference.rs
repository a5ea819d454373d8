//! ONNX detectors through ONNX Runtime, loaded at run time.
//!
//! A model takes `image`, f32 `[1, 3, H, W]`, RGB 0 to 1, native resolution, any H and W, and
//! gives `boxes` f32 `[N, 4]` (x0, y0, x1, y1 in input pixels), `scores` f32 `[N]` and `labels`
//! i64 `[N]`; its metadata says `boresight.interface = 1`.

use crate::models::detection::Detection;
use ort::ep::{CUDA, ExecutionProvider, TensorRT};
use ort::session::Session;
use ort::value::{TensorElementType, TensorRef, ValueType};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Why a detector cannot be used.
#[derive(Debug, thiserror::Error)]
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
        "detector model {path}: cannot be read ({why}); name an existing .onnx file in detector.onnx_model"
    )]
    Unreadable {
        /// The model file.
        path: PathBuf,
        /// What the system said.
        why: String,
    },
    /// The file is no model that the runtime takes.
    #[error("detector model {path}: not a usable ONNX model ({why}); export it again (opset 17)")]
    Broken {
        /// The model file.
        path: PathBuf,
        /// What the runtime said.
        why: String,
    },
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
    planes: Vec<f32>,
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
    /// Loads and checks the model at `path`, which then runs on `threads` threads.
    pub fn load(path: &Path, threads: usize) -> Result<Self, DetectorError> {
        let unreadable = |error: std::io::Error| DetectorError::Unreadable {
            path: path.into(),
            why: error.to_string(),
        };
        if std::fs::metadata(path).map_err(unreadable)?.is_dir() {
            return Err(unreadable(std::io::ErrorKind::IsADirectory.into()));
        }
        std::fs::File::open(path).map_err(unreadable)?;
        let environment = environment()?;
        let broken = |why: String| DetectorError::Broken {
            path: path.into(),
            why: first_line(&why),
        };
        let session = Session::builder(environment)
            .map_err(|error| broken(error.to_string()))?
            .with_intra_threads(threads)
            .map_err(|error| broken(error.to_string()))?
            // Idle threads that spin would take the renderer's cores.
            .with_intra_op_spinning(false)
            .map_err(|error| broken(error.to_string()))?
            .commit_from_file(path)
            .map_err(|error| broken(error.to_string()))?;
        let mut detector = Self {
            session,
            path: path.into(),
            planes: Vec::new(),
        };
        detector.check_interface()?;
        // A grey frame shows a model that answers nonsense before the run starts.
        detector.detect(&[128; 128 * 128 * 3], [128, 128], &mut Vec::new())?;
        Ok(detector)
    }

    fn interface_error(&self, why: impl Into<String>) -> DetectorError {
        DetectorError::Interface {
            path: self.path.clone(),
            why: why.into(),
        }
    }

    fn check_interface(&self) -> Result<(), DetectorError> {
        let version = self
            .session
            .metadata()
            .ok()
            .and_then(|metadata| metadata.custom("boresight.interface"));
        if version.as_deref() != Some(INTERFACE) {
            return Err(self.interface_error(format!(
                "metadata boresight.interface is {}, expected {INTERFACE}",
                version.as_deref().unwrap_or("missing")
            )));
        }
        let names = |outlets: &[ort::value::Outlet]| {
            outlets
                .iter()
                .map(|outlet| outlet.name().to_string())
                .collect::<Vec<_>>()
        };
        let inputs = self.session.inputs();
        let image_ok = inputs.len() == 1
            && inputs[0].name() == "image"
            && matches!(inputs[0].dtype(), ValueType::Tensor { ty: TensorElementType::Float32, shape, .. } if shape.len() == 4);
        if !image_ok {
            return Err(self.interface_error(format!(
                "its inputs are {:?}, expected one input `image`, f32 [1, 3, H, W]",
                names(inputs)
            )));
        }
        let outputs = names(self.session.outputs());
        for wanted in ["boxes", "scores", "labels"] {
            if !outputs.iter().any(|name| name == wanted) {
                return Err(self.interface_error(format!(
                    "it has no output `{wanted}` (outputs are {outputs:?})"
                )));
            }
        }
        Ok(())
    }

    /// Appends the detections in an 8-bit RGB image of width and height `size_px`, in the
    /// image's own pixels, most confident first.
    pub fn detect(
        &mut self,
        rgb8: &[u8],
        size_px: [u32; 2],
        out: &mut Vec<Detection>,
    ) -> Result<(), DetectorError> {
        let [width, height] = size_px.map(|n| n as usize);
        let area = width * height;
        self.planes.resize(3 * area, 0.0);
        let (red, rest) = self.planes.split_at_mut(area);
        let (green, blue) = rest.split_at_mut(area);
        for (i, pixel) in rgb8.chunks_exact(3).enumerate().take(area) {
            red[i] = f32::from(pixel[0]) / 255.0;
            green[i] = f32::from(pixel[1]) / 255.0;
            blue[i] = f32::from(pixel[2]) / 255.0;
        }
        let path = &self.path;
        let broken = |error: ort::Error| DetectorError::Broken {
            path: path.clone(),
            why: first_line(&error.to_string()),
        };
        let wrong = |why: &str| DetectorError::Interface {
            path: path.clone(),
            why: why.to_string(),
        };
        let image = TensorRef::from_array_view(([1usize, 3, height, width], &self.planes[..]))
            .map_err(broken)?;
        let outputs = self
            .session
            .run(ort::inputs!["image" => image])
            .map_err(broken)?;
        let (shape, boxes) = outputs["boxes"]
            .try_extract_tensor::<f32>()
            .map_err(broken)?;
        let (_, scores) = outputs["scores"]
            .try_extract_tensor::<f32>()
            .map_err(broken)?;
        if shape.len() != 2 || shape[1] != 4 || boxes.len() != 4 * scores.len() {
            return Err(wrong("boxes are not [N, 4] with one score each"));
        }
        if boxes.iter().chain(scores).any(|x| !x.is_finite()) {
            return Err(wrong("it gives boxes or scores that are not finite"));
        }
        let first = out.len();
        out.extend(
            boxes
                .chunks_exact(4)
                .zip(scores)
                .map(|(b, score)| Detection {
                    box_px: [b[0], b[1], b[2], b[3]].map(f64::from),
                    score: f64::from(*score),
                }),
        );
        out[first..].sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(())
    }
}

/// Runtime messages run over several lines; the first says what is wrong.
pub(crate) fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().trim().to_string()
}
