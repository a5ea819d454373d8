//! Weather at the site, and its reading from a METAR.
//!
//! The report is read up to the pressure group by the `metar` crate (0.9); colour codes, recent
//! weather, runway states, trends and remarks after it do not change the weather now and are not
//! read. That crate panics on some malformed groups and knows neither `KMH`, nor `M1/4SM`, nor
//! `SPECI`; so each group is first checked, and respelled where it must be, by the grammar of
//! WMO-No. 306 FM 15 / FMH-1 below. That also gives an error its column.
//!
//! Conventions for what a METAR leaves open:
//! - `9999` and `CAVOK` mean "10 km or more": [`OPEN_VISIBILITY_M`] is taken, less what the
//!   precipitation takes of it, down to 10 km. Statute miles are taken as written (a US `10SM` is
//!   also a lower bound).
//! - `VRB` gives no direction: north (0) is taken. `00000KT` is a calm from the north.
//! - Cover: FEW 1.5, SCT 3.5, BKN 6, OVC and vertical visibility 8 oktas; the layers' largest. The
//!   base is that layer's. A vertical visibility has none: the visibility hides what fog hides.
//! - Pressure is the reported one, reduced to sea level (QNH or altimeter setting).
//! - Precipitation: the first phenomenon of a group decides the kind, `-`/none/`+` the class of
//!   WMO-No. 8; the rate is nominal, from inside the class. What is in the vicinity (VC), fog,
//!   mist, haze and ice crystals count nothing: the visibility carries them.

use super::atmosphere::{
    Hydrometeor, KOSCHMIEDER, extinction_per_m, precipitation_extinction_per_m,
};
use metar::{
    CloudDensity, Clouds, Data, Metar, Pressure, Visibility, WeatherCondition, WeatherIntensity,
    Wind, WindDirection, WindSpeed,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The visibility taken where the report says only "10 km or more" [m]: the "clear" 23 km of the
/// LOWTRAN standard atmospheres.
pub const OPEN_VISIBILITY_M: f64 = 23_000.0;

/// Cover from which on a layer counts as closed, 7 oktas.
pub const OVERCAST_COVER: f64 = 0.875;

/// What "10 km or more" holds at least [m].
const LEAST_OPEN_VISIBILITY_M: f64 = 10_000.0;

const KNOT_MPS: f64 = 1852.0 / 3600.0;
const KMH_MPS: f64 = 1.0 / 3.6;
const STATUTE_MILE_M: f64 = 1609.344;
const FOOT_M: f64 = 0.3048;
const INCH_OF_MERCURY_PA: f64 = 3386.389;

/// The weather at the site.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Weather {
    /// Mean wind speed 10 m above open ground as reported, or above the site's displacement height [m/s].
    pub wind_speed_mps: f64,
    /// Direction the wind blows from, clockwise from true north [rad].
    pub wind_from_rad: f64,
    /// Gust speed, where gusts are reported: the highest mean over 3 s in ten minutes [m/s].
    pub gust_mps: Option<f64>,
    /// Meteorological visibility, through the precipitation too [m].
    pub visibility_m: f64,
    /// Air temperature [K].
    pub temperature_k: f64,
    /// Relative humidity over water, 0 to 1.
    pub relative_humidity: f64,
    /// Air pressure [Pa].
    pub pressure_pa: f64,
    /// Share of the sky that cloud covers, 0 to 1.
    pub cloud_cover: f64,
    /// Height above ground of the base of the layer that covers most, where it is known [m].
    pub cloud_base_m: Option<f64>,
    /// Precipitation rate as water [mm/h].
    pub precipitation_mmph: f64,
    /// Whether the precipitation is snow.
    pub snow: bool,
}

/// A METAR that cannot be read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WeatherError {
    /// A group that is not what stands at its place in a METAR.
    #[error("METAR column {column}: \"{token}\" is not {expected}")]
    Token {
        /// The group as written.
        token: String,
        /// Its first character, counted from 1.
        column: usize,
        /// What could stand there, and how to write it.
        expected: &'static str,
    },
    /// A group that the simulation needs is not there.
    #[error("METAR ends before {missing}")]
    Missing {
        /// What is missing, and how to write it.
        missing: &'static str,
    },
}

