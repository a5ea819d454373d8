//! Calls by which a vehicle flies. Each becomes an order of the run.

use super::answers::{Answer, Fault};
use super::names;
use super::session::Session;
use super::tasks::{Task, Until, heading_rad, stop};
use crate::components::flight::UavStatus;
use crate::models::maths::geodesy::Geodetic;
use crate::scenario::{FlyOrder, OrderConfig};
use crate::serve::inbox::Client;
use boresight_airsim::arguments::{finite, flag, of_map, vector};
use boresight_airsim::frames::{heading_deg, swapped};
use boresight_airsim::{Arguments, Value};
use glam::{DVec2, DVec3};

/// A take-off rises so far \[m\]: as AirSim's.
const TAKEOFF_M: f64 = 3.0;
/// Longest time that a task is waited for \[s\]: a clients' "no limit" is a number of 38 digits.
const LONGEST_S: f64 = 1e6;
/// Places of a path.
const MOST_PLACES: usize = 10_000;

/// `enableApiControl`.
pub(super) fn enable(session: &mut Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let enabled = of.flag("is_enabled")?;
    let vehicle = vehicle(session, of)?;
    session.control(&vehicle, enabled);
    Ok(Value::Nil.into())
}

/// `isApiControlEnabled`.
pub(super) fn is_enabled(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let vehicle = vehicle(session, of)?;
    Ok(Value::from(session.controls(&vehicle)).into())
}

/// `armDisarm`: the rotors are the simulation's.
pub(super) fn arm(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    of.flag("arm")?;
    vehicle(session, of)?;
    Ok(Value::from(true).into())
}

/// `cancelLastTask`: the vehicle stops.
pub(super) fn cancel(session: &mut Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let vehicle = vehicle(session, of)?;
    if let Some(task) = session.tasks.take(&vehicle) {
        task.end(false);
        fly(session, of.method(), stop(&vehicle))?;
    }
    Ok(Value::Nil.into())
}

/// The name that is given next of a vehicle.
fn vehicle(session: &Session, of: &mut Arguments) -> Result<String, String> {
    let name = of.maybe_text("vehicle_name")?;
    let found = names::vehicle(session.view(), &name);
    let found = found.map(|uav| uav.name().to_owned());
    found.map_err(|why| of.wrong(why))
}

fn fly(session: &mut Session, method: &str, order: FlyOrder) -> Result<(), Fault> {
    let order = OrderConfig {
        fly: Some(order),
        ..OrderConfig::default()
    };
    session.give(method, order)
}

/// How the nose is turned on the way.
#[derive(Clone, Copy)]
enum Nose {
    /// As it is.
    Kept,
    /// So \[deg, clockwise from north\].
    At(f64),
    /// To where it flies, and so much off that \[deg\].
    Ahead(f64),
}

impl Nose {
    /// Heading on a way.
    fn heading_deg(self, way_enu: DVec2) -> Option<f64> {
        match self {
            Self::Kept => None,
            Self::At(deg) => Some(deg.rem_euclid(360.0)),
            // Straight up there is no ahead.
            Self::Ahead(_) if way_enu.length() < 0.1 => None,
            Self::Ahead(off_deg) => Some(heading_deg(
                way_enu.x.atan2(way_enu.y) + off_deg.to_radians(),
            )),
        }
    }
}

/// `drivetrain` and `yaw_mode`.
fn nose(of: &mut Arguments, with_drivetrain: bool) -> Result<Nose, String> {
    let forward = match with_drivetrain {
        true => of.whole("drivetrain")? == 1,
        false => false,
    };
    let mode = of.value();
    if mode.is_nil() {
        return Ok(Nose::Kept);
    }
    let is_rate = of_map(&mode, "is_rate").and_then(flag);
    let value = of_map(&mode, "yaw_or_rate").and_then(finite);
    let (Some(is_rate), Some(value)) = (is_rate, value) else {
        return Err(of.wrong("yaw_mode: give a YawMode"));
    };
    match (is_rate, forward) {
        (true, _) if value != 0.0 => Err(
            of.wrong("a rate of yaw is not offered: give YawMode(False, degrees), or rotateToYaw")
        ),
        (true, true) => Ok(Nose::Ahead(0.0)),
        (true, false) => Ok(Nose::Kept),
        (false, true) => Ok(Nose::Ahead(value)),
        (false, false) => Ok(Nose::At(value)),
    }
}

/// What a call wants of a vehicle, before the vehicle is known.
enum Wanted {
    Takeoff,
    Land,
    Home,
    Hover,
    /// Places in the vehicle's frame, and a speed.
    Path(Vec<DVec3>, f64, Nose),
    /// A place on the Earth, and a speed.
    Geo(Geodetic, f64, Nose),
    /// A height in the vehicle's frame, down, and a speed.
    Z(f64, f64, Nose),
    /// Velocity north, east, down, or forward, right, down; and for how long.
    Velocity {
        v: DVec3,
        body: bool,
        duration_s: f64,
        nose: Nose,
    },
    /// The same with a height in place of the last.
    VelocityZ {
        v: DVec2,
        z: f64,
        body: bool,
        duration_s: f64,
        nose: Nose,
    },
    /// Yaw and margin \[deg\].
    Yaw(f64, f64),
}

