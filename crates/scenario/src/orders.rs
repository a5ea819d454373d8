//! What an operator, or a controller outside, may order.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Scenario;
use super::air::{VISIBILITY_M, WIND_FROM_DEG, WIND_MPS};
use super::check::{Check, ELEVATION, MAX_DURATION_S, Problem, TURN};
use super::control::Gains;
use super::load::suggestion;
use super::search::check_named_uav;
use super::station::ResolvedStation;

/// More than any gimbal turns, and any mirror deflects: the mount's own limits hold below these.
const MOST_DRIVEN_DEGPS: f64 = 3_600.0; // [deg/s]
const MOST_DRIVEN_URAD: f64 = 1e6; // [µrad]

/// What an operator orders: a target by `designate` or by `track`, fire, a direction, a pointing law, gains,
/// weather, or gimbal and mirror driven from outside, one of them in an order; without any the choice goes back to the tracker.
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
    /// Name of the station that obeys; absent: every one.
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
    }
}
