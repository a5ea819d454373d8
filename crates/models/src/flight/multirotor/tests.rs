use super::*;

const DT_S: f64 = 1.0 / 960.0; // [s]
const RHO: f64 = SEA_LEVEL_DENSITY_KGPM3;

fn hover_at(r_enu_m: DVec3, yaw_rad: f64) -> Setpoint {
    Setpoint {
        r_enu_m,
        v_enu_mps: DVec3::ZERO,
        a_enu_mps2: DVec3::ZERO,
        yaw_rad,
    }
}

fn airframe(rotor_count: usize) -> Airframe {
    Airframe::new(&UavModel {
        rotor_count,
        ..UavModel::sample()
    })
}

#[test]
fn hover_rotor_speed_is_the_real_one() {
    // A Phantom 4 hovers near 5500 rpm.
    let rpm = airframe(4).hover_rotor_speed_radps * 60.0 / TAU;
    assert!((4800.0..6200.0).contains(&rpm), "{rpm}");
}

#[test]
fn holds_against_a_steady_wind() {
    let airframe = airframe(4);
    let setpoint = hover_at(DVec3::new(0.0, 0.0, 50.0), 0.0);
    let mut state = MultirotorState::trimmed(&airframe, &setpoint, DVec3::ZERO, RHO);
    let wind_enu_mps = DVec3::new(10.0, 0.0, 0.0);
    for _ in 0..20 * 960 {
        step(&airframe, &mut state, &setpoint, wind_enu_mps, RHO, DT_S);
    }
    assert!((state.r_enu_m - setpoint.r_enu_m).length() < 0.01);
    // Drag 0.5 * 1.225 * 0.0498 * 100 = 3.050 N against a weight of 13.533 N.
    let tilt_rad = (state.q_enu_body * DVec3::Z).angle_between(DVec3::Z);
    assert!((tilt_rad.tan() - 3.050_25 / 13.533_18).abs() < 1e-4);
    let trimmed = MultirotorState::trimmed(&airframe, &setpoint, wind_enu_mps, RHO);
    assert!(trimmed.q_enu_body.angle_between(state.q_enu_body) < 1e-4);
}

#[test]
fn mixer_inverts_the_wrench_and_gives_up_yaw_first() {
    for rotor_count in [4, 6] {
        let airframe = airframe(rotor_count);
        let k = airframe.thrust_k_ns2(RHO);
        let wrench = |thrust_n: [f64; MAX_ROTORS]| {
            let mut state =
                MultirotorState::trimmed(&airframe, &hover_at(DVec3::ZERO, 0.0), DVec3::ZERO, RHO);
            state.rotor_speed_radps = thrust_n.map(|t| (t / k).sqrt());
            airframe.rotor_wrench(&state, k)
        };
        let weight_n = airframe.mass_kg * GRAVITY_MPS2;
        let arm_m = airframe.rotor_arm_body_m[0].length();
        let wanted = DVec3::new(0.1, -0.05, 0.01) * weight_n * arm_m;
        let (force_n, moment) = wrench(airframe.mix(weight_n, wanted, k));
        assert!((force_n / weight_n - 1.0).abs() < 1e-12);
        assert!((moment - wanted).length() < 1e-12 * weight_n);
        // An impossible yaw moment leaves force, roll and pitch alone.
        let greedy = DVec3::new(wanted.x, wanted.y, 10.0 * weight_n);
        let (force_n, moment) = wrench(airframe.mix(weight_n, greedy, k));
        assert!((force_n / weight_n - 1.0).abs() < 1e-12);
        assert!((moment - greedy).truncate().length() < 1e-12 * weight_n);
        assert!(moment.z > 0.0 && moment.z < greedy.z);
        // An impossible roll moment keeps its direction and every rotor its limits.
        let thrust_n = airframe.mix(weight_n, DVec3::new(10.0, 5.0, 1.0) * weight_n, k);
        let most_n = k * airframe.rotor_speed_max_radps.powi(2);
        assert!(thrust_n.iter().all(|t| (-1e-9..=most_n + 1e-9).contains(t)));
        let (_, moment) = wrench(thrust_n);
        assert!((moment.x / moment.y - 2.0).abs() < 1e-9);
    }
}

#[test]
fn drag_follows_equation_6() {
    let airframe = airframe(4);
    let drag = airframe.drag_enu_n(DVec3::new(0.0, 10.0, 0.0), DVec3::new(5.0, 10.0, 0.0), RHO);
    // Only the 5 m/s of relative wind count: 0.5 * 1.225 * 0.0498 * 25 = 0.7626 N.
    assert!((drag - DVec3::new(0.762_562_5, 0.0, 0.0)).length() < 1e-9);
}

