//! Sets as people have them.

use super::content::RawPicture;
use super::*;
use crate::media::image::encode_jpeg;
use image::{ImageFormat, Rgb};
use proptest::prelude::*;
use std::io::Cursor;

const GOOD: &str = r#"{"images": [
        {"id": 4, "file_name": "b.png", "width": 3, "height": 2},
        {"id": 2, "file_name": "a.jpg", "width": 16, "height": 8}],
    "annotations": [
        {"id": 1, "image_id": 4, "category_id": 1, "bbox": [1, 0, 2, 1], "tight": true},
        {"id": 2, "image_id": 4, "category_id": 1, "bbox": [0, 0, 2, 1], "area": 1.5, "iscrowd": 1},
        {"id": 3, "image_id": 2, "category_id": 1, "bbox": [0, 0, 2, 1], "tight": false},
        {"id": 4, "image_id": 2, "category_id": 2, "bbox": [0, 0, 2, 1]}],
    "categories": [{"id": 1, "name": "Drone"}, {"id": 2, "name": "bird"}]}"#;

fn write(folder: &Path, name: &str, bytes: &[u8]) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
    std::fs::write(path, bytes).expect("written");
}

/// A PNG file of 3 × 2 px.
fn png() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let picture = RgbImage::from_fn(3, 2, |_, y| Rgb(if y == 0 { [9, 8, 7] } else { [1, 2, 3] }));
    (picture.write_to(&mut bytes, ImageFormat::Png)).expect("a PNG");
    bytes.into_inner()
}

#[test]
fn layouts_and_flags_are_read() {
    let jpeg = encode_jpeg(&[200; 16 * 8 * 3], 16, 8, 90).expect("a JPEG");
    for (file, folder) in [
        ("annotations.json", "."),
        ("labels.json", "images"),
        ("annotations/instances_val.json", "images/val"),
        ("annotations/instances_val.json", "val"),
        ("annotations.json", "frames"),
    ] {
        let root = tempfile::tempdir().expect("a folder");
        write(root.path(), file, GOOD.as_bytes());
        write(root.path(), &format!("{folder}/b.png"), &png());
        write(root.path(), &format!("{folder}/a.jpg"), &jpeg);
        let coco = Coco::load(root.path(), &[]).expect("a set");
        assert_eq!(
            coco.categories,
            BTreeMap::from([(Id::Number(1), "Drone".to_string())])
        );
        let files: Vec<_> = coco.pictures.iter().map(|p| p.file_name.as_str()).collect();
        assert_eq!(files, ["a.jpg", "b.png"], "in the order of the ids");
        let ignored: Vec<Vec<bool>> = (coco.truth.iter())
            .map(|truth| truth.iter().map(|t| t.ignored).collect())
            .collect();
        assert_eq!(ignored, [vec![true], vec![false, true]]);
        assert_eq!(coco.truth[1][0].box_px, [1.0, 0.0, 3.0, 1.0]);
        assert_eq!(coco.truth[1][1].area_px2, 1.5);
        let image = coco.image(&coco.pictures[1]).expect("a picture");
        assert_eq!(image.dimensions(), (3, 2));
        assert_eq!((image[(0, 0)].0, image[(2, 1)].0), ([9, 8, 7], [1, 2, 3]));
        let grey = coco.image(&coco.pictures[0]).expect("a picture");
        assert!(grey.as_raw().iter().all(|&c| c.abs_diff(200) < 4));
    }
}

#[test]
fn pictures_of_one_clip_share_its_name() {
    let clip = |file: &str, scene: &str| {
        let text = format!(
            r#"{{"id": 1, "file_name": "{file}", "width": 1, "height": 1, "scene": {scene}}}"#
        );
        let picture: RawPicture = serde_json::from_str(&text).expect("a picture");
        let picture = picture.checked().expect("a picture");
        picture.clip().to_string()
    };
    assert_eq!(clip("V_DRONE_001_0015.jpg", "null"), "V_DRONE_001");
    assert_eq!(clip("a/img1/000001.png", "null"), "a/img1/");
    assert_eq!(clip("000001.png", "null"), "000001.png");
    assert_eq!(clip("x_1.png", "17"), "17");
    assert_eq!(clip("x_1.png", "\"s3\""), "s3");
}

