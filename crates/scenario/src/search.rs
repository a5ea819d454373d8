//! Where the station looks for targets.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{Check, ELEVATION, TURN};
use super::load::suggestion;
use super::targets::UavConfig;
use boresight_models::tracking::search::SearchPattern;

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
    /// Whether all UAVs in the air are tracked; a network of stations assigns them.
    #[serde(default)]
    pub all: bool,
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

impl SearchSector {
    pub(super) fn check(&self, check: &mut Check, uavs: &[UavConfig]) {
        check.within("centre_azimuth_deg", self.centre_azimuth_deg, TURN);
        check.positive("width_deg", self.width_deg);
        check.within("width_deg", self.width_deg, 0.0..=360.0);
        check.within("elevation_deg", self.elevation_deg, ELEVATION);
        check.positive("height_deg", self.height_deg);
        check.within("height_deg", self.height_deg, 0.0..=180.0);
        if let Some(cue) = &self.cue {
            check.table("cue", |check| cue.check(check, uavs));
        }
    }
}

impl Cue {
    fn check(&self, check: &mut Check, uavs: &[UavConfig]) {
        check.within("sigma_deg", self.sigma_deg, 0.0..=90.0);
        check.within("range_sigma_m", self.range_sigma_m, 0.0..=10_000.0);
        check.positive("rate_hz", self.rate_hz);
        check.within("latency_s", self.latency_s, 0.0..=60.0);
        check.that(!self.all || self.target.is_none(), "all", || {
            "all UAVs are tracked, and 'target' names one: leave one of the two out".to_owned()
        });
        if let Some(target) = &self.target {
            check_named_uav(check, "target", target, uavs);
        }
    }
}

/// `name` must be that of a UAV.
pub(super) fn check_named_uav(check: &mut Check, key: &str, name: &str, uavs: &[UavConfig]) {
    let known = uavs.iter().any(|uav| uav.name == name);
    check.that(known, key, || {
        let names: Vec<&str> = uavs.iter().map(|uav| uav.name.as_str()).collect();
        format!("no UAV '{name}'{}", suggestion(name, &names))
    });
}
