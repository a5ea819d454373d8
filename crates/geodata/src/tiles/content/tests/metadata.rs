//! Property tables and feature IDs of glTF.

use super::*;
use boresight_models::shape::textured::NO_FEATURE;

/// The triangle with `_FEATURE_ID_0` 2, 0, 7 of a table of three trees, whose properties have every kind.
fn trees() -> Vec<u8> {
    let (mut model, _) = triangle();
    let ids = model.add("SCALAR", 5121, 3, &[2, 0, 7]);
    let height = model.view(&bytes![f32; 1.5, -1.0, 20.25]);
    let name = model.view("oakΩbeech".as_bytes());
    let name_at = model.view(&bytes![u32; 0, 3, 5, 10]);
    let alive = model.view(&[0b101]);
    let kind = model.view(&bytes![u16; 1, 0, 9]);
    let place = model.view(&[0, 127, 129, 64, 0, 0]);
    let years = model.view(&bytes![u64; 1, u64::MAX, 3]);
    let years_at = model.view(&[0, 0, 2, 3]);
    let corners = model.view(&bytes![i16; 1, 2, 3, 4, 5, 6]);
    model.glb(json!({
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "_FEATURE_ID_0": ids}, "extensions": {
            "EXT_mesh_features": {"featureIds": [{"featureCount": 3, "attribute": 0, "propertyTable": 0}]}}}]}],
        "extensions": {"EXT_structural_metadata": {
            "schema": {"id": "s", "enums": {"kinds": {"values": [{"name": "leaf", "value": 0}, {"name": "needle", "value": 1}]}},
                "classes": {"tree": {"properties": {
                    "height": {"type": "SCALAR", "componentType": "FLOAT32", "noData": -1.0},
                    "name": {"type": "STRING"},
                    "alive": {"type": "BOOLEAN"},
                    "kind": {"type": "ENUM", "enumType": "kinds"},
                    "place": {"type": "VEC2", "componentType": "INT8", "normalized": true, "offset": [10.0, 0.0], "scale": [2.0, 1.0]},
                    "years": {"type": "SCALAR", "componentType": "UINT64", "array": true},
                    "corners": {"type": "SCALAR", "componentType": "INT16", "array": true, "count": 2},
                    "owner": {"type": "STRING", "default": "nobody"}}}}},
            "propertyTables": [{"class": "tree", "count": 3, "properties": {
                "height": {"values": height},
                "name": {"values": name, "stringOffsets": name_at},
                "alive": {"values": alive},
                "kind": {"values": kind},
                "place": {"values": place},
                "years": {"values": years, "arrayOffsets": years_at, "arrayOffsetType": "UINT8"},
                "corners": {"values": corners}}}]}}}))
}

#[test]
fn property_tables_of_every_kind() {
    let content = alone(&trees()).unwrap();
    let rows: Vec<Value> = content
        .features
        .iter()
        .cloned()
        .map(Value::Object)
        .collect();
    assert_eq!(
        rows,
        [
            json!({"height": 1.5, "name": "oak", "alive": true, "kind": "needle", "place": [10.0, 1.0],
            "years": [], "corners": [1, 2], "owner": "nobody"}),
            json!({"name": "Ω", "alive": false, "kind": "leaf", "place": [8.0, 64.0 / 127.0],
            "years": [1, u64::MAX], "corners": [3, 4], "owner": "nobody"}),
            json!({"height": 20.25, "name": "beech", "alive": true, "kind": 9, "place": [10.0, 0.0],
            "years": [3], "corners": [5, 6], "owner": "nobody"}),
        ]
    );
    // ID 7 is beyond the table.
    assert_eq!(content.meshes[0].mesh.features, [2, 0, NO_FEATURE]);
}

