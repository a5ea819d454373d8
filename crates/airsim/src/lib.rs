#![doc = include_str!("../README.md")]

pub mod arguments;
pub mod frames;
mod framing;
pub mod messages;

pub use arguments::Arguments;
pub use framing::{Call, FramingError, Reader, refusal, reply};
pub use rmpv::Value;

/// Longest call that a server reads \[byte\].
pub const MAX_CALL_BYTES: usize = 1 << 20;

/// Most values of a call, those within others counted: a path has four for each of its places.
pub const MAX_CALL_VALUES: usize = 100_000;

/// How deeply a call's values may lie within one another: a list of images to be taken lies three deep.
pub const MAX_DEPTH: usize = 12;
