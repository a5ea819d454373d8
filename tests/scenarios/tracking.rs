//! Tracking against the truth.

use crate::common::{BLIND, ROOT, messages, of, run_scenario, scenario, station};
use bevy::ecs::schedule::ScheduleCleanupPolicy;
use bevy::prelude::{IntoScheduleConfigs, Query, Res, World};
use boresight::app::{self, Options};
use boresight::components::capture::{Readout, Tier};
use boresight::components::control::SearchScan;
use boresight::components::flight::{Flight, UavStatus};
use boresight::components::operator::{Answer, Command, Designation, Operator, Order};
use boresight::components::record::StateHash;
use boresight::components::run::{SimClock, Tick};
use boresight::components::track::{StateChange, TrackStage, Tracker, TrackingState};
use boresight::models::engage::outcome::Outcome;
use boresight::models::ground::city::{City, CityParams};
use boresight::models::ground::dsm::LineOfSight;
use boresight::models::maths::kinematics::error_angles;
use boresight::report::summary;
use boresight::scenario::{GainsOrder, Scenario, WeatherOrder};
use boresight::simulation::Simulation;
use glam::DVec3;
use std::path::Path;
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

/// The tracker and the truth at one instant of the coarse camera's clock.
#[derive(Debug)]
struct Moment {
    t_s: f64,
    state: TrackingState,
    /// Identity of the target's track.
    target: Option<u32>,
    /// Angle of every UAV and distractor from the laser's true axis [rad], by index.
    off_rad: Vec<f64>,
    /// Whether nothing stands before the first UAV.
    clear: bool,
}

impl Moment {
    fn precise(&self) -> bool {
        matches!(self.state, TrackingState::Precise | TrackingState::Engage)
    }

    /// What the laser's axis is on while a precise track is claimed: the nearest within a
    /// milliradian.
    fn on(&self) -> Option<usize> {
        let near = |index: &usize| self.precise() && self.off_rad[*index] < 1e-3;
        (0..self.off_rad.len())
            .filter(near)
            .min_by(|a, b| self.off_rad[*a].total_cmp(&self.off_rad[*b]))
    }
}

/// What a run without images and files showed.
struct Watched {
    moments: Vec<Moment>,
    changes: Vec<StateChange>,
}

impl Watched {
    /// The last moment before `t_s`.
    fn before(&self, t_s: f64) -> &Moment {
        self.moments
            .iter()
            .rev()
            .find(|moment| moment.t_s < t_s)
            .unwrap()
    }

    /// The longest stretch of time with the laser's axis on something else than the first UAV [s].
    fn longest_on_another_s(&self) -> f64 {
        let other = |moment: &&Moment| moment.on().is_some_and(|on| on > 0);
        let stretches = self.moments.split(|moment| !other(&moment));
        // Each moment stands for a sixtieth of a second.
        stretches
            .map(|some| some.len() as f64 / 60.0)
            .fold(0.0, f64::max)
    }

    /// Identities and times at which the target changed.
    fn targets(&self) -> Vec<(f64, Option<u32>)> {
        let mut targets: Vec<(f64, Option<u32>)> = Vec::new();
        for moment in &self.moments {
            if targets.last().is_none_or(|last| last.1 != moment.target) {
                targets.push((moment.t_s, moment.target));
            }
        }
        targets
    }

    fn log(&self) -> String {
        let line = |change: &StateChange| {
            let (t_s, to) = (change.tick as f64 / 960.0, change.to.name());
            format!("{t_s:8.3} s {to}: {}\n", change.reason)
        };
        self.changes.iter().map(line).collect()
    }
}

