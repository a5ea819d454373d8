//! The protected station and its laser.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::cameras::Cameras;
use super::check::Check;
use super::mount::MountConfig;
use super::search::SearchSector;
use super::targets::UavConfig;
use glam::DVec3;

/// The protected station.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Station {
    /// Its name; topics and logs of every station but the first begin with it.
    pub name: String,
    /// East, north, up of the mount's axes crossing; absent: on the city's station rooftop.
    pub position_enu_m: Option<[f64; 3]>,
    /// The two-axis gimbal and its steering mirror.
    pub mount: MountConfig,
    /// Whether the cameras' boresights are measured against the laser before the run, and corrected;
    /// without it the laser misses by the boresight error.
    pub calibrate: bool,
    /// The search, coarse and precise cameras.
    pub cameras: Cameras,
    /// The laser and its beam director.
    pub laser: LaserConfig,
    /// Where it looks for targets; absent: as `[search]` says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub search: Option<SearchSector>,
}

impl Default for Station {
    fn default() -> Self {
        Self {
            name: "station".into(),
            position_enu_m: None,
            mount: MountConfig::default(),
            calibrate: true,
            cameras: Cameras::default(),
            laser: LaserConfig::default(),
            search: None,
        }
    }
}

/// A station of a scenario.
#[derive(Clone, Debug)]
pub struct ResolvedStation<'a> {
    /// Its name.
    pub name: String,
    /// Where it stands in the file, for errors.
    pub place: String,
    /// Mount, cameras and laser.
    pub config: &'a Station,
    /// Where it looks for targets.
    pub search: &'a SearchSector,
}

/// The laser and its beam director.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Laser")]
pub struct LaserConfig {
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

impl Default for LaserConfig {
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

impl Station {
    pub(super) fn check(&self, check: &mut Check, tick_hz: u32, uavs: &[UavConfig]) {
        check.name("name", &self.name, &[]);
        check.that(!self.name.contains('/'), "name", || {
            format!("found '{}', must not contain a slash", self.name)
        });
        if let Some(search) = &self.search {
            check.table("search", |check| search.check(check, uavs));
        }
        check.table("mount", |check| self.mount.check(check, tick_hz));
        check.table("cameras", |check| self.cameras.check(check, tick_hz));
        check.table("laser", |check| self.laser.check(check));
    }
}

/// Stations are told apart by name, and stand apart.
pub(super) fn check_apart(stations: &[Station], check: &mut Check) {
    /// Twice what a beam keeps clear of a station.
    const APART_M: f64 = 20.0; // [m]
    for (index, station) in stations.iter().enumerate() {
        check.table(&format!("stations[{index}]"), |check| {
            let earlier: Vec<&str> = (stations[..index].iter())
                .map(|other| other.name.as_str())
                .collect();
            check.name("name", &station.name, &earlier);
            for other in &stations[..index] {
                let apart_m = match (other.position_enu_m, station.position_enu_m) {
                    (Some(a), Some(b)) => DVec3::from(a).distance(b.into()),
                    (None, None) => 0.0,
                    _ => f64::INFINITY,
                };
                check.that(apart_m >= APART_M, "position_enu_m", || {
                    format!(
                        "{apart_m:.1} m from station '{}', must be at least {APART_M} m",
                        other.name
                    )
                });
            }
        });
    }
}

impl LaserConfig {
    fn check(&self, check: &mut Check) {
        check.within("power_w", self.power_w, 0.0..=1e6);
        check.within("wavelength_nm", self.wavelength_nm, 200.0..=12_000.0);
        check.positive("aperture_radius_m", self.aperture_radius_m);
        check.within("m2", self.m2, 1.0..=100.0);
        if let Focus::Metres(distance) = self.focus {
            check.positive("focus", distance);
        }
        check.within("jitter_urad", self.jitter_urad, 0.0..=1e4);
    }
}
