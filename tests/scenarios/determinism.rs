//! One seed is one run, to the bit.

use crate::common::{
    BLIND, ROOT, Run, boresight, messages, on_display, read_with_python, rendering, run_scenario,
    scenario, station, stderr, tick_hashes,
};
use bevy::prelude::{Component, Without};
use boresight::app::{self, Options};
use boresight::components::flight::{Distractor, Uav, UavStatus};
use boresight::components::record::StateHash;
use boresight::recording::proto;
use boresight::scenario::Scenario;
use boresight::simulation::Arrived;
use prost::Message as _;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;
use tempfile::TempDir;

/// A bird and a balloon among the UAVs of `eval/suite_swarm`.
const FLOCK: &str = "distractors=[{ name = 'gull', kind = 'bird', trajectory = { kind = 'straight', \
                     start_enu_m = [-574.9, 499.9, 101.24], velocity_enu_mps = [3.5, 3.5, 0] } }, \
                     { name = 'party', kind = 'balloon', trajectory = { kind = 'hover', \
                     position_enu_m = [-611, 520, 103] } }]";

#[test]
fn one_seed_is_one_run_whatever_the_threads() {
    let run = |extra: &[&str]| {
        let mut args = BLIND.to_vec();
        args.extend(["--set", "duration_s=6"]);
        args.extend(extra);
        run_scenario("crossing_pair", &args)
    };
    let first = run(&[]);
    let hashes = tick_hashes(&first);
    assert_eq!(hashes.len(), 6 * 960, "one hash a tick");
    let last = hashes.last().map(|(_, hash)| format!("{hash:016x}"));
    assert_eq!(last.as_deref(), Some(first.hash()));
    let recorded = std::fs::read(first.file("run.mcap")).unwrap();
    for threads in ["1", "2", "8"] {
        let again = run(&["--threads", threads]);
        assert_eq!(again.hash(), first.hash(), "--threads {threads}");
        assert_eq!(tick_hashes(&again), hashes, "--threads {threads}");
        let bytes = std::fs::read(again.file("run.mcap")).unwrap();
        assert!(
            bytes == recorded,
            "--threads {threads}: the recordings differ"
        );
    }
    let other = run(&["--seed", "2"]);
    assert_eq!(other.summary["seed"], 2);
    assert_ne!(other.hash(), first.hash());
}

/// Bevy numbers archetypes as they come, and a query meets new ones in the order of a hash map of these numbers:
/// what else is in the program must not show in a run, nor in how what falls comes to rest.
#[test]
fn one_seed_is_one_run_whatever_else_lives_in_the_world() {
    #[derive(Component)]
    struct Other<const N: usize>;
    let path = Path::new(ROOT).join("scenarios/crossing_pair.toml");
    let set = ["detector.kind=truth", "engage.authorised=false", FLOCK].map(String::from);
    let loaded = Scenario::load(&path, &set).unwrap();
    let run = |others: usize| {
        let mut app = app::build_with(&loaded, &Options::default(), |app| {
            for number in 0..others {
                let mut other = app.world_mut().spawn_empty();
                for bit in 0..5 {
                    match (number >> bit & 1, bit) {
                        (1, 0) => drop(other.insert(Other::<0>)),
                        (1, 1) => drop(other.insert(Other::<1>)),
                        (1, 2) => drop(other.insert(Other::<2>)),
                        (1, 3) => drop(other.insert(Other::<3>)),
                        (1, _) => drop(other.insert(Other::<4>)),
                        _ => {}
                    }
                }
            }
        })
        .unwrap();
        let world = app.world_mut();
        let mut uavs = world.query_filtered::<(&Uav, &mut UavStatus), Without<Distractor>>();
        for _ in 0..480 {
            app::step(world).unwrap();
        }
        // The first falls first.
        for (uav, mut status) in uavs.iter_mut(world) {
            if uav.index == 0 {
                *status = UavStatus::Falling;
            }
        }
        for _ in 0..480 {
            app::step(world).unwrap();
        }
        let met: Vec<usize> = uavs.iter(world).map(|(uav, _)| uav.index).collect();
        assert_eq!(met, [0, 1], "systems meet UAVs in the scenario's order");
        for (_, mut status) in uavs.iter_mut(world) {
            *status = UavStatus::Falling;
        }
        let mut hashes = Vec::new();
        while uavs
            .iter(world)
            .any(|(_, status)| *status == UavStatus::Falling)
        {
            app::step(world).unwrap();
            hashes.push(world.resource::<StateHash>().0);
            assert!(hashes.len() < 30 * 960, "they never come down");
        }
        hashes
    };
    let alone = run(0);
    for others in [3, 8, 13, 31] {
        assert!(run(others) == alone, "beside {others} other archetypes");
    }
}

