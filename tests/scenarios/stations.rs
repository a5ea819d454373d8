//! Several stations in one run.

use crate::common::{BLIND, ROOT, boresight, messages, refused, run_scenario, tick_hashes};
use boresight::app::{self, Options};
use boresight::components::beam::BeamState;
use boresight::components::engage::Interlocks;
use boresight::components::mount::Stations;
use boresight::components::track::{Tracker, TrackingState};
use boresight::recording::proto;
use boresight::scenario::Scenario;
use prost::Message as _;
use std::collections::BTreeSet;
use std::path::Path;

/// A UAV that hovers 700 m north-west of the first station.
const HOVERS: &str = "uavs.0.trajectory={ kind = 'hover', position_enu_m = [-495, 495, 118] }";
/// Another station some way to the east of the first.
const EAST: &str = "stations=[{ name = 'west', position_enu_m = [0, 0, 60] }, \
                    { name = 'east', position_enu_m = [150, 40, 62] }]";
/// Another station on the first one's way to that UAV.
const BETWEEN: &str = "stations=[{ name = 'rear', position_enu_m = [0, 0, 60] }, \
                       { name = 'front', position_enu_m = [-148.5, 148.5, 77.4] }]";

#[test]
fn two_stations_repeat_whatever_the_threads() {
    let run = |threads: &str| {
        let mut args = BLIND.to_vec();
        args.extend(["--set", "duration_s=3", "--set", EAST, "--threads", threads]);
        run_scenario("urban_intercept", &args)
    };
    let [one, two, eight] = ["1", "2", "8"].map(run);
    let hashes = tick_hashes(&one);
    assert_eq!(hashes.len(), 3 * 960);
    assert!(hashes == tick_hashes(&two) && hashes == tick_hashes(&eight));
}

#[test]
fn every_station_tracks_fires_and_is_recorded() {
    let mut args = BLIND.to_vec();
    let alone = "network={ assignment = 'none' }";
    args.extend([
        "--set",
        "duration_s=4",
        "--set",
        EAST,
        "--set",
        HOVERS,
        "--set",
        alone,
    ]);
    let run = run_scenario("urban_intercept", &args);
    let energy_j = |station: &str| run.number(&format!("/stations/{station}/energy_j"));
    assert!(energy_j("0") > 0.0 && energy_j("1") > 0.0);
    let total_j = energy_j("0") + energy_j("1");
    assert!((run.number("/energy_j") - total_j).abs() < 1e-9 * total_j);
    let states = |topic: &str| messages(&run.file("run.mcap"), topic).len();
    for state in ["mount", "track", "beam"] {
        let first = states(&format!("/boresight/{state}_state"));
        assert!(first > 100);
        assert_eq!(
            states(&format!("/boresight/east/{state}_state")),
            first,
            "{state}"
        );
    }
}

#[test]
fn nobody_fires_across_another_station() {
    let path = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    let set = ["detector.kind=truth", HOVERS, BETWEEN].map(String::from);
    let loaded = Scenario::load(&path, &set).unwrap();
    let mut app = app::build(&loaded, &Options::default()).unwrap();
    let world = app.world_mut();
    let [rear, front] = world.resource::<Stations>().0[..] else {
        panic!("two stations")
    };
    let mut refused_ticks = 0;
    for _ in 0..4 * loaded.scenario.tick_hz {
        app::step(world).unwrap();
        let tracker: &Tracker = world.get(rear).unwrap();
        let Interlocks { reasons, .. } = world.get(rear).unwrap();
        if tracker.state == TrackingState::Engage && tracker.range_m.is_some() {
            assert!(
                reasons.contains(&"another station in the line of fire"),
                "{reasons:?}"
            );
            refused_ticks += 1;
        }
    }
    assert!(refused_ticks > 960, "{refused_ticks}");
    let energy_j = |station| world.get::<BeamState>(station).unwrap().energy_j;
    assert_eq!(energy_j(rear), 0.0);
    assert!(energy_j(front) > 0.0);
}

#[test]
fn a_station_may_have_no_search_camera_or_two() {
    // Nearest to the radar's cue there is a UAV; the coarse camera finds it alone.
    let none = ["--set", "station.cameras.has_search=false", "--set", HOVERS];
    let run = run_scenario("urban_intercept", &[&BLIND[..], &none].concat());
    assert_eq!(run.text("outcome"), "neutralised");
    // The second looks at the UAV from the start, while the mount searches elsewhere.
    let more = "station.cameras.more=[{ name = 'watch', role = 'search', path = { fixed = \
                { azimuth_deg = 315, elevation_deg = 5 } }, changes = { hfov_deg = 8 } }]";
    let elsewhere = "search={ centre_azimuth_deg = 45, width_deg = 20, height_deg = 4 }";
    let two = ["--set", more, "--set", elsewhere, "--set", HOVERS];
    let run = run_scenario("urban_intercept", &[&BLIND[..], &two].concat());
    assert_eq!(run.text("outcome"), "neutralised");
    assert!(run.number("/time_to_acquire_s") < 3.0);
    let truths = messages(&run.file("run.mcap"), "/boresight/frame_truth");
    let cameras: BTreeSet<String> = (truths.iter())
        .map(|data| proto::FrameTruth::decode(&data[..]).unwrap().camera)
        .collect();
    assert_eq!(
        cameras,
        ["ctv", "ptv", "stv", "watch"].map(String::from).into()
    );
}

#[test]
fn stations_that_cannot_stand_are_refused() {
    let path = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    for (stations, wanted) in [
        (
            "stations=[{ position_enu_m = [0, 0, 60] }, { position_enu_m = [90, 0, 60] }]",
            ["stations[1].name", "taken by an earlier one"],
        ),
        (
            "stations=[{ name = 'a' }, { name = 'b' }]",
            ["stations[1].position_enu_m", "at least 20 m"],
        ),
        (
            "stations=[{ name = 'a' }, { name = 'b', position_enu_m = [90, 0, -5] }]",
            ["stations[1].position_enu_m", "put it above"],
        ),
        (
            "station.cameras.more=[{ name = 'ctv', role = 'coarse' }]",
            ["station.cameras.more[0].name", "taken by an earlier one"],
        ),
        (
            "station.cameras.more=[{ name = 'w', role = 'coarse', path = { fixed = { azimuth_deg = 0, \
             elevation_deg = 5 } } }]",
            ["station.cameras.more[0].path", "only search"],
        ),
        (
            "operator=[{ t_s = 1.0, track = 3, station = 'statoin' }]",
            ["operator[0].station", "did you mean 'station'"],
        ),
        ("stations=[{ name = 'a/b' }]", ["stations[0].name", "slash"]),
        (
            "stations=[{ name = 'a', laser = { watts = 3 } }]",
            ["stations[0].laser.watts", "unknown key"],
        ),
    ] {
        let mut command = boresight();
        command.arg("check").arg(&path).args(["--set", stations]);
        refused(&mut command, &wanted);
    }
}
