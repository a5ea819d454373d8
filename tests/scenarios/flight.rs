//! What flies, and what is taken for it.

use crate::common::{BLIND, ROOT, boresight, messages, stderr};
use boresight::recording::proto;
use glam::DVec3;
use prost::Message as _;
use serde_json::Value;
use std::path::Path;
use tempfile::TempDir;

/// Birds and balloons are in truth and recording, and neither end nor outlast a run.
#[test]
fn distractors_are_recorded_and_never_counted() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("birds.toml");
    let demo = std::fs::read_to_string(Path::new(ROOT).join("scenarios/urban_intercept.toml"));
    let text = demo.unwrap()
        + r#"
[[distractors]]
name = "gull"
kind = "bird"
trajectory = { kind = "orbit", centre_enu_m = [-150.0, 150.0, 90.0], radius_m = 6.0, speed_mps = 6.0 }

[[distractors]]
name = "party"
kind = "balloon"
trajectory = { kind = "hover", position_enu_m = [-150.0, 150.0, 90.0] }
"#;
    std::fs::write(&path, text).unwrap();
    let run = |out: &str| {
        let output = boresight()
            .arg("run")
            .arg(&path)
            .args(BLIND)
            .args(["--set", "search.width_deg=20"])
            // It flies into the ground after a few seconds.
            .args(["--set", "uavs.0.trajectory={ kind = \"straight\", start_enu_m = [-150.0, 150.0, 90.0], velocity_enu_mps = [0.0, 5.0, -12.0] }"])
            .arg("--out")
            .arg(folder.path().join(out))
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        let text = std::fs::read_to_string(folder.path().join(out).join("summary.json"));
        serde_json::from_str::<Value>(&text.unwrap()).unwrap()
    };
    let (summary, again) = (run("a"), run("b"));
    assert_eq!(summary["state_hash"], again["state_hash"]);
    let end_s = summary["simulated_s"].as_f64().unwrap();
    assert!(end_s < 15.0, "{summary:#}");
    assert_ne!(summary["outcome"], "partly_neutralised", "{summary:#}");

    let mcap = folder.path().join("a/run.mcap");
    let states: Vec<_> = messages(&mcap, "/boresight/uav_state")
        .iter()
        .map(|data| proto::UavState::decode(&data[..]).unwrap())
        .collect();
    let of = |name: &'static str| states.iter().filter(move |state| state.name == name);
    let at = |state: &proto::UavState| {
        let r = state.r_enu_m.as_ref().unwrap();
        DVec3::new(r.x, r.y, r.z)
    };
    let gulls: Vec<_> = of("gull").collect();
    assert!(gulls.len() > 100 && gulls.iter().all(|state| state.status == "bird"));
    for state in gulls {
        let out = at(state) - DVec3::new(-150.0, 150.0, 90.0);
        assert!((out.truncate().length() - 6.0).abs() < 1e-6, "{out}");
        assert!(out.z.abs() < 0.03, "{out}");
    }
    let party: Vec<_> = of("party").collect();
    assert!(party.iter().all(|state| state.status == "balloon"));
    let drift = at(party[party.len() - 1]) - at(party[0]);
    let speed_mps = drift.length() / end_s;
    assert!((0.5..15.0).contains(&speed_mps), "{speed_mps} m/s");

    let seen: std::collections::BTreeSet<String> = messages(&mcap, "/boresight/frame_truth")
        .iter()
        .flat_map(|data| proto::FrameTruth::decode(&data[..]).unwrap().uavs)
        .map(|uav| uav.name)
        .collect();
    assert!(seen.contains("gull") && seen.contains("party"), "{seen:?}");
}
