//! The groups of a METAR, each by its form alone (WMO-No. 306 FM 15, FMH-1, MANOBS and what else stations write).

const KNOT_MPS: f64 = 1852.0 / 3600.0;
const KMH_MPS: f64 = 1.0 / 3.6;
const STATUTE_MILE_M: f64 = 1609.344;
const FOOT_M: f64 = 0.3048;
const INCH_OF_MERCURY_PA: f64 = 3386.389;
/// The visibility taken where the report says zero [m]: `0000` means less than 50 m.
const LEAST_VISIBILITY_M: f64 = 25.0;
/// Temperatures that a station can meet [°C].
const CELSIUS: std::ops::RangeInclusive<f64> = -90.0..=60.0;

/// Precipitation and obscuration codes (WMO code table 4678).
const PHENOMENA: [&str; 30] = [
    "MI", "PR", "BC", "DR", "BL", "SH", "TS", "FZ", "RA", "DZ", "SN", "SG", "IC", "PL", "GR", "GS",
    "UP", "FG", "VA", "BR", "HZ", "DU", "FU", "SA", "PY", "SQ", "PO", "DS", "SS", "FC",
];

/// Whether `text` is `len` ASCII digits.
pub(super) fn digits(text: &str, len: usize) -> bool {
    text.len() == len && text.bytes().all(|byte| byte.is_ascii_digit())
}

/// The number that `len` digits make.
fn number(text: &str, len: usize) -> Option<f64> {
    digits(text, len).then(|| text.parse().ok()).flatten()
}

/// A whole number of up to two digits.
pub(super) fn short_number(text: &str) -> Option<f64> {
    number(text, 1).or_else(|| number(text, 2))
}

/// Whether `text` is nothing but slashes, `len` of them or more: what stands there was not measured.
pub(super) fn slashes(text: &str, len: usize) -> bool {
    text.len() >= len && text.bytes().all(|byte| byte == b'/')
}

/// The measured wind; what is absent was not measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WindGroup {
    /// Where it blows from, clockwise from north [rad]; north where it varies.
    pub(super) from_rad: Option<f64>,
    /// Whether the direction varies (`VRB`).
    pub(super) varies: bool,
    /// Mean speed [m/s].
    pub(super) speed_mps: Option<f64>,
    /// Gust speed [m/s].
    pub(super) gust_mps: Option<f64>,
    /// Whether a gust is announced that was not measured (`G//`).
    pub(super) gust_unknown: bool,
    /// Whether the mean and the gust speed are lower bounds (`P99`).
    pub(super) bounds: [bool; 2],
}

/// The wind of a group that names its unit, as in `24008G18KT`, `VRB03MPS`, `250100G125KT`, `240P99KT` or `/////KT`.
pub(super) fn wind(text: &str) -> Option<WindGroup> {
    let mut group = WindGroup {
        from_rad: Some(0.0),
        varies: false,
        speed_mps: Some(0.0),
        gust_mps: None,
        gust_unknown: false,
        bounds: [false; 2],
    };
    if text == "CALM" {
        return Some(group);
    }
    let units = [
        ("KTS", KNOT_MPS),
        ("KT", KNOT_MPS),
        ("MPS", 1.0),
        ("KMH", KMH_MPS),
        ("KPH", KMH_MPS),
    ];
    let (body, unit_mps) = units
        .into_iter()
        .find_map(|(suffix, unit_mps)| Some((text.strip_suffix(suffix)?, unit_mps)))?;
    let speed = |text: &str| {
        if slashes(text, 1) {
            return Some((None, false));
        }
        let above = text.strip_prefix('P');
        let text = above.unwrap_or(text);
        let speed = number(text, 2).or_else(|| number(text, 3))?;
        Some((Some(speed * unit_mps), above.is_some()))
    };
    let (mean, gust) = match body.split_once('G') {
        Some((mean, gust)) => (mean, Some(gust)),
        None => (body, None),
    };
    let (direction, mean) = mean.split_at_checked(3)?;
    group.varies = direction == "VRB";
    group.from_rad = match direction {
        "VRB" => Some(0.0),
        "///" => None,
        _ => {
            let degrees = number(direction, 3).filter(|degrees| *degrees <= 360.0)?;
            Some((degrees % 360.0).to_radians())
        }
    };
    (group.speed_mps, group.bounds[0]) = speed(mean)?;
    if let Some(gust) = gust {
        (group.gust_mps, group.bounds[1]) = speed(gust)?;
        group.gust_unknown = group.gust_mps.is_none();
    }
    // A calm has no direction to measure.
    if group.speed_mps == Some(0.0) {
        group.from_rad = group.from_rad.or(Some(0.0));
    }
    Some(group)
}

