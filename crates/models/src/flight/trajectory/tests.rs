use super::*;
use crate::air::wind::{DrydenGust, MeanWind};
use crate::flight::multirotor;
use crate::flight::uav::UavModel;
use crate::maths::rng::Stream;
use proptest::prelude::*;

const CSV: &str = "t_s,east_m,north_m,up_m\n\
        10.0, 0, 0, 40\n11.0, 6, 2, 40\n12.5, 14, 8, 41\n14.0, 20, 18, 43\n\
        16.0, 22, 32, 44\n18.0, 18, 46, 44\n20.0, 10, 56, 43\n";

fn compile(trajectory: &Trajectory) -> Result<CompiledTrajectory, TrajectoryError> {
    trajectory.compile(|_| Ok(CSV.to_owned()))
}

fn every_kind() -> Vec<Trajectory> {
    let square = vec![
        [0.0, 0.0, 40.0],
        [80.0, 0.0, 40.0],
        [80.0, 80.0, 50.0],
        [0.0, 80.0, 50.0],
    ];
    vec![
        Trajectory::Straight {
            start_enu_m: [0.0, 0.0, 40.0],
            velocity_enu_mps: [8.0, 3.0, 0.5],
        },
        Trajectory::Waypoints {
            points_enu_m: square.clone(),
            speed_mps: 10.0,
            closed: true,
            corner_acceleration_mps2: 4.0,
        },
        Trajectory::Waypoints {
            points_enu_m: square,
            speed_mps: 10.0,
            closed: false,
            corner_acceleration_mps2: 4.0,
        },
        Trajectory::Orbit {
            centre_enu_m: [0.0, 0.0, 40.0],
            radius_m: 40.0,
            speed_mps: 10.0,
            clockwise: true,
            start_bearing_deg: 30.0,
        },
        Trajectory::Weave {
            start_enu_m: [0.0, 0.0, 40.0],
            velocity_enu_mps: [0.0, 10.0, 0.0],
            lateral_acceleration_mps2: 4.0,
            period_s: 5.0,
        },
        Trajectory::PopUp {
            position_enu_m: [0.0, 0.0, 40.0],
            hide_height_m: 5.0,
            pop_time_s: 3.0,
            rise_speed_mps: 5.0,
            heading_deg: 45.0,
        },
        Trajectory::Hover {
            position_enu_m: [0.0, 0.0, 40.0],
            heading_deg: 120.0,
        },
        Trajectory::Recorded {
            file: "flight.csv".to_owned(),
        },
    ]
}

/// Velocity and acceleration are the derivatives of position and velocity, except that the
/// acceleration may jump.
fn check_derivatives(path: &CompiledTrajectory, t_s: f64) {
    let h_s = 1e-4; // [s]
    let (before, here, after) = (
        path.sample(t_s - h_s),
        path.sample(t_s),
        path.sample(t_s + h_s),
    );
    // Central differences of a piecewise cubic: within jump(a) h/2 plus rounding.
    let v = (after.r_enu_m - before.r_enu_m) / (2.0 * h_s);
    assert!((v - here.v_enu_mps).length() < 3e-3, "{t_s} {v} {here:?}");
    let a = (after.v_enu_mps - before.v_enu_mps) / (2.0 * h_s);
    let allowed = (after.a_enu_mps2 - before.a_enu_mps2).length() + 1e-4;
    assert!(
        (a - here.a_enu_mps2).length() < allowed,
        "{t_s} {a} {here:?}"
    );
}

proptest! {
    #[test]
    fn velocity_is_the_derivative_of_position(t_s in 0.001_f64..120.0) {
        for trajectory in every_kind() {
            check_derivatives(&compile(&trajectory).unwrap(), t_s);
        }
    }

    #[test]
    fn random_waypoints_stay_smooth_and_within_their_limits(
        points in prop::collection::vec(prop::array::uniform3(-200.0_f64..200.0), 2..7),
        speed_mps in 1.0_f64..20.0,
        acceleration_mps2 in 1.0_f64..8.0,
        closed: bool,
        t_s in 0.001_f64..200.0,
    ) {
        let path = |speed_mps| Trajectory::Waypoints {
            points_enu_m: points.clone(),
            speed_mps,
            closed,
            corner_acceleration_mps2: acceleration_mps2,
        };
        let mut compiled = compile(&path(speed_mps));
        // The mend an error offers must lead to a path that flies.
        for _ in 0..points.len() {
            if let Err(TrajectoryError::LegTooShort { speed_mps, .. }) = compiled {
                prop_assume!(speed_mps > 0.0);
                compiled = compile(&path(speed_mps));
            }
        }
        let compiled = compiled.unwrap();
        check_derivatives(&compiled, t_s);
        let setpoint = compiled.sample(t_s);
        prop_assert!(setpoint.v_enu_mps.length() <= speed_mps + 1e-9);
        prop_assert!(setpoint.a_enu_mps2.length() <= acceleration_mps2 + 1e-9);
    }
}

