//! The mount: kinematics, gimbal, gyros, mirror, the base's motion.

use crate::check::{Check, Fault, Tolerance, a_fifth_more, times};
use crate::theory;
use boresight_models::maths::frequency::step_figures;
use boresight_models::maths::kinematics::{boresight_chain, exp_so3};
use boresight_models::maths::rng::Stream;
use boresight_models::maths::statistics::allan_deviation;
use boresight_models::mount::base_motion::{BaseMotion, BaseMotionParams, Spectrum, TiltMode};
use boresight_models::mount::drive::{Cogging, Friction};
use boresight_models::mount::gimbal::{
    AxisParams, GimbalCommand, GimbalParams, GimbalState, WindLoad, step,
};
use boresight_models::mount::gyro::{Gyro, GyroParams};
use boresight_models::mount::mirror::{Mirror, MirrorParams};
use boresight_models::tracking::search::SlewLimits;
use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

pub fn checks() -> Vec<Check> {
    [
        kinematics(),
        gimbal(),
        gyros(),
        search(),
        mirror(),
        base_motion(),
    ]
    .concat()
}

const DT_S: f64 = 1.0 / 960.0; // [s]

fn kinematics() -> Vec<Check> {
    vec![
        Check {
            model: "kinematics",
            name: "a vector turned about an oblique axis by 0.7 rad",
            reference: "Rodrigues' formula",
            // u = (1, 2, 2)/3 and v = x: cos θ + u_x² (1 - cos θ).
            value: 0.7f64.cos() + (1.0 - 0.7f64.cos()) / 9.0,
            unit: "",
            tolerance: Tolerance::Absolute(1e-14),
            mutation: a_fifth_more("angle"),
            run: |scale| {
                let axis = DVec3::new(1.0, 2.0, 2.0) / 3.0;
                Ok((exp_so3(scale.of(0.7) * axis) * DVec3::X).x)
            },
        },
        Check {
            model: "kinematics",
            name: "turn of the line of sight by a mirror of 3 mrad right and 2 mrad up",
            reference: "great circle: √13 mrad",
            value: 13f64.sqrt(),
            unit: "mrad",
            tolerance: Tolerance::Relative(1e-8),
            mutation: a_fifth_more("deflection"),
            run: |scale| {
                let along = |mirror_rad| {
                    let still = DVec3::ZERO;
                    boresight_chain(still, still, 0.9, 0.4, mirror_rad, still).q_enu_cam * DVec3::Z
                };
                let turned = along(scale.of(1.0) * DVec2::new(3e-3, 2e-3));
                Ok(1e3 * turned.angle_between(along(DVec2::ZERO)))
            },
        },
    ]
}

/// An azimuth axis without friction, sensor errors and structure, and its command [rad/s], over some ticks.
fn turned(
    axis: AxisParams,
    rate_radps: f64,
    start_radps: f64,
    [dt_s, t_s]: [f64; 2],
) -> GimbalState {
    let params = GimbalParams {
        azimuth: axis,
        ..GimbalParams::default()
    };
    let mut state = GimbalState::default();
    state.azimuth.rate_radps = start_radps;
    let command = GimbalCommand {
        rate_radps: [rate_radps, 0.0],
    };
    for _ in 0..(t_s / dt_s).round() as u32 {
        step(&mut state, &params, &command, [0.0; 2], dt_s);
    }
    state
}

fn rigid() -> AxisParams {
    AxisParams {
        structure: None,
        ..GimbalParams::default().azimuth.ideal()
    }
}

