//! A blocking client.

use crate::endpoint::{Connection, Endpoint, EndpointError};
use crate::framing::{FramingError, Reader, encode};
use crate::proto::{
    BeDetector, Box as Found, Detected, Done, Events, Finish, Finished, Frames, GetEvents,
    GetFrames, GetScenario, GetState, Hello, Order, Pause, Ping, Question, Reply, Request, Restore,
    Resume, RunUntil, Seek, Snapshot, State, Step, Stepped, TakeSnapshot, Welcome, reply,
    request::What,
};
use crate::{MAX_REPLY_BYTES, VERSION};
use std::io::Write;

/// Why a server does not do what a client wants.
#[derive(thiserror::Error)]
pub enum ClientError {
    /// There is no server.
    #[error(transparent)]
    Endpoint(#[from] EndpointError),
    /// The connection is at its end.
    #[error(transparent)]
    Framing(#[from] FramingError),
    /// The server refuses, in its own words.
    #[error("{0}")]
    Refused(String),
    /// The server says something that was not asked.
    #[error("the server answers something else than was asked; is it of another version?")]
    Unexpected,
}

/// The line itself, so that a program whose `main` returns it ends with it.
impl std::fmt::Debug for ClientError {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{self}")
    }
}

/// What a client that is the detector does with each frame.
type Look = Box<dyn FnMut(&Question) -> Vec<Found> + Send>;

/// A connection to a server: one request at a time, each waits for its reply.
pub struct Client {
    connection: Connection,
    reader: Reader<Connection>,
    welcome: Welcome,
    last_id: u64,
    look: Option<Look>,
}

impl std::fmt::Debug for Client {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.debug_struct("Client")
            .field("welcome", &self.welcome)
            .finish_non_exhaustive()
    }
}

/// Reads the reply of one kind out of whatever was replied.
macro_rules! expect {
    ($reply:expr, $kind:ident) => {
        match $reply {
            reply::What::$kind(reply) => Ok(reply),
            _ => Err(ClientError::Unexpected),
        }
    };
}

impl Client {
    /// Connects under a name of the client's own; the token is empty where the server wants none.
    pub fn connect(endpoint: &Endpoint, name: &str, token: &str) -> Result<Self, ClientError> {
        let connection = endpoint.connect()?;
        let second = connection.try_clone().map_err(FramingError::Io)?;
        let mut client = Self {
            connection,
            reader: Reader::new(second, MAX_REPLY_BYTES),
            welcome: Welcome::default(),
            last_id: 0,
            look: None,
        };
        let hello = Hello {
            version: VERSION,
            token: token.to_owned(),
            name: name.to_owned(),
        };
        client.welcome = expect!(client.ask(What::Hello(hello))?, Welcome)?;
        Ok(client)
    }

    /// What the server said at the beginning: ticks a second, names, cameras.
    pub fn welcome(&self) -> &Welcome {
        &self.welcome
    }

    /// A request, and the reply to it. Frames for the detector are looked at meanwhile.
    pub fn ask(&mut self, what: What) -> Result<reply::What, ClientError> {
        let id = self.send(what)?;
        loop {
            let (reply, _) = self.reader.read::<Reply>()?;
            match reply.what {
                Some(reply::What::Question(question)) => self.answer(&question)?,
                Some(reply::What::Error(error)) if reply.id == id || reply.id == 0 => {
                    return Err(ClientError::Refused(error.message));
                }
                Some(what) if reply.id == id => return Ok(what),
                _ => return Err(ClientError::Unexpected),
            }
        }
    }

    /// A request alone; its `id`. The reply is [`Self::receive`]d.
    pub fn send(&mut self, what: What) -> Result<u64, ClientError> {
        self.last_id += 1;
        let request = Request {
            id: self.last_id,
            what: Some(what),
        };
        let sent = self.connection.write_all(&encode(&request));
        if let Err(error) = sent {
            // What the server said before it closed the connection says more.
            while let Ok((reply, _)) = self.reader.read::<Reply>() {
                if let Some(reply::What::Error(error)) = reply.what {
                    return Err(ClientError::Refused(error.message));
                }
            }
            return Err(FramingError::Io(error).into());
        }
        Ok(self.last_id)
    }

