//! The program's errors as exceptions: each carries the one line that the program prints.

use boresight::app::RunError;
use boresight::scenario::InputError;
use boresight::simulation::SimulationError;
use pyo3::import_exception;
use pyo3::prelude::*;
use std::fmt::Display;

// They stand in Python, where type checkers see them.
import_exception!(boresight.errors, BoresightError);
import_exception!(boresight.errors, ScenarioError);
import_exception!(boresight.errors, OrderError);
import_exception!(boresight.errors, RecordingError);

/// Any other error of the program.
pub fn failed(error: impl Display) -> PyErr {
    BoresightError::new_err(error.to_string())
}

/// An error of the front door.
pub fn of(error: SimulationError) -> PyErr {
    let line = error.to_string();
    match error {
        SimulationError::Scenario(_) | SimulationError::Run(RunError::Scenario(_)) => {
            ScenarioError::new_err(line)
        }
        // What the set-up of a run refuses.
        SimulationError::Run(RunError::Part(part)) if part.is::<InputError>() => {
            ScenarioError::new_err(line)
        }
        SimulationError::Order(_) => OrderError::new_err(line),
        SimulationError::Recording(_) => RecordingError::new_err(line),
        _ => BoresightError::new_err(line),
    }
}
