use super::*;
use crate::tiles::fetch::Limits;
use boresight_models::tiles::selection::{SelectOptions, View, ideal_cut};
use glam::DVec3;
use std::path::PathBuf;
use std::time::{Duration, Instant};

fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    folder
}

/// A tileset of one tile with something more in it.
fn one(more: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"1.1"}},"geometricError":9,"root":{{"boundingVolume":{{"sphere":[0,0,0,5]}},"geometricError":1{more}}}}}"#
    )
}

fn open(json: &str) -> Result<Tileset, TilesError> {
    let folder = folder(&[("tileset.json", json)]);
    Tileset::open(folder.path().to_str().unwrap())
}

#[test]
fn transforms_refinement_and_contents_are_inherited_and_read() {
    let json = one(
        r#","refine":"ADD","transform":[2,0,0,0,0,2,0,0,0,0,2,0,10,0,0,1],"content":{"url":"a.b3dm"},
        "children":[{"boundingVolume":{"box":[0,0,0,1,0,0,0,1,0,0,0,1]},"geometricError":0.5,
        "transform":[1,0,0,0,0,1,0,0,0,0,1,0,0,3,0,1],"contents":[{"uri":"b.glb","group":1},{"uri":"c.glb"}],
        "metadata":{"class":"x"}}]"#,
    );
    let tileset = open(&json).unwrap();
    let child = TileId(1);
    let tile = tileset.tree.tile(child);
    assert_eq!((tile.refine, tile.contents.len()), (Refine::Add, 2));
    assert_eq!(
        tileset.tree.bounds(child).center_m,
        DVec3::new(10.0, 6.0, 0.0)
    );
    assert_eq!(tileset.tree.error_m(child), 1.0);
    assert!(tileset.tree.tile(TileId(0)).contents[0].ends_with("/a.b3dm"));
    let facts = tileset.facts(child).unwrap();
    assert_eq!(
        (facts.groups.clone(), facts.metadata.is_some()),
        (vec![1], true)
    );
}

