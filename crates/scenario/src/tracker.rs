//! From detections to a target: the tracker, and the operator who overrules it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::air::{VISIBILITY_M, WIND_FROM_DEG, WIND_MPS};
use super::check::{Check, ELEVATION, FRACTION, MAX_DURATION_S, TURN};
use super::control::Gains;
use super::load::suggestion;
use super::search::check_named_uav;
use super::station::ResolvedStation;
use super::targets::{DistractorConfig, UavConfig};

/// How detections become tracks and which of them becomes the target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Tracker")]
pub struct TrackerConfig {
    /// Which detection belongs to the target; absent: "paper" with the paper's controller,
    /// "global" with any other.
    pub rule: Option<AssociationRule>,
    /// Standard deviation of a detection's centre that the tracker assumes; absent: the truth
    /// detector's noise, or 0.5 for an ONNX model.
    pub centre_sigma_px: Option<f64>,
    /// Share of its frames in which the detector must see a track for that to speak for a UAV.
    pub min_quality: f64,
    /// Score from which on a detection speaks for a UAV; absent: 0.72 for the truth
    /// detector, half way between its scores of UAVs and of distractors, and what fits the box's size for an
    /// ONNX model.
    pub min_score: Option<f64>,
    /// Another track becomes the target when it could reach the asset sooner by this factor.
    pub switch_ratio: f64,
    /// The protected asset, east, north, up from the site; absent: the station itself.
    pub asset_enu_m: Option<[f64; 3]>,
    /// A UAV that comes this close to the asset unharmed has got through.
    pub asset_radius_m: f64,
}

impl Default for TrackerConfig {
    fn default() -> Self {
        Self {
            rule: None,
            centre_sigma_px: None,
            min_quality: 0.6,
            min_score: None,
            switch_ratio: 1.5,
            asset_enu_m: None,
            asset_radius_m: 50.0,
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

/// What an operator orders: a target by `designate` or by `track`, fire, a direction, a pointing law, gains or
/// weather, one of them in an order; without any the choice goes back to the tracker.
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

impl TrackerConfig {
    pub(super) fn check(&self, check: &mut Check) {
        check.maybe_within("centre_sigma_px", self.centre_sigma_px, 0.01..=20.0);
        check.within("min_quality", self.min_quality, FRACTION);
        check.maybe_within("min_score", self.min_score, FRACTION);
        check.positive("asset_radius_m", self.asset_radius_m);
        check.within("switch_ratio", self.switch_ratio, 1.0..=f64::MAX);
    }
}

/// Orders must be in order of time, and name stations and UAVs that are there.
pub(super) fn check_orders(
    orders: &[OrderConfig],
    stations: &[ResolvedStation],
    uavs: &[UavConfig],
    distractors: &[DistractorConfig],
    check: &mut Check,
) {
    let mut earliest_s = 0.0;
    for (index, order) in orders.iter().enumerate() {
        check.table(&format!("operator[{index}]"), |check| {
            check.within("t_s", order.t_s, earliest_s..=MAX_DURATION_S);
            if let Some(name) = &order.station {
                let names: Vec<&str> = stations.iter().map(|s| s.name.as_str()).collect();
                check.that(names.contains(&name.as_str()), "station", || {
                    format!("no station '{name}'{}", suggestion(name, &names))
                });
            }
            if let Some(name) = &order.designate
                && !distractors.iter().any(|other| other.name == *name)
            {
                check_named_uav(check, "designate", name, uavs);
            }
            let held = order.held();
            if let [first, second, ..] = held[..] {
                check.that(false, second, || {
                    format!(
                        "this order already holds '{first}': give '{second}' an order of its own"
                    )
                });
            }
            if let Some([azimuth_deg, elevation_deg]) = order.slew_deg {
                check.within("slew_deg[0]", azimuth_deg, TURN);
                check.within("slew_deg[1]", elevation_deg, ELEVATION);
            }
            if let Some(gains) = &order.gains {
                check.table("gains", |check| gains.check(check));
            }
            if let Some(weather) = &order.weather {
                check.table("weather", |check| weather.check(check));
            }
        });
        earliest_s = order.t_s;
    }
}
