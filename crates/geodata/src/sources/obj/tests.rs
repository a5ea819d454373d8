use super::*;
use boresight_models::shape::textured::UpAxis;
use proptest::prelude::*;

fn odd(name: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("../shared/data/odd")
        .join(name);
    if !path.exists() {
        println!("skipped: {} is absent", path.display());
    }
    path.exists().then_some(path)
}

/// East, north and up of a site.
fn local() -> Options {
    let origin = boresight_models::maths::geodesy::Geodetic {
        latitude_rad: 0.8,
        longitude_rad: 0.15,
        height_m: 500.0,
    };
    Options {
        site: Some(boresight_models::maths::geodesy::SiteFrame::new(origin)),
        mesh_unit: Some("m".into()),
        mesh_up: Some(UpAxis::Z),
        ..Options::default()
    }
}

fn in_crs() -> Options {
    Options {
        crs: Some("EPSG:25832".into()),
        ..Options::default()
    }
}

fn read_text(text: &str, options: &Options) -> Result<Layer, SourceError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    std::fs::write(&path, text).unwrap();
    read(&path, options)
}

fn said(layer: &Layer) -> String {
    let lines: Vec<_> = layer.warnings.iter().map(ToString::to_string).collect();
    lines.join("\n")
}

fn triangles(layer: &Layer) -> usize {
    layer.meshes.iter().map(TexturedMesh::triangle_count).sum()
}

/// Each triangle's corners, and the lowest and highest corner of all [m].
fn corners(layer: &Layer) -> (Vec<DVec3>, [DVec3; 2]) {
    let of = |mesh: &TexturedMesh| {
        mesh.indices
            .iter()
            .map(|&i| mesh.vertex_m(i))
            .collect::<Vec<_>>()
    };
    let all: Vec<DVec3> = layer.meshes.iter().flat_map(of).collect();
    let low = all.iter().fold(DVec3::INFINITY, |a, b| a.min(*b));
    let high = all.iter().fold(DVec3::NEG_INFINITY, |a, b| a.max(*b));
    (all, [low, high])
}

/// The area of all triangles [m²].
fn area_m2(layer: &Layer) -> f64 {
    let (all, _) = corners(layer);
    all.as_chunks::<3>()
        .0
        .iter()
        .map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0)
        .sum()
}

#[test]
fn indices_count_back_and_lines_go_on() {
    let Some(path) = odd("obj-negative-indices.obj") else {
        return;
    };
    let layer = read(&path, &local()).unwrap();
    assert_eq!(triangles(&layer), 3);
    assert!((area_m2(&layer) - 150.0).abs() < 1e-6);
    assert!(layer.warnings.is_empty(), "{}", said(&layer));
}

#[test]
fn a_square_far_from_the_origin_is_a_square() {
    let Some(path) = odd("obj-far.obj") else {
        return;
    };
    let layer = read(&path, &in_crs()).unwrap();
    let (all, [low, high]) = corners(&layer);
    assert_eq!(all.len(), 6);
    let size = high - low;
    // The map's grid is turned by up to 0.02 against the north, its scale is within 5e-4.
    assert!((area_m2(&layer) - 1.0).abs() < 1e-3, "{}", area_m2(&layer));
    let sides = all
        .as_chunks::<3>()
        .0
        .iter()
        .flat_map(|[a, b, c]| [a.distance(*b), b.distance(*c), c.distance(*a)]);
    for side in sides {
        assert!(
            (side - 1.0).abs() < 1e-3 || (side - 2.0_f64.sqrt()).abs() < 1e-3,
            "{side}"
        );
    }
    assert!(size.z < 1e-3 && low.length() < 2.0, "{low} {size}");
}

#[test]
fn a_dummy_face_at_the_origin_and_short_lines_cost_no_digits() {
    let text = "\u{feff}v 0 0 0\r\nv 0 0 0\r\nv 0 0 0\r\nf 1 2 3\r\nv 4691000.125 5334000.125 520 1.0\r\n\
                v 4691001.125 5334000.125 520 1.0\r\nv 4691001.125 5334001.125 520 1.0\r\nv 4691000.125 \\\r\n 5334001.125 520\r\n\
                f -4 -3 \\\r\n -2 \\\r\n -1\r\n\
                f 4 5 6 # once more, not last in the middle\r\n";
    let layer = read_text(text, &local()).unwrap();
    let (all, _) = corners(&layer);
    let square = &all[3..];
    let far: Vec<_> = square
        .iter()
        .map(|r| *r - DVec3::new(4_691_000.125, 5_334_000.125, 520.0))
        .collect();
    for r in far {
        assert!(
            r.to_array().iter().all(|x| (x - x.round()).abs() < 1e-6),
            "{r}"
        );
    }
}

