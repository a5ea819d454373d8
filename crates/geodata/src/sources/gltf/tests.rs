use super::*;
use base64::Engine as _;
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use glam::{DMat4, DQuat};
use proptest::prelude::*;
use serde_json::{Value, json};

fn local() -> Options {
    Options {
        site: Some(SiteFrame::new(Geodetic {
            latitude_rad: 0.8,
            longitude_rad: 0.15,
            height_m: 500.0,
        })),
        ..Options::default()
    }
}

fn corners(layer: &Layer) -> Vec<DVec3> {
    let of = |mesh: &TexturedMesh| {
        mesh.indices
            .iter()
            .map(|&i| mesh.vertex_m(i))
            .collect::<Vec<_>>()
    };
    layer.meshes.iter().flat_map(of).collect()
}

fn read_json(root: &Value) -> Result<Layer, SourceError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    std::fs::write(&path, format!("\u{feff}{root}")).unwrap();
    read(&path, &local())
}

fn encoded(bytes: &[u8]) -> String {
    let text = base64::engine::general_purpose::STANDARD.encode(bytes);
    format!("data:application/octet-stream;base64,{text}")
}

/// A model of one mesh at a node, its places as floats.
fn model(points: &[[f32; 3]], node: Value) -> Value {
    let bytes: Vec<u8> = points
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let mut node = node;
    node["mesh"] = json!(0);
    json!({"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [node],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": points.len(), "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": bytes.len()}],
        "buffers": [{"uri": encoded(&bytes), "byteLength": bytes.len()}]})
}

const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 0.0, -10.0]];

#[test]
fn sparse_places_without_a_view_are_read() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("../shared/data/odd/gltf-sparse/s.gltf");
    if !path.exists() {
        println!("skipped: {} is absent", path.display());
        return;
    }
    let layer = read(&path, &local()).unwrap();
    let triangles: usize = layer.meshes.iter().map(TexturedMesh::triangle_count).sum();
    assert_eq!(triangles, 7688);
    // One row of them belongs to no triangle.
    let mesh = &layer.meshes[0];
    let all: Vec<DVec3> = (0..mesh.positions.len() as u32)
        .map(|i| mesh.vertex_m(i))
        .collect();
    let low = all.iter().fold(DVec3::INFINITY, |a, b| a.min(*b));
    let high = all.iter().fold(DVec3::NEG_INFINITY, |a, b| a.max(*b));
    // x is east, z of the file south.
    assert!(
        (high - low).distance(DVec3::new(62.0, 63.0, 0.0)) < 1e-4,
        "{}",
        high - low
    );
}

#[test]
fn a_few_sparse_corners_among_zeros() {
    let mut root = model(&TRIANGLE, json!({}));
    let bytes: Vec<u8> = [2_u16, 1]
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .chain(
            [0.0_f32, 0.0, -4.0, 3.0, 0.0, 0.0]
                .iter()
                .flat_map(|x| x.to_le_bytes()),
        )
        .collect();
    // Most of a large accessor is zeros, far more than the file has bytes.
    root["accessors"] = json!([{"componentType": 5126, "count": 300_000, "type": "VEC3", "sparse": {"count": 2,
        "indices": {"bufferView": 0, "componentType": 5123}, "values": {"bufferView": 0, "byteOffset": 4}}}]);
    root["bufferViews"][0]["byteLength"] = json!(bytes.len());
    root["buffers"][0] = json!({"uri": encoded(&bytes), "byteLength": bytes.len()});
    let all = corners(&read_json(&root).unwrap());
    let area = (all[1] - all[0]).cross(all[2] - all[0]).length() / 2.0;
    assert!((area - 6.0).abs() < 1e-6, "{area}");
}

#[test]
fn files_beside_are_found_by_escaped_names() {
    let folder = tempfile::tempdir().unwrap();
    let bytes: Vec<u8> = TRIANGLE
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    std::fs::create_dir(folder.path().join("my data")).unwrap();
    std::fs::write(folder.path().join("my data/Gelände 1.bin"), &bytes).unwrap();
    std::fs::write(folder.path().join("100%25.bin"), &bytes).unwrap();
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    for (uri, good) in [
        ("my%20data/Gel%C3%A4nde%201.bin", true),
        ("my data/Gelände 1.bin", true),
        ("./my%20data\\Gel%c3%a4nde 1.bin", true),
        ("100%25.bin", true),
        ("my%20data/Gel%C3%A4nde%201.bin?v=2", true),
        ("./sub/../my%20data/Gel%C3%A4nde%201.bin", true),
        ("..%2Fsecret.bin", false),
        ("my%20data/../../secret.bin", false),
        ("https://example.org/a.bin", false),
    ] {
        let mut root = model(&TRIANGLE, json!({}));
        root["buffers"][0]["uri"] = json!(uri);
        let path = folder.path().join("a.gltf");
        std::fs::write(&path, root.to_string()).unwrap();
        assert_eq!(read(&path, &local()).is_ok(), good, "{uri}");
    }
    // Data inside, in other notations than the usual.
    for uri in [
        format!(
            "data:;base64,{}",
            base64::engine::general_purpose::STANDARD_NO_PAD.encode(&bytes)
        ),
        format!(
            "data:application/octet-stream,{}",
            bytes
                .iter()
                .map(|b| format!("%{b:02x}"))
                .collect::<String>()
        ),
    ] {
        let mut root = model(&TRIANGLE, json!({}));
        root["buffers"][0]["uri"] = json!(uri);
        assert_eq!(corners(&read_json(&root).unwrap()).len(), 3);
    }
}

