use super::*;

const SENSOR: [u32; 2] = [640, 480];

fn run(errors: &TruthErrors, frames: usize, size_px: [u32; 2]) -> Vec<Detection> {
    (0..frames as u64)
        .flat_map(|key| frame(&[UAV], errors, size_px, key))
        .collect()
}

fn frame(seen: &[Candidate], errors: &TruthErrors, size_px: [u32; 2], key: u64) -> Vec<Detection> {
    let mut out = Vec::new();
    let seen = seen.iter().copied();
    detect_truth(seen, errors, [0, 0], size_px, SENSOR, key, &mut out);
    out
}

const UAV: Candidate = Candidate {
    index: 0,
    box_px: [100.0, 100.0, 110.0, 108.0],
    distractor: false,
};
const BIRD: Candidate = Candidate {
    index: 1,
    box_px: [300.0, 100.0, 310.0, 108.0],
    distractor: true,
};

#[derive(serde::Deserialize)]
struct Golden {
    stride: u32,
    min_side_px: u32,
    width: u32,
    height: u32,
    rgb: Vec<u8>,
    padded_width: u32,
    padded_height: u32,
    planes: Vec<f32>,
}

/// The file that the Python side of the rule is held to as well.
#[test]
fn the_golden_picture_is_padded_as_in_training() {
    let text = include_str!("../../../../../tests/data/preprocess.json");
    let golden: Golden = serde_json::from_str(text).unwrap();
    let padding = Padding {
        stride_px: golden.stride,
        min_side_px: golden.min_side_px,
        fixed_px: [None; 2],
    };
    let size_px = [golden.width, golden.height];
    let input_px = padding.input_px(size_px).unwrap();
    assert_eq!(input_px, [golden.padded_width, golden.padded_height]);
    let whole = PixelRect {
        offset_px: [0, 0],
        size_px,
    };
    // What the buffer held before, the batch's earlier pictures, stays.
    let mut out = vec![7.0; 5];
    planes(&golden.rgb, golden.width, whole, input_px, &mut out);
    assert_eq!(out[..5], [7.0; 5]);
    let out = out.split_off(5);
    assert_eq!(out.len(), golden.planes.len());
    for (i, (found, wanted)) in out.iter().zip(&golden.planes).enumerate() {
        assert!((found - wanted).abs() <= 1e-6, "{i}: {found}, not {wanted}");
    }
    // A part of the picture is what the picture holds there.
    let look = PixelRect {
        offset_px: [3, 2],
        size_px: [golden.width - 4, golden.height - 2],
    };
    let mut part = Vec::new();
    planes(&golden.rgb, golden.width, look, input_px, &mut part);
    let [across, down] = input_px.map(|x| x as usize);
    for (i, found) in part.iter().enumerate() {
        let (plane, y, x) = (i / (across * down), i / across % down, i % across);
        let inside = x < look.size_px[0] as usize && y < look.size_px[1] as usize;
        let wanted = if inside {
            out[(plane * down + y + 2) * across + x + 3]
        } else {
            0.0
        };
        assert_eq!(*found, wanted, "{plane} {y} {x}");
    }
}

#[test]
fn inputs_are_multiples_of_the_stride_and_large_enough() {
    let padding = Padding {
        stride_px: 32,
        min_side_px: 100,
        fixed_px: [None, Some(512)],
    };
    assert_eq!(padding.input_px([640, 480]), Some([640, 512]));
    assert_eq!(padding.input_px([641, 512]), Some([672, 512]));
    assert_eq!(padding.input_px([1, 1]), Some([128, 512]));
    assert_eq!(padding.input_px([640, 513]), None);
    assert_eq!(padding.input_px([u32::MAX, 1]), None);
}

#[test]
fn distractors_are_reported_at_their_rate_with_lower_scores() {
    let errors = TruthErrors {
        noise_px: 0.5,
        miss_rate: 0.0,
        distractor_rate: 0.3,
        false_alarms_per_frame: 0.0,
    };
    let n = 20_000;
    let (mut uavs, mut birds) = (Vec::new(), Vec::new());
    for key in 0..n {
        for found in frame(&[UAV, BIRD], &errors, SENSOR, key) {
            if found.centre_px()[0] < 200.0 {
                uavs.push(found.score);
            } else {
                birds.push(found.score);
            }
        }
    }
    let rate = birds.len() as f64 / n as f64;
    assert!(
        (rate - 0.3).abs() < 5.0 * (0.21 / n as f64).sqrt(),
        "{rate}"
    );
    assert_eq!(uavs.len() as u64, n);
    let mean = |scores: &[f64]| scores.iter().sum::<f64>() / scores.len() as f64;
    // The cut at 1 takes 0.003 off the UAVs' mean: sigma phi(1.5) - 1.5 sigma Q(1.5).
    assert!((mean(&uavs) - 0.847).abs() < 0.003, "{}", mean(&uavs));
    assert!((mean(&birds) - 0.600).abs() < 0.008, "{}", mean(&birds));
    assert!(uavs.iter().all(|score| (0.0..=1.0).contains(score)));
}

#[test]
fn what_else_is_visible_changes_no_draw() {
    let errors = TruthErrors {
        noise_px: 1.0,
        miss_rate: 0.3,
        distractor_rate: 0.5,
        false_alarms_per_frame: 0.2,
    };
    let hidden = Candidate {
        box_px: [900.0, 100.0, 910.0, 108.0],
        ..BIRD
    };
    for key in 0..500 {
        let alone = frame(&[UAV], &errors, SENSOR, key);
        assert_eq!(frame(&[UAV, hidden], &errors, SENSOR, key), alone);
        let both = frame(&[BIRD, UAV], &errors, SENSOR, key);
        assert!(alone.iter().all(|found| both.contains(found)));
    }
}

#[test]
fn misses_and_noise_have_the_set_rates() {
    let n = 20_000;
    let errors = TruthErrors {
        noise_px: 1.5,
        miss_rate: 0.1,
        distractor_rate: 0.0,
        false_alarms_per_frame: 0.0,
    };
    let seen = run(&errors, n, SENSOR);
    let rate = 1.0 - seen.len() as f64 / n as f64;
    assert!(
        (rate - 0.1).abs() < 5.0 * (0.09 / n as f64).sqrt(),
        "{rate}"
    );
    let variance = seen
        .iter()
        .map(|d| (d.centre_px()[0] - 105.0).powi(2))
        .sum::<f64>()
        / seen.len() as f64;
    assert!((variance.sqrt() - 1.5).abs() < 0.05, "{}", variance.sqrt());
}

#[test]
fn false_alarms_scale_with_the_window() {
    let errors = TruthErrors {
        noise_px: 0.0,
        miss_rate: 1.0,
        distractor_rate: 0.0,
        false_alarms_per_frame: 2.0,
    };
    let n = 4_000;
    let window = run(&errors, n, [320, 240]).len() as f64 / n as f64;
    assert!(
        (window - 0.5).abs() < 5.0 * (0.5 / n as f64).sqrt(),
        "{window}"
    );
}

#[test]
fn what_lies_outside_the_window_is_not_seen() {
    let errors = TruthErrors {
        noise_px: 0.0,
        miss_rate: 0.0,
        distractor_rate: 0.0,
        false_alarms_per_frame: 0.0,
    };
    assert!(run(&errors, 10, [50, 50]).is_empty());
}
