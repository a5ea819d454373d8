use super::play::SHEET;
use super::truth::{FrameTruth, parse_boxes};
use super::*;
use crate::eval::detector::metrics::{AnnotatedImage, Truth};
use crate::media::image::encode_jpeg;
use crate::models::optics::detection::Detection;
use image::RgbImage;
use proptest::prelude::*;
use std::num::NonZeroUsize;

const GOOD: &str = r#"[{"file": "a.mp4", "frames": 3, "boxes_xywh":
        [{"drone": [[10, 20, 4, 6]], "bird": [[1, 1, 2, 2]]}, {}, {"Drone": []}]},
        {"file": "b.mp4", "frames": 1, "boxes_xywh": [{"airplane": [[0.5, 0, 2, 1]]}]}]"#;

#[test]
fn boxes_are_read_by_label() {
    let clips = parse_boxes(GOOD, &[]).unwrap();
    assert_eq!((clips.len(), clips[0].frames.len()), (2, 3));
    let [first, rest @ ..] = &clips[0].frames[..] else {
        panic!("no frames");
    };
    assert_eq!(first.uavs[0].box_px, [10.0, 20.0, 14.0, 26.0]);
    assert_eq!(first.others, [[1.0, 1.0, 3.0, 3.0]]);
    assert_eq!(Vec::from_iter(&first.labels), ["bird", "drone"]);
    assert!(rest.iter().all(|frame| *frame == FrameTruth::default()));
    assert_eq!(clips[1].frames[0].others, [[0.5, 0.0, 2.5, 1.0]]);
    let birds = parse_boxes(GOOD, &["bird".into()]).unwrap();
    assert_eq!(birds[0].frames[0].others, [[10.0, 20.0, 14.0, 26.0]]);
}

#[test]
fn bad_boxes_are_told() {
    for (from, to, expected) in [
        (
            "\"frames\": 3",
            "\"frames\": 4",
            "has 3 entries, frames says 4",
        ),
        ("b.mp4", "a.mp4", "listed twice"),
        ("4, 6]", "0, 6]", "frame 0: the box [10, 20, 0, 6]"),
        ("airplane", "thing", "'thing' is a UAV is not clear"),
        ("\"frames\": 1,", "", "missing field `frames`"),
        ("[0.5, 0, 2, 1]", "[0.5, 0, 2]", "expected a list of"),
    ] {
        let text = GOOD.replace(from, to);
        assert_ne!(text, GOOD, "{from}");
        let message = parse_boxes(&text, &[]).unwrap_err().to_string();
        assert!(message.contains(expected), "{expected}: {message}");
    }
}

proptest! {
    /// Any text is read or refused; so is a good file with a piece put in anywhere.
    #[test]
    fn any_boxes_are_read_or_refused(text in ".*", at in 0..GOOD.len(), cut in 0..40_usize) {
        let _ = parse_boxes(&text, &[]);
        let end = (at + cut).min(GOOD.len());
        let _ = parse_boxes(&format!("{}{text}{}", &GOOD[..at], &GOOD[end..]), &[]);
    }

    /// What is written is read back.
    #[test]
    fn boxes_are_read_as_written(
        boxes in prop::collection::vec(
            prop::collection::vec(
                (0.0..900.0, 0.0..900.0, 0.1..200.0, 0.1..200.0, any::<bool>()),
                0..4,
            ),
            0..20,
        ),
    ) {
        let frames: Vec<serde_json::Value> = boxes.iter().map(|boxes| {
            let of = |uav: bool| -> Vec<[f64; 4]> {
                boxes.iter().filter(|b| b.4 == uav).map(|b| [b.0, b.1, b.2, b.3]).collect()
            };
            serde_json::json!({"uav": of(true), "helicopter": of(false)})
        }).collect();
        let text = serde_json::json!(
            [{"file": "x", "frames": frames.len(), "boxes_xywh": frames}]
        ).to_string();
        let clips = parse_boxes(&text, &[]).unwrap();
        for (frame, boxes) in clips[0].frames.iter().zip(&boxes) {
            let mut others = frame.others.iter();
            let mut uavs = frame.uavs.iter().map(|truth| &truth.box_px);
            for (x, y, w, h, uav) in boxes {
                let found = if *uav { uavs.next() } else { others.next() };
                // JSON's decimals are read to within the last bit.
                let near = found.is_some_and(|found| {
                    let expected = [*x, *y, x + w, y + h];
                    found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9)
                });
                prop_assert!(near, "{:?}", found);
            }
        }
    }
}

#[test]
fn folders_of_clips_have_names_of_their_own() {
    let files = ["x/a.mp4", "y/a.mov", "b", "x/.."].map(PathBuf::from);
    let names = folder_names(&files);
    assert_eq!(names[..3], ["a", "a-2", "b"]);
    assert!(!names[3].is_empty());
}

