//! Calls that ask how vehicles stand. What sensors say is the exact truth: there are no models of them here.

use super::answers::{Answer, Fault};
use super::names;
use super::session::Session;
use crate::components::flight::UavStatus;
use crate::models::ground::dsm::LineOfSight;
use crate::models::maths::geodesy::Geodetic;
use crate::models::maths::kinematics::GRAVITY_MPS2;
use crate::simulation::{UavView, View};
use boresight_airsim::arguments::{finite, of_map};
use boresight_airsim::frames::{attitude, flipped, swapped};
use boresight_airsim::messages::{
    self, Collision, GeoPoint, Kinematics, Multirotor, barometer, gps, imu, magnetometer,
};
use boresight_airsim::{Arguments, Value};
use glam::DVec3;

/// Field of the Earth's axial dipole at its equator \[G\].
const DIPOLE_GAUSS: f64 = 0.312;
/// Pressure at sea level of the standard atmosphere \[hPa\].
const STANDARD_HPA: f64 = 1013.25;

/// `getSettingsString`: what clients look for in it.
pub(super) fn settings() -> &'static str {
    r#"{"SettingsVersion": 1.2, "SimMode": "Multirotor"}"#
}

/// `listVehicles`.
pub(super) fn vehicles(session: &Session) -> Value {
    let names = names::vehicles(session.view()).map(|uav| uav.name().into());
    Value::Array(names.collect())
}

/// A place on the Earth.
pub(super) fn geo_point(view: View, r_enu_m: DVec3) -> GeoPoint {
    let Geodetic {
        latitude_rad,
        longitude_rad,
        height_m,
    } = view.air().site().enu_to_geodetic(r_enu_m);
    GeoPoint {
        latitude_deg: latitude_rad.to_degrees(),
        longitude_deg: longitude_rad.to_degrees(),
        altitude_m: height_m,
    }
}

/// A vehicle with what moves it, in its own frame.
struct Asked<'a> {
    uav: UavView<'a>,
    kinematics: Kinematics,
}

fn asked<'a>(session: &'a Session, of: &mut Arguments) -> Result<Asked<'a>, String> {
    let name = of.maybe_text("vehicle_name")?;
    let view = session.view();
    let uav = names::vehicle(view, &name).map_err(|why| of.wrong(why))?;
    let number = names::vehicles(view).position(|other| other.index() == uav.index());
    let (a_enu_mps2, turning_radps2) = session.accelerations(number.unwrap_or(usize::MAX));
    let home_enu_m = session.home_enu_m(uav.name());
    let kinematics = Kinematics {
        position: swapped(uav.r_enu_m() - home_enu_m),
        orientation: attitude(uav.q_enu_body()),
        linear_velocity: swapped(uav.v_enu_mps()),
        angular_velocity: flipped(uav.rates_body_radps()),
        linear_acceleration: swapped(a_enu_mps2),
        angular_acceleration: flipped(turning_radps2),
    };
    Ok(Asked { uav, kinematics })
}

fn collision_of(asked: &Asked) -> Collision {
    let crash = asked.uav.fate().and_then(|fate| fate.crash.as_ref());
    let met = matches!(asked.uav.status(), UavStatus::Struck | UavStatus::Crashed);
    Collision {
        has_collided: met || crash.is_some(),
        position: asked.kinematics.position,
        time_stamp_ns: 0,
    }
}

/// `getMultirotorState`.
pub(super) fn multirotor(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let asked = asked(session, of)?;
    let status = asked.uav.status();
    let ready = matches!(status, UavStatus::Flying | UavStatus::Landed);
    let state = Multirotor {
        collision: collision_of(&asked),
        gps_location: geo_point(session.view(), asked.uav.r_enu_m()),
        time_stamp_ns: session.now_ns(),
        landed: status.grounded(),
        ready,
        ready_message: match ready {
            true => String::new(),
            false => format!("it is {}", status.name()),
        },
        kinematics: asked.kinematics,
    };
    Ok(state.value().into())
}

/// `simGetVehiclePose`.
pub(super) fn vehicle_pose(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let Kinematics {
        position,
        orientation,
        ..
    } = asked(session, of)?.kinematics;
    Ok(messages::pose(position, orientation).into())
}

/// `simGetGroundTruthKinematics`.
pub(super) fn kinematics(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    Ok(asked(session, of)?.kinematics.value().into())
}