/// Runs a scenario with the truth as detector and looks at it 60 times a second.
fn watched(name: &str, seed: u64, set: &[&str]) -> Watched {
    static CITY: LazyLock<Arc<City>> =
        LazyLock::new(|| Arc::new(City::generate(&CityParams::default()).unwrap()));
    let truth = ["detector.kind=truth", "engage.authorised=false"];
    let set = [&truth, set].concat();
    let options = Options {
        seed: Some(seed),
        city: Some(CITY.clone()),
        ..Options::default()
    };
    let started = Instant::now();
    let mut run = scenario(name, &set).options(options).open().unwrap();
    let mut moments = Vec::new();
    run.watch(|run| {
        let view = run.view();
        if view.tick().is_multiple_of(u64::from(view.tick_hz() / 60)) {
            let (station, uavs) = (station(run), view.uavs());
            let aims_enu_m: Vec<DVec3> = uavs.map(|uav| uav.aim_enu_m()).collect();
            let mount = station.mount();
            let axis = mount.laser;
            let off_rad = |aim: &DVec3| error_angles(axis.q_enu_cam, *aim - axis.r_enu_m).length();
            let dsm = &view.air().city().dsm;
            moments.push(Moment {
                t_s: view.t_s(),
                state: station.state(),
                target: station.tracker().target,
                off_rad: aims_enu_m.iter().map(off_rad).collect(),
                clear: dsm.line_of_sight(mount.r_enu_m, aims_enu_m[0]) == LineOfSight::Clear,
            });
        }
        false
    })
    .unwrap();
    let watched = Watched {
        moments,
        changes: station(&run).tracker().changes.clone(),
    };
    println!(
        "{name} {seed} {set:?}: {:.1} s",
        started.elapsed().as_secs_f64()
    );
    watched
}

#[test]
fn a_uav_behind_a_building_is_waited_for_and_found_again() {
    let run = watched("eval/occlusion", 1, &[]);
    let hidden: Vec<_> = run.moments.iter().filter(|moment| !moment.clear).collect();
    let (from_s, to_s) = (hidden[0].t_s, hidden[hidden.len() - 1].t_s);
    assert!((0.8..=1.2).contains(&(to_s - from_s)), "{from_s} to {to_s}");
    // Hidden once, without a break.
    assert!(hidden.len() as f64 > 60.0 * (to_s - from_s));
    let foreseen = run.changes.iter().any(|change| {
        let there = (from_s..to_s).contains(&(change.tick as f64 / 960.0));
        there && change.to == TrackingState::Lost && change.reason.contains("behind a building")
    });
    assert!(foreseen, "{}", run.log());
    // The laser's axis stays on the UAV that nothing sees: within 0.2 mrad, 12 cm there.
    for moment in hidden {
        assert!(moment.off_rad[0] < 2e-4, "{moment:?}");
        assert_ne!(moment.state, TrackingState::Search);
    }
    let known = run.before(from_s);
    assert!(known.on() == Some(0) && known.target.is_some(), "{known:?}");
    let mut after = run.moments.iter().filter(|moment| moment.t_s > to_s);
    let again = after.find(|moment| moment.on() == Some(0)).unwrap();
    assert!(again.t_s - to_s < 0.5, "{again:?}, hidden until {to_s} s");
    assert_eq!(again.target, known.target);
    assert_eq!(run.targets().len(), 2, "{:?}", run.targets());
}

/// The paper's rule goes over to another UAV where sight lines cross, ours does not.
#[test]
fn only_the_papers_rule_mistakes_uavs_that_cross() {
    let lost = |rule: &str| {
        let seeds = 1..=5;
        let runs = seeds.map(|seed| {
            watched(
                "eval/suite_crossing",
                seed,
                &[&format!("tracker.rule={rule}")],
            )
        });
        // On something else than the first UAV for long, or not on it at the end.
        let lost = runs.filter(|run| {
            let before = run.before(5.0); // [s], of the first crossing
            assert_eq!(before.on(), Some(0), "{rule}: {}", run.log());
            assert_eq!(run.targets().len(), 2, "{rule}: {:?}", run.targets());
            run.longest_on_another_s() > 0.25 || run.before(f64::MAX).on() != Some(0)
        });
        lost.count()
    };
    let (paper, ours) = (lost("paper"), lost("global"));
    println!("of 5 locks the paper's rule loses {paper}, ours {ours}");
    assert!(ours == 0 && paper > 0, "{paper}, {ours}");
}

