use std::sync::OnceLock;

use super::*;
use crate::models::maths::kinematics::az_el_to_los;

/// Level ground, no houses: what is asked does not depend on the city.
const BASE: &str = r#"name = "test"
duration_s = 20.0
time_utc = 2025-06-21T10:00:00Z

[site]
latitude_deg = 47.4
longitude_deg = 8.5
altitude_m = 455.0

[city]
seed = 3
extent_m = 800.0

[station]
position_enu_m = [0.0, 0.0, 90.0]

[search]
centre_azimuth_deg = 0.0

[[uavs]]
name = "one"
model = "phantom4"
trajectory = { kind = "straight", start_enu_m = [-60.0, 500.0, 120.0], velocity_enu_mps = [6.0, 0.0, 0.0] }
"#;

fn loaded(text: &str) -> Loaded {
    Loaded::parse(text.to_owned(), "s.toml".into(), Vec::new()).unwrap()
}

fn scene<'a>(loaded: &'a Loaded, city: &'a City) -> Scene<'a> {
    let (weather, _, sun) = loaded.weather_and_sun().unwrap();
    Scene {
        loaded,
        city,
        weather,
        sun_dir_enu: sun.sun_dir_enu(),
    }
}

/// The city of all these texts.
fn city() -> &'static City {
    static CITY: OnceLock<City> = OnceLock::new();
    CITY.get_or_init(|| City::generate(&loaded(BASE).scenario.city).unwrap())
}

/// The warnings of a text, as they are printed.
fn said(text: &str) -> Vec<String> {
    let loaded = loaded(text);
    let found = warnings(&scene(&loaded, city()));
    found.iter().map(ToString::to_string).collect()
}

/// [`BASE`] with one text in another's place.
fn with(from: &str, to: &str) -> String {
    assert!(BASE.contains(from), "{from}");
    BASE.replacen(from, to, 1)
}

#[track_caller]
fn one(text: &str, begins: &str, holds: &str) {
    let said = said(text);
    let right = |line: &&String| line.starts_with(begins) && line.contains(holds);
    let found = said.iter().filter(right).count();
    assert_eq!(found, 1, "{begins} {holds}: {said:#?}");
}

#[test]
fn what_makes_sense_is_not_warned_of() {
    assert_eq!(said(BASE), [""; 0]);
    let more = "[[distractors]]\nname = \"gull\"\nkind = \"bird\"\n\
                trajectory = { kind = \"straight\", start_enu_m = [0.0, 300.0, 120.0], velocity_enu_mps = [12.0, 0.0, 0.0] }\n\
                [expect]\noutcome = \"neutralised\"\n[expect.values]\ntime_to_neutralise_s = { at_most = 20.0 }\n";
    assert_eq!(said(&format!("{BASE}{more}")), [""; 0]);
}

#[test]
fn speeds_beyond_a_kind_are_warned_of() {
    let gull = |mps: u32| {
        format!(
            "{BASE}[[distractors]]\nname = \"gull\"\nkind = \"bird\"\ntrajectory = {{ kind = \"straight\", start_enu_m = [0.0, 300.0, 120.0], velocity_enu_mps = [{mps}.0, 0.0, 0.0] }}\n"
        )
    };
    one(
        &gull(600),
        "s.toml:27: distractors[0].trajectory: 'gull' flies 600 m/s",
        "a bird reaches 35 m/s at most; lower",
    );
    assert_eq!(said(&gull(30)), [""; 0]);
    one(
        &with("[6.0, 0.0, 0.0]", "[200.0, 0.0, 0.0]"),
        "s.toml:23: uavs[0].trajectory: 'one' flies 200 m/s",
        "reaches 20 m/s",
    );
    let swarm = |mps: f64| {
        format!(
            "{BASE}[[swarms]]\nname = \"wave\"\ncount = 3\nmodels = [\"matrice200\"]\nformation = \"line\"\nspacing_m = 20.0\nspeed_mps = {mps}\nfrom = [{{ azimuth_deg = 0, distance_m = 300, above_m = 120 }}]\n[tracker]\nasset_enu_m = [0.0, 0.0, 60.0]\n"
        )
    };
    let of_swarm = |mps: f64| {
        let lines = said(&swarm(mps));
        let about = lines
            .into_iter()
            .filter(|line| line.contains("swarms[0].speed_mps"));
        about.collect::<Vec<_>>()
    };
    // Its members have one warning together.
    let fast = of_swarm(60.0);
    assert!(
        fast.len() == 1 && fast[0].contains("'wave' flies 60 m/s"),
        "{fast:#?}"
    );
    assert_eq!(of_swarm(8.0), [""; 0]);
}

