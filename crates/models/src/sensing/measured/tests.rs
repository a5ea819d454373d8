use super::*;
use crate::maths::rng::Stream;
use crate::tracking::evidence::{logit, probability};
use crate::tracking::recognition::TrackClass;

const FLOOR: f64 = 0.075;

fn seen(size_px: f64) -> Appearance {
    Appearance {
        tier: Tier::Search,
        size_px,
        in_sky: true,
        transmittance: 0.8,
        gain: 1.0,
        smear_px: 0.2,
    }
}

/// A run in which UAVs of 2 to 64 px are looked at 20 times a second for 10 s: the logit is -3 plus 1.5 times the log of the size, less
/// 1 before what is solid, with noise of 1.2 that lasts by a half.
fn made(run: u64) -> Run {
    let mut draw = Stream::new(7, run, "made");
    let mut rows = vec![Row::Frame(FrameRow {
        t_s: 0.0,
        tier: Tier::Search,
        area_mpx: 1.0,
        sky: 0.5,
        floor: FLOOR,
        start: 2.0 * FLOOR,
    })];
    let noise = Noise {
        frame: 0.5,
        changing: [0.0, 0.0],
        lasting: 0.5,
    };
    for thing in 0..12 {
        let size_px = 2.0 * (draw.uniform() * 32.0_f64.ln()).exp();
        let in_sky = draw.uniform() < 0.5;
        for frame in 0..200_u64 {
            let appearance = Appearance {
                in_sky,
                ..seen(size_px)
            };
            let t_s = frame as f64 / 20.0;
            let error = 1.2 * Draws::new(run, thing, t_s, frame).noise(Of::Score, &noise);
            let solid = f64::from(u8::from(!in_sky));
            let score = probability(-3.0 + 1.5 * size_px.ln() - solid + error);
            let off_px = [0.1 * size_px * draw.normal(), 0.1 * size_px * draw.normal()];
            let found = (score >= FLOOR).then(|| FoundRow {
                score,
                name: "quadcopter".into(),
                off_px,
                box_px: [1.2 * size_px, 1.2 * size_px],
            });
            rows.push(Row::Look(LookRow {
                t_s,
                thing: thing as usize,
                kind: "uav".into(),
                appearance,
                box_px: [size_px, size_px],
                found,
                moving: false,
            }));
        }
    }
    rows
}

fn fitted(runs: u64) -> Measured {
    let runs: Vec<Run> = (0..runs).map(made).collect();
    fit(
        &runs,
        vec!["quadcopter".into(), "bird".into()],
        0.3,
        "a test".into(),
    )
    .expect("UAVs were looked at")
    .model
}

#[test]
fn a_fit_finds_what_the_data_were_made_with() {
    let model = fitted(20);
    let scores = &model.uav.scores;
    for size_px in [3.0_f64, 6.0, 12.0, 24.0] {
        for in_sky in [true, false] {
            let seen = Appearance {
                in_sky,
                ..seen(size_px)
            };
            let expected = -3.0 + 1.5 * size_px.ln() - f64::from(u8::from(!in_sky));
            let mean = scores.mean(&seen);
            assert!(
                (mean - expected).abs() < 0.35,
                "{size_px} {in_sky}: {mean} for {expected}"
            );
        }
    }
    assert!((scores.sigma / 1.2 - 1.0).abs() < 0.1, "{}", scores.sigma);
    let noise = scores.noise;
    assert!((noise.frame - 0.5).abs() < 0.15, "{noise:?}");
    assert!((noise.lasting - 0.5).abs() < 0.2, "{noise:?}");
    let boxes = &model.uav.boxes;
    assert!(
        (boxes.off_px[3] / 1.6 - 1.0).abs() < 0.1,
        "{:?}",
        boxes.off_px
    );
    assert!(
        (boxes.log_side[3] - 1.2_f64.ln()).abs() < 0.02,
        "{:?}",
        boxes.log_side
    );
}

#[test]
fn as_many_are_found_as_the_model_says() {
    let model = fitted(20);
    for size_px in [4.0, 8.0, 16.0] {
        let appearance = seen(size_px);
        let box_px = [100.0, 100.0, 100.0 + size_px, 100.0 + size_px];
        let found = (0..4000_u64).filter(|thing| {
            let draws = Draws::new(3, *thing, 0.5, 30);
            let found = model.found(TrackClass::Uav, &appearance, box_px, &draws);
            found.is_some_and(|found| found.score >= FLOOR && found.label == 0)
        });
        let share = found.count() as f64 / 4000.0;
        let expected = model.uav.scores.chance(&appearance);
        // Three standard deviations of 4000 tries, and what names of another class take.
        assert!(
            (share - expected).abs() < 0.03,
            "{size_px}: {share} for {expected}"
        );
    }
}

