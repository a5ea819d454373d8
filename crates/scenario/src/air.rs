//! Weather and optical turbulence of a scenario.

use std::ops::RangeInclusive;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::{Check, FRACTION};
use boresight_common::warning::Notes;
use boresight_models::air::atmosphere::Cn2Profile;
use boresight_models::air::metar::{Given, MetarError, Report};
use boresight_models::air::weather::Weather;
use boresight_models::air::wind::over_rough_ground;
use boresight_models::laser::propagation::{PaperPropagation, WaveSettings};

/// The weather: a METAR, explicit values, or both (an explicit value wins over the report's).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Weather")]
pub struct WeatherConfig {
    /// An aerodrome report, verbatim (METAR or SPECI); the [page of METAR](metar.md) says what is read. What it lacks
    /// (`/////KT`, `////`, `M01/`, `Q////`) is to be given beside it.
    pub metar: Option<String>,
    /// Mean wind speed 10 m above the ground, in a city above 0.7 of its mean building height; 3 without
    /// a METAR. A METAR's wind is that of open ground; the city's roughness takes about half of its speed.
    pub wind_speed_mps: Option<f64>,
    /// Direction the wind blows from, clockwise from north; 270 without a METAR.
    pub wind_from_deg: Option<f64>,
    /// Gust speed at the same height, the highest mean over 3 s in ten minutes; absent: no gusts beyond
    /// the turbulence of the mean wind.
    pub gust_mps: Option<f64>,
    /// Meteorological visibility at 550 nm, precipitation included. Absent: the METAR's, or
    /// 20,000 of haze, reduced by `precipitation_mmph`.
    pub visibility_m: Option<f64>,
    /// Air temperature; 15 without a METAR.
    pub temperature_c: Option<f64>,
    /// Relative humidity, 0 to 1; 0.5 without a METAR.
    pub relative_humidity: Option<f64>,
    /// Pressure at sea level; 1013.25 without a METAR.
    pub pressure_hpa: Option<f64>,
    /// Covered fraction of the sky, 0 to 1; 0 without a METAR.
    pub cloud_cover: Option<f64>,
    /// Height of the cloud base above the ground at the site's altitude. Under a cover of 7/8 or more
    /// nothing above it is seen or lit; absent without a METAR: the clouds are above everything.
    pub cloud_base_m: Option<f64>,
    /// Whether the covered fraction of the sky shows as clouds rather than as their mean light; they
    /// look broken below a full cover and mottled under it.
    #[serde(default)]
    pub cloud_texture: bool,
    /// Precipitation as water, snow below 1 °C, else rain; 0 without a METAR.
    pub precipitation_mmph: Option<f64>,
}

/// The weather where neither a report nor a value says otherwise: a clear, mild day with a light
/// west wind.
pub const UNREPORTED_WEATHER: Weather = Weather {
    wind_speed_mps: 3.0,
    wind_from_rad: 270f64.to_radians(),
    gust_mps: None,
    visibility_m: 20_000.0,
    temperature_k: 288.15,
    relative_humidity: 0.5,
    pressure_pa: 101_325.0,
    cloud_cover: 0.0,
    cloud_base_m: None,
    precipitation_mmph: 0.0,
    snow: false,
};

impl WeatherConfig {
    /// The weather of a run: the METAR's or the documented defaults, then the explicit values.
    pub fn resolved(&self) -> Result<Weather, MetarError> {
        let base = match &self.metar {
            Some(report) => Report::read(report)?.weather(&self.given())?,
            None => UNREPORTED_WEATHER,
        };
        let given = Weather {
            wind_speed_mps: self.wind_speed_mps.unwrap_or(base.wind_speed_mps),
            wind_from_rad: (self.wind_from_deg).map_or(base.wind_from_rad, f64::to_radians),
            gust_mps: self.gust_mps.or(base.gust_mps),
            visibility_m: self.visibility_m.unwrap_or(base.visibility_m),
            temperature_k: (self.temperature_c).map_or(base.temperature_k, |c| c + 273.15),
            relative_humidity: self.relative_humidity.unwrap_or(base.relative_humidity),
            pressure_pa: (self.pressure_hpa).map_or(base.pressure_pa, |hpa| 100.0 * hpa),
            cloud_cover: self.cloud_cover.unwrap_or(base.cloud_cover),
            cloud_base_m: self.cloud_base_m.or(base.cloud_base_m),
            ..base
        };
        Ok(match (self.precipitation_mmph, self.visibility_m) {
            (None, _) => given,
            (Some(rate_mmph), None) => given.with_precipitation(rate_mmph),
            (Some(rate_mmph), Some(visibility_m)) => Weather {
                visibility_m,
                ..given.with_precipitation(rate_mmph)
            },
        })
    }