/// By the paper's rule, seed 4 follows a balloon for 3.3 s.
#[test]
fn a_uav_is_not_left_for_a_balloon() {
    for seed in [1, 4] {
        let run = watched("eval/suite_decoy", seed, &[]);
        assert!(run.longest_on_another_s() <= 1.0, "{}", run.log());
        let end = run.before(f64::MAX);
        assert_eq!(end.on(), Some(0), "{end:?}");
    }
}

/// Someone who flies beside the pair, a little further away, and so the lesser threat.
const BESIDE: &str = "uavs.1.trajectory={ kind = 'straight', start_enu_m = [-707, 570, 117.8], \
                      velocity_enu_mps = [5.657, 5.657, 0] }";

#[test]
fn an_operator_points_at_a_uav_and_hands_the_choice_back() {
    let orders = "operator=[{ t_s = 3.0, designate = 'far' }, { t_s = 6.0 }]";
    let run = watched("crossing_pair", 1, &[BESIDE, orders, "duration_s=10"]);
    assert_eq!(run.before(3.0).on(), Some(0), "{}", run.log());
    let ordered = run
        .moments
        .iter()
        .filter(|moment| (4.0..6.0).contains(&moment.t_s));
    for moment in ordered {
        assert_eq!(moment.on(), Some(1), "{moment:?}\n{}", run.log());
    }
    // The nearer one is the greater threat again, and held again.
    assert_eq!(run.before(f64::MAX).on(), Some(0), "{}", run.log());
    let held: Vec<_> = run.targets().into_iter().filter_map(|(_, id)| id).collect();
    assert!(held.len() == 3 && held[0] == held[2], "{held:?}");
    // Without the second order it stays.
    let stays = watched(
        "crossing_pair",
        1,
        &[
            BESIDE,
            &orders.replace(", { t_s = 6.0 }", ""),
            "duration_s=10",
        ],
    );
    assert_eq!(stays.before(f64::MAX).on(), Some(1), "{}", stays.log());
}

/// The crossing pair with orders that a window gives between ticks, and what it then keeps.
fn ordered(set: &[String], given: &[(f64, Command)], seconds: f64) -> (Vec<u64>, Vec<Order>) {
    let path = Path::new(ROOT).join("scenarios/crossing_pair.toml");
    let loaded = Scenario::load(&path, set).unwrap();
    let mut app = app::build(&loaded, &Options::default()).unwrap();
    let world = app.world_mut();
    let hz = f64::from(loaded.scenario.tick_hz);
    let hashes = (0..(seconds * hz) as u64)
        .map(|tick| {
            for (t_s, command) in given {
                if (t_s * hz) as u64 == tick {
                    let mut operator = world.query::<&mut Operator>().single_mut(world).unwrap();
                    operator.give(Order {
                        tick: tick + 1,
                        command: command.clone(),
                    });
                }
            }
            app::step(world).unwrap();
            world.resource::<StateHash>().0
        })
        .collect();
    (hashes, of::<Operator>(world).orders.clone())
}

#[test]
fn a_session_in_the_window_is_repeated_by_its_orders() {
    let set = ["detector.kind=truth", "engage.authorised=false", BESIDE].map(String::from);
    let seconds = 7.0;
    let (untouched, none) = ordered(&set, &[], seconds);
    assert!(none.is_empty());
    // The tracks' identities as a run without orders shows them after three seconds.
    let mut run = scenario("crossing_pair", &set).open().unwrap();
    run.run_until(3.0).unwrap();
    let target = station(&run).target().unwrap().id();
    let other = station(&run).tracks().find(|track| track.id() != target);
    let other = other.expect("both UAVs have tracks").id();
    let given = [
        (3.0, Command::Target(Designation::Track(target))),
        (3.5, Command::Target(Designation::Track(9_999))),
        (4.0, Command::Target(Designation::Track(other))),
        (6.0, Command::Target(Designation::Release)),
    ];
    let (clicked, orders) = ordered(&set, &given, seconds);
    assert_eq!(orders.len(), 4);
    let differs = untouched.iter().zip(&clicked).position(|(a, b)| a != b);
    // To pin the present target, or to choose what is not there, moves nothing.
    assert!(differs.is_some_and(|tick| tick >= 4 * 960), "{differs:?}");

    let scripted = format!(
        "operator=[{{ t_s = {}, track = {target} }}, {{ t_s = {}, track = 9999 }}, \
         {{ t_s = {}, track = {other} }}, {{ t_s = {} }}]",
        orders[0].tick as f64 / 960.0,
        orders[1].tick as f64 / 960.0,
        orders[2].tick as f64 / 960.0,
        orders[3].tick as f64 / 960.0,
    );
    let set = [&set[..], &[scripted]].concat();
    let (repeated, again) = ordered(&set, &[], seconds);
    assert_eq!(again, orders);
    assert_eq!(repeated, clicked);
}

