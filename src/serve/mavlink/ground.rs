//! Ground stations: what they are told of a run, and what they want of it.

use super::frames::Earth;
use super::gimbal::{Gimbal, Sender, Setpoint};
use super::link::{Heard, Link};
use super::systems::{FIRST_STATION, of_station, of_uav};
use super::telemetry::{self, AUTOPILOT, GIMBAL, Motion};
use crate::scenario::{OrderConfig, Scenario};
use crate::simulation::{StationView, UavView, View};
use glam::{DQuat, DVec3};
use mavlink::dialects::common::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult, MavSeverity,
    STATUSTEXT_DATA,
};
use mavlink::{MavHeader, Message as _};
use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

/// How often things are told, by simulated time [Hz].
const HEARTBEAT_HZ: u32 = 1;
const POSITION_HZ: u32 = 10;
const ATTITUDE_HZ: u32 = 20;
const GIMBAL_HZ: u32 = 10;
/// While time stands, heartbeats go by the clock.
const BEAT: Duration = Duration::from_secs(1);
/// Messages that are heard between two ticks at most.
const MOST_HEARD: usize = 64;
/// What STATUSTEXT holds [byte].
const TEXT_BYTES: usize = 50;
/// Numbers of the messages that can be asked for.
const MANAGER_INFORMATION: f32 = 280.0;
const MANAGER_STATUS: f32 = 281.0;

/// The ground stations of a run.
pub struct Ground {
    link: Link,
    earth: Earth,
    gimbals: Vec<Gimbal>,
    elevation_limits_deg: Vec<[f64; 2]>,
    uavs: usize,
    /// Sequence number of the next message of a system's component.
    sequences: BTreeMap<(u8, u8), u8>,
    beaten: Option<Instant>,
    had_any: bool,
    /// Messages that ask for what is not offered, by their names.
    unknown: BTreeSet<&'static str>,
}

/// Something that is wanted of a station, for which orders must be given.
pub struct Asked {
    station: usize,
    sender: Sender,
    command: Option<MavCmd>,
    /// The orders, or why there are none.
    pub orders: Result<Vec<OrderConfig>, String>,
}

impl Ground {
    pub(super) fn new(link: Link, view: View, scenario: &Scenario) -> Self {
        let stations = scenario.stations();
        Self {
            link,
            earth: Earth::about(scenario.site.geodetic()),
            gimbals: view
                .stations()
                .map(|station| Gimbal::new(station.name()))
                .collect(),
            elevation_limits_deg: (stations.iter())
                .map(|station| station.config.mount.elevation_limits_deg)
                .collect(),
            uavs: scenario.uavs.len(),
            sequences: BTreeMap::new(),
            beaten: None,
            had_any: false,
            unknown: BTreeSet::new(),
        }
    }

    /// Where it is spoken, in words.
    pub(super) fn address(&self) -> String {
        self.link.address().to_string()
    }

    /// Whether anybody has ever been heard.
    pub(super) fn had_any(&self) -> bool {
        self.had_any
    }

    /// What went wrong, in words; none where nothing did.
    pub fn told(&self) -> Option<String> {
        self.link.counts().told()
    }

    fn send(&mut self, system: u8, component: u8, message: &MavMessage) {
        let next = self.sequences.entry((system, component)).or_default();
        let header = MavHeader {
            system_id: system.into(),
            component_id: component,
            sequence: *next,
        };
        *next = next.wrapping_add(1);
        self.link.send(header, message);
    }

    /// Tells what is due after a tick.
    pub(super) fn tell(&mut self, view: View) {
        let due = |rate_hz: u32| {
            let ticks = (f64::from(view.tick_hz()) / f64::from(rate_hz)).round();
            view.tick().is_multiple_of((ticks as u64).max(1))
        };
        let (positions, attitudes) = (due(POSITION_HZ), due(ATTITUDE_HZ));
        if due(HEARTBEAT_HZ) {
            self.beat(view);
        }
        let t_s = view.t_s();
        for uav in flown(view).filter(|_| positions || attitudes) {
            let (system, motion) = (of_uav(uav.index()), motion(&uav));
            if positions {
                let height_m = view.air().height_agl_m(motion.r_enu_m);
                let global = telemetry::global_position(&self.earth, &motion, height_m, t_s);
                self.send(system, AUTOPILOT, &global);
                self.send(system, AUTOPILOT, &telemetry::local_position(&motion, t_s));
            }
            if attitudes {
                self.send(system, AUTOPILOT, &telemetry::uav_attitude(&motion, t_s));
            }
        }
        if due(GIMBAL_HZ) {
            for station in view.stations() {
                let mount = station.mount();
                let [looks, turns] = [mount.measured_az_el_rad, mount.measured_rates_radps];
                let status = telemetry::device_status(looks, turns, t_s);
                self.send(of_station(station.index()), GIMBAL, &status);
            }
        }
    }

