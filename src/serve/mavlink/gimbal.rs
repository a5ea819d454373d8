//! A station's mount as MAVLink's gimbal protocol v2 has it: who is in control, and what is wanted.

use super::telemetry::GIMBAL;
use crate::scenario::{DriveOrder, OrderConfig};
use mavlink::dialects::common::{GIMBAL_MANAGER_SET_PITCHYAW_DATA, GimbalManagerFlags as Flags};

/// Flags that say of roll, pitch and yaw what holds here in any case: relative to the horizon and to north.
const NATURAL: Flags = Flags::GIMBAL_MANAGER_FLAGS_ROLL_LOCK
    .union(Flags::GIMBAL_MANAGER_FLAGS_PITCH_LOCK)
    .union(Flags::GIMBAL_MANAGER_FLAGS_YAW_LOCK)
    .union(Flags::GIMBAL_MANAGER_FLAGS_YAW_IN_VEHICLE_FRAME)
    .union(Flags::GIMBAL_MANAGER_FLAGS_YAW_IN_EARTH_FRAME)
    .union(Flags::GIMBAL_MANAGER_FLAGS_ACCEPTS_YAW_IN_EARTH_FRAME);
/// Parameters of MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE: as it is, to the sender, away from the sender.
const AS_IT_IS: f32 = -1.0;
const TO_SENDER: f32 = -2.0;
const FROM_SENDER: f32 = -3.0;

/// What is wanted of pitch and yaw; NaN is nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setpoint {
    pub pitch_deg: f64,
    pub yaw_deg: f64,
    pub pitch_rate_degps: f64,
    pub yaw_rate_degps: f64,
    /// As GIMBAL_MANAGER_FLAGS has them.
    pub flags: u32,
    /// The device that is meant: 0 for all, or [`GIMBAL`].
    pub device: u8,
}

impl Setpoint {
    /// That of the parameters of MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW.
    pub(super) fn of_command(params: [f32; 7]) -> Self {
        let [pitch, yaw, pitch_rate, yaw_rate, flags, _, device] = params;
        Self {
            pitch_deg: pitch.into(),
            yaw_deg: yaw.into(),
            pitch_rate_degps: pitch_rate.into(),
            yaw_rate_degps: yaw_rate.into(),
            flags: whole(flags).unwrap_or(u32::MAX),
            device: whole(device)
                .and_then(|id| u8::try_from(id).ok())
                .unwrap_or(u8::MAX),
        }
    }

    /// That of GIMBAL_MANAGER_SET_PITCHYAW.
    pub(super) fn of_message(message: &GIMBAL_MANAGER_SET_PITCHYAW_DATA) -> Self {
        let deg = |rad: f32| f64::from(rad).to_degrees();
        Self {
            pitch_deg: deg(message.pitch),
            yaw_deg: deg(message.yaw),
            pitch_rate_degps: deg(message.pitch_rate),
            yaw_rate_degps: deg(message.yaw_rate),
            flags: message.flags.bits(),
            device: message.gimbal_device_id,
        }
    }

    /// What it asks of a mount that looks to azimuth and elevation `now_deg`, or why it cannot be had.
    fn wish(&self, now_deg: [f64; 2]) -> Result<Wish, String> {
        if ![0, GIMBAL].contains(&self.device) {
            return Err(format!("gimbal {}: here is {GIMBAL}", self.device));
        }
        let flags = Flags::from_bits_retain(self.flags);
        if !NATURAL.contains(flags) {
            return Err("of the flags only locks and frames".to_owned());
        }
        let angles = [self.yaw_deg, self.pitch_deg];
        let rates = [self.yaw_rate_degps, self.pitch_rate_degps];
        let given = |of: [f64; 2]| of.iter().any(|x| !x.is_nan());
        if [angles, rates].iter().flatten().any(|x| x.is_infinite()) {
            return Err("an angle or rate is infinite".to_owned());
        }
        let moves = rates.iter().any(|rate| !rate.is_nan() && *rate != 0.0);
        match (given(angles), given(rates)) {
            (true, _) if moves => Err("give angles or rates, not both".to_owned()),
            (true, _) => {
                // What is not given stays.
                let or = |x: f64, now: f64| if x.is_nan() { now } else { x };
                Ok(Wish::Slew([
                    or(angles[0], now_deg[0]),
                    or(angles[1], now_deg[1]),
                ]))
            }
            (false, true) => {
                let or_still = |x: f64| if x.is_nan() { 0.0 } else { x };
                Ok(Wish::Drive(rates.map(or_still)))
            }
            (false, false) => Err("gives neither angle nor rate".to_owned()),
        }
    }
}

