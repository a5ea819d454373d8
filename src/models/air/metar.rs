//! The weather from a METAR or SPECI, by the grammar of WMO-No. 306 FM 15 / FMH-1.
//!
//! The report is read up to the pressure group; colour codes, recent weather, runway states, trends
//! and remarks after it do not change the weather now and are not read.
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

use std::iter::Peekable;
use std::ops::{Range, RangeInclusive};
use std::vec::IntoIter;

use super::weather::{OPEN_VISIBILITY_M, Weather};

/// What "10 km or more" holds at least [m].
const LEAST_OPEN_VISIBILITY_M: f64 = 10_000.0;
/// The visibility taken where the report says zero [m]: `0000` means less than 50 m.
const LEAST_VISIBILITY_M: f64 = 25.0;

const KNOT_MPS: f64 = 1852.0 / 3600.0;
const KMH_MPS: f64 = 1.0 / 3.6;
const STATUTE_MILE_M: f64 = 1609.344;
const FOOT_M: f64 = 0.3048;
const INCH_OF_MERCURY_PA: f64 = 3386.389;

/// A METAR that cannot be read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MetarError {
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
    fn is_not(self, expected: &'static str) -> MetarError {
        MetarError::Token {
            token: self.text.to_owned(),
            column: self.column,
            expected,
        }
    }
}

/// The groups that have not been read yet.
struct Groups<'a>(Peekable<IntoIter<Token<'a>>>);

impl<'a> Groups<'a> {
    fn new(text: &'a str) -> Self {
        // A report may end with "=" and may have been wrapped over lines.
        let report = text.trim_end().trim_end_matches('=');
        let tokens: Vec<Token<'a>> = report
            .split_whitespace()
            .map(|token| Token {
                text: token,
                // `token` lies inside `text`: the difference of addresses is its byte offset.
                column: 1 + text[..token.as_ptr() as usize - text.as_ptr() as usize]
                    .chars()
                    .count(),
            })
            .collect();
        Self(tokens.into_iter().peekable())
    }

    /// The next group, or the error that it is missing.
    fn next(&mut self, missing: &'static str) -> Result<Token<'a>, MetarError> {
        self.0.next().ok_or(MetarError::Missing { missing })
    }

    /// The next group, if it is one that `belongs`.
    fn next_if(&mut self, belongs: impl Fn(&str) -> bool) -> Option<Token<'a>> {
        self.0.next_if(|token| belongs(token.text))
    }

