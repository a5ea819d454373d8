//! How clients of the lockstep protocol are let in.

use super::entrance::{House, say};
use super::inbox::{Client, Inbox};
use super::outside::Link;
use boresight_lockstep::proto::{self, Hello, Reply, Request, Welcome, reply, request::What};
use boresight_lockstep::{Connection, FramingError, MAX_REQUEST_BYTES, Reader, VERSION, encode};
use std::io;
use std::sync::Arc;
use std::time::Duration;

/// Longest first message \[byte\]: more than version, token and name need.
const HELLO_BYTES: usize = 4 << 10;
/// Time that a client has to say who it is.
const HELLO: Duration = Duration::from_secs(10);

/// What every client is let in by.
pub(super) struct Door {
    /// Where requests wait.
    pub inbox: Arc<Inbox>,
    /// The detector outside.
    pub link: Arc<Link>,
    /// What a client is told that is let in.
    pub welcome: Welcome,
    /// What it must know.
    pub token: Option<String>,
    /// How long a client may take nothing of what waits for it.
    pub patience: Duration,
}

impl House for Door {
    type Request = Request;
    type Reader = Reader<Connection>;

    fn inbox(&self) -> &Inbox<Request> {
        &self.inbox
    }

    fn patience(&self) -> Duration {
        self.patience
    }

    fn refusal(id: u64, why: &str) -> Vec<u8> {
        let message = why.to_owned();
        encode(&Reply {
            id,
            what: Some(reply::What::Error(proto::Error { message })),
        })
    }

    fn reader(connection: Connection) -> Self::Reader {
        Reader::new(connection, HELLO_BYTES)
    }

    fn connection(reader: &Self::Reader) -> &Connection {
        reader.stream()
    }

    fn greet(&self, client: &mut Client, reader: &mut Self::Reader) -> Result<(), String> {
        greet(client, reader, self)
    }

    fn read_all(&self, client: &Client, reader: &mut Self::Reader) -> Result<(), String> {
        read_all(client, reader, self)
    }

    fn leave(&self, client: u64) {
        self.link.leave(client);
    }
}

/// Lets a client in, or says why not.
fn greet(client: &mut Client, reader: &mut Reader<Connection>, door: &Door) -> Result<(), String> {
    let timed = |longest| {
        reader
            .stream()
            .set_read_timeout(longest)
            .map_err(|error| error.to_string())
    };
    timed(Some(HELLO))?;
    let request = reader.read::<Request>();
    let (request, _) = request.map_err(|error| match error {
        FramingError::Io(error)
            if [io::ErrorKind::WouldBlock, io::ErrorKind::TimedOut].contains(&error.kind()) =>
        {
            format!("no hello came within {} s; begin with one", HELLO.as_secs())
        }
        error => error.to_string(),
    })?;
    let Some(What::Hello(Hello {
        version,
        token,
        name,
    })) = request.what
    else {
        return Err("the first request must be hello, with version and token".into());
    };
    if version != VERSION {
        return Err(format!(
            "the client speaks version {version} of lockstep.proto, this server {VERSION}: take the client that came with it"
        ));
    }
    if !door
        .token
        .as_ref()
        .is_none_or(|own| same(own.as_bytes(), token.as_bytes()))
    {
        return Err("the token is not that of the server: give what its token file holds".into());
    }
    client.name = name.chars().filter(|c| !c.is_control()).take(64).collect();
    reader
        .stream()
        .set_read_timeout(None)
        .map_err(|error| error.to_string())?;
    reader.set_limit(MAX_REQUEST_BYTES);
    // First the seat, then the welcome: who has read that is there.
    door.inbox.join(client.clone());
    client.outbox.send(&Reply {
        id: request.id,
        what: Some(reply::What::Welcome(door.welcome.clone())),
    });
    Ok(())
}

/// Whether two texts are the same; takes as long wherever they differ.
fn same(a: &[u8], b: &[u8]) -> bool {
    let differ = a.iter().zip(b).fold(0, |differ, (a, b)| differ | (a ^ b));
    a.len() == b.len() && differ == 0
}

/// Hands a client's requests on; an error says why it must go.
fn read_all(client: &Client, reader: &mut Reader<Connection>, door: &Door) -> Result<(), String> {
    loop {
        let (request, bytes) = match reader.read::<Request>() {
            Ok(read) => read,
            Err(FramingError::Closed) => return Ok(()),
            // It was killed, or dropped by the one who sends.
            Err(FramingError::Io(error)) => {
                say(format_args!("{client}: the connection failed: {error}"));
                client.outbox.close();
                return Ok(());
            }
            Err(error) => return Err(error.to_string()),
        };
        match request.what {
            // The run may be waiting for it.
            Some(What::Detected(detected)) => {
                if let Err(why) = door.link.answer(client.id, detected) {
                    client.outbox.refuse(request.id, why);
                }
            }
            Some(_) => {
                if !door.inbox.put(client.id, request, bytes) {
                    return Ok(());
                }
            }
            None => client.outbox.refuse(
                request.id,
                "the request asks for nothing that this server knows; is it of another version?",
            ),
        }
    }
}
