//! The formats of 3D Tiles 1.0.

use super::*;
use crate::tiles::content::Fault;
use boresight_models::shape::textured::NO_FEATURE;
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;

/// The triangle with `_BATCHID` 1, 1, 0.
fn batched() -> Vec<u8> {
    let (mut model, _) = triangle();
    let ids = model.add("SCALAR", 5126, 3, &bytes![f32; 1.0, 1.0, 0.0]);
    model.glb(
        json!({"meshes": [{"primitives": [{"attributes": {"POSITION": 0, "_BATCHID": ids}}]}]}),
    )
}

#[test]
fn a_b3dm_stands_about_its_center_with_z_up() {
    let center = br#"{"BATCH_LENGTH":2,"RTC_CENTER":[4000000.125,-2.5,1e6]}"#;
    let batch = br#"{"name":["shed","tower"],"height_m":{"byteOffset":8,"componentType":"DOUBLE","type":"SCALAR"}}"#;
    let binary = bytes![f64; 0.0, 3.5, 41.25];
    let file = tile(b"b3dm", &[], [center, &[], batch, &binary], &batched());
    let content = alone(&file).unwrap();
    // glTF's y is up: (x, y, z) becomes (x, -z, y).
    near(
        &corners(&content),
        &[
            [4000000.125, -2.5, 1e6],
            [4000001.125, -2.5, 1e6],
            [4000000.125, -2.5, 1000002.0],
        ],
    );
    assert_eq!(content.meshes[0].mesh.features, [1, 1, 0]);
    assert_eq!(content.features[1]["name"], "tower");
    assert_eq!(content.features[1]["height_m"], 41.25);
    assert_eq!(content.features.len(), 2);
    assert!(content.notes.is_empty(), "{:?}", content.notes);
}

#[test]
fn a_center_may_lie_in_the_binary_part() {
    let head = br#"{"BATCH_LENGTH":0,"RTC_CENTER":{"byteOffset":4}}"#;
    let binary = bytes![f32; 9.0, 1.0, 2.0, 3.0];
    let file = tile(b"b3dm", &[], [head, &binary, &[], &[]], &triangle_glb());
    let content = alone(&file).unwrap();
    near(&corners(&content)[..1], &[[1.0, 2.0, 3.0]]);
}

#[test]
fn two_older_b3dm_headers_are_known() {
    let batch: &[u8] = br#"{"id":[10,20]}"#;
    let mut first = b"b3dm".to_vec();
    let model = batched();
    let length = |header: usize| (header + batch.len() + model.len()) as u32;
    first.extend(bytes![u32; 1, length(20), 2, batch.len() as u32]);
    let mut second = b"b3dm".to_vec();
    second.extend(bytes![u32; 1, length(24), batch.len() as u32, 0, 2]);
    for mut file in [first, second] {
        file.extend(batch);
        file.extend(&model);
        let content = alone(&file).unwrap();
        assert_eq!(content.triangle_count(), 1);
        assert_eq!(content.features[1]["id"], 20);
        assert_eq!(content.meshes[0].mesh.features, [1, 1, 0]);
    }
}

#[test]
fn hierarchies_of_batch_tables_are_left_out_with_a_note() {
    let batch = br#"{"id":[1,2],"extensions":{"3DTILES_batch_table_hierarchy":{"classes":[]}}}"#;
    let file = tile(
        b"b3dm",
        &[],
        [br#"{"BATCH_LENGTH":2}"#, &[], batch, &[]],
        &batched(),
    );
    let content = alone(&file).unwrap();
    assert_eq!(content.features[0].len(), 1);
    assert_eq!(
        content.notes,
        ["left out of the batch table: 3DTILES_batch_table_hierarchy"]
    );
}

#[test]
fn the_up_axis_turns_the_model() {
    let of = |axis| corners(&decode(&triangle_glb(), axis, &|_| Err(String::new())).unwrap());
    near(
        &of(UpAxis::Z),
        &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]],
    );
    near(
        &of(UpAxis::Y),
        &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 2.0]],
    );
    near(
        &of(UpAxis::X),
        &[[0.0; 3], [0.0, 0.0, 1.0], [0.0, 2.0, 0.0]],
    );
}

