//! Lengths and counts as people write them in attributes and tags.
//!
//! OpenStreetMap documents a number of metres with a decimal point, a unit behind it (m, km, mi, nmi), and feet and inches as `7'4"`
//! (<https://wiki.openstreetmap.org/wiki/Map_features/Units>).

/// How a value was taken that is not one plain number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Loose {
    /// `12,5`: the comma is a decimal point.
    Comma,
    /// `~12`, `ca. 12`: the number is near enough.
    About,
    /// `8-10`: the middle counts.
    Range,
    /// `10;12`: the largest counts.
    List,
}

impl Loose {
    /// What was assumed, said of several values.
    pub fn said(self) -> &'static str {
        match self {
            Self::Comma => "with a comma, taken as the decimal point",
            Self::About => "said to be approximate, taken as they are",
            Self::Range => "given as ranges, of which the middle is taken",
            Self::List => "given as lists, of which the largest is taken",
        }
    }
}

/// A value, and how it was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// The value [m], or a count.
    pub value: f64,
    /// Where it is not one plain number.
    pub loose: Option<Loose>,
}

/// Words before a number that is not exact.
const ABOUT: [&str; 9] = [
    "~",
    "≈",
    "approximately",
    "approx.",
    "approx",
    "about",
    "circa",
    "ca.",
    "c.",
];

/// Metres in a unit of length; `None` where it is none.
fn unit_m(unit: &str) -> Option<f64> {
    Some(
        match unit.trim().trim_end_matches('.').to_lowercase().as_str() {
            "" | "m" | "metre" | "metres" | "meter" | "meters" => 1.0, // [m]
            "cm" => 0.01,                                              // [m]
            "mm" => 0.001,                                             // [m]
            "km" => 1000.0,                                            // [m]
            "mi" | "mile" | "miles" => 1609.344,                       // [m]
            "nmi" => 1852.0,                                           // [m]
            "'" | "ft" | "foot" | "feet" => FOOT_M,
            "\"" | "in" | "inch" | "inches" => INCH_M,
            _ => return None,
        },
    )
}

/// International foot and inch [m].
const FOOT_M: f64 = 0.3048; // [m]
/// A twelfth of it.
const INCH_M: f64 = 0.0254; // [m]

/// A length [m]; `None` where the text is not understood.
pub fn length_m(text: &str) -> Option<Reading> {
    read(text, &quantity_m)
}

/// A count, perhaps with a fraction; `None` where the text is not understood.
pub fn count(text: &str) -> Option<Reading> {
    let plain = |text: &str| {
        let (value, rest, comma) = number(text.trim())?;
        rest.trim().is_empty().then_some((value, comma))
    };
    read(text, &plain)
}

/// One quantity from the start to the end of a text, and whether it has a comma.
type Quantity<'q> = &'q dyn Fn(&str) -> Option<(f64, bool)>;

/// A quantity, a range or a list of them, perhaps an approximate one.
fn read(text: &str, one: Quantity) -> Option<Reading> {
    let text = plain_marks(text);
    let text = text.trim();
    let exact = ABOUT.iter().find_map(|word| {
        let head = text.get(..word.len())?;
        head.eq_ignore_ascii_case(word).then(|| &text[word.len()..])
    });
    let (text, about) = (exact.unwrap_or(text).trim(), exact.is_some());
    let reading = |value: f64, loose: Option<Loose>| {
        let loose = loose.or(about.then_some(Loose::About));
        Some(Reading { value, loose })
    };
    if let Some((value, comma)) = one(text) {
        return reading(value, comma.then_some(Loose::Comma));
    }
    if text.contains(';') {
        let parts = text
            .split(';')
            .map(str::trim)
            .filter(|part| !part.is_empty());
        let values: Option<Vec<f64>> = parts
            .map(|part| one(part).map(|(value, _)| value))
            .collect();
        let values = values.filter(|values| !values.is_empty())?;
        let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        return reading(most, (values.len() > 1).then_some(Loose::List));
    }
    let (low, high) = range(text, one)?;
    reading(low.midpoint(high), Some(Loose::Range))
}

/// The ends of a range `8-10 m`, `8 m – 10 m`, `8 to 10`: a unit behind both holds for both.
fn range(text: &str, one: Quantity) -> Option<(f64, f64)> {
    let dash = ["–", "—", " to ", "-"].into_iter().find_map(|dash| {
        let (low, high) = text.split_once(dash)?;
        (!low.trim().is_empty()).then(|| (low.trim(), high.trim()))
    });
    let (low, high) = dash?;
    let unit = high.trim_start_matches(|c: char| c.is_ascii_digit() || ".,".contains(c));
    let bare = low.chars().all(|c| c.is_ascii_digit() || ".,".contains(c));
    let low = if bare {
        format!("{low}{unit}")
    } else {
        low.to_string()
    };
    let (low, high) = (one(&low)?.0, one(high)?.0);
    (low <= high).then_some((low, high))
}

/// The same with plain marks in place of primes and of quotation marks, as phones and word processors put them.
fn plain_marks(text: &str) -> String {
    let plain = |c: char| match c {
        '′' | '’' | '‘' | '´' | '`' | 'ʹ' => '\'',
        '″' | '”' | '“' | 'ʺ' => '"',
        '−' => '-',
        '\u{a0}' | '\u{202f}' | '\u{2009}' => ' ',
        c => c,
    };
    text.chars()
        .map(plain)
        .collect::<String>()
        .replace("''", "\"")
}

