use super::*;
use crate::maths::rng::Stream;
use crate::mount::gyro::GyroParams;

const DT: f64 = 1.0 / 960.0;

/// Both axes without dry friction, sensor errors and structure.
fn rigid() -> GimbalParams {
    let GimbalParams { azimuth, elevation } = ideal();
    let rigid = |axis| AxisParams {
        structure: None,
        ..axis
    };
    GimbalParams {
        azimuth: rigid(azimuth),
        elevation: rigid(elevation),
    }
}

/// Both axes without dry friction and sensor errors.
fn ideal() -> GimbalParams {
    let GimbalParams { azimuth, elevation } = GimbalParams::default();
    GimbalParams {
        azimuth: azimuth.ideal(),
        elevation: elevation.ideal(),
    }
}

fn rate(az: f64, el: f64) -> GimbalCommand {
    GimbalCommand {
        rate_radps: [az, el],
    }
}

#[test]
fn small_rate_step_follows_the_linear_loop() {
    // Without friction the loop is (2ζω s + ω²)/(s² + 2ζω s + ω²).
    let mut params = rigid();
    params.azimuth.viscous_nms = 0.0;
    let (z, w) = (params.azimuth.damping, TAU * params.azimuth.bandwidth_hz);
    // Fine steps: what remains is the first-order error of the sampled integrator.
    let dt = DT / 64.0;
    let mut state = GimbalState::default();
    for k in 1..=64 * 200 {
        step(&mut state, &params, &rate(1e-3, 0.0), [0.0; 2], dt);
        let t = f64::from(k) * dt;
        let wd = w * (1.0 - z * z).sqrt();
        let s = z * w;
        // 1 − e^{−st}(cos − (s/wd) sin): step of the loop with its zero.
        let y = 1.0 - (-s * t).exp() * ((wd * t).cos() - s / wd * (wd * t).sin());
        assert!(
            (state.azimuth.rate_radps - 1e-3 * y).abs() < 3e-3 * 1e-3,
            "{t}"
        );
    }
}

#[test]
fn servo_is_stable_at_the_tick_and_rejects_a_constant_torque() {
    let params = ideal();
    let mut state = GimbalState::default();
    for _ in 0..1920 {
        step(&mut state, &params, &rate(0.1, -0.05), [5.0, -3.0], DT);
    }
    assert!((state.azimuth.rate_radps - 0.1).abs() < 1e-9);
    assert!((state.elevation.rate_radps + 0.05).abs() < 1e-9);
    // Steady motor torque = viscous friction − disturbance.
    assert!((state.azimuth.torque_nm - (2.0 * 0.1 - 5.0)).abs() < 1e-6);
}

#[test]
fn free_spin_down_is_exponential() {
    // With the motor starved, J ω̇ = −b ω: angle runs to ω0 J/b (1 − e^{−bt/J}).
    let axis = AxisParams {
        torque_limit_nm: 1e-12,
        travel_rad: Some([-10.0, 10.0]),
        ..rigid().azimuth
    };
    let params = GimbalParams {
        azimuth: axis,
        elevation: axis,
    };
    let mut state = GimbalState::default();
    state.azimuth.rate_radps = 0.5;
    for _ in 0..960 {
        step(&mut state, &params, &rate(0.5, 0.0), [0.0; 2], DT);
    }
    let x = 2.0 / 8.0_f64;
    assert!((state.azimuth.rate_radps - 0.5 * (-x).exp()).abs() < 1e-9);
    assert!((state.azimuth.angle_rad - 0.5 * (1.0 - (-x).exp()) / x).abs() < 1e-9);
}

