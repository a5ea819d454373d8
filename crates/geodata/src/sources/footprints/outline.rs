//! An outline of a building, and what its attributes say of its heights and place.

use super::length::{self, Loose, Reading};
use boresight_common::warning::Notes;
use glam::DVec2;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// Height of a storey [m].
const STOREY_M: f64 = 3.0; // [m]
/// Tallest building that is believed [m].
pub const TALLEST_M: f64 = 1500.0; // [m]

/// Attributes that say how high the top is [m], in the order in which they count.
const HEIGHT: [&str; 5] = [
    "height",
    "building:height",
    "measuredHeight",
    "height_m",
    "est_height",
];
/// How many storeys there are above the ground, without those of the roof.
const STOREYS: [&str; 5] = [
    "building:levels",
    "levels",
    "storeys",
    "num_floors",
    "numberOfFloorsAboveGround",
];
/// How high the bottom is [m].
const BOTTOM: [&str; 1] = ["min_height"];
/// How many storeys there would be below the bottom.
const STOREYS_BELOW: [&str; 3] = ["building:min_level", "min_level", "min_floor"];
/// How high the roof is [m].
const ROOF: [&str; 2] = ["roof:height", "roof_height"];

/// Whether attributes state how high the top is, by a height or by storeys.
pub fn states_height(known: &Map<String, Value>) -> bool {
    let mut keys = HEIGHT.iter().chain(&STOREYS);
    keys.any(|key| known.contains_key(*key))
}

/// An outline with what is known of it.
#[derive(Clone, Debug, Default)]
pub struct Footprint {
    /// Outline and holes: east or longitude, north or latitude.
    pub rings: Vec<Vec<DVec2>>,
    /// Attributes or tags.
    pub known: Map<String, Value>,
    /// What it is called in its file.
    pub name: String,
}

/// What is said of the heights of a file: how values were taken, and what was not understood.
#[derive(Debug, Default)]
pub struct Remarks {
    loose: BTreeMap<Loose, (u64, String)>,
    /// What cannot be a height, by the reason.
    refused: BTreeMap<&'static str, (u64, String)>,
    /// Buildings of which no height is stated.
    unknown: u64,
}

impl Remarks {
    fn refuse(&mut self, why: &'static str, place: impl FnOnce() -> String) {
        self.refused.entry(why).or_insert_with(|| (0, place())).0 += 1;
    }

    /// Says all of it to the notes; `unknown_m` is what stands in for a height [m].
    pub fn say(self, unknown_m: f64, notes: &mut Notes) {
        let mend = "state one number of metres";
        for (loose, (count, first)) in self.loose {
            let what = format!("{count} {} (first {first})", loose.said());
            notes.assume("heights", what, mend);
        }
        for (why, (count, first)) in self.refused {
            let what = format!("{count} {why}, taken as absent (first {first})");
            notes.assume("heights", what, mend);
        }
        if self.unknown > 0 {
            let what = format!(
                "{} buildings state none, each is {unknown_m} m high",
                self.unknown
            );
            notes.assume("heights", what, "say another with --building-height");
        }
    }
}

impl Footprint {
    /// An attribute; its name counts in any case where there is none of this very name.
    fn get(&self, key: &str) -> Option<&Value> {
        let any_case = || {
            let found = self
                .known
                .iter()
                .find(|(name, _)| name.eq_ignore_ascii_case(key));
            found.map(|(_, value)| value)
        };
        self.known.get(key).or_else(any_case)
    }

    /// The first of some attributes that holds a number that `read` understands; what it does not is said.
    fn number(
        &self,
        keys: &[&str],
        read: fn(&str) -> Option<Reading>,
        remarks: &mut Remarks,
    ) -> Option<f64> {
        keys.iter().find_map(|key| {
            let value = self.get(key)?;
            let place = || format!("{}, {key}={}", self.name, short(value));
            let found = match value {
                Value::Null => return None,
                Value::String(text) if text.trim().is_empty() => return None,
                Value::Number(number) => {
                    number.as_f64().map(|value| Reading { value, loose: None })
                }
                Value::String(text) => read(text),
                _ => None,
            };
            let believed =
                |found: &Reading| found.value.is_finite() && found.value.abs() <= TALLEST_M;
            let Some(found) = found.filter(believed) else {
                remarks.refuse("that are not understood", place);
                return None;
            };
            if let Some(loose) = found.loose {
                remarks.loose.entry(loose).or_insert_with(|| (0, place())).0 += 1;
            }
            Some(found.value)
        })
    }

