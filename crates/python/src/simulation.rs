//! The front door.

use crate::error::{self, OrderError, ScenarioError};
use crate::frame::Frame;
use crate::held::Held;
use crate::parts::{PyDetector, PyLaw, Raised};
use crate::views::{Air, Event, Station, Uav};
use boresight::scenario::{DriveOrder, OrderConfig};
use boresight::simulation as sim;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// A run: opened, stepped, looked at, given orders, finished.
///
/// The base of `boresight.Simulation`, which says how it is opened.
#[pyclass(frozen, subclass, module = "boresight._boresight")]
pub struct Simulation {
    held: Arc<Held>,
}

/// A run's state between two ticks; it belongs to the run that it was taken of.
#[pyclass(frozen, module = "boresight")]
pub struct Snapshot {
    kept: sim::Snapshot,
}

#[pymethods]
impl Snapshot {
    /// Ticks from the start of the run.
    #[getter]
    fn tick(&self) -> u64 {
        self.kept.tick()
    }
}

#[pymethods]
impl Simulation {
    #[new]
    #[pyo3(signature = (path, text, seed, set, pictures, record, threads, laws, detectors))]
    #[allow(clippy::too_many_arguments)] // Called by the class in Python alone.
    fn new(
        py: Python,
        path: PathBuf,
        text: Option<String>,
        seed: Option<u64>,
        set: Vec<String>,
        pictures: Option<bool>,
        record: Option<PathBuf>,
        threads: Option<usize>,
        laws: BTreeMap<String, Py<PyAny>>,
        detectors: BTreeMap<String, Py<PyAny>>,
    ) -> PyResult<Self> {
        let raised = Raised::default();
        let kept = raised.clone();
        let opened = py.detach(|| {
            let mut builder = match text {
                Some(text) => sim::Builder::from_text(text, path),
                None => sim::Builder::file(path),
            };
            if let Some(seed) = seed {
                builder = builder.seed(seed);
            }
            if let Some(pictures) = pictures {
                builder = builder.pictures(pictures);
            }
            if let Some(threads) = threads {
                builder = builder.threads(threads);
            }
            if let Some(folder) = record {
                builder = builder.record(folder);
            }
            for change in set {
                builder = builder.set(change);
            }
            for (name, make) in laws {
                let raised = raised.clone();
                builder = builder.law(&name, move |plant| {
                    Python::attach(|py| match PyLaw::new(py, &make, plant, raised.clone()) {
                        Ok(law) => Ok(Box::new(law) as _),
                        Err(error) => Err(raised.keep(py, error).into()),
                    })
                });
            }
            for (name, object) in detectors {
                let raised = raised.clone();
                builder = builder.detector(&name, move |context| {
                    let tick_hz = context.loaded.scenario.tick_hz;
                    Python::attach(|py| {
                        match PyDetector::new(py, &object, tick_hz, raised.clone()) {
                            Ok(detector) => Ok(Box::new(detector) as _),
                            Err(error) => Err(raised.keep(py, error).into()),
                        }
                    })
                });
            }
            builder.open().map_err(error::of)
        });
        match opened {
            Ok(run) => Ok(Self {
                held: Arc::new(Held::new(run, kept)),
            }),
            Err(error) => {
                if let Some(cause) = kept.take() {
                    error.set_cause(py, Some(cause));
                }
                Err(error)
            }
        }
    }

    /// Lets so many ticks pass, fewer if the run ends before; True once it is over. Ctrl-C stops between two ticks.
    #[pyo3(signature = (ticks = 1))]
    fn step(&self, py: Python, ticks: u64) -> PyResult<bool> {
        self.held.steps(py, |_| ticks)
    }

    /// Lets time pass until `t_s` [s], or the run's end; True once it is over.
    fn run_until(&self, py: Python, t_s: f64) -> PyResult<bool> {
        if t_s.is_nan() {
            return Err(PyValueError::new_err(
                "run_until: NaN is no time; give seconds",
            ));
        }
        self.held.steps(py, |run| run.ticks_until(t_s))
    }

    /// Whether the run has come to its end.
    #[getter]
    fn over(&self, py: Python) -> PyResult<bool> {
        self.held.with(py, |run| Ok(run.over()))
    }

    /// Simulated time [s].
    #[getter]
    fn t_s(&self, py: Python) -> PyResult<f64> {
        self.held.view(py, |view| view.t_s())
    }

    /// Ticks since the start.
    #[getter]
    fn tick(&self, py: Python) -> PyResult<u64> {
        self.held.view(py, |view| view.tick())
    }

    /// Ticks a second [Hz].
    #[getter(tick_hz)]
    fn get_tick_hz(&self, py: Python) -> PyResult<u32> {
        self.held.tick_hz(py)
    }

