//! The way to ground stations: datagrams or streams, of this machine alone.
//!
//! Threads read; what came whole waits in a queue for the run. Nothing waits for a peer that takes nothing: its
//! messages are dropped and counted.

use super::address::{Address, Kind};
use mavlink::dialects::common::MavMessage;
use mavlink::{MavHeader, MavlinkReader, error::MessageReadError};
use std::collections::BTreeSet;
use std::io::{self, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// Messages that wait for the run, and for a stream, at most.
const MOST_WAITING: usize = 1_024;
/// Those that are sent to at a time.
const MOST_PEERS: usize = 16;
/// Longest datagram: more than any message, and more than one fit.
const DATAGRAM_BYTES: usize = 4_096;
/// Time after a failed wait for a stream.
const RETRY: Duration = Duration::from_millis(100);

/// A message and who sent it.
pub(super) type Heard = (MavHeader, MavMessage);

/// What went wrong on the way, in numbers.
#[derive(Default)]
pub(super) struct Counts {
    /// Datagrams that held no message, or one that cannot be read.
    malformed: AtomicU64,
    /// Messages that came faster than they were taken.
    unheard: AtomicU64,
    /// Messages that a peer did not take.
    untaken: AtomicU64,
}

impl Counts {
    /// The same in words; none where nothing went wrong.
    pub(super) fn told(&self) -> Option<String> {
        let parts = [
            (&self.malformed, "malformed and ignored"),
            (&self.unheard, "not heard for there were too many"),
            (&self.untaken, "not taken by their peer"),
        ];
        let count = |(count, what): (&AtomicU64, &str)| {
            let count = count.load(Ordering::Relaxed);
            (count > 0).then(|| format!("{count} {what}"))
        };
        let said: Vec<String> = parts.into_iter().filter_map(count).collect();
        (!said.is_empty()).then(|| said.join(", "))
    }
}

/// The way out to a peer of a stream.
struct Stream {
    id: u64,
    queue: SyncSender<Arc<[u8]>>,
}

#[derive(Default)]
struct Peers {
    datagrams: BTreeSet<SocketAddr>,
    streams: Vec<Stream>,
}

struct Shared {
    peers: Mutex<Peers>,
    heard: SyncSender<Heard>,
    counts: Arc<Counts>,
}

impl Shared {
    fn peers(&self) -> MutexGuard<'_, Peers> {
        self.peers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn put(&self, heard: Heard) {
        if let Err(TrySendError::Full(_)) = self.heard.try_send(heard) {
            self.counts.unheard.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// The way to ground stations and back.
pub(super) struct Link {
    socket: Option<UdpSocket>,
    shared: Arc<Shared>,
    heard: Receiver<Heard>,
    at: Address,
}

impl Link {
    /// Opens the way, on threads that end with the program.
    pub(super) fn open(address: Address) -> io::Result<Self> {
        let (sender, heard) = sync_channel(MOST_WAITING);
        let shared = Arc::new(Shared {
            peers: Mutex::default(),
            heard: sender,
            counts: Arc::default(),
        });
        let mut at = address;
        let socket = match address.kind {
            Kind::UdpOut | Kind::UdpIn => {
                let bound = match address.kind {
                    Kind::UdpIn => address.at,
                    // A free port of the address's own family, on this machine.
                    _ => SocketAddr::new(address.at.ip(), 0),
                };
                let socket = UdpSocket::bind(bound)?;
                if address.kind == Kind::UdpIn {
                    at.at = socket.local_addr()?;
                } else {
                    shared.peers().datagrams.insert(address.at);
                }
                let (reads, shared) = (socket.try_clone()?, shared.clone());
                let answers = address.kind == Kind::UdpIn;
                spawn("mavlink", move || hear_datagrams(&reads, &shared, answers))?;
                Some(socket)
            }
            Kind::TcpOut => {
                join(TcpStream::connect(address.at)?, 0, &shared)?;
                None
            }
            Kind::TcpIn => {
                let listener = TcpListener::bind(address.at)?;
                at.at = listener.local_addr()?;
                let shared = shared.clone();
                spawn("mavlink", move || let_in(&listener, &shared))?;
                None
            }
        };
        Ok(Self {
            socket,
            shared,
            heard,
            at,
        })
    }

    /// Where it is.
    pub(super) fn address(&self) -> Address {
        self.at
    }

    /// What went wrong so far.
    pub(super) fn counts(&self) -> Arc<Counts> {
        self.shared.counts.clone()
    }

    /// The next message that came.
    pub(super) fn hear(&self) -> Option<Heard> {
        self.heard.try_recv().ok()
    }

    /// Sends a message to every peer.
    pub(super) fn send(&self, header: MavHeader, message: &MavMessage) {
        let mut bytes = Vec::with_capacity(64);
        if mavlink::write_v2_msg(&mut bytes, header, message).is_err() {
            return;
        }
        let untaken = || {
            self.shared.counts.untaken.fetch_add(1, Ordering::Relaxed);
        };
        let mut peers = self.shared.peers();
        if let Some(socket) = &self.socket {
            // Nobody may listen yet: that is no error.
            for peer in &peers.datagrams {
                let _ = socket.send_to(&bytes, peer);
            }
        }
        if !peers.streams.is_empty() {
            let bytes: Arc<[u8]> = bytes.into();
            peers
                .streams
                .retain(|stream| match stream.queue.try_send(bytes.clone()) {
                    Ok(()) => true,
                    Err(TrySendError::Full(_)) => {
                        untaken();
                        true
                    }
                    Err(TrySendError::Disconnected(_)) => false,
                });
        }
    }
}

fn spawn(name: &str, work: impl FnOnce() + Send + 'static) -> io::Result<()> {
    let spawned = thread::Builder::new().name(name.into()).spawn(work);
    spawned.map(|_| ())
}

/// The messages of a datagram, and whether all of them could be read and there were any.
fn messages(datagram: &[u8]) -> (Vec<Heard>, bool) {
    let mut reader = MavlinkReader::new(datagram);
    let mut found = Vec::new();
    let mut sound = true;
    loop {
        match reader.read_any_message::<MavMessage>() {
            Ok(heard) => found.push(heard),
            Err(MessageReadError::Io(_)) => break,
            Err(MessageReadError::Parse(_)) => sound = false,
        }
    }
    // Garbage is passed over in silence.
    let sound = sound && !found.is_empty();
    (found, sound)
}

/// Reads datagrams; `answers` says whether who sends one is sent to.
fn hear_datagrams(socket: &UdpSocket, shared: &Shared, answers: bool) {
    let mut datagram = [0; DATAGRAM_BYTES];
    loop {
        let Ok((bytes, from)) = socket.recv_from(&mut datagram) else {
            // What was sent to nobody comes back as an error of the next read.
            thread::sleep(Duration::from_millis(1));
            continue;
        };
        let (found, sound) = messages(&datagram[..bytes]);
        if !sound {
            shared.counts.malformed.fetch_add(1, Ordering::Relaxed);
        }
        if found.is_empty() {
            continue;
        }
        if answers {
            let mut peers = shared.peers();
            if peers.datagrams.len() < MOST_PEERS {
                peers.datagrams.insert(from);
            }
        }
        found.into_iter().for_each(|heard| shared.put(heard));
    }
}

/// Lets streams in.
fn let_in(listener: &TcpListener, shared: &Arc<Shared>) {
    for id in 0.. {
        match listener.accept() {
            Ok((stream, _)) if shared.peers().streams.len() < MOST_PEERS => {
                // One that has gone again is no loss.
                let _ = join(stream, id, shared);
            }
            Ok(_) => {}
            Err(_) => thread::sleep(RETRY),
        }
    }
}

/// Gives a stream its threads.
fn join(stream: TcpStream, id: u64, shared: &Arc<Shared>) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let mut writes = stream.try_clone()?;
    let (queue, waiting) = sync_channel::<Arc<[u8]>>(MOST_WAITING);
    shared.peers().streams.push(Stream { id, queue });
    spawn("mavlink out", move || {
        while let Ok(bytes) = waiting.recv() {
            if writes.write_all(&bytes).is_err() {
                break;
            }
        }
    })?;
    let shared = shared.clone();
    spawn("mavlink in", move || {
        let mut reader = MavlinkReader::new(stream);
        loop {
            match reader.read_any_message::<MavMessage>() {
                Ok(heard) => shared.put(heard),
                Err(MessageReadError::Parse(_)) => {
                    shared.counts.malformed.fetch_add(1, Ordering::Relaxed);
                }
                Err(MessageReadError::Io(_)) => break,
            }
        }
        shared.peers().streams.retain(|stream| stream.id != id);
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::common::HEARTBEAT_DATA;

    fn framed(system_id: u32) -> Vec<u8> {
        let header = MavHeader {
            system_id,
            component_id: 1,
            sequence: 0,
        };
        let mut bytes = Vec::new();
        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::DEFAULT);
        mavlink::write_v2_msg(&mut bytes, header, &message).unwrap();
        bytes
    }

    #[test]
    fn a_datagram_may_hold_several_messages_and_garbage_is_none() {
        let (found, sound) = messages(&[framed(7), framed(8)].concat());
        let systems: Vec<u32> = found.iter().map(|(header, _)| header.system_id).collect();
        assert!(sound && systems == [7, 8]);
        let mut broken = framed(7);
        let last = broken.len() - 1;
        broken[last] ^= 1;
        for datagram in [&[][..], &[0; 40], b"hello", &framed(7)[..9], &broken] {
            let (found, sound) = messages(datagram);
            assert!(found.is_empty() && !sound, "{datagram:?}");
        }
    }

    #[test]
    fn who_sends_a_datagram_is_sent_to_and_what_is_malformed_is_counted() {
        let address = Address::read("udpin:127.0.0.1:0").unwrap();
        let link = Link::open(address).unwrap();
        let peer = UdpSocket::bind("127.0.0.1:0").unwrap();
        peer.set_read_timeout(Some(Duration::from_secs(10)))
            .unwrap();
        peer.send_to(b"no message", link.address().at).unwrap();
        peer.send_to(&framed(9), link.address().at).unwrap();
        let heard = (0..1_000).find_map(|_| {
            thread::sleep(Duration::from_millis(5));
            link.hear()
        });
        let (header, message) = heard.unwrap();
        assert_eq!(header.system_id, 9);
        let told = link.counts().told();
        assert_eq!(told.as_deref(), Some("1 malformed and ignored"));
        link.send(header, &message);
        let mut bytes = [0; 64];
        let (count, from) = peer.recv_from(&mut bytes).unwrap();
        assert_eq!((&bytes[..count], from), (&framed(9)[..], link.address().at));
    }
}
