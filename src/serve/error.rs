//! Why a run is not served.

use super::mavlink::{MavlinkError, PilotError};
use crate::output::OutputError;
use crate::simulation::SimulationError;
use boresight_lockstep::EndpointError;
use std::io;
use std::path::PathBuf;

/// Why a run cannot be served, or ends before its time. Each prints as one line that names the mend.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Where it was to listen.
    #[error(transparent)]
    Endpoint(#[from] EndpointError),
    /// Others could reach it, and nothing keeps them out.
    #[error(
        "{0}: is reached from other machines, so a token is wanted: --token FILE, or listen on 127.0.0.1 or --unix"
    )]
    Open(String),
    /// The same of clients that know no token.
    #[error(
        "--airsim {0}: is reached from other machines, and AirSim's clients give no token: listen on 127.0.0.1"
    )]
    OpenAirsim(String),
    /// The file of the token.
    #[error("--token {path}: cannot be read: {source}; name a file that holds the token")]
    TokenFile {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A token that keeps nobody out.
    #[error(
        "--token {0}: holds fewer than 16 characters; `head -c 24 /dev/urandom | base64` makes a token"
    )]
    ShortToken(PathBuf),
    /// The system gives no thread.
    #[error("the server cannot start: {0}; are there too many threads?")]
    Thread(io::Error),
    /// MAVLink.
    #[error(transparent)]
    Mavlink(#[from] MavlinkError),
    /// An autopilot that flies a UAV.
    #[error(transparent)]
    Pilot(#[from] PilotError),
    /// The run itself.
    #[error(transparent)]
    Run(#[from] SimulationError),
    /// The scenario with the orders that were given.
    #[error(
        "the scenario with its orders cannot be written as TOML: {0}; this is a fault of the program: please report it"
    )]
    Orders(#[from] toml::ser::Error),
    /// The answers of a detector outside.
    #[error(
        "the detector's answers cannot be written: {0}; this is a fault of the program: please report it"
    )]
    Answers(String),
    /// A file that it leaves.
    #[error(transparent)]
    Output(#[from] OutputError),
}