#[test]
fn torque_and_rate_limits_hold() {
    let params = rigid();
    let mut state = GimbalState::default();
    for _ in 0..96 {
        step(&mut state, &params, &rate(9.0, 9.0), [0.0; 2], DT);
        assert!(state.azimuth.torque_nm.abs() <= params.azimuth.torque_limit_nm);
    }
    // Full torque: no faster than T/J · t, and nearly that with little friction.
    let fastest = 60.0 / 8.0 * 0.1;
    assert!(state.azimuth.rate_radps < fastest && state.azimuth.rate_radps > 0.97 * fastest);
    for _ in 0..2000 {
        step(&mut state, &params, &rate(9.0, 0.0), [0.0; 2], DT);
        // One tick at full torque beyond the limit at most.
        assert!(state.azimuth.rate_radps <= params.azimuth.rate_limit_radps + 7.5 * DT);
    }
    assert!((state.azimuth.rate_radps / params.azimuth.rate_limit_radps - 1.0).abs() < 0.01);
}

#[test]
fn stops_hold_and_are_met_gently() {
    let params = GimbalParams::default();
    let high = params.elevation.travel_rad.unwrap()[1];
    let mut state = GimbalState::default();
    let mut last = 0.0;
    for _ in 0..960 * 5 {
        last = state.elevation.rate_radps;
        step(&mut state, &params, &rate(0.0, 1.0), [0.0; 2], DT);
        assert!(state.elevation.angle_rad <= high);
    }
    assert!(high - state.elevation.angle_rad < 1e-3);
    assert!(last.abs() < 0.05);
    // A hard push does not pass either.
    for _ in 0..960 {
        step(&mut state, &params, &rate(0.0, 1.0), [0.0, 500.0], DT);
    }
    assert_eq!(state.elevation.angle_rad, high);
}

#[test]
fn azimuth_takes_the_short_way_unless_a_cable_forbids_it() {
    let mut axis = GimbalParams::default().azimuth;
    assert!((axis.error_rad(-3.0, 3.0) - (TAU - 6.0)).abs() < 1e-14);
    axis.travel_rad = Some([-1.5 * PI, 1.5 * PI]);
    assert!((axis.error_rad(-3.0, 3.0) - (TAU - 6.0)).abs() < 1e-14);
    // At +260° the way up to 280° is blocked at 270°: go back to −80°.
    let degree = PI / 180.0;
    let error = axis.error_rad(280.0 * degree, 260.0 * degree);
    assert!((error + 340.0 * degree).abs() < 1e-12);
    // An unreachable elevation stops at the stop.
    let elevation = GimbalParams::default().elevation;
    assert!((elevation.error_rad(1.55, 0.0) - 85.0 * degree).abs() < 1e-12);
}

#[test]
fn angles_are_brought_between_the_stops() {
    let mut params = rigid();
    params.azimuth.travel_rad = Some([-3.0, 3.0]);
    params.elevation.travel_rad = Some([-0.2, 1.5]);
    // 5.5 rad is the direction of 5.5 rad less a turn; what lies beyond a stop becomes the stop.
    let found = params.within_stops(DVec2::new(5.5, 2.0));
    assert!(
        (found - DVec2::new(5.5 - TAU, 1.5)).length() < 1e-12,
        "{found}"
    );
    params.azimuth.travel_rad = Some([0.0, TAU]);
    let found = params.within_stops(DVec2::new(-0.5, 0.3));
    assert!(
        (found - DVec2::new(TAU - 0.5, 0.3)).length() < 1e-12,
        "{found}"
    );
}

#[test]
fn position_command_slews_and_settles_across_north_and_south() {
    let params = ideal();
    let mut state = GimbalState::at_rest(DVec2::new(2.9, 0.1));
    let target = DVec2::new(-2.0, 0.9);
    let mut overshoot = 0.0_f64;
    for _ in 0..960 * 4 {
        let command = params.position_command(&state, target);
        step(&mut state, &params, &command, [0.0; 2], DT);
        overshoot = overshoot.max(-params.error_rad(target, state.az_el_rad()).x);
    }
    assert!(params.error_rad(target, state.az_el_rad()).length() < 1e-6);
    assert!(overshoot < 0.02, "{overshoot}");
}

