//! Compressed geometry and pictures: files of other programs (`tests/data/tiles/make.mjs`), and what the
//! meshoptimizer encoder here makes.

use super::*;
use crate::tiles::content::{model::linear, picture};

/// The grid of `make.mjs` in a frame with z up: how far what was decoded is off, in positions, normals and
/// texture coordinates.
fn grid_errors(file: &[u8]) -> [f32; 3] {
    let content = decode(file, UpAxis::Z, &|_| Err(String::new())).unwrap();
    assert_eq!(content.triangle_count(), 128);
    let mesh = &content.meshes[0].mesh;
    assert_eq!(mesh.positions.len(), 81);
    let mut errors = [0.0_f32; 3];
    let mut area = 0.0;
    for (i, normal) in mesh.normals.iter().enumerate() {
        let p = mesh.vertex_m(i as u32).as_vec3();
        let [x, y] = [p.x, p.y];
        let length = (0.25 * (x * x + y * y) + 1.0).sqrt();
        let expected = [-0.5 * y / length, -0.5 * x / length, 1.0 / length];
        errors[0] = errors[0].max((p.z - 0.5 * x * y).abs());
        // The corners of the squares are at eighths.
        errors[0] = errors[0].max((8.0 * x - (8.0 * x).round()).abs() / 8.0);
        for (found, expected) in normal.iter().zip(expected) {
            errors[1] = errors[1].max((found - expected).abs());
        }
        if let Some([u, v]) = mesh.uv.get(i) {
            errors[2] = errors[2].max((u - x).abs()).max((v - y).abs());
        }
    }
    for corners in mesh.indices.chunks(3) {
        let [a, b, c] = [0, 1, 2].map(|i| mesh.vertex_m(corners[i]));
        let doubled = (b - a).cross(c - a).z;
        assert!(doubled > 0.0, "a triangle faces down");
        area += 0.5 * doubled;
    }
    assert!((area - 1.0).abs() < 1e-3, "{area}");
    errors
}