const STATION: &str = "a station: write four letters or digits, as in LSZH";
const TIME: &str = "a time: write day, hour and minute in UTC, as in 171230Z";
const WIND: &str = "a measured wind: write 24008KT, 24008G18KT, VRB03KT, 24005MPS or 240015KMH";
const VISIBILITY: &str =
    "a measured visibility: write CAVOK, metres as in 4000, or miles as in 10SM, 1/2SM or 1 1/2SM";
const SKY_OR_TEMPERATURE: &str =
    "a weather, cloud or temperature group: write them as -RA, BKN020 or 12/M03, in this order";
const TEMPERATURE: &str = "a measured temperature and dew point, the dew point not above the temperature: write them as 12/07 or M03/M05";
const PRESSURE: &str = "a measured pressure: write it as Q1013 or A2992";

/// Precipitation and obscuration codes (WMO code table 4678).
const PHENOMENA: [&str; 30] = [
    "MI", "PR", "BC", "DR", "BL", "SH", "TS", "FZ", "RA", "DZ", "SN", "SG", "IC", "PL", "GR", "GS",
    "UP", "FG", "VA", "BR", "HZ", "DU", "FU", "SA", "PY", "SQ", "PO", "DS", "SS", "FC",
];

/// A group of the report and its column.
#[derive(Clone, Copy)]
struct Token<'a> {
    text: &'a str,
    column: usize,
}

impl Token<'_> {
    fn is_not(self, expected: &'static str) -> WeatherError {
        WeatherError::Token {
            token: self.text.to_owned(),
            column: self.column,
            expected,
        }
    }
}

/// Whether `text` is `len` ASCII digits.
fn digits(text: &str, len: usize) -> bool {
    text.len() == len && text.bytes().all(|byte| byte.is_ascii_digit())
}

/// Whether `text` is `len` digits, or `len` slashes for "not measured".
fn digits_or_unknown(text: &str, len: usize) -> bool {
    digits(text, len) || (text.len() == len && text.bytes().all(|byte| byte == b'/'))
}

/// The wind group as the crate spells it, if `text` is one that names a speed.
fn wind(text: &str) -> Option<String> {
    let (body, unit, len) = [("KT", "KT", 2), ("MPS", "MPS", 2), ("KMH", "KPH", 3)]
        .into_iter()
        .find_map(|(suffix, unit, len)| Some((text.strip_suffix(suffix)?, unit, len)))?;
    let (direction, speeds) = body.split_at_checked(3)?;
    let known = digits(direction, 3) && direction <= "360" || direction == "VRB";
    let (mean, gust) = match speeds.split_once('G') {
        Some((mean, gust)) => (mean, Some(gust)),
        None => (speeds, None),
    };
    // A kilometre-per-hour group may carry two digits; the crate wants three.
    let pad = |speed: &str| {
        let wide = unit == "KPH" && digits(speed, 2);
        (digits(speed, len) || wide).then(|| format!("{speed:0>len$}"))
    };
    let mean = pad(mean)?;
    let gust = match gust {
        Some(gust) => format!("G{}", pad(gust)?),
        None => String::new(),
    };
    known.then(|| format!("{direction}{mean}{gust}{unit}"))
}

/// Whether `text` says between which directions the wind varies, as in `180V240`.
fn is_wind_sector(text: &str) -> bool {
    text.split_once('V')
        .is_some_and(|(from, to)| digits(from, 3) && digits(to, 3) && from <= "360" && to <= "360")
}

/// Whether `text` is a fraction of a mile with its unit, as in `1/2SM`.
fn is_mile_fraction(text: &str) -> bool {
    text.strip_suffix("SM")
        .and_then(|fraction| fraction.split_once('/'))
        .is_some_and(|(top, bottom)| {
            digits(top, 1) && (digits(bottom, 1) || digits(bottom, 2)) && !bottom.starts_with('0')
        })
}

/// Whether `text` is a whole number of miles with its unit, as in `10SM`.
fn is_miles(text: &str) -> bool {
    text.strip_suffix("SM")
        .is_some_and(|miles| digits(miles, 1) || digits(miles, 2))
}

