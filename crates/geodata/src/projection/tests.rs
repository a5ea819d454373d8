use super::*;
use boresight_models::maths::geodesy::SiteFrame;
use proptest::prelude::*;

/// The line where `scripts/projections.py` has put a point with PROJ.
fn points() -> Vec<(String, DVec3, Geodetic)> {
    let table = include_str!(concat!(
        concat!(env!("CARGO_MANIFEST_DIR"), "/../.."),
        "/tests/data/projections.csv"
    ));
    let mut lines = csv::Reader::from_reader(table.as_bytes());
    let row = |row: csv::StringRecord| {
        let number = |k: usize| row[k].parse::<f64>().unwrap();
        let there = Geodetic {
            longitude_rad: number(4).to_radians(),
            latitude_rad: number(5).to_radians(),
            height_m: number(6),
        };
        (
            row[0].into(),
            DVec3::new(number(1), number(2), number(3)),
            there,
        )
    };
    lines.records().map(|found| row(found.unwrap())).collect()
}

/// Distance of two points along the ground, and in height [m].
fn gap_m(a: Geodetic, b: Geodetic) -> [f64; 2] {
    let r = SiteFrame::new(b).ecef_to_enu(
        Geodetic {
            height_m: b.height_m,
            ..a
        }
        .to_ecef(),
    );
    [r.truncate().length(), (a.height_m - b.height_m).abs()]
}

#[test]
fn proj_puts_points_at_the_same_place() {
    let mut worst = Vec::new();
    let (mut largest_m, mut of) = (0.0, String::new());
    for (code, r, there) in points() {
        let crs = Crs::parse(&format!("EPSG:{code}")).unwrap();
        let [ground_m, up_m] = gap_m(crs.to_geodetic(r).unwrap(), there);
        let up_m = if crs.is_geocentric() { up_m } else { 0.0 };
        if ground_m > largest_m {
            (largest_m, of) = (ground_m, code.clone());
        }
        if ground_m.max(up_m) > 1e-3 {
            worst.push(format!("EPSG:{code} {r}: {ground_m:.4} m, {up_m:.4} m"));
        }
        if !crs.is_geocentric() {
            let back = crs.horizontal(crs.to_geodetic(r).unwrap()).unwrap();
            let unit_m = if crs.is_geographic() { 111e3 } else { 1.0 };
            let back_m = back.distance(r.truncate()) * unit_m;
            if back_m > 2e-3 {
                worst.push(format!("EPSG:{code} {r}: {back_m:.4} m on the way back"));
            }
        }
    }
    println!("at most {:.3} mm from PROJ (EPSG:{of})", 1e3 * largest_m);
    assert!(worst.is_empty(), "{}", worst.join("\n"));
}

#[test]
fn the_geoid_has_the_published_heights() {
    // Latitude, longitude [deg], height [m]: the test points that NGA publishes with its program for EGM96, which interpolates in a
    // grid of a quarter degree.
    for (lat, lon, height_m) in [
        (38.628155, 269.779155, -31.628),
        (-14.621217, 305.021114, -2.969),
        (46.874319, 102.448729, -43.575),
        (-23.617446, 133.874712, 15.871),
        (38.625473, 359.9995, 50.066),
        (-0.466744, 0.0023, 17.329),
    ] {
        let exact_m = egm96::egm96_compute_altitude_offset(lat, lon);
        assert!(
            (exact_m - height_m).abs() < 4e-3,
            "{exact_m} against {height_m}"
        );
        let between_m = Geoid::default().height_m(lat.to_radians(), lon.to_radians());
        assert!(
            (between_m - exact_m).abs() < 1e-3,
            "{between_m} against {exact_m}"
        );
    }
}