#[test]
fn joints_are_continuous() {
    for trajectory in every_kind() {
        let CompiledPath::Pieces(pieces, period_s) = compile(&trajectory).unwrap().path else {
            continue;
        };
        for pair in pieces.windows(2) {
            let (r, v, _) = pair[0].motion(pair[1].t_s - pair[0].t_s);
            assert!((r - pair[1].r_enu_m).length() < 1e-9);
            assert!((v - pair[1].v_enu_mps).length() < 1e-9);
        }
        if let (Some(period_s), Some(last)) = (period_s, pieces.last()) {
            let (r, v, _) = last.motion(period_s - last.t_s);
            assert!((r - pieces[0].r_enu_m).length() < 1e-9);
            assert!((v - pieces[0].v_enu_mps).length() < 1e-9);
        }
    }
}

#[test]
fn open_paths_stop_on_their_last_point() {
    let path = compile(&every_kind()[2]).unwrap();
    let end = path.sample(1e4);
    assert!((end.r_enu_m - DVec3::new(0.0, 80.0, 50.0)).length() < 1e-9);
    assert_eq!(end.v_enu_mps, DVec3::ZERO);
    // It arrived flying west and keeps facing that way.
    assert!((end.yaw_rad + TAU / 4.0).abs() < 1e-9);
}

#[test]
fn orbit_keeps_its_radius_speed_and_sense() {
    let path = compile(&every_kind()[3]).unwrap();
    let start = path.sample(0.0);
    assert!((start.r_enu_m - DVec3::new(20.0, 1200.0_f64.sqrt(), 40.0)).length() < 1e-9);
    let later = path.sample(1.0);
    assert!((later.v_enu_mps.length() - 10.0).abs() < 1e-12);
    assert!((later.a_enu_mps2.length() - 2.5).abs() < 1e-12);
    // Clockwise, by 10/40 rad.
    let turned_rad = later.r_enu_m.x.atan2(later.r_enu_m.y) - 30.0_f64.to_radians();
    assert!((turned_rad - 0.25).abs() < 1e-12);
}

#[test]
fn weave_peaks_at_its_lateral_acceleration() {
    let path = compile(&every_kind()[4]).unwrap();
    // A quarter period in: to the right of a northward line, accelerating back.
    let quarter = path.sample(1.25);
    assert!((quarter.a_enu_mps2 - DVec3::new(-4.0, 0.0, 0.0)).length() < 1e-12);
    let amplitude_m = 4.0 * (5.0 / TAU).powi(2);
    assert!((quarter.r_enu_m - DVec3::new(amplitude_m, 12.5, 40.0)).length() < 1e-12);
}

#[test]
fn pop_up_hides_rises_and_hovers() {
    let path = compile(&every_kind()[5]).unwrap();
    assert_eq!(path.sample(2.999).r_enu_m, DVec3::new(0.0, 0.0, 5.0));
    // 35 m at 5 m/s plus one ramp of 5/3 s.
    let arrive_s = 3.0 + 35.0 / 5.0 + 5.0 / 3.0;
    assert!(path.sample(arrive_s - 0.1).r_enu_m.z < 40.0);
    assert!((path.sample(arrive_s).r_enu_m.z - 40.0).abs() < 1e-9);
    assert_eq!(path.sample(60.0).v_enu_mps, DVec3::ZERO);
    assert!((path.sample(60.0).yaw_rad - TAU / 8.0).abs() < 1e-12);
}