#[test]
fn ids_without_a_table_get_rows_of_their_own() {
    let (mut model, _) = triangle();
    let ids = model.add("SCALAR", 5123, 3, &bytes![u16; 40, 7, 65535]);
    for (set, expected, rows) in [
        (
            json!({"featureCount": 2, "attribute": 3, "nullFeatureId": 65535}),
            [1, 0, NO_FEATURE],
            vec![7, 40],
        ),
        // Without an attribute the vertex is the feature.
        (json!({"featureCount": 3}), [0, 1, 2], vec![0, 1, 2]),
    ] {
        let file = model.glb(
            json!({"meshes": [{"primitives": [{"attributes": {"POSITION": 0, "_FEATURE_ID_3": ids},
            "extensions": {"EXT_mesh_features": {"featureIds": [set]}}}]}]}),
        );
        let content = alone(&file).unwrap();
        assert_eq!(content.meshes[0].mesh.features, expected);
        let found: Vec<_> = content
            .features
            .iter()
            .map(|row| row["featureId"].as_u64().unwrap())
            .collect();
        assert_eq!(found, rows);
    }
}

#[test]
fn instances_are_features() {
    let (mut model, meshes) = triangle();
    let to = model.add("VEC3", 5126, 2, &[0; 24]);
    let ids = model.add("SCALAR", 5121, 2, &[1, 0]);
    let values = model.view(&bytes![u32; 11, 22]);
    let file = model.glb(json!({"meshes": meshes, "nodes": [{"mesh": 0, "extensions": {
            "EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": to, "_FEATURE_ID_0": ids}},
            "EXT_instance_features": {"featureIds": [{"featureCount": 2, "attribute": 0, "propertyTable": 0}]}}}],
        "extensions": {"EXT_structural_metadata": {
            "schema": {"classes": {"c": {"properties": {"n": {"type": "SCALAR", "componentType": "UINT32"}}}}},
            "propertyTables": [{"class": "c", "count": 2, "properties": {"n": {"values": values}}}]}}}));
    let content = alone(&file).unwrap();
    assert_eq!(content.meshes[0].placement_features, [1, 0]);
    assert_eq!(content.features[1]["n"], 22);
}

#[test]
fn schemas_may_lie_elsewhere() {
    let (mut model, meshes) = triangle();
    let values = model.view(&bytes![u32; 5]);
    let file = model.glb(
        json!({"meshes": meshes, "extensions": {"EXT_structural_metadata": {
        "schemaUri": "schema.json",
        "propertyTables": [{"class": "c", "count": 1, "properties": {"n": {"values": values}}}]}}}),
    );
    let schema = br#"{"id":"s","classes":{"c":{"properties":{"n":{"type":"SCALAR","componentType":"UINT32"}}}}}"#;
    let fetch = |uri: &str| {
        if uri == "schema.json" {
            Ok(schema.to_vec())
        } else {
            Err("gone".to_owned())
        }
    };
    assert_eq!(
        decode(&file, UpAxis::Y, &fetch).unwrap().features[0]["n"],
        5
    );
    assert!(alone(&file).is_err());
}

#[test]
fn tables_larger_than_their_bytes_are_refused() {
    let (mut model, meshes) = triangle();
    let values = model.view(&bytes![u32; 5, 6]);
    for (count, property) in [
        (3, json!({"type": "SCALAR", "componentType": "UINT32"})),
        (4_000_000_000_u64, json!({"type": "BOOLEAN"})),
        (
            1,
            json!({"type": "SCALAR", "componentType": "UINT32", "array": true, "count": u64::MAX}),
        ),
        (1, json!({"type": "STRING"})),
        (1, json!({"type": "VEC7", "componentType": "UINT32"})),
        (1, json!({"type": "ENUM", "enumType": "nothing"})),
    ] {
        let file = model.glb(json!({"meshes": meshes, "extensions": {"EXT_structural_metadata": {
            "schema": {"classes": {"c": {"properties": {"n": property}}}},
            "propertyTables": [{"class": "c", "count": count, "properties": {"n": {"values": values}}}]}}}));
        let refused = alone(&file).unwrap_err();
        assert!(
            refused.place.starts_with("glTF, property table 0"),
            "{refused}"
        );
    }
}
