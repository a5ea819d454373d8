use std::collections::BTreeSet;

use proptest::prelude::*;
use serde_json::Value;

use super::docs::{schema, uav_schema, words};
use super::*;
use boresight_models::air::wind::over_rough_ground;
use boresight_models::engage::interlock::Zone;
use boresight_models::flight::trajectory::Trajectory;

const GOOD: &str = r#"name = "test"
duration_s = 10
time_utc = 2025-06-21T10:00:00+02:00

[site]
latitude_deg = 47.4
longitude_deg = 8.5
altitude_m = 455.0

[search]
centre_azimuth_deg = 0.0

[[uavs]]
name = "one"
model = "phantom4"
trajectory = { kind = "hover", position_enu_m = [0.0, 500.0, 100.0] }
"#;

fn good() -> Scenario {
    Scenario::parse(GOOD, "good.toml", &[]).unwrap()
}

fn error(text: &str, sets: &[&str]) -> String {
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    Scenario::parse(text, "s.toml", &sets)
        .unwrap_err()
        .to_string()
}

fn with(sets: &[&str]) -> Scenario {
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    Scenario::parse(GOOD, "s.toml", &sets).unwrap()
}

fn shipped() -> Vec<Loaded> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("scenarios");
    let mut paths: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "toml"))
        .collect();
    paths.sort();
    (paths.iter())
        .map(|path| Scenario::load(path, &[]).unwrap_or_else(|error| panic!("{error}")))
        .collect()
}

#[test]
fn defaults_and_time_zones() {
    let scenario = good();
    assert_eq!(scenario.seed, 1);
    assert_eq!(scenario.tick_hz, 960);
    assert_eq!(scenario.time_utc.to_rfc3339(), "2025-06-21T08:00:00+00:00");
    let quoted = GOOD.replace("2025-06-21T10:00:00+02:00", "\"2025-06-21T08:00:00Z\"");
    assert_eq!(
        Scenario::parse(&quoted, "quoted.toml", &[]).unwrap(),
        scenario
    );
}

#[test]
fn errors_name_line_path_and_cure() {
    let change = |from: &str, to: &str| error(&GOOD.replace(from, to), &[]);
    assert_eq!(
        change("phantom4", "phantom"),
        "s.toml:15: uavs[0].model: unknown model 'phantom' - did you mean 'phantom4'? expected \
             one of fpv5, hframe, matrice200, matrice600, mavic2, mavic_air, phantom4, quadplane, or a \
             path that ends in .toml"
    );
    assert_eq!(
        change("latitude_deg", "lattitude_deg"),
        "s.toml:6: site.lattitude_deg: unknown key - did you mean 'latitude_deg'? expected one \
             of latitude_deg, longitude_deg, altitude_m"
    );
    assert_eq!(
        change("altitude_m = 455.0\n", ""),
        "s.toml:5: site.altitude_m: is missing: add 'altitude_m = ...' to this table"
    );
    assert_eq!(
        change("name = \"test\"\n", ""),
        "s.toml:1: name: is missing: add 'name = ...' to this table"
    );
    assert_eq!(
        change("duration_s = 10", "duration_s = \"10\""),
        "s.toml:2: duration_s: invalid type: string \"10\", expected a number"
    );
    assert_eq!(
        change("duration_s = 10", "duration_s = -10"),
        "s.toml:2: duration_s: found -10, must be above 0"
    );
    assert_eq!(
        change("duration_s = 10", "duration_s = nan"),
        "s.toml:2: duration_s: must be a finite number"
    );
    assert_eq!(
        change("= 47.4", "= 97.4"),
        "s.toml:6: site.latitude_deg: found 97.4, must be from -90 to 90"
    );
    assert_eq!(
        change("2025-06-21T10:00:00+02:00", "2025-06-21"),
        "s.toml:3: time_utc: invalid value: string \"2025-06-21\", expected a time with its \
             zone such as 2025-06-21T10:00:00Z"
    );
    assert!(change("[site]", "[site").starts_with("s.toml:5: not TOML: "));
    assert!(change("500.0, ", "").starts_with("s.toml:16: uavs[0].trajectory: "));
}

#[test]
fn only_a_reports_wind_is_carried_to_the_site() {
    const ROUGHNESS_M: f64 = 1.0; // [m]
    let wind = |sets: &[&str]| {
        let weather = with(sets).weather;
        let at_site = weather.at_site(weather.resolved().unwrap(), ROUGHNESS_M);
        (at_site.wind_speed_mps, at_site.gust_mps)
    };
    assert_eq!(wind(&["weather.wind_speed_mps=5"]), (5.0, None));
    let metar = "weather.metar=\"LSZH 200850Z 24010G20KT 9999 FEW045 19/11 Q1020\"";
    let knots = 1852.0 / 3600.0; // [m/s]
    let carried = over_rough_ground(10.0 * knots, Some(20.0 * knots), ROUGHNESS_M);
    assert_eq!(wind(&[metar]), carried);
    let both = [metar, "weather.wind_speed_mps=6", "weather.gust_mps=9"];
    assert_eq!(wind(&both), (6.0, Some(9.0)));
}

