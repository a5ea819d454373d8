//! What flies and falls.

use crate::check::{Check, Fault, Tolerance, a_fifth_more, times};
use boresight_models::flight::fall::{Fall, Falling};
use boresight_models::flight::multirotor::{Airframe, MultirotorState, Setpoint, step};
use boresight_models::flight::trajectory::Trajectory;
use boresight_models::flight::uav::UavModel;
use boresight_scenario::catalogue;
use glam::{DQuat, DVec3};
use std::f64::consts::TAU;

pub fn checks() -> Vec<Check> {
    [multirotor(), tops(), trajectories(), falling()].concat()
}

const DT_S: f64 = 1.0 / 960.0; // [s]
const RHO_KGPM3: f64 = 1.225; // [kg/m³]

fn hover() -> Setpoint {
    Setpoint {
        r_enu_m: DVec3::new(0.0, 0.0, 50.0),
        v_enu_mps: DVec3::ZERO,
        a_enu_mps2: DVec3::ZERO,
        yaw_rad: 0.0,
    }
}

/// A UAV of the catalogue with its drag area times a factor.
fn uav(name: &str, drag: f64) -> Result<UavModel, Fault> {
    let model = catalogue::load(name).map_err(Fault::of)?;
    Ok(UavModel {
        drag_area_m2: drag * model.drag_area_m2,
        ..model
    })
}

/// Tangent of the tilt with which a UAV holds its place in 10 m/s of wind.
fn tilt_in_wind(drag: f64) -> Result<f64, Fault> {
    let airframe = Airframe::new(&uav("phantom4", drag)?);
    let setpoint = hover();
    let mut state = MultirotorState::trimmed(&airframe, &setpoint, DVec3::ZERO, RHO_KGPM3);
    for _ in 0..20 * 960 {
        step(
            &airframe,
            &mut state,
            &setpoint,
            10.0 * DVec3::X,
            RHO_KGPM3,
            DT_S,
        );
    }
    Ok((state.q_enu_body * DVec3::Z).angle_between(DVec3::Z).tan())
}

/// Speed that a UAV reaches when it is asked for twice its greatest [m/s].
fn top_speed_mps(name: &str, drag: f64) -> Result<f64, Fault> {
    let model = uav(name, drag)?;
    let airframe = Airframe::new(&model);
    let mut setpoint = hover();
    let mut state = MultirotorState::trimmed(&airframe, &setpoint, DVec3::ZERO, RHO_KGPM3);
    setpoint.v_enu_mps = 2.0 * model.v_max_mps * DVec3::Y;
    for _ in 0..40 * 960 {
        setpoint.r_enu_m += DT_S * setpoint.v_enu_mps;
        step(
            &airframe,
            &mut state,
            &setpoint,
            DVec3::ZERO,
            RHO_KGPM3,
            DT_S,
        );
    }
    Ok(state.v_enu_mps.y)
}

fn multirotor() -> Vec<Check> {
    vec![
        Check {
            model: "multirotor",
            name: "drag of a Phantom 4 in 5 m/s",
            reference: "eq. 6: ½ρ C_D A v², 0.0498 m²",
            value: 0.5 * 1.225 * 0.0498 * 25.0,
            unit: "N",
            tolerance: Tolerance::Relative(1e-9),
            mutation: a_fifth_more("drag area"),
            run: |scale| {
                let airframe = Airframe::new(&uav("phantom4", scale.of(1.0))?);
                Ok(airframe
                    .drag_enu_n(DVec3::ZERO, 5.0 * DVec3::X, RHO_KGPM3)
                    .x)
            },
        },
        Check {
            model: "multirotor",
            name: "tangent of the tilt against 10 m/s of wind",
            reference: "drag over weight, 3.0503 N over 13.5332 N",
            value: 3.050_25 / 13.533_18,
            unit: "",
            tolerance: Tolerance::Absolute(1e-4),
            mutation: a_fifth_more("drag area"),
            run: |scale| tilt_in_wind(scale.of(1.0)),
        },
        Check {
            model: "multirotor",
            name: "rotors of a hovering Phantom 4",
            reference: "near 5,500 rpm (recalled)",
            value: 5500.0,
            unit: "rpm",
            tolerance: Tolerance::Absolute(700.0),
            mutation: a_fifth_more("propeller's diameter"),
            run: |scale| {
                let model = uav("phantom4", 1.0)?;
                let airframe = Airframe::new(&UavModel {
                    propeller_diameter_m: scale.of(model.propeller_diameter_m),
                    ..model
                });
                Ok(airframe.hover_rotor_speed_radps * 60.0 / TAU)
            },
        },
    ]
}

