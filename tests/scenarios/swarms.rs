//! Swarms: members, ways, collisions, evasion.

use crate::common::{BLIND, boresight, refused, run_scenario, scenario};
use boresight::components::flight::UavStatus;
use boresight::models::ground::city::{City, CityParams};
use boresight::models::ground::dsm::{Dsm, LineOfSight};
use boresight::simulation::Simulation;
use glam::{DVec2, DVec3};

/// `urban_intercept` with these swarms in place of its UAV, and as long as any test lets it run.
fn swarm(text: &str, more: &[&str]) -> Simulation {
    let set = [
        &[
            "detector.kind=truth",
            "duration_s=200",
            "uavs=[]",
            "engage.authorised=false",
            text,
        ][..],
        more,
    ];
    let builder = scenario("urban_intercept", &set.concat());
    builder.open().unwrap()
}

fn run_for(run: &mut Simulation, seconds: f64) {
    run.step((960.0 * seconds) as u64).unwrap();
}

fn members(run: &Simulation) -> Vec<(DVec3, UavStatus)> {
    let uavs = run.view().uavs();
    uavs.map(|uav| (uav.r_enu_m(), uav.status())).collect()
}

#[test]
fn a_flock_follows_the_roofs_and_keeps_apart() {
    let mut run = swarm(
        "swarms=[{ name = 's', count = 40, models = ['fpv5', 'mavic2'], formation = 'grid', spacing_m = 12, \
         from = [{ azimuth_deg = 315, distance_m = 700, above_m = 40 }], to_enu_m = [0, 0, 60], \
         above_ground_m = 30, keep_formation = false }]",
        &[],
    );
    let start = members(&run);
    assert_eq!(start.len(), 40);
    run_for(&mut run, 20.0);
    let places = members(&run);
    let dsm = &run.view().air().city().dsm;
    let mut nearest_m = f64::INFINITY;
    for (index, (r_enu_m, status)) in places.iter().enumerate() {
        assert_eq!(*status, UavStatus::Flying, "member {index}");
        let above_m = r_enu_m.z - dsm.surface_m(r_enu_m.x, r_enu_m.y);
        assert!(above_m > 8.0, "member {index}: {above_m} m above the roofs");
        for (other, _) in &places[index + 1..] {
            nearest_m = nearest_m.min(r_enu_m.distance(*other));
        }
    }
    assert!(nearest_m > 2.0, "{nearest_m} m");
    let middle = |list: &[(DVec3, UavStatus)]| {
        list.iter().map(|(r, _)| *r).sum::<DVec3>() / list.len() as f64
    };
    let gone_m = (middle(&places) - middle(&start)).truncate().length();
    assert!((180.0..260.0).contains(&gone_m), "{gone_m} m at 12 m/s");
}

#[test]
fn what_meets_in_the_air_falls() {
    // Head on, from both sides of the same place.
    let mut run = swarm(
        "uavs=[{ name = 'a', model = 'mavic2', gnss_sigma_m = [0, 0], trajectory = { kind = 'straight', start_enu_m = [-320, 300, 120], \
         velocity_enu_mps = [10, 0, 0] } }, { name = 'b', model = 'phantom4', gnss_sigma_m = [0, 0], trajectory = { kind = 'straight', \
         start_enu_m = [-280, 300, 120], velocity_enu_mps = [-10, 0, 0] } }, { name = 'c', model = 'phantom4', \
         trajectory = { kind = 'hover', position_enu_m = [-300, 320, 120] } }]",
        &[],
    );
    run_for(&mut run, 3.0);
    let statuses: Vec<UavStatus> = members(&run).iter().map(|(_, status)| *status).collect();
    assert_eq!(
        statuses,
        [UavStatus::Struck, UavStatus::Struck, UavStatus::Flying]
    );
    run_for(&mut run, 12.0);
    let statuses: Vec<UavStatus> = members(&run).iter().map(|(_, status)| *status).collect();
    assert_eq!(
        statuses,
        [UavStatus::Crashed, UavStatus::Crashed, UavStatus::Flying]
    );
}

/// `urban_intercept`'s city.
fn city() -> City {
    City::generate(&CityParams::default()).unwrap()
}