#[test]
fn recorded_passes_through_its_rows() {
    let path = compile(&every_kind()[7]).unwrap();
    for (t_s, r_enu_m) in [
        (0.0, DVec3::new(0.0, 0.0, 40.0)),
        (2.5, DVec3::new(14.0, 8.0, 41.0)),
        (10.0, DVec3::new(10.0, 56.0, 43.0)),
    ] {
        assert!((path.sample(t_s).r_enu_m - r_enu_m).length() < 1e-9);
    }
    assert_eq!(path.sample(60.0).v_enu_mps, DVec3::ZERO);
}

#[test]
fn bad_recordings_are_refused_by_row() {
    let refused = |text: &str| {
        let recorded = Trajectory::Recorded {
            file: "flight.csv".to_owned(),
        };
        recorded.compile(|_| Ok(text.to_owned())).unwrap_err()
    };
    let header = "t_s,east_m,north_m,up_m\n";
    let error = refused(&format!("{header}0,0,0,0\n1,1,1,1\n1,2,2,2\n"));
    assert!(matches!(
        error,
        TrajectoryError::TimeNotIncreasing { row: 3, .. }
    ));
    let error = refused(&format!("{header}0,0,0,0\n1,NaN,1,1\n"));
    assert!(matches!(
        error,
        TrajectoryError::RowNotFinite { row: 2, .. }
    ));
    let error = refused(&format!("{header}0,0,0,0\n1,x,1,1\n"));
    assert!(error.to_string().contains("line: 3"), "{error}");
    let error = refused(&format!("{header}0,0,0,0\n"));
    assert!(matches!(error, TrajectoryError::TooFewRows { rows: 1, .. }));
    assert!(matches!(
        refused("t,x,y,z\n0,0,0,0\n"),
        TrajectoryError::Csv { .. }
    ));
    let missing = every_kind()[7].compile(|_| Err(std::io::ErrorKind::NotFound.into()));
    assert!(matches!(missing, Err(TrajectoryError::Unreadable { .. })));
}

