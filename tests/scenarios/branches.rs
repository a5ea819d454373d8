//! Runs that are told where UAVs fly and how cameras expose, and runs that go back.

use crate::common::{rendering, scenario};
use boresight::components::capture::Tier;
use boresight::components::flight::UavStatus;
use boresight::components::operator::Answer;
use boresight::scenario::{CameraOrder, Exposure, FlyOrder, OrderConfig};
use boresight::simulation::{Builder, Simulation, SimulationError, UavView, What};
use glam::DVec3;
use std::path::Path;
use tempfile::TempDir;

const BLIND: [&str; 1] = ["detector.kind=truth"];

fn uav(run: &Simulation) -> UavView<'_> {
    run.view().uavs().next().expect("there is a UAV")
}

fn fly(order: FlyOrder) -> OrderConfig {
    OrderConfig {
        fly: Some(FlyOrder {
            uav: "intruder".into(),
            ..order
        }),
        ..OrderConfig::default()
    }
}

/// What came of the orders of the last step.
fn answers(run: &Simulation) -> Vec<Answer> {
    let events = run.events().iter();
    let answers = events.filter_map(|event| match &event.what {
        What::Order { answer, .. } => Some(answer.clone()),
        _ => None,
    });
    answers.collect()
}

#[test]
fn a_uav_flies_where_it_is_told_lands_rises_and_the_run_repeats() {
    let mut run = scenario("urban_intercept", &BLIND).open().unwrap();
    let hold = OrderConfig {
        fire: Some(false),
        ..OrderConfig::default()
    };
    run.give(&hold).unwrap();
    run.run_until(0.5).unwrap();

    let there = uav(&run).r_enu_m() + DVec3::new(10.0, -12.0, 6.0);
    let path = FlyOrder {
        path_enu_m: vec![there.into()],
        speed_mps: Some(6.0),
        heading_deg: Some(90.0),
        ..FlyOrder::default()
    };
    run.give(&fly(path)).unwrap();
    run.run_until(12.0).unwrap();
    let off_m = uav(&run).r_enu_m().distance(there);
    // What its navigation is off is drawn once, 0.75 m each axis.
    assert!(off_m < 2.5, "{off_m} m off");
    let nose = uav(&run).q_enu_body() * DVec3::X;
    assert!(nose.x > 0.98, "{nose}");

    let up = FlyOrder {
        velocity_enu_mps: Some([0.0, 0.0, 2.0]),
        ..FlyOrder::default()
    };
    run.give(&fly(up)).unwrap();
    run.run_until(16.0).unwrap();
    let v_enu_mps = uav(&run).v_enu_mps();
    assert!(
        v_enu_mps.distance(DVec3::new(0.0, 0.0, 2.0)) < 0.3,
        "{v_enu_mps}"
    );

    let rotors = FlyOrder {
        rotors: Some(vec![0.5; 3]),
        ..FlyOrder::default()
    };
    run.give(&fly(rotors)).unwrap();
    run.step(3).unwrap();
    let refused = Answer::Refused("it has 4 rotors, the order 3: give one number for each".into());
    assert_eq!(answers(&run).last(), Some(&refused));

    let (tick, hash) = (run.view().tick(), run.view().state_hash());
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("again.toml");
    std::fs::write(&path, run.scenario_with_orders().unwrap()).unwrap();
    let mut again = Builder::file(&path).open().unwrap();
    again.step(tick).unwrap();
    assert_eq!(again.view().state_hash(), hash);
}

#[test]
fn a_uav_lands_stands_and_takes_off_again() {
    let low = [
        BLIND[0],
        "engage.authorised=false",
        "duration_s=60",
        // Over an open place, 12 m up.
        "uavs.0.trajectory={ kind = \"hover\", position_enu_m = [-40.0, 40.0, 45.0] }",
    ];
    let mut run = scenario("urban_intercept", &low).open().unwrap();
    let land = FlyOrder {
        land: true,
        ..FlyOrder::default()
    };
    run.give(&fly(land)).unwrap();
    let mut landed_s = None;
    run.watch(|run| {
        if uav(run).status() == UavStatus::Landed {
            landed_s = Some(run.t_s());
        }
        landed_s.is_some()
    })
    .unwrap();
    assert!(landed_s.is_some_and(|t_s| t_s > 2.0), "{landed_s:?}");
    assert_eq!(uav(&run).v_enu_mps(), DVec3::ZERO);

    let rotors = FlyOrder {
        rotors: Some(vec![0.7; 4]),
        ..FlyOrder::default()
    };
    run.give(&fly(rotors)).unwrap();
    run.step(3).unwrap();
    let [.., Answer::Refused(why)] = &answers(&run)[..] else {
        panic!("{:?}", answers(&run));
    };
    assert!(why.contains("stands on the ground"), "{why}");

    let stood = uav(&run).r_enu_m();
    let path = FlyOrder {
        path_enu_m: vec![(stood + 8.0 * DVec3::Z).into()],
        ..FlyOrder::default()
    };
    run.give(&fly(path)).unwrap();
    run.step(6 * 960).unwrap();
    assert_eq!(uav(&run).status(), UavStatus::Flying);
    assert!(uav(&run).r_enu_m().z > stood.z + 7.0);
}

