//! What can be wrong with a detector.

use boresight_scenario::Provider;
use std::path::PathBuf;

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
    #[error(
        "{path}: this ONNX Runtime does not start: {why}; set ORT_DYLIB_PATH to another, or run ./setup.sh"
    )]
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
    #[error("detector model {path}: it cannot be run: {why}; export it again, or name another")]
    Run {
        /// The model file.
        path: PathBuf,
        /// What the runtime says.
        why: String,
    },
    /// The thread of the detector has ended; it does so only when it panics.
    #[error("the detector's thread has ended; the error before this one says why")]
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
