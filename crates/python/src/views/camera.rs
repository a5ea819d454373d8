//! Cameras of a station.

use crate::numbers::{Matrix, pose};
use boresight::models::maths::kinematics::Pose;
use boresight::simulation as sim;
use pyo3::prelude::*;

/// A camera of a station.
#[pyclass(frozen, module = "boresight")]
pub struct Camera {
    #[pyo3(get)]
    /// Its name.
    name: String,
    #[pyo3(get)]
    /// "search", "coarse" or "precise".
    tier: &'static str,
    #[pyo3(get)]
    /// Width and height of its sensor [px].
    sensor_px: (u32, u32),
    #[pyo3(get)]
    /// Focal length over pixel pitch [px].
    focal_px: f64,
    #[pyo3(get)]
    /// Time between exposures [s].
    period_s: f64,
    #[pyo3(get)]
    /// Time from an exposure to the arrival of its detections [s].
    latency_s: f64,
    #[pyo3(get)]
    /// Exposure time times gain [s]; None before the first exposure.
    exposure_s: Option<f64>,
    poses: [Pose; 2],
}

impl Camera {
    /// As a view shows it.
    pub fn of(camera: sim::CameraView) -> Self {
        Self {
            name: camera.name().to_owned(),
            tier: camera.tier().word(),
            sensor_px: (camera.pinhole().width_px, camera.pinhole().height_px),
            focal_px: camera.pinhole().focal_px,
            period_s: camera.period_s(),
            latency_s: camera.latency_s(),
            exposure_s: camera.exposure_s(),
            poses: [camera.pose(), camera.believed()],
        }
    }
}

#[pymethods]
impl Camera {
    /// True pose: takes points of the camera (right, down, forward) to east, north, up of the site [m].
    ///
    /// Shape [4, 4].
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        pose(py, &self.poses[0])
    }

    /// The same as the station believes it.
    ///
    /// Shape [4, 4].
    #[getter]
    fn believed_pose<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        pose(py, &self.poses[1])
    }
}