#[test]
fn a_given_visibility_holds_the_precipitation() {
    let weather = |sets: &[&str]| with(sets).weather.resolved().unwrap();
    let dry = weather(&[]);
    assert_eq!((dry.visibility_m, dry.precipitation_mmph), (20_000.0, 0.0));
    // 5 mm/h of rain, 0.72835 /km, beside the haze of 20 km.
    let rain = weather(&["weather.precipitation_mmph=5"]);
    let expected_m = 3912.0 / (3.912 / 20.0 + 0.72835);
    assert!((rain.visibility_m - expected_m).abs() < 0.1, "{rain:?}");
    assert!(!rain.snow);
    let snow = weather(&["weather.precipitation_mmph=5", "weather.temperature_c=-5"]);
    assert!(snow.snow && snow.visibility_m < 400.0, "{snow:?}");
    let both = weather(&["weather.precipitation_mmph=5", "weather.visibility_m=8000"]);
    assert_eq!((both.visibility_m, both.precipitation_mmph), (8000.0, 5.0));
    // The report's visibility is given too; other precipitation than the report's changes it.
    let metar = "weather.metar='LSZH 200850Z 24005KT 4000 RA OVC010 09/08 Q1020'";
    assert_eq!(weather(&[metar]).visibility_m, 4000.0);
    let dried = weather(&[metar, "weather.precipitation_mmph=0"]);
    let expected_m = 3912.0 / (3.912 / 4.0 - 0.72835);
    assert!(
        (dried.visibility_m / expected_m - 1.0).abs() < 1e-4,
        "{dried:?}"
    );
}

#[test]
fn contradictions_are_found_where_they_stand() {
    let add = |text: &str| error(&format!("{GOOD}{text}"), &[]);
    assert_eq!(
        add("[station.cameras.precise]\nhfov_deg = 2\nrate_hz = 100\n"),
        "s.toml:19: station.cameras.precise.rate_hz: 100 Hz does not divide tick_hz = 960 - \
             the nearest rate that does is 96 Hz"
    );
    assert!(add("[record]\nstate_hz = 0").starts_with("s.toml:18: record.state_hz: 0 Hz does not"));
    assert!(
        add(
            "[[uavs]]\nname = 'one'\nmodel = 'fpv5'\ntrajectory.kind = 'hover'\n\
                 trajectory.position_enu_m = [1, 2, 3]"
        )
        .starts_with("s.toml:18: uavs[1].name: the name 'one' is taken")
    );
    let distractor = |name: &str, kind: &str, rest: &str| {
        add(&format!(
            "[[distractors]]\nname = '{name}'\nkind = '{kind}'\ntrajectory.kind = 'orbit'\n\
                 trajectory.centre_enu_m = [1, 2, 3]\ntrajectory.radius_m = 9\n{rest}"
        ))
    };
    assert!(
        distractor("one", "bird", "trajectory.speed_mps = 9")
            .starts_with("s.toml:18: distractors[0].name: the name 'one' is taken")
    );
    assert!(
        distractor("gull", "brid", "trajectory.speed_mps = 9").starts_with(
            "s.toml:19: distractors[0].kind: unknown kind 'brid' - did you mean 'bird'?"
        )
    );
    assert!(
        distractor("gull", "bird", "trajectory.speed_mps = 0")
            .contains("distractors[0].trajectory: speed_mps is 0; give a value above 0")
    );
    assert!(
        distractor(
            "gull",
            "bird",
            "trajectory.speed_mps = 9\nspread_m = [5, -1]"
        )
        .contains("distractors[0].spread_m[1]: found -1, must be at least 0")
    );
    assert!(
        add("[weather]\nmetar = 'LSZH nonsense'").starts_with("s.toml:18: weather.metar: METAR")
    );
    assert!(
        add("[weather]\nwind_speed_mps = 9\ngust_mps = 4")
            .starts_with("s.toml:19: weather.gust_mps: is below")
    );
    assert!(
        add("[weather]\ncloud_cover = 0.5\ncloud_base_m = 400")
            .starts_with("s.toml:19: weather.cloud_base_m: has no effect with a cloud_cover of")
    );
    assert!(
        add("[station.mount]\nelevation_limits_deg = [50, 20]")
            .starts_with("s.toml:18: station.mount.elevation_limits_deg: found [50, 20]")
    );
    assert!(
        add("[station.mount]\nbase_motion = 'boat'")
            .starts_with("s.toml:18: station.mount.base_motion: expected \"quiet\"")
    );
    assert!(
        add("[station.mount]\ngyro = 'laser'")
            .starts_with("s.toml:18: station.mount.gyro: expected \"ideal\", \"fibre\"")
    );
    assert!(
        add("[station.mount]\ngyro = { delay_s = 1.0 }")
            .starts_with("s.toml:18: station.mount.gyro.delay_s: found 1, must")
    );
    let psd = "[station.mount]\nbase_motion = { psd = [[1.0, 1e-9], [500.0, 1e-12]] }";
    assert!(add(psd).starts_with("s.toml:18: station.mount.base_motion.psd: found 500, must"));
    assert!(
        add("[station.mount]\nstructural_mode_hz = 0\nbacklash_urad = 20")
            .starts_with("s.toml:19: station.mount.backlash_urad: needs a spring")
    );
    assert_eq!(
        error(&format!("tick_hz = 1000\n{GOOD}"), &[]),
        "s.toml:1: station.cameras.search.rate_hz: 30 Hz does not divide tick_hz = 1000 - the \
             nearest rate that does is 25 Hz"
    );
    assert!(
        error(GOOD, &["record.state_hz=7"])
            .starts_with("s.toml: --set record.state_hz=7: record.state_hz: 7 Hz")
    );
    assert!(error(GOOD, &["recogniser.rate_hz=7"]).contains("recogniser.rate_hz: 7 Hz does not"));
    assert!(error(GOOD, &["recogniser.max_tracks=0"]).contains("recogniser.max_tracks"));
    assert!(error(GOOD, &["engage.min_uav_probability=2"]).contains("engage.min_uav_probability"));
    for tuning in [
        "sure_s=0",
        "worth_s=inf",
        "cue_for=-1",
        "cue_against=1",
        "chosen=nan",
        "surface_m=-1",
        "closer_look_px=[8.0, 8.0]",
        "evidence.clear_score=0",
        "evidence.other_class=1",
    ] {
        let (key, _) = tuning.split_once('=').unwrap();
        let error = error(GOOD, &[&format!("tracker.tuning.{tuning}")]);
        assert!(error.contains(&format!("tracker.tuning.{key}")), "{error}");
    }
}

