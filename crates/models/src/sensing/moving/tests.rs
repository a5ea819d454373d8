use super::*;
use crate::maths::rng::Stream;

const STEP_S: f64 = 1.0 / 30.0;
const SIZE: [usize; 2] = [160, 140];
/// Frames over which a dot as faint as these is told from noise: two more than a plain one needs.
const FULL_FRAMES: usize = LEAST_FRAMES + 2;

/// A camera of 0.16 mrad a pixel.
fn pinhole() -> Pinhole {
    let [width_px, height_px] = SIZE.map(|side| side as u32);
    Pinhole {
        width_px,
        height_px,
        focal_px: 6200.0,
    }
}

/// The scenery's brightness, sharp edges and all, in a direction [px]: walls, windows and crowns.
fn scenery(x: f64, y: f64) -> f64 {
    let wall = 60.0 * (0.11 * x).sin() * (0.07 * y + 0.4 * (0.05 * x).cos()).cos();
    let windows = if x.rem_euclid(28.0) < 12.0 && y.rem_euclid(40.0) < 16.0 {
        40.0
    } else {
        0.0
    };
    110.0 + 0.5 * wall + windows
}

/// Frames of a camera that sways by 0.4 px about where it looks, and turns away by `turn_px` a frame, with noise of 2 grey levels: a
/// dot of 3 by 3 px stands out by `contrast` grey levels and moves at `velocity_px` a frame over the scenery. The dots
/// found in each, and where it is.
fn found(contrast: f64, velocity_px: DVec2, turn_px: f64, frames: usize) -> Vec<(Vec<Dot>, DVec2)> {
    let start_px = pinhole().centre_px() + DVec2::new(-6.0, 5.0);
    found_from(start_px, 1.0, contrast, velocity_px, turn_px, frames)
}

/// The same of a dot that starts there, and under an exposure that makes each frame `brighter` than the one before by a factor.
fn found_from(
    start_px: DVec2,
    brighter: f64,
    contrast: f64,
    velocity_px: DVec2,
    turn_px: f64,
    frames: usize,
) -> Vec<(Vec<Dot>, DVec2)> {
    let pinhole = pinhole();
    let mut rng = Stream::new(7, 0, "moving dots");
    let mut dots = MovingDots::default();
    let look = |frame: usize| {
        let sway_px = 0.4 * DVec2::new((0.9 * frame as f64).sin(), (0.7 * frame as f64).cos());
        let off_px = sway_px + DVec2::new(turn_px * frame as f64, 0.0);
        // The scenery moves left and up by as much as the camera turns right and down.
        let turned = DQuat::from_rotation_y((off_px.x / pinhole.focal_px).atan())
            * DQuat::from_rotation_x(-(off_px.y / pinhole.focal_px).atan());
        let dot = start_px + velocity_px * frame as f64 - off_px;
        let mut rgb8 = Vec::new();
        for y in 0..SIZE[1] {
            for x in 0..SIZE[0] {
                // A lens blurs each pixel over two by two: the mean of four by four points.
                let mut value = 0.0;
                for i in 0..16 {
                    let (u, v) = (f64::from(i % 4) + 0.5, f64::from(i / 4) + 0.5);
                    let at = DVec2::new(x as f64 + u / 2.0, y as f64 + v / 2.0) - 0.5;
                    let inside = (at - dot).abs().max_element() < 1.5;
                    let shown = scenery(at.x + off_px.x, at.y + off_px.y);
                    value += (shown - if inside { contrast } else { 0.0 }) / 16.0;
                }
                value *= brighter.powi(frame as i32);
                for _ in 0..3 {
                    rgb8.push((value + 2.0 * rng.normal()).round().clamp(0.0, 255.0) as u8);
                }
            }
        }
        let picture = Picture {
            t_s: STEP_S * frame as f64,
            exposure_s: 1e-3 * brighter.powi(frame as i32),
            q_enu_cam: turned,
            rgb8: &rgb8,
        };
        (dots.look(&pinhole, &picture), dot)
    };
    (0..frames).map(look).collect()
}

