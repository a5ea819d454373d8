//! `boresight serve`: one run, and many clients that step it, look at it and give it orders.
//!
//! The run stays on the thread that opened it. Each client has a thread that reads what it wants ([`door`]) and a
//! bounded queue ([`inbox`]); what it is told goes out at once, or waits in another ([`outbox`]). So a client that is slow, gone
//! or hostile costs the run nothing but its own place.

mod airsim;
mod convert;
mod door;
mod entrance;
mod error;
mod inbox;
mod marks;
mod mavlink;
mod order;
mod outbox;
mod outside;
mod pace;
mod session;

pub use error::ServeError;
pub use mavlink::{MavlinkError, PilotError};

use crate::report::summary::Finished;
use crate::scenario::Loaded;
use crate::simulation::Options;
use crate::stop;
use boresight_lockstep::Endpoint;
use boresight_lockstep::proto::{Reply, Request};
use clap::Args;
use entrance::{leave, say};
use inbox::{BETWEEN_LATE_TICKS, Client, Inbox, Taken};
use outside::Link;
use pace::seconds;
use session::{Handled, Opening, Session};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// A token has so many characters at least.
const TOKEN_CHARACTERS: usize = 16;

/// Where and for whom a run is served.
#[derive(Args, Debug, Clone)]
pub struct Arguments {
    /// Listen on this address and port; port 0 is a free one. Beyond this machine a token is wanted.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:7878")]
    listen: String,
    /// Listen on a Unix socket at this path instead; only your user reaches it.
    #[arg(long, value_name = "PATH", conflicts_with = "listen")]
    unix: Option<PathBuf>,
    /// File that holds the token which clients must give.
    #[arg(long, value_name = "FILE")]
    token: Option<PathBuf>,
    /// Seconds that a client which is the detector may take for a frame.
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = seconds)]
    detector_timeout: Duration,
    /// Seconds for which a client may take none of the replies that wait for it before it is dropped.
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = seconds)]
    patience: Duration,
    /// Speak AirSim's language instead, on this address and port of this machine; the run goes by the clock, as fast as
    /// --pace says.
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = airsim::ADDRESS,
          conflicts_with_all = ["listen", "unix", "token"])]
    airsim: Option<String>,
    #[command(flatten)]
    mavlink: mavlink::Arguments,
}

impl Arguments {
    fn endpoint(&self) -> Result<Endpoint, ServeError> {
        match &self.unix {
            Some(path) => Ok(Endpoint::unix(path)),
            None => Ok(Endpoint::tcp(&self.listen)?),
        }
    }

    /// What clients must know to be let in.
    fn token(&self) -> Result<Option<String>, ServeError> {
        let read = |path: &PathBuf| {
            let text = std::fs::read_to_string(path).map_err(|source| ServeError::TokenFile {
                path: path.clone(),
                source,
            })?;
            let token = text.trim().to_owned();
            match token.chars().count() < TOKEN_CHARACTERS {
                true => Err(ServeError::ShortToken(path.clone())),
                false => Ok(token),
            }
        };
        self.token.as_ref().map(read).transpose()
    }
}

/// Serves a run until it is finished: by a client, by a signal, or because it is over and all clients have left.
pub fn serve(args: &Arguments, loaded: Loaded, options: Options) -> Result<Finished, ServeError> {
    if let Some(address) = &args.airsim {
        let opening = Opening {
            loaded,
            options,
            link: Arc::new(Link::default()),
            detector_timeout: args.detector_timeout,
            mavlink: args.mavlink.clone(),
        };
        return airsim::serve(address, args.patience, opening);
    }
    let endpoint = args.endpoint()?;
    let token = args.token()?;
    if token.is_none() && !endpoint.is_local() {
        return Err(ServeError::Open(endpoint.to_string()));
    }
    // Whoever is in the way is found before the run is built.
    let listener = Arc::new(endpoint.listen()?);
    let link = Arc::new(Link::default());
    let session = Session::open(Opening {
        loaded,
        options,
        link: link.clone(),
        detector_timeout: args.detector_timeout,
        mavlink: args.mavlink.clone(),
    })?;
    // From here on there is something to end whole; before, a signal ends the program.
    stop::listen();
    let inbox = Arc::new(Inbox::default());
    let door = door::Door {
        inbox: inbox.clone(),
        link,
        welcome: session.welcome(),
        token,
        patience: args.patience,
    };
    let endpoint = listener.endpoint().unwrap_or(endpoint);
    entrance::open(listener.clone(), door)?;
    say(format!("serve  {endpoint}"));
    session.said().iter().for_each(say);
    let ended = run(session, &inbox);
    if let Err(error) = &ended {
        for client in inbox.clients() {
            client.outbox.refuse(0, error.to_string());
        }
    }
    leave(&inbox, &listener);
    ended
}

