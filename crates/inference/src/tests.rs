use super::*;
use boresight_models::flight::class::ObjectClass;
use boresight_models::optics::camera::PixelRect;
use boresight_models::optics::detection::Detection;
use boresight_scenario::Provider;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn test_model(name: &str) -> PathBuf {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("tests/data/models");
    folder.join(format!("{name}.onnx"))
}

/// A dark quadcopter from the side before grey, 160 x 120 px, 24 px wide, its middle at
/// `left_px` + 12, 54.5.
fn quadcopter(left_px: usize) -> Vec<u8> {
    let mut rgb8 = vec![150; 160 * 120 * 3];
    // Rotors, motors, arms, body, legs: rows and columns.
    for (rows, columns) in [
        (50..51, 0..8),
        (50..51, 16..24),
        (51..53, 3..5),
        (51..53, 19..21),
        (53..54, 3..21),
        (52..57, 9..15),
        (57..60, 9..10),
        (57..60, 14..15),
    ] {
        for at in rows.flat_map(|y| columns.clone().map(move |x| 3 * (y * 160 + left_px + x))) {
            rgb8[at..at + 3].fill(20);
        }
    }
    rgb8
}

#[test]
fn the_shipped_models_load() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("assets/models");
    let all = ObjectClass::ALL.map(ObjectClass::name);
    for (name, classes) in [
        ("saliency", &["uav"][..]),
        ("boresight-p2-roi", &all),
        ("d-fine-nwd-p2-dsam", &all[..3]),
    ] {
        let path = folder.join(format!("{name}.onnx"));
        let mut model = OnnxDetector::load(&path, 1).expect("a shipped model");
        assert_eq!(model.classes(), classes);
        let mut found = Vec::new();
        model
            .detect(&quadcopter(64), [160, 120], &mut found)
            .expect("an answer");
        let [x, y] = found[0].aim_px;
        assert!((x - 76.0).hypot(y - 54.5) < 3.0, "{name}: {:?}", found[0]);
        assert!(found[0].score > 0.3, "{name}: {:?}", found[0]);
    }
}

/// The models are those of training/make_broken_models.py.
#[test]
fn a_model_that_differs_from_the_interface_is_refused_with_its_fault() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("empty.onnx"), "").expect("written");
    std::fs::write(folder.path().join("text.onnx"), "no model").expect("written");
    let cases: [(PathBuf, &[&str]); 30] = [
        (test_model("absent"), &["cannot be read", "--model"]),
        (folder.path().into(), &["directory", "--model"]),
        (
            folder.path().join("empty.onnx"),
            &["not a usable ONNX model"],
        ),
        (
            folder.path().join("text.onnx"),
            &["not a usable ONNX model"],
        ),
        (
            test_model("truncated"),
            &["not a usable ONNX model", "opset 17"],
        ),
        (
            test_model("wrong_inputs"),
            &["`pixels`, f32 [1, length]", "expected one input `image`"],
        ),
        (
            test_model("input_rank"),
            &["`image`, f32 [3, height, width]"],
        ),
        (
            test_model("input_type"),
            &["`image`, u8 [1, 3", "f32 [1, 3, H, W]"],
        ),
        (test_model("input_channels"), &["f32 [1, 1, height, width]"]),
        (
            test_model("output_name"),
            &["`bboxes`", "an output `boxes`"],
        ),
        (test_model("output_type"), &["`labels`, i32 [1]", "i64 [N]"]),
        (
            test_model("output_shape"),
            &["`boxes`, f32 [1, 5]", "f32 [N, 4]"],
        ),
        (
            test_model("output_batch"),
            &["`boxes`, f32 [1, 4]", "f32 [B, N, 4]"],
        ),
        (
            test_model("interface_missing"),
            &["boresight.interface is missing"],
        ),
        (
            test_model("interface_other"),
            &["boresight.interface is 2, expected 1"],
        ),
        (
            test_model("preprocess"),
            &["preprocess is letterbox, expected native"],
        ),
        (test_model("classes_missing"), &["classes is missing"]),
        (test_model("classes_empty"), &["classes is [], expected"]),
        (test_model("classes_twice"), &["different names"]),
        (test_model("side"), &["a side of 100000 px", "1 to 8192"]),
        (test_model("batch_of_one"), &["boxes are not [B, N, 4]"]),
        (test_model("score"), &["the score 1.5", "0 to 1"]),
        (test_model("stride"), &["stride is 0"]),
        (test_model("min_side"), &["min_side_px is wide"]),
        (test_model("threshold"), &["score_threshold is 1.5"]),
        (test_model("neutral"), &["score_neutral is 1", "above 0"]),
        (test_model("label"), &["label 1", "1 names"]),
        (test_model("opset"), &["opset 99 is newer", "opset 17"]),
        (test_model("ir_version"), &["IR version 99 is newer"]),
        (test_model("nan"), &["not finite"]),
    ];
    for (path, wanted) in cases {
        let Err(error) = OnnxDetector::load(&path, 1) else {
            panic!("{} is taken", path.display());
        };
        let text = error.to_string();
        let file = path.display().to_string();
        assert!(text.contains(&file) && text.lines().count() == 1, "{text}");
        for words in wanted {
            assert!(text.contains(words), "{file}: no '{words}' in {text}");
        }
    }
}

