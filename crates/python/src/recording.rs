//! Recordings: what they say of their run, and their messages.

use crate::error::RecordingError;
use crate::numbers::Fields;
use boresight::recording::read::{Decoder, Recorded};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The recording of a run.
///
/// The base of `boresight.Recording`, which makes tables of its messages.
#[pyclass(frozen, subclass, module = "boresight._boresight")]
pub struct Recording {
    recorded: Recorded,
}

#[pymethods]
impl Recording {
    #[new]
    fn new(py: Python, path: PathBuf) -> PyResult<Self> {
        let recorded = py.detach(|| {
            let recorded = Recorded::open(&path)?;
            recorded.check()?;
            Ok::<_, boresight::recording::read::ReadError>(recorded)
        });
        let recorded = recorded.map_err(|error| RecordingError::new_err(error.to_string()))?;
        Ok(Self { recorded })
    }

    /// The file.
    #[getter]
    fn path(&self) -> &Path {
        &self.recorded.path
    }

    /// The scenario file as it was read.
    #[getter]
    fn scenario(&self) -> &str {
        &self.recorded.scenario_toml
    }

    /// The changes that were made to it.
    #[getter]
    fn overrides(&self) -> Vec<String> {
        self.recorded.overrides.clone()
    }

    /// Seed of the run.
    #[getter]
    fn seed(&self) -> u64 {
        self.recorded.seed
    }

    /// Version of the program that made it.
    #[getter]
    fn version(&self) -> &str {
        &self.recorded.version
    }

    /// Ticks a second [Hz].
    #[getter]
    fn tick_hz(&self) -> u32 {
        self.recorded.tick_hz
    }

    /// Whether it ends as a finished one does; that of a killed run lacks its last moments.
    #[getter]
    fn whole(&self) -> bool {
        self.recorded.is_whole()
    }

    /// Its topics, each with the number of its messages.
    fn topics(&self, py: Python) -> BTreeMap<String, usize> {
        py.detach(|| {
            let mut topics = BTreeMap::new();
            for message in self.recorded.messages() {
                *topics.entry(message.channel.topic.clone()).or_default() += 1;
            }
            topics
        })
    }

    /// The messages of a topic: a list of (time [s], fields by name). Bytes are base64 text.
    fn messages<'py>(&self, py: Python<'py>, topic: &str) -> PyResult<Vec<(f64, Fields<'py>)>> {
        let mut decoder = Decoder::default();
        let mut list = Vec::new();
        let mut known = false;
        for message in self.recorded.messages() {
            if message.channel.topic != topic {
                continue;
            }
            known = true;
            let t_s = self.recorded.t_s(self.recorded.tick(&message));
            let fields = decoder.decode(&message).ok_or_else(|| {
                RecordingError::new_err(format!("{topic}: a message at {t_s} s cannot be decoded"))
            })?;
            list.push((t_s, Fields(object(py, &fields)?.cast_into()?)));
        }
        if known {
            return Ok(list);
        }
        let topics: Vec<_> = self.topics(py).into_keys().collect();
        Err(RecordingError::new_err(format!(
            "{}: no topic '{topic}'; it has {}",
            self.recorded.path.display(),
            topics.join(", ")
        )))
    }
}

/// JSON as Python has it.
fn object<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Null => py.None().into_bound(py),
        Value::Bool(value) => value.into_pyobject(py)?.to_owned().into_any(),
        Value::Number(number) => match (number.as_u64(), number.as_i64(), number.as_f64()) {
            (Some(value), ..) => value.into_pyobject(py)?.into_any(),
            (_, Some(value), _) => value.into_pyobject(py)?.into_any(),
            (.., value) => value.into_pyobject(py)?.into_any(),
        },
        Value::String(text) => text.into_pyobject(py)?.into_any(),
        Value::Array(values) => {
            let list = PyList::empty(py);
            for value in values {
                list.append(object(py, value)?)?;
            }
            list.into_any()
        }
        Value::Object(fields) => {
            let dict = PyDict::new(py);
            for (name, value) in fields {
                dict.set_item(name, object(py, value)?)?;
            }
            dict.into_any()
        }
    })
}
