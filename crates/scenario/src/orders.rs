//! What an operator, or a controller outside, may order.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

use super::Scenario;
use super::air::{VISIBILITY_M, WIND_FROM_DEG, WIND_MPS};
use super::cameras::Exposure;
use super::check::{Check, ELEVATION, MAX_DURATION_S, Problem, TURN};
use super::control::Gains;
use super::load::suggestion;
use super::search::check_named_uav;
use super::station::ResolvedStation;

/// More than any gimbal turns, and any mirror deflects: the mount's own limits hold below these.
const MOST_DRIVEN_DEGPS: f64 = 3_600.0; // [deg/s]
const MOST_DRIVEN_URAD: f64 = 1e6; // [µrad]
/// Where and how fast a UAV may be told to fly, an axis.
const FLOWN_M: RangeInclusive<f64> = -100_000.0..=100_000.0; // [m]
const FLOWN_MPS: RangeInclusive<f64> = -100.0..=100.0; // [m/s]

/// What an operator orders: a target by `designate` or by `track`, fire, a direction, a pointing law, gains,
/// weather, gimbal and mirror driven from outside, a camera's exposure, or where a UAV flies, one of them in an order; without any the choice goes back to the tracker.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Order")]
pub struct OrderConfig {
    /// Time of the order, from the start of the run.
    pub t_s: f64,
    /// Name of the UAV or distractor whose picture the operator points at: its track becomes the
    /// target and stays it.
    pub designate: Option<String>,
    /// Identity of the track that becomes the target and stays it, as recordings have it. The
    /// window records a choice in this way, so that its run can be repeated.
    pub track: Option<u32>,
    /// Whether the laser may fire from now on, in place of `engage.authorised`.
    pub fire: Option<bool>,
    /// Azimuth, clockwise from north, and elevation to which the station turns by hand: it gives its target up,
    /// searches one field of its widest camera about that direction, and takes up nothing elsewhere, until a
    /// target is designated or the choice goes back to the tracker.
    pub slew_deg: Option<[f64; 2]>,
    /// Name of the pointing law that takes over, as for `controller.preset`; not "paper", whose loops are no law
    /// on a predicted line of sight.
    pub law: Option<String>,
    /// Gains of the law in force.
    pub gains: Option<GainsOrder>,
    /// How the weather changes, for all stations, from the next tick on.
    pub weather: Option<WeatherOrder>,
    /// Rates and deflection at which gimbal and mirror are driven from outside, in place of what the pointing law
    /// commands, until another such order; what is absent of them the law commands again.
    pub drive: Option<DriveOrder>,
    /// How a camera exposes from now on.
    pub camera: Option<CameraOrder>,
    /// Where a UAV flies from now on, in place of its plan.
    pub fly: Option<FlyOrder>,
    /// Name of the station that obeys; absent: every one. Weather and flight are of no station.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub station: Option<String>,
}

/// Gains that take the place of those in force; what is absent stays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GainsOrder {
    /// Gains of the coarse loop, with the paper's controller.
    pub coarse: Option<Gains>,
    /// Gains of the precise loop, with the paper's controller.
    pub precise: Option<Gains>,
    /// Gimbal rate per angle still to turn, with the "tuned" law; another law may take it too.
    pub gimbal_per_s: Option<f64>,
}

/// Weather that takes the place of what there is; what is absent stays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WeatherOrder {
    /// Mean wind speed, as `weather.wind_speed_mps`. The gusts go on in its strength; a reported gust speed
    /// below it counts no more.
    pub wind_speed_mps: Option<f64>,
    /// Direction the wind blows from, clockwise from north.
    pub wind_from_deg: Option<f64>,
    /// Meteorological visibility at 550 nm, precipitation included.
    pub visibility_m: Option<f64>,
}

/// Gimbal and mirror driven from outside; what is absent stays with the pointing law.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DriveOrder {
    /// Rates of azimuth and elevation relative to the base.
    pub rates_degps: Option<[f64; 2]>,
    /// Deflection of the line of sight by the mirror, right and up.
    pub mirror_urad: Option<[f64; 2]>,
}

/// How a camera of the station exposes; what is absent stays.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraOrder {
    /// Name of the camera, as for its topics in a recording, without the station's name.
    pub name: String,
    /// Exposure time in seconds, at most the time between its frames, or "auto". The latency of its detections stays.
    pub exposure_s: Option<Exposure>,
    /// Share of the white level at which automatic exposure puts what it meters, as `exposure_level` of a camera.
    pub exposure_level: Option<f64>,
}