#[test]
fn pictures_find_their_own_boxes_whatever_other_folders_call_theirs() {
    let root = tempfile::tempdir().expect("a folder");
    let jpeg = encode_jpeg(&[90; 3 * 40 * 30], 40, 30, 90).expect("a picture");
    for folder in ["a", "b"] {
        let folder = root.path().join(folder);
        std::fs::create_dir(&folder).expect("made");
        std::fs::write(folder.join("0001.jpg"), &jpeg).expect("written");
    }
    let text = serde_json::json!({
        "images": [{"id": 1, "file_name": "0001.jpg", "width": 40, "height": 30}],
        "annotations": [{"image_id": 1, "category_id": 1, "bbox": [3, 4, 5, 6]}],
        "categories": [{"id": 1, "name": "drone"}],
    });
    let boxes = root.path().join("b/boxes.json");
    std::fs::write(&boxes, text.to_string()).expect("written");
    let truth = BoxFile::load(&boxes, &[]).expect("boxes");
    let clip = |folder: &str| {
        let path = root.path().join(folder);
        let clip = Clip::open(&path, 30.0).expect("a clip");
        (path, clip)
    };
    let (path, other) = clip("a");
    let error = truth.check(&path, &other).expect_err("refused").to_string();
    assert!(error.contains("a/0001.jpg"), "{error}");
    let (path, mut own) = clip("b");
    truth.check(&path, &own).expect("its own");
    let mut frame = own.next_frame().expect("read").expect("a frame");
    let found = truth.of(&path, 0, &frame).expect("boxes");
    assert_eq!(found.uavs[0].box_px, [3.0, 4.0, 8.0, 10.0]);
    // Of another size than the annotations say.
    frame.picture = RgbImage::new(41, 30);
    let error = truth.of(&path, 0, &frame).expect_err("refused").to_string();
    assert!(error.contains("41 × 30"), "{error}");
}

/// Truth in both boxes of the first frame, one detection in each of two places.
#[test]
fn hits_and_false_alarms_are_counted_by_the_centre() {
    let truth = |box_px: [f64; 4]| Truth {
        box_px,
        area_px2: 100.0,
        ignored: false,
    };
    let found =
        |x: f64, y: f64, score: f64| Detection::new([x - 2.0, y - 2.0, x + 2.0, y + 2.0], score, 0);
    let images = [
        AnnotatedImage {
            truth: vec![
                truth([0.0, 0.0, 10.0, 10.0]),
                truth([50.0, 50.0, 60.0, 60.0]),
            ],
            // A hit 3 px off, a second one in the same box, one beside.
            found: vec![
                found(8.0, 5.0, 0.9),
                found(5.0, 5.0, 0.8),
                found(30.0, 5.0, 0.7),
            ],
        },
        AnnotatedImage {
            truth: Vec::new(),
            found: vec![found(1.0, 1.0, 0.6)],
        },
    ];
    let mut tally = Tally {
        known: true,
        frames: 2,
        ..Tally::default()
    };
    let series = tally.judge(&images, &vec![(0.0, 0.0), (0.1, 0.0)]);
    let figures = tally.figures();
    assert_eq!(figures.recall, Some(0.5));
    assert_eq!(
        (figures.false_alarms, figures.duplicates),
        (Some(2), Some(1))
    );
    assert_eq!(figures.false_alarms_per_frame, Some(1.0));
    let centre = images[0].truth[0].centre_px();
    assert_eq!(centre, [5.0, 5.0]);
    // The most confident takes the box, though another is nearer.
    assert_eq!(figures.miss_distance_px.detector.mean, Some(3.0));
    assert_eq!(series[0].1, 3.0);
    assert!(series[1].1.is_nan());
}

/// A dark blob of 12 × 7 px that moves at 60 px/s and 15 px/s over a slope of sky, in noise of
/// some grey levels.
fn blob_folder(folder: &Path, frames: usize) -> Vec<[f64; 2]> {
    let (width, height) = (320_usize, 240_usize);
    let mut rng = crate::models::maths::rng::Stream::new(3, 0, "blob");
    (0..frames)
        .map(|k| {
            let t_s = k as f64 / 30.0;
            let centre = [60.0 + 60.0 * t_s, 160.0 - 15.0 * t_s];
            let mut rgb8 = Vec::with_capacity(3 * width * height);
            for j in 0..height {
                for i in 0..width {
                    let dx = (i as f64 + 0.5 - centre[0]) / 6.0;
                    let dy = (j as f64 + 0.5 - centre[1]) / 3.5;
                    // Soft edges keep the centre at the fraction of a pixel.
                    let cover = ((1.15 - dx.hypot(dy)) / 0.3).clamp(0.0, 1.0);
                    let sky = 170.0 + 0.1 * j as f64 + 2.0 * rng.normal();
                    let grey = sky + cover * (45.0 - sky);
                    rgb8.extend([grey - 10.0, grey, grey + 12.0].map(|c| c as u8));
                }
            }
            let jpeg = encode_jpeg(&rgb8, width as u16, height as u16, 92).unwrap();
            std::fs::write(folder.join(format!("{k:04}.jpg")), jpeg).unwrap();
            centre
        })
        .collect()
}