fn gimbal() -> Vec<Check> {
    const T_S: f64 = 5e-3; // [s]
    let (z, w) = (rigid().damping, TAU * rigid().bandwidth_hz);
    let (s, damped) = (z * w, w * (1.0 - z * z).sqrt());
    let swing = (damped * T_S).cos() - s / damped * (damped * T_S).sin();
    vec![
        Check {
            model: "gimbal",
            name: "rate 5 ms after a step of 1 mrad/s",
            reference: "(2ζωs + ω²)/(s² + 2ζωs + ω²), closed form",
            value: 1.0 - (-s * T_S).exp() * swing,
            unit: "mrad/s",
            tolerance: Tolerance::Absolute(3e-3),
            mutation: a_fifth_more("bandwidth of the rate loop"),
            run: |scale| {
                let axis = AxisParams {
                    viscous_nms: 0.0,
                    bandwidth_hz: scale.of(rigid().bandwidth_hz),
                    ..rigid()
                };
                let state = turned(axis, 1e-3, 0.0, [DT_S / 64.0, T_S]);
                Ok(1e3 * state.azimuth.rate_radps)
            },
        },
        Check {
            model: "gimbal",
            name: "rate after 1 s without motor, from 0.5 rad/s",
            reference: "viscous friction 2 N m s over 8 kg m²: e^-0.25",
            value: 0.5 * (-0.25f64).exp(),
            unit: "rad/s",
            tolerance: Tolerance::Relative(1e-8),
            mutation: a_fifth_more("moment of inertia"),
            run: |scale| {
                let axis = AxisParams {
                    torque_limit_nm: 1e-12,
                    inertia_kg_m2: scale.of(8.0),
                    ..rigid()
                };
                Ok(turned(axis, 0.5, 0.5, [DT_S, 1.0]).azimuth.rate_radps)
            },
        },
        Check {
            model: "gimbal",
            name: "motor torque at a steady 3 mrad/s",
            reference: "Stribeck's curve and viscous friction",
            value: 0.4 + 0.2 * (-2.25f64).exp() + 2.0 * 3e-3,
            unit: "N m",
            tolerance: Tolerance::Relative(1e-5),
            mutation: a_fifth_more("Coulomb's friction"),
            run: |scale| {
                let axis = AxisParams {
                    friction: Some(Friction {
                        coulomb_nm: scale.of(0.4),
                        breakaway_nm: 0.6,
                        stribeck_radps: 2e-3,
                        presliding_rad: 2e-4,
                        bristle_nms: 150.0,
                    }),
                    ..rigid()
                };
                Ok(turned(axis, 3e-3, 0.0, [DT_S, 2.0]).azimuth.torque_nm)
            },
        },
        Check {
            model: "gimbal",
            name: "turn of a resting axis under half its breakaway torque",
            reference: "LuGre before sliding: θ = -z_S ln(1 - T/F_S)",
            value: 200.0 * 2.0f64.ln(),
            unit: "µrad",
            tolerance: Tolerance::Relative(0.02),
            mutation: a_fifth_more("presliding displacement"),
            run: |scale| {
                let axis = AxisParams {
                    friction: Some(Friction {
                        coulomb_nm: 0.4,
                        breakaway_nm: 0.6,
                        stribeck_radps: 2e-3,
                        presliding_rad: scale.of(2e-4),
                        bristle_nms: 150.0,
                    }),
                    viscous_nms: 2.0,
                    torque_limit_nm: 1e-12,
                    ..rigid()
                };
                // The torque rises so slowly that the axis is always at rest.
                let params = GimbalParams {
                    azimuth: axis,
                    ..GimbalParams::default()
                };
                let mut state = GimbalState::default();
                let ticks = 20_000;
                for k in 1..=ticks {
                    let torque_nm = [0.3 * f64::from(k) / f64::from(ticks), 0.0];
                    step(
                        &mut state,
                        &params,
                        &GimbalCommand::default(),
                        torque_nm,
                        DT_S,
                    );
                }
                Ok(1e6 * state.azimuth.angle_rad)
            },
        },
        Check {
            model: "gimbal",
            name: "ripple of a free rotor's rate over a motor's poles at 0.2 rad/s",
            reference: "2 T/(J n ω), to first order",
            value: 1e6 * 2.0 * 0.12 / (8.0 * 180.0 * 0.2),
            unit: "µrad/s",
            tolerance: Tolerance::Relative(0.02),
            mutation: a_fifth_more("cogging torque"),
            run: |scale| {
                let axis = AxisParams {
                    cogging: Some(Cogging {
                        torque_nm: scale.of(0.12),
                        per_turn: 180.0,
                    }),
                    viscous_nms: 0.0,
                    torque_limit_nm: 1e-12,
                    ..rigid()
                };
                let params = GimbalParams {
                    azimuth: axis,
                    ..GimbalParams::default()
                };
                let mut state = GimbalState::default();
                state.azimuth.rate_radps = 0.2;
                let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
                for _ in 0..960 {
                    step(
                        &mut state,
                        &params,
                        &GimbalCommand::default(),
                        [0.0; 2],
                        DT_S,
                    );
                    low = low.min(state.azimuth.rate_radps);
                    high = high.max(state.azimuth.rate_radps);
                }
                Ok(1e6 * (high - low))
            },
        },
        Check {
            model: "gimbal",
            name: "torque of a crosswind of 10 m/s about azimuth",
            reference: "arm times ½ρ C_D A v²",
            value: 0.15 * 0.5 * 1.225 * 1.2 * 0.25 * 100.0,
            unit: "N m",
            tolerance: Tolerance::Relative(1e-12),
            mutation: a_fifth_more("wind"),
            run: |scale| {
                let wind = scale.of(10.0) * DVec3::X;
                Ok(WindLoad::default().torque_nm(1.225, wind, DVec2::ZERO)[0])
            },
        },
    ]
}