/// Where a UAV flies until another such order, in place of its plan: one of path, velocity, landing and rotors. Without
/// any of them it stops and stays.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlyOrder {
    /// Name of the UAV.
    pub uav: String,
    /// Places that it flies to, one after the other; it stays at the last.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub path_enu_m: Vec<[f64; 3]>,
    /// Speed on the path; 5 m/s without it. The airframe's own limit holds, too.
    pub speed_mps: Option<f64>,
    /// Velocity over ground.
    pub velocity_enu_mps: Option<[f64; 3]>,
    /// Whether it goes down where it is and stands on what is there.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub land: bool,
    /// Throttle of each rotor, 0 to 1, as an autopilot outside commands it: the share of the rotor's fastest speed.
    /// Rotors are counted counter-clockwise, seen from above, from the one at the front left.
    pub rotors: Option<Vec<f64>>,
    /// Heading of its nose, clockwise from north; absent: as it is.
    pub heading_deg: Option<f64>,
}

impl OrderConfig {
    /// Whether the station of that name obeys it.
    pub fn is_for(&self, station: &str) -> bool {
        self.station.as_deref().is_none_or(|name| name == station)
    }

    /// Keys of what it holds.
    fn held(&self) -> Vec<&'static str> {
        let keys = [
            ("designate", self.designate.is_some()),
            ("track", self.track.is_some()),
            ("fire", self.fire.is_some()),
            ("slew_deg", self.slew_deg.is_some()),
            ("law", self.law.is_some()),
            ("gains", self.gains.is_some()),
            ("weather", self.weather.is_some()),
            ("drive", self.drive.is_some()),
            ("camera", self.camera.is_some()),
            ("fly", self.fly.is_some()),
        ];
        (keys.into_iter().filter(|(_, given)| *given))
            .map(|(key, _)| key)
            .collect()
    }
}

impl GainsOrder {
    fn check(&self, check: &mut Check) {
        for (key, gains) in [("coarse", self.coarse), ("precise", self.precise)] {
            if let Some(gains) = gains {
                check.table(key, |check| gains.check(check));
            }
        }
        check.maybe_within("gimbal_per_s", self.gimbal_per_s, 0.0..=1000.0);
        check.that(*self != Self::default(), "", || {
            "changes no gain: give coarse, precise or gimbal_per_s".to_owned()
        });
    }
}

impl WeatherOrder {
    fn check(&self, check: &mut Check) {
        check.maybe_within("wind_speed_mps", self.wind_speed_mps, WIND_MPS);
        check.maybe_within("wind_from_deg", self.wind_from_deg, WIND_FROM_DEG);
        check.maybe_within("visibility_m", self.visibility_m, VISIBILITY_M);
        check.that(*self != Self::default(), "", || {
            "changes nothing: give wind_speed_mps, wind_from_deg or visibility_m".to_owned()
        });
    }
}

impl DriveOrder {
    fn check(&self, check: &mut Check) {
        for (key, values, most) in [
            ("rates_degps", self.rates_degps, MOST_DRIVEN_DEGPS),
            ("mirror_urad", self.mirror_urad, MOST_DRIVEN_URAD),
        ] {
            for (index, value) in values.into_iter().flatten().enumerate() {
                check.within(&format!("{key}[{index}]"), value, -most..=most);
            }
        }
    }
}

impl CameraOrder {
    /// The cameras of these stations that it means must be there, and have the time for the exposure.
    fn check<'a>(
        &self,
        stations: impl Iterator<Item = &'a ResolvedStation<'a>>,
        check: &mut Check,
    ) {
        let all: Vec<_> = stations
            .flat_map(|station| station.config.cameras.all())
            .collect();
        let meant = || all.iter().filter(|camera| camera.name == self.name);
        check.that(meant().next().is_some(), "name", || {
            let names: Vec<&str> = all.iter().map(|camera| camera.name.as_str()).collect();
            format!(
                "no camera '{}'{}",
                self.name,
                suggestion(&self.name, &names)
            )
        });
        if let Some(Exposure::Seconds(time_s)) = self.exposure_s {
            let fastest_hz = meant().map(|camera| camera.config.rate_hz).max();
            let longest_s = 1.0 / f64::from(fastest_hz.unwrap_or(1));
            check.within("exposure_s", time_s, 1e-6..=longest_s);
        }
        check.maybe_within("exposure_level", self.exposure_level, 0.01..=1.0);
        let changes = self.exposure_s.is_some() || self.exposure_level.is_some();
        check.that(changes, "", || {
            "changes nothing: give exposure_s or exposure_level".to_owned()
        });
    }
}

impl FlyOrder {
    /// Speed on its path where none is given [m/s].
    pub const SPEED_MPS: f64 = 5.0;