/// Carries out what clients want, and lets a run that goes by the clock go on.
fn run(mut session: Session, inbox: &Inbox) -> Result<Finished, ServeError> {
    loop {
        session.hear()?.iter().for_each(say);
        let left = inbox.is_abandoned() || (session.goes_alone() && inbox.clients().is_empty());
        if stop::asked().is_some() || (session.over() && left) {
            return finish(session, inbox, None);
        }
        // The clock begins with the first who comes.
        let begun = inbox.had_any() || session.had_any();
        let due = if begun { session.due() } else { None };
        let mut next = match inbox.take(due) {
            Taken::Request(taken) => Some(*taken),
            Taken::Nothing => None,
            Taken::Due => {
                if let Err(error) = session.tick() {
                    // Without its autopilot the run is no more, but what there is of it is kept.
                    if let ServeError::Pilot(_) = error {
                        finish(session, inbox, None)?;
                    }
                    return Err(error);
                }
                inbox.try_take()
            }
        };
        let mut carried_out = 0;
        while let Some((client, request)) = next.take() {
            session = match carry_out(session, inbox, &client, request)? {
                ControlFlow::Continue(session) => session,
                ControlFlow::Break(finished) => return Ok(finished),
            };
            carried_out += 1;
            if due.is_some() && carried_out < BETWEEN_LATE_TICKS {
                next = inbox.try_take();
            }
        }
    }
}

/// Carries a request out and replies to it; breaks once the run is finished.
fn carry_out(
    mut session: Session,
    inbox: &Inbox,
    client: &Client,
    request: Request,
) -> Result<ControlFlow<Finished, Session>, ServeError> {
    let id = request.id;
    let Some(wants) = request.what else {
        return Ok(ControlFlow::Continue(session));
    };
    let said = match session.handle(client, wants)? {
        Handled::Say(said) => *said,
        Handled::Refuse(why) => {
            client.outbox.refuse(id, why);
            return Ok(ControlFlow::Continue(session));
        }
        Handled::Seek(seek) => {
            let (again, said) = session.seek(seek)?;
            session = again;
            said
        }
        Handled::Finish => {
            return finish(session, inbox, Some((client, id))).map(ControlFlow::Break);
        }
    };
    client.outbox.send(&Reply {
        id,
        what: Some(said),
    });
    Ok(ControlFlow::Continue(session))
}

/// Finishes the run, and says so to the client that wants it, and to the others.
fn finish(
    mut session: Session,
    inbox: &Inbox,
    wanted: Option<(&Client, u64)>,
) -> Result<Finished, ServeError> {
    if let Some(pace) = session.pace() {
        say(pace.told());
    }
    session.told().iter().for_each(say);
    let (said, finished) = session.finish()?;
    if let Some((client, id)) = wanted {
        client.outbox.send(&Reply {
            id,
            what: Some(said),
        });
    }
    let why = match (stop::asked(), wanted) {
        (Some(stop), _) => format!("the run is finished: stopped by {}", stop.name()),
        (None, Some((client, _))) => format!("the run is finished: {client} wants no more of it"),
        (None, None) => "the run is finished".to_owned(),
    };
    let others = inbox.clients().into_iter();
    for other in others.filter(|other| wanted.is_none_or(|(client, _)| client.id != other.id)) {
        other.outbox.refuse(0, why.as_str());
    }
    Ok(finished)
}