#[test]
fn fire_slew_law_gains_and_weather_are_repeated_by_their_orders() {
    let set = ["detector.kind=truth", BESIDE].map(String::from);
    let wind = WeatherOrder {
        wind_speed_mps: Some(9.7),
        wind_from_deg: Some(0.1 + 0.2),
        visibility_m: Some(1e4 / 3.0),
    };
    let gains = GainsOrder {
        gimbal_per_s: Some(4.2),
        ..GainsOrder::default()
    };
    let given = [
        (0.5, Command::Fire(false)),
        (2.5, Command::Gains(gains)),
        (3.0, Command::Law("lqg".into())),
        (3.5, Command::Weather(wind)),
        (4.0, Command::Slew([314.1, 5.9])),
        (5.0, Command::Target(Designation::Release)),
    ];
    let (clicked, orders) = ordered(&set, &given, 6.0);
    let (untouched, _) = ordered(&set, &[], 6.0);
    let differs = untouched.iter().zip(&clicked).position(|(a, b)| a != b);
    // The wind blows from the tick after the order on, whatever the fire may be.
    assert!(differs.is_some_and(|tick| tick <= 3361), "{differs:?}");
    let at = |i: usize| orders[i].tick as f64 / 960.0;
    let scripted = format!(
        "operator=[{{ t_s = {}, fire = false }}, {{ t_s = {}, gains = {{ gimbal_per_s = 4.2 }} }}, \
         {{ t_s = {}, law = 'lqg' }}, {{ t_s = {}, weather = {{ wind_speed_mps = 9.7, \
         wind_from_deg = {}, visibility_m = {} }} }}, {{ t_s = {}, slew_deg = [314.1, 5.9] }}, \
         {{ t_s = {} }}]",
        at(0),
        at(1),
        at(2),
        at(3),
        0.1 + 0.2,
        1e4 / 3.0,
        at(4),
        at(5),
    );
    let (repeated, again) = ordered(&[&set[..], &[scripted]].concat(), &[], 6.0);
    assert_eq!(again, orders);
    assert_eq!(repeated, clicked);
}

/// What has come of each order is kept beside it, so that a window can say so.
#[test]
fn an_order_is_answered() {
    let path = Path::new(ROOT).join("scenarios/crossing_pair.toml");
    let set = ["detector.kind=truth", "engage.authorised=false", BESIDE].map(String::from);
    let loaded = Scenario::load(&path, &set).unwrap();
    let mut app = app::build(&loaded, &Options::default()).unwrap();
    let world = app.world_mut();
    let mut after = |commands: &[Command], ticks: u32| {
        let tick = world.resource::<SimClock>().tick + 1;
        for command in commands {
            let command = command.clone();
            let mut operator = world.query::<&mut Operator>().single_mut(world).unwrap();
            operator.give(Order { tick, command });
        }
        for _ in 0..ticks {
            app::step(world).unwrap();
        }
        of::<Operator>(world).answers.clone()
    };
    let refused = |why: &str| Answer::Refused(why.into());
    let target = Command::Target;
    assert!(after(&[], 3 * 960).is_empty());
    // One that has not come due has no answer.
    let two = [Command::Fire(false), target(Designation::Track(9_999))];
    assert!(after(&two, 0).is_empty());
    let gone = refused("there is no track 9999");
    assert_eq!(after(&[], 1), [Answer::Obeyed, gone.clone()]);
    let answers = after(&[Command::Law("nonesuch".into())], 1);
    assert!(
        matches!(&answers[2], Answer::Refused(why) if why.contains("no law 'nonesuch'")),
        "{answers:?}"
    );
    // Of two in one tick the later takes the other's place, and is carried out in the next.
    let (first, release) = (Designation::Uav(1), Designation::Release);
    let answers = after(&[target(first), target(release)], 1);
    let replaced = refused("another order took its place");
    assert_eq!(answers[3..], [replaced.clone(), Answer::Waits]);
    assert_eq!(after(&[], 1)[3..], [replaced, Answer::Obeyed]);
}