/// Whether `text` is a visibility in one direction (`1500SW`, `4000NDV`) or along a runway
/// (`R27/1200N`); neither is the prevailing one.
fn is_partial_visibility(text: &str) -> bool {
    let directional = text.split_at_checked(4).is_some_and(|(metres, direction)| {
        let known = ["N", "NE", "E", "SE", "S", "SW", "W", "NW", "NDV"];
        digits(metres, 4) && known.contains(&direction)
    });
    let runway = text
        .strip_prefix('R')
        .and_then(|rest| rest.split_once('/'))
        .is_some_and(|(runway, _)| runway.get(..2).is_some_and(|number| digits(number, 2)));
    directional || runway
}

/// Whether `text` is a group of present weather, as in `-SHRA` or `VCFG`.
fn is_present_weather(text: &str) -> bool {
    let codes = text
        .strip_prefix(['-', '+'])
        .or_else(|| text.strip_prefix("VC"))
        .unwrap_or(text);
    !codes.is_empty()
        && codes.is_ascii()
        && codes.len().is_multiple_of(2)
        && (0..codes.len())
            .step_by(2)
            .all(|at| PHENOMENA.contains(&&codes[at..at + 2]))
}

/// Whether `text` is a cloud layer, as in `BKN020CB`.
fn is_cloud_layer(text: &str) -> bool {
    text.split_at_checked(3).is_some_and(|(amount, rest)| {
        ["FEW", "SCT", "BKN", "OVC", "///"].contains(&amount)
            && rest.split_at_checked(3).is_some_and(|(height, kind)| {
                digits_or_unknown(height, 3) && ["", "CB", "TCU", "///"].contains(&kind)
            })
    })
}

/// Whether `text` is a temperature in whole degrees Celsius, as in `M03`.
fn is_temperature(text: &str) -> bool {
    digits(text.strip_prefix('M').unwrap_or(text), 2)
}

/// The next group, or the error that it is missing.
fn need<'a>(token: Option<Token<'a>>, missing: &'static str) -> Result<Token<'a>, WeatherError> {
    token.ok_or(WeatherError::Missing { missing })
}