/// Frames with a dot within 2.5 px of what is there, of those that could have one; there is no other.
fn hits(found: &[(Vec<Dot>, DVec2)]) -> (usize, usize) {
    let judged = &found[FULL_FRAMES - 1..];
    let right = |dot: &Dot, at: DVec2| dot.at_px.distance(at) < 2.5;
    let wrong = (judged.iter()).any(|(dots, at)| dots.iter().any(|dot| !right(dot, *at)));
    assert!(!wrong, "{found:?}");
    let hit = judged.iter().filter(|(dots, _)| !dots.is_empty());
    (hit.count(), judged.len())
}

#[test]
fn a_dot_too_faint_for_one_frame_is_found_by_its_motion() {
    // Six grey levels: windows and walls around it differ by forty.
    let seen = found(6.0, DVec2::new(1.6, 0.4), 0.0, 24);
    assert!(
        seen[..LEAST_FRAMES - 1]
            .iter()
            .all(|(dots, _)| dots.is_empty())
    );
    let (right, judged) = hits(&seen);
    assert!(3 * right >= 2 * judged, "{right} of {judged}: {seen:?}");
    let dot = (seen.iter().rev())
        .find_map(|(dots, _)| dots.first())
        .unwrap();
    assert!(
        dot.velocity_px.distance(DVec2::new(1.6, 0.4)) < 0.6,
        "{dot:?}"
    );
    assert!((3.0..7.0).contains(&dot.side_px), "{dot:?}");
}

#[test]
fn scenery_noise_and_what_stands_still_are_no_dots() {
    for (contrast, velocity_px) in [(0.0, DVec2::ZERO), (40.0, DVec2::ZERO)] {
        let seen = found(contrast, velocity_px, 0.0, 24);
        assert!(seen.iter().all(|(dots, _)| dots.is_empty()), "{seen:?}");
    }
}

#[test]
fn a_camera_that_drifts_finds_it_and_one_that_slews_forgets() {
    let velocity_px = DVec2::new(-1.2, 0.8);
    let (right, judged) = hits(&found(8.0, velocity_px, 1.0, 16));
    assert!(3 * right >= 2 * judged, "{right} of {judged}");
    let slews = found(8.0, velocity_px, 9.0, 14);
    assert!(slews.iter().all(|(dots, _)| dots.is_empty()));
}

#[test]
fn a_dot_is_found_close_to_the_edge_and_while_the_exposure_settles() {
    let velocity_px = DVec2::new(1.6, 0.2);
    let middle_px = pinhole().centre_px();
    for (start_px, brighter) in [(DVec2::new(25.0, 14.0), 1.0), (middle_px, 0.985)] {
        let (right, judged) = hits(&found_from(start_px, brighter, 10.0, velocity_px, 0.0, 16));
        assert!(3 * right >= 2 * judged, "{right} of {judged}");
    }
}

#[test]
fn what_moves_is_a_detection_once() {
    let dot = |x: f64| Dot {
        at_px: DVec2::new(x, 50.0),
        side_px: 4.0,
        velocity_px: DVec2::ONE,
        sigmas: 6.0,
    };
    let seen = |side_px: f64, score: f64| {
        let box_px = [100.0, 48.0, 100.0 + side_px, 48.0 + side_px];
        Detection::new(box_px, score, 3)
    };
    let moving = MovingAs {
        label: 8,
        score: 0.3,
    };
    // A small box, behind a larger one that says little.
    let mut found = vec![seen(30.0, 0.1), seen(4.0, 0.1)];
    dot(102.0).count_in(&mut found, &moving);
    dot(140.0).count_in(&mut found, &moving);
    let counted: Vec<_> = found.iter().map(|d| (d.score, d.label)).collect();
    assert_eq!(counted, [(0.1, 3), (0.3, 3), (0.3, 8)]);
    assert_eq!(found[2].box_px, [138.0, 48.0, 142.0, 52.0]);
    // In a larger one alone it is another thing, unless that is seen as surely.
    for (score, count) in [(0.1, 2), (0.5, 1)] {
        let mut found = vec![seen(20.0, score)];
        dot(110.0).count_in(&mut found, &moving);
        assert_eq!((found.len(), found[0]), (count, seen(20.0, score)));
    }
}