#[test]
fn errors_name_the_place_and_the_mend() {
    let told = |text: &str| {
        Content::parse(text)
            .err()
            .map_or_else(String::new, |e| e.to_string())
    };
    for (from, to, expected) in [
        (
            "\"id\": 4, \"file",
            "\"id\": 2, \"file",
            "images[1].id: 2 is given twice",
        ),
        (
            "\"id\": 2, \"name",
            "\"id\": 1, \"name",
            "categories[1].id: 1 is given twice, to Drone and bird",
        ),
        ("\"images\"", "\"pictures\"", "missing field `images`"),
        (
            "\"image_id\"",
            "\"image\"",
            "annotations[0].image_id: null is no id",
        ),
    ] {
        let text = GOOD.replace(from, to);
        assert_ne!(text, GOOD, "{from}");
        assert!(told(&text).contains(expected), "{to}: {}", told(&text));
    }
    let root = tempfile::tempdir().expect("a folder");
    let failed = |names: &[&str]| {
        let names: Vec<String> = names.iter().map(ToString::to_string).collect();
        Coco::load(root.path(), &names)
            .expect_err("refused")
            .to_string()
    };
    assert!(
        failed(&[]).contains("no annotation file"),
        "{}",
        failed(&[])
    );
    write(root.path(), "a.json", GOOD.as_bytes());
    assert!(failed(&["kite"]).contains("no 'kite' among Drone, bird"));
    let coco = Coco::load(root.path(), &["bird".into()]).expect("a set");
    assert_eq!(coco.truth[0].len(), 1);
    assert!(
        coco.image(&coco.pictures[0])
            .expect_err("none")
            .to_string()
            .contains("a.jpg: not found")
    );
    write(root.path(), "a.jpg", &png());
    let why = coco
        .image(&coco.pictures[0])
        .expect_err("another size")
        .to_string();
    assert!(why.contains("3 × 2 px, but"), "{why}");
    write(root.path(), "a.jpg", b"no picture");
    assert!(coco.image(&coco.pictures[0]).is_err());
    write(
        root.path(),
        "a.json",
        GOOD.replace("Drone", "kite").as_bytes(),
    );
    assert!(failed(&[]).contains("--category"), "{}", failed(&[]));
    write(root.path(), "b.json", b"{}");
    assert!(failed(&[]).contains("2 .json files"), "{}", failed(&[]));
}

/// What a content's notes say.
fn noted(content: &Content) -> String {
    let warnings = content.notes.clone().warnings(Path::new("a.json"));
    let lines: Vec<_> = warnings.iter().map(ToString::to_string).collect();
    lines.join("\n")
}

#[test]
fn boxes_without_height_are_left_out_and_counted() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/odd/coco-zero-boxes");
    if !folder.exists() {
        println!("skipped: {} is absent", folder.display());
        return;
    }
    let coco = Coco::load(&folder, &[]).expect("a set");
    let boxes: Vec<usize> = coco.truth.iter().map(Vec::len).collect();
    assert_eq!(boxes, [1, 1, 1, 1]);
    let said: Vec<_> = coco.warnings().iter().map(ToString::to_string).collect();
    assert_eq!(said.len(), 1);
    let want = "2 boxes without width or height (first annotations[4].bbox";
    assert!(said[0].contains(want), "{said:?}");
}

#[test]
fn one_odd_entry_does_not_cost_the_set() {
    let text = r#"{"images": [
        {"id": "b7", "file_name": "b.png", "width": 3, "height": 2, "license": null},
        {"id": 2.0, "file_name": "a.jpg", "width": "16", "height": 8, "scene": null},
        {"id": 2, "file_name": "a.jpg", "width": 16, "height": 8},
        {"id": 3, "file_name": null}, {"file_name": "c.png"}, null],
    "annotations": [
        {"image_id": "b7", "category_id": 1, "bbox": [1, 0, 2, 1], "area": NaN, "iscrowd": null},
        {"image_id": "2", "category_id": "1", "bbox": ["0", 0.5, 2, 1], "area": null, "iscrowd": 1.0},
        {"image_id": 2, "category_id": 1, "bbox": null, "segmentation": [[1, 2, 5, 2, 5, 6], [0, 3, 1, 3, 1, 4]]},
        {"image_id": 2, "category_id": 1, "bbox": [], "segmentation": {"counts": "abc", "size": [8, 16]}},
        {"image_id": 2, "category_id": 1, "bbox": [0, 0, 4, 2], "segmentation": {"counts": [3, 4], "size": [8, 16]}, "area": -1},
        {"image_id": 2, "category_id": 1, "bbox": [0, 0, -4, 2]},
        {"image_id": 2, "category_id": 1, "bbox": [0, 0, "wide", 2]},
        {"image_id": 9, "category_id": 1, "bbox": [0, 0, 4, 2]},
        {"image_id": 2, "category_id": 9, "bbox": [0, 0, 4, 2]},
        {"image_id": 2, "category_id": 1, "bbox": [0, 0, 4, 2], "tight": false},
        7],
    "categories": [{"id": 1, "name": "a \"NaN\" Drone", "supercategory": null}, {"id": 2, "name": null}, {"name": "x"}],
    "info": null}"#;
    let content = Content::parse(&format!("\u{feff}{text}")).expect("a set");
    let ids: Vec<_> = (content.pictures.iter())
        .map(|picture| picture.id.clone())
        .collect();
    assert_eq!(ids, [Id::Number(2), Id::Text("b7".into())]);
    assert_eq!(content.categories[0].name, "a \"NaN\" Drone");
    let of =
        |k: usize| -> Vec<Truth> { content.boxes[k].iter().map(|(_, truth)| *truth).collect() };
    let truth = |box_px: [f64; 4], area_px2, ignored| Truth {
        box_px,
        area_px2,
        ignored,
    };
    assert_eq!(of(1), [truth([1.0, 0.0, 3.0, 1.0], 2.0, false)]);
    let want = [
        truth([0.0, 0.5, 2.0, 1.5], 2.0, true),
        truth([0.0, 2.0, 5.0, 6.0], 20.0, false),
        truth([0.0, 0.0, 4.0, 2.0], 8.0, false),
        truth([0.0, 0.0, 4.0, 2.0], 8.0, true),
    ];
    assert_eq!(of(0), want);
    let said = noted(&content);
    for part in [
        "1 images that are given twice (images[2])",
        "1 images without a file name (images[3])",
        "1 images without an id (images[4])",
        "2 entries that are no objects (first images[5])",
        "1 annotations without a box (annotations[3].bbox: absent)",
        "1 boxes without width or height (annotations[5].bbox",
        "1 boxes that are no four numbers (annotations[6].bbox",
        "1 annotations of images that are not there (annotations[7].image_id: 9",
        "1 annotations of categories that are not there (annotations[8].category_id: 9",
        "1 categories without an id",
        "1 areas that are no numbers from 0",
        "annotations without a box get the one about their polygons",
    ] {
        assert!(said.contains(part), "{part}: {said}");
    }
}