#[test]
fn starts_in_something_solid_or_out_of_sight_are_warned_of() {
    let at = |place: &str| with("[-60.0, 500.0, 120.0]", place);
    one(
        &at("[-60.0, 390.0, -80.0]"),
        "s.toml:23: uavs[0].trajectory: 'one' begins",
        "below the ground",
    );
    let city = city();
    let house = city
        .buildings
        .iter()
        .find(|house| house.height_m() > 12.0)
        .unwrap();
    let corners = house.footprint_enu_m();
    let middle = corners.iter().copied().sum::<DVec2>() / corners.len() as f64;
    let up_m = city.dsm.surface_m(middle.x, middle.y) - 4.0;
    let inside = at(&format!("[{:.1}, {:.1}, {up_m:.1}]", middle.x, middle.y));
    one(
        &inside,
        "s.toml:23: uavs[0].trajectory: 'one' begins",
        "below what reaches up to",
    );
    one(
        &at("[-3000.0, 0.0, 120.0]"),
        "s.toml:23: uavs[0].trajectory: 'one' begins outside the city",
        "every search sector",
    );
}

#[test]
fn a_path_into_the_city_is_warned_of() {
    let dive = with("[6.0, 0.0, 0.0]", "[6.0, -5.0, -15.0]");
    one(
        &dive,
        "s.toml:23: uavs[0].trajectory: the path of 'one' leads into the city after",
        "raise the path",
    );
    // What has come to its aim may end there.
    let aimed = format!("{dive}[tracker]\nasset_enu_m = [-36.0, 480.0, 60.0]\n");
    let said = said(&aimed);
    assert!(
        !said.iter().any(|line| line.contains("leads into")),
        "{said:#?}"
    );
}

#[test]
fn what_no_camera_resolves_is_warned_of() {
    let far = with("[-60.0, 500.0, 120.0]", "[-60.0, 30000.0, 2000.0]");
    one(
        &far,
        "s.toml:23: uavs[0].trajectory: 'one' comes no nearer than",
        "px of the finest camera",
    );
}

#[test]
fn a_sector_that_never_contains_the_uav_is_warned_of() {
    let south = with("centre_azimuth_deg = 0.0", "centre_azimuth_deg = 180.0");
    one(
        &south,
        "s.toml:17: search: the sector never contains 'one'",
        "turn or widen",
    );
    let cued = with(
        "centre_azimuth_deg = 0.0",
        "centre_azimuth_deg = 180.0\ncue = { sigma_deg = 0.7 }",
    );
    assert_eq!(said(&cued), [""; 0]);
    // The sector may be too low or too high, too.
    let high = with(
        "centre_azimuth_deg = 0.0",
        "centre_azimuth_deg = 0.0\nelevation_deg = 60.0",
    );
    one(
        &high,
        "s.toml:17: search: the sector never contains 'one'",
        "elevation",
    );
}

#[test]
fn a_run_that_ends_too_early_is_warned_of() {
    // It reaches the asset after half a minute.
    let asset = format!("{BASE}[tracker]\nasset_enu_m = [200.0, 500.0, 120.0]\n");
    one(
        &asset,
        "s.toml:2: duration_s: the run ends after 20 s, before any UAV could reach the asset, after 35",
        "longer",
    );
    let longer = asset.replace("duration_s = 20.0", "duration_s = 50.0");
    assert!(!said(&longer).iter().any(|line| line.contains("duration_s")));
    // Nor is it seen: it climbs out of a cellar.
    let hidden = with(
        "{ kind = \"straight\", start_enu_m = [-60.0, 500.0, 120.0], velocity_enu_mps = [6.0, 0.0, 0.0] }",
        "{ kind = \"straight\", start_enu_m = [0.0, 399.0, -200.0], velocity_enu_mps = [0.0, 0.0, 5.0] }",
    );
    one(
        &hidden,
        "s.toml:2: duration_s: the run ends after 20 s, before any station has a clear sight of 'one'",
        "longer",
    );
}

#[test]
fn the_night_is_warned_of_where_pictures_count() {
    let night = with("T10:00:00Z", "T23:30:00Z");
    one(
        &night,
        "s.toml:3: time_utc: the sun stands",
        "visible light only",
    );
    let blind = format!("{night}[detector]\nkind = \"truth\"\n");
    assert_eq!(said(&blind), [""; 0]);
}

#[test]
fn a_uav_without_an_echo_is_warned_of() {
    let far = BASE.replace("-60.0, 500.0, 120.0", "-60.0, 5000.0, 600.0");
    one(
        &far,
        "s.toml:15: station.position_enu_m: no UAV gives the range finder an echo",
        "nearer",
    );
}

#[test]
fn a_laser_that_heats_nothing_is_warned_of() {
    let laser = |power_w: f64| {
        with(
            "[search]",
            &format!("[station.laser]\npower_w = {power_w}\n[search]"),
        )
    };
    one(
        &laser(3.0),
        "s.toml:18: station.laser.power_w: 3 W bring nothing down",
        "engage.authorised",
    );
    assert_eq!(said(&laser(800.0)), [""; 0]);
    assert_eq!(said(&laser(0.0)), [""; 0]);
    let tracks = format!("{}[engage]\nauthorised = false\n", laser(3.0));
    assert_eq!(said(&tracks), [""; 0]);
}