/// Frames of nothing but noise that are in the stretch after each, with such turns [px], at such times [steps], exposed so [s].
fn stretch(frames: &[(f64, f64, f64)], focal_px: f64) -> Vec<usize> {
    let pinhole = Pinhole {
        focal_px,
        ..pinhole()
    };
    let mut dots = MovingDots::default();
    let rgb8 = vec![100; 3 * SIZE[0] * SIZE[1]];
    let look = |(off_px, steps, exposure_s): &(f64, f64, f64)| {
        let picture = Picture {
            t_s: STEP_S * steps,
            exposure_s: *exposure_s,
            q_enu_cam: DQuat::from_rotation_y((off_px / focal_px).atan()),
            rgb8: &rgb8,
        };
        dots.look(&pinhole, &picture);
        dots.planes.len()
    };
    frames.iter().map(look).collect()
}

#[test]
fn frames_that_do_not_lie_on_one_another_begin_anew() {
    const SHORT_S: f64 = 1e-4;
    let at = |off_px: f64, steps: f64| (off_px, steps, SHORT_S);
    // It sways by less than a step, and by more; it has drifted too far.
    let sways = |off_px: f64| [at(0.0, 0.0), at(off_px, 1.0), at(0.0, 2.0)];
    assert_eq!(stretch(&sways(7.9), 6200.0), [1, 2, 3]);
    assert_eq!(stretch(&sways(8.1), 6200.0), [1, 1, 1]);
    let drifts = [0.0, 7.0, 14.0, 21.0, 28.0].map(|off_px| at(off_px, off_px / 7.0));
    assert_eq!(stretch(&drifts, 6200.0), [1, 2, 3, 4, 1]);
    // In a wide field the edge moves otherwise than the middle.
    assert_eq!(stretch(&sways(6.0), 200.0), [1, 1, 1]);
    // A pause, and another exposure.
    let pauses = [0.0, 1.0, 2.0, 5.0, 6.0, 7.0].map(|steps| at(0.0, steps));
    assert_eq!(stretch(&pauses, 6200.0), [1, 2, 3, 1, 1, 2]);
    let exposed = [
        (0.0, 0.0, SHORT_S),
        (0.0, 1.0, SHORT_S),
        (0.0, 2.0, 2.0 * SHORT_S),
    ];
    assert_eq!(stretch(&exposed, 6200.0), [1, 2, 1]);
    // A long exposure smears what a short one does not, and is not begun with.
    let smears = [(0.0, 0.0), (2.0, 1.0), (2.0, 2.0), (2.0, 3.0)]
        .map(|(off_px, steps)| (off_px, steps, 0.02));
    assert_eq!(stretch(&smears, 6200.0), [1, 0, 1, 2]);
}

#[test]
fn sensors_of_any_size_are_looked_at() {
    for [width_px, height_px] in [[1, 1], [20, 300], [62, 300], [63, 64], [300, 62], [67, 400]] {
        let pinhole = Pinhole {
            width_px,
            height_px,
            focal_px: 6200.0,
        };
        let mut dots = MovingDots::default();
        let rgb8: Vec<u8> = (0..3 * width_px * height_px)
            .map(|i| (i % 251) as u8)
            .collect();
        for frame in 0..14 {
            let off_rad = 20.0 / 6200.0 * f64::from(frame % 2);
            let picture = Picture {
                t_s: STEP_S * f64::from(frame),
                exposure_s: 1e-4,
                q_enu_cam: DQuat::from_rotation_x(off_rad * f64::from(frame / 7)),
                rgb8: &rgb8,
            };
            dots.look(&pinhole, &picture);
        }
    }
}
