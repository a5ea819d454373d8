//! Where the station looks for targets.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{Check, ELEVATION, TURN};
use super::load::suggestion;
use super::targets::UavConfig;
use boresight_models::sensing::radar::RadarErrors;
use boresight_models::sensing::radar::sensing::RadarParams;
use boresight_models::tracking::search::{SearchPattern, Sector};
use glam::DVec2;

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

/// A radar at the station that cues the search, which covers two deviations of the radar's track to either side of where that
/// says the target is now.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Cue {
    /// What its plots come from.
    #[serde(default)]
    pub kind: CueKind,
    /// Standard deviation of a plot's direction, each axis; of a strong echo's where the kind is "radar".
    pub sigma_deg: f64,
    /// Standard deviation of a plot's slant range; of a strong echo's where the kind is "radar".
    #[serde(default = "default_cue_range_sigma")]
    pub range_sigma_m: f64,
    /// Looks a second; the first is at the start.
    #[serde(default = "default_cue_rate")]
    pub rate_hz: f64,
    /// From a measurement to its plot at the station.
    #[serde(default = "default_cue_latency")]
    pub latency_s: f64,
    /// Name of the UAV that is tracked; absent: the first that is still in the air. Only where the kind is "truth".
    pub target: Option<String>,
    /// Whether all UAVs in the air are tracked; a network of stations assigns them. Only where the kind is "truth": a radar
    /// tracks what it detects.
    #[serde(default)]
    pub all: bool,
    /// The radar itself, where the kind is "radar".
    #[serde(default)]
    pub radar: RadarConfig,
}

/// What a radar's plots come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CueKind {
    /// A small scanning radar: it misses, sees birds and vehicles, makes false plots, does not see through buildings, and finds
    /// out by itself which plots are one thing's.
    #[default]
    Radar,
    /// The truth plus an error: UAVs alone, each in every look.
    Truth,
}

/// A small scanning radar.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RadarConfig {
    /// Range in which it detects a UAV of 0.01 m² in half of its looks. Makers of small radars state 1 to 2.5 km for such a one.
    pub half_range_m: f64,
    /// Farthest range.
    pub farthest_m: f64,
    /// Width of its field in azimuth, about the sector's middle; at least the sector's.
    pub width_deg: f64,
    /// Height of its field in elevation, about the sector's middle; at least the sector's.
    pub height_deg: f64,
    /// Width of its beam, both axes.
    pub beam_deg: f64,
    /// Its cell in range.
    pub cell_m: f64,
    /// Its cell in speed along the line of sight.
    pub cell_mps: f64,
    /// Chance that noise alone makes a detection in one cell.
    pub false_alarm: f64,
    /// What is slower along the line of sight, and has no rotor or wing, is taken for ground.
    pub least_mps: f64,
    /// Fastest speed along the line of sight.
    pub most_mps: f64,
    /// A plot with a greater apparent radar cross-section is dropped.
    pub most_rcs_m2: f64,
    /// Standard deviation of the constant angle between its axes and the mount's, each axis.
    pub alignment_deg: f64,
    /// Vehicles on the ground in its field, which it sees and no camera shows.
    pub vehicles: u32,
}

impl Default for RadarConfig {
    fn default() -> Self {
        Self {
            half_range_m: 1500.0,
            farthest_m: 3000.0,
            width_deg: 120.0,
            height_deg: 40.0,
            beam_deg: 5.0,
            cell_m: 5.0,
            cell_mps: 1.0,
            false_alarm: 1e-7,
            least_mps: 1.0,
            most_mps: 30.0,
            most_rcs_m2: 0.3,
            alignment_deg: 0.1,
            vehicles: 6,
        }
    }
}

fn default_cue_range_sigma() -> f64 {
    15.0 // [m]
}

fn default_cue_rate() -> f64 {
    2.0 // [Hz]
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
            check.table("cue", |check| cue.check(check, self, uavs));
        }
    }
}

impl Cue {
    /// Errors of a plot; of a strong echo's where the kind is "radar".
    pub fn errors(&self) -> RadarErrors {
        RadarErrors {
            sigma_rad: self.sigma_deg.to_radians(),
            range_sigma_m: self.range_sigma_m,
        }
    }

