//! The scenario file: everything a run depends on, as TOML.
//!
//! Loading goes text → spanned TOML tree → `--set` overrides → numbered tree → [`Scenario`] →
//! checks. Every node of the tree gets a number before it is deserialised, so that an error, from
//! serde or from a check, leads back to the one node, its dotted path and its line.

use std::fmt::{self, Write as _};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use chrono::{DateTime, Utc};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use thiserror::Error;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::models::air::atmosphere::Cn2Profile;
use crate::models::air::metar::MetarError;
use crate::models::air::weather;
use crate::models::air::wind::over_rough_ground;
use crate::models::engage::interlock::Zone;
use crate::models::flight::distractor::DistractorKind;
use crate::models::flight::trajectory::Trajectory;
use crate::models::flight::uav::{AimPart, UavKind};
use crate::models::ground::city::CityParams;
use crate::models::laser::thermal::{self, SkinMaterial};
use crate::models::maths::rng::Stream;
use crate::models::mount::base_motion::{self, BaseMotionParams, Spectrum, TiltMode};
use crate::models::tracking::search::SearchPattern;

/// One run of the simulator: where, when, in what weather, with what equipment, against what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Short name; recordings and reports carry it.
    pub name: String,
    /// What the scenario shows, for people.
    #[serde(default)]
    pub description: String,
    /// Seed of every random stream: the same seed gives the same run, bit for bit.
    #[serde(default = "default_seed")]
    pub seed: u64,
    /// Simulated time to run.
    pub duration_s: f64,
    /// Rate of the simulation clock. Every camera's and recorder's rate must divide it.
    #[serde(default = "default_tick_hz")]
    pub tick_hz: u32,
    /// The origin of the local east-north-up frame on the WGS-84 ellipsoid.
    pub site: Site,
    /// Time at the start of the run, as TOML's own date-time or as an RFC 3339 string; it places
    /// the sun.
    #[serde(deserialize_with = "date_time")]
    pub time_utc: DateTime<Utc>,
    /// Wind, visibility, clouds and rain.
    #[serde(default)]
    pub weather: Weather,
    /// Optical turbulence along the line of sight.
    #[serde(default)]
    pub turbulence: Turbulence,
    /// The generated city around the station.
    #[serde(default)]
    pub city: CityParams,
    /// The protected station: mount, cameras and laser.
    #[serde(default)]
    pub station: Station,
    /// Where the station looks for targets.
    pub search: SearchSector,
    /// The UAVs; none makes a false-alarm run.
    #[serde(default)]
    pub uavs: Vec<Uav>,
    /// Birds, balloons, aeroplanes and leaves, which a detector may take for UAVs.
    #[serde(default)]
    pub distractors: Vec<Distractor>,
    /// What finds UAVs in the images.
    #[serde(default)]
    pub detector: Detector,
    /// How detections become tracks and which of them becomes the target.
    #[serde(default)]
    pub tracker: Tracker,
    /// What an operator orders during the run, in order of time.
    #[serde(default)]
    pub operator: Vec<Order>,
    /// The tracking loops.
    #[serde(default)]
    pub controller: Controller,
    /// When the laser may fire.
    #[serde(default)]
    pub engage: Engage,
    /// What is written down.
    #[serde(default)]
    pub record: Record,
}

fn default_seed() -> u64 {
    1
}

fn default_tick_hz() -> u32 {
    960
}

/// The site point: WGS-84 geodetic coordinates of the local origin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Site {
    /// Geodetic latitude, north positive.
    pub latitude_deg: f64,
    /// Longitude, east positive.
    pub longitude_deg: f64,
    /// Height of the street level above the ellipsoid.
    pub altitude_m: f64,
}

/// The weather: a METAR, explicit values, or both (an explicit value wins over the report's).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Weather {
    /// An aerodrome report, verbatim.
    pub metar: Option<String>,
    /// Mean wind speed 10 m above the ground, in a city above 0.7 of its mean building height; 3 without
    /// a METAR, whose wind, that of open ground, loses some half of its speed to the city's roughness.
    pub wind_speed_mps: Option<f64>,
    /// Direction the wind blows from, clockwise from north; 270 without a METAR.
    pub wind_from_deg: Option<f64>,
    /// Gust speed at the same height, the highest mean over 3 s in ten minutes; absent: no gusts beyond
    /// the turbulence of the mean wind.
    pub gust_mps: Option<f64>,
    /// Meteorological visibility at 550 nm, through the precipitation too. Absent: the METAR's, or
    /// 20,000 of haze, with `precipitation_mmph` reckoned in.
    pub visibility_m: Option<f64>,
    /// Air temperature; 15 without a METAR.
    pub temperature_c: Option<f64>,
    /// Relative humidity, 0 to 1; 0.5 without a METAR.
    pub relative_humidity: Option<f64>,
    /// Pressure at sea level; 1013.25 without a METAR.
    pub pressure_hpa: Option<f64>,
    /// Covered fraction of the sky, 0 to 1; 0 without a METAR.
    pub cloud_cover: Option<f64>,
    /// Height of the cloud base above the ground at the site's altitude. Under a cover of 7/8 or more
    /// nothing above it is seen or lit; absent without a METAR: the clouds are above everything.
    pub cloud_base_m: Option<f64>,
    /// Whether the covered fraction of the sky shows as clouds rather than as their mean light; they
    /// look broken below a full cover and mottled under it.
    #[serde(default)]
    pub cloud_texture: bool,
    /// Precipitation as water, snow below 1 °C, else rain; 0 without a METAR.
    pub precipitation_mmph: Option<f64>,
}

impl Weather {
    /// The weather of a run: the METAR's or the documented defaults, then the explicit values.
    pub fn resolved(&self) -> Result<weather::Weather, MetarError> {
        let base = match &self.metar {
            Some(report) => weather::Weather::from_metar(report)?,
            None => weather::Weather {
                wind_speed_mps: 3.0, // [m/s]
                wind_from_rad: 270f64.to_radians(),
                gust_mps: None,
                visibility_m: 20_000.0, // [m]
                temperature_k: 288.15,  // [K]
                relative_humidity: 0.5, // [-]
                pressure_pa: 101_325.0, // [Pa]
                cloud_cover: 0.0,       // [-]
                cloud_base_m: None,
                precipitation_mmph: 0.0, // [mm/h]
                snow: false,
            },
        };
        let given = weather::Weather {
            wind_speed_mps: self.wind_speed_mps.unwrap_or(base.wind_speed_mps),
            wind_from_rad: (self.wind_from_deg).map_or(base.wind_from_rad, f64::to_radians),
            gust_mps: self.gust_mps.or(base.gust_mps),
            visibility_m: self.visibility_m.unwrap_or(base.visibility_m),
            temperature_k: (self.temperature_c).map_or(base.temperature_k, |c| c + 273.15),
            relative_humidity: self.relative_humidity.unwrap_or(base.relative_humidity),
            pressure_pa: (self.pressure_hpa).map_or(base.pressure_pa, |hpa| 100.0 * hpa),
            cloud_cover: self.cloud_cover.unwrap_or(base.cloud_cover),
            cloud_base_m: self.cloud_base_m.or(base.cloud_base_m),
            ..base
        };
        Ok(match (self.precipitation_mmph, self.visibility_m) {
            (None, _) => given,
            (Some(rate_mmph), None) => given.with_precipitation(rate_mmph),
            (Some(rate_mmph), Some(visibility_m)) => weather::Weather {
                visibility_m,
                ..given.with_precipitation(rate_mmph)
            },
        })
    }

    /// The resolved weather at a site of roughness length `roughness_m` [m]: a report's wind is that
    /// of open ground, explicit values are the site's own.
    pub fn at_site(&self, resolved: weather::Weather, roughness_m: f64) -> weather::Weather {
        if self.metar.is_none() {
            return resolved;
        }
        let (reported_mps, gust_mps) = (resolved.wind_speed_mps, resolved.gust_mps);
        let (wind_speed_mps, gust_mps) = over_rough_ground(reported_mps, gust_mps, roughness_m);
        weather::Weather {
            wind_speed_mps: self.wind_speed_mps.unwrap_or(wind_speed_mps),
            gust_mps: self.gust_mps.or(gust_mps),
            ..resolved
        }
    }
}

/// Optical turbulence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Turbulence {
    /// Refractive-index structure constant Cn² in m^(-2/3), at the profile's own ground: 1e-15 is
    /// calm, 1e-14 an ordinary day, 1e-13 a hot roof.
    pub cn2_ground: f64,
    /// How the structure constant falls with height.
    pub profile: TurbulenceProfile,
    /// How the laser's intensity fluctuates.
    pub intensity: IntensityModel,
}

impl Default for Turbulence {
    fn default() -> Self {
        Self {
            cn2_ground: 1e-14,
            profile: TurbulenceProfile::Urban,
            intensity: IntensityModel::Physical,
        }
    }
}

/// Height profile of the refractive-index structure constant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TurbulenceProfile {
    /// Falls with height above the roofs by time of day; the ground value holds 10 m above the
    /// displacement height, which is 0.7 of the mean building height.
    Urban,
    /// Hufnagel–Valley with a pseudo-wind of 21 m/s and the ground value.
    HufnagelValley,
    /// The ground value everywhere.
    Constant,
}

