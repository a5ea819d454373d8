//! The program's errors as exceptions: each carries the one line that the program prints.

use boresight::simulation::SimulationError;
use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use std::fmt::Display;

create_exception!(
    boresight,
    BoresightError,
    PyException,
    "What keeps a simulation from being opened, going on or being finished."
);
create_exception!(
    boresight,
    ScenarioError,
    BoresightError,
    "A scenario that cannot be read or is not valid; names the place and the mend."
);
create_exception!(
    boresight,
    OrderError,
    BoresightError,
    "An order that nobody can obey; names the value and what would be right."
);
create_exception!(
    boresight,
    RecordingError,
    BoresightError,
    "A recording that cannot be read."
);

/// Any other error of the program.
pub fn failed(error: impl Display) -> PyErr {
    BoresightError::new_err(error.to_string())
}

/// An error of the front door.
pub fn of(error: SimulationError) -> PyErr {
    let line = error.to_string();
    match error {
        SimulationError::Scenario(_) => ScenarioError::new_err(line),
        SimulationError::Order(_) => OrderError::new_err(line),
        SimulationError::Recording(_) => RecordingError::new_err(line),
        _ => BoresightError::new_err(line),
    }
}

/// Adds the exceptions to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("BoresightError", py.get_type::<BoresightError>())?;
    module.add("ScenarioError", py.get_type::<ScenarioError>())?;
    module.add("OrderError", py.get_type::<OrderError>())?;
    module.add("RecordingError", py.get_type::<RecordingError>())
}