/// `urban_intercept`, blind, with its UAV hovering in the sector and these settings, after so many seconds.
fn hovering(set: &[&str], seconds: u32) -> Simulation {
    let own = [
        "detector.kind=truth",
        "uavs.0.trajectory={ kind = 'hover', position_enu_m = [-495, 495, 118] }",
    ];
    let builder = scenario("urban_intercept", &[&own, set].concat());
    let mut run = builder.open().unwrap();
    run.run_until(f64::from(seconds)).unwrap();
    run
}

#[test]
fn an_order_to_hold_fire_keeps_a_uav_alive() {
    let status = |set: &[&str]| {
        let run = hovering(set, 12);
        let [uav] = run.view().uavs().collect::<Vec<_>>()[..] else {
            panic!("one UAV")
        };
        uav.status()
    };
    let (ordered, given) = (
        "operator=[{ t_s = 1.0, fire = false }]",
        "operator=[{ t_s = 1.0, fire = true }]",
    );
    assert_ne!(status(&[]), UavStatus::Flying);
    assert_eq!(status(&[ordered]), UavStatus::Flying);
    // The other way round too: an order waits for its track meanwhile, and holds up nothing.
    let waits = given.replace("[{", "[{ t_s = 0.5, track = 1 }, {");
    assert_ne!(
        status(&["engage.authorised=false", &waits]),
        UavStatus::Flying
    );
}

#[test]
fn a_slew_by_hand_finds_a_uav_outside_the_sector() {
    let south = "search={ centre_azimuth_deg = 135, elevation_deg = 5.8 }";
    let held = "engage.authorised=false";
    let target = |set: &[&str]| {
        let run = hovering(set, 8);
        let station = station(&run);
        (station.state(), station.tracker().changes.clone())
    };
    let (state, changes) = target(&[south]);
    assert_eq!(state, TrackingState::Search, "{changes:?}");
    let slew = "operator=[{ t_s = 0.5, slew_deg = [315, 6] }]";
    let (state, changes) = target(&[south, held, slew]);
    assert!(state.holds(Tier::Precise), "{changes:?}");
    // A designation that waits for its track is no hindrance, and is carried out once there is one.
    let both = slew.replace("[{", "[{ t_s = 0.2, designate = 'intruder' }, {");
    let run = hovering(&[south, held, &both], 8);
    let (tracker, operator) = (station(&run).tracker(), station(&run).operator());
    assert!(tracker.designated, "{:?}", tracker.changes);
    assert_eq!((operator.waiting, operator.slew_rad), (None, None));
    // Slewed away from its target it looks elsewhere, and takes up nothing there, until it is released.
    let away = "operator=[{ t_s = 5.0, slew_deg = [135, 6] }, { t_s = 10.0 }]";
    let run = hovering(&[held, away], 9);
    assert_eq!(station(&run).state(), TrackingState::Search);
    let az_rad = station(&run).mount().measured_az_el_rad.x;
    assert!((az_rad.to_degrees() - 135.0).abs() < 3.0, "{az_rad}");
    let run = hovering(&[held, away], 15);
    assert!(station(&run).tracker().target.is_some());
}