/// The number at the start of a text, what follows it, and whether it has a comma. A comma before three digits may part thousands: no number.
fn number(text: &str) -> Option<(f64, &str, bool)> {
    let digits = text.strip_prefix(['-', '+']).unwrap_or(text);
    let skipped = text.len() - digits.len();
    let end = digits.find(|c: char| !(c.is_ascii_digit() || ".,".contains(c)));
    let (number, rest) = text.split_at(skipped + end.unwrap_or(digits.len()));
    let comma = number.split_once(',');
    if comma.is_some_and(|(_, behind)| behind.len() == 3) {
        return None;
    }
    let value: f64 = number.replace(',', ".").parse().ok()?;
    value.is_finite().then_some((value, rest, comma.is_some()))
}

/// A number with its unit, or feet and inches [m].
fn quantity_m(text: &str) -> Option<(f64, bool)> {
    let (value, rest, comma) = number(text.trim())?;
    let rest = rest.trim();
    let next = rest.find(|c: char| c.is_ascii_digit());
    let Some(next) = next else {
        return Some((value * unit_m(rest)?, comma));
    };
    // Feet, and inches behind them: `5'10"`, `5' 10`, `5'-10"`, `5 ft 10 in`.
    let (unit, inches) = rest.split_at(next);
    let unit = unit.trim().trim_end_matches('-');
    let (inches, inch, _) = number(inches)?;
    let inch = inch.trim();
    let fits = unit_m(unit)? == FOOT_M && (inch.is_empty() || unit_m(inch)? == INCH_M);
    (fits && inches < 12.0 && !comma).then(|| {
        let inches_m = (inches * INCH_M).copysign(value);
        (value * FOOT_M + inches_m, false)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn metres(text: &str) -> Option<f64> {
        length_m(text).map(|reading| reading.value)
    }

    #[test]
    fn every_documented_notation_is_read() {
        for (text, want_m) in [
            ("12", 12.0),
            (" 12.5 ", 12.5),
            ("12 m", 12.0),
            ("12m", 12.0),
            (".5", 0.5),
            ("-3.2", -3.2),
            ("0.1 km", 100.0),
            ("0.5 mi", 804.672),
            ("0.1 nmi", 185.2),
            ("40 ft", 12.192),
            ("40ft", 12.192),
            ("40'", 12.192),
            ("131'3\"", 40.005),
            ("5'10\"", 1.778),
            ("5' 10\"", 1.778),
            ("5'-10\"", 1.778),
            ("5′10″", 1.778),
            ("5’10”", 1.778),
            ("5'10''", 1.778),
            ("5'10", 1.778),
            ("5 ft 10 in", 1.778),
            ("70\"", 1.778),
            ("250 cm", 2.5),
        ] {
            let found = length_m(text).unwrap_or_else(|| panic!("{text}"));
            assert!((found.value - want_m).abs() < 1e-9, "{text}: {found:?}");
            assert_eq!(found.loose, None, "{text}");
        }
    }

    #[test]
    fn loose_values_are_read_and_named() {
        for (text, want_m, loose) in [
            ("~12", 12.0, Loose::About),
            ("ca. 12 m", 12.0, Loose::About),
            ("12,5", 12.5, Loose::Comma),
            ("12,5 m", 12.5, Loose::Comma),
            ("8-10", 9.0, Loose::Range),
            ("8 – 10 m", 9.0, Loose::Range),
            ("10-20 ft", 4.572, Loose::Range),
            ("10' - 20'", 4.572, Loose::Range),
            ("10;12", 12.0, Loose::List),
            ("12 m; 10 m", 12.0, Loose::List),
        ] {
            let want = Reading {
                value: want_m,
                loose: Some(loose),
            };
            let found = length_m(text).unwrap_or_else(|| panic!("{text}"));
            assert!((found.value - want.value).abs() < 1e-9, "{text}: {found:?}");
            assert_eq!(found.loose, want.loose, "{text}");
        }
        assert_eq!(count("2-3").map(|found| found.value), Some(2.5));
        assert_eq!(count("2;4").map(|found| found.value), Some(4.0));
        assert_eq!(count("1.5").map(|found| found.value), Some(1.5));
    }

    #[test]
    fn what_is_no_length_is_none() {
        for text in [
            "",
            "tall",
            "12 storeys",
            "1,200",
            "5'13\"",
            "5 m 10",
            "5'10' 3\"",
            "m",
            "~",
            ";",
            "12-8",
            "1e9",
            "nan",
            "--3",
            "3 12 m",
        ] {
            assert_eq!(metres(text), None, "{text}");
        }
        assert_eq!(count("3 m"), None);
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_not(text in ".*") {
            let _ = (length_m(&text), count(&text));
        }

        #[test]
        fn one_height_is_one_height_in_every_notation(inches in 1..3000_u32) {
            let want_m = f64::from(inches) * 0.0254;
            let [feet, rest] = [inches / 12, inches % 12];
            for text in [
                format!("{want_m}"),
                format!("{want_m:.4} m"),
                format!("{}km", want_m / 1000.0),
                format!("{} mi", want_m / 1609.344),
                format!("{inches}\""),
                format!("{feet}'{rest}\""),
                format!("{feet} ft {rest} in"),
                format!("{} ft", f64::from(inches) / 12.0),
                format!("~{want_m:.4}"),
                format!("{want_m:.4};0.01"),
                format!("{}-{} m", want_m / 2.0, want_m * 1.5),
            ] {
                let found = metres(&text);
                prop_assert!(found.is_some_and(|found| (found - want_m).abs() < 1e-4), "{text}: {found:?}, {want_m}");
            }
        }
    }
}
