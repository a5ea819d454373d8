//! Files as people have them: the odd rows of `../shared/data/odd`, and others of their kind.

use super::extract::{House, Packed, Places, Variant, extract};
use super::*;

fn odd(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("../shared/data/odd")
        .join(name);
    if !path.exists() {
        println!("skipped: {} is absent", path.display());
    }
    path.exists().then_some(path)
}

fn read_bytes_as(name: &str, bytes: &[u8], options: &Options) -> Result<Layer, SourceError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    read(&path, options)
}

fn tops(layer: &Layer) -> Vec<f64> {
    let top = |known: &serde_json::Map<String, Value>| known["top_m"].as_f64().unwrap();
    layer.features.iter().map(top).collect()
}

/// What a layer's warnings say, in one text.
fn said(layer: &Layer) -> String {
    let lines: Vec<_> = layer.warnings.iter().map(ToString::to_string).collect();
    lines.join("\n")
}

/// The volume of all buildings [m³].
fn volume(layer: &Layer) -> f64 {
    volume_m3(&layer.meshes, None)
}

/// A square of about 20 m by 10 m at a longitude and latitude [1e-9 deg].
fn square(lon: i64, lat: i64) -> Vec<[i64; 2]> {
    let (w, h) = (265_000, 90_000);
    vec![
        [lon, lat],
        [lon + w, lat],
        [lon + w, lat + h],
        [lon, lat + h],
    ]
}

const LON: i64 = 8_541_700_000;
const LAT: i64 = 47_376_900_000;

#[test]
fn heights_in_the_notations_of_openstreetmap() {
    let Some(path) = odd("osm-heights.osm.pbf") else {
        return;
    };
    let layer = read(&path, &Options::default()).unwrap();
    let want = [40.005, 1.778, 12.0, 12.0, 12.192, 12.192, 12.0, 13.5, 12.0];
    let tops = tops(&layer);
    assert_eq!(tops.len(), want.len());
    for (found, want) in tops.iter().zip(want) {
        assert!((found - want).abs() < 1e-9, "{tops:?}");
    }
    let said = said(&layer);
    for part in ["height=~12", "height=12-15", "height=10;12"] {
        assert!(said.contains(part), "{said}");
    }
}

#[test]
fn what_is_under_the_ground_is_left_out_and_counted() {
    let Some(path) = odd("osm-underground.osm.pbf") else {
        return;
    };
    let layer = read(&path, &Options::default()).unwrap();
    assert_eq!(tops(&layer), [10.0]);
    let said = said(&layer);
    assert!(
        said.contains("3 buildings under the ground (first way "),
        "{said}"
    );
}

#[test]
fn places_on_ways_need_no_nodes() {
    let Some(path) = odd("osm-locations-on-ways.osm.pbf") else {
        return;
    };
    let layer = read(&path, &Options::default()).unwrap();
    assert_eq!(tops(&layer), [10.0, 20.0]);
}

#[test]
fn blobs_in_lz4_are_read() {
    let Some(path) = odd("osm-lz4.osm.pbf") else {
        return;
    };
    let layer = read(&path, &Options::default()).unwrap();
    assert_eq!(tops(&layer), [10.0]);
}

#[test]
fn a_byte_order_mark_is_no_part_of_geojson() {
    let Some(path) = odd("bom.geojson") else {
        return;
    };
    let layer = read(&path, &Options::default()).unwrap();
    assert_eq!(tops(&layer), [12.0, 20.0]);
    // Nothing says what the ground's height is counted from; with that said there is no warning.
    assert!(layer.warnings.len() == 1, "{}", said(&layer));
    let options = Options {
        crs: Some("WGS84+geoid".into()),
        ..Options::default()
    };
    let layer = read(&path, &options).unwrap();
    assert!(layer.warnings.is_empty(), "{}", said(&layer));
    assert!((layer.site.origin().height_m - 47.5).abs() < 3.0);
}