fn tops() -> Vec<Check> {
    let published = |name, value, run| Check {
        model: "catalogue",
        name,
        reference: "the maker's data sheet",
        value,
        unit: "m/s",
        tolerance: Tolerance::Relative(0.05),
        mutation: a_fifth_more("drag area"),
        run,
    };
    vec![
        published("top speed of a Phantom 4", 20.0, |scale| {
            top_speed_mps("phantom4", scale.of(1.0))
        }),
        published("top speed of a Mavic 2 Pro", 20.0, |scale| {
            top_speed_mps("mavic2", scale.of(1.0))
        }),
        published("top speed of a Mavic Air", 19.0, |scale| {
            top_speed_mps("mavic_air", scale.of(1.0))
        }),
        published("top speed of a Matrice 200", 23.0, |scale| {
            top_speed_mps("matrice200", scale.of(1.0))
        }),
        published("top speed of a Matrice 600 Pro", 18.0, |scale| {
            top_speed_mps("matrice600", scale.of(1.0))
        }),
    ]
}

fn sampled(trajectory: &Trajectory, t_s: f64) -> Result<Setpoint, Fault> {
    let none = |_: &str| Err(std::io::ErrorKind::NotFound.into());
    Ok(trajectory.compile(none).map_err(Fault::of)?.sample(t_s))
}

fn trajectories() -> Vec<Check> {
    vec![
        Check {
            model: "trajectories",
            name: "acceleration in a circle of 60 m at 15 m/s",
            reference: "v²/r",
            value: 3.75,
            unit: "m/s²",
            tolerance: Tolerance::Relative(1e-9),
            mutation: a_fifth_more("speed"),
            run: |scale| {
                let orbit = Trajectory::Orbit {
                    centre_enu_m: [0.0, 0.0, 50.0],
                    radius_m: 60.0,
                    speed_mps: scale.of(15.0),
                    clockwise: true,
                    start_bearing_deg: 0.0,
                };
                Ok(sampled(&orbit, 3.7)?.a_enu_mps2.length())
            },
        },
        Check {
            model: "trajectories",
            name: "sideways swing of a weave of 4 m/s² every 3 s",
            reference: "a T²/(4π²)",
            value: 4.0 * 9.0 / (TAU * TAU),
            unit: "m",
            tolerance: Tolerance::Relative(1e-9),
            mutation: a_fifth_more("period"),
            run: |scale| {
                let period_s = scale.of(3.0);
                let weave = Trajectory::Weave {
                    start_enu_m: [0.0, 0.0, 50.0],
                    velocity_enu_mps: [0.0, 12.0, 0.0],
                    lateral_acceleration_mps2: 4.0,
                    period_s,
                };
                Ok(sampled(&weave, 0.25 * period_s)?.r_enu_m.x.abs())
            },
        },
    ]
}

fn falling() -> Vec<Check> {
    vec![Check {
        model: "falling",
        name: "depth after a second, thrown up at 3 m/s",
        reference: "parabola: v t - g t²/2",
        value: 3.0 - 0.5 * 9.80665,
        unit: "m",
        // A step of Euler's method errs by half of gravity, step and time.
        tolerance: Tolerance::Absolute(6e-3),
        mutation: times("speed upwards", 1.2),
        run: |scale| {
            let thrown = Falling {
                size_m: [0.4, 0.3, 0.2],
                mass_kg: 1.2,
                q_enu_body: DQuat::IDENTITY,
                v_enu_mps: scale.of(3.0) * DVec3::Z,
                omega_body_radps: DVec3::ZERO,
            };
            let mut fall = Fall::new(&thrown, None, 1e-3);
            for _ in 0..1000 {
                fall.step(DVec3::ZERO);
            }
            Ok(fall.moved_enu_m().z)
        },
    }]
}
