//! Where clients come in, whatever they speak: each has a thread that reads its requests, and one that sends what it
//! does not take at once.

use super::error::ServeError;
use super::inbox::{Client, Inbox};
use super::outbox::Outbox;
use boresight_lockstep::{Connection, Listener};
use std::io::{self, Read, Write};
use std::net::Shutdown;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Clients at a time.
const MOST_CLIENTS: usize = 16;
/// Time for which a client that is turned away is still listened to, so that it can read why.
const FAREWELL: Duration = Duration::from_secs(1);

/// Time that clients have for their last replies when the run has ended.
const LAST_REPLIES: Duration = Duration::from_secs(1);

/// What clients that speak one language are let in by.
pub(super) trait House: Send + Sync + 'static {
    /// What a client wants.
    type Request: Send + 'static;
    /// What reads it from a connection.
    type Reader;

    /// Where requests wait.
    fn inbox(&self) -> &Inbox<Self::Request>;
    /// How long a client may take nothing of what waits for it.
    fn patience(&self) -> Duration;
    /// An error in the clients' language; an `id` of 0 belongs to no request.
    fn refusal(id: u64, why: &str) -> Vec<u8>;
    /// Begins to read.
    fn reader(connection: Connection) -> Self::Reader;
    /// What is read from.
    fn connection(reader: &Self::Reader) -> &Connection;
    /// Lets a client in, or says why not.
    fn greet(&self, client: &mut Client, reader: &mut Self::Reader) -> Result<(), String>;
    /// Hands a client's requests on until it leaves; an error says why it must go.
    fn read_all(&self, client: &Client, reader: &mut Self::Reader) -> Result<(), String>;
    /// A client has left.
    fn leave(&self, client: u64);
}

/// Says on standard error what became of a client.
pub(super) fn say(line: impl std::fmt::Display) {
    // A closed pipe is no error.
    let _ = writeln!(io::stderr(), "{line}");
}

/// Lets clients in, on a thread that ends with the program.
pub(super) fn open<H: House>(listener: Arc<Listener>, door: H) -> Result<(), ServeError> {
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
fn enter<H: House>(
    id: u64,
    connection: Connection,
    from: String,
    door: &Arc<H>,
    inside: &Arc<AtomicUsize>,
) {
    let full = inside.fetch_add(1, Ordering::Relaxed) >= MOST_CLIENTS;
    let inside = Inside(inside.clone());
    let begun = || -> io::Result<()> {
        let reads = connection.try_clone()?;
        let outbox = Outbox::new(connection, H::refusal)?;
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
            listen(client, reads, &*door);
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
fn listen<H: House>(mut client: Client, connection: Connection, door: &H) {
    let mut reader = H::reader(connection);
    let greeted = door.greet(&mut client, &mut reader);
    let ended = greeted.and_then(|()| {
        let sender = client.clone();
        let patience = door.patience();
        let sends = move || {
            if let Err(why) = sender.outbox.work(patience) {
                say(format_args!("{sender}: {why}; it is dropped"));
            }
        };
        let spawned = thread::Builder::new().spawn(sends);
        let ended = match spawned {
            Ok(_) => door.read_all(&client, &mut reader),
            Err(error) => Err(format!("the server has no thread left: {error}")),
        };
        door.leave(client.id);
        door.inbox().leave(client.id);
        ended
    });
    match ended {
        Ok(()) => {}
        Err(why) => {
            client.outbox.refuse(0, why.as_str());
            client.outbox.close();
            say(format_args!("{client}: {why}; it is dropped"));
            farewell(H::connection(&reader));
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

/// Sends what still waits, and lets nobody wait for more.
pub(super) fn leave<R>(inbox: &Inbox<R>, listener: &Listener) {
    let until = Instant::now() + LAST_REPLIES;
    inbox.close();
    for client in inbox.clients() {
        client.outbox.close();
        client.outbox.drain(until);
    }
    // Its thread holds it until the program ends.
    if let Listener::Unix(_, path) = listener {
        // Somebody else may have removed it.
        let _ = std::fs::remove_file(path);
    }
}
