//! Cameras from their scenario: geometry, sensor, exposure, boresight.

use crate::components::capture::{Lamp, LaserGate, StrayOptics};
use crate::components::environment::Environment;
use crate::components::mount::{Boresight, OpticalPath};
use crate::components::run::Seed;
use crate::models::air::turbulence::{AirPath, PathTurbulence};
use crate::models::optics::calibration::{self, CalibrationError};
use crate::models::optics::camera::Pinhole;
use crate::models::optics::exposure::{ExposureControl, white_balance};
use crate::models::optics::mosaic::Mosaic;
use crate::models::optics::motion::Shutter;
use crate::models::optics::seeing::{FrozenAir, Lens, Pupil, SeeingOptics};
use crate::models::optics::sensor::{SensorParams, Transfer};
use crate::models::optics::stray::lamp::{LampBeam, LampLight};
use crate::models::optics::stray::response::BlockingFilter;
use crate::scenario::{self, CameraOrder, CameraPath, Exposure, InputError, Loaded, WhiteBalance};
use glam::{DVec2, DVec3};
use std::sync::Arc;

/// Distance for which the cameras' turbulence blur is taken where the picture is not disturbed frame by frame [m].
pub const BLUR_RANGE_M: f64 = 1_000.0;

/// Standard deviation of a beacon's centroid in a calibration [px].
pub const CENTROID_SIGMA_PX: f64 = 0.2;

/// Centroids a camera in a calibration.
pub const CENTROIDS: usize = 200;

/// What turns a scenario's camera.
pub fn optical_path(path: CameraPath) -> OpticalPath {
    match path {
        CameraPath::Gimbal => OpticalPath::OnGimbal,
        CameraPath::Mirror => OpticalPath::BehindMirror,
        CameraPath::Fixed {
            azimuth_deg,
            elevation_deg,
        } => {
            let az_el_rad = DVec2::from([azimuth_deg, elevation_deg].map(f64::to_radians));
            OpticalPath::Apart {
                az_el_rad,
                measured_az_el_rad: az_el_rad,
            }
        }
        // Until its pan-tilt is there.
        CameraPath::PanTilt(_) => OpticalPath::Apart {
            az_el_rad: DVec2::ZERO,
            measured_az_el_rad: DVec2::ZERO,
        },
    }
}

/// The geometry of a scenario's camera.
pub fn pinhole(
    loaded: &Loaded,
    place: &str,
    camera: &scenario::CameraConfig,
) -> Result<Pinhole, InputError> {
    let hfov_rad = camera.hfov_deg.to_radians();
    Pinhole::from_hfov(camera.width_px, camera.height_px, hfov_rad)
        .map_err(|error| loaded.refuse(place, error))
}

/// How a camera is turned against the laser, and what the calibration finds of it; `key`: of its streams.
pub fn boresight(
    station: &scenario::Station,
    path: OpticalPath,
    pinhole: &Pinhole,
    seed: Seed,
    key: u64,
) -> Result<Boresight, CalibrationError> {
    // What stands behind the mirror looks through the laser's own optics.
    let share = if path == OpticalPath::BehindMirror {
        1.0 / 3.0
    } else {
        1.0
    };
    let sigma_rad = share * (1e-6 * station.mount.boresight_sigma_urad);
    let mut rng = seed.stream(key, "boresight");
    let mut draw = || sigma_rad * rng.normal();
    let true_rad = DVec3::new(draw(), draw(), draw());
    if !station.calibrate {
        return Ok(Boresight {
            true_rad,
            known_rad: DVec3::ZERO,
            sigma_rad,
        });
    }
    let mut rng = seed.stream(key, "calibration");
    let centroids = calibration::measure(pinhole, true_rad, CENTROIDS, CENTROID_SIGMA_PX, &mut rng);
    let found = calibration::estimate(pinhole, &centroids, CENTROID_SIGMA_PX)?;
    Ok(Boresight {
        true_rad,
        known_rad: found.rotation_rad,
        sigma_rad: found.standard_error_rad.truncate().max_element(),
    })
}

/// Pitch of the map by which turbulence shifts a picture [px]; what is finer blurs.
const SEEING_PITCH_PX: f64 = 4.0;

/// What a scenario's camera sees of the air of its station.
pub fn seeing_optics(
    camera: &scenario::CameraConfig,
    pinhole: &Pinhole,
    air: &Arc<FrozenAir>,
) -> SeeingOptics {
    let diameter_m = camera.focal_length_m() / camera.f_number;
    SeeingOptics {
        air: air.clone(),
        pupil: Pupil::disc(diameter_m),
        diameter_m,
        lens: Lens {
            focal_px: pinhole.focal_px,
            centre_px: pinhole.centre_px(),
            pitch_px: SEEING_PITCH_PX,
            line_s: match camera.shutter {
                scenario::Shutter::Global => 0.0,
                scenario::Shutter::Rolling => 1e-6 * camera.line_time_us,
            },
        },
    }
}