    /// The explicit values, in the units of a report's weather.
    fn given(&self) -> Given {
        Given {
            wind_speed_mps: self.wind_speed_mps,
            wind_from_rad: self.wind_from_deg.map(f64::to_radians),
            visibility_m: self.visibility_m,
            temperature_c: self.temperature_c,
            relative_humidity: self.relative_humidity,
            pressure_pa: self.pressure_hpa.map(|hpa| 100.0 * hpa),
            cloud_cover: self.cloud_cover,
        }
    }

    /// What is taken where the report leaves something open that no explicit value states.
    pub fn notes(&self) -> Notes {
        let mut notes = Notes::default();
        let report = self.metar.as_deref().map(Report::read);
        for assumed in report
            .into_iter()
            .flatten()
            .flat_map(|report| report.assumed)
        {
            let mend = match assumed.key {
                Some(key) if self.states(key) => continue,
                Some(key) => format!("say it with weather.{key}"),
                None => "leave it out of the report if it should not count".into(),
            };
            let what = format!("\"{}\" {}", assumed.group, assumed.what);
            notes.assume("weather.metar", what, mend);
        }
        notes
    }

    /// Whether an explicit value is there that a report may leave open.
    fn states(&self, key: &str) -> bool {
        let value = match key {
            "wind_speed_mps" => self.wind_speed_mps,
            "wind_from_deg" => self.wind_from_deg,
            "gust_mps" => self.gust_mps,
            "visibility_m" => self.visibility_m,
            "temperature_c" => self.temperature_c,
            "pressure_hpa" => self.pressure_hpa,
            "cloud_cover" => self.cloud_cover,
            "cloud_base_m" => self.cloud_base_m,
            "precipitation_mmph" => self.precipitation_mmph,
            _ => None,
        };
        value.is_some()
    }

    /// The resolved weather at a site of roughness length `roughness_m` [m]: a report's wind is that
    /// of open ground, explicit values are the site's own.
    pub fn at_site(&self, resolved: Weather, roughness_m: f64) -> Weather {
        if self.metar.is_none() {
            return resolved;
        }
        let (reported_mps, gust_mps) = (resolved.wind_speed_mps, resolved.gust_mps);
        let (wind_speed_mps, gust_mps) = over_rough_ground(reported_mps, gust_mps, roughness_m);
        Weather {
            wind_speed_mps: self.wind_speed_mps.unwrap_or(wind_speed_mps),
            gust_mps: self.gust_mps.or(gust_mps),
            ..resolved
        }
    }
}

/// Optical turbulence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Turbulence {
    /// Refractive-index structure constant Cn² in m^(-2/3), at the profile's own ground: 1e-15 is
    /// calm, 1e-14 an ordinary day, 1e-13 a hot roof.
    pub cn2_ground: f64,
    /// How the structure constant falls with height.
    pub profile: TurbulenceProfile,
    /// Outer scale L0 in m: larger eddies carry no more. Near the ground some 0.4 of the height; inf for none.
    pub outer_scale_m: f64,
    /// Inner scale l0 in m, of the propagation "wave": smaller eddies are dissolved. Near the ground some millimetres.
    pub inner_scale_m: f64,
    /// How the laser's beam crosses the air: "scaling" moves a Gaussian by theory, "wave" sends the wave itself through screens
    /// that the wind carries, "paper" is the paper's equation 7, a geometric Brownian motion that never becomes stationary;
    /// or one of your own.
    pub propagation: String,
    /// Drift γ of "paper" in 1/s: its mean intensity falls as e^(-γ t). The paper prints no value.
    pub paper_drift: f64,
    /// Volatility σ of "paper" in 1/√s: its logarithm has the variance σ² t. The paper prints no value.
    pub paper_volatility: f64,
    /// Whether cameras see through the turbulence: what they see is shifted, warped and blurred frame by frame, by the air up to
    /// it. A truth detector's places are shifted alike, and the beam of "scaling" wanders as the image does. Without, a picture
    /// has one blur, a long exposure's over a level kilometre.
    pub imaging: bool,
    /// How finely "wave" is followed.
    pub wave: WaveConfig,
}

