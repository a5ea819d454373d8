//! An autopilot in another program that flies a UAV, in lockstep: it is given sensors, and time waits for its throttles.

use super::address::Address;
use super::frames::Earth;
use super::rotors::{MOTORS, throttles};
use super::sensors::{self, Sensed};
use super::systems::of_uav;
use super::telemetry::Motion;
use crate::components::flight::UavStatus;
use crate::scenario::{FlyOrder, OrderConfig};
use crate::simulation::{UavView, View};
use glam::DVec3;
use mavlink::dialects::common::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavModeFlag, MavResult,
};
use mavlink::{MavHeader, MavlinkReader, error::MessageReadError};
use std::io::{self, Write as _};
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

/// The component that sensors are, MAV_COMP_ID_USER1.
const SENSORS: u8 = 25;
/// How often satellites are heard [Hz].
const GPS_HZ: u32 = 10;
/// How long a read waits at most: so soon a stop from outside is seen.
const NAP: Duration = Duration::from_millis(50);
/// The number of HIL_STATE_QUATERNION, for which an autopilot may ask.
const STATE: f32 = 115.0;

/// Why an autopilot flies no more.
#[derive(Debug, thiserror::Error)]
pub enum PilotError {
    /// It does not answer.
    #[error(
        "--hil {uav}: no HIL_ACTUATOR_CONTROLS of time {t_usec} µs within {deadline_s} s{last}; an autopilot answers each \
         HIL_SENSOR with its time, and --hil-deadline gives it longer"
    )]
    Silent {
        /// The UAV.
        uav: String,
        /// The time that was waited for.
        t_usec: u64,
        /// How long.
        deadline_s: f64,
        /// What came instead, in words.
        last: String,
    },
    /// It has left.
    #[error(
        "--hil {uav}: its autopilot has left at {t_s:.3} s ({source}); nobody flies the UAV any more"
    )]
    Left {
        /// The UAV.
        uav: String,
        /// Simulated time.
        t_s: f64,
        /// What the system said.
        source: io::Error,
    },
}

/// Why an autopilot's door is not opened.
pub(super) enum OpenError {
    /// Nothing can be had so, and the mend.
    Refused(String),
    /// The address.
    Address(io::Error),
}

/// How often an autopilot is asked, and how long it may take.
#[derive(Clone, Copy)]
pub(super) struct Rates {
    pub exchange_hz: u32,
    pub deadline: Duration,
}

/// A UAV that an autopilot can fly.
pub(super) struct Airborne {
    uav: String,
    index: usize,
}

impl Airborne {
    /// The UAV of a name, or why it cannot be flown.
    pub(super) fn found(name: &str, view: View) -> Result<Self, String> {
        let mut all = view.uavs().filter(|uav| uav.distractor().is_none());
        let Some(uav) = all.find(|uav| uav.name() == name) else {
            let names: Vec<&str> = view.uavs().map(|uav| uav.name()).collect();
            return Err(format!(
                "no UAV of this name: there are {}",
                names.join(", ")
            ));
        };
        match uav.rotors() {
            MOTORS => Ok(Self {
                uav: name.to_owned(),
                index: uav.index(),
            }),
            rotors => Err(format!(
                "has {rotors} rotors: throttles are mapped for {MOTORS} in X alone; give another model"
            )),
        }
    }
}

/// An autopilot's connection.
struct Connection {
    reader: MavlinkReader<TcpStream>,
    writes: TcpStream,
    sequence: u8,
}

impl Connection {
    fn new(stream: TcpStream) -> io::Result<Self> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(NAP))?;
        Ok(Self {
            writes: stream.try_clone()?,
            reader: MavlinkReader::new(stream),
            sequence: 0,
        })
    }

    fn send(&mut self, system: u8, messages: &[MavMessage]) -> io::Result<()> {
        let mut bytes = Vec::with_capacity(512);
        for message in messages {
            let header = MavHeader {
                system_id: system.into(),
                component_id: SENSORS,
                sequence: self.sequence,
            };
            self.sequence = self.sequence.wrapping_add(1);
            mavlink::write_v2_msg(&mut bytes, header, message).map_err(io::Error::other)?;
        }
        self.writes.write_all(&bytes)
    }

    /// The next message; none when none has come for a while.
    fn read(&mut self) -> io::Result<Option<(MavHeader, MavMessage)>> {
        match self.reader.read_any_message::<MavMessage>() {
            Ok(heard) => Ok(Some(heard)),
            // A message of another dialect, or noise.
            Err(MessageReadError::Parse(_)) => Ok(None),
            Err(MessageReadError::Io(error)) => match error.kind() {
                io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => Ok(None),
                _ => Err(error),
            },
        }
    }
}