impl Turbulence {
    /// The profile over a city of mean building height `building_height_m` [m], by `day` or night.
    pub fn cn2_profile(&self, building_height_m: f64, day: bool) -> Cn2Profile {
        match self.profile {
            TurbulenceProfile::Constant => Cn2Profile::Constant(self.cn2_ground),
            TurbulenceProfile::HufnagelValley => Cn2Profile::HufnagelValley {
                wind_mps: 21.0, // [m/s]
                ground: self.cn2_ground,
            },
            TurbulenceProfile::Urban => Cn2Profile::Urban {
                cn2_ref: self.cn2_ground,
                height_ref_m: 10.0, // [m]
                displacement_m: 0.7 * building_height_m,
                day,
            },
        }
    }
}

/// Intensity fluctuation of the laser channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum IntensityModel {
    /// Stationary gamma–gamma scintillation with a correlation time.
    Physical,
    /// The paper's equation 7, a geometric Brownian motion; it never becomes stationary.
    Paper,
}

/// The protected station.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Station {
    /// East, north, up of the mount's axes crossing; absent: on the city's station rooftop.
    pub position_enu_m: Option<[f64; 3]>,
    /// The two-axis gimbal and its steering mirror.
    pub mount: Mount,
    /// Whether the cameras' boresights are measured against the laser before the run and what was
    /// found is taken off; without it the laser misses by the boresight error.
    pub calibrate: bool,
    /// The search, coarse and precise cameras.
    pub cameras: Cameras,
    /// The laser and its beam director.
    pub laser: Laser,
}

impl Default for Station {
    fn default() -> Self {
        Self {
            position_enu_m: None,
            mount: Mount::default(),
            calibrate: true,
            cameras: Cameras::default(),
            laser: Laser::default(),
        }
    }
}

/// The azimuth–elevation gimbal and the fast steering mirror.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Mount {
    /// Azimuth stops [from, to]; absent: turns without end.
    pub azimuth_limits_deg: Option<[f64; 2]>,
    /// Elevation stops [from, to].
    pub elevation_limits_deg: [f64; 2],
    /// Fastest turn of either axis.
    pub max_rate_degps: f64,
    /// Largest angular acceleration of either axis.
    pub max_acceleration_degps2: f64,
    /// Steering mirror throw either way, as an angle of the line of sight.
    pub mirror_range_mrad: f64,
    /// Natural frequency of the steering mirror's position loop.
    pub mirror_bandwidth_hz: f64,
    /// How the roof under the mount moves: a preset, its strength and frequency, or a spectrum.
    pub base_motion: BaseMotion,
    /// Whether the axes have dry friction, backlash, encoder steps and gyro noise; the structural
    /// mode stays.
    pub friction: bool,
    /// First structural mode of either axis, of the load on the locked rotor; 0 is a rigid axis.
    /// The tuned law's gain sets off a mode below some 12 Hz.
    pub structural_mode_hz: f64,
    /// Backlash of either axis, stop to stop; a direct drive has none.
    pub backlash_urad: f64,
    /// Bits of the encoders per turn.
    pub encoder_bits: u32,
    /// Whether the wind turns the axes: its drag on the optics ahead of them, with gusts.
    pub wind_load: bool,
    /// Standard deviation, per axis, of how the search and coarse cameras are turned against the
    /// laser as built; the precise camera, which shares its optics, a third of it.
    pub boresight_sigma_urad: f64,
}

impl Default for Mount {
    fn default() -> Self {
        Self {
            azimuth_limits_deg: None,
            elevation_limits_deg: [-15.0, 85.0],
            max_rate_degps: 60.0,
            max_acceleration_degps2: 180.0,
            mirror_range_mrad: 5.0,
            mirror_bandwidth_hz: 500.0,
            base_motion: BaseMotion::Preset(BasePreset::Roof),
            friction: true,
            structural_mode_hz: 40.0,
            backlash_urad: 0.0,
            encoder_bits: 24,
            wind_load: true,
            boresight_sigma_urad: 150.0,
        }
    }
}

/// Angular motion of what the mount stands on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "expected \"quiet\", \"roof\", \"mast\", { rms_urad = ..., frequency_hz = ... } or { psd = [[frequency, density], ...] }"
)]
pub enum BaseMotion {
    /// A named base.
    Preset(BasePreset),
    /// Values of your own.
    Values(BaseValues),
    /// A measured spectrum.
    Spectrum(BaseSpectrum),
}

/// Base motion of a given spectrum.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BaseSpectrum {
    /// One-sided power spectral density of the tilt about each axis: frequencies [Hz], rising, and
    /// densities [rad²/Hz], a power law between them and nothing beyond.
    pub psd: Vec<[f64; 2]>,
}

/// Named bases.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum BasePreset {
    /// An isolated pier: a twentieth of the roof's amplitudes.
    Quiet,
    /// A short mast on a tall office roof in a fresh breeze: sway of 100 µrad rms at 0.3 Hz,
    /// bending of 50 µrad at 12 Hz, broadband vibration of 5 µrad.
    Roof,
    /// A tall mast in the wind: three times the roof's amplitudes.
    Mast,
}

/// Base motion of one lightly damped mode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BaseValues {
    /// Angular root mean square, each axis.
    pub rms_urad: f64,
    /// Natural frequency of the mode; its damping ratio is 0.03.
    pub frequency_hz: f64,
}

impl BaseMotion {
    /// The base motion, to be stepped every `dt_s`; a spectrum's phases come from `rng`.
    pub fn model(&self, dt_s: f64, rng: &mut Stream) -> Result<base_motion::BaseMotion, String> {
        let roof = BaseMotionParams::default();
        let scaled = |mode: TiltMode, factor: f64| TiltMode {
            rms_rad: mode.rms_rad.map(|rms| factor * rms),
            ..mode
        };
        let factor = match self {
            Self::Preset(BasePreset::Quiet) => 0.05,
            Self::Preset(BasePreset::Roof) => 1.0,
            Self::Preset(BasePreset::Mast) => 3.0,
            Self::Values(_) => 0.0,
            Self::Spectrum(given) => {
                let spectrum = Spectrum::new(&given.psd).map_err(|error| error.to_string())?;
                return Ok(base_motion::BaseMotion::from_spectrum(&spectrum, dt_s, rng));
            }
        };
        let mut params = BaseMotionParams {
            sway: scaled(roof.sway, factor),
            mast: scaled(roof.mast, factor),
            broadband: scaled(roof.broadband, factor),
        };
        if let Self::Values(values) = self {
            params.mast = TiltMode {
                frequency_hz: values.frequency_hz,
                damping: 0.03,
                rms_rad: [1e-6 * values.rms_urad; 3],
            };
        }
        base_motion::BaseMotion::new(&params, dt_s).map_err(|error| error.to_string())
    }
}

/// The three cameras: a preset, and what differs from it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Cameras {
    /// The set of cameras to start from.
    pub preset: CameraPreset,
    /// Changes to the search camera.
    pub search: CameraChanges,
    /// Changes to the coarse tracking camera.
    pub coarse: CameraChanges,
    /// Changes to the precise tracking camera.
    pub precise: CameraChanges,
}

/// Named sets of cameras.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraPreset {
    /// Optics that show a 0.35 m UAV at 1 km 2, 4 and 12.8 px wide: 6°, 3° and 1°.
    #[default]
    #[serde(rename = "urban_1km")]
    Urban1Km,
    /// The paper's printed cameras: 120° (4 mm) and 30° (50 mm); the first one also searches.
    Paper,
}