/// Frames that the precise camera reads in the fifth second of a hover at this time of day, held fire.
fn precise_frames(time_utc: &str) -> usize {
    let time = format!("time_utc={time_utc}");
    let mut run = hovering(&["engage.authorised=false", &time], 4);
    assert!(station(&run).state().holds(Tier::Precise));
    let ticks_per_s = run.view().tick() / 4;
    let mut read = 0;
    for _ in 0..ticks_per_s {
        run.step(1).unwrap();
        let tick = run.view().tick();
        read += (station(&run).cameras())
            .filter(|camera| camera.tier() == Tier::Precise && camera.exposes_at(tick))
            .filter(|camera| camera.readout() != Readout::Off)
            .count();
    }
    read
}

#[test]
fn a_camera_that_tracks_in_little_light_is_read_less_often() {
    assert_eq!(precise_frames("2025-09-20T08:50:00Z"), 120);
    // Half an hour after sunset: down to 30 Hz.
    assert_eq!(precise_frames("2025-09-20T18:00:00Z"), 30);
}

#[test]
fn an_ordered_wind_and_fog_are_there_from_the_next_tick_on() {
    let order = "operator=[{ t_s = 1.0, weather = { wind_speed_mps = 14, wind_from_deg = 90, \
                 visibility_m = 300 } }]";
    let calm = "weather={ wind_speed_mps = 0 }";
    let drift = |set: &[&str]| {
        let run = hovering(set, 3);
        let [uav] = run.view().uavs().collect::<Vec<_>>()[..] else {
            panic!("one UAV")
        };
        (
            uav.wind_enu_mps().unwrap(),
            station(&run).beam().transmittance,
            run.view().air().weather().visibility_m,
        )
    };
    let (still, clear, _) = drift(&[calm]);
    let (blown, fog, visibility_m) = drift(&[calm, order]);
    assert!(still.length() < 0.1, "{still}");
    // It blows from the east, and stronger up there.
    assert!(blown.x < -10.0 && blown.y.abs() < 8.0, "{blown}");
    assert_eq!(visibility_m, 300.0);
    assert!(fog < 0.1 * clear, "{fog} {clear}");
}

/// What the station knows of the target's range after some seconds of `urban_intercept`, its UAV hovering
/// 700 m away, and whether the range finder ever answered.
fn ranged(set: &[&str], seconds: u32) -> (Option<f64>, bool) {
    // In the beam's line, as what stands half way is.
    let own = ["engage.authorised=false", "uavs.0.gnss_sigma_m=[0, 0]"];
    let run = hovering(&[&own, set].concat(), seconds);
    let tracker = station(&run).tracker();
    assert!(tracker.state.holds(Tier::Precise), "{:?}", tracker.changes);
    (tracker.range_m, tracker.lased)
}

#[test]
fn the_range_finder_sees_what_light_sees() {
    let (clear_m, _) = ranged(&[], 5);
    let clear_m = clear_m.expect("a range through clear air");
    assert!((690.0..720.0).contains(&clear_m), "{clear_m} m");
    // The truth detector sees through fog; the pulse does not.
    let fog = "weather={ visibility_m = 300.0 }";
    assert_eq!(ranged(&[fog], 5), (None, false));
    // A balloon half way hides nothing from the truth detector, but it answers first: believed where nothing
    // else is known of the range, and not where the radar has the target twice as far.
    let balloon = "distractors=[{ name = 'b', kind = 'balloon', \
                   trajectory = { kind = 'hover', position_enu_m = [-247, 247, 83] } }]";
    let unaided = "search={ centre_azimuth_deg = 315, elevation_deg = 5.8, pattern = 'stare' }";
    let (near_m, lased) = ranged(&[balloon, "weather.wind_speed_mps=0", unaided], 5);
    assert!(lased && near_m.is_some_and(|m| m < 600.0), "{near_m:?}");
    let (behind_m, _) = ranged(&[balloon, "weather.wind_speed_mps=0"], 5);
    let right = |m: f64| (680.0..730.0).contains(&m);
    assert!(behind_m.is_none_or(right), "{behind_m:?}");
}

