//! Searchlights and dazzlers that shine on a station.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{AT_LEAST_ZERO, Check};

/// A searchlight or dazzler: pointed at a station, on a UAV or distractor or standing somewhere. Cameras see it where
/// nothing hides it; it heats and hurts nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Light")]
pub struct LightConfig {
    /// Name, unique among the lights.
    pub name: String,
    /// The UAV or distractor that carries it; absent: it stands at `position_enu_m`.
    pub on: Option<String>,
    /// East, north, up of one that stands.
    pub position_enu_m: Option<[f64; 3]>,
    /// The station that it is pointed at; absent: the first.
    pub at: Option<String>,
    /// Luminous intensity on its axis, for a lamp of white light.
    pub candela: Option<f64>,
    /// Power, for a laser.
    pub power_w: Option<f64>,
    /// Wavelength of the laser.
    #[serde(default = "green_nm")]
    pub wavelength_nm: f64,
    /// Full width of its beam at half of the intensity.
    #[serde(default = "wide_deg")]
    pub beam_deg: f64,
    /// When it goes on.
    #[serde(default)]
    pub from_s: f64,
    /// When it goes off; absent: never.
    pub to_s: Option<f64>,
}

/// A usual dazzler's: 532 nm.
fn green_nm() -> f64 {
    532.0
}

/// A hand-held searchlight's: 4°.
fn wide_deg() -> f64 {
    4.0
}

/// Names that a light may refer to: those of all that flies, and of the stations.
pub(super) fn check(lights: &[LightConfig], flying: &[&str], stations: &[&str], check: &mut Check) {
    let mut names: Vec<&str> = Vec::new();
    for (index, light) in lights.iter().enumerate() {
        check.table(&format!("lights[{index}]"), |check| {
            check.name("name", &light.name, &names);
            let placed = light.on.is_some() != light.position_enu_m.is_some();
            check.that(placed, "on", || {
                "give one of on and position_enu_m: who carries the light, or where it stands"
                    .into()
            });
            for (key, name, known, what) in [
                ("on", &light.on, flying, "UAV or distractor"),
                ("at", &light.at, stations, "station"),
            ] {
                let Some(name) = name else { continue };
                check.that(known.contains(&name.as_str()), key, || {
                    format!("no {what} '{name}': there are {}", known.join(", "))
                });
            }
            check.that(
                light.candela.is_some() != light.power_w.is_some(),
                "candela",
                || "give one of candela (white light) and power_w (a laser)".into(),
            );
            check.maybe_within("candela", light.candela, 0.0..=1e10);
            check.maybe_within("power_w", light.power_w, 0.0..=1e4);
            check.within("wavelength_nm", light.wavelength_nm, 200.0..=12_000.0);
            check.within("beam_deg", light.beam_deg, 0.001..=90.0);
            check.within("from_s", light.from_s, AT_LEAST_ZERO);
            check.maybe_within("to_s", light.to_s, light.from_s..=f64::MAX);
        });
        names.push(&light.name);
    }
}