/// Defines [`Camera`] and its partial twin [`CameraChanges`] from one list of fields.
macro_rules! camera {
    ($($(#[$doc:meta])* $field:ident: $type:ty,)*) => {
        /// One camera with every value settled.
        #[derive(Clone, Debug, PartialEq, Serialize)]
        pub struct Camera {
            $($(#[$doc])* pub $field: $type,)*
        }

        /// Changes to a preset's camera; what is absent stays as the preset has it.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields, default)]
        pub struct CameraChanges {
            $(
                $(#[$doc])*
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $field: Option<$type>,
            )*
        }

        impl CameraChanges {
            fn applied_to(&self, preset: Camera) -> Camera {
                Camera { $($field: self.$field.unwrap_or(preset.$field),)* }
            }
        }
    };
}

camera! {
    /// Full horizontal field of view.
    hfov_deg: f64,
    /// Image width.
    width_px: u32,
    /// Image height.
    height_px: u32,
    /// Frame rate; must divide `tick_hz`.
    rate_hz: u32,
    /// Exposure time, or "auto" for automatic exposure.
    exposure_s: Exposure,
    /// Focal ratio.
    f_number: f64,
    /// Width of a pixel on the sensor; with the field of view it gives the focal length.
    pixel_pitch_um: f64,
    /// Charge that saturates a pixel.
    full_well_e: f64,
    /// Read noise, root mean square.
    read_noise_e: f64,
    /// Standard deviation of the lens blur.
    optics_blur_px: f64,
    /// From the end of the exposure to the image being in memory.
    readout_latency_s: f64,
    /// From the image being in memory to its detections being known.
    inference_latency_s: f64,
    /// Samples per pixel in the renderer: 1 or 4.
    antialias: u32,
    /// Which part of the sensor is read.
    readout: Readout,
    /// Side of the square window that a windowed readout takes.
    window_px: u32,
}

/// Exposure control.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a time in seconds or \"auto\"")]
pub enum Exposure {
    /// A fixed time [s].
    Seconds(f64),
    /// Follows the scene.
    Auto(AutoWord),
}

/// The word "auto".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AutoWord {
    /// Automatic.
    Auto,
}

/// What a camera reads out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Readout {
    /// The whole sensor.
    Full,
    /// A square around the predicted target.
    Window,
}

impl Camera {
    /// Focal length [m] that the field of view and the pixel pitch imply.
    pub fn focal_length_m(&self) -> f64 {
        let half_width_m = 0.5 * f64::from(self.width_px) * self.pixel_pitch_um * 1e-6;
        half_width_m / (0.5 * self.hfov_deg.to_radians()).tan()
    }
}

impl Cameras {
    /// The search, coarse and precise cameras, in this order, after the changes.
    pub fn resolved(&self) -> [Camera; 3] {
        let [search, coarse, precise] = self.preset.cameras();
        [
            self.search.applied_to(search),
            self.coarse.applied_to(coarse),
            self.precise.applied_to(precise),
        ]
    }
}

impl CameraPreset {
    fn cameras(self) -> [Camera; 3] {
        // A 1/1.8-inch global-shutter sensor binned to 640 × 480.
        let base = Camera {
            hfov_deg: 1.0,
            width_px: 640,
            height_px: 480,
            rate_hz: 120,
            exposure_s: Exposure::Auto(AutoWord::Auto),
            f_number: 5.6,
            pixel_pitch_um: 6.9,
            full_well_e: 20_000.0,
            read_noise_e: 4.0,
            optics_blur_px: 0.6,
            readout_latency_s: 0.002,
            inference_latency_s: 0.003,
            antialias: 4,
            readout: Readout::Full,
            window_px: 256,
        };
        match self {
            Self::Urban1Km => [
                Camera {
                    hfov_deg: 6.0,
                    rate_hz: 30,
                    f_number: 2.8,
                    ..base.clone()
                },
                Camera {
                    hfov_deg: 3.0,
                    rate_hz: 60,
                    f_number: 4.0,
                    readout: Readout::Window,
                    ..base.clone()
                },
                Camera {
                    readout: Readout::Window,
                    ..base
                },
            ],
            Self::Paper => {
                // Pitches that make the printed focal lengths and fields of view agree:
                // 2·f·tan(hfov/2)/640 with 4 mm and 120°, 50 mm and 30°.
                let coarse = Camera {
                    hfov_deg: 120.0,
                    rate_hz: 60,
                    f_number: 2.8,
                    pixel_pitch_um: 21.65,
                    ..base.clone()
                };
                [
                    Camera {
                        rate_hz: 30,
                        ..coarse.clone()
                    },
                    coarse,
                    Camera {
                        hfov_deg: 30.0,
                        pixel_pitch_um: 41.87,
                        ..base
                    },
                ]
            }
        }
    }
}

/// The laser and its beam director.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Laser {
    /// Optical power leaving the aperture.
    pub power_w: f64,
    /// Wavelength.
    pub wavelength_nm: f64,
    /// 1/e² radius of the beam at the exit aperture.
    pub aperture_radius_m: f64,
    /// Beam quality M²; 1 is a perfect beam.
    pub m2: f64,
    /// Focus distance in metres, or "target" to follow the target's range.
    pub focus: Focus,
    /// Pointing jitter of the beam director, root mean square per axis.
    pub jitter_urad: f64,
}

impl Default for Laser {
    fn default() -> Self {
        Self {
            power_w: 3000.0,
            wavelength_nm: 1064.0,
            aperture_radius_m: 0.05,
            m2: 1.3,
            focus: Focus::Target(TargetWord::Target),
            jitter_urad: 2.0,
        }
    }
}

/// Focus control.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a distance in metres or \"target\"")]
pub enum Focus {
    /// A fixed distance [m].
    Metres(f64),
    /// Follows the target's range.
    Target(TargetWord),
}

/// The word "target".
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TargetWord {
    /// The target's range.
    Target,
}

/// The sector the station searches.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SearchSector {
    /// Azimuth of the middle, clockwise from north.
    pub centre_azimuth_deg: f64,
    /// Full width in azimuth.
    #[serde(default = "default_sector_width")]
    pub width_deg: f64,
    /// Elevation of the middle.
    #[serde(default = "default_sector_elevation")]
    pub elevation_deg: f64,
    /// Full height in elevation.
    #[serde(default = "default_sector_height")]
    pub height_deg: f64,
    /// How the sector is covered.
    #[serde(default)]
    pub pattern: SearchPattern,
    /// A radar that tracks a UAV; absent: search unaided.
    pub cue: Option<Cue>,
}

fn default_sector_width() -> f64 {
    60.0
}

fn default_sector_elevation() -> f64 {
    6.0
}

fn default_sector_height() -> f64 {
    12.0
}

/// The cue of an external radar at the station: a track of one UAV made of noisy plots. The search
/// covers two deviations of the track to either side of where it says the UAV is now.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Cue {
    /// Standard deviation of a plot's direction, each axis.
    pub sigma_deg: f64,
    /// Standard deviation of a plot's slant range.
    #[serde(default = "default_cue_range_sigma")]
    pub range_sigma_m: f64,
    /// Plots a second; the first is there at the start.
    #[serde(default = "default_cue_rate")]
    pub rate_hz: f64,
    /// From a measurement to its plot at the station.
    #[serde(default = "default_cue_latency")]
    pub latency_s: f64,
    /// Name of the UAV that is tracked; absent: the first that is still in the air.
    pub target: Option<String>,
}

fn default_cue_range_sigma() -> f64 {
    15.0 // [m]
}

fn default_cue_rate() -> f64 {
    1.0 // [Hz]
}

fn default_cue_latency() -> f64 {
    0.3 // [s]
}

/// One UAV.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Uav {
    /// Name, unique in the scenario.
    pub name: String,
    /// Its entry in the catalogue.
    pub model: UavKind,
    /// Where it flies.
    pub trajectory: Trajectory,
    /// Material of the part the laser heats; absent: the catalogue's.
    pub skin: Option<Skin>,
    /// Standard deviation of a displacement of the whole trajectory, drawn from the seed: east and
    /// north, up [m].
    #[serde(default)]
    pub spread_m: [f64; 2],
    /// The trajectory is begun up to this much earlier, drawn from the seed.
    #[serde(default)]
    pub spread_s: f64,
}

/// A bird, balloon, aeroplane or leaf: every camera sees it, no success counts it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Distractor {
    /// Name, unique among UAVs and distractors.
    pub name: String,
    /// What it is.
    pub kind: DistractorKind,
    /// Where it flies; a balloon's or leaf's is relative to the air, so that one that hovers drifts
    /// with the wind.
    pub trajectory: Trajectory,
    /// Standard deviation of a displacement of the whole trajectory, drawn from the seed: east and
    /// north, up [m].
    #[serde(default)]
    pub spread_m: [f64; 2],
    /// The trajectory is begun up to this much earlier, drawn from the seed.
    #[serde(default)]
    pub spread_s: f64,
}

/// Material of the part the laser heats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Skin {
    /// Dark polycarbonate shell.
    PolycarbonateShell,
    /// ABS shell.
    AbsShell,
    /// Carbon-fibre epoxy.
    CarbonFibre,
    /// Pouch of a lithium-polymer battery.
    LipoPouch,
    /// Aluminium.
    Aluminium,
}

impl Skin {
    /// Its thermal and optical constants.
    pub fn material(self) -> SkinMaterial {
        match self {
            Self::PolycarbonateShell => thermal::POLYCARBONATE_SHELL,
            Self::AbsShell => thermal::ABS_SHELL,
            Self::CarbonFibre => thermal::CARBON_EPOXY,
            Self::LipoPouch => thermal::LIPO_POUCH,
            Self::Aluminium => thermal::ALUMINIUM,
        }
    }
}

/// What finds UAVs in the images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Detector {
    /// A neural network on the rendered images, or the truth with errors added.
    pub kind: DetectorKind,
    /// The ONNX file, relative to the working directory.
    pub onnx_model: PathBuf,
    /// What runs the network; the loaded ONNX Runtime must have it.
    pub provider: Provider,
    /// Detections with a lower score are dropped, 0 to 1; absent: the score that the model recommends.
    pub score_threshold: Option<f64>,
    /// Side of the square around the predicted target in which the network looks while a camera
    /// follows it; 0: in all that the camera reads out.
    pub roi_px: u32,
    /// Errors of the truth detector.
    pub truth: TruthErrors,
}

impl Default for Detector {
    fn default() -> Self {
        Self {
            kind: DetectorKind::Onnx,
            onnx_model: PathBuf::from("assets/models/boresight-p2-roi.onnx"),
            provider: Provider::Cpu,
            score_threshold: None,
            roi_px: 256,
            truth: TruthErrors::default(),
        }
    }
}

/// Kind of detector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DetectorKind {
    /// A neural network in ONNX form.
    Onnx,
    /// True positions with noise, misses and false alarms; needs no images.
    Truth,
}

/// Execution provider of ONNX Runtime.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Provider {
    /// The processor; the only one whose results are the same on every machine.
    Cpu,
    /// An NVIDIA GPU through CUDA.
    Cuda,
    /// An NVIDIA GPU through TensorRT, with CUDA for what that does not take.
    Tensorrt,
}

impl Provider {
    /// Its name in ONNX Runtime.
    pub fn runtime_name(self) -> &'static str {
        match self {
            Self::Cpu => "CPU",
            Self::Cuda => "CUDA",
            Self::Tensorrt => "TensorRT",
        }
    }
}

impl std::fmt::Display for Provider {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.runtime_name())
    }
}

