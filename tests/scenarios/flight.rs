//! What flies, and what is taken for it.

use crate::common::{BLIND, ROOT, boresight, messages, scenario, stderr};
use boresight::app::{self, Options};
use boresight::components::environment::Environment;
use boresight::components::flight::{Flight, Uav, UavStatus};
use boresight::components::run::SimClock;
use boresight::models::ground::city::{BuildingKind, City, CityParams, Roof};
use boresight::models::maths::kinematics::GRAVITY_MPS2;
use boresight::models::maths::polygon;
use boresight::recording::proto;
use boresight::scenario::{Scenario, catalogue};
use glam::{DVec2, DVec3};
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

/// Whether the surface is level within `radius_m` of a place.
fn level(city: &City, at: DVec2, radius_m: f64) -> bool {
    let height_m = |p: DVec2| city.dsm.surface_m(p.x, p.y);
    let around = (0..8).map(|k| radius_m * DVec2::from_angle(f64::from(k) * 0.785));
    let around = around.flat_map(|offset| [at + 0.5 * offset, at + offset]);
    around
        .into_iter()
        .all(|p| (height_m(p) - height_m(at)).abs() < 0.05)
}

/// The default city without relief.
fn flat_city() -> City {
    let params = CityParams {
        relief_m: 0.0,
        ..CityParams::default()
    };
    City::generate(&params).unwrap()
}

/// How high what stands at a place is [m].
fn built_m(city: &City, p: DVec2) -> f64 {
    city.dsm.surface_m(p.x, p.y) - city.dsm.terrain_m(p.x, p.y)
}

/// Level ground with nothing on it.
fn open_ground(city: &City) -> DVec2 {
    (0..2_000)
        .map(f64::from)
        .map(|k| (100.0 + 0.2 * k) * DVec2::from_angle(2.4 * k))
        .find(|p| level(city, *p, 8.0) && built_m(city, *p).abs() < 0.1)
        .unwrap()
}

/// Two UAVs stand in still air, one above open ground and one above a flat roof, when their rotors
/// die.
#[test]
fn a_uav_that_was_shot_falls_to_what_lies_below_it() {
    const HEIGHT_M: f64 = 60.0;
    let city = flat_city();
    let open = open_ground(&city);
    let roofs = city.buildings.iter().filter(|building| {
        matches!(building.parts[0].roof, Roof::Flat(_)) && building.kind != BuildingKind::Station
    });
    let roof = roofs
        .flat_map(|building| {
            let outline = building.footprint_enu_m();
            let centre = outline.iter().sum::<DVec2>() / outline.len() as f64;
            // Beside what stands on the roof.
            let steps_m = [-8.0, -4.0, 0.0, 4.0, 8.0];
            let around = steps_m.map(|e| steps_m.map(|n| centre + DVec2::new(e, n)));
            around.into_iter().flatten()
        })
        .find(|p| level(&city, *p, 4.0) && built_m(&city, *p) > 5.0)
        .unwrap();

    let places = [open, roof].map(|p| {
        let up_m = city.dsm.surface_m(p.x, p.y) + HEIGHT_M;
        p.extend(up_m)
    });
    let hover = |name: &str, kind: &str, r: DVec3| {
        format!(
            "{{ name = '{name}', model = '{kind}', gnss_sigma_m = [0, 0], trajectory = {{ kind = 'hover', \
             position_enu_m = [{}, {}, {}] }} }}",
            r.x, r.y, r.z
        )
    };
    let kinds = ["phantom4", "matrice600"];
    let set = [
        "detector.kind=truth".to_string(),
        "engage.authorised=false".to_string(),
        "city.relief_m=0".to_string(),
        "weather={ wind_speed_mps = 0 }".to_string(),
        format!(
            "uavs=[{}, {}]",
            hover("open", "phantom4", places[0]),
            hover("roof", "matrice600", places[1])
        ),
    ];
    let path = Path::new(ROOT).join("scenarios/urban_intercept.toml");
    let loaded = Scenario::load(&path, &set).unwrap();
    let mut app = app::build(&loaded, &Options::default()).unwrap();
    let world = app.world_mut();
    let mut uavs = world.query::<(&Uav, &Flight, &mut UavStatus)>();
    for _ in 0..960 {
        app::step(world).unwrap();
    }
    let mut starts = [DVec3::ZERO; 2];
    for (uav, flight, mut status) in uavs.iter_mut(world) {
        starts[uav.index] = flight.state.r_enu_m;
        *status = UavStatus::Falling;
    }
    let from_s = world.resource::<SimClock>().t_s();
    let density = world.resource::<Environment>().air_density_kgpm3;
    let mut heights_m: [Vec<(f64, f64)>; 2] = Default::default();
    let mut down: [Option<(f64, DVec3)>; 2] = [None; 2];
    while down.contains(&None) {
        app::step(world).unwrap();
        let t_s = world.resource::<SimClock>().t_s() - from_s;
        assert!(t_s < 20.0, "they never come down: {heights_m:?}");
        for (uav, flight, status) in uavs.iter(world) {
            let r = flight.state.r_enu_m;
            match *status {
                UavStatus::Falling => heights_m[uav.index].push((t_s, r.z)),
                UavStatus::Down if down[uav.index].is_none() => down[uav.index] = Some((t_s, r)),
                _ => {}
            }
        }
    }
    for index in 0..2 {
        let uav = catalogue::load(kinds[index]).unwrap();
        let (place, start) = (places[index], starts[index]);
        let surface_m = place.z - HEIGHT_M;
        let half_m = 0.5 * uav.size_m[2];
        // From rest against quadratic drag: v_t = sqrt(2 m g / (rho C_D A)),
        // t = v_t / g acosh(exp(g h / v_t^2)).
        let terminal_mps = (2.0 * uav.mass_kg * GRAVITY_MPS2 / (density * uav.drag_area_m2)).sqrt();
        let h_m = start.z - surface_m - half_m;
        let expected_s =
            terminal_mps / GRAVITY_MPS2 * (GRAVITY_MPS2 * h_m / terminal_mps.powi(2)).exp().acosh();
        let touches = |(_, z): &&(f64, f64)| *z < surface_m + half_m + 0.05;
        let (touched_s, _) = *heights_m[index].iter().find(touches).unwrap();
        let (down_s, r) = down[index].unwrap();
        let off = r - place;
        println!(
            "{:?}: {h_m:.2} m in {touched_s:.3} s, closed form {expected_s:.3} s, free fall {:.3} s, \
             at rest after {down_s:.2} s, {:.3} m aside, {:.3} m above the surface",
            kinds[index],
            (2.0 * h_m / GRAVITY_MPS2).sqrt(),
            off.truncate().length(),
            r.z - surface_m
        );
        let falls = heights_m[index]
            .iter()
            .take_while(|(t_s, _)| *t_s < touched_s);
        let falls: Vec<f64> = falls.map(|(_, z)| *z).collect();
        assert!(falls.windows(2).all(|pair| pair[1] <= pair[0]), "{falls:?}");
        // Measured: 0.1 per cent short, from the size of Rapier's step. Free fall would be 12 to 18 per cent shorter.
        assert!(
            (touched_s / expected_s - 1.0).abs() < 0.005,
            "{touched_s} s for {expected_s} s"
        );
        // It bounces for a moment. Measured: at rest 0.9 and 0.6 s later, 0.12 m aside.
        assert!((0.0..2.0).contains(&(down_s - touched_s)), "{down_s} s");
        assert!(off.truncate().length() < 1.0, "{off}");
        assert!(
            (r.z - surface_m - half_m).abs() < 0.1,
            "{} m",
            r.z - surface_m
        );
    }
}

