use super::*;
use crate::maths::rng::Stream;
use proptest::prelude::*;

/// Delft.
fn home() -> SiteFrame {
    SiteFrame::new(Geodetic {
        latitude_rad: 52.0116_f64.to_radians(),
        longitude_rad: 4.3571_f64.to_radians(),
        height_m: 44.0,
    })
}

/// A placement far from the identity.
fn truth() -> Placement {
    Placement {
        center_local: DVec3::new(120.0, -40.0, 8.0),
        r_ecef_m: home().enu_to_ecef(DVec3::new(30.0, 20.0, 5.0)),
        q_ecef_local: home().q_ecef_enu()
            * DQuat::from_euler(glam::EulerRot::ZYX, 2.1, 0.02, -0.01),
        scale: 1.000_12,
    }
}

/// Eight points over 700 m, at street level and on roofs.
const EIGHT: [[f64; 3]; 8] = [
    [-330.0, -180.0, 1.2],
    [-120.0, 210.0, 24.0],
    [350.0, 160.0, 3.4],
    [290.0, -230.0, 41.0],
    [20.0, -15.0, 2.0],
    [-280.0, 140.0, 12.5],
    [140.0, 60.0, 33.0],
    [60.0, -200.0, 1.0],
];

/// Control points at `local`, with noise of `sigma_m` in each axis on the Earth.
fn points(local: &[[f64; 3]], placement: Placement, sigma_m: f64, seed: u64) -> Vec<ControlPoint> {
    let mut rng = Stream::new(seed, 0, "georeference-test");
    let point = |(k, r): (usize, &[f64; 3])| ControlPoint {
        name: (k + 1).to_string(),
        r_local: DVec3::from(*r),
        r_ecef_m: placement.to_ecef(DVec3::from(*r)) + rng.normal3() * sigma_m,
        sigma_m: [sigma_m.max(0.01); 2],
    };
    local.iter().enumerate().map(point).collect()
}

/// How far a placement puts the points elsewhere, at most [m].
fn apart_m(a: &Placement, b: &Placement, local: &[[f64; 3]]) -> f64 {
    let apart = |r: &[f64; 3]| {
        a.to_ecef(DVec3::from(*r))
            .distance(b.to_ecef(DVec3::from(*r)))
    };
    local.iter().map(apart).fold(0.0, f64::max)
}

#[test]
fn without_noise_it_is_umeyama_and_the_truth() {
    // 1e-9 of the Earth's radius are 6 mm: of the model's extent they are less than a micrometre, and ECEF has digits for 1e-9 m.
    for mode in [Mode::Seven, Mode::FixedScale, Mode::Paper] {
        let mut truth = truth();
        if mode == Mode::FixedScale {
            truth.scale = 1.0;
        }
        let mut local = EIGHT;
        if mode == Mode::Paper {
            // The vertical is that of the fitted points' centre.
            let center = (EIGHT.iter().map(|r| DVec3::from(*r)).sum::<DVec3>()) / 8.0;
            truth.center_local = center;
            let up = SiteFrame::new(Geodetic::from_ecef(truth.r_ecef_m));
            truth.q_ecef_local = up.q_ecef_enu() * DQuat::from_rotation_z(2.1);
            local[0] = EIGHT[0];
        }
        let found = fit(&points(&local, truth, 0.0, 1), mode).unwrap();
        assert!(
            found.closed_form_m < 1e-9,
            "{mode:?}: {} m",
            found.closed_form_m
        );
        let off_m = apart_m(&found.placement, &truth, &local);
        assert!(off_m < 5e-9, "{mode:?}: {off_m} m");
        assert!((found.placement.scale / truth.scale - 1.0).abs() < 1e-11);
        assert!(
            found.rms_m < 5e-9 && found.warnings.is_empty(),
            "{:?}",
            found.warnings
        );
        let affine = found.placement.affine();
        let r = DVec3::from(local[3]);
        assert!(
            affine
                .transform_point3(r)
                .distance(found.placement.to_ecef(r))
                < 5e-9
        );
        assert_eq!(suspects(&points(&local, truth, 0.0, 1), mode).unwrap(), []);
    }
}

#[test]
fn epsg_9836_is_a_placement() {
    // The topocentric frame of EPSG's example, found again from points in it, puts the example's point where EPSG has it.
    let origin = DVec3::new(3652755.3058, 319574.6799, 5201547.3536);
    let site = SiteFrame::new(Geodetic::from_ecef(origin));
    let placement = Placement {
        center_local: DVec3::ZERO,
        r_ecef_m: origin,
        q_ecef_local: site.q_ecef_enu(),
        scale: 1.0,
    };
    let far = [
        [0.0, 0.0, 0.0],
        [-2e5, 1e5, 500.0],
        [1e5, -2e5, 3000.0],
        [-1e5, -1e5, -4000.0],
    ];
    let found = fit(&points(&far, placement, 0.0, 1), Mode::Seven).unwrap();
    let r = found
        .placement
        .to_ecef(DVec3::new(-189_013.869, -128_642.040, -4_220.171));
    let published = DVec3::new(3_771_793.968, 140_253.342, 5_124_304.349);
    assert!(
        (r - published).abs().max_element() < 2e-3,
        "{r} against {published}"
    );
}