/// The file with a material that has a texture, so that texture coordinates are read.
fn with_texture(file: &[u8]) -> Vec<u8> {
    let length = u32::from_le_bytes(*file[12..].first_chunk().unwrap()) as usize;
    let mut root: Value = serde_json::from_slice(&file[20..20 + length]).unwrap();
    let pixel = "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8z8BQDwAEhQGAhKmMIQAAAABJRU5ErkJggg==";
    root["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    root["textures"] = json!([{"source": 0}]);
    root["images"] = json!([{"uri": pixel}]);
    root["meshes"][0]["primitives"][0]["material"] = json!(0);
    glb(&root, &file[28 + length..])
}

/// Asserts that a file of the grid is as good as its encoder's steps.
#[track_caller]
fn grid(file: &[u8], limits: [f32; 3]) {
    let found = grid_errors(&with_texture(file));
    let fits = found
        .iter()
        .zip(limits)
        .all(|(found, limit)| *found <= limit);
    assert!(fits, "{found:?} where {limits:?} is allowed");
}

#[test]
fn draco_of_both_kinds() {
    // 14 bits for positions, 10 for normals, 12 for texture coordinates.
    let limits = [1e-4, 4e-3, 4e-4];
    grid(
        include_bytes!("../../../../../../tests/data/tiles/draco-edgebreaker.glb"),
        limits,
    );
    grid(
        include_bytes!("../../../../../../tests/data/tiles/draco-sequential.glb"),
        limits,
    );
}

#[test]
fn meshopt_of_another_program() {
    // 16 bits for positions and texture coordinates, 8 for normals.
    grid(
        include_bytes!("../../../../../../tests/data/tiles/meshopt.glb"),
        [1e-4, 2e-2, 2e-4],
    );
}

#[test]
fn quantized_without_compression() {
    grid(
        include_bytes!("../../../../../../tests/data/tiles/quantized.glb"),
        [1e-4, 2e-3, 2e-4],
    );
}

#[test]
fn draco_of_points_of_both_kinds() {
    const SIDE: f64 = 8.0;
    for file in [
        include_bytes!("../../../../../../tests/data/tiles/draco-cloud-sequential.pnts").as_slice(),
        include_bytes!("../../../../../../tests/data/tiles/draco-cloud-kd-tree.pnts"),
    ] {
        let content = decode(file, UpAxis::Z, &|_| Err(String::new())).unwrap();
        let cloud = &content.points[0];
        assert_eq!(cloud.positions.len(), 81);
        let mut seen = [false; 81];
        for (i, position) in cloud.positions.iter().enumerate() {
            let p = DVec3::from(position.map(f64::from)) + cloud.origin_m
                - DVec3::new(10.0, 20.0, 30.0);
            let [column, row] = [p.x, p.y].map(|x| (SIDE * x).round());
            // 14 bits; the method with a tree quantizes the box's longest side.
            let at = DVec3::new(column / SIDE, row / SIDE, 0.5 * column * row / SIDE / SIDE);
            assert!((p - at).abs().max_element() < 1e-4, "{p}");
            let k = (row * 9.0 + column) as usize;
            seen[k] = true;
            let level = |x: f64| linear((255.0 * x).round() / 255.0);
            let color = [
                level(column / SIDE),
                level(row / SIDE),
                level(64.0 / 255.0),
                1.0,
            ];
            assert_eq!(cloud.colors[i], color);
            assert_eq!(cloud.features[i], k as u32 % 4);
        }
        assert!(seen.iter().all(|seen| *seen));
        assert_eq!(content.features[2]["name"], "c");
        // Fewer points than the table says, and data that end early.
        let text = |from: &str, to: &str| {
            let mut changed = file.to_vec();
            let at = file.windows(from.len()).position(|w| w == from.as_bytes());
            let at = at.unwrap();
            changed[at..at + from.len()].copy_from_slice(to.as_bytes());
            alone(&changed).unwrap_err().to_string()
        };
        let refused = text(r#""POINTS_LENGTH":81"#, r#""POINTS_LENGTH":82"#);
        assert!(refused.contains("81 points where 82"), "{refused}");
        let refused = text(r#""RGB":1"#, r#""RGB":7"#);
        assert!(refused.contains("no Draco attribute 7"), "{refused}");
        let refused = text("DRACO", "DRACI");
        assert!(
            refused.contains("3DTILES_draco_point_compression"),
            "{refused}"
        );
    }
}

#[test]
fn draco_may_ask_for_no_more_than_a_content_may_hold() {
    let file = include_bytes!("../../../../../../tests/data/tiles/draco-edgebreaker.glb");
    let at = file.windows(5).position(|part| part == b"DRACO").unwrap();
    assert_eq!(file[at + 8], 1, "edgebreaker");
    // Vertices, faces (two bytes), symbols: 2³² and more of each.
    for (from, length) in [(12, 1), (13, 2), (16, 1)] {
        let mut damaged = file.to_vec();
        let huge = [0xff, 0xff, 0xff, 0xff, 0x7f];
        damaged.splice(at + from..at + from + length, huge);
        // The containers' lengths stay; what is shifted out at the end does not matter.
        damaged.truncate(file.len());
        let refused = alone(&damaged).unwrap_err().to_string();
        assert!(refused.contains("KHR_draco_mesh_compression"), "{refused}");
    }
}

/// A model whose one buffer view `at` is stored as meshoptimizer packed it.
fn pack(model: &mut Model, at: usize, packed: &[u8], how: Value, name: &str) {
    let view = model.view(packed);
    let view = model.views.remove(view);
    let mut how = how;
    for key in ["buffer", "byteOffset", "byteLength"] {
        how[key] = view[key].clone();
    }
    // What lay there before is spoiled, so that it cannot be what is read.
    let (start, length) = (
        &model.views[at]["byteOffset"],
        &model.views[at]["byteLength"],
    );
    let (start, length) = (
        start.as_u64().unwrap() as usize,
        length.as_u64().unwrap() as usize,
    );
    model.bin[start..start + length].fill(0xee);
    model.views[at]["extensions"] = json!({ name: how });
}

#[test]
fn meshopt_of_all_modes_under_both_names() {
    let points: Vec<[f32; 3]> = (0..40u8)
        .map(|i| [f32::from(i), f32::from(i % 7), 0.5])
        .collect();
    let bytes_of: Vec<u8> = points
        .as_flattened()
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let list: Vec<u32> = (0..38).flat_map(|i| [i, i + 1, i + 2]).collect();
    for (name, mode) in [
        ("EXT_meshopt_compression", "TRIANGLES"),
        ("KHR_meshopt_compression", "INDICES"),
    ] {
        for stride in [2, 4] {
            let mut model = Model::default();
            model.add("VEC3", 5126, points.len(), &bytes_of);
            let plain: Vec<u8> = match stride {
                2 => list
                    .iter()
                    .flat_map(|i| (*i as u16).to_le_bytes())
                    .collect(),
                _ => list.iter().flat_map(|i| i.to_le_bytes()).collect(),
            };
            let kind = if stride == 2 { 5123 } else { 5125 };
            model.add("SCALAR", kind, list.len(), &plain);
            let packed = ::meshopt::encode_vertex_buffer(&points).unwrap();
            pack(
                &mut model,
                0,
                &packed,
                json!({"byteStride": 12, "count": 40, "mode": "ATTRIBUTES"}),
                name,
            );
            let packed = match mode {
                "TRIANGLES" => ::meshopt::encode_index_buffer(&list, 40).unwrap(),
                _ => ::meshopt::encode_index_sequence(&list, 40).unwrap(),
            };
            pack(
                &mut model,
                1,
                &packed,
                json!({"byteStride": stride, "count": list.len(), "mode": mode}),
                name,
            );
            let file = model.glb(json!({"extensionsRequired": [name],
                "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}]}));
            let content = decode(&file, UpAxis::Z, &|_| Err(String::new())).unwrap();
            let found = corners(&content);
            let expected: Vec<_> = list
                .iter()
                .map(|i| points[*i as usize].map(f64::from))
                .collect();
            // The codec may turn a triangle's corners round, but keeps their order.
            for (found, expected) in found.chunks(3).zip(expected.chunks(3)) {
                let turn = (0..3).find(|t| (found[*t] - DVec3::from(expected[0])).length() < 1e-6);
                let turn = turn.expect("the triangle's first corner");
                near(
                    &[found[(turn + 1) % 3], found[(turn + 2) % 3]],
                    &expected[1..],
                );
            }
        }
    }
}

#[test]
fn meshopt_filters() {
    let vectors = [
        [0.0, 0.6, 0.8, 0.0],
        [-1.0, 0.0, 0.0, 0.0],
        [0.48, -0.64, -0.6, 0.0],
    ];
    let positions: Vec<[f32; 3]> = (0..3u8).map(|i| [1.5 * f32::from(i), -0.25, 1e3]).collect();
    let exponential =
        ::meshopt::encode_filter_exp(&positions, 15, ::meshopt::EncodeExpMode::Separate);
    let octahedral: Vec<[i16; 4]> = ::meshopt::encode_filter_oct(&vectors, 12)
        .into_iter()
        .map(|v: [u16; 4]| v.map(|c| c as i16))
        .collect();
    let colors = [
        [1.0, 0.0, 0.5, 1.0],
        [0.0, 1.0, 0.25, 0.5],
        [0.2, 0.4, 0.6, 0.8],
    ];
    let packed_colors: Vec<[u8; 4]> = ::meshopt::encode_filter_color(&colors, 8);
    let mut model = Model::default();
    model.add("VEC3", 5126, 3, &[0; 36]);
    let normals = model.add("VEC3", 5122, 3, &[0; 24]);
    model.accessors[normals]["normalized"] = json!(true);
    model.views[1]["byteStride"] = json!(8);
    let color = model.add("VEC4", 5121, 3, &[0; 12]);
    model.accessors[color]["normalized"] = json!(true);
    let name = "KHR_meshopt_compression";
    let how = |stride: u32, filter: &str| json!({"byteStride": stride, "count": 3, "mode": "ATTRIBUTES", "filter": filter});
    let packed = ::meshopt::encode_vertex_buffer(&exponential).unwrap();
    pack(&mut model, 0, &packed, how(12, "EXPONENTIAL"), name);
    let packed = ::meshopt::encode_vertex_buffer(&octahedral).unwrap();
    pack(&mut model, 1, &packed, how(8, "OCTAHEDRAL"), name);
    let packed = ::meshopt::encode_vertex_buffer(&packed_colors).unwrap();
    pack(&mut model, 2, &packed, how(4, "COLOR"), name);
    let file = model.glb(json!({"meshes": [{"primitives": [
        {"attributes": {"POSITION": 0, "NORMAL": normals, "COLOR_0": color}}]}]}));
    let content = decode(&file, UpAxis::Z, &|_| Err(String::new())).unwrap();
    let mesh = &content.meshes[0].mesh;
    for i in 0..3 {
        let at = mesh.vertex_m(i as u32).as_vec3().to_array();
        for (found, expected) in at.iter().zip(positions[i]) {
            assert!((found - expected).abs() <= 1e-4 * expected.abs(), "{at:?}");
        }
        for (found, expected) in mesh.normals[i].iter().zip(vectors[i]) {
            assert!((found - expected).abs() < 2e-3, "{:?}", mesh.normals[i]);
        }
        for (found, expected) in mesh.colors[i].iter().zip(colors[i]) {
            assert!((found - expected).abs() < 2e-2, "{:?}", mesh.colors[i]);
        }
    }
}

#[test]
fn meshopt_counts_are_checked_before_anything_is_allocated() {
    for how in [
        json!({"byteStride": 12, "count": 4_000_000_000_u64, "mode": "ATTRIBUTES"}),
        json!({"byteStride": 4, "count": 4_000_000_000_u64, "mode": "TRIANGLES"}),
        json!({"byteStride": 4, "count": 3_000, "mode": "TRIANGLES"}),
        json!({"byteStride": 4, "count": 3_001, "mode": "INDICES"}),
        json!({"byteStride": 13, "count": 3, "mode": "ATTRIBUTES"}),
        json!({"byteStride": 12, "count": 3, "mode": "ATTRIBUTES", "filter": "OCTAHEDRAL"}),
        json!({"byteStride": 12, "count": 3, "mode": "NOTHING"}),
    ] {
        let mut model = Model::default();
        model.add("VEC3", 5126, 3, &[0; 36]);
        let packed = ::meshopt::encode_vertex_buffer(&[[0.0_f32; 3]; 3]).unwrap();
        pack(
            &mut model,
            0,
            &packed,
            how.clone(),
            "EXT_meshopt_compression",
        );
        let file =
            model.glb(json!({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}));
        assert!(alone(&file).is_err(), "{how}");
    }
}

#[test]
fn ktx2_of_all_kinds() {
    for (name, file, tolerance) in [
        (
            "ETC1S",
            &include_bytes!("../../../../../../tests/data/tiles/etc1s.ktx2")[..],
            48,
        ),
        (
            "UASTC",
            include_bytes!("../../../../../../tests/data/tiles/uastc.ktx2"),
            8,
        ),
        (
            "UASTC in Zstandard",
            include_bytes!("../../../../../../tests/data/tiles/uastc-zstd.ktx2"),
            8,
        ),
    ] {
        let texture = picture::decode(file, "picture").unwrap();
        assert_eq!(texture.size_px, [16, 16]);
        let mut worst = 0;
        for (i, pixel) in texture.rgba.chunks(4).enumerate() {
            let expected = [(i % 16 * 17) as u8, (i / 16 * 17) as u8, 64, 255];
            for (found, expected) in pixel.iter().zip(expected) {
                worst = worst.max(found.abs_diff(expected));
            }
        }
        assert!(worst <= tolerance, "{name}: {worst} levels off");
    }
}

#[test]
fn ktx2_in_a_model() {
    let (mut model, _) = triangle();
    let uv = model.add("VEC2", 5126, 3, &[0; 24]);
    let view = model.view(include_bytes!(
        "../../../../../../tests/data/tiles/etc1s.ktx2"
    ));
    let file = model.glb(json!({"extensionsRequired": ["KHR_texture_basisu"],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": uv}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"extensions": {"KHR_texture_basisu": {"source": 0}}}],
        "images": [{"bufferView": view, "mimeType": "image/ktx2"}]}));
    let content = alone(&file).unwrap();
    assert_eq!(
        content.meshes[0]
            .mesh
            .look
            .texture
            .as_ref()
            .unwrap()
            .size_px,
        [16, 16]
    );
}
