//! The shipped scenarios, from start to end.

use crate::common::{
    BLIND, ROOT, boresight, messages, read_with_python, rendering, run_scenario, stderr,
};
use boresight::recording::proto;
use boresight::scenario::Scenario;
use prost::Message as _;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};
use tempfile::TempDir;

#[test]
fn the_urban_intercept_ends_neutralised() {
    let run = {
        let _one = rendering();
        run_scenario("urban_intercept", &[])
    };
    assert_eq!(run.text("outcome"), "neutralised", "{:#}", run.summary);
    assert_eq!(run.summary["scenario"], "urban_intercept");
    assert_eq!(run.summary["seed"], 1);
    assert_eq!(run.hash().len(), 16);
    assert!(!run.text("version").is_empty() && !run.text("reason").is_empty());
    for camera in ["coarse", "precise"] {
        for key in ["mean", "rms", "p50", "p95", "p99"] {
            assert!(run.number(&format!("/miss_distance_px/{camera}/{key}")) >= 0.0);
        }
    }
    let mean_px = run.number("/miss_distance_px/precise/mean");
    assert!(mean_px < 2.0, "{mean_px}");
    let (acquired_s, neutralised_s) = (
        run.number("/time_to_acquire_s"),
        run.number("/time_to_neutralise_s"),
    );
    let simulated_s = run.number("/simulated_s");
    assert!(0.0 < acquired_s && acquired_s < neutralised_s && neutralised_s < simulated_s);
    let (dwell_s, energy_j) = (run.number("/dwell_s"), run.number("/energy_j"));
    // The beam rests on the aim point only while it is on.
    let demo = Scenario::load(&Path::new(ROOT).join("scenarios/urban_intercept.toml"), &[]);
    let on_s = energy_j / demo.unwrap().scenario.station.laser.power_w;
    assert!(
        0.0 < dwell_s && dwell_s <= 1.001 * on_s,
        "{dwell_s} s of {on_s} s"
    );
    assert!(run.number("/real_time_factor") > 0.0);
    let shares = ["render", "inference", "other"].map(|k| run.number(&format!("/share/{k}")));
    assert!(
        shares.iter().all(|share| (0.0..=1.0).contains(share)),
        "{shares:?}"
    );
    assert!(
        (shares.iter().sum::<f64>() - 1.0).abs() < 0.01,
        "{shares:?}"
    );

    let report = std::fs::read_to_string(run.file("report.html")).unwrap();
    assert!(report.contains(run.hash()) && report.contains("data:image/jpeg;base64,"));
    for chart in ["<svg", "px", "K", "W"] {
        assert!(report.contains(chart), "the report lacks {chart}");
    }
    // Nothing may be loaded: names of XML namespaces are the only addresses.
    let loads = report.replace("http://www.w3.org/", "");
    for marker in ["http://", "https://", "src=\"/", "<link", "@import"] {
        assert!(
            !loads.contains(marker),
            "the report loads something: {marker}"
        );
    }
    let truth = messages(&run.file("run.mcap"), "/boresight/frame_truth");
    let seen: Vec<_> = truth
        .iter()
        .flat_map(|data| proto::FrameTruth::decode(&data[..]).unwrap().uavs)
        .collect();
    assert!(
        seen.iter()
            .any(|uav| uav.visible_fraction > 0.9 && uav.range_m > 900.0)
    );
    read_with_python(&run.file("run.mcap"), true);
}

/// Every scenario file below a folder, in order.
fn scenario_files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(scenario_files(&path));
        } else if path
            .extension()
            .is_some_and(|extension| extension == "toml")
        {
            found.push(path);
        }
    }
    found.sort();
    found
}

