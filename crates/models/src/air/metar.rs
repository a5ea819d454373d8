//! The weather from a METAR or SPECI, by the grammar of WMO-No. 306 FM 15 / FMH-1 and as stations write it.
//!
//! What a station did not measure (`/////KT`, `////`, `M01/`, `Q////`, a group that is not there) is absent: the caller's
//! own value takes its place. The report is read up to its pressure; runway states, recent weather, colours and trends do
//! not change the weather now and are not read. Remarks are read only for a pressure (`SLP142`, `QNH1013`, `A2992`) or
//! temperatures (`T00640036`) that the report itself lacks.
//!
//! Conventions for what a METAR leaves open; those with a * are told as an [`Assumption`]:
//! - `9999`, `CAVOK` and `10KM` mean "10 km or more": [`OPEN_VISIBILITY_M`] is taken, less what the
//!   precipitation takes of it, down to 10 km. Statute miles are taken as written (a US `10SM` is
//!   also a lower bound), and so are the bounds `P6SM`, `M1/4SM` and, *, `P99KT`.
//! - `VRB` gives no direction: north (0) is taken*. `00000KT` is a calm from the north.
//! - Cover: FEW 1.5, SCT 3.5, BKN 6, OVC and vertical visibility 8 oktas; the layers' largest. The
//!   base is that layer's. A vertical visibility has none: the visibility hides what fog hides.
//!   Where the sky was not measured, it is taken as clear*.
//! - Pressure is the reported one, reduced to sea level (QNH or altimeter setting); of two the first.
//! - Precipitation: the first phenomenon of a group decides the kind, `-`/none/`+` the class of
//!   WMO-No. 8; the rate is nominal, from inside the class. What is in the vicinity (VC), raised by the wind (BL, DR), fog,
//!   mist, haze and ice crystals count nothing: the visibility carries them. What is unknown (`UP`) is snow below 1 °C*, what
//!   was not measured (`//`) nothing*.

use super::weather::{OPEN_VISIBILITY_M, Weather};
use groups::{SkyGroup, VisibilityGroup, digits, slashes};

mod groups;

pub use groups::{Falling, Precipitation};

/// What "10 km or more" holds at least [m].
const LEAST_OPEN_VISIBILITY_M: f64 = 10_000.0;
/// Below it, what falls is snow where the report does not say [°C].
const SNOW_BELOW_C: f64 = 1.0;
/// Two pressures that differ by more contradict each other [Pa]: rounding to whole hectopascals and hundredths of an inch.
const SAME_PRESSURE_PA: f64 = 200.0;

/// A METAR that cannot be read, or that lacks what is needed.
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
    /// The simulation needs what neither the report nor a value of the scenario states.
    #[error("METAR states no {missing}")]
    Missing {
        /// What is missing, how to write it, and the scenario's key that gives it.
        missing: &'static str,
    },
}

/// What is taken where a report leaves something open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Assumption {
    /// The group, or what is missing.
    pub group: String,
    /// What is taken.
    pub what: &'static str,
    /// The scenario's key in `[weather]` that states it otherwise; none where only the report can.
    pub key: Option<&'static str>,
}

const STATION: &str = "a station: write four letters or digits, as in LSZH";
const TIME: &str = "a time: write day, hour and minute in UTC, as in 171230Z";
const WIND: &str = "a wind: write 24008KT, 24008G18KT, VRB03KT, 24005MPS or 240015KMH, or /////KT \
     where it was not measured";
const VISIBILITY: &str = "a visibility: write CAVOK, metres as in 4000, or miles as in 10SM, 1/2SM or 1 1/2SM, or //// \
     where it was not measured";
const SKY_OR_TEMPERATURE: &str = "a weather, cloud or temperature group: write them as -RA, BKN020 or 12/M03, in this \
     order, or leave the group out";
const TEMPERATURE: &str = "a temperature and dew point, the dew point not above the temperature: write them as 12/07 or \
     M03/M05, or ///// where they were not measured";
const PRESSURE: &str = "a pressure: write it as Q1013 or A2992, or Q//// where it was not measured";
const ONCE: &str = "the only group of its kind: leave one of them out";
const ONE_REPORT: &str = "the end of the report: write one METAR only";

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