/// Errors of the truth detector.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TruthErrors {
    /// Standard deviation of the box centre, each axis.
    pub noise_px: f64,
    /// Chance that a visible UAV is missed in a frame, 0 to 1.
    pub miss_rate: f64,
    /// Chance that a visible distractor is reported as a UAV in a frame, 0 to 1.
    pub distractor_rate: f64,
    /// Mean number of false alarms in a frame.
    pub false_alarms_per_frame: f64,
}

impl Default for TruthErrors {
    fn default() -> Self {
        Self {
            noise_px: 0.5,
            miss_rate: 0.02,
            distractor_rate: 0.3,
            false_alarms_per_frame: 0.01,
        }
    }
}

/// How detections become tracks and which of them becomes the target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Tracker {
    /// Which detection belongs to the target; absent: "paper" with the paper's controller,
    /// "global" with any other.
    pub rule: Option<AssociationRule>,
    /// Standard deviation of a detection's centre that the tracker counts on; absent: the truth
    /// detector's noise, or 0.5 for an ONNX model.
    pub centre_sigma_px: Option<f64>,
    /// Least share of its frames in which the detector must see a track for it to be a UAV.
    pub min_quality: f64,
    /// Least mean score of a track's detections for it to be a UAV; absent: 0.72 for the truth
    /// detector, half way between its scores of UAVs and of distractors, and 0 for an ONNX model.
    pub min_score: Option<f64>,
    /// Another track becomes the target when it could reach the asset sooner by this factor.
    pub switch_ratio: f64,
    /// The protected asset, east, north, up from the site; absent: the station itself.
    pub asset_enu_m: Option<[f64; 3]>,
}

impl Default for Tracker {
    fn default() -> Self {
        Self {
            rule: None,
            centre_sigma_px: None,
            min_quality: 0.6,
            min_score: None,
            switch_ratio: 1.5,
            asset_enu_m: None,
        }
    }
}

/// Rules by which detections belong to the target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AssociationRule {
    /// The detection nearest to the image centre is the target, as in the paper.
    Paper,
    /// All detections are assigned to all tracks at the least total cost.
    Global,
}

/// What an operator orders.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Order {
    /// When.
    pub t_s: f64,
    /// Name of the UAV whose picture the operator points at: its track becomes the target and
    /// stays it. Absent: the choice goes back to the tracker.
    pub designate: Option<String>,
}

/// The tracking loops: a preset, and what differs from it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Controller {
    /// The set of loops to start from.
    pub preset: ControllerPreset,
    /// Gains of the coarse loop; absent: the preset's.
    pub coarse: Option<Gains>,
    /// Gains of the precise loop; absent: the preset's.
    pub precise: Option<Gains>,
}

/// Named sets of tracking loops.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ControllerPreset {
    /// The paper's equations 8 to 10 with its printed gains and its linear pixel-to-angle map.
    Paper,
    /// Exact pixel-to-angle map, prediction over the latency, gains tuned for this mount.
    #[default]
    Tuned,
    /// As tuned, with one optimal regulator for gimbal and mirror.
    Lqg,
}

/// Gains of one proportional-integral-derivative loop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gains {
    /// Proportional gain.
    pub kp: f64,
    /// Integral gain, per second.
    pub ki_per_s: f64,
    /// Derivative gain, in seconds.
    pub kd_s: f64,
}

/// When the laser may fire.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Engage {
    /// False: track only, the laser never fires.
    pub authorised: bool,
    /// The part of a UAV that the laser is aimed at.
    pub aim: AimPart,
    /// Regions that the beam never enters.
    pub keep_out: Vec<KeepOut>,
    /// The laser does not fire this close to the sun: it would dazzle the precise camera.
    pub sun_exclusion_deg: f64,
    /// How far ahead the line of sight is checked for obstacles and keep-out zones: the laser is
    /// off before it gets there.
    pub look_ahead_s: f64,
    /// What may lie behind the target on the beam's line: any of "sky", "ground", "building".
    pub allow_backstop: Vec<Backstop>,
    /// An allowed building or ground must lie at least this far behind the target.
    pub min_clear_range_m: f64,
    /// The precise track's error must stay below this to count as locked.
    pub lock_radius_px: f64,
    /// How long the lock must hold before the laser fires.
    pub lock_dwell_s: f64,
    /// The laser stops when the precise track's error exceeds this.
    pub break_radius_px: f64,
    /// Longest single burst.
    pub max_burst_s: f64,
}

impl Default for Engage {
    fn default() -> Self {
        Self {
            authorised: true,
            aim: AimPart::default(),
            keep_out: Vec::new(),
            sun_exclusion_deg: 5.0,
            look_ahead_s: 0.3,
            allow_backstop: vec![Backstop::Sky],
            min_clear_range_m: 500.0,
            lock_radius_px: 3.0,
            lock_dwell_s: 0.25,
            break_radius_px: 8.0,
            max_burst_s: 15.0,
        }
    }
}

/// A region that the beam never enters: a block of directions (`azimuth_deg`, `elevation_deg`), or
/// everything near a straight route (`from_enu_m`, `to_enu_m`, `radius_m`), such as an aircraft
/// corridor, which the beam must not meet behind the target either.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct KeepOut {
    /// What is protected.
    pub name: String,
    /// Block: azimuths [from, to] clockwise from north; from > to passes through north.
    pub azimuth_deg: Option<[f64; 2]>,
    /// Block: elevations [from, to].
    pub elevation_deg: Option<[f64; 2]>,
    /// Route: east, north, up of one end.
    pub from_enu_m: Option<[f64; 3]>,
    /// Route: east, north, up of the other end.
    pub to_enu_m: Option<[f64; 3]>,
    /// Route: protected distance around it.
    pub radius_m: Option<f64>,
}

impl KeepOut {
    /// The region; none unless the fields of exactly one form are given.
    pub fn zone(&self) -> Option<Zone> {
        let block = (self.azimuth_deg, self.elevation_deg);
        let route = (self.from_enu_m, self.to_enu_m, self.radius_m);
        match (block, route) {
            ((Some(azimuth_deg), Some(elevation_deg)), (None, None, None)) => Some(Zone::Sector {
                azimuth_rad: azimuth_deg.map(f64::to_radians),
                elevation_rad: elevation_deg.map(f64::to_radians),
            }),
            ((None, None), (Some(from), Some(to), Some(radius_m))) => Some(Zone::Route {
                from_enu_m: from.into(),
                to_enu_m: to.into(),
                radius_m,
            }),
            _ => None,
        }
    }
}

/// What the beam would meet beyond the target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Backstop {
    /// Nothing.
    Sky,
    /// Terrain or street.
    Ground,
    /// A building, or a tree: what stands more than 2 m above the ground.
    Building,
}

/// What a run writes down.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Record {
    /// Rate of the recorded states; must divide `tick_hz`.
    pub state_hz: u32,
    /// Which frames are kept: "all", "none" or { every = n }.
    pub images: Images,
    /// JPEG quality of the kept frames, 1 to 100.
    pub jpeg_quality: u8,
}

impl Default for Record {
    fn default() -> Self {
        Self {
            state_hz: 120,
            images: Images::All,
            jpeg_quality: 90,
        }
    }
}

/// Which camera frames are recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Images {
    /// Every frame.
    All,
    /// No frame.
    None,
    /// One frame in so many, of each camera.
    Every(u32),
}

/// Accepts TOML's own date-time and RFC 3339 text.
fn date_time<'de, D: serde::Deserializer<'de>>(deserializer: D) -> Result<DateTime<Utc>, D::Error> {
    use serde::de::{Error, MapAccess, Visitor, value::MapAccessDeserializer};

    struct TimeVisitor;
    impl<'de> Visitor<'de> for TimeVisitor {
        type Value = DateTime<Utc>;

        fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
            formatter.write_str("a time with its zone such as 2025-06-21T10:00:00Z")
        }

        fn visit_str<E: Error>(self, text: &str) -> Result<Self::Value, E> {
            DateTime::parse_from_rfc3339(text)
                .map(|time| time.with_timezone(&Utc))
                .map_err(|_| E::invalid_value(serde::de::Unexpected::Str(text), &self))
        }

        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
            let time = toml::value::Datetime::deserialize(MapAccessDeserializer::new(map))?;
            self.visit_str(&time.to_string())
        }
    }
    deserializer.deserialize_any(TimeVisitor)
}

/// A scenario together with the text it came from.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// The checked scenario, overrides applied.
    pub scenario: Scenario,
    /// The file's text, as read.
    pub source: String,
    /// The overrides, as given.
    pub overrides: Vec<String>,
    /// The file's path, as given.
    pub path: PathBuf,
}

impl Loaded {
    /// The error for the value at `path`, such as `station.mount`, that a part of the run refuses.
    pub fn refuse(&self, path: &str, message: impl fmt::Display) -> ScenarioError {
        ScenarioError::Field {
            place: Place {
                file: self.path.display().to_string(),
                line: None,
                set: None,
            },
            path: path.to_owned(),
            message: message.to_string(),
        }
    }
}

/// Where a value stands: a line of the scenario file, or an override.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// The scenario file.
    pub file: String,
    /// Line, from 1; none for an override.
    pub line: Option<usize>,
    /// The override `key=value`.
    pub set: Option<String>,
}

impl fmt::Display for Place {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str(&self.file)?;
        if let Some(line) = self.line {
            write!(formatter, ":{line}")?;
        }
        if let Some(set) = &self.set {
            write!(formatter, ": --set {set}")?;
        }
        Ok(())
    }
}

