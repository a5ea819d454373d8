//! Real tiles, where they are at hand (`../shared/data/tiles`).

use super::*;
use std::path::{Path, PathBuf};

/// A folder of real tiles; `None`, with a message, where it is absent.
fn folder(name: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("../shared/data/tiles")
        .join(name);
    if !path.is_dir() {
        println!("skipped: {} is absent", path.display());
        return None;
    }
    Some(path)
}

/// All files of contents below a folder, in order.
fn contents(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut waiting = vec![folder.to_owned()];
    while let Some(folder) = waiting.pop() {
        for entry in folder.read_dir().unwrap() {
            let path = entry.unwrap().path();
            let kinds = [
                "b3dm", "i3dm", "pnts", "cmpt", "glb", "gltf", "vctr", "geom", "geojson",
            ];
            if path.is_dir() {
                waiting.push(path);
            } else if path
                .extension()
                .is_some_and(|e| kinds.iter().any(|kind| e == *kind))
            {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// Decodes a file, and what lies beside it.
fn read(path: &Path) -> Result<Content, ContentError> {
    let fetch = |uri: &str| {
        let beside = path.with_file_name(uri.replace("%20", " "));
        std::fs::read(&beside).map_err(|why| why.to_string())
    };
    decode(&std::fs::read(path).unwrap(), UpAxis::Y, &fetch)
}

#[test]
fn all_samples_show_what_their_files_count() {
    // Counted by a script over the accessors of each file's scene: triangles and points, instances included.
    for (name, files, triangles, points) in [
        ("samples", 114, 149_236, 170_979),
        ("mars-terrain", 293, 298_357, 0),
    ] {
        let Some(folder) = folder(name) else { return };
        let mut found = (0, 0, 0);
        for path in contents(&folder) {
            let content = read(&path).unwrap_or_else(|why| panic!("{}: {why}", path.display()));
            found.0 += 1;
            found.1 += content.triangle_count();
            found.2 += content.point_count();
            for placed in &content.meshes {
                let mesh = &placed.mesh;
                let count = mesh.positions.len();
                assert!(mesh.indices.iter().all(|i| (*i as usize) < count));
                for length in [
                    mesh.normals.len(),
                    mesh.uv.len(),
                    mesh.colors.len(),
                    mesh.features.len(),
                ] {
                    assert!(length == 0 || length == count, "{}", path.display());
                }
                let rows = content.features.len() as u32;
                let none = boresight_models::shape::textured::NO_FEATURE;
                let ids = mesh.features.iter().chain(&placed.placement_features);
                assert!(
                    ids.clone().all(|id| *id < rows || *id == none),
                    "{}",
                    path.display()
                );
            }
        }
        assert_eq!(found, (files, triangles, points), "{name}");
    }
}

#[test]
fn every_invalid_content_is_read_or_one_error() {
    let Some(folder) = folder("invalid") else {
        return;
    };
    let (mut good, mut bad) = (0, 0);
    for path in contents(&folder) {
        match read(&path) {
            Ok(_) => good += 1,
            Err(why) => {
                bad += 1;
                let text = why.to_string();
                assert!(
                    !why.place.is_empty() && !text.contains('\n'),
                    "{}: {text}",
                    path.display()
                );
                println!("{}: {text}", path.strip_prefix(&folder).unwrap().display());
            }
        }
    }
    println!("{good} read, {bad} refused");
    assert_eq!((good, bad), (262, 38));
}

/// A sample's content.
fn sample(name: &str) -> Option<Content> {
    let path = folder("samples")?.join(name);
    Some(read(&path).unwrap_or_else(|why| panic!("{name}: {why}")))
}

#[test]
fn property_tables_of_the_samples() {
    let name = "glTF/EXT_structural_metadata/FeatureIdAttributeAndPropertyTable/FeatureIdAttributeAndPropertyTable.gltf";
    let Some(content) = sample(name) else { return };
    // Four squares, one feature each; the file's table has 3, 0.1, 0.2; 1, 1.1, 1.2; and so on.
    let ids = &content.meshes[0].mesh.features;
    assert_eq!(
        ids.chunks(4).map(|c| c[0]).collect::<Vec<_>>(),
        [0, 1, 2, 3]
    );
    assert_eq!(ids.len(), 16);
    for (row, expected) in content.features.iter().zip([
        [0.0, 0.1, 0.2],
        [1.0, 1.1, 1.2],
        [2.0, 2.1, 2.2],
        [3.0, 3.1, 3.2],
    ]) {
        let found = row["example_VEC3_FLOAT32"].as_array().unwrap();
        for (found, expected) in found.iter().zip(expected) {
            assert!((found.as_f64().unwrap() - expected).abs() < 1e-6, "{row:?}");
        }
    }
}

#[test]
fn complex_types_of_the_samples() {
    let Some(content) = sample("glTF/EXT_structural_metadata/ComplexTypes/ComplexTypes.gltf")
    else {
        return;
    };
    let rows = &content.features;
    assert_eq!(rows.len(), 4);
    // Bytes 00 ff | 00 80 ff | 00 55 aa ff | 00 40 80 c0 ff.
    let bytes = |row: usize| -> Vec<u8> {
        let list = rows[row]["example_variable_length_ARRAY_normalized_UINT8"]
            .as_array()
            .unwrap()
            .clone();
        list.iter()
            .map(|x| (x.as_f64().unwrap() * 255.0).round() as u8)
            .collect()
    };
    assert_eq!(bytes(0), [0, 255]);
    assert_eq!(bytes(3), [0, 0x40, 0x80, 0xc0, 255]);
    // Bits 55 cd cc 8c aa, ten a row, the lowest first.
    let bits = |row: usize| -> String {
        let list = rows[row]["example_fixed_length_ARRAY_BOOLEAN"]
            .as_array()
            .unwrap()
            .clone();
        list.iter()
            .map(|x| if x.as_bool().unwrap() { '1' } else { '0' })
            .collect()
    };
    assert_eq!(
        [bits(0), bits(1), bits(2), bits(3)],
        ["1010101010", "1100110011", "0011001100", "0101010101"]
    );
    assert_eq!(
        rows[2]["example_variable_length_ARRAY_STRING"],
        json!(["One", "Two", "Three"])
    );
    assert_eq!(
        rows[0]["example_fixed_length_ARRAY_ENUM"],
        json!(["ExampleEnumValueA", "ExampleEnumValueB"])
    );
    assert_eq!(
        rows[3]["example_fixed_length_ARRAY_ENUM"],
        json!(["ExampleEnumValueB", "ExampleEnumValueC"])
    );
}

#[test]
fn instances_of_the_samples() {
    let Some(content) = sample("glTF/GpuInstancesMetadata/GpuInstancesMetadata.gltf") else {
        return;
    };
    let placed = &content.meshes[0];
    assert_eq!(placed.placements.len(), 10);
    assert_eq!(placed.placement_features, (0..10).rev().collect::<Vec<_>>());
    let names: Vec<_> = content
        .features
        .iter()
        .map(|row| row["example_STRING"].as_str().unwrap().to_owned())
        .collect();
    assert_eq!(
        names,
        [
            "zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine"
        ]
    );
    // The last one stands at (10, 10, 10), twice as large; glTF's y is up.
    let last = placed.placements[9];
    assert!(
        (last.translation - DVec3::new(10.0, -10.0, 10.0)).length() < 1e-5,
        "{last:?}"
    );
    assert!((last.matrix3.determinant() - 8.0).abs() < 1e-4);
}

#[test]
fn trees_and_buildings_of_the_samples() {
    let Some(trees) = sample("1.0/TilesetWithTreeBillboards/tree.i3dm") else {
        return;
    };
    assert_eq!(trees.features.len(), 25);
    assert_eq!(
        trees.features[0]
            .keys()
            .map(String::as_str)
            .collect::<Vec<_>>(),
        ["Height"]
    );
    assert_eq!(trees.meshes[0].placements.len(), 25);
    assert_eq!(
        trees.meshes[0].placement_features,
        (0..25).collect::<Vec<_>>()
    );
    let Some(city) = sample("1.0/TilesetWithRequestVolume/city/lr.b3dm") else {
        return;
    };
    assert_eq!(city.features.len(), 10);
    let row = &city.features[9];
    assert_eq!(row["id"], 9);
    assert!(
        row["Height"].as_f64().unwrap() > 1.0 && row.contains_key("Longitude"),
        "{row:?}"
    );
    // Around its RTC_CENTER, on the globe.
    let radius = city.meshes[0].mesh.origin_m.length();
    assert!((6.3e6..6.4e6).contains(&radius), "{radius}");
}