#[test]
fn instances_turn_and_scale() {
    let head = br#"{"INSTANCES_LENGTH":2,"RTC_CENTER":[100,0,0],"POSITION":{"byteOffset":0},
        "NORMAL_UP":{"byteOffset":24},"NORMAL_RIGHT":{"byteOffset":48},"SCALE":{"byteOffset":72},
        "BATCH_ID":{"byteOffset":80,"componentType":"UNSIGNED_BYTE"}}"#;
    let mut binary = bytes![f32;
        1.0, 2.0, 3.0, 10.0, 20.0, 30.0,
        0.0, 1.0, 0.0, 0.0, 0.0, 1.0,
        1.0, 0.0, 0.0, 0.0, 1.0, 0.0,
        1.0, 2.0];
    binary.extend([1, 0]);
    let batch = br#"{"kind":["oak","lime"]}"#;
    let file = tile(
        b"i3dm",
        &bytes![u32; 1],
        [head, &binary, batch, &[]],
        &triangle_glb(),
    );
    let content = alone(&file).unwrap();
    assert_eq!(content.meshes.len(), 1);
    assert_eq!(content.meshes[0].placement_features, [1, 0]);
    assert_eq!(content.features[1]["kind"], "lime");
    // Turned to z up the triangle has corners 0, (1, 0, 0), (0, 0, 2). The second instance has right = y, up = z,
    // right × up = x, and twice the size.
    near(
        &corners(&content),
        &[
            [101.0, 2.0, 3.0],
            [102.0, 2.0, 3.0],
            [101.0, 2.0, 5.0],
            [110.0, 20.0, 30.0],
            [110.0, 22.0, 30.0],
            [114.0, 20.0, 30.0],
        ],
    );
}

#[test]
fn quantized_instances_of_a_model_elsewhere() {
    // OCT32P (65535, 32768) is nearly x, (32768, 65535) nearly y: identity.
    let head = br#"{"INSTANCES_LENGTH":1,"POSITION_QUANTIZED":{"byteOffset":0},"QUANTIZED_VOLUME_OFFSET":[10,20,30],
        "QUANTIZED_VOLUME_SCALE":[65535,655350,6553500],"NORMAL_UP_OCT32P":{"byteOffset":6},
        "NORMAL_RIGHT_OCT32P":{"byteOffset":10},"SCALE_NON_UNIFORM":{"byteOffset":16}}"#;
    let mut binary = bytes![u16; 1, 2, 3, 32768, 65535, 65535, 32768, 0];
    binary.extend(bytes![f32; 1.0, 1.0, 0.5]);
    let file = tile(
        b"i3dm",
        &bytes![u32; 0],
        [head, &binary, &[], &[]],
        b"models/tree.glb \0",
    );
    let fetch = |uri: &str| match uri {
        "models/tree.glb" => Ok(triangle_glb()),
        other => Err(format!("no {other}")),
    };
    let content = decode(&file, UpAxis::Y, &fetch).unwrap();
    let found = corners(&content);
    for (found, expected) in found.iter().zip([
        [11.0, 40.0, 330.0],
        [12.0, 40.0, 330.0],
        [11.0, 40.0, 331.0],
    ]) {
        // A step of the octahedron is 1.5e-5 of the unit sphere.
        assert!((*found - DVec3::from(expected)).length() < 1e-4, "{found}");
    }
    let broken = decode(&file, UpAxis::Y, &|_| Err("no such file".into())).unwrap_err();
    assert!(
        matches!(&broken.fault, Fault::Missing { uri, .. } if uri == "models/tree.glb"),
        "{broken}"
    );
}

