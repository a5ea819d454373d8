//! What a user adds from outside: every example runs, and does what it says.

use crate::common::{ROOT, boresight, messages, read_with_python, refused, rendering, scenario};
use boresight::components::capture::Tier;
use boresight::components::flight::UavStatus;
use boresight::components::operator::Answer;
use boresight::scenario::{DriveOrder, OrderConfig};
use boresight::simulation::parts::{
    Detection, GimbalCommand, GimbalParams, HandOver, MountPlant, PartError, PointingInput,
    PointingLaw, PointingOutput, TrackStage,
};
use boresight::simulation::{Builder, Simulation, What};
use glam::DVec2;
use serde_json::Value;
use std::path::Path;
use tempfile::TempDir;

#[path = "../../examples/bare_run.rs"]
mod bare_run;
#[path = "../../examples/beam_budget.rs"]
mod beam_budget;
#[path = "../../examples/detect_picture.rs"]
mod detect_picture;
#[path = "../../examples/events.rs"]
mod events;
#[path = "../../examples/hot_spot.rs"]
mod hot_spot;
#[path = "../../examples/operator.rs"]
mod operator;
#[path = "../../examples/outside_controller.rs"]
mod outside_controller;
#[path = "../../examples/own_detector.rs"]
mod own_detector;
#[path = "../../examples/own_law.rs"]
mod own_law;
#[path = "../../examples/own_propagation.rs"]
mod own_propagation;
#[path = "../../examples/own_scenario.rs"]
mod own_scenario;
#[path = "../../examples/own_stage.rs"]
mod own_stage;
#[path = "../../examples/own_topic.rs"]
mod own_topic;
#[path = "../../examples/own_uav.rs"]
mod own_uav;
#[path = "../../examples/repeat.rs"]
mod repeat;
#[path = "../../examples/seeds.rs"]
mod seeds;

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
    let (events, state) = own_detector::run().unwrap();
    assert!(state.holds(Tier::Coarse), "{events:?}");
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
fn the_events_of_a_run_tell_its_story() {
    let events = events::events().unwrap();
    let at = |wanted: &dyn Fn(&What) -> bool| {
        let found = events.iter().find(|event| wanted(&event.what));
        found.unwrap_or_else(|| panic!("{events:#?}")).t_s
    };
    let acquired_s = at(&|what| matches!(what, What::State { to, .. } if to.acquired()));
    let fired_s = at(&|what| matches!(what, What::Fire { at: Some(0), .. }));
    let falls_s = at(&|what| {
        matches!(
            what,
            What::Uav {
                status: UavStatus::Falling,
                ..
            }
        )
    });
    let ceased_s = at(&|what| matches!(what, What::CeaseFire { .. }));
    assert!(acquired_s < fired_s && fired_s < falls_s && fired_s < ceased_s);
    assert!(events.is_sorted_by_key(|event| event.tick));
}

#[test]
fn an_operator_holds_fire_and_gives_it() {
    let (given_s, fired_s) = operator::authority_and_fire_s().unwrap().unwrap();
    assert!(
        (given_s..given_s + 0.1).contains(&fired_s),
        "{given_s} {fired_s}"
    );
}

#[test]
fn an_order_that_nobody_can_obey_is_one_error() {
    let builder = Simulation::builder("scenarios/urban_intercept.toml");
    let mut run = builder.set("detector.kind=truth").open().unwrap();
    let refusal =
        |run: &mut Simulation, order: OrderConfig| run.give(&order).err().unwrap().to_string();
    let nobody = OrderConfig {
        designate: Some("intrude".into()),
        ..OrderConfig::default()
    };
    let text = refusal(&mut run, nobody);
    assert!(
        text.starts_with("order: designate: no UAV 'intrude'"),
        "{text}"
    );
    let lost = OrderConfig {
        drive: Some(DriveOrder {
            rates_degps: Some([0.0, f64::NAN]),
            mirror_urad: None,
        }),
        ..OrderConfig::default()
    };
    let text = refusal(&mut run, lost);
    assert!(
        text.starts_with("order: drive.rates_degps[1]: found NaN"),
        "{text}"
    );
    // A law's name is known once it is asked for.
    run.give(&OrderConfig {
        law: Some("tunde".into()),
        ..OrderConfig::default()
    })
    .unwrap();
    run.step(1).unwrap();
    let [event] = run.events() else {
        panic!("{:?}", run.events())
    };
    let refused = |why: &str| why.contains("did you mean 'tuned'");
    assert!(
        matches!(&event.what, What::Order { answer: Answer::Refused(why), .. } if refused(why)),
        "{event:?}"
    );
}

