//! MAVLink: UAVs and stations as ground stations know such, and UAVs that an autopilot in another program flies.
//!
//! It shows a simulation and obeys in it: nothing here commands a real mount or a real UAV.

mod address;
mod doors;
mod frames;
mod gimbal;
mod ground;
mod hil;
mod link;
mod rotors;
mod sensors;
mod systems;
mod telemetry;

pub(super) use doors::Doors;
pub use hil::PilotError;

use super::pace::seconds;
use crate::scenario::Scenario;
use crate::simulation::View;
use address::{Address, Kind};
use clap::Args;
use frames::Earth;
use ground::Ground;
use hil::Pilot;
use std::io;
use std::time::Duration;
use systems::{MOST_STATIONS, MOST_UAVS};

/// Why MAVLink is not spoken.
#[derive(Debug, thiserror::Error)]
pub enum MavlinkError {
    /// An address that cannot be had.
    #[error("--{option} {address}: {source}; is it in use, or does nobody listen there?")]
    Address {
        /// The option that names it.
        option: &'static str,
        /// The address.
        address: String,
        /// What the system said.
        source: io::Error,
    },
    /// More UAVs or stations than MAVLink can number.
    #[error(
        "--mavlink: {uavs} UAVs and {stations} stations: systems are numbered for {MOST_UAVS} and {MOST_STATIONS} at most"
    )]
    TooMany {
        /// UAVs of the scenario.
        uavs: usize,
        /// Its stations.
        stations: usize,
    },
    /// A UAV that no autopilot can fly.
    #[error("--hil {uav}: {why}")]
    Pilot {
        /// Its name.
        uav: String,
        /// What is wrong, and the mend.
        why: String,
    },
}

/// Whom MAVLink is spoken with.
#[derive(Args, Debug, Clone)]
pub(super) struct Arguments {
    /// Speak MAVLink with ground stations on this machine: udpout, udpin, tcpout or tcpin, address and port, such as
    /// udpout:127.0.0.1:14550.
    #[arg(long, value_name = "KIND:ADDRESS", value_parser = Address::read)]
    mavlink: Option<Address>,
    /// Let an autopilot in another program fly this UAV, in lockstep: it comes to the address, such as
    /// intruder=tcpin:127.0.0.1:4560. May be repeated.
    #[arg(long, value_name = "UAV=KIND:ADDRESS", value_parser = pilot)]
    hil: Vec<(String, Address)>,
    /// How often an autopilot is given its sensors and answers with throttles, in Hz; a divisor of the scenario's ticks.
    #[arg(long, value_name = "HZ", default_value = "240", value_parser = clap::value_parser!(u32).range(10..=8_000))]
    hil_rate: u32,
    /// Seconds that an autopilot may take for an answer.
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = seconds)]
    hil_deadline: Duration,
}

/// A UAV's name, and where its autopilot comes in.
fn pilot(text: &str) -> Result<(String, Address), String> {
    let wanted = "expected UAV=tcpin:ADDRESS:PORT, such as intruder=tcpin:127.0.0.1:4560";
    let (uav, address) = text.rsplit_once('=').ok_or(wanted)?;
    let address = Address::read(address)?;
    match address.kind {
        Kind::TcpIn if !uav.is_empty() => Ok((uav.to_owned(), address)),
        _ => Err(wanted.to_owned()),
    }
}

impl Arguments {
    /// Opens the doors of a run.
    pub(super) fn open(&self, view: View, scenario: &Scenario) -> Result<Doors, MavlinkError> {
        Ok(Doors {
            ground: self.ground(view, scenario)?,
            pilots: self.pilots(view, scenario)?,
        })
    }

    /// Opens the way to ground stations, if one is wanted.
    fn ground(&self, view: View, scenario: &Scenario) -> Result<Option<Ground>, MavlinkError> {
        let Some(address) = self.mavlink else {
            return Ok(None);
        };
        let (uavs, stations) = (scenario.uavs.len(), view.stations().count());
        if uavs > MOST_UAVS || stations > MOST_STATIONS {
            return Err(MavlinkError::TooMany { uavs, stations });
        }
        let link = link::Link::open(address).map_err(|source| MavlinkError::Address {
            option: "mavlink",
            address: address.to_string(),
            source,
        })?;
        Ok(Some(Ground::new(link, view, scenario)))
    }

    /// Opens the doors of the autopilots.
    fn pilots(&self, view: View, scenario: &Scenario) -> Result<Vec<Pilot>, MavlinkError> {
        let rates = hil::Rates {
            exchange_hz: self.hil_rate,
            deadline: self.hil_deadline,
        };
        let mut pilots: Vec<Pilot> = Vec::new();
        for (uav, address) in &self.hil {
            let refused = |why: String| MavlinkError::Pilot {
                uav: uav.clone(),
                why,
            };
            if pilots.iter().any(|other| other.uav() == uav) {
                return Err(refused(
                    "has an autopilot already; one is enough".to_owned(),
                ));
            }
            let earth = Earth::about(scenario.site.geodetic());
            let airframe = hil::Airborne::found(uav, view).map_err(refused)?;
            let pilot = Pilot::open(airframe, *address, rates, earth, view);
            pilots.push(pilot.map_err(|error| match error {
                hil::OpenError::Refused(why) => refused(why),
                hil::OpenError::Address(source) => MavlinkError::Address {
                    option: "hil",
                    address: address.to_string(),
                    source,
                },
            })?);
        }
        Ok(pilots)
    }
}