/// Open ground near a place, level for so many metres around.
fn open_near(dsm: &Dsm, near_m: DVec2, radius_m: f64) -> DVec2 {
    let built_m = |p: DVec2| dsm.surface_m(p.x, p.y) - dsm.terrain_m(p.x, p.y);
    let spiral =
        (0..4_000).map(|k| near_m + f64::from(k).sqrt() * DVec2::from_angle(2.4 * f64::from(k)));
    let open = |p: &DVec2| {
        let around = (0..16).map(|k| DVec2::from_angle(f64::from(k) * std::f64::consts::FRAC_PI_8));
        let around =
            around.flat_map(|out| [0.25, 0.5, 0.75, 1.0].map(|share| *p + share * radius_m * out));
        around.into_iter().all(|at| built_m(at) < 0.2)
    };
    spiral.into_iter().find(open).unwrap()
}

#[test]
fn neighbours_of_a_swarm_share_their_gusts() {
    let mut run = swarm(
        "swarms=[{ name = 's', count = 4, models = ['mavic2'], formation = 'line', spacing_m = 8, \
         from = [{ azimuth_deg = 315, distance_m = 1500, above_m = 60 }, { azimuth_deg = 135, distance_m = 1500, above_m = 60 }], \
         to_enu_m = [0, 0, 60] }]",
        &["weather.wind_speed_mps=8"],
    );
    // The first two come from the north-west, the others from the south-east.
    let (mut near, mut far, mut n) = (0.0, 0.0, 0.0);
    for tick in 0..960 * 40 {
        run.step(1).unwrap();
        if tick % 96 != 0 {
            continue;
        }
        let winds = run.view().uavs().map(|uav| uav.wind_enu_mps().unwrap());
        let winds: Vec<DVec3> = winds.collect();
        let apart = |a: usize, b: usize| (winds[a] - winds[b]).length_squared();
        near += apart(0, 1) + apart(2, 3);
        far += apart(0, 2) + apart(1, 3);
        n += 2.0;
    }
    let (near_mps, far_mps) = (f64::sqrt(near / n), f64::sqrt(far / n));
    println!("rms difference of the wind: 8 m apart {near_mps:.2} m/s, far {far_mps:.2} m/s");
    assert!(
        near_mps > 0.02 && near_mps < 0.5 * far_mps,
        "{near_mps} {far_mps}"
    );
}

#[test]
fn groups_fly_apart_and_meet_again() {
    let mut run = swarm(
        "swarms=[{ name = 's', count = 12, models = ['fpv5'], formation = 'line', spacing_m = 8, speed_mps = 15, \
         from = [{ azimuth_deg = 0, distance_m = 700, above_m = 60 }], to_enu_m = [0, 0, 80], keep_formation = false, \
         split = { bearings_deg = [-35, 35], at_m = 650, rejoin_m = 250 } }]",
        &[],
    );
    let width_m = |run: &Simulation| {
        let members = members(run);
        assert!(
            members
                .iter()
                .all(|(_, status)| *status == UavStatus::Flying)
        );
        let east = members.iter().map(|(r, _)| r.x);
        east.clone().fold(f64::NEG_INFINITY, f64::max) - east.fold(f64::INFINITY, f64::min)
    };
    let start_m = width_m(&run);
    // 50 m at 15 m/s, then 200 of 400 m at 12.3 m/s: 140 m to each side.
    run_for(&mut run, 19.6);
    let apart_m = width_m(&run);
    run_for(&mut run, 19.0);
    let again_m = width_m(&run);
    println!("{start_m:.0} m wide, {apart_m:.0} m, {again_m:.0} m");
    assert!(apart_m > 250.0, "{apart_m} m");
    assert!(again_m < 1.3 * start_m, "{again_m} m of {start_m} m");
}

