//! What a client of AirSim sends to `boresight serve --airsim`.
#![no_main]

#[path = "../common.rs"]
mod common;

use boresight_airsim::arguments::{vector, whole};
use boresight_airsim::{Arguments, Reader};

libfuzzer_sys::fuzz_target!(init: common::init(), |data: &[u8]| {
    let mut reader = Reader::new(data);
    while let Ok((call, _)) = reader.read() {
        // What was read is written and read again as the same; numbers that are none equal nothing: bytes are compared.
        let bytes = call.encode();
        let (again, _) = Reader::new(&bytes[..]).read().expect("own bytes");
        assert!(again.encode() == bytes);
        let mut arguments = Arguments::new(&call.method, call.arguments.clone());
        let _ = arguments.text("a");
        let _ = arguments.number("b");
        let _ = arguments.list("c", "places", vector);
        let _ = arguments.list("d", "numbers", whole);
        let _ = arguments.flag("e");
    }
});
