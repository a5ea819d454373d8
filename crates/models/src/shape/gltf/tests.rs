use super::*;
use proptest::prelude::*;
use serde_json::{Value, json};

/// A binary glTF file of a document and its data.
fn glb(document: &Value, data: &[u8]) -> Vec<u8> {
    let padded = |bytes: &[u8], with: u8| {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), with);
        bytes
    };
    let json = padded(document.to_string().as_bytes(), b' ');
    let data = padded(data, 0);
    let length = 12 + 8 + json.len() + 8 + data.len();
    let word = |x: usize| (x as u32).to_le_bytes();
    let mut file = [&b"glTF"[..], &word(2), &word(length)].concat();
    file.extend([&word(json.len())[..], b"JSON", &json].concat());
    file.extend([&word(data.len())[..], b"BIN\0", &data].concat());
    file
}

/// A red tetrahedron with corners at the origin and 1 m along glTF's axes, in a node 2 m up.
fn tetrahedron() -> (Value, Vec<u8>) {
    let corners = [
        [0.0_f32; 3],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];
    let mut data: Vec<u8> = corners
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    data.extend([0, 2, 1, 0, 3, 2, 0, 1, 3, 1, 2, 3_u8]);
    let document = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [
            { "translation": [0.0, 2.0, 0.0], "children": [1] },
            { "mesh": 0 },
        ],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.25, 0.125, 1.0] } }],
        "buffers": [{ "byteLength": 60 }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 48 },
            { "buffer": 0, "byteOffset": 48, "byteLength": 12 },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3",
              "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0] },
            { "bufferView": 1, "componentType": 5121, "count": 12, "type": "SCALAR" },
        ],
    });
    (document, data)
}

/// The error of the tetrahedron with `value` at a JSON pointer.
fn refused(at: &str, value: Value) -> String {
    let (mut document, data) = tetrahedron();
    *document.pointer_mut(at).unwrap() = value;
    gltf_mesh(&glb(&document, &data)).unwrap_err().to_string()
}

#[test]
fn a_shape_looks_along_body_forward_and_keeps_its_colour() {
    let (document, data) = tetrahedron();
    let mesh = gltf_mesh(&glb(&document, &data)).unwrap();
    assert_eq!(mesh.triangle_count(), 4);
    assert!((mesh.signed_volume_m3() - 1.0 / 6.0).abs() < 1e-6);
    // 1 m forward, left and up, from 2 m up.
    let bounds = (DVec3::Z * 2.0, DVec3::new(1.0, 1.0, 3.0));
    assert_eq!(mesh.bounds_m(), Some(bounds));
    assert!(
        mesh.colors
            .iter()
            .all(|colour| *colour == [0.5, 0.25, 0.125, 1.0])
    );
    // glTF's +z, where it looks, is forward.
    let mut document = document;
    document["nodes"][0]["translation"] = json!([0.0, 0.0, 5.0]);
    let (low, _) = gltf_mesh(&glb(&document, &data))
        .unwrap()
        .bounds_m()
        .unwrap();
    assert_eq!(low, DVec3::X * 5.0);
}

#[test]
fn normals_of_the_file_are_used() {
    let (mut document, mut data) = tetrahedron();
    let diagonal = [0.0_f32, 0.6, 0.8];
    for _ in 0..4 {
        data.extend(diagonal.iter().flat_map(|x| x.to_le_bytes()));
    }
    let push = |list: &mut Value, item: Value| list.as_array_mut().unwrap().push(item);
    let view = json!({ "buffer": 0, "byteOffset": 60, "byteLength": 48 });
    push(&mut document["bufferViews"], view);
    let accessor = json!({ "bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC3" });
    push(&mut document["accessors"], accessor);
    document["buffers"][0]["byteLength"] = json!(108);
    document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(2);
    let mesh = gltf_mesh(&glb(&document, &data)).unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangle_count()), (4, 4));
    for normal in mesh.normals {
        assert!((DVec3::from(normal.map(f64::from)) - DVec3::new(0.8, 0.0, 0.6)).length() < 1e-6);
    }
}

#[test]
fn what_cannot_be_drawn_is_one_error_with_its_mend() {
    for (at, value, words) in [
        (
            "/scenes/0/nodes",
            json!([]),
            "has no triangles; export a mesh of triangles",
        ),
        ("/meshes/0/primitives/0/mode", json!(1), "has no triangles"),
        ("/accessors/0/count", json!(400), "positions are damaged"),
        ("/accessors/0/type", json!("VEC2"), "positions are damaged"),
        (
            "/bufferViews/0/byteOffset",
            json!(4_000_000_000_u32),
            "positions are damaged",
        ),
        (
            "/accessors/1/componentType",
            json!(5126),
            "indices are damaged",
        ),
        ("/accessors/0/count", json!(3), "indices are damaged"),
        (
            "/buffers/0",
            json!({ "byteLength": 60, "uri": "own.bin" }),
            "in another file",
        ),
        ("/nodes/1", json!({ "children": [0] }), "nodes are damaged"),
        ("/accessors", json!([]), "accessors are damaged"),
        ("/nodes/1/mesh", json!(7), "export the shape anew"),
    ] {
        // A pointer leads to what is there; the mode is not.
        let error = if at.ends_with("mode") {
            let (mut document, data) = tetrahedron();
            document["meshes"][0]["primitives"][0]["mode"] = value;
            gltf_mesh(&glb(&document, &data)).unwrap_err().to_string()
        } else {
            refused(at, value)
        };
        assert!(error.contains(words), "{at}: {error}");
    }
    for bytes in [&b""[..], b"solid cube", b"glTF\x02\0\0\0\x01\0\0\0", b"{}"] {
        assert!(matches!(gltf_mesh(bytes), Err(GltfError::NotBinary)));
    }
}

proptest! {
    #[test]
    fn damaged_files_never_panic(cut: usize, at: usize, byte: u8) {
        let (document, data) = tetrahedron();
        let mut file = glb(&document, &data);
        prop_assert!(gltf_mesh(&file[..cut % file.len()]).is_err());
        let at = at % file.len();
        file[at] = byte;
        // Some damage is harmless.
        let _ = gltf_mesh(&file);
    }
}
