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
    place(
        parse(text, Path::new("points.csv"), &arguments)?,
        &arguments,
    )
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

#[test]
fn what_cannot_lie_on_the_earth_is_one_error() {
    let said = |text: &str, extra: &[&str]| georef(text, extra).unwrap_err().to_string();
    // Points 11 km from the centre of the Earth.
    let deep = "x,y,z,ecef_x,ecef_y,ecef_z\n0,0,0,6000,7000,6100\n100,0,0,6100,7000,6100\n0,100,0,6000,7100,6100\n0,0,50,6000,7000,6150\n";
    let error = said(deep, &[]);
    assert!(
        error.contains(":2:") && error.contains("11 km from the centre"),
        "{error}"
    );
    // Degrees in the columns of metres, latitude under longitude, heights in millimetres, east and north exchanged.
    let head = "x,y,z,longitude,latitude,height";
    let error = said(&format!("{head}\n0,0,0,-33.9,151.2,20\n"), &[]);
    assert!(error.contains("no point of"), "{error}");
    let error = said(&format!("{head}\n0,0,0,8.5,47.4,408000\n"), &[]);
    assert!(error.contains("cannot lie on the Earth"), "{error}");
    let error = said(
        "x,y,z,east,north,height\n0,0,0,5334000,691000,520\n",
        &["--crs", "EPSG:25832"],
    );
    assert!(
        error.contains("cannot lie on the Earth") && error.contains("order"),
        "{error}"
    );
    // Points all over the Earth.
    let far = format!("{head}\n0,0,0,8,47,3\n1,0,0,-120,-47,3\n0,1,0,100,20,3\n1,1,0,8,-80,5\n");
    assert!(georef(&far, &[]).is_err());
}

#[test]
fn a_fit_that_means_nothing_is_one_error() {
    // Rows that do not belong together.
    let lines: Vec<String> = survey(HEADER, false).lines().map(str::to_string).collect();
    let row = |k: usize| lines[k].split(',').map(str::to_string).collect::<Vec<_>>();
    let mixed: String = (0..7)
        .map(|k| {
            let (local, earth) = (row(2 + k), row(2 + (3 * k + 2) % 7));
            format!(
                "{},{},{}\n",
                local[0],
                local[1..4].join(","),
                earth[4..].join(",")
            )
        })
        .collect();
    let error = georef(&format!("{HEADER}\n{mixed}"), &["--crs", "EPSG:7415"])
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("points.csv: fit: residuals") && error.contains("order"),
        "{error}"
    );
    // A model in feet whose unit is said to be the metre.
    let feet: String = lines[2..]
        .iter()
        .map(|line| {
            let f: Vec<&str> = line.split(',').collect();
            let feet = |k: usize| f[k].parse::<f64>().unwrap() / 0.3048;
            format!(
                "{},{},{},{},{}\n",
                f[0],
                feet(1),
                feet(2),
                feet(3),
                f[4..].join(",")
            )
        })
        .collect();
    let text = format!("{HEADER}\n{feet}");
    let error = georef(&text, &["--crs", "EPSG:7415", "--fixed-scale"])
        .unwrap_err()
        .to_string();
    assert!(error.contains("--fixed-scale"), "{error}");
    assert!(georef(&text, &["--crs", "EPSG:7415"]).unwrap().sound());
}

#[test]
fn a_heading_says_what_heights_are_over_and_unused_columns_are_named() {
    let text = |height: &str| {
        format!(
            "x,y,z,lon,lat,{height},remark\n0,0,0,8.540,47.370,450,a\n377.5,0,5,8.545,47.370,455,b\n0,556,10,8.540,47.375,460,c\n\
             377.5,556,2,8.545,47.375,452,d\n"
        )
    };
    let fitted = |height: &str, extra: &[&str]| georef(&text(height), extra).unwrap();
    let up_m = |found: &Georeferenced| found.fit.site.origin().height_m;
    let plain = fitted("height", &[]);
    let said: Vec<_> = plain.warnings.iter().map(ToString::to_string).collect();
    assert!(
        said.len() == 2 && said.iter().any(|line| line.contains("+geoid")),
        "{said:?}"
    );
    assert!(
        said.iter().any(|line| line.contains("'remark'")),
        "{said:?}"
    );
    let over = fitted("orthometric_height", &[]);
    assert!((47.0..48.0).contains(&(up_m(&over) - up_m(&plain))));
    assert_eq!(up_m(&fitted("ellipsoidal_height", &[])), up_m(&plain));
    assert_eq!(fitted("ellipsoidal_height", &[]).warnings.len(), 1);
    let against = fitted("ellipsoidal_height", &["--crs", "EPSG:4326+geoid"]);
    assert!(
        against
            .warnings
            .iter()
            .any(|warning| warning.place == "column of heights")
    );
}

#[test]
fn a_model_across_the_antimeridian_is_placed() {
    let site =
        crate::models::maths::geodesy::SiteFrame::new(crate::models::maths::geodesy::Geodetic {
            latitude_rad: -16.5_f64.to_radians(),
            longitude_rad: std::f64::consts::PI,
            height_m: 10.0, // [m]
        });
    let row = |r: [f64; 3]| {
        let at = site.enu_to_geodetic(r.into());
        let (lon, lat) = (at.longitude_rad.to_degrees(), at.latitude_rad.to_degrees());
        format!(
            "{},{},{},{lon:.12},{lat:.12},{:.6}\n",
            r[0], r[1], r[2], at.height_m
        )
    };
    let rows: String = [
        [-300.0, -200.0, 0.0],
        [300.0, -250.0, 20.0],
        [280.0, 240.0, 5.0],
        [-310.0, 260.0, 12.0],
    ]
    .map(row)
    .concat();
    let found = georef(
        &format!("x,y,z,longitude,latitude,ellipsoidal_height\n{rows}"),
        &[],
    )
    .unwrap();
    assert!(
        found.fit.rms_m < 1e-4 && found.sound(),
        "{}",
        found.fit.rms_m
    );
    let middle_deg = found.fit.site.origin().longitude_rad.to_degrees().abs();
    assert!((middle_deg - 180.0).abs() < 1e-3, "{middle_deg}");
}
