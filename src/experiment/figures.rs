//! Figures of a run by their keys in `summary.json`, such as `uavs.intruder.neutralised_s`.

use crate::report::statistics::MissStats;
use crate::report::summary::{MissDistances, ObjectSummary, StationSummary, Summary};
use crate::report::uavs::{CrashSummary, DealingSummary, SightSummary, UavSummary};
use crate::scenario::{Scenario, suggestion};
use serde_json::{Map, Value, json};

/// What finds an element of a list beside its place.
const NAMES: [&str; 2] = ["name", "identity"];

/// The figure at a key: tables and lists by their keys with dots between, an element of a list by its name or its
/// place from 0. A list has `count`, one of numbers also `least`, `most` and `mean`. What the run does not have is
/// null, and so is all below it; `Err`: the keys that would have been right.
pub fn figure(summary: &Value, key: &str) -> Result<Value, Vec<String>> {
    if key.is_empty() {
        return Ok(summary.clone());
    }
    // A name may hold dots itself.
    let after = |name: &str| match key.strip_prefix(name)? {
        "" => Some(""),
        rest => rest.strip_prefix('.'),
    };
    match summary {
        Value::Null => Ok(Value::Null),
        Value::Object(table) => {
            let found = (table.iter()).find_map(|(name, value)| Some((value, after(name)?)));
            let (value, rest) = found.ok_or_else(|| table.keys().cloned().collect::<Vec<_>>())?;
            figure(value, rest)
        }
        Value::Array(list) => {
            let found = list.iter().enumerate().find_map(|(index, element)| {
                let by_name = name_of(element).and_then(after);
                Some((element, by_name.or_else(|| after(&index.to_string()))?))
            });
            if let Some((element, rest)) = found {
                return figure(element, rest);
            }
            let numbers: Vec<f64> = list.iter().filter_map(Value::as_f64).collect();
            match key {
                "count" => Ok(json!(list.len())),
                "least" => Ok(json!(numbers.iter().copied().reduce(f64::min))),
                "most" => Ok(json!(numbers.iter().copied().reduce(f64::max))),
                "mean" if numbers.is_empty() => Ok(Value::Null),
                "mean" => Ok(json!(numbers.iter().sum::<f64>() / numbers.len() as f64)),
                // The place of an element that this run does not have.
                _ if key.split('.').next().is_some_and(is_place) => Ok(Value::Null),
                _ => {
                    let own = ["count", "least", "most", "mean"].map(String::from);
                    let names = list.iter().filter_map(name_of).map(str::to_owned);
                    Err(names.chain(own).collect())
                }
            }
        }
        _ => Err(Vec::new()),
    }
}

/// The name of a list's element.
fn name_of(element: &Value) -> Option<&str> {
    NAMES.iter().find_map(|key| element.get(key)?.as_str())
}

fn is_place(word: &str) -> bool {
    word.parse::<usize>().is_ok()
}

/// What a figure is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A number.
    Number,
    /// A word or a sentence.
    Text,
}

/// Least and most that a figure can be: counts, times, energies and distances are not negative. A figure that can be is
/// named here.
pub fn range(key: &str) -> [f64; 2] {
    let mut parts = key.split('.');
    match parts.next_back().unwrap_or(key) {
        // From 0 to 1.
        "best_score" | "wanted_score" => [0.0, 1.0],
        // Of a picture of 8 bits.
        "grey_level" => [0.0, 255.0],
        "sun_elevation_deg" => [-90.0, 90.0],
        "count" => [0.0, f64::INFINITY],
        // Coordinates, which have their places.
        _ if parts.next_back() == Some("r_enu_m") => [f64::NEG_INFINITY, f64::INFINITY],
        _ => [0.0, f64::INFINITY],
    }
}

/// Figures of wall-clock time: no two runs share them.
const WALL_CLOCK: [&str; 2] = ["real_time_factor", "share"];

/// Lists whose elements are not known before the run, by the keys that lead to them; the sample has one element of each.
const GROWING: [&str; 7] = [
    "kill_to_shot_s",
    "objects",
    "objects.stations",
    "objects.engaged_by",
    "stations.lost_s",
    "stations.kill_to_shot_s",
    "uavs.stations.refused",
];

/// What the figure of this key is in the runs of a scenario; what is wrong with the key if they have none.
pub fn kind(key: &str, scenario: &Scenario) -> Result<Kind, String> {
    let first = key.split('.').next().unwrap_or(key);
    if WALL_CLOCK.contains(&first) {
        return Err(format!(
            "'{key}' is wall-clock time, which is another in every run: leave it out"
        ));
    }
    sampled(&sample(scenario), key, "").map_err(|known| {
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        let last = key.rsplit('.').next().unwrap_or(key);
        match known[..] {
            [] => format!("no figure '{key}': what stands before the last dot has no parts"),
            _ => format!("no figure '{key}'{}", suggestion(last, &known)),
        }
    })
}