/// Why a scenario cannot be used; prints as one line.
#[derive(Debug, Error)]
pub enum ScenarioError {
    /// The file cannot be read.
    #[error("{file}: cannot be read: {source}")]
    Read {
        /// The scenario file.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is not TOML.
    #[error("{place}: not TOML: {message}")]
    Syntax {
        /// Where the text stops being TOML.
        place: Place,
        /// What was found and expected.
        message: String,
    },
    /// An override cannot be applied.
    #[error("{place}: {message}")]
    Override {
        /// The override.
        place: Place,
        /// What is wrong with it.
        message: String,
    },
    /// A value is unknown, absent, of the wrong type or out of range.
    #[error("{place}: {path}: {message}")]
    Field {
        /// Where the value, or the table that lacks it, stands.
        place: Place,
        /// Dotted path of the value such as `uavs[0].model`.
        path: String,
        /// What was found and what would be right.
        message: String,
    },
}

impl Scenario {
    /// Reads, parses and checks a scenario file; `overrides` are `key=value` texts as for
    /// [`Scenario::parse`].
    pub fn load(path: &Path, overrides: &[String]) -> Result<Loaded, ScenarioError> {
        let file = path.display().to_string();
        match std::fs::read_to_string(path) {
            Ok(source) => Ok(Loaded {
                scenario: Self::parse(&source, &file, overrides)?,
                overrides: overrides.to_vec(),
                source,
                path: path.to_owned(),
            }),
            Err(source) => Err(ScenarioError::Read { file, source }),
        }
    }

    /// Parses and checks a scenario; `file_name` appears in errors.
    ///
    /// An override `uavs.0.model=fpv5` replaces one value, or adds it with the tables around it.
    /// Its right side is TOML, or a string where it is not.
    pub fn parse(text: &str, file_name: &str, overrides: &[String]) -> Result<Self, ScenarioError> {
        let mut sources = Sources {
            file: file_name,
            text,
            overrides: Vec::new(),
        };
        let mut end = text.len();
        let mut documents = Vec::new();
        for set in overrides {
            sources.overrides.push((end + 1, set.as_str()));
            // Leading blanks make the parser's spans virtual offsets.
            let value = set.split_once('=').map_or("", |(_, value)| value);
            documents.push(format!("{:1$}v={value}", "", end + 1));
            end += 1 + set.len();
        }

        let root = DeTable::parse(text).map_err(|error| ScenarioError::Syntax {
            place: sources.place(error.span().map_or(0, |span| span.start)),
            message: one_line(error.message()),
        })?;
        let mut root = Spanned::new(0..0, DeValue::Table(root.into_inner()));
        for (set, document) in sources.overrides.iter().zip(&documents) {
            sources.apply(&mut root, *set, document)?;
        }

        let mut nodes = Nodes(Vec::new());
        let root = nodes.number(root, String::new());
        if let Some(node) = nodes.0.iter().find(|node| node.not_finite) {
            return Err(sources.field(node.at, &node.path, "must be a finite number".to_owned()));
        }
        let scenario = Self::deserialize(toml::de::ValueDeserializer::from(root))
            .map_err(|error| nodes.explain(&sources, &error))?;
        match scenario.problem() {
            Some(Problem {
                path,
                with,
                message,
            }) => {
                // A preset's value does not stand in the file; what it clashes with may.
                let at = (nodes.find(&path).or_else(|| nodes.find(with)))
                    .unwrap_or_else(|| nodes.nearest(&path));
                Err(sources.field(at, &path, message))
            }
            None => Ok(scenario),
        }
    }
}

/// The scenario text followed by the overrides, as one virtual text that offsets point into.
struct Sources<'a> {
    file: &'a str,
    text: &'a str,
    /// Virtual offset of each override's start, and the override.
    overrides: Vec<(usize, &'a str)>,
}

impl Sources<'_> {
    fn place(&self, offset: usize) -> Place {
        let set = (self.overrides.iter().rev())
            .find(|(start, _)| *start <= offset)
            .map(|(_, set)| one_line(set));
        let before = self.text.as_bytes().iter().take(offset);
        Place {
            file: self.file.to_owned(),
            line: (set.is_none()).then(|| 1 + before.filter(|byte| **byte == b'\n').count()),
            set,
        }
    }

    fn field(&self, offset: usize, path: &str, message: String) -> ScenarioError {
        ScenarioError::Field {
            place: self.place(offset),
            path: path.to_owned(),
            message,
        }
    }

    /// Puts one override, whose right side also stands in `document`, into the tree.
    fn apply<'i>(
        &self,
        root: &mut Spanned<DeValue<'i>>,
        (start, set): (usize, &str),
        document: &'i str,
    ) -> Result<(), ScenarioError> {
        let fail = |message: String| ScenarioError::Override {
            place: self.place(start),
            message,
        };
        let Some((path, text)) = set.split_once('=') else {
            return Err(fail("expected key=value".to_owned()));
        };
        let mut slot = root;
        let mut walked = String::new();
        for key in path.split('.').map(str::trim) {
            slot =
                entry(slot.get_mut(), key, start).map_err(|why| fail(format!("{walked} {why}")))?;
            join(&mut walked, key);
        }
        // One key more in the document would be an injected line.
        let value = (DeTable::parse(document).ok())
            .map(Spanned::into_inner)
            .filter(|table| table.len() == 1)
            .and_then(|mut table| table.remove("v"));
        *slot = value.unwrap_or_else(|| {
            Spanned::new(start..start, DeValue::String(text.trim().to_owned().into()))
        });
        Ok(())
    }
}

/// The value under `key` of a table, added as an empty table where it is not there (a later check
/// finds names that are unknown), or the item of an array; else why there is none.
fn entry<'t, 'i>(
    value: &'t mut DeValue<'i>,
    key: &str,
    at: usize,
) -> Result<&'t mut Spanned<DeValue<'i>>, String> {
    match value {
        DeValue::Table(table) => Ok(table
            .entry(Spanned::new(at..at, key.to_owned().into()))
            .or_insert_with(|| Spanned::new(at..at, DeValue::Table(DeTable::new())))),
        DeValue::Array(array) => {
            let len = array.len();
            (key.parse::<usize>().ok())
                .and_then(|index| array.get_mut(index))
                .ok_or_else(|| format!("has {len} entries, numbered from 0: no entry '{key}'"))
        }
        other => Err(format!("is of type {}, it has no keys", other.type_str())),
    }
}

/// One key or value of the tree.
struct Node {
    path: String,
    /// Virtual offset in [`Sources`].
    at: usize,
    not_finite: bool,
}

/// Every key and value of the tree; a numbered tree's spans are indices into this list.
struct Nodes(Vec<Node>);

impl Nodes {
    fn push(&mut self, path: &str, at: usize, not_finite: bool) -> std::ops::Range<usize> {
        let path = path.to_owned();
        self.0.push(Node {
            path,
            at,
            not_finite,
        });
        self.0.len() - 1..self.0.len()
    }

    fn number<'i>(&mut self, value: Spanned<DeValue<'i>>, path: String) -> Spanned<DeValue<'i>> {
        let at = value.span().start;
        let value = value.into_inner();
        let not_finite = value.as_float().is_some_and(|float| {
            let number = float.as_str().parse::<f64>();
            !number.is_ok_and(f64::is_finite)
        });
        let id = self.push(&path, at, not_finite);
        let value = match value {
            DeValue::Table(table) => DeValue::Table(
                table
                    .into_iter()
                    .map(|(key, value)| {
                        let mut child = path.clone();
                        join(&mut child, key.get_ref());
                        let key_id = self.push(&child, key.span().start, false);
                        let key = Spanned::new(key_id, key.into_inner());
                        (key, self.number(value, child))
                    })
                    .collect(),
            ),
            DeValue::Array(array) => DeValue::Array(
                array
                    .into_iter()
                    .enumerate()
                    .map(|(index, item)| self.number(item, format!("{path}[{index}]")))
                    .collect(),
            ),
            other => other,
        };
        Spanned::new(id, value)
    }

    /// Virtual offset of the value at `path`.
    fn find(&self, path: &str) -> Option<usize> {
        // A value stands after its key; an override may have replaced it alone.
        let node = self.0.iter().rev().find(|node| node.path == path)?;
        Some(node.at)
    }

    /// Virtual offset of the value at `path`, or of the innermost table around it that is there.
    fn nearest(&self, path: &str) -> usize {
        let mut path = path;
        loop {
            if let Some(at) = self.find(path) {
                return at;
            }
            match path.rfind(['.', '[']) {
                Some(end) => path = &path[..end],
                None => return 0,
            }
        }
    }

    /// Turns serde's words about a numbered tree into ours.
    fn explain(&self, sources: &Sources, error: &toml::de::Error) -> ScenarioError {
        let id = error.span().map_or(0, |span| span.start);
        let (mut path, at) =
            (self.0.get(id)).map_or((String::new(), 0), |node| (node.path.clone(), node.at));
        let message = one_line(error.message());
        // serde puts names between back quotes: first what it found, then what it knows.
        let mut names = message.split('`').skip(1).step_by(2);
        let found = names.next().unwrap_or_default().to_owned();
        let known: Vec<&str> = names.collect();
        let last_key = path.rsplit('.').next().unwrap_or_default();
        let last_key = last_key.split('[').next().unwrap_or_default().to_owned();
        let message = if message.starts_with("missing field") {
            join(&mut path, &found);
            format!("is missing: add '{found} = ...' to this table")
        } else if message.starts_with("unknown field") {
            if last_key != found {
                join(&mut path, &found);
            }
            format!("unknown key{}", suggestion(&found, &known))
        } else if message.starts_with("unknown variant") {
            format!("unknown {last_key} '{found}'{}", suggestion(&found, &known))
        } else {
            let words = (message.replace("f64", "a number"))
                .replace("floating point ", "")
                .replace("invalid type: map", "invalid type: table")
                .replace("expected u32", "expected a whole number, not negative")
                .replace("expected u64", "expected a whole number, not negative")
                .replace("expected u8", "expected a whole number from 0 to 255");
            match words.split_once("expected struct ") {
                Some((found, _)) => format!("{found}expected a table"),
                None => words,
            }
        };
        sources.field(at, &path, message)
    }
}

