use super::*;
use boresight_models::maths::geodesy::{Geodetic, SiteFrame};
use boresight_models::shape::textured::UpAxis;
use proptest::prelude::*;

fn local() -> Options {
    Options {
        site: Some(SiteFrame::new(Geodetic {
            latitude_rad: 0.8,
            longitude_rad: 0.15,
            height_m: 500.0,
        })),
        mesh_unit: Some("m".into()),
        mesh_up: Some(UpAxis::Z),
        ..Options::default()
    }
}

fn read_file(bytes: &[u8]) -> Result<Layer, SourceError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    std::fs::write(&path, bytes).unwrap();
    read(&path, &local())
}

fn corners(layer: &Layer) -> Vec<DVec3> {
    let of = |mesh: &TexturedMesh| {
        mesh.indices
            .iter()
            .map(|&i| mesh.vertex_m(i))
            .collect::<Vec<_>>()
    };
    layer.meshes.iter().flat_map(of).collect()
}

fn said(layer: &Layer) -> String {
    let lines: Vec<_> = layer.warnings.iter().map(ToString::to_string).collect();
    lines.join("\n")
}

#[derive(Clone, Copy, Debug)]
enum Way {
    Ascii,
    Little,
    Big,
}

/// A file of triangles in a row, its places as doubles or floats.
fn write(points: &[[f64; 3]], way: Way, double: bool) -> Vec<u8> {
    let name = match way {
        Way::Ascii => "ascii",
        Way::Little => "binary_little_endian",
        Way::Big => "binary_big_endian",
    };
    let kind = if double { "double" } else { "float" };
    let faces = points.len() - 2;
    let head = format!(
        "ply\r\nformat {name} 1.0\r\ncomment made in K\u{f6}ln\r\nobj_info none\r\nelement vertex {}\r\nproperty uchar red\r\n\
         property {kind} x\r\nproperty {kind} y\r\nproperty {kind} z\r\nelement face {faces}\r\n\
         property list uchar int vertex_indices\r\nproperty short flags\r\nend_header\r\n",
        points.len()
    );
    let mut out = head.into_bytes();
    match way {
        Way::Ascii => {
            for [x, y, z] in points {
                out.extend(format!("7 {x} {y} {z} \r\n").bytes());
            }
            for k in 0..faces {
                out.extend(format!("3 {k} {} {} -1\r\n\r\n", k + 1, k + 2).bytes());
            }
        }
        Way::Little | Way::Big => {
            let big = matches!(way, Way::Big);
            let mut put = |bytes: &[u8]| match big {
                true => out.extend_from_slice(bytes),
                false => out.extend(bytes.iter().rev()),
            };
            for point in points {
                put(&[7]);
                for x in point {
                    match double {
                        true => put(&x.to_be_bytes()),
                        false => put(&(*x as f32).to_be_bytes()),
                    }
                }
            }
            for k in 0..faces as i32 {
                put(&[3]);
                (k..k + 3).for_each(|i| put(&i.to_be_bytes()));
                put(&(-1_i16).to_be_bytes());
            }
        }
    }
    out
}

proptest! {
    /// In every encoding, with an offset taken off again, it is the same ground.
    #[test]
    fn every_encoding_and_offset_is_the_same_ground(
        points in prop::collection::vec(prop::array::uniform3(-500.0..500.0_f64), 3..10),
        offset in prop::array::uniform3(-9_000_000_i32..9_000_000),
    ) {
        let offset = offset.map(f64::from);
        let near = corners(&read_file(&write(&points, Way::Ascii, true)).unwrap());
        let moved: Vec<[f64; 3]> = points.iter().map(|p| [0, 1, 2].map(|k| p[k] + offset[k])).collect();
        for way in [Way::Ascii, Way::Little, Way::Big] {
            let far = corners(&read_file(&write(&moved, way, true)).unwrap());
            prop_assert_eq!(far.len(), near.len());
            for (far, near) in far.iter().zip(&near) {
                let apart = (*far - DVec3::from(offset)).distance(*near);
                // Positions are f32 about a vertex of the mesh.
                prop_assert!(apart < 2e-4, "{way:?}: {apart}");
            }
            let floats = corners(&read_file(&write(&points, way, false)).unwrap());
            for (float, near) in floats.iter().zip(&near) {
                prop_assert!(float.distance(*near) < 2e-4);
            }
        }
    }

    #[test]
    fn damaged_files_never_panic(flips in prop::collection::vec((0..600_usize, 0..8_u8), 1..6), cut in 0..900_usize) {
        for way in [Way::Ascii, Way::Little] {
            let mut bytes = write(&[[0.0, 0.0, 1.0], [5.0, 0.0, 1.0], [0.0, 5.0, 1.0], [5.0, 5.0, 1.0]], way, true);
            for (at, bit) in &flips {
                let at = at % bytes.len();
                bytes[at] ^= 1 << bit;
            }
            bytes.truncate(cut.max(1));
            let _ = read_file(&bytes);
        }
    }
}