/// The groups of a text.
fn tokens(text: &str) -> Vec<Token<'_>> {
    let token = |token: &'_ str| {
        // `token` lies inside `text`: the difference of addresses is its byte offset.
        let before = &text[..token.as_ptr() as usize - text.as_ptr() as usize];
        1 + before.chars().count()
    };
    text.split_whitespace()
        .map(|text| Token {
            text,
            column: token(text),
        })
        .collect()
}

/// The visibility that a report states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Visibility {
    /// 10 km or more.
    Open,
    /// As much [m].
    Metres(f64),
}

/// What a METAR states; what is absent was not measured or not reported.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Direction the wind blows from, clockwise from true north [rad].
    pub wind_from_rad: Option<f64>,
    /// Mean wind speed 10 m above open ground [m/s].
    pub wind_speed_mps: Option<f64>,
    /// Gust speed, where gusts are reported [m/s].
    pub gust_mps: Option<f64>,
    /// Prevailing visibility.
    pub visibility: Option<Visibility>,
    /// The heaviest precipitation of its groups.
    pub falls: Precipitation,
    /// Share of the sky that the layer covers that covers most, 0 to 1.
    pub cloud_cover: Option<f64>,
    /// Height of that layer's base above the aerodrome, where it was measured [m].
    pub cloud_base_m: Option<f64>,
    /// Air temperature [°C].
    pub temperature_c: Option<f64>,
    /// Dew point [°C].
    pub dew_point_c: Option<f64>,
    /// Pressure reduced to sea level [Pa].
    pub pressure_pa: Option<f64>,
    /// What is taken where the report leaves something open.
    pub assumed: Vec<Assumption>,
}

/// Values that a caller has beside a report: they take the place of what is absent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Given {
    /// Mean wind speed [m/s].
    pub wind_speed_mps: Option<f64>,
    /// Direction the wind blows from, clockwise from true north [rad].
    pub wind_from_rad: Option<f64>,
    /// Meteorological visibility [m].
    pub visibility_m: Option<f64>,
    /// Air temperature [°C].
    pub temperature_c: Option<f64>,
    /// Relative humidity, 0 to 1.
    pub relative_humidity: Option<f64>,
    /// Pressure reduced to sea level [Pa].
    pub pressure_pa: Option<f64>,
    /// Share of the sky that cloud covers, 0 to 1.
    pub cloud_cover: Option<f64>,
}

/// Reads the groups one after the other.
struct Reader<'a> {
    tokens: Vec<Token<'a>>,
    next: usize,
    report: Report,
    /// What is expected next: a wind, a visibility, weather, cloud or temperature, a pressure; or nothing more.
    stage: usize,
    wind: bool,
    temperature: bool,
    sky: bool,
    cavok: bool,
    /// The lowest visibility in a direction [m].
    directional_m: Option<f64>,
}