/// A number that counts or flags.
fn whole(x: f32) -> Option<u32> {
    // Absent parameters are 0 or NaN.
    let x = if x.is_nan() { 0.0 } else { f64::from(x) };
    ((0.0..=f64::from(u32::MAX)).contains(&x) && x.fract() == 0.0).then_some(x as u32)
}

/// What is asked of a mount: azimuth and elevation.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wish {
    /// To turn to these angles [deg].
    Slew([f64; 2]),
    /// To turn at these rates [deg/s].
    Drive([f64; 2]),
}

/// System and component of one who commands.
pub(super) type Sender = (u8, u8);

/// The gimbal of one station.
pub(super) struct Gimbal {
    station: String,
    control: Option<Sender>,
    /// Whether rates drive it.
    driven: bool,
}

impl Gimbal {
    /// That of the station of a name, with nobody in control.
    pub(super) fn new(station: &str) -> Self {
        Self {
            station: station.to_owned(),
            control: None,
            driven: false,
        }
    }

    /// Who is in control.
    pub(super) fn control(&self) -> Option<Sender> {
        self.control
    }

    fn order(&self) -> OrderConfig {
        OrderConfig {
            station: Some(self.station.clone()),
            ..OrderConfig::default()
        }
    }

    fn drive(&mut self, rates_degps: Option<[f64; 2]>) -> OrderConfig {
        self.driven = rates_degps.is_some();
        OrderConfig {
            drive: Some(DriveOrder {
                rates_degps,
                mirror_urad: None,
            }),
            ..self.order()
        }
    }

    /// Orders by which the mount does what one wants of it; who commands while nobody is in control takes it.
    pub(super) fn turn(
        &mut self,
        sender: Sender,
        setpoint: &Setpoint,
        now_deg: [f64; 2],
    ) -> Result<Vec<OrderConfig>, String> {
        if let Some((system, component)) = self.control.filter(|other| *other != sender) {
            return Err(format!("{system}/{component} is in control"));
        }
        let wish = setpoint.wish(now_deg)?;
        self.control = Some(sender);
        Ok(match wish {
            Wish::Drive(rates_degps) => vec![self.drive(Some(rates_degps))],
            Wish::Slew(slew_deg) => {
                let law = self.driven.then(|| self.drive(None));
                let slew = OrderConfig {
                    slew_deg: Some(slew_deg),
                    ..self.order()
                };
                law.into_iter().chain([slew]).collect()
            }
        })
    }

    /// Gives control to who asks for it, or takes it from who gives it up (MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE), and the
    /// orders that follow: without anybody in control the choice is the tracker's.
    pub(super) fn configure(
        &mut self,
        sender: Sender,
        params: [f32; 7],
    ) -> Result<Vec<OrderConfig>, String> {
        let [system, component] = [params[0], params[1]];
        if system == AS_IT_IS {
            return Ok(Vec::new());
        }
        if system == TO_SENDER {
            self.control = Some(sender);
            return Ok(Vec::new());
        }
        if system == FROM_SENDER {
            return Ok(match self.control == Some(sender) {
                true => self.release(),
                false => Vec::new(),
            });
        }
        let [Some(system), Some(component)] =
            [system, component].map(|id| whole(id).and_then(|id| u8::try_from(id).ok()))
        else {
            return Err("no system and component are of these numbers".to_owned());
        };
        if system == 0 {
            return Ok(self.release());
        }
        self.control = Some((system, component));
        Ok(Vec::new())
    }