#[test]
fn what_a_model_elsewhere_refers_to_lies_beside_it() {
    let head = br#"{"INSTANCES_LENGTH":1,"POSITION":[0,0,0]}"#;
    let model = json!({"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"uri": "tree.bin", "byteLength": 36}]});
    let fetch = |uri: &str| match uri {
        "models/oak/tree.gltf" => Ok(model.to_string().into_bytes()),
        "models/oak/tree.bin" => Ok(CORNERS.iter().flat_map(|x| x.to_le_bytes()).collect()),
        other => Err(format!("no {other}")),
    };
    let file = tile(
        b"i3dm",
        &bytes![u32; 0],
        [head, &[], &[], &[]],
        b"models/oak/tree.gltf",
    );
    assert_eq!(
        decode(&file, UpAxis::Y, &fetch).unwrap().triangle_count(),
        1
    );
}

#[test]
fn instances_on_the_globe_stand_upright() {
    let head = br#"{"INSTANCES_LENGTH":1,"POSITION":[6378137.0,0,0],"EAST_NORTH_UP":true}"#;
    let file = tile(
        b"i3dm",
        &bytes![u32; 1],
        [head, &[], &[], &[]],
        &triangle_glb(),
    );
    // At 0° N 0° E east is y, north is z, up is x.
    near(
        &corners(&alone(&file).unwrap()),
        &[
            [6378137.0, 0.0, 0.0],
            [6378137.0, 1.0, 0.0],
            [6378139.0, 0.0, 0.0],
        ],
    );
}

#[test]
fn mirroring_instances_wind_the_right_way() {
    let head = br#"{"INSTANCES_LENGTH":1,"POSITION":[0,0,0],"SCALE_NON_UNIFORM":[-1,1,1]}"#;
    let file = tile(
        b"i3dm",
        &bytes![u32; 1],
        [head, &[], &[], &[]],
        &triangle_glb(),
    );
    let found = corners(&alone(&file).unwrap());
    // The mirrored triangle, seen from where its front was: its normal (0, -1, 0) is the same.
    let normal = (found[1] - found[0]).cross(found[2] - found[0]).normalize();
    assert!((normal - DVec3::NEG_Y).length() < 1e-9, "{normal}");
    near(&found, &[[0.0; 3], [0.0, 0.0, 2.0], [-1.0, 0.0, 0.0]]);
}

#[test]
fn points_with_all_kinds_of_colours() {
    let position: &[u8] = &bytes![f32; 1.0, 2.0, 3.0, 3.0, 2.0, 1.0];
    type Case = (&'static str, Vec<u8>, [[f32; 4]; 2]);
    let cases: [Case; 4] = [
        (
            r#""RGB":{"byteOffset":24}"#,
            vec![255, 0, 0, 0, 255, 188],
            [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.502_886, 1.0]],
        ),
        (
            r#""RGBA":{"byteOffset":24}"#,
            vec![255, 0, 0, 51, 0, 255, 188, 0],
            [[1.0, 0.0, 0.0, 0.2], [0.0, 1.0, 0.502_886, 0.0]],
        ),
        (
            r#""RGB565":{"byteOffset":24}"#,
            bytes![u16; 0xf800, 0x07e0],
            [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]],
        ),
        (
            r#""CONSTANT_RGBA":[0,0,255,255]"#,
            vec![],
            [[0.0, 0.0, 1.0, 1.0]; 2],
        ),
    ];
    for (semantic, color, expected) in cases {
        let head = format!(
            r#"{{"POINTS_LENGTH":2,"RTC_CENTER":[1e6,0,0],"POSITION":{{"byteOffset":0}},{semantic}}}"#
        );
        let binary = [position, &color].concat();
        let file = tile(b"pnts", &[], [head.as_bytes(), &binary, &[], &[]], &[]);
        let content = alone(&file).unwrap();
        let cloud = &content.points[0];
        assert_eq!(cloud.origin_m, DVec3::new(1e6 + 2.0, 2.0, 2.0));
        assert_eq!(cloud.positions, [[-1.0, 0.0, 1.0], [1.0, 0.0, -1.0]]);
        for (found, expected) in cloud.colors.iter().flatten().zip(expected.as_flattened()) {
            assert!(
                (found - expected).abs() < 1e-5,
                "{semantic}: {found} instead of {expected}"
            );
        }
    }
}

#[test]
fn quantized_points_with_normals_and_features() {
    let head = br#"{"POINTS_LENGTH":2,"POSITION_QUANTIZED":{"byteOffset":0},"QUANTIZED_VOLUME_OFFSET":[0,0,5],
        "QUANTIZED_VOLUME_SCALE":[65535,65535,65535],"NORMAL_OCT16P":{"byteOffset":12},
        "BATCH_ID":{"byteOffset":16,"componentType":"UNSIGNED_BYTE"},"BATCH_LENGTH":2}"#;
    let mut binary = bytes![u16; 0, 0, 0, 2, 4, 6];
    binary.extend([255, 128, 0, 0, 1, 9]);
    let file = tile(
        b"pnts",
        &[],
        [head, &binary, br#"{"part":["roof","wall"]}"#, &[]],
        &[],
    );
    let content = alone(&file).unwrap();
    let cloud = &content.points[0];
    assert_eq!(cloud.origin_m, DVec3::new(1.0, 2.0, 8.0));
    assert_eq!(cloud.positions, [[-1.0, -2.0, -3.0], [1.0, 2.0, 3.0]]);
    // (1, 0) of the unfolded octahedron is x; its corner (-1, -1) is -z.
    let close = |a: [f32; 3], b: [f32; 3]| (0..3).all(|i| (a[i] - b[i]).abs() < 0.02);
    assert!(
        close(cloud.normals[0], [1.0, 0.0, 0.0]),
        "{:?}",
        cloud.normals
    );
    assert!(
        close(cloud.normals[1], [0.0, 0.0, -1.0]),
        "{:?}",
        cloud.normals
    );
    assert_eq!(cloud.features, [1, NO_FEATURE]);
    assert_eq!(content.features[1]["part"], "wall");
}

/// A composite of tiles.
fn composite(tiles: &[Vec<u8>]) -> Vec<u8> {
    let body = tiles.concat();
    let mut file = b"cmpt".to_vec();
    file.extend(bytes![u32; 1, 16 + body.len() as u32, tiles.len() as u32]);
    file.extend(body);
    file
}

#[test]
fn composites_nest_and_their_features_follow_each_other() {
    let one = tile(
        b"b3dm",
        &[],
        [br#"{"BATCH_LENGTH":2}"#, &[], br#"{"n":[1,2]}"#, &[]],
        &batched(),
    );
    let points = tile(
        b"pnts",
        &[],
        [br#"{"POINTS_LENGTH":1,"POSITION":[1,2,3]}"#, &[], &[], &[]],
        &[],
    );
    let nested = composite(&[one.clone(), composite(&[points, one])]);
    let content = alone(&nested).unwrap();
    assert_eq!((content.triangle_count(), content.point_count()), (2, 1));
    assert_eq!(content.features.len(), 4);
    assert_eq!(content.meshes[0].mesh.features, [1, 1, 0]);
    assert_eq!(content.meshes[1].mesh.features, [3, 3, 2]);
    let mut deep = composite(&[]);
    for _ in 0..20 {
        deep = composite(&[deep]);
    }
    let refused = alone(&deep).unwrap_err();
    assert!(matches!(refused.fault, Fault::Unsupported(_)), "{refused}");
    assert!(
        refused.place.starts_with("cmpt, tile 0, cmpt, tile 0"),
        "{refused}"
    );
}

#[test]
fn gzip_around_a_content_is_undone() {
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(&triangle_glb()).unwrap();
    assert_eq!(
        alone(&packed.finish().unwrap()).unwrap(),
        alone(&triangle_glb()).unwrap()
    );
}

#[test]
fn what_is_no_content_is_one_clear_error() {
    for (bytes, expected) in [
        (
            &b""[..],
            "content: is no content of 3D Tiles: it begins with \"\"",
        ),
        (b"\x89PNG\r\n", "content: is no content of 3D Tiles"),
        (b"vctr\x01\0\0\0", "content: is not supported: vector tiles"),
        (b"geom\x01\0\0\0", "content: is not supported: vector tiles"),
        (
            b"b3dm",
            "b3dm, header: is cut short: needs 8 bytes and has 4",
        ),
        (
            b"b3dm\x02\0\0\0",
            "b3dm, header: is not supported: version 2",
        ),
        (
            b"glTF\x01\0\0\0",
            "glTF, glb header: is glTF of version 1, of which 2.0 is read; export it as 2.0",
        ),
        (
            br#"{"asset":{"version":"1.1"},"root":{}}"#,
            "content: is not supported: a tileset",
        ),
        (
            br#"{"type":"FeatureCollection"}"#,
            "content: is not supported: GeoJSON",
        ),
        (
            br#"{"asset":{"version":"1.0"}}"#,
            "glTF, asset: is glTF of version 1.0, of which 2.0 is read",
        ),
        (br#" {"asset""#, "JSON: is damaged"),
    ] {
        let refused = alone(bytes).unwrap_err().to_string();
        assert!(refused.starts_with(expected), "{refused}");
    }
}

#[test]
fn counts_are_checked_against_the_bytes_at_hand() {
    for head in [
        r#"{"POINTS_LENGTH":4294967295,"POSITION":{"byteOffset":0}}"#,
        r#"{"POINTS_LENGTH":3,"POSITION":{"byteOffset":0}}"#,
        r#"{"POINTS_LENGTH":1,"POSITION":{"byteOffset":18446744073709551615}}"#,
        r#"{"POINTS_LENGTH":-1,"POSITION":{"byteOffset":0}}"#,
        r#"{"POINTS_LENGTH":1,"POSITION":[1,2]}"#,
        r#"{"POINTS_LENGTH":1}"#,
        r#"{"POSITION":[1,2,3]}"#,
    ] {
        let file = tile(b"pnts", &[], [head.as_bytes(), &[0; 24], &[], &[]], &[]);
        let refused = alone(&file).unwrap_err();
        assert!(
            refused.place.starts_with("pnts, feature table"),
            "{refused}"
        );
    }
    let file = tile(
        b"b3dm",
        &[],
        [br#"{"BATCH_LENGTH":4000000000}"#, &[], &[], &[]],
        &triangle_glb(),
    );
    assert!(
        alone(&file)
            .unwrap_err()
            .to_string()
            .contains("4000000000 features in")
    );
}