/// Several UAVs, balloons, misses and false alarms: the table's order must not depend on anything.
#[test]
fn one_seed_is_one_run_with_many_tracks() {
    let run = |scenario: &str, threads: &str| {
        let args = [
            "--set",
            "duration_s=5",
            "--threads",
            threads,
            "--set",
            FLOCK,
        ];
        run_scenario(scenario, &[&BLIND[..], &args].concat())
    };
    let first = run("eval/suite_swarm", "1");
    let names: std::collections::BTreeSet<_> =
        messages(&first.file("run.mcap"), "/boresight/uav_state")
            .iter()
            .map(|data| proto::UavState::decode(&data[..]).unwrap().name)
            .collect();
    assert_eq!(names.len(), 10, "{names:?}");
    for threads in ["1", "2"] {
        let again = run("eval/suite_swarm", threads);
        assert_eq!(again.hash(), first.hash(), "--threads {threads}");
        assert_eq!(
            tick_hashes(&again),
            tick_hashes(&first),
            "--threads {threads}"
        );
    }
    read_with_python(&first.file("run.mcap"), false);
}

#[test]
fn rendering_changes_no_state() {
    let _one = rendering();
    let truth = ["--set", "detector.kind=truth", "--set", "duration_s=1.5"];
    let with = |extra: &[&str]| run_scenario("urban_intercept", &[&truth[..], extra].concat());
    let blind = with(&["--no-capture"]);
    let (first, second) = (with(&["--threads", "1"]), with(&["--threads", "8"]));
    assert_eq!(first.hash(), blind.hash());
    assert_eq!(tick_hashes(&first), tick_hashes(&blind));
    assert!(messages(&first.file("run.mcap"), "/ptv/image").len() > 10);
    let bytes = [&first, &second].map(|run| std::fs::read(run.file("run.mcap")).unwrap());
    assert!(
        bytes[0] == bytes[1],
        "two runs of one seed leave different recordings"
    );
}

/// A measured detector goes by the truth alone: pictures change nothing.
#[test]
fn a_measured_run_is_one_run_with_pictures_or_without() {
    let _one = rendering();
    let kind = "detector.kind=measured";
    let measured = ["--set", kind, "--set", FLOCK, "--set", "duration_s=1.5"];
    let with = |extra: &[&str]| run_scenario("urban_intercept", &[&measured[..], extra].concat());
    let (blind, shown) = (
        with(&["--no-capture", "--threads", "8"]),
        with(&["--threads", "1"]),
    );
    assert_eq!(tick_hashes(&blind), tick_hashes(&shown));
    assert!(messages(&blind.file("run.mcap"), "/boresight/detections").len() > 10);
    let other = with(&["--no-capture", "--seed", "2"]);
    assert_ne!(other.hash(), blind.hash());
}

/// What a window shows besides reaches no sensor: on pixels its session is the run without a window, in every picture and
/// every state, before and after an order of weather changes the light.
#[test]
fn a_window_shows_and_does_what_a_run_does() {
    let _one = rendering();
    let weather = "operator=[{ t_s = 0.6, weather = { visibility_m = 6000 } }]";
    let set = ["--set", "duration_s=1", "--set", weather];
    let run = run_scenario("rooftops", &set);
    let folder = TempDir::new().unwrap();
    let output = on_display()
        .args(["view", "scenarios/rooftops.toml"])
        .args(set)
        .arg("--out")
        .arg(folder.path())
        .arg("--screenshot")
        .arg(folder.path().join("window.png"))
        .arg("1")
        .output()
        .unwrap_or_else(|error| panic!("xvfb-run: {error}; ./setup.sh installs it (xvfb, xauth)"));
    assert!(output.status.success(), "{}", stderr(&output));
    let session = Run {
        folder,
        summary: run.summary.clone(),
    };
    for topic in ["/stv/image", "/ctv/image", "/ptv/image"] {
        let [alone, windowed] = [&run, &session].map(|run| messages(&run.file("run.mcap"), topic));
        let differs = alone.iter().zip(&windowed).position(|(a, b)| a != b);
        assert_eq!(differs, None, "{topic}: the first picture that differs");
        assert_eq!(alone.len(), windowed.len(), "{topic}");
    }
    assert!(messages(&run.file("run.mcap"), "/stv/image").len() > 10);
    let [alone, windowed] = [&run, &session].map(tick_hashes);
    assert_eq!(alone.len(), 960);
    let differs = alone.iter().zip(&windowed).find(|(a, b)| a != b);
    assert_eq!(differs, None, "the first tick that differs");
    assert_eq!(alone, windowed);
}