impl<'a> Reader<'a> {
    fn peek(&self) -> Option<&'a str> {
        self.tokens.get(self.next).map(|token| token.text)
    }

    fn take(&mut self) -> Option<Token<'a>> {
        let token = self.tokens.get(self.next).copied();
        self.next += 1;
        token
    }

    fn take_if(&mut self, belongs: impl Fn(&str) -> bool) -> bool {
        let there = self.peek().is_some_and(belongs);
        self.next += usize::from(there);
        there
    }

    fn assume(&mut self, group: &str, what: &'static str, key: impl Into<Option<&'static str>>) {
        let (group, key) = (group.to_owned(), key.into());
        self.report.assumed.push(Assumption { group, what, key });
    }

    /// Reads over the kind of report, the station and the time; whether a report follows.
    fn header(&mut self) -> Result<bool, MetarError> {
        // The date line of a file, and the heading of a bulletin.
        let date = |text: &str| text.len() == 10 && text.split('/').count() == 3;
        if self.take_if(date) {
            self.take_if(|text| text.len() == 5 && text.contains(':'));
        }
        let heading = |text: &str| {
            let parts = text.split_at_checked(4);
            parts.is_some_and(|(area, number)| {
                digits(number, 2) && area.bytes().all(|byte| byte.is_ascii_uppercase())
            })
        };
        let day = self.tokens.get(self.next + 2);
        if self.peek().is_some_and(heading) && day.is_some_and(|day| digits(day.text, 6)) {
            self.next += 3;
            self.take_if(is_correction);
        }
        while self.take_if(|text| ["METAR", "SPECI", "AUTO"].contains(&text) || is_correction(text))
        {
        }
        let missing = "station: write four letters or digits, as in LSZH";
        let station = self.take().ok_or(MetarError::Missing { missing })?;
        let in_station = |byte: u8| byte.is_ascii_uppercase() || byte.is_ascii_digit();
        if station.text.len() != 4 || !station.text.bytes().all(in_station) {
            return Err(station.is_not(STATION));
        }
        while self.take_if(is_correction) {}
        if self.take_if(|text| text == "NIL") {
            return Ok(false);
        }
        let missing = "time: write day, hour and minute in UTC, as in 171230Z";
        let time = self.take().ok_or(MetarError::Missing { missing })?;
        let body = time.text.strip_suffix('Z').unwrap_or(time.text);
        let valid = digits(body, 6)
            && ("01"..="31").contains(&&body[..2])
            && ("00"..="23").contains(&&body[2..4])
            && ("00"..="59").contains(&&body[4..]);
        if !valid {
            return Err(time.is_not(TIME));
        }
        while self.take_if(|text| text == "AUTO" || is_correction(text)) {}
        Ok(!self.take_if(|text| text == "NIL"))
    }

    /// Reads everything from the wind to the pressure and what comes after it, up to the remarks.
    fn body(&mut self) -> Result<(), MetarError> {
        while let Some(token) = self.take() {
            let text = token.text;
            if text == "RMK" || text == "RMKS" {
                return Ok(());
            }
            if ["METAR", "SPECI"].contains(&text) {
                return Err(token.is_not(ONE_REPORT));
            }
            if text == "NOSIG" || groups::is_aside(text) {
                continue;
            }
            if text == "WS" {
                self.wind_shear();
                continue;
            }
            if groups::is_trend(text) {
                while self.peek().is_some_and(|text| !text.starts_with("RMK")) {
                    self.no_second_report()?;
                    self.next += 1;
                }
                continue;
            }
            if self.stage < 4 {
                let read = self.wind(token)?
                    || self.visibility(token)?
                    || self.sky(token)
                    || self.temperature(token)?;
                if read {
                    continue;
                }
            }
            if let Some(pressure_pa) = groups::pressure_pa(text) {
                self.pressure(token, pressure_pa);
            } else if slashes(text, 1) || ["M", "MM"].contains(&text) {
                // Whatever it is, it was not measured.
            } else if self.stage < 4 {
                return Err(token.is_not(self.expected(text)));
            } else {
                self.assume(text, "is not understood and is left out", None);
            }
        }
        Ok(())
    }

    fn no_second_report(&self) -> Result<(), MetarError> {
        match self.tokens.get(self.next) {
            Some(token) if ["METAR", "SPECI"].contains(&token.text) => {
                Err(token.is_not(ONE_REPORT))
            }
            _ => Ok(()),
        }
    }

    /// What a group that is not understood should have been.
    fn expected(&self, text: &str) -> &'static str {
        let then_digit = |first: char| {
            let rest = text.strip_prefix(first);
            rest.is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
        };
        if ["KT", "KTS", "MPS", "KMH"]
            .iter()
            .any(|unit| text.ends_with(unit))
        {
            WIND
        } else if text.ends_with("SM") {
            VISIBILITY
        } else if then_digit('Q') || then_digit('A') {
            PRESSURE
        } else {
            [WIND, VISIBILITY, SKY_OR_TEMPERATURE, PRESSURE][self.stage.min(3)]
        }
    }

    fn wind(&mut self, token: Token<'_>) -> Result<bool, MetarError> {
        let text = token.text;
        // Five or six slashes before anything else are a wind without its unit.
        if self.stage == 0 && slashes(text, 5) && text.len() <= 6 {
            self.stage = 1;
            return Ok(true);
        }
        if self.wind && groups::is_wind_sector(text) {
            return Ok(true);
        }
        let Some(wind) = groups::wind(text) else {
            return Ok(false);
        };
        if self.wind {
            return Err(token.is_not(ONCE));
        }
        self.wind = true;
        self.stage = self.stage.max(1);
        self.report.wind_from_rad = wind.from_rad;
        self.report.wind_speed_mps = wind.speed_mps;
        self.report.gust_mps = wind.gust_mps;
        if wind.varies && wind.speed_mps != Some(0.0) {
            let what = "gives no direction of the wind: from the north is taken";
            self.assume(text, what, "wind_from_deg");
        }
        for (_, key) in (wind.bounds.into_iter())
            .zip(["wind_speed_mps", "gust_mps"])
            .filter(|(bound, _)| *bound)
        {
            let what = "gives a bound of the wind speed: the bound is taken";
            self.assume(text, what, key);
        }
        if wind.gust_unknown {
            let what = "gives no speed of its gusts: none are taken";
            self.assume(text, what, "gust_mps");
        }
        Ok(true)
    }

    fn visibility(&mut self, token: Token<'_>) -> Result<bool, MetarError> {
        let text = token.text;
        let whole = text.strip_prefix(['M', 'P']).unwrap_or(text);
        let group = if let Some(whole) = groups::short_number(whole) {
            // Miles over two groups or three: `1 1/2SM`, `1 1/2 SM`, `10 SM`.
            let part = self.peek().and_then(|next| {
                let part = next.strip_suffix("SM").unwrap_or(next);
                groups::fraction(part).filter(|part| *part < 1.0)
            });
            self.next += usize::from(part.is_some());
            let before = self.tokens.get(self.next - 1);
            let unit = before.is_some_and(|token| token.text.ends_with("SM"));
            if !(unit || self.take_if(|text| text == "SM")) {
                return Err(token.is_not(VISIBILITY));
            }
            groups::miles(whole + part.unwrap_or(0.0))
        } else if let Some(group) = groups::visibility(text) {
            group
        } else {
            return Ok(false);
        };
        self.stage = self.stage.max(2);
        let stated = match group {
            VisibilityGroup::Cavok => {
                self.cavok = true;
                Visibility::Open
            }
            VisibilityGroup::Open => Visibility::Open,
            VisibilityGroup::Metres(metres) => Visibility::Metres(metres),
            VisibilityGroup::Directional(metres) => {
                let least_m = self.directional_m.unwrap_or(f64::INFINITY).min(metres);
                self.directional_m = Some(least_m);
                return Ok(true);
            }
            VisibilityGroup::Unknown => return Ok(true),
        };
        // A second one is the least in some direction.
        self.report.visibility.get_or_insert(stated);
        Ok(true)
    }

    fn sky(&mut self, token: Token<'_>) -> bool {
        let text = token.text;
        if text == "//" {
            let what = "means that the station cannot tell the weather: no precipitation is taken";
            self.assume(text, what, "precipitation_mmph");
        } else if let Some(falls) = groups::present_weather(text) {
            if falls.falling == Falling::Unknown {
                let what = "does not say what falls: snow below 1 °C, else rain";
                self.assume(text, what, "precipitation_mmph");
            }
            if falls.rate_mmph > self.report.falls.rate_mmph {
                self.report.falls = falls;
            }
        } else if let Some(sky) = groups::sky(text) {
            self.cloud(text, sky);
        } else if text == "BLW" {
            // The Canadian `CLR BLW 120`.
            self.take_if(|text| digits(text, 3));
        } else {
            return false;
        }
        self.stage = self.stage.max(2);
        true
    }

    fn cloud(&mut self, text: &str, sky: SkyGroup) {
        let (cover, base_m) = match sky {
            SkyGroup::Clear => (Some(0.0), None),
            SkyGroup::Hidden => (Some(1.0), None),
            SkyGroup::Layer { cover, base_m } => (cover, base_m),
        };
        let Some(cover) = cover else {
            let what = "gives no cover: the layer is not counted";
            self.sky = true;
            self.assume(text, what, "cloud_cover");
            return;
        };
        self.sky = true;
        // Of equal layers the lowest counts, which is reported first; a vertical visibility stands for all.
        let known = self.report.cloud_cover;
        if sky == SkyGroup::Hidden || known.is_none_or(|known| cover > known) {
            self.report.cloud_cover = Some(cover);
            self.report.cloud_base_m = base_m;
        }
        if matches!(sky, SkyGroup::Layer { base_m: None, .. }) && cover >= 1.0 {
            let what = "gives no height: the cloud is taken to be above everything";
            self.assume(text, what, "cloud_base_m");
        }
    }

    fn temperature(&mut self, token: Token<'_>) -> Result<bool, MetarError> {
        let Some([air, dew]) = groups::temperatures(token.text) else {
            return Ok(false);
        };
        if self.temperature {
            return Err(token.is_not(ONCE));
        }
        if let (Some(air), Some(dew)) = (air, dew)
            && dew > air
        {
            return Err(token.is_not(TEMPERATURE));
        }
        self.temperature = true;
        self.stage = self.stage.max(3);
        (self.report.temperature_c, self.report.dew_point_c) = (air, dew);
        Ok(true)
    }

    fn pressure(&mut self, token: Token<'_>, pressure_pa: Option<f64>) {
        self.stage = 4;
        match (self.report.pressure_pa, pressure_pa) {
            (Some(first), Some(second)) if (first - second).abs() > SAME_PRESSURE_PA => {
                let what = "contradicts the pressure before it, which is taken";
                self.assume(token.text, what, "pressure_hpa");
            }
            (None, stated) => self.report.pressure_pa = stated,
            _ => {}
        }
    }

    /// Reads over a wind shear, as in `WS R27`, `WS ALL RWY` or `WS TKOF RWY 09`.
    fn wind_shear(&mut self) {
        while self.take_if(|text| {
            let runway = text.strip_prefix("RWY").or(text.strip_prefix('R'));
            let number = |text: &str| text.get(..2).is_some_and(|text| digits(text, 2));
            ["ALL", "RWY", "RWYS", "TKOF", "LDG"].contains(&text)
                || runway.is_some_and(|rest| number(rest) && !rest.contains('/'))
                || (number(text) && text.len() <= 3)
        }) {}
    }

    /// Takes from the remarks what the report itself lacks.
    fn remarks(&mut self) -> Result<(), MetarError> {
        while let Some(token) = self.tokens.get(self.next).copied() {
            self.no_second_report()?;
            self.next += 1;
            let text = token.text;
            let pressure_pa =
                groups::sea_level_pa(text).or_else(|| groups::pressure_pa(text).flatten());
            if self.report.pressure_pa.is_none() && pressure_pa.is_some() {
                self.report.pressure_pa = pressure_pa;
                let what = "of the remarks is taken as the pressure, which the report lacks";
                self.assume(text, what, "pressure_hpa");
            }
            if let Some([air, dew]) = groups::tenths(text)
                && self.report.temperature_c.is_none()
                && self.report.dew_point_c.is_none()
                && dew <= air
            {
                (self.report.temperature_c, self.report.dew_point_c) = (air, dew);
                let what = "of the remarks is taken as the temperature, which the report lacks";
                self.assume(text, what, "temperature_c");
            }
        }
        Ok(())
    }

    /// The report, with what its groups mean together.
    fn finish(mut self) -> Report {
        if self.cavok {
            self.report.cloud_cover = Some(0.0);
            self.report.cloud_base_m = None;
        } else if !self.sky {
            let what = "is not in the report: a clear one is taken";
            self.assume("the sky", what, "cloud_cover");
        }
        if let (None, Some(metres)) = (self.report.visibility, self.directional_m) {
            self.report.visibility = Some(match metres >= LEAST_OPEN_VISIBILITY_M {
                true => Visibility::Open,
                false => Visibility::Metres(metres),
            });
            let what = "is stated for directions only: the least is taken";
            self.assume("the visibility", what, "visibility_m");
        }
        self.report
    }
}

