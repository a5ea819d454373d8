//! A station: what it is doing and what it knows.

use super::camera::Camera;
use super::mount::{Beam, Mount};
use super::track::Track;
use crate::frame::Frame;
use crate::held::Held;
use boresight::simulation as sim;
use pyo3::prelude::*;
use std::sync::Arc;

/// A station of a run. It shows the present: read it again after a step.
#[pyclass(frozen, module = "boresight")]
pub struct Station {
    held: Arc<Held>,
    name: String,
}

impl Station {
    /// The station of a name, of a run.
    pub fn of(held: Arc<Held>, name: String) -> Self {
        Self { held, name }
    }

    fn look<T: Send>(
        &self,
        py: Python,
        look: impl FnOnce(sim::StationView) -> T + Send,
    ) -> PyResult<T> {
        self.held.station_view(py, &self.name, look)
    }
}

#[pymethods]
impl Station {
    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// State of the engagement: "search", "acquire", "coarse", "precise", "engage" or "lost".
    #[getter]
    fn state(&self, py: Python) -> PyResult<&'static str> {
        self.look(py, |station| station.state().name())
    }

    /// Gimbal, mirror and base.
    #[getter]
    fn mount(&self, py: Python) -> PyResult<Mount> {
        self.look(py, |station| Mount::of(station.mount()))
    }

    /// What the beam did in the last tick.
    #[getter]
    fn beam(&self, py: Python) -> PyResult<Beam> {
        self.look(py, |station| Beam::of(station.beam()))
    }

    /// Why the laser may not fire; empty while it may.
    #[getter]
    fn interlocks(&self, py: Python) -> PyResult<Vec<&'static str>> {
        self.look(py, |station| station.interlocks().to_vec())
    }

    /// Name of the pointing law in force.
    #[getter]
    fn law(&self, py: Python) -> PyResult<String> {
        self.look(py, |station| station.law().to_owned())
    }

    /// The tracks, in the order of their identities.
    #[getter]
    fn tracks(&self, py: Python) -> PyResult<Vec<Track>> {
        self.look(py, |station| {
            station.tracks().map(|track| Track::of(&track)).collect()
        })
    }

    /// The target's track, or None.
    #[getter]
    fn target(&self, py: Python) -> PyResult<Option<Track>> {
        self.look(py, |station| {
            station.target().map(|track| Track::of(&track))
        })
    }

    /// Probability that the target is a UAV, as far as fire is concerned; None without a target.
    #[getter]
    fn target_uav_probability(&self, py: Python) -> PyResult<Option<f64>> {
        self.look(py, |station| station.target_uav_probability())
    }

    /// The cameras, in the order of the scenario.
    #[getter]
    fn cameras(&self, py: Python) -> PyResult<Vec<Camera>> {
        self.look(py, |station| station.cameras().map(Camera::of).collect())
    }

    /// Where the radar has its targets now: a list of (number, azimuth [rad], elevation [rad], range [m]); the number
    /// is the UAV's in the scenario where the radar plots the truth, otherwise that of the radar's track.
    #[getter]
    fn radar(&self, py: Python) -> PyResult<Vec<(usize, f64, f64, f64)>> {
        self.look(py, |station| {
            let radar = station.radar();
            radar
                .map(|(index, az_el, range_m)| (index, az_el.x, az_el.y, range_m))
                .collect()
        })
    }

    /// The answers of the detector that arrived in the last tick: a list of (frame, detections), a detection being
    /// (x0, y0, x1, y1, score, label) in pixels of the whole sensor.
    #[getter]
    #[allow(clippy::type_complexity)] // A class for it would say no more.
    fn arrived(&self, py: Python) -> PyResult<Vec<(Frame, Vec<(f64, f64, f64, f64, f64, u32)>)>> {
        let tick_hz = self.held.tick_hz(py)?;
        self.look(py, |station| {
            let of = |arrived: sim::Arrived| {
                let found = arrived.detections.iter().map(|found| {
                    let [x0, y0, x1, y1] = found.box_px;
                    (x0, y0, x1, y1, found.score, found.label)
                });
                (
                    Frame::of(arrived.frame.keep(), tick_hz),
                    found.collect::<Vec<_>>(),
                )
            };
            station.arrived().map(of).collect()
        })
    }

    fn __repr__(&self, py: Python) -> PyResult<String> {
        Ok(format!("<Station '{}', {}>", self.name, self.state(py)?))
    }
}
