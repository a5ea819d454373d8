use super::*;
use crate::sources::surfaces::volume_m3;
use proptest::prelude::*;
use serde_json::json;

/// A file of its own in a folder that goes with it.
fn read_text(text: &str, options: &Options) -> Result<Vec<Layer>, SourceError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("city.json");
    std::fs::write(&path, text).unwrap();
    read_all(&path, options)
}

/// Surfaces of a box with corners 0..8, seen from outside: ground, roof, four walls.
fn cube() -> Value {
    json!([
        [[0, 3, 2, 1]],
        [[4, 5, 6, 7]],
        [[0, 1, 5, 4]],
        [[1, 2, 6, 5]],
        [[2, 3, 7, 6]],
        [[3, 0, 4, 7]]
    ])
}

/// 10 m by 20 m by 6 m, in millimetres.
fn corners() -> Value {
    let (x, y, z) = (10_000, 20_000, 6_000);
    json!([
        [0, 0, 0],
        [x, 0, 0],
        [x, y, 0],
        [0, y, 0],
        [0, 0, z],
        [x, 0, z],
        [x, y, z],
        [0, y, z]
    ])
}

fn city(objects: Value) -> Value {
    json!({
        "type": "CityJSON", "version": "2.0",
        "transform": {"scale": [0.001, 0.001, 0.001], "translate": [84600.0, 447400.0, 1.0]},
        "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415"},
        "CityObjects": objects, "vertices": corners()
    })
}

#[test]
fn a_solid_becomes_a_closed_building() {
    let house = json!({"house": {"type": "Building", "attributes": {"storeys": 2}, "geometry": [
        {"type": "Solid", "lod": "2.2", "boundaries": [cube()], "semantics": {
            "surfaces": [{"type": "GroundSurface"}, {"type": "RoofSurface"}, {"type": "WallSurface"}],
            "values": [[0, 1, 2, 2, 2, null]]}},
        {"type": "MultiSurface", "lod": "0", "boundaries": [[[0, 1, 2, 3]]]}
    ]}});
    let layers = read_text(&city(house).to_string(), &Options::default()).unwrap();
    let [layer] = &layers[..] else { panic!() };
    // RD New is 0.99993 of the ground here.
    let volume = volume_m3(&layer.meshes, Some(0));
    assert!((volume / 1200.0 - 1.0).abs() < 3e-4, "{volume}");
    assert_eq!(layer.meshes[0].triangle_count(), 12);
    let known = &layer.features[0];
    assert_eq!(
        (known["id"].as_str(), known["storeys"].as_i64()),
        (Some("house"), Some(2))
    );
    assert_eq!(
        (known["bottom"].as_f64(), known["top"].as_f64()),
        (Some(1.0), Some(7.0))
    );
    // The roof has a colour of its own, and lies 6 m over the lowest point.
    let mesh = &layer.meshes[0];
    let up = mesh.normals.iter().position(|n| n[2] > 0.99).unwrap();
    assert_eq!(
        mesh.colors[up],
        albedo("Building", Some("RoofSurface"), 1.0)
    );
    assert!((mesh.vertex_m(up as u32).z - 6.0).abs() < 1e-3);
    // NAP 1 m over Delft is some 44.5 m over the ellipsoid.
    assert!((layer.site.origin().height_m - 44.5).abs() < 0.6);
}

#[test]
fn shells_that_are_inside_out_are_turned() {
    let turned: Vec<Value> = cube()
        .as_array()
        .unwrap()
        .iter()
        .map(|s| json!([s[0].as_array().unwrap().iter().rev().collect::<Vec<_>>()]))
        .collect();
    for (kind, boundaries) in [
        ("Solid", json!([turned])),
        ("MultiSurface", json!(turned)),
        ("CompositeSolid", json!([[turned]])),
    ] {
        let house = json!({"house": {"type": "BuildingPart", "parents": ["block"], "geometry": [
            {"type": kind, "lod": 1, "boundaries": boundaries}]}});
        let layers = read_text(&city(house).to_string(), &Options::default()).unwrap();
        assert!(
            (volume_m3(&layers[0].meshes, None) / 1200.0 - 1.0).abs() < 3e-4,
            "{kind}"
        );
        assert_eq!(layers[0].features[0]["parent"], "block");
    }
}