#[test]
fn two_centimetres_of_noise_give_centimetre_residuals() {
    let points = points(&EIGHT, truth(), 0.02, 3);
    let found = fit(&points, Mode::Seven).unwrap();
    assert_eq!(found.degrees_of_freedom, 17);
    // Three axes of 2 cm, less what seven parameters take up: 2 cm·√(3·17/24) = 2.9 cm.
    assert!((0.015..0.045).contains(&found.rms_m), "{}", found.rms_m);
    assert!(found.residuals_enu_m.iter().all(|r| r.length() < 0.09));
    assert!((0.5..1.6).contains(&found.sigma0.unwrap()));
    let off_m = apart_m(&found.placement, &truth(), &EIGHT);
    assert!((0.001..0.05).contains(&off_m), "{off_m} m");
    assert_eq!(suspects(&points, Mode::Seven).unwrap(), []);
}

#[test]
fn the_covariance_is_that_of_many_surveys() {
    let runs = 1500;
    for mode in [Mode::Seven, Mode::FixedScale] {
        let mut truth = truth();
        truth.scale = 1.0;
        let mut sums = DMatrix::<f64>::zeros(mode.free(), mode.free());
        let mut stated = DMatrix::zeros(mode.free(), mode.free());
        let mut sigma0 = 0.0;
        for seed in 0..runs {
            let found = fit(&points(&EIGHT, truth, 0.02, seed), mode).unwrap();
            // The error of each parameter in the terms of the covariance.
            let center = found.placement.center_local;
            let shift = found.placement.r_ecef_m - truth.to_ecef(center);
            let to_enu = found.site.q_ecef_enu().inverse();
            let turn = found.placement.q_ecef_local * truth.q_ecef_local.inverse();
            let (e, t) = (to_enu * shift, to_enu * turn.to_scaled_axis());
            let scale = found.placement.scale / truth.scale - 1.0;
            let error = [e.x, e.y, e.z, t.x, t.y, t.z, scale];
            let error = DVector::from_row_slice(&error[..mode.free()]);
            sums += &error * error.transpose() / runs as f64;
            stated += &found.covariance / runs as f64;
            sigma0 += found.sigma0.unwrap().powi(2) / runs as f64;
        }
        assert!((sigma0 - 1.0).abs() < 0.03, "{sigma0}");
        for k in 0..mode.free() {
            // A deviation from 1500 draws is good to 1.8 %.
            let ratio = (sums[(k, k)] / stated[(k, k)]).sqrt();
            assert!(
                (ratio - 1.0).abs() < 0.06,
                "{:?} {}: {ratio}",
                mode,
                mode.names()[k]
            );
        }
    }
}

#[test]
fn heights_of_less_accuracy_weigh_less() {
    let mut points = points(&EIGHT, truth(), 0.0, 1);
    let plain = fit(&points, Mode::Seven).unwrap();
    points[3].r_ecef_m = plain
        .site
        .enu_to_ecef(plain.site.ecef_to_enu(points[3].r_ecef_m) + DVec3::Z);
    let equal = fit(&points, Mode::Seven).unwrap();
    points[3].sigma_m = [0.01, 10.0];
    let weighted = fit(&points, Mode::Seven).unwrap();
    let off = |fit: &Fit| apart_m(&fit.placement, &truth(), &EIGHT);
    assert!(
        off(&equal) > 0.2 && off(&weighted) < 1e-5,
        "{} {}",
        off(&equal),
        off(&weighted)
    );
    assert!((weighted.residuals_enu_m[3].z - 1.0).abs() < 1e-3);
}

#[test]
fn a_swapped_pair_is_named() {
    let mut named = 0;
    for (seed, (i, j)) in [(4, 6), (0, 1), (2, 7), (5, 3)].into_iter().enumerate() {
        let mut points = points(&EIGHT, truth(), 0.02, seed as u64);
        let r = points[i].r_ecef_m;
        points[i].r_ecef_m = points[j].r_ecef_m;
        points[j].r_ecef_m = r;
        let want = Suspect::Swapped(i.min(j), i.max(j));
        assert_eq!(suspects(&points, Mode::Seven).unwrap(), [want]);
        named += 1;
    }
    assert_eq!(named, 4);
    // With four points, of which two cannot be left out.
    let mut four = points(&EIGHT[..4], truth(), 0.02, 9);
    let r = four[1].r_ecef_m;
    four[1].r_ecef_m = four[2].r_ecef_m;
    four[2].r_ecef_m = r;
    assert_eq!(
        suspects(&four, Mode::Seven).unwrap(),
        [Suspect::Swapped(1, 2)]
    );
}