#[test]
fn vertices_may_stand_behind_the_faces_that_name_them() {
    let layer = read_text(
        "f 1 2 3\nv 0 0 0\nv 10 0 0\nv 0 10 0\nf 3/9 2//7 1\n",
        &local(),
    )
    .unwrap();
    assert!(
        layer.warnings.is_empty() && triangles(&layer) == 2,
        "{}",
        said(&layer)
    );
}

#[test]
fn lines_may_end_with_cr_and_words_be_large() {
    let text = "V 0 0 0\rV 10 0 0\rV 0 10 0\rUSEMTL x\rF 1 2 3\r";
    assert_eq!(triangles(&read_text(text, &local()).unwrap()), 1);
}

#[test]
fn odd_statements_are_left_out_and_counted() {
    let text = "mtllib nowhere.mtl\nusemtl rough stone\nv 0 0 0\nv 10 0 0\nv 10 10 0 0.5\nv a b c\nv 0 10 0\n\
                vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 1 2 9\nf 1 2 4\nf 1 2\nf 1/7 2/7 5/7\nl 1 2\np 1\nsurf 0 1 0 1 1 2 3\n\
                cstype bspline\ncall other.obj\nwobble 3\nf 1 2 3 5\nf 1 1 1 1\n\ng\n";
    let layer = read_text(text, &local()).unwrap();
    assert_eq!(triangles(&layer), 4);
    let said = said(&layer);
    for part in [
        "1 material libraries (nowhere.mtl",
        "1 materials that no library has, of plain colour (rough stone)",
        "1 vertices that are no numbers (line 6)",
        "2 faces with a vertex that is not there or no number (first line 11)",
        "1 faces of fewer than three corners",
        "2 lines and points",
        "1 free-form curves and surfaces",
        "1 calls of other files",
        "1 statements that are not known (line 20, \"wobble\")",
        "1 weights of vertices",
        "1 faces without an area",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
    let none = read_text("v 1,5 2,5 3,5\nv 1 2 3\nf 1 2 3\n", &local())
        .unwrap_err()
        .to_string();
    assert!(none.contains("no faces"), "{none}");
}

#[test]
fn colours_hollow_polygons_and_textures_with_spaces() {
    let folder = tempfile::tempdir().unwrap();
    let picture = image::RgbImage::from_pixel(2, 2, image::Rgb([9, 9, 9]));
    picture.save(folder.path().join("old wall.png")).unwrap();
    let library = "newmtl wall\nmap_Kd -s 2 2 1 C:\\work\\old wall.png\nnewmtl lost\nKd 1 0 0\nmap_Kd lost.png\n";
    std::fs::write(folder.path().join("my house.mtl"), library).unwrap();
    let path = folder.path().join("my house.obj");
    // An arrow head, hollow at its second corner.
    let text = "mtllib my house.mtl\nv 0 0 0 255 0 0\nv 2 1 0 255 0 0\nv 0 2 0 255 0 0\nv 4 1 0 255 0 0\nvt 0 0\nvt 1 0\nvt 0.5 0.5\n\
                f 1 4 3 2\nusemtl wall\nf 1/1 4/2 3/3\nusemtl lost\nf 1/1 4/2 3/3\n";
    std::fs::write(&path, text).unwrap();
    let layer = read(&path, &local()).unwrap();
    let said = said(&layer);
    assert!(
        said.contains("colours of vertices up to 255") && said.contains("lost.png"),
        "{said}"
    );
    let area = |mesh: &TexturedMesh| -> f64 {
        let at = |i: u32| mesh.vertex_m(i);
        let each = mesh
            .indices
            .as_chunks::<3>()
            .0
            .iter()
            .map(|[a, b, c]| (at(*b) - at(*a)).cross(at(*c) - at(*a)).z / 2.0);
        each.sum()
    };
    let [wall, lost, plain] = [0, 1, 2].map(|k| &layer.meshes[k]);
    assert!((area(plain) - 2.0).abs() < 1e-6, "{}", area(plain));
    assert_eq!(plain.colors[0], [1.0, 0.0, 0.0, 1.0]);
    assert!(wall.look.texture.is_some() && lost.look.texture.is_none());
    assert_eq!(lost.look.base_color, [1.0, 0.0, 0.0, 1.0]);
    assert_eq!((wall.uv[1], wall.uv[2]), ([2.0, 1.0], [1.0, 0.0]));
}

#[test]
fn what_is_not_stated_of_unit_and_axes_is_said() {
    let text = "v 0 0 0\nv 10 0 0\nv 0 10 0\nf 1 2 3\n";
    let site_alone = Options {
        mesh_unit: None,
        mesh_up: None,
        ..local()
    };
    let told = said(&read_text(text, &site_alone).unwrap());
    assert!(
        told.contains("--mesh-unit") && told.contains("--mesh-up"),
        "{told}"
    );
    assert!(read_text(text, &local()).unwrap().warnings.is_empty());
    let word = |unit: &str, options: Options| {
        let options = Options {
            mesh_unit: Some(unit.into()),
            ..options
        };
        read_text(text, &options).unwrap_err().to_string()
    };
    assert!(word("cubit", local()).contains("'cubit' is no unit of length"));
    assert!(word("mm", in_crs()).contains("already those of a system"));
}

proptest! {
    /// Another unit and another axis up, with coordinates to match, are the same ground.
    #[test]
    fn another_unit_or_axis_is_the_same_ground(
        points in prop::collection::vec(prop::array::uniform3(-500.0..500.0_f64), 3..12),
        unit in prop::sample::select(vec![("mm", 1e-3), ("ft", 0.3048), ("us-ft", 1200.0 / 3937.0), ("in", 0.0254)]),
        up in prop::sample::select(vec![UpAxis::Y, UpAxis::Z]),
    ) {
        let write = |turned: bool, unit_m: f64| -> String {
            let vertex = |p: &[f64; 3]| {
                let [x, y, z] = p.map(|v| v / unit_m);
                let [x, y, z] = if turned { [x, z, -y] } else { [x, y, z] };
                format!("v {x} {y} {z}\n")
            };
            let faces = (0..points.len() - 2).map(|k| format!("f {} {} {}\n", k + 1, k + 2, k + 3));
            points.iter().map(vertex).chain(faces).collect()
        };
        let stated = Options { mesh_unit: Some(unit.0.into()), mesh_up: Some(up), ..local() };
        let one = corners(&read_text(&write(false, 1.0), &local()).unwrap()).0;
        let other = corners(&read_text(&write(up == UpAxis::Y, unit.1), &stated).unwrap()).0;
        prop_assert_eq!(one.len(), other.len());
        for (one, other) in one.iter().zip(&other) {
            prop_assert!(one.distance(*other) < 1e-3, "{one} {other}");
        }
    }

    /// An offset of the file's coordinates, taken off by the map, is the same ground, however far.
    #[test]
    fn an_offset_is_the_same_ground(
        points in prop::collection::vec(prop::array::uniform3(-500.0..500.0_f64), 3..12),
        offset in prop::array::uniform3(-9_000_000_i32..9_000_000),
        back in any::<bool>(),
    ) {
        let offset = offset.map(f64::from);
        let write = |offset: [f64; 3]| {
            let vertex = |p: &[f64; 3]| format!("v {} {} {}\n", p[0] + offset[0], p[1] + offset[1], p[2] + offset[2]);
            let vertices: String = points.iter().map(vertex).collect();
            let n = points.len();
            let faces: String = (0..n - 2).map(|k| match back {
                true => format!("f {} {} \\\n {}\n", k as i64 - n as i64, k as i64 + 1 - n as i64, k as i64 + 2 - n as i64),
                false => format!("f {} {} {}\n", k + 1, k + 2, k + 3),
            }).collect();
            format!("v 0 0 0\n{vertices}{}", if back { faces } else {
                (0..n - 2).map(|k| format!("f {} {} {}\n", k + 2, k + 3, k + 4)).collect()
            })
        };
        let near = corners(&read_text(&write([0.0; 3]), &local()).unwrap()).0;
        let far = corners(&read_text(&write(offset), &local()).unwrap()).0;
        prop_assert_eq!(near.len(), far.len());
        for (near, far) in near.iter().zip(&far) {
            let apart = (*far - DVec3::from(offset)).distance(*near);
            // Positions are f32 about a vertex of the mesh: half a step at 2 km is 0.06 mm.
            prop_assert!(apart < 2e-4, "{apart}");
        }
    }

    #[test]
    fn any_text_is_read_or_refused(text in "([vfltn]{1,2} [-0-9./ \\\\#]{0,20}\n|.*\n){0,12}") {
        let _ = read_text(&text, &local());
    }
}
