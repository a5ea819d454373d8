//! UAVs and the air: the truth.

use super::vectors;
use crate::numbers::{Matrix, Vector, rotation, three};
use boresight::simulation as sim;
use glam::{DQuat, DVec3};
use pyo3::prelude::*;

/// A UAV or distractor: the truth.
#[pyclass(frozen, module = "boresight")]
pub struct Uav {
    #[pyo3(get)]
    /// Its number in the scenario; distractors come after all UAVs.
    index: usize,
    #[pyo3(get)]
    /// Its name.
    name: String,
    #[pyo3(get)]
    /// What it is if it is no UAV, such as "bird"; None for a UAV.
    distractor: Option<&'static str>,
    #[pyo3(get)]
    /// What has become of it: "flying", "falling", "struck", "down", "crashed" or "landed".
    status: String,
    #[pyo3(get)]
    /// Length, width and height [m].
    size_m: (f64, f64, f64),
    #[pyo3(get)]
    /// The hottest of what would fail under beams, a wall that bears or what lies behind one [K]; None of a distractor.
    skin_k: Option<f64>,
    #[pyo3(get)]
    /// The hottest place that beams have fallen on [K]; None of a distractor.
    face_k: Option<f64>,
    #[pyo3(get)]
    /// Area that is burnt through [m²].
    hole_m2: f64,
    #[pyo3(get)]
    /// Parts that lasers have destroyed, in the order of their loss: "body", "battery", "motor", "arm", "camera".
    lost: Vec<String>,
    #[pyo3(get)]
    /// Mean irradiance within 5 cm of the aim point in the last tick [W/m²].
    irradiance_wpm2: f64,
    #[pyo3(get)]
    /// Energy that lasers emitted while it was the aimed one [J].
    energy_j: f64,
    #[pyo3(get)]
    /// Time for which a firing beam's centre lay on its aim point [s].
    dwell_s: f64,
    #[pyo3(get)]
    /// When a camera of a station first held it [s]; None before.
    acquired_s: Option<f64>,
    #[pyo3(get)]
    /// When it was brought down [s]; None before.
    neutralised_s: Option<f64>,
    #[pyo3(get)]
    /// When it came within the asset's radius unharmed [s]; None before.
    at_asset_s: Option<f64>,
    vectors: UavVectors,
    q_enu_body: DQuat,
}

#[derive(Clone, Copy)]
struct UavVectors {
    r_enu_m: DVec3,
    v_enu_mps: DVec3,
    aim_enu_m: DVec3,
}

impl Uav {
    /// As a view shows it.
    pub fn of(uav: sim::UavView) -> Self {
        let fate = uav.fate();
        Self {
            index: uav.index(),
            name: uav.name().to_owned(),
            distractor: uav.distractor().map(|kind| kind.name()),
            status: uav.status().name().to_owned(),
            size_m: uav.size_m().into(),
            skin_k: uav.skin_k(),
            face_k: uav.face_k(),
            hole_m2: uav.hole_m2(),
            lost: uav.lost(),
            irradiance_wpm2: uav.irradiance_wpm2(),
            energy_j: uav.dose().energy_j,
            dwell_s: uav.dose().dwell_s,
            acquired_s: fate.and_then(|fate| fate.acquired_s),
            neutralised_s: fate.and_then(|fate| fate.neutralised_s),
            at_asset_s: fate.and_then(|fate| fate.at_asset_s),
            vectors: UavVectors {
                r_enu_m: uav.r_enu_m(),
                v_enu_mps: uav.v_enu_mps(),
                aim_enu_m: uav.aim_enu_m(),
            },
            q_enu_body: uav.q_enu_body(),
        }
    }

    fn vectors(&self) -> &UavVectors {
        &self.vectors
    }
}

vectors! { Uav {
    /// Where it is, east, north, up of the site [m].
    r_enu_m: three,
    /// Its velocity over the ground [m/s].
    v_enu_mps: three,
    /// Where the part aimed at is [m].
    aim_enu_m: three,
}
    /// How it is turned: from its body's axes (forward, left, up) to east, north, up.
    ///
    /// Shape [3, 3].
    #[getter]
    fn rotation_enu_body<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        rotation(py, self.q_enu_body)
    }

    fn __repr__(&self) -> String {
        let r = self.vectors.r_enu_m;
        format!(
            "<Uav '{}', {}, at {:.1}, {:.1}, {:.1} m>",
            self.name, self.status, r.x, r.y, r.z
        )
    }
}

/// Weather and light.
#[pyclass(frozen, module = "boresight")]
pub struct Air {
    #[pyo3(get)]
    /// Mean wind speed at 10 m [m/s].
    wind_speed_mps: f64,
    #[pyo3(get)]
    /// Direction the wind blows from, clockwise from north [rad].
    wind_from_rad: f64,
    #[pyo3(get)]
    /// Meteorological visibility [m].
    visibility_m: f64,
    #[pyo3(get)]
    /// Temperature [K].
    temperature_k: f64,
    #[pyo3(get)]
    /// Relative humidity, 0 to 1.
    relative_humidity: f64,
    #[pyo3(get)]
    /// Pressure [Pa].
    pressure_pa: f64,
    #[pyo3(get)]
    /// Structure parameter of the refractive index 10 m above the first station's ground [m^(-2/3)].
    cn2_10m: f64,
    #[pyo3(get)]
    /// What the city is, in words.
    city: String,
    vectors: AirVectors,
}

#[derive(Clone, Copy)]
struct AirVectors {
    sun_dir_enu: DVec3,
}

impl Air {
    /// As a view shows it.
    pub fn of(view: sim::View) -> Self {
        let air = view.air();
        let weather = air.weather();
        let station = view.stations().next();
        let at = station.map_or(DVec3::ZERO, |station| station.mount().r_enu_m);
        let at = at + DVec3::Z * (10.0 - air.height_agl_m(at)); // [m]
        Self {
            wind_speed_mps: weather.wind_speed_mps,
            wind_from_rad: weather.wind_from_rad,
            visibility_m: weather.visibility_m,
            temperature_k: weather.temperature_k,
            relative_humidity: weather.relative_humidity,
            pressure_pa: weather.pressure_pa,
            cn2_10m: air.cn2(at),
            city: air.describe(),
            vectors: AirVectors {
                sun_dir_enu: air.sun_dir_enu(),
            },
        }
    }

    fn vectors(&self) -> &AirVectors {
        &self.vectors
    }
}

vectors! { Air {
    /// Direction to the sun, a unit vector.
    sun_dir_enu: three,
} }