#[test]
fn the_network_sees_the_same_on_one_thread_and_on_eight() {
    let _one = rendering();
    let recogniser = "recogniser.onnx_model=tests/data/models/recogniser.onnx";
    let run = |threads| {
        let length = ["--set", "duration_s=1", "--threads", threads];
        run_scenario(
            "urban_intercept",
            &[&length[..], &["--set", recogniser]].concat(),
        )
    };
    let (one, eight) = (run("1"), run("8"));
    assert!(messages(&one.file("run.mcap"), "/boresight/detections").len() > 10);
    assert_eq!(tick_hashes(&one), tick_hashes(&eight));
    assert_eq!(one.hash(), eight.hash());
}

/// Once the first frames are drawn, a run needs no more memory: a shader that branches on uniforms
/// alone made Mesa's lavapipe keep a gigabyte for each simulated second (assets/shaders/lean.wgsl).
#[cfg(target_os = "linux")]
#[test]
fn a_rendered_run_keeps_its_memory() {
    let _one = rendering();
    let folder = TempDir::new().unwrap();
    let set = "duration_s=2.5 detector.kind=truth engage.authorised=false";
    let mut child = boresight()
        .args(["run", "scenarios/urban_intercept.toml", "--out"])
        .arg(folder.path())
        .args(set.split(' ').flat_map(|value| ["--set", value]))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut taken_mb = Vec::new();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        let file = format!("/proc/{}/status", child.id());
        let text = std::fs::read_to_string(file).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("RssAnon:"));
        let kilobytes = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<u64>().ok());
        taken_mb.extend(kilobytes.map(|kilobytes| kilobytes / 1024));
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(status.success());
    // City and pipelines are made in the first half.
    let later_mb = &taken_mb[taken_mb.len() / 2..];
    let growth_mb = later_mb.iter().max().unwrap() - later_mb[0];
    println!("{growth_mb} MB more after {} MB", later_mb[0]);
    assert!(growth_mb < 300, "{taken_mb:?}");
}

/// The detector's thread works while the next frames are rendered, and what a run does with what it
/// finds is the same as without it; here in regions of 160 px of cameras that have no window.
#[test]
fn a_thread_for_the_network_changes_no_state() {
    let _one = rendering();
    let set = [
        "search.pattern=stare",
        "search.cue.sigma_deg=0.05",
        "station.cameras.coarse.readout=full",
        "station.cameras.precise.readout=full",
        "detector.roi_px=160",
        "engage.authorised=false",
    ];
    let run = |one_thread| {
        let options = Options {
            capture: true,
            one_thread,
            ..Options::default()
        };
        let builder = scenario("urban_intercept", &set).options(options);
        let mut run = builder.open().unwrap();
        let (mut hashes, mut regions) = (Vec::new(), 0);
        for _ in 0..(2.5 * f64::from(run.view().tick_hz())) as u64 {
            run.step(1).unwrap();
            hashes.push(run.view().state_hash());
            let region = |answer: &Arrived| answer.look.size_px == [160; 2];
            regions += station(&run).arrived().filter(region).count();
            assert!(run.frames().all(|f| f.rect().size_px == [640, 480]));
        }
        (hashes, regions)
    };
    let (with, without) = (run(false), run(true));
    assert_eq!(with, without);
    assert!(with.1 > 20, "{} regions", with.1);
}
