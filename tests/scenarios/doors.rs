//! What a user adds from outside: every example runs, and does what it says.

use crate::common::{ROOT, boresight, messages, read_with_python, refused, rendering};
use boresight::app::{self, Options};
use boresight::components::capture::Tier;
use boresight::components::control::PointingLaws;
use boresight::models::control::law::{HandOver, PointingInput, PointingOutput};
use boresight::models::control::pointing::PointingLaw;
use boresight::models::mount::gimbal::{GimbalCommand, GimbalParams};
use boresight::scenario::Scenario;
use glam::DVec2;
use serde_json::Value;
use std::path::Path;
use tempfile::TempDir;

#[path = "../../examples/bare_run.rs"]
mod bare_run;
#[path = "../../examples/own_detector.rs"]
mod own_detector;
#[path = "../../examples/own_law.rs"]
mod own_law;
#[path = "../../examples/own_stage.rs"]
mod own_stage;
#[path = "../../examples/own_topic.rs"]
mod own_topic;
#[path = "../../examples/own_uav.rs"]
mod own_uav;

#[test]
fn a_topic_of_ones_own_is_recorded() {
    let folder = TempDir::new().unwrap();
    own_topic::record(folder.path()).unwrap();
    let mcap = folder.path().join("run.mcap");
    let counts: Vec<Value> = (messages(&mcap, "/mine/tracks").iter())
        .map(|json| serde_json::from_slice(json).unwrap())
        .collect();
    assert_eq!(counts.len(), 20);
    assert_eq!(counts[19]["station"], "station");
    assert_eq!(counts[19]["tracks"], 1);
    read_with_python(&mcap, false);
}

#[test]
fn a_detector_of_ones_own_finds() {
    let _one = rendering();
    let tracker = own_detector::run().unwrap();
    assert!(tracker.state.holds(Tier::Coarse), "{:?}", tracker.changes);
}

#[test]
fn a_bare_run_reads_frames_and_truth() {
    let _one = rendering();
    let shown = bare_run::frames().unwrap();
    assert!(shown.len() >= 3, "{}", shown.len());
    for frame in &shown {
        assert!((0.0..=0.1).contains(&frame.t_s) && !frame.camera.is_empty());
        assert!(frame.rgb8.iter().any(|value| *value > 0), "black");
    }
}

#[test]
fn a_stage_of_the_tracker_is_replaced() {
    assert!(own_stage::energy_j(0.1).unwrap() > 0.0);
    assert_eq!(own_stage::energy_j(5.0).unwrap(), 0.0);
}

#[test]
fn an_unknown_detector_is_one_error() {
    let path = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    let wanted = [
        "detector.kind",
        "no detector 'onxn'",
        "did you mean 'onnx'",
        "truth",
    ];
    let mut command = boresight();
    command
        .arg("check")
        .arg(path)
        .args(["--set", "detector.kind=onxn"]);
    refused(&mut command, &wanted);
}

#[test]
fn a_law_of_ones_own_points() {
    let [tuned, alone] = ["tuned", "gimbal_alone"].map(|law| own_law::rms_urad(law).unwrap());
    assert!(tuned < 30.0 && alone < 300.0, "{tuned} {alone}");
    // What the mirror is for.
    assert!(alone > 1.5 * tuned, "{tuned} {alone}");
}

#[test]
fn a_uav_of_ones_own_flies_and_falls() {
    let [phantom_s, own_s] =
        ["phantom4", own_uav::OWN].map(|model| own_uav::neutralised_s(model).unwrap().unwrap());
    // Its carbon-fibre plates stand more heat than the Phantom's shell.
    assert!(phantom_s < own_s, "{phantom_s} {own_s}");
}

/// A law that loses its mind.
#[derive(Clone, Debug)]
struct Lost;

impl PointingLaw for Lost {
    fn command(
        &mut self,
        _hand_over: &mut HandOver,
        _gimbal: &GimbalParams,
        _input: &PointingInput,
    ) -> PointingOutput {
        PointingOutput {
            gimbal: GimbalCommand {
                rate_radps: [f64::NAN, 0.0],
            },
            mirror_rad: DVec2::ZERO,
        }
    }
}

#[test]
fn a_law_that_is_unknown_or_returns_no_number_is_one_error() {
    let path = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    let start = |preset: &str| {
        let set = [
            "detector.kind=truth",
            &format!("controller.preset={preset}"),
        ];
        let loaded = Scenario::load(&path, &set.map(String::from)).unwrap();
        app::build_with(&loaded, &Options::default(), |app| {
            let mut laws = app.world_mut().resource_mut::<PointingLaws>();
            laws.add("lost", |_plant| Ok(Box::new(Lost)));
        })
    };
    let unknown = start("tunde").err().unwrap().to_string();
    for wanted in [
        "controller.preset",
        "no law 'tunde'",
        "did you mean 'tuned'",
        "lost",
        "paper",
    ] {
        assert!(unknown.contains(wanted), "{unknown}");
    }
    let mut app = start("lost").unwrap();
    let fault = (0..960).find_map(|_| app::step(app.world_mut()).err());
    let fault = fault.unwrap().to_string();
    for wanted in ["station 'station'", "law 'lost'", "NaN", "finite"] {
        assert!(fault.contains(wanted), "{fault}");
    }
}