/// How finely the propagation "wave" is followed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WaveConfig {
    /// Times a second that the wave is sent through the air, in Hz: a divisor of the tick rate.
    pub rate_hz: u32,
    /// Radius of the clear aperture over the beam's 1/e² radius.
    pub clear_ratio: f64,
}

impl Default for WaveConfig {
    fn default() -> Self {
        let WaveSettings {
            rate_hz,
            clear_ratio,
        } = WaveSettings::default();
        Self {
            rate_hz,
            clear_ratio,
        }
    }
}

impl Default for Turbulence {
    fn default() -> Self {
        Self {
            cn2_ground: 1e-14,
            profile: TurbulenceProfile::Urban,
            outer_scale_m: 20.0,  // [m]
            inner_scale_m: 0.005, // [m]
            propagation: "scaling".into(),
            paper_drift: 0.0,
            paper_volatility: 0.1,
            imaging: true,
            wave: WaveConfig::default(),
        }
    }
}

/// Height profile of the refractive-index structure constant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TurbulenceProfile {
    /// Falls with height above the roofs by time of day; the ground value holds 10 m above the
    /// displacement height, which is 0.7 of the mean building height.
    Urban,
    /// Hufnagel–Valley with a pseudo-wind of 21 m/s and the ground value.
    HufnagelValley,
    /// The ground value everywhere.
    Constant,
}

impl Turbulence {
    /// The profile over a city of mean building height `building_height_m` [m], by `day` or night.
    pub fn cn2_profile(&self, building_height_m: f64, day: bool) -> Cn2Profile {
        match self.profile {
            TurbulenceProfile::Constant => Cn2Profile::Constant(self.cn2_ground),
            TurbulenceProfile::HufnagelValley => Cn2Profile::HufnagelValley {
                wind_mps: 21.0, // [m/s]
                ground: self.cn2_ground,
            },
            TurbulenceProfile::Urban => Cn2Profile::Urban {
                cn2_ref: self.cn2_ground,
                height_ref_m: 10.0, // [m]
                displacement_m: 0.7 * building_height_m,
                day,
            },
        }
    }
}

/// What the mean wind and the visibility may be.
pub(super) const WIND_MPS: RangeInclusive<f64> = 0.0..=60.0; // [m/s]
pub(super) const WIND_FROM_DEG: RangeInclusive<f64> = 0.0..=360.0; // [deg]
pub(super) const VISIBILITY_M: RangeInclusive<f64> = 10.0..=400_000.0; // [m]

impl WeatherConfig {
    pub(super) fn check(&self, check: &mut Check) {
        check.maybe_within("wind_speed_mps", self.wind_speed_mps, WIND_MPS);
        check.maybe_within("wind_from_deg", self.wind_from_deg, WIND_FROM_DEG);
        check.maybe_within("gust_mps", self.gust_mps, 0.0..=90.0);
        check.maybe_within("visibility_m", self.visibility_m, VISIBILITY_M);
        check.maybe_within("temperature_c", self.temperature_c, -90.0..=60.0);
        check.maybe_within("relative_humidity", self.relative_humidity, FRACTION);
        check.maybe_within("pressure_hpa", self.pressure_hpa, 850.0..=1100.0);
        check.maybe_within("cloud_cover", self.cloud_cover, FRACTION);
        check.maybe_within("cloud_base_m", self.cloud_base_m, 0.0..=20_000.0);
        check.maybe_within("precipitation_mmph", self.precipitation_mmph, 0.0..=500.0);
        match self.resolved() {
            Ok(weather) => {
                let (wind, gust) = (weather.wind_speed_mps, weather.gust_mps);
                check.that(gust.is_none_or(|gust| gust >= wind), "gust_mps", || {
                    format!("is below the mean wind speed of {wind} m/s")
                });
                let meaningful = self.cloud_base_m.is_none() || weather.ceiling_m().is_some();
                check.that(meaningful, "cloud_base_m", || {
                    format!(
                        "has no effect with a cloud_cover of {}: only a cover of 0.875 or more \
                         hides what is above its base",
                        weather.cloud_cover
                    )
                });
            }
            Err(error) => check.that(false, "metar", || error.to_string()),
        }
    }
}