/// `simGetCollisionInfo`.
pub(super) fn collision(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    Ok(collision_of(&asked(session, of)?).value().into())
}

/// Pressure of the air where something is \[Pa\]: that of the standard atmosphere above the site's.
fn pressure_pa(view: View, r_enu_m: DVec3) -> f64 {
    use crate::models::air::atmosphere::pressure_at_pa;
    let altitude_m = |r_enu_m: DVec3| view.air().site().enu_to_geodetic(r_enu_m).height_m;
    let site_pa = view.air().weather().pressure_pa;
    let [here, site] = [r_enu_m, DVec3::ZERO].map(|r| pressure_at_pa(1.0, altitude_m(r)));
    site_pa * here / site
}

/// `simGetGroundTruthEnvironment`.
pub(super) fn environment(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let asked = asked(session, of)?;
    let view = session.view();
    let r_enu_m = asked.uav.r_enu_m();
    let air = (
        pressure_pa(view, r_enu_m),
        view.air().weather().temperature_k,
        view.air().density_kgpm3(),
    );
    let geo_point = geo_point(view, r_enu_m);
    let position = asked.kinematics.position;
    Ok(messages::environment(position, geo_point, GRAVITY_MPS2, air).into())
}

/// `getHomeGeoPoint`.
pub(super) fn home(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let asked = asked(session, of)?;
    let home_enu_m = session.home_enu_m(asked.uav.name());
    Ok(geo_point(session.view(), home_enu_m).value().into())
}

/// `getGpsData`, `getImuData`, `getBarometerData`, `getMagnetometerData`.
pub(super) fn sensor(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    // Whatever it is called, there is one of each.
    of.maybe_text("sensor_name")?;
    let Asked { uav, kinematics } = asked(session, of)?;
    let view = session.view();
    let (now_ns, r_enu_m) = (session.now_ns(), uav.r_enu_m());
    let to_body = kinematics.orientation.inverse();
    let said = match of.method() {
        "getImuData" => {
            let gravity = DVec3::new(0.0, 0.0, GRAVITY_MPS2);
            let felt = to_body * (kinematics.linear_acceleration - gravity);
            let Kinematics {
                orientation,
                angular_velocity,
                ..
            } = kinematics;
            imu(now_ns, orientation, angular_velocity, felt)
        }
        "getGpsData" => {
            let start_us = session
                .run()
                .scenario()
                .scenario
                .time_utc
                .timestamp_micros();
            let utc_us = u64::try_from(start_us).unwrap_or(0) + now_ns / 1000;
            let at = geo_point(view, r_enu_m);
            gps(now_ns, utc_us, at, kinematics.linear_velocity)
        }
        "getBarometerData" => {
            let altitude_m = geo_point(view, r_enu_m).altitude_m;
            barometer(now_ns, altitude_m, pressure_pa(view, r_enu_m), STANDARD_HPA)
        }
        _ => {
            let latitude_rad = geo_point(view, r_enu_m).latitude_deg.to_radians();
            let (sin, cos) = latitude_rad.sin_cos();
            let field = DIPOLE_GAUSS * DVec3::new(cos, 0.0, 2.0 * sin);
            magnetometer(now_ns, to_body * field)
        }
    };
    Ok(said.into())
}

/// A place that is given on the Earth \[m\].
fn place_enu_m(session: &Session, of: &mut Arguments) -> Result<DVec3, String> {
    let point = of.value();
    let number = |key| of_map(&point, key).and_then(finite);
    let read = || {
        Some(Geodetic {
            latitude_rad: number("latitude")?.to_radians(),
            longitude_rad: number("longitude")?.to_radians(),
            height_m: number("altitude")?,
        })
    };
    let place = read().ok_or_else(|| of.wrong("give a GeoPoint"))?;
    Ok(session.view().air().site().ecef_to_enu(place.to_ecef()))
}

/// `simTestLineOfSightToPoint`, `simTestLineOfSightBetweenPoints`.
pub(super) fn line_of_sight(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let first_enu_m = place_enu_m(session, of)?;
    let second_enu_m = match of.method() {
        "simTestLineOfSightBetweenPoints" => place_enu_m(session, of)?,
        _ => asked(session, of)?.uav.r_enu_m(),
    };
    let sight = (session.view().air()).line_of_sight(second_enu_m, first_enu_m);
    Ok(Value::from(sight == LineOfSight::Clear).into())
}