/// Lens and sensor of a scenario's camera in the light and air of the run. The sensor has the blur of a long exposure over a
/// kilometre of level air, unless the picture is `disturbed` frame by frame.
pub fn sensor_params(
    camera: &scenario::CameraConfig,
    environment: &Environment,
    r_station_enu_m: DVec3,
    pinhole: &Pinhole,
    pattern_key: u64,
    disturbed: bool,
) -> SensorParams {
    const WAVELENGTH_M: f64 = 550e-9;
    let pixel_pitch_m = camera.pixel_pitch_um * 1e-6;
    let ground_m = environment
        .city
        .dsm
        .terrain_m(r_station_enu_m.x, r_station_enu_m.y);
    let height_m = (r_station_enu_m.z - ground_m).max(1.0);
    let path = AirPath {
        length_m: BLUR_RANGE_M,
        h0_m: height_m,
        h1_m: height_m,
    };
    let fried_m =
        PathTurbulence::new(&environment.cn2, &path, WAVELENGTH_M, f64::INFINITY).fried_spherical_m;
    // Standard deviations of the Gaussians that fit the cores of the Airy pattern (0.42 lambda N)
    // and of the long-exposure seeing disc (FWHM 0.98 lambda / r0, over 2.355).
    let diffraction_px = 0.42 * WAVELENGTH_M * camera.f_number / pixel_pitch_m;
    let seeing_px = 0.98 * WAVELENGTH_M / fried_m / 2.355 * camera.focal_length_m() / pixel_pitch_m;
    let lens_px = camera.optics_blur_px.hypot(diffraction_px);
    let blur = if disturbed {
        lens_px
    } else {
        lens_px.hypot(seeing_px)
    };
    SensorParams {
        f_number: camera.f_number,
        pixel_pitch_m,
        transmission: 0.8,
        quantum_efficiency: 0.6,
        full_well_e: camera.full_well_e,
        read_noise_e: camera.read_noise_e,
        dark_current_eps: camera.dark_current_eps,
        dsnu_e: camera.dsnu_e,
        prnu: 0.01 * camera.prnu_percent,
        pattern_key,
        size_px: [camera.width_px, camera.height_px],
        focal_px: pinhole.focal_px,
        vignetting: 0.01 * camera.vignetting_percent,
        mosaic: match camera.mosaic {
            scenario::Mosaic::None => Mosaic::None,
            scenario::Mosaic::Rggb => Mosaic::Rggb,
            scenario::Mosaic::Mono => Mosaic::Mono,
        },
        shutter: match camera.shutter {
            scenario::Shutter::Global => Shutter::Global,
            scenario::Shutter::Rolling => Shutter::Rolling(1e-6 * camera.line_time_us),
        },
        motion_blur: camera.motion_blur,
        glare: camera.glare,
        blur_sigma_px: blur.min(16.0),
        white_balance: match camera.white_balance {
            _ if camera.mosaic == scenario::Mosaic::Mono => [1.0; 3],
            WhiteBalance::Auto => white_balance(environment.backdrop.sky.illuminant_klx()),
            WhiteBalance::Daylight => [1.0; 3],
        },
        transfer: Transfer::Srgb,
    }
}

/// What a scenario's camera does about the light of lasers and lamps.
pub fn stray_optics(camera: &scenario::CameraConfig) -> StrayOptics {
    StrayOptics {
        filter: BlockingFilter {
            band_m: camera.blocked_nm.map(|nm| nm * 1e-9),
            density: camera.blocking_od,
        },
        gate: match camera.laser_gate {
            scenario::LaserGate::None => LaserGate::None,
            scenario::LaserGate::Pause => LaserGate::Pause,
            scenario::LaserGate::Blank => LaserGate::Blank,
        },
        offset_m: camera.laser_offset_m,
        lens_m: camera.focal_length_m() / camera.f_number,
    }
}

/// The lamps of a scenario.
pub fn lamps(scenario: &scenario::Scenario) -> Vec<Lamp> {
    let stations = scenario.stations();
    let flying: Vec<&str> = scenario.flying().collect();
    let named: Vec<&str> = stations.iter().map(|station| &station.name[..]).collect();
    let number = |names: &[&str], name: &Option<String>| {
        let name = name.as_deref()?;
        names.iter().position(|known| *known == name)
    };
    let lamp = |light: &scenario::LightConfig| Lamp {
        beam: LampBeam {
            light: match light.power_w {
                Some(power_w) => LampLight::Line(power_w, light.wavelength_nm * 1e-9),
                None => LampLight::White(light.candela.unwrap_or(0.0)),
            },
            width_rad: light.beam_deg.to_radians(),
        },
        on: number(&flying, &light.on),
        r_enu_m: DVec3::from(light.position_enu_m.unwrap_or_default()),
        at: number(&named, &light.at).unwrap_or(0),
        lit_s: [light.from_s, light.to_s.unwrap_or(f64::INFINITY)],
    };
    scenario.lights.iter().map(lamp).collect()
}

/// The exposure control of a scenario's camera.
pub fn exposure_control(camera: &scenario::CameraConfig) -> ExposureControl {
    ExposureControl {
        level: camera.exposure_level,
        time_s: [0.0; 2],
        max_gain: 10f64.powf(camera.max_gain_db / 20.0),
        settling_s: camera.exposure_settling_s,
    }
    .timed(fixed_s(camera.exposure_s), 1.0 / f64::from(camera.rate_hz))
}

/// The exposure control after an order to a camera whose frames are `frame_s` [s] apart.
pub fn ordered(control: ExposureControl, order: &CameraOrder, frame_s: f64) -> ExposureControl {
    let control = ExposureControl {
        level: order.exposure_level.unwrap_or(control.level),
        ..control
    };
    match order.exposure_s {
        Some(exposure) => control.timed(fixed_s(exposure), frame_s),
        None => control,
    }
}

/// The time of a fixed exposure [s].
fn fixed_s(exposure: Exposure) -> Option<f64> {
    match exposure {
        Exposure::Seconds(time_s) => Some(time_s),
        Exposure::Auto(_) => None,
    }
}
