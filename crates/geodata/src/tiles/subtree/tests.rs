use super::*;
use boresight_models::tiles::implicit::Scheme;
use boresight_models::tiles::tree::Refine;
use boresight_models::tiles::volume::BoundingVolume;
use glam::{DAffine3, DMat3, DVec3};
use proptest::prelude::*;
use serde_json::json;

fn tiling(schema: Option<Value>) -> Arc<Tiling> {
    Arc::new(Tiling {
        scheme: Scheme::Quadtree,
        subtree_levels: 2,
        available_levels: 4,
        base: "/t/tileset.json".into(),
        subtrees: "s/{level}.{x}.{y}.subtree".into(),
        contents: vec!["c/{level}/{x}/{y}.glb".into()],
        volume: BoundingVolume::Box {
            center_m: DVec3::ZERO,
            half_axes_m: DMat3::from_diagonal(DVec3::splat(8.0)),
        },
        error_m: 16.0,
        refine: Refine::Replace,
        to_root_m: DAffine3::IDENTITY,
        schema: schema.map(Arc::new),
    })
}

fn binary(json: &Value, buffer: &[u8]) -> Vec<u8> {
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(8), b' ');
    let mut bytes = b"subt\x01\0\0\0".to_vec();
    bytes.extend((json.len() as u64).to_le_bytes());
    bytes.extend((buffer.len() as u64).to_le_bytes());
    bytes.extend(json);
    bytes.extend(buffer);
    bytes
}

fn read(bytes: &[u8]) -> Result<Expansion, TilesError> {
    subtree(
        &Fetcher::default(),
        "/t/s/0.0.0.subtree",
        bytes,
        &tiling(None),
        Coordinates::default(),
    )
}

/// Tiles: root, (1,0) and (0,1); contents of the root and of (0,1); below (0,1) the subtrees (0,2) and (1,3).
fn sparse() -> (Value, Vec<u8>) {
    let json = json!({
        "buffers": [{ "byteLength": 16 }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 1 },
            { "buffer": 0, "byteOffset": 1, "byteLength": 1 },
            { "buffer": 0, "byteOffset": 8, "byteLength": 2 },
        ],
        "tileAvailability": { "bitstream": 0 },
        "contentAvailability": [{ "bitstream": 1 }],
        "childSubtreeAvailability": { "bitstream": 2 },
    });
    let mut buffer = vec![0; 16];
    (buffer[0], buffer[1]) = (0b0_1101, 0b0_1001);
    // Of (0,1), the third of its level: the first and the last child; and one of a tile that is not there.
    buffer[9] = 0b1001;
    buffer[8] = 0b1;
    (json, buffer)
}

#[test]
fn a_sparse_subtree_has_its_tiles() {
    let (json, buffer) = sparse();
    let read = read(&binary(&json, &buffer)).unwrap();
    assert_eq!(read.contents, ["/t/c/0/0/0.glb"]);
    assert_eq!((read.roots.clone(), read.tiles.len()), (0..2, 4));
    let contents: Vec<_> = read.tiles.iter().map(|t| t.tile.contents.clone()).collect();
    assert_eq!(
        contents,
        [vec![], vec!["/t/c/1/0/1.glb".to_string()], vec![], vec![]]
    );
    assert_eq!(read.tiles[1].children, 2..4);
    let unread: Vec<_> = read
        .tiles
        .iter()
        .filter_map(|t| t.tile.unread.clone())
        .collect();
    assert_eq!(unread, ["/t/s/2.0.2.subtree", "/t/s/2.1.3.subtree"]);
    assert_eq!(read.tiles[1].tile.geometric_error_m, 8.0);
    let BoundingVolume::Box {
        center_m,
        half_axes_m,
    } = read.tiles[1].tile.volume
    else {
        panic!()
    };
    assert_eq!(
        (center_m, half_axes_m.x_axis.x, half_axes_m.z_axis.z),
        (DVec3::new(-4.0, 4.0, 0.0), 4.0, 8.0)
    );
}

#[test]
fn json_constants_and_external_buffers_are_read() {
    let all = json!({
        "tileAvailability": { "constant": 1 },
        "contentAvailability": [{ "constant": 0 }],
        "childSubtreeAvailability": { "constant": 1 },
    });
    let all = read(all.to_string().as_bytes()).unwrap();
    assert_eq!(all.tiles.len(), 4 + 16);
    assert!(all.contents.is_empty() && all.tiles[4].tile.unread.is_some());

    let (mut json, buffer) = sparse();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("b.bin"), &buffer).unwrap();
    json["buffers"][0]["uri"] = "b.bin".into();
    let location = folder.path().join("x.json");
    let location = location.to_str().unwrap();
    let bytes = json.to_string();
    let read = subtree(
        &Fetcher::default(),
        location,
        bytes.as_bytes(),
        &tiling(None),
        Coordinates::default(),
    );
    assert_eq!(read.unwrap().tiles.len(), 4);
}