#[test]
fn hidden_nodes_are_left_out_and_faults_have_one_mend() {
    let mut root = model(&TRIANGLE, json!({}));
    let hidden = json!({"mesh": 0, "extensions": {"KHR_node_visibility": {"visible": false}}});
    root["nodes"].as_array_mut().unwrap().push(hidden);
    root["scenes"][0]["nodes"] = json!([0, 1]);
    root["scene"] = json!(0);
    let layer = read_json(&root).unwrap();
    assert_eq!(corners(&layer).len(), 3);
    assert!(
        layer
            .warnings
            .iter()
            .any(|warning| warning.what.contains("hidden"))
    );
    let said = |change: &dyn Fn(&mut Value)| {
        let mut root = model(&TRIANGLE, json!({}));
        change(&mut root);
        read_json(&root).unwrap_err().to_string()
    };
    let version = said(&|root| root["asset"]["version"] = json!("1.0"));
    assert!(
        version.ends_with("is glTF of version 1.0, of which 2.0 is read; export it as 2.0"),
        "{version}"
    );
    let missing = said(&|root| root["buffers"][0]["uri"] = json!("absent.bin"));
    assert_eq!(missing.matches("; ").count(), 1, "{missing}");
}

#[test]
fn one_bad_primitive_does_not_cost_the_others() {
    let mut root = model(&TRIANGLE, json!({"skin": 0}));
    let good = json!({"attributes": {"POSITION": 0}, "targets": [{"POSITION": 0}]});
    let bad = json!({"attributes": {"POSITION": 7}});
    root["meshes"][0]["primitives"] =
        json!([bad, good, bad, {"attributes": {"POSITION": 0}, "mode": 1}]);
    let layer = read_json(&root).unwrap();
    assert_eq!(corners(&layer).len(), 3);
    let said: Vec<_> = layer.warnings.iter().map(ToString::to_string).collect();
    let said = said.join("\n");
    for part in [
        "2 damaged primitives are left out, the first: mesh 0, primitive 0",
        "lines",
        "morph targets",
        "skins",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    root["meshes"][0]["primitives"] = json!([bad]);
    assert!(read_json(&root).is_err());
    let mut root = model(&TRIANGLE, json!({}));
    root["extensionsRequired"] = json!(["KHR_ropes"]);
    let refused = read_json(&root).unwrap_err().to_string();
    assert!(refused.contains("KHR_ropes"), "{refused}");
}

fn close(a: &[DVec3], b: &[DVec3], tolerance_m: f64) -> Result<(), TestCaseError> {
    prop_assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(b) {
        prop_assert!(a.distance(*b) < tolerance_m, "{a} {b}");
    }
    Ok(())
}

proptest! {
    /// Scale, rotation and offset of a node, with places to match, are the same ground; so are a matrix and whole numbers of 1/32767.
    #[test]
    fn a_nodes_transform_with_places_to_match_is_the_same_ground(
        points in prop::collection::vec(prop::array::uniform3(-200.0..200.0_f32), 3),
        scale in prop::array::uniform3(prop_oneof![-50.0..-0.02_f64, 0.02..50.0_f64]),
        axis in prop::array::uniform3(-1.0..1.0_f64),
        offset in prop::array::uniform3(-1000.0..1000.0_f64),
    ) {
        let rotation = DQuat::from_scaled_axis(DVec3::from(axis) * 3.0);
        let (scale, offset) = (DVec3::from(scale), DVec3::from(offset));
        let to_node = DMat4::from_scale_rotation_translation(scale, rotation, offset).inverse();
        let own: Vec<[f32; 3]> = points.iter()
            .map(|p| to_node.transform_point3(Vec3::from(*p).as_dvec3()).as_vec3().to_array())
            .collect();
        let mut plain = corners(&read_json(&model(&points, json!({}))).unwrap());
        // A transform that mirrors turns the triangle's winding, so that its front stays in front.
        if scale.x * scale.y * scale.z < 0.0 {
            plain.swap(1, 2);
        }
        // Places are f32 of up to 60 km in the node's frame, times the scale that made them large.
        let tolerance_m = 1e-2;
        let parts = json!({"scale": scale.to_array(), "rotation": rotation.to_array(), "translation": offset.to_array()});
        close(&corners(&read_json(&model(&own, parts)).unwrap()), &plain, tolerance_m)?;
        let matrix = json!({"matrix": to_node.inverse().to_cols_array()});
        close(&corners(&read_json(&model(&own, matrix)).unwrap()), &plain, tolerance_m)?;
        // The same, in whole numbers with a stride and a node that scales them back.
        let most = points.iter().flatten().fold(1e-3_f32, |a, b| a.max(b.abs()));
        let mut root = model(&points, json!({"scale": [most, most, most]}));
        let bytes: Vec<u8> = points.iter()
            .flat_map(|p| p.iter().map(|x| (x / most * 32767.0).round() as i16).chain([77]).collect::<Vec<_>>())
            .flat_map(i16::to_le_bytes)
            .collect();
        root["accessors"][0] = json!({"bufferView": 0, "componentType": 5122, "normalized": true, "count": 3, "type": "VEC3"});
        root["bufferViews"][0] = json!({"buffer": 0, "byteLength": bytes.len(), "byteStride": 8});
        root["buffers"][0] = json!({"uri": encoded(&bytes), "byteLength": bytes.len()});
        root["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
        if scale.x * scale.y * scale.z < 0.0 {
            plain.swap(1, 2);
        }
        close(&corners(&read_json(&root).unwrap()), &plain, f64::from(most) / 32767.0 + 1e-3)?;
    }
}