/// Whether `text` says between which directions the wind varies, as in `180V240`.
pub(super) fn is_wind_sector(text: &str) -> bool {
    let part = |text: &str| (digits(text, 3) && text <= "360") || slashes(text, 3);
    text.split_once('V')
        .is_some_and(|(from, to)| part(from) && part(to))
}

/// What a group says of the visibility.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum VisibilityGroup {
    /// `CAVOK`.
    Cavok,
    /// 10 km or more.
    Open,
    /// As much [m].
    Metres(f64),
    /// As much in one direction [m], 10,000 for "10 km or more".
    Directional(f64),
    /// Not measured.
    Unknown,
}

/// Miles of visibility in metres.
pub(super) fn miles(miles: f64) -> VisibilityGroup {
    VisibilityGroup::Metres((miles * STATUTE_MILE_M).max(LEAST_VISIBILITY_M))
}

/// A fraction, as in `1/2`; whole miles run into their fraction (`11/2` for 1 1/2) are understood.
pub(super) fn fraction(text: &str) -> Option<f64> {
    let (top, bottom) = text.split_once('/')?;
    let bottom = short_number(bottom).filter(|bottom| *bottom > 0.0)?;
    let value = short_number(top)? / bottom;
    if digits(top, 2) && value > 1.0 {
        let (whole, top) = top.split_at(1);
        let part = number(top, 1)? / bottom;
        return (part < 1.0).then_some(number(whole, 1)? + part);
    }
    Some(value)
}

/// The visibility of one group, as in `4000`, `9999NDV`, `1500SW`, `10SM`, `M1/4SM`, `P6SM`, `5KM` or `////`.
pub(super) fn visibility(text: &str) -> Option<VisibilityGroup> {
    if text == "CAVOK" {
        return Some(VisibilityGroup::Cavok);
    }
    if let Some(body) = text.strip_suffix("SM") {
        if slashes(body, 1) {
            return Some(VisibilityGroup::Unknown);
        }
        // "Less" or "more than" has no better estimate than its bound.
        let body = body.strip_prefix(['M', 'P']).unwrap_or(body);
        let decimal = || body.contains('.').then(|| body.parse().ok()).flatten();
        let whole = fraction(body)
            .or_else(|| short_number(body))
            .or_else(decimal);
        return whole.map(miles);
    }
    if let Some(km) = text.strip_suffix("KM").and_then(short_number) {
        return Some(match km {
            10.0 => VisibilityGroup::Open,
            _ => VisibilityGroup::Metres((1000.0 * km).max(LEAST_VISIBILITY_M)),
        });
    }
    let (metres, direction) = text.split_at_checked(4)?;
    let compass = ["N", "NE", "E", "SE", "S", "SW", "W", "NW"].contains(&direction);
    if !(compass || ["", "NDV", "NDZ", "ND", "M"].contains(&direction)) {
        return None;
    }
    if slashes(metres, 4) {
        return Some(VisibilityGroup::Unknown);
    }
    let metres = number(metres, 4)?.max(LEAST_VISIBILITY_M);
    Some(match (compass, metres) {
        (true, 9999.0) => VisibilityGroup::Directional(10_000.0),
        (true, _) => VisibilityGroup::Directional(metres),
        (false, 9999.0) => VisibilityGroup::Open,
        (false, _) => VisibilityGroup::Metres(metres),
    })
}