#[test]
fn levels_of_detail_and_kinds_of_objects_are_chosen() {
    let roof = json!([[[4, 5, 6, 7]]]);
    let objects = json!({
        "house": {"type": "Building", "geometry": [
            {"type": "Solid", "lod": "1.2", "boundaries": [cube()]},
            {"type": "MultiSurface", "lod": "2.2", "boundaries": roof}]},
        "lawn": {"type": "LandUse", "geometry": [{"type": "MultiSurface", "lod": "1", "boundaries": [[[0, 3, 2, 1]]]}]},
        "bridge": {"type": "Bridge", "geometry": [{"type": "MultiSurface", "lod": "1", "boundaries": roof}]},
        "empty": {"type": "Building"}
    });
    let text = city(objects).to_string();
    let triangles = |lod: Option<&str>| {
        let options = Options {
            lod: lod.map(str::to_string),
            ..Options::default()
        };
        let layers = read_text(&text, &options).unwrap();
        assert_eq!(
            layers.iter().map(|l| l.kind).collect::<Vec<_>>(),
            [LayerKind::Buildings, LayerKind::Terrain, LayerKind::Surface]
        );
        assert_eq!(layers[0].features.len(), 1);
        // The lawn is seen from above although its ring runs clockwise.
        assert!(layers[1].meshes[0].normals.iter().all(|n| n[2] > 0.99));
        layers[0].meshes[0].triangle_count()
    };
    assert_eq!(
        (
            triangles(None),
            triangles(Some("1.3")),
            triangles(Some("0.5"))
        ),
        (2, 12, 12)
    );
}

#[test]
fn a_sequence_and_instances_of_a_template_are_read() {
    let mut head = city(json!({}));
    head["vertices"] = json!([]);
    head["geometry-templates"] = json!({
        "templates": [{"type": "Solid", "lod": "1", "boundaries": [cube()]}],
        "vertices-templates": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    });
    let house = json!({"type": "CityJSONFeature", "id": "house", "vertices": corners(),
        "CityObjects": {"house": {"type": "Building", "geometry": [{"type": "Solid", "lod": "1", "boundaries": [cube()]}]}}});
    // Twice as high, moved by 100 m east.
    let copy = json!({"type": "CityJSONFeature", "id": "copy", "vertices": [[0, 0, 0]],
        "CityObjects": {"copy": {"type": "BuildingInstallation", "geometry": [{"type": "GeometryInstance", "template": 0, "boundaries": [0],
            "transformationMatrix": [2, 0, 0, 100, 0, 2, 0, 0, 0, 0, 4, 0, 0, 0, 0, 1]}]}}});
    let layers = read_text(&format!("{head}\n{house}\n{copy}\n"), &Options::default()).unwrap();
    assert_eq!(layers[0].features.len(), 2);
    assert!((volume_m3(&layers[0].meshes, Some(0)) / 1200.0 - 1.0).abs() < 3e-4);
    assert!((volume_m3(&layers[0].meshes, Some(1)) / 16.0 - 1.0).abs() < 3e-4);
    let east = layers[0].meshes[0]
        .features
        .iter()
        .position(|f| *f == 1)
        .unwrap();
    assert!(layers[0].meshes[0].vertex_m(east as u32).x > 80.0);
}