/// One UAV crosses 700 m away, another comes straight at the station from 750 m: only its picture
/// grows, by some two per cent a second.
#[test]
fn the_tracker_turns_once_to_the_uav_that_comes() {
    let uavs = "uavs=[{ name = 'crossing', model = 'phantom4', trajectory = { kind = 'straight', \
                start_enu_m = [-523.3, 466.7, 110], velocity_enu_mps = [5.657, 5.657, 0] } }, \
                { name = 'coming', model = 'phantom4', trajectory = { kind = 'straight', \
                start_enu_m = [-530, 530, 115], velocity_enu_mps = [8, -8, -0.5] } }]";
    for seed in [1, 2] {
        let set = [
            uavs,
            "operator=[]",
            "tracker.switch_ratio=1.5",
            "duration_s=16",
        ];
        let run = watched("eval/suite_crossing", seed, &set);
        assert_eq!(run.before(1.0).on(), Some(0), "{}", run.log());
        assert_eq!(run.before(f64::MAX).on(), Some(1), "{}", run.log());
        assert_eq!(run.targets().len(), 3, "{}", run.log());
        assert!(run.log().contains("is the greater threat"), "{}", run.log());
    }
}

#[test]
fn the_controllers_of_the_project_hold_what_the_papers_gains_do_not() {
    for (preset, [least_px, most_px]) in [
        ("tuned", [0.0, 0.6]),
        ("lqg", [0.0, 0.6]),
        ("paper", [10.0, f64::MAX]),
    ] {
        let preset = format!("controller.preset={preset}");
        let set = ["engage.authorised=false", "duration_s=6", &preset];
        let args: Vec<&str> = set.iter().flat_map(|set| ["--set", set]).collect();
        let run = run_scenario("urban_intercept", &[&BLIND[..], &args].concat());
        let mean_px = run.number("/miss_distance_px/precise/mean");
        println!("{preset}: {mean_px:.2} px");
        assert!(
            (least_px..most_px).contains(&mean_px),
            "{preset}: {mean_px} px"
        );
    }
}

/// A UAV that is seen from the third gaze alone interrupts it, and vanishes.
#[test]
fn a_gaze_that_was_left_is_begun_anew() {
    let path = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    let set = [
        "detector.kind=truth",
        "engage.authorised=false",
        "station.position_enu_m=[0, 0, 48]",
        // Four gazes of 6 degrees beside each other, and no radar that would shift them.
        "search={ centre_azimuth_deg = 315, elevation_deg = 6, width_deg = 20, height_deg = 4 }",
        // 700 m away in the middle of the third.
        "uavs.0.trajectory={ kind = 'hover', position_enu_m = [-472.1, 511.7, 121.2] }",
    ];
    let loaded = Scenario::load(&path, &set.map(String::from)).unwrap();
    let mut app = app::build(&loaded, &Options::default()).unwrap();
    let world = app.world_mut();
    let at = |world: &World| {
        let tick = world.resource::<SimClock>().tick;
        assert!(tick < 30 * 960, "nothing happens");
        let scan = of::<SearchScan>(world);
        (tick, scan.index, scan.settled_since)
    };
    let searches = |world: &World| of::<Tracker>(world).state == TrackingState::Search;
    while searches(world) {
        app::step(world).unwrap();
        at(world);
    }
    let (_, left, settled_since) = at(world);
    assert_eq!((left, settled_since), (2, None));
    let gaze_ticks = (960.0 * of::<SearchScan>(world).empty_gaze_s()) as u64;

    let mut uavs = world.query::<(&mut Flight, &mut UavStatus)>();
    let (mut flight, mut status) = uavs.single_mut(world).unwrap();
    flight.state.r_enu_m = DVec3::new(0.0, 0.0, -500.0);
    *status = UavStatus::Crashed;
    while !searches(world) {
        app::step(world).unwrap();
        at(world);
    }
    // Still the same gaze; what it had lasted before counts no more.
    let (back, index, _) = at(world);
    assert_eq!(index, left);
    let mut begun = None;
    loop {
        app::step(world).unwrap();
        let (tick, index, settled_since) = at(world);
        if index != left {
            let begun = begun.expect("the gaze was never begun");
            println!("left, back at {back}, begun at {begun}, next at {tick}");
            assert_eq!(index, left + 1);
            assert!(
                begun >= back && tick > begun + gaze_ticks,
                "{begun} to {tick}"
            );
            break;
        }
        begun = begun.or(settled_since);
    }
}