#[test]
fn a_keep_out_zone_has_one_form() {
    let zones = with(&[
        "engage.keep_out=[{ name = 'a', azimuth_deg = [350, 10], elevation_deg = [0, 90] }, \
             { name = 'b', from_enu_m = [0, 1, 2], to_enu_m = [3, 4, 5], radius_m = 6 }]",
    ])
    .engage
    .keep_out;
    assert!(matches!(zones[0].zone(), Some(Zone::Sector { .. })));
    assert_eq!(
        zones[1].zone(),
        Some(Zone::Route {
            from_enu_m: glam::DVec3::new(0.0, 1.0, 2.0),
            to_enu_m: glam::DVec3::new(3.0, 4.0, 5.0),
            radius_m: 6.0
        })
    );
    for broken in [
        "radius_m = 6",
        "azimuth_deg = [0, 10]",
        "azimuth_deg = [0, 10], elevation_deg = [0, 90], radius_m = 6",
        "from_enu_m = [0, 1, 2], to_enu_m = [3, 4, 5]",
        "elevation_deg = [0, 90], from_enu_m = [0, 1, 2], to_enu_m = [3, 4, 5], radius_m = 6",
    ] {
        let zone = format!("[engage]\nkeep_out = [{{ name = 'c', {broken} }}]");
        let message = error(&format!("{GOOD}{zone}"), &[]);
        assert!(
            message.starts_with("s.toml:18: engage.keep_out[0]: give either azimuth_deg"),
            "{message}"
        );
    }
}

#[test]
fn a_cue_names_a_uav() {
    let cue = with(&["search.cue={ sigma_deg = 0.7 }"])
        .search
        .cue
        .unwrap();
    assert_eq!(
        (cue.rate_hz, cue.range_sigma_m, cue.latency_s),
        (2.0, 15.0, 0.3)
    );
    let named = with(&["search.cue={ sigma_deg = 0.7, kind = 'truth', target = 'one' }"]);
    assert_eq!(named.search.cue.unwrap().target.as_deref(), Some("one"));
    assert_eq!(
        error(
            GOOD,
            &["search.cue={ sigma_deg = 0.7, kind = 'truth', target = 'ona' }"]
        ),
        "s.toml: --set search.cue={ sigma_deg = 0.7, kind = 'truth', target = 'ona' }: search.cue.target: no \
             UAV 'ona' - did you mean 'one'? expected one of one"
    );
    for (cue, words) in [
        ("target = 'one'", "search.cue.target: a radar cannot tell"),
        ("all = true", "search.cue.all: a radar tracks whatever"),
        (
            "kind = 'truth', radar = { cell_m = 3 }",
            "search.cue.radar: is not read",
        ),
        (
            "radar = { half_range_m = 0 }",
            "search.cue.radar.half_range_m",
        ),
        (
            "radar = { false_alarm = 0.001 }",
            "false plots in every look",
        ),
    ] {
        let set = format!("search.cue={{ sigma_deg = 0.7, {cue} }}");
        let told = error(GOOD, &[&set]);
        assert!(told.contains(words), "{cue}: {told}");
    }
}