#[test]
fn rotors_without_lift_drop_a_uav() {
    let mut run = scenario("urban_intercept", &BLIND).open().unwrap();
    let rotors = FlyOrder {
        rotors: Some(vec![0.0; 4]),
        ..FlyOrder::default()
    };
    run.give(&fly(rotors)).unwrap();
    run.run_until(1.5).unwrap();
    let fall_mps = -uav(&run).v_enu_mps().z;
    // Free fall for a second and a half, less drag and what the rotors still gave.
    assert!((8.0..14.7).contains(&fall_mps), "{fall_mps} m/s");
}

#[test]
fn a_camera_exposes_as_it_is_told() {
    let mut run = scenario("urban_intercept", &BLIND).open().unwrap();
    let camera = |name: &str, exposure_s| OrderConfig {
        camera: Some(CameraOrder {
            name: name.into(),
            exposure_s: Some(Exposure::Seconds(exposure_s)),
            exposure_level: None,
        }),
        ..OrderConfig::default()
    };
    let exposure_s = |run: &Simulation| {
        let mut frames = run.frames();
        let coarse = frames.find(|frame| frame.tier() == Tier::Coarse);
        coarse.expect("it has exposed").conditions().exposure.time_s
    };
    run.run_until(0.5).unwrap();
    let before_s = exposure_s(&run);
    run.give(&camera("ctv", 3e-4)).unwrap();
    run.run_until(1.0).unwrap();
    assert_ne!(before_s, 3e-4);
    assert_eq!(exposure_s(&run), 3e-4);

    for (name, exposure_s, words) in [
        ("ctv", 2.0, "camera.exposure_s"),
        ("xtv", 1e-3, "camera.name: no camera 'xtv'"),
    ] {
        let error = run.give(&camera(name, exposure_s)).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

/// Steps a run on and returns each tick's hash.
fn hashes(run: &mut Simulation, ticks: usize) -> Vec<u64> {
    let tick = |_| {
        run.step(1).unwrap();
        run.view().state_hash()
    };
    (0..ticks).map(tick).collect()
}

/// A run goes back to each of three snapshots, and goes on as before.
fn goes_back(mut run: Simulation, name: &str) {
    let mut marks = Vec::new();
    for _ in 0..3 {
        let snapshot = run.snapshot().unwrap();
        marks.push((snapshot, hashes(&mut run, 400)));
    }
    for (snapshot, wanted) in marks.iter().rev() {
        run.restore(snapshot).unwrap();
        assert_eq!(run.view().tick(), snapshot.tick(), "{name}");
        assert_eq!(
            hashes(&mut run, 400),
            *wanted,
            "{name} from {}",
            snapshot.tick()
        );
    }
}

#[test]
fn every_shipped_run_goes_back_bit_for_bit() {
    let mut tried = 0;
    let folder = Path::new(crate::common::ROOT).join("scenarios");
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|ending| ending == "toml") {
            let run = Builder::file(&path).set(BLIND[0]).open().unwrap();
            goes_back(run, &path.display().to_string());
            tried += 1;
        }
    }
    assert!(tried > 5, "{tried}");
}

#[test]
fn a_rendered_run_goes_back_bit_for_bit() {
    let _one = rendering();
    goes_back(
        scenario("urban_intercept", &[""; 0]).open().unwrap(),
        "rendered",
    );
}

/// A wreck in the air, an order that came later, the end of a run.
#[test]
fn what_came_after_a_snapshot_is_forgotten() {
    let mut run = scenario("urban_intercept", &BLIND).open().unwrap();
    let start = run.snapshot().unwrap();
    while uav(&run).status() != UavStatus::Falling {
        assert!(!run.step(1).unwrap(), "it falls before the end");
    }
    run.step(100).unwrap();
    let falling = run.snapshot().unwrap();
    let first = hashes(&mut run, 600);
    run.restore(&falling).unwrap();
    assert_eq!(hashes(&mut run, 600), first);
    run.run_until(60.0).unwrap();
    assert!(run.over());
    let end = run.view().state_hash();

    run.restore(&start).unwrap();
    assert!(!run.over());
    let hold = OrderConfig {
        fire: Some(false),
        ..OrderConfig::default()
    };
    run.give(&hold).unwrap();
    run.run_until(60.0).unwrap();
    assert_eq!(uav(&run).status(), UavStatus::Flying);

    run.restore(&start).unwrap();
    run.run_until(60.0).unwrap();
    assert_eq!(run.view().state_hash(), end);
    assert!(!run.scenario_with_orders().unwrap().contains("[[operator]]"));
}

#[test]
fn a_run_does_not_go_back_to_what_is_not_its_own_or_is_recorded() {
    let open = || scenario("urban_intercept", &BLIND);
    let (mut run, mut other) = (open().open().unwrap(), open().open().unwrap());
    let snapshot = other.snapshot().unwrap();
    let error = run.restore(&snapshot).unwrap_err();
    assert!(matches!(error, SimulationError::OtherRun), "{error}");

    let folder = TempDir::new().unwrap();
    let mut recorded = open().record(folder.path()).open().unwrap();
    let snapshot = recorded.snapshot().unwrap();
    recorded.step(10).unwrap();
    let error = recorded.restore(&snapshot).unwrap_err();
    assert!(matches!(error, SimulationError::Recorded), "{error}");
    recorded.step(10).unwrap();
    recorded.finish().unwrap();
}