/// Whether `text` marks a report as corrected, amended or delayed: `COR`, `CCA`, `AMD`, `AAB`, `RTD`, `RRC`.
fn is_correction(text: &str) -> bool {
    let numbered = text.len() == 3
        && ["CC", "AA", "RR"].iter().any(|kind| text.starts_with(kind))
        && text.bytes().all(|byte| byte.is_ascii_uppercase());
    numbered || ["COR", "CORR", "AMD", "RTD"].contains(&text)
}

/// Saturation vapour pressure over water [hPa] at `celsius` (Magnus form, Sonntag 1990
/// coefficients as in WMO-No. 8).
fn saturation_hpa(celsius: f64) -> f64 {
    6.112 * (17.62 * celsius / (243.12 + celsius)).exp()
}

impl Report {
    /// What a METAR or SPECI states; the module's page says how open reports are read.
    pub fn read(text: &str) -> Result<Self, MetarError> {
        Self::read_upper(&text.to_ascii_uppercase()).map_err(|error| match error {
            MetarError::Token {
                token,
                column,
                expected,
            } => {
                let written = text.chars().skip(column - 1).take(token.chars().count());
                MetarError::Token {
                    token: written.collect(),
                    column,
                    expected,
                }
            }
            error => error,
        })
    }

    /// As [`Report::read`], of a text in capitals.
    fn read_upper(upper: &str) -> Result<Self, MetarError> {
        // A report may end with "=".
        let (report, behind) = upper.split_once('=').unwrap_or((upper, ""));
        if let Some(more) = tokens(upper).iter().find(|token| {
            let more = behind.contains(|c: char| !c.is_whitespace() && c != '=');
            more && token.text.as_ptr() > report.as_ptr().wrapping_add(report.len())
        }) {
            return Err(more.is_not(ONE_REPORT));
        }
        let mut reader = Reader {
            tokens: tokens(report),
            next: 0,
            report: Self::default(),
            stage: 0,
            wind: false,
            temperature: false,
            sky: false,
            cavok: false,
            directional_m: None,
        };
        if reader.header()? {
            reader.body()?;
            reader.remarks()?;
        }
        Ok(reader.finish())
    }

