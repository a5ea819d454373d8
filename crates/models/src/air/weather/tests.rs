use super::*;

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
fn a_reported_visibility_holds_the_precipitation() {
    // 5 mm/h of rain: 1.076 · 5^0.67 = 3.1632 dB/km = 0.72835 /km of the 0.978 /km at 4 km.
    let rain = read("LSZH 171220Z 24012KT 4000 RA OVC010 05/04 Q1008");
    near(rain.visibility_m, 4000.0);
    near(1e4 * rain.extinction_per_m(550e-9), 9.78);
    // What is left is aerosol of 15.67 km: only that part thins out at 1064 nm, by Kim's 1.3.
    let expected = 0.72835e-3 + (0.978e-3 - 0.72835e-3) * (1064.0_f64 / 550.0).powf(-1.3);
    let got = rain.extinction_per_m(1064e-9);
    assert!((got / expected - 1.0).abs() < 1e-4, "{got} {expected}");
    // More rain than the visibility has room for takes all of it and no more.
    let hazy = read("LSZH 171220Z 24012KT 8000 +RA OVC010 05/04 Q1008");
    for wavelength_m in [550e-9, 1064e-9] {
        near(1e4 * hazy.extinction_per_m(wavelength_m), 4.89);
    }
    // "10 km or more" gives way to the rain, down to 10 km.
    let drizzle = read("LSZH 171220Z 24012KT 9999 -DZ OVC010 05/04 Q1008").visibility_m;
    let light_per_m = precipitation_extinction_per_m(Hydrometeor::Rain, 0.05);
    near(drizzle, 3.912 / (3.912 / OPEN_VISIBILITY_M + light_per_m));
    near(
        read("LSZH 171220Z 24012KT 9999 RA OVC010 05/04 Q1008").visibility_m,
        10_000.0,
    );
}

#[test]
fn other_precipitation_leaves_the_aerosol() {
    let dry = read("LSZH 171220Z 24012KT 8000 NSC 15/04 Q1008");
    let wet = dry.with_precipitation(10.0);
    let rain_per_m = precipitation_extinction_per_m(Hydrometeor::Rain, 10.0);
    near(wet.visibility_m, 3.912 / (3.912 / 8000.0 + rain_per_m));
    for wavelength_m in [550e-9, 1064e-9] {
        let aerosol_per_m = dry.extinction_per_m(wavelength_m);
        near(
            1e4 * wet.aerosol_extinction_per_m(wavelength_m),
            1e4 * aerosol_per_m,
        );
        near(
            1e4 * wet.extinction_per_m(wavelength_m),
            1e4 * (aerosol_per_m + rain_per_m),
        );
    }
    near(wet.with_precipitation(0.0).visibility_m, 8000.0);
    // Moderate rain alone hides more than this report says: without it, open air, not the clearest.
    let shower = read("LSZH 171220Z 24012KT 6000 RA 05/04 Q1008");
    near(shower.aerosol_extinction_per_m(550e-9), 0.0);
    near(
        shower.with_precipitation(0.0).visibility_m,
        OPEN_VISIBILITY_M,
    );
    let cold = Weather {
        temperature_k: 270.0,
        ..dry
    };
    assert!(cold.with_precipitation(1.0).visibility_m < 3.912 / 1.2e-3);
    assert!(cold.with_precipitation(1.0).snow && !wet.snow);
}