#[test]
fn materials_and_textures_are_taken() {
    let folder = tempfile::tempdir().unwrap();
    let picture = image::RgbaImage::from_fn(4, 4, |x, y| {
        image::Rgba([10 * x as u8, 10 * y as u8, 0, 255])
    });
    picture.save(folder.path().join("facade.png")).unwrap();
    let ring = json!([[0, 0, 1, 2, 3]]);
    let none = json!([[null]]);
    let mut text = city(
        json!({"house": {"type": "Building", "geometry": [{"type": "Solid", "lod": "2", "boundaries": [cube()],
        "material": {"rgb": {"values": [[null, 0, null, null, null, null]]}},
        "texture": {"day": {"values": [[none, none, ring, none, none, none]]}}}]}}),
    );
    text["appearance"] = json!({
        "materials": [{"name": "roof", "diffuseColor": [1.0, 0.0, 0.0]}],
        "textures": [{"type": "PNG", "image": "facade.png"}],
        "vertices-texture": [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    });
    let path = folder.path().join("city.json");
    std::fs::write(&path, text.to_string()).unwrap();
    let layer = read(&path, &Options::default()).unwrap();
    assert_eq!(layer.meshes.len(), 2);
    let up = layer.meshes[0]
        .normals
        .iter()
        .position(|n| n[2] > 0.99)
        .unwrap();
    assert_eq!(layer.meshes[0].colors[up], [1.0, 0.0, 0.0, 1.0]);
    let wall = &layer.meshes[1];
    assert_eq!(wall.look.texture.as_ref().unwrap().size_px, [4, 4]);
    assert_eq!((wall.uv[0], wall.triangle_count()), ([0.0, 1.0], 2));
    // Without its picture the wall is plain.
    std::fs::remove_file(folder.path().join("facade.png")).unwrap();
    assert_eq!(read(&path, &Options::default()).unwrap().meshes.len(), 1);
}

#[test]
fn bad_files_are_one_error_that_says_what_to_do() {
    let said = |text: String| {
        read_text(&text, &Options::default())
            .unwrap_err()
            .to_string()
    };
    assert!(said("{".into()).contains("JSON"));
    assert!(said("[]".into()).contains("JSON"));
    assert!(said(json!({"type": "FeatureCollection"}).to_string()).contains("is no CityJSON"));
    let mut old = city(json!({}));
    old["version"] = json!("0.8");
    assert!(said(old.to_string()).contains("cjio"));
    let house = |boundaries: Value| {
        city(
            json!({"house": {"type": "Building", "geometry": [{"type": "Solid", "lod": "1", "boundaries": boundaries}]}}),
        )
    };
    let missing = said(house(json!([[[[0, 1, 99]]]])).to_string());
    assert!(
        missing.contains("Building house") && missing.contains("does not exist"),
        "{missing}"
    );
    let mut nowhere = house(json!([cube()]));
    nowhere["metadata"] = json!({});
    assert!(said(nowhere.to_string()).contains("--crs"));
    nowhere["metadata"] = json!({"referenceSystem": "EPSG:99999"});
    assert!(said(nowhere.to_string()).contains("EPSG:99999"));
    assert!(said(city(json!({})).to_string()).contains("no surfaces"));
    let deep = format!("{}{}", "[".repeat(5000), "]".repeat(5000));
    assert!(
        said(
            house(json!(0))
                .to_string()
                .replace("\"boundaries\":0", &format!("\"boundaries\":{deep}"))
        )
        .contains("JSON")
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn damaged_files_never_panic(cut in 0..900_usize, flips in prop::collection::vec((0..900_usize, 0..8_u8), 0..4)) {
        let text = city(json!({"house": {"type": "Building", "geometry": [{"type": "Solid", "lod": "2.2", "boundaries": [cube()],
            "semantics": {"surfaces": [{"type": "RoofSurface"}], "values": [[0, 0, 0, 0, 0, null]]}}]}})).to_string();
        let mut bytes = text.into_bytes();
        for (at, bit) in flips {
            let at = at % bytes.len();
            bytes[at] ^= 1 << bit;
        }
        if cut < bytes.len() && cut % 3 == 0 {
            bytes.truncate(cut);
        }
        if let Ok(documents) = document::parse(&bytes) {
            let place = Place::Local(glam::DAffine3::from_translation(DVec3::new(6_378_137.0, 0.0, 0.0)));
            let _ = layers(&documents, &place, &Options::default(), Path::new("."));
        }
    }
}

#[test]
fn delft_has_its_160_buildings() {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/cityjson/delft.city.json");
    if !path.exists() {
        println!("skipped: {} is absent", path.display());
        return;
    }
    let layers = read_all(&path, &Options::default()).unwrap();
    let kinds: Vec<_> = layers
        .iter()
        .map(|layer| (layer.kind, layer.features.len()))
        .collect();
    assert_eq!(
        kinds,
        [
            (LayerKind::Buildings, 160),
            (LayerKind::Terrain, 407),
            (LayerKind::Surface, 3)
        ]
    );
    let (mut high, mut volume_all) = (0, 0.0);
    for (k, known) in layers[0].features.iter().enumerate() {
        let volume = volume_m3(&layers[0].meshes, Some(k as u32));
        assert!(volume > 3.0, "{volume} {known:?}");
        volume_all += volume;
        // The file states each roof's height over NAP, rounded to a centimetre.
        let top = known["top"].as_f64().unwrap();
        high += usize::from((top - known["measuredHeight"].as_f64().unwrap()).abs() < 0.011);
    }
    assert_eq!(high, 160);
    // The solids lack their ground surfaces. Their volume over it in the map's plane is 33060.4 m³; the map's scale there is 0.99993.
    assert!((volume_all / 33_060.36 - 1.0).abs() < 5e-4, "{volume_all}");
}
