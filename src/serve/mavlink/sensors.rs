//! What an autopilot measures, without noise: inertial sensors, compass, pressure, satellites, and the truth beside them.

use super::frames::{Earth, attitude, centi, compass, frd, ned};
use super::telemetry::Motion;
use crate::models::air::atmosphere::pressure_at_pa;
use crate::models::maths::kinematics::GRAVITY_MPS2;
use glam::{DQuat, DVec3};
use mavlink::dialects::common::{
    HIL_GPS_DATA, HIL_SENSOR_DATA, HIL_STATE_QUATERNION_DATA, HilSensorUpdatedFlags, MavMessage,
};

/// Pressure at sea level, and density there \[Pa\], \[kg/m³\] (ISA): what an autopilot makes heights and speeds of.
const SEA_LEVEL_PA: f64 = 101_325.0;
const SEA_LEVEL_KGPM3: f64 = 1.225;
/// Radius of the Earth for its field \[m\], and the field's dipole along ECEF's axes \[nT\]: g11, h11, g10 of IGRF-13 for 2020.
const FIELD_RADIUS_M: f64 = 6_371_200.0;
const DIPOLE_NT: DVec3 = DVec3::new(-1_450.9, 4_652.5, -29_404.8);
/// Gauss in a nanotesla.
const GAUSS_PER_NT: f64 = 1e-5;
/// What a receiver says of itself: a 3D fix of so many satellites, and its dilutions of precision [1/100].
const FIX: u8 = 3;
const SATELLITES: u8 = 12;
const DILUTION: u16 = 70;

/// All that sensors need of a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sensed {
    pub t_usec: u64,
    pub motion: Motion,
    /// Acceleration of the body over the last tick \[m/s²\].
    pub a_enu_mps2: DVec3,
    /// The wind that it meets [m/s].
    pub wind_enu_mps: DVec3,
    /// Temperature of the air [K].
    pub temperature_k: f64,
}

impl Sensed {
    /// A vector of the site in forward-right-down.
    fn body(&self, enu: DVec3) -> DVec3 {
        frd(self.motion.q_enu_body.inverse() * enu)
    }

    /// What accelerometers feel [m/s²]: acceleration without gravity.
    fn specific_force(&self) -> DVec3 {
        self.body(self.a_enu_mps2 + GRAVITY_MPS2 * DVec3::Z)
    }

    /// Speed through the air along the nose, and in all [m/s].
    fn airspeed_mps(&self) -> [f64; 2] {
        let flow = self.motion.v_enu_mps - self.wind_enu_mps;
        [self.body(flow).x.max(0.0), flow.length()]
    }
}

/// The Earth's field at a place, east, north, up [G]: that of a dipole at the Earth's centre. Its declination
/// misses the true one by up to some 20 degrees in Europe, its strength by about a tenth.
fn field_enu_gauss(earth: &Earth, r_enu_m: DVec3) -> DVec3 {
    let r_ecef_m = earth.site().enu_to_ecef(r_enu_m);
    let up = r_ecef_m.normalize_or(DVec3::Z);
    let nearer = (FIELD_RADIUS_M / r_ecef_m.length()).powi(3);
    let ecef_nt = nearer * (3.0 * DIPOLE_NT.dot(up) * up - DIPOLE_NT);
    let q_enu_ecef: DQuat = earth.site().q_ecef_enu().inverse();
    GAUSS_PER_NT * (q_enu_ecef * ecef_nt)
}

/// HIL_SENSOR.
pub(super) fn sensor(earth: &Earth, sensed: &Sensed) -> MavMessage {
    let single = |v: DVec3| v.to_array().map(|x| x as f32);
    let [xacc, yacc, zacc] = single(sensed.specific_force());
    let [xgyro, ygyro, zgyro] = single(frd(sensed.motion.rates_body_radps));
    let field = field_enu_gauss(earth, sensed.motion.r_enu_m);
    let [xmag, ymag, zmag] = single(sensed.body(field));
    let height_m = earth.height_m(sensed.motion.r_enu_m);
    let hectopascal = |pa: f64| (1e-2 * pa) as f32;
    let [nose_mps, _] = sensed.airspeed_mps();
    MavMessage::HIL_SENSOR(HIL_SENSOR_DATA {
        time_usec: sensed.t_usec,
        xacc,
        yacc,
        zacc,
        xgyro,
        ygyro,
        zgyro,
        xmag,
        ymag,
        zmag,
        abs_pressure: hectopascal(pressure_at_pa(SEA_LEVEL_PA, height_m)),
        diff_pressure: hectopascal(0.5 * SEA_LEVEL_KGPM3 * nose_mps.powi(2)),
        pressure_alt: height_m as f32,
        temperature: (sensed.temperature_k - 273.15) as f32,
        // All but the reset.
        fields_updated: HilSensorUpdatedFlags::from_bits_retain(0x1fff),
        ..HIL_SENSOR_DATA::DEFAULT
    })
}

