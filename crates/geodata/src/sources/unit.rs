//! Units of length as files and users state them: by EPSG's code or in words.

/// EPSG's code, metres, and the words for it, in lower case.
const UNITS: [(u16, f64, &[&str]); 15] = [
    (
        9001,
        1.0,
        &[
            "m",
            "metre",
            "metres",
            "meter",
            "meters",
            "metro",
            "metros",
            "mètre",
            "mètres",
            "1 m",
            "m asl",
            "masl",
            "m amsl",
            "metre above sea level",
            "meters above sea level",
        ],
    ),
    (
        9002,
        0.3048,
        &[
            "ft",
            "foot",
            "feet",
            "'",
            "international foot",
            "international feet",
            "foot_intl",
            "foot (international)",
            "ft_intl",
            "ift",
            "foot_international",
        ],
    ),
    (
        9003,
        1200.0 / 3937.0,
        &[
            "us survey foot",
            "us survey feet",
            "us-ft",
            "us_ft",
            "usft",
            "ftus",
            "sft",
            "foot_us",
            "us foot",
            "us feet",
            "us_survey_foot",
            "us_survey_feet",
            "survey foot",
            "survey feet",
            "foot (us survey)",
            "ft (us)",
            "ft_us",
            "ussft",
            "us survey ft",
            "ft us survey",
            "foot_survey_us",
        ],
    ),
    (9005, 0.304_797_265_4, &["clarke's foot", "foot_clarke"]),
    (
        9041,
        0.304_799_471_538_676_7,
        &["british foot (sears 1922)"],
    ),
    (9070, 0.304_800_833_333_333_35, &["british foot (1865)"]),
    (9080, 0.304_799_510_248_146_94, &["indian foot"]),
    (9095, 0.304_800_749_1, &["british foot (1936)"]),
    (9014, 1.8288, &["fathom", "fathoms"]),
    (9096, 0.9144, &["yd", "yard", "yards"]),
    (
        9036,
        1000.0,
        &["km", "kilometre", "kilometres", "kilometer", "kilometers"],
    ),
    (
        1033,
        0.01,
        &[
            "cm",
            "centimetre",
            "centimetres",
            "centimeter",
            "centimeters",
        ],
    ),
    (
        1025,
        0.001,
        &[
            "mm",
            "millimetre",
            "millimetres",
            "millimeter",
            "millimeters",
        ],
    ),
    (
        0,
        0.1,
        &["dm", "decimetre", "decimetres", "decimeter", "decimeters"],
    ),
    (0, 0.0254, &["in", "inch", "inches"]),
];

/// Metres in the unit of a code; `None` where it is no length that is known here.
pub fn by_code(code: u16) -> Option<f64> {
    let found = UNITS.iter().find(|unit| unit.0 == code && code != 0);
    found.map(|unit| unit.1)
}

/// Metres in a unit that is written out; `None` where it is no length that is known here.
pub fn by_word(word: &str) -> Option<f64> {
    // Dots and a bracketed plural say nothing more: `m.`, `m a.s.l.`, `meter(s)`.
    let plain = word.to_lowercase().replace("(s)", "s").replace('.', "");
    let plain = plain.trim();
    let inside = |open: char, close: char| plain.strip_prefix(open)?.strip_suffix(close);
    let lower = inside('[', ']').or(inside('(', ')')).unwrap_or(plain);
    let lower = lower.split_whitespace().collect::<Vec<_>>().join(" ");
    let found = UNITS.iter().find(|unit| unit.2.contains(&lower.as_str()));
    found.map(|unit| unit.1)
}

/// Degrees in an angular unit of a code.
pub fn degrees(code: u16) -> Option<f64> {
    Some(match code {
        9102 | 9122 => 1.0,
        9101 => 1_f64.to_degrees(),
        9105 | 9106 => 0.9,
        9103 => 1.0 / 60.0,
        9104 => 1.0 / 3600.0,
        9109 => 1e-6_f64.to_degrees(),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_understood_in_their_usual_spellings() {
        for (words, unit_m) in [
            (
                &[
                    "m", "M", "m.", "meter(s)", "[metres]", "m a.s.l.", "M.A.S.L.",
                ][..],
                1.0,
            ),
            (&["ft", "Foot (International)", "feet"], 0.3048),
            (&["U.S. Survey Feet", "us-ft", "foot_us"], 1200.0 / 3937.0),
            (&["(cm)", "Centimeters"], 0.01),
        ] {
            for word in words {
                assert_eq!(by_word(word), Some(unit_m), "{word}");
            }
        }
        for word in ["", "m/s", "metres above the ellipsoid", "kelvin", "m NAP"] {
            assert_eq!(by_word(word), None, "{word}");
        }
    }
}
