//! Systems that a raster's keys define by their parameters, as PROJ strings (OGC GeoTIFF 1.1, clause 7 and annex C).

use crate::projection::definition_of;
use crate::sources::unit;
use geotiff_core::geokeys::{self as key, GeoKeyDirectory, GeoKeyValue};

/// Codes that name nothing: undefined and user-defined.
pub const NONE: [u16; 2] = [0, 32_767];

const LINEAR_UNIT_SIZE: u16 = 3077;
const ANGULAR_UNIT_SIZE: u16 = 2055;
const ELLIPSOID: u16 = 2056;
const SEMI_MAJOR_AXIS: u16 = 2057;
const SEMI_MINOR_AXIS: u16 = 2058;
const INV_FLATTENING: u16 = 2059;
const PRIME_MERIDIAN: u16 = 2051;
const PRIME_MERIDIAN_LONG: u16 = 2061;
const TO_WGS84: u16 = 2062;
/// EPSG's code of the meridian of Greenwich.
const GREENWICH: u16 = 8901;

/// Parameters of projections: the keys that may hold each, the one of the specification first.
const PARALLEL_1: &[u16] = &[3078];
const PARALLEL_2: &[u16] = &[3079];
const LONGITUDE: &[u16] = &[3080, 3084, 3088, 3095];
const LATITUDE: &[u16] = &[3081, 3085, 3089];
const EASTING: &[u16] = &[3082, 3086, 3090];
const NORTHING: &[u16] = &[3083, 3087, 3091];
const SCALE: &[u16] = &[3092, 3093];
const POLE_LONGITUDE: &[u16] = &[3095, 3080];

/// EPSG's codes of ellipsoids and PROJ's names for them.
const ELLIPSOIDS: [(u16, &str); 14] = [
    (1024, "GRS80"),
    (7001, "airy"),
    (7002, "mod_airy"),
    (7003, "aust_SA"),
    (7004, "bessel"),
    (7008, "clrk66"),
    (7015, "evrst30"),
    (7019, "GRS80"),
    (7022, "intl"),
    (7024, "krass"),
    (7030, "WGS84"),
    (7036, "GRS67"),
    (7043, "WGS72"),
    (7050, "aust_SA"),
];

/// What the map of web pages is called: a sphere's, on WGS 84's latitudes.
const WEB: [&str; 5] = [
    "pseudo-mercator",
    "pseudo mercator",
    "web_mercator",
    "web mercator",
    "auxiliary_sphere",
];
const SPHERE_OF_THE_WEB: &str = "+proj=merc +a=6378137 +b=6378137 +lat_ts=0 +k=1 +nadgrids=@null";

/// What is wrong with keys that define a system: it, in words behind "its keys define".
type Fault = String;

/// Metres in the unit of the map, or degrees in that of a geographic system, as the keys state it; `None` where they state none. Fails
/// with the code of a unit that is not known.
pub fn map_unit(keys: &GeoKeyDirectory, geographic: bool) -> Result<Option<f64>, u16> {
    let [code, size] = match geographic {
        true => [key::GEOG_ANGULAR_UNITS, ANGULAR_UNIT_SIZE],
        false => [key::PROJ_LINEAR_UNITS, LINEAR_UNIT_SIZE],
    };
    let sized = number(keys, &[size]).filter(|size| *size > 0.0);
    match keys.get_short(code) {
        None | Some(0) => Ok(None),
        // A user's own: metres or radians in it.
        Some(32_767) if geographic => Ok(sized.map(f64::to_degrees)),
        Some(32_767) => Ok(sized),
        Some(code) if geographic => unit::degrees(code).map(Some).ok_or(code),
        Some(code) => unit::by_code(code).map(Some).ok_or(code),
    }
}

/// The PROJ string of a geographic system that the keys define.
pub fn geographic(keys: &GeoKeyDirectory) -> Result<String, Fault> {
    Ok(format!("+proj=longlat {} +no_defs", datum(keys)?))
}

