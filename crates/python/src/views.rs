//! What can be read of a run between two ticks.

use crate::frame::Frame;
use crate::held::Held;
use crate::numbers::{Matrix, Vector, pose, rotation, three, two};
use boresight::models::maths::kinematics::Pose;
use boresight::simulation::{self as sim, What};
use glam::{DQuat, DVec2, DVec3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
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

    /// State of the engagement, such as "search" or "precise_track".
    #[getter]
    fn state(&self, py: Python) -> PyResult<&'static str> {
        self.look(py, |station| station.state().name())
    }

    /// Gimbal, mirror and base.
    #[getter]
    fn mount(&self, py: Python) -> PyResult<Mount> {
        self.look(py, |station| Mount(station.mount()))
    }

    /// What the beam did in the last tick.
    #[getter]
    fn beam(&self, py: Python) -> PyResult<Beam> {
        self.look(py, |station| {
            let beam = station.beam();
            Beam {
                firing: beam.firing,
                aimed: beam.aimed,
                power_at_target_w: beam.power_at_target_w,
                power_in_bucket_w: beam.power_in_bucket_w,
                irradiance_wpm2: beam.irradiance_wpm2,
                spot_radius_m: beam.spot_radius_m,
                offset_m: beam.offset_m,
                on_aim_point: beam.on_aim_point,
                transmittance: beam.transmittance,
                scintillation: beam.scintillation,
                energy_j: beam.energy_j,
                dwell_s: beam.dwell_s,
            }
        })
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
        self.look(py, |station| {
            let of = |camera: sim::CameraView| Camera {
                name: camera.name().to_owned(),
                tier: camera.tier().name(),
                sensor_px: (camera.pinhole().width_px, camera.pinhole().height_px),
                focal_px: camera.pinhole().focal_px,
                period_s: camera.period_s(),
                latency_s: camera.latency_s(),
                exposure_s: camera.exposure_s(),
                poses: [camera.pose(), camera.believed()],
            };
            station.cameras().map(of).collect()
        })
    }

    /// Where the radar has its targets now: a list of (number in the scenario, azimuth [rad], elevation [rad], range [m]).
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

/// A class of vectors: each a fresh array.
macro_rules! vectors {
    ($class:ident { $($(#[$doc:meta])* $name:ident: $kind:ident,)* } $($more:tt)*) => {
        #[pymethods]
        impl $class {
            $($(#[$doc])*
            #[getter]
            fn $name<'py>(&self, py: Python<'py>) -> Vector<'py> {
                $kind(py, self.vectors().$name)
            })*
            $($more)*
        }
    };
}

/// A mount as a tick left it. Azimuths run clockwise from north; rates are relative to the base; deflections are of the
/// line of sight, right and up.
#[pyclass(frozen, module = "boresight")]
pub struct Mount(sim::MountView);

impl Mount {
    fn vectors(&self) -> &sim::MountView {
        &self.0
    }
}

vectors! { Mount {
    /// Where the axes cross, east, north, up of the site [m].
    r_enu_m: three,
    /// True azimuth and elevation [rad].
    az_el_rad: two,
    /// True rates of azimuth and elevation [rad/s].
    rates_radps: two,
    /// Azimuth and elevation by the encoders [rad].
    measured_az_el_rad: two,
    /// Rates by the gyros [rad/s].
    measured_rates_radps: two,
    /// Deflection by the mirror [rad].
    mirror_rad: two,
    /// Tilt of the base, a rotation vector about east, north, up [rad].
    base_tilt_rad: three,
    /// Rates commanded for the next tick [rad/s].
    commanded_rates_radps: two,
    /// Deflection commanded for the next tick [rad].
    commanded_mirror_rad: two,
    /// Where the station believes its laser to point, a unit vector.
    believed_axis_enu: three,
}
    /// Whether the mirror is at a stop.
    #[getter]
    fn mirror_at_stop(&self) -> bool {
        self.0.mirror_at_stop
    }

    /// True pose of the laser, [4, 4]; it points along its third axis.
    #[getter]
    fn laser_pose<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        pose(py, &self.0.laser)
    }
}

/// A beam as a tick left it.
#[pyclass(frozen, get_all, module = "boresight")]
pub struct Beam {
    /// Whether the laser emitted.
    firing: bool,
    /// The UAV nearest to the beam's axis: its number in the scenario; None where there is none.
    aimed: Option<usize>,
    /// Power that arrives at that UAV's range [W].
    power_at_target_w: f64,
    /// Power inside the bucket about its aim point [W].
    power_in_bucket_w: f64,
    /// Mean irradiance over that bucket [W/m²].
    irradiance_wpm2: f64,
    /// Short-term 1/e² radius at its range [m].
    spot_radius_m: f64,
    /// Distance of the beam's centre from its aim point [m].
    offset_m: f64,
    /// Whether the firing beam's centre lay on that aim point, with nothing in between.
    on_aim_point: bool,
    /// Transmittance of the air.
    transmittance: f64,
    /// Relative intensity by scintillation.
    scintillation: f64,
    /// Energy emitted since the start [J].
    energy_j: f64,
    /// Time for which the firing beam's centre lay on the target's aim point [s].
    dwell_s: f64,
}

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
    fn of(track: &sim::TrackView) -> Self {
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

#[pymethods]
impl Camera {
    /// True pose, [4, 4]: takes points of the camera (right, down, forward) to east, north, up of the site [m].
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        pose(py, &self.poses[0])
    }

    /// The same as the station believes it.
    #[getter]
    fn believed_pose<'py>(&self, py: Python<'py>) -> PyResult<Matrix<'py>> {
        pose(py, &self.poses[1])
    }
}

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
    /// Temperature of the skin under the aim point [K]; None of a distractor.
    skin_k: Option<f64>,
    #[pyo3(get)]
    /// Mean irradiance on that skin in the last tick [W/m²].
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
    /// When its skin failed [s]; None before.
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
    /// How it is turned, [3, 3]: from its body's axes (forward, left, up) to east, north, up.
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
    fn data<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
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
                data.set_item("order", format!("{command:?}"))?;
                data.set_item("answer", format!("{answer:?}"))?;
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
        Ok(data)
    }

    fn __repr__(&self, py: Python) -> PyResult<String> {
        Ok(format!(
            "<Event {} at {:.3} s: {}>",
            self.kind(),
            self.0.t_s,
            self.data(py)?.repr()?
        ))
    }
}
