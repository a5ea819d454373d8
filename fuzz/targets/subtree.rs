//! A subtree of implicit tiles: of a quadtree or, where the first byte is odd, of an octree.
#![no_main]

#[path = "../common.rs"]
mod common;

use boresight_models::tiles::tree::TileId;
use boresight_geodata::tiles::tileset::Tileset;

libfuzzer_sys::fuzz_target!(init: common::init(), |data: &[u8]| {
    let Some((first, data)) = data.split_first() else { return };
    // A subtree as it is stored begins with `s`, which is odd.
    let (scheme, data) = match first % 2 {
        1 if *first != b's' => ("OCTREE", data),
        1 => ("QUADTREE", &[b"s", data].concat()[..]),
        _ => ("QUADTREE", data),
    };
    if common::leads_away(data) {
        return;
    }
    let tileset = format!(
        r#"{{"asset":{{"version":"1.1"}},"geometricError":100,"root":{{"boundingVolume":{{"box":[0,0,0,8,0,0,0,8,0,0,0,8]}},
        "geometricError":100,"refine":"ADD","content":{{"uri":"{{level}}.{{x}}.{{y}}.glb"}},"implicitTiling":{{
        "subdivisionScheme":"{scheme}","availableLevels":6,"subtreeLevels":3,"subtrees":{{"uri":"own.subtree"}}}}}}}}"#
    );
    common::file("own.subtree", data);
    let file = common::file("tileset.json", tileset.as_bytes());
    let Ok(mut tileset) = Tileset::open(&file.to_string_lossy()) else { return };
    for tile in 0..tileset.tree.tiles().len().min(4) {
        let _ = tileset.expand(TileId(tile as u32));
    }
});