#[test]
fn steps_of_a_search_settle_without_overshoot() {
    let params = GimbalParams::default();
    // From gaze to gaze, and to a glance in the field [rad], each with the longest it may take [s].
    for (step_rad, longest_s) in [(85e-3, 0.28), (20e-3, 0.12)] {
        let target = DVec2::new(step_rad, 0.0);
        let mut state = GimbalState::default();
        let (mut settled_s, mut overshoot) = (None, 0.0_f64);
        for k in 1..960 {
            let command = params.position_command(&state, target);
            step(&mut state, &params, &command, [0.0; 2], DT);
            let short_rad = params.error_rad(target, state.az_el_rad()).x;
            overshoot = overshoot.max(-short_rad / step_rad);
            let rests = short_rad.abs() < 2e-3 && state.rates_radps().length() < 15e-3;
            settled_s = settled_s.or(rests.then_some(f64::from(k) * DT));
        }
        println!("{step_rad} rad: {settled_s:?} s, overshoot {overshoot:.4}");
        assert!(settled_s.is_some_and(|s| s < longest_s), "{settled_s:?}");
        assert!(overshoot < 0.01, "{overshoot}");
    }
}

/// The azimuth axis alone, pushed by a torque on its rotor.
fn push(state: &mut AxisState, axis: &AxisParams, torque_nm: f64) {
    state.torque_nm = torque_nm;
    advance(state, axis, 0.0, DT);
}

#[test]
fn sliding_friction_is_stribecks_curve() {
    let friction = GimbalParams::default().azimuth.friction.unwrap();
    // Ends and the 1/e point of F_C + (F_S − F_C) exp(−(ω/ω_S)²).
    assert_eq!(friction.level_nm(0.0), 0.6);
    assert!((friction.level_nm(2e-3) - (0.4 + 0.2 * (-1.0f64).exp())).abs() < 1e-15);
    assert!((friction.level_nm(-1.0) - 0.4).abs() < 1e-15);
    // The plant obeys it: at a steady rate the motor gives the curve plus viscous friction.
    let mut params = rigid();
    params.azimuth.friction = Some(friction);
    for omega in [1e-3, 2e-3, 3e-3, 5e-3, 0.1] {
        for sign in [1.0, -1.0] {
            let mut state = GimbalState::default();
            // At 1 mrad/s the bristles take 0.2 s to bend.
            for _ in 0..960 * 8 {
                step(&mut state, &params, &rate(sign * omega, 0.0), [0.0; 2], DT);
            }
            let expected = friction.level_nm(omega) + 2.0 * omega;
            assert!((sign * state.azimuth.rate_radps - omega).abs() < 1e-9);
            assert!(
                (sign * state.azimuth.torque_nm - expected).abs() < 1e-6,
                "{omega}"
            );
        }
    }
}

/// The default azimuth axis without cogging, held rigidly until its bearings break away.
fn sticking() -> AxisParams {
    let axis = GimbalParams::default().azimuth;
    AxisParams {
        friction: axis.friction.map(|friction| Friction {
            presliding_rad: 0.0,
            ..friction
        }),
        cogging: None,
        ..axis
    }
}

#[test]
fn nothing_moves_below_the_breakaway_torque() {
    for axis in [
        AxisParams {
            structure: None,
            ..sticking()
        },
        sticking(),
    ] {
        let mut state = AxisState::default();
        for k in 0..9600 {
            push(&mut state, &axis, 0.599 * (f64::from(k) * 0.01).sin());
            let rotor = state.angle_rad + state.twist_rad;
            assert!(rotor.abs() < 1e-14 && state.angle_rad.abs() < 1e-14);
        }
        for _ in 0..960 {
            push(&mut state, &axis, 0.65);
        }
        assert!(state.angle_rad > 1e-3);
        // Once it slides, less than the breakaway torque keeps it going, less than Coulomb's
        // brings it to a true rest.
        let rate = state.rate_radps;
        for _ in 0..96 {
            push(&mut state, &axis, 0.5);
        }
        assert!(state.rate_radps > rate);
        for _ in 0..960 * 30 {
            push(&mut state, &axis, 0.3);
        }
        let rest = state.angle_rad;
        for _ in 0..960 {
            push(&mut state, &axis, 0.3);
        }
        assert!((state.angle_rad - rest).abs() < 1e-14);
    }
}