#[test]
fn mistyped_points_are_named() {
    let mut points = points(&EIGHT, truth(), 0.02, 5);
    let site = home();
    // A digit of the northing.
    let north = site.ecef_to_enu(points[4].r_ecef_m) + DVec3::Y * 100.0;
    points[4].r_ecef_m = site.enu_to_ecef(north);
    let [Suspect::Off(4, off)] = suspects(&points, Mode::Seven).unwrap()[..] else {
        panic!("{:?}", suspects(&points, Mode::Seven));
    };
    assert!((off - DVec3::Y * 100.0).length() < 0.2, "{off}");
    // And a second one beside it.
    points[0].r_local.x += 0.5;
    let found = suspects(&points, Mode::Seven).unwrap();
    assert!(
        matches!(found[..], [Suspect::Off(0, _), Suspect::Off(4, _)]),
        "{found:?}"
    );
}

#[test]
fn good_points_are_rarely_suspected() {
    let mut wrong = 0;
    for seed in 0..300 {
        let local = &EIGHT[..5 + seed as usize % 4];
        wrong += usize::from(
            !suspects(&points(local, truth(), 0.02, seed), Mode::Seven)
                .unwrap()
                .is_empty(),
        );
    }
    // A few in a thousand by its set-up.
    assert!(wrong <= 3, "{wrong} of 300");
}

#[test]
fn degenerate_sets_are_one_error_and_near_ones_a_warning() {
    let line = [
        [0.0, 0.0, 0.0],
        [100.0, 50.0, 1.0],
        [200.0, 100.0, 2.0],
        [300.0, 150.0, 3.0],
    ];
    let error = |local: &[[f64; 3]], mode| fit(&points(local, truth(), 0.0, 1), mode).unwrap_err();
    assert!(matches!(
        error(&line, Mode::Seven),
        GeoreferenceError::Collinear(_)
    ));
    assert!(matches!(
        error(&[[1.0; 3]; 4], Mode::Seven),
        GeoreferenceError::Coincident(_)
    ));
    assert!(matches!(
        error(&EIGHT[..2], Mode::FixedScale),
        GeoreferenceError::TooFew { fewest: 3, .. }
    ));
    assert!(fit(&points(&line, truth(), 0.0, 1), Mode::Paper).is_ok());
    let mut off = line;
    off[1][1] += 2.0;
    let found = fit(&points(&off, truth(), 0.0, 1), Mode::Seven).unwrap();
    assert!(
        found.spread < 0.01 && found.warnings[0].contains("almost on a line"),
        "{:?}",
        found.warnings
    );
    let mut twice = points(&EIGHT, truth(), 0.0, 1);
    twice[5].r_ecef_m = twice[2].r_ecef_m;
    assert!(matches!(
        fit(&twice, Mode::Seven),
        Err(GeoreferenceError::Twice(..))
    ));
    twice[5].r_ecef_m = DVec3::NAN;
    assert!(matches!(
        fit(&twice, Mode::Seven),
        Err(GeoreferenceError::NotFinite(..))
    ));
    // East and north exchanged in one list.
    let mirrored = EIGHT.map(|[x, y, z]| [y, x, z]);
    let mut points = points(&EIGHT, truth(), 0.0, 1);
    for (point, local) in points.iter_mut().zip(mirrored) {
        point.r_local = local.into();
    }
    let found = fit(&points, Mode::Seven).unwrap();
    assert!(
        found.warnings.iter().any(|w| w.contains("mirrored")),
        "{:?}",
        found.warnings
    );
}

#[test]
fn the_jacobian_is_the_residuals_derivative() {
    for mode in [Mode::Seven, Mode::FixedScale, Mode::Paper] {
        let (pairs, ..) = prepare(&points(&EIGHT, truth(), 0.02, 1), mode).unwrap();
        let about = pairs.closed_form(mode, &[0, 1, 2, 3, 4]).unwrap();
        let x = DVector::from_fn(mode.free(), |k, _| 0.1 + 0.05 * k as f64);
        let mut problem = Problem {
            pairs: &pairs,
            about,
            mode,
            x,
        };
        let numeric = levenberg_marquardt::differentiate_numerically(&mut problem).unwrap();
        let exact = problem.jacobian().unwrap();
        assert!((&numeric - &exact).amax() < 1e-5 * exact.amax(), "{mode:?}");
    }
}

proptest! {
    #[test]
    fn any_points_give_a_fit_or_an_error(values in prop::collection::vec(-1e7_f64..1e7, 30), mode in 0..3_usize) {
        let points: Vec<ControlPoint> = values.chunks(6).enumerate().map(|(k, v)| ControlPoint {
            name: k.to_string(),
            r_local: DVec3::new(v[0], v[1], v[2]),
            r_ecef_m: DVec3::new(v[3], v[4], v[5]),
            sigma_m: [0.01, 0.02],
        }).collect();
        let mode = [Mode::Seven, Mode::FixedScale, Mode::Paper][mode];
        if let Ok(found) = fit(&points, mode) {
            prop_assert!(found.rms_m.is_finite());
        }
        let _ = suspects(&points, mode);
    }
}
