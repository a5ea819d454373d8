use super::kinds::albedo;
use super::*;
use crate::sources::surfaces::volume_m3;
use proptest::prelude::*;
use serde_json::{Value, json};

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
        let mut notes = Notes::default();
        if let Ok(documents) = document::parse(&bytes, &mut notes) {
            let place = Place::Local(glam::DAffine3::from_translation(DVec3::new(6_378_137.0, 0.0, 0.0)));
            let _ = layers(&documents, &place, &Options::default(), Path::new("."), &mut notes);
        }
    }
}

#[test]
fn delft_has_its_160_buildings() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("../shared/data/cityjson/delft.city.json");
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

/// What a file is read to, with its warnings in one text.
fn read_with_warnings(text: &str, options: &Options) -> (Vec<Layer>, String) {
    let layers = read_text(text, options).unwrap();
    let lines: Vec<String> = layers
        .iter()
        .flat_map(|layer| &layer.warnings)
        .map(ToString::to_string)
        .collect();
    (layers, lines.join("\n"))
}

fn house() -> Value {
    json!({"type": "Building", "geometry": [{"type": "Solid", "lod": "2", "boundaries": [cube()]}]})
}

fn sound(layers: &[Layer]) -> bool {
    (volume_m3(&layers[0].meshes, Some(0)) / 1200.0 - 1.0).abs() < 3e-4
}

#[test]
fn members_may_stand_in_any_order_behind_a_mark_and_between_blanks() {
    let head = city(json!({}));
    let feature = json!({"type": "CityJSONFeature", "id": "a", "CityObjects": {"a": house()}, "vertices": corners()});
    // The type of the head and of each feature stands last.
    let last = |value: &Value| {
        let mut members: Vec<_> = value.as_object().unwrap().iter().collect();
        members.sort_by_key(|(key, _)| *key == "type");
        let members: Vec<_> = members
            .iter()
            .map(|(key, value)| format!("{key:?}:{value}"))
            .collect();
        format!("{{{}}}", members.join(","))
    };
    let (head, feature) = (last(&head), last(&feature));
    for text in [
        format!("{head}\n{feature}"),
        format!("\u{feff}{head}\r\n\r\n{feature}\r\n\n"),
        format!("\u{1e}{head}\n\u{1e}{feature}\n"),
        format!("{head}\n{}\n", feature.replace(',', ",\n  ")),
        format!("{head}\n{feature}\n{{\"type\": \"CityJSONFeature\", \"vert"),
    ] {
        let (layers, warnings) = read_with_warnings(&text, &Options::default());
        assert!(sound(&layers), "{text}");
        let damaged = warnings.contains("1 damaged lines (line 3)");
        assert_eq!(damaged, text.ends_with("vert"), "{warnings}");
    }
    let said = |bytes: Vec<u8>| document::parse(&bytes, &mut Notes::default()).unwrap_err();
    assert!(
        said(feature.into_bytes())
            .mend
            .contains("CityJSON line first")
    );
}

