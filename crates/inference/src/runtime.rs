//! ONNX Runtime's library and its sessions.

use super::error::DetectorError;
use boresight_scenario::Provider;
use ort::ep::{CUDA, ExecutionProvider, TensorRT};
use ort::session::{Session, builder::SessionBuilder};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

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
pub fn environment() -> Result<&'static ort::environment::Environment, DetectorError> {
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

/// A session about to load a model.
pub(super) fn session(setup: &Setup) -> Result<SessionBuilder, DetectorError> {
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
pub(super) fn refused(path: &Path, message: &str) -> DetectorError {
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

/// Runtime messages run over several lines; the first says what is wrong.
pub fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().trim().to_string()
}