impl Turbulence {
    pub(super) fn check(&self, check: &mut Check) {
        check.within("cn2_ground", self.cn2_ground, 0.0..=1e-10);
        check.within("outer_scale_m", self.outer_scale_m, 0.1..=f64::INFINITY);
        check.within("inner_scale_m", self.inner_scale_m, 0.0..=0.1);
        check.within("wave.clear_ratio", self.wave.clear_ratio, 0.5..=10.0);
        check.within(
            "paper_drift",
            self.paper_drift,
            PaperPropagation::DRIFT_RANGE_PER_S,
        );
        check.within(
            "paper_volatility",
            self.paper_volatility,
            PaperPropagation::VOLATILITY_RANGE_PER_SQRT_S,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scenario;
    use boresight_models::air::weather::OPEN_VISIBILITY_M;
    use std::path::Path;

    fn of(metar: &str) -> WeatherConfig {
        WeatherConfig {
            metar: Some(metar.into()),
            ..WeatherConfig::default()
        }
    }

    fn told(weather: &WeatherConfig) -> Vec<String> {
        let warnings = weather.notes().warnings(Path::new("s.toml"));
        warnings.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn visibility_without_directions_is_open() {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
            .join("../shared/data/odd/metar-9999ndv.toml");
        if !path.exists() {
            println!("skipped: no ../shared/data/odd");
            return;
        }
        let loaded = Scenario::load(&path, &[]).unwrap();
        let weather = loaded.scenario.weather.resolved().unwrap();
        assert_eq!(weather.visibility_m, OPEN_VISIBILITY_M);
        assert_eq!((weather.wind_speed_mps, weather.gust_mps), (0.0, None));
        assert_eq!((weather.cloud_cover, weather.pressure_pa), (1.0, 100_100.0));
        assert_eq!(told(&loaded.scenario.weather), Vec::<String>::new());
    }

    #[test]
    fn an_explicit_value_stands_in_for_what_a_report_lacks() {
        let lacking = of("METAR EGPF 171220Z AUTO /////KT 4000NDV // ////// 11/ Q////");
        let error = lacking.resolved().unwrap_err().to_string();
        assert!(error.contains("weather.wind_speed_mps"), "{error}");
        let whole = WeatherConfig {
            wind_speed_mps: Some(7.0),
            wind_from_deg: Some(180.0),
            relative_humidity: Some(0.7),
            pressure_hpa: Some(990.0),
            ..lacking
        };
        let weather = whole.resolved().unwrap();
        let found = [
            weather.wind_speed_mps,
            weather.wind_from_rad.to_degrees(),
            weather.visibility_m,
            weather.temperature_k,
            weather.relative_humidity,
            weather.pressure_pa,
        ];
        assert_eq!(found, [7.0, 180.0, 4000.0, 284.15, 0.7, 99_000.0]);
        // And wins over what it states.
        let both = WeatherConfig {
            visibility_m: Some(1500.0),
            temperature_c: Some(-3.0),
            ..whole
        };
        let weather = both.resolved().unwrap();
        assert_eq!(
            (weather.visibility_m, weather.temperature_k),
            (1500.0, 270.15)
        );
    }

    #[test]
    fn what_a_report_leaves_open_is_told_until_a_value_states_it() {
        let open = of("EDDF 171220Z VRB02KT 9999 // NSC 11/04 Q1013");
        let expected = [
            "s.toml: weather.metar: \"VRB02KT\" gives no direction of the wind: from the north is taken; say it with \
             weather.wind_from_deg",
            "s.toml: weather.metar: \"//\" means that the station cannot tell the weather: no precipitation is taken; \
             say it with weather.precipitation_mmph",
        ];
        assert_eq!(told(&open), expected);
        let stated = WeatherConfig {
            wind_from_deg: Some(20.0),
            precipitation_mmph: Some(0.0),
            ..open
        };
        assert_eq!(told(&stated), Vec::<String>::new());
    }
}