#[test]
fn odd_records_are_left_out_and_the_rest_is_read() {
    let surface = |ring: Value| json!({"type": "Building", "geometry": [{"type": "MultiSurface", "lod": "1", "boundaries": [[ring], [[4, 5, 6]]]}]});
    for (name, odd, said) in [
        ("null", Value::Null, "damaged objects"),
        ("text", json!("house"), "damaged objects"),
        (
            "nothing",
            json!({"type": "Building"}),
            "objects without geometry",
        ),
        (
            "no geometry",
            json!({"type": "Building", "geometry": [null]}),
            "damaged geometries",
        ),
        (
            "empty",
            json!({"type": "Building", "geometry": [{"type": "MultiSurface", "lod": "1", "boundaries": []}]}),
            "geometries without surfaces",
        ),
        (
            "null lists",
            json!({"type": "Building", "geometry": [{"type": "Solid", "lod": null, "boundaries": null}]}),
            "geometries without surfaces",
        ),
        (
            "points",
            json!({"type": "Building", "geometry": [{"type": "MultiPoint", "lod": "1", "boundaries": [0]}]}),
            "MultiPoint",
        ),
        (
            "lines",
            json!({"type": "Building", "geometry": [{"type": "MultiLineString", "lod": "1", "boundaries": [[0, 1]]}]}),
            "MultiLineString",
        ),
        (
            "extension",
            json!({"type": "Building", "geometry": [{"type": "+Pipe", "lod": "1", "boundaries": [[0, 1]]}]}),
            "geometries of extensions",
        ),
        (
            "two corners",
            surface(json!([0, 1])),
            "fewer than three corners",
        ),
        ("a line", surface(json!([0, 1, 0, 1])), "without an area"),
        (
            "no vertex",
            surface(json!([0, 1, 77])),
            "a vertex that does not exist",
        ),
        (
            "minus",
            surface(json!([0, 1, -2])),
            "a vertex that does not exist",
        ),
        (
            "bad vertex",
            surface(json!([0, 1, 8])),
            "a vertex that is no point",
        ),
        (
            "stray vertex",
            surface(json!([0, 1, 9])),
            "a hundred kilometres",
        ),
        (
            "no template",
            json!({"type": "Building", "geometry": [{"type": "GeometryInstance", "template": 3, "boundaries": [0]}]}),
            "template that does not exist",
        ),
    ] {
        let mut text = city(json!({"a house": house(), name: odd}));
        let vertices = text["vertices"].as_array_mut().unwrap();
        vertices.extend([json!([1, null, 2]), json!([3e15, 0, 0])]);
        let (layers, warnings) = read_with_warnings(&text.to_string(), &Options::default());
        assert!(sound(&layers), "{name}");
        assert!(warnings.contains(said), "{name}: {warnings}");
        assert!(warnings.contains("left out: "), "{name}: {warnings}");
        // The stray vertex does not move the frame.
        let site = layers[0].site.origin();
        assert!(
            (site.latitude_rad.to_degrees() - 52.0).abs() < 0.1,
            "{name}: {site:?}"
        );
    }
}

#[test]
fn null_and_empty_members_are_taken_as_absent() {
    let mut text = city(json!({"a": house()}));
    for (member, value) in [
        ("semantics", Value::Null),
        ("semantics", json!({"surfaces": null, "values": null})),
        ("semantics", json!([])),
        ("material", Value::Null),
        ("material", json!({"rgb": null})),
        ("material", json!({"rgb": {"value": null}})),
        ("texture", json!([])),
        (
            "texture",
            json!({"day": {"values": [[null, [], [[null]]]]}}),
        ),
    ] {
        text["CityObjects"]["a"]["geometry"][0][member] = value;
        assert!(
            sound(&read_with_warnings(&text.to_string(), &Options::default()).0),
            "{text}"
        );
    }
    text["CityObjects"]["a"]["attributes"] = Value::Null;
    text["CityObjects"]["a"]["parents"] = Value::Null;
    text["CityObjects"]["a"]["children"] = Value::Null;
    for (member, value) in [
        ("appearance", json!({})),
        ("appearance", Value::Null),
        (
            "appearance",
            json!({"materials": null, "textures": [null], "vertices-texture": [[0]]}),
        ),
        ("geometry-templates", json!({})),
        ("extensions", Value::Null),
    ] {
        text[member] = value;
        assert!(
            sound(&read_with_warnings(&text.to_string(), &Options::default()).0),
            "{text}"
        );
    }
    text["metadata"] = Value::Null;
    let options = Options {
        crs: Some("EPSG:7415".into()),
        ..Options::default()
    };
    assert!(sound(&read_with_warnings(&text.to_string(), &options).0));
    text["version"] = json!(1.1);
    assert!(sound(&read_with_warnings(&text.to_string(), &options).0));
    text["version"] = Value::Null;
    let (layers, warnings) = read_with_warnings(&text.to_string(), &options);
    assert!(
        sound(&layers) && warnings.contains("version: it states none"),
        "{warnings}"
    );
}