/// The kind of what stands at a key of the sample, whose own keys are `above`; `Err`: what would have been right.
fn sampled(sample: &Value, key: &str, above: &str) -> Result<Kind, Vec<String>> {
    let inside = |name: &str| match above {
        "" => name.to_owned(),
        _ => format!("{above}.{name}"),
    };
    let keys = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    match (sample, key) {
        (Value::Object(table), "") => Err(table.keys().cloned().collect()),
        (Value::Object(table), _) => {
            let (name, rest) = key.split_once('.').unwrap_or((key, ""));
            match table.get(name) {
                Some(value) => sampled(value, rest, &inside(name)),
                None => Err(table.keys().cloned().collect()),
            }
        }
        (Value::Array(list), _) => {
            let of_all = match list.first() {
                Some(Value::Number(_)) if list.iter().all(Value::is_number) => {
                    &["count", "least", "most", "mean"][..]
                }
                _ => &["count"],
            };
            if of_all.contains(&key) {
                return Ok(Kind::Number);
            }
            let named: Vec<(&str, &Value)> = (list.iter())
                .filter_map(|element| Some((name_of(element)?, element)))
                .collect();
            let (word, rest) = key.split_once('.').unwrap_or((key, ""));
            let own = || {
                named
                    .iter()
                    .map(|(name, _)| *name)
                    .chain(of_all.iter().copied())
            };
            match word.parse::<usize>() {
                // Any place of a list that grows is like its first.
                Ok(_) if GROWING.contains(&above) => {
                    // What is a list itself has so many elements.
                    let fixed = format!("{above}.");
                    let above = if list[0].is_array() { &fixed } else { above };
                    sampled(&list[0], rest, above)
                }
                Ok(place) => match list.get(place) {
                    Some(element) => sampled(element, rest, above),
                    None => Err(own().map(str::to_owned).collect()),
                },
                // Identities are not known before the run, and may hold dots.
                Err(_) if above == "objects" && !word.is_empty() => {
                    let parts = key.match_indices('.').map(|(at, _)| &key[at + 1..]);
                    let kinds = parts.map(|rest| sampled(&list[0], rest, above));
                    kinds
                        .reduce(|first, next| first.or(next))
                        .unwrap_or_else(|| Err(keys(of_all)))
                }
                Err(_) => {
                    let found = named.iter().find_map(|(name, element)| {
                        let rest = match key.strip_prefix(name)? {
                            "" => "",
                            rest => rest.strip_prefix('.')?,
                        };
                        Some((*element, rest))
                    });
                    match found {
                        Some((element, rest)) => sampled(element, rest, above),
                        None => Err(own().map(str::to_owned).collect()),
                    }
                }
            }
        }
        (Value::Number(_), "") => Ok(Kind::Number),
        (_, "") => Ok(Kind::Text),
        _ => Err(Vec::new()),
    }
}

/// A summary of a scenario's run that has every figure.
fn sample(scenario: &Scenario) -> Value {
    let time = Some(0.0);
    let miss = Some(MissStats::default());
    let summary = Summary {
        time_to_acquire_s: time,
        time_to_neutralise_s: time,
        stopped_s: time,
        energy_per_neutralised_j: time,
        kill_to_shot_s: vec![0.0],
        miss_distance_px: MissDistances {
            coarse: miss,
            precise: miss,
        },
        uavs: (scenario.uavs.iter())
            .map(|uav| uav_sample(&uav.name, scenario))
            .collect(),
        stations: (scenario.stations().into_iter())
            .map(|station| StationSummary {
                name: station.name,
                acquired_s: time,
                energy_j: 0.0,
                dwell_s: 0.0,
                distractor_s: 0.0,
                keep_out_s: 0.0,
                wrong_object_s: 0.0,
                lost_s: vec![0.0],
                kill_to_shot_s: vec![0.0],
            })
            .collect(),
        objects: vec![ObjectSummary {
            stations: vec![String::new()],
            engaged_by: vec![(0.0, String::new())],
            ..ObjectSummary::default()
        }],
        ..Summary::default()
    };
    serde_json::to_value(summary).unwrap_or_else(|_| Value::Object(Map::new()))
}