#[test]
fn free_spin_conserves_energy_and_momentum() {
    let airframe = airframe(4);
    let mut state =
        MultirotorState::trimmed(&airframe, &hover_at(DVec3::ZERO, 0.0), DVec3::ZERO, RHO);
    state.omega_body_radps = DVec3::new(3.0, 5.0, 4.0);
    let inertia = airframe.inertia_kgm2;
    let momentum = |s: &MultirotorState| s.q_enu_body * (inertia * s.omega_body_radps);
    let energy = |s: &MultirotorState| s.omega_body_radps.dot(inertia * s.omega_body_radps);
    let before = state;
    for _ in 0..9600 {
        rotate(&mut state, inertia, DVec3::ZERO, DT_S);
    }
    let drift = (momentum(&state) - momentum(&before)).length() / momentum(&before).length();
    assert!(drift < 1e-3, "{drift}");
    assert!((energy(&state) / energy(&before) - 1.0).abs() < 1e-4);
    assert!((state.q_enu_body.length() - 1.0).abs() < 1e-12);
}

#[test]
fn symmetric_top_precesses_at_the_analytic_rate() {
    let inertia = DVec3::new(2e-3, 2e-3, 3e-3);
    let airframe = airframe(4);
    let mut state =
        MultirotorState::trimmed(&airframe, &hover_at(DVec3::ZERO, 0.0), DVec3::ZERO, RHO);
    state.omega_body_radps = DVec3::new(1.0, 0.0, 8.0);
    for _ in 0..960 {
        rotate(&mut state, inertia, DVec3::ZERO, DT_S);
    }
    // The transverse rate turns in the body at w_z (Iz - Ix)/Ix = 4 rad/s, for 1 s.
    let omega = state.omega_body_radps;
    assert!(
        (omega - DVec3::new(4.0_f64.cos(), 4.0_f64.sin(), 8.0)).length() < 1e-4,
        "{omega}"
    );
}

#[test]
fn rotor_phase_turns_with_the_rotor() {
    let airframe = airframe(4);
    let setpoint = hover_at(DVec3::ZERO, 0.0);
    let mut state = MultirotorState::trimmed(&airframe, &setpoint, DVec3::ZERO, RHO);
    for _ in 0..100 {
        step(&airframe, &mut state, &setpoint, DVec3::ZERO, RHO, DT_S);
    }
    for i in 0..4 {
        let turned_rad = airframe.rotor_spin[i] * airframe.hover_rotor_speed_radps * 100.0 * DT_S;
        assert!((state.rotor_phase_rad[i] - turned_rad.rem_euclid(TAU)).abs() < 1e-6);
    }
}

/// One second of open-loop flight against `rotorpy` 3.0.0: its Hummingbird with isotropic
/// parasitic drag 0.005 N s^2/m^2, rotor drag, inflow and translational lift off, gravity
/// 9.80665 m/s^2, integrated by DOP853 to 1e-11.
#[test]
fn open_loop_flight_matches_rotorpy() {
    let arm_m = 0.17; // [m]
    let airframe = Airframe {
        rotor_arm_body_m: std::array::from_fn(|i| {
            arm_m * DVec2::from_angle(PI * (0.25 + 0.5 * i as f64))
        }),
        mass_kg: 0.5,
        inertia_kgm2: DVec3::new(3.65e-3, 3.68e-3, 7.03e-3),
        thrust_k_ns2: 5.57e-6,
        torque_per_thrust_m: 1.36e-7 / 5.57e-6,
        rotor_lag_s: 0.005,
        drag_area_m2: 2.0 * 0.005 / RHO,
        ..airframe(4)
    };
    let mut state = MultirotorState::trimmed(
        &airframe,
        &hover_at(DVec3::new(0.0, 0.0, 50.0), PI / 2.0),
        DVec3::ZERO,
        RHO,
    );
    assert!(state.q_enu_body.angle_between(DQuat::IDENTITY) < 1e-7);
    state.v_enu_mps = DVec3::new(4.0, 1.0, -1.0);
    state.omega_body_radps = DVec3::new(0.8, -0.5, 1.2);
    state.rotor_speed_radps[..4].fill(450.0);
    let mut wanted_radps = [0.0; MAX_ROTORS];
    wanted_radps[..4].copy_from_slice(&[480.5, 480.0, 479.6, 480.2]);
    let wind_enu_mps = DVec3::new(3.0, -2.0, 0.5);
    for _ in 0..960 {
        advance(
            &airframe,
            &mut state,
            &wanted_radps,
            wind_enu_mps,
            RHO,
            DT_S,
        );
    }
    let r_enu_m = DVec3::new(3.978_028_46, -0.511_068_266, 48.895_172_7);
    let v_enu_mps = DVec3::new(4.757_215_52, -3.145_043_65, -1.806_643_59);
    let q_enu_body = DQuat::from_xyzw(0.400_612_22, -0.022_591_487, 0.574_686_518, 0.713_256_532);
    let omega_body_radps = DVec3::new(1.001_827_57, 0.393_073_893, 1.198_395_59);
    let apart = |a: DVec3, b: DVec3| (a - b).length() / b.length();
    let moved_m = r_enu_m - DVec3::new(0.0, 0.0, 50.0);
    assert!(apart(state.r_enu_m - DVec3::new(0.0, 0.0, 50.0), moved_m) < 1e-3);
    assert!(apart(state.v_enu_mps, v_enu_mps) < 1e-3);
    assert!(state.q_enu_body.angle_between(q_enu_body) < 1e-3);
    assert!(apart(state.omega_body_radps, omega_body_radps) < 1e-3);
}