/// A time to wait for \[s\].
fn longest(of: &mut Arguments) -> Result<f64, String> {
    Ok(of.number("timeout_sec")?.clamp(0.0, LONGEST_S))
}

/// `lookahead` and `adaptive_lookahead`, which mean nothing here.
fn skip_lookahead(of: &mut Arguments) {
    of.value();
    of.value();
}

fn read(of: &mut Arguments) -> Result<(Wanted, f64), String> {
    let xyz = |of: &mut Arguments, names: [&str; 3]| {
        let [x, y, z] = names;
        Ok::<_, String>(DVec3::new(of.number(x)?, of.number(y)?, of.number(z)?))
    };
    let duration = |of: &mut Arguments| {
        let seconds = of.number("duration")?;
        Ok::<_, String>(seconds.clamp(0.0, LONGEST_S))
    };
    let method = of.method().to_owned();
    let body = method.ends_with("BodyFrame");
    Ok(match method.as_str() {
        "takeoff" => (Wanted::Takeoff, longest(of)?),
        "land" => (Wanted::Land, longest(of)?),
        "goHome" => (Wanted::Home, longest(of)?),
        "hover" => (Wanted::Hover, LONGEST_S),
        "moveToPosition" => {
            let at = xyz(of, ["x", "y", "z"])?;
            let (speed_mps, longest_s) = (of.number("velocity")?, longest(of)?);
            let nose = nose(of, true)?;
            skip_lookahead(of);
            (Wanted::Path(vec![at], speed_mps, nose), longest_s)
        }
        "moveToGPS" => {
            let at = xyz(of, ["latitude", "longitude", "altitude"])?;
            let (speed_mps, longest_s) = (of.number("velocity")?, longest(of)?);
            let nose = nose(of, true)?;
            skip_lookahead(of);
            let at = Geodetic {
                latitude_rad: at.x.to_radians(),
                longitude_rad: at.y.to_radians(),
                height_m: at.z,
            };
            (Wanted::Geo(at, speed_mps, nose), longest_s)
        }
        "moveOnPath" => {
            let path = of.list("path", "a list of Vector3r", vector)?;
            if path.is_empty() || path.len() > MOST_PLACES {
                return Err(of.wrong(format!("path: give 1 to {MOST_PLACES} places")));
            }
            let (speed_mps, longest_s) = (of.number("velocity")?, longest(of)?);
            let nose = nose(of, true)?;
            skip_lookahead(of);
            (Wanted::Path(path, speed_mps, nose), longest_s)
        }
        "moveToZ" => {
            let (z, speed_mps) = (of.number("z")?, of.number("velocity")?);
            let longest_s = longest(of)?;
            let nose = nose(of, false)?;
            skip_lookahead(of);
            (Wanted::Z(z, speed_mps, nose), longest_s)
        }
        "moveByVelocity" | "moveByVelocityBodyFrame" => {
            let v = xyz(of, ["vx", "vy", "vz"])?;
            let duration_s = duration(of)?;
            let nose = nose(of, true)?;
            (
                Wanted::Velocity {
                    v,
                    body,
                    duration_s,
                    nose,
                },
                LONGEST_S,
            )
        }
        "moveByVelocityZ" | "moveByVelocityZBodyFrame" => {
            let v = xyz(of, ["vx", "vy", "z"])?;
            let duration_s = duration(of)?;
            let nose = nose(of, true)?;
            let (v, z) = (v.truncate(), v.z);
            (
                Wanted::VelocityZ {
                    v,
                    z,
                    body,
                    duration_s,
                    nose,
                },
                LONGEST_S,
            )
        }
        _ => {
            let yaw_deg = of.number("yaw")?;
            let longest_s = longest(of)?;
            (Wanted::Yaw(yaw_deg, of.number("margin")?), longest_s)
        }
    })
}

/// Begins what a call wants; it is answered when that is done.
pub(super) fn begin(
    session: &mut Session,
    client: &Client,
    id: Option<u32>,
    of: &mut Arguments,
) -> Result<Answer, Fault> {
    let (wanted, longest_s) = read(of)?;
    let vehicle = vehicle(session, of)?;
    if !session.controls(&vehicle) {
        let why =
            format!("'{vehicle}' is not under API control: call enableApiControl(True) first");
        return Err(of.wrong(why).into());
    }
    let (order, until) = plan(session, &vehicle, wanted).map_err(|why| of.wrong(why))?;
    fly(session, of.method(), order)?;
    let deadline_s = session.view().t_s() + longest_s;
    session.begin_task(Task {
        client: client.clone(),
        id,
        vehicle,
        until,
        deadline_s,
    });
    Ok(Answer::Later)
}

