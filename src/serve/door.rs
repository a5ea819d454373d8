//! Where clients come in: each has a thread that reads its requests, and one that sends what it does not take at once.

use super::error::ServeError;
use super::inbox::{Client, Inbox};
use super::outbox::Outbox;
use super::outside::Link;
use boresight_lockstep::proto::{Hello, Reply, Request, Welcome, reply, request::What};
use boresight_lockstep::{Connection, FramingError, Listener, MAX_REQUEST_BYTES, Reader, VERSION};
use std::io::{self, Read, Write};
use std::net::Shutdown;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Clients at a time.
const MOST_CLIENTS: usize = 16;
/// Longest first message \[byte\]: more than version, token and name need.
const HELLO_BYTES: usize = 4 << 10;
/// Time that a client has to say who it is.
const HELLO: Duration = Duration::from_secs(10);
/// Time for which a client that is turned away is still listened to, so that it can read why.
const FAREWELL: Duration = Duration::from_secs(1);

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

/// Says on standard error what became of a client.
fn say(line: impl std::fmt::Display) {
    // A closed pipe is no error.
    let _ = writeln!(io::stderr(), "{line}");
}

/// Lets clients in, on a thread that ends with the program.
pub(super) fn open(listener: Arc<Listener>, door: Door) -> Result<(), ServeError> {
    let door = Arc::new(door);
    let inside = Arc::new(AtomicUsize::new(0));
    let accept = move || {
        for id in 1.. {
            match listener.accept() {
                Ok((connection, from)) => enter(id, connection, from, &door, &inside),
                Err(error) => {
                    // Too many open files, or a client that has gone again: others may come later.
                    say(format_args!("serve: a client could not come in: {error}"));
                    thread::sleep(Duration::from_millis(100));
                }
            }
        }
    };
    let spawned = thread::Builder::new().name("serve".into()).spawn(accept);
    spawned.map(|_| ()).map_err(ServeError::Thread)
}

/// One that is counted among those inside for as long as it lives.
struct Inside(Arc<AtomicUsize>);

impl Drop for Inside {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Gives a new client its threads.
fn enter(
    id: u64,
    connection: Connection,
    from: String,
    door: &Arc<Door>,
    inside: &Arc<AtomicUsize>,
) {
    let full = inside.fetch_add(1, Ordering::Relaxed) >= MOST_CLIENTS;
    let inside = Inside(inside.clone());
    let begun = || -> io::Result<()> {
        let reads = connection.try_clone()?;
        let outbox = Outbox::new(connection)?;
        if full {
            outbox.refuse(
                0,
                format!(
                    "{MOST_CLIENTS} clients are connected, and more are not let in; come back later"
                ),
            );
            return Ok(());
        }
        let client = Client {
            id,
            name: String::new(),
            from: from.clone(),
            outbox,
        };
        let door = door.clone();
        let serve = move || {
            let _inside = inside;
            listen(client, reads, &door);
        };
        thread::Builder::new()
            .name(format!("client {id}"))
            .spawn(serve)?;
        Ok(())
    };
    if let Err(error) = begun() {
        say(format_args!(
            "client {id} ({from}): could not come in: {error}"
        ));
    }
}

/// Reads what a client wants until it leaves.
fn listen(mut client: Client, connection: Connection, door: &Door) {
    let mut reader = Reader::new(connection, HELLO_BYTES);
    let greeted = greet(&mut client, &mut reader, door);
    let ended = greeted.and_then(|()| {
        let sender = client.clone();
        let patience = door.patience;
        let sends = move || {
            if let Err(why) = sender.outbox.work(patience) {
                say(format_args!("{sender}: {why}; it is dropped"));
            }
        };
        let spawned = thread::Builder::new().spawn(sends);
        let ended = match spawned {
            Ok(_) => read_all(&client, &mut reader, door),
            Err(error) => Err(format!("the server has no thread left: {error}")),
        };
        door.link.leave(client.id);
        door.inbox.leave(client.id);
        ended
    });
    match ended {
        Ok(()) => {}
        Err(why) => {
            client.outbox.refuse(0, why.as_str());
            client.outbox.close();
            say(format_args!("{client}: {why}; it is dropped"));
            farewell(reader.stream());
        }
    }
}

/// Reads on for a while, so that a client which still sends can read why it is dropped.
fn farewell(mut connection: &Connection) {
    let until = Instant::now() + FAREWELL;
    let _ = connection.set_read_timeout(Some(FAREWELL / 10));
    let mut bytes = [0; 4096];
    let read = |bytes: &mut [u8]| match &mut connection {
        Connection::Tcp(stream) => (&mut &*stream).read(bytes),
        Connection::Unix(stream) => (&mut &*stream).read(bytes),
    };
    let mut read = read;
    while Instant::now() < until && !matches!(read(&mut bytes), Ok(0)) {}
    let _ = connection.shutdown(Shutdown::Both);
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