/// HIL_GPS.
pub(super) fn gps(earth: &Earth, sensed: &Sensed) -> MavMessage {
    let Motion {
        r_enu_m, v_enu_mps, ..
    } = sensed.motion;
    let at = earth.global(r_enu_m);
    let [vn, ve, vd] = ned(v_enu_mps).to_array().map(centi);
    let over_ground = v_enu_mps.truncate();
    MavMessage::HIL_GPS(HIL_GPS_DATA {
        time_usec: sensed.t_usec,
        lat: at.lat,
        lon: at.lon,
        alt: at.alt,
        eph: DILUTION,
        epv: DILUTION,
        vel: (1e2 * over_ground.length()).round() as u16,
        vn,
        ve,
        vd,
        cog: compass(over_ground.x.atan2(over_ground.y)),
        fix_type: FIX,
        satellites_visible: SATELLITES,
        ..HIL_GPS_DATA::DEFAULT
    })
}

/// HIL_STATE_QUATERNION: the truth.
pub(super) fn state(earth: &Earth, sensed: &Sensed) -> MavMessage {
    let motion = &sensed.motion;
    let at = earth.global(motion.r_enu_m);
    let [vx, vy, vz] = ned(motion.v_enu_mps).to_array().map(centi);
    let rates = frd(motion.rates_body_radps).to_array();
    let [rollspeed, pitchspeed, yawspeed] = rates.map(|x| x as f32);
    let milli_g = |x: f64| (1e3 * x / GRAVITY_MPS2).round() as i16;
    let [xacc, yacc, zacc] = sensed.body(sensed.a_enu_mps2).to_array().map(milli_g);
    let [ind_airspeed, true_airspeed] = sensed.airspeed_mps().map(|mps| (1e2 * mps).round() as u16);
    MavMessage::HIL_STATE_QUATERNION(HIL_STATE_QUATERNION_DATA {
        time_usec: sensed.t_usec,
        attitude_quaternion: attitude(motion.q_enu_body),
        rollspeed,
        pitchspeed,
        yawspeed,
        lat: at.lat,
        lon: at.lon,
        alt: at.alt,
        vx,
        vy,
        vz,
        ind_airspeed,
        true_airspeed,
        xacc,
        yacc,
        zacc,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::maths::geodesy::Geodetic;

    fn earth(latitude_deg: f64, longitude_deg: f64) -> Earth {
        Earth::about(Geodetic {
            latitude_rad: latitude_deg.to_radians(),
            longitude_rad: longitude_deg.to_radians(),
            height_m: 500.0,
        })
    }

    fn at_rest() -> Sensed {
        Sensed {
            t_usec: 4_000,
            motion: Motion {
                r_enu_m: DVec3::ZERO,
                v_enu_mps: DVec3::ZERO,
                q_enu_body: DQuat::IDENTITY,
                rates_body_radps: DVec3::ZERO,
            },
            a_enu_mps2: DVec3::ZERO,
            wind_enu_mps: DVec3::ZERO,
            temperature_k: 288.15,
        }
    }

    fn sensed(earth: &Earth, at: &Sensed) -> HIL_SENSOR_DATA {
        let MavMessage::HIL_SENSOR(sensor) = sensor(earth, at) else {
            panic!()
        };
        sensor
    }

    #[test]
    fn at_rest_the_ground_pushes_up_and_in_free_fall_nothing_does() {
        let earth = earth(47.0, 8.0);
        let rest = sensed(&earth, &at_rest());
        assert_eq!([rest.xacc, rest.yacc], [0.0, 0.0]);
        assert!((rest.zacc + GRAVITY_MPS2 as f32).abs() < 1e-5);
        let falls = Sensed {
            a_enu_mps2: -GRAVITY_MPS2 * DVec3::Z,
            ..at_rest()
        };
        assert_eq!(sensed(&earth, &falls).zacc, 0.0);
        // Rolled to the right by a quarter turn, up is to the left.
        let mut rolled = at_rest();
        rolled.motion.q_enu_body = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
        assert!((sensed(&earth, &rolled).yacc + GRAVITY_MPS2 as f32).abs() < 1e-5);
    }

    #[test]
    fn pressure_is_that_of_the_standard_atmosphere() {
        let earth = earth(47.0, 8.0);
        let mut high = at_rest();
        high.motion.r_enu_m.z = 1_000.0 - earth.height_m(DVec3::ZERO);
        let sensor = sensed(&earth, &high);
        assert!((sensor.pressure_alt - 1_000.0).abs() < 0.01);
        // ISA: 898.76 hPa at 1,000 m.
        assert!(
            (sensor.abs_pressure - 898.76).abs() < 0.2,
            "{}",
            sensor.abs_pressure
        );
    }

    #[test]
    fn the_field_of_a_dipole_dips_with_magnetic_latitude() {
        // Over the dipole's own northern pole it stands straight down, twice as strong as at its equator.
        let north = -DIPOLE_NT.normalize();
        let pole = earth(
            north.z.asin().to_degrees(),
            north.y.atan2(north.x).to_degrees(),
        );
        let at_pole = field_enu_gauss(&pole, DVec3::ZERO);
        assert!(
            at_pole.truncate().length() < 0.01 && at_pole.z < -0.58,
            "{at_pole}"
        );
        let equator = earth(0.0, (north.y.atan2(north.x)).to_degrees() + 90.0);
        let at_equator = field_enu_gauss(&equator, DVec3::ZERO);
        assert!((at_pole.length() / at_equator.length() - 2.0).abs() < 0.02);
        // At Zürich a needle points along the great circle to that pole, by spherical trigonometry, and dips by
        // tan(dip) = 2 tan(magnetic latitude), seen from a sphere's centre.
        let [lat, lon] = [47.4_f64, 8.5].map(f64::to_radians);
        let here = field_enu_gauss(&earth(47.4, 8.5), DVec3::ZERO);
        let (pole_lat, away) = (north.z.asin(), north.y.atan2(north.x) - lon);
        let east = away.sin() * pole_lat.cos();
        let ahead = lat.cos() * pole_lat.sin() - lat.sin() * pole_lat.cos() * away.cos();
        let declination = here.x.atan2(here.y).to_degrees();
        assert!(
            (declination - east.atan2(ahead).to_degrees()).abs() < 0.5,
            "{declination}"
        );
        let sine = lat.sin() * pole_lat.sin() + lat.cos() * pole_lat.cos() * away.cos();
        let dip = (-here.z).atan2(here.truncate().length()).to_degrees();
        let wanted = (2.0 * sine.asin().tan()).atan().to_degrees();
        assert!((dip - wanted).abs() < 0.5, "{dip}");
        assert!((0.42..0.52).contains(&here.length()), "{here}");
    }

    #[test]
    fn satellites_and_truth_say_the_same_place() {
        let earth = earth(47.0, 8.0);
        let mut moves = at_rest();
        moves.motion.r_enu_m = DVec3::new(30.0, 40.0, 50.0);
        moves.motion.v_enu_mps = DVec3::new(3.0, 4.0, -1.0);
        let (MavMessage::HIL_GPS(gps), MavMessage::HIL_STATE_QUATERNION(state)) =
            (gps(&earth, &moves), state(&earth, &moves))
        else {
            panic!()
        };
        assert_eq!(
            (gps.lat, gps.lon, gps.alt),
            (state.lat, state.lon, state.alt)
        );
        assert_eq!([gps.vn, gps.ve, gps.vd], [400, 300, 100]);
        assert_eq!((gps.vel, gps.cog), (500, 3_687));
        assert_eq!([state.vx, state.vy, state.vz], [400, 300, 100]);
        assert_eq!(state.true_airspeed, 510);
    }
}