/// The order that does what is wanted, and when it is done.
fn plan(session: &Session, vehicle: &str, wanted: Wanted) -> Result<(FlyOrder, Until), String> {
    let view = session.view();
    let uav = names::vehicle(view, vehicle)?;
    match uav.status() {
        UavStatus::Flying | UavStatus::Landed => {}
        status => {
            return Err(format!(
                "'{vehicle}' flies no more: it is {}",
                status.name()
            ));
        }
    }
    let (t_s, r_enu_m) = (view.t_s(), uav.r_enu_m());
    let home_enu_m = session.home_enu_m(vehicle);
    let still = stop(vehicle);
    let path = |places: Vec<DVec3>, speed_mps: f64, nose: Nose| {
        let last = places.last().copied().unwrap_or(r_enu_m);
        let first = places.first().copied().unwrap_or(r_enu_m);
        let order = FlyOrder {
            path_enu_m: places.iter().map(DVec3::to_array).collect(),
            speed_mps: Some(speed_mps),
            heading_deg: nose.heading_deg((first - r_enu_m).truncate()),
            ..stop(vehicle)
        };
        (order, last)
    };
    // Forward and right of the nose, north and east of the world.
    let turned = |v: DVec2, body: bool| match body {
        true => DVec2::from_angle(heading_rad(&uav)).rotate(v),
        false => v,
    };
    Ok(match wanted {
        Wanted::Takeoff if uav.status() == UavStatus::Landed => {
            let up_enu_m = r_enu_m + TAKEOFF_M * DVec3::Z;
            let (order, last) = path(vec![up_enu_m], 0.5 * TAKEOFF_M, Nose::Kept);
            (order, Until::There(last))
        }
        // It flies already.
        Wanted::Takeoff | Wanted::Hover => (still, Until::Still),
        Wanted::Land => {
            let order = FlyOrder {
                land: true,
                ..still
            };
            (order, Until::Landed)
        }
        Wanted::Home => {
            let (order, last) = path(vec![home_enu_m], FlyOrder::SPEED_MPS, Nose::Kept);
            (order, Until::There(last))
        }
        Wanted::Path(places, speed_mps, nose) => {
            let places = places.into_iter().map(|at| home_enu_m + swapped(at));
            let (order, last) = path(places.collect(), speed_mps, nose);
            (order, Until::There(last))
        }
        Wanted::Geo(at, speed_mps, nose) => {
            let at_enu_m = view.air().site().ecef_to_enu(at.to_ecef());
            let (order, last) = path(vec![at_enu_m], speed_mps, nose);
            (order, Until::There(last))
        }
        Wanted::Z(z, speed_mps, nose) => {
            let at_enu_m = DVec3::new(r_enu_m.x, r_enu_m.y, home_enu_m.z - z);
            let (order, last) = path(vec![at_enu_m], speed_mps, nose);
            (order, Until::Height(last.z))
        }
        Wanted::Velocity {
            v,
            body,
            duration_s,
            nose,
        } => {
            let v_enu_mps = swapped(turned(v.truncate(), body).extend(v.z));
            let order = FlyOrder {
                velocity_enu_mps: Some(v_enu_mps.to_array()),
                heading_deg: nose.heading_deg(v_enu_mps.truncate()),
                ..still
            };
            (order, Until::Time(t_s + duration_s))
        }
        Wanted::VelocityZ {
            v,
            z,
            body,
            duration_s,
            nose,
        } => {
            let v_enu_mps = swapped(turned(v, body).extend(0.0)).truncate();
            let heading_deg = nose.heading_deg(v_enu_mps);
            let order = FlyOrder {
                velocity_enu_mps: Some(v_enu_mps.extend(0.0).to_array()),
                heading_deg,
                ..still
            };
            let until = Until::HeldTime {
                end_s: t_s + duration_s,
                v_enu_mps,
                up_m: home_enu_m.z - z,
                heading_deg,
                next_s: t_s,
            };
            (order, until)
        }
        Wanted::Yaw(yaw_deg, margin_deg) => {
            let order = FlyOrder {
                heading_deg: Some(yaw_deg.rem_euclid(360.0)),
                ..still
            };
            let margin_rad = margin_deg.abs().max(0.1).to_radians();
            (order, Until::Heading(yaw_deg.to_radians(), margin_rad))
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_nose_looks_where_it_is_told() {
        assert_eq!(Nose::Kept.heading_deg(DVec2::X), None);
        assert_eq!(Nose::At(-90.0).heading_deg(DVec2::X), Some(270.0));
        // East is 90 degrees, and a bit off that.
        let ahead = |off, way| Nose::Ahead(off).heading_deg(way).unwrap();
        assert!((ahead(0.0, DVec2::X) - 90.0).abs() < 1e-9);
        assert!((ahead(10.0, -DVec2::X) - 280.0).abs() < 1e-9);
        assert_eq!(Nose::Ahead(0.0).heading_deg(DVec2::ZERO), None);
    }

    #[test]
    fn a_way_ahead_of_the_nose_is_turned_with_it() {
        // A nose to the east: ahead is east, right is south; north is x and east is y.
        let turned = DVec2::from_angle(std::f64::consts::FRAC_PI_2).rotate(DVec2::new(3.0, 1.0));
        assert!((turned - DVec2::new(-1.0, 3.0)).length() < 1e-12);
    }
}
