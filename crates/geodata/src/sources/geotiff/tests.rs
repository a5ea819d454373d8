use super::tiff::Tiff;
use super::*;
use proptest::prelude::*;

mod stated;

/// A tag of a directory: number, type, values' bytes and count.
type Tag = (u16, u16, Vec<u8>, u32);

fn shorts(tag: u16, values: &[u16]) -> Tag {
    (
        tag,
        3,
        values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        values.len() as u32,
    )
}

fn longs(tag: u16, values: &[u32]) -> Tag {
    (
        tag,
        4,
        values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        values.len() as u32,
    )
}

fn doubles(tag: u16, values: &[f64]) -> Tag {
    (
        tag,
        12,
        values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        values.len() as u32,
    )
}

fn text(tag: u16, text: &str) -> Tag {
    (
        tag,
        2,
        [text.as_bytes(), b"\0"].concat(),
        text.len() as u32 + 1,
    )
}

/// A little-endian TIFF of one strip.
fn tiff(tags: Vec<Tag>, pixels: &[u8]) -> Vec<u8> {
    pages(vec![(tags, pixels.to_vec())])
}

/// A little-endian TIFF of several pictures, each of one strip.
fn pages(pages: Vec<(Vec<Tag>, Vec<u8>)>) -> Vec<u8> {
    let mut out = b"II\x2a\0\0\0\0\0".to_vec();
    // Where the place of the next directory is to be written.
    let mut next = 4;
    for (mut tags, pixels) in pages {
        tags.push(longs(273, &[out.len() as u32]));
        tags.push(longs(279, &[pixels.len() as u32]));
        tags.sort_by_key(|tag| tag.0);
        out.extend(pixels);
        let mut places = Vec::new();
        for (_, _, bytes, _) in &tags {
            places.push(out.len() as u32);
            out.extend(bytes);
        }
        let directory = out.len() as u32;
        out[next..next + 4].copy_from_slice(&directory.to_le_bytes());
        out.extend((tags.len() as u16).to_le_bytes());
        for ((tag, kind, bytes, count), place) in tags.iter().zip(places) {
            out.extend(tag.to_le_bytes());
            out.extend(kind.to_le_bytes());
            out.extend(count.to_le_bytes());
            let mut own = [0; 4];
            if bytes.len() <= 4 {
                own[..bytes.len()].copy_from_slice(bytes);
            } else {
                own = place.to_le_bytes();
            }
            out.extend(own);
        }
        next = out.len();
        out.extend([0; 4]);
    }
    out
}

/// Tags of a raster of 32-bit heights with 10 m pixels, whose top left corner lies at a place.
fn map(size: [u16; 2], corner: [f64; 2], epsg: u16, point: bool) -> Vec<Tag> {
    vec![
        shorts(256, &[size[0]]),
        shorts(257, &[size[1]]),
        shorts(258, &[32]),
        shorts(259, &[1]),
        shorts(277, &[1]),
        shorts(278, &[size[1]]),
        shorts(339, &[3]),
        doubles(33_550, &[10.0, 10.0, 0.0]),
        doubles(33_922, &[0.0, 0.0, 0.0, corner[0], corner[1], 0.0]),
        shorts(
            34_735,
            &[
                1,
                1,
                0,
                3,
                1024,
                0,
                1,
                1,
                1025,
                0,
                1,
                if point { 2 } else { 1 },
                3072,
                0,
                1,
                epsg,
            ],
        ),
        text(42_113, "-9999"),
    ]
}

/// A hill side of 20 × 12 pixels, 0.1 m higher each metre to the north, with a hole at (3, 4).
fn slope(epsg: u16, point: bool) -> Vec<u8> {
    let height = |k: u16| {
        if k == 4 * 20 + 3 {
            -9999.0
        } else {
            400.0 - f32::from(k / 20)
        }
    };
    let pixels: Vec<u8> = (0..240).flat_map(|k| height(k).to_le_bytes()).collect();
    tiff(
        map([20, 12], [2_683_000.0, 1_247_000.0], epsg, point),
        &pixels,
    )
}