    /// The scanning radar that looks about a sector's middle, its axes turned so far against the mount's, azimuth and elevation
    /// [rad].
    pub fn scanning(&self, sector: &SearchSector, turned_rad: DVec2) -> RadarParams {
        let radar = &self.radar;
        RadarParams {
            errors: self.errors(),
            half_range_m: radar.half_range_m,
            farthest_m: radar.farthest_m,
            beam_rad: radar.beam_deg.to_radians(),
            cell_m: radar.cell_m,
            cell_mps: radar.cell_mps,
            false_alarm: radar.false_alarm,
            least_mps: radar.least_mps,
            most_mps: radar.most_mps,
            most_rcs_m2: radar.most_rcs_m2,
            field: Sector {
                centre_azimuth_rad: sector.centre_azimuth_deg.to_radians(),
                centre_elevation_rad: sector.elevation_deg.to_radians(),
                width_rad: radar.width_deg.max(sector.width_deg).to_radians(),
                height_rad: radar.height_deg.max(sector.height_deg).to_radians(),
            },
            turned_rad,
        }
    }

    fn check(&self, check: &mut Check, sector: &SearchSector, uavs: &[UavConfig]) {
        check.within("sigma_deg", self.sigma_deg, 0.0..=90.0);
        check.within("range_sigma_m", self.range_sigma_m, 0.0..=10_000.0);
        check.positive("rate_hz", self.rate_hz);
        check.within("latency_s", self.latency_s, 0.0..=60.0);
        check.that(!self.all || self.target.is_none(), "all", || {
            "all UAVs are tracked, and 'target' names one: leave one of the two out".to_owned()
        });
        let told = |what: &str| format!("{what}: leave it out, or give kind = \"truth\"");
        let scans = self.kind == CueKind::Radar;
        check.that(!scans || !self.all, "all", || {
            told("a radar tracks whatever it detects")
        });
        check.that(!scans || self.target.is_none(), "target", || {
            told("a radar cannot tell one UAV from another")
        });
        let unread = !scans && self.radar != RadarConfig::default();
        check.that(!unread, "radar", || {
            "is not read where kind = \"truth\": leave one of the two out".to_owned()
        });
        check.table("radar", |check| {
            self.radar.check(check);
            let false_plots = self.scanning(sector, DVec2::ZERO).false_plots();
            check.that(false_plots <= MOST_FALSE_PLOTS, "false_alarm", || {
                format!(
                    "makes {false_plots:.0} false plots in every look, at most {MOST_FALSE_PLOTS:.0} can be tracked: lower it"
                )
            });
        });
        if let Some(target) = &self.target {
            check_named_uav(check, "target", target, uavs);
        }
    }
}

impl RadarConfig {
    fn check(&self, check: &mut Check) {
        check.within("half_range_m", self.half_range_m, 10.0..=100_000.0);
        check.within("farthest_m", self.farthest_m, 10.0..=100_000.0);
        check.within("width_deg", self.width_deg, 1.0..=360.0);
        check.within("height_deg", self.height_deg, 1.0..=180.0);
        check.within("beam_deg", self.beam_deg, 0.01..=90.0);
        check.within("cell_m", self.cell_m, 0.01..=1_000.0);
        check.within("cell_mps", self.cell_mps, 0.01..=100.0);
        // At a thousandth and above a look is full of false plots.
        check.within("false_alarm", self.false_alarm, 1e-15..=1e-3);
        check.within("least_mps", self.least_mps, 0.0..=100.0);
        check.within("most_mps", self.most_mps, 0.1..=1_000.0);
        check.within("most_rcs_m2", self.most_rcs_m2, 1e-4..=1e6);
        check.within("alignment_deg", self.alignment_deg, 0.0..=10.0);
        check.within("vehicles", self.vehicles.into(), 0.0..=1_000.0);
    }
}

/// More false plots than this in a look make more tracks than can be told apart.
const MOST_FALSE_PLOTS: f64 = 200.0;

/// `name` must be that of a UAV.
pub(super) fn check_named_uav(check: &mut Check, key: &str, name: &str, uavs: &[UavConfig]) {
    let known = uavs.iter().any(|uav| uav.name == name);
    check.that(known, key, || {
        let names: Vec<&str> = uavs.iter().map(|uav| uav.name.as_str()).collect();
        format!("no UAV '{name}'{}", suggestion(name, &names))
    });
}
