use super::*;
use crate::tiles::inspect::{self, inspect};
use clap::Parser;
use std::path::{Path, PathBuf};

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    inspect: inspect::Arguments,
}

/// The folder of real tilesets; `None`, with a message, where it is absent.
fn data() -> Option<PathBuf> {
    let folder =
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("../shared/data/tiles");
    if !folder.is_dir() {
        println!("skipped: no ../shared/data/tiles");
        return None;
    }
    Some(folder)
}

fn look(path: &Path) -> Result<Validation, TilesError> {
    validate(&Arguments {
        location: path.to_str().unwrap().into(),
        no_contents: false,
        most: 1000,
    })
}

#[test]
fn faults_are_told_one_line_each_with_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("tileset.json");
    let json = r#"{"asset":{"version":"1.1"},"root":{"boundingVolume":{"sphere":[0,0,0,5]},"geometricError":1,
        "content":{"uri":"none.glb","group":3},"children":[{"boundingVolume":{"sphere":[90,0,0,5]},"geometricError":2}]}}"#;
    std::fs::write(&file, json).unwrap();
    let found = look(&file).unwrap();
    let text = found.text();
    assert_eq!(found.exit_code(), 1);
    for told in [
        "tileset.json: file: has no 'geometricError'; add it",
        "tileset.json: root: has no 'refine'",
        "root.content.group: is no number of the 0 groups",
        "root.children[0].geometricError: is 2, more than its parent's 1",
        "root.children[0].boundingVolume: has its middle 85.00 m outside",
        "none.glb: there is no such file",
        "6 faults in 2 tiles",
    ] {
        assert!(text.contains(told), "{told}\n{text}");
    }
    assert_eq!(text.lines().count(), 7);
    assert!(look(&folder.path().join("other.json")).is_err());
}

#[test]
fn real_tilesets_have_the_faults_that_they_are_known_for() {
    let Some(data) = data() else { return };
    let mars = data.join("mars-terrain/example/public/data");
    for (name, faults) in [
        ("tileset.json", 0),
        ("tileset-add.json", 0),
        ("tileset-external.json", 0),
        ("tileset-external-broken.json", 1),
        ("tileset-broken-root-content.json", 1),
    ] {
        assert_eq!(
            look(&mars.join(name)).unwrap().faults.len(),
            faults,
            "{name}"
        );
    }
    for name in [
        "1.1/SparseImplicitOctree",
        "1.1/MetadataGranularities",
        "1.0/TilesetWithRequestVolume",
    ] {
        let found = look(&data.join("samples").join(name)).unwrap();
        assert_eq!(found.text(), found.text().lines().last().unwrap(), "{name}");
    }
}

/// What the validator of others calls wrong is found wrong here, too, but for the rules named below.
#[test]
fn damaged_tilesets_are_found_damaged() {
    /// Rules that this validator has not: values scaled by offset and scale, sums of statistics, extensions that are declared in
    /// vain or have a wrong type, and what is no fault of the file (its own external files, glTF of 1.1 that is declared twice).
    const NOT_KEPT: [&str; 14] = [
        "extensionNotDeclaredAsRequired",
        "extensionNotNecessary_1_1_glTF",
        "extensionUsedButNotFound",
        "extensionsValueInvalidType",
        "extrasUnexpectedType",
        "statisticsClassesMinPropertiesMismatch",
        "statisticsClassesPropertiesMinPropertiesMismatch",
        "tileContentBoundingVolumeWithTransform",
        "tilesetMetadataEntityPropertyMaxWithScaleNotInRange",
        "tilesetMetadataEntityPropertyMinWithNormalizedNotInRange",
        "tilesetMetadataEntityPropertyMinWithOffsetNotInRange",
        "tilesetMetadataEntityPropertyMinWithScaleNotInRange",
        "tilesetWithMultipleExternal",
        "implicitTilingValid",
    ];
    let Some(data) = data() else { return };
    let (mut found, mut missed) = (0, Vec::new());
    for entry in std::fs::read_dir(data.join("invalid/specs/data/tilesets")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_string();
        let excused = NOT_KEPT.iter().any(|known| name.starts_with(known));
        let json = path.extension().is_some_and(|end| end == "json");
        let text = std::fs::read(&path).unwrap_or_default();
        let away = text.windows(4).any(|word| word == b"http");
        if !json || name.starts_with("valid") || excused || away {
            continue;
        }
        if look(&path).is_ok_and(|found| found.faults.is_empty()) {
            missed.push(name);
        } else {
            found += 1;
        }
    }
    assert!(missed.is_empty(), "{missed:?}");
    assert!(found > 80, "{found}");
}

#[test]
fn contradictions_of_subtrees_are_found() {
    let Some(data) = data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let from = data.join("invalid/specs/data/subtrees");
    for entry in std::fs::read_dir(&from).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), folder.path().join(entry.file_name())).unwrap();
    }
    for (name, told) in [
        ("validSubtree.json", "no fault"),
        ("binarySubtreeValid.subtree", "no fault"),
        (
            "subtreeTileAvailabilityAvailableCountMismatch.json",
            "bits that are set",
        ),
        (
            "subtreeTileAvailabilityBitstreamLengthTooLarge.json",
            "more bytes",
        ),
        (
            "subtreeTileAvailabilityBitstreamLengthTooSmall.json",
            "bits, fewer",
        ),
        (
            "subtreeTileAvailabilityForParentMissingForAvailableTile.json",
            "without its parent",
        ),
        (
            "subtreeTileAvailabilityMissingForAvailableContent.json",
            "not available",
        ),
        ("binarySubtreeInvalidMagic.subtree", "is no subtree"),
    ] {
        let json = format!(
            r#"{{"asset":{{"version":"1.1"}},"geometricError":9,"root":{{"boundingVolume":{{"box":[0,0,0,8,0,0,0,8,0,0,0,8]}},
            "geometricError":9,"refine":"ADD","implicitTiling":{{"subdivisionScheme":"QUADTREE","availableLevels":3,
            "subtreeLevels":3,"subtrees":{{"uri":"{name}?{{level}}.{{x}}.{{y}}"}}}}}}}}"#
        );
        let file = folder.path().join("tileset.json");
        std::fs::write(&file, json).unwrap();
        let text = look(&file).unwrap().text();
        assert!(text.contains(told), "{name}: {text}");
    }
}

#[test]
fn inspect_says_what_a_camera_would_load() {
    let Some(data) = data() else { return };
    let mars = data.join("mars-terrain/example/public/data");
    let line = [
        "inspect",
        mars.to_str().unwrap(),
        "--above",
        "200",
        "--no-cull",
    ];
    let text = inspect(&Line::parse_from(line).inspect).unwrap();
    assert!(text.contains("293 tiles, with 293 contents"), "{text}");
    assert!(
        text.contains("draws     88 tiles, 89,736 triangles"),
        "{text}"
    );
    let georeferenced = data.join("samples/1.0/TilesetWithRequestVolume");
    let line = [
        "inspect",
        georeferenced.to_str().unwrap(),
        "--at",
        "40.04253,-75.612,150",
        "--look",
        "0,-89.9",
    ];
    let text = inspect(&Line::parse_from(line).inspect).unwrap();
    assert!(
        text.contains("latitude 40.042530°, longitude -75.612000°, 150.0 m"),
        "{text}"
    );
    assert!(text.contains("files     2 tilesets"), "{text}");
    for wrong in [
        ["inspect", "x", "--at", "1,2"],
        ["inspect", "x", "--size", "5"],
        ["inspect", "x", "--fovy", "200"],
    ] {
        assert!(Line::try_parse_from(wrong).is_err());
    }
}