    /// Height of its lowest and highest part above the ground, and of its roof [m]; what is assumed is said to `remarks`.
    pub fn heights_m(&self, unknown_m: f64, remarks: &mut Remarks) -> [f64; 3] {
        let length =
            |keys: &[&str], remarks: &mut Remarks| self.number(keys, length::length_m, remarks);
        let storeys = |keys: &[&str], remarks: &mut Remarks| {
            self.number(keys, length::count, remarks)
                .map(|n| n * STOREY_M)
        };
        let low = length(&BOTTOM, remarks).or_else(|| storeys(&STOREYS_BELOW, remarks));
        let roof = length(&ROOF, remarks).or_else(|| storeys(&["roof:levels"], remarks));
        let roof = roof.unwrap_or(0.0).max(0.0);
        let low = low.unwrap_or(0.0).max(0.0);
        let above = |high: f64, remarks: &mut Remarks| {
            let why = match high > 0.0 {
                _ if high > low => return Some(high),
                true => "not above their min_height",
                false => "of 0 or less",
            };
            remarks.refuse(why, || format!("{}, {high} m", self.name));
            None
        };
        let high = length(&HEIGHT, remarks).and_then(|high| above(high, remarks));
        // Storeys are counted without those of the roof.
        let high = high.or_else(|| {
            let high = storeys(&STOREYS, remarks)? + roof;
            above(high, remarks)
        });
        let high = high.unwrap_or_else(|| {
            remarks.unknown += 1;
            low + unknown_m
        });
        [low, high, roof.min(high - low)]
    }

    /// Whether all of it lies under the ground or under water, as far as its attributes say.
    pub fn is_underground(&self) -> bool {
        let text = |key: &str| self.get(key).and_then(text_of);
        let said = |key: &str, words: &[&str]| {
            text(key).is_some_and(|found| words.contains(&found.trim().to_lowercase().as_str()))
        };
        if said(
            "location",
            &["overground", "surface", "roof", "rooftop", "overhead"],
        ) {
            return false;
        }
        if said(
            "location",
            &[
                "underground",
                "underwater",
                "subsurface",
                "indoor_underground",
            ],
        ) || ["underground", "is_underground", "tunnel"]
            .iter()
            .any(|key| said(key, &["yes", "true", "1"]))
        {
            return true;
        }
        let levels = |key: &str| text(key).and_then(|text| levels(&text));
        let top = |key: &str| levels(key).map(|[_, high]| high);
        // Where a level or a height puts some of it above the ground, a layer says only what it passes under.
        let below = ["level", "max_level", "building:max_level"]
            .iter()
            .find_map(|key| top(key));
        if let Some(top) = below {
            return top < 0.0;
        }
        let quiet = &mut Remarks::default();
        let storeys = STOREYS.iter().find_map(|key| top(key));
        let none = storeys.is_some_and(|n| n <= 0.0);
        let cellars = ["building:levels:underground", "num_floors_underground"];
        let under = |key: &&str| top(key).is_some_and(|n| n < 0.0);
        let height_m = self.number(&HEIGHT, length::length_m, quiet);
        let roof = self
            .number(&["roof:levels"], length::count, quiet)
            .is_some_and(|n| n > 0.0);
        let stands = height_m.is_some_and(|m| m > 0.0) || roof;
        let has_cellars = cellars
            .iter()
            .find_map(|key| top(key))
            .is_some_and(|n| n > 0.0);
        if none && !stands && (has_cellars || STOREYS_BELOW.iter().any(under)) {
            return true;
        }
        let bottom_m = self.number(&BOTTOM, length::length_m, quiet);
        if height_m.is_some_and(|m| m <= 0.0) && bottom_m.is_some_and(|m| m < 0.0) {
            return true;
        }
        let stands = stands || storeys.is_some_and(|n| n > 0.0);
        !stands && top("layer").is_some_and(|layer| layer < 0.0)
    }

    /// A text among its attributes.
    pub fn text(&self, key: &str) -> Option<&str> {
        self.get(key)?.as_str().map(str::trim)
    }
}

/// A value's text.
fn text_of(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Number(_) | Value::Bool(_) => Some(value.to_string()),
        _ => None,
    }
}