/// What precipitation is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Falling {
    /// Rain, drizzle, hail.
    #[default]
    Rain,
    /// Snow, snow grains, ice pellets.
    Snow,
    /// Reported as unknown (`UP`).
    Unknown,
}

/// What falls, as one group of present weather says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Precipitation {
    /// Nominal rate [mm/h of water], inside its WMO-No. 8 class.
    pub rate_mmph: f64,
    /// What it is.
    pub falling: Falling,
}

/// The precipitation of a group of present weather, as in `-SHRA` or `VCFG`; none for another group.
pub(super) fn present_weather(text: &str) -> Option<Precipitation> {
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
    // What the wind raises does not fall.
    let falls = !codes().any(|code| ["BL", "DR"].contains(&code));
    let kind = codes().filter(|_| falls).find_map(|code| match code {
        // Classes: below 2.5, to 10, above.
        "RA" | "GR" | "GS" => Some(([1.0, 5.0, 20.0], Falling::Rain)),
        "UP" => Some(([1.0, 5.0, 20.0], Falling::Unknown)),
        // Classes: below 0.1, to 0.5, above.
        "DZ" => Some(([0.05, 0.25, 0.8], Falling::Rain)),
        // Classes: below 1, to 5, above.
        "SN" | "SG" | "PL" => Some(([0.5, 2.5, 7.0], Falling::Snow)),
        _ => None,
    });
    let (rates_mmph, falling) = kind.unwrap_or_default();
    Some(Precipitation {
        rate_mmph: class.map_or(0.0, |class: usize| rates_mmph[class]),
        falling,
    })
}

/// What a group says of the sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SkyGroup {
    /// A layer of cloud.
    Layer {
        /// Share of the sky it covers, from the middle of its class (WMO code table 2700), if measured.
        cover: Option<f64>,
        /// Height of its base above the aerodrome, if measured [m].
        base_m: Option<f64>,
    },
    /// No cloud, or none that matters.
    Clear,
    /// A vertical visibility: the sky is hidden.
    Hidden,
}

/// The cloud of a group, as in `BKN020CB`, `FEW///`, `///015TCU`, `NSC` or `VV002`.
pub(super) fn sky(text: &str) -> Option<SkyGroup> {
    let known = |height: &str| digits(height, 3) || slashes(height, 3);
    if ["SKC", "CLR", "NSC", "NCD"].contains(&text)
        || text.strip_prefix("CLRBLW").is_some_and(known)
    {
        return Some(SkyGroup::Clear);
    }
    if let Some(height) = text.strip_prefix("VV") {
        return (known(height) && height.len() == 3).then_some(SkyGroup::Hidden);
    }
    let (amount, rest) = text.split_at_checked(3)?;
    let oktas = match amount {
        "FEW" => Some(1.5),
        "SCT" => Some(3.5),
        "BKN" => Some(6.0),
        "OVC" => Some(8.0),
        "///" => None,
        _ => return None,
    };
    let cover = oktas.map(|oktas| oktas / 8.0);
    if ["CB", "TCU"].contains(&rest) || (rest.is_empty() && cover.is_some()) {
        let base_m = None;
        return Some(SkyGroup::Layer { cover, base_m });
    }
    let (height, kind) = rest.split_at_checked(3)?;
    let genus = kind
        .trim_start_matches(['(', '-', '/'])
        .trim_end_matches(')');
    let top = genus.strip_prefix("TOP").is_some_and(known);
    let letters = genus.len() <= 5 && genus.bytes().all(|byte| byte.is_ascii_uppercase());
    (known(height) && (letters || top)).then(|| SkyGroup::Layer {
        cover,
        base_m: number(height, 3).map(|height| height * 100.0 * FOOT_M),
    })
}

/// One temperature [°C], as in `M03`; the outer option is none for another text, the inner one for what was not measured.
fn celsius(text: &str) -> Option<Option<f64>> {
    if ["", "//", "XX", "MM", "M"].contains(&text) {
        return Some(None);
    }
    let below = text.strip_prefix(['M', '-']);
    let value = below.unwrap_or(text);
    let (whole, tenths) = value.split_once('.').unwrap_or((value, "0"));
    if short_number(whole).is_none() || !digits(tenths, 1) {
        return None;
    }
    let value: f64 = value.parse().ok()?;
    let value = if below.is_some() { -value } else { value };
    CELSIUS.contains(&value).then_some(Some(value))
}