/// The groups up to the pressure, checked and spelt as the crate reads them.
fn canonical(tokens: &[Token<'_>]) -> Result<String, WeatherError> {
    let mut rest = tokens.iter().copied().peekable();
    let skip = |words: &[&str], rest: &mut std::iter::Peekable<_>| {
        while rest
            .next_if(|token: &Token<'_>| words.contains(&token.text))
            .is_some()
        {}
    };

    skip(&["METAR", "SPECI", "COR", "AUTO"], &mut rest);
    let station = need(rest.next(), STATION)?;
    let in_station = |byte: u8| byte.is_ascii_uppercase() || byte.is_ascii_digit();
    if station.text.len() != 4 || !station.text.bytes().all(in_station) {
        return Err(station.is_not(STATION));
    }
    let time = need(rest.next(), TIME)?;
    let valid = |range: std::ops::Range<usize>, limits: std::ops::RangeInclusive<&str>| {
        time.text
            .get(range)
            .is_some_and(|part| digits(part, 2) && limits.contains(&part))
    };
    if !(valid(0..2, "01"..="31") && valid(2..4, "00"..="23") && valid(4..6, "00"..="59"))
        || time.text.get(6..) != Some("Z")
    {
        return Err(time.is_not(TIME));
    }
    skip(&["AUTO", "COR"], &mut rest);

    let token = need(rest.next(), WIND)?;
    let wind = match token.text {
        "CALM" => "00000KT".to_owned(),
        text => wind(text).ok_or_else(|| token.is_not(WIND))?,
    };
    rest.next_if(|token| is_wind_sector(token.text));

    let token = need(rest.next(), VISIBILITY)?;
    // "Less than" a quarter mile has no better estimate than its bound.
    let text = token.text.strip_prefix('M').unwrap_or(token.text);
    let whole_miles = digits(text, 1) || digits(text, 2);
    let visibility = match rest.next_if(|next| whole_miles && is_mile_fraction(next.text)) {
        Some(fraction) if fraction.text.len() == "1/2SM".len() => {
            format!("{text} {}", fraction.text)
        }
        Some(fraction) => return Err(fraction.is_not(VISIBILITY)),
        None if is_mile_fraction(text) => text.to_owned(),
        None if token.text == "CAVOK" || digits(token.text, 4) || is_miles(token.text) => {
            token.text.to_owned()
        }
        None => return Err(token.is_not(VISIBILITY)),
    };

    let mut weather = Vec::new();
    let mut vertical = None;
    let mut layers = Vec::new();
    let temperature = loop {
        let token = need(rest.next(), TEMPERATURE)?;
        let text = token.text;
        if is_present_weather(text) {
            weather.push(text);
        } else if is_cloud_layer(text) {
            layers.push(text);
        } else if text == "VV///" || text.strip_prefix("VV").is_some_and(|h| digits(h, 3)) {
            vertical = Some(text);
        } else if let Some((air, dew)) = text.split_once('/')
            && (is_temperature(air) || air.is_empty())
        {
            if is_temperature(air) && is_temperature(dew) {
                break text;
            }
            // "//" alone: the station cannot tell the present weather.
            if text != "//" {
                return Err(token.is_not(TEMPERATURE));
            }
        } else if !["SKC", "CLR", "NSC", "NCD"].contains(&text) && !is_partial_visibility(text) {
            return Err(token.is_not(SKY_OR_TEMPERATURE));
        }
    };

    let token = need(rest.next(), PRESSURE)?;
    let value = token
        .text
        .strip_prefix('Q')
        .filter(|hpa| ("0850"..="1100").contains(hpa))
        .or_else(|| token.text.strip_prefix('A'))
        .filter(|value| digits(value, 4));
    let inches_in_range = !token.text.starts_with('A') || ("A2500"..="A3250").contains(&token.text);
    if value.is_none() || !inches_in_range {
        return Err(token.is_not(PRESSURE));
    }

    let mut text = format!("{} {} {wind} {visibility}", station.text, time.text);
    for group in weather.into_iter().chain(vertical).chain(layers) {
        text.push(' ');
        text.push_str(group);
    }
    Ok(format!("{text} {temperature} {}", token.text))
}

/// Oktas of cloud of a layer, from the middle of its class (WMO code table 2700).
fn oktas(density: CloudDensity) -> f64 {
    match density {
        CloudDensity::Few => 1.5,
        CloudDensity::Scattered => 3.5,
        CloudDensity::Broken => 6.0,
        CloudDensity::Overcast => 8.0,
    }
}

/// The nominal rate of a group of present weather [mm/h of water], inside its WMO-No. 8 class, and
/// whether it is snow.
fn precipitation(group: &metar::Weather) -> (f64, bool) {
    use WeatherCondition as C;
    let kind = group
        .conditions
        .iter()
        .find_map(|condition| match condition {
            C::Rain | C::Hail | C::SnowPelletsOrSmallHail | C::UnknownPrecipitation => {
                Some(([1.0, 5.0, 20.0], false)) // classes: below 2.5, to 10, above
            }
            C::Drizzle => Some(([0.05, 0.25, 0.8], false)), // classes: below 0.1, to 0.5, above
            C::Snow | C::SnowGrains | C::IcePellets => {
                Some(([0.5, 2.5, 7.0], true)) // classes: below 1, to 5, above
            }
            _ => None,
        });
    let ([light, moderate, heavy], snow) = kind.unwrap_or_default();
    let rate_mmph = match group.intensity {
        WeatherIntensity::Light => light,
        WeatherIntensity::Moderate => moderate,
        WeatherIntensity::Heavy => heavy,
        WeatherIntensity::InVicinity | WeatherIntensity::Recent => 0.0,
    };
    (rate_mmph, snow)
}

/// Saturation vapour pressure over water [hPa] at `celsius` (Magnus form, Sonntag 1990
/// coefficients as in WMO-No. 8).
fn saturation_hpa(celsius: f64) -> f64 {
    6.112 * (17.62 * celsius / (243.12 + celsius)).exp()
}

impl Weather {
    /// The weather of a METAR or SPECI; the module's page says how open reports are read.
    pub fn from_metar(text: &str) -> Result<Self, WeatherError> {
        // A report may end with "=" and may have been wrapped over lines.
        let report = text.trim_end().trim_end_matches('=');
        let tokens: Vec<Token<'_>> = report
            .split_whitespace()
            .map(|token| Token {
                text: token,
                // `token` lies inside `text`: the difference of addresses is its byte offset.
                column: 1 + text[..token.as_ptr() as usize - text.as_ptr() as usize]
                    .chars()
                    .count(),
            })
            .collect();
        let canonical = canonical(&tokens)?;
        let metar = Metar::parse(&canonical).map_err(|errors| WeatherError::Token {
            token: canonical.clone(),
            column: errors.first().map_or(0, |error| error.start) + 1,
            expected: "a METAR the reader knows, in the groups shown: leave the group at this column out",
        })?;

        let Wind::Present {
            dir,
            speed:
                WindSpeed::Knots { speed, gusting }
                | WindSpeed::MetresPerSecond { speed, gusting }
                | WindSpeed::KilometresPerHour { speed, gusting },
            ..
        } = metar.wind
        else {
            return Err(WeatherError::Missing { missing: WIND });
        };
        let unit_mps = match metar.wind {
            Wind::Present {
                speed: WindSpeed::Knots { .. },
                ..
            } => KNOT_MPS,
            Wind::Present {
                speed: WindSpeed::KilometresPerHour { .. },
                ..
            } => KMH_MPS,
            _ => 1.0,
        };
        let Data::Known(speed) = speed else {
            return Err(WeatherError::Missing { missing: WIND });
        };
        let gust_mps = match gusting {
            Some(Data::Known(gust)) => Some(f64::from(gust) * unit_mps),
            _ => None,
        };
        let wind_from_rad = match dir {
            WindDirection::Heading(Data::Known(degrees)) => f64::from(degrees % 360).to_radians(),
            _ => 0.0,
        };

        let cavok = metar.visibility == Data::Known(Visibility::CAVOK);
        let visibility_m = match metar.visibility {
            Data::Known(Visibility::CAVOK | Visibility::Metres(9999)) => OPEN_VISIBILITY_M,
            // 0000 means less than 50 m, 0SM less than a sixteenth: stay off a zero visibility.
            Data::Known(Visibility::Metres(metres)) => f64::from(metres).max(25.0),
            Data::Known(Visibility::StatuteMiles(miles)) => {
                (f64::from(miles) * STATUTE_MILE_M).max(25.0)
            }
            Data::Unknown => {
                return Err(WeatherError::Missing {
                    missing: VISIBILITY,
                });
            }
        };

        let (Data::Known(celsius), Data::Known(dew_celsius)) = (metar.temperature, metar.dewpoint)
        else {
            return Err(WeatherError::Missing {
                missing: TEMPERATURE,
            });
        };
        let (celsius, dew_celsius) = (f64::from(celsius), f64::from(dew_celsius));
        if dew_celsius > celsius {
            let token = tokens
                .iter()
                .find(|token| canonical.rsplit(' ').nth(1) == Some(token.text));
            return Err(token.map_or(
                WeatherError::Missing {
                    missing: TEMPERATURE,
                },
                |token| token.is_not(TEMPERATURE),
            ));
        }
        let pressure_pa = match metar.pressure {
            Pressure::Hectopascals(Data::Known(hpa)) => f64::from(hpa) * 100.0,
            Pressure::InchesOfMercury(Data::Known(inches)) => {
                f64::from(inches) * INCH_OF_MERCURY_PA
            }
            _ => return Err(WeatherError::Missing { missing: PRESSURE }),
        };

        let mut cloud_cover = 0.0;
        let mut cloud_base_m: Option<f64> = None;
        if !cavok && metar.clouds == Clouds::CloudLayers {
            for layer in &metar.cloud_layers {
                let Data::Known(density) = layer.density else {
                    continue;
                };
                let cover = oktas(density) / 8.0;
                let base_m = match layer.height {
                    Data::Known(height) => Some(f64::from(height) * 100.0 * FOOT_M),
                    Data::Unknown => None,
                };
                // Layers are reported from below: of equal ones the first stays.
                if cover > cloud_cover {
                    (cloud_cover, cloud_base_m) = (cover, base_m);
                }
            }
        }
        if metar.vert_visibility.is_some() {
            (cloud_cover, cloud_base_m) = (1.0, None);
        }
        let (precipitation_mmph, snow) = match &metar.weather {
            Data::Known(groups) => {
                groups
                    .iter()
                    .map(precipitation)
                    .fold(
                        (0.0, false),
                        |most, group| {
                            if group.0 > most.0 { group } else { most }
                        },
                    )
            }
            Data::Unknown => (0.0, false),
        };

        let mut weather = Self {
            wind_speed_mps: f64::from(speed) * unit_mps,
            wind_from_rad,
            gust_mps,
            visibility_m,
            temperature_k: celsius + 273.15,
            relative_humidity: saturation_hpa(dew_celsius) / saturation_hpa(celsius),
            pressure_pa,
            cloud_cover,
            cloud_base_m,
            precipitation_mmph,
            snow,
        };
        let open = matches!(
            metar.visibility,
            Data::Known(Visibility::CAVOK | Visibility::Metres(9999))
        );
        if open && precipitation_mmph > 0.0 {
            let total_per_m = KOSCHMIEDER / OPEN_VISIBILITY_M + weather.precipitation_per_m();
            weather.visibility_m = (KOSCHMIEDER / total_per_m).max(LEAST_OPEN_VISIBILITY_M);
        }
        Ok(weather)
    }

    /// This weather with precipitation of `rate_mmph` [mm/h of water] in place of its own: the
    /// aerosol stays, the visibility changes with what falls.
    ///
    /// It is snow below 1 °C, where it snows as often as it rains (Jennings et al., Nat. Commun. 9,
    /// 1148, 2018: the mean over the northern hemisphere).
    pub fn with_precipitation(self, rate_mmph: f64) -> Self {
        /// Scattering of clean air at 550 nm and sea level [1/m] (Bucholtz, Appl. Opt. 34, 2765,
        /// 1995).
        const CLEAN_AIR_PER_M: f64 = 1.16e-5;
        let aerosol_per_m = self.aerosol_extinction_per_m(550e-9);
        let air_per_m = if aerosol_per_m > 0.0 {
            aerosol_per_m.max(CLEAN_AIR_PER_M)
        } else {
            // A shower hid more than was reported, and nothing is known of the air between its drops.
            KOSCHMIEDER / OPEN_VISIBILITY_M
        };
        let mut changed = Self {
            precipitation_mmph: rate_mmph,
            snow: self.temperature_k < 274.15, // [K]
            ..self
        };
        changed.visibility_m = KOSCHMIEDER / (air_per_m + changed.precipitation_per_m());
        changed
    }

    /// Extinction [1/m] at `wavelength_m` [m]: that of the aerosol, which falls with the
    /// wavelength, and that of the precipitation, which does not.
    pub fn extinction_per_m(&self, wavelength_m: f64) -> f64 {
        let whole_per_m = KOSCHMIEDER / self.visibility_m;
        self.aerosol_extinction_per_m(wavelength_m) + self.precipitation_per_m().min(whole_per_m)
    }

    /// The aerosol's part of the extinction [1/m] at `wavelength_m` [m]: what the visibility
    /// leaves beside the precipitation.
    pub fn aerosol_extinction_per_m(&self, wavelength_m: f64) -> f64 {
        let precipitation_per_m = self.precipitation_per_m();
        let visibility_m = if precipitation_per_m > 0.0 {
            KOSCHMIEDER / (KOSCHMIEDER / self.visibility_m - precipitation_per_m).max(0.0)
        } else {
            self.visibility_m
        };
        extinction_per_m(visibility_m, wavelength_m)
    }

    /// Extinction [1/m] that the precipitation alone causes.
    fn precipitation_per_m(&self) -> f64 {
        let falls = match (self.snow, self.temperature_k < 273.15) {
            (false, _) => Hydrometeor::Rain,
            (true, false) => Hydrometeor::WetSnow,
            (true, true) => Hydrometeor::DrySnow,
        };
        precipitation_extinction_per_m(falls, self.precipitation_mmph)
    }

    /// Height above ground [m] from which on cloud hides everything: the base of a layer that
    /// covers 7/8 of the sky or more.
    pub fn ceiling_m(&self) -> Option<f64> {
        self.cloud_base_m
            .filter(|_| self.cloud_cover >= OVERCAST_COVER)
    }
}

#[cfg(test)]
mod tests;