/// The PROJ string of a projection that the keys define.
pub fn projected(keys: &GeoKeyDirectory) -> Result<String, Fault> {
    let unit = |geographic: bool, or: f64| {
        map_unit(keys, geographic)
            .map(|unit| unit.unwrap_or(or))
            .map_err(|code| format!("a projection in the unit {code}, which is not known here"))
    };
    let [unit_m, angle_deg] = [unit(false, 1.0)?, unit(true, 1.0)?];
    let web = keys.get_short(key::PROJ_COORD_TRANS) == Some(7) && cited(keys, &WEB);
    let datum = if web { String::new() } else { datum(keys)? };
    let tail = format!("{datum} +to_meter={unit_m} +no_defs");
    // UTM by its own code: 16001 to 16060 in the north, 16101 to 16160 in the south.
    if let Some(utm @ (16_001..=16_060 | 16_101..=16_160)) = keys.get_short(key::PROJECTION) {
        let south = if utm > 16_100 { " +south" } else { "" };
        return Ok(format!("+proj=utm +zone={}{south} {tail}", utm % 100));
    }
    let of = |name: &str, ids: &[u16], unit: f64| {
        number(keys, ids).map(|value| format!("+{name}={}", value * unit))
    };
    let needed = |name: &str, ids: &[u16], unit: f64| {
        of(name, ids, unit)
            .ok_or_else(|| format!("a projection without {name} (GeoKey {})", ids[0]))
    };
    let angle = |name: &str, ids: &[u16]| needed(name, ids, angle_deg);
    let latitude_deg = number(keys, LATITUDE).map(|value| value * angle_deg);
    let scale = || of("k_0", SCALE, 1.0).unwrap_or_default();
    let first = || angle("lat_1", PARALLEL_1);
    let origin = || -> Result<String, Fault> {
        Ok(format!(
            "{} {}",
            angle("lat_0", LATITUDE)?,
            angle("lon_0", LONGITUDE)?
        ))
    };
    let Some(method) = keys.get_short(key::PROJ_COORD_TRANS) else {
        return Err("a projection without a method (ProjCoordTrans)".into());
    };
    let own = match method {
        1 => format!("+proj=tmerc {} {}", origin()?, scale()),
        // The map of web pages is a sphere's, on WGS 84's latitudes.
        7 if web => format!("{SPHERE_OF_THE_WEB} {}", angle("lon_0", LONGITUDE)?),
        // Without a scale the latitude of origin is that of true scale, as GDAL reads it.
        7 if number(keys, PARALLEL_1).is_none()
            && latitude_deg.is_some_and(|latitude| latitude != 0.0)
            && number(keys, SCALE).is_none_or(|scale| scale == 1.0) =>
        {
            format!(
                "+proj=merc {} {}",
                angle("lat_ts", LATITUDE)?,
                angle("lon_0", LONGITUDE)?
            )
        }
        7 => match of("lat_ts", PARALLEL_1, angle_deg) {
            Some(parallel) => format!("+proj=merc {parallel} {}", angle("lon_0", LONGITUDE)?),
            None => format!("+proj=merc {} {}", angle("lon_0", LONGITUDE)?, scale()),
        },
        8 => format!(
            "+proj=lcc {} {} {}",
            first()?,
            angle("lat_2", PARALLEL_2)?,
            origin()?
        ),
        9 => format!(
            "+proj=lcc {} {} {}",
            angle("lat_1", LATITUDE)?,
            origin()?,
            scale()
        ),
        10 => format!("+proj=laea {}", origin()?),
        11 => format!(
            "+proj=aea {} {} {}",
            first()?,
            angle("lat_2", PARALLEL_2)?,
            origin()?
        ),
        12 => format!("+proj=aeqd {}", origin()?),
        14 => format!("+proj=stere {} {}", origin()?, scale()),
        15 => {
            let latitude_deg = latitude_deg.ok_or("a projection without lat_ts (GeoKey 3081)")?;
            let pole = if latitude_deg < 0.0 { -90 } else { 90 };
            let turned = angle("lon_0", POLE_LONGITUDE)?;
            match latitude_deg.abs() < 90.0 {
                true => format!("+proj=stere +lat_0={pole} +lat_ts={latitude_deg} {turned}"),
                false => format!("+proj=stere +lat_0={pole} {turned} {}", scale()),
            }
        }
        16 => format!("+proj=sterea {} {}", origin()?, scale()),
        17 => {
            let parallel = of("lat_ts", PARALLEL_1, angle_deg).unwrap_or_default();
            format!("+proj=eqc {parallel} {}", origin()?)
        }
        24 => format!("+proj=sinu {}", angle("lon_0", LONGITUDE)?),
        other => return Err(format!("a projection by method {other} (ProjCoordTrans)")),
    };
    let shift = |name: &str, ids: &[u16]| of(name, ids, unit_m).unwrap_or_default();
    let [east, north] = [shift("x_0", EASTING), shift("y_0", NORTHING)];
    let words = format!("{own} {east} {north} {tail}");
    Ok(words.split_whitespace().collect::<Vec<_>>().join(" "))
}

