//! A glTF model: JSON and, after a zero, binary data, in a container whose lengths are right.
#![no_main]

#[path = "../common.rs"]
mod common;

use boresight_geodata::tiles::content::{UpAxis, decode};

libfuzzer_sys::fuzz_target!(init: common::init(), |data: &[u8]| {
    let at = data.iter().position(|byte| *byte == 0).unwrap_or(data.len());
    let (json, bin) = (&data[..at], data.get(at + 1..).unwrap_or_default());
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", bin)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    let fetch = |uri: &str| match uri.len() % 2 {
        0 => Ok(bin.to_vec()),
        _ => Err("there is no such file".to_owned()),
    };
    let _ = decode(&file, UpAxis::Z, &fetch);
});
