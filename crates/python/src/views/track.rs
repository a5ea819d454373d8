//! What a tracker believes.

use super::vectors;
use crate::numbers::{Vector, three, two};
use boresight::simulation as sim;
use glam::{DVec2, DVec3};
use pyo3::prelude::*;

/// What a tracker believes of one object, carried on to the present tick.
#[pyclass(frozen, module = "boresight")]
pub struct Track {
    #[pyo3(get)]
    /// Its identity, which no other track of the run ever has.
    id: u32,
    #[pyo3(get)]
    /// Whether it is the target.
    is_target: bool,
    #[pyo3(get)]
    /// Probability that it is a UAV.
    uav_probability: f64,
    #[pyo3(get)]
    /// Larger side of its box on the sky [rad].
    size_rad: f64,
    #[pyo3(get)]
    /// Frames that have shown it, of all cameras.
    hits: u32,
    #[pyo3(get)]
    /// Range and its standard deviation [m]; None where it is not known.
    range_m: Option<(f64, f64)>,
    vectors: TrackVectors,
    motion: Option<(DVec3, DVec3)>,
}

#[derive(Clone, Copy)]
struct TrackVectors {
    az_el_rad: DVec2,
    sigma_rad: DVec2,
    rates_radps: DVec2,
}

impl Track {
    /// As a view shows it.
    pub fn of(track: &sim::TrackView) -> Self {
        Self {
            id: track.id(),
            is_target: track.is_target(),
            uav_probability: track.uav_probability(),
            size_rad: track.size_rad(),
            hits: track.hits(),
            range_m: track.range_m(),
            vectors: TrackVectors {
                az_el_rad: track.az_el_rad(),
                sigma_rad: track.sigma_rad(),
                rates_radps: track.rates_radps(),
            },
            motion: track.motion_enu(),
        }
    }

    fn vectors(&self) -> &TrackVectors {
        &self.vectors
    }
}

vectors! { Track {
    /// Azimuth and elevation [rad].
    az_el_rad: two,
    /// Standard deviation of those [rad].
    sigma_rad: two,
    /// Rates of azimuth and elevation [rad/s].
    rates_radps: two,
}
    /// Position [m] and velocity [m/s], east, north, up of the site; None where the range is not known.
    ///
    /// Shape [3] each.
    #[getter]
    fn motion_enu<'py>(&self, py: Python<'py>) -> Option<(Vector<'py>, Vector<'py>)> {
        self.motion.map(|(r, v)| (three(py, r), three(py, v)))
    }

    fn __repr__(&self) -> String {
        let [az_deg, el_deg] = self.vectors.az_el_rad.to_array().map(f64::to_degrees);
        format!(
            "<Track {} at azimuth {az_deg:.3}, elevation {el_deg:.3} deg, a UAV by {:.2}>",
            self.id, self.uav_probability
        )
    }
}
