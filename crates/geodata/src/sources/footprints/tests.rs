use super::*;
use crate::sources::surfaces::volume_m3;
use proptest::prelude::*;
use serde_json::{Value, json};
use std::path::PathBuf;

mod extract;
mod odd;

/// A file in a folder of its own.
fn read_text(text: &str, options: &Options) -> Result<Layer, SourceError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("outlines.geojson");
    std::fs::write(&path, text).unwrap();
    read(&path, options)
}

/// A rectangle in the Swiss map, corners in order.
fn ring(e: f64, n: f64, w: f64, h: f64) -> Value {
    json!([[e, n], [e + w, n], [e + w, n + h], [e, n + h], [e, n]])
}

fn collection(features: &[(Value, Value)]) -> String {
    let feature = |(rings, known): &(Value, Value)| json!({"type": "Feature", "properties": known, "geometry": {"type": "Polygon", "coordinates": rings}});
    let features: Vec<Value> = features.iter().map(feature).collect();
    json!({"type": "FeatureCollection", "features": features,
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::2056"}}})
    .to_string()
}

const E: f64 = 2_683_000.0;
const N: f64 = 1_247_000.0;

#[test]
fn outlines_become_closed_buildings_of_their_height() {
    let text = collection(&[
        (
            json!([ring(E, N, 20.0, 10.0), ring(E + 5.0, N + 2.0, 4.0, 4.0)]),
            json!({"height": 12.0, "name": "court"}),
        ),
        (
            json!([ring(E + 50.0, N, 10.0, 10.0)]),
            json!({"building:levels": "4", "min_height": 3}),
        ),
        (
            json!([ring(E + 80.0, N, 10.0, 10.0)]),
            json!({"height": "40 ft"}),
        ),
        (
            json!([ring(E + 100.0, N, 10.0, 10.0)]),
            json!({"height": "tall"}),
        ),
        (
            json!([ring(E + 120.0, N, 10.0, 10.0)]),
            json!({"height": 12, "roof:height": 6, "roof:shape": "pyramidal", "roof:colour": "#ff0000"}),
        ),
        (json!([[[E, N], [E + 1.0, N], [E, N]]]), json!({})),
    ]);
    let layer = read_text(
        &text,
        &Options {
            base_height_m: 400.0,
            ..Options::default()
        },
    )
    .unwrap();
    assert_eq!(
        (layer.kind, layer.features.len()),
        (LayerKind::Buildings, 5)
    );
    for (k, want) in [
        184.0 * 12.0,
        100.0 * 9.0,
        100.0 * 12.192,
        100.0 * UNKNOWN_M,
        100.0 * 8.0,
    ]
    .into_iter()
    .enumerate()
    {
        let found = volume_m3(&layer.meshes, Some(k as u32));
        // The Swiss map's scale in Zürich is within 1e-4, and a tower widens with its height by 2e-6.
        assert!(
            (found / want - 1.0).abs() < 3e-4,
            "{k}: {found} against {want}"
        );
    }
    assert_eq!(layer.features[0]["name"], "court");
    assert_eq!(
        (
            layer.features[1]["bottom_m"].as_f64(),
            layer.features[1]["top_m"].as_f64()
        ),
        (Some(3.0), Some(12.0))
    );
    let red = layer.meshes[0]
        .colors
        .iter()
        .filter(|c| **c == [1.0, 0.0, 0.0, 1.0])
        .count();
    assert_eq!(red, 12);
    // 400 m over LN02, 47.5 m of geoid.
    assert!((layer.site.origin().height_m - 447.5).abs() < 1.0);
    let walls = layer.meshes[0].positions.len();
    assert_eq!(layer.meshes[0].features.len(), walls);
}

#[test]
fn openstreetmap_ways_relations_and_parts_are_read() {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("tests/data/osm/block.osm.pbf");
    let layer = read(&path, &Options::default()).unwrap();
    // A box, a house of two storeys and a pyramid, a court of two joined ways, and two parts in place of their outline.
    let wanted = [
        2400.0,
        100.0 * 6.0 + 100.0 * 3.0 / 3.0,
        200.0 * 25.0,
        200.0 * 10.0,
        (1600.0 - 400.0) * 15.0,
    ];
    let found: Vec<f64> = (0..layer.features.len())
        .map(|k| volume_m3(&layer.meshes, Some(k as u32)))
        .collect();
    assert_eq!(found.len(), wanted.len(), "{found:?}");
    for (found, want) in found.iter().zip(wanted) {
        // Nodes are kept to a centimetre.
        assert!((found / want - 1.0).abs() < 5e-3, "{found} against {want}");
    }
    assert_eq!(layer.features[1]["name"], "Haus");
    assert_eq!(layer.features[3]["building:part"], "yes");
}

#[test]
fn longitudes_and_latitudes_stay_so_beside_a_map() {
    let text = r#"{"type":"Polygon","coordinates":[[[8.54,47.37],[8.541,47.37],[8.541,47.371],[8.54,47.37]]]}"#;
    let read = |crs: Option<&str>| {
        let options = Options {
            crs: crs.map(str::to_string),
            ..Options::default()
        };
        read_text(text, &options).unwrap().site.origin()
    };
    assert_eq!(read(Some("EPSG:2056")), read(None));
}

#[test]
fn bad_files_are_one_error_that_says_what_to_do() {
    let said = |text: &str, options: &Options| read_text(text, options).unwrap_err().to_string();
    let plain = Options::default();
    assert!(said("{", &plain).contains("GeoJSON"));
    assert!(said(r#"{"type":"FeatureCollection","features":[]}"#, &plain).contains("no polygon"));
    // Metres where degrees belong.
    let metres =
        collection(&[(json!([ring(E, N, 9.0, 9.0)]), json!({}))]).replace("\"crs\"", "\"none\"");
    assert!(said(&metres, &plain).contains("--crs"));
    assert!(
        read_text(
            &metres,
            &Options {
                crs: Some("EPSG:2056".into()),
                ..plain.clone()
            }
        )
        .is_ok()
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("city.osm");
    std::fs::write(&path, "<osm/>").unwrap();
    assert!(
        read(&path, &plain)
            .unwrap_err()
            .to_string()
            .contains("osmium")
    );
    let path = folder.path().join("city.osm.pbf");
    for bytes in [&b""[..], b"\0\0\0\x0d", b"nothing of the kind", &[255; 64]] {
        std::fs::write(&path, bytes).unwrap();
        assert!(read(&path, &plain).is_err());
    }
}

#[test]
fn buildings_stand_on_terrain() {
    let dem = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("../shared/data/dem/zh_dem_25.tif");
    if !dem.exists() {
        println!("skipped: {} is absent", dem.display());
        return;
    }
    // Two houses in Zürich, one of them on the Zürichberg, and one in Bern, beside the terrain.
    let text = collection(&[
        (json!([ring(E, N, 20.0, 10.0)]), json!({"height": 10})),
        (
            json!([ring(2_685_200.0, 1_248_600.0, 20.0, 10.0)]),
            json!({"height": 10}),
        ),
        (
            json!([ring(2_600_000.0, 1_200_000.0, 20.0, 10.0)]),
            json!({"height": 10}),
        ),
    ]);
    let options = Options {
        terrain: Some(dem),
        terrain_crs: Some("EPSG:21781".into()),
        ..Options::default()
    };
    let layer = read_text(&text, &options).unwrap();
    assert_eq!(layer.features.len(), 2);
    let said = layer.warnings[0].to_string();
    assert!(
        said.contains("1 outlines beside the terrain (feature 3)"),
        "{said}"
    );
    let ground = |k: usize| layer.features[k]["ground_ellipsoid_m"].as_f64().unwrap() - 47.5;
    println!("{} {}", ground(0), ground(1));
    assert!((400.0..460.0).contains(&ground(0)) && (550.0..700.0).contains(&ground(1)));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]
    #[test]
    fn damaged_extracts_never_panic(flips in prop::collection::vec((0..2000_usize, 0..8_u8), 1..6), cut in 0..1200_usize) {
        let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("tests/data/osm/block.osm.pbf");
        let mut bytes = std::fs::read(path).unwrap();
        for (at, bit) in flips {
            let at = at % bytes.len();
            bytes[at] ^= 1 << bit;
        }
        if cut < bytes.len() && cut % 2 == 0 {
            bytes.truncate(cut);
        }
        let _ = osm::read(&bytes, &mut Notes::default());
    }

    #[test]
    fn damaged_geojson_never_panics(flips in prop::collection::vec((0..2000_usize, 0..8_u8), 1..6)) {
        let text = collection(&[(json!([ring(E, N, 20.0, 10.0)]), json!({"height": "12 m", "roof:shape": "pyramidal", "roof:height": 3}))]);
        let mut bytes = text.into_bytes();
        for (at, bit) in flips {
            let at = at % bytes.len();
            bytes[at] ^= 1 << bit;
        }
        let mut notes = Notes::default();
        if let Ok((found, system)) = parse(&bytes, "a.geojson", &Options::default(), &mut notes)
            && let Ok(crs) = Crs::parse(&system)
        {
            let _ = buildings(found, &crs.with_geoid_height(47.0), None, &Options::default(), &mut notes);
        }
    }
}
