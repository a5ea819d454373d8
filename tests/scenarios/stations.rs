//! Several stations in one run.

use crate::common::{
    BLIND, ROOT, Run, boresight, messages, refused, run_scenario, scenario, tick_hashes,
};
use bevy::prelude::*;
use boresight::app::{self, Options};
use boresight::components::mount::Stations;
use boresight::components::network::Tasking;
use boresight::components::run::SimClock;
use boresight::components::track::{Tracker, TrackingState};
use boresight::recording::proto;
use boresight::scenario::Scenario;
use prost::Message as _;
use serde_json::Value;
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

/// The one object of a run, and its longest time unseen [s].
fn only_object(run: &Run) -> f64 {
    let objects = run.summary["objects"].as_array().unwrap();
    assert_eq!(objects.len(), 1, "{objects:?}");
    let by: Vec<_> = (objects[0]["stations"].as_array().unwrap().iter())
        .map(|name| name.as_str().unwrap())
        .collect();
    assert_eq!(by, ["yard", "tower"]);
    objects[0]["longest_gap_s"].as_f64().unwrap()
}

/// When each station took the object over [s].
fn engaged_by(run: &Run) -> Vec<(f64, String)> {
    let engaged = run.summary["objects"][0]["engaged_by"].clone();
    serde_json::from_value(engaged).unwrap()
}

#[test]
fn a_target_is_handed_over_before_a_building_hides_it() {
    let run = run_scenario("two_stations", &BLIND);
    assert!(only_object(&run) <= 0.2);
    // The yard is nearer; 9.4 s in it loses sight of the UAV.
    let [(_, first), (over_s, second)] = &engaged_by(&run)[..] else {
        panic!("{:?}", engaged_by(&run))
    };
    assert_eq!((first.as_str(), second.as_str()), ("yard", "tower"));
    assert!((2.0..9.4).contains(over_s), "{over_s}");
    // Each fired, and only while the target was its own, but for the first second, in which they knew of no other.
    let energy_j = |station: &str| run.number(&format!("/stations/{station}/energy_j"));
    assert!(energy_j("0") > 100.0 && energy_j("1") > 500.0);
    let states: Vec<Value> = (messages(&run.file("run.mcap"), "/boresight/network").iter())
        .map(|json| serde_json::from_slice(json).unwrap())
        .collect();
    let engaging = |station: &str, [from_s, to_s]: [f64; 2]| {
        let own = states.iter().filter(|state| state["station"] == station);
        let span = own.skip((10.0 * from_s) as usize);
        let span = span.take((10.0 * (to_s - from_s)) as usize);
        span.filter(|state| state["engages"] == true).count()
    };
    assert!(engaging("yard", [0.0, *over_s]) > 10 && engaging("yard", [over_s + 0.2, 9.0]) == 0);
    assert!(engaging("tower", [0.0, over_s - 0.2]) == 0 && engaging("tower", [*over_s, 9.0]) > 10);
}

#[test]
fn over_a_bad_link_a_target_is_handed_over_all_the_same() {
    let slow = "network={ latency_s = 0.4, loss = 0.4 }";
    let run = run_scenario("two_stations", &[&BLIND[..], &["--set", slow]].concat());
    assert_eq!(run.summary["outcome"], "neutralised");
    // Most of the burning is the tower's, which sees the UAV to the end.
    assert!(run.number("/stations/1/energy_j") > 1000.0);
    // Each station may have a name of its own for it, and the reports a third.
    let names = run.summary["objects"].as_array().unwrap();
    assert!((1..=3).contains(&names.len()), "{names:?}");
    // News of seconds ago still tell whose turn it is.
    let late = "network={ latency_s = 2.0, rate_hz = 2 }";
    let run = run_scenario("two_stations", &[&BLIND[..], &["--set", late]].concat());
    assert!(!engaged_by(&run).is_empty());
}

#[test]
fn of_two_stations_one_engages_and_one_watches() {
    let mut args = BLIND.to_vec();
    args.extend(["--set", "duration_s=4", "--set", EAST, "--set", HOVERS]);
    let run = run_scenario("urban_intercept", &args);
    // Until each knew of the other, for less than a second, both fired.
    let energy_j = |station: &str| run.number(&format!("/stations/{station}/energy_j"));
    let [most_j, least_j] = if energy_j("0") > energy_j("1") {
        ["0", "1"]
    } else {
        ["1", "0"]
    };
    assert!(energy_j(most_j) > 1000.0 && energy_j(least_j) < 800.0);
    let mcap = run.file("run.mcap");
    let watcher = if least_j == "0" { "" } else { "east/" };
    let beams = messages(&mcap, &format!("/boresight/{watcher}beam_state"));
    let refused = (beams.iter())
        .map(|data| proto::BeamState::decode(&data[..]).unwrap().interlocks)
        .filter(|interlocks| {
            interlocks
                .iter()
                .any(|one| one == "another station's target")
        });
    assert!(refused.count() > 100);
}