    /// The tick after which the run ends at the latest.
    #[getter]
    fn last_tick(&self, py: Python) -> PyResult<u64> {
        self.held.view(py, |view| view.last_tick())
    }

    /// Hash of the whole state; each tick's covers the one before.
    #[getter]
    fn state_hash(&self, py: Python) -> PyResult<u64> {
        self.held.view(py, |view| view.state_hash())
    }

    /// Seed of every random stream.
    #[getter]
    fn seed(&self, py: Python) -> PyResult<u64> {
        self.held.with(py, |run| Ok(run.seed()))
    }

    /// The stations, in the order of the scenario.
    #[getter]
    fn stations(slf: &Bound<'_, Self>) -> PyResult<Vec<Station>> {
        let names = slf.get().held.view(slf.py(), |view| {
            view.stations()
                .map(|station| station.name().to_owned())
                .collect::<Vec<_>>()
        })?;
        Ok((names.into_iter())
            .map(|name| Station::of(slf.get().held.clone(), name))
            .collect())
    }

    /// The UAVs in the order of the scenario, and after them the distractors: the truth.
    #[getter]
    fn uavs(&self, py: Python) -> PyResult<Vec<Uav>> {
        self.held
            .view(py, |view| view.uavs().map(Uav::of).collect())
    }

    /// Weather and light.
    #[getter]
    fn air(&self, py: Python) -> PyResult<Air> {
        self.held.view(py, Air::of)
    }

    /// The newest frame of each camera that exposed in the last step. A step no longer than a camera's period misses none.
    #[getter]
    fn frames(&self, py: Python) -> PyResult<Vec<Frame>> {
        self.held.with(py, |run| {
            let tick_hz = run.view().tick_hz();
            let frames = run.frames();
            Ok(frames
                .map(|frame| Frame::of(frame.keep(), tick_hz))
                .collect())
        })
    }

    /// What happened in the last step, in order of time.
    #[getter]
    fn events(&self, py: Python) -> PyResult<Vec<Event>> {
        self.held.with(py, |run| {
            Ok(run.events().iter().cloned().map(Event::of).collect())
        })
    }

    /// Gives an order, as TOML.
    fn _give(&self, py: Python, order: &str) -> PyResult<()> {
        let order: OrderConfig = toml::from_str(order)
            .map_err(|error| OrderError::new_err(format!("order: {}", error.message())))?;
        self.held.with(py, |run| run.give(&order))
    }

    /// Drives gimbal \[°/s\] and mirror \[µrad\] from outside.
    fn _drive(
        &self,
        py: Python,
        rates_degps: Option<[f64; 2]>,
        mirror_urad: Option<[f64; 2]>,
        station: Option<String>,
    ) -> PyResult<()> {
        let order = OrderConfig {
            station,
            drive: Some(DriveOrder {
                rates_degps,
                mirror_urad,
            }),
            ..OrderConfig::default()
        };
        self.held.with(py, |run| run.give(&order))
    }

    /// The run's state, to go back to by `restore`: clocks, random streams, UAVs, mount, tracks, laws (by `copy.deepcopy`),
    /// orders. A detector's own memory is not held. It may be taken of a run that is recorded, too.
    fn snapshot(&self, py: Python) -> PyResult<Snapshot> {
        let kept = self.held.with(py, sim::Simulation::snapshot)?;
        Ok(Snapshot { kept })
    }

    /// Goes back to a snapshot of this run, or on to one: from there it goes on bit for bit as it did before. A run that is
    /// recorded refuses.
    fn restore(&self, py: Python, snapshot: &Snapshot) -> PyResult<()> {
        self.held.with(py, |run| run.restore(&snapshot.kept))
    }

    /// The scenario as TOML, with seed and orders of this run: run again, with the same parts, it is the same run.
    fn scenario_with_orders(&self, py: Python) -> PyResult<String> {
        let text = self.held.with(py, |run| Ok(run.scenario_with_orders()))?;
        text.map_err(|error| ScenarioError::new_err(error.to_string()))
    }

    /// The run summed up as far as it went, as JSON.
    fn _summary(&self, py: Python) -> PyResult<String> {
        let text = self
            .held
            .with(py, |run| Ok(serde_json::to_string(&run.summary().summary)))?;
        text.map_err(error::failed)
    }

    /// Ends the run where it is, and returns its summary as JSON; None where it was finished before.
    fn _finish(&self, py: Python) -> PyResult<Option<String>> {
        let finished = self.held.finish(py)?;
        let text = finished.map(|finished| serde_json::to_string(&finished.summary));
        text.transpose().map_err(error::failed)
    }
}