#[test]
fn a_moving_blob_is_found_and_followed() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("blob");
    std::fs::create_dir(&folder).unwrap();
    let centres = blob_folder(&folder, 60);
    let boxes: Vec<_> = (centres.iter())
        .map(|[x, y]| serde_json::json!({"drone": [[x - 9.0, y - 7.0, 18.0, 14.0]]}))
        .collect();
    let list = serde_json::json!([{"file": "blob", "frames": 60, "boxes_xywh": boxes}]);
    let truth = root.path().join("boxes.json");
    std::fs::write(&truth, list.to_string()).unwrap();
    let arguments = Arguments {
        files: vec![folder],
        model: Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/models/saliency.onnx"),
        out: root.path().join("out"),
        threshold: Some(0.5),
        boxes: Some(truth),
        category: Vec::new(),
        recogniser: None,
        uav_probability: 0.5,
        fov_deg: 1.0,
        centre_sigma_px: 0.5,
        rate_hz: 30.0,
        threads: NonZeroUsize::new(1),
    };
    let evaluation = evaluate(&arguments).unwrap();
    let figures = &evaluation.figures;
    assert_eq!(figures.frames, 60);
    assert!(figures.recall > Some(0.95), "{figures:?}");
    // Six frames make a candidate, four more confirm it.
    assert!(figures.on_target_share > Some(0.8), "{figures:?}");
    assert_eq!(figures.false_lock_share, Some(0.0));
    let miss = &figures.miss_distance_px;
    assert!(miss.detector.mean < Some(1.0), "{figures:?}");
    assert!(miss.tracker.mean < Some(1.0), "{figures:?}");
    let tracks = &evaluation.clips[0].tracks;
    assert_eq!(tracks.len(), 1, "{tracks:?}");
    assert!(tracks[0].length > 1.6 && tracks[0].on_uav_share > Some(0.95));
    // What it leaves: the same figures, a film of as many frames, a line for each of the track.
    let text = std::fs::read_to_string(arguments.out.join("clip.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(json["frames"], 60);
    assert_eq!(json["clips"][0]["tracks"][0]["id"], tracks[0].id);
    assert_eq!(json["miss_distance_px"]["tracker"]["n"], miss.tracker.n);
    let overlay = Clip::open(&arguments.out.join("overlay.mp4"), 30.0).unwrap();
    assert_eq!(overlay.frames(), 60);
    let lines = std::fs::read_to_string(arguments.out.join("tracks.txt")).unwrap();
    assert_eq!(lines.lines().count(), tracks[0].frames);
    let page = std::fs::read_to_string(arguments.out.join("clip.html")).unwrap();
    assert_eq!(page.matches("data:image/jpeg").count(), SHEET);
    // Of several clips, those of each label are summed up.
    let bird = root.path().join("bird");
    std::fs::create_dir(&bird).unwrap();
    blob_folder(&bird, 12);
    let list = serde_json::json!([
        {"file": "blob", "frames": 60, "boxes_xywh": boxes},
        {"file": "bird", "frames": 12, "boxes_xywh": vec![serde_json::json!({"Bird": [[1, 1, 9, 9]]}); 12]},
    ]);
    std::fs::write(root.path().join("boxes.json"), list.to_string()).unwrap();
    let both = Arguments {
        files: vec![arguments.files[0].clone(), bird],
        ..arguments.clone()
    };
    let evaluation = evaluate(&both).unwrap();
    let frames: Vec<_> = (evaluation.by_label.iter())
        .map(|(label, of)| (label.as_str(), of.frames, of.boxes))
        .collect();
    assert_eq!(frames, [("bird", 12, Some(0)), ("drone", 60, Some(60))]);
    // Truth of other length, or of no such clip, is refused before the work.
    for (frames, name, expected) in [
        (59, "blob", "lists 59 frames"),
        (60, "other", "lists no boxes of 'blob'"),
    ] {
        let list = serde_json::json!(
            [{"file": name, "frames": frames, "boxes_xywh": &boxes[..frames]}]
        );
        std::fs::write(root.path().join("boxes.json"), list.to_string()).unwrap();
        let message = evaluate(&arguments).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
}