#[test]
fn heights_over_ellipsoid_and_geoid_are_told_apart() {
    let r = DVec3::new(84_600.0, 447_200.0, 1.5);
    let height_m = |name: &str| Crs::parse(name).unwrap().to_geodetic(r).unwrap().height_m;
    // Over Delft the geoid lies 43.5 m above the ellipsoid (NLGEO2018: 43.4 m).
    assert!(
        (height_m("EPSG:7415") - 45.0).abs() < 0.6,
        "{}",
        height_m("EPSG:7415")
    );
    for same in [
        "EPSG:28992+5709",
        "EPSG:28992",
        "urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5709",
    ] {
        assert_eq!(height_m(same), height_m("EPSG:7415"), "{same}");
    }
    assert_eq!(height_m("EPSG:28992+ellipsoid"), 1.5);
    let constant = Crs::parse("EPSG:7415").unwrap().with_geoid_height(43.4);
    assert!((constant.to_geodetic(r).unwrap().height_m - 44.9).abs() < 1e-12);
    // A GNSS receiver's and a chart's 10 m in Zürich, 47.6 m apart; feet.
    let zurich = DVec3::new(8.5417, 47.3769, 10.0);
    let height_m = |name: &str| {
        Crs::parse(name)
            .unwrap()
            .to_geodetic(zurich)
            .unwrap()
            .height_m
    };
    assert_eq!(height_m("WGS84"), 10.0);
    assert_eq!(height_m("EPSG:4979"), 10.0);
    assert!(
        (height_m("EPSG:4326+5773") - 57.5).abs() < 0.8,
        "{}",
        height_m("EPSG:4326+5773")
    );
    let feet = height_m("EPSG:4326+8228") - height_m("EPSG:4326+5773");
    assert!((feet + 10.0 * (1.0 - 0.3048)).abs() < 1e-9);
}

#[test]
fn vertical_codes_say_what_they_count_from_and_in_which_unit() {
    let zurich = DVec3::new(8.5417, 47.3769, 1000.0);
    let geoid_m = egm96::egm96_compute_altitude_offset(zurich.y, zurich.x);
    // Name, metres in its unit, over the geoid or not.
    for (name, unit_m, over_geoid) in [
        // GeoTIFF 1.0's ellipsoid of WGS 84, of GRS 80; its NAVD88, Newlyn, NGVD29, Yellow Sea, Baltic and Caspian.
        ("EPSG:4326+5030", 1.0, false),
        ("EPSG:4326+5019", 1.0, false),
        ("EPSG:4326+5103", 1.0, true),
        ("EPSG:4326+5101", 1.0, true),
        ("EPSG:4326+5102", 1.0, true),
        ("EPSG:4326+5104", 1.0, true),
        ("EPSG:4326+5105", 1.0, true),
        ("EPSG:4326+5106", 1.0, true),
        // NAVD88 in US survey feet, in feet, in metres; NGVD29 in US survey feet; the sea in feet.
        ("EPSG:4326+6360", 1200.0 / 3937.0, true),
        ("EPSG:4326+8228", 0.3048, true),
        ("EPSG:4326+5703", 1.0, true),
        ("EPSG:4326+5702", 1200.0 / 3937.0, true),
        ("EPSG:4326+8050", 0.3048, true),
        // WGS 84 with EGM2008 and EGM96; three-dimensional systems, ETRS89's also as the vertical part.
        ("EPSG:9518", 1.0, true),
        ("EPSG:9707", 1.0, true),
        ("EPSG:4979", 1.0, false),
        ("EPSG:4937", 1.0, false),
        ("EPSG:7912", 1.0, false),
        ("EPSG:4326+4979", 1.0, false),
        ("EPSG:4258+4937", 1.0, false),
    ] {
        let crs = Crs::parse(name).unwrap_or_else(|error| panic!("{name}: {error}"));
        let found_m = crs.to_geodetic(zurich).unwrap().height_m;
        let want_m = 1000.0 * unit_m + if over_geoid { geoid_m } else { 0.0 };
        // The lattice of the geoid is good to 1 mm.
        assert!(
            (found_m - want_m).abs() < 2e-3,
            "{name}: {found_m} for {want_m}"
        );
        assert!(crs.heights_are_stated(), "{name}");
    }
    // NAD83 in feet of California, with NAVD88 in US survey feet.
    let compound = Crs::parse("EPSG:2229+6360").unwrap();
    let parts = DVec3::new(6_487_000.0, 1_842_000.0, 300.0);
    assert_eq!(compound.height_unit_m(), 0.304_800_609_601_219_2);
    assert!(compound.to_geodetic(parts).unwrap().height_m < 100.0);
    assert_eq!(
        vertical::named_in("NAVD88 height - Geoid12B (ftUS)"),
        Some("5703")
    );
    assert_eq!(
        vertical::named_in("height over the DHHN2016 datum"),
        Some("7837")
    );
    assert_eq!(vertical::named_in("local"), None);
}