/// Allan deviation [µrad/s] of what a gyro at rest reads, over `m` of `count` readings.
fn allan_uradps(params: GyroParams, dt_s: f64, m: usize, count: usize) -> Result<f64, Fault> {
    let mut gyro = Gyro::<1>::new(params, Stream::new(1, 0, "gyro"));
    let readings: Vec<f64> = (0..count).map(|_| gyro.read([0.0], dt_s)[0]).collect();
    let deviation = allan_deviation(&readings, m).ok_or(Fault::Nothing("allan_deviation"))?;
    Ok(1e6 * deviation)
}

fn gyros() -> Vec<Check> {
    let fibre = GyroParams::FIBRE;
    let walk = Check {
        model: "gyros",
        name: "Allan deviation over 0.1 s, angle random walk alone",
        reference: "IEEE Std 952: N/√τ",
        value: 1e6 * fibre.angle_walk / 0.1f64.sqrt(),
        unit: "µrad/s",
        tolerance: Tolerance::Relative(0.05),
        mutation: a_fifth_more("angle random walk"),
        run: |scale| {
            let params = GyroParams {
                angle_walk: scale.of(GyroParams::FIBRE.angle_walk),
                ..GyroParams::default()
            };
            allan_uradps(params, DT_S, 96, 200_000)
        },
    };
    vec![
        walk,
        Check {
            name: "top of the Allan deviation, bias instability alone",
            reference: "IEEE Std 952: 0.664 B",
            value: 1e6 * 0.664 * fibre.bias_radps,
            tolerance: Tolerance::Relative(0.08),
            mutation: a_fifth_more("bias instability"),
            run: |scale| {
                let params = GyroParams {
                    bias_radps: scale.of(GyroParams::FIBRE.bias_radps),
                    ..GyroParams::default()
                };
                allan_uradps(params, 1.0, 189, 200_000)
            },
            ..walk
        },
        Check {
            name: "Allan deviation over 1 s, rate random walk alone",
            reference: "IEEE Std 952: K √(τ/3)",
            value: 1e6 * fibre.rate_walk / 3.0f64.sqrt(),
            tolerance: Tolerance::Relative(0.08),
            mutation: a_fifth_more("rate random walk"),
            run: |scale| {
                let params = GyroParams {
                    rate_walk: scale.of(GyroParams::FIBRE.rate_walk),
                    ..GyroParams::default()
                };
                allan_uradps(params, DT_S, 960, 400_000)
            },
            ..walk
        },
        Check {
            model: "gyros",
            name: "lag behind a ramp, 100 Hz and 5 ms",
            reference: "1/(2π f) + delay, for finely held rates",
            value: 1e3 / (TAU * 100.0) + 5.0,
            unit: "ms",
            tolerance: Tolerance::Relative(1e-2),
            mutation: a_fifth_more("delay"),
            run: |scale| {
                let params = GyroParams {
                    bandwidth_hz: Some(100.0),
                    delay_s: scale.of(5e-3),
                    ..GyroParams::default()
                };
                let dt_s = 1e-5;
                let mut gyro = Gyro::<1>::new(params, Stream::new(0, 0, "gyro"));
                let mut late_s = 0.0;
                for k in 0..5_000 {
                    let t_s = f64::from(k) * dt_s;
                    late_s = t_s - gyro.read([t_s], dt_s)[0];
                }
                Ok(1e3 * late_s)
            },
        },
    ]
}

fn search() -> Vec<Check> {
    const LIMITS: SlewLimits = SlewLimits {
        rate_radps: 1.0,
        acceleration_radps2: 7.5,
        settle_s: 0.0,
    };
    vec![Check {
        model: "search",
        name: "slew over 1 rad at 1 rad/s and 7.5 rad/s²",
        reference: "trapezoid of rate: θ/v + v/a",
        value: 1.0 + 1.0 / 7.5,
        unit: "s",
        tolerance: Tolerance::Relative(1e-12),
        mutation: a_fifth_more("greatest rate"),
        run: |scale| {
            let limits = SlewLimits {
                rate_radps: scale.of(LIMITS.rate_radps),
                ..LIMITS
            };
            Ok(limits.slew_s(1.0))
        },
    }]
}

/// A mirror's response to a step of 1 mrad, in ticks [s].
fn mirror_step(params: &MirrorParams, dt_s: f64, ticks: usize) -> Result<Vec<f64>, Fault> {
    let mut mirror = Mirror::new(params, dt_s).map_err(Fault::of)?;
    let step = |_| 1e3 * mirror.step(DVec2::new(1e-3, 0.0)).x;
    Ok((0..ticks).map(step).collect())
}