#[test]
fn labels_padding_and_sizes_are_those_of_the_model() {
    let mut model = OnnxDetector::load(&test_model("good"), 1).expect("a model");
    assert_eq!(model.classes(), ["fpv", "quadcopter"]);
    let mut found = Vec::new();
    model
        .detect(&[0; 3 * 35 * 17], [35, 17], &mut found)
        .expect("an answer");
    assert_eq!((found.len(), found[0].label), (1, 1));
    assert_eq!(found[0].box_px, [8.0, 8.0, 16.0, 16.0]);
    // Its box lies beyond this picture, in the padding.
    found.clear();
    model
        .detect(&[0; 3 * 11 * 11], [11, 11], &mut found)
        .expect("an answer");
    assert!(found.is_empty());

    let mut model = OnnxDetector::load(&test_model("fixed_size"), 1).expect("a model");
    assert_eq!(model.input_px([150, 100]).expect("a size"), [200, 100]);
    let grey = vec![9; 3 * 150 * 70];
    model
        .detect(&grey, [150, 70], &mut found)
        .expect("an answer");
    let error = model
        .input_px([150, 101])
        .expect_err("too large")
        .to_string();
    assert!(
        error.contains("at most 200 x 100 px, not 150 x 101"),
        "{error}"
    );
}

/// The model's box is as high as the batch, and its score the picture's mean.
#[test]
fn views_of_one_size_are_answered_together_each_with_its_own() {
    let mut model = OnnxDetector::load(&test_model("batches"), 1).expect("a model");
    let views = [([70, 40], 51), ([100, 80], 102), ([70, 40], 153)];
    let pictures = views.map(|([w, h], grey)| vec![grey; 3 * w * h]);
    let views: Vec<View> = (views.iter().zip(&pictures))
        .map(|(([w, h], _), rgb8)| View {
            rgb8,
            width_px: *w as u32,
            look: PixelRect {
                offset_px: [0, 0],
                size_px: [*w as u32, *h as u32],
            },
        })
        .collect();
    let found = model.detect_all(&views).expect("answers");
    let seen = |i: usize| (found[i][0].box_px[3], found[i][0].score, found[i].len());
    // 40 rows are padded to 64.
    for (i, height_px, score) in [(0, 2.0, 0.125), (1, 1.0, 0.4), (2, 2.0, 0.375)] {
        let (high, mean, count) = seen(i);
        assert_eq!((high, count), (height_px, 1), "{i}");
        assert!((mean - score).abs() < 1e-4, "{i}: {mean}");
    }
    assert!(model.detect_all(&[]).expect("nothing").is_empty());
}