#[test]
fn a_transform_is_applied_or_refused_by_name() {
    let said = |text: &Value| {
        read_text(&text.to_string(), &Options::default())
            .unwrap_err()
            .to_string()
    };
    let whole = city(json!({"a": house()}));
    for (scale, translate) in [
        (json!([0.001, 0.001, 0.0]), json!([0, 0, 0])),
        (json!([0.001, null, 0.001]), json!([0, 0, 0])),
        (json!([0.001, 0.001]), json!([0, 0, 0])),
        (json!(0.001), json!([0, 0, 0])),
        (json!([0.001, 0.001, 0.001]), json!([0, "x", 0])),
        (Value::Null, Value::Null),
    ] {
        let mut text = whole.clone();
        text["transform"] = json!({"scale": scale, "translate": translate});
        assert!(said(&text).contains("transform: its "), "{}", said(&text));
    }
    let mut text = whole.clone();
    text["transform"] = Value::Null;
    for version in ["1.1", "2.0", "2.0.1"] {
        text["version"] = json!(version);
        assert!(
            said(&text).contains("transform: it is missing"),
            "{}",
            said(&text)
        );
    }
    // Without one, vertices of 1.0 count as they stand.
    text["version"] = json!("1.0");
    let metres: Vec<Value> = corners()
        .as_array()
        .unwrap()
        .iter()
        .map(|v| {
            json!([
                v[0].as_f64().unwrap() / 1e3 + 84600.0,
                v[1].as_f64().unwrap() / 1e3 + 447400.0,
                v[2].as_f64().unwrap() / 1e3
            ])
        })
        .collect();
    text["vertices"] = json!(metres);
    assert!(sound(
        &read_with_warnings(&text.to_string(), &Options::default()).0
    ));
    // Without its shift a city lies at the map's own origin.
    let mut text = whole.clone();
    text["transform"]["translate"] = json!([0, 0, 0]);
    let options = Options {
        crs: Some("EPSG:25832".into()),
        ..Options::default()
    };
    let (_, warnings) = read_with_warnings(&text.to_string(), &options);
    assert!(
        warnings.contains("vertices: they lie 0.0 km from the map's own origin"),
        "{warnings}"
    );
    // An extent that the vertices leave is a warning, a larger one is none.
    let mut text = whole;
    text["metadata"]["geographicalExtent"] = json!([84000, 447000, 0, 85000, 448000, 50]);
    assert!(
        !read_with_warnings(&text.to_string(), &Options::default())
            .1
            .contains("Extent")
    );
    text["metadata"]["geographicalExtent"] = json!([194000, 447000, 0, 195000, 448000, 50]);
    assert!(
        read_with_warnings(&text.to_string(), &Options::default())
            .1
            .contains("geographicalExtent: it reaches")
    );
}

#[test]
fn systems_are_understood_in_many_forms() {
    let heights = "heights: ";
    for (system, compound) in [
        (json!("https://www.opengis.net/def/crs/EPSG/0/7415"), true),
        (json!("http://www.opengis.net/def/crs/EPSG/0/28992/"), false),
        (json!("urn:ogc:def:crs:EPSG::7415"), true),
        (
            json!("urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5709"),
            true,
        ),
        (
            json!(
                "https://www.opengis.net/def/crs-compound?1=https://www.opengis.net/def/crs/EPSG/0/28992&2=https://www.opengis.net/def/crs/EPSG/0/5709"
            ),
            true,
        ),
        (json!("EPSG:28992"), false),
        (json!(" epsg:28992+5709 "), true),
        (json!(7415), true),
        (json!({"epsg": 7415}), true),
    ] {
        let mut text = city(json!({"a": house()}));
        text["metadata"]["referenceSystem"] = system.clone();
        let (layers, warnings) = read_with_warnings(&text.to_string(), &Options::default());
        let site = layers[0].site.origin();
        assert!(
            (site.latitude_rad.to_degrees() - 52.01).abs() < 0.01,
            "{system}"
        );
        // The heights of a horizontal system are said to be assumed.
        assert_eq!(
            !warnings.contains(heights),
            compound,
            "{system}: {warnings}"
        );
    }
    let mut text = city(json!({"a": house()}));
    text["metadata"]["referenceSystem"] = json!([7415]);
    let said = read_text(&text.to_string(), &Options::default())
        .unwrap_err()
        .to_string();
    assert!(
        said.contains("referenceSystem") && said.contains("--crs"),
        "{said}"
    );
}