#[test]
fn before_breakaway_the_axis_is_a_stiffening_spring() {
    // dz/dθ = 1 − σz/g at vanishing rate: T = F_S (1 − e^(−σθ/F_S)), stiffness σ at first.
    let axis = AxisParams {
        structure: None,
        cogging: None,
        ..GimbalParams::default().azimuth
    };
    let friction = axis.friction.unwrap();
    let mut state = AxisState::default();
    for k in 1..=960 * 200 {
        let torque_nm = 0.9 * friction.breakaway_nm * (f64::from(k) / (960.0 * 200.0));
        push(&mut state, &axis, torque_nm);
        if k % 9600 == 0 {
            let turned_rad =
                -friction.presliding_rad * (1.0 - torque_nm / friction.breakaway_nm).ln();
            let error = state.angle_rad / turned_rad - 1.0;
            assert!(error.abs() < 0.03, "{torque_nm}: {error}");
        }
    }
    // Let go, it springs back by less than it came: the loop has an area.
    let far_rad = state.angle_rad;
    for k in 0..960 * 200 {
        push(
            &mut state,
            &axis,
            0.9 * friction.breakaway_nm * (1.0 - f64::from(k) / (960.0 * 200.0)),
        );
    }
    let left = state.angle_rad / far_rad;
    assert!(left > 0.3 && left < 0.8, "{left}");
}

#[test]
fn cogging_comes_again_with_every_pole() {
    let mut axis = rigid().azimuth;
    axis.viscous_nms = 0.0;
    axis.cogging = GimbalParams::default().azimuth.cogging;
    let cogging = axis.cogging.unwrap();
    // Running over the poles the rate ripples by T/(J n ω²) ω, to first order in the ripple.
    let rate_radps = 0.2;
    let mut state = AxisState {
        rate_radps,
        ..AxisState::default()
    };
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for _ in 0..9600 {
        push(&mut state, &axis, 0.0);
        low = low.min(state.rate_radps);
        high = high.max(state.rate_radps);
    }
    let ripple = 2.0 * cogging.torque_nm / (axis.inertia_kg_m2 * cogging.per_turn * rate_radps);
    assert!(
        ((high - low) / ripple - 1.0).abs() < 0.02,
        "{low} {high} {ripple}"
    );
}

#[test]
fn structural_mode_rings_down_at_its_frequency_and_damping() {
    // Rotor free: f = f_locked/√share, ζ = ζ_locked/√share. Rotor locked by friction: as given.
    let mut axis = ideal().azimuth;
    axis.viscous_nms = 0.0;
    let lock = Friction {
        coulomb_nm: 1e6,
        breakaway_nm: 1e6,
        stribeck_radps: 1.0,
        presliding_rad: 0.0,
        bristle_nms: 0.0,
    };
    for (friction, frequency_hz, damping) in [(None, 80.0, 0.04), (Some(lock), 40.0, 0.02)] {
        axis.friction = friction;
        // Fine steps: a torque held over a substep is all that separates the lock from rest.
        let dt = 1.0 / 96_000.0;
        let mut state = AxisState {
            twist_rad: 1e-4,
            angle_rad: -1e-4 * if friction.is_some() { 1.0 } else { 0.25 },
            ..AxisState::default()
        };
        let (omega, sigma) = (TAU * frequency_hz, TAU * frequency_hz * damping);
        let damped = omega * (1.0 - damping * damping).sqrt();
        let held = if friction.is_some() { 1e-3 } else { 1e-9 };
        for k in 1..=9600 {
            advance(&mut state, &axis, 0.0, dt);
            let t = f64::from(k) * dt;
            let x = (-sigma * t).exp() * ((damped * t).cos() + sigma / damped * (damped * t).sin());
            assert!(
                (state.twist_rad - 1e-4 * x).abs() < held * 1e-4,
                "{friction:?} {t} {} {}",
                state.twist_rad,
                1e-4 * x
            );
            let rotor = state.angle_rad + state.twist_rad;
            let centre = 0.25 * rotor + 0.75 * state.angle_rad;
            let fixed = if friction.is_some() { rotor } else { centre };
            assert!(fixed.abs() < 1e-9);
        }
    }
}

