//! Mount and beam of a station.

use super::vectors;
use crate::numbers::{Matrix, Vector, pose, three, two};
use boresight::components::beam::BeamState;
use boresight::simulation as sim;
use pyo3::prelude::*;

/// A mount as a tick left it. Azimuths run clockwise from north; rates are relative to the base; deflections are of the
/// line of sight, right and up.
#[pyclass(frozen, module = "boresight")]
pub struct Mount(sim::MountView);

impl Mount {
    /// As a view shows it.
    pub fn of(mount: sim::MountView) -> Self {
        Self(mount)
    }

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

    /// True pose of the laser: takes points of it to east, north, up of the site [m]; it points along its third axis.
    ///
    /// Shape [4, 4].
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
    /// Greatest irradiance in the spot [W/m²].
    peak_wpm2: f64,
}

impl Beam {
    /// As a view shows it.
    pub fn of(beam: &BeamState) -> Self {
        Self {
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
            peak_wpm2: beam.peak_wpm2,
        }
    }
}