#[test]
fn a_low_approach_is_hidden_until_it_pops_up() {
    let mut run = swarm(
        "swarms=[{ name = 's', count = 10, models = ['fpv5', 'mavic2'], formation = 'line', spacing_m = 12, \
         from = [{ azimuth_deg = 315, distance_m = 900, above_m = 30 }], to_enu_m = [0, 0, 60], keep_formation = false, \
         pop_up = { at_m = 350 } }]",
        &[],
    );
    let (mut low, mut seen_low, mut high, mut seen_high) = (0, 0, 0, 0);
    for second in 0..60 {
        run_for(&mut run, 1.0);
        let air = run.view().air();
        for (index, (r_enu_m, status)) in members(&run).into_iter().enumerate() {
            assert_eq!(status, UavStatus::Flying, "member {index} after {second} s");
            let goal = DVec3::new(0.0, 0.0, 60.0);
            let sight = air.line_of_sight(goal, r_enu_m);
            let seen = usize::from(sight == LineOfSight::Clear);
            match r_enu_m.truncate().length() {
                far if far > 360.0 => (low, seen_low) = (low + 1, seen_low + seen),
                far if far < 250.0 => (high, seen_high) = (high + 1, seen_high + seen),
                _ => {}
            }
        }
    }
    println!("seen from the goal: {seen_low} of {low} low, {seen_high} of {high} after the rise");
    let share = |seen: usize, of: usize| seen as f64 / of as f64;
    assert!(share(seen_low, low) < 0.35 && share(seen_high, high) > 0.8);
}

#[test]
fn members_take_off_one_after_the_other_and_land() {
    let city = city();
    let [from, to] =
        [[-250.0, 250.0], [150.0, -200.0]].map(|near| open_near(&city.dsm, near.into(), 8.0));
    let pads = format!(
        "swarms=[{{ name = 's', count = 6, models = ['mavic2', 'fpv5'], spacing_m = 8, keep_formation = false, \
         above_ground_m = 30, to_enu_m = [0, 0, 80], \
         take_off = {{ pads_en_m = [[{}, {}], [{}, {}]], every_s = 3 }}, \
         land = {{ pads_en_m = [[{}, {}]], at_s = 15 }} }}]",
        from.x,
        from.y,
        from.x + 5.0,
        from.y,
        to.x,
        to.y
    );
    let mut run = swarm(&pads, &[]);
    let count = |run: &Simulation, wanted: UavStatus| {
        members(run)
            .iter()
            .filter(|(_, status)| *status == wanted)
            .count()
    };
    let start = members(&run);
    assert_eq!(count(&run, UavStatus::Landed), 6);
    run_for(&mut run, 1.0);
    assert_eq!(count(&run, UavStatus::Flying), 2);
    let after = members(&run);
    for (index, (now, before)) in after.iter().zip(&start).enumerate() {
        let risen_m = now.0.z - before.0.z;
        assert_eq!(index < 2, risen_m > 0.5, "member {index}: {risen_m} m");
        assert!(index < 2 || risen_m == 0.0, "member {index}: {risen_m} m");
    }
    run_for(&mut run, 7.0);
    assert_eq!(count(&run, UavStatus::Flying), 6);
    let mut seconds = 8;
    while count(&run, UavStatus::Landed) < 6 {
        run_for(&mut run, 1.0);
        seconds += 1;
        let stuck = members(&run);
        assert!(seconds < 150, "{stuck:?}");
        let whole = |(_, status): &(DVec3, UavStatus)| {
            matches!(status, UavStatus::Flying | UavStatus::Landed)
        };
        assert!(stuck.iter().all(whole), "{stuck:?}");
    }
    println!("all have landed after {seconds} s");
    let landed = members(&run);
    for (r_enu_m, _) in &landed {
        assert!((r_enu_m.truncate() - to).length() < 8.0, "{r_enu_m}");
        let legs_m = r_enu_m.z - city.dsm.surface_m(r_enu_m.x, r_enu_m.y);
        assert!((0.0..0.3).contains(&legs_m), "{legs_m} m");
    }
    // They rest.
    run_for(&mut run, 2.0);
    assert_eq!(members(&run), landed);
}

