//! A snapshot holds every component and resource that a tick may change.

use crate::common::ROOT;
use std::collections::BTreeSet;
use std::path::Path;

/// What a snapshot leaves out, and why that is right.
const LEFT_OUT: [(&str, &[&str]); 5] = [
    (
        "set before the first tick, and never changed",
        &[
            "CameraOf",
            "Cast",
            "DetectorInUse",
            "Detectors",
            "Distractor",
            "Lamps",
            "Network",
            "OpticalPath",
            "Options",
            "PointingLaws",
            "Propagations",
            "Recogniser",
            "RunScenario",
            "Seed",
            "Station",
            "StationCameras",
            "Stations",
            "StrayOptics",
            "Surveyed",
            "Swarms",
            "Uav",
            "UavShape",
        ],
    ),
    (
        "drawn anew for each exposure",
        &[
            "CityTilesets",
            "DepthViews",
            "LeanPaint",
            "SceneHandles",
            "SensorViews",
            "SiteGrid",
            "Solids",
            "StationOrigin",
            "UavBody",
            "UavRotor",
        ],
    ),
    (
        "of a run that is recorded, which does not go back",
        &["OwnTopics", "Recording"],
    ),
    (
        "of the wall clock, or workspace",
        &["Failure", "Kept", "Stopwatch"],
    ),
    (
        "of the window",
        &[
            "ChosenStation",
            "Estimates",
            "FreeCamera",
            "Insets",
            "Pacing",
            "Pictures",
            "Playback",
            "Session",
            "ShowWeak",
            "Sight",
            "Taken",
            "TrackRows",
            "WindowCamera",
            "WindowFrame",
        ],
    ),
];

/// Names of the components and resources in a source text.
fn data(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut derived = false;
    for line in text.lines() {
        if let Some(list) = line.strip_prefix("#[derive(") {
            let mut names = list.split([',', ')']).map(str::trim);
            derived = names.any(|name| name == "Component" || name == "Resource");
        }
        let named = ["pub struct ", "pub enum "]
            .iter()
            .find_map(|start| line.strip_prefix(start));
        if let Some(rest) = named.filter(|_| derived) {
            let end = rest.find(|letter: char| !letter.is_alphanumeric());
            found.insert(rest[..end.unwrap_or(rest.len())].to_owned());
            derived = false;
        }
    }
    found
}

/// Names between `<` and `>` of a list of kinds.
fn kept(text: &str) -> BTreeSet<String> {
    let entries = text
        .lines()
        .filter(|line| line.trim_end().ends_with("::boxed,"));
    let names =
        entries.filter_map(|line| Some(line.split_once("::<")?.1.split_once('>')?.0.to_owned()));
    names.collect()
}

#[test]
fn a_snapshot_holds_all_that_a_tick_may_change() {
    let mut there = BTreeSet::new();
    for entry in std::fs::read_dir(Path::new(ROOT).join("src/components")).unwrap() {
        there.extend(data(
            &std::fs::read_to_string(entry.unwrap().path()).unwrap(),
        ));
    }
    let snapshot = Path::new(ROOT).join("src/simulation/snapshot.rs");
    let kept = kept(&std::fs::read_to_string(snapshot).unwrap());
    let left = LEFT_OUT
        .iter()
        .flat_map(|(_, names)| *names)
        .map(|name| name.to_string());
    let left: BTreeSet<String> = left.collect();
    assert!(kept.len() > 30, "{kept:?}");
    let both: Vec<_> = kept.intersection(&left).collect();
    assert!(both.is_empty(), "kept and left out: {both:?}");
    let known: BTreeSet<String> = kept.union(&left).cloned().collect();
    let new: Vec<_> = there.difference(&known).collect();
    assert!(
        new.is_empty(),
        "{new:?}: put them into src/simulation/snapshot.rs, or say here why not"
    );
    let gone: Vec<_> = known.difference(&there).collect();
    assert!(gone.is_empty(), "{gone:?} are no components or resources");
}

#[test]
fn data_are_found_by_their_derives() {
    let text = "#[derive(Component, Clone)]\n#[x]\npub struct A(u8);\n#[derive(Clone)]\npub struct B;\n\
                #[derive(Clone, Resource)]\npub enum C {\n";
    assert_eq!(data(text), BTreeSet::from(["A".to_owned(), "C".to_owned()]));
}