#[test]
fn sizes_come_from_pictures_and_absent_ones_are_left_out() {
    let root = tempfile::tempdir().expect("a folder");
    let text = GOOD.replace("\"width\": 3, \"height\": 2", "\"width\": null");
    write(root.path(), "annotations.json", text.as_bytes());
    write(root.path(), "b.png", &png());
    let mut coco = Coco::load(root.path(), &[]).expect("a set");
    assert_eq!(coco.pictures[1].size_px(), [3, 2]);
    coco.leave_out_absent();
    assert_eq!((coco.pictures.len(), coco.truth.len()), (1, 1));
    let said = coco.warnings()[0].to_string();
    assert!(said.contains("1 images without a file (a.jpg)"), "{said}");
}

proptest! {
    /// Any text is read or refused; so is a good file with a piece put in anywhere.
    #[test]
    fn any_text_is_read_or_refused(text in ".*", at in 0..GOOD.len(), cut in 0..40_usize) {
        let _ = Content::parse(&text);
        let end = (at + cut).min(GOOD.len());
        let spoiled = format!("{}{text}{}", &GOOD[..at], &GOOD[end..]);
        let _ = Content::parse(&spoiled);
        let _ = Content::parse(&format!("{}{}", &GOOD[..at], &GOOD[end..]));
    }
}

#[test]
fn boxes_beyond_their_pictures_are_left_out_or_noted_and_whole_paths_are_found() {
    let root = tempfile::tempdir().expect("a folder");
    let text = r#"{"images": [{"id": 1, "file_name": "C:\\work\\b.png", "width": 640, "height": 480}],
        "annotations": [
            {"id": 1, "image_id": 1, "category_id": 1, "bbox": [10, 10, 20, 20]},
            {"id": 2, "image_id": 1, "category_id": 1, "bbox": [700, 10, 20, 20]},
            {"id": 3, "image_id": 1, "category_id": 1, "bbox": [600, 400, 630, 420]},
            {"id": 4, "image_id": 1, "category_id": 2, "bbox": [-50, 0, 20, 20]},
            {"id": 5, "image_id": 1, "category_id": 3, "bbox": [5, 5, 9, 9]}],
        "categories": [{"id": 1, "name": "drone"}, {"id": 2, "name": "bird"}, {"id": 3, "name": "bird"}]}"#;
    write(root.path(), "annotations.json", text.as_bytes());
    write(root.path(), "images/b.png", &png());
    let coco = Coco::load(root.path(), &[]).expect("a set");
    let boxes: Vec<_> = coco.truth[0].iter().map(|truth| truth.box_px[0]).collect();
    assert_eq!(boxes, [10.0, 600.0]);
    assert_eq!(coco.category[0].len(), 2);
    // Of two categories of one name neither is lost.
    let others: Vec<_> = coco.others[0].iter().map(|other| other.box_px[0]).collect();
    assert_eq!(others, [5.0]);
    let said: String = coco.warnings().iter().map(ToString::to_string).collect();
    assert!(said.contains("2 boxes outside their pictures"), "{said}");
    assert!(said.contains("1 reach beyond their pictures"), "{said}");
    assert!(
        coco.path(&coco.pictures[0])
            .expect("a file")
            .ends_with("images/b.png")
    );
}