#[test]
fn bad_paths_are_refused() {
    let waypoints = |points_enu_m, speed_mps| {
        compile(&Trajectory::Waypoints {
            points_enu_m,
            speed_mps,
            closed: false,
            corner_acceleration_mps2: 4.0,
        })
        .map(|_| ())
    };
    let corner = vec![[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [10.0, 10.0, 0.0]];
    assert!(matches!(
        waypoints(vec![[0.0; 3]], 5.0),
        Err(TrajectoryError::TooFewWaypoints(1))
    ));
    assert!(matches!(
        waypoints(vec![[0.0; 3], [0.0; 3]], 5.0),
        Err(TrajectoryError::RepeatedWaypoint(2))
    ));
    assert!(matches!(
        waypoints(corner.clone(), 0.0),
        Err(TrajectoryError::NotPositive("speed_mps", _))
    ));
    assert!(matches!(
        waypoints(corner, 20.0),
        Err(TrajectoryError::LegTooShort { waypoint: 2, .. })
    ));
    assert!(matches!(
        compile(&Trajectory::Hover {
            position_enu_m: [f64::NAN, 0.0, 0.0],
            heading_deg: 0.0
        }),
        Err(TrajectoryError::NotFinite("position_enu_m"))
    ));
    assert!(matches!(
        compile(&Trajectory::Weave {
            start_enu_m: [0.0; 3],
            velocity_enu_mps: [0.0, 0.0, 2.0],
            lateral_acceleration_mps2: 1.0,
            period_s: 4.0
        }),
        Err(TrajectoryError::NoSideways)
    ));
    assert!(matches!(
        compile(&Trajectory::PopUp {
            position_enu_m: [0.0, 0.0, 5.0],
            hide_height_m: 6.0,
            pop_time_s: 0.0,
            rise_speed_mps: 1.0,
            heading_deg: 0.0
        }),
        Err(TrajectoryError::NoRise { .. })
    ));
}

/// Root-mean-square position error [m] of a Phantom 4 over a minute in 5 m/s of gusty wind.
fn tracking_rms_m(path: &CompiledTrajectory) -> f64 {
    let (dt_s, rho) = (1.0 / 960.0, 1.225); // [s], [kg/m^3]
    let mean = MeanWind::new(5.0, 240.0, 0.5, 0.0).unwrap();
    let mut rng = Stream::new(11, 0, "gust");
    let mut gust = DrydenGust::new(&mean, &mut rng);
    let airframe = Airframe::new(&UavModel::sample());
    let start_m = path.sample(0.0).r_enu_m.z;
    let mut state = path.initial_state(&airframe, mean.mean_wind_enu_mps(start_m), rho);
    let ticks = 60 * 960;
    let mut sum_m2 = 0.0;
    for k in 0..ticks {
        let t_s = f64::from(k) * dt_s;
        let h_m = state.r_enu_m.z;
        let mean_enu_mps = mean.mean_wind_enu_mps(h_m);
        let airspeed_mps = (state.v_enu_mps - mean_enu_mps).length();
        let wind_enu_mps = mean_enu_mps + gust.step(dt_s, h_m, airspeed_mps, &mut rng);
        sum_m2 += (state.r_enu_m - path.sample(t_s).r_enu_m).length_squared();
        let setpoint = path.sample(t_s);
        multirotor::step(&airframe, &mut state, &setpoint, wind_enu_mps, rho, dt_s);
    }
    (sum_m2 / f64::from(ticks)).sqrt()
}

#[test]
fn every_kind_is_tracked_in_gusty_wind() {
    for trajectory in every_kind() {
        let rms_m = tracking_rms_m(&compile(&trajectory).unwrap());
        println!("{rms_m:.3} m rms: {trajectory:?}");
        assert!(rms_m < 1.5);
    }
}

#[test]
fn a_spread_moves_the_whole_path_and_nothing_else() {
    for trajectory in every_kind() {
        let path = compile(&trajectory).unwrap();
        let offset = DVec3::new(3.0, -4.0, 5.0);
        let moved = path.clone().shifted(offset);
        let earlier = path.clone().begun_earlier(2.5);
        for t_s in [0.0, 1.7, 40.0] {
            let (a, b) = (path.sample(t_s), moved.sample(t_s));
            assert!((b.r_enu_m - a.r_enu_m - offset).length() < 1e-9);
            assert_eq!((b.v_enu_mps, b.a_enu_mps2), (a.v_enu_mps, a.a_enu_mps2));
            assert_eq!(earlier.sample(t_s).r_enu_m, path.sample(t_s + 2.5).r_enu_m);
        }
        // No spread is no change, to the bit.
        let same = path
            .clone()
            .spread([0.0; 2], 0.0, &mut Stream::new(1, 0, "spread"));
        assert_eq!(same.sample(3.3).r_enu_m, path.sample(3.3).r_enu_m);
    }
}

#[test]
fn seeds_spread_with_the_set_deviations() {
    let path = compile(&Trajectory::Hover {
        position_enu_m: [0.0; 3],
        heading_deg: 0.0,
    })
    .unwrap();
    let n = 4000;
    let mut squares = DVec3::ZERO;
    for seed in 0..n {
        let mut rng = Stream::new(seed, 2, "spread");
        let r = path
            .clone()
            .spread([30.0, 8.0], 0.0, &mut rng)
            .sample(0.0)
            .r_enu_m;
        squares += r * r;
    }
    let sigma = (squares / n as f64).map(f64::sqrt);
    // Five standard errors of an estimated deviation.
    let relative = 5.0 / (2.0 * n as f64).sqrt();
    for (got, want) in sigma.to_array().into_iter().zip([30.0, 30.0, 8.0]) {
        assert!((got / want - 1.0).abs() < relative, "{sigma}");
    }
}

#[test]
fn scenarios_name_their_kinds_and_fields() {
    let path: Trajectory = serde_json::from_str(
            r#"{"kind": "waypoints", "points_enu_m": [[0, 0, 9], [9, 0, 9]], "speed_mps": 2, "loop": true}"#,
        )
        .unwrap();
    assert!(matches!(
        path,
        Trajectory::Waypoints {
            closed: true,
            corner_acceleration_mps2: 4.0,
            ..
        }
    ));
    let text = r#"{"kind": "hover", "position_enu_m": [0, 0, 9], "speed_mps": 2}"#;
    let error = serde_json::from_str::<Trajectory>(text).unwrap_err();
    assert!(error.to_string().contains("speed_mps"), "{error}");
}