/// Two houses in every variant of an extract are the same two houses.
#[test]
fn every_variant_of_an_extract_is_the_same_ground() {
    let houses: Vec<House> = vec![
        (square(LON, LAT), &[("building", "yes"), ("height", "12")]),
        (
            square(LON + 500_000, LAT),
            &[("building", "house"), ("height", "20 m")],
        ),
    ];
    let read = |variant: &Variant| {
        let read = read_bytes_as("a.osm.pbf", &extract(&houses, variant), &Options::default());
        read.map_err(|error| error.to_string())
    };
    let plain = read(&Variant::default()).unwrap();
    assert_eq!(tops(&plain), [12.0, 20.0]);
    let area_m2 = 265e-6_f64.to_radians()
        * 90e-6_f64.to_radians()
        * 6_378_137.0_f64.powi(2)
        * 47.3769_f64.to_radians().cos();
    assert!((volume(&plain) / (area_m2 * 32.0) - 1.0).abs() < 5e-3);
    for packed in [Packed::Raw, Packed::Zlib, Packed::Lz4, Packed::Zstd] {
        for places in [Places::Nodes, Places::Dense, Places::Ways] {
            let layer = read(&Variant {
                packed,
                places,
                first_id: -7,
                ..Variant::default()
            });
            let layer = layer.unwrap_or_else(|error| panic!("{packed:?} {places:?}: {error}"));
            assert_eq!(tops(&layer), tops(&plain));
            assert_eq!(volume(&layer), volume(&plain), "{packed:?} {places:?}");
        }
    }
    let packed = Packed::Lzma;
    let error = read(&Variant {
        packed,
        ..Variant::default()
    })
    .unwrap_err();
    assert!(
        error.contains("LZMA") && error.contains("osmium"),
        "{error}"
    );
    for (name, mend) in [("HistoricalInformation", "time-filter"), ("Ropes", "Ropes")] {
        let required = vec!["OsmSchema-V0.6".into(), name.into()];
        let error = read(&Variant {
            required,
            ..Variant::default()
        })
        .unwrap_err();
        assert!(error.contains(name) && error.contains(mend), "{error}");
    }
}

#[test]
fn what_an_extract_has_no_outline_of_is_counted() {
    let houses: Vec<House> = vec![
        (square(LON, LAT), &[("building", "yes"), ("height", "12")]),
        (
            vec![[LON, LAT], [LON + 1000, LAT]],
            &[("building", "yes"), ("height", "5")],
        ),
        (
            square(LON, LAT + 400_000),
            &[
                ("building", "yes"),
                ("roof:shape", "gabled"),
                ("building:colour", "Red"),
            ],
        ),
        (
            square(LON, LAT + 800_000),
            &[
                ("building", "yes"),
                ("building:colour", "plaid"),
                ("height", "3"),
            ],
        ),
    ];
    let layer = read_bytes_as(
        "a.osm.pbf",
        &extract(&houses, &Variant::default()),
        &Options::default(),
    )
    .unwrap();
    assert_eq!(tops(&layer), [12.0, 8.0, 3.0]);
    let said = said(&layer);
    for part in [
        "1 outlines without an area",
        "1 roof shapes, made flat",
        "1 colours that are not understood",
        "1 buildings state none, each is 8 m high",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let red = layer.meshes[0]
        .colors
        .iter()
        .filter(|c| **c == [1.0, 0.0, 0.0, 1.0]);
    assert!(red.count() > 0);
}

/// A feature with a house of a height at a longitude.
fn house(lon: f64, known: Value) -> Value {
    let (w, h) = (0.000_265, 0.000_09);
    let ring = json!([
        [lon, 47.3],
        [lon + w, 47.3],
        [lon + w, 47.3 + h],
        [lon, 47.3 + h],
        [lon, 47.3]
    ]);
    json!({"type": "Feature", "properties": known, "geometry": {"type": "Polygon", "coordinates": [ring]}})
}

#[test]
fn rows_of_geojson_are_read_under_every_ending() {
    let [a, b] = [
        house(8.5, json!({"height": 12})),
        house(8.501, json!({"height": 20})),
    ]
    .map(|f| f.to_string());
    for (text, what) in [
        (
            format!("{a}\n{b}\n\n  \n"),
            "a feature a line, empty last rows",
        ),
        (format!("\u{feff}{a}\r\n{b}\r\n"), "a mark and CR LF"),
        (format!("\u{1e}{a}\n\u{1e}{b}\n"), "RFC 8142"),
        (format!("{a}{b}"), "one behind the other"),
        (
            format!(
                "{{\"features\": [{a},\n{b}], \"name\": \"x\", \"type\": \"FeatureCollection\"}}"
            ),
            "type last",
        ),
    ] {
        for ending in [
            "geojsonl",
            "geojson",
            "ndjson",
            "geojsons",
            "geojsonseq",
            "json",
            "jsonl",
        ] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join(format!("a.{ending}"));
            std::fs::write(&path, &text).unwrap();
            let layers = crate::build::sources::read(&path, &Options::default());
            let layers = layers.unwrap_or_else(|error| panic!("{what}, {ending}: {error}"));
            assert_eq!(tops(&layers[0]), [12.0, 20.0], "{what}, {ending}");
        }
    }
}