/// Whether what the keys call their system holds one of some words.
fn cited(keys: &GeoKeyDirectory, words: &[&str]) -> bool {
    let names = [key::PROJ_CITATION, key::GT_CITATION, key::GEOG_CITATION];
    let names = names.iter().filter_map(|id| keys.get_ascii(*id));
    let names: Vec<String> = names.map(str::to_lowercase).collect();
    words
        .iter()
        .any(|word| names.iter().any(|name| name.contains(word)))
}

/// Ellipsoid, shift and meridian of a system: those of its geographic code, or of the code of its datum, or by their own keys.
fn datum(keys: &GeoKeyDirectory) -> Result<String, Fault> {
    let code = |id: u16| keys.get_short(id).filter(|code| !NONE.contains(code));
    // EPSG numbers the old datums 2000 above their geographic systems.
    let of_datum = code(key::GEODETIC_DATUM).and_then(|datum| datum.checked_sub(2000));
    let known = code(key::GEODETIC_CRS_TYPE).or(of_datum);
    let known = known.and_then(definition_of).map(|text| {
        let words = text.split_whitespace();
        let own = words.filter(|word| !word.starts_with("+proj=") && *word != "+no_defs");
        own.collect::<Vec<_>>().join(" ")
    });
    let (axis_m, flattening) = (
        number(keys, &[SEMI_MAJOR_AXIS]),
        number(keys, &[INV_FLATTENING]),
    );
    let minor_m = number(keys, &[SEMI_MINOR_AXIS]);
    let ellipsoid = code(ELLIPSOID);
    let by_code = ELLIPSOIDS.iter().find(|row| Some(row.0) == ellipsoid);
    let mut words = match (known, by_code, axis_m, flattening, minor_m) {
        (Some(known), ..) => known,
        (_, Some((_, name)), ..) => format!("+ellps={name}"),
        // PROJ's Clarke 1880 is another than EPSG's.
        _ if ellipsoid == Some(7012) => "+a=6378249.145 +rf=293.465".into(),
        (_, _, Some(a_m), Some(rf), _) if rf > 1.0 => format!("+a={a_m} +rf={rf}"),
        (_, _, Some(a_m), _, Some(b_m)) => format!("+a={a_m} +b={b_m}"),
        (_, _, Some(a_m), ..) => format!("+a={a_m} +b={a_m}"),
        _ => {
            return Err(match ellipsoid {
                Some(code) => format!("a system on the ellipsoid {code}, which is not known here"),
                None => "a system without an ellipsoid".into(),
            });
        }
    };
    if let Some(shift) = keys
        .get_double(TO_WGS84)
        .filter(|shift| [3, 7].contains(&shift.len()))
    {
        let kept = words
            .split_whitespace()
            .filter(|word| !word.starts_with("+towgs84="));
        let shift: Vec<String> = shift.iter().map(f64::to_string).collect();
        words = kept.collect::<Vec<_>>().join(" ") + " +towgs84=" + &shift.join(",");
    }
    let meridian = number(keys, &[PRIME_MERIDIAN_LONG]).filter(|degrees| *degrees != 0.0);
    match (meridian, code(PRIME_MERIDIAN)) {
        _ if words.contains("+pm=") => {}
        (Some(angle), _) => {
            let unit_deg = map_unit(keys, true).ok().flatten().unwrap_or(1.0);
            words += &format!(" +pm={}", angle * unit_deg);
        }
        (None, None | Some(GREENWICH)) => {}
        (None, Some(code)) => return Err(format!("a system of the prime meridian {code}")),
    }
    Ok(words)
}

/// Whether a PROJ string has an ellipsoid beside the Earth's, without a shift to it.
pub fn is_unshifted(text: &str) -> bool {
    let shifts = ["+towgs84=", "+datum=", "+nadgrids="];
    let earths = [
        "+ellps=WGS84",
        "+ellps=GRS80",
        "+ellps=WGS72",
        "+a=6378137 ",
    ];
    !shifts.iter().chain(&earths).any(|word| text.contains(word))
}