#[test]
fn every_shipped_scenario_passes_its_check() {
    let folder = Path::new(ROOT).join("scenarios");
    let files = scenario_files(&folder);
    for path in &files {
        let output = boresight().arg("check").arg(path).output().unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        // The foggy night is meant to end without acquisition, and nothing is seen in it: its warnings are right.
        let night = path.ends_with("night_fog.toml");
        let warned = stderr(&output);
        let lines: Vec<&str> = warned.lines().collect();
        let wanted: &[&str] = match night {
            true => &[
                "station.position_enu_m: no UAV gives the range finder an echo",
                "time_utc: the sun stands",
            ],
            false => &[],
        };
        assert_eq!(lines.len(), wanted.len(), "{}: {lines:#?}", path.display());
        for (line, wanted) in lines.iter().zip(wanted) {
            assert!(
                line.starts_with("warning: ") && line.contains(wanted),
                "{line}"
            );
        }
    }
    // What the documents and the evaluation name is there, in the folders below too.
    for name in [
        "crossing_pair",
        "dusk_intercept",
        "forest_intercept",
        "night_fog",
        "paper_table2_matrice200",
        "paper_table2_mavic",
        "paper_table2_phantom4",
        "urban_intercept",
        "eval/occlusion",
        "eval/search",
        "eval/suite_birds",
        "eval/suite_crossing",
        "eval/suite_decoy",
        "eval/suite_occlusion",
        "eval/suite_overtaking",
        "eval/suite_swarm",
        "eval/table2_urban",
        "eval/weave",
    ] {
        let path = folder.join(format!("{name}.toml"));
        assert!(files.contains(&path), "{name} is not among {files:?}");
    }
}

#[test]
fn a_crossing_pair_is_taken_apart_one_by_one() {
    for seed in ["1", "2", "3"] {
        let run = run_scenario("crossing_pair", &[&BLIND[..], &["--seed", seed]].concat());
        assert_eq!(run.text("outcome"), "neutralised", "{:#}", run.summary);
        let mut ends_s = Vec::new();
        for (index, name) in ["near", "far"].into_iter().enumerate() {
            let of = |key: &str| format!("/uavs/{index}/{key}");
            assert_eq!(run.summary.pointer(&of("name")).unwrap(), name);
            assert_eq!(run.summary.pointer(&of("status")).unwrap(), "down");
            // 3 kW and 2 kg of plastic: no UAV falls of a touch.
            assert!(run.number(&of("dwell_s")) > 0.3, "{:#}", run.summary);
            ends_s.push(run.number(&of("neutralised_s")));
        }
        // Which is the first is the radar's choice.
        let order = if ends_s[0] < ends_s[1] {
            ["near", "far"]
        } else {
            ["far", "near"]
        };
        let acquired_s = run.number("/time_to_acquire_s");
        let first_s = ends_s[0].min(ends_s[1]);
        assert!(0.0 < acquired_s && acquired_s < first_s, "{acquired_s} s");
        // From the first to the last the target is one, then the other: it never switches back.
        let tracks = messages(&run.file("run.mcap"), "/boresight/track_state");
        let mut targets: Vec<String> = tracks
            .iter()
            .map(|data| proto::TrackState::decode(&data[..]).unwrap().target)
            .filter(|target| !target.is_empty())
            .collect();
        targets.dedup();
        assert_eq!(targets, order, "seed {seed}");
        let names: std::collections::BTreeSet<_> =
            messages(&run.file("run.mcap"), "/boresight/uav_state")
                .iter()
                .map(|data| proto::UavState::decode(&data[..]).unwrap().name)
                .collect();
        assert_eq!(names.into_iter().collect::<Vec<_>>(), ["far", "near"]);
    }
}

#[test]
fn a_killed_run_leaves_a_readable_recording() {
    let folder = TempDir::new().unwrap();
    let mcap = folder.path().join("run.mcap");
    let mut child = boresight()
        .args([
            "run",
            "scenarios/urban_intercept.toml",
            "--set",
            "duration_s=3600",
        ])
        // An unauthorised laser ends nothing early.
        .args(["--set", "engage.authorised=false", "--out"])
        .arg(folder.path())
        .args(BLIND)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    let size = || std::fs::metadata(&mcap).map_or(0, |file| file.len());
    while size() < 500_000 && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let bytes = std::fs::read(&mcap).unwrap();
    let options = mcap::read::Options::IgnoreEndMagic.into();
    let ticks = mcap::MessageStream::new_with_options(&bytes, options)
        .unwrap()
        // The chunk that was being written when the process died is lost.
        .map_while(Result::ok)
        .filter(|message| message.channel.topic == "/boresight/tick")
        .map(|message| proto::Tick::decode(&message.data[..]).unwrap().tick)
        .collect::<Vec<_>>();
    assert!(ticks.len() > 960, "{} ticks", ticks.len());
    assert!(ticks.windows(2).all(|pair| pair[1] == pair[0] + 1));
}