fn mirror() -> Vec<Check> {
    let params = MirrorParams::default();
    let omega_radps = TAU * params.natural_frequency_hz;
    vec![
        Check {
            model: "mirror",
            name: "deflection a tick after a step of 1 mrad",
            reference: "ω²/(s² + 2ζωs + ω²), closed form",
            value: theory::second_order_step(omega_radps, params.damping, DT_S),
            unit: "mrad",
            tolerance: Tolerance::Relative(1e-9),
            mutation: a_fifth_more("natural frequency"),
            run: |scale| {
                let params = MirrorParams::default();
                let params = MirrorParams {
                    natural_frequency_hz: scale.of(params.natural_frequency_hz),
                    ..params
                };
                let response = mirror_step(&params, DT_S, 1)?;
                Ok(response.iter().sum())
            },
        },
        Check {
            model: "mirror",
            name: "overshoot",
            reference: "e^(-πζ/√(1-ζ²))",
            value: theory::overshoot(params.damping),
            unit: "",
            tolerance: Tolerance::Relative(1e-3),
            mutation: a_fifth_more("damping ratio"),
            run: |scale| {
                let params = MirrorParams::default();
                let params = MirrorParams {
                    damping: scale.of(params.damping),
                    ..params
                };
                let response = mirror_step(&params, 1e-6, 20_000)?;
                let figures = step_figures(&response, 1.0, 1e-6);
                Ok(figures.ok_or(Fault::Nothing("step_figures"))?.overshoot)
            },
        },
        Check {
            model: "mirror",
            name: "deflection by its sensor's noise of 1 µrad, much faster than the tick",
            reference: "white readings held over ticks that the loop follows whole: 1 µrad",
            value: 1.0,
            unit: "µrad rms",
            tolerance: Tolerance::Relative(0.03),
            mutation: a_fifth_more("sensor noise"),
            run: |scale| {
                let params = MirrorParams {
                    natural_frequency_hz: 1e5,
                    noise_rad: scale.of(1e-6),
                    ..MirrorParams::default()
                };
                let mut mirror = Mirror::new(&params, DT_S).map_err(Fault::of)?;
                let mut rng = Stream::new(1, 0, "mirror");
                let mut square = 0.0;
                for _ in 0..20_000 {
                    mirror.read(params.noise_rad * DVec2::new(rng.normal(), rng.normal()));
                    square += mirror.step(DVec2::ZERO).length_squared();
                }
                Ok(1e6 * (square / 40_000.0).sqrt())
            },
        },
    ]
}

/// Rms tilt about east of the default base after one tick [µrad], its sway times a factor, over 10,000 runs.
fn tilt_urad(factor: f64) -> Result<f64, Fault> {
    const RUNS: u64 = 10_000;
    let mut params = BaseMotionParams::default();
    params.sway.rms_rad = params.sway.rms_rad.map(|rms| factor * rms);
    let mut square = 0.0;
    for run in 0..RUNS {
        let mut base = BaseMotion::new(&params, DT_S).map_err(Fault::of)?;
        let tilt_rad = base.step(&mut Stream::new(1, run, "base"));
        square += tilt_rad.x.powi(2) / RUNS as f64;
    }
    Ok(1e6 * square.sqrt())
}

fn base_motion() -> Vec<Check> {
    let mast = BaseMotionParams::default().mast;
    let z2 = mast.damping * mast.damping;
    vec![
        Check {
            model: "base-motion",
            name: "rms tilt about east of sway, mast and broadband",
            reference: "independent modes: squares add",
            value: (100f64.powi(2) + 50f64.powi(2) + 5f64.powi(2)).sqrt(),
            unit: "µrad",
            // Five standard errors.
            tolerance: Tolerance::Relative(0.035),
            mutation: a_fifth_more("rms of the sway"),
            run: |scale| tilt_urad(scale.of(1.0)),
        },
        Check {
            model: "base-motion",
            name: "density at the mast's peak, of unit variance",
            reference: "white noise through a resonance: 2/(ζω(1-ζ²))",
            value: 1e3 * 2.0 / (mast.damping * TAU * mast.frequency_hz * (1.0 - z2)),
            unit: "1/kHz",
            tolerance: Tolerance::Relative(1e-9),
            mutation: a_fifth_more("damping ratio"),
            run: |scale| {
                let mast = BaseMotionParams::default().mast;
                let mode = TiltMode {
                    damping: scale.of(mast.damping),
                    ..mast
                };
                let at_hz = mast.frequency_hz * (1.0 - 2.0 * mode.damping.powi(2)).sqrt();
                Ok(1e3 * mode.psd_unit_per_hz(at_hz))
            },
        },
        Check {
            model: "base-motion",
            name: "power of a measured spectrum 200/f² from 10 to 100 Hz",
            reference: "its integral: 200 (1/10 - 1/100)",
            value: 18.0,
            unit: "rad²",
            tolerance: Tolerance::Relative(1e-9),
            mutation: times("level at the lower end", 1.2),
            run: |scale| {
                let points = [[10.0, scale.of(2.0)], [100.0, 0.02]];
                let spectrum = Spectrum::new(&points).map_err(Fault::of)?;
                Ok(spectrum.power_rad2(10.0, 100.0))
            },
        },
    ]
}