#[test]
fn an_order_holds_one_thing_at_most() {
    let order = |fields: &str| format!("operator=[{{ t_s = 2, {fields} }}]");
    let given = |fields: &str| with(&[&order(fields)]).operator.remove(0);
    assert_eq!(given("designate = 'one'").designate.as_deref(), Some("one"));
    assert_eq!(given("track = 7").track, Some(7));
    let neither = with(&["operator=[{ t_s = 2 }]"]).operator.remove(0);
    assert_eq!((neither.designate, neither.track), (None, None));
    let refused = |fields: &str| error(GOOD, &[&order(fields)]);
    assert!(refused("designate = 'one', track = 7").ends_with(
        "operator[0].track: this order already holds 'designate': give 'track' an order of its own"
    ));
    assert!(refused("fire = false, law = 'lqg'").contains("operator[0].law: this order already"));
    let slew = given("slew_deg = [315, 6.5]");
    assert_eq!((slew.slew_deg, slew.fire), (Some([315.0, 6.5]), None));
    for (fields, what) in [
        (
            "slew_deg = [400, 5]",
            "slew_deg[0]: found 400, must be from -360 to 360",
        ),
        (
            "slew_deg = [0, 91]",
            "slew_deg[1]: found 91, must be from -90 to 90",
        ),
        (
            "weather = { wind_speed_mps = -1 }",
            "weather.wind_speed_mps: found -1, must be from 0 to 60",
        ),
        (
            "weather = {}",
            "weather: changes nothing: give wind_speed_mps, wind_from_deg or",
        ),
        (
            "gains = {}",
            "gains: changes no gain: give coarse, precise or gimbal_per_s",
        ),
        (
            "gains = { coarse = { kp = -1, ki_per_s = 0, kd_s = 0 } }",
            "gains.coarse.kp: found -1, must be at least 0",
        ),
    ] {
        let error = refused(fields);
        assert!(error.contains(&format!("operator[0].{what}")), "{error}");
    }
    assert!(refused("designate = 'ona'").contains("operator[0].designate: no UAV 'ona' - did you"));
    let gull = "distractors=[{ name = 'gull', kind = 'bird', trajectory = { kind = 'hover', \
                position_enu_m = [1, 2, 3] } }]";
    let flock = with(&[gull, &order("designate = 'gull'")]);
    assert_eq!(flock.flying().nth(flock.uavs.len()), Some("gull"));
    assert_eq!(flock.operator[0].designate.as_deref(), Some("gull"));
    assert!(refused("track = -1").contains("expected a whole number, not negative"));
    assert_eq!(
        error(
            &format!("{GOOD}[[operator]]\nt_s = 2\n[[operator]]\nt_s = 1"),
            &[]
        ),
        "s.toml:20: operator[1].t_s: found 1, before the order above it at 2: put orders in the order of time"
    );
}

#[test]
fn the_papers_propagation_has_figures() {
    let turbulence =
        with(&["turbulence.propagation=paper", "turbulence.paper_drift=0.5"]).turbulence;
    assert_eq!(turbulence.paper_drift, 0.5);
    assert_eq!(turbulence.paper_volatility, 0.1);
    assert!(
        error(GOOD, &["turbulence.paper_volatility=-1"])
            .ends_with("turbulence.paper_volatility: found -1, must be from 0 to 10")
    );
}

#[test]
fn what_the_set_up_refuses_is_named_where_it_stands() {
    let sets = ["station.mount.friction=false".to_owned()];
    let loaded = Loaded::parse(GOOD.to_owned(), "s.toml".into(), sets.to_vec()).unwrap();
    for (path, start) in [
        ("uavs[0].trajectory", "s.toml:16: uavs[0].trajectory: no"),
        ("uavs[0].skin", "s.toml:13: uavs[0].skin: no"),
        ("time_utc", "s.toml:3: time_utc: no"),
        (
            "station.mount",
            "s.toml: --set station.mount.friction=false: station.mount: no",
        ),
        ("detector.onnx_model", "s.toml: detector.onnx_model: no"),
    ] {
        assert_eq!(loaded.refuse(path, "no").to_string(), start);
    }
}

