//! The mount of a scenario and the motion of what it stands on.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{Check, ELEVATION, TURN};
use boresight_models::maths::rng::Stream;
use boresight_models::mount::base_motion::{BaseMotion, BaseMotionParams, Spectrum, TiltMode};
use boresight_models::mount::gyro::{DEG_PER_HOUR, DEG_PER_ROOT_HOUR, GyroParams};

/// The azimuth–elevation gimbal and the fast steering mirror.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Mount")]
pub struct MountConfig {
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
    pub base_motion: BaseMotionConfig,
    /// Noise of the steering mirror's sensor, which its loop follows: standard deviation of a reading
    /// a tick on each axis, as an angle of the line of sight.
    pub mirror_noise_urad: f64,
    /// The rate gyros on the base and on both axes: a preset or values.
    pub gyro: GyroConfig,
    /// Whether the bearings have dry friction.
    pub friction: bool,
    /// How far an axis at rest gives way, like a spring, before its bearings break away; 0 holds it
    /// rigidly until then.
    pub presliding_urad: f64,
    /// Amplitude of the motors' cogging, of their largest torque.
    pub cogging_share: f64,
    /// First structural mode of either axis, of the load on the locked rotor; 0 is a rigid axis.
    /// The tuned law's gain makes a mode below some 12 Hz oscillate.
    pub structural_mode_hz: f64,
    /// Backlash of either axis, stop to stop; a direct drive has none.
    pub backlash_urad: f64,
    /// Bits of the encoders per turn.
    pub encoder_bits: u32,
    /// Whether the wind turns the axes: its drag on the optics ahead of them, with gusts.
    pub wind_load: bool,
    /// Standard deviation, per axis, of the angle between the laser and the search and coarse cameras
    /// as built; a third of it for the precise camera, which shares the laser's optics.
    pub boresight_sigma_urad: f64,
}

impl Default for MountConfig {
    fn default() -> Self {
        Self {
            azimuth_limits_deg: None,
            elevation_limits_deg: [-15.0, 85.0],
            max_rate_degps: 60.0,
            max_acceleration_degps2: 180.0,
            mirror_range_mrad: 5.0,
            mirror_bandwidth_hz: 500.0,
            base_motion: BaseMotionConfig::Preset(BasePreset::Roof),
            mirror_noise_urad: 0.13,
            gyro: GyroConfig::Preset(GyroPreset::Fibre),
            friction: true,
            presliding_urad: 200.0,
            cogging_share: 0.005,
            structural_mode_hz: 40.0,
            backlash_urad: 0.0,
            encoder_bits: 24,
            wind_load: true,
            boresight_sigma_urad: 150.0,
        }
    }
}

/// The rate gyros of a mount.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "expected \"ideal\", \"fibre\", \"mems\" or { walk_deg_per_rt_h = ..., bias_deg_per_h = ..., ... }"
)]
#[schemars(rename = "Gyro")]
pub enum GyroConfig {
    /// A named class.
    Preset(GyroPreset),
    /// Values of a data sheet.
    Values(GyroValues),
}

/// Named classes of gyros.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GyroPreset {
    /// Without noise, filter and delay.
    Ideal,
    /// A small closed-loop fibre gyro: 0.01°/√h, 0.05°/h, 0.01°/h/√h, 1 kHz, 0.1 ms.
    Fibre,
    /// A tactical MEMS gyro: 0.15°/√h, 0.5°/h, 0.1°/h/√h, 260 Hz, 1.5 ms.
    Mems,
}

/// A gyro by the terms of its data sheet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GyroValues {
    /// Angle random walk [°/√h].
    pub walk_deg_per_rt_h: f64,
    /// Bias instability [°/h].
    pub bias_deg_per_h: f64,
    /// Rate random walk [°/h/√h].
    pub drift_deg_per_h_rt_h: f64,
    /// Bandwidth, 3 dB down; absent: no filter.
    pub bandwidth_hz: Option<f64>,
    /// Pure delay.
    pub delay_s: f64,
}

impl GyroConfig {
    /// The gyro's constants.
    pub fn params(&self) -> GyroParams {
        match self {
            Self::Preset(GyroPreset::Ideal) => GyroParams::default(),
            Self::Preset(GyroPreset::Fibre) => GyroParams::FIBRE,
            Self::Preset(GyroPreset::Mems) => GyroParams::MEMS,
            Self::Values(values) => GyroParams {
                angle_walk: values.walk_deg_per_rt_h * DEG_PER_ROOT_HOUR,
                bias_radps: values.bias_deg_per_h * DEG_PER_HOUR,
                rate_walk: values.drift_deg_per_h_rt_h * DEG_PER_HOUR / 60.0, // a root hour is 60 √s
                bandwidth_hz: values.bandwidth_hz,
                delay_s: values.delay_s,
            },
        }
    }

