//! The light of the sky, and what air takes of light.

use crate::check::{Check, Fault, Tolerance, a_fifth_more, times};
use boresight_models::air::atmosphere::{
    Cn2Profile, Hydrometeor, air_density_kgpm3, airlight, extinction_per_m,
    precipitation_extinction_per_m, pressure_at_pa, transmittance,
};
use boresight_models::air::daylight::luminance;
use boresight_models::air::sky::Sky;
use boresight_models::air::weather::Weather;
use glam::DVec3;

pub fn checks() -> Vec<Check> {
    [sky(), extinction(), air(), weather_reports()].concat()
}

/// A sky under a sun to the south.
fn sky_of(elevation_deg: f64, visibility_m: f64, cloud_cover: f64) -> Sky {
    let (sin, cos) = elevation_deg.to_radians().sin_cos();
    Sky::new(DVec3::new(0.0, -cos, sin), visibility_m, cloud_cover, 0.15)
}

fn sky() -> Vec<Check> {
    vec![
        Check {
            model: "sky",
            name: "illuminance under a closed sky, sun at 40°",
            reference: "Krochmann & Seidl 1974 (recalled): 0.3 + 21 sin h klx",
            value: 13.80,
            unit: "klx",
            tolerance: Tolerance::Absolute(0.05),
            mutation: a_fifth_more("elevation of the sun"),
            run: |scale| Ok(sky_of(scale.of(40.0), 10e3, 1.0).global_illuminance_klx()),
        },
        Check {
            model: "sky",
            name: "zenith over horizon of a closed sky",
            reference: "CIE S 011, overcast sky",
            value: 3.0,
            unit: "",
            tolerance: Tolerance::Absolute(1e-3),
            mutation: times("cloud cover", 0.8),
            run: |scale| {
                let grey = sky_of(40.0, 10e3, scale.of(1.0));
                let [zenith, horizon] =
                    [DVec3::Z, DVec3::X].map(|towards| luminance(grey.radiance(towards)));
                Ok(zenith / horizon)
            },
        },
        Check {
            model: "sky",
            name: "illuminance under a clear sky, sun at 60°",
            reference: "Janiczek & DeYoung, USNO Circular 171 (recalled): 10^5.01 lx",
            value: 103.0,
            unit: "klx",
            tolerance: Tolerance::Relative(0.25),
            mutation: times("elevation of the sun", 0.5),
            run: |scale| Ok(sky_of(scale.of(60.0), 23e3, 0.0).global_illuminance_klx()),
        },
        Check {
            model: "sky",
            name: "illuminance at civil dusk, sun at −6°",
            reference: "Explanatory Supplement to the Astronomical Almanac (recalled)",
            value: 3.40,
            unit: "lx",
            tolerance: Tolerance::Relative(0.06),
            mutation: a_fifth_more("depression of the sun"),
            run: |scale| Ok(1e3 * sky_of(scale.of(-6.0), 23e3, 0.0).global_illuminance_klx()),
        },
    ]
}

fn extinction() -> Vec<Check> {
    const KIM: &str = "Kim, McArthur & Korevaar, Proc. SPIE 4214, 2001, by hand";
    let mutation = a_fifth_more("visibility");
    let by_kim = |name, value, tolerance, run| Check {
        model: "extinction-and-air",
        name,
        reference: KIM,
        value,
        unit: "1/km",
        tolerance: Tolerance::Relative(tolerance),
        mutation,
        run,
    };
    vec![
        by_kim(
            "extinction at 1064 nm, visibility 23 km",
            0.0721,
            1e-3,
            |scale| Ok(1e3 * extinction_per_m(scale.of(23e3), 1064e-9)),
        ),
        by_kim(
            "extinction at 1064 nm, visibility 5 km",
            0.3687,
            2e-4,
            |scale| Ok(1e3 * extinction_per_m(scale.of(5e3), 1064e-9)),
        ),
        by_kim(
            "extinction at 1064 nm, visibility 1 km",
            2.8126,
            2e-5,
            |scale| Ok(1e3 * extinction_per_m(scale.of(1e3), 1064e-9)),
        ),
        Check {
            model: "extinction-and-air",
            name: "contrast of a black thing at the visibility",
            reference: "Koschmieder's definition: 2 %",
            value: 0.02,
            unit: "",
            tolerance: Tolerance::Relative(1e-3),
            mutation,
            run: |scale| {
                let beta_pm = extinction_per_m(scale.of(10e3), 550e-9);
                Ok(1.0 - airlight(0.0, beta_pm, 10e3, 1.0))
            },
        },
    ]
}