/// The number of the first key that is there.
fn number(keys: &GeoKeyDirectory, ids: &[u16]) -> Option<f64> {
    let value = |id: &u16| match &keys.get(*id)?.value {
        GeoKeyValue::Double(values) => values.first().copied(),
        GeoKeyValue::Short(value) => Some(f64::from(*value)),
        GeoKeyValue::Ascii(_) => None,
    };
    ids.iter().find_map(value).filter(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::projection::Crs;
    use glam::DVec3;

    fn keys(shorts: &[(u16, u16)], doubles: &[(u16, &[f64])]) -> GeoKeyDirectory {
        let mut keys = GeoKeyDirectory::default();
        for (id, value) in shorts {
            keys.set(*id, GeoKeyValue::Short(*value));
        }
        for (id, values) in doubles {
            keys.set(*id, GeoKeyValue::Double(values.to_vec()));
        }
        keys
    }

    /// The same place by EPSG's code and by keys with EPSG's parameters.
    #[test]
    fn parameters_say_what_the_code_says() {
        const FOOT_M: f64 = 1200.0 / 3937.0;
        type Case<'c> = (&'c str, &'c [(u16, u16)], &'c [(u16, &'c [f64])], [f64; 2]);
        let cases: [Case; 11] = [
            (
                "EPSG:31467",
                &[(2048, 4314), (3075, 1)],
                &[
                    (3080, &[9.0]),
                    (3081, &[0.0]),
                    (3082, &[3_500_000.0]),
                    (3083, &[0.0]),
                    (3092, &[1.0]),
                ],
                [3_500_123.0, 5_300_456.0],
            ),
            (
                "EPSG:32733",
                &[(2048, 4326), (3074, 16_133)],
                &[],
                [500_100.0, 6_200_200.0],
            ),
            (
                "EPSG:2154",
                &[(2048, 4171), (3075, 8)],
                &[
                    (3078, &[49.0]),
                    (3079, &[44.0]),
                    (3084, &[3.0]),
                    (3085, &[46.5]),
                    (3086, &[700_000.0]),
                    (3087, &[6_600_000.0]),
                ],
                [652_000.0, 6_862_000.0],
            ),
            (
                "EPSG:3035",
                &[(2048, 4258), (3075, 10)],
                &[
                    (3088, &[10.0]),
                    (3089, &[52.0]),
                    (3082, &[4_321_000.0]),
                    (3083, &[3_210_000.0]),
                ],
                [4_400_000.0, 3_100_000.0],
            ),
            (
                "EPSG:5070",
                &[(2050, 6269), (3075, 11)],
                &[
                    (3078, &[29.5]),
                    (3079, &[45.5]),
                    (3080, &[-96.0]),
                    (3081, &[23.0]),
                    (3082, &[0.0]),
                    (3083, &[0.0]),
                ],
                [-1_500_000.0, 1_900_000.0],
            ),
            (
                "EPSG:3031",
                &[(2048, 4326), (3075, 15)],
                &[
                    (3081, &[-71.0]),
                    (3095, &[0.0]),
                    (3092, &[1.0]),
                    (3082, &[0.0]),
                    (3083, &[0.0]),
                ],
                [1_100_000.0, -1_300_000.0],
            ),
            (
                "EPSG:28992",
                &[(2048, 4289), (3075, 16)],
                &[
                    (3080, &[5.387_638_888_888_89]),
                    (3081, &[52.156_160_555_555_55]),
                    (3082, &[155_000.0]),
                    (3083, &[463_000.0]),
                    (3092, &[0.999_907_9]),
                ],
                [84_000.0, 447_000.0],
            ),
            (
                "EPSG:31370",
                &[(2048, 4313), (3075, 8)],
                &[
                    (3078, &[51.166_667_233_333_33]),
                    (3079, &[49.833_333_9]),
                    (3080, &[4.367_486_666_666_666]),
                    (3081, &[90.0]),
                    (3082, &[150_000.013]),
                    (3083, &[5_400_088.438]),
                ],
                [150_000.0, 170_000.0],
            ),
            (
                // In US survey feet.
                "EPSG:2263",
                &[(2048, 4269), (3075, 8), (3076, 9003)],
                &[
                    (3078, &[41.033_333_333_333_33]),
                    (3079, &[40.666_666_666_666_66]),
                    (3084, &[-74.0]),
                    (3085, &[40.166_666_666_666_66]),
                    (3086, &[300_000.0 / FOOT_M]),
                    (3087, &[0.0]),
                ],
                [987_654.0, 210_987.0],
            ),
            (
                // The same unit as a user's own.
                "EPSG:2263",
                &[(2048, 4269), (3075, 8), (3076, 32_767)],
                &[
                    (3077, &[FOOT_M]),
                    (3078, &[41.033_333_333_333_33]),
                    (3079, &[40.666_666_666_666_66]),
                    (3084, &[-74.0]),
                    (3085, &[40.166_666_666_666_66]),
                    (3086, &[300_000.0 / FOOT_M]),
                    (3087, &[0.0]),
                ],
                [987_654.0, 210_987.0],
            ),
            (
                "EPSG:3395",
                &[(2056, 7030), (3075, 7)],
                &[(3080, &[0.0]), (3092, &[1.0]), (2062, &[0.0, 0.0, 0.0])],
                [950_000.0, 6_000_000.0],
            ),
        ];
        for (code, shorts, doubles, [x, y]) in cases {
            let text = projected(&keys(shorts, doubles)).unwrap();
            let at = |name: &str| {
                Crs::parse(name)
                    .unwrap()
                    .to_ecef(DVec3::new(x, y, 0.0))
                    .unwrap()
            };
            let apart_m = at(&text).distance(at(code));
            assert!(apart_m < 1e-3, "{code}: {apart_m} m by {text}");
        }
    }

    #[test]
    fn geographic_systems_have_their_ellipsoid_and_meridian() {
        let own = geographic(&keys(
            &[(2056, 7004)],
            &[(2062, &[598.1, 73.7, 418.2]), (2061, &[2.5])],
        ));
        assert_eq!(
            own.unwrap(),
            "+proj=longlat +ellps=bessel +towgs84=598.1,73.7,418.2 +pm=2.5 +no_defs"
        );
        let axes = geographic(&keys(
            &[],
            &[(2057, &[6_378_137.0]), (2059, &[298.257_223_563])],
        ));
        assert_eq!(
            axes.unwrap(),
            "+proj=longlat +a=6378137 +rf=298.257223563 +no_defs"
        );
        assert!(
            geographic(&keys(&[], &[]))
                .unwrap_err()
                .contains("without an ellipsoid")
        );
        let paris = geographic(&keys(&[(2056, 7019), (2051, 8903)], &[]));
        assert!(paris.unwrap_err().contains("8903"));
    }

    #[test]
    fn the_map_of_the_web_is_known_by_its_name() {
        let mut web = keys(
            &[(2048, 4326), (3075, 7)],
            &[(3080, &[0.0]), (3092, &[1.0])],
        );
        let plain = projected(&web).unwrap();
        web.set(
            key::GT_CITATION,
            GeoKeyValue::Ascii("WGS 84 / Pseudo-Mercator|".into()),
        );
        let at = |name: &str| {
            Crs::parse(name)
                .unwrap()
                .to_ecef(DVec3::new(950_000.0, 6_000_000.0, 0.0))
                .unwrap()
        };
        assert!(at(&projected(&web).unwrap()).distance(at("EPSG:3857")) < 1e-3);
        web.set(3080, GeoKeyValue::Double(vec![150.0]));
        let there = Crs::parse(&projected(&web).unwrap()).unwrap();
        let there = there.to_geodetic(DVec3::new(0.0, 0.0, 0.0)).unwrap();
        assert!((there.longitude_rad.to_degrees() - 150.0).abs() < 1e-9);
        assert!(at(&plain).distance(at("EPSG:3857")) > 1e4);
    }

    #[test]
    fn angles_count_in_the_unit_of_the_keys() {
        let gons = keys(&[(2056, 7030), (2054, 9105)], &[(2061, &[10.0])]);
        assert!(geographic(&gons).unwrap().contains("+pm=9 "));
        assert_eq!(map_unit(&gons, true), Ok(Some(0.9)));
        let own = keys(&[(2054, 32_767)], &[(2055, &[1e-3])]);
        assert_eq!(map_unit(&own, true), Ok(Some(1e-3_f64.to_degrees())));
        assert_eq!(map_unit(&keys(&[(3076, 9999)], &[]), false), Err(9999));
        assert!(is_unshifted("+proj=longlat +ellps=bessel +no_defs"));
        assert!(!is_unshifted(
            "+proj=longlat +ellps=bessel +towgs84=1,2,3 +no_defs"
        ));
        assert!(!is_unshifted(
            "+proj=longlat +a=6378137 +rf=298.257223563 +no_defs"
        ));
    }

    #[test]
    fn what_is_missing_or_not_known_is_named() {
        let said = |shorts: &[(u16, u16)]| projected(&keys(shorts, &[])).unwrap_err();
        assert!(said(&[(2048, 4326)]).contains("ProjCoordTrans"));
        assert!(said(&[(2048, 4326), (3075, 8)]).contains("lat_1 (GeoKey 3078)"));
        assert!(said(&[(2048, 4326), (3075, 3)]).contains("method 3"));
        assert!(said(&[(2048, 4326), (3075, 1), (3076, 9999)]).contains("9999"));
    }
}