#[test]
fn what_hits_a_wall_falls_down_it() {
    let city = city();
    let dsm = &city.dsm;
    let surface_m = |p: DVec2| dsm.surface_m(p.x, p.y);
    // A wall of 15 m at least, open ground before it, met square and aslant.
    let walls = (0..4_000).map(|k| 60.0 + 0.1 * f64::from(k)).zip(0..);
    let mut walls = walls.flat_map(|(r_m, k)| {
        let at = r_m * DVec2::from_angle(2.4 * f64::from(k));
        [0.0, 0.8, 1.6, 2.4, 3.2, 4.0, 4.8, 5.6].map(|angle| (at, DVec2::from_angle(angle)))
    });
    let mut fit = |high_m: f64| {
        walls.find(|(at, into)| {
            let ground_m = surface_m(*at);
            let before = (0..35).all(|m| surface_m(*at - f64::from(m) * *into) < ground_m + 0.5);
            let deep = (1..8).all(|m| surface_m(*at + f64::from(m) * *into) > ground_m + high_m);
            before && deep
        })
    };
    let uavs: Vec<String> = (0..4)
        .map(|index| {
            let (wall, into) = fit(15.0).unwrap();
            let start = wall - 25.0 * into;
            let (up_m, speed_mps) = (surface_m(wall) + [4.0, 10.0][index % 2], [12.0, 20.0][index / 2]);
            format!(
                "{{ name = 'u{index}', model = '{}', trajectory = {{ kind = 'straight', start_enu_m = [{}, {}, {up_m}], \
                 velocity_enu_mps = [{}, {}, 0] }} }}",
                ["mavic2", "matrice600"][index % 2],
                start.x,
                start.y,
                speed_mps * into.x,
                speed_mps * into.y
            )
        })
        .collect();
    // A fifth hovers: a run ends soon after the last has come down.
    let goes_on = "{ name = 'high', model = 'mavic2', trajectory = { kind = 'hover', \
                   position_enu_m = [0, 300, 200] } }";
    let mut run = swarm(&format!("uavs=[{}, {goes_on}]", uavs.join(", ")), &[]);
    let walled = |run: &Simulation| members(run)[..4].to_vec();
    let mut before = walled(&run);
    let (mut hit, mut fallen_m) = ([None; 4], [0.0; 4]);
    for tick in 0..960 * 20 {
        run.step(1).unwrap();
        let now = walled(&run);
        for (index, ((r_enu_m, status), (last_enu_m, _))) in now.iter().zip(&before).enumerate() {
            // Out of the wall at once, by no more than its own size and what the patch is off.
            let jump_m = r_enu_m.distance(*last_enu_m);
            assert!(jump_m < 1.6, "{index} at tick {tick}: {jump_m} m");
            if *status == UavStatus::Struck {
                let from = hit[index].get_or_insert(*r_enu_m);
                fallen_m[index] = from.z - r_enu_m.z;
            }
        }
        before = now;
    }
    for (index, (r_enu_m, status)) in before.iter().enumerate() {
        let above_m = r_enu_m.z - dsm.surface_m(r_enu_m.x, r_enu_m.y);
        println!(
            "{index}: {status:?} after {:.1} m, {above_m:.2} m above what lies below",
            fallen_m[index]
        );
        assert_eq!(*status, UavStatus::Crashed, "{index}");
        let high_m = [4.0, 10.0][index % 2];
        assert!(
            (0.6 * high_m..1.3 * high_m).contains(&fallen_m[index]),
            "{index}: {fallen_m:?}"
        );
        assert!((-0.1..1.0).contains(&above_m), "{index}: {above_m} m");
    }
}

#[test]
fn evasion_costs_the_laser_time_and_repeats_bit_for_bit() {
    let raider = |evasion: &str| {
        format!(
            "swarms=[{{ name = 'raider', count = 1, models = ['phantom4'], from = [{{ azimuth_deg = 315, \
             distance_m = 900, above_m = 60 }}], to_enu_m = [0, 0, 60], evasion = [{evasion}] }}]"
        )
    };
    let run = |evasion: &str| {
        let swarm = raider(evasion);
        // In a third of the runs it comes out of sight before it falls, and so with this seed.
        let more = ["--seed", "13", "--set", "uavs=[]", "--set", &swarm];
        let args = [&BLIND[..], &more].concat();
        run_scenario("urban_intercept", &args)
    };
    let (straight, evading, again) = (run(""), run("'jink', 'dive'"), run("'jink', 'dive'"));
    assert_eq!(straight.text("outcome"), "neutralised");
    assert_eq!(evading.hash(), again.hash());
    // Low over the roofs it is out of sight, or before what must not be hit.
    let until_s = |run: &crate::common::Run| match run.text("outcome") {
        "neutralised" => run.number("/time_to_neutralise_s"),
        _ => f64::INFINITY,
    };
    let (straight_s, evading_s) = (until_s(&straight), until_s(&evading));
    assert!(
        evading_s > 1.5 * straight_s,
        "{evading_s} s, {straight_s} s"
    );
}