#[test]
fn levels_shells_and_pictures_that_are_not_shown_are_counted() {
    let mut text = city(json!({"a": house(), "b": house()}));
    text["CityObjects"]["a"]["geometry"][0]["boundaries"] =
        json!([cube(), [[[0, 1, 2]]], [[[0, 1, 3]]]]);
    let ring = json!([[0, 0, 1, 2, 3]]);
    let none = json!([[null]]);
    text["CityObjects"]["b"]["geometry"][0]["texture"] =
        json!({"day": {"values": [[none, none, ring, ring, none, none]]}});
    text["appearance"] = json!({"textures": [{"type": "PNG", "image": "gone.png"}], "vertices-texture": [[0, 0], [1, 0], [1, 1], [0, 1]]});
    let options = Options {
        lod: Some("1".into()),
        ..Options::default()
    };
    let (layers, warnings) = read_with_warnings(&text.to_string(), &options);
    assert!(sound(&layers));
    assert!(
        warnings.contains("2 inner shells of solids (first Building a)"),
        "{warnings}"
    );
    assert!(
        warnings.contains("1 textures whose picture is missing or damaged (gone.png)"),
        "{warnings}"
    );
    assert!(
        warnings.contains("lod: 2 objects have none of 1"),
        "{warnings}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// Whole-number vertices with another scale and shift are the same ground.
    #[test]
    fn another_transform_is_the_same_ground(digits in 0..5_i32, mirrored in any::<[bool; 3]>(), shift in prop::array::uniform3(-1000..1000_i32)) {
        let own = city(json!({"a": house()}));
        let mut other = own.clone();
        let scale: Vec<f64> = mirrored.iter().map(|m| 10_f64.powi(-digits) * if *m { -1.0 } else { 1.0 }).collect();
        let old = [84600.0, 447400.0, 1.0];
        let translate: Vec<f64> = (0..3).map(|k| old[k] + f64::from(shift[k])).collect();
        let vertices: Vec<Value> = corners().as_array().unwrap().iter().map(|v| {
            let place = |k: usize| ((v[k].as_f64().unwrap() * 0.001 - f64::from(shift[k])) / scale[k]).round() as i64;
            json!([place(0), place(1), place(2)])
        }).collect();
        other["transform"] = json!({"scale": scale, "translate": translate});
        other["vertices"] = json!(vertices);
        let places = |text: &Value| -> Vec<DVec3> {
            let layer = read_text(&text.to_string(), &Options::default()).unwrap().remove(0);
            let mesh = &layer.meshes[0];
            let all = 0..mesh.positions.len() as u32;
            all.map(|k| layer.site.enu_to_ecef(mesh.vertex_m(k))).collect()
        };
        for (a, b) in places(&own).iter().zip(places(&other)) {
            // Corners in f32 about a middle: some micrometres.
            prop_assert!(a.distance(b) < 1e-4, "{a} {b}");
        }
    }
}

#[test]
fn heights_of_a_map_in_feet_are_in_feet_unless_stated() {
    let foot_m = 1200.0 / 3937.0;
    let house = json!({"house": {"type": "Building", "geometry": [{"type": "Solid", "lod": "1", "boundaries": [cube()]}]}});
    let mut document = city(house);
    document["transform"]["translate"] = json!([987_000.0, 195_000.0, 100.0]);
    document["metadata"]["referenceSystem"] = json!("EPSG:2263");
    let document = document.to_string();
    let height = |text: &str| {
        let (layers, said) = read_with_warnings(
            text,
            &Options {
                geoid_height_m: Some(0.0),
                ..Options::default()
            },
        );
        let mesh = &layers[0].meshes[0];
        let up = (0..mesh.positions.len() as u32).map(|k| mesh.vertex_m(k).z);
        let [low, high] = up.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], z| {
            [a.min(z), b.max(z)]
        });
        (high - low, said)
    };
    let (found, said) = height(&document);
    assert!((found - 6.0 * foot_m).abs() < 0.01, "{found}");
    assert!(said.contains("in the map's unit of 0.3048006"), "{said}");
    let (found, said) = height(&document.replace("EPSG:2263", "EPSG:2263+5703"));
    assert!(
        (found - 6.0).abs() < 0.01 && !said.contains("map's unit"),
        "{found} {said}"
    );
}