#[test]
fn nobody_fires_across_another_station() {
    // Told by the network, the rear one would leave the UAV to the other.
    let alone = "network={ assignment = 'none' }";
    let set = ["detector.kind=truth", HOVERS, BETWEEN, alone];
    let mut run = scenario("urban_intercept", &set).open().unwrap();
    let mut refused_ticks = 0;
    for _ in 0..4 * run.view().tick_hz() {
        run.step(1).unwrap();
        let rear = run.view().station("rear").unwrap();
        if rear.state() == TrackingState::Engage && rear.tracker().range_m.is_some() {
            let reasons = rear.interlocks();
            assert!(
                reasons.contains(&"another station in the line of fire"),
                "{reasons:?}"
            );
            refused_ticks += 1;
        }
    }
    assert!(refused_ticks > 960, "{refused_ticks}");
    let energy_j = |name| run.view().station(name).unwrap().beam().energy_j;
    assert_eq!(energy_j("rear"), 0.0);
    assert!(energy_j("front") > 0.0);
}

#[test]
fn what_a_station_has_left_alone_another_engages() {
    let path = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    let hold = "engage.authorised=false";
    let set = ["detector.kind=truth", HOVERS, EAST, hold].map(String::from);
    let loaded = Scenario::load(&path, &set).unwrap();
    let mut app = app::build(&loaded, &Options::default()).unwrap();
    let world = app.world_mut();
    let stations = world.resource::<Stations>().0.clone();
    let run = |world: &mut World, for_s: u32| {
        for _ in 0..for_s * loaded.scenario.tick_hz {
            app::step(world).unwrap();
        }
    };
    let engages = |world: &World| {
        let task = |station: &Entity| world.get::<Tasking>(*station)?.task;
        let mut engaging = (stations.iter()).filter(|s| task(s).is_some_and(|task| task.engages));
        let [station, none] = [engaging.next(), engaging.next()];
        assert_eq!(none, None);
        *station.unwrap()
    };
    run(world, 3);
    let first = engages(world);
    let tick = world.resource::<SimClock>().tick;
    let mut tracker: Mut<Tracker> = world.get_mut(first).unwrap();
    assert_eq!(tracker.state, TrackingState::Engage);
    tracker.give_up(tick, Some(60.0), "no UAV to this station");
    run(world, 2);
    let second = engages(world);
    assert_ne!(second, first);
    let state = |station| world.get::<Tracker>(station).unwrap().state;
    assert_eq!(state(second), TrackingState::Engage);
    assert_eq!(state(first), TrackingState::Search);
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
fn a_search_camera_of_its_own_mount_finds_the_next_target_meanwhile() {
    // Two UAVs at the ends of the sector, no radar; the mount turns to one of them.
    let two = "uavs=[{ name = 'left', model = 'phantom4', trajectory = { kind = 'hover', \
               position_enu_m = [-860, 500, 110] } }, { name = 'right', model = 'phantom4', \
               trajectory = { kind = 'hover', position_enu_m = [-500, 860, 110] } }]";
    let sector =
        "search={ centre_azimuth_deg = 315, width_deg = 40, height_deg = 4, elevation_deg = 3 }";
    let alone = [&BLIND[..], &["--set", two, "--set", sector]].concat();
    let watch =
        "station.cameras.more=[{ name = 'watch', role = 'search', path = { pan_tilt = {} } }]";
    let watched = [&alone[..], &["--set", watch]].concat();
    let pause_s = |args: &[&str]| {
        let run = run_scenario("urban_intercept", args);
        assert_eq!(run.text("outcome"), "neutralised");
        run.number("/stations/0/kill_to_shot_s/0")
    };
    let (without_s, with_s) = (pause_s(&alone), pause_s(&watched));
    assert!(with_s < 0.7 * without_s, "{with_s} s, {without_s} s");
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
            "station.cameras.more=[{ name = 'w', role = 'search', path = { pan_tilt = { \
             max_rate_degps = -1 } } }]",
            ["path.pan_tilt.max_rate_degps", "above 0"],
        ),
        (
            "operator=[{ t_s = 1.0, track = 3, station = 'statoin' }]",
            ["operator[0].station", "did you mean 'station'"],
        ),
        ("stations=[{ name = 'a/b' }]", ["stations[0].name", "slash"]),
        ("network.loss=1.5", ["network.loss", "must be from 0 to 1"]),
        ("network.rate_hz=7", ["network.rate_hz", "does not divide"]),
        (
            "network.assignment='fair'",
            ["network.assignment", "least_cost"],
        ),
        (
            "search.cue={ sigma_deg = 1, kind = 'truth', all = true, target = 'intruder' }",
            ["search.cue.all", "leave one of the two out"],
        ),
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