#[test]
fn overrides_replace_and_add() {
    let scenario = with(&[
        "detector.kind=truth",
        "uavs.0.model=mavic2",
        "uavs.0.trajectory.position_enu_m.2=80",
        "station.laser={ power_w = 500, focus = 900 }",
        "time_utc=2025-01-01T00:00:00Z",
        "station.cameras.coarse.exposure_s=1e-3",
    ]);
    assert!(scenario.detector.is_truth());
    assert_eq!(scenario.uavs[0].model, "mavic2");
    assert_eq!(
        scenario.uavs[0].trajectory,
        Trajectory::Hover {
            position_enu_m: [0.0, 500.0, 80.0],
            heading_deg: 0.0
        }
    );
    assert_eq!(scenario.station.laser.power_w, 500.0);
    assert_eq!(scenario.station.laser.focus, Focus::Metres(900.0));
    assert_eq!(scenario.time_utc.to_rfc3339(), "2025-01-01T00:00:00+00:00");
    let coarse = scenario.station.cameras.resolved()[1].clone();
    assert_eq!(coarse.exposure_s, Exposure::Seconds(1e-3));
    assert_eq!(coarse.hfov_deg, 3.0);

    assert_eq!(
        error(GOOD, &["seed=3", "detctor.kind=truth"]),
        "s.toml: --set detctor.kind=truth: detctor: unknown key - did you mean 'detector'? \
             expected one of name, description, seed, duration_s, tick_hz, site, time_utc, weather, \
             turbulence, city, station, stations, network, search, uavs, swarms, distractors, lights, detector, recogniser, tracker, operator, \
             controller, engage, record, expect"
    );
    assert_eq!(
        error(GOOD, &["uavs.1.model=fpv5"]),
        "s.toml: --set uavs.1.model=fpv5: uavs has 1 entries, numbered from 0: no entry '1'"
    );
    assert_eq!(
        error(GOOD, &["duration_s.x=1"]),
        "s.toml: --set duration_s.x=1: duration_s is of type integer, it has no keys"
    );
    assert_eq!(
        error(GOOD, &["seed"]),
        "s.toml: --set seed: expected key=value"
    );
    // A line cannot be smuggled in.
    assert!(error(GOOD, &["seed=1\nname = 'x'"]).contains("seed: invalid type: string"));
}

#[test]
fn serialised_scenarios_read_back() {
    for Loaded { scenario, path, .. } in shipped() {
        let text = toml::to_string(&scenario).unwrap();
        let file = path.display().to_string();
        assert_eq!(Scenario::parse(&text, &file, &[]).unwrap(), scenario);
    }
}

#[test]
fn unreadable_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("latin1.toml");
    std::fs::write(&path, b"name = \"Z\xfcrich\"").unwrap();
    for path in [path, folder.path().join("absent.toml")] {
        let message = Scenario::load(&path, &[]).unwrap_err().to_string();
        assert!(message.starts_with(&format!("{}: cannot be read: ", path.display())));
    }
}

#[test]
fn preset_cameras_have_the_stated_optics() {
    let [search, coarse, precise] = CameraPreset::Paper.cameras();
    // The paper's section 5.3: 4 mm and 50 mm; pitches are rounded to four digits.
    for (camera, focal_m) in [(&search, 0.004), (&coarse, 0.004), (&precise, 0.05)] {
        assert!((camera.focal_length_m() / focal_m - 1.0).abs() < 5e-4);
    }
    // 0.35 m at 1 km spans 12.8 px of 1° over 640 px, within 1 %.
    let precise = &CameraPreset::Urban1Km.cameras()[2];
    let per_rad = precise.focal_length_m() / (1e-6 * precise.pixel_pitch_um);
    assert!((0.35e-3 * per_rad / 12.8 - 1.0).abs() < 0.01);
}

fn straight(uav: &UavConfig) -> ([f64; 3], [f64; 3]) {
    match uav.trajectory {
        Trajectory::Straight {
            start_enu_m,
            velocity_enu_mps,
        } => (start_enu_m, velocity_enu_mps),
        _ => panic!("{} does not fly straight", uav.name),
    }
}