/// Kinetic energy and that of spring and bristles [J].
fn energy_j(state: &AxisState, axis: &AxisParams) -> f64 {
    let structure = axis.structure.unwrap();
    let (j, share) = (axis.inertia_kg_m2, structure.rotor_share);
    let rotor = state.rate_radps + state.twist_rate_radps;
    let stretch = (state.twist_rad.abs() - 0.5 * structure.backlash_rad).max(0.0);
    let omega = TAU * structure.locked_rotor_hz;
    let bristles = axis.friction.map_or(0.0, |friction| {
        0.5 * friction.breakaway_nm / friction.presliding_rad * state.bristle_rad.powi(2)
    });
    bristles
        + 0.5
            * j
            * (share * rotor.powi(2)
                + (1.0 - share) * (state.rate_radps.powi(2) + (omega * stretch).powi(2)))
}

#[test]
fn no_energy_is_created() {
    for (friction, backlash_rad) in [(false, 0.0), (true, 0.0), (false, 1e-4), (true, 1e-4)] {
        let mut axis = GimbalParams::default().azimuth;
        if !friction {
            axis = axis.ideal();
            axis.viscous_nms = 0.0;
        }
        axis.cogging = None; // the motor's poles hold energy, too
        axis.structure.as_mut().unwrap().backlash_rad = backlash_rad;
        axis.structure.as_mut().unwrap().damping = 1e-6;
        let mut state = AxisState {
            rate_radps: 0.02,
            twist_rate_radps: -0.05,
            ..AxisState::default()
        };
        let start = energy_j(&state, &axis);
        let mut last = start;
        for _ in 0..960 * 5 {
            push(&mut state, &axis, 0.0);
            let now = energy_j(&state, &axis);
            // Friction is held over a substep, in which the rotor may turn back: 1e-6 of the start.
            assert!(
                now <= last + 1e-6 * start,
                "{friction} {backlash_rad} {last} {now}"
            );
            last = now;
        }
        if friction {
            assert!(last < 1e-3 * start, "{last} {start}");
        } else {
            // Nothing but the spring's damping of 1e-6 takes energy: that of the twist decays
            // by exp(−2ζωt) = 1 %.
            assert!(last > 0.98 * start, "{last} {start}");
        }
    }
}

#[test]
fn backlash_is_the_dead_band_of_a_reversal() {
    let backlash_rad = 200e-6;
    let mut params = ideal();
    let structure = params.azimuth.structure.as_mut().unwrap();
    structure.backlash_rad = backlash_rad;
    // Stiff and well damped, so that the load follows its stop without rattling.
    (structure.locked_rotor_hz, structure.damping) = (100.0, 0.9);
    let mut state = GimbalState::default();
    let mut run = |omega: f64, seconds: f64, until_rate: f64| {
        for _ in 0..(seconds / DT) as usize {
            // A little friction of the load stops it in the slack.
            let drag = -0.5 * state.azimuth.rate_radps / DT;
            step(&mut state, &params, &rate(omega, 0.0), [drag, 0.0], DT);
            if until_rate < 0.0 && state.azimuth.rate_radps < until_rate {
                break;
            }
        }
        state.azimuth.angle_rad + state.azimuth.twist_rad
    };
    run(2e-3, 1.0, 0.0);
    // So slowly that the load stays on its stop when the rotor does.
    let turned = run(2e-5, 2.0, 0.0);
    let caught = run(-2e-5, 15.0, -1e-5);
    assert!(
        (turned - caught - backlash_rad).abs() < 1e-6,
        "{}",
        turned - caught
    );
}