    /// Tells who is there.
    fn beat(&mut self, view: View) {
        self.beaten = Some(Instant::now());
        for uav in flown(view) {
            let beat = telemetry::uav_heartbeat(uav.rotors(), uav.status());
            self.send(of_uav(uav.index()), AUTOPILOT, &beat);
        }
        let t_s = view.t_s();
        for station in view.stations() {
            let system = of_station(station.index());
            self.send(system, GIMBAL, &telemetry::gimbal_heartbeat());
            let control = self.gimbals.get(station.index()).and_then(Gimbal::control);
            self.send(system, GIMBAL, &telemetry::manager_status(control, t_s));
            let motion = standing(&station);
            let height_m = view.air().height_agl_m(motion.r_enu_m);
            let place = telemetry::global_position(&self.earth, &motion, height_m, t_s);
            self.send(system, GIMBAL, &place);
        }
    }

    /// What is wanted of stations since the last call; what needs no order is answered at once. Lines that tell of what is
    /// not offered are added to `said`.
    pub fn hear(&mut self, view: View, said: &mut Vec<String>) -> Vec<Asked> {
        if self.beaten.is_none_or(|beaten| beaten.elapsed() >= BEAT) {
            self.beat(view);
        }
        let mut asked = Vec::new();
        for _ in 0..MOST_HEARD {
            let Some(heard) = self.link.hear() else { break };
            self.had_any = true;
            asked.extend(self.take(view, heard, said));
        }
        asked
    }

    fn take(
        &mut self,
        view: View,
        (header, message): Heard,
        said: &mut Vec<String>,
    ) -> Option<Asked> {
        let sender = (u8::try_from(header.system_id).ok()?, header.component_id);
        match &message {
            MavMessage::HEARTBEAT(_) => None,
            MavMessage::COMMAND_LONG(command) => self.command(view, sender, command),
            MavMessage::COMMAND_INT(command) => {
                let long = COMMAND_LONG_DATA {
                    param1: command.param1,
                    param2: command.param2,
                    param3: command.param3,
                    param4: command.param4,
                    param5: command.x as f32,
                    param6: command.y as f32,
                    param7: command.z,
                    command: command.command,
                    target_system: command.target_system,
                    target_component: command.target_component,
                    confirmation: 0,
                };
                self.command(view, sender, &long)
            }
            MavMessage::GIMBAL_MANAGER_SET_PITCHYAW(wanted) => {
                let station = self.station(wanted.target_system, wanted.target_component)?;
                let setpoint = Setpoint::of_message(wanted);
                let orders = self.turn(view, station, sender, &setpoint)?;
                Some(Asked {
                    station,
                    sender,
                    command: None,
                    orders,
                })
            }
            other => {
                let name = other.message_name();
                if self.unknown.insert(name) {
                    said.push(format!(
                        "mavlink: {name} of system {}: is not offered",
                        sender.0
                    ));
                }
                None
            }
        }
    }

    /// The station that a message is for; one for all is for the first.
    fn station(&self, system: u8, component: u8) -> Option<usize> {
        let meant = [0, GIMBAL].contains(&component);
        let index = match system {
            0 => 0,
            system => usize::from(system.checked_sub(FIRST_STATION)?),
        };
        (meant && index < self.gimbals.len()).then_some(index)
    }

    fn turn(
        &mut self,
        view: View,
        station: usize,
        sender: Sender,
        setpoint: &Setpoint,
    ) -> Option<Result<Vec<OrderConfig>, String>> {
        let now = view.stations().nth(station)?.mount().measured_az_el_rad;
        let now_deg = now.to_array().map(f64::to_degrees);
        Some(
            self.gimbals
                .get_mut(station)?
                .turn(sender, setpoint, now_deg),
        )
    }

