//! What waits to be sent to a client: never much, and never for long.

use boresight_lockstep::{Connection, encode, proto};
use std::collections::VecDeque;
use std::io::{self, Write};
use std::net::Shutdown;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A client for whom more than this waits is not served until it has taken some \[byte\].
const BACKLOG_BYTES: usize = 1 << 20;
/// Longest that the run waits for a client's side of a connection to take a reply; then a thread of the client's own does.
const TRY: Duration = Duration::from_millis(2);

/// The way out to one client, for all threads that have something to say to it.
#[derive(Clone)]
pub(super) struct Outbox(Arc<Shared>);

struct Shared {
    connection: Connection,
    /// An error in the client's language.
    refusal: fn(u64, &str) -> Vec<u8>,
    waiting: Mutex<Waiting>,
    changed: Condvar,
}

#[derive(Default)]
struct Waiting {
    messages: VecDeque<Vec<u8>>,
    /// Bytes of those, and of the one that is being sent.
    bytes: usize,
    /// Whether a message is being sent.
    busy: bool,
    /// Nothing more is taken in; what waits is still sent.
    closing: bool,
    /// Nothing is sent any more.
    closed: bool,
}

impl Outbox {
    /// For a connection, whose write timeout it sets.
    pub(super) fn new(
        connection: Connection,
        refusal: fn(u64, &str) -> Vec<u8>,
    ) -> io::Result<Self> {
        connection.set_write_timeout(Some(TRY))?;
        Ok(Self(Arc::new(Shared {
            connection,
            refusal,
            waiting: Mutex::default(),
            changed: Condvar::new(),
        })))
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.0
            .waiting
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    /// Sends a reply, as [`Self::post`] does.
    pub(super) fn send(&self, reply: &proto::Reply) {
        self.post(encode(reply));
    }

    /// Sends a message, or queues what the client does not take at once. To one that has left nothing is sent.
    pub(super) fn post(&self, mut bytes: Vec<u8>) {
        let mut waiting = self.lock();
        if waiting.closing || waiting.closed {
            return;
        }
        if waiting.messages.is_empty() && !waiting.busy {
            let sent = write(&self.0.connection, &bytes);
            match sent {
                Ok(sent) if sent == bytes.len() => return,
                Ok(sent) => drop(bytes.drain(..sent)),
                Err(_) => {
                    self.end(&mut waiting);
                    return;
                }
            }
        }
        waiting.bytes += bytes.len();
        waiting.messages.push_back(bytes);
        self.0.changed.notify_all();
    }

    /// Sends an error; an `id` of 0 belongs to no request.
    pub(super) fn refuse(&self, id: u64, message: impl Into<String>) {
        self.post((self.0.refusal)(id, &message.into()));
    }

    /// Whether little enough waits for the client to be served, or it has left.
    pub(super) fn ready(&self) -> bool {
        let waiting = self.lock();
        waiting.closed || waiting.bytes <= BACKLOG_BYTES
    }

    /// Takes nothing more in; the connection's way out is closed once all is sent.
    pub(super) fn close(&self) {
        let mut waiting = self.lock();
        waiting.closing = true;
        if waiting.messages.is_empty() && !waiting.busy {
            self.end(&mut waiting);
        }
        self.0.changed.notify_all();
    }

    /// Waits until all is sent, or `until`.
    pub(super) fn drain(&self, until: Instant) {
        let mut waiting = self.lock();
        while !waiting.closed && waiting.bytes > 0 {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return;
            }
            let woken = self.0.changed.wait_timeout(waiting, left);
            waiting = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn end(&self, waiting: &mut Waiting) {
        waiting.closed = true;
        waiting.messages.clear();
        waiting.bytes = 0;
        // It may be closed already.
        let _ = self.0.connection.shutdown(Shutdown::Write);
        self.0.changed.notify_all();
    }

    /// Sends what waits until the outbox is closed: the work of a thread of the client's own. An error says that the
    /// client has taken nothing for `patience`.
    pub(super) fn work(&self, patience: Duration) -> Result<(), String> {
        let mut waiting = self.lock();
        loop {
            if waiting.closed {
                return Ok(());
            }
            let Some(message) = waiting.messages.pop_front() else {
                if waiting.closing {
                    self.end(&mut waiting);
                    return Ok(());
                }
                let woken = self.0.changed.wait(waiting);
                waiting = woken.unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            waiting.busy = true;
            drop(waiting);
            let sent = self.send_whole(&message, patience);
            waiting = self.lock();
            waiting.busy = false;
            let bytes = waiting.bytes;
            waiting.bytes = bytes.saturating_sub(message.len());
            match sent {
                Ok(true) => self.0.changed.notify_all(),
                Ok(false) => {
                    self.end(&mut waiting);
                    let _ = self.0.connection.shutdown(Shutdown::Both);
                    return Err(format!(
                        "has taken nothing for {} s while {bytes} bytes wait for it; read every reply",
                        patience.as_secs_f64()
                    ));
                }
                Err(_) => {
                    self.end(&mut waiting);
                    return Ok(());
                }
            }
        }
    }

    /// Whether a message was taken before the patience was at its end.
    fn send_whole(&self, message: &[u8], patience: Duration) -> io::Result<bool> {
        let (mut sent, mut last) = (0, Instant::now());
        while sent < message.len() {
            match write(&self.0.connection, &message[sent..])? {
                0 if last.elapsed() > patience => return Ok(false),
                0 => {}
                more => {
                    sent += more;
                    last = Instant::now();
                }
            }
        }
        Ok(true)
    }
}

/// Bytes that the connection takes within [`TRY`].
fn write(connection: &Connection, bytes: &[u8]) -> io::Result<usize> {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    let written = match connection {
        Connection::Tcp(stream) => (&mut &*stream).write(bytes),
        Connection::Unix(stream) => (&mut &*stream).write(bytes),
    };
    match written {
        Err(error) if [Interrupted, TimedOut, WouldBlock].contains(&error.kind()) => Ok(0),
        Ok(0) if !bytes.is_empty() => Err(io::ErrorKind::WriteZero.into()),
        written => written,
    }
}