/// "did you mean" and the known names.
fn suggestion(found: &str, known: &[&str]) -> String {
    let mut text = String::new();
    let nearest = known.iter().min_by_key(|name| edit_distance(found, name));
    if let Some(name) = nearest.filter(|name| edit_distance(found, name) <= name.len() / 2) {
        let _ = write!(text, " - did you mean '{name}'?");
    } else {
        text.push_str(" -");
    }
    let _ = write!(text, " expected one of {}", known.join(", "));
    text
}

/// Levenshtein distance in characters.
fn edit_distance(a: &str, b: &str) -> usize {
    let mut row: Vec<usize> = (0..=b.chars().count()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = i;
        row[0] = i + 1;
        for (j, to) in b.chars().enumerate() {
            let substituted = diagonal + usize::from(from != to);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.chars().count()]
}

/// Appends a key to a dotted path.
fn join(path: &mut String, key: &str) {
    if !path.is_empty() {
        path.push('.');
    }
    path.push_str(&one_line(key));
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Something wrong with a scenario.
struct Problem {
    path: String,
    /// Path of the value that it clashes with, or empty.
    with: &'static str,
    message: String,
}

/// Keeps the first problem of a scenario.
struct Check(Option<Problem>);

impl Check {
    fn that(&mut self, ok: bool, path: &str, message: impl FnOnce() -> String) {
        if !ok && self.0.is_none() {
            self.0 = Some(Problem {
                path: path.to_owned(),
                with: "",
                message: message(),
            });
        }
    }

    fn within(&mut self, path: &str, value: f64, range: RangeInclusive<f64>) {
        self.that(range.contains(&value), path, || {
            let (low, high) = (range.start(), range.end());
            match *high {
                f64::MAX => format!("found {value}, must be at least {low}"),
                _ => format!("found {value}, must be from {low} to {high}"),
            }
        });
    }

    fn maybe_within(&mut self, path: &str, value: Option<f64>, range: RangeInclusive<f64>) {
        if let Some(value) = value {
            self.within(path, value, range);
        }
    }

    fn positive(&mut self, path: &str, value: f64) {
        self.that(value > 0.0, path, || {
            format!("found {value}, must be above 0")
        });
    }

    fn ascending(&mut self, path: &str, [from, to]: [f64; 2], range: RangeInclusive<f64>) {
        self.within(&format!("{path}[0]"), from, range.clone());
        self.within(&format!("{path}[1]"), to, range);
        self.that(from < to, path, || {
            format!("found [{from}, {to}], the first must be below the second")
        });
    }

    fn name(&mut self, path: &str, name: &str, earlier: &[&str]) {
        self.that(!name.trim().is_empty(), path, || {
            "must not be empty".to_owned()
        });
        self.that(!earlier.contains(&name), path, || {
            format!("the name '{name}' is taken by an earlier one - give each its own")
        });
    }

    /// A rate must divide the tick rate.
    fn rate(&mut self, path: &str, rate_hz: u32, tick_hz: u32) {
        let divides = |rate: u32| rate > 0 && tick_hz.is_multiple_of(rate);
        if divides(rate_hz) || self.0.is_some() {
            return;
        }
        let nearest = (1..=tick_hz)
            .filter(|rate| divides(*rate))
            .min_by_key(|rate| rate.abs_diff(rate_hz))
            .unwrap_or(1);
        self.0 = Some(Problem {
            path: path.to_owned(),
            with: "tick_hz",
            message: format!(
                "{rate_hz} Hz does not divide tick_hz = {tick_hz} - the nearest rate that does is \
                 {nearest} Hz"
            ),
        });
    }
}

const AT_LEAST_ZERO: RangeInclusive<f64> = 0.0..=f64::MAX;
const FRACTION: RangeInclusive<f64> = 0.0..=1.0;
const TURN: RangeInclusive<f64> = -360.0..=360.0; // [deg]
const ELEVATION: RangeInclusive<f64> = -90.0..=90.0; // [deg]

impl Scenario {
    /// The first value that is out of range, or that another value contradicts.
    fn problem(&self) -> Option<Problem> {
        let mut check = Check(None);
        check.name("name", &self.name, &[]);
        check.positive("duration_s", self.duration_s);
        check.within("duration_s", self.duration_s, 0.0..=86_400.0);
        check.within("tick_hz", self.tick_hz.into(), 1.0..=100_000.0);
        check.within("site.latitude_deg", self.site.latitude_deg, ELEVATION);
        check.within(
            "site.longitude_deg",
            self.site.longitude_deg,
            -180.0..=180.0,
        );
        check.within("site.altitude_m", self.site.altitude_m, -500.0..=9000.0);
        self.weather.check(&mut check);
        check.within(
            "turbulence.cn2_ground",
            self.turbulence.cn2_ground,
            0.0..=1e-10,
        );
        check_city(&self.city, &mut check);
        self.station.check(&mut check, self.tick_hz);
        self.search.check(&mut check, &self.uavs);
        let mut names = Vec::new();
        let uavs = self.uavs.iter().enumerate().map(|(index, uav)| {
            let flight = (&uav.trajectory, uav.spread_m, uav.spread_s);
            (format!("uavs[{index}]"), &uav.name, flight)
        });
        let distractors = self.distractors.iter().enumerate().map(|(index, other)| {
            let flight = (&other.trajectory, other.spread_m, other.spread_s);
            (format!("distractors[{index}]"), &other.name, flight)
        });
        for (at, name, (trajectory, [across_m, up_m], spread_s)) in uavs.chain(distractors) {
            check.name(&format!("{at}.name"), name, &names);
            names.push(name);
            // A recorded flight's file is read, and checked, when the run starts.
            if !matches!(trajectory, Trajectory::Recorded { .. })
                && let Err(error) = trajectory.compile(|_| Ok(String::new()))
            {
                check.that(false, &format!("{at}.trajectory"), || error.to_string());
            }
            check.within(&format!("{at}.spread_m[0]"), across_m, AT_LEAST_ZERO);
            check.within(&format!("{at}.spread_m[1]"), up_m, AT_LEAST_ZERO);
            check.within(&format!("{at}.spread_s"), spread_s, AT_LEAST_ZERO);
        }
        self.detector.check(&mut check);
        self.tracker.check(&mut check);
        for (index, order) in self.operator.iter().enumerate() {
            let path = format!("operator[{index}]");
            let earliest = index.checked_sub(1).map_or(0.0, |i| self.operator[i].t_s);
            check.within(&format!("{path}.t_s"), order.t_s, earliest..=86_400.0);
            if let Some(name) = &order.designate {
                check.that(
                    self.uavs.iter().any(|uav| uav.name == *name),
                    &format!("{path}.designate"),
                    || format!("no UAV of the scenario is named '{name}'"),
                );
            }
        }
        self.controller.check(&mut check);
        self.engage.check(&mut check);
        check.rate("record.state_hz", self.record.state_hz, self.tick_hz);
        if let Images::Every(frames) = self.record.images {
            check.within("record.images.every", frames.into(), 1.0..=f64::MAX);
        }
        check.within(
            "record.jpeg_quality",
            self.record.jpeg_quality.into(),
            1.0..=100.0,
        );
        check.0
    }
}

/// The ranges that the city's generator accepts.
fn check_city(city: &CityParams, check: &mut Check) {
    check.within("city.extent_m", city.extent_m, 800.0..=6000.0);
    check.within("city.building_density", city.building_density, FRACTION);
    check.within("city.max_height_m", city.max_height_m, 20.0..=400.0);
    check.within("city.relief_m", city.relief_m, 0.0..=60.0);
    check.within("city.park_share", city.park_share, 0.0..=0.3);
    check.within("city.station_height_m", city.station_height_m, 30.0..=120.0);
    check.within("city.forest_share", city.forest_share, FRACTION);
}

impl Weather {
    fn check(&self, check: &mut Check) {
        let mut within = |key: &str, value, range| {
            check.maybe_within(&format!("weather.{key}"), value, range);
        };
        within("wind_speed_mps", self.wind_speed_mps, 0.0..=60.0);
        within("wind_from_deg", self.wind_from_deg, 0.0..=360.0);
        within("gust_mps", self.gust_mps, 0.0..=90.0);
        within("visibility_m", self.visibility_m, 10.0..=400_000.0);
        within("temperature_c", self.temperature_c, -90.0..=60.0);
        within("relative_humidity", self.relative_humidity, FRACTION);
        within("pressure_hpa", self.pressure_hpa, 850.0..=1100.0);
        within("cloud_cover", self.cloud_cover, FRACTION);
        within("cloud_base_m", self.cloud_base_m, 0.0..=20_000.0);
        within("precipitation_mmph", self.precipitation_mmph, 0.0..=500.0);
        match self.resolved() {
            Ok(weather) => {
                let (wind, gust) = (weather.wind_speed_mps, weather.gust_mps);
                check.that(
                    gust.is_none_or(|gust| gust >= wind),
                    "weather.gust_mps",
                    || format!("is below the mean wind speed of {wind} m/s"),
                );
                check.that(
                    self.cloud_base_m.is_none() || weather.ceiling_m().is_some(),
                    "weather.cloud_base_m",
                    || {
                        format!(
                            "says nothing with a cloud_cover of {}: only a cover of 0.875 or more \
                             hides what is above its base",
                            weather.cloud_cover
                        )
                    },
                );
            }
            Err(error) => check.that(false, "weather.metar", || error.to_string()),
        }
    }
}

impl Station {
    fn check(&self, check: &mut Check, tick_hz: u32) {
        let mount = &self.mount;
        if let Some(limits) = mount.azimuth_limits_deg {
            check.ascending("station.mount.azimuth_limits_deg", limits, TURN);
        }
        let limits = mount.elevation_limits_deg;
        check.ascending("station.mount.elevation_limits_deg", limits, ELEVATION);
        check.positive("station.mount.max_rate_degps", mount.max_rate_degps);
        check.positive(
            "station.mount.max_acceleration_degps2",
            mount.max_acceleration_degps2,
        );
        check.within(
            "station.mount.mirror_range_mrad",
            mount.mirror_range_mrad,
            0.0..=100.0,
        );
        match &mount.base_motion {
            BaseMotion::Preset(_) => {}
            BaseMotion::Values(base) => {
                let path = "station.mount.base_motion";
                check.within(&format!("{path}.rms_urad"), base.rms_urad, 0.0..=1e5);
                check.positive(&format!("{path}.frequency_hz"), base.frequency_hz);
            }
            BaseMotion::Spectrum(base) => {
                let path = "station.mount.base_motion.psd";
                match Spectrum::new(&base.psd) {
                    Ok(_) => {
                        let last_hz = base.psd.iter().fold(0.0, |last, [f, _]| f64::max(last, *f));
                        check.within(path, last_hz, 0.0..=0.5 * f64::from(tick_hz));
                    }
                    Err(error) => check.that(false, path, || error.to_string()),
                }
            }
        }
        check.within(
            "station.mount.mirror_bandwidth_hz",
            mount.mirror_bandwidth_hz,
            10.0..=5_000.0,
        );
        let (mode_hz, path) = (mount.structural_mode_hz, "station.mount.structural_mode_hz");
        if mode_hz != 0.0 {
            check.within(path, mode_hz, 5.0..=200.0);
        }
        let path = "station.mount.backlash_urad";
        check.within(path, mount.backlash_urad, 0.0..=1e5);
        check.that(mount.backlash_urad == 0.0 || mode_hz != 0.0, path, || {
            "needs a spring to act on: set structural_mode_hz above 0".into()
        });
        check.within(
            "station.mount.encoder_bits",
            mount.encoder_bits.into(),
            8.0..=40.0,
        );
        check.within(
            "station.mount.boresight_sigma_urad",
            mount.boresight_sigma_urad,
            0.0..=5_000.0,
        );
        for (name, camera) in ["search", "coarse", "precise"]
            .iter()
            .zip(self.cameras.resolved())
        {
            camera.check(check, &format!("station.cameras.{name}"), tick_hz);
        }
        let laser = &self.laser;
        check.within("station.laser.power_w", laser.power_w, 0.0..=1e6);
        check.within(
            "station.laser.wavelength_nm",
            laser.wavelength_nm,
            200.0..=12_000.0,
        );
        check.positive("station.laser.aperture_radius_m", laser.aperture_radius_m);
        check.within("station.laser.m2", laser.m2, 1.0..=100.0);
        if let Focus::Metres(distance) = laser.focus {
            check.positive("station.laser.focus", distance);
        }
        check.within("station.laser.jitter_urad", laser.jitter_urad, 0.0..=1e4);
    }
}

impl Camera {
    fn check(&self, check: &mut Check, path: &str, tick_hz: u32) {
        let at = |key: &str| format!("{path}.{key}");
        check.rate(&at("rate_hz"), self.rate_hz, tick_hz);
        check.within(&at("hfov_deg"), self.hfov_deg, 0.01..=170.0);
        check.within(&at("width_px"), self.width_px.into(), 16.0..=8192.0);
        check.within(&at("height_px"), self.height_px.into(), 16.0..=8192.0);
        if let Exposure::Seconds(time) = self.exposure_s {
            check.positive(&at("exposure_s"), time);
            check.that(
                time * f64::from(self.rate_hz) <= 1.0,
                &at("exposure_s"),
                || {
                    format!(
                        "{time} s is longer than a frame at rate_hz = {}",
                        self.rate_hz
                    )
                },
            );
        }
        check.within(&at("f_number"), self.f_number, 0.5..=100.0);
        check.within(&at("pixel_pitch_um"), self.pixel_pitch_um, 0.5..=100.0);
        check.positive(&at("full_well_e"), self.full_well_e);
        check.within(&at("read_noise_e"), self.read_noise_e, AT_LEAST_ZERO);
        check.within(&at("optics_blur_px"), self.optics_blur_px, 0.0..=20.0);
        check.within(&at("readout_latency_s"), self.readout_latency_s, FRACTION);
        check.within(
            &at("inference_latency_s"),
            self.inference_latency_s,
            FRACTION,
        );
        check.that([1, 4].contains(&self.antialias), &at("antialias"), || {
            format!("found {}, must be 1 or 4", self.antialias)
        });
        let side = self.width_px.min(self.height_px);
        check.that(
            (16..=side).contains(&self.window_px),
            &at("window_px"),
            || {
                format!(
                    "found {}, must be from 16 to the image's {side}",
                    self.window_px
                )
            },
        );
    }
}

impl SearchSector {
    fn check(&self, check: &mut Check, uavs: &[Uav]) {
        check.within("search.centre_azimuth_deg", self.centre_azimuth_deg, TURN);
        check.positive("search.width_deg", self.width_deg);
        check.within("search.width_deg", self.width_deg, 0.0..=360.0);
        check.within("search.elevation_deg", self.elevation_deg, ELEVATION);
        check.positive("search.height_deg", self.height_deg);
        check.within("search.height_deg", self.height_deg, 0.0..=180.0);
        if let Some(cue) = &self.cue {
            check.within("search.cue.sigma_deg", cue.sigma_deg, 0.0..=90.0);
            check.within(
                "search.cue.range_sigma_m",
                cue.range_sigma_m,
                0.0..=10_000.0,
            );
            check.positive("search.cue.rate_hz", cue.rate_hz);
            check.within("search.cue.latency_s", cue.latency_s, 0.0..=60.0);
            if let Some(target) = &cue.target {
                let known = uavs.iter().any(|uav| uav.name == *target);
                check.that(known, "search.cue.target", || {
                    let names: Vec<&str> = uavs.iter().map(|uav| uav.name.as_str()).collect();
                    format!("no UAV '{target}'{}", suggestion(target, &names))
                });
            }
        }
    }
}

impl Detector {
    fn check(&self, check: &mut Check) {
        check.maybe_within("detector.score_threshold", self.score_threshold, FRACTION);
        let roi_px = self.roi_px;
        check.that(
            roi_px == 0 || (16..=8192).contains(&roi_px),
            "detector.roi_px",
            || format!("found {roi_px}, must be 0 or from 16 to 8192"),
        );
        let truth = &self.truth;
        check.within("detector.truth.noise_px", truth.noise_px, 0.0..=100.0);
        check.within("detector.truth.miss_rate", truth.miss_rate, FRACTION);
        check.within(
            "detector.truth.distractor_rate",
            truth.distractor_rate,
            FRACTION,
        );
        check.within(
            "detector.truth.false_alarms_per_frame",
            truth.false_alarms_per_frame,
            0.0..=100.0,
        );
    }
}

impl Tracker {
    fn check(&self, check: &mut Check) {
        check.maybe_within("tracker.centre_sigma_px", self.centre_sigma_px, 0.01..=20.0);
        check.within("tracker.min_quality", self.min_quality, FRACTION);
        check.maybe_within("tracker.min_score", self.min_score, FRACTION);
        check.within("tracker.switch_ratio", self.switch_ratio, 1.0..=f64::MAX);
    }
}

impl Controller {
    fn check(&self, check: &mut Check) {
        for (name, gains) in [("coarse", self.coarse), ("precise", self.precise)] {
            if let Some(gains) = gains {
                for (key, gain) in [
                    ("kp", gains.kp),
                    ("ki_per_s", gains.ki_per_s),
                    ("kd_s", gains.kd_s),
                ] {
                    check.within(&format!("controller.{name}.{key}"), gain, AT_LEAST_ZERO);
                }
            }
        }
    }
}

impl Engage {
    fn check(&self, check: &mut Check) {
        let mut names = Vec::new();
        for (index, zone) in self.keep_out.iter().enumerate() {
            let path = format!("engage.keep_out[{index}]");
            check.name(&format!("{path}.name"), &zone.name, &names);
            names.push(&zone.name);
            check.that(zone.zone().is_some(), &path, || {
                "give either azimuth_deg and elevation_deg, or from_enu_m, to_enu_m and radius_m"
                    .to_owned()
            });
            for (end, azimuth) in zone.azimuth_deg.into_iter().flatten().enumerate() {
                check.within(&format!("{path}.azimuth_deg[{end}]"), azimuth, TURN);
            }
            if let Some(elevation_deg) = zone.elevation_deg {
                check.ascending(&format!("{path}.elevation_deg"), elevation_deg, ELEVATION);
            }
            if let Some(radius_m) = zone.radius_m {
                check.positive(&format!("{path}.radius_m"), radius_m);
            }
        }
        check.within(
            "engage.sun_exclusion_deg",
            self.sun_exclusion_deg,
            0.0..=90.0,
        );
        check.within("engage.look_ahead_s", self.look_ahead_s, 0.0..=5.0);
        let mut within = |key: &str, value| {
            check.within(&format!("engage.{key}"), value, AT_LEAST_ZERO);
        };
        within("min_clear_range_m", self.min_clear_range_m);
        within("lock_dwell_s", self.lock_dwell_s);
        within("max_burst_s", self.max_burst_s);
        check.positive("engage.lock_radius_px", self.lock_radius_px);
        check.that(
            self.break_radius_px >= self.lock_radius_px,
            "engage.break_radius_px",
            || {
                let (found, lock) = (self.break_radius_px, self.lock_radius_px);
                format!("found {found}, must not be below lock_radius_px = {lock}")
            },
        );
    }
}

/// JSON Schema (draft 2020-12) of the scenario file, pretty, keys in alphabetical order.
pub fn json_schema() -> String {
    let mut text = format!("{:#}", schema());
    text.push('\n');
    text
}

/// Reference of the scenario file in Markdown, made from the JSON Schema.
pub fn docs_markdown() -> String {
    let root = schema();
    let mut text = String::from(
        "# Scenario files\n\n\
         Generated by `boresight schema`; do not edit. A scenario is a TOML file. A key that is not \
         listed here is an error, and an error names the file and the line. `--set key=value` \
         replaces a value on the command line; the key is a dotted path, list entries are numbered \
         from 0: `--set uavs.0.model=fpv5`.\n\n\
         Angles are in degrees, azimuth clockwise from north, elevation up from the horizon. \
         `enu` is the local east-north-up frame at the site point.\n",
    );
    let mut queue = vec![("Scenario".to_owned(), &root)];
    let mut next = 0;
    while let Some((name, schema)) = queue.get(next).cloned() {
        next += 1;
        let _ = write!(text, "\n## {name}\n\n{}\n", words(schema));
        let tables: Vec<&Value> = match schema["oneOf"].as_array() {
            Some(variants) => variants.iter().collect(),
            None => vec![schema],
        };
        if schema["properties"].is_null() {
            match type_words(schema).as_str() {
                "table" => {}
                kinds => {
                    let _ = write!(text, "\nIs {kinds}.\n\n");
                }
            }
            for variant in schema["oneOf"].as_array().into_iter().flatten() {
                for value in names(variant) {
                    let _ = writeln!(text, "- `\"{value}\"`: {}", words(variant));
                }
            }
        }
        for table in tables {
            write_table(&mut text, table);
        }
        references(schema, &mut |reference| {
            if !queue.iter().any(|(name, _)| name == reference)
                && let Some(schema) = root["$defs"].get(reference)
            {
                queue.push((reference.to_owned(), schema));
            }
        });
    }

    text.push_str("\n## Camera presets\n");
    for (name, preset) in [
        ("urban_1km", CameraPreset::Urban1Km),
        ("paper", CameraPreset::Paper),
    ] {
        let _ = write!(
            text,
            "\n`{name}`\n\n| field | search | coarse | precise |\n|---|---|---|---|\n"
        );
        let cameras = preset.cameras();
        let focal_mm = cameras.each_ref().map(|c| 1e3 * c.focal_length_m());
        let [search, coarse, precise] =
            cameras.map(|camera| sorted(serde_json::to_value(camera).unwrap_or_default()));
        for (field, value) in search.as_object().into_iter().flatten() {
            let (coarse, precise) = (&coarse[field], &precise[field]);
            let _ = writeln!(text, "| `{field}` | {value} | {coarse} | {precise} |");
        }
        let [search, coarse, precise] = focal_mm;
        let _ = writeln!(
            text,
            "| focal length that follows [mm] | {search:.2} | {coarse:.2} | {precise:.2} |"
        );
    }
    text
}

fn schema() -> Value {
    sorted(schemars::schema_for!(Scenario).to_value())
}

/// The same value with keys in alphabetical order, whatever map the JSON library was built with.
fn sorted(value: Value) -> Value {
    match value {
        Value::Object(map) => {
            let mut entries: Vec<_> = map.into_iter().collect();
            entries.sort_by(|a, b| a.0.cmp(&b.0));
            Value::Object(entries.into_iter().map(|(k, v)| (k, sorted(v))).collect())
        }
        Value::Array(items) => Value::Array(items.into_iter().map(sorted).collect()),
        other => other,
    }
}

fn words(schema: &Value) -> String {
    one_line(schema["description"].as_str().unwrap_or_default())
}

/// Writes the fields of an object schema, required ones first.
fn write_table(text: &mut String, schema: &Value) {
    let Some(properties) = schema["properties"].as_object() else {
        return;
    };
    if let Some((tag, value)) = properties
        .iter()
        .find(|(_, field)| !field["const"].is_null())
    {
        let _ = write!(text, "\n`{tag} = {}`: {}\n", value["const"], words(schema));
    }
    let required = |name: &str| {
        (schema["required"].as_array()).is_some_and(|list| list.iter().any(|item| item == name))
    };
    let mut fields: Vec<_> = (properties.iter())
        .filter(|(_, field)| field["const"].is_null())
        .collect();
    if fields.is_empty() {
        return;
    }
    fields.sort_by_key(|(name, _)| (!required(name), name.as_str()));
    text.push_str("\n| field | type | unit | default | meaning |\n|---|---|---|---|---|\n");
    for (name, field) in fields {
        let default = match &field["default"] {
            _ if required(name) => "**required**".to_owned(),
            Value::Null => String::new(),
            Value::Object(_) => "see there".to_owned(),
            value => format!("`{value}`"),
        };
        let _ = writeln!(
            text,
            "| `{name}` | {} | {} | {default} | {} |",
            type_words(field),
            unit(name),
            match words(field) {
                // The payload of a one-field variant is described by the variant.
                bare if bare.is_empty() => words(schema),
                described => described,
            }
        );
    }
}

/// Unit of a field, from the suffix of its name.
fn unit(name: &str) -> &'static str {
    match name.rsplit('_').next().unwrap_or_default() {
        "m" => "m",
        "mps" => "m/s",
        "mps2" => "m/s²",
        "s" => "s",
        "hz" => "Hz",
        "deg" => "°",
        "degps" => "°/s",
        "degps2" => "°/s²",
        "mrad" => "mrad",
        "urad" => "µrad",
        "px" => "px",
        "um" => "µm",
        "nm" => "nm",
        "e" => "e⁻",
        "w" => "W",
        "c" => "°C",
        "hpa" => "hPa",
        "mmph" => "mm/h",
        _ => "",
    }
}

/// The words a string schema allows.
fn names(schema: &Value) -> Vec<&str> {
    let listed = schema["enum"].as_array().into_iter().flatten();
    listed
        .chain([&schema["const"]])
        .filter_map(Value::as_str)
        .collect()
}

fn type_words(schema: &Value) -> String {
    if let Some(reference) = reference(schema) {
        return format!("[{reference}](#{})", reference.to_lowercase());
    }
    if !names(schema).is_empty() {
        return (names(schema).iter().map(|name| format!("`\"{name}\"`")))
            .collect::<Vec<_>>()
            .join(" or ");
    }
    for key in ["anyOf", "oneOf"] {
        if let Some(variants) = schema[key].as_array() {
            let mut kinds: Vec<String> = (variants.iter())
                .filter(|variant| variant["type"] != "null")
                .map(type_words)
                .collect();
            kinds.dedup();
            return kinds.join(" or ");
        }
    }
    let kind = match &schema["type"] {
        Value::Array(kinds) => kinds.iter().find(|kind| *kind != "null"),
        kind => Some(kind),
    };
    match kind.and_then(Value::as_str).unwrap_or_default() {
        "string" if schema["format"] == "date-time" => "date-time".to_owned(),
        "string" => "text".to_owned(),
        "integer" => "whole number".to_owned(),
        "boolean" => "true or false".to_owned(),
        "object" => "table".to_owned(),
        "array" => {
            let count = schema["maxItems"].as_u64().map(|n| format!(" of {n}"));
            format!(
                "list{}: {}",
                count.unwrap_or_default(),
                type_words(&schema["items"])
            )
        }
        other => other.to_owned(),
    }
}

fn reference(schema: &Value) -> Option<&str> {
    schema["$ref"].as_str()?.strip_prefix("#/$defs/")
}

/// Visits every reference in a schema, definitions left out.
fn references<'a>(schema: &'a Value, visit: &mut impl FnMut(&'a str)) {
    match schema {
        Value::Object(map) => {
            if let Some(reference) = reference(schema) {
                visit(reference);
            }
            for (key, value) in map {
                if key != "$defs" && key != "default" {
                    references(value, visit);
                }
            }
        }
        Value::Array(items) => items.iter().for_each(|item| references(item, visit)),
        _ => {}
    }
}

#[cfg(test)]
mod tests;