/// Temperature and dew point [°C] of their group, as in `12/07`, `M03/M05`, `M01/`, `12///` or `/////`.
pub(super) fn temperatures(text: &str) -> Option<[Option<f64>; 2]> {
    let wide = text.bytes().filter(u8::is_ascii_digit).count() > 2;
    text.match_indices('/').find_map(|(at, _)| {
        let pair = [celsius(&text[..at])?, celsius(&text[at + 1..])?];
        let meant = match pair {
            [None, None] => text.len() == 5,
            // A broken mile has single digits.
            [Some(_), Some(_)] => wide,
            [Some(_), None] | [None, Some(_)] => text.len() > 2,
        };
        meant.then_some(pair)
    })
}

/// The pressure [Pa] of a group in hectopascals (850 to 1100) or hundredths of an inch of mercury (25 to 32.5 inches),
/// as in `Q1013`, `A2992`, `QNH2992INS` or `Q1013/A2992`; the inner option is none where it was not measured.
pub(super) fn pressure_pa(text: &str) -> Option<Option<f64>> {
    let hpa = |text: &str| {
        let (whole, tenths) = text.split_once('.').unwrap_or((text, "0"));
        let known = (digits(whole, 4) || digits(whole, 3)) && digits(tenths, 1);
        let hpa: f64 = known.then(|| text.parse().ok()).flatten()?;
        (850.0..=1100.0).contains(&hpa).then_some(hpa * 100.0)
    };
    let inches = |text: &str| {
        let inches = match text.split_once('.') {
            Some((whole, part)) if digits(whole, 2) && digits(part, 2) => text.parse().ok()?,
            Some(_) => return None,
            None => number(text, 4)? / 100.0,
        };
        (25.0..=32.5)
            .contains(&inches)
            .then_some(inches * INCH_OF_MERCURY_PA)
    };
    let unknown = |text: &str| slashes(text, 2) || ["NNNN", "XXXX", "MMMM"].contains(&text);
    // The same in another unit may follow.
    let whole = match text.split_once('/') {
        Some((first, second)) if first.len() > 3 && !slashes(second, 1) => {
            let second = second.trim_start_matches(['A', 'Q']);
            (hpa(second).is_some() || inches(second).is_some()).then_some(first)?
        }
        _ => text,
    };
    if let Some(body) = whole.strip_suffix("INS") {
        let body = body.trim_start_matches("QNH").trim_start_matches('A');
        return inches(body).map(Some);
    }
    let body = whole
        .strip_suffix("HPA")
        .or(whole.strip_suffix("MB"))
        .unwrap_or(whole);
    if let Some(body) = body.strip_prefix("QNH").or(body.strip_prefix('Q')) {
        return match unknown(body) {
            true => Some(None),
            false => hpa(body).map(Some),
        };
    }
    let body = whole.strip_prefix('A')?;
    match unknown(body) {
        true => Some(None),
        false => inches(body).map(Some),
    }
}

/// Pressure at sea level [Pa] of a remark, as in `SLP142`.
pub(super) fn sea_level_pa(text: &str) -> Option<f64> {
    let tenths = number(text.strip_prefix("SLP")?, 3)? / 10.0;
    Some(100.0 * tenths + if tenths < 50.0 { 100_000.0 } else { 90_000.0 })
}

/// Temperature and dew point [°C] in tenths, of a remark, as in `T00640036` or `T1017`.
pub(super) fn tenths(text: &str) -> Option<[Option<f64>; 2]> {
    let body = text.strip_prefix('T').filter(|body| body.is_ascii())?;
    let one = |at: usize| {
        let part = body.get(at..at + 4).filter(|part| digits(part, 4))?;
        let value = number(&part[1..], 3)? / 10.0;
        match part.as_bytes()[0] {
            b'0' => Some(value),
            b'1' => Some(-value),
            _ => None,
        }
    };
    match body.len() {
        4 => Some([Some(one(0)?), None]),
        8 => Some([Some(one(0)?), Some(one(4)?)]),
        _ => None,
    }
}