#[test]
fn one_bad_feature_does_not_cost_the_file() {
    let features = json!([
        {"type": "Feature", "properties": null, "geometry": null},
        {"type": "Feature", "properties": {"height": "NAN"}, "geometry": {"type": "Polygon", "coordinates": "none"}},
        {"type": "Feature", "properties": {}, "geometry": {"type": "Point", "coordinates": [8.5, 47.3]}},
        {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": []}},
        {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [[[8.5, 147.3], [8.6, 147.3], [8.5, 147.4], [8.5, 147.3]]]}},
        null,
        {"type": "Feature", "id": "h1", "properties": null, "geometry": house(8.5, json!({}))["geometry"], "stars": 3},
        {"type": "Feature", "id": 7, "properties": {"height": "9"}, "geometry": {"type": "GeometryCollection", "geometries": [
            {"type": "Point", "coordinates": [8.5, 47.3, 401.5]}, house(8.502, json!({}))["geometry"]]}},
    ]);
    let text =
        json!({"type": "FeatureCollection", "features": features, "bbox": null, "crs": null})
            .to_string();
    // As Python writes a number that is none.
    let text = text.replace("\"NAN\"", "NaN");
    let layer = read_text(&text, &Options::default()).unwrap();
    assert_eq!(tops(&layer), [8.0, 9.0]);
    assert_eq!(
        (&layer.features[0]["id"], &layer.features[1]["id"]),
        (&json!("h1"), &json!("7"))
    );
    let said = said(&layer);
    for part in [
        "1 features without a geometry (feature 1)",
        "1 features whose geometry is damaged (feature 2",
        "2 features without a polygon (first feature 3, Point)",
        "1 outlines that lie nowhere on the Earth (feature 5)",
        "1 features that are no objects",
        "crs: null",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    // A row that is cut off among whole ones.
    let good = house(8.5, json!({"height": 5})).to_string();
    let layer = read_text(
        &format!("{good}\n{{\"type\": \n{good}\n"),
        &Options::default(),
    )
    .unwrap();
    assert_eq!(tops(&layer), [5.0, 5.0]);
    assert!(self::said(&layer).contains("1 rows that are no GeoJSON (line 2)"));
}

#[test]
fn old_crs_members_count_in_all_their_forms() {
    let with = |crs: Value| {
        let text = collection(&[(json!([ring(E, N, 20.0, 10.0)]), json!({"height": 10}))]);
        let mut all: Value = serde_json::from_str(&text).unwrap();
        all["crs"] = crs;
        read_text(&all.to_string(), &Options::default())
    };
    let site = |crs: Value| {
        let layer = with(crs.clone()).unwrap_or_else(|error| panic!("{crs}: {error}"));
        layer.site.origin()
    };
    let want = site(json!({"type": "name", "properties": {"name": "EPSG:2056"}}));
    for crs in [
        json!({"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::2056"}}),
        json!({"properties": {"name": "http://www.opengis.net/def/crs/EPSG/0/2056"}, "type": "name"}),
        json!({"type": "EPSG", "properties": {"code": 2056}}),
        json!({"type": "EPSG", "properties": {"code": "2056"}}),
        json!({"type": "link", "properties": {"href": "http://spatialreference.org/ref/epsg/2056/proj4/", "type": "proj4"}}),
        json!("EPSG:2056"),
    ] {
        assert_eq!(site(crs.clone()), want, "{crs}");
    }
    let error = with(json!({"type": "link", "properties": {"href": "city.prj"}}))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("city.prj") && error.contains("--crs"),
        "{error}"
    );
}

