//! A run that is shared by the objects that show it.

use crate::error;
use crate::parts::Raised;
use boresight::report::summary::Finished;
use boresight::simulation::{self as sim, SimulationError};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::sync::Mutex;

/// Between two looks whether Ctrl-C was pressed, so many ticks pass.
const TICKS_BETWEEN_SIGNALS: u64 = 64;

/// A run behind a lock; none once it is finished.
pub struct Held {
    run: Mutex<Option<sim::Simulation>>,
    raised: Raised,
}

impl Held {
    /// Holds a run whose parts in Python leave there what they raise.
    pub fn new(run: sim::Simulation, raised: Raised) -> Self {
        Self {
            run: Mutex::new(Some(run)),
            raised,
        }
    }

    /// Works with the run, the interpreter let go.
    pub fn with<T: Send>(
        &self,
        py: Python,
        work: impl FnOnce(&mut sim::Simulation) -> Result<T, SimulationError> + Send,
    ) -> PyResult<T> {
        let done = py.detach(|| match self.run.try_lock() {
            Ok(mut run) => match run.as_mut() {
                Some(run) => work(run).map_err(error::of),
                None => Err(PyRuntimeError::new_err(
                    "the simulation is finished; open it anew",
                )),
            },
            // Two threads at once, or a law or detector that asks its own run, would wait for ever.
            Err(_) => Err(PyRuntimeError::new_err(
                "the simulation is in the middle of a step; look at it afterwards, and from one thread at a time",
            )),
        });
        done.inspect_err(|error| {
            if let Some(cause) = self.raised.take() {
                error.set_cause(py, Some(cause));
            }
        })
    }

    /// Looks at it.
    pub fn view<T: Send>(
        &self,
        py: Python,
        look: impl FnOnce(sim::View) -> T + Send,
    ) -> PyResult<T> {
        self.with(py, |run| Ok(look(run.view())))
    }

    /// Looks at the station of a name.
    pub fn station_view<T: Send>(
        &self,
        py: Python,
        name: &str,
        look: impl FnOnce(sim::StationView) -> T + Send,
    ) -> PyResult<T> {
        let seen = self.view(py, |view| view.station(name).map(look))?;
        seen.ok_or_else(|| PyValueError::new_err(format!("no station '{name}' in the run")))
    }

    /// Ticks a second \[Hz\].
    pub fn tick_hz(&self, py: Python) -> PyResult<u32> {
        self.view(py, |view| view.tick_hz())
    }

    /// Steps until `ticks` have passed or Ctrl-C is pressed.
    pub fn steps(
        &self,
        py: Python,
        ticks: impl FnOnce(&sim::Simulation) -> u64 + Send,
    ) -> PyResult<bool> {
        let mut passed = 0;
        let mut interrupted = None;
        let over = self.with(py, |run| {
            let ticks = ticks(run);
            run.step_while(ticks, || {
                passed += 1;
                if passed % TICKS_BETWEEN_SIGNALS == 0 {
                    interrupted = Python::attach(|py| py.check_signals()).err();
                }
                interrupted.is_none()
            })
        })?;
        match interrupted {
            Some(signal) => Err(signal),
            None => Ok(over),
        }
    }

    /// Ends the run where it is; nothing where it was finished before.
    pub fn finish(&self, py: Python) -> PyResult<Option<Finished>> {
        py.detach(|| {
            let mut run = self.run.try_lock().map_err(|_| {
                PyRuntimeError::new_err(
                    "the simulation is in the middle of a step; finish it afterwards",
                )
            })?;
            let finished = run.take().map(sim::Simulation::finish);
            finished.transpose().map_err(error::of)
        })
    }
}