#[test]
fn depths_and_other_ellipsoids_are_refused_by_name() {
    for (name, said) in [
        ("EPSG:4326+5715", "MSL depth"),
        ("EPSG:4326+6358", "NAVD88 depth"),
        ("EPSG:4326+5861", "LAT depth"),
        ("EPSG:25832+5004", "Bessel 1841"),
        ("EPSG:25832+5008", "Clarke 1866"),
    ] {
        let error = Crs::parse(name).unwrap_err().to_string();
        assert!(error.contains(said), "{name}: {error}");
    }
}

#[test]
fn what_cannot_lie_on_the_earth_is_refused() {
    for (name, r, said) in [
        (
            "EPSG:4978",
            [4000.0, 5000.0, 9000.0],
            "11 km from the centre",
        ),
        ("EPSG:4978", [4.2e7, 0.0, 0.0], "42000 km"),
        ("EPSG:4979", [8.0, 47.0, 5e5], "height would be 500000 m"),
        ("EPSG:4979", [8.0, 47.0, -20_000.0], "-20000 m"),
        ("EPSG:4326", [8.0, 98.0, 0.0], "no point of"),
        ("EPSG:4326", [401.0, 8.0, 0.0], "no point of"),
        // East and north swapped.
        ("EPSG:25832", [5_334_000.0, 691_000.0, 520.0], "meridian"),
        ("EPSG:31467", [5_400_000.0, 3_500_000.0, 300.0], "meridian"),
    ] {
        let error = Crs::parse(name)
            .unwrap()
            .to_ecef(DVec3::from(r))
            .unwrap_err();
        assert!(error.to_string().contains(said), "{name}: {error}");
    }
    // From 0° to 360°.
    let one = Crs::parse("WGS84").unwrap();
    let [a, b] = [351.5, -8.5].map(|x| one.to_ecef(DVec3::new(x, 40.0, 5.0)).unwrap());
    assert!(a.distance(b) < 1e-8);
}

#[test]
fn a_name_is_understood_or_refused_with_what_to_write() {
    for name in [
        "EPSG:4326",
        "epsg:4326",
        "4326",
        "urn:ogc:def:crs:EPSG::7415",
        "https://www.opengis.net/def/crs/EPSG/0/7415",
        "urn:ogc:def:crs:OGC:1.3:CRS84",
        "WGS 84",
        "+proj=utm +zone=32 +ellps=GRS80 +units=m +no_defs +ellipsoid",
    ] {
        assert!(Crs::parse(name).is_ok(), "{name}");
    }
    for name in [
        "",
        "EPSG:",
        "EPSG:1",
        "ESRI:102100",
        "EPSG:7415+5709+5773",
        "Zürich",
    ] {
        assert!(
            matches!(Crs::parse(name), Err(CrsError::Unknown(_))),
            "{name}"
        );
    }
    assert!(matches!(
        Crs::parse("EPSG:28992+5728000"),
        Err(CrsError::Vertical(_))
    ));
    assert!(matches!(
        Crs::parse("+proj=nothing"),
        Err(CrsError::Unsupported { .. })
    ));
    let swapped = Crs::parse("EPSG:4326")
        .unwrap()
        .to_geodetic(DVec3::new(47.0, 151.0, 0.0));
    assert!(matches!(swapped, Err(CrsError::Outside { .. })));
}

#[test]
fn nearly_all_registered_systems_are_understood() {
    let codes = || (1000..=32_767_u16).filter(|code| crs_definitions::from_code(*code).is_some());
    let understood = |code: &u16| Crs::parse(&format!("EPSG:{code}")).is_ok();
    let (all, known) = (codes().count(), codes().filter(understood).count());
    println!("{known} of {all} systems");
    assert!(known as f64 > 0.95 * all as f64, "{known} of {all}");
}

proptest! {
    #[test]
    fn no_coordinates_panic(x in any::<f64>(), y in any::<f64>(), z in any::<f64>(), k in 0..5_usize) {
        let names = ["EPSG:7415", "EPSG:2056", "EPSG:4978", "EPSG:25832", "EPSG:5514"];
        let crs = Crs::parse(names[k]).unwrap().with_geoid_height(40.0);
        if let Ok(found) = crs.to_geodetic(DVec3::new(x, y, z)) {
            prop_assert!(found.latitude_rad.is_finite() && found.height_m.is_finite());
        }
    }
}
