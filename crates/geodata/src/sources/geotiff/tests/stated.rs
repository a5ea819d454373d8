//! What a raster states of its values and its place: applied, refused by name, or noted.

use super::*;

/// Columns and rows of the ground.
const SIZE: [usize; 2] = [6, 5];
/// Its top left corner, in LV95 [m].
const CORNER: [f64; 2] = [2_683_000.0, 1_247_000.0];
/// Its pixels [m].
const STEP: f64 = 10.0; // [m]

/// How a file lies on the map.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Lying {
    /// Pixel scale and tie point.
    Scale,
    /// A tie point in the middle of the raster.
    Middle,
    /// Rows from the south, by a matrix.
    SouthMatrix,
    /// Rows from the south, by a negative scale.
    SouthScale,
    /// Rows that run east, by a matrix.
    Turned,
    /// Four corners as control points.
    Corners,
    /// A world file.
    World,
}

/// Where a scale and an offset stand.
#[derive(Clone, Copy, Debug, PartialEq)]
enum By {
    /// GDAL's metadata in the file.
    Items,
    /// In the file beside it.
    Aux,
    /// The third scale and the tie point's height.
    Third,
}

/// How the unit of heights is stated.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Unit {
    Nothing,
    /// GDAL's unit type.
    Word(&'static str, f64),
    /// Of the file beside it.
    Aux(&'static str, f64),
    /// The key of vertical units.
    Key(u16, f64),
    /// The vertical code.
    Code(u16, f64),
}

const US_FOOT_M: f64 = 1200.0 / 3937.0; // [m]

/// Keys of LV95 with others.
fn keys(more: &[[u16; 2]]) -> Tag {
    let mut all = vec![[1024, 1], [1025, 1], [3072, 2056]];
    for own in more {
        all.retain(|key| key[0] != own[0]);
        all.push(*own);
    }
    all.retain(|key| key[1] != u16::MAX);
    all.sort_unstable();
    let mut shorts_ = vec![1, 1, 0, all.len() as u16];
    shorts_.extend(all.iter().flat_map(|[id, value]| [*id, 0, 1, *value]));
    shorts(34_735, &shorts_)
}

/// Tags of a raster of 64-bit numbers.
fn plain(size: [usize; 2]) -> Vec<Tag> {
    vec![
        shorts(256, &[size[0] as u16]),
        shorts(257, &[size[1] as u16]),
        shorts(258, &[64]),
        shorts(259, &[1]),
        shorts(262, &[1]),
        shorts(277, &[1]),
        shorts(278, &[size[1] as u16]),
        shorts(339, &[3]),
    ]
}

fn pixels(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Items of GDAL's metadata.
fn items(items: &[(&str, &str)]) -> Tag {
    let one = |(role, value): &(&str, &str)| {
        format!(
            "<Item name=\"{}\" sample=\"0\" role=\"{role}\">{value}</Item>",
            role.to_uppercase()
        )
    };
    let all: String = items.iter().map(one).collect();
    text(42_112, &format!("<GDALMetadata>\n{all}</GDALMetadata>\n"))
}

/// Where a raster of the ground lies, and in which order its values stand: tags, size, and the ground's column and row of each value.
fn lying(lying: Lying, third: [f64; 2]) -> (Vec<Tag>, [usize; 2], Vec<[usize; 2]>) {
    let [columns, rows] = SIZE;
    let [x, y] = CORNER;
    let [wide, high] = [columns as f64 * STEP, rows as f64 * STEP];
    let order = |south: bool| {
        let row = move |j| if south { rows - 1 - j } else { j };
        (0..rows)
            .flat_map(|j| (0..columns).map(move |i| [i, row(j)]))
            .collect::<Vec<_>>()
    };
    let scale = |height: f64| doubles(33_550, &[STEP, height, third[0]]);
    let [step, zero] = third;
    let matrix = |a: [f64; 6]| {
        let [a, b, c, d, e, f] = a;
        doubles(
            34_264,
            &[
                a, b, 0.0, c, d, e, 0.0, f, 0.0, 0.0, step, zero, 0.0, 0.0, 0.0, 1.0,
            ],
        )
    };
    match lying {
        Lying::Scale => (
            vec![scale(STEP), doubles(33_922, &[0.0, 0.0, 0.0, x, y, zero])],
            SIZE,
            order(false),
        ),
        Lying::Middle => (
            vec![
                scale(STEP),
                doubles(
                    33_922,
                    &[3.0, 2.0, 0.0, x + 3.0 * STEP, y - 2.0 * STEP, zero],
                ),
            ],
            SIZE,
            order(false),
        ),
        Lying::SouthScale => (
            vec![
                scale(-STEP),
                doubles(33_922, &[0.0, 0.0, 0.0, x, y - high, zero]),
            ],
            SIZE,
            order(true),
        ),
        Lying::SouthMatrix => (
            vec![matrix([STEP, 0.0, x, 0.0, STEP, y - high])],
            SIZE,
            order(true),
        ),
        Lying::Turned => (
            vec![matrix([0.0, STEP, x, -STEP, 0.0, y])],
            [rows, columns],
            (0..columns)
                .flat_map(|i| (0..rows).map(move |j| [i, j]))
                .collect(),
        ),
        Lying::Corners => {
            let [i, j] = [columns as f64, rows as f64];
            let corners = [
                [0.0, 0.0, x, y],
                [i, 0.0, x + wide, y],
                [0.0, j, x, y - high],
                [i, j, x + wide, y - high],
            ];
            let ties: Vec<f64> = corners
                .iter()
                .flat_map(|[i, j, x, y]| [*i, *j, 0.0, *x, *y, 0.0])
                .collect();
            (vec![doubles(33_922, &ties)], SIZE, order(false))
        }
        Lying::World => (Vec::new(), SIZE, order(false)),
    }
}

/// The ground's heights [m] as a file in a folder, with its scale, offset and unit stated somewhere.
fn written(
    folder: &Path,
    ground_m: &[f64],
    place: Lying,
    by: By,
    [scale, offset]: [f64; 2],
    unit: Unit,
) -> PathBuf {
    let (unit_m, mut known) = match unit {
        Unit::Nothing => (1.0, keys(&[])),
        Unit::Word(_, m) | Unit::Aux(_, m) => (m, keys(&[])),
        Unit::Key(code, m) => (m, keys(&[[4099, code]])),
        Unit::Code(code, m) => (m, keys(&[[4096, code]])),
    };
    let third = if by == By::Third {
        [scale, offset]
    } else {
        [0.0, 0.0]
    };
    let (placing, size, order) = lying(place, third);
    let values: Vec<f64> = order
        .iter()
        .map(|[i, j]| (ground_m[j * SIZE[0] + i] / unit_m - offset) / scale)
        .collect();
    let (scale, offset) = (scale.to_string(), offset.to_string());
    let mut inside = Vec::new();
    let mut beside = String::new();
    match by {
        By::Items => inside.extend([("scale", scale.as_str()), ("offset", offset.as_str())]),
        By::Aux => beside = format!("<Offset>{offset}</Offset><Scale>{scale}</Scale>"),
        By::Third => {}
    }
    match unit {
        Unit::Word(word, _) => inside.push(("unittype", word)),
        Unit::Aux(word, _) => beside += &format!("<UnitType>{word}</UnitType>"),
        _ => {}
    }
    let mut tags = plain(size);
    tags.extend(placing);
    tags.push(std::mem::replace(&mut known, shorts(0, &[])));
    if !inside.is_empty() {
        tags.push(items(&inside));
    }
    let path = kept(folder, "dem.tif", &tiff(tags, &pixels(&values)));
    if !beside.is_empty() {
        let xml =
            format!("<PAMDataset><PAMRasterBand band=\"1\">{beside}</PAMRasterBand></PAMDataset>");
        std::fs::write(folder.join("dem.tif.aux.xml"), xml).unwrap();
    }
    if place == Lying::World {
        let [x, y] = [CORNER[0] + STEP / 2.0, CORNER[1] - STEP / 2.0];
        let world = format!("{STEP}\n0\n0\n-{STEP}\n{x}\n{y}\n");
        std::fs::write(folder.join("dem.tfw"), world).unwrap();
    }
    path
}

fn site() -> SiteFrame {
    SiteFrame::new(Geodetic {
        latitude_rad: 47.37_f64.to_radians(),
        longitude_rad: 8.54_f64.to_radians(),
        height_m: 450.0, // [m]
    })
}

/// The vertices of a raster, from west to east and south to north [m].
fn vertices(path: &Path) -> Vec<DVec3> {
    let options = Options {
        site: Some(site()),
        ..Options::default()
    };
    let layer = read(path, &options).unwrap();
    let mut found: Vec<DVec3> = (layer.meshes.iter())
        .flat_map(|mesh| (0..mesh.positions.len() as u32).map(|k| mesh.vertex_m(k)))
        .collect();
    found.sort_by_key(|r| [r.x.round() as i64, r.y.round() as i64]);
    found
}

/// The ground of the tests [m].
fn ground_m() -> Vec<f64> {
    (0..SIZE[0] * SIZE[1])
        .map(|k| 400.0 + (k * 7 % 11) as f64 + 0.25 * k as f64)
        .collect()
}

/// The heights of a file, and what its reader notes.
fn heights(path: &Path) -> Result<(Heights, Vec<String>), String> {
    let mut notes = Notes::default();
    let found =
        Heights::read(path, &Options::default(), &mut notes).map_err(|error| error.to_string())?;
    let lines = notes
        .warnings(path)
        .iter()
        .map(ToString::to_string)
        .collect();
    Ok((found, lines))
}

/// Heights in LV95 with tags and keys of one's own: the file, read.
fn with(tags: Vec<Tag>, more: &[[u16; 2]]) -> Result<(Heights, Vec<String>), String> {
    let folder = tempfile::tempdir().unwrap();
    let (placing, size, _) = lying(Lying::Scale, [0.0, 0.0]);
    let mut all = plain(size);
    all.extend(placing);
    all.push(keys(more));
    for tag in tags {
        all.retain(|own| own.0 != tag.0);
        all.push(tag);
    }
    heights(&kept(
        folder.path(),
        "dem.tif",
        &tiff(all, &pixels(&ground_m())),
    ))
}

/// Height of the first pixel over the geoid's zero [m], and the notes.
fn first_m(found: &Heights) -> f64 {
    found.at(0, 0).unwrap() * found.crs.height_unit_m()
}

#[test]
fn the_scale_and_offset_of_the_odd_file_count() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("../shared/data/odd/tif-scale-offset.tif");
    if !path.exists() {
        println!("skipped: {} is absent", path.display());
        return;
    }
    let (found, _) = heights(&path).unwrap();
    let all = (0..12).flat_map(|j| (0..16).map(move |i| (i, j)));
    let all: Vec<f64> = all.filter_map(|(i, j)| found.at(i, j)).collect();
    let low = all.iter().copied().fold(f64::INFINITY, f64::min);
    let high = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    assert_eq!(all.len(), 16 * 12);
    // Its steps are 0.1 m.
    assert!(
        (low - 500.0).abs() < 1e-4 && (high - 510.25).abs() < 0.051,
        "{low} {high}"
    );
}

#[test]
fn every_way_to_state_scale_unit_and_place_gives_the_same_ground() {
    let folder = tempfile::tempdir().unwrap();
    let want = vertices(&written(
        folder.path(),
        &ground_m(),
        Lying::Scale,
        By::Items,
        [1.0, 0.0],
        Unit::Nothing,
    ));
    assert_eq!(want.len(), 30);
    let places = [
        Lying::Scale,
        Lying::Middle,
        Lying::SouthMatrix,
        Lying::SouthScale,
        Lying::Turned,
        Lying::Corners,
        Lying::World,
    ];
    let units = [
        Unit::Nothing,
        Unit::Word("m", 1.0),
        Unit::Word("Metres", 1.0),
        Unit::Word("ft", 0.3048),
        Unit::Word("US survey foot", US_FOOT_M),
        Unit::Aux("US_survey_foot", US_FOOT_M),
        Unit::Aux("cm", 0.01),
        Unit::Key(9001, 1.0),
        Unit::Key(9002, 0.3048),
        Unit::Key(9003, US_FOOT_M),
        Unit::Code(5103, 1.0),
        Unit::Code(5703, 1.0),
        Unit::Code(6360, US_FOOT_M),
        Unit::Code(8228, 0.3048),
    ];
    for place in places {
        for unit in units {
            for by in [By::Items, By::Aux, By::Third] {
                let third = [Lying::Corners, Lying::World].contains(&place) && by == By::Third;
                if third {
                    continue;
                }
                let folder = tempfile::tempdir().unwrap();
                let path = written(folder.path(), &ground_m(), place, by, [0.1, 400.0], unit);
                let found = vertices(&path);
                // Heights of 32 bits in feet are good to 0.03 mm, places in a mesh to 0.01 mm.
                let apart_m = found
                    .iter()
                    .zip(&want)
                    .map(|(a, b)| a.distance(*b))
                    .fold(0.0, f64::max);
                assert!(
                    found.len() == 30 && apart_m < 1e-3,
                    "{place:?} {by:?} {unit:?}: {apart_m}"
                );
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn a_changed_scale_offset_unit_or_axis_is_the_same_ground(
        ground_m in prop::collection::vec(0.0..3000.0_f64, SIZE[0] * SIZE[1]),
        step in prop_oneof![-5.0..-0.01, 0.01..5.0_f64],
        offset in -2000.0..2000.0_f64,
        unit_m in prop_oneof![Just(1.0), Just(0.3048), Just(US_FOOT_M)],
        place in 0..7_usize,
        aux in any::<bool>(),
        word in any::<bool>(),
    ) {
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let want = vertices(&written(folders[0].path(), &ground_m, Lying::Scale, By::Items, [1.0, 0.0], Unit::Nothing));
        let places = [
            Lying::Scale, Lying::Middle, Lying::SouthMatrix, Lying::SouthScale, Lying::Turned, Lying::Corners, Lying::World,
        ];
        let (name, code) = match unit_m {
            1.0 => ("metre", 9001),
            0.3048 => ("foot", 9002),
            _ => ("us-ft", 9003),
        };
        let unit = if word { Unit::Word(name, unit_m) } else { Unit::Key(code, unit_m) };
        let by = if aux { By::Aux } else { By::Items };
        let found = vertices(&written(folders[1].path(), &ground_m, places[place], by, [step, offset], unit));
        prop_assert_eq!(found.len(), want.len());
        for (a, b) in found.iter().zip(&want) {
            // Heights of 32 bits: 3000 m are 9843 ft, good to 0.15 mm.
            prop_assert!(a.distance(*b) < 2e-3, "{} for {}", a, b);
        }
    }
}

#[test]
fn what_is_stated_and_not_understood_is_refused_by_name() {
    let said = |tags: Vec<Tag>, more: &[[u16; 2]]| match with(tags, more) {
        Ok((_, notes)) => panic!("read, with {notes:?}"),
        Err(error) => error,
    };
    for (error, words) in [
        (
            said(vec![items(&[("unittype", "kelvin")])], &[]),
            ["'kelvin'", "gdal_edit -units"],
        ),
        (
            said(vec![items(&[("scale", "a tenth")])], &[]),
            ["scale: 'a tenth'", "gdal_translate -unscale"],
        ),
        (
            said(vec![items(&[("scale", "0")])], &[]),
            ["scale: 0", "-scale"],
        ),
        (
            said(vec![], &[[4099, 9122]]),
            ["VerticalUnits: 9122", "metres"],
        ),
        (said(vec![], &[[4096, 5715]]), ["MSL depth", "sign"]),
        (said(vec![], &[[4096, 5004]]), ["Bessel 1841", "+ellipsoid"]),
        (said(vec![], &[[4096, 4444]]), ["'4444'", "+geoid"]),
        (
            said(vec![], &[[3072, 32_767]]),
            ["without an ellipsoid", "--crs"],
        ),
        (
            said(vec![], &[[1024, 3], [3072, u16::MAX]]),
            ["geocentric", "gdalwarp"],
        ),
        (
            said(vec![], &[[3076, 9999]]),
            ["ProjLinearUnits: 9999", "gdalwarp"],
        ),
        (
            said(vec![], &[[1024, u16::MAX], [3072, u16::MAX]]),
            ["name no coordinate", "--crs"],
        ),
        (
            said(
                vec![doubles(
                    33_922,
                    &[
                        0.0, 0.0, 0.0, 1.0, 2.0, 0.0, 6.0, 5.0, 0.0, 800.0, 900.0, 0.0,
                    ],
                )],
                &[],
            ),
            ["2 tie points do not agree", "gdalwarp"],
        ),
    ] {
        assert!(
            words.iter().all(|word| error.contains(word)),
            "{error}: {words:?}"
        );
    }
    // Half floats, complex numbers.
    for tag in [shorts(258, &[16]), shorts(339, &[6])] {
        let error = said(vec![tag], &[]);
        assert!(error.contains("-ot Float32"), "{error}");
    }
    // Pictures.
    let pictures =
        Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("tests/data/rasters");
    for (name, word) in [
        ("palette.tif", "a palette"),
        ("alpha.tif", "red, green and blue"),
    ] {
        let error = heights(&pictures.join(name)).err().unwrap();
        assert!(
            error.contains(word) && error.contains("--orthophoto"),
            "{error}"
        );
    }
    // Control points that lie crooked, and on one line; a matrix that tilts; a picture from space.
    let folder = tempfile::tempdir().unwrap();
    let placed = |placing: Vec<Tag>| {
        let mut tags = plain(SIZE);
        tags.push(keys(&[]));
        tags.extend(placing);
        heights(&kept(
            folder.path(),
            "dem.tif",
            &tiff(tags, &pixels(&ground_m())),
        ))
        .err()
        .unwrap()
    };
    let ties = |points: &[[f64; 4]]| {
        let all: Vec<f64> = points
            .iter()
            .flat_map(|[i, j, x, y]| [*i, *j, 0.0, *x, *y, 0.0])
            .collect();
        vec![doubles(33_922, &all)]
    };
    let crooked = placed(ties(&[
        [0.0, 0.0, 0.0, 50.0],
        [6.0, 0.0, 60.0, 50.0],
        [0.0, 5.0, 0.0, 0.0],
        [6.0, 5.0, 90.0, 20.0],
    ]));
    assert!(
        crooked.contains("4 tie points lie on no straight map") && crooked.contains("gdalwarp"),
        "{crooked}"
    );
    let line = placed(ties(&[
        [0.0, 0.0, 0.0, 50.0],
        [3.0, 0.0, 30.0, 50.0],
        [6.0, 0.0, 60.0, 50.0],
    ]));
    assert!(line.contains("one line"), "{line}");
    let one = placed(ties(&[[0.0, 0.0, 0.0, 50.0]]));
    assert!(one.contains("1 tie points without a pixel scale"), "{one}");
    let mut tilted = [0.0; 16];
    (tilted[0], tilted[5], tilted[8], tilted[15]) = (10.0, -10.0, 0.5, 1.0);
    assert!(placed(vec![doubles(34_264, &tilted)]).contains("tilts"));
    assert!(placed(vec![doubles(50_844, &[0.0; 92])]).contains("RPC"));
}

#[test]
fn what_is_assumed_or_left_out_is_noted() {
    // Nothing but what the heights are over is assumed of a plain file, and nothing where its keys say that.
    let (_, notes) = with(vec![], &[]).unwrap();
    assert!(
        notes.len() == 1 && notes[0].contains("EPSG:2056+geoid"),
        "{notes:?}"
    );
    assert_eq!(
        with(vec![], &[[4096, 5728]]).unwrap().1,
        Vec::<String>::new()
    );
    // LN02 and the vertical code of WGS 84's ellipsoid in GeoTIFF 1.0.
    let (found, notes) = with(vec![], &[[4096, 5030]]).unwrap();
    let there = found
        .crs
        .to_geodetic(found.center(0, 0).extend(400.0))
        .unwrap();
    assert!(notes.is_empty() && there.height_m == 400.0, "{notes:?}");
    // NAVD88's old code without a unit, and with US feet.
    let (found, notes) = with(vec![], &[[4096, 5103]]).unwrap();
    assert!(
        notes.len() == 1 && notes[0].contains("VerticalUnits") && first_m(&found) == 400.0,
        "{notes:?}"
    );
    let (found, notes) = with(vec![], &[[4096, 5103], [4099, 9003]]).unwrap();
    assert!(
        (first_m(&found) - 400.0 * US_FOOT_M).abs() < 1e-9,
        "{notes:?}"
    );
    // A unit type against the key's unit.
    let (found, notes) = with(vec![items(&[("unittype", "ft")])], &[[4096, 5703]]).unwrap();
    assert!(
        notes.iter().any(|note| note.contains("unit type"))
            && (first_m(&found) - 121.92).abs() < 1e-9,
        "{notes:?}"
    );
    let noted = |tags: Vec<Tag>, more: &[[u16; 2]], word: &str| {
        let (_, notes) = with(tags, more).unwrap();
        assert!(
            notes.iter().any(|note| note.contains(word)),
            "{word}: {notes:?}"
        );
    };
    noted(vec![shorts(274, &[4])], &[], "Orientation");
    noted(vec![text(42_113, "none")], &[], "GDAL_NODATA");
    noted(vec![text(42_112, "<GDALMetadata><Item")], &[], "no XML");
    noted(
        vec![text(
            42_112,
            "<GDALMetadata><Item name=\"z#scale_factor\">0.5</Item></GDALMetadata>",
        )],
        &[],
        "z#scale_factor",
    );
    noted(
        vec![doubles(
            33_922,
            &[0.0, 0.0, 0.0, CORNER[0], CORNER[1], 100.0],
        )],
        &[],
        "third scale",
    );
    // Metadata that say nothing of values are not noted.
    let harmless = "<GDALMetadata><Item name=\"AREA_OR_POINT\">Area</Item><Item name=\"STATISTICS_MEAN\" sample=\"0\">3</Item>\
        <Item name=\"units\">m</Item></GDALMetadata>";
    assert_eq!(
        with(vec![text(42_112, harmless)], &[[4096, 5728]])
            .unwrap()
            .1,
        Vec::<String>::new()
    );
    // East and north in US survey feet, though the code is in metres.
    let (found, notes) = with(vec![], &[[3072, 26_910], [3076, 9003]]).unwrap();
    let want = CORNER[0] * US_FOOT_M + STEP * US_FOOT_M / 2.0;
    assert!(
        (found.center(0, 0).x - want).abs() < 1e-6,
        "{}",
        found.center(0, 0)
    );
    assert!(
        notes.iter().any(|note| note.contains("unit of the map")),
        "{notes:?}"
    );
    // A height that no place has.
    let folder = tempfile::tempdir().unwrap();
    let mut values = ground_m();
    (values[3], values[4]) = (-32_768.0, 65_535.0);
    let mut tags = plain(SIZE);
    tags.extend(lying(Lying::Scale, [0.0, 0.0]).0);
    tags.push(keys(&[]));
    let path = kept(
        folder.path(),
        "dem.tif",
        &tiff(tags.clone(), &pixels(&values)),
    );
    let (found, notes) = heights(&path).unwrap();
    assert!(
        found.at(3, 0).is_none() && notes.iter().any(|note| note.contains("2 pixels")),
        "{notes:?}"
    );
    // A world file that says otherwise; pictures behind the first.
    std::fs::write(
        folder.path().join("dem.tfw"),
        "10\n0\n0\n-10\n600005\n200005\n",
    )
    .unwrap();
    assert!(
        heights(&path)
            .unwrap()
            .1
            .iter()
            .any(|note| note.contains("world file"))
    );
    let second = (plain(SIZE), pixels(&values));
    let path = kept(
        folder.path(),
        "two.tif",
        &pages(vec![(tags, pixels(&values)), second]),
    );
    assert!(
        heights(&path)
            .unwrap()
            .1
            .iter()
            .any(|note| note.contains("1 pictures behind the first"))
    );
}

#[test]
fn values_for_none_in_odd_forms_leave_the_heights() {
    let holes = |found: &Heights| (0..SIZE[0]).filter(|k| found.at(*k, 0).is_none()).count();
    for none in ["-inf", "inf", "nan", "-3.4028234663852886e+38", "-1e400"] {
        let (found, _) = with(vec![text(42_113, none)], &[]).unwrap();
        assert_eq!(holes(&found), 0, "{none}");
    }
    let folder = tempfile::tempdir().unwrap();
    let mut values = ground_m();
    values[2] = -9999.0;
    let mut tags = plain(SIZE);
    tags.extend(lying(Lying::Scale, [0.0, 0.0]).0);
    tags.push(keys(&[]));
    let path = kept(
        folder.path(),
        "a.tif",
        &tiff(tags.clone(), &pixels(&values)),
    );
    let (found, notes) = heights(&path).unwrap();
    assert_eq!(holes(&found), 1);
    assert!(
        notes
            .iter()
            .any(|note| note.contains("1 pixels hold -9999")),
        "{notes:?}"
    );
    tags.push(text(42_113, "7"));
    let path = kept(folder.path(), "b.tif", &tiff(tags, &pixels(&values)));
    assert_eq!(heights(&path).unwrap().0.at(2, 0), Some(-9999.0));
    let scale = vec![doubles(33_550, &[STEP, STEP, f64::NAN])];
    let (found, notes) = with(scale, &[]).unwrap();
    assert_eq!(holes(&found), 0);
    assert!(
        notes.iter().any(|note| note.contains("are no numbers")),
        "{notes:?}"
    );
}

#[test]
fn world_files_in_odd_forms_place_a_raster_or_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut tags = plain(SIZE);
    tags.push(keys(&[]));
    let path = kept(folder.path(), "dem.tif", &tiff(tags, &pixels(&ground_m())));
    let world = folder.path().join("dem.tfw");
    for text in [
        "10\n0\n0\n-10\n2600005\n1200005\n",
        "\u{feff} 10,0 0 0 -10,0\r\n2600005,0 1200005,0",
        "1.0D+01\n0.0D+00\n0.0D+00\n-1.0D+01\n2.600005D+06\n1.200005D+06\n",
    ] {
        std::fs::write(&world, text).unwrap();
        let (found, _) = heights(&path).unwrap();
        assert!(
            found
                .center(0, 0)
                .distance(DVec2::new(2_600_005.0, 1_200_005.0))
                < 1e-6,
            "{text}"
        );
    }
    std::fs::write(&world, "10\n0\nnorth\n").unwrap();
    let error = heights(&path).err().unwrap();
    assert!(
        error.contains("dem.tfw does not begin with six numbers"),
        "{error}"
    );
}

#[test]
fn high_ground_in_feet_is_no_gap() {
    let folder = tempfile::tempdir().unwrap();
    let high_m: Vec<f64> = ground_m().iter().map(|h| h + 3800.0).collect();
    let path = written(
        folder.path(),
        &high_m,
        Lying::Scale,
        By::Items,
        [1.0, 0.0],
        Unit::Word("ft", 0.3048),
    );
    let (found, _) = heights(&path).unwrap();
    assert!((first_m(&found) - 4200.0).abs() < 1e-3);
}

#[test]
fn masks_and_alpha_make_holes() {
    let folder = tempfile::tempdir().unwrap();
    let mut tags = plain(SIZE);
    tags.extend(lying(Lying::Scale, [0.0, 0.0]).0);
    tags.push(keys(&[]));
    let hole = |path: &Path| {
        let (found, _) = heights(path).unwrap();
        let missing: Vec<usize> = (0..30)
            .filter(|k| found.at(k % 6, k / 6).is_none())
            .collect();
        assert_eq!(missing, [8], "{}", path.display());
    };
    // A second picture of one bit: all but column 2 of row 1.
    let mask = vec![
        longs(254, &[4]),
        shorts(256, &[6]),
        shorts(257, &[5]),
        shorts(258, &[1]),
        shorts(259, &[1]),
        shorts(262, &[4]),
        shorts(277, &[1]),
        shorts(278, &[5]),
    ];
    let bits = vec![0xfc, 0xdc, 0xfc, 0xfc, 0xfc];
    let inside = pages(vec![
        (tags.clone(), pixels(&ground_m())),
        (mask.clone(), bits),
    ]);
    hole(&kept(folder.path(), "inside.tif", &inside));
    // A mask beside it.
    let path = kept(
        folder.path(),
        "beside.tif",
        &tiff(tags.clone(), &pixels(&ground_m())),
    );
    let mut beside = plain(SIZE);
    beside.retain(|tag| ![258, 339].contains(&tag.0));
    beside.push(shorts(258, &[8]));
    let mut shown = vec![255; 30];
    shown[8] = 0;
    kept(
        folder.path(),
        "beside.tif.msk",
        &tiff(beside.clone(), &shown),
    );
    hole(&path);
    // A mask of another size.
    beside.retain(|tag| tag.0 != 257);
    beside.push(shorts(257, &[4]));
    kept(folder.path(), "beside.tif.msk", &tiff(beside, &shown));
    assert!(heights(&path).err().unwrap().contains(".msk"));
    // A second band that is alpha.
    let mut two = tags;
    two.retain(|tag| tag.0 != 277);
    two.extend([shorts(277, &[2]), shorts(338, &[2])]);
    let values: Vec<f64> = ground_m()
        .iter()
        .enumerate()
        .flat_map(|(k, h)| [*h, if k == 8 { 0.0 } else { 255.0 }])
        .collect();
    hole(&kept(
        folder.path(),
        "alpha.tif",
        &tiff(two, &pixels(&values)),
    ));
}

#[test]
fn rasters_across_the_antimeridian_and_of_0_to_360_degrees_are_one_ground() {
    let folder = tempfile::tempdir().unwrap();
    let degrees = |west: f64, north: f64, step: f64, size: [usize; 2]| {
        let mut tags = plain(size);
        tags.push(doubles(33_550, &[step, step, 0.0]));
        tags.push(doubles(33_922, &[0.0, 0.0, 0.0, west, north, 0.0]));
        tags.push(keys(&[[1024, 2], [2048, 4979], [3072, u16::MAX]]));
        tags
    };
    let at = |ground: &Ground, longitude_deg: f64, latitude_deg: f64| {
        ground.height_m(Geodetic {
            latitude_rad: latitude_deg.to_radians(),
            longitude_rad: longitude_deg.to_radians(),
            height_m: 0.0,
        })
    };
    // Round the Earth in steps of 10°, from 0°: heights of a degree each.
    let around: Vec<f64> = (0..36 * 18)
        .map(|k| f64::from(k % 36) * 10.0 + 5.0)
        .collect();
    let path = kept(
        folder.path(),
        "around.tif",
        &tiff(degrees(0.0, 90.0, 10.0, [36, 18]), &pixels(&around)),
    );
    let ground = Ground::read(&path, &Options::default()).unwrap();
    for (longitude_deg, want_m) in [
        (8.0, 8.0),
        (-172.0, 188.0),
        (-8.0, 352.0),
        (352.0, 352.0),
        (180.0, 180.0),
        (-180.0, 180.0),
    ] {
        let found_m = at(&ground, longitude_deg, 3.0).unwrap();
        assert!(
            (found_m - want_m).abs() < 1e-3,
            "{longitude_deg}: {found_m}"
        );
    }
    // Between the last column and the first.
    assert!((at(&ground, 0.0, 3.0).unwrap() - 180.0).abs() < 1e-3);
    // Two tiles of a folder that meet at 180°, and one raster that is written beyond it.
    let tiles = folder.path().join("tiles");
    std::fs::create_dir(&tiles).unwrap();
    let flat = pixels(&[7.0; 16]);
    kept(
        &tiles,
        "e.tif",
        &tiff(degrees(179.996, -16.0, 0.001, [4, 4]), &flat),
    );
    kept(
        &tiles,
        "w.tif",
        &tiff(degrees(-180.0, -16.0, 0.001, [4, 4]), &flat),
    );
    let layer = read(&tiles, &Options::default()).unwrap();
    let far_m = (layer.meshes.iter())
        .flat_map(|mesh| (0..mesh.positions.len() as u32).map(|k| mesh.vertex_m(k).length()))
        .fold(0.0, f64::max);
    assert!(far_m < 1000.0, "{far_m}");
    let path = kept(
        folder.path(),
        "beyond.tif",
        &tiff(degrees(179.998, -16.0, 0.001, [4, 4]), &flat),
    );
    let ground = Ground::read(&path, &Options::default()).unwrap();
    for longitude_deg in [179.999, -179.999, 180.0] {
        assert!((at(&ground, longitude_deg, -16.002).unwrap() - 7.0).abs() < 1e-3);
    }
}

#[test]
fn a_picture_has_no_colour_where_its_value_for_none_stands() {
    let folder = tempfile::tempdir().unwrap();
    let mut tags = plain([4, 2]);
    tags.retain(|tag| ![258, 262, 277, 339].contains(&tag.0));
    tags.extend([
        shorts(258, &[8, 8, 8]),
        shorts(262, &[2]),
        shorts(277, &[3]),
        text(42_113, "0"),
    ]);
    tags.push(doubles(33_550, &[STEP, STEP, 0.0]));
    tags.push(doubles(33_922, &[0.0, 0.0, 0.0, CORNER[0], CORNER[1], 0.0]));
    let mut colours = vec![9; 24];
    colours[..3].fill(0);
    colours[3] = 0;
    let path = kept(folder.path(), "photo.tif", &tiff(tags, &colours));
    let photo = Orthophoto::read(&path, &mut Notes::default()).unwrap();
    assert_eq!(photo.at(0, 0).unwrap()[3], 0);
    assert_eq!(photo.at(1, 0).unwrap(), [0, 9, 9, 255]);
}

#[test]
fn the_terrain_under_footprints_names_its_own_option() {
    let folder = tempfile::tempdir().unwrap();
    let mut tags = plain(SIZE);
    tags.extend(lying(Lying::Scale, [0.0, 0.0]).0);
    let nameless = kept(
        folder.path(),
        "dem.tif",
        &tiff(tags.clone(), &pixels(&ground_m())),
    );
    let error = Ground::read(&nameless, &Options::default())
        .err()
        .unwrap()
        .to_string();
    assert!(error.contains("--terrain-crs"), "{error}");
    tags.push(keys(&[]));
    let path = kept(folder.path(), "dem.tif", &tiff(tags, &pixels(&ground_m())));
    let ground = Ground::read(&path, &Options::default()).unwrap();
    assert!(
        ground.warnings[0]
            .mend
            .contains("--terrain-crs EPSG:2056+ellipsoid"),
        "{:?}",
        ground.warnings
    );
}