/// A UAV's part of a summary that has every figure.
fn uav_sample(name: &str, scenario: &Scenario) -> UavSummary {
    let number = Some(0.0);
    let stations = scenario.stations();
    let sight = |(first, station, camera): (bool, &str, &str)| SightSummary {
        name: match first {
            true => camera.to_owned(),
            false => format!("{station}/{camera}"),
        },
        largest_px: number,
        typical_px: number,
        contrast: number,
        grey_level: number,
        best_score: number,
        wanted_score: number,
        ..SightSummary::default()
    };
    let cameras = stations.iter().enumerate().flat_map(|(index, station)| {
        let all = station.config.cameras.all().into_iter();
        all.map(move |camera| sight((index == 0, &station.name, &camera.name)))
    });
    UavSummary {
        name: name.to_owned(),
        neutralised_s: number,
        at_asset_s: number,
        acquired_s: number,
        crash: Some(CrashSummary::default()),
        why: Some(String::new()),
        cameras: cameras.collect(),
        stations: (stations.iter())
            .map(|station| DealingSummary {
                name: station.name.clone(),
                refused: vec![(String::new(), 0.0)],
                ..DealingSummary::default()
            })
            .collect(),
        ..UavSummary::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn summary() -> Value {
        json!({
            "outcome": "tracked",
            "time_to_acquire_s": null,
            "miss_distance_px": { "coarse": null, "precise": { "p95": 2.0 } },
            "uavs": [{ "name": "a.b", "dwell_s": 1.0 }, { "name": "c", "dwell_s": 2.0 }],
            "stations": [{ "name": "yard", "kill_to_shot_s": [2.0, 4.0, 3.0], "lost_s": [] }],
        })
    }

    #[test]
    fn figures_are_found_by_key_name_and_place() {
        for (key, wanted) in [
            ("outcome", json!("tracked")),
            ("time_to_acquire_s", Value::Null),
            ("miss_distance_px.precise.p95", json!(2.0)),
            ("miss_distance_px.coarse.p95", Value::Null),
            ("uavs.a.b.dwell_s", json!(1.0)),
            ("uavs.1.dwell_s", json!(2.0)),
            ("uavs.7.dwell_s", Value::Null),
            ("uavs.count", json!(2)),
            ("stations.yard.kill_to_shot_s.1", json!(4.0)),
            ("stations.yard.kill_to_shot_s.most", json!(4.0)),
            ("stations.yard.kill_to_shot_s.least", json!(2.0)),
            ("stations.yard.kill_to_shot_s.mean", json!(3.0)),
            ("stations.yard.lost_s.count", json!(0)),
            ("stations.yard.lost_s.most", Value::Null),
        ] {
            assert_eq!(figure(&summary(), key), Ok(wanted), "{key}");
        }
        assert!(figure(&summary(), "uavs.d.dwell_s").is_err());
        assert!(figure(&summary(), "outcome.x").is_err());
    }

    #[test]
    fn figures_know_what_they_can_be() {
        for (key, wanted) in [
            ("leakers", [0.0, f64::INFINITY]),
            ("stations.yard.kill_to_shot_s.mean", [0.0, f64::INFINITY]),
            ("uavs.0.stations.0.refused.3.1", [0.0, f64::INFINITY]),
            ("uavs.0.cameras.0.best_score", [0.0, 1.0]),
            ("light.sun_elevation_deg", [-90.0, 90.0]),
            ("uavs.0.crash.r_enu_m.2", [f64::NEG_INFINITY, f64::INFINITY]),
            (
                "uavs.0.crash.r_enu_m.least",
                [f64::NEG_INFINITY, f64::INFINITY],
            ),
            ("uavs.0.crash.r_enu_m.count", [0.0, f64::INFINITY]),
        ] {
            assert_eq!(range(key), wanted, "{key}");
        }
    }

    #[test]
    fn a_key_that_no_run_has_is_refused() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/two_stations.toml");
        let scenario = Scenario::load(&path, &[]).unwrap().scenario;
        for key in [
            "dwell_s",
            "miss_distance_px.precise.p95",
            "uavs.0.neutralised_s",
            "stations.tower.kill_to_shot_s.most",
            "objects.count",
            "objects.yard 1.longest_gap_s",
            "objects.y.a 1.engaged_by.count",
            "objects.7.engaged_by.3.0",
            "stations.0.lost_s.3",
            "stations.tower.kill_to_shot_s.9",
            "uavs.0.cameras.0.in_view_s",
            "uavs.0.cameras.stv.largest_px",
            "uavs.0.stations.tower.hidden_s",
            "uavs.0.stations.0.refused.3.1",
            "uavs.0.crash.t_s",
            "light.illuminance_lx",
        ] {
            assert_eq!(kind(key, &scenario), Ok(Kind::Number), "{key}");
        }
        for key in [
            "outcome",
            "uavs.0.status",
            "uavs.0.why",
            "uavs.0.crash.into",
            "uavs.0.stations.0.refused.3.0",
            "objects.0.engaged_by.1.1",
            "objects.2.stations.5",
        ] {
            assert_eq!(kind(key, &scenario), Ok(Kind::Text), "{key}");
        }
        for (key, hint) in [
            ("dwel_s", "did you mean 'dwell_s'"),
            ("stations.towr.dwell_s", "tower"),
            ("miss_distance_px.precise", "p95"),
            ("stations.tower.lost_s", "count"),
            ("dwell_s.mean", "has no parts"),
            ("uavs.7.dwell_s", "no figure 'uavs.7.dwell_s'"),
            ("uavs.mean", "count"),
            ("stations.2.dwell_s", "tower"),
            ("objects.0.engaged_by.0.2", "no figure"),
            ("objects.0.engaged_by.0", "count"),
            ("objects.yard 1.longest_gap", "longest_gap_s"),
            ("objects.0.stations.most", "no figure"),
            ("real_time_factor", "wall-clock"),
            ("share.render", "wall-clock"),
        ] {
            let message = kind(key, &scenario).unwrap_err();
            assert!(message.contains(hint), "{key}: {message}");
        }
    }
}