#[test]
fn expectations_that_no_run_meets_are_warned_of() {
    let expects = |text: &str| format!("{BASE}[expect]\n{text}");
    one(
        &expects("outcome = \"partly_neutralised\"\n"),
        "s.toml:25: expect.outcome: one UAV alone",
        "correct",
    );
    one(
        &expects("[expect.values]\ntime_to_acquire_s = { at_least = 21.0 }\n"),
        "s.toml:26: expect.values.time_to_acquire_s: at_least",
        "beyond the end",
    );
    one(
        &expects("[expect.values]\nleakers = { at_most = -1 }\n"),
        "s.toml:26: expect.values.leakers: at_most",
        "never below 0",
    );
    one(
        &expects(
            "outcome = \"not_acquired\"\n[expect.values]\ntime_to_acquire_s = { at_most = 3.0 }\n",
        ),
        "s.toml:27: expect.values.time_to_acquire_s: a run",
        "lacks it",
    );
    let tracks =
        format!("{BASE}[engage]\nauthorised = false\n[expect]\noutcome = \"neutralised\"\n");
    one(
        &tracks,
        "s.toml:27: expect.outcome: no run ends neutralised while",
        "authorised",
    );
    assert_eq!(said(&expects("outcome = \"neutralised\"\n")), [""; 0]);
}

#[test]
fn an_order_after_the_end_is_warned_of() {
    let order = |t_s: f64| format!("{BASE}[[operator]]\nt_s = {t_s}\nfire = false\n");
    one(
        &order(25.0),
        "s.toml:25: operator[0].t_s: 25 s is after the end",
        "earlier",
    );
    assert_eq!(said(&order(5.0)), [""; 0]);
}

#[test]
fn the_table_says_where_and_how_large_a_uav_is() {
    let loaded = loaded(BASE);
    let text = table(&scene(&loaded, city()));
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 2, "{text}");
    let cells: Vec<&str> = lines[1].split_whitespace().collect();
    // (-60, 500, 30) from the station: 504.5 m, azimuth 353.16 deg, elevation 3.41 deg.
    assert_eq!(cells[..4], ["one", "504", "353.2", "3.4"], "{text}");
    // A degree over 640 px: 36,670 px a radian.
    let model = catalogue::load("phantom4").unwrap();
    let size_m = f64::max(model.size_m[0], model.size_m[1]);
    let want_px = size_m / 504.48 * 36_670.0;
    let found_px: f64 = cells[6].parse().unwrap();
    assert!(
        (found_px - want_px).abs() < 0.01 * want_px + 0.06,
        "{found_px} {want_px}"
    );
    assert_eq!(cells[7..], ["0.0", "504"], "{text}");
    assert!(
        lines[0].contains("search px") && lines[0].contains("precise px"),
        "{text}"
    );
}

#[test]
fn the_first_sight_is_where_the_city_ends() {
    // It rises behind the roof of the highest house.
    let text = with(
        "{ kind = \"straight\", start_enu_m = [-60.0, 500.0, 120.0], velocity_enu_mps = [6.0, 0.0, 0.0] }",
        "{ kind = \"straight\", start_enu_m = [0.0, 390.0, -10.0], velocity_enu_mps = [0.0, 0.0, 10.0] }",
    );
    let loaded = loaded(&text);
    let scene = scene(&loaded, city());
    let (stations, uavs) = (scene.stations(), scene.uavs());
    let sight = scene.sight(&stations[0], &uavs[0], &scene.times_s());
    let (t_s, view) = sight.first.unwrap();
    assert!(t_s > 0.0 && t_s < 12.0, "{t_s}");
    assert!(
        view.range_m >= 390.0 && view.range_m < 420.0,
        "{}",
        view.range_m
    );
    assert!(!scene.clear(stations[0].r_enu_m, uavs[0].at(t_s - STEP_S)));
}

#[test]
fn the_map_has_all_that_the_scenario_has() {
    let text = BASE.replace("\"one\"", "\"one & <two>\"");
    let loaded = loaded(&text);
    let scene = scene(&loaded, city());
    let picture = svg(&scene);
    assert!(picture.starts_with("<svg") && picture.trim_end().ends_with("</svg>"));
    for part in [
        "one &amp; &lt;two&gt;",
        "class=\"scale\"",
        "class=\"north\"",
        ">N</text>",
        "class=\"sector\"",
        ">station</text>",
        " m</text>",
    ] {
        assert!(picture.contains(part), "{part}");
    }
    assert!(picture.matches("<polygon").count() > 20, "houses");
    assert_eq!(picture.matches("<polyline").count(), 1);
    // North is up, east right: the UAV flies to the right above the station.
    let line = picture
        .lines()
        .find(|line| line.starts_with("<polyline"))
        .unwrap();
    let points = line.split('"').nth(1).unwrap();
    let numbers: Vec<f64> = (points.split([',', ' ']))
        .map(|n| n.parse().unwrap())
        .collect();
    let last = numbers.len() - 2;
    assert!(numbers[last] > numbers[0] && (numbers[last + 1] - numbers[1]).abs() < 0.2);
    assert_eq!(az_el_to_los(DVec2::ZERO).y, 1.0);
}
