use super::*;

fn arguments(extra: &[&str]) -> Arguments {
    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }
    let words = ["georef", "points.csv"].iter().chain(extra);
    <Line as clap::Parser>::try_parse_from(words)
        .unwrap()
        .arguments
}

fn georef(text: &str, extra: &[&str]) -> Result<Georeferenced, GeorefError> {
    let arguments = arguments(extra);
    let (points, crs, stated) = parse(text, Path::new("points.csv"), &arguments)?;
    place(points, crs, stated, &arguments)
}

/// A campus surveyed in RD New and NAP: the model is the city's map about (84500, 446500), turned by 30° and scaled by 1.001.
fn survey(header: &str, swap: bool) -> String {
    let local = [
        [-330.0, -180.0, 1.2],
        [-120.0, 210.0, 24.0],
        [350.0, 160.0, 3.4],
        [290.0, -230.0, 41.0],
        [20.0, -15.0, 2.0],
        [-280.0, 140.0, 12.5],
        [140.0, 60.0, 33.0],
    ];
    let (sin, cos) = 30_f64.to_radians().sin_cos();
    let place = |[x, y, z]: [f64; 3]| {
        [
            84_500.0 + 1.001 * (cos * x - sin * y),
            446_500.0 + 1.001 * (sin * x + cos * y),
            1.001 * z,
        ]
    };
    let mut places: Vec<_> = local.iter().map(|r| place(*r)).collect();
    if swap {
        places.swap(4, 6);
    }
    let row = |(k, (r, p)): (usize, (&[f64; 3], &[f64; 3]))| {
        format!(
            "{},{},{},{},{},{},{}\n",
            k + 1,
            r[0],
            r[1],
            r[2],
            p[0],
            p[1],
            p[2]
        )
    };
    let rows: String = local.iter().zip(&places).enumerate().map(row).collect();
    format!("# a survey\n{header}\n{rows}")
}

const HEADER: &str = "name,x,y,z,east,north,height";

#[test]
fn a_survey_in_a_projected_system_is_fitted() {
    let found = georef(&survey(HEADER, false), &["--crs", "EPSG:7415"]).unwrap();
    // RD New's own scale (0.99993 here), its curvature and the geoid's slope over 700 m remain.
    assert!(found.fit.rms_m < 0.01, "{}", found.fit.rms_m);
    assert!(
        (found.fit.placement.scale - 1.001).abs() < 2e-4,
        "{}",
        found.fit.placement.scale
    );
    assert!(found.sound() && found.suspects.is_empty());
    let text = found.to_text();
    assert!(
        text.contains("scale") && text.contains("14 degrees of freedom"),
        "{text}"
    );
    let back: toml::Value = toml::from_str(&found.to_toml().unwrap()).unwrap();
    assert_eq!(back["points"].as_array().unwrap().len(), 7);
    assert_eq!(back["fit"]["covariance"].as_array().unwrap().len(), 7);
    assert!(
        georef(
            &survey(HEADER, false),
            &["--crs", "EPSG:7415", "--fixed-scale"]
        )
        .unwrap()
        .fit
        .rms_m
            > 0.1
    );
    let paper = georef(&survey(HEADER, false), &["--crs", "EPSG:7415", "--paper"]).unwrap();
    assert!(
        paper.fit.rms_m < 0.02 && paper.fit.degrees_of_freedom == 16,
        "{}",
        paper.fit.rms_m
    );
}

#[test]
fn heights_of_another_kind_move_it_up() {
    let up_m = |extra: &[&str]| {
        georef(&survey(HEADER, false), extra)
            .unwrap()
            .fit
            .site
            .origin()
            .height_m
    };
    let geoid = up_m(&["--crs", "EPSG:7415"]);
    let ellipsoid = up_m(&["--crs", "EPSG:28992+ellipsoid"]);
    assert!(
        (42.0..45.0).contains(&(geoid - ellipsoid)),
        "{geoid} {ellipsoid}"
    );
    let stated = up_m(&["--crs", "EPSG:7415", "--geoid-height", "43.4"]);
    assert!((stated - ellipsoid - 43.4).abs() < 1e-3);
}

#[test]
fn a_swapped_pair_is_said_and_left_out() {
    let text = survey(HEADER, true);
    let kept = georef(&text, &["--crs", "EPSG:7415"]).unwrap();
    assert!(
        kept.suspects[0].contains("5 and 7 look swapped"),
        "{:?}",
        kept.suspects
    );
    assert!(!kept.sound() && kept.fit.rms_m > 10.0);
    let left = georef(&text, &["--crs", "EPSG:7415", "--robust"]).unwrap();
    assert!(left.sound() && left.fit.rms_m < 0.01);
    assert!(left.to_text().matches("left out").count() >= 2);
}

#[test]
fn stated_accuracies_are_taken_from_the_file() {
    let text = "id;lon;lat;h;x;y;z;sigma_ground;sigma_height\n\
        A;8.540;47.370;450;0;0;0;0.01;0.02\nB;8.545;47.370;455;377.5;0;5;0.01;0.02\n\
        C;8.540;47.375;460;0;556;10;0.01;0.02\nD;8.545;47.375;452;377.5;556;2;0.01;0.02\n";
    let found = georef(text, &[]).unwrap();
    assert_eq!(found.points[1].sigma_m, [0.01, 0.02]);
    assert!(found.stated && found.variance() == (1.0, "stated accuracies"));
    assert!(found.to_text().contains("times the stated accuracy"));
}

#[test]
fn bad_files_are_one_error_with_its_line() {
    let said = |text: &str, extra: &[&str]| georef(text, extra).unwrap_err().to_string();
    let rows = "1,0,0,0,1,2,3\n2,1,1,1,2,3,x\n";
    assert!(said("", &[]).contains("headings are"));
    assert!(said("a,b\n1,2\n", &[]).contains("headings are"));
    assert!(said(&format!("{HEADER}\n{rows}"), &[]).contains("--crs"));
    let wrong = said(&format!("{HEADER}\n{rows}"), &["--crs", "EPSG:7415"]);
    assert!(wrong.contains(":3: height = 'x'"), "{wrong}");
    let degrees = said(&format!("{HEADER}\n{rows}"), &["--crs", "WGS84"]);
    assert!(degrees.contains("longitude, latitude"), "{degrees}");
    assert!(said(&format!("{HEADER}\n1,0,0,0\n"), &["--crs", "EPSG:7415"]).contains(":2:"));
    let two: String = survey(HEADER, false)
        .lines()
        .take(4)
        .map(|line| format!("{line}\n"))
        .collect();
    assert!(said(&two, &["--crs", "EPSG:7415"]).contains("give 3 or more"));
    let far = said("x,y,z,lon,lat,height\n0,0,0,8,447,3\n", &[]);
    assert!(far.contains(":2:") && far.contains("no point of"), "{far}");
}
