//! A height raster.
#![no_main]

#[path = "../common.rs"]
mod common;

use boresight_geodata::sources::{geotiff, options::Options};

libfuzzer_sys::fuzz_target!(init: common::init(), |data: &[u8]| {
    let file = common::file("own.tif", data);
    let options = Options { crs: Some("EPSG:21781".into()), ..Options::default() };
    let _ = geotiff::read(&file, &options);
});