#[test]
fn encoder_error_is_uniform_over_a_step() {
    let mut params = GimbalParams::default();
    params.azimuth.encoder_bits = Some(20);
    let lsb = TAU / f64::from(1 << 20);
    let mut state = GimbalState::default();
    let (mut sum, mut square, mut n) = (0.0, 0.0, 0.0);
    for k in 0..96_000 {
        let wanted = 0.3 * (f64::from(k) * 1e-3).sin();
        step(&mut state, &params, &rate(wanted, 0.0), [0.0; 2], DT);
        let error = state.azimuth.encoder_rad - state.azimuth.angle_rad;
        assert!(error.abs() <= 0.5 * lsb * (1.0 + 1e-9));
        (sum, square, n) = (sum + error, square + error * error, n + 1.0);
    }
    // LSB/√12 within 1 %; successive errors are not independent, so no standard error is given.
    assert!(((square / n).sqrt() * 12.0f64.sqrt() / lsb - 1.0).abs() < 0.01);
    assert!((sum / n).abs() < 0.01 * lsb);
}

/// Peak to peak of the load over the last `seconds` of a minute [rad], and its reversals, with
/// `control` choosing the torque.
fn hunting(
    params: &GimbalParams,
    gyro: GyroParams,
    mut control: impl FnMut(&mut GimbalState) -> f64,
) -> (f64, usize) {
    let mut gyros = Gyro::new(gyro, Stream::new(9, 0, "gyro"));
    let mut state = GimbalState::at_rest(DVec2::new(-1e-3, 0.3));
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let (mut direction, mut reversals) = (0.0, 0);
    for k in 0..960 * 60 {
        state.azimuth.torque_nm = control(&mut state);
        advance(&mut state.azimuth, &params.azimuth, 0.0, DT);
        advance(&mut state.elevation, &params.elevation, 0.0, DT);
        state.read_gyros(&mut gyros, DT);
        if k >= 960 * 30 {
            low = state.azimuth.angle_rad.min(low);
            high = state.azimuth.angle_rad.max(high);
            let rate = state.azimuth.rate_radps;
            if rate.abs() > 1e-5 && rate.signum() != direction {
                direction = rate.signum();
                reversals += 1;
            }
        }
    }
    (high - low, reversals)
}

#[test]
fn friction_limit_cycle_hunts_under_a_plain_pid_and_not_under_a_cascade() {
    const POSITION_GAIN_PER_S: f64 = 12.0;
    let params = GimbalParams::default();
    let axis = params.azimuth;
    // A slow PID (0.5 Hz) on the load's encoder, well damped without friction.
    let omega = TAU * 0.5;
    let j = axis.inertia_kg_m2;
    let (mut integral, mut before) = (0.0, -1e-3);
    let pid = |state: &mut GimbalState| {
        let angle = state.azimuth.encoder_rad;
        integral += 0.4 * j * omega.powi(3) * -angle * DT;
        let rate = (angle - before) / DT;
        before = angle;
        (integral - j * omega * omega * angle - 1.6 * j * omega * rate).clamp(-60.0, 60.0)
    };
    // Bearings that give way before they slide let such a loop come to rest; rigid ones do not.
    let rigid = GimbalParams {
        azimuth: sticking(),
        ..params
    };
    let (hunt_rad, reversals) = hunting(&rigid, GyroParams::FIBRE, pid);
    assert!(hunt_rad > 1e-3 && reversals > 20, "{hunt_rad} {reversals}");
    // Rate loop under a position loop, as the tuned law closes it on a still target.
    let cascade = |params: &GimbalParams, gyro: GyroParams| {
        hunting(params, gyro, |state| {
            let error = params.error_rad(DVec2::new(0.0, 0.3), state.encoder_az_el_rad());
            let [az, el] = (POSITION_GAIN_PER_S * error).to_array();
            state.elevation.torque_nm =
                servo_torque(&mut state.elevation, &params.elevation, el, DT);
            servo_torque(&mut state.azimuth, &params.azimuth, az, DT)
        })
    };
    // With the gyro's noise the axis trembles by a few encoder steps, more where the bearings give way ...
    let (tremble_rad, _) = cascade(&rigid, GyroParams::FIBRE);
    assert!(tremble_rad < 4e-6, "{tremble_rad}");
    let (tremble_rad, _) = cascade(&params, GyroParams::FIBRE);
    assert!(tremble_rad < 8e-6, "{tremble_rad}");
    // ... and without it nothing moves, or creeps by less than such a step: no cycle feeds itself.
    let encoder_rad = TAU / 2f64.powi(24);
    for (params, most_rad) in [(&rigid, 1e-12), (&params, encoder_rad)] {
        let (rest_rad, reversals) = cascade(params, GyroParams::FIBRE.quiet());
        assert!(
            rest_rad < most_rad && reversals == 0,
            "{rest_rad} {reversals}"
        );
    }
}