#[test]
fn noise_has_its_variance_and_goes_on_as_long_as_it_should() {
    let noise = Noise {
        frame: 0.1,
        changing: [0.3, 0.4],
        lasting: 0.2,
    };
    let pairs = |later_s: f64| {
        let pair = |thing: u64| {
            let t_s = 3.0 + 0.001 * thing as f64;
            [(t_s, thing), (t_s + later_s, thing + 1_000_000)]
                .map(|(t_s, frame)| Draws::new(1, thing, t_s, frame).noise(Of::Right, &noise))
        };
        let pairs: Vec<[f64; 2]> = (0..8000).map(pair).collect();
        let mean = |of: fn(&[f64; 2]) -> f64| pairs.iter().map(of).sum::<f64>() / 8000.0;
        (mean(|[a, _]| a * a), mean(|[a, b]| a * b))
    };
    let (variance, next) = pairs(0.001);
    assert!((variance - 1.0).abs() < 0.05, "{variance}");
    assert!((next - 0.9).abs() < 0.05, "{next}");
    assert!((pairs(5.0).1 - 0.2).abs() < 0.05);
    assert!((pairs(0.6).1 - 0.55).abs() < 0.08, "{}", pairs(0.6).1);
}

#[test]
fn false_boxes_are_as_many_as_they_should_be_and_come_back() {
    let mut model = fitted(2);
    let places = &mut model.scenery.coarse;
    (places.sky_per_mpx, places.solid_per_mpx, places.duty) = (0.0, 20.0, 0.5);
    let ifov_rad = 1e-4; // [rad]
    let patch = Patch {
        tier: Tier::Coarse,
        ifov_rad,
        az_rad: [-0.05, 0.05],
        el_rad: [-0.05, 0.05],
    };
    let below = |[_, el]: [f64; 2]| el > 0.0;
    // A million pixels, half of them sky, over many seeds.
    let counts: Vec<usize> = (0..400)
        .map(|seed| {
            model
                .scenery
                .coarse
                .boxes(seed, &patch, 1.0, 1, below)
                .len()
        })
        .collect();
    let mean = counts.iter().sum::<usize>() as f64 / 400.0;
    assert!((mean / 5.0 - 1.0).abs() < 0.1, "{mean}");
    let at = |frame: u64| model.scenery.coarse.boxes(5, &patch, 1.0, frame, below);
    let [first, second] = [at(1), at(2)];
    assert!(first.iter().all(|place| place.az_el_rad[1] <= 0.0));
    let again = first.iter().filter(|place| {
        second
            .iter()
            .any(|other| other.az_el_rad == place.az_el_rad)
    });
    assert!(again.count() > 0, "{first:?} {second:?}");
}

#[test]
fn recognition_shares_the_rest_among_what_is_no_uav() {
    let model = fitted(2);
    let draws = Draws::new(1, 1, 1.0, 1);
    for class in [None, Some(TrackClass::Uav), Some(TrackClass::Balloon)] {
        let probabilities = model.recognised(class, 8.0, &draws);
        assert!((probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!(probabilities.iter().all(|p| *p >= 0.0));
    }
    let balloon = model.recognised(Some(TrackClass::Balloon), 8.0, &draws);
    assert_eq!(balloon[TrackClass::Bird as usize], 0.0);
    assert!(logit(balloon[0]).is_finite());
}

#[test]
fn a_file_with_numbers_that_cannot_be_is_told() {
    let good = fitted(2);
    assert_eq!(good.fault(), None);
    let told = |change: fn(&mut Measured)| {
        let mut bad = good.clone();
        change(&mut bad);
        bad.fault().unwrap_or_default()
    };
    assert!(told(|m| m.bird.scores.sigma = 0.0).starts_with("bird.scores.sigma"));
    assert!(told(|m| m.classes.clear()).starts_with("uav.named"));
    assert!(told(|m| m.scenery.coarse.duty = 1.5).starts_with("scenery.coarse.duty"));
    assert!(told(|m| m.uav.boxes.off.frame = -0.1).starts_with("uav.noise"));
    assert!(told(|m| m.floor = f64::NAN).starts_with("floor"));
}

/// Places due south keep where they are, from whichever side the camera comes.
#[test]
fn south_is_no_edge() {
    let mut model = fitted(2);
    let places = &mut model.scenery.coarse;
    (places.sky_per_mpx, places.solid_per_mpx, places.duty) = (50.0, 50.0, 1.0);
    let seen_about = |middle_rad: f64| {
        let patch = Patch {
            tier: Tier::Coarse,
            ifov_rad: 1e-4,
            az_rad: [middle_rad - 0.05, middle_rad + 0.05],
            el_rad: [-0.05, 0.05],
        };
        let mut seen = model.scenery.coarse.boxes(5, &patch, 1.0, 1, |_| true);
        seen.sort_by(|a, b| a.az_el_rad[1].total_cmp(&b.az_el_rad[1]));
        seen
    };
    let pi = std::f64::consts::PI;
    let (east, west) = (seen_about(pi), seen_about(-pi));
    assert!(east.len() > 20);
    assert_eq!(east.len(), west.len());
    for (a, b) in east.iter().zip(&west) {
        let apart_rad = crate::maths::kinematics::wrap_pi(a.az_el_rad[0] - b.az_el_rad[0]);
        assert!(apart_rad.abs() < 1e-9);
    }
}