#[test]
fn odd_rows_and_elements_are_left_out_and_counted() {
    // A mark, letters of Latin-1, numbers as printf writes them, a hollow face, colours of floats to 255.
    let mut bytes = b"\xef\xbb\xbfply\nformat ascii 1.0\ncomment K\xf6ln\nelement camera 1\nproperty float view_px\n".to_vec();
    bytes.extend(
        b"element vertex 6\nproperty float32 x\nproperty float64 y\nproperty double z\nproperty float red\nproperty float green\n\
          property float blue\nelement face 6\nproperty list uint8 int32 vertex_index\nend_header\n\
          1.\n0. 0 0 255 0 0\n2 1. 0 255 0 0\n.0 2 0 255 0 0\n4e0 1 0 255 0 0\nnan nan nan 0 0 0\n9 9 9 0 255 0\n\
          4 0 3 2 1\n3 0 1 4\n3 0 1 77\n3 0 1 -1\n2 0 1\n0\n",
    );
    let layer = read_file(&bytes).unwrap();
    let mesh = &layer.meshes[0];
    let at = |i: u32| mesh.vertex_m(i);
    let each = mesh.indices.as_chunks::<3>().0.iter();
    let area: f64 = each
        .map(|[a, b, c]| (at(*b) - at(*a)).cross(at(*c) - at(*a)).z / 2.0)
        .sum();
    assert!((area - 2.0).abs() < 1e-9, "{area}");
    assert_eq!(mesh.colors[0], [1.0, 0.0, 0.0, 1.0]);
    let said = said(&layer);
    for part in [
        "1 rows of 'camera' are not read",
        "3 faces with a vertex that is not there or no number (first face 1)",
        "2 faces of fewer than three corners",
        "colours up to 255",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
}

#[test]
fn strips_textures_and_colours_of_faces_are_read() {
    let head = "ply\nformat ascii 1.0\ncomment TextureFile old wall.png\ncomment TextureFile lost.png\nelement vertex 4\n\
                property float x\nproperty float y\nproperty float z\n";
    let square = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n";
    let strips = format!(
        "{head}element tristrips 1\nproperty list int int vertex_indices\nend_header\n{square}9 0 1 2 3 -1 0 1 2 -1\n"
    );
    assert_eq!(corners(&read_file(strips.as_bytes()).unwrap()).len(), 9);
    let folder = tempfile::tempdir().unwrap();
    let picture = image::RgbImage::from_pixel(2, 2, image::Rgb([9, 9, 9]));
    picture.save(folder.path().join("old wall.png")).unwrap();
    let path = folder.path().join("a.ply");
    let faces = "element face 2\nproperty list uchar uint vertex_indices\nproperty list uchar float texcoord\nproperty int texnumber\n\
                 property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    let rows = "3 0 1 2 6 0 0 1 0 0 1 0 255 0 0\n3 1 3 2 6 0 0 1 0 0 1 1 0 255 0\n";
    std::fs::write(&path, format!("{head}{faces}{square}{rows}")).unwrap();
    let layer = read(&path, &local()).unwrap();
    let [wall, lost] = [0, 1].map(|k| &layer.meshes[k]);
    assert!(wall.look.texture.is_some() && lost.look.texture.is_none());
    assert_eq!(
        (wall.colors[0], lost.colors[0]),
        ([1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0])
    );
    assert_eq!(wall.uv, [[0.0, 1.0], [1.0, 1.0], [0.0, 0.0]]);
    assert!(
        said(&layer).contains("1 textures (") && said(&layer).contains("lost.png"),
        "{}",
        said(&layer)
    );
}

#[test]
fn what_is_no_mesh_is_one_error() {
    for (text, part) in [
        (
            "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
            "point cloud",
        ),
        (
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty quad x\nend_header\n1\n",
            "property quad x",
        ),
        ("ply\nformat binary 1.0\nend_header\n", "format binary"),
        ("ply\nelement vertex 3\n", "no end"),
        (
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nend_header\n1\n",
            "3 of 'vertex'",
        ),
        ("solid a\n", "'ply'"),
    ] {
        let error = read_file(text.as_bytes()).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}
