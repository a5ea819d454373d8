//! The topics of a run over Foxglove's WebSocket, while it goes on.
//!
//! Nothing that a client sends reaches the run. Each has a queue of its own that the server's threads work off; what no
//! longer fits pushes out the oldest, so that nobody who looks on holds up a tick.

use foxglove::websocket::{Capability, ChannelView, Client, ServerListener};
use foxglove::{
    ChannelBuilder, Context, FoxgloveError, PartialMetadata, RawChannel, Schema, WebSocketServer,
    WebSocketServerHandle,
};
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread;
use std::time::{Duration, Instant};

/// Messages that wait for a client at most: some seconds of a run in real time.
const BACKLOG: usize = 8192;
/// Wall-clock time between two messages of the clock.
const CLOCK_PERIOD: Duration = Duration::from_millis(16);
/// Wall-clock time that clients have for what is in their queues when a run is over: closing empties them.
const LAST_MESSAGES: Duration = Duration::from_millis(200);
/// Wall-clock time after which a client that takes nothing any more is left behind.
const CLOSING: Duration = Duration::from_secs(1);

/// Why a run cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The address cannot be had.
    #[error("--live: cannot listen on {address}: {source}; choose another address or port")]
    Bind {
        /// The address asked for.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// The server refused something else.
    #[error("--live: {0}; leave it out, or choose another address")]
    Server(#[from] FoxgloveError),
}

/// A topic with what a client gets when it subscribes.
struct Topic {
    channel: Arc<RawChannel>,
    /// Log time \[ns\] and bytes: the messages of the set-up, which come once, and those of the topic's last tick.
    kept: Mutex<Vec<(u64, Vec<u8>)>>,
}

impl Topic {
    fn keep(&self, start_ns: u64, log_time_ns: u64, message: &[u8]) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept
            .last()
            .is_some_and(|(last_ns, _)| *last_ns < log_time_ns)
        {
            kept.retain(|(kept_ns, _)| *kept_ns == start_ns);
        }
        kept.push((log_time_ns, message.to_vec()));
    }
}

struct Topics(Vec<Topic>);

impl ServerListener for Topics {
    fn on_subscribe(&self, client: Client, channel: ChannelView) {
        for topic in self.0.iter().filter(|t| t.channel.id() == channel.id()) {
            let kept = topic.kept.lock().unwrap_or_else(PoisonError::into_inner);
            for (log_time_ns, message) in &*kept {
                let time = PartialMetadata::with_log_time(*log_time_ns);
                (topic.channel).log_with_meta_to_sink(message, time, client.sink_id());
            }
        }
    }
}

/// Serves one run. Dropping it closes the connections.
pub struct Live {
    address: SocketAddr,
    /// Connects channels and clients for as long as it lives.
    _context: Arc<Context>,
    topics: Arc<Topics>,
    server: Option<WebSocketServerHandle>,
    start_ns: u64,
    clock_sent: Option<Instant>,
}

impl Live {
    /// Listens on an address, with port 0 on one that is free. `channels` are topics with message encoding and schema;
    /// the set-up's messages have the log time `start_ns` \[ns\].
    pub fn start(
        address: SocketAddr,
        name: &str,
        start_ns: u64,
        channels: Vec<(String, &str, Option<Schema>)>,
    ) -> Result<Self, LiveError> {
        let context = Context::new();
        let topic = |(topic, encoding, schema): (String, &str, Option<Schema>)| {
            let channel = ChannelBuilder::new(topic).context(&context);
            Ok::<_, FoxgloveError>(Topic {
                channel: (channel.message_encoding(encoding).schema(schema)).build_raw()?,
                kept: Mutex::default(),
            })
        };
        let topics = channels
            .into_iter()
            .map(topic)
            .collect::<Result<Vec<_>, _>>()?;
        let topics = Arc::new(Topics(topics));
        let host = match address.ip() {
            IpAddr::V4(ip) => ip.to_string(),
            IpAddr::V6(ip) => format!("[{ip}]"),
        };
        let server = WebSocketServer::new()
            .name(name)
            .bind(host, address.port())
            .capabilities([Capability::Time])
            .message_backlog_size(BACKLOG)
            .context(&context)
            .listener(topics.clone())
            .start_blocking()
            .map_err(|error| match error {
                FoxgloveError::Bind(source) => LiveError::Bind { address, source },
                error => error.into(),
            })?;
        Ok(Self {
            address: SocketAddr::new(address.ip(), server.port()),
            _context: context,
            topics,
            server: Some(server),
            start_ns,
            clock_sent: None,
        })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Sends a message on a channel, by its number, to all who have subscribed to it.
    pub fn send(&self, channel: usize, log_time_ns: u64, message: &[u8]) {
        let topic = &self.topics.0[channel];
        topic.keep(self.start_ns, log_time_ns, message);
        let time = PartialMetadata::with_log_time(log_time_ns);
        topic.channel.log_with_meta(message, time);
    }

    /// Tells the clients what time it is in the run, as often as a screen can show it.
    pub fn set_clock(&mut self, log_time_ns: u64) {
        let due = |sent: Instant| sent.elapsed() >= CLOCK_PERIOD;
        if let Some(server) = self
            .server
            .as_ref()
            .filter(|_| self.clock_sent.is_none_or(due))
        {
            server.broadcast_time(log_time_ns);
            self.clock_sent = Some(Instant::now());
        }
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        let Some(server) = self.server.take() else {
            return;
        };
        if server.client_count() > 0 {
            thread::sleep(LAST_MESSAGES);
        }
        // A client that takes nothing would keep this waiting for ever.
        let (done, closed) = mpsc::channel();
        let close = move || {
            server.stop().wait_blocking();
            let _ = done.send(());
        };
        if thread::Builder::new().spawn(close).is_ok() {
            let _ = closed.recv_timeout(CLOSING);
        }
    }
}