#[test]
fn the_default_detector_takes_batches_and_sees_what_it_sees_alone() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("assets/models/boresight-p2-roi.onnx");
    let mut model = OnnxDetector::load(&path, 1).expect("the shipped model");
    assert!(model.batches);
    let size_px = [160, 120];
    let pictures = [30, 64, 90].map(quadcopter);
    let views = pictures.each_ref().map(|rgb8| View {
        rgb8,
        width_px: 160,
        look: PixelRect {
            offset_px: [0, 0],
            size_px,
        },
    });
    let together = model.detect_all(&views).expect("answers");
    for (rgb8, together) in pictures.iter().zip(together) {
        let mut alone = Vec::new();
        model.detect(rgb8, size_px, &mut alone).expect("an answer");
        let (a, b) = (alone[0], together[0]);
        assert!(a.score > 0.3, "{a:?}");
        assert!((a.score - b.score).abs() < 1e-4, "{a:?} {b:?}");
        assert!((a.aim_px[0] - b.aim_px[0]).abs() < 1e-2, "{a:?} {b:?}");
    }
}

#[test]
fn a_number_that_is_none_in_a_later_picture_is_an_error() {
    let mut model = OnnxDetector::load(&test_model("nan_later"), 1).expect("a model");
    let mut picture = vec![40; 3 * 64 * 64];
    let mut found = Vec::new();
    model
        .detect(&picture, [64, 64], &mut found)
        .expect("an answer");
    picture[0] = 41;
    let error = model
        .detect(&picture, [64, 64], &mut found)
        .expect_err("refused");
    assert!(error.to_string().contains("not finite"), "{error}");
}

#[test]
fn a_provider_that_the_runtime_lacks_is_refused() {
    let there = providers().expect("a runtime");
    for provider in [Provider::Cuda, Provider::Tensorrt] {
        let setup = Setup {
            threads: 1,
            provider,
            named_in: "detector.onnx_model",
        };
        if there.contains(&provider.runtime_name()) {
            continue;
        }
        let Err(error) = OnnxDetector::load_with(&test_model("good"), &setup) else {
            panic!("{provider} is taken");
        };
        let text = error.to_string();
        let name = provider.runtime_name();
        assert!(
            text.contains(name) && text.contains("detector.provider"),
            "{text}"
        );
    }
}

/// Answers come in the order of the pictures, and are the same from either worker.
#[test]
fn a_thread_of_its_own_answers_as_the_caller_does() {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("assets/models/saliency.onnx");
    let load = || OnnxDetector::load(&path, 2).expect("the shipped model");
    let mut workers = [
        Inference::on_thread(load()).expect("a thread"),
        Inference::on_caller(load()),
    ];
    let pictures: Vec<DetectorInput> = (0..6_u32)
        .map(|i| {
            let disc = |at: u32| {
                let (x, y) = (at % 200, at / 200);
                (x.abs_diff(60 + 12 * i).pow(2) + y.abs_diff(70).pow(2) < 20) as u8
            };
            let noise = |at: u32| (at.wrapping_mul(2_654_435_761) >> 20 & 3) as u8;
            DetectorInput {
                rgb8: Arc::new(
                    (0..200 * 150)
                        .flat_map(|at| [160 + noise(at) - 70 * disc(at); 3])
                        .collect(),
                ),
                width_px: 200,
                look: PixelRect {
                    offset_px: [20, 10],
                    size_px: [150, 120],
                },
            }
        })
        .collect();
    let answers = workers.each_mut().map(|worker| {
        for pictures in pictures.chunks(2) {
            worker.submit(pictures.to_vec());
        }
        let answers: Vec<Vec<Detection>> = (pictures.iter())
            .map(|_| worker.fetch().expect("an answer"))
            .collect();
        answers
    });
    assert_eq!(answers[0], answers[1]);
    for (i, found) in answers[0].iter().enumerate() {
        // The disc's middle in the part that was looked at.
        let [x, y] = found[0].centre_px();
        assert!(found[0].score > 0.5, "{i}: {found:?}");
        assert!(
            (x - (40.5 + 12.0 * i as f64)).hypot(y - 60.5) < 0.5,
            "{i}: {x} {y}"
        );
    }
}