#[test]
fn keyhole_ramp_leaves_and_meets_the_target() {
    let params = GimbalParams::default();
    let omega = 0.9 * params.azimuth.rate_limit_radps;
    // Straight level flight 300 m up, eastward at 20 m/s, passing 5 m north or south of the
    // zenith: the azimuth is that of (20 t, ±5).
    for north_m in [5.0, -5.0] {
        let at = |t: f64| {
            let (x, y, z) = (20.0 * t, north_m, 300.0);
            let d = f64::hypot(x, y);
            let rates = DVec2::new(y * 20.0 / (d * d), -z * (x * 20.0 / d) / (d * d + z * z));
            (DVec2::new(x.atan2(y), z.atan2(d)), rates)
        };
        let mut last: Option<(f64, f64)> = None;
        let mut inside = 0;
        for k in -4000..4000 {
            let t = f64::from(k) * 1e-3;
            let (az_el, rates) = at(t);
            let here = params.keyhole_azimuth(az_el, rates);
            let az = here.map_or(az_el.x, |[az, _]| az);
            if let Some([_, rate]) = here {
                inside += 1;
                assert!((rate.abs() - omega).abs() < 1e-12);
            }
            // Continuous, at entry and exit too, and never faster than the axis turns.
            if let Some((before, _)) = last {
                let turned = wrap_pi(az - before).abs();
                assert!(turned <= omega * 1e-3 * (1.0 + 1e-6) + 1e-9, "{t} {turned}");
            }
            last = Some((az, t));
        }
        // 2T with ω T = atan(v T/ρ), v/ρ = 4/s: T = 1.439 s by hand.
        let half = 1e-3 * 0.5 * f64::from(inside);
        let residual = (4.0 * half).atan() - omega * half;
        assert!(residual.abs() < 2e-3, "{half}");
        // Far below the zenith or passing slowly there is no keyhole.
        assert!(
            params
                .keyhole_azimuth(DVec2::new(0.0, 0.5), DVec2::new(3.0, 0.0))
                .is_none()
        );
        assert!(
            params
                .keyhole_azimuth(DVec2::new(0.0, 1.3), DVec2::new(0.5, 0.0))
                .is_none()
        );
    }
}

