//! The station's cameras: presets, and what differs from them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{AT_LEAST_ZERO, Check, ELEVATION, FRACTION, TURN};
use super::mount::MountConfig;
use boresight_models::optics::tier::Tier;

/// The cameras: a preset's three, and what differs from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
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
    /// Whether the search camera is there; without it the coarse one searches, as a rule about a radar's cue.
    pub has_search: bool,
    /// Further cameras.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub more: Vec<MoreCamera>,
}

impl Default for Cameras {
    fn default() -> Self {
        Self {
            preset: CameraPreset::default(),
            search: CameraChanges::default(),
            coarse: CameraChanges::default(),
            precise: CameraChanges::default(),
            has_search: true,
            more: Vec::new(),
        }
    }
}

/// A camera beside the three.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MoreCamera {
    /// Its name, which heads its topics.
    pub name: String,
    /// What it is for.
    pub role: Tier,
    /// What turns it; absent: the mirror where it is a precise one, or else the gimbal.
    pub path: Option<CameraPath>,
    /// What differs from the preset's camera of that role.
    #[serde(default)]
    pub changes: CameraChanges,
}

/// What turns a camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraPath {
    /// The gimbal.
    Gimbal,
    /// The gimbal and the mirror behind it.
    Mirror,
    /// Nothing: it looks one way.
    Fixed {
        /// Azimuth, clockwise from north.
        azimuth_deg: f64,
        /// Elevation.
        elevation_deg: f64,
    },
    /// A gimbal of its own, which searches the sector whatever the station does.
    PanTilt(PanTiltConfig),
}

/// A gimbal that turns one camera: as the station's, but for this.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "PanTilt")]
pub struct PanTiltConfig {
    /// Azimuth stops [from, to]; absent: turns without end.
    pub azimuth_limits_deg: Option<[f64; 2]>,
    /// Elevation stops [from, to].
    pub elevation_limits_deg: [f64; 2],
    /// Fastest turn of either axis.
    pub max_rate_degps: f64,
    /// Largest angular acceleration of either axis.
    pub max_acceleration_degps2: f64,
}

impl Default for PanTiltConfig {
    fn default() -> Self {
        let mount = MountConfig::default();
        Self {
            azimuth_limits_deg: mount.azimuth_limits_deg,
            elevation_limits_deg: mount.elevation_limits_deg,
            max_rate_degps: mount.max_rate_degps,
            max_acceleration_degps2: mount.max_acceleration_degps2,
        }
    }
}

impl PanTiltConfig {
    /// The mount of a station with these axes.
    pub fn as_mount(&self, station: &MountConfig) -> MountConfig {
        MountConfig {
            azimuth_limits_deg: self.azimuth_limits_deg,
            elevation_limits_deg: self.elevation_limits_deg,
            max_rate_degps: self.max_rate_degps,
            max_acceleration_degps2: self.max_acceleration_degps2,
            ..station.clone()
        }
    }
}