#[test]
fn parts_that_cannot_be_added_are_one_error() {
    let builder = || scenario("urban_intercept", &["detector.kind=truth"]);
    let refused = |builder: Builder| format!("{:?}", builder.open().err().unwrap());
    let lost = |_: &MountPlant| -> Result<Box<dyn PointingLaw>, PartError> { Ok(Box::new(Lost)) };
    let text = refused(builder().law("paper", lost));
    assert!(text.starts_with("law 'paper'"), "{text}");
    let text = refused(builder().topic("mine tracks", 1, |_| Some(1_u32)));
    assert!(
        text.contains("'mine tracks'") && text.contains("/mine/tracks"),
        "{text}"
    );
    let text = refused(builder().topic("/boresight/tick", 1, |_| Some(1_u32)));
    assert!(text.contains("'/boresight/tick'"), "{text}");
    let twice = builder().stage(TrackStage::Recognise, |_| {});
    let text = refused(twice.stage(TrackStage::Recognise, |_| {}));
    assert!(text.contains("replaced twice"), "{text}");
    // A law that cannot be made is no fault of the mount.
    let none =
        |_: &MountPlant| -> Result<Box<dyn PointingLaw>, PartError> { Err("no gains".into()) };
    let text = refused(builder().set("controller.preset=mine").law("mine", none));
    assert!(text.contains("controller.preset: no gains"), "{text}");
}

#[test]
fn several_topics_are_recorded_in_turn() {
    let folder = TempDir::new().unwrap();
    let set = ["detector.kind=truth", "duration_s=0.5"];
    let mut run = scenario("urban_intercept", &set)
        .record(folder.path())
        .topic("/mine/first", 10, |view| Some(view.tick()))
        .topic("/mine/second", 20, |view| Some(view.tick()))
        .open()
        .unwrap();
    assert!(run.step(u64::MAX).unwrap());
    // After the end an order changes nothing any more.
    let error = run.give(&OrderConfig::default()).err().unwrap();
    assert!(error.to_string().contains("over"), "{error}");
    run.finish().unwrap();
    let mcap = folder.path().join("run.mcap");
    let count = |topic: &str| messages(&mcap, topic).len();
    assert_eq!((count("/mine/first"), count("/mine/second")), (5, 10));
}

#[test]
fn a_run_with_orders_is_repeated_by_its_scenario() {
    let folder = TempDir::new().unwrap();
    let set = ["detector.kind=truth", "duration_s=1"];
    let mut run = scenario("urban_intercept", &set).seed(11).open().unwrap();
    run.run_until(0.25).unwrap();
    let drive = DriveOrder {
        rates_degps: Some([1.0 / 3.0, -0.1]),
        mirror_urad: None,
    };
    run.give(&OrderConfig {
        drive: Some(drive),
        ..OrderConfig::default()
    })
    .unwrap();
    run.step(u64::MAX).unwrap();
    let path = folder.path().join("again.toml");
    std::fs::write(&path, run.scenario_with_orders().unwrap()).unwrap();
    let mut again = Simulation::open(&path).unwrap();
    again.step(u64::MAX).unwrap();
    assert_eq!(again.view().state_hash(), run.view().state_hash());
    // Without the order it is another run.
    let mut without = scenario("urban_intercept", &set).seed(11).open().unwrap();
    without.step(u64::MAX).unwrap();
    assert_ne!(without.view().state_hash(), run.view().state_hash());
}

#[test]
fn a_controller_outside_points_and_is_repeated_by_its_orders() {
    let (rms_urad, hash) = outside_controller::run().unwrap();
    // It leads by nothing and leaves the mirror alone; a UAV of 0.35 m at half a kilometre is 700 µrad wide.
    assert!(rms_urad < 1_000.0, "{rms_urad}");
    assert_eq!(outside_controller::run().unwrap(), (rms_urad, hash));
}