#[test]
fn zenith_pass_stays_bounded_and_is_reacquired() {
    let mut params = GimbalParams::default();
    params.elevation.travel_rad = Some([-0.3, 0.5 * PI]);
    let run = |keyhole: bool| {
        let at = |t: f64| {
            let (x, y, z) = (20.0 * t, 5.0, 300.0);
            let d = f64::hypot(x, y);
            let rates = DVec2::new(y * 20.0 / (d * d), -z * (x * 20.0 / d) / (d * d + z * z));
            (DVec2::new(x.atan2(y), z.atan2(d)), rates)
        };
        let mut state = GimbalState::at_rest(at(-10.0).0);
        let (mut worst, mut after) = (0.0_f64, 0.0_f64);
        for k in 0..960 * 20 {
            let t = f64::from(k) * DT - 10.0;
            let (az_el, rates) = at(t);
            let lead = params.keyhole_azimuth(az_el, rates).filter(|_| keyhole);
            let [az, az_rate] = lead.unwrap_or([az_el.x, rates.x]);
            let mut command = params.position_command(&state, DVec2::new(az, az_el.y));
            command.rate_radps[0] += az_rate;
            command.rate_radps[1] += rates.y;
            step(&mut state, &params, &command, [0.0; 2], DT);
            assert!(state.azimuth.rate_radps.abs() < 1.05 * params.azimuth.rate_limit_radps);
            let los = az_el_to_los(at(t + DT).0);
            let error = az_el_to_los(state.az_el_rad()).angle_between(los);
            worst = error.max(worst);
            if t > 2.0 {
                after = error.max(after);
            }
        }
        (worst, after)
    };
    let (worst, after) = run(true);
    let (plain_worst, plain_after) = run(false);
    // The ramp's own miss: the target's distance from the zenith times the azimuth's error.
    let omega = 0.9 * params.azimuth.rate_limit_radps;
    let ramp = (0..1439).map(|k| {
        let t = f64::from(k) * 1e-3;
        (t * 20.0).hypot(5.0) / 300.0 * ((4.0 * t).atan() - omega * t).sin()
    });
    assert!(worst < 1.05 * ramp.fold(0.0, f64::max));
    // Half a second after the exit at t = 1.44 s the target is held to 0.05 mrad.
    assert!(after < 5e-5 && after < 0.1 * plain_after);
    assert!(worst < 0.6 * plain_worst);
}

#[test]
fn wind_torque_is_arm_times_drag() {
    let load = WindLoad::default();
    // Looking north and level, wind of 10 m/s from the west: ½ · 1.2 · 1.2 · 0.25 · 100 · 0.15.
    let [az, el] = load.torque_nm(1.2, DVec3::new(10.0, 0.0, 0.0), DVec2::ZERO);
    assert!((az - 2.7).abs() < 1e-12 && el.abs() < 1e-12);
    // Wind along the line of sight turns nothing; in general it is r × F about the axes.
    let at = DVec2::new(0.7, 0.4);
    let los = az_el_to_los(at);
    let [az, el] = load.torque_nm(1.2, -8.0 * los, at);
    assert!(az.abs() < 1e-12 && el.abs() < 1e-12);
    let wind = DVec3::new(3.0, -4.0, 1.0);
    let force = 0.5 * 1.2 * 1.2 * 0.25 * wind.length() * wind;
    let moment = (0.15 * los).cross(force);
    let right = DVec3::new(at.x.cos(), -at.x.sin(), 0.0);
    let [az, el] = load.torque_nm(1.2, wind, at);
    assert!((az + moment.z).abs() < 1e-12 && (el - moment.dot(right)).abs() < 1e-12);
}

#[test]
fn bad_parameters_are_refused() {
    assert!(GimbalParams::default().validate().is_ok());
    let bad = |f: fn(&mut AxisParams)| {
        let mut p = GimbalParams::default();
        f(&mut p.elevation);
        p.validate().is_err()
    };
    assert!(bad(|p| p.inertia_kg_m2 = 0.0));
    assert!(bad(|p| p.viscous_nms = -1.0));
    assert!(bad(|p| p.bandwidth_hz = f64::INFINITY));
    assert!(bad(|p| p.travel_rad = Some([1.0, 1.0])));
    assert!(bad(|p| p.encoder_bits = Some(0)));
    assert!(bad(|p| p.friction.as_mut().unwrap().breakaway_nm = 0.1));
    assert!(bad(|p| p.structure.as_mut().unwrap().rotor_share = 1.0));
    assert!(bad(|p| p.structure.as_mut().unwrap().backlash_rad = -1e-6));
}