#[test]
fn faults_say_where_and_what() {
    for (more, told) in [
        (r#","refine":"SOMEHOW""#, "root.refine"),
        (r#","transform":[1,2,3]"#, "root.transform"),
        (
            r#","transform":[1,0,0,1,0,1,0,0,0,0,1,0,0,0,0,1]"#,
            "affine",
        ),
        (
            r#","children":[{"boundingVolume":{"box":[1,2]},"geometricError":0}]"#,
            "root.children[0].boundingVolume.box",
        ),
        (
            r#","children":[{"geometricError":0}]"#,
            "root.children[0]: has no 'boundingVolume'",
        ),
        (
            r#","children":[{"boundingVolume":{"extensions":{"3DTILES_bounding_volume_S2":{"token":"1"}}},"geometricError":0}]"#,
            "S2",
        ),
        (r#","content":{}"#, "root.content: has no 'uri'"),
        (
            r#","implicitTiling":{"subdivisionScheme":"QUADTREE"}"#,
            "sphere",
        ),
        (r#","children":7"#, "root.children"),
    ] {
        let error = open(&one(more)).unwrap_err().to_string();
        assert!(
            error.contains(told) && error.contains("tileset.json"),
            "{error}"
        );
    }
    let versions = open(&one("").replace("1.1", "2.0"))
        .unwrap_err()
        .to_string();
    assert!(versions.contains("version '2.0'"), "{versions}");
    let required = one("").replacen('{', r#"{"extensionsRequired":["ACME_magic"],"#, 1);
    assert!(
        open(&required)
            .unwrap_err()
            .to_string()
            .contains("ACME_magic")
    );
    assert!(open("{").unwrap_err().to_string().contains("line 1"));
    assert!(
        Tileset::open("/nowhere/tileset.json")
            .unwrap_err()
            .to_string()
            .contains("no such file")
    );
    assert!(
        Tileset::open("x.3dtiles")
            .unwrap_err()
            .to_string()
            .contains(".3tz")
    );
}

#[test]
fn a_tileset_that_leads_back_to_itself_ends() {
    let lead = |to: &str| one(&format!(r#","content":{{"uri":"{to}"}}"#));
    let folder = folder(&[
        ("a.json", &lead("b/b.json")),
        ("b/b.json", &lead("../a.json")),
    ]);
    let mut tileset = Tileset::open(folder.path().join("a.json").to_str().unwrap()).unwrap();
    tileset.expand(TileId(0)).unwrap();
    let error = tileset.expand(TileId(1)).unwrap_err().to_string();
    assert!(error.contains("leads back"), "{error}");
    assert_eq!(tileset.failures().len(), 1);
    // Told once.
    tileset.expand(TileId(1)).unwrap();
    assert_eq!(tileset.failures().len(), 1);
}

#[test]
fn several_external_tilesets_beside_a_content_are_all_found() {
    let leaf = one(r#","content":{"uri":"leaf.glb"}"#);
    let root = one(r#","contents":[{"uri":"a.glb"},{"uri":"x/a.json?v=1"},{"uri":"b.json"}]"#);
    let folder = folder(&[
        ("tileset.json", &root),
        ("x/a.json", &leaf),
        ("b.json", &leaf),
    ]);
    let mut tileset = Tileset::open(folder.path().to_str().unwrap()).unwrap();
    assert_eq!(tileset.tree.tile(TileId(0)).contents.len(), 1);
    let leading: Vec<TileId> = tileset.tree.children(TileId(0)).collect();
    assert_eq!(leading.len(), 2);
    for tile in leading {
        tileset.expand(tile).unwrap();
        assert_eq!(tileset.tree.children(tile).count(), 1);
    }
    assert!(tileset.tree.tile(TileId(3)).contents[0].ends_with("/x/leaf.glb"));
    assert_eq!(tileset.tree.depth(TileId(4)), 2);
}

#[test]
fn a_request_reads_on_another_thread() {
    let leaf = one("");
    let folder = folder(&[
        ("tileset.json", &one(r#","content":{"uri":"b.json"}"#)),
        ("b.json", &leaf),
    ]);
    let mut tileset = Tileset::open(folder.path().to_str().unwrap()).unwrap();
    let request = tileset.request(TileId(0)).unwrap();
    let read = std::thread::spawn(move || request.read()).join().unwrap();
    tileset.adopt(TileId(0), read).unwrap();
    assert_eq!(tileset.tree.tiles().len(), 2);
    assert!(tileset.request(TileId(0)).is_none());
}

/// Opens it, and reads all that four views and a fixed level of detail ask for.
fn walk(location: &str, most: usize) -> Result<usize, TilesError> {
    let limits = Limits {
        bytes: 64 << 20,
        silence: Duration::from_millis(300),
        whole: Duration::from_millis(600),
    };
    let mut tileset = Tileset::open_with(location, Fetcher::new(limits))?;
    let options = SelectOptions {
        max_error_px: 1e-9,
        cull: false,
    };
    let eye = tileset.tree.bounds(TileId(0)).center_m;
    let view = View {
        r_root_m: eye,
        forward: DVec3::X,
        up: DVec3::Z,
        fovy_rad: 1.0,
        size_px: [640, 480],
    };
    loop {
        let cut = ideal_cut(&tileset.tree, &[view], &options);
        let next = cut.unread.into_iter().next();
        let Some(next) = next.filter(|_| tileset.tree.tiles().len() < most) else {
            return Ok(tileset.tree.tiles().len());
        };
        let _ = tileset.expand(next);
    }
}

#[test]
fn every_damaged_tileset_loads_or_gives_one_error() {
    let root = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("../shared/data/tiles/invalid");
    if !root.is_dir() {
        println!("skipped: no ../shared/data/tiles/invalid");
        return;
    }
    let (mut loaded, mut refused, mut folders) = (0, 0, vec![root]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let text = std::fs::read(&path).unwrap_or_default();
            // Nothing is fetched from a network here.
            if text.windows(7).any(|w| w == b"http://") || text.windows(8).any(|w| w == b"https://")
            {
                continue;
            }
            let started = Instant::now();
            match walk(path.to_str().unwrap(), 20_000) {
                Ok(_) => loaded += 1,
                Err(error) => {
                    let told = error.to_string();
                    assert!(told.lines().count() == 1 && told.len() < 1000, "{told}");
                    refused += 1;
                }
            }
            assert!(
                started.elapsed() < Duration::from_secs(20),
                "{}",
                path.display()
            );
        }
    }
    assert!(
        loaded > 100 && refused > 100,
        "{loaded} loaded, {refused} refused"
    );
}
