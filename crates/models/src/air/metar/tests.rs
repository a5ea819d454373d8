use super::*;
use proptest::prelude::*;

fn read(text: &str) -> Weather {
    Weather::from_metar(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

const FOOT_M: f64 = 0.3048;

fn near(value: f64, expected: f64) {
    assert!(
        (value - expected).abs() < 1e-6 * expected.abs().max(1.0),
        "{value} not {expected}"
    );
}

#[test]
fn reads_an_icao_report() {
    let weather = read(
        "METAR LSZH 171220Z AUTO 24012G24KT 210V270 6000 -SHRA FEW012 BKN025CB 12/09 Q1008 \
             RESHRA TEMPO 3000 RMK ANY THING=",
    );
    near(weather.wind_speed_mps, 12.0 * 0.514444);
    near(weather.gust_mps.unwrap(), 24.0 * 0.514444);
    near(weather.wind_from_rad, 240_f64.to_radians());
    near(weather.visibility_m, 6000.0);
    near(weather.temperature_k, 285.15);
    near(weather.pressure_pa, 100_800.0);
    near(weather.cloud_cover, 0.75);
    near(weather.cloud_base_m.unwrap(), 2500.0 * 0.3048);
    assert_eq!((weather.snow, weather.ceiling_m()), (false, None));
    near(weather.precipitation_mmph, 1.0);
    // 11.48 hPa over 14.03 hPa, from WMO tables of saturation vapour pressure.
    assert!((weather.relative_humidity - 0.8183).abs() < 1e-3);
}

#[test]
fn reads_a_us_report() {
    let weather = read(
        "KJFK 121251Z VRB03KT 1 1/2SM R04R/3000V4500FT +SN VV008 M03/M05 A2996 RMK AO2 SLP142",
    );
    near(weather.visibility_m, 1.5 * 1609.344);
    near(weather.wind_from_rad, 0.0);
    near(weather.cloud_cover, 1.0);
    assert_eq!((weather.snow, weather.cloud_base_m), (true, None));
    near(weather.temperature_k, 270.15);
    near(weather.precipitation_mmph, 7.0);
    assert!((weather.pressure_pa - 101_456.2).abs() < 0.5);
    near(
        read("KJFK 121251Z 24016KT 10SM CLR 28/23 A2996").visibility_m,
        16_093.44,
    );
    near(
        read("KJFK 121251Z 24016KT M1/4SM FG OVC001 08/08 A2996").visibility_m,
        402.336,
    );
    near(
        read("KJFK 121251Z 24016KT 1/16SM FG OVC001 08/08 A2996").visibility_m,
        100.584,
    );
}

#[test]
fn open_visibility_units_and_sky() {
    let cavok = read("EDDM 010000Z 00000MPS CAVOK 30/10 Q0998");
    assert_eq!(
        (cavok.visibility_m, cavok.cloud_cover, cavok.cloud_base_m),
        (OPEN_VISIBILITY_M, 0.0, None)
    );
    assert_eq!((cavok.wind_speed_mps, cavok.gust_mps), (0.0, None));
    near(
        read("UUEE 312359Z 36005G11MPS 9999 NSC M10/M12 Q1031")
            .gust_mps
            .unwrap(),
        11.0,
    );
    near(
        read("UUEE 312359Z 36005G11MPS 9999 NSC M10/M12 Q1031").wind_from_rad,
        0.0,
    );
    near(
        read("ZBAA 010000Z 180036KMH 9999 SKC 20/10 Q1013").wind_speed_mps,
        10.0,
    );
    near(
        read("ZBAA 010000Z 18036G54KMH 9999 SKC 20/10 Q1013")
            .gust_mps
            .unwrap(),
        15.0,
    );
    near(
        read("SPECI EGLL 010000Z CALM 0000 FG VV/// 04/04 Q1013").visibility_m,
        25.0,
    );
    near(
        read("EGLL 010000Z AUTO 18003KT 9999 // ////// 04/03 Q1013").cloud_cover,
        0.0,
    );
    near(
        read("EGLL 010000Z 18003KT 4000 1500SW BR OVC/// 04/03 Q1013").cloud_cover,
        1.0,
    );
}

#[test]
fn precipitation_rates() {
    for (group, rate) in [
        ("-RA", 1.0),
        ("RA", 5.0),
        ("+TSRA", 20.0),
        ("DZ", 0.25),
        ("-SN", 0.5),
        ("RASN", 5.0),
        ("SNRA", 2.5),
        ("VCSH", 0.0),
        ("FG", 0.0),
        ("-DZ BR", 0.05),
    ] {
        let text = format!("LSZH 171220Z 24012KT 4000 {group} OVC010 05/04 Q1008");
        let weather = read(&text);
        near(weather.precipitation_mmph, rate);
        assert_eq!(
            weather.snow,
            group.trim_start_matches('-').starts_with("SN")
        );
    }
}

#[test]
fn a_closed_layer_has_a_ceiling() {
    let ceiling = |sky: &str| {
        read(&format!("LSZH 171220Z 24012KT 4000 {sky} 05/04 Q1008"))
            .ceiling_m()
            .map(|base_m| base_m / FOOT_M)
    };
    near(ceiling("FEW005 BKN010 OVC020 OVC040").unwrap(), 2000.0);
    for open in ["FEW005 BKN010", "OVC///", "FG VV002", "NSC"] {
        assert_eq!(ceiling(open), None);
    }
}

/// A number and its unit, in SI; none for "-".
fn measured(text: &str) -> Option<f64> {
    let at = text.find(|c: char| c.is_ascii_alphabetic())?;
    let unit = match &text[at..] {
        "kt" => 1852.0 / 3600.0,
        "m/s" | "m" => 1.0,
        "km/h" => 1.0 / 3.6,
        "mi" => 1609.344,
        "ft" => 0.3048,
        "hPa" => 100.0,
        "inHg" => 3386.389,
        unit => panic!("{unit}"),
    };
    Some(text[..at].parse::<f64>().unwrap() * unit)
}

fn agree(found: Option<f64>, expected: Option<f64>, what: &str, report: &str) {
    let same = match (found, expected) {
        (Some(found), Some(expected)) => (found - expected).abs() < 1e-6 * expected.abs().max(1.0),
        (None, None) => true,
        _ => false,
    };
    assert!(same, "{report}: {what} {found:?}, not {expected:?}");
}

/// Reports of some twenty countries against what a reader of FM 15 says of them.
#[test]
fn reports_of_many_countries_state_what_their_table_says() {
    let rows = include_str!("reports.txt").lines();
    let mut count = 0;
    for row in rows.filter(|row| !row.starts_with('#')) {
        count += 1;
        let columns: Vec<&str> = row.split('|').map(str::trim).collect();
        let found = Report::read(columns[0]);
        if columns[1] == "refused" {
            assert!(found.is_err(), "{row}: {found:?}");
            continue;
        }
        let report = found.unwrap_or_else(|error| panic!("{row}: {error}"));
        let [
            text,
            from,
            speed,
            gust,
            visibility,
            sky,
            air,
            pressure,
            falls,
        ] = columns[..]
        else {
            panic!("{row}: columns");
        };
        let from_rad = from.parse().ok().map(|deg: f64| (deg % 360.0).to_radians());
        agree(report.wind_from_rad, from_rad, "direction", text);
        agree(report.wind_speed_mps, measured(speed), "speed", text);
        agree(report.gust_mps, measured(gust), "gust", text);
        match (report.visibility, visibility) {
            (Some(Visibility::Open), "open") | (None, "-") => {}
            (Some(Visibility::Metres(metres)), _) => {
                agree(Some(metres), measured(visibility), "visibility", text);
            }
            (found, _) => panic!("{text}: {found:?}"),
        }
        let (oktas, base) = sky.split_once(' ').unwrap_or((sky, "-"));
        let cover = oktas.parse().ok().map(|oktas: f64| oktas / 8.0);
        agree(report.cloud_cover, cover, "cover", text);
        agree(report.cloud_base_m, measured(base), "base", text);
        let (air, dew) = match air {
            "-" => (None, None),
            _ => air
                .split_once('/')
                .map(|(air, dew)| (air.parse().ok(), dew.parse().ok()))
                .unwrap(),
        };
        agree(report.temperature_c, air, "temperature", text);
        agree(report.dew_point_c, dew, "dew point", text);
        agree(report.pressure_pa, measured(pressure), "pressure", text);
        let (kind, rate) = falls.split_once(' ').unwrap_or(("rain", "0"));
        agree(
            Some(report.falls.rate_mmph),
            rate.parse().ok(),
            "rate",
            text,
        );
        let snow = match report.falls.falling {
            Falling::Rain => false,
            Falling::Snow => true,
            Falling::Unknown => report.temperature_c.unwrap() < 1.0,
        };
        assert_eq!(snow, kind == "snow", "{text}");
    }
    assert!(count > 120, "{count}");
}

#[test]
fn what_is_absent_is_given_or_refused_by_its_key() {
    let given = Given {
        wind_speed_mps: Some(4.0),
        wind_from_rad: Some(1.0),
        visibility_m: Some(7000.0),
        temperature_c: Some(8.0),
        relative_humidity: Some(0.6),
        pressure_pa: Some(99_000.0),
        cloud_cover: Some(0.5),
    };
    let nothing = Report::read("LSZH 171220Z AUTO /////KT //// // ////// ///// Q////").unwrap();
    let weather = nothing.weather(&given).unwrap();
    let found = [
        weather.wind_speed_mps,
        weather.wind_from_rad,
        weather.visibility_m,
        weather.temperature_k,
        weather.relative_humidity,
        weather.pressure_pa,
        weather.cloud_cover,
    ];
    assert_eq!(found, [4.0, 1.0, 7000.0, 281.15, 0.6, 99_000.0, 0.5]);
    // Each of them alone is missed; the sky is taken as clear.
    type Less = fn(&mut Given);
    let cases: [(Less, &str); 6] = [
        (
            |given| given.wind_speed_mps = None,
            "weather.wind_speed_mps",
        ),
        (|given| given.wind_from_rad = None, "weather.wind_from_deg"),
        (|given| given.visibility_m = None, "weather.visibility_m"),
        (|given| given.temperature_c = None, "weather.temperature_c"),
        (
            |given| given.relative_humidity = None,
            "weather.relative_humidity",
        ),
        (|given| given.pressure_pa = None, "weather.pressure_hpa"),
    ];
    for (less, key) in cases {
        let mut given = given;
        less(&mut given);
        let error = nothing.weather(&given).unwrap_err().to_string();
        assert!(
            error.starts_with("METAR states no ") && error.contains(key),
            "{error}"
        );
    }
    let keys: Vec<_> = nothing.assumed.iter().map(|assumed| assumed.key).collect();
    assert_eq!(keys, [Some("precipitation_mmph"), Some("cloud_cover")]);
}

#[test]
fn what_is_taken_is_told() {
    for (report, group, key) in [
        (
            "LSZH 171220Z VRB02KT 9999 NSC 05/04 Q1008",
            "VRB02KT",
            Some("wind_from_deg"),
        ),
        (
            "LSZH 171220Z 240P99KT 9999 NSC 05/04 Q1008",
            "240P99KT",
            Some("wind_speed_mps"),
        ),
        (
            "LSZH 171220Z 24010G//KT 9999 NSC 05/04 Q1008",
            "24010G//KT",
            Some("gust_mps"),
        ),
        (
            "LSZH 171220Z 24010KT 9999 // NSC 05/04 Q1008",
            "//",
            Some("precipitation_mmph"),
        ),
        (
            "LSZH 171220Z 24010KT 9999 UP NSC 05/04 Q1008",
            "UP",
            Some("precipitation_mmph"),
        ),
        (
            "LSZH 171220Z 24010KT 9999 05/04 Q1008",
            "the sky",
            Some("cloud_cover"),
        ),
        (
            "LSZH 171220Z 24010KT 9999 OVC/// 05/04 Q1008",
            "OVC///",
            Some("cloud_base_m"),
        ),
        (
            "LSZH 171220Z 24010KT 2000SW NSC 05/04 Q1008",
            "the visibility",
            Some("visibility_m"),
        ),
        (
            "LSZH 171220Z 24010KT 9999 NSC 05/04 Q1008 A2900",
            "A2900",
            Some("pressure_hpa"),
        ),
        (
            "LSZH 171220Z 24010KT 9999 NSC 05/04 RMK SLP142",
            "SLP142",
            Some("pressure_hpa"),
        ),
        (
            "LSZH 171220Z 24010KT 9999 NSC Q1008 RMK T00560050",
            "T00560050",
            Some("temperature_c"),
        ),
        (
            "LSZH 171220Z 24010KT 9999 NSC 05/04 Q1008 HELLO",
            "HELLO",
            None,
        ),
    ] {
        let told = Report::read(report).unwrap().assumed;
        let brief: Vec<_> = told
            .iter()
            .map(|told| (&told.group[..], told.key))
            .collect();
        assert_eq!(brief, [(group, key)], "{report}");
    }
    let whole = "LSZH 171220Z 24012G24KT 210V270 6000 1500SW R27/1200N -SHRA FEW012 BKN025CB 12/09 Q1008 A2977 RESHRA \
                 WS ALL RWY W12/S4 R27/290050 BLU NOSIG RMK QFE712";
    assert_eq!(Report::read(whole).unwrap().assumed, []);
}

#[test]
fn errors_name_the_group_its_column_and_the_mend() {
    for (text, column, token, mend) in [
        ("hello world", 1, "hello", "LSZH"),
        (
            "LSZH 321220Z 24012KT 9999 05/04 Q1008",
            6,
            "321220Z",
            "171230Z",
        ),
        (
            "LSZH 171220Z 24O12KT 9999 05/04 Q1008",
            14,
            "24O12KT",
            "24008KT",
        ),
        (
            "LSZH 171220Z 99912KT 9999 05/04 Q1008",
            14,
            "99912KT",
            "24008KT",
        ),
        ("LSZH 171220Z 24012KT 999 05/04 Q1008", 22, "999", "CAVOK"),
        (
            "LSZH 171220Z 24012KT 1/0SM 05/04 Q1008",
            22,
            "1/0SM",
            "CAVOK",
        ),
        (
            "LSZH 171220Z 24012KT 9999 RAIN 05/04 Q1008",
            27,
            "RAIN",
            "BKN020",
        ),
        (
            "LSZH 171220Z 24012KT 9999 04/05 Q1008",
            27,
            "04/05",
            "12/07",
        ),
        ("LSZH 171220Z 24012KT 9999 05/04 Q10", 33, "Q10", "Q1013"),
        (
            "LSZH 171220Z 24012KT 9999 05/04 A1008",
            33,
            "A1008",
            "A2992",
        ),
        (
            "LSZH 171220Z VRBV090KT 9999 05/04 Q1008",
            14,
            "VRBV090KT",
            "24008KT",
        ),
    ] {
        let error = Weather::from_metar(text).unwrap_err();
        let shown = error.to_string();
        assert!(
            shown.starts_with(&format!("METAR column {column}: \"{token}\"")),
            "{shown}"
        );
        assert!(shown.contains(mend), "{shown}");
    }
    for (text, mend) in [
        ("", "LSZH"),
        ("LSZH 171220Z", "24008KT"),
        ("LSZH 171220Z 24012KT 9999 OVC010", "12/07"),
        ("LSZH 171220Z 24012KT 9999 OVC010 05/04", "Q1013"),
    ] {
        let shown = Weather::from_metar(text).unwrap_err().to_string();
        assert!(
            shown.starts_with("METAR states no") && shown.contains(mend),
            "{shown}"
        );
    }
}

/// Pieces that steer random reports into every branch.
const PIECES: [&str; 34] = [
    "METAR",
    "AUTO",
    "LSZH",
    "171220Z",
    "24012KT",
    "24012G20KT",
    "P99KT",
    "VRBV090",
    "VRB02KT",
    "180V240",
    "9999",
    "CAVOK",
    "1",
    "1/2SM",
    "1500SW",
    "R27/1200",
    "-RA",
    "+SHSN",
    "//",
    "VV///",
    "OVC010",
    "//////CB",
    "SKC",
    "M03/M04",
    "12/",
    "Q1013",
    "A2992",
    "RMK",
    "WS",
    "TEMPO",
    "NOSIG",
    "=",
    "é",
    "88//",
];

/// What does not change the weather now.
const ASIDES: [&str; 12] = [
    "NOSIG",
    "TEMPO 0500 +TSRA BKN002",
    "BECMG FM1330 36040KT",
    "WS R27",
    "WS ALL RWY",
    "RERA",
    "R27/290050",
    "R88/CLRD//",
    "SNOCLO",
    "W12/S4",
    "BLU+",
    "$",
];

proptest! {
    #[test]
    fn never_panics_on_any_string(text in ".{0,80}") {
        let _ = Weather::from_metar(&text);
    }

    #[test]
    fn never_panics_on_near_reports(picks in proptest::collection::vec(0..PIECES.len(), 0..12)) {
        let text: Vec<&str> = picks.into_iter().map(|pick| PIECES[pick]).collect();
        let _ = Weather::from_metar(&text.join(" "));
    }

    /// The same weather in other units, with other spacing, case and asides, is the same weather.
    #[test]
    fn a_report_in_other_words_states_the_same(
        from in 0_u32..36, speed in 1_u32..50, metres in 1_u32..99, base in 1_u32..200, air in -40_i32..40, hpa in 900_u32..1050,
        asides in proptest::collection::vec(0..ASIDES.len(), 0..4), lower in any::<bool>(), wrapped in any::<bool>(),
    ) {
        let degrees = if air < 0 { format!("M{:02}", -air) } else { format!("{air:02}") };
        let body = format!("{:03}{speed:02}KT {:04} BKN{base:03} {degrees}/M50 Q{hpa:04}", 10 * from, 100 * metres);
        let plain = format!("LSZH 171220Z {body}");
        let asides: Vec<&str> = asides.into_iter().map(|aside| ASIDES[aside]).collect();
        let mut other = format!("METAR COR LSZH 171220Z AUTO {body} {} RMK ANY THING=", asides.join(" "));
        if lower {
            other = other.to_lowercase();
        }
        if wrapped {
            other = other.replace(' ', "\r\n   ");
        }
        let (plain, other) = (Report::read(&plain).unwrap(), Report::read(&other).unwrap());
        prop_assert_eq!(&plain, &other);
        prop_assert!((plain.wind_speed_mps.unwrap() - f64::from(speed) * 0.514_444).abs() < 1e-4);
        prop_assert_eq!(plain.temperature_c, Some(f64::from(air)));
        prop_assert_eq!(plain.pressure_pa, Some(100.0 * f64::from(hpa)));
    }

    /// 5 m/s are 18 km/h, and 8 km are 8,000 m; a mile is eight eighths.
    #[test]
    fn a_report_in_other_units_states_the_same(fives in 1_u32..10, km in 1_u32..10, eighths in 1_u32..8) {
        let wind = |wind: String| Report::read(&format!("LSZH 171220Z 240{wind} 9999 NSC 05/04 Q1008")).unwrap();
        let (metres, km_h) = (wind(format!("{:02}MPS", 5 * fives)), wind(format!("{:03}KMH", 18 * fives)));
        prop_assert!((metres.wind_speed_mps.unwrap() - km_h.wind_speed_mps.unwrap()).abs() < 1e-9);
        let seen = |seen: String| {
            let text = format!("LSZH 171220Z 24005KT {seen} NSC 05/04 Q1008");
            match Report::read(&text).unwrap().visibility {
                Some(Visibility::Metres(metres)) => metres,
                other => panic!("{text}: {other:?}"),
            }
        };
        prop_assert_eq!(seen(format!("{km}KM")), seen(format!("{:04}", 1000 * km)));
        let parts = seen(format!("1 {eighths}/8SM")) - seen(format!("{eighths}/8SM"));
        prop_assert!((parts - seen("1SM".into())).abs() < 1e-9);
    }

    #[test]
    fn a_spoilt_report_is_read_or_refused_with_a_reason(at in 0_usize..60, with in "\\PC") {
        let mut report: Vec<char> =
            "LSZH 171220Z 24012G20KT 180V240 1 1/2SM -RA OVC010CB 05/M04 Q1008".chars().collect();
        report[at] = with.chars().next().unwrap_or('x');
        let text: String = report.into_iter().collect();
        match Weather::from_metar(&text) {
            Ok(weather) => {
                prop_assert!((0.0..=1.0).contains(&weather.relative_humidity));
                prop_assert!((0.0..=1.0).contains(&weather.cloud_cover));
                prop_assert!(weather.visibility_m > 0.0 && weather.wind_speed_mps >= 0.0);
            }
            Err(error) => prop_assert!(error.to_string().starts_with("METAR ")),
        }
    }
}