    fn skip(&mut self, words: &[&str]) {
        while self.next_if(|text| words.contains(&text)).is_some() {}
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

/// The number that `len` digits make.
fn number(text: &str, len: usize) -> Option<f64> {
    digits(text, len).then(|| text.parse().ok()).flatten()
}

/// The measured wind.
#[derive(Clone, Copy)]
struct WindGroup {
    from_rad: f64,
    speed_mps: f64,
    gust_mps: Option<f64>,
}

/// The wind of a group that names a speed.
fn wind(text: &str) -> Option<WindGroup> {
    if text == "CALM" {
        return Some(WindGroup {
            from_rad: 0.0,
            speed_mps: 0.0,
            gust_mps: None,
        });
    }
    // A group in kilometres per hour carries two or three digits.
    let units: [(&str, f64, &[usize]); 3] = [
        ("KT", KNOT_MPS, &[2]),
        ("MPS", 1.0, &[2]),
        ("KMH", KMH_MPS, &[3, 2]),
    ];
    let (body, unit_mps, lengths) = units
        .into_iter()
        .find_map(|(suffix, unit_mps, len)| Some((text.strip_suffix(suffix)?, unit_mps, len)))?;
    let (direction, speeds) = body.split_at_checked(3)?;
    let from_rad = if direction == "VRB" {
        0.0
    } else {
        let degrees = number(direction, 3).filter(|degrees| *degrees <= 360.0)?;
        (degrees % 360.0).to_radians()
    };
    let (mean, gust) = match speeds.split_once('G') {
        Some((mean, gust)) => (mean, Some(gust)),
        None => (speeds, None),
    };
    let speed_mps = |text: &str| {
        let speed = lengths.iter().find_map(|&len| number(text, len))?;
        Some(speed * unit_mps)
    };
    Some(WindGroup {
        from_rad,
        speed_mps: speed_mps(mean)?,
        gust_mps: match gust {
            Some(gust) => Some(speed_mps(gust)?),
            None => None,
        },
    })
}

/// Whether `text` says between which directions the wind varies, as in `180V240`.
fn is_wind_sector(text: &str) -> bool {
    text.split_once('V')
        .is_some_and(|(from, to)| digits(from, 3) && digits(to, 3) && from <= "360" && to <= "360")
}

/// The fraction of a mile in a group with its unit, as in `1/2SM`.
fn mile_fraction(text: &str) -> Option<f64> {
    let (top, bottom) = text.strip_suffix("SM")?.split_once('/')?;
    let bottom = number(bottom, 1)
        .or_else(|| number(bottom, 2))
        .filter(|_| !bottom.starts_with('0'))?;
    Some(number(top, 1)? / bottom)
}

/// A whole number of up to two digits.
fn short_number(text: &str) -> Option<f64> {
    number(text, 1).or_else(|| number(text, 2))
}

/// The prevailing visibility [m]; None for "10 km or more", with whether the group was `CAVOK`.
struct VisibilityGroup {
    metres: Option<f64>,
    cavok: bool,
}

/// Reads the prevailing visibility, of one group or of whole and broken miles.
fn visibility(groups: &mut Groups<'_>) -> Result<VisibilityGroup, MetarError> {
    let token = groups.next(VISIBILITY)?;
    let of_miles = |miles: f64| VisibilityGroup {
        metres: Some((miles * STATUTE_MILE_M).max(LEAST_VISIBILITY_M)),
        cavok: false,
    };
    // "Less than" a quarter mile has no better estimate than its bound.
    let text = token.text.strip_prefix('M').unwrap_or(token.text);
    if let Some(whole) = short_number(text)
        && let Some(part) = groups.next_if(|next| mile_fraction(next).is_some())
    {
        // Whole miles are followed by a half to a ninth only.
        return mile_fraction(part.text)
            .filter(|_| part.text.len() == "1/2SM".len())
            .map(|fraction| of_miles(whole + fraction))
            .ok_or_else(|| part.is_not(VISIBILITY));
    }
    if let Some(miles) = mile_fraction(text) {
        return Ok(of_miles(miles));
    }
    if let Some(miles) = token.text.strip_suffix("SM").and_then(short_number) {
        return Ok(of_miles(miles));
    }
    let cavok = token.text == "CAVOK";
    match number(token.text, 4) {
        Some(metres) if metres < 9999.0 => Ok(VisibilityGroup {
            metres: Some(metres.max(LEAST_VISIBILITY_M)),
            cavok,
        }),
        None if !cavok => Err(token.is_not(VISIBILITY)),
        _ => Ok(VisibilityGroup {
            metres: None,
            cavok,
        }),
    }
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

/// What falls, as one group of present weather says.
#[derive(Clone, Copy, Default)]
struct Precipitation {
    /// Nominal rate [mm/h of water], inside its WMO-No. 8 class.
    rate_mmph: f64,
    snow: bool,
}

/// The precipitation of a group of present weather, as in `-SHRA` or `VCFG`; none for another group.
fn present_weather(text: &str) -> Option<Precipitation> {
    // Light, moderate and heavy in the order of the rates below; the vicinity has none.
    let (class, codes) = if let Some(codes) = text.strip_prefix('-') {
        (Some(0), codes)
    } else if let Some(codes) = text.strip_prefix('+') {
        (Some(2), codes)
    } else if let Some(codes) = text.strip_prefix("VC") {
        (None, codes)
    } else {
        (Some(1), text)
    };
    if codes.is_empty() || !codes.is_ascii() || !codes.len().is_multiple_of(2) {
        return None;
    }
    let codes = || (0..codes.len()).step_by(2).map(|at| &codes[at..at + 2]);
    if !codes().all(|code| PHENOMENA.contains(&code)) {
        return None;
    }
    let kind = codes().find_map(|code| match code {
        // Classes: below 2.5, to 10, above.
        "RA" | "GR" | "GS" | "UP" => Some(([1.0, 5.0, 20.0], false)),
        // Classes: below 0.1, to 0.5, above.
        "DZ" => Some(([0.05, 0.25, 0.8], false)),
        // Classes: below 1, to 5, above.
        "SN" | "SG" | "PL" => Some(([0.5, 2.5, 7.0], true)),
        _ => None,
    });
    let (rates_mmph, snow) = kind.unwrap_or_default();
    Some(Precipitation {
        rate_mmph: class.map_or(0.0, |class: usize| rates_mmph[class]),
        snow,
    })
}

/// A layer of cloud.
#[derive(Clone, Copy, Default)]
struct Layer {
    /// Share of the sky it covers, from the middle of its class (WMO code table 2700); 0 where it
    /// was not measured.
    cover: f64,
    /// Height of its base above the aerodrome, where it was measured [m].
    base_m: Option<f64>,
}

/// The cloud of a layer's group, as in `BKN020CB`.
fn cloud_layer(text: &str) -> Option<Layer> {
    let (amount, rest) = text.split_at_checked(3)?;
    let (height, kind) = rest.split_at_checked(3)?;
    let oktas = match amount {
        "FEW" => 1.5,
        "SCT" => 3.5,
        "BKN" => 6.0,
        "OVC" => 8.0,
        "///" => 0.0,
        _ => return None,
    };
    let known = digits_or_unknown(height, 3) && ["", "CB", "TCU", "///"].contains(&kind);
    known.then(|| Layer {
        cover: oktas / 8.0,
        base_m: number(height, 3).map(|height| height * 100.0 * FOOT_M),
    })
}

/// Temperature in whole degrees Celsius, as in `M03`.
fn celsius(text: &str) -> Option<f64> {
    match text.strip_prefix('M') {
        Some(below) => number(below, 2).map(|degrees| -degrees),
        None => number(text, 2),
    }
}

/// Present weather, cloud, temperature and dew point.
#[derive(Default)]
struct SkyGroups {
    falls: Precipitation,
    /// The layer that covers most; of equal ones the lowest, which is reported first.
    cloud: Layer,
    /// Whether a vertical visibility stands in place of layers.
    hidden: bool,
    celsius: f64,
    dew_celsius: f64,
}

/// Reads everything from the present weather to the temperature.
fn sky(groups: &mut Groups<'_>) -> Result<SkyGroups, MetarError> {
    let mut sky = SkyGroups::default();
    loop {
        let token = groups.next(TEMPERATURE)?;
        let text = token.text;
        if let Some(falls) = present_weather(text) {
            if falls.rate_mmph > sky.falls.rate_mmph {
                sky.falls = falls;
            }
        } else if let Some(layer) = cloud_layer(text) {
            if layer.cover > sky.cloud.cover {
                sky.cloud = layer;
            }
        } else if text == "VV///" || text.strip_prefix("VV").is_some_and(|h| digits(h, 3)) {
            sky.hidden = true;
        } else if let Some((air, dew)) = text.split_once('/')
            && (celsius(air).is_some() || air.is_empty())
        {
            if let (Some(air), Some(dew)) = (celsius(air), celsius(dew)) {
                if dew > air {
                    return Err(token.is_not(TEMPERATURE));
                }
                (sky.celsius, sky.dew_celsius) = (air, dew);
                return Ok(sky);
            }
            // "//" alone: the station cannot tell the present weather.
            if text != "//" {
                return Err(token.is_not(TEMPERATURE));
            }
        } else if !["SKC", "CLR", "NSC", "NCD"].contains(&text) && !is_partial_visibility(text) {
            return Err(token.is_not(SKY_OR_TEMPERATURE));
        }
    }
}

/// The pressure [Pa] of a group in hectopascals (850 to 1100) or hundredths of an inch of mercury
/// (25 to 32.5 inches).
fn pressure_pa(text: &str) -> Option<f64> {
    if let Some(hpa) = text.strip_prefix('Q') {
        let hpa = number(hpa, 4).filter(|hpa| (850.0..=1100.0).contains(hpa))?;
        return Some(hpa * 100.0);
    }
    let hundredths = number(text.strip_prefix('A')?, 4)?;
    (2500.0..=3250.0)
        .contains(&hundredths)
        .then(|| hundredths / 100.0 * INCH_OF_MERCURY_PA)
}

/// Reads over the kind of report, the station and the time.
fn header(groups: &mut Groups<'_>) -> Result<(), MetarError> {
    groups.skip(&["METAR", "SPECI", "COR", "AUTO"]);
    let station = groups.next(STATION)?;
    let in_station = |byte: u8| byte.is_ascii_uppercase() || byte.is_ascii_digit();
    if station.text.len() != 4 || !station.text.bytes().all(in_station) {
        return Err(station.is_not(STATION));
    }
    let time = groups.next(TIME)?;
    let valid = |at: Range<usize>, limits: RangeInclusive<&str>| {
        let part = time.text.get(at);
        part.is_some_and(|part| digits(part, 2) && limits.contains(&part))
    };
    if !(valid(0..2, "01"..="31") && valid(2..4, "00"..="23") && valid(4..6, "00"..="59"))
        || time.text.get(6..) != Some("Z")
    {
        return Err(time.is_not(TIME));
    }
    groups.skip(&["AUTO", "COR"]);
    Ok(())
}

/// Saturation vapour pressure over water [hPa] at `celsius` (Magnus form, Sonntag 1990
/// coefficients as in WMO-No. 8).
fn saturation_hpa(celsius: f64) -> f64 {
    6.112 * (17.62 * celsius / (243.12 + celsius)).exp()
}

impl Weather {
    /// The weather of a METAR or SPECI; the module's page says how open reports are read.
    pub fn from_metar(text: &str) -> Result<Self, MetarError> {
        let mut groups = Groups::new(text);
        header(&mut groups)?;
        let token = groups.next(WIND)?;
        let wind = wind(token.text).ok_or_else(|| token.is_not(WIND))?;
        groups.next_if(is_wind_sector);
        let visibility = visibility(&mut groups)?;
        let sky = sky(&mut groups)?;
        let token = groups.next(PRESSURE)?;
        let pressure_pa = pressure_pa(token.text).ok_or_else(|| token.is_not(PRESSURE))?;

        let cloud = match (sky.hidden, visibility.cavok) {
            (true, _) => Layer {
                cover: 1.0,
                base_m: None,
            },
            (false, true) => Layer::default(),
            (false, false) => sky.cloud,
        };
        let weather = Self {
            wind_speed_mps: wind.speed_mps,
            wind_from_rad: wind.from_rad,
            gust_mps: wind.gust_mps,
            visibility_m: visibility.metres.unwrap_or(OPEN_VISIBILITY_M),
            temperature_k: sky.celsius + 273.15,
            relative_humidity: saturation_hpa(sky.dew_celsius) / saturation_hpa(sky.celsius),
            pressure_pa,
            cloud_cover: cloud.cover,
            cloud_base_m: cloud.base_m,
            precipitation_mmph: sky.falls.rate_mmph,
            snow: sky.falls.snow,
        };
        Ok(match visibility.metres {
            Some(_) => weather,
            None => weather.with_precipitation_in_open_air(LEAST_OPEN_VISIBILITY_M),
        })
    }
}

#[cfg(test)]
mod tests;