/// The start of a value, for messages.
fn short(value: &Value) -> String {
    const MOST: usize = 40; // [character]
    let text = text_of(value).unwrap_or_else(|| value.to_string());
    text.chars().take(MOST).collect()
}

/// The lowest and the highest of levels as OpenStreetMap writes them: `-1`, `-2;-1`, `-2--1`, `0-3`.
fn levels(text: &str) -> Option<[f64; 2]> {
    let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
    for part in text.split([';', ',']).map(str::trim) {
        // A sign may follow the dash of a range.
        let dash = part
            .char_indices()
            .skip(1)
            .find(|(_, c)| *c == '-')
            .map(|(at, _)| at);
        let parts = match dash {
            Some(at) => [&part[..at], &part[at + 1..]],
            None => [part, part],
        };
        for level in parts {
            let level: f64 = level.trim().parse().ok()?;
            ends = [ends[0].min(level), ends[1].max(level)];
        }
    }
    ends[1].is_finite().then_some(ends)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn footprint(known: Value) -> Footprint {
        Footprint {
            known: known.as_object().cloned().unwrap_or_default(),
            name: "way 1".into(),
            ..Footprint::default()
        }
    }

    #[test]
    fn what_lies_under_the_ground_is_known_by_its_tags() {
        for (known, under) in [
            (json!({"location": "underground"}), true),
            (json!({"location": "underwater", "height": 5}), true),
            (json!({"layer": "-1"}), true),
            (json!({"layer": -1, "height": "45"}), false),
            (json!({"layer": "-1", "building:levels": "4"}), false),
            (json!({"layer": "-1", "building:levels": "0"}), true),
            (json!({"layer": "-1", "location": "surface"}), false),
            (json!({"layer": "-1", "level": "-1;0"}), false),
            (json!({"layer": "1"}), false),
            (json!({"level": "-2--1"}), true),
            (json!({"level": "-1-3"}), false),
            (json!({"max_level": "-1", "min_level": "-3"}), true),
            (
                json!({"building:levels": "0", "building:levels:underground": "2"}),
                true,
            ),
            (
                json!({"building:levels": "0", "building:levels:underground": "2", "roof:levels": "1"}),
                false,
            ),
            (
                json!({"building:levels": "2", "building:levels:underground": "1"}),
                false,
            ),
            (json!({"min_height": -6, "height": 0}), true),
            (json!({"min_height": -6, "height": 4}), false),
            (json!({"tunnel": "yes"}), true),
            (json!({"tunnel": "building_passage"}), false),
            (json!({"is_underground": true}), true),
            (json!({"is_underground": false}), false),
            (json!({"height": 10}), false),
            (json!({}), false),
        ] {
            assert_eq!(footprint(known.clone()).is_underground(), under, "{known}");
        }
    }

    #[test]
    fn heights_fall_back_and_what_is_not_understood_is_counted() {
        let mut remarks = Remarks::default();
        for (known, want_m) in [
            (
                json!({"height": "tall", "building:levels": "2.5"}),
                [0.0, 7.5, 0.0],
            ),
            (json!({"height": -1, "num_floors": 3}), [0.0, 9.0, 0.0]),
            (json!({"height": "", "est_height": "20"}), [0.0, 20.0, 0.0]),
            (json!({"HEIGHT": 11}), [0.0, 11.0, 0.0]),
            (json!({"height": 5, "min_height": 6}), [6.0, 14.0, 0.0]),
            (json!({"height": "8-10"}), [0.0, 9.0, 0.0]),
            (json!({"height": null}), [0.0, 8.0, 0.0]),
        ] {
            assert_eq!(
                footprint(known.clone()).heights_m(8.0, &mut remarks),
                want_m,
                "{known}"
            );
        }
        let mut notes = Notes::default();
        remarks.say(8.0, &mut notes);
        let said: Vec<_> = (notes.warnings(std::path::Path::new("a")).iter())
            .map(|warning| warning.what.clone())
            .collect();
        assert_eq!(
            said,
            [
                "1 given as ranges, of which the middle is taken (first way 1, height=8-10)",
                "1 not above their min_height, taken as absent (first way 1, 5 m)",
                "1 of 0 or less, taken as absent (first way 1, -1 m)",
                "1 that are not understood, taken as absent (first way 1, height=tall)",
                "2 buildings state none, each is 8 m high",
            ]
        );
    }
}
