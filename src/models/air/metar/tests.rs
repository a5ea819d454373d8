use super::*;
use proptest::prelude::*;

fn read(text: &str) -> Weather {
    Weather::from_metar(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

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
            "LSZH 171220Z /////KT 9999 05/04 Q1008",
            14,
            "/////KT",
            "24008KT",
        ),
        (
            "LSZH 171220Z 99912KT 9999 05/04 Q1008",
            14,
            "99912KT",
            "24008KT",
        ),
        ("LSZH 171220Z 24012KT //// 05/04 Q1008", 22, "////", "CAVOK"),
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
        ("LSZH 171220Z 24012KT 9999 05/ Q1008", 27, "05/", "12/07"),
        (
            "LSZH 171220Z 24012KT 9999 ///// Q1008",
            27,
            "/////",
            "12/07",
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
            shown.starts_with("METAR ends before") && shown.contains(mend),
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
