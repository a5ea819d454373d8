//! A tileset's JSON, and whatever it leads to beside it.
#![no_main]

#[path = "../common.rs"]
mod common;

use boresight_models::tiles::tree::TileId;
use boresight_geodata::tiles::tileset::Tileset;

libfuzzer_sys::fuzz_target!(init: common::init(), |data: &[u8]| {
    if common::leads_away(data) {
        return;
    }
    let file = common::file("tileset.json", data);
    let Ok(mut tileset) = Tileset::open(&file.to_string_lossy()) else { return };
    for tile in 0..tileset.tree.tiles().len().min(8) {
        let _ = tileset.expand(TileId(tile as u32));
    }
});
