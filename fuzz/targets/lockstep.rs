//! What a client sends to `boresight serve`, and what a server sends back.
#![no_main]

#[path = "../common.rs"]
mod common;

use boresight_lockstep::proto::{Reply, Request};
use boresight_lockstep::{FramingError, Reader, encode};

/// Reads messages until there are no more; what was read is written and read again as the same.
fn read_all<M: prost::Message + Default + PartialEq>(data: &[u8], limit: usize) {
    let mut reader = Reader::new(data, limit);
    loop {
        match reader.read::<M>() {
            Ok((message, _)) => {
                let bytes = encode(&message);
                // Numbers that are none equal nothing: bytes are compared.
                let (again, _) = Reader::new(&bytes[..], bytes.len()).read::<M>().expect("own bytes");
                assert!(encode(&again) == bytes);
            }
            Err(FramingError::Malformed { .. }) => {}
            Err(_) => return,
        }
    }
}

libfuzzer_sys::fuzz_target!(init: common::init(), |data: &[u8]| {
    read_all::<Request>(data, boresight_lockstep::MAX_REQUEST_BYTES);
    read_all::<Reply>(data, boresight_lockstep::MAX_REPLY_BYTES);
});