    /// The weather of the report, with `given` in place of what it lacks; refused where neither has what is needed.
    pub fn weather(&self, given: &Given) -> Result<Weather, MetarError> {
        fn need(value: Option<f64>, missing: &'static str) -> Result<f64, MetarError> {
            value.ok_or(MetarError::Missing { missing })
        }
        let wind_speed_mps = need(
            self.wind_speed_mps.or(given.wind_speed_mps),
            "wind speed: write it as in 24008KT, or give weather.wind_speed_mps",
        )?;
        let calm = (wind_speed_mps == 0.0).then_some(0.0);
        let wind_from_rad = need(
            self.wind_from_rad.or(given.wind_from_rad).or(calm),
            "direction of the wind: write it as in 24008KT, or give weather.wind_from_deg",
        )?;
        let metres = match self.visibility {
            Some(Visibility::Open) => None,
            Some(Visibility::Metres(metres)) => Some(metres),
            None => Some(need(
                given.visibility_m,
                "visibility: write it as 9999, 4000 or 10SM, or give weather.visibility_m",
            )?),
        };
        let celsius = need(
            given.temperature_c.or(self.temperature_c),
            "temperature: write it as in 12/07, or give weather.temperature_c",
        )?;
        let relative_humidity = need(
            (self.dew_point_c)
                .map(|dew| (saturation_hpa(dew) / saturation_hpa(celsius)).min(1.0))
                .or(given.relative_humidity),
            "dew point: write it as in 12/07, or give weather.relative_humidity",
        )?;
        let pressure_pa = need(
            self.pressure_pa.or(given.pressure_pa),
            "pressure: write it as in Q1013 or A2992, or give weather.pressure_hpa",
        )?;
        let weather = Weather {
            wind_speed_mps,
            wind_from_rad,
            gust_mps: self.gust_mps,
            visibility_m: metres.unwrap_or(OPEN_VISIBILITY_M),
            temperature_k: celsius + 273.15,
            relative_humidity,
            pressure_pa,
            cloud_cover: self.cloud_cover.or(given.cloud_cover).unwrap_or(0.0),
            cloud_base_m: self.cloud_base_m,
            precipitation_mmph: self.falls.rate_mmph,
            snow: match self.falls.falling {
                Falling::Rain => false,
                Falling::Snow => true,
                Falling::Unknown => celsius < SNOW_BELOW_C,
            },
        };
        Ok(match metres {
            Some(_) => weather,
            None => weather.with_precipitation_in_open_air(LEAST_OPEN_VISIBILITY_M),
        })
    }
}

impl Weather {
    /// The weather of a METAR or SPECI that states all that is needed.
    pub fn from_metar(text: &str) -> Result<Self, MetarError> {
        Report::read(text)?.weather(&Given::default())
    }
}

#[cfg(test)]
mod tests;