/// How far an autopilot has the UAV.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Hands {
    /// It has not answered yet: time goes by the clock, for it may need time to start.
    Starts,
    /// It answers, but has not armed: the UAV flies its plan.
    Waits,
    /// It flies the UAV.
    Flies,
    /// The UAV flies no more.
    Over,
}

/// The autopilot of one UAV.
pub struct Pilot {
    airborne: Airborne,
    at: Address,
    listener: TcpListener,
    connection: Option<Connection>,
    earth: Earth,
    period_ticks: u64,
    gps_exchanges: u64,
    exchange: Duration,
    deadline: Duration,
    hands: Hands,
    v_enu_mps: DVec3,
    a_enu_mps2: DVec3,
    given: Option<[f64; MOTORS]>,
}

impl Pilot {
    /// Opens the door for an autopilot.
    pub(super) fn open(
        airborne: Airborne,
        address: Address,
        rates: Rates,
        earth: Earth,
        view: View,
    ) -> Result<Self, OpenError> {
        let (tick_hz, exchange_hz) = (view.tick_hz(), rates.exchange_hz);
        if !tick_hz.is_multiple_of(exchange_hz) {
            return Err(OpenError::Refused(format!(
                "--hil-rate {exchange_hz}: the scenario has {tick_hz} ticks a second; give a divisor of that"
            )));
        }
        let listener = TcpListener::bind(address.at).map_err(OpenError::Address)?;
        listener.set_nonblocking(true).map_err(OpenError::Address)?;
        let at = Address {
            at: listener.local_addr().map_err(OpenError::Address)?,
            ..address
        };
        let mut pilot = Self {
            airborne,
            at,
            listener,
            connection: None,
            earth,
            period_ticks: u64::from(tick_hz / exchange_hz),
            gps_exchanges: u64::from((exchange_hz / GPS_HZ).max(1)),
            exchange: Duration::from_secs_f64(1.0 / f64::from(exchange_hz)),
            deadline: rates.deadline,
            hands: Hands::Starts,
            v_enu_mps: DVec3::ZERO,
            a_enu_mps2: DVec3::ZERO,
            given: None,
        };
        if let Some(uav) = pilot.uav_of(view) {
            pilot.v_enu_mps = uav.v_enu_mps();
        }
        Ok(pilot)
    }

    /// The UAV's name.
    pub fn uav(&self) -> &str {
        &self.airborne.uav
    }

    /// Where its autopilot comes in, in words.
    pub fn address(&self) -> String {
        self.at.to_string()
    }