    fn command(&mut self, view: View, sender: Sender, wanted: &COMMAND_LONG_DATA) -> Option<Asked> {
        let COMMAND_LONG_DATA {
            param1,
            param2,
            param3,
            param4,
            param5,
            param6,
            param7,
            command,
            ..
        } = *wanted;
        let params = [param1, param2, param3, param4, param5, param6, param7];
        let Some(station) = self.station(wanted.target_system, wanted.target_component) else {
            // UAVs are flown by the scenario, or by an autopilot of their own.
            let uav = usize::from(wanted.target_system);
            if (1..=self.uavs).contains(&uav) {
                let unsupported = MavResult::MAV_RESULT_UNSUPPORTED;
                self.acknowledge(
                    (wanted.target_system, AUTOPILOT),
                    sender,
                    command,
                    unsupported,
                );
            }
            return None;
        };
        let from = (of_station(station), GIMBAL);
        let orders = match command {
            MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW => {
                self.turn(view, station, sender, &Setpoint::of_command(params))?
            }
            MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE => {
                self.gimbals.get_mut(station)?.configure(sender, params)
            }
            MavCmd::MAV_CMD_REQUEST_MESSAGE
                if [MANAGER_INFORMATION, MANAGER_STATUS].contains(&param1) =>
            {
                self.acknowledge(from, sender, command, MavResult::MAV_RESULT_ACCEPTED);
                let message = match param1 == MANAGER_INFORMATION {
                    true => {
                        let limits = *self.elevation_limits_deg.get(station)?;
                        telemetry::manager_information(limits, view.t_s())
                    }
                    false => {
                        let control = self.gimbals.get(station)?.control();
                        telemetry::manager_status(control, view.t_s())
                    }
                };
                self.send(from.0, from.1, &message);
                return None;
            }
            _ => {
                self.acknowledge(from, sender, command, MavResult::MAV_RESULT_UNSUPPORTED);
                return None;
            }
        };
        Some(Asked {
            station,
            sender,
            command: Some(command),
            orders,
        })
    }

    /// Answers what was asked, once its orders were given or refused.
    pub fn answer(&mut self, view: View, asked: &Asked, given: Result<(), String>) {
        let from = (of_station(asked.station), GIMBAL);
        let result = match given {
            Ok(()) => MavResult::MAV_RESULT_ACCEPTED,
            Err(_) => MavResult::MAV_RESULT_DENIED,
        };
        if let Some(command) = asked.command {
            self.acknowledge(from, asked.sender, command, result);
        }
        match given {
            Ok(()) => {
                let control = self.gimbals.get(asked.station).and_then(Gimbal::control);
                let status = telemetry::manager_status(control, view.t_s());
                self.send(from.0, from.1, &status);
            }
            Err(why) => {
                let text = MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                    severity: MavSeverity::MAV_SEVERITY_WARNING,
                    text: short(&why).into(),
                    ..STATUSTEXT_DATA::DEFAULT
                });
                self.send(from.0, from.1, &text);
            }
        }
    }

    fn acknowledge(&mut self, from: Sender, to: Sender, command: MavCmd, result: MavResult) {
        let answer = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command,
            result,
            target_system: to.0,
            target_component: to.1,
            ..COMMAND_ACK_DATA::DEFAULT
        });
        self.send(from.0, from.1, &answer);
    }
}

/// The UAVs, without distractors.
fn flown(view: View<'_>) -> impl Iterator<Item = UavView<'_>> {
    view.uavs().filter(|uav| uav.distractor().is_none())
}

fn motion(uav: &UavView) -> Motion {
    Motion {
        r_enu_m: uav.r_enu_m(),
        v_enu_mps: uav.v_enu_mps(),
        q_enu_body: uav.q_enu_body(),
        rates_body_radps: uav.rates_body_radps(),
    }
}

/// A station stands, and its front is to the north.
fn standing(station: &StationView) -> Motion {
    Motion {
        r_enu_m: station.mount().r_enu_m,
        v_enu_mps: DVec3::ZERO,
        q_enu_body: DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2),
        rates_body_radps: DVec3::ZERO,
    }
}

/// As much of a line as a STATUSTEXT holds.
fn short(line: &str) -> &str {
    let mut end = line.len().min(TEXT_BYTES);
    while !line.is_char_boundary(end) {
        end -= 1;
    }
    &line[..end]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_cut_between_two_characters() {
        assert_eq!(short("brief"), "brief");
        let long = format!("{}é", "x".repeat(TEXT_BYTES - 1));
        assert_eq!(short(&long), "x".repeat(TEXT_BYTES - 1));
    }
}