fn kept(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

#[test]
fn a_height_raster_becomes_terrain_with_its_hole() {
    let folder = tempfile::tempdir().unwrap();
    let path = kept(folder.path(), "dem.tif", &slope(2056, false));
    let layer = read(&path, &Options::default()).unwrap();
    assert_eq!((layer.kind, layer.meshes.len()), (LayerKind::Terrain, 1));
    let mesh = &layer.meshes[0];
    // 19 × 11 cells; the missing corner takes half of each of the four about it.
    assert_eq!(
        (mesh.positions.len(), mesh.triangle_count()),
        (239, 2 * 19 * 11 - 4)
    );
    // One triangle of a half cell stays at each corner of the hole. The slope's area is 1/cos of the map's.
    let area: f64 = (0..mesh.triangle_count())
        .map(|t| {
            let [a, b, c] = [0, 1, 2].map(|k| mesh.vertex_m(mesh.indices[3 * t + k]));
            let cross = (b - a).cross(c - a) / 2.0;
            assert!(cross.z > 0.0);
            cross.length()
        })
        .sum();
    let want = (19.0 * 11.0 - 2.0) * 100.0 * 1.01_f64.sqrt();
    assert!((area / want - 1.0).abs() < 1e-3, "{area} {want}");
    // Normals lean to the south.
    let normal = DVec3::from(mesh.normals[100].map(f64::from));
    assert!(
        (normal - DVec3::new(0.0, -0.1, 1.0).normalize()).length() < 2e-3,
        "{normal}"
    );
    // In the middle of the raster, at its lowest height: 389 m over LN02, 47.5 m of geoid.
    assert!(
        (layer.site.origin().height_m - 436.3).abs() < 1.0,
        "{}",
        layer.site.origin().height_m
    );
}

#[test]
fn a_point_raster_lies_half_a_pixel_off_an_area_raster() {
    let folder = tempfile::tempdir().unwrap();
    let center = |point| {
        let path = kept(folder.path(), "dem.tif", &slope(2056, point));
        Heights::read(&path, &Options::default(), &mut Notes::default())
            .unwrap()
            .center(0, 0)
    };
    assert_eq!(center(false), DVec2::new(2_683_005.0, 1_246_995.0));
    assert_eq!(center(true), DVec2::new(2_683_000.0, 1_247_000.0));
}

#[test]
fn ground_is_sampled_between_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let path = kept(folder.path(), "dem.tif", &slope(2056, false));
    let heights = Heights::read(&path, &Options::default(), &mut Notes::default()).unwrap();
    // Half way between the rows at 396 and 395 m.
    let found = heights
        .sample(DVec2::new(2_683_120.0, 1_246_950.0))
        .unwrap();
    assert!((found - 395.5).abs() < 1e-5, "{found}");
    assert_eq!(heights.sample(DVec2::new(2_683_035.0, 1_246_955.0)), None);
    assert_eq!(heights.sample(DVec2::new(2_682_999.0, 1_246_955.0)), None);
    let ground = Ground::read(folder.path(), &Options::default()).unwrap();
    let there = heights
        .crs
        .to_geodetic(DVec3::new(2_683_120.0, 1_246_950.0, found))
        .unwrap();
    let again = ground
        .height_m(Geodetic {
            height_m: 0.0,
            ..there
        })
        .unwrap();
    assert!((again - there.height_m).abs() < 1e-3);
}

#[test]
fn a_picture_lies_where_its_world_file_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = kept(folder.path(), "dem.tif", &slope(2056, false));
    // Half a metre a pixel over the raster's western half, red growing to the east and green to the south.
    let picture = image::RgbImage::from_fn(200, 240, |x, y| image::Rgb([x as u8, y as u8, 9]));
    let photo = folder.path().join("photo.png");
    picture.save(&photo).unwrap();
    std::fs::write(
        folder.path().join("photo.pgw"),
        "0.5\n0\n0\n-0.5\n2683000.25\n1246999.75\n",
    )
    .unwrap();
    let options = Options {
        orthophoto: Some(photo.clone()),
        ..Options::default()
    };
    let layer = read(&path, &options).unwrap();
    let mesh = &layer.meshes[0];
    let texture = mesh.look.texture.as_ref().unwrap();
    let shown = |vertex: usize| {
        let [u, v] = mesh.uv[vertex];
        let (x, y) = (
            (u * texture.size_px[0] as f32) as usize,
            (v * texture.size_px[1] as f32) as usize,
        );
        let at = 4 * (y * texture.size_px[0] as usize + x);
        [texture.rgba[at], texture.rgba[at + 1], texture.rgba[at + 2]]
    };
    // Pixels 7 east and 2 south (no hole before them): 75 m and 25 m from the corner.
    assert_eq!(shown(2 * 20 + 7), [150, 50, 9]);
    // Outside the picture the ground is plain.
    assert_eq!(
        shown(2 * 20 + 15)[2],
        (255.0 * GROUND[2].powf(1.0 / 2.2)) as u8
    );
    assert!(!mesh.look.repeats && texture.size_px[0].max(texture.size_px[1]) <= 2048);
    std::fs::remove_file(folder.path().join("photo.pgw")).unwrap();
    let error = read(&path, &options).unwrap_err().to_string();
    assert!(error.contains("world file"), "{error}");
}