    fn release(&mut self) -> Vec<OrderConfig> {
        self.control = None;
        let law = self.driven.then(|| self.drive(None));
        law.into_iter().chain([self.order()]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NONE: f32 = f32::NAN;
    const NOW_DEG: [f64; 2] = [315.0, 10.0];
    const QGC: Sender = (255, 190);

    fn turned(gimbal: &mut Gimbal, params: [f32; 7]) -> Result<Vec<OrderConfig>, String> {
        gimbal.turn(QGC, &Setpoint::of_command(params), NOW_DEG)
    }

    #[test]
    fn rates_drive_and_angles_slew() {
        let mut gimbal = Gimbal::new("north");
        let orders = turned(&mut gimbal, [NONE, NONE, 1.5, -2.0, 0.0, 0.0, 0.0]).unwrap();
        let [drive] = &orders[..] else { panic!() };
        assert_eq!(drive.station.as_deref(), Some("north"));
        assert_eq!(drive.drive.unwrap().rates_degps, Some([-2.0, 1.5]));
        // One rate alone leaves the other axis still.
        let orders = turned(&mut gimbal, [NONE, NONE, NONE, 4.0, 16.0, 0.0, 154.0]).unwrap();
        assert_eq!(orders[0].drive.unwrap().rates_degps, Some([4.0, 0.0]));
        // An angle ends the rates; what is not given of it stays.
        let orders = turned(&mut gimbal, [20.0, NONE, NONE, NONE, 0.0, 0.0, 0.0]).unwrap();
        let [law, slew] = &orders[..] else { panic!() };
        assert_eq!(law.drive, Some(DriveOrder::default()));
        assert_eq!(slew.slew_deg, Some([315.0, 20.0]));
        let orders = turned(&mut gimbal, [20.0, -30.0, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
        let [slew] = &orders[..] else { panic!() };
        assert_eq!(slew.slew_deg, Some([-30.0, 20.0]));
    }

    #[test]
    fn radians_of_the_message_are_degrees_of_the_command() {
        let message = GIMBAL_MANAGER_SET_PITCHYAW_DATA {
            pitch: NONE,
            yaw: NONE,
            pitch_rate: 0.1,
            yaw_rate: NONE,
            ..GIMBAL_MANAGER_SET_PITCHYAW_DATA::DEFAULT
        };
        let mut setpoint = Setpoint::of_message(&message);
        setpoint.flags = 0;
        let wish = setpoint.wish(NOW_DEG).unwrap();
        let Wish::Drive([azimuth, elevation]) = wish else {
            panic!()
        };
        assert!(azimuth == 0.0 && (elevation - 5.729_578).abs() < 1e-5);
    }

    #[test]
    fn what_cannot_be_had_is_refused_in_words() {
        let mut gimbal = Gimbal::new("north");
        for (params, named) in [
            ([NONE; 7], "neither"),
            ([1.0, 2.0, 3.0, NONE, 0.0, 0.0, 0.0], "not both"),
            ([1.0, 2.0, NONE, NONE, 1.0, 0.0, 0.0], "flags"),
            ([1.0, 2.0, NONE, NONE, 256.0, 0.0, 0.0], "flags"),
            ([1.0, 2.0, NONE, NONE, 0.0, 0.0, 1.0], "gimbal 1"),
            ([f32::INFINITY, 2.0, NONE, NONE, 0.0, 0.0, 0.0], "infinite"),
        ] {
            let error = turned(&mut gimbal, params).unwrap_err();
            assert!(error.contains(named), "{params:?}: {error}");
        }
        assert_eq!(gimbal.control(), None);
    }

    #[test]
    fn one_is_in_control_at_a_time() {
        let mut gimbal = Gimbal::new("north");
        let rates = [NONE, NONE, 1.0, 1.0, 0.0, 0.0, 0.0];
        turned(&mut gimbal, rates).unwrap();
        assert_eq!(gimbal.control(), Some(QGC));
        let other = (254, 1);
        let setpoint = Setpoint::of_command(rates);
        let error = gimbal.turn(other, &setpoint, NOW_DEG).unwrap_err();
        assert!(error.contains("255/190 is in control"), "{error}");
        let configure = |system: f32| [system, 0.0, -1.0, -1.0, 0.0, 0.0, 0.0];
        // Who is not in control gives nothing up.
        assert_eq!(gimbal.configure(other, configure(-3.0)), Ok(vec![]));
        assert_eq!(gimbal.control(), Some(QGC));
        gimbal.configure(other, configure(-2.0)).unwrap();
        assert!(gimbal.turn(other, &setpoint, NOW_DEG).is_ok());
        let orders = gimbal.configure(other, configure(-3.0)).unwrap();
        assert_eq!(gimbal.control(), None);
        // The law has the mount again, and the tracker the choice.
        assert_eq!(orders[0].drive, Some(DriveOrder::default()));
        assert_eq!(orders[1], gimbal.order());
        assert!(gimbal.configure(other, configure(1e9)).is_err());
    }
}
