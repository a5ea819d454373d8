//! The catalogue's UAVs fly.

use glam::{DQuat, DVec3};

use crate::catalogue;
use boresight_models::flight::multirotor::{Airframe, MultirotorState, Setpoint, step};

const DT_S: f64 = 1.0 / 960.0; // [s]
const RHO: f64 = 1.225; // [kg/m^3]

fn hover_at(r_enu_m: DVec3, yaw_rad: f64) -> Setpoint {
    Setpoint {
        r_enu_m,
        v_enu_mps: DVec3::ZERO,
        a_enu_mps2: DVec3::ZERO,
        yaw_rad,
    }
}

fn airframe(kind: &str) -> Airframe {
    Airframe::new(&catalogue::load(kind).unwrap())
}

#[test]
fn trim_faces_its_heading_and_stays() {
    for kind in catalogue::names() {
        let airframe = airframe(kind);
        let setpoint = hover_at(DVec3::new(3.0, -4.0, 50.0), 0.6);
        let mut state = MultirotorState::trimmed(&airframe, &setpoint, DVec3::ZERO, RHO);
        let nose = state.q_enu_body * DVec3::X;
        assert!((nose - DVec3::new(0.6_f64.sin(), 0.6_f64.cos(), 0.0)).length() < 1e-12);
        for _ in 0..20 * 960 {
            step(&airframe, &mut state, &setpoint, DVec3::ZERO, RHO, DT_S);
            assert!((state.r_enu_m - setpoint.r_enu_m).length() < 1e-6);
        }
        assert!((state.rotor_speed_radps[0] / airframe.hover_rotor_speed_radps - 1.0).abs() < 1e-9);
    }
}

#[test]
fn hover_settles_within_a_centimetre() {
    for kind in catalogue::names() {
        let airframe = airframe(kind);
        let mut state = MultirotorState::trimmed(
            &airframe,
            &hover_at(DVec3::new(0.0, 0.0, 50.0), 0.0),
            DVec3::ZERO,
            RHO,
        );
        let setpoint = hover_at(DVec3::new(5.0, -3.0, 52.0), 2.5);
        for k in 0..30 * 960 {
            step(&airframe, &mut state, &setpoint, DVec3::ZERO, RHO, DT_S);
            if k >= 15 * 960 {
                assert!((state.r_enu_m - setpoint.r_enu_m).length() < 0.01);
            }
        }
        let nose = state.q_enu_body * DVec3::X;
        assert!((nose - DVec3::new(2.5_f64.sin(), 2.5_f64.cos(), 0.0)).length() < 1e-3);
    }
}

#[test]
fn tops_out_at_the_published_speed_and_tilt() {
    for kind in catalogue::names() {
        let model = catalogue::load(kind).unwrap();
        let airframe = Airframe::new(&model);
        let v_asked_enu_mps = DVec3::new(0.0, 2.0 * model.v_max_mps, 0.0);
        let mut setpoint = hover_at(DVec3::new(0.0, 0.0, 50.0), 0.0);
        let mut state = MultirotorState::trimmed(&airframe, &setpoint, DVec3::ZERO, RHO);
        setpoint.v_enu_mps = v_asked_enu_mps;
        for _ in 0..60 * 960 {
            setpoint.r_enu_m += DT_S * v_asked_enu_mps;
            step(&airframe, &mut state, &setpoint, DVec3::ZERO, RHO, DT_S);
            assert!(state.v_enu_mps.length() < 1.05 * model.v_max_mps);
        }
        let tilt_rad = (state.q_enu_body * DVec3::Z).angle_between(DVec3::Z);
        assert!(
            (state.v_enu_mps.y / model.v_max_mps - 1.0).abs() < 0.05,
            "{} {}",
            model.name,
            state.v_enu_mps
        );
        assert!(
            (tilt_rad / model.max_tilt_rad - 1.0).abs() < 0.05,
            "{}",
            model.name
        );
        assert!(
            (state.r_enu_m.z - 50.0).abs() < 0.5,
            "{} {}",
            model.name,
            state.r_enu_m
        );
    }
}

#[test]
fn recovers_from_upsets() {
    for kind in catalogue::names() {
        for (angle_deg, axis) in [
            (30.0_f64, DVec3::X),
            (30.0, DVec3::Y),
            (120.0, DVec3::new(0.6, 0.8, 0.0)),
        ] {
            let airframe = airframe(kind);
            let setpoint = hover_at(DVec3::new(0.0, 0.0, 50.0), 0.0);
            let mut state = MultirotorState::trimmed(&airframe, &setpoint, DVec3::ZERO, RHO);
            state.q_enu_body *= DQuat::from_axis_angle(axis, angle_deg.to_radians());
            for k in 0..12 * 960 {
                step(&airframe, &mut state, &setpoint, DVec3::ZERO, RHO, DT_S);
                if k == 960 {
                    let up = state.q_enu_body * DVec3::Z;
                    let limit_rad = catalogue::load(kind).unwrap().max_tilt_rad;
                    assert!(
                        up.angle_between(DVec3::Z) < limit_rad,
                        "{kind:?} {angle_deg}"
                    );
                }
            }
            let error_m = (state.r_enu_m - setpoint.r_enu_m).length();
            assert!(error_m < 0.01, "{kind:?} {angle_deg} {error_m}");
        }
    }
}