#[test]
fn metadata_says_where_tiles_lie() {
    let (mut json, mut buffer) = sparse();
    // Rows: the root, (1,0) and (0,1), the tiles that there are.
    for row in 0..3 {
        let numbers = [
            f64::from(row),
            0.0,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
            1.0,
        ];
        buffer.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
    }
    for error in [9.0f32, 5.0, 4.0] {
        buffer.extend(error.to_le_bytes());
    }
    json["buffers"][0]["byteLength"] = buffer.len().into();
    let views = json["bufferViews"].as_array_mut().unwrap();
    views.push(json!({ "buffer": 0, "byteOffset": 16, "byteLength": 288 }));
    views.push(json!({ "buffer": 0, "byteOffset": 304, "byteLength": 12 }));
    json["propertyTables"] = json!([{ "class": "tile", "count": 3, "properties": {
        "where": { "values": 3 }, "error": { "values": 4 }
    } }]);
    json["tileMetadata"] = 0.into();
    let schema = json!({ "classes": { "tile": { "properties": {
        "where": { "type": "SCALAR", "array": true, "count": 12, "componentType": "FLOAT64", "semantic": "TILE_BOUNDING_BOX" },
        "error": { "type": "SCALAR", "componentType": "FLOAT32", "semantic": "TILE_GEOMETRIC_ERROR" },
        "name": { "type": "STRING" },
    } } } });
    let read = subtree(
        &Fetcher::default(),
        "/t/x",
        &binary(&json, &buffer),
        &tiling(Some(schema)),
        Coordinates::default(),
    );
    let read = read.unwrap();
    let x = |i: usize| match read.tiles[i].tile.volume {
        BoundingVolume::Box { center_m, .. } => center_m.x,
        _ => panic!(),
    };
    assert_eq!((x(0), x(1)), (1.0, 2.0));
    assert_eq!(
        (
            read.tiles[0].tile.geometric_error_m,
            read.tiles[1].tile.geometric_error_m
        ),
        (5.0, 4.0)
    );
}

#[test]
fn faults_name_their_place() {
    let (json, buffer) = sparse();
    let told = |change: &dyn Fn(&mut Value)| {
        let mut json = json.clone();
        change(&mut json);
        read(&binary(&json, &buffer)).unwrap_err().to_string()
    };
    let missing = told(&|json| _ = json.as_object_mut().unwrap().remove("tileAvailability"));
    assert!(missing.contains("tileAvailability"), "{missing}");
    let beyond = told(&|json| json["bufferViews"][1]["byteLength"] = 99.into());
    assert!(beyond.contains("bufferViews[1]"), "{beyond}");
    let short = told(&|json| json["childSubtreeAvailability"]["bitstream"] = 0.into());
    assert!(short.contains("fewer"), "{short}");
    let none = told(&|json| json["tileAvailability"] = json!({ "constant": 0 }));
    assert!(none.contains("root"), "{none}");
    assert!(read(b"subt\x01\0\0\0").is_err() && read(b"what").is_err() && read(b"").is_err());
    let mut lying = binary(&json, &buffer);
    lying[16..24].copy_from_slice(&u64::MAX.to_le_bytes());
    assert!(read(&lying).is_err());
}

#[test]
fn a_few_bytes_cannot_promise_more_tiles_than_are_kept() {
    let json = br#"{"tileAvailability":{"constant":1},"childSubtreeAvailability":{"constant":1}}"#;
    let deep = Tiling {
        subtree_levels: 60,
        available_levels: 60,
        ..Tiling::clone(&tiling(None))
    };
    let read = subtree(
        &Fetcher::default(),
        "/t/x",
        json,
        &Arc::new(deep),
        Coordinates::default(),
    );
    assert!(read.unwrap_err().to_string().contains("more than"));
}

proptest! {
    #[test]
    fn damaged_subtrees_are_errors_or_trees(at in 0usize..600, byte: u8, cut in 0usize..600) {
        let (json, buffer) = sparse();
        let mut bytes = binary(&json, &buffer);
        let at = at % bytes.len();
        bytes[at] = byte;
        bytes.truncate(bytes.len() - cut.min(bytes.len()) * usize::from(cut % 3 == 0));
        if let Ok(read) = read(&bytes) {
            prop_assert!(read.tiles.len() <= 20);
        }
    }
}
