//! Any content of a tile.
#![no_main]

#[path = "../common.rs"]
mod common;

use boresight_geodata::tiles::content::{UpAxis, decode};

libfuzzer_sys::fuzz_target!(init: common::init(), |data: &[u8]| {
    let nothing = |_: &str| Err("there is nothing else".to_owned());
    let _ = decode(data, UpAxis::Y, &nothing);
});