    /// The next that the server says, whatever it is.
    pub fn receive(&mut self) -> Result<Reply, ClientError> {
        Ok(self.reader.read::<Reply>()?.0)
    }

    fn answer(&mut self, question: &Question) -> Result<(), ClientError> {
        let look = self.look.as_mut().ok_or(ClientError::Unexpected)?;
        let boxes = look(question);
        let answer = Detected {
            question: question.question,
            boxes,
        };
        self.send(What::Detected(answer))?;
        Ok(())
    }

    /// Waits for a reply and nothing else.
    pub fn ping(&mut self) -> Result<(), ClientError> {
        expect!(self.ask(What::Ping(Ping {}))?, Pong).map(|_| ())
    }

    /// The run as its last tick left it.
    pub fn state(&mut self) -> Result<State, ClientError> {
        expect!(self.ask(What::State(GetState::default()))?, State)
    }

    /// The newest frame of each camera.
    pub fn frames(&mut self, pixels: bool) -> Result<Frames, ClientError> {
        let frames = GetFrames {
            pixels,
            ..GetFrames::default()
        };
        expect!(self.ask(What::Frames(frames))?, Frames)
    }

    /// Lets ticks pass.
    pub fn step(&mut self, ticks: u64) -> Result<Stepped, ClientError> {
        let step = Step {
            ticks,
            with_state: false,
        };
        expect!(self.ask(What::Step(step))?, Stepped)
    }

    /// Lets time pass until `t_s` \[s\].
    pub fn run_until(&mut self, t_s: f64) -> Result<Stepped, ClientError> {
        let until = RunUntil {
            t_s,
            with_state: false,
        };
        expect!(self.ask(What::RunUntil(until))?, Stepped)
    }

    /// Goes to a tick, back or on.
    pub fn seek(&mut self, tick: u64) -> Result<Stepped, ClientError> {
        let seek = Seek {
            tick,
            with_state: false,
        };
        expect!(self.ask(What::Seek(seek))?, Stepped)
    }

    /// Keeps the run's state, to go back to.
    pub fn take_snapshot(&mut self) -> Result<Snapshot, ClientError> {
        expect!(self.ask(What::TakeSnapshot(TakeSnapshot {}))?, Snapshot)
    }

    /// Goes back to the snapshot of a number.
    pub fn restore(&mut self, number: u64) -> Result<Stepped, ClientError> {
        let restore = Restore {
            number,
            with_state: false,
        };
        expect!(self.ask(What::Restore(restore))?, Stepped)
    }

    /// Holds the run.
    pub fn pause(&mut self) -> Result<Done, ClientError> {
        expect!(self.ask(What::Pause(Pause {}))?, Done)
    }

    /// Lets it go on.
    pub fn resume(&mut self) -> Result<Done, ClientError> {
        expect!(self.ask(What::Resume(Resume {}))?, Done)
    }

    /// Gives an order.
    pub fn order(&mut self, order: Order) -> Result<Done, ClientError> {
        expect!(self.ask(What::Order(order))?, Done)
    }

    /// The scenario, as TOML, that repeats the run without clients.
    pub fn scenario(&mut self) -> Result<String, ClientError> {
        let scenario = expect!(self.ask(What::Scenario(GetScenario {}))?, Scenario)?;
        Ok(scenario.toml)
    }

    /// What has happened, from an event's number on.
    pub fn events(&mut self, from: u64) -> Result<Events, ClientError> {
        expect!(self.ask(What::Events(GetEvents { from }))?, Events)
    }

    /// Is the run's detector from now on: `look` finds what is in each frame. It is asked while this client waits for
    /// a reply.
    pub fn detect(
        &mut self,
        as_detector: BeDetector,
        look: impl FnMut(&Question) -> Vec<Found> + Send + 'static,
    ) -> Result<Done, ClientError> {
        self.look = Some(Box::new(look));
        expect!(self.ask(What::BeDetector(as_detector))?, Done)
    }

    /// Ends run and server.
    pub fn finish(mut self) -> Result<Finished, ClientError> {
        expect!(self.ask(What::Finish(Finish {}))?, Finished)
    }
}
