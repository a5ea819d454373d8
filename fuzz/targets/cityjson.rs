//! A city model.
#![no_main]

#[path = "../common.rs"]
mod common;

use boresight_geodata::sources::{cityjson, options::Options};

libfuzzer_sys::fuzz_target!(init: common::init(), |data: &[u8]| {
    let file = common::file("own.city.json", data);
    let options = Options { crs: Some("EPSG:7415".into()), ..Options::default() };
    let _ = cityjson::read_all(&file, &options);
});