/// Whether `text` is a group that says nothing of the weather now at the aerodrome: visual range and state of a runway,
/// recent weather, state of the sea, colour of a military aerodrome, maintenance.
pub(super) fn is_aside(text: &str) -> bool {
    let recent = || {
        let codes = text.strip_prefix("RE")?;
        (slashes(codes, 2) || present_weather(codes).is_some()).then_some(())
    };
    is_runway(text)
        || is_sea(text)
        || is_colour(text)
        || recent().is_some()
        || ["$", "NSW", "NDV", "RVRNO", "CB", "TCU"].contains(&text)
        || text
            .strip_prefix("QFE")
            .is_some_and(|rest| rest.bytes().all(|b| b.is_ascii_digit() || b == b'/'))
}

/// Visual range or state of a runway: `R27/1200N`, `R04R/3000V4500FT/D`, `R24/290050`, `R88/CLRD//`, `88290595`, `SNOCLO`.
fn is_runway(text: &str) -> bool {
    let signs = |text: &str| {
        let mut bytes = text.bytes();
        bytes.all(|b| b.is_ascii_digit() || b.is_ascii_uppercase() || b"/+-".contains(&b))
    };
    let named = |text: &str| {
        let (runway, state) = text.strip_prefix('R')?.split_once('/')?;
        let (number, side) = runway.split_at_checked(2)?;
        let known = (digits(number, 2) || slashes(number, 2)) && side.len() <= 2;
        (known && signs(side) && signs(state)).then_some(())
    };
    let state = |text: &str| {
        let (runway, state) = text.split_at_checked(2)?;
        let measured = state.len() == 6 && state.bytes().all(|b| b.is_ascii_digit() || b == b'/');
        let cleared = state
            .strip_prefix("CLRD")
            .is_some_and(|rest| rest.len() <= 2);
        (digits(runway, 2) && (measured || cleared)).then_some(())
    };
    named(text).is_some()
        || state(text.strip_prefix('R').unwrap_or(text)).is_some()
        || ["SNOCLO", "R/SNOCLO"].contains(&text)
}

/// Temperature and state of the sea: `W12/S4`, `WM01/H12`, `W///S/`.
fn is_sea(text: &str) -> bool {
    let parts = || {
        let body = text.strip_prefix('W')?;
        let body = body.strip_prefix('M').unwrap_or(body);
        let (temperature, rest) = body.split_at_checked(2)?;
        let waves = rest.strip_prefix('/')?.strip_prefix(['S', 'H'])?;
        let known = |text: &str| text.bytes().all(|b| b.is_ascii_digit() || b == b'/');
        (known(temperature) && (1..=3).contains(&waves.len()) && known(waves)).then_some(())
    };
    parts().is_some()
}

/// Colour of a military aerodrome: `BLU`, `BLU+`, `YLO2`, `BLACKWHT`, `GRN/BLU`.
fn is_colour(text: &str) -> bool {
    const COLOURS: [&str; 11] = [
        "BLACK", "BLU+", "BLU", "WHT", "GRN", "YLO1", "YLO2", "YLO", "AMB", "RED", "/",
    ];
    let mut rest = text;
    while let Some(after) = COLOURS.iter().find_map(|colour| rest.strip_prefix(colour)) {
        rest = after;
    }
    rest.is_empty() && text.bytes().any(|byte| byte.is_ascii_uppercase())
}

/// Whether a trend begins here; what follows does not hold now.
pub(super) fn is_trend(text: &str) -> bool {
    let timed = |prefix: &str| {
        text.strip_prefix(prefix)
            .is_some_and(|rest| rest.len() >= 4 && rest.bytes().all(|b| b.is_ascii_digit()))
    };
    ["TEMPO", "BECMG", "INTER", "TREND", "TEND", "TTF"].contains(&text.trim_end_matches(':'))
        || text.starts_with("PROB")
        || ["FM", "TL", "AT"].into_iter().any(timed)
}