#[test]
fn fine_pictures_are_cut_into_pages() {
    let folder = tempfile::tempdir().unwrap();
    let path = kept(folder.path(), "dem.tif", &slope(2056, false));
    // 25 pixels a metre.
    let (width, height) = (4750_u16, 2750);
    let tags = vec![
        shorts(256, &[width]),
        shorts(257, &[height]),
        shorts(258, &[8]),
        shorts(259, &[1]),
        shorts(277, &[1]),
        shorts(278, &[height]),
        doubles(33_550, &[0.04, 0.04, 0.0]),
        doubles(33_922, &[0.0, 0.0, 0.0, 2_683_005.0, 1_246_995.0, 0.0]),
    ];
    let photo = kept(
        folder.path(),
        "photo.tif",
        &tiff(tags, &vec![77; usize::from(width) * usize::from(height)]),
    );
    let options = Options {
        orthophoto: Some(photo),
        ..Options::default()
    };
    let layer = read(&path, &options).unwrap();
    // 2032 px hold 8 cells of 250 px.
    assert_eq!(layer.meshes.len(), 3 * 2);
    for mesh in &layer.meshes {
        let texture = mesh.look.texture.as_ref().unwrap();
        assert!(
            texture.size_px.iter().all(|n| *n <= 2048),
            "{:?}",
            texture.size_px
        );
        assert!(mesh.uv.iter().flatten().all(|v| (0.0..=1.0).contains(v)));
    }
}

#[test]
fn compressions_predictors_and_byte_orders_are_read() {
    let folder =
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("tests/data/rasters");
    let read = |name: &str| Tiff::open(std::fs::read(folder.join(name)).unwrap()).unwrap();
    // Written with tifffile: tiles and strips, LZW with both predictors, PackBits and Deflate in big-endian order, BigTIFF.
    for (name, whole) in [
        ("lzw3.tif", false),
        ("lzw2.tif", true),
        ("pack.tif", true),
        ("defl.tif", false),
    ] {
        let tiff = read(name);
        assert_eq!(tiff.size(), [40, 30], "{name}");
        let band = tiff.band(0, |value| value as f32).unwrap();
        for (k, found) in band.iter().enumerate() {
            let (x, y) = ((k % 40) as f32, (k / 40) as f32);
            let want = if whole {
                100.0 + 3.0 * x + 7.0 * y
            } else {
                100.0 + 0.5 * x + 0.25 * y
            };
            assert_eq!(*found, want, "{name} {x} {y}");
        }
    }
    // More codes than the table of the LZW holds.
    let full = read("lzw-full.tif").band(0, |value| value as f32).unwrap();
    for (k, found) in full.iter().enumerate() {
        let (x, y) = (k % 90, k / 90);
        let want = (x * x * 37 + y * y * 101 + x * y * 59) % 241;
        assert_eq!(*found, want as f32);
    }
}

/// A raster that GDAL wrote (64 × 48 pixels in tiles of 32 × 16).
fn by_gdal(name: &str) -> Tiff {
    let folder =
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("tests/data/rasters");
    Tiff::open(std::fs::read(folder.join(name)).unwrap()).unwrap()
}

#[test]
fn heights_of_every_compression_are_the_same() {
    for name in ["zstd.tif", "lerc.tif", "sparse.tif"] {
        let band = by_gdal(name).band(0, |value| value as f32).unwrap();
        for (k, found) in band.iter().enumerate() {
            let (x, y) = ((k % 64) as f32, (k / 64) as f32);
            // The eastern half of the sparse file was never written.
            if name == "sparse.tif" && x >= 32.0 {
                assert!(found.is_nan());
            } else {
                assert_eq!(*found, 400.0 + 0.5 * x + 0.25 * y, "{name} {x} {y}");
            }
        }
    }
}

#[test]
fn pictures_of_every_colour_model_look_the_same() {
    // Largest difference of a colour, and whether the eight western columns are transparent.
    for (name, off, edge) in [
        ("webp.tif", 0, false),
        ("jpeg.tif", 6, true),
        ("alpha.tif", 0, true),
        ("nir.tif", 0, false),
        ("bands.tif", 0, false),
        ("palette.tif", 0, false),
    ] {
        let rgba = by_gdal(name).rgba(None).unwrap();
        assert_eq!(rgba.len(), 4 * 64 * 48);
        for (k, found) in rgba.chunks(4).enumerate() {
            let (x, y) = ((k % 64) as i32, (k / 64) as i32);
            let want = if name == "palette.tif" {
                [10 * (x / 8), 255 - 10 * (x / 8), 7]
            } else {
                [60 + 2 * x, 200 - 2 * y, 90]
            };
            let opaque = if edge && x < 8 { 0 } else { 255 };
            assert_eq!(found[3], opaque, "{name} {x} {y}");
            for (found, want) in found.iter().zip(want) {
                let near = i32::from(*found).abs_diff(want) <= off;
                assert!(opaque == 0 || near, "{name} {x} {y}: {found} for {want}");
            }
        }
    }
}