#[test]
fn a_recording_is_made_again_tick_by_tick() {
    let folder = TempDir::new().unwrap();
    let [first, again] = repeat::twice(folder.path(), 7).unwrap();
    assert_eq!(first, again);
    let [other, _] = repeat::twice(folder.path(), 8).unwrap();
    assert_ne!(first, other);
}

#[test]
fn seeds_have_a_mean_and_an_interval() {
    let mean = seeds::acquisition_s(3).unwrap();
    assert!(mean.n == 3 && mean.mean.unwrap() > 0.0 && mean.half_95.is_some());
}

#[test]
fn a_scenario_made_by_a_program_runs() {
    let [near, far] = [400.0, 800.0].map(|range_m| own_scenario::neutralised_s(range_m).unwrap());
    assert!(near.unwrap() < far.unwrap(), "{near:?} {far:?}");
}

#[test]
fn air_widens_and_weakens_the_beam() {
    let budget = beam_budget::budget(&[500.0, 2_000.0]);
    for at in &budget {
        assert!(at.radius_m[0] < at.radius_m[1] && at.peak_wpm2[1] < at.peak_wpm2[0]);
    }
    // Diffraction alone: the peak falls with the square of the range.
    let ratio = budget[0].peak_wpm2[0] / budget[1].peak_wpm2[0];
    assert!((ratio / 16.0 - 1.0).abs() < 1e-12, "{ratio}");
    assert!(budget[0].peak_wpm2[1] > 16.0 * budget[1].peak_wpm2[1]);
}

#[test]
fn the_detector_alone_finds_a_uav_in_a_picture() {
    let _one = rendering();
    let (found, truth) = detect_picture::found_and_truth().unwrap();
    let on = |detection: &Detection| detection.lies_on(truth);
    assert!(found.iter().any(on), "{found:?} {truth:?}");
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
    let [tuned, alone] = ["tuned", "gimbal_alone"].map(|law| own_law::run(law).unwrap().0);
    assert!(tuned < 30.0 && alone < 300.0, "{tuned} {alone}");
    // What the mirror is for.
    assert!(alone > 1.5 * tuned, "{tuned} {alone}");
}

#[test]
fn a_hot_spot_grows_until_the_uav_falls() {
    let [calm, strong] = [1e-15, 1e-13].map(|cn2| hot_spot::run(cn2).unwrap());
    // Red says how hot a place is: ABS begins to ablate at 690 K.
    let hottest = (calm.iter().flat_map(image::RgbImage::pixels))
        .map(|pixel| pixel.0[0])
        .max();
    assert!(calm.len() > 3 && hottest > Some(200), "{}", calm.len());
    // The wider spot of strong turbulence takes longer.
    assert!(
        strong.len() > calm.len() + 2,
        "{} {}",
        calm.len(),
        strong.len()
    );
}

#[test]
fn a_beam_crosses_the_air_in_a_way_of_ones_own() {
    let [vacuum, scaling, wave] =
        ["vacuum", "scaling", "wave"].map(|name| own_propagation::run(name).unwrap());
    // Air spreads the spot; half a second at some hundred metres is no long exposure.
    assert!(
        vacuum > 1.02 * scaling && vacuum > 1.02 * wave,
        "{vacuum} {scaling} {wave}"
    );
    assert!((0.7..1.4).contains(&(scaling / wave)), "{scaling} {wave}");
    let wrong = own_propagation::run("wafe").unwrap_err().to_string();
    assert!(
        wrong.contains("no propagation 'wafe'") && wrong.contains("wave"),
        "{wrong}"
    );
}

#[test]
fn a_uav_of_ones_own_flies_and_falls() {
    let [phantom_s, own_s] =
        ["phantom4", own_uav::OWN].map(|model| own_uav::neutralised_s(model).unwrap().unwrap());
    // Its battery lies where the beam falls, and red paint absorbs what the Phantom's white shell throws back.
    assert!(own_s < phantom_s, "{phantom_s} {own_s}");
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
    let start = |preset: &str| {
        let preset = format!("controller.preset={preset}");
        let builder = scenario("urban_intercept", &["detector.kind=truth", &preset]);
        builder.law("lost", |_plant| Ok(Box::new(Lost))).open()
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
    let mut run = start("lost").unwrap();
    let fault = run.step(960).unwrap_err().to_string();
    for wanted in ["station 'station'", "law 'lost'", "NaN", "finite"] {
        assert!(fault.contains(wanted), "{fault}");
    }
}