    fn check(&self, scenario: &Scenario, check: &mut Check) {
        check_named_uav(check, "uav", &self.uav, &scenario.uavs);
        let keys = [
            ("path_enu_m", !self.path_enu_m.is_empty()),
            ("velocity_enu_mps", self.velocity_enu_mps.is_some()),
            ("land", self.land),
            ("rotors", self.rotors.is_some()),
        ];
        let mut given = keys.iter().filter(|(_, given)| *given).map(|(key, _)| *key);
        let (first, second) = (given.next(), given.next());
        if let (Some(first), Some(second)) = (first, second) {
            check.that(false, second, || {
                format!("this order already holds '{first}': give '{second}' an order of its own")
            });
        }
        for (place, r_enu_m) in self.path_enu_m.iter().enumerate() {
            for (axis, value) in r_enu_m.iter().enumerate() {
                check.within(&format!("path_enu_m[{place}][{axis}]"), *value, FLOWN_M);
            }
        }
        for (axis, value) in self.velocity_enu_mps.iter().flatten().enumerate() {
            check.within(&format!("velocity_enu_mps[{axis}]"), *value, FLOWN_MPS);
        }
        if let Some(speed_mps) = self.speed_mps {
            check.within("speed_mps", speed_mps, 0.1..=*FLOWN_MPS.end());
            check.that(first == Some("path_enu_m"), "speed_mps", || {
                "is the speed on a path: give path_enu_m, too".to_owned()
            });
        }
        for (index, share) in self.rotors.iter().flatten().enumerate() {
            check.within(&format!("rotors[{index}]"), *share, 0.0..=1.0);
        }
        check.maybe_within("heading_deg", self.heading_deg, TURN);
        if self.heading_deg.is_some() {
            check.that(self.rotors.is_none(), "heading_deg", || {
                "an autopilot outside turns the nose by the rotors: leave it out".to_owned()
            });
        }
    }
}

/// An order given during a run that cannot be obeyed, whatever comes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("order: {path}: {message}")]
pub struct OrderError {
    /// Dotted path of the value in the order.
    pub path: String,
    /// What was found and what would be right.
    pub message: String,
}

impl Scenario {
    /// Checks an order that is given while the scenario runs, by the rules for those that stand in it.
    pub fn check_order(&self, order: &OrderConfig) -> Result<(), OrderError> {
        let mut check = Check::default();
        order.check(0.0, &self.stations(), self, &mut check);
        match check.into_problems().into_iter().next() {
            None => Ok(()),
            Some(Problem { path, message, .. }) => Err(OrderError { path, message }),
        }
    }

    /// Orders must be in order of time, and name stations and UAVs that are there.
    pub(super) fn check_orders(&self, stations: &[ResolvedStation], check: &mut Check) {
        let mut earliest_s = 0.0;
        for (index, order) in self.operator.iter().enumerate() {
            check.table(&format!("operator[{index}]"), |check| {
                order.check(earliest_s, stations, self, check);
            });
            earliest_s = order.t_s;
        }
    }
}

impl OrderConfig {
    fn check(
        &self,
        earliest_s: f64,
        stations: &[ResolvedStation],
        scenario: &Scenario,
        check: &mut Check,
    ) {
        check.within("t_s", self.t_s, 0.0..=MAX_DURATION_S);
        check.that(self.t_s >= earliest_s, "t_s", || {
            let found = self.t_s;
            format!("found {found}, before the order above it at {earliest_s}: put orders in the order of time")
        });
        if let Some(name) = &self.station {
            let names: Vec<&str> = stations.iter().map(|s| s.name.as_str()).collect();
            check.that(names.contains(&name.as_str()), "station", || {
                format!("no station '{name}'{}", suggestion(name, &names))
            });
        }
        if let Some(name) = &self.designate
            && !(scenario.distractors.iter()).any(|other| other.name == *name)
        {
            check_named_uav(check, "designate", name, &scenario.uavs);
        }
        let held = self.held();
        if let [first, second, ..] = held[..] {
            check.that(false, second, || {
                format!("this order already holds '{first}': give '{second}' an order of its own")
            });
        }
        if let Some([azimuth_deg, elevation_deg]) = self.slew_deg {
            check.within("slew_deg[0]", azimuth_deg, TURN);
            check.within("slew_deg[1]", elevation_deg, ELEVATION);
        }
        if let Some(gains) = &self.gains {
            check.table("gains", |check| gains.check(check));
        }
        if let Some(weather) = &self.weather {
            check.table("weather", |check| weather.check(check));
        }
        if let Some(drive) = &self.drive {
            check.table("drive", |check| drive.check(check));
        }
        if let Some(camera) = &self.camera {
            let meant = stations.iter().filter(|station| self.is_for(&station.name));
            check.table("camera", |check| camera.check(meant, check));
        }
        if let Some(fly) = &self.fly {
            check.table("fly", |check| fly.check(scenario, check));
        }
    }
}