#[test]
fn bad_rasters_are_one_error_that_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let said = |bytes: &[u8], options: &Options| {
        read(&kept(folder.path(), "dem.tif", bytes), options)
            .unwrap_err()
            .to_string()
    };
    let plain = Options::default();
    assert!(said(b"", &plain).contains("no TIFF"));
    let lost = said(b"II\x2a\0\xff\xff\xff\xff", &plain);
    assert!(
        lost.contains("TIFF: ") && lost.contains("gdal_translate"),
        "{lost}"
    );
    let good = slope(2056, false);
    assert!(said(&slope(32_767, false), &plain).contains("--crs"));
    assert!(
        said(
            &good,
            &Options {
                crs: Some("EPSG:4326".into()),
                ..plain.clone()
            }
        )
        .contains("no point of EPSG:4326")
    );
    // A size that the file cannot hold.
    let mut tags = map([60_000, 6_000], [0.0, 0.0], 2056, false);
    assert!(said(&tiff(tags.clone(), &[0; 100]), &plain).contains("too short"));
    tags.retain(|tag| ![256, 257, 33_550].contains(&tag.0));
    tags.extend([shorts(256, &[2]), shorts(257, &[2])]);
    assert!(said(&tiff(tags, &[0; 16]), &plain).contains("world file"));
    let cut = said(&tiff(map([2, 2], [0.0; 2], 2056, false), &[0; 9]), &plain);
    assert!(
        cut.contains("TIFF: ") && cut.contains("gdal_translate"),
        "{cut}"
    );
    let empty: Vec<u8> = (0..4).flat_map(|_| (-9999_f32).to_le_bytes()).collect();
    assert!(said(&tiff(map([2, 2], [0.0; 2], 2056, false), &empty), &plain).contains("no pixel"));
    assert!(read(folder.path().join("none.tif").as_path(), &plain).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn damaged_rasters_never_panic(flips in prop::collection::vec((0..2000_usize, 0..8_u8), 0..6), cut in 0..4000_usize, which in 0..10_usize) {
        let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("tests/data/rasters");
        let names = [
            "lzw3.tif", "lzw2.tif", "pack.tif", "defl.tif", "jpeg.tif", "lerc.tif", "zstd.tif", "webp.tif",
            "palette.tif",
        ];
        let mut bytes = match names.get(which) {
            Some(name) => std::fs::read(folder.join(name)).unwrap(),
            None => slope(2056, false),
        };
        bytes.truncate(cut.max(8));
        for (at, bit) in flips {
            let at = at % bytes.len();
            bytes[at] ^= 1 << bit;
        }
        if let Ok(tiff) = Tiff::open(bytes) {
            let _ = (tiff.heights(|value| value as f32), tiff.rgba(Some(0.0)));
        }
    }
}

#[test]
fn zurich_lies_where_its_lake_is() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("../shared/data/dem/zh_dem_25.tif");
    if !path.exists() {
        println!("skipped: {} is absent", path.display());
        return;
    }
    let unnamed = read(&path, &Options::default()).unwrap_err().to_string();
    assert!(unnamed.contains("--crs"), "{unnamed}");
    let options = Options {
        crs: Some("EPSG:21781".into()),
        ..Options::default()
    };
    let layer = read(&path, &options).unwrap();
    let triangles: usize = layer.meshes.iter().map(TexturedMesh::triangle_count).sum();
    println!(
        "{} meshes, {triangles} triangles, site {:?}",
        layer.meshes.len(),
        layer.site.origin()
    );
    assert!(triangles > 200_000 && layer.meshes.len() == 4);
    let ground = Ground::read(&path, &options).unwrap();
    let at = |latitude: f64, longitude: f64| {
        ground.height_m(Geodetic {
            latitude_rad: latitude.to_radians(),
            longitude_rad: longitude.to_radians(),
            height_m: 0.0,
        })
    };
    // The lake stands at 406 m; the Uetliberg, 4 km from it, at 870 m. The geoid lies 47 to 48 m over the ellipsoid.
    println!(
        "lake {:?} Uetliberg {:?}",
        at(47.3600, 8.5400),
        at(47.3493, 8.4914)
    );
    let lake = at(47.3600, 8.5400).unwrap() - 47.5;
    assert!((lake - 406.0).abs() < 3.0, "{lake}");
}
