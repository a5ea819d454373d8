//! AirSim's calls: the clients of AirSim fly the UAVs of a run and take its cameras' pictures.
//!
//! Door, inbox, outbox and run are those of every served run; here stands what the calls mean. The clients know no token, so
//! that only this machine is let in.

mod answers;
mod calls;
mod door;
mod images;
mod motion;
mod names;
mod objects;
mod queries;
mod scene;
mod scenery;
mod session;
mod tasks;
mod weather;

use super::entrance;
use super::entrance::{leave, say};
use super::error::ServeError;
use super::inbox::{BETWEEN_LATE_TICKS, Inbox, Taken};
use super::session::Opening;
use crate::report::summary::Finished;
use crate::stop;
use boresight_airsim::Call;
use boresight_lockstep::Endpoint;
use session::Session;
use std::sync::Arc;
use std::time::Duration;

/// Where AirSim's clients look for their server.
pub(super) const ADDRESS: &str = "127.0.0.1:41451";

/// Simulated seconds a second where nothing is said: as AirSim's own clock.
const PACE: f64 = 1.0;

/// Serves a run to AirSim's clients until it is finished: by a signal, or because it is over and all clients have left.
pub(super) fn serve(
    address: &str,
    patience: Duration,
    mut opening: Opening,
) -> Result<Finished, ServeError> {
    let endpoint = Endpoint::tcp(address)?;
    if !endpoint.is_local() {
        return Err(ServeError::OpenAirsim(endpoint.to_string()));
    }
    let listener = Arc::new(endpoint.listen()?);
    opening.options.pace = opening.options.pace.or(Some(PACE));
    // Where the run itself looks at no picture, those that clients ask for are rendered all the same.
    opening.options.capture |= opening.options.on_demand;
    keep_memory();
    let session = Session::open(opening)?;
    stop::listen();
    let inbox = Arc::new(Inbox::default());
    let door = door::Door {
        inbox: inbox.clone(),
        patience,
    };
    let endpoint = listener.endpoint().unwrap_or(endpoint);
    entrance::open(listener.clone(), door)?;
    say(format!("airsim  {endpoint}"));
    let ended = run(session, &inbox);
    let why = match (&ended, stop::asked()) {
        (Err(error), _) => error.to_string(),
        (Ok(_), Some(stop)) => format!("the run is finished: stopped by {}", stop.name()),
        (Ok(_), None) => "the run is finished".to_owned(),
    };
    for client in inbox.clients() {
        client.outbox.refuse(0, why.as_str());
    }
    leave(&inbox, &listener);
    ended
}

/// Answers calls, and lets the run go on.
fn run(mut session: Session, inbox: &Inbox<Call>) -> Result<Finished, ServeError> {
    loop {
        if stop::asked().is_some() || (session.over() && inbox.is_abandoned()) {
            return session.finish();
        }
        session.hear()?;
        // The clock begins with the first client.
        let due = if inbox.had_any() { session.due() } else { None };
        let mut next = match inbox.take(due) {
            Taken::Request(taken) => Some(*taken),
            Taken::Nothing => None,
            Taken::Due => {
                session.tick()?;
                inbox.try_take()
            }
        };
        let mut answered = 0;
        while let Some((client, call)) = next.take() {
            session = calls::answer(session, &client, call)?;
            answered += 1;
            if due.is_some() && answered < BETWEEN_LATE_TICKS {
                next = inbox.try_take();
            }
        }
    }
}

/// Lets the allocator keep what is given back. A picture of a wide field takes tens of megabytes of a software renderer, and
/// would be given them by the system anew: with them kept, pictures come nearly twice as often (`benches/airsim.py`).
fn keep_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        const BYTES: [(libc::c_int, libc::c_int); 3] = [
            // The greatest that glibc takes.
            (libc::M_MMAP_THRESHOLD, 32 << 20),
            (libc::M_TRIM_THRESHOLD, 1 << 30),
            (libc::M_TOP_PAD, 64 << 20),
        ];
        for (parameter, bytes) in BYTES {
            // SAFETY: it takes two numbers, and locks the allocator's state by itself.
            unsafe { libc::mallopt(parameter, bytes) };
        }
    }
}
