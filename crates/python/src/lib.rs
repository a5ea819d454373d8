#![doc = include_str!("../README.md")]

mod error;
mod frame;
mod held;
mod numbers;
mod parts;
mod recording;
mod simulation;
mod views;

use boresight::cli;
use pyo3::prelude::*;
use std::ffi::OsString;

/// Carries a command line out, as `boresight` does, and returns its exit code.
#[pyfunction]
fn command(py: Python, arguments: Vec<OsString>) -> u8 {
    py.detach(|| cli::program(arguments))
}

/// What the package `boresight` is made of; use it through that.
#[pymodule]
mod _boresight {
    #[pymodule_export]
    use super::command;
    #[pymodule_export]
    use crate::frame::{Frame, Seen};
    #[pymodule_export]
    use crate::parts::{Picture, Plant, PointingInput};
    #[pymodule_export]
    use crate::recording::Recording;
    #[pymodule_export]
    use crate::simulation::{Simulation, Snapshot};
    #[pymodule_export]
    use crate::views::{Air, Beam, Camera, Event, Mount, Station, Track, Uav};

    #[pymodule_export]
    #[allow(non_upper_case_globals)] // Python's name.
    const __version__: &str = boresight::VERSION;
}