#[test]
fn other_formats_in_json_are_refused_by_name() {
    for (text, name) in [
        (r#"{"type": "Topology", "objects": {}}"#, "TopoJSON"),
        (
            r#"{"geometryType": "esriGeometryPolygon", "features": []}"#,
            "Esri",
        ),
        (
            r#"{"version": 0.6, "osm3s": {}, "elements": []}"#,
            "Overpass",
        ),
        (r#"{"type": "CityJSON", "version": "2.0"}"#, "CityJSON"),
        ("[1, 2]", "no object"),
        (r#"{"a": 1}"#, "type"),
    ] {
        let error = read_text(text, &Options::default())
            .unwrap_err()
            .to_string();
        assert!(error.contains(name), "{error}");
    }
}

/// A street across the meridian of 180°, written in three ways, is one neighbourhood of some 60 m.
#[test]
fn houses_on_both_sides_of_the_date_line_are_neighbours() {
    let w = 0.000_265;
    let east = |lon: f64| house(lon, json!({"height": 10}));
    let split = json!({"type": "Feature", "properties": {"height": 10}, "geometry": {"type": "MultiPolygon", "coordinates": [
        house(180.0 - w, json!({}))["geometry"]["coordinates"], house(-180.0, json!({}))["geometry"]["coordinates"]]}});
    let whole = |lon: f64| {
        let mut feature = house(lon, json!({"height": 10}));
        for k in [1, 2] {
            feature["geometry"]["coordinates"][0][k][0] =
                json!(lon + 2.0 * w - if lon > 0.0 { 360.0 } else { 0.0 });
        }
        feature
    };
    let read = |features: Vec<Value>| {
        let text = json!({"type": "FeatureCollection", "features": features}).to_string();
        read_text(&text, &Options::default()).unwrap()
    };
    let written = [
        read(vec![split, east(179.999), east(-179.9995)]),
        read(vec![whole(180.0 - w), east(179.999), east(180.0005)]),
        read(vec![whole(-180.0 - w), east(-180.001), east(-179.9995)]),
    ];
    for layer in &written {
        let far = layer
            .meshes
            .iter()
            .flat_map(|mesh| (0..mesh.positions.len()).map(|i| mesh.vertex_m(i as u32)));
        let far = far.map(|r| r.length()).fold(0.0, f64::max);
        assert!(far < 200.0, "{far}");
        let longitude = layer.site.origin().longitude_rad.to_degrees();
        assert!((179.9..=180.0).contains(&longitude.abs()), "{longitude}");
        assert!((volume(layer) / volume(&written[0]) - 1.0).abs() < 1e-4);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Other units and offsets of the coordinates, with values to match, and another notation of the height, are the same ground.
    #[test]
    fn an_extract_in_other_units_is_the_same_ground(
        unit in prop::sample::select(vec![1, 10, 100, 1000]),
        offset in prop::array::uniform2(-50_000_i64..50_000),
        feet in 5..200_u32,
        place in 0..3_usize,
    ) {
        let offset = offset.map(|units| units * 1000);
        let height_m = format!("{}", f64::from(feet) * 0.3048);
        let notations = [format!("{feet}'"), format!("{feet} ft"), format!("{}\"", 12 * feet)];
        let one = |height: &str, variant: &Variant| {
            let tags = [("building", "yes"), ("height", height)];
            let bytes = extract(&[(square(LON, LAT), &tags)], variant);
            read_bytes_as("a.osm.pbf", &bytes, &Options::default()).unwrap()
        };
        let plain = one(&height_m, &Variant::default());
        let other = one(&notations[place], &Variant {
            granularity: unit,
            offset,
            places: [Places::Nodes, Places::Dense, Places::Ways][place],
            ..Variant::default()
        });
        prop_assert!((tops(&other)[0] - tops(&plain)[0]).abs() < 1e-9);
        prop_assert!((volume(&other) / volume(&plain) - 1.0).abs() < 1e-6);
        let apart = other.site.origin().to_ecef().distance(plain.site.origin().to_ecef());
        prop_assert!(apart < 1e-6, "{apart}");
    }
}

#[test]
fn heights_of_corners_are_named() {
    let mut feature = house(8.5, json!({"height": 10}));
    for corner in feature["geometry"]["coordinates"][0]
        .as_array_mut()
        .unwrap()
    {
        corner.as_array_mut().unwrap().push(json!(401.5));
    }
    let layer = read_text(&feature.to_string(), &Options::default()).unwrap();
    assert_eq!(tops(&layer), [10.0]);
    assert!(said(&layer).contains("heights of corners are not read (first feature 1)"));
}

#[test]
fn json_is_known_by_its_type_wherever_that_stands() {
    use crate::build::sources;
    for (name, count) in [("type-last.json", 40), ("one-feature.json", 1)] {
        let Some(path) = odd(name) else { return };
        let layers = sources::read(&path, &Options::default()).unwrap();
        assert_eq!(layers[0].features.len(), count, "{name}");
    }
    // Other formats are refused by their own names, CityJSON goes to its reader.
    for (text, name) in [
        (r#"{"a": [1], "type": "Topology"}"#, "TopoJSON"),
        (
            r#"{"features": [], "geometryType": "esriGeometryPolygon"}"#,
            "Esri",
        ),
        (r#"{"version": "9.9", "type": "CityJSON"}"#, "cjio"),
        (r#"{"type": "FeatureCollection", "features": ["#, "GeoJSON"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        std::fs::write(&path, text).unwrap();
        let error = sources::read(&path, &Options::default())
            .unwrap_err()
            .to_string();
        assert!(error.contains(name), "{error}");
    }
}

#[test]
fn outlines_that_cross_or_touch_are_closed_solids() {
    let at =
        |ring: &[[f64; 2]]| -> Value { ring.iter().map(|[x, y]| json!([E + x, N + y])).collect() };
    let square = |x: f64, y: f64, w: f64| ring(E + x, N + y, w, w);
    let bow = at(&[
        [0.0, 0.0],
        [10.0, 10.0],
        [10.0, 0.0],
        [0.0, 10.0],
        [0.0, 0.0],
    ]);
    let touching = at(&[[0.0, 0.0], [3.0, 1.0], [1.0, 3.0], [0.0, 0.0]]);
    let outer = || square(0.0, 0.0, 10.0);
    for (name, rings, m2, told) in [
        ("bow tie", json!([bow]), 50.0, true),
        (
            "hole outside",
            json!([outer(), square(30.0, 0.0, 4.0)]),
            100.0,
            true,
        ),
        (
            "hole across the edge",
            json!([outer(), square(8.0, 2.0, 4.0)]),
            92.0,
            true,
        ),
        (
            "hole at the edge",
            json!([outer(), square(0.0, 2.0, 4.0)]),
            84.0,
            false,
        ),
        ("hole at a corner", json!([outer(), touching]), 96.0, false),
        (
            "hole in a hole",
            json!([outer(), square(1.0, 1.0, 8.0), square(3.0, 3.0, 2.0)]),
            36.0,
            true,
        ),
        (
            "holes that overlap",
            json!([outer(), square(1.0, 1.0, 4.0), square(3.0, 3.0, 4.0)]),
            72.0,
            true,
        ),
    ] {
        let layer = read_text(
            &collection(&[(rings, json!({"height": 10}))]),
            &Options::default(),
        )
        .unwrap();
        // The Swiss map is true to a few parts in 10,000.
        assert!(
            (volume(&layer) / (10.0 * m2) - 1.0).abs() < 1e-3,
            "{name}: {} m³",
            volume(&layer)
        );
        let mut roof_m2 = 0.0;
        for mesh in &layer.meshes {
            for corners in mesh.indices.as_chunks::<3>().0 {
                let [a, b, c] = corners.map(|k| mesh.vertex_m(k));
                roof_m2 += (b - a).cross(c - a).z.max(0.0) / 2.0;
            }
        }
        assert!(
            (roof_m2 / m2 - 1.0).abs() < 1e-3,
            "{name}: a roof of {roof_m2} m²"
        );
        assert_eq!(
            said(&layer).contains("cross or touch"),
            told,
            "{name}: {}",
            said(&layer)
        );
    }
    let none = collection(&[(json!([outer(), outer()]), json!({"height": 10}))]);
    let error = read_text(&none, &Options::default())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("1 outlines without an area (feature 1)"),
        "{error}"
    );
}

#[test]
fn a_stray_outline_does_not_cost_the_town() {
    let house = |x: f64| (json!([ring(E + x, N, 10.0, 10.0)]), json!({"height": 10}));
    let island = (
        json!([ring(600_000.0 - 3e6, 200_000.0 - 2e6, 10.0, 10.0)]),
        json!({"height": 10}),
    );
    let layer = read_text(
        &collection(&[island, house(0.0), house(30.0)]),
        &Options::default(),
    )
    .unwrap();
    assert_eq!(layer.features.len(), 2);
    let told = said(&layer);
    assert!(
        told.contains("a hundred kilometres from the rest")
            || told.contains("nowhere on the Earth"),
        "{told}"
    );
    let degrees = |lon: f64, lat: f64| {
        let d = 1e-4;
        json!({"type": "Feature", "properties": {"height": 10}, "geometry": {"type": "Polygon", "coordinates":
            [[[lon, lat], [lon + d, lat], [lon + d, lat + d], [lon, lat + d], [lon, lat]]]}})
    };
    let town = json!({"type": "FeatureCollection", "features": [degrees(0.0, 0.0), degrees(8.54, 47.37), degrees(8.541, 47.37)]});
    let layer = read_text(&town.to_string(), &Options::default()).unwrap();
    assert_eq!(layer.features.len(), 2);
    assert!(
        said(&layer).contains("1 outlines a hundred kilometres from the rest (feature 1)"),
        "{}",
        said(&layer)
    );
    // Of two outlines the one that stands somewhere counts.
    let two = json!({"type": "FeatureCollection", "features": [degrees(0.0, 0.0), degrees(-8.54, -47.37)]});
    let layer = read_text(&two.to_string(), &Options::default()).unwrap();
    assert!(layer.features.len() == 1 && layer.site.origin().latitude_rad < -0.8);
}

#[test]
fn parts_stand_for_an_outline_that_they_cover() {
    let outline = (
        json!([ring(E, N, 100.0, 100.0)]),
        json!({"building": "yes", "height": 10}),
    );
    let part = |w: f64| {
        (
            json!([ring(E, N, w, 100.0)]),
            json!({"building:part": "yes", "height": 20}),
        )
    };
    let read = |w: f64| {
        read_text(
            &collection(&[outline.clone(), part(w)]),
            &Options::default(),
        )
        .unwrap()
    };
    assert_eq!(read(90.0).features.len(), 1);
    let both = read(5.0);
    assert_eq!(both.features.len(), 2);
    assert!(
        said(&both).contains("1 stand beside their parts"),
        "{}",
        said(&both)
    );
}