/// Loss over a kilometre of what falls [dB].
fn loss_db(falls: Hydrometeor, rate_mmph: f64) -> f64 {
    let extinction_pm = precipitation_extinction_per_m(falls, rate_mmph);
    -10.0 * transmittance(extinction_pm, 1e3).log10()
}

fn air() -> Vec<Check> {
    vec![
        Check {
            model: "extinction-and-air",
            name: "loss in rain of 10 mm/h",
            reference: "Carbonneau & Wisely, Proc. SPIE 3232, 1998: 1.076 R^0.67 dB/km",
            value: 5.0330,
            unit: "dB/km",
            tolerance: Tolerance::Relative(1e-4),
            mutation: a_fifth_more("rate"),
            run: |scale| Ok(loss_db(Hydrometeor::Rain, scale.of(10.0))),
        },
        Check {
            model: "extinction-and-air",
            name: "loss in dry snow of 5 mm/h",
            reference: "ITU-R P.1817-1, table 2, by hand",
            value: 50.930,
            unit: "dB/km",
            tolerance: Tolerance::Relative(1e-4),
            mutation: a_fifth_more("rate"),
            run: |scale| Ok(loss_db(Hydrometeor::DrySnow, scale.of(5.0))),
        },
        Check {
            model: "extinction-and-air",
            name: "pressure at 1,000 m",
            reference: "ICAO Doc 7488, table 1",
            value: 898.75,
            unit: "hPa",
            tolerance: Tolerance::Relative(2e-3),
            mutation: a_fifth_more("altitude"),
            run: |scale| Ok(1e-2 * pressure_at_pa(101_325.0, scale.of(1e3))),
        },
        Check {
            model: "extinction-and-air",
            name: "density of dry air at sea level",
            reference: "ICAO standard atmosphere",
            value: 1.2250,
            unit: "kg/m³",
            tolerance: Tolerance::Relative(1e-4),
            mutation: a_fifth_more("pressure"),
            run: |scale| Ok(air_density_kgpm3(scale.of(101_325.0), 288.15, 0.0)),
        },
        Check {
            model: "extinction-and-air",
            name: "Cn² by day, 80 m above the displacement height, over that at 10 m",
            reference: "Wyngaard, Izumi & Collins, J. Opt. Soc. Am. 61, 1646, 1971: z^(-4/3)",
            value: 1.0 / 16.0,
            unit: "",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("reference height"),
            run: |scale| {
                let profile = Cn2Profile::Urban {
                    cn2_ref: 1e-14,
                    height_ref_m: scale.of(10.0),
                    displacement_m: 15.0,
                    day: true,
                };
                Ok(profile.cn2(95.0) / 1e-14)
            },
        },
    ]
}

fn weather_reports() -> Vec<Check> {
    vec![
        Check {
            model: "weather-reports",
            name: "15 kt of wind",
            reference: "the nautical mile, 1852 m",
            value: 15.0 * 1852.0 / 3600.0,
            unit: "m/s",
            tolerance: Tolerance::Relative(1e-9),
            mutation: a_fifth_more("knots in the report"),
            run: |scale| {
                let knots = scale.of(15.0);
                let text = format!("EDDF 121150Z 240{knots:02.0}KT 4000 BR 12/07 Q1013");
                Ok(Weather::from_metar(&text)
                    .map_err(Fault::of)?
                    .wind_speed_mps)
            },
        },
        Check {
            model: "weather-reports",
            name: "29.92 inHg of pressure",
            reference: "the inch of mercury, 3,386.389 Pa",
            value: 1_013.208,
            unit: "hPa",
            tolerance: Tolerance::Relative(1e-5),
            mutation: times("hundredths in the report", 1.01),
            run: |scale| {
                let hundredths = scale.of(2992.0);
                let text = format!("KJFK 121151Z 24015KT 10SM CLR 12/07 A{hundredths:04.0}");
                Ok(1e-2 * Weather::from_metar(&text).map_err(Fault::of)?.pressure_pa)
            },
        },
        Check {
            model: "weather-reports",
            name: "relative humidity of 12 °C with a dew point of 7 °C",
            reference: "saturation pressures over water, IAPWS-95: 10.021 and 14.028 hPa",
            value: 10.021 / 14.028,
            unit: "",
            tolerance: Tolerance::Relative(2e-3),
            mutation: a_fifth_more("dew point"),
            run: |scale| {
                let dew_c = scale.of(7.0);
                let text = format!("EDDF 121150Z 24015KT 4000 BR 12/{dew_c:02.0} Q1013");
                Ok(Weather::from_metar(&text)
                    .map_err(Fault::of)?
                    .relative_humidity)
            },
        },
    ]
}