    fn check(&self, check: &mut Check) {
        if let Self::Values(values) = self {
            check.within("walk_deg_per_rt_h", values.walk_deg_per_rt_h, 0.0..=10.0);
            check.within("bias_deg_per_h", values.bias_deg_per_h, 0.0..=1e4);
            check.within(
                "drift_deg_per_h_rt_h",
                values.drift_deg_per_h_rt_h,
                0.0..=1e4,
            );
            if let Some(hz) = values.bandwidth_hz {
                check.within("bandwidth_hz", hz, 1.0..=1e5);
            }
            check.within("delay_s", values.delay_s, 0.0..=0.1);
        }
    }
}

/// Angular motion of what the mount stands on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "expected \"quiet\", \"roof\", \"mast\", { rms_urad = ..., frequency_hz = ... } or { psd = [[frequency, density], ...] }"
)]
#[schemars(rename = "BaseMotion")]
pub enum BaseMotionConfig {
    /// A named base.
    Preset(BasePreset),
    /// One mode of a given strength and frequency.
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

impl BaseMotionConfig {
    /// The base motion, to be stepped every `dt_s`; a spectrum's phases come from `rng`.
    pub fn model(&self, dt_s: f64, rng: &mut Stream) -> Result<BaseMotion, String> {
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
                return Ok(BaseMotion::from_spectrum(&spectrum, dt_s, rng));
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
        BaseMotion::new(&params, dt_s).map_err(|error| error.to_string())
    }
}

impl MountConfig {
    pub(super) fn check(&self, check: &mut Check, tick_hz: u32) {
        if let Some(limits) = self.azimuth_limits_deg {
            check.ascending("azimuth_limits_deg", limits, TURN);
        }
        check.ascending("elevation_limits_deg", self.elevation_limits_deg, ELEVATION);
        check.positive("max_rate_degps", self.max_rate_degps);
        check.positive("max_acceleration_degps2", self.max_acceleration_degps2);
        check.within("mirror_range_mrad", self.mirror_range_mrad, 0.0..=100.0);
        check.table("base_motion", |check| {
            self.base_motion.check(check, tick_hz);
        });
        let bandwidth_hz = self.mirror_bandwidth_hz;
        check.within("mirror_bandwidth_hz", bandwidth_hz, 10.0..=5_000.0);
        check.within("mirror_noise_urad", self.mirror_noise_urad, 0.0..=100.0);
        check.table("gyro", |check| self.gyro.check(check));
        check.within("presliding_urad", self.presliding_urad, 0.0..=1e5);
        check.within("cogging_share", self.cogging_share, 0.0..=0.2);
        let mode_hz = self.structural_mode_hz;
        if mode_hz != 0.0 {
            check.within("structural_mode_hz", mode_hz, 5.0..=200.0);
        }
        check.within("backlash_urad", self.backlash_urad, 0.0..=1e5);
        let sprung = self.backlash_urad == 0.0 || mode_hz != 0.0;
        check.that(sprung, "backlash_urad", || {
            "needs a spring to act on: set structural_mode_hz above 0".into()
        });
        check.within("encoder_bits", self.encoder_bits.into(), 8.0..=40.0);
        let sigma_urad = self.boresight_sigma_urad;
        check.within("boresight_sigma_urad", sigma_urad, 0.0..=5_000.0);
    }
}

impl BaseMotionConfig {
    fn check(&self, check: &mut Check, tick_hz: u32) {
        match self {
            Self::Preset(_) => {}
            Self::Values(base) => {
                check.within("rms_urad", base.rms_urad, 0.0..=1e5);
                check.positive("frequency_hz", base.frequency_hz);
            }
            Self::Spectrum(base) => match Spectrum::new(&base.psd) {
                Ok(_) => {
                    let last_hz = base.psd.iter().fold(0.0, |last, [f, _]| f64::max(last, *f));
                    check.within("psd", last_hz, 0.0..=0.5 * f64::from(tick_hz));
                }
                Err(error) => check.that(false, "psd", || error.to_string()),
            },
        }
    }
}
