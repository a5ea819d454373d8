//! What comes of a call.

use crate::serve::error::ServeError;
use crate::serve::inbox::Client;
use boresight_airsim::{Value, reply};

/// Why a call has no result: the client is told, or the run is at its end.
pub(super) enum Fault {
    Refused(String),
    Fatal(ServeError),
}

impl From<String> for Fault {
    fn from(why: String) -> Self {
        Self::Refused(why)
    }
}

/// What comes of a call.
pub(super) enum Answer {
    /// This is its result.
    Now(Value),
    /// Its result comes later.
    Later,
    /// The run begins anew; then the result is nil.
    Reset,
}

impl From<Value> for Answer {
    fn from(value: Value) -> Self {
        Self::Now(value)
    }
}

/// Time \[ns\] of one in seconds.
pub(super) fn time_ns(t_s: f64) -> u64 {
    (1e9 * t_s).round() as u64
}

/// Answers a call that wants an answer.
pub(super) fn say_to(client: &Client, id: Option<u32>, value: Value) {
    if let Some(id) = id {
        client.outbox.post(reply(id, value));
    }
}
