//! An outline of a building, and what its attributes say of its heights.

use glam::DVec2;
use serde_json::{Map, Value};

/// Height of a storey [m].
const STOREY_M: f64 = 3.0; // [m]
/// Tallest building that is believed [m].
pub const TALLEST_M: f64 = 1500.0; // [m]
/// An outline with what is known of it.
#[derive(Clone, Debug, Default)]
pub struct Footprint {
    /// Outline and holes: east or longitude, north or latitude.
    pub rings: Vec<Vec<DVec2>>,
    /// Attributes or tags.
    pub known: Map<String, Value>,
}

impl Footprint {
    /// A length among its attributes [m]: a number, `12.5`, `12.5 m`, `40 ft` or `40'`.
    pub fn length_m(&self, keys: &[&str]) -> Option<f64> {
        let one = |key: &&str| match self.known.get(*key)? {
            Value::Number(number) => number.as_f64(),
            Value::String(text) => {
                let text = text.trim().replace(',', ".");
                let end = text.find(|c: char| !(c.is_ascii_digit() || ".-+".contains(c)));
                let (number, unit) = text.split_at(end.unwrap_or(text.len()));
                let unit_m = match unit.trim() {
                    "" | "m" => 1.0,
                    "ft" | "'" | "feet" => 0.3048,
                    _ => return None,
                };
                Some(number.parse::<f64>().ok()? * unit_m)
            }
            _ => None,
        };
        keys.iter()
            .find_map(one)
            .filter(|v| v.is_finite() && v.abs() <= TALLEST_M)
    }

    /// Height of its lowest and highest part above the ground, and of its roof [m].
    pub fn heights_m(&self, unknown_m: f64) -> [f64; 3] {
        let storeys = |keys: &[&str]| self.length_m(keys).map(|n| n * STOREY_M);
        let low = self
            .length_m(&["min_height"])
            .or_else(|| storeys(&["building:min_level", "min_level"]));
        let roof = self
            .length_m(&["roof:height"])
            .or_else(|| storeys(&["roof:levels"]));
        let roof = roof.unwrap_or(0.0).max(0.0);
        let high = self.length_m(&["height", "building:height", "measuredHeight", "height_m"]);
        // Storeys are counted without those of the roof.
        let high = high.or_else(|| {
            Some(storeys(&["building:levels", "levels", "storeys", "num_floors"])? + roof)
        });
        let low = low.unwrap_or(0.0).max(0.0);
        let high = high.filter(|high| *high > low).unwrap_or(low + unknown_m);
        [low, high, roof.min(high - low)]
    }

    /// A text among its attributes.
    pub fn text(&self, key: &str) -> Option<&str> {
        self.known.get(key)?.as_str()
    }
}