/// When, where and into what UAVs fly is told: a roof, the ground, each other.
#[test]
fn a_crash_is_told_with_when_where_and_into_what() {
    let city = flat_city();
    let open = open_ground(&city);
    let flat = (city.buildings.iter().enumerate()).filter(|(_, building)| {
        matches!(building.parts[0].roof, Roof::Flat(_)) && building.kind != BuildingKind::Station
    });
    let (number, roof) = flat
        .flat_map(|(number, building)| {
            let outline = building.footprint_enu_m();
            let centre = outline.iter().sum::<DVec2>() / outline.len() as f64;
            let steps_m = [-8.0, -4.0, 0.0, 4.0, 8.0];
            let around = steps_m.map(|e| steps_m.map(|n| centre + DVec2::new(e, n)));
            let inside = |p: &DVec2| polygon::encloses(outline, *p);
            (around.into_iter().flatten().filter(inside))
                .map(|p| (number, p))
                .collect::<Vec<_>>()
        })
        .find(|(_, p)| level(&city, *p, 4.0) && built_m(&city, *p) > 8.0)
        .unwrap();
    let above = |p: DVec2| p.extend(city.dsm.surface_m(p.x, p.y) + 30.0);
    let high = DVec3::new(0.0, 300.0, 200.0);
    let flying = |(name, r, v): (&str, DVec3, [f64; 3])| {
        format!(
            "{{ name = '{name}', model = 'phantom4', gnss_sigma_m = [0, 0], trajectory = {{ kind = 'straight', \
             start_enu_m = {:?}, velocity_enu_mps = {v:?} }} }}",
            r.to_array()
        )
    };
    let uavs = [
        ("roof", above(roof), [0.0, 0.0, -6.0]),
        ("open", above(open), [0.0, 0.0, -6.0]),
        ("east", high, [4.0, 0.0, 0.0]),
        ("west", high + DVec3::new(8.0, 0.0, 0.0), [-4.0, 0.0, 0.0]),
    ]
    .map(flying)
    .join(", ");
    let set = [
        "detector.kind=truth".to_string(),
        "engage.authorised=false".to_string(),
        "city.relief_m=0".to_string(),
        "weather={ wind_speed_mps = 0 }".to_string(),
        format!("uavs=[{uavs}]"),
    ];
    let mut run = scenario("urban_intercept", &set).open().unwrap();
    run.run_until(8.0).unwrap();
    let summary = run.summary().summary;
    let crash = |name: &str| {
        let uav = summary.uavs.iter().find(|uav| uav.name == name);
        let uav = uav.unwrap();
        (uav.crash.clone().unwrap(), uav.why.clone().unwrap())
    };
    let (on_roof, why) = crash("roof");
    assert!(
        on_roof.into.starts_with(&format!("building {number} (")),
        "{}",
        on_roof.into
    );
    // 30 m at 6 m/s.
    assert!((4.0..6.5).contains(&on_roof.t_s), "{}", on_roof.t_s);
    let [e, n, _] = on_roof.r_enu_m;
    assert!(DVec2::new(e, n).distance(roof) < 3.0);
    assert!(
        why.starts_with(&format!("flew into {} at ", on_roof.into)),
        "{why}"
    );
    assert_eq!(crash("open").0.into, "the ground");
    assert_eq!(crash("east").0.into, "the UAV west");
    assert_eq!(crash("west").0.into, "the UAV east");
    assert!(
        (0.6..1.2).contains(&crash("east").0.t_s),
        "{}",
        crash("east").0.t_s
    );
    assert!(
        summary.reason.contains("roof flew into building"),
        "{}",
        summary.reason
    );
}
