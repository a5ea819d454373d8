//! When the laser may fire.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{AT_LEAST_ZERO, Check, ELEVATION, FRACTION, TURN};
use boresight_models::engage::interlock::Zone;
use boresight_models::flight::uav::AimPart;

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
    /// How far ahead the line of sight is checked for obstacles, backstops and keep-out zones: the laser is
    /// off before it gets there.
    pub look_ahead_s: f64,
    /// Least probability that the target is a UAV, 0 to 1: by the recogniser, now and evened out over half a second, or by
    /// the tracker's own evidence where that has not judged it. A radar that has a target where the range finder meets it, and sees it fly alike,
    /// adds up to 1 to its log-odds.
    pub min_uav_probability: f64,
    /// Largest size that a target may have, by its box and the range finder's echo: what is larger is no UAV, is given up and
    /// not fired at.
    pub max_span_m: f64,
    /// What may lie behind the target on the beam's line: any of "sky", "ground", "building".
    pub allow_backstop: Vec<Backstop>,
    /// An allowed building or ground must lie at least this far behind the target.
    pub min_clear_range_m: f64,
    /// The precise track's error, or its mean over 0.2 s, must stay below this to count as locked.
    pub lock_radius_px: f64,
    /// How long the lock must hold before the laser fires.
    pub lock_dwell_s: f64,
    /// The laser stops when the precise track's error, and its mean over 0.2 s, exceed this.
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
            min_uav_probability: 0.95,
            max_span_m: 4.0,
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
    /// Nothing but sky.
    Sky,
    /// Terrain or street.
    Ground,
    /// A building, or a tree: what stands more than 2 m above the ground.
    Building,
}

impl Engage {
    pub(super) fn check(&self, check: &mut Check) {
        let mut names = Vec::new();
        for (index, zone) in self.keep_out.iter().enumerate() {
            check.table(&format!("keep_out[{index}]"), |check| {
                check.name("name", &zone.name, &names);
                zone.check(check);
            });
            names.push(&zone.name);
        }
        check.within("min_uav_probability", self.min_uav_probability, FRACTION);
        check.positive("max_span_m", self.max_span_m);
        check.within("sun_exclusion_deg", self.sun_exclusion_deg, 0.0..=90.0);
        check.within("look_ahead_s", self.look_ahead_s, 0.0..=5.0);
        check.within("min_clear_range_m", self.min_clear_range_m, AT_LEAST_ZERO);
        check.within("lock_dwell_s", self.lock_dwell_s, AT_LEAST_ZERO);
        check.within("max_burst_s", self.max_burst_s, AT_LEAST_ZERO);
        check.positive("lock_radius_px", self.lock_radius_px);
        let (found, lock) = (self.break_radius_px, self.lock_radius_px);
        check.that(found >= lock, "break_radius_px", || {
            format!("found {found}, must not be below lock_radius_px = {lock}")
        });
    }
}

impl KeepOut {
    fn check(&self, check: &mut Check) {
        check.that(self.zone().is_some(), "", || {
            "give either azimuth_deg and elevation_deg, or from_enu_m, to_enu_m and radius_m"
                .to_owned()
        });
        for (end, azimuth) in self.azimuth_deg.into_iter().flatten().enumerate() {
            check.within(&format!("azimuth_deg[{end}]"), azimuth, TURN);
        }
        if let Some(elevation_deg) = self.elevation_deg {
            check.ascending("elevation_deg", elevation_deg, ELEVATION);
        }
        if let Some(radius_m) = self.radius_m {
            check.positive("radius_m", radius_m);
        }
    }
}