/// A camera of a station, all changes made.
#[derive(Clone, Debug, PartialEq)]
pub struct ResolvedCamera {
    /// Its name.
    pub name: String,
    /// What it is for.
    pub tier: Tier,
    /// What turns it.
    pub path: CameraPath,
    /// Where it stands in the table of the cameras, for errors.
    pub place: String,
    /// Its values.
    pub config: CameraConfig,
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

/// Defines [`CameraConfig`] and its partial twin [`CameraChanges`] from one list of fields.
macro_rules! camera {
    ($($(#[$doc:meta])* $field:ident: $type:ty,)*) => {
        /// One camera, the preset's values and the changes put together.
        #[derive(Clone, Debug, PartialEq, Serialize)]
        pub struct CameraConfig {
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
            fn applied_to(&self, preset: CameraConfig) -> CameraConfig {
                CameraConfig { $($field: self.$field.unwrap_or(preset.$field),)* }
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
    /// Share of the white level at which automatic exposure puts the bright parts of the field.
    exposure_level: f64,
    /// Time constant of automatic exposure.
    exposure_settling_s: f64,
    /// Largest gain of automatic exposure, used once the exposure has half a frame's time, or half of that since the last
    /// frame read, up to 1/60 s; a fixed exposure has none.
    max_gain_db: f64,
    /// Which light is shown white.
    white_balance: WhiteBalance,
    /// Focal ratio.
    f_number: f64,
    /// Width of a pixel on the sensor; with the field of view it gives the focal length.
    pixel_pitch_um: f64,
    /// Charge that saturates a pixel.
    full_well_e: f64,
    /// Read noise, root mean square.
    read_noise_e: f64,
    /// Charge that gathers in a pixel in the dark.
    dark_current_eps: f64,
    /// Standard deviation of the pixels' offsets (DSNU of EMVA 1288); 0 for none.
    dsnu_e: f64,
    /// Standard deviation of the pixels' sensitivities (PRNU of EMVA 1288); 0 for none.
    prnu_percent: f64,
    /// Colour filters on the pixels.
    mosaic: Mosaic,
    /// How the rows are exposed.
    shutter: Shutter,
    /// Time from one row to the next of a rolling shutter.
    line_time_us: f64,
    /// Whether what moves or turns during the exposure is smeared: the picture, what flies, rotors.
    motion_blur: bool,
    /// Light that the lens loses in the corners, beyond the natural cos⁴.
    vignetting_percent: f64,
    /// Veiling glare of the sun, and of lasers and lamps: luminance in kcd/m² of a klx of light 1° away; 0 for none.
    glare: f64,
    /// Wavelengths [from, to] that a filter before the lens blocks.
    blocked_nm: [f64; 2],
    /// Optical density of that filter in its band: 10 to the power of minus this passes; 0 for no filter.
    blocking_od: f64,
    /// What keeps the station's own laser out of the camera's exposures.
    laser_gate: LaserGate,
    /// Distance of the lens from the laser's axis, to its right; 0 looks through the laser's own aperture.
    laser_offset_m: f64,
    /// Standard deviation of the lens blur.
    optics_blur_px: f64,
    /// From the end of the exposure to the image being in memory.
    readout_latency_s: f64,
    /// From the image being in memory to its detections being known.
    inference_latency_s: f64,
    /// Samples per pixel in the renderer: 1 or 4.
    antialias: u32,
    /// Which part of the sensor is read.
    readout: ReadoutMode,
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
    /// Automatic exposure.
    Auto,
}

/// White balance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WhiteBalance {
    /// The light of sun and sky on level ground, between some 4,000 K and 10,000 K.
    Auto,
    /// Always D65, average daylight.
    Daylight,
}

/// Colour filters on the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mosaic {
    /// Three values a pixel, as from three chips.
    None,
    /// Bayer's pattern with red in the first pixel; what is missing is interpolated linearly.
    Rggb,
    /// No filters: a grey picture of all visible light, three times as much of it.
    Mono,
}

/// How the rows are exposed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Shutter {
    /// All at once.
    Global,
    /// One after the other, `line_time_us` apart; the middle row at the instant of the exposure.
    Rolling,
}

/// What keeps a station's own laser out of a camera's exposures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LaserGate {
    /// Nothing.
    None,
    /// The laser pauses while the camera exposes, and loses that share of its power.
    Pause,
    /// The camera takes no frames while the laser fires.
    Blank,
}

/// What a camera reads out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Readout")]
pub enum ReadoutMode {
    /// The whole sensor.
    Full,
    /// A square around the predicted target.
    Window,
}

impl CameraConfig {
    /// Focal length [m] that the field of view and the pixel pitch imply.
    pub fn focal_length_m(&self) -> f64 {
        let half_width_m = 0.5 * f64::from(self.width_px) * self.pixel_pitch_um * 1e-6;
        half_width_m / (0.5 * self.hfov_deg.to_radians()).tan()
    }
}

impl Cameras {
    /// The search, coarse and precise cameras, in this order, after the changes.
    pub fn resolved(&self) -> [CameraConfig; 3] {
        let [search, coarse, precise] = self.preset.cameras();
        [
            self.search.applied_to(search),
            self.coarse.applied_to(coarse),
            self.precise.applied_to(precise),
        ]
    }

    /// All cameras that are there: wide to narrow, then the further ones.
    pub fn all(&self) -> Vec<ResolvedCamera> {
        let usual = |tier: Tier| match tier {
            Tier::Search | Tier::Coarse => CameraPath::Gimbal,
            Tier::Precise => CameraPath::Mirror,
        };
        let three = Tier::ALL.into_iter().zip(self.resolved());
        let three = three.map(|(tier, config)| ResolvedCamera {
            name: tier.name().into(),
            tier,
            path: usual(tier),
            place: tier.word().into(),
            config,
        });
        let preset = self.preset.cameras();
        let more = (self.more.iter().enumerate()).map(|(index, more)| ResolvedCamera {
            name: more.name.clone(),
            tier: more.role,
            path: more.path.unwrap_or(usual(more.role)),
            place: format!("more[{index}]"),
            config: (more.changes).applied_to(preset[more.role as usize].clone()),
        });
        three
            .filter(|camera| self.has_search || camera.tier != Tier::Search)
            .chain(more)
            .collect()
    }
}

impl CameraPreset {
    pub(super) fn cameras(self) -> [CameraConfig; 3] {
        // 640 × 480 of the 720 × 540 pixels of a FLIR Blackfly S BFS-U3-04S2C (Sony IMX287, 1/2.9",
        // 6.9 µm, global shutter, 12 bits, 522 frames a second).
        let base = CameraConfig {
            hfov_deg: 1.0,
            width_px: 640,
            height_px: 480,
            rate_hz: 120,
            exposure_s: Exposure::Auto(AutoWord::Auto),
            exposure_level: 0.5,
            exposure_settling_s: 0.25,
            max_gain_db: 36.0,
            white_balance: WhiteBalance::Auto,
            f_number: 5.6,
            pixel_pitch_um: 6.9,
            full_well_e: 22_000.0,
            read_noise_e: 4.0,
            dark_current_eps: 2.0,
            dsnu_e: 1.0,
            prnu_percent: 0.6,
            mosaic: Mosaic::Rggb,
            shutter: Shutter::Global,
            line_time_us: 15.0,
            motion_blur: true,
            vignetting_percent: 15.0,
            glare: 1.0,
            // As in front of cameras that look along a laser of 800 nm to 1.1 µm; the sensor's colour filters let it through.
            blocked_nm: [750.0, 1100.0],
            blocking_od: 6.0,
            laser_gate: LaserGate::None,
            laser_offset_m: 0.0,
            optics_blur_px: 0.6,
            readout_latency_s: 0.002,
            inference_latency_s: 0.003,
            antialias: 4,
            readout: ReadoutMode::Full,
            window_px: 256,
        };
        match self {
            Self::Urban1Km => [
                CameraConfig {
                    hfov_deg: 6.0,
                    rate_hz: 30,
                    f_number: 2.8,
                    laser_offset_m: 0.3,
                    ..base.clone()
                },
                CameraConfig {
                    hfov_deg: 3.0,
                    rate_hz: 60,
                    f_number: 4.0,
                    laser_offset_m: 0.3,
                    readout: ReadoutMode::Window,
                    ..base.clone()
                },
                CameraConfig {
                    readout: ReadoutMode::Window,
                    ..base
                },
            ],
            Self::Paper => {
                // Pitches that make the printed focal lengths and fields of view agree:
                // 2·f·tan(hfov/2)/640 with 4 mm and 120°, 50 mm and 30°.
                let coarse = CameraConfig {
                    hfov_deg: 120.0,
                    rate_hz: 60,
                    f_number: 2.8,
                    laser_offset_m: 0.3,
                    pixel_pitch_um: 21.65,
                    ..base.clone()
                };
                [
                    CameraConfig {
                        rate_hz: 30,
                        ..coarse.clone()
                    },
                    coarse,
                    CameraConfig {
                        hfov_deg: 30.0,
                        pixel_pitch_um: 41.87,
                        ..base
                    },
                ]
            }
        }
    }
}

impl Cameras {
    pub(super) fn check(&self, check: &mut Check, tick_hz: u32) {
        let cameras = self.all();
        for (index, camera) in cameras.iter().enumerate() {
            check.table(&camera.place, |check| {
                camera.config.check(check, tick_hz);
                let earlier: Vec<&str> = (cameras[..index].iter())
                    .map(|other| other.name.as_str())
                    .collect();
                check.name("name", &camera.name, &earlier);
                match camera.path {
                    CameraPath::Gimbal | CameraPath::Mirror => return,
                    CameraPath::Fixed {
                        azimuth_deg,
                        elevation_deg,
                    } => {
                        check.within("path.fixed.azimuth_deg", azimuth_deg, TURN);
                        check.within("path.fixed.elevation_deg", elevation_deg, ELEVATION);
                    }
                    CameraPath::PanTilt(axes) => check.table("path.pan_tilt", |check| {
                        axes.as_mount(&MountConfig::default()).check(check, tick_hz);
                    }),
                }
                check.that(camera.tier == Tier::Search, "path", || {
                    "a camera beside the gimbal can only search: give it the role search".into()
                });
            });
        }
    }
}

impl CameraConfig {
    fn check(&self, check: &mut Check, tick_hz: u32) {
        check.rate("rate_hz", self.rate_hz, tick_hz);
        check.within("hfov_deg", self.hfov_deg, 0.01..=170.0);
        check.within("width_px", self.width_px.into(), 16.0..=8192.0);
        check.within("height_px", self.height_px.into(), 16.0..=8192.0);
        if let Exposure::Seconds(time) = self.exposure_s {
            check.positive("exposure_s", time);
            let fits = time * f64::from(self.rate_hz) <= 1.0;
            check.that(fits, "exposure_s", || {
                let rate_hz = self.rate_hz;
                format!("{time} s is longer than a frame at rate_hz = {rate_hz}")
            });
        }
        check.within("exposure_level", self.exposure_level, 0.01..=1.0);
        check.within("exposure_settling_s", self.exposure_settling_s, 1e-3..=60.0);
        check.within("max_gain_db", self.max_gain_db, 0.0..=60.0);
        check.within("f_number", self.f_number, 0.5..=100.0);
        check.within("pixel_pitch_um", self.pixel_pitch_um, 0.5..=100.0);
        check.positive("full_well_e", self.full_well_e);
        check.within("dark_current_eps", self.dark_current_eps, AT_LEAST_ZERO);
        check.within("dsnu_e", self.dsnu_e, AT_LEAST_ZERO);
        check.within("prnu_percent", self.prnu_percent, 0.0..=20.0);
        check.within("line_time_us", self.line_time_us, 0.0..=1_000.0);
        check.within("vignetting_percent", self.vignetting_percent, 0.0..=100.0);
        check.within("glare", self.glare, 0.0..=100.0);
        let [from_nm, to_nm] = self.blocked_nm;
        check.that(0.0 <= from_nm && from_nm <= to_nm, "blocked_nm", || {
            format!("found [{from_nm}, {to_nm}], must rise from 0 or more")
        });
        check.within("blocking_od", self.blocking_od, 0.0..=12.0);
        check.within("laser_offset_m", self.laser_offset_m, 0.0..=10.0);
        check.within("read_noise_e", self.read_noise_e, AT_LEAST_ZERO);
        check.within("optics_blur_px", self.optics_blur_px, 0.0..=20.0);
        check.within("readout_latency_s", self.readout_latency_s, FRACTION);
        check.within("inference_latency_s", self.inference_latency_s, FRACTION);
        check.that([1, 4].contains(&self.antialias), "antialias", || {
            format!("found {}, must be 1 or 4", self.antialias)
        });
        let side = self.width_px.min(self.height_px);
        check.that((16..=side).contains(&self.window_px), "window_px", || {
            let found = self.window_px;
            format!("found {found}, must be from 16 to the image's {side}")
        });
    }
}