/// A gull and a balloon are no UAVs: the search turns to what shows for a moment, and says so.
#[test]
fn what_the_search_glances_at_is_logged() {
    let sector =
        "search={ centre_azimuth_deg = 315, elevation_deg = 6, width_deg = 20, height_deg = 4 }";
    let gull = "{ name = 'gull', kind = 'bird', trajectory = { kind = 'straight', \
                start_enu_m = [-472.1, 511.7, 111.2], velocity_enu_mps = [9, 9, 0] } }";
    let balloon = "{ name = 'balloon', kind = 'balloon', trajectory = { kind = 'hover', \
                   position_enu_m = [-472.1, 511.7, 121.2] } }";
    let both = format!("distractors=[{gull}, {balloon}]");
    let set = [
        "engage.authorised=false",
        "duration_s=5",
        sector,
        "uavs.0.trajectory={ kind = 'hover', position_enu_m = [0, -700, 121] }",
        &both,
    ];
    let args: Vec<&str> = set.iter().flat_map(|set| ["--set", set]).collect();
    let run = run_scenario("urban_intercept", &[&BLIND[..], &args].concat());
    let lines = messages(&run.file("run.mcap"), "/log");
    let glances = (lines.iter())
        .map(|line| String::from_utf8_lossy(line))
        .filter(|line| line.contains("glances at track"))
        .count();
    // Neither is looked at again within ten seconds.
    assert!(
        (1..=2).contains(&glances),
        "{glances} of {} lines",
        lines.len()
    );
}

/// A state machine that goes from acquire to precise without coarse.
fn straight_to_precise(clock: Res<SimClock>, mut stations: Query<&mut Tracker>) {
    for mut tracker in &mut stations {
        let first = tracker.table.tracks.first().map(|track| track.id);
        match (tracker.state, first) {
            (TrackingState::Search, Some(id)) => tracker.acquire(clock.tick, id, "test"),
            (TrackingState::Acquire, _) if clock.tick >= 600 => {
                tracker.change(clock.tick, TrackingState::Precise, "test");
            }
            _ => {}
        }
    }
}

/// Acquired is what a camera holds, whichever: the precise one may find a candidate before the coarse one.
#[test]
fn what_the_precise_camera_finds_first_is_acquired() {
    let path = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    let loaded = Scenario::load(&path, &["detector.kind=truth".into()]).unwrap();
    let options = Options::default();
    let mut app = app::build_with(&loaded, &options, |app| {
        let all = ScheduleCleanupPolicy::RemoveSystemsOnly;
        let removed = app.remove_systems_in_set(Tick, TrackStage::Decide, all);
        assert!(removed.unwrap() > 0);
        app.add_systems(Tick, straight_to_precise.in_set(TrackStage::Decide));
    })
    .unwrap();
    let world = app.world_mut();
    let finish = |world: &mut World| {
        summary::finish(world, &loaded, &options, Duration::from_secs(1)).summary
    };
    while world.resource::<SimClock>().tick < 599 {
        app::step(world).unwrap();
    }
    assert_eq!(of::<Tracker>(world).state, TrackingState::Acquire);
    let before = finish(world);
    assert_eq!(before.outcome, Outcome::NotAcquired);
    assert_eq!(before.time_to_acquire_s, None);
    let why = before.uavs[0].why.as_ref().unwrap();
    assert!(why.starts_with("in the search camera's view for "), "{why}");
    app::step(world).unwrap();
    assert_eq!(of::<Tracker>(world).state, TrackingState::Precise);
    let acquired_s = Some(world.resource::<SimClock>().t_s());
    let after = finish(world);
    assert_eq!(after.time_to_acquire_s, acquired_s);
    assert_eq!(after.stations[0].acquired_s, acquired_s);
    assert_eq!(after.outcome, Outcome::Tracked, "{}", after.reason);
    let reason = &after.reason;
    assert!(reason.starts_with("tracking reached precise"), "{reason}");
}