/// Offset [m] of a straight-flying UAV from the station at a time [s].
fn offset_m(scenario: &Scenario, uav: usize, t_s: f64) -> [f64; 3] {
    let station = scenario.station.position_enu_m.unwrap();
    let (start, velocity) = straight(&scenario.uavs[uav]);
    std::array::from_fn(|axis| start[axis] + t_s * velocity[axis] - station[axis])
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

#[test]
fn paper_targets_pass_at_the_printed_size_and_speed() {
    let paper: Vec<_> = (shipped().into_iter())
        .map(|loaded| loaded.scenario)
        .filter(|scenario| scenario.name.starts_with("paper_table2_"))
        .collect();
    assert_eq!(paper.len(), 3);
    for scenario in paper {
        let precise = &scenario.station.cameras.resolved()[2];
        assert_eq!(scenario.duration_s * f64::from(precise.rate_hz), 1500.0);
        assert!((length(straight(&scenario.uavs[0]).1) - 8.0).abs() < 1e-3);
        let ranges = (0..=1500).map(|i| length(offset_m(&scenario, 0, f64::from(i) / 120.0)));
        let nearest_m = ranges.fold(f64::INFINITY, f64::min);
        let span_m = catalogue::load(&scenario.uavs[0].model).unwrap().diagonal_m;
        let per_rad = precise.focal_length_m() / (1e-6 * precise.pixel_pitch_um);
        let share = span_m / nearest_m * per_rad / f64::from(precise.width_px);
        assert!(
            (share / 0.02 - 1.0).abs() < 0.01,
            "{}: {share}",
            scenario.name
        );
    }
}

#[test]
fn the_pair_crosses_in_the_image_of_the_precise_camera() {
    let pair = shipped();
    let scenario = &pair
        .iter()
        .find(|s| s.scenario.name == "crossing_pair")
        .unwrap()
        .scenario;
    let [a, b] = [0, 1].map(|uav| offset_m(scenario, uav, 10.0));
    let cosine: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>() / length(a) / length(b);
    // Both lie within a Phantom 4's half width, 0.175 m at 1 km.
    assert!(cosine.acos() < 0.175e-3, "{}", cosine.acos());
    assert!(length(b) - length(a) > 200.0);
}

#[test]
fn generated_files_are_up_to_date() {
    let docs = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("docs");
    for (file, text) in [
        ("scenarios.schema.json", json_schema()),
        ("scenarios.md", docs_markdown()),
    ] {
        let stored = std::fs::read_to_string(docs.join(file)).unwrap();
        assert!(
            stored == text,
            "docs/{file} is out of date: run `boresight schema`"
        );
    }
}

#[test]
fn every_field_is_documented() {
    fn visit(schema: &Value, path: &str, bare: &mut BTreeSet<String>) {
        for (key, field) in schema["properties"].as_object().into_iter().flatten() {
            // A tag and the payload of a one-field variant are described by the variant.
            if words(field).is_empty() && words(schema).is_empty() {
                bare.insert(format!("{path}.{key}"));
            }
        }
        for variant in schema["oneOf"].as_array().into_iter().flatten() {
            visit(variant, path, bare);
        }
    }
    let mut bare = BTreeSet::new();
    for (name, root) in [("Scenario", schema()), ("UavFile", uav_schema())] {
        visit(&root, name, &mut bare);
        for (name, schema) in root["$defs"].as_object().unwrap() {
            assert!(!words(schema).is_empty(), "{name}");
            visit(schema, name, &mut bare);
        }
    }
    assert_eq!(bare, BTreeSet::new());
}

fn one_clear_message(text: &str, sets: &[String]) -> Result<(), TestCaseError> {
    if let Err(error) = Scenario::parse(text, "file.toml", sets) {
        let message = error.to_string();
        prop_assert!(message.starts_with("file.toml:"), "{}", message);
        prop_assert_eq!(message.lines().count(), 1, "{}", message);
    }
    Ok(())
}

proptest! {
    #[test]
    fn arbitrary_text_never_panics(text in any::<String>(), set in any::<String>()) {
        one_clear_message(&text, &[])?;
        one_clear_message(GOOD, &[set])?;
    }

    #[test]
    fn mutated_scenarios_never_panic(
        at in 0..GOOD.len(),
        cut in 0..20usize,
        insert in "([\\[\\]{}=.,'\"\n #-]|[a-z_]{1,9}|[0-9]{1,25}|nan|inf|\\PC){0,4}",
        key in "[a-z_]{1,8}(\\.([a-z_]{1,8}|[0-9])){0,3}",
        value in "\\PC{0,12}",
    ) {
        let mut bytes = GOOD.as_bytes().to_vec();
        let end = (at + cut).min(bytes.len());
        bytes.splice(at..end, insert.bytes());
        let text = String::from_utf8_lossy(&bytes);
        let sets = [format!("{key}={value}")];
        one_clear_message(&text, &[])?;
        one_clear_message(&text, &sets)?;
        one_clear_message(GOOD, &sets)?;
    }
}

/// A scenario with a UAV at a place.
fn with_place(place: &str) -> String {
    format!(
        "name = \"p\"\nduration_s = 1.0\ntime_utc = 2025-01-01T00:00:00Z\n[site]\nlatitude_deg = 47.0\n\
         longitude_deg = 8.0\naltitude_m = 400.0\n[search]\ncentre_azimuth_deg = 0.0\n[[uavs]]\nname = \"u\"\n\
         model = \"phantom4\"\ntrajectory = {{ kind = \"hover\", position_enu_m = {place} }}\n"
    )
}

#[test]
fn a_place_by_latitude_and_longitude_becomes_numbers() {
    let hover = |loaded: &Loaded| match loaded.scenario.uavs[0].trajectory {
        Trajectory::Hover { position_enu_m, .. } => position_enu_m,
        _ => panic!("hovers"),
    };
    let load = |text: String| Loaded::parse(text, "p.toml".into(), Vec::new());
    // A minute of latitude at 47 degrees is 1853.0 m (WGS 84), and 1.8 km away the ellipsoid has fallen by 0.27 m.
    let text =
        with_place("{ lat = 47.01666667, lon = 8.0, height_m = 500, above = \"ellipsoid\" }");
    let loaded = load(text).unwrap();
    let [e, n, u] = hover(&loaded);
    assert!(e.abs() < 1e-6 && (n - 1853.1).abs() < 0.3, "{e} {n}");
    assert!((u - 99.73).abs() < 0.01, "{u}");
    // Above a roof of 33 m in the plane of the site.
    let loaded = load(with_place(
        "{ east_m = 10, north_m = -20, height_m = 5, above = \"roof\" }",
    ));
    let loaded = loaded.unwrap();
    assert_eq!(hover(&loaded), [10.0, -20.0, 5.0]);
    let placed = loaded.placed(|place| {
        assert_eq!(place.above, Above::Roof);
        Ok(DVec3::new(10.0, -20.0, 38.0))
    });
    let placed = placed.unwrap().unwrap();
    assert_eq!(hover(&placed), [10.0, -20.0, 38.0]);
    assert_eq!(placed.source, loaded.source);
    let nowhere = loaded.placed(|_| Err("lies in the sea".into()));
    let line = "p.toml:13: uavs[0].trajectory.position_enu_m: lies in the sea";
    assert_eq!(nowhere.unwrap_err().to_string(), line);
    // Numbers stay what they are, and an override may hold a place.
    let sets = vec!["station.position_enu_m={ east_m = 1, north_m = 2 }".to_owned()];
    let loaded = Loaded::parse(with_place("[1, 2, 3]"), "p.toml".into(), sets).unwrap();
    assert_eq!(hover(&loaded), [1.0, 2.0, 3.0]);
    let placed = loaded
        .placed(|_| Ok(DVec3::new(1.0, 2.0, 44.0)))
        .unwrap()
        .unwrap();
    assert_eq!(
        placed.scenario.station.position_enu_m,
        Some([1.0, 2.0, 44.0])
    );
    let plain = Loaded::parse(with_place("[1, 2, 3]"), "p.toml".into(), Vec::new()).unwrap();
    assert!(plain.placed(|_| Err("none".into())).unwrap().is_none());
}

#[test]
fn a_text_is_named_as_one_and_has_a_folder() {
    let folder = Path::new("some/where");
    let load = |text: &str, sets: &[&str]| {
        let sets = sets.iter().map(|set| (*set).to_owned()).collect();
        Loaded::text(text.to_owned(), folder, sets)
    };
    let text = with_place("{ east_m = 1, north_m = 2, above = \"roof\" }");
    let loaded = load(&text, &["seed=3"]).unwrap();
    assert_eq!(loaded.scenario.seed, 3);
    assert_eq!(loaded.path.parent(), Some(folder));
    let said = |error: InputError| error.to_string();
    let line = "scenario text, line 13: uavs[0].trajectory.position_enu_m: lies in the sea";
    let nowhere = loaded.placed(|_| Err("lies in the sea".into()));
    assert_eq!(nowhere.map(drop).map_err(said), Err(line.to_owned()));
    let refused = said(loaded.refuse("site.altitude_m", "too high"));
    assert_eq!(refused, "scenario text, line 7: site.altitude_m: too high");
    let wrong = |text: &str, sets: &[&str]| said(load(text, sets).map(drop).unwrap_err());
    assert!(wrong("name = ", &[]).starts_with("scenario text, line 1: not TOML: "));
    let set = "scenario text: --set seed=x: seed: ";
    assert!(wrong(&text, &["seed=x"]).starts_with(set));
}

#[test]
fn a_place_that_is_none_is_named() {
    let error = |place: &str| {
        let loaded = Loaded::parse(with_place(place), "p.toml".into(), Vec::new());
        loaded.unwrap_err().to_string()
    };
    let begin = "p.toml:13: uavs[0].trajectory.position_enu_m: ";
    for (place, why) in [
        ("{ lat = 47.0 }", "give lat and lon, or east_m and north_m"),
        (
            "{ lat = 47, lon = 8, east_m = 3 }",
            "give lat and lon, or east_m and north_m",
        ),
        (
            "{ lat = 97, lon = 8 }",
            "lat: found 97, must be from -90 to 90",
        ),
        (
            "{ lat = 47, lon = 8, hight_m = 3 }",
            "unknown field 'hight_m'",
        ),
        (
            "{ lat = 47, lon = 8, above = \"sea\" }",
            "unknown variant 'sea'",
        ),
    ] {
        let said = error(place);
        assert!(said.starts_with(&format!("{begin}{why}")), "{said}");
    }
}

#[test]
fn a_city_is_generated_or_real() {
    let error = |city: &str| {
        let text = format!("{}[city]\n{city}\n", with_place("[1, 2, 3]"));
        Scenario::parse(&text, "p.toml", &[])
            .unwrap_err()
            .to_string()
    };
    let said = error("tileset = \"t\"\nextent_m = 900");
    assert!(
        said.starts_with("p.toml:16: city.extent_m: belongs to a generated city"),
        "{said}"
    );
    let said = error("tileset = \"t\"\nsources = [\"a.tif\"]");
    assert!(
        said.starts_with("p.toml:16: city.sources: 'tileset' names the city already"),
        "{said}"
    );
    let said = error("radius_m = 900");
    assert!(
        said.starts_with("p.toml:15: city.radius_m: belongs to a real city"),
        "{said}"
    );
    let said = error("sources = [\"a.tif\"]\norigin_enu_m = [1, 2, 3]");
    assert!(
        said.starts_with("p.toml:16: city.origin_enu_m: places a tileset"),
        "{said}"
    );
    let said = error("sources = [3]");
    assert!(
        said.starts_with("p.toml:15: city.sources: expected a path, or a table of file"),
        "{said}"
    );
}

/// Every error of a scenario's text, as `boresight check` tells them.
fn all_errors(text: &str) -> Vec<String> {
    let loaded = Loaded::parse_all(text.to_owned(), "s.toml".into(), Vec::new());
    let faults = loaded.err().unwrap();
    faults.all().iter().map(ToString::to_string).collect()
}

#[test]
fn all_errors_are_told_at_once_in_the_files_order() {
    let text = "name = \"\"\n\
        durations_s = 20\n\
        seed = \"fast\"\n\
        time_utc = 2025-06-01T10:00:00Z\n\
        [site]\n\
        latitude_deg = 473769.0\n\
        longitude_deg = \"east\"\n\
        altitude_m = nan\n\
        [search]\n\
        centre_azimuth_deg = 0.0\n\
        width_deg = -4.0\n\
        [station.laser]\n\
        power_w = -1\n\
        watts = 3\n\
        [station.cameras.precise]\n\
        rate_hz = 7\n\
        mosaic = \"rgbb\"\n\
        [[uavs]]\n\
        model = \"phantom9\"\n\
        name = \"a\"\n\
        trajectory = { kind = \"teleport\" }\n\
        [[uavs]]\n\
        model = \"phantom4\"\n\
        spread_s = -1\n\
        trajectory = { kind = \"hover\", position_enu_m = { lat = 97, lon = 8 } }\n\
        [[distractors]]\n\
        name = \"gull\"\n\
        kind = \"brd\"\n\
        trajectory = { kind = \"straight\", start_enu_m = [1, 2, 3], velocity_enu_mps = [1, 2, 3], sped = 3 }\n";
    let found = all_errors(text);
    let want = [
        "s.toml:1: name: must not be empty",
        "s.toml:2: durations_s: unknown key - did you mean 'duration_s'?",
        "s.toml:3: seed: invalid type: string \"fast\", expected a whole number",
        "s.toml:6: site.latitude_deg: found 473769, must be from",
        "s.toml:7: site.longitude_deg: invalid type: string \"east\", expected a number",
        "s.toml:8: site.altitude_m: must be a finite number",
        "s.toml:11: search.width_deg: found -4, must be above 0",
        "s.toml:13: station.laser.power_w: found -1, must be from",
        "s.toml:14: station.laser.watts: unknown key",
        "s.toml:16: station.cameras.precise.rate_hz: 7 Hz does not divide",
        "s.toml:17: station.cameras.precise.mosaic: unknown mosaic 'rgbb'",
        "s.toml:19: uavs[0].model: unknown model 'phantom9'",
        "s.toml:21: uavs[0].trajectory",
        "s.toml:22: uavs[1].name: is missing",
        "s.toml:24: uavs[1].spread_s: found -1, must be at least 0",
        "s.toml:25: uavs[1].trajectory.position_enu_m: lat: found 97, must be from",
        "s.toml:28: distractors[0].kind: unknown kind 'brd' - did you mean 'bird'?",
        "s.toml:29: distractors[0].trajectory.sped: unknown key",
    ];
    assert_eq!(found.len(), want.len(), "{found:#?}");
    for (found, want) in found.iter().zip(want) {
        assert!(found.starts_with(want), "{found}\n{want}");
    }
    // A text that is no TOML is one error, and a right one has none.
    assert_eq!(all_errors("name = \nnom = ").len(), 1);
    assert!(Loaded::parse_all(GOOD.to_owned(), "s.toml".into(), Vec::new()).is_ok());
}

#[test]
fn an_error_is_told_once_whatever_stands_in_for_it() {
    // What depends on a broken value is not told beside it.
    let broken = |from: &str, to: &str| all_errors(&GOOD.replacen(from, to, 1));
    for (from, to) in [
        ("[search]", "[search]\ncentre_azimuth_deg = [3]\n[old]"),
        ("trajectory", "trajectori"),
        ("[[uavs]]", "uavs = 3\n[[uav]]"),
    ] {
        assert!(GOOD.contains(from), "{from}");
        let found = broken(from, to);
        assert!((1..=3).contains(&found.len()), "{found:#?}");
        let mut once = found.clone();
        once.dedup();
        assert_eq!(once, found);
    }
}
