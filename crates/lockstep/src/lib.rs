#![doc = include_str!("../README.md")]

mod client;
mod endpoint;
mod framing;

pub use client::{Client, ClientError};
pub use endpoint::{Connection, Endpoint, EndpointError, Listener};
pub use framing::{FramingError, Reader, encode};

/// The messages, generated from `proto/lockstep.proto`.
pub mod proto {
    include!(concat!(env!("OUT_DIR"), "/boresight.lockstep.v1.rs"));
}

/// The schema as text, for clients in other languages.
pub const SCHEMA: &str = include_str!("../proto/lockstep.proto");

/// Version of the schema.
pub const VERSION: u32 = 1;

/// Longest message that a server reads \[byte\].
pub const MAX_REQUEST_BYTES: usize = 1 << 20;

/// Longest message that a client reads \[byte\]: frames with their pixels are long.
pub const MAX_REPLY_BYTES: usize = 256 << 20;
