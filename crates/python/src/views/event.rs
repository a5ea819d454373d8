//! What happened.

use crate::numbers::Fields;
use boresight::simulation::{self as sim, What};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Something that happened in a tick.
#[pyclass(frozen, module = "boresight")]
pub struct Event(sim::Event);

impl Event {
    /// As the run noted it.
    pub fn of(event: sim::Event) -> Self {
        Self(event)
    }
}

#[pymethods]
impl Event {
    /// The tick.
    #[getter]
    fn tick(&self) -> u64 {
        self.0.tick
    }

    /// Simulated time [s].
    #[getter]
    fn t_s(&self) -> f64 {
        self.0.t_s
    }

    /// "state", "order", "fire", "cease_fire", "uav" or "at_asset".
    #[getter]
    fn kind(&self) -> &'static str {
        match &self.0.what {
            What::State { .. } => "state",
            What::Order { .. } => "order",
            What::Fire { .. } => "fire",
            What::CeaseFire { .. } => "cease_fire",
            What::Uav { .. } => "uav",
            What::AtAsset { .. } => "at_asset",
        }
    }

    /// What more there is to say, by name: "station", "to", "reason", "order", "answer", "at", "uav", "name", "status".
    #[getter]
    fn data<'py>(&self, py: Python<'py>) -> PyResult<Fields<'py>> {
        let data = PyDict::new(py);
        match &self.0.what {
            What::State {
                station,
                to,
                reason,
            } => {
                data.set_item("station", station)?;
                data.set_item("to", to.name())?;
                data.set_item("reason", reason)?;
            }
            What::Order {
                station,
                command,
                answer,
            } => {
                data.set_item("station", station)?;
                let (answer, reason) = answer.words();
                data.set_item("order", command.name())?;
                data.set_item("answer", answer)?;
                data.set_item("reason", reason)?;
            }
            What::Fire { station, at } => {
                data.set_item("station", station)?;
                data.set_item("at", at)?;
            }
            What::CeaseFire { station } => data.set_item("station", station)?,
            What::Uav {
                index,
                name,
                status,
            } => {
                data.set_item("uav", index)?;
                data.set_item("name", name)?;
                data.set_item("status", status.name())?;
            }
            What::AtAsset { index, name } => {
                data.set_item("uav", index)?;
                data.set_item("name", name)?;
            }
        }
        Ok(Fields(data))
    }

    fn __repr__(&self, py: Python) -> PyResult<String> {
        Ok(format!(
            "<Event {} at {:.3} s: {}>",
            self.kind(),
            self.0.t_s,
            self.data(py)?.0.repr()?
        ))
    }
}
