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

/// The module `boresight._boresight`.
#[pymodule]
fn _boresight(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", boresight::VERSION)?;
    error::register(module)?;
    module.add_class::<simulation::Simulation>()?;
    module.add_class::<frame::Frame>()?;
    module.add_class::<frame::Seen>()?;
    module.add_class::<views::Station>()?;
    module.add_class::<views::Mount>()?;
    module.add_class::<views::Beam>()?;
    module.add_class::<views::Track>()?;
    module.add_class::<views::Camera>()?;
    module.add_class::<views::Uav>()?;
    module.add_class::<views::Air>()?;
    module.add_class::<views::Event>()?;
    module.add_class::<parts::Picture>()?;
    module.add_class::<parts::Plant>()?;
    module.add_class::<parts::PointingInput>()?;
    module.add_class::<recording::Recording>()?;
    module.add_function(wrap_pyfunction!(command, module)?)?;
    Ok(())
}