#[test]
fn swarms_that_cannot_fly_are_refused() {
    for (swarm, wanted) in [
        (
            "count = 0, models = ['fpv5'], from = [{ azimuth_deg = 0, distance_m = 500 }], to_enu_m = [0, 0, 50]",
            "swarms[0].count",
        ),
        (
            "count = 3, models = [], from = [{ azimuth_deg = 0, distance_m = 500 }], to_enu_m = [0, 0, 50]",
            "swarms[0].models",
        ),
        (
            "count = 3, models = ['fpv6'], from = [{ azimuth_deg = 0, distance_m = 500 }], to_enu_m = [0, 0, 50]",
            "did you mean 'fpv5'",
        ),
        (
            "count = 3, models = ['fpv5'], from = [], to_enu_m = [0, 0, 50]",
            "swarms[0].from",
        ),
        (
            "count = 3, models = ['fpv5'], from = [{ azimuth_deg = 0, distance_m = 500 }]",
            "tracker.asset_enu_m",
        ),
        (
            "count = 3, models = ['fpv5'], from = [{ azimuth_deg = 0, distance_m = 500 }], to_enu_m = [0, 0, 50], \
             formation = 'star'",
            "wedge",
        ),
        (
            "count = 3, models = ['fpv5'], from = [{ azimuth_deg = 0, distance_m = 500 }], to_enu_m = [0, 0, 50], \
             split = { bearings_deg = [0], at_m = 300 }",
            "swarms[0].split.bearings_deg",
        ),
        (
            "count = 3, models = ['fpv5'], from = [{ azimuth_deg = 0, distance_m = 500 }], to_enu_m = [0, 0, 50], \
             split = { bearings_deg = [-30, 30], at_m = 300, rejoin_s = 20 }",
            "give at_m, with or without rejoin_m",
        ),
        (
            "count = 3, models = ['fpv5'], from = [{ azimuth_deg = 0, distance_m = 500 }], to_enu_m = [0, 0, 50], \
             split = { bearings_deg = [-30, 30], at_m = 300, rejoin_m = 400 }",
            "must be below at_m = 300",
        ),
        (
            "count = 3, models = ['fpv5'], from = [{ azimuth_deg = 0, distance_m = 500 }], to_enu_m = [0, 0, 50], \
             pop_up = { at_m = 300, low_m = 1 }",
            "swarms[0].pop_up.low_m",
        ),
        (
            "count = 3, models = ['fpv5'], to_enu_m = [0, 0, 50], take_off = { pads_en_m = [] }",
            "swarms[0].take_off.pads_en_m",
        ),
        (
            "count = 3, models = ['fpv5'], from = [{ azimuth_deg = 0, distance_m = 500 }], to_enu_m = [0, 0, 50], \
             take_off = { pads_en_m = [[0, 200]] }",
            "leave from, waves and decoys out",
        ),
        (
            "count = 3, models = ['fpv5'], from = [{ azimuth_deg = 0, distance_m = 500 }], to_enu_m = [0, 0, 50], \
             land = { pads_en_m = [[0, 200]], at_s = -1 }",
            "swarms[0].land.at_s",
        ),
        (
            "count = 1000000000, models = ['fpv5'], from = [{ azimuth_deg = 0, distance_m = 500 }], to_enu_m = [0, 0, 50]",
            "must be from 1 to 5000",
        ),
    ] {
        let set = format!("swarms=[{{ name = 's', {swarm} }}]");
        let mut command = boresight();
        command.args(["check", "scenarios/urban_intercept.toml", "--set", &set]);
        refused(&mut command, &[wanted]);
    }
}