    fn uav_of<'a>(&self, view: View<'a>) -> Option<UavView<'a>> {
        view.uavs().nth(self.airborne.index)
    }

    /// Lets the autopilot in if it has come; whether it is there.
    pub fn join(&mut self) -> bool {
        if self.connection.is_none()
            && let Ok((stream, _)) = self.listener.accept()
        {
            // One that has gone again may come back.
            self.connection = Connection::new(stream).ok();
        }
        self.connection.is_some()
    }

    /// Notes how the UAV moved in the tick that has passed.
    pub fn note(&mut self, view: View) {
        let Some(uav) = self.uav_of(view) else { return };
        let v_enu_mps = uav.v_enu_mps();
        self.a_enu_mps2 = f64::from(view.tick_hz()) * (v_enu_mps - self.v_enu_mps);
        self.v_enu_mps = v_enu_mps;
    }

    /// Gives the autopilot its sensors, if that is due, and waits for its throttles; the order that they are, unless they
    /// are as before. `stopped` says that nobody wants to wait any more.
    pub fn exchange(
        &mut self,
        view: View,
        stopped: impl Fn() -> bool,
    ) -> Result<Option<OrderConfig>, PilotError> {
        let tick = view.tick();
        if !tick.is_multiple_of(self.period_ticks) || self.hands == Hands::Over {
            return Ok(None);
        }
        let Some(uav) = self.uav_of(view) else {
            return Ok(None);
        };
        if !matches!(uav.status(), UavStatus::Flying | UavStatus::Landed) {
            self.hands = Hands::Over;
            return Ok(None);
        }
        let sensed = Sensed {
            t_usec: (1e6 * view.t_s()).round() as u64,
            motion: Motion {
                r_enu_m: uav.r_enu_m(),
                v_enu_mps: uav.v_enu_mps(),
                q_enu_body: uav.q_enu_body(),
                rates_body_radps: uav.rates_body_radps(),
            },
            a_enu_mps2: self.a_enu_mps2,
            wind_enu_mps: uav.wind_enu_mps().unwrap_or_default(),
            temperature_k: view.air().weather().temperature_k,
        };
        let mut messages = vec![
            sensors::state(&self.earth, &sensed),
            sensors::sensor(&self.earth, &sensed),
        ];
        if (tick / self.period_ticks).is_multiple_of(self.gps_exchanges) {
            messages.insert(0, sensors::gps(&self.earth, &sensed));
        }
        let answer = self.ask(&messages, sensed.t_usec, stopped);
        let answer = answer.map_err(|error| match error {
            Fault::Silent(last) => PilotError::Silent {
                uav: self.airborne.uav.clone(),
                t_usec: sensed.t_usec,
                deadline_s: self.deadline.as_secs_f64(),
                last,
            },
            Fault::Left(source) => PilotError::Left {
                uav: self.airborne.uav.clone(),
                t_s: view.t_s(),
                source,
            },
        })?;
        Ok(answer.and_then(|answer| self.order(answer)))
    }

    /// Sends the sensors of a time and waits for the controls of the same. Nothing comes of an autopilot that still
    /// starts, after the time that has passed.
    fn ask(
        &mut self,
        messages: &[MavMessage],
        t_usec: u64,
        stopped: impl Fn() -> bool,
    ) -> Result<Option<Controls>, Fault> {
        let system = of_uav(self.airborne.index);
        let Some(connection) = &mut self.connection else {
            return Ok(None);
        };
        connection.send(system, messages).map_err(Fault::Left)?;
        let starts = self.hands == Hands::Starts;
        let longest = if starts { self.exchange } else { self.deadline };
        let until = Instant::now() + longest;
        let mut last = None;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return match starts {
                    true => Ok(None),
                    false => Err(Fault::Silent(last.map_or_else(String::new, |last: u64| {
                        format!("; the last were of {last} µs")
                    }))),
                };
            }
            if stopped() {
                return Ok(None);
            }
            let nap = left.min(NAP).max(Duration::from_millis(1));
            let timed = connection.writes.set_read_timeout(Some(nap));
            timed.map_err(Fault::Left)?;
            let heard = connection.read().map_err(Fault::Left)?;
            match heard {
                Some((_, MavMessage::HIL_ACTUATOR_CONTROLS(controls))) => {
                    if controls.time_usec == t_usec {
                        return Ok(Some(Controls {
                            armed: controls
                                .mode
                                .contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED),
                            throttles: throttles(&controls.controls),
                        }));
                    }
                    last = Some(controls.time_usec);
                }
                Some((from, MavMessage::COMMAND_LONG(command))) => {
                    let answer = acknowledged(from, &command);
                    connection.send(system, &[answer]).map_err(Fault::Left)?;
                }
                Some(_) | None => {}
            }
        }
    }

    /// The order that an answer is.
    fn order(&mut self, answer: Controls) -> Option<OrderConfig> {
        let flies = self.hands == Hands::Flies;
        self.hands = match flies || answer.armed {
            true => Hands::Flies,
            false => Hands::Waits,
        };
        if self.hands == Hands::Waits {
            return None;
        }
        let throttles = match answer.armed {
            true => answer.throttles,
            false => [0.0; MOTORS],
        };
        if self.given == Some(throttles) {
            return None;
        }
        self.given = Some(throttles);
        Some(OrderConfig {
            fly: Some(FlyOrder {
                uav: self.airborne.uav.clone(),
                rotors: Some(throttles.to_vec()),
                ..FlyOrder::default()
            }),
            ..OrderConfig::default()
        })
    }
}

/// What an autopilot answers.
struct Controls {
    armed: bool,
    throttles: [f64; MOTORS],
}

enum Fault {
    Silent(String),
    Left(io::Error),
}

/// What comes of an autopilot's command: it may ask for the truth at some rate, and has it at every exchange.
fn acknowledged(from: MavHeader, command: &COMMAND_LONG_DATA) -> MavMessage {
    let truth = command.command == MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL && command.param1 == STATE;
    MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
        command: command.command,
        result: match truth {
            true => MavResult::MAV_RESULT_ACCEPTED,
            false => MavResult::MAV_RESULT_UNSUPPORTED,
        },
        target_system: u8::try_from(from.system_id).unwrap_or(0),
        target_component: from.component_id,
        ..COMMAND_ACK_DATA::DEFAULT
    })
}
